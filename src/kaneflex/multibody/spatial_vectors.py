"""Compiled products and differences of vectors in space that lie one behind the other in arrays."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.tables import OPTIONS, apart
from kaneflex.support.inner import once


@once
@njit(**OPTIONS)
def times(A, x, i, y, j):
    """y = A x, a matrix (3, 3) and vectors that begin at i and j."""
    apart()
    for row in range(3):
        y[j + row] = A[row, 0] * x[i] + A[row, 1] * x[i + 1] + A[row, 2] * x[i + 2]


@once
@njit(**OPTIONS)
def add_cross(a, i, b, j, y, k):
    """y += a x b, vectors that begin at i, j and k."""
    apart()
    y[k] += a[i + 1] * b[j + 2] - a[i + 2] * b[j + 1]
    y[k + 1] += a[i + 2] * b[j] - a[i] * b[j + 2]
    y[k + 2] += a[i] * b[j + 1] - a[i + 1] * b[j]


@once
@njit(**OPTIONS)
def less(a, b, y, k):
    """y = a - b."""
    for i in range(3):
        y[k + i] = a[i] - b[i]
