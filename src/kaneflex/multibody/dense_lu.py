"""LU factors of small dense matrices, real or complex, within compiled loops."""

from __future__ import annotations

from numba import njit

OPTIONS = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


@njit(**OPTIONS)
def factorise(a, pivots):
    """LU in place with row exchanges; False where a pivot vanishes."""
    n = a.shape[0]
    for k in range(n):
        row, largest = k, abs(a[k, k])
        for i in range(k + 1, n):
            if abs(a[i, k]) > largest:
                row, largest = i, abs(a[i, k])
        pivots[k] = row
        if not largest > 0.0 or not largest < 1e300:
            return False
        if row != k:
            for j in range(n):
                a[k, j], a[row, j] = a[row, j], a[k, j]
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, n):
            if a[i, k] != 0.0:
                factor = a[i, k] * inverse
                a[i, k] = factor
                for j in range(k + 1, n):
                    a[i, j] -= factor * a[k, j]
    return True


@njit(**OPTIONS)
def substitute(a, pivots, x):
    """Solve with the factors of :func:`factorise`, in place."""
    n = a.shape[0]
    for k in range(n):
        row = pivots[k]
        if row != k:
            x[k], x[row] = x[row], x[k]
    for i in range(n):
        total = x[i]
        for j in range(i):
            total -= a[i, j] * x[j]
        x[i] = total
    for i in range(n - 1, -1, -1):
        total = x[i]
        for j in range(i + 1, n):
            total -= a[i, j] * x[j]
        x[i] = total / a[i, i]
