"""The compiled loop `newmark_banded`: Newmark's family for long chains, see `kaneflex.integrate.banded_slices`.

It takes the arguments of `kaneflex.integrate.steppers.newmark`, with a BandedSystem in the place of `packed`, and makes
the same steps. Where that one adds up M, C and K for LANES steps, this one adds up M + c C + k K alone, and multiplies
C and K by vectors as the sums of scalar x constant matrix that they are, LANES rows at once.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import banded_slices, conventions, lanes, matrices
from kaneflex.integrate.banded_slices import BAND, MARGIN, NODES, PER_NODE, ROWS, WIDTH
from kaneflex.integrate.conventions import COMPLETED, FASTMATH, LANES, SINGULAR, UNBOUNDED
from kaneflex.integrate.lanes import (
    absolute,
    eliminate_row,
    lane_sum,
    less,
    load,
    load_run,
    store,
    store_run,
    transpose,
)
from kaneflex.integrate.matrices import (
    ONE,
    SMALLEST_PIVOT,
    THREE,
    TWO,
    compiled,
    empty_lanes,
    inlined,
    weights,
)  # fmt: skip
from kaneflex.support.fingerprint import made_of

# unsigned, as in `matrices`
_PER_NODE, _NODES, _ROWS, _WIDTH, _BAND, _MARGIN = map(np.uint64, (PER_NODE, NODES, ROWS, WIDTH, BAND, MARGIN))
_SLOTS = _ROWS * _WIDTH  # of a slice
_STEP = _BAND + ONE  # numbers that a row keeps for those that follow: its reciprocal pivot, and what is right of it
_SQUARES = _SLOTS // _NODES


# Compiled in one piece, as the loops of `steppers` are; the sums of `_add_up` are eight names, which stay in registers.
@inlined
def _add_up(ends, what, values, group, scalars, block, sums, slot, apart):
    """Sum of scalar x constant matrix over the runs of a group, in lanes, for each of its NODES entries."""
    sum_0 = sum_1 = sum_2 = sum_3 = sum_4 = sum_5 = sum_6 = sum_7 = 0.0 * load(scalars, (block, 0))
    for k in range(ends[group], ends[group + ONE]):
        scalar = load(scalars, (block, what[k]))
        sum_0 += scalar * values[k, 0]
        sum_1 += scalar * values[k, 1]
        sum_2 += scalar * values[k, 2]
        sum_3 += scalar * values[k, 3]
        sum_4 += scalar * values[k, 4]
        sum_5 += scalar * values[k, 5]
        sum_6 += scalar * values[k, 6]
        sum_7 += scalar * values[k, 7]
    for number in (sum_0, sum_1, sum_2, sum_3, sum_4, sum_5, sum_6, sum_7):
        store(sums, slot, number)
        slot += apart


@compiled
def _factors(system, scalars, block, band_rows, good_rows):
    """M + c C + k K = L D U for LANES steps, handed over to them slice by slice; and whether no pivot vanishes.

    A row's slots become its shares of the rows before it, the reciprocal pivot, and U.
    """
    n, slices = system.n, system.slices
    ends, what, values = system.effective
    size_ends, size_what, size_values = system.sizes
    band, scale, good = np.empty((_SLOTS, LANES)), empty_lanes(_ROWS), empty_lanes(ONE)
    above = np.zeros(((_ROWS + _BAND) * _STEP, LANES))  # rows for those that follow, BAND of them from the slice before
    magnitudes = np.empty((1, scalars.shape[1], LANES))
    for k in range(scalars.shape[1]):
        store(magnitudes, (0, k), absolute(load(scalars, (block, k))))
    regular = less(-1.0, load(magnitudes, (0, 0)))
    for part in range(slices):
        group = part * _PER_NODE
        for each in range(_PER_NODE * _WIDTH):
            _add_up(ends, what, values, group * _WIDTH + each, scalars, block, band, each, _PER_NODE * _WIDTH)
        for r in range(_PER_NODE):
            _add_up(size_ends, size_what, size_values, group + r, magnitudes, 0, scale, r, _PER_NODE)
        for k in range(_BAND * _STEP):
            store(above, k, load(above, k + _ROWS * _STEP))
        for row in range(min(n - part * _ROWS, _ROWS)):
            pivot = eliminate_row(band, row * _WIDTH, above, row + _BAND, WIDTH)
            regular *= less(SMALLEST_PIVOT * load(scale, row), absolute(pivot))
        for square in range(_SQUARES):
            transpose(band, square * _NODES, band_rows, part * _SLOTS + square * _NODES)
    store(good, 0, regular)
    transpose(good, 0, good_rows, 0)


@inlined
def _multiply(table, scalars, block, row, vector, column, products):
    """Factors of the runs of -C or -K: scalar times the vector."""
    for k in range(table.shape[0]):
        scalar = scalars[block, table[k, 0], row]
        source = table[k, 1]
        place = table[k, 3]
        for run in range(table[k, 2]):
            store_run(products, place + run * _NODES, scalar * load_run(vector, (column, source + run * _NODES)))


@inlined
def _residual(ends, what, values, slices, stride, products, rest, column):
    """F - C v - K z at one step."""
    zero = 0.0 * load_run(rest, (column, 0))
    group = 0 * ONE
    for part in range(slices):
        for r in range(_PER_NODE):
            even = odd = zero  # two sums, for an addition waits for the one before it
            for k in range(ends[group] // TWO, ends[group + ONE] // TWO):
                even += load(values, TWO * k) * load_run(products, what[TWO * k])
                odd += load(values, TWO * k + ONE) * load_run(products, what[TWO * k + ONE])
            group += ONE
            store_run(rest, (column, r * stride + _MARGIN + part * _NODES), even + odd)


@inlined
def _solve(slices, stride, band, row, x, column):
    """Solve L D U x = x: of each sum only the last product waits for the number before it, without "reassoc"."""
    nodes = slices * _NODES
    starts = (_MARGIN, _MARGIN + stride, _MARGIN + TWO * stride)
    x_1 = x_2 = x_3 = x_4 = x_5 = 0.0
    for node in range(nodes):
        slot = node * _PER_NODE * _WIDTH
        for start in starts:
            place = (column, start + node)
            known = load(x, place) - load(band, (row, slot)) * x_5 - load(band, (row, slot + ONE)) * x_4
            known = known - load(band, (row, slot + TWO)) * x_3 - load(band, (row, slot + THREE)) * x_2
            known = known - load(band, (row, slot + THREE + ONE)) * x_1
            store(x, place, known * load(band, (row, slot + _BAND)))
            x_5, x_4, x_3, x_2, x_1 = x_4, x_3, x_2, x_1, known
            slot += _WIDTH
    x_1 = x_2 = x_3 = x_4 = x_5 = 0.0
    for back in range(nodes):
        node = nodes - ONE - back
        slot = (node * _PER_NODE + TWO) * _WIDTH + _BAND
        for start in starts[::-1]:
            place = (column, start + node)
            known = load(x, place) - load(band, (row, slot + _BAND)) * x_5 - load(band, (row, slot + _BAND - ONE)) * x_4
            known = known - load(band, (row, slot + THREE)) * x_3 - load(band, (row, slot + TWO)) * x_2
            known = known - load(band, (row, slot + ONE)) * x_1
            store(x, place, known)
            x_5, x_4, x_3, x_2, x_1 = x_4, x_3, x_2, x_1, known
            slot -= _WIDTH


@compiled
def _scatter(system, narrow):
    """Vectors of n unknowns in the system's own order."""
    wide = np.zeros((narrow.shape[0], system.width))
    for column in range(narrow.shape[0]):
        for i in range(system.n):
            place = i % _PER_NODE * system.stride + _MARGIN + i // _PER_NODE
            wide[column, place] = narrow[column, i]
    return wide


