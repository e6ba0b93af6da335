"""Compiled parts of the spectral solver: banded matrices and vectors at all instants of a cycle at once.

Arrays are (rows, N): the N values of a number lie side by side, so that the innermost loops, over the instants, fill
the registers.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import lanes
from kaneflex.integrate.lanes import FASTMATH
from kaneflex.support.fingerprint import made_of

ROUNDING = 1e-13
"""Share of a diagonal entry that is taken for nothing."""
_made_of_parts = made_of(lanes.__file__)
_cached = njit(cache=True, error_model="numpy", fastmath=FASTMATH)


@_cached
@_made_of_parts
def factorise(w, stiffness, factor):
    """Cholesky's factor of the symmetric part, a band of w, at every instant; False where it is not positive definite.

    Row i, column j <= i is in row i (w + 1) + j - i + w, the diagonal as its reciprocal.
    """
    n, count = stiffness.shape[0] // (2 * w + 1), stiffness.shape[1]
    for i in range(n):
        for j in range(max(0, i - w), i + 1):
            entry = factor[i * (w + 1) + j - i + w]
            below, above = stiffness[i * (2 * w + 1) + j - i + w], stiffness[j * (2 * w + 1) + i - j + w]
            for t in range(count):
                entry[t] = 0.5 * (below[t] + above[t])
            for k in range(max(0, i - w), j):
                left, right = factor[i * (w + 1) + k - i + w], factor[j * (w + 1) + k - j + w]
                for t in range(count):
                    entry[t] -= left[t] * right[t]
            if j < i:
                reciprocal = factor[j * (w + 1) + w]
                for t in range(count):
                    entry[t] *= reciprocal[t]
                continue
            lost = 0
            for t in range(count):
                lost += 0 if entry[t] > ROUNDING * abs(below[t]) else 1
                entry[t] = 1.0 / np.sqrt(abs(entry[t]))
            if lost:
                return False
    return True


@_cached
@_made_of_parts
def solve_lower(w, factor, x):
    """L^-1 x in place."""
    for i in range(x.shape[0]):
        for k in range(max(0, i - w), i):
            entry = factor[i * (w + 1) + k - i + w]
            for t in range(x.shape[1]):
                x[i, t] -= entry[t] * x[k, t]
        reciprocal = factor[i * (w + 1) + w]
        for t in range(x.shape[1]):
            x[i, t] *= reciprocal[t]


@_cached
@_made_of_parts
def solve_upper(w, factor, x):
    """L^-T x in place."""
    for i in range(x.shape[0] - 1, -1, -1):
        reciprocal = factor[i * (w + 1) + w]
        for t in range(x.shape[1]):
            x[i, t] *= reciprocal[t]
        for k in range(max(0, i - w), i):
            entry = factor[i * (w + 1) + k - i + w]
            for t in range(x.shape[1]):
                x[k, t] -= entry[t] * x[i, t]


@_cached
@_made_of_parts
def add_product(w, matrix, x, out):
    """Add a banded matrix times x, at every instant."""
    n = x.shape[0]
    for i in range(n):
        for j in range(max(0, i - w), min(n, i + w + 1)):
            entry = matrix[i * (2 * w + 1) + j - i + w]
            for t in range(x.shape[1]):
                out[i, t] += entry[t] * x[j, t]


@_cached
@_made_of_parts
def residual(w, mass, damping, stiffness, z, v, a):
    """M a + C v + K z."""
    out = np.empty_like(z)
    n = z.shape[0]
    for i in range(n):
        out[i, :] = 0.0
        for j in range(max(0, i - w), min(n, i + w + 1)):
            slot = i * (2 * w + 1) + j - i + w
            m, c, k = mass[slot], damping[slot], stiffness[slot]
            for t in range(z.shape[1]):
                out[i, t] += m[t] * a[j, t] + c[t] * v[j, t] + k[t] * z[j, t]
    return out


@_cached
@_made_of_parts
def into_modes(w, factor, shapes, rest):
    """L^-1 rest, in place, and its shares in the modes, shape (m, N)."""
    solve_lower(w, factor, rest)
    taken = np.empty((shapes.shape[1], rest.shape[1]))
    for k in range(shapes.shape[1]):
        taken[k, :] = 0.0
        for i in range(shapes.shape[0]):
            for t in range(rest.shape[1]):
                taken[k, t] += shapes[i, k] * rest[i, t]
    return taken


@_cached
@_made_of_parts
def out_of_modes(shapes, taken, answered, rest):
    """The modes' answers, and what the others answer at once: what of the rest the modes have not taken."""
    n, m = shapes.shape
    if n == m:
        rest[:] = 0.0
        taken[:] = 0.0
    for k in range(m):
        for i in range(n):
            for t in range(rest.shape[1]):
                rest[i, t] += shapes[i, k] * (answered[k, t] - taken[k, t])
    return rest


@_cached
@_made_of_parts
def conjugate(steps, changes, count, rest, z):
    """One step of GCR with row `count`, made orthogonal to those before; the square of what is left."""
    step, change = steps[count].ravel(), changes[count].ravel()
    left, moved = rest.ravel(), z.ravel()
    for k in range(count):
        old_step, old_change = steps[k].ravel(), changes[k].ravel()
        along = 0.0
        for t in range(change.size):
            along += old_change[t] * change[t]
        for t in range(change.size):
            change[t] -= along * old_change[t]
            step[t] -= along * old_step[t]
    length, along = 0.0, 0.0
    for t in range(change.size):
        length += change[t] * change[t]
        along += change[t] * left[t]
    scale = 1.0 / np.sqrt(length) if length > 0.0 else 0.0
    square = 0.0
    for t in range(change.size):
        change[t] *= scale
        step[t] *= scale
        moved[t] += along * scale * step[t]
        left[t] -= along * scale * change[t]
        square += left[t] * left[t]
    return square


@_cached
@_made_of_parts
def mean_products(w, factor, mass, damping, stiffness, shapes):
    """Means over the instants of L^-1 A L^-T x, for A each of the matrices and x each row of shapes: (n, rows)."""
    rows, n = shapes.shape
    found = np.empty((n, rows)), np.empty((n, rows)), np.empty((n, rows))
    x, product = np.empty((n, factor.shape[1])), np.empty((n, factor.shape[1]))
    for row in range(rows):
        for i in range(n):
            x[i, :] = shapes[row, i]
        solve_upper(w, factor, x)
        for matrix, out in ((mass, found[0]), (damping, found[1]), (stiffness, found[2])):
            product[:] = 0.0
            add_product(w, matrix, x, product)
            solve_lower(w, factor, product)
            for i in range(n):
                total = 0.0
                for t in range(product.shape[1]):
                    total += product[i, t]
                out[i, row] = total / product.shape[1]
    return found
