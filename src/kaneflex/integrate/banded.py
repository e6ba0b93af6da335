"""The compiled loop `newmark_chain`: Newmark's family for long chains, see `kaneflex.integrate.banded_slices`.

It takes the arguments of `kaneflex.integrate.steppers.newmark`, with a Chain in the place of `packed`, and makes the
same steps. Where that one adds up M, C and K for LANES steps, this one adds up M + c C + k K alone, and multiplies C
and K by vectors as the sums of scalar x constant matrix that they are, LANES rows at once.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import lanes, matrices
from kaneflex.integrate.lanes import FASTMATH, LANES, at, eliminate_row, less, put, put_run, run_at, size, total, turn
from kaneflex.integrate.matrices import (
    COMPLETED,
    ONE,
    SINGULAR,
    SMALLEST_PIVOT,
    THREE,
    TWO,
    UNBOUNDED,
    compiled,
    inlined,
    room,
    weights,
)  # fmt: skip
from kaneflex.support.fingerprint import made_of

NODES = LANES  # of a slice: consecutive ones, a number of each in a register
PER_NODE = 3  # displacements u, w and a rotation
BAND = 5  # largest |i - j|: neighbouring nodes
WIDTH = 2 * BAND + 1
ROWS = NODES * PER_NODE  # of a slice
MARGIN = 8  # zeros before and behind the nodes' numbers, which runs at the ends read

# unsigned, as in `matrices`
_PER_NODE, _NODES, _ROWS, _WIDTH, _BAND, _MARGIN = map(np.uint64, (PER_NODE, NODES, ROWS, WIDTH, BAND, MARGIN))
_SLOTS = _ROWS * _WIDTH  # of a slice
_STEP = _BAND + ONE  # numbers that a row keeps for those that follow: its reciprocal pivot, and what is right of it
_SQUARES = _SLOTS // _NODES


@inlined
def _add_up(ends, what, values, group, scalars, block, sums, slot, apart):
    """Sum of scalar x constant matrix over the runs of a group, in lanes, for each of its NODES entries."""
    sum_0 = sum_1 = sum_2 = sum_3 = sum_4 = sum_5 = sum_6 = sum_7 = 0.0 * at(scalars, (block, 0))
    for k in range(ends[group], ends[group + ONE]):
        scalar = at(scalars, (block, what[k]))
        sum_0 += scalar * values[k, 0]
        sum_1 += scalar * values[k, 1]
        sum_2 += scalar * values[k, 2]
        sum_3 += scalar * values[k, 3]
        sum_4 += scalar * values[k, 4]
        sum_5 += scalar * values[k, 5]
        sum_6 += scalar * values[k, 6]
        sum_7 += scalar * values[k, 7]
    for number in (sum_0, sum_1, sum_2, sum_3, sum_4, sum_5, sum_6, sum_7):
        put(sums, slot, number)
        slot += apart


@compiled
def _factors(chain, scalars, block, band_at, good_at):
    """M + c C + k K = L D U for LANES steps, handed over to them slice by slice; and whether no pivot vanishes.

    A row's slots become its shares of the rows before it, the reciprocal pivot, and U.
    """
    n, slices = chain.n, chain.slices
    ends, what, values = chain.effective
    size_ends, size_what, size_values = chain.sizes
    band, scale, good = np.empty((_SLOTS, LANES)), room(_ROWS), room(ONE)
    above = np.zeros(((_ROWS + _BAND) * _STEP, LANES))  # rows for those that follow, BAND of them from the slice before
    magnitudes = np.empty((1, scalars.shape[1], LANES))
    for k in range(scalars.shape[1]):
        put(magnitudes, (0, k), size(at(scalars, (block, k))))
    regular = less(-1.0, at(magnitudes, (0, 0)))
    for part in range(slices):
        group = part * _PER_NODE
        for each in range(_PER_NODE * _WIDTH):
            _add_up(ends, what, values, group * _WIDTH + each, scalars, block, band, each, _PER_NODE * _WIDTH)
        for r in range(_PER_NODE):
            _add_up(size_ends, size_what, size_values, group + r, magnitudes, 0, scale, r, _PER_NODE)
        for k in range(_BAND * _STEP):
            put(above, k, at(above, k + _ROWS * _STEP))
        for row in range(min(n - part * _ROWS, _ROWS)):
            pivot = eliminate_row(band, row * _WIDTH, above, row + _BAND, WIDTH)
            regular *= less(SMALLEST_PIVOT * at(scale, row), size(pivot))
        for square in range(_SQUARES):
            turn(band, square * _NODES, band_at, part * _SLOTS + square * _NODES)
    put(good, 0, regular)
    turn(good, 0, good_at, 0)


@inlined
def _multiply(table, scalars, block, row, vector, column, products):
    """What runs of -C or -K are multiplied by: scalar times the vector."""
    for k in range(table.shape[0]):
        scalar = scalars[block, table[k, 0], row]
        source = table[k, 1]
        place = table[k, 3]
        for run in range(table[k, 2]):
            put_run(products, place + run * _NODES, scalar * run_at(vector, (column, source + run * _NODES)))


@inlined
def _unbalanced(ends, what, values, slices, stride, products, rest, column):
    """F - C v - K z at one step."""
    zero = 0.0 * run_at(rest, (column, 0))
    group = 0 * ONE
    for part in range(slices):
        for r in range(_PER_NODE):
            even = odd = zero  # two sums, for an addition waits for the one before it
            for k in range(ends[group] // TWO, ends[group + ONE] // TWO):
                even += at(values, TWO * k) * run_at(products, what[TWO * k])
                odd += at(values, TWO * k + ONE) * run_at(products, what[TWO * k + ONE])
            group += ONE
            put_run(rest, (column, r * stride + _MARGIN + part * _NODES), even + odd)


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
            known = at(x, place) - at(band, (row, slot)) * x_5 - at(band, (row, slot + ONE)) * x_4
            known = known - at(band, (row, slot + TWO)) * x_3 - at(band, (row, slot + THREE)) * x_2
            known = known - at(band, (row, slot + THREE + ONE)) * x_1
            put(x, place, known * at(band, (row, slot + _BAND)))
            x_5, x_4, x_3, x_2, x_1 = x_4, x_3, x_2, x_1, known
            slot += _WIDTH
    x_1 = x_2 = x_3 = x_4 = x_5 = 0.0
    for back in range(nodes):
        node = nodes - ONE - back
        slot = (node * _PER_NODE + TWO) * _WIDTH + _BAND
        for start in starts[::-1]:
            place = (column, start + node)
            known = at(x, place) - at(band, (row, slot + _BAND)) * x_5 - at(band, (row, slot + _BAND - ONE)) * x_4
            known = known - at(band, (row, slot + THREE)) * x_3 - at(band, (row, slot + TWO)) * x_2
            known = known - at(band, (row, slot + ONE)) * x_1
            put(x, place, known)
            x_5, x_4, x_3, x_2, x_1 = x_4, x_3, x_2, x_1, known
            slot -= _WIDTH


@compiled
def _spread(chain, narrow):
    """Vectors of n unknowns in the chain's own order."""
    wide = np.zeros((narrow.shape[0], chain.width))
    for column in range(narrow.shape[0]):
        for i in range(chain.n):
            place = i % _PER_NODE * chain.stride + _MARGIN + i // _PER_NODE
            wide[column, place] = narrow[column, i]
    return wide


