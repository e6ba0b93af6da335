"""Compiled parts that the steps share: matrices in lanes, factorised, and handed to the steps that read them.

None of them is cached for itself: they are compiled into the loops that call them.
"""

import numpy as np
from numba import njit
from numba.extending import overload

from kaneflex.integrate.lanes import FASTMATH, LANES, at, less, put, size, turn

# Indices are unsigned throughout: with signed ones numba must test each for a negative value, which counts
# from the end, and nothing is vectorised. Mixed with a signed number an unsigned one would become a float.
ZERO, ONE, TWO, THREE, FOUR = (np.uint64(k) for k in range(5))
COMPLETED, SINGULAR, UNBOUNDED = 0, 1, 2  # how a loop ended
SMALLEST_PIVOT = 1e-14  # relative to what was added up to it: less is rounding

# Nothing but compiled code calls them: without a way in from Python they compile in half the time.
compiled = njit(error_model="numpy", fastmath=FASTMATH, no_cpython_wrapper=True, no_cfunc_wrapper=True)
# A call costs as much as a small solve: numba hands over seven words an array.
inlined = njit(inline="always", error_model="numpy", fastmath=FASTMATH)


@compiled
def room(n):
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
    """What steps read of the array (slots, LANES): it, as (1, slots, LANES), or room for its transpose."""


@overload(rows_read)
def _rows_of(z, lanes):
    if z.ndim == 3:
        return lambda z, lanes: np.expand_dims(lanes, 0)
    return lambda z, lanes: np.empty((LANES, lanes.shape[0]))


def hand_over(lanes, rows):
    """What was prepared in lanes, to those who read it."""


@overload(hand_over)
def _handed_over(lanes, rows):
    if rows.ndim == 3:
        return lambda lanes, rows: None

    def turned(lanes, rows):
        for block in range(rows.shape[1] // LANES):
            turn(lanes, block * LANES, rows, block * LANES)

    return turned


@inlined
def affine_sum(packed, scalars, row, sums, begin):
    """M, C, K and F at one row of the table: sum of scalar x constant, one for all lanes or one in each.

    begin: where in `sums` they go
    """
    quads, runs, data = packed.quads, packed.runs, packed.data
    for i in range(THREE * packed.layout.n_slots + packed.layout.n):
        put(sums, begin + i, 0.0)
    for k in range(runs.shape[0]):
        scalar = at(scalars, (row, runs[k, 0]))
        start = begin + runs[k, 1]
        offset = runs[k, 3]
        for i in range(runs[k, 2]):
            put(sums, start + i, at(sums, start + i) + scalar * at(data, offset + i))
    for k in range(quads.shape[0]):
        one, two = at(scalars, (row, quads[k, 0])), at(scalars, (row, quads[k, 1]))
        three, four = at(scalars, (row, quads[k, 2])), at(scalars, (row, quads[k, 3]))
        start = begin + quads[k, 4]
        for i in range(quads[k, 5]):
            number = quads[k, 6] + FOUR * i
            more = three * at(data, number + TWO) + four * at(data, number + THREE)
            before = at(sums, start + i) + one * at(data, number) + two * at(data, number + ONE)
            put(sums, start + i, before + more)


@inlined
def weights(c):
    """Those of `kaneflex.integrate.methods.newmark_weights`, in their order."""
    return at(c, 0), at(c, 1), at(c, 2), at(c, 3), at(c, 4), at(c, 5), at(c, 6), at(c, 7), at(c, 8), at(c, 9)


@compiled
def factor(layout, lu, scale, good):
    """A = L U in place, without pivoting, reciprocal pivots on the diagonal.

    scale: of each row, sum of the absolute values of what was added up in the diagonal
    good: one number, 1.0 where no pivot vanishes, else 0.0
    """
    base = layout.base
    last = layout.last
    regular = less(-1.0, at(scale, 0))
    for k in range(layout.n):
        row_k = base[k]
        pivot = at(lu, row_k + k)
        regular *= less(SMALLEST_PIVOT * at(scale, k), size(pivot))
        reciprocal = 1.0 / pivot
        put(lu, row_k + k, reciprocal)
        for i in range(k + ONE, last[k]):
            row_i = base[i]
            share = at(lu, row_i + k) * reciprocal
            put(lu, row_i + k, share)
            for j in range(k + ONE, last[k]):
                put(lu, row_i + j, at(lu, row_i + j) - share * at(lu, row_k + j))
    put(good, 0, regular)


@inlined
def solve(layout, lu, row, x, column):
    """Solve L U x = x for one row of `x`: by columns, because short sums wait for each other."""
    base = layout.base
    first = layout.first
    last = layout.last
    n = layout.n
    for j in range(n):
        known = at(x, (column, j))
        for i in range(j + ONE, last[j]):
            put(x, (column, i), at(x, (column, i)) - at(lu, (row, base[i] + j)) * known)
    for back in range(n):
        j = n - ONE - back
        known = at(x, (column, j)) * at(lu, (row, base[j] + j))
        put(x, (column, j), known)
        for i in range(first[j], j):
            put(x, (column, i), at(x, (column, i)) - at(lu, (row, base[i] + j)) * known)


@inlined
def unbalanced(layout, sums, row, begin, load, z, z_row, v, column, i):
    """Row i of F - C v - K z, of the sums from `begin` on."""
    c_row = begin + layout.n_slots + layout.base[i]
    k_row = c_row + layout.n_slots
    force = load * at(sums, (row, begin + THREE * layout.n_slots + i))
    reaction = 0.0 * force  # two sums, for an addition waits for the one before it
    for j in range(layout.first[i], layout.last[i]):
        force -= at(sums, (row, c_row + j)) * at(v, (column, j))
        reaction += at(sums, (row, k_row + j)) * at(z, (z_row, j))
    return force - reaction


@compiled
def mass_matrices(packed, scalars, row, sums, begin, mass, scale, good):
    """All sums at one row of the table, put from `begin` on, and M factorised."""
    layout = packed.layout
    affine_sum(packed, scalars, row, sums, begin)
    for i in range(layout.n_slots):
        put(mass, i, at(sums, begin + i))
    for i in range(layout.n):
        put(scale, i, size(at(sums, begin + layout.base[i] + i)))
    factor(layout, mass, scale, good)


@inlined
def true_accelerations(layout, sums, mass, row, begin, load, z, v, q, column):
    """q from M q = F - C v - K z, of the sums from `begin` on."""
    for i in range(layout.n):
        put(q, (column, i), unbalanced(layout, sums, row, begin, load[column], z, column, v, column, i))
    solve(layout, mass, row, q, column)
