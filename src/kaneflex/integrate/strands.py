"""Compiled parts of the loop for long chains: its matrices, eliminated from both ends, and products with them.

What they read is laid out by `kaneflex.integrate.sliced`, where its terms are explained. None of them is cached for
itself: they are compiled into the loop that calls them.
"""

import numpy as np
from numba import njit

from kaneflex.integrate.lanes import FASTMATH, LANES, at, eliminate_row, less, put, put_run, run_at, size, turn
from kaneflex.integrate.matrices import ONE, SMALLEST_PIVOT, THREE, TWO, compiled, factor, inlined, room, solve

NODES = LANES  # of a slice: consecutive ones, a number of each in a register
PER_NODE = 3  # displacements u, w and a rotation
BAND = 5  # largest |i - j|: neighbouring nodes
WIDTH = 2 * BAND + 1
ROWS = NODES * PER_NODE  # of a slice
MARGIN = 8  # zeros before and behind the nodes' numbers, which runs at the ends read

# unsigned, as in `matrices`
_PER_NODE, _NODES, _ROWS, _WIDTH, _BAND, _MARGIN = map(np.uint64, (PER_NODE, NODES, ROWS, WIDTH, BAND, MARGIN))
_SLOTS = _ROWS * _WIDTH  # of a slice
_ABOVE = _ROWS + _BAND  # rows kept for those that follow, BAND of them from the slice before
_STEP = _BAND + ONE  # numbers of each

# sums as they are written, so that only their last product waits for the number before
_in_order = njit(error_model="numpy", fastmath=FASTMATH - {"reassoc"})


@inlined
def _add_up(runs, group, scalars, block, sums, slot, apart):
    """Sum of scalar x constant matrix over the runs of a group, in lanes, for each of its NODES entries."""
    ends, what, values = runs
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
def _slice_sums(chain, part, scalars, block, magnitudes, band, scale, first_row):
    """All rows of a slice of M + c C + k K, and the sizes of what is added up in their diagonals, in lanes."""
    for r in range(_PER_NODE):
        group = part * _PER_NODE + r
        for d in range(_WIDTH):
            slot = (first_row + r) * _WIDTH + d
            _add_up(chain.effective, group * _WIDTH + d, scalars, block, band, slot, _PER_NODE * _WIDTH)
        _add_up(chain.sizes, group, magnitudes, 0, scale, first_row + r, _PER_NODE)


@compiled
def _meet(chain, strand, row, c, above_row, band, above, core, scale, core_scale):
    """Row c of the core along a strand: what is left of it after the strand's own rows is added to the core's matrix.

    In place its shares of those rows, and the unit matrix, which lets what the core finds pass.
    """
    start = row * _WIDTH
    own = _BAND - min(c, _BAND)  # columns left of the core
    for m in range(own):
        pivot = (above_row + m) * _STEP
        share = at(band, start + m) * at(above, pivot)
        put(band, start + m, share)
        for right in range(ONE, _STEP):
            slot = start + m + right
            put(band, slot, at(band, slot) - share * at(above, pivot + right))
    last = chain.core - ONE
    mine = c if strand == 0 else last - c
    for m in range(own, _WIDTH):
        other = c + m - _BAND
        if other < chain.core:
            slot = mine * chain.core + (other if strand == 0 else last - other)
            put(core, slot, at(core, slot) + at(band, start + m))
        put(band, start + m, 0.0)
    put(band, start + _BAND, 1.0)
    put(core_scale, mine, at(core_scale, mine) + at(scale, row))