@compiled
def _gather(chain, wide, column, narrow, row):
    """The n unknowns of one of them."""
    for i in range(chain.n):
        narrow[row, i] = wide[column, i % _PER_NODE * chain.stride + _MARGIN + i // _PER_NODE]


# Without "reassoc" for `_solve`, whose sums are kept in their order.
@njit(cache=True, error_model="numpy", fastmath=FASTMATH - {"reassoc"}, no_cfunc_wrapper=True)
@made_of(lanes.__file__, matrices.__file__)
def newmark_chain(chain, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    """The steps of `kaneflex.integrate.steppers.newmark`, where they are explained."""
    step, from_q, from_a, kappa, c_weight, k_weight, v_start, v_known, z_start, z_known = weights(coefficients)
    slices, stride, (ends, what, values) = chain.slices, chain.stride, chain.unbalanced
    loads, speeds, displacements = chain.loads, chain.speeds, chain.displacements
    z, v, a, q = _spread(chain, state[0]), _spread(chain, state[1]), _spread(chain, state[2]), _spread(chain, state[3])
    band_at, good_at = np.empty((LANES, slices * _SLOTS)), np.empty((LANES, LANES))
    products = np.empty(chain.products)
    runs = chain.width // _NODES
    due = every - done % every
    out = done // every + 1
    count, status = 0, COMPLETED
    while count < n_steps and status == COMPLETED:
        block, row = position // LANES, position % LANES
        if row == 0 or count == 0:
            _factors(chain, scalars, block, band_at, good_at)
        if not good_at[row, 0] > 0.0:
            status = SINGULAR
            break
        for column in range(load.shape[0]):
            for run in range(runs):
                here = (column, run * _NODES)
                before, speed = run_at(a, here), run_at(v, here)
                known = from_q * run_at(q, here) + from_a * before
                put_run(z, here, run_at(z, here) + step * speed + z_start * before + z_known * known)
                put_run(v, here, speed + v_start * before + v_known * known)
                put_run(a, here, known)
            for k in range(loads.shape[0]):
                put_run(products, loads[k, 3], load[column] * scalars[block, loads[k, 0], row])
            _multiply(speeds, scalars, block, row, v, column, products)
            _multiply(displacements, scalars, block, row, z, column, products)
            _unbalanced(ends, what, values, slices, stride, products, q, column)
            _solve(slices, stride, band_at, row, q, column)
            squares = 0.0 * run_at(z, (column, 0))
            for run in range(runs):
                here = (column, run * _NODES)
                found = run_at(q, here)
                moved = run_at(z, here) + k_weight * found
                put_run(z, here, moved)
                put_run(v, here, run_at(v, here) + c_weight * found)
                put_run(a, here, run_at(a, here) + kappa * found)
                squares += moved * moved
            if not total(squares) < bound:
                status = UNBOUNDED
        count += 1
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            for wide, narrow in ((z, stored[0]), (v, stored[1]), (q, stored[2])):
                _gather(chain, wide, 0, narrow, out)
            out += 1
    for wide, narrow in ((z, state[0]), (v, state[1]), (a, state[2]), (q, state[3])):
        for column in range(load.shape[0]):
            _gather(chain, wide, column, narrow, column)
    return count, status
