"""Compiled parts that the steps share: matrices in lanes, factorised, and handed to the steps that read them.

None of them is cached for itself: they are compiled into the loops that call them.
"""

import numpy as np
from numba import njit
from numba.extending import overload

from kaneflex.integrate.conventions import FASTMATH, LANES
from kaneflex.integrate.lanes import absolute, less, load, store, transpose
from kaneflex.support.inner import PART

# Indices are unsigned throughout: with signed ones numba must test each for a negative value, which counts
# from the end, and nothing is vectorised. Mixed with a signed number an unsigned one would become a float.
ZERO, ONE, TWO, THREE, FOUR = (np.uint64(k) for k in range(5))
SMALLEST_PIVOT = 1e-14  # relative to what was added up to it: less is rounding

compiled = njit(error_model="numpy", fastmath=FASTMATH, **PART)
# Compiled into the loop that calls them: a call costs as much as a small solve, for numba hands over seven words an
# array. That is why they take what they read one by one, however many: a tuple of it would be made at each step.
inlined = njit(inline="always", error_model="numpy", fastmath=FASTMATH)


@compiled
def empty_lanes(n):
    """An array of at least n times LANES numbers: whole squares of them, so that they can be transposed."""
    return np.empty(((np.intp(n) + LANES - 1) // LANES * LANES, LANES))


# Side by side or one after the other: the axes of the state, or of what it reads, say which when a loop is compiled.


def step_place(z, position):
    """Block of the table, and row of what is prepared, of a step."""


@overload(step_place, inline="always")
def _place_of(z, position):
    if z.ndim == 3:
        return lambda z, position: (position, 0)
    return lambda z, position: (position // LANES, position % LANES)


def rows_read(z, lanes):
    """View of the array (slots, LANES) for steps: as (1, slots, LANES), or empty_lanes for its transpose."""


@overload(rows_read)
def _rows_of(z, lanes):
    if z.ndim == 3:
        return lambda z, lanes: np.expand_dims(lanes, 0)
    return lambda z, lanes: np.empty((LANES, lanes.shape[0]))


def hand_over(lanes, rows):
    """Copy data prepared in lanes to its readers."""


@overload(hand_over)
def _handed_over(lanes, rows):
    if rows.ndim == 3:
        return lambda lanes, rows: None

    def turned(lanes, rows):
        for block in range(rows.shape[1] // LANES):
            transpose(lanes, block * LANES, rows, block * LANES)

    return turned


@inlined
def affine_sum(packed, scalars, row, sums, begin):
    """M, C, K and F at one row of the table: sum of scalar x constant.

    begin: where in `sums` they go
    """
    quads, runs, data = packed.quads, packed.runs, packed.data
    for i in range(THREE * packed.layout.n_slots + packed.layout.n):
        store(sums, begin + i, 0.0)
    for k in range(runs.shape[0]):
        scalar = load(scalars, (row, runs[k, 0]))
        start = begin + runs[k, 1]
        offset = runs[k, 3]
        for i in range(runs[k, 2]):
            store(sums, start + i, load(sums, start + i) + scalar * load(data, offset + i))
    for k in range(quads.shape[0]):
        one, two = load(scalars, (row, quads[k, 0])), load(scalars, (row, quads[k, 1]))
        three, four = load(scalars, (row, quads[k, 2])), load(scalars, (row, quads[k, 3]))
        start = begin + quads[k, 4]
        for i in range(quads[k, 5]):
            number = quads[k, 6] + FOUR * i
            more = three * load(data, number + TWO) + four * load(data, number + THREE)
            before = load(sums, start + i) + one * load(data, number) + two * load(data, number + ONE)
            store(sums, start + i, before + more)


@inlined
def weights(c):
    """Weights of `kaneflex.integrate.methods.newmark_weights`, in their order."""
    return (
        load(c, 0), load(c, 1), load(c, 2), load(c, 3), load(c, 4),
        load(c, 5), load(c, 6), load(c, 7), load(c, 8), load(c, 9),
    )  # fmt: skip


@compiled
def factor(layout, lu, scale, good):
    """A = L U in place, without pivoting, reciprocal pivots on the diagonal.

    scale: of each row, sum of the absolute values of what was added up in the diagonal
    good: one number, 1.0 where no pivot vanishes, else 0.0
    """
    base = layout.base
    last = layout.last
    regular = less(-1.0, load(scale, 0))
    for k in range(layout.n):
        row_k = base[k]
        pivot = load(lu, row_k + k)
        regular *= less(SMALLEST_PIVOT * load(scale, k), absolute(pivot))
        reciprocal = 1.0 / pivot
        store(lu, row_k + k, reciprocal)
        for i in range(k + ONE, last[k]):
            row_i = base[i]
            share = load(lu, row_i + k) * reciprocal
            store(lu, row_i + k, share)
            for j in range(k + ONE, last[k]):
                store(lu, row_i + j, load(lu, row_i + j) - share * load(lu, row_k + j))
    store(good, 0, regular)


@inlined
def solve(layout, lu, row, x, column):
    """Solve L U x = x for one row of `x`: by columns, because short sums wait for each other."""
    base = layout.base
    first = layout.first
    last = layout.last
    n = layout.n
    for j in range(n):
        known = load(x, (column, j))
        for i in range(j + ONE, last[j]):
            store(x, (column, i), load(x, (column, i)) - load(lu, (row, base[i] + j)) * known)
    for back in range(n):
        j = n - ONE - back
        known = load(x, (column, j)) * load(lu, (row, base[j] + j))
        store(x, (column, j), known)
        for i in range(first[j], j):
            store(x, (column, i), load(x, (column, i)) - load(lu, (row, base[i] + j)) * known)


@inlined
def residual(layout, sums, row, begin, load_factor, z, z_row, v, column, i):
    """Row i of F - C v - K z, of the sums from `begin` on."""
    c_row = begin + layout.n_slots + layout.base[i]
    k_row = c_row + layout.n_slots
    force = load_factor * load(sums, (row, begin + THREE * layout.n_slots + i))
    reaction = 0.0 * force  # two sums, for an addition waits for the one before it
    for j in range(layout.first[i], layout.last[i]):
        force -= load(sums, (row, c_row + j)) * load(v, (column, j))
        reaction += load(sums, (row, k_row + j)) * load(z, (z_row, j))
    return force - reaction


@compiled
def mass_matrices(packed, scalars, row, sums, begin, mass, scale, good):
    """All sums at one row of the table, put from `begin` on, and M factorised."""
    layout = packed.layout
    affine_sum(packed, scalars, row, sums, begin)
    for i in range(layout.n_slots):
        store(mass, i, load(sums, begin + i))
    for i in range(layout.n):
        store(scale, i, absolute(load(sums, begin + layout.base[i] + i)))
    factor(layout, mass, scale, good)


@inlined
def true_accelerations(layout, sums, mass, row, begin, load_factor, z, v, q, column):
    """q from M q = F - C v - K z, of the sums from `begin` on."""
    for i in range(layout.n):
        store(q, (column, i), residual(layout, sums, row, begin, load_factor[column], z, column, v, column, i))
    solve(layout, mass, row, q, column)