@compiled
def factors(chain, scalars, block, band_at, core_at, good_at):
    """M + c C + k K = L D U for LANES steps, handed over to them slice by slice; and whether no pivot vanishes.

    A row's slots become its shares of the rows before it, the reciprocal pivot, and U. The core is factorised for
    itself.
    """
    band, above, scale = np.empty((TWO * _SLOTS, LANES)), np.zeros((TWO * _ABOVE * _STEP, LANES)), room(TWO * _ROWS)
    core, core_scale, good = room(chain.core * chain.core), room(chain.core), room(1)
    magnitudes = np.empty((1, scalars.shape[1], LANES))
    for k in range(scalars.shape[1]):
        put(magnitudes, (0, k), size(at(scalars, (block, k))))
    for slot in range(chain.core * chain.core):
        put(core, slot, 0.0)
    for c in range(chain.core):
        put(core_scale, c, 0.0)
    regular = less(-1.0, at(magnitudes, (0, 0)))
    for part in range(chain.slices):
        for strand in range(TWO):
            own_slice = strand * chain.slices + part
            _slice_sums(chain, own_slice, scalars, block, magnitudes, band, scale, strand * _ROWS)
            carried = strand * _ABOVE * _STEP
            for k in range(carried, carried + _BAND * _STEP):
                put(above, k, at(above, k + _ROWS * _STEP))
        before = part * _ROWS
        proper = min(max(chain.own, before) - before, _ROWS)
        for k in range(proper):
            for strand in range(TWO):
                row = strand * _ROWS + k
                pivot = eliminate_row(band, row * _WIDTH, above, strand * _ABOVE + _BAND + k, WIDTH)
                regular *= less(SMALLEST_PIVOT * at(scale, row), size(pivot))
        for k in range(proper, min(chain.own + chain.core - before, _ROWS)):
            for strand in range(TWO):
                row, above_row = strand * _ROWS + k, strand * _ABOVE + k
                _meet(chain, strand, row, before + k - chain.own, above_row, band, above, core, scale, core_scale)
        for strand in range(TWO):
            place = (strand * chain.slices + part) * _SLOTS
            for k in range(0, _SLOTS, _NODES):
                turn(band, strand * _SLOTS + k, band_at, place + k)
    factor(chain.middle, core, core_scale, good)
    for square in range(core.shape[0] // LANES):
        turn(core, square * LANES, core_at, square * LANES)
    put(good, 0, at(good, 0) * regular)
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


@compiled
def unbalanced(chain, scalars, block, row, load, z, v, rest, column, products):
    """F - C v - K z at one step; the core's rows in two parts, one along each strand."""
    for k in range(chain.loads.shape[0]):
        put_run(products, chain.loads[k, 3], load * scalars[block, chain.loads[k, 0], row])
    _multiply(chain.speeds, scalars, block, row, v, column, products)
    _multiply(chain.displacements, scalars, block, row, z, column, products)
    ends, what, values = chain.unbalanced
    zero = 0.0 * run_at(rest, (column, 0))
    group = 0 * ONE
    for strand in range(TWO):
        for part in range(chain.slices):
            for r in range(_PER_NODE):
                even = odd = zero
                for k in range(ends[group] // TWO, ends[group + ONE] // TWO):
                    even += at(values, TWO * k) * run_at(products, what[TWO * k])
                    odd += at(values, TWO * k + ONE) * run_at(products, what[TWO * k + ONE])
                group += ONE
                start = (strand * _PER_NODE + r) * chain.stride + _MARGIN
                put_run(rest, (column, start + part * _NODES), even + odd)


@_in_order
def _sum(band, row, slot, number, x_1, x_2, x_3, x_4, x_5):
    """The number less five products, the factor of x_5 at `slot`."""
    number = number - at(band, (row, slot)) * x_5 - at(band, (row, slot + ONE)) * x_4
    number = number - at(band, (row, slot + TWO)) * x_3 - at(band, (row, slot + THREE)) * x_2
    return number - at(band, (row, slot + THREE + ONE)) * x_1


@_in_order
def _sum_back(band, row, slot, number, x_1, x_2, x_3, x_4, x_5):
    """The number less five products, the factor of x_1 at `slot`."""
    number = number - at(band, (row, slot + THREE + ONE)) * x_5 - at(band, (row, slot + THREE)) * x_4
    number = number - at(band, (row, slot + TWO)) * x_3 - at(band, (row, slot + ONE)) * x_2
    return number - at(band, (row, slot)) * x_1


@compiled
def solve_strands(chain, band, core, row, x, column, middle):
    """Solve for x in place: down both strands, in the core, and back."""
    nodes = (chain.own + chain.core + TWO) // _PER_NODE
    strand_slots, strand_places = chain.slices * _SLOTS, _PER_NODE * chain.stride
    starts = (_MARGIN, _MARGIN + chain.stride, _MARGIN + TWO * chain.stride)
    p_1 = p_2 = p_3 = p_4 = p_5 = q_1 = q_2 = q_3 = q_4 = q_5 = 0.0
    for node in range(nodes):
        slot = node * _PER_NODE * _WIDTH
        for start in starts:
            here, there, other = (column, start + node), (column, start + node + strand_places), slot + strand_slots
            p = _sum(band, row, slot, at(x, here), p_1, p_2, p_3, p_4, p_5)
            q = _sum(band, row, other, at(x, there), q_1, q_2, q_3, q_4, q_5)
            put(x, here, p * at(band, (row, slot + _BAND)))
            put(x, there, q * at(band, (row, other + _BAND)))
            p_5, p_4, p_3, p_2, p_1 = p_4, p_3, p_2, p_1, p
            q_5, q_4, q_3, q_2, q_1 = q_4, q_3, q_2, q_1, q
            slot += _WIDTH
    for c in range(chain.core):
        i = chain.own + c
        put(middle, (0, c), at(x, (column, chain.places[0, i])) + at(x, (column, chain.places[1, i])))
    solve(chain.middle, core, row, middle, 0)
    for c in range(chain.core):
        found = at(middle, (0, c))
        put(x, (column, chain.places[0, chain.own + c]), found)
        put(x, (column, chain.places[1, chain.own + c]), found)
    p_1 = p_2 = p_3 = p_4 = p_5 = q_1 = q_2 = q_3 = q_4 = q_5 = 0.0
    for back in range(nodes):
        node = nodes - ONE - back
        slot = (node * _PER_NODE + TWO) * _WIDTH + _STEP
        for start in starts[::-1]:
            here, there, other = (column, start + node), (column, start + node + strand_places), slot + strand_slots
            p = _sum_back(band, row, slot, at(x, here), p_1, p_2, p_3, p_4, p_5)
            q = _sum_back(band, row, other, at(x, there), q_1, q_2, q_3, q_4, q_5)
            put(x, here, p)
            put(x, there, q)
            p_5, p_4, p_3, p_2, p_1 = p_4, p_3, p_2, p_1, p
            q_5, q_4, q_3, q_2, q_1 = q_4, q_3, q_2, q_1, q
            slot -= _WIDTH
