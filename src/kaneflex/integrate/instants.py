"""Compiled parts of the spectral solver: the equations at all instants of a cycle, and the mean of them.

Instant l N / 8 + b of N is lane l of block b: a lane goes through an eighth of the cycle, block after block. Arrays are
(blocks, rows, LANES). Those of vectors have as many rows as fill whole squares, the last ones zero.
"""

from numba import njit

from kaneflex.integrate import lanes, matrices
from kaneflex.integrate.lanes import (
    FASTMATH,
    LANES,
    absolute,
    everywhere,
    lane_sum,
    less,
    load,
    root,
    stay_apart,
    store,
)
from kaneflex.integrate.matrices import compiled
from kaneflex.support.fingerprint import made_of

AT_ONCE = 4
"""Blocks whose equations are summed up side by side."""
ROUNDING = 1e-13
"""Share of a diagonal entry that is taken for nothing."""
_made_of_parts = made_of(lanes.__file__, matrices.__file__)
_cached = njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True, _nrt=False)


@compiled
def _diagonal_factor(n, w, sums, factor):
    """The root of the mean of K's diagonal, in the place of its factor."""
    first, width, largest = 2 * n * (2 * w + 1) + w, 2 * w + 1, 0.0
    for b in range(len(sums)):
        for k in range(factor.shape[1]):
            store(factor, (b, k), 0.0)
    for i in range(n):
        total = 0.0 * load(sums, (0, 0))
        for b in range(len(sums)):
            total += absolute(load(sums, (b, first + i * width)))
        mean = lane_sum(total) / (LANES * len(sums))
        largest = max(largest, mean)
        store(factor, (0, i * (w + 1) + w), mean)
    for i in range(n):
        size = load(factor, (0, i * (w + 1) + w)) + (largest if largest > 0.0 else 1.0) * ROUNDING
        for b in range(len(sums)):
            store(factor, (b, i * (w + 1) + w), 1.0 / root(size))


@compiled
def _sums(ends, what, values, scalars, first, sums):
    """M, C, K and F of AT_ONCE blocks from `first` on, each number of the sums read once for all of them.

    scalars: of the table, shape (AT_ONCE, n_scalars, LANES)
    """
    stay_apart()
    one, two, three, four = scalars[0], scalars[1], scalars[2], scalars[3]
    nothing = 0.0 * load(one, 0)
    for row in range(len(ends) - 1):
        a = b = c = d = nothing
        for k in range(ends[row], ends[row + 1]):
            value, scalar = values[k], what[k]
            a += value * load(one, scalar)
            b += value * load(two, scalar)
            c += value * load(three, scalar)
            d += value * load(four, scalar)
        store(sums, (first, row), a)
        store(sums, (first + 1, row), b)
        store(sums, (first + 2, row), c)
        store(sums, (first + 3, row), d)


@compiled
def _cholesky(n, w, sums, b, factor):
    """The factor of the symmetric part of K in a block; whether it is positive definite."""
    width, good = 2 * w + 1, True
    stiffness = 2 * n * width
    for i in range(n):
        for j in range(max(0, i - w), i + 1):
            below = load(sums, (b, stiffness + i * width + j - i + w))
            entry = 0.5 * (below + load(sums, (b, stiffness + j * width + i - j + w)))
            row, column = i * (w + 1) - i + w, j * (w + 1) - j + w
            for k in range(max(0, i - w), j):
                entry -= load(factor, (b, row + k)) * load(factor, (b, column + k))
            if j < i:
                store(factor, (b, row + j), entry * load(factor, (b, column + j)))
            else:
                good = good and everywhere(less(ROUNDING * absolute(below), entry))
                store(factor, (b, row + j), 1.0 / root(absolute(entry)))
    return good


@_cached
@_made_of_parts
def equations(n, w, terms, rows, scalars, sums, factor):
    """M, C and K by their slots, then F, at all instants, to `sums`; Cholesky's factor of K; whether it has one.

    terms: `AffineSystem.sums`, of each of them the scalars that enter it and their factors
    rows: the table, shape (N, n_scalars), of AT_ONCE blocks or a multiple of them; scalars: work, AT_ONCE of them

    The factor is that of K's symmetric part: row i, column j <= i in slot i (w + 1) + j - i + w, the diagonal as its
    reciprocal. Where K is not positive definite everywhere it is the root of the mean of K's diagonal.
    """
    good, blocks = True, len(sums)
    ends, what, values = terms
    for first in range(0, blocks, AT_ONCE):
        for b in range(AT_ONCE):
            for each in range(LANES):
                for scalar in range(rows.shape[1]):
                    scalars[b, scalar, each] = rows[each * blocks + first + b, scalar]
        _sums(ends, what, values, scalars, first, sums)
        for b in range(first, first + AT_ONCE):
            good = _cholesky(n, w, sums, b, factor) and good
    if not good:
        _diagonal_factor(n, w, sums, factor)
    return good


@compiled
def solve_lower(n, w, factor, b, x):
    """L^-1 x in place."""
    for i in range(n):
        row = i * (w + 1) - i + w
        known = load(x, (b, i))
        for k in range(max(0, i - w), i):
            known -= load(factor, (b, row + k)) * load(x, (b, k))
        store(x, (b, i), known * load(factor, (b, row + i)))


@compiled
def solve_upper(n, w, factor, b, x):
    """L^-T x in place."""
    for back in range(n):
        i = n - 1 - back
        row = i * (w + 1) - i + w
        known = load(x, (b, i)) * load(factor, (b, row + i))
        store(x, (b, i), known)
        for k in range(max(0, i - w), i):
            store(x, (b, k), load(x, (b, k)) - load(factor, (b, row + k)) * known)


@compiled
def multiply_upper(n, w, factor, b, x, y):
    """y = L^T x."""
    for j in range(n):
        total = load(x, (b, j)) / load(factor, (b, j * (w + 1) + w))
        for i in range(j + 1, min(n, j + w + 1)):
            total += load(factor, (b, i * (w + 1) + j - i + w)) * load(x, (b, i))
        store(y, (b, j), total)


@compiled
def multiply(n, w, sums, first, b, x, row, out):
    """The matrix whose slots begin at `first` times x, to row `row` of `out`."""
    for i in range(n):
        slot = first + i * (2 * w + 1) - i + w
        total = 0.0 * load(x, (b, i))
        for j in range(max(0, i - w), min(n, i + w + 1)):
            total += load(sums, (b, slot + j)) * load(x, (b, j))
        store(out, (row, i), total)


@_cached
@_made_of_parts
def mean_products(n, w, sums, factor, every, shapes, work, found):
    """Sums over one block in so many of L^-1 A L^-T x, for A each of M, C, K, x each row of shapes.

    They are added to `found`, (3, n, rows); work: (2, blocks, n, LANES).
    """
    x, product = work[0], work[1]
    for b in range(0, len(sums), every):
        for row in range(shapes.shape[0]):
            for i in range(n):
                store(x, (b, i), shapes[row, i])
            solve_upper(n, w, factor, b, x)
            for matrix in range(3):
                multiply(n, w, sums, matrix * n * (2 * w + 1), b, x, b, product)
                solve_lower(n, w, factor, b, product)
                for i in range(n):
                    found[matrix, i, row] += lane_sum(load(product, (b, i)))
