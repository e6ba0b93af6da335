"""The compiled loop `newmark_chain`: Newmark's family for long chains of narrow band, see `kaneflex.integrate.sliced`.

It takes the arguments of `kaneflex.integrate.steppers.newmark`, with a Chain in the place of `packed`, and makes the
same steps. Where that one adds up M, C and K for LANES steps, this one adds up M + c C + k K alone, and multiplies C
and K by vectors as the sums of scalar x constant matrix that they are, LANES rows at once.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import lanes, matrices, steppers
from kaneflex.integrate.lanes import (
    FASTMATH,
    LANES,
    at,
    eliminate_row,
    less,
    put,
    put_run,
    run_at,
    size,
    total,
    turn,
)
from kaneflex.integrate.matrices import ONE, SMALLEST_PIVOT, TWO, compiled
from kaneflex.integrate.steppers import COMPLETED, SINGULAR, UNBOUNDED
from kaneflex.stamp import stamp

NODES = LANES  # of a slice: consecutive ones, a number of each in a register
PER_NODE = 3  # displacements u, w and a rotation
BAND = 5  # largest |i - j|: neighbouring nodes
WIDTH = 2 * BAND + 1
ROWS = NODES * PER_NODE  # of a slice
MARGIN = 8  # zeros before and behind the nodes' numbers, which runs at the ends read

_MADE_OF = stamp(lanes.__file__, matrices.__file__, steppers.__file__)
# unsigned, as in `matrices`
_PER_NODE, _NODES, _ROWS, _WIDTH, _BAND, _MARGIN = map(np.uint64, (PER_NODE, NODES, ROWS, WIDTH, BAND, MARGIN))
_SLOTS = _ROWS * _WIDTH
_SQUARES = _SLOTS // _NODES


@compiled
def _sums_of_a_slice(runs, group, scalars, block, band):
    """All rows of a slice of the effective matrix, in lanes."""
    ends, what, values = runs
    zero = 0.0 * at(scalars, (block, 0))
    for r in range(_PER_NODE):
        for d in range(_WIDTH):
            sum_0 = sum_1 = sum_2 = sum_3 = sum_4 = sum_5 = sum_6 = sum_7 = zero
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
            group += ONE
            slot = r * _WIDTH + d
            for number in (sum_0, sum_1, sum_2, sum_3, sum_4, sum_5, sum_6, sum_7):
                put(band, slot, number)
                slot += _PER_NODE * _WIDTH


@compiled
def _scale(runs, group, node, scalars, block):
    """Sum of the absolute values of what was added up in a diagonal, in lanes."""
    ends, what, values = runs
    scale = 0.0 * at(scalars, (block, 0))
    for k in range(ends[group], ends[group + ONE]):
        scale += size(at(scalars, (block, what[k]))) * values[k, node]
    return scale


@compiled
def _factors(chain, scalars, block, band, above, good, band_at, good_at):
    """M + c C + k K = L D U for LANES steps, handed over to them slice by slice."""
    regular = less(-1.0, at(scalars, (block, 0)) * 0.0)
    for i in range(above.shape[0]):
        put(above, i, 0.0)
    for part in range(chain.slices):
        _sums_of_a_slice(chain.effective, part * _PER_NODE * _WIDTH, scalars, block, band)
        for row in range(_BAND * (_BAND + ONE)):
            put(above, row, at(above, _ROWS * (_BAND + ONE) + row))
        for row in range(min(_ROWS, chain.n - part * _ROWS)):
            pivot = eliminate_row(band, row * _WIDTH, above, row + _BAND, WIDTH)
            scale = _scale(chain.sizes, part * _PER_NODE + row % _PER_NODE, row // _PER_NODE, scalars, block)
            regular *= less(SMALLEST_PIVOT * scale, size(pivot))
        for square in range(_SQUARES):
            turn(band, square * _NODES, band_at, part * _SLOTS + square * _NODES)
    put(good, 0, regular)
    turn(good, 0, good_at, 0)


@compiled
def _multiply(table, scalars, block, row, vector, column, products):
    """What runs of -C or -K are multiplied by: scalar times the vector."""
    for k in range(table.shape[0]):
        scalar = scalars[block, table[k, 0], row]
        source = table[k, 1]
        place = table[k, 3]
        for run in range(table[k, 2]):
            put_run(products, place + run * _NODES, scalar * run_at(vector, (column, source + run * _NODES)))


@compiled
def _unbalanced(chain, scalars, block, row, load, z, v, rest, column, products):
    """F - C v - K z at one step."""
    for k in range(chain.loads.shape[0]):
        put_run(products, chain.loads[k, 3], load * scalars[block, chain.loads[k, 0], row])
    _multiply(chain.speeds, scalars, block, row, v, column, products)
    _multiply(chain.displacements, scalars, block, row, z, column, products)
    ends, what, values = chain.unbalanced
    group = 0 * ONE
    for part in range(chain.slices):
        for r in range(_PER_NODE):
            even = odd = 0.0 * run_at(rest, (column, _MARGIN))
            for k in range(ends[group] // TWO, ends[group + ONE] // TWO):
                even += at(values, TWO * k) * run_at(products, what[TWO * k])
                odd += at(values, TWO * k + ONE) * run_at(products, what[TWO * k + ONE])
            group += ONE
            put_run(rest, (column, r * chain.stride + _MARGIN + part * _NODES), even + odd)


@compiled
def _solve(chain, band, row, x, column):
    """Solve L D U x = x."""
    first, second, third = _MARGIN, chain.stride + _MARGIN, chain.stride + chain.stride + _MARGIN
    x_1 = x_2 = x_3 = x_4 = x_5 = 0.0
    nodes = chain.slices * _NODES
    for node in range(nodes):
        slot = node * _PER_NODE * _WIDTH
        for start in (first, second, third):
            place = (column, start + node)
            known = at(x, place) - at(band, (row, slot)) * x_5 - at(band, (row, slot + ONE)) * x_4
            known = known - at(band, (row, slot + TWO)) * x_3 - at(band, (row, slot + TWO + ONE)) * x_2
            known = known - at(band, (row, slot + TWO + TWO)) * x_1
            put(x, place, known * at(band, (row, slot + _BAND)))
            x_5, x_4, x_3, x_2, x_1 = x_4, x_3, x_2, x_1, known
            slot += _WIDTH
    x_1 = x_2 = x_3 = x_4 = x_5 = 0.0
    for back in range(nodes):
        node = nodes - ONE - back
        slot = (node * _PER_NODE + TWO) * _WIDTH + _BAND
        for start in (third, second, first):
            place = (column, start + node)
            known = at(x, place) - at(band, (row, slot + _BAND)) * x_5
            known = known - at(band, (row, slot + _BAND - ONE)) * x_4 - at(band, (row, slot + TWO + ONE)) * x_3
            known = known - at(band, (row, slot + TWO)) * x_2 - at(band, (row, slot + ONE)) * x_1
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


@njit(cache=True, error_model="numpy", fastmath=FASTMATH)
def newmark_chain(
    chain, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored, made_of=_MADE_OF
):
    """The steps of `kaneflex.integrate.steppers.newmark`, where they are explained."""
    step, from_q, from_a, kappa, c_weight, k_weight, v_start, v_known, z_start, z_known = coefficients
    columns = load.shape[0]
    z, v, a, q = _spread(chain, state[0]), _spread(chain, state[1]), _spread(chain, state[2]), _spread(chain, state[3])
    band, above = np.zeros((_SLOTS, LANES)), np.zeros(((_ROWS + _BAND) * (_BAND + ONE), LANES))
    good, good_at = np.empty((LANES, LANES)), np.empty((LANES, LANES))
    band_at, products = np.empty((LANES, chain.slices * _SLOTS)), np.empty(chain.products)
    runs = chain.width // _NODES
    due = every - done % every
    out = done // every + 1
    count, status = 0, COMPLETED
    while count < n_steps and status == COMPLETED:
        block, row = position // LANES, position % LANES
        if row == 0 or count == 0:
            _factors(chain, scalars, block, band, above, good, band_at, good_at)
        if not good_at[row, 0] > 0.0:
            status = SINGULAR
            break
        for column in range(columns):
            for run in range(runs):
                here = (column, run * _NODES)
                before, speed = run_at(a, here), run_at(v, here)
                known = from_q * run_at(q, here) + from_a * before
                put_run(z, here, run_at(z, here) + step * speed + z_start * before + z_known * known)
                put_run(v, here, speed + v_start * before + v_known * known)
                put_run(a, here, known)
            _unbalanced(chain, scalars, block, row, load[column], z, v, q, column, products)
            _solve(chain, band_at, row, q, column)
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
        for column in range(columns):
            _gather(chain, wide, column, narrow, column)
    return count, status
