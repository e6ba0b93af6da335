"""Compiled parts that the steps share: sums of constant matrices, factorisation and solution of banded equations.

None of them is cached for itself: they are compiled into the loops that call them.
"""

import numpy as np
from numba import njit

from kaneflex.integrate.conventions import FASTMATH, LANES
from kaneflex.integrate.lanes import absolute, less, load, store
from kaneflex.support.inner import PART

# Indices are unsigned throughout: with signed ones numba must test each for a negative value, which counts
# from the end, and nothing is vectorised. Mixed with a signed number an unsigned one would become a float.
ZERO, ONE, TWO, THREE = (np.uint64(k) for k in range(4))
SMALLEST_PIVOT = 1e-14  # relative to what was added up to it: less is rounding

# They take what they read one by one, however many: a tuple of it would be made at each step.
compiled = njit(error_model="numpy", fastmath=FASTMATH, **PART)


@compiled
def read_steps(table, first, apart, period, nodes, node, scalars):
    """Scalars (n_scalars, LANES) of LANES steps `apart`, from `first` on; after `period` steps the table begins again.

    table: rows of scalars, `nodes` a step; node: the row after the step's first one
    """
    for lane in range(LANES):
        row = (first + lane * apart) % period * nodes + node
        for k in range(table.shape[1]):
            scalars[k, lane] = table[row, k]


@compiled
def affine_sums(terms, scalars, sums, begin):
    """M, C, K and F of LANES steps, in `sums` from `begin` on: sums of scalar x constant.

    terms: `AffineSystem.sums`
    """
    ends, what, values = terms
    for k in range(np.uint64(len(ends)) - ONE):
        total = 0.0 * load(scalars, 0)
        for term in range(ends[k], ends[k + ONE]):
            total += values[term] * load(scalars, what[term])
        store(sums, begin + k, total)


@compiled
def factor(layout, lu, scale, good):
    """A = L U of LANES matrices in place, without pivoting, reciprocal pivots on the diagonal.

    scale: of each row, sum of the absolute values of what was added up in the diagonal
    good: one number, 1.0 where no pivot vanishes, else 0.0
    """
    base, last = layout.base, layout.last
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


@compiled
def solve(layout, lu, lane, x):
    """Solve L U x = x with the matrix of one lane, for LANES columns."""
    base, n = layout.base, layout.n
    for i in range(n):
        known = load(x, i)
        for j in range(layout.first[i], i):
            known -= lu[base[i] + j, lane] * load(x, j)
        store(x, i, known)
    for back in range(n):
        i = n - ONE - back
        known = load(x, i)
        for j in range(i + ONE, layout.last[i]):
            known -= lu[base[i] + j, lane] * load(x, j)
        store(x, i, known * lu[base[i] + i, lane])


@compiled
def residual(layout, sums, begin, lane, load_factor, z, v, rest, place, apart):
    """F - C v - K z of LANES columns, with the sums of one lane from `begin` on, in `rest` from `place` on.

    apart: places between its numbers
    """
    damping = begin + layout.n_slots
    stiffness = damping + layout.n_slots
    force = stiffness + layout.n_slots
    for i in range(layout.n):
        c_row, k_row = damping + layout.base[i], stiffness + layout.base[i]
        total = load_factor * sums[force + i, lane]
        reaction = 0.0 * total  # two sums, for an addition waits for the one before it
        for j in range(layout.first[i], layout.last[i]):
            total -= sums[c_row + j, lane] * load(v, j)
            reaction += sums[k_row + j, lane] * load(z, j)
        store(rest, place + apart * i, total - reaction)


@compiled
def in_lanes(columns):
    """Columns (columns, n), LANES of them in a block, filled up with zeros: (blocks, n, LANES)."""
    found = np.zeros(((len(columns) + LANES - 1) // LANES, columns.shape[1], LANES))
    for column in range(len(columns)):
        for i in range(columns.shape[1]):
            found[column // LANES, i, column % LANES] = columns[column, i]
    return found


@compiled
def out_of_lanes(found, columns):
    """Inverse of `in_lanes`, to `columns`."""
    for column in range(len(columns)):
        for i in range(columns.shape[1]):
            columns[column, i] = found[column // LANES, i, column % LANES]
