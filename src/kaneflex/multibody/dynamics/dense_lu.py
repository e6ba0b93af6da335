"""LU factors of small dense matrices, real or complex, in a long array."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.types import IN_ORDER, OPTIONS, magnitude, no_inline
from kaneflex.support.inner import once


@once
@njit(**OPTIONS)
def factorise(a, at, n, pivots, first):
    """LU factors in place with row exchanges, 1/U on the diagonal; False for a zero pivot."""
    no_inline()
    for k in range(n):
        row, largest = k, magnitude(a[at + n * k + k])
        for i in range(k + 1, n):
            if magnitude(a[at + n * i + k]) > largest:
                row, largest = i, magnitude(a[at + n * i + k])
        pivots[first + k] = row
        if not largest > 0.0 or not largest < 1e300:
            return False
        if row != k:
            for j in range(n):
                a[at + n * k + j], a[at + n * row + j] = a[at + n * row + j], a[at + n * k + j]
        inverse = 1.0 / a[at + n * k + k]
        a[at + n * k + k] = inverse
        for i in range(k + 1, n):
            factor = a[at + n * i + k] * inverse
            a[at + n * i + k] = factor
            for j in range(k + 1, n):
                a[at + n * i + j] -= factor * a[at + n * k + j]
    return True


@once
@njit(**IN_ORDER)
def substitute(a, at, n, pivots, first, x):
    """Solve with the factors of :func:`factorise`, in place: the right-hand side is at x."""
    no_inline()
    if n == 2:  # one loop, the most frequent case; it dominates a step's latency
        i = pivots[first]
        above = a[x + i]
        below = (a[x + 1 - i] - a[at + 2] * above) * a[at + 3]
        a[x], a[x + 1] = (above - a[at + 1] * below) * a[at], below
        return
    for k in range(n):
        row = pivots[first + k]
        if row != k:
            a[x + k], a[x + row] = a[x + row], a[x + k]
    for i in range(n):
        total = a[x + i]
        for j in range(i):
            total -= a[at + n * i + j] * a[x + j]
        a[x + i] = total
    for i in range(n - 1, -1, -1):
        total = a[x + i]
        for j in range(i + 1, n):
            total -= a[at + n * i + j] * a[x + j]
        a[x + i] = total * a[at + n * i + i]
