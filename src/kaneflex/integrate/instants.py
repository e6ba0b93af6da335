"""Compiled parts of the spectral solver: the equations at all instants of a cycle, and the mean of them.

Instant l N / 8 + b of N is lane l of block b: a lane goes through an eighth of the cycle, block after block. Arrays are
(blocks, rows, LANES).
"""

import numpy as np
from numba import njit

from kaneflex.integrate import conventions, lanes
from kaneflex.integrate.conventions import FASTMATH, LANES
from kaneflex.integrate.lanes import (
    ONE,
    absolute,
    compiled,
    everywhere,
    lane_sum,
    less,
    load,
    root,
    store,
)
from kaneflex.support.fingerprint import made_of

ROUNDING = 1e-13
"""Share of a diagonal entry that is taken for nothing."""
_made_of_parts = made_of(conventions.__file__, lanes.__file__)
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


@compiled
def _affine_sums(terms, scalars, sums):
    """M, C, K and F of LANES instants: sums of scalar x constant."""
    ends, what, values = terms
    for k in range(np.uint64(len(ends)) - ONE):
        total = 0.0 * load(scalars, 0)
        for term in range(ends[k], ends[k + ONE]):
            total += values[term] * load(scalars, what[term])
        store(sums, k, total)


@_cached
@_made_of_parts
def equations(n, w, terms, rows, scalars, sums, factor):
    """M, C and K by their slots, then F, at all instants, to `sums`; Cholesky's factor of K; whether it has one.

    terms: `AffineSystem.sums`
    rows: the table, shape (N, n_scalars); scalars: work, (n_scalars, LANES)

    The factor is that of K's symmetric part: row i, column j <= i in slot i (w + 1) + j - i + w, the diagonal as its
    reciprocal. Where K is not positive definite everywhere it is the root of the mean of K's diagonal.
    """
    good, blocks = True, len(sums)
    for b in range(blocks):
        for lane in range(LANES):
            for k in range(rows.shape[1]):
                scalars[k, lane] = rows[b + lane * blocks, k]
        _affine_sums(terms, scalars, sums[b])
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


# Compiled in one piece: one real and one complex matrix side by side, whose entries stay in registers; what is left of
# a step in functions of its own would be called for each column of each step.
@_cached
@_made_of_parts
def eighths(n, w, sums, every, repeats, step, poles, shares, entries, vectors, state):
    """Move every state (z, h z') through each eighth of the cycle, in place: shape (2 n states, 2 n, LANES).

    every, repeats: of the blocks one in so many is read, and so many steps are taken with it
    entries, vectors: work, (5, n (2 w + 1), LANES) and (3, n, LANES)

    With x' = A x and u = (p - h A)^-1 x it is (p^2 M + p h C + h^2 K) h u' = p M h x' - h^2 K x, p u = x + h u'.
    """
    width = 2 * w + 1
    slots, states = n * width, 2 * n
    p, p_re, p_im = poles[0], poles[1], poles[2]
    q_re, q_im = p_re * p_re - p_im * p_im, 2.0 * p_re * p_im
    r, r_re, r_im = shares[0], shares[1], shares[2]
    size = 1.0 / (p_re * p_re + p_im * p_im)
    mass, stiffness, real, re, im = entries[0], entries[1], entries[2], entries[3], entries[4]
    x, x_re, x_im = vectors[0], vectors[1], vectors[2]
    for b in range(0, len(sums), every):
        for k in range(slots):
            m, c = load(sums, (b, k)), step * load(sums, (b, slots + k))
            s = step * step * load(sums, (b, 2 * slots + k))
            store(mass, k, m)
            store(stiffness, k, s)
            store(real, k, p * p * m + p * c + s)
            store(re, k, q_re * m + p_re * c + s)
            store(im, k, q_im * m + p_im * c)
        # both are L U, without pivoting, with the reciprocal pivots on the diagonal
        for k in range(n):
            row = k * width - k + w
            one = 1.0 / load(real, row + k)
            store(real, row + k, one)
            d_re, d_im = load(re, row + k), load(im, row + k)
            length = 1.0 / (d_re * d_re + d_im * d_im)
            d_re, d_im = d_re * length, 0.0 - d_im * length
            store(re, row + k, d_re)
            store(im, row + k, d_im)
            for i in range(k + 1, min(n, k + w + 1)):
                low = i * width - i + w
                share = load(real, low + k) * one
                a_re, a_im = load(re, low + k), load(im, low + k)
                s_re, s_im = a_re * d_re - a_im * d_im, a_re * d_im + a_im * d_re
                store(real, low + k, share)
                store(re, low + k, s_re)
                store(im, low + k, s_im)
                for j in range(k + 1, min(n, k + w + 1)):
                    u_re, u_im = load(re, row + j), load(im, row + j)
                    store(real, low + j, load(real, low + j) - share * load(real, row + j))
                    store(re, low + j, load(re, low + j) - s_re * u_re + s_im * u_im)
                    store(im, low + j, load(im, low + j) - s_re * u_im - s_im * u_re)
        for _ in range(repeats):
            for column in range(states):
                for i in range(n):
                    slot = i * width - i + w
                    inert = elastic = 0.0 * load(real, 0)
                    for j in range(max(0, i - w), min(n, i + w + 1)):
                        inert += load(mass, slot + j) * load(state, (column, n + j))
                        elastic += load(stiffness, slot + j) * load(state, (column, j))
                    known, known_re, known_im = p * inert - elastic, p_re * inert - elastic, p_im * inert
                    for j in range(max(0, i - w), i):
                        known -= load(real, slot + j) * load(x, j)
                        a_re, a_im, y_re, y_im = load(re, slot + j), load(im, slot + j), load(x_re, j), load(x_im, j)
                        known_re = known_re - a_re * y_re + a_im * y_im
                        known_im = known_im - a_re * y_im - a_im * y_re
                    store(x, i, known)
                    store(x_re, i, known_re)
                    store(x_im, i, known_im)
                for back in range(n):
                    i = n - 1 - back
                    slot = i * width - i + w
                    known, known_re, known_im = load(x, i), load(x_re, i), load(x_im, i)
                    for j in range(i + 1, min(n, i + w + 1)):
                        known -= load(real, slot + j) * load(x, j)
                        a_re, a_im, y_re, y_im = load(re, slot + j), load(im, slot + j), load(x_re, j), load(x_im, j)
                        known_re = known_re - a_re * y_re + a_im * y_im
                        known_im = known_im - a_re * y_im - a_im * y_re
                    a_re, a_im = load(re, slot + i), load(im, slot + i)
                    known = known * load(real, slot + i)
                    known_re, known_im = known_re * a_re - known_im * a_im, known_re * a_im + known_im * a_re
                    store(x, i, known)
                    store(x_re, i, known_re)
                    store(x_im, i, known_im)
                    # u = (x + h u') / p
                    z = load(state, (column, i))
                    u, y_re = (z + known) * (1.0 / p), z + known_re
                    u_re, u_im = (y_re * p_re + known_im * p_im) * size, (known_im * p_re - y_re * p_im) * size
                    store(state, (column, i), r_im * u_im - r_re * u_re - r * u)
                    store(state, (column, n + i), r_im * known_im - r_re * known_re - r * known)
