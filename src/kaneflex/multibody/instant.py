"""Compiled parts of M q'' = f + G^T lambda, g(t, q) = 0 at one instant: linear equations, projection, energies."""

from __future__ import annotations

import numpy as np
from numba import njit, types
from numba.types import FunctionType, float64, int64, void

OPTIONS = {"error_model": "numpy"}
V, A = float64[::1], float64[:, ::1]
EQUATIONS = FunctionType(void(float64, V, V, V, A, V))
CONSTRAINTS = FunctionType(void(float64, V, V, V, V, V, A, V))
TANGENT = FunctionType(void(float64, V, V, V, V, V, A, A))
ENERGY = FunctionType(void(float64, V, V, V, V))
"""Types of the generated kernels, given explicitly: as plain arguments they would be compiled anew in every process."""



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


@njit(**OPTIONS)
def saddle(M, G, n, m, out):
    """[[M, -G^T], [G, 0]]; rows of constraints are scaled by nothing: pivoting takes care of their units."""
    out[:, :] = 0.0
    out[:n, :n] = M
    for i in range(m):
        for j in range(n):
            out[n + i, j] = G[i, j]
            out[j, n + i] = -G[i, j]


# Compiled: the module's kernels, then the state, an array each, as the kernels themselves take them.
@njit(cache=True, **OPTIONS)
def settle(equations, constraints, p, t, q, v, a, multipliers, passes, drift):
    """Project q and v onto the constraints (least change by mass), then accelerations and multipliers there.

    drift: largest residuals of position and velocity before. False at a singular state.
    """
    n, m = q.size, multipliers.size
    M, f = np.zeros((n, n)), np.zeros(n)
    G, g, g_t, gamma = np.zeros((m, n)), np.zeros(m), np.zeros(m), np.zeros(m)
    square, pivots, x = np.zeros((n + m, n + m)), np.zeros(n + m, np.int64), np.zeros(n + m)
    drift[:] = 0.0
    for turn in range(passes + 1):
        M[:, :] = 0.0
        f[:] = 0.0
        G[:, :] = 0.0
        g[:] = 0.0
        g_t[:] = 0.0
        gamma[:] = 0.0
        equations(t, q, v, p, M, f)
        constraints(t, q, v, p, g, g_t, G, gamma)
        saddle(M, G, n, m, square)
        if not factorise(square, pivots):
            return False
        if turn < passes:
            x[:n] = 0.0
            for i in range(m):
                x[n + i] = -g[i]
                if turn == 0:
                    drift[0] = max(drift[0], abs(g[i]))
            substitute(square, pivots, x)
            q += x[:n]
            continue
        x[:n] = 0.0
        for i in range(m):
            rate = g_t[i]
            for j in range(n):
                rate += G[i, j] * v[j]
            x[n + i] = -rate
            drift[1] = max(drift[1], abs(rate))
        substitute(square, pivots, x)
        v += x[:n]
        f[:] = 0.0
        M[:, :] = 0.0
        g[:] = 0.0
        g_t[:] = 0.0
        G[:, :] = 0.0
        gamma[:] = 0.0
        equations(t, q, v, p, M, f)
        constraints(t, q, v, p, g, g_t, G, gamma)
        x[:n] = f
        x[n:] = -gamma
        substitute(square, pivots, x)
        a[:] = x[:n]
        multipliers[:] = x[n:]
    return True


@njit(cache=True, **OPTIONS)
def balance(equations, constraints, energy, p, times, qs, vs, lambdas, energies, kinetic, power):
    """Entries of ``energy``, kinetic energy [J] and what loads and moving constraints supply [W], row by row."""
    n, m = qs.shape[1], lambdas.shape[1]
    M, f = np.zeros((n, n)), np.zeros(n)
    G, g, g_t, gamma = np.zeros((m, n)), np.zeros(m), np.zeros(m), np.zeros(m)
    for row in range(times.size):
        M[:, :] = 0.0
        f[:] = 0.0
        equations(times[row], qs[row], vs[row], p, M, f)
        constraints(times[row], qs[row], vs[row], p, g, g_t, G, gamma)
        energy(times[row], qs[row], vs[row], p, energies[row])
        twice = 0.0
        for i in range(n):
            for j in range(n):
                twice += vs[row, i] * M[i, j] * vs[row, j]
        kinetic[row] = 0.5 * twice
        power[row] = 0.0
        for k in range(3, energies.shape[1]):
            power[row] += energies[row, k]
        for k in range(m):
            power[row] -= lambdas[row, k] * g_t[k]


SIGNATURES = {
    settle: types.boolean(EQUATIONS, CONSTRAINTS, V, float64, V, V, V, V, int64, V),
    balance: void(EQUATIONS, CONSTRAINTS, ENERGY, V, V, A, A, A, A, V, V),
}
"""What is compiled for any module's kernels, and for which arguments."""