@compiled
def _gather(system, wide, column, narrow, row):
    """The n unknowns of one of them."""
    for i in range(system.n):
        narrow[row, i] = wide[column, i % _PER_NODE * system.stride + _MARGIN + i // _PER_NODE]


# Without "reassoc" for `_solve`, whose sums are kept in their order.
@njit(cache=True, error_model="numpy", fastmath=FASTMATH - {"reassoc"}, no_cfunc_wrapper=True)
@made_of(banded_slices.__file__, conventions.__file__, lanes.__file__, matrices.__file__)
def newmark_banded(
    system, scalars, period, position, n_steps, coefficients, load_factor, state, done, every, bound, stored
):
    """The steps of `kaneflex.integrate.steppers.newmark`, where they are explained."""
    step, from_q, from_a, kappa, c_weight, k_weight, v_start, v_known, z_start, z_known = weights(coefficients)
    slices, stride, (ends, what, values) = system.slices, system.stride, system.residual
    loads, speeds, displacements = system.loads, system.speeds, system.displacements
    z, v = _scatter(system, state[0]), _scatter(system, state[1])
    a, q = _scatter(system, state[2]), _scatter(system, state[3])
    band_rows, good_rows = np.empty((LANES, slices * _SLOTS)), np.empty((LANES, LANES))
    products = np.empty(system.products)
    runs = system.width // _NODES
    due = every - done % every
    out = done // every + 1
    count, status = 0, COMPLETED
    while count < n_steps and status == COMPLETED:
        block, row = position // LANES, position % LANES
        if row == 0 or count == 0:
            _factors(system, scalars, block, band_rows, good_rows)
        if not good_rows[row, 0] > 0.0:
            status = SINGULAR
            break
        for column in range(load_factor.shape[0]):
            for run in range(runs):
                here = (column, run * _NODES)
                before, speed = load_run(a, here), load_run(v, here)
                known = from_q * load_run(q, here) + from_a * before
                store_run(z, here, load_run(z, here) + step * speed + z_start * before + z_known * known)
                store_run(v, here, speed + v_start * before + v_known * known)
                store_run(a, here, known)
            for k in range(loads.shape[0]):
                store_run(products, loads[k, 3], load_factor[column] * scalars[block, loads[k, 0], row])
            _multiply(speeds, scalars, block, row, v, column, products)
            _multiply(displacements, scalars, block, row, z, column, products)
            _residual(ends, what, values, slices, stride, products, q, column)
            _solve(slices, stride, band_rows, row, q, column)
            squares = 0.0 * load_run(z, (column, 0))
            for run in range(runs):
                here = (column, run * _NODES)
                found = load_run(q, here)
                moved = load_run(z, here) + k_weight * found
                store_run(z, here, moved)
                store_run(v, here, load_run(v, here) + c_weight * found)
                store_run(a, here, load_run(a, here) + kappa * found)
                squares += moved * moved
            if not lane_sum(squares) < bound:
                status = UNBOUNDED
        count += 1
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            for wide, narrow in ((z, stored[0]), (v, stored[1]), (q, stored[2])):
                _gather(system, wide, 0, narrow, out)
            out += 1
    for wide, narrow in ((z, state[0]), (v, state[1]), (a, state[2]), (q, state[3])):
        for column in range(load_factor.shape[0]):
            _gather(system, wide, column, narrow, column)
    return count, status
