"""Compiled loops of a coupled run's slopes: its own steps, differentiated.

Every step solves R(t, q, v, a, lambda; p) = 0 at its stages. Along a direction of the parameters p in which every time
t moves by tau t, the slopes of what it finds obey

    M a' - G^T lambda' + C v' + K q' + R' = 0,    G a' + C v' + K q' + R' = 0

with the matrices of the solved step, and R' at fixed q, v, a and lambda (the staggered direct method of Caracotsios &
Stewart 1985). All directions share a step's factors.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types
from numba.types import FunctionType, float64, void

from kaneflex.multibody import instant, stepping
from kaneflex.multibody.instant import CONSTRAINTS, EQUATIONS, OPTIONS, TANGENT, A, V, factorise, saddle, substitute
from kaneflex.multibody.stepping import A_1, A_2, B_2, NODES
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(instant.__file__, stepping.__file__)
RESIDUAL_SLOPE = FunctionType(void(float64, float64, V, V, V, V, V, V, V))
CLOSING_SLOPE = FunctionType(void(float64, float64, V, V, V, V, V, V))
"""Types of the kernels of a module of slopes."""
_MOST, _SOLVED = 12, 1e-5
"""Iterations at most in a step that the run has solved already, and the last change in shares of the error allowed."""


@njit(**OPTIONS)
def _linear(equations, constraints, tangent, p, t, q, v, a, multipliers, K, C, square, left):
    """K, C and [M, -G^T; G, 0] at a state, and in ``left`` what its residual leaves: (f + G^T lambda - M a, ...)."""
    n, m = q.size, multipliers.size
    M, f = np.zeros((n, n)), np.zeros(n)
    G, g, g_t, gamma = np.zeros((m, n)), np.zeros(m), np.zeros(m), np.zeros(m)
    K[:, :] = 0.0
    C[:, :] = 0.0
    equations(t, q, v, p, M, f)
    constraints(t, q, v, p, g, g_t, G, gamma)
    tangent(t, q, v, a, multipliers, p, K, C)
    saddle(M, G, n, m, square)
    left[:n] = f
    left[n:] = -gamma
    for r in range(n + m):
        for c in range(n):
            left[r] -= square[r, c] * a[c]
        for c in range(m):
            left[r] -= square[r, n + c] * multipliers[c]


@njit(**OPTIONS)
def _put(closing_slope, p, p_slope, t, t_slope, q, v, m, C, G, square, pivots, x, dq, dv):
    """Put slopes of q and v onto those of the constraints, by the least change by mass; square holds its factors."""
    n = q.size
    g, rate = np.zeros(m), np.zeros(m)
    closing_slope(t, t_slope, q, v, p, p_slope, g, rate)
    x[:n] = 0.0
    for i in range(m):
        x[n + i] = -g[i]
        for j in range(n):
            x[n + i] -= G[i, j] * dq[j]
    substitute(square, pivots, x)
    dq += x[:n]
    # d(g_t + G v)/dq is the rate of G, and C holds twice that: gamma is quadratic in v
    x[:n] = 0.0
    for i in range(m):
        x[n + i] = -rate[i]
        for j in range(n):
            x[n + i] -= G[i, j] * dv[j] + 0.5 * C[n + i, j] * dq[j]
    substitute(square, pivots, x)
    dv += x[:n]


@njit(**OPTIONS)
def _follow(residual_slope, p, p_slope, t, t_slope, q, v, a, multipliers, K, C, dq, dv, x):
    """-(C v' + K q' + R'): what a' and lambda' balance."""
    x[:] = 0.0
    residual_slope(t, t_slope, q, v, a, multipliers, p, p_slope, x)
    for i in range(x.size):
        x[i] = -x[i]
        for j in range(dq.size):
            x[i] -= K[i, j] * dq[j] + C[i, j] * dv[j]


@njit(**OPTIONS)
def _solve_stages(
    equations, constraints, tangent, p, scale, t, h, q_0, v_0, stage_q, stage_v, stage_a, stage_l, K, C, big, pivots
):
    """Newton's method on the stages of a step, from their a and lambda; big keeps the factors. False without them."""
    n, m = stage_a.shape[1], stage_l.shape[1]
    size = n + m
    x, left, small = np.zeros(2 * size), np.zeros(size), np.zeros((size, size))
    for _ in range(_MOST):
        for i in range(2):
            for c in range(n):
                twice = A_2[i, 0] * stage_a[0, c] + A_2[i, 1] * stage_a[1, c]
                stage_v[i, c] = v_0[c] + h * (A_1[i, 0] * stage_a[0, c] + A_1[i, 1] * stage_a[1, c])
                stage_q[i, c] = q_0[c] + h * NODES[i] * v_0[c] + h * h * twice
            _linear(
                equations, constraints, tangent, p, t + h * NODES[i], stage_q[i], stage_v[i], stage_a[i], stage_l[i],
                K[i], C[i], small, left,
            )
            x[i * size : (i + 1) * size] = left
            for j in range(2):
                d, s = h * A_1[i, j], h * h * A_2[i, j]
                for r in range(size):
                    for c in range(n):
                        big[i * size + r, j * size + c] = d * C[i, r, c] + s * K[i, r, c]
                    for c in range(n, size):
                        big[i * size + r, j * size + c] = 0.0
            for r in range(size):
                for c in range(size):
                    big[i * size + r, i * size + c] += small[r, c]
        if not factorise(big, pivots):
            return False
        substitute(big, pivots, x)
        change = 0.0
        for i in range(2):
            for c in range(m):
                stage_l[i, c] += x[i * size + n + c]
            for c in range(n):
                stage_a[i, c] += x[i * size + c]
                change = max(change, h * h * abs(x[i * size + c]) / scale[c])
        if change < _SOLVED:
            break
    return True


@njit(cache=True, **OPTIONS)
@_made_of_parts
def gauss_slopes(
    equations, constraints, tangent, residual_slope, closing_slope, p, p_slopes, stretches, scale, times, qs, vs,
    accels, lambdas, slopes,
):
    """Fill rows 1, 2, ... of ``slopes`` from row 0, along steps of two-stage Gauss-Legendre from row to row.

    slopes: (rows, directions, 3 n + m), of q, v, a and lambda; in row 0 q and v, which are put onto the constraints.
    p_slopes (directions, len(p)). scale: error allowed in each coordinate. False where a step has no factors.
    """
    n, m = qs.shape[1], lambdas.shape[1]
    size = n + m
    K, C = np.zeros((2, size, n)), np.zeros((2, size, n))
    big, big_pivots = np.zeros((2 * size, 2 * size)), np.zeros(2 * size, np.int64)
    small, pivots, G = np.zeros((size, size)), np.zeros(size, np.int64), np.zeros((m, n))
    x, left = np.zeros(2 * size), np.zeros(size)
    stage_a, stage_l = np.zeros((2, n)), np.zeros((2, m))
    stage_q, stage_v = np.zeros((2, n)), np.zeros((2, n))
    stage_dq, stage_dv = np.zeros((2, n)), np.zeros((2, n))
    for row in range(times.size):
        slopes[row, :, : 2 * n] = slopes[max(row - 1, 0), :, : 2 * n]
        if row > 0:
            t, h = times[row - 1], times[row] - times[row - 1]
            q_0, v_0 = qs[row - 1], vs[row - 1]
            for i in range(2):
                stage_a[i], stage_l[i] = accels[row - 1], lambdas[row - 1]
            if not _solve_stages(
                equations, constraints, tangent, p, scale, t, h, q_0, v_0, stage_q, stage_v, stage_a, stage_l, K, C,
                big, big_pivots,
            ):
                return False
            for k in range(stretches.size):
                tau, dq, dv = stretches[k], slopes[row, k, :n], slopes[row, k, n : 2 * n]
                # of the stages with a' = 0, then a' itself
                for i in range(2):
                    for c in range(n):
                        once = A_1[i, 0] * stage_a[0, c] + A_1[i, 1] * stage_a[1, c]
                        twice = A_2[i, 0] * stage_a[0, c] + A_2[i, 1] * stage_a[1, c]
                        stage_dv[i, c] = dv[c] + tau * h * once
                        stage_dq[i, c] = dq[c] + h * NODES[i] * (dv[c] + tau * v_0[c]) + 2.0 * tau * h * h * twice
                    at = t + h * NODES[i]
                    _follow(
                        residual_slope, p, p_slopes[k], at, tau * at, stage_q[i], stage_v[i], stage_a[i], stage_l[i],
                        K[i], C[i], stage_dq[i], stage_dv[i], left,
                    )
                    x[i * size : (i + 1) * size] = left
                substitute(big, big_pivots, x)
                for c in range(n):
                    dq[c] += h * (dv[c] + tau * v_0[c])
                    for i in range(2):
                        da = x[i * size + c]
                        dq[c] += h * h * B_2[i] * (da + 2.0 * tau * stage_a[i, c])
                        dv[c] += 0.5 * h * (da + tau * stage_a[i, c])
        at, q, v, a, multipliers = times[row], qs[row], vs[row], accels[row], lambdas[row]
        _linear(equations, constraints, tangent, p, at, q, v, a, multipliers, K[0], C[0], small, left)
        G[:, :] = small[n:, :n]
        if not factorise(small, pivots):
            return False
        for k in range(stretches.size):
            dq, dv, t_slope = slopes[row, k, :n], slopes[row, k, n : 2 * n], stretches[k] * at
            _put(closing_slope, p, p_slopes[k], at, t_slope, q, v, m, C[0], G, small, pivots, left, dq, dv)
            _follow(residual_slope, p, p_slopes[k], at, t_slope, q, v, a, multipliers, K[0], C[0], dq, dv, left)
            substitute(small, pivots, left)
            slopes[row, k, 2 * n :] = left
    return True


@njit(cache=True, **OPTIONS)
@_made_of_parts
def alpha_slopes(
    equations, constraints, tangent, residual_slope, closing_slope, p, p_slopes, stretches, method, times, qs, vs,
    accels, lambdas, slopes,
):
    """As :func:`gauss_slopes` along the steps of generalised-alpha; method: alpha_m, alpha_f, beta, gamma."""
    n, m = qs.shape[1], lambdas.shape[1]
    size = n + m
    alpha_m, alpha_f, beta, gamma = method
    share = (1.0 - alpha_f) / (1.0 - alpha_m)
    K, C = np.zeros((size, n)), np.zeros((size, n))
    square, pivots, G = np.zeros((size, size)), np.zeros(size, np.int64), np.zeros((m, n))
    left, g, rate = np.zeros(size), np.zeros(m), np.zeros(m)
    algorithmic, new = accels[0].copy(), np.zeros(n)
    d_algorithmic, d_new = np.zeros((stretches.size, n)), np.zeros(n)
    for row in range(times.size):
        t, q, v, a, multipliers = times[row], qs[row], vs[row], accels[row], lambdas[row]
        _linear(equations, constraints, tangent, p, t, q, v, a, multipliers, K, C, square, left)
        G[:, :] = square[n:, :n]
        h = times[row] - times[max(row - 1, 0)]
        if row > 0:
            square[:n, :n] += share * h * (gamma * C[:n] + h * beta * K[:n])
            new[:] = share * a + (alpha_f * accels[row - 1] - alpha_m * algorithmic) / (1.0 - alpha_m)
        if not factorise(square, pivots):
            return False
        for k in range(stretches.size):
            tau, slope, before = stretches[k], slopes[row, k], slopes[max(row - 1, 0), k]
            dq, dv = slope[:n], slope[n : 2 * n]
            if row == 0:
                _put(closing_slope, p, p_slopes[k], t, tau * t, q, v, m, C, G, square, pivots, left, dq, dv)
                _follow(residual_slope, p, p_slopes[k], t, tau * t, q, v, a, multipliers, K, C, dq, dv, left)
                substitute(square, pivots, left)
                slope[2 * n :] = left
                d_algorithmic[k] = left[:n]
                continue
            # what the step would have with a' = 0, then a' itself
            d_new[:] = (alpha_f * before[2 * n : 3 * n] - alpha_m * d_algorithmic[k]) / (1.0 - alpha_m)
            mean_v = (1.0 - gamma) * algorithmic + gamma * new
            mean_q = (0.5 - beta) * algorithmic + beta * new
            dv[:] = before[n : 2 * n] + h * ((1.0 - gamma) * d_algorithmic[k] + gamma * d_new + tau * mean_v)
            dq[:] = before[:n] + h * (before[n : 2 * n] + tau * vs[row - 1])
            dq += h * h * ((0.5 - beta) * d_algorithmic[k] + beta * d_new + 2.0 * tau * mean_q)
            _follow(residual_slope, p, p_slopes[k], t, tau * t, q, v, a, multipliers, K, C, dq, dv, left)
            g[:] = 0.0
            rate[:] = 0.0
            closing_slope(t, tau * t, q, v, p, p_slopes[k], g, rate)
            for i in range(m):
                left[n + i] = -g[i]
                for j in range(n):
                    left[n + i] -= G[i, j] * dq[j]
                left[n + i] /= share * h * h * beta  # a step ends where g = 0, and dq grows by this times a'
            substitute(square, pivots, left)
            slope[2 * n :] = left
            d_new += share * left[:n]
            dv += share * h * gamma * left[:n]
            dq += share * h * h * beta * left[:n]
            d_algorithmic[k] = d_new
        if row > 0:
            algorithmic[:] = new
    return True


_TABLE = float64[:, :, ::1]
_SIGNATURE = types.boolean(
    EQUATIONS, CONSTRAINTS, TANGENT, RESIDUAL_SLOPE, CLOSING_SLOPE, V, A, V, V, V, A, A, A, A, _TABLE
)


def compile_slopes(integrator: str) -> None:
    """Compile an integrator's loop for kernels of any module, once on a machine."""
    function = {"gauss": gauss_slopes, "generalised-alpha": alpha_slopes}[integrator]
    if not function.overloads:
        function.compile(_SIGNATURE)
        function.disable_compile()
