"""Compiled loops for M q'' = f + G^T lambda, g(t, q) = 0.

Two-stage Gauss-Legendre with G q'' + gamma = 0 in place of g = 0 (index 1), drift projected away.

The stages' accelerations and multipliers are the unknowns of a bounded, simplified Newton iteration with the analytic
tangent (Hairer & Wanner 1996, IV.8); order 4, A-stable and without numerical damping, so that stiff axial modes cost
nothing but accuracy of their own.

The step follows the defect of its collocation polynomial: what a at its start and end differ from the line through
the stages by, h^2 a'' / 12. Sums of all four a can't do: where q'' = -w^2 q they lie on a parabola, and any rule that
has the parabola's integral right is the Gauss rule itself. As a displacement, (M + h C + h^2 K)^-1 M h^2 (defect) is

    (w h)^4 / 12 of the amplitude of a vibration that the step resolves, which is what ten of its periods accumulate,
        for the step is wrong by (w h)^5 / 720;
    the amplitude itself of one that it doesn't, w h >> 1.

So a mode is left unresolved only where its vibration is smaller than the error allowed.

Beside it generalised-alpha with a fixed step, as other codes have it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types
from numba.types import int64

from kaneflex.multibody import instant
from kaneflex.multibody.instant import (
    CONSTRAINTS,
    ENERGY,
    EQUATIONS,
    OPTIONS,
    TANGENT,
    A,
    V,
    factorise,
    saddle,
    settle,
    substitute,
)  # fmt: skip
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(instant.__file__)
DONE, TOO_SMALL, SINGULAR, NO_CONVERGENCE, PAUSED = 0, 1, 2, 3, 4
"""How a piece of the integration ended: at its end, with a vanishing step, at a singular state, in a fixed step whose
equations Newton's method does not solve, after as many steps as it may try."""

_ROOT = math.sqrt(3.0)
NODES = np.array([0.5 - _ROOT / 6, 0.5 + _ROOT / 6])
A_1 = np.array([[0.25, 0.25 - _ROOT / 6], [0.25 + _ROOT / 6, 0.25]])
A_2 = A_1 @ A_1
B_2 = 0.5 * (A_1[0] + A_1[1])
"""Nodes of the two stages, their weights for rates and, twice, for places; weights of a whole step's places."""


_BEYOND = NODES[0] / (NODES[1] - NODES[0])
_DEFECTS = np.array([[1.0, -1.0 - _BEYOND, _BEYOND, 0.0], [0.0, _BEYOND, -1.0 - _BEYOND, 1.0]])
"""Of a at a step's start, its stages and its end: by what start and end differ from the line through the stages."""


# Compiled in one piece: a step works on some twenty arrays that are made once a run. A function for a part of it would
# take nearly all of them, and numba hands over seven words an array.
@njit(cache=True, **OPTIONS)
@_made_of_parts
def integrate(
    equations, constraints, tangent, energy, p, scale, control, here, given, times, qs, vs, accels, lambdas, works,
    powers, counts,
):
    """Fill rows 1, 2, ... of the tables at ``times`` [s], from ``here``; every one of them is the end of a step.

    scale: error allowed in each coordinate. control: [next step, longest step, steps to try at most, last row filled].
    here: where the motion stands, before row 1 in time, and is left: t, then q, v, a, multipliers and works as in a
    row of the tables. given: the ends [s] of the steps to take from there, with the ``times`` among them; empty where
    the control of the error chooses them. powers: entries of ``energy``. works: time integrals of the powers
    (dissipation, loads, constraints). counts: accepted and rejected steps, Newton iterations, largest residuals of
    position and velocity before a projection.

    Returns a status and the ends of the steps that were taken.
    """
    n, m = qs.shape[1], lambdas.shape[1]
    size = n + m
    M, f = np.zeros((n, n)), np.zeros(n)
    G, g, g_t, gamma = np.zeros((m, n)), np.zeros(m), np.zeros(m), np.zeros(m)
    K, C = np.zeros((size, n)), np.zeros((size, n))
    big, big_pivots = np.zeros((2 * size, 2 * size)), np.zeros(2 * size, np.int64)
    small, small_pivots = np.zeros((size, size)), np.zeros(size, np.int64)
    x, e = np.zeros(2 * size), np.zeros(size)
    stage_a, stage_l = np.zeros((2, n)), np.zeros((2, m))
    stage_q, stage_v = np.zeros((2, n)), np.zeros((2, n))
    q, v, a, multipliers = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(m)
    q_0, v_0, a_0 = here[1 : 1 + n], here[1 + n : 1 + 2 * n], here[1 + 2 * n : 1 + 3 * n]
    multipliers_0, work = here[1 + 3 * n : 1 + 3 * n + m], here[1 + 3 * n + m :]
    drift, rates = np.zeros(2), np.zeros(powers)
    wanted, t, row, tried, taken = control[0], here[0], 0, 0, 0
    replayed, ends = given.size > 0, np.empty(max(given.size, 2 * times.size))
    while row + 1 < times.size:
        control[0], control[3], here[0] = wanted, row, t
        if tried == control[2]:
            return PAUSED, ends[:taken]
        tried += 1
        if replayed:
            end = given[taken]
            h = end - t
        else:
            wanted = min(wanted, control[1])
            if wanted < 1e-12 * (times[times.size - 1] - times[0]):
                return TOO_SMALL, ends[:taken]
            # Steps of equal length up to the next instant: none is cut to a sliver.
            left = times[row + 1] - t
            h = left / math.ceil(left / wanted * (1.0 - 1e-9))
            end = times[row + 1] if h >= left * (1.0 - 1e-9) else t + h
        M[:, :] = 0.0
        f[:] = 0.0
        G[:, :] = 0.0
        K[:, :] = 0.0
        C[:, :] = 0.0
        equations(t, q_0, v_0, p, M, f)
        constraints(t, q_0, v_0, p, g, g_t, G, gamma)
        tangent(t, q_0, v_0, a_0, multipliers_0, p, K, C)
        for i in range(2):
            for j in range(2):
                d, s = h * A_1[i, j], h * h * A_2[i, j]
                for r in range(size):
                    for c in range(n):
                        big[i * size + r, j * size + c] = d * C[r, c] + s * K[r, c]
                    for c in range(n, size):
                        big[i * size + r, j * size + c] = 0.0
                if i == j:
                    for r in range(n):
                        for c in range(n):
                            big[i * size + r, j * size + c] += M[r, c]
                        for c in range(m):
                            big[i * size + r, j * size + n + c] = -G[c, r]
                    for r in range(m):
                        for c in range(n):
                            big[i * size + n + r, j * size + c] += G[r, c]
        if not factorise(big, big_pivots):
            return SINGULAR, ends[:taken]
        stage_a[0], stage_a[1] = a_0, a_0
        stage_l[0], stage_l[1] = multipliers_0, multipliers_0
        converged, before = False, 0.0
        for iteration in range(30 if replayed else 10):
            counts[2] += 1
            for i in range(2):
                stage_v[i] = v_0 + h * (A_1[i, 0] * stage_a[0] + A_1[i, 1] * stage_a[1])
                stage_q[i] = q_0 + h * NODES[i] * v_0 + h * h * (A_2[i, 0] * stage_a[0] + A_2[i, 1] * stage_a[1])
                M[:, :] = 0.0
                f[:] = 0.0
                G[:, :] = 0.0
                gamma[:] = 0.0
                at = t + h * NODES[i]
                equations(at, stage_q[i], stage_v[i], p, M, f)
                constraints(at, stage_q[i], stage_v[i], p, g, g_t, G, gamma)
                for r in range(n):
                    total = f[r]
                    for c in range(n):
                        total -= M[r, c] * stage_a[i, c]
                    for c in range(m):
                        total += G[c, r] * stage_l[i, c]
                    x[i * size + r] = total
                for r in range(m):
                    total = -gamma[r]
                    for c in range(n):
                        total -= G[r, c] * stage_a[i, c]
                    x[i * size + n + r] = total
            substitute(big, big_pivots, x)
            change = 0.0
            for i in range(2):
                for c in range(n):
                    stage_a[i, c] += x[i * size + c]
                    change = max(change, h * h * abs(x[i * size + c]) / scale[c])
                for c in range(m):
                    stage_l[i, c] += x[i * size + n + c]
            if not change < 1e200:
                break
            if iteration > 0:
                rate = change / before
                if replayed and rate >= 0.5 and change < 1.0:  # the scale is that of rounding
                    converged = True
                    break
                if rate >= 1.0 and change > 1e-3:
                    break
                if change * rate < 1e-3 * max(1.0 - rate, 0.0):
                    converged = True
                    break
            if change < 1e-6:
                converged = True
                break
            before = change
        if not converged:
            if replayed:
                return NO_CONVERGENCE, ends[:taken]
            counts[1] += 1
            wanted = 0.4 * h
            continue
        q[:] = q_0 + h * v_0 + h * h * (B_2[0] * stage_a[0] + B_2[1] * stage_a[1])
        v[:] = v_0 + 0.5 * h * (stage_a[0] + stage_a[1])
        if not settle(equations, constraints, p, end, q, v, a, multipliers, 1, drift):
            return SINGULAR, ends[:taken]
        if not replayed:
            # Defects at both ends, a load may jump between, filtered by [M + h C + h^2 K, -G^T; G, 0].
            M[:, :] = 0.0
            G[:, :] = 0.0
            f[:] = 0.0
            equations(end, q, v, p, M, f)
            constraints(end, q, v, p, g, g_t, G, gamma)
            saddle(M, G, n, m, small)
            for r in range(n):
                for c in range(n):
                    small[r, c] += h * C[r, c] + h * h * K[r, c]
            if not factorise(small, small_pivots):
                return SINGULAR, ends[:taken]
            error = 1e-12
            for of in _DEFECTS:
                e[:] = 0.0
                for c in range(n):
                    defect = of[0] * a_0[c] + of[1] * stage_a[0, c] + of[2] * stage_a[1, c] + of[3] * a[c]
                    for r in range(n):
                        e[r] += h * h * M[r, c] * defect
                substitute(small, small_pivots, e)
                for c in range(n):
                    error = max(error, abs(e[c]) / scale[c])
            growth = min(2.0, max(0.2, 0.9 * error ** (-0.25)))
            if not error <= 1.0:
                counts[1] += 1
                wanted = h * min(growth, 0.9)
                continue
            wanted = max(wanted, h * growth) if growth >= 1.0 else h * growth
        for i in range(2):
            at = t + h * NODES[i]
            rates[:] = 0.0
            energy(at, stage_q[i], stage_v[i], p, rates)
            for k in range(powers - 2):
                work[k] += 0.5 * h * rates[k + 2]
            constraints(at, stage_q[i], stage_v[i], p, g, g_t, G, gamma)
            for k in range(m):
                work[powers - 2 + k] -= 0.5 * h * stage_l[i, k] * g_t[k]
        q_0[:], v_0[:], a_0[:], multipliers_0[:] = q, v, a, multipliers
        counts[0] += 1
        counts[3], counts[4] = max(counts[3], drift[0]), max(counts[4], drift[1])
        if taken == ends.size:
            ends = np.concatenate((ends, np.empty(taken)))
        t, ends[taken] = end, end
        taken += 1
        if t == times[row + 1]:
            row += 1
            qs[row], vs[row], accels[row], lambdas[row], works[row] = q, v, a, multipliers, work
    control[0], control[3], here[0] = wanted, row, t
    return DONE, ends[:taken]


@njit(cache=True, **OPTIONS)
@_made_of_parts
def generalised_alpha(
    equations, constraints, tangent, energy, p, scale, method, algorithmic, times, qs, vs, accels, lambdas, works,
    powers, counts,
):
    """As :func:`integrate`, with one step from row to row, at whose end g = 0 (index 3; Arnold & Bruels 2007).

    method: alpha_m, alpha_f, beta, gamma. algorithmic: the method's own accelerations, overwritten. Returns a status
    and the last row that was filled.
    """
    n, m = qs.shape[1], lambdas.shape[1]
    size = n + m
    alpha_m, alpha_f, beta, gamma = method
    M, f = np.zeros((n, n)), np.zeros(n)
    G, g, g_t, drag = np.zeros((m, n)), np.zeros(m), np.zeros(m), np.zeros(m)
    K, C = np.zeros((size, n)), np.zeros((size, n))
    square, pivots, x = np.zeros((size, size)), np.zeros(size, np.int64), np.zeros(size)
    rates, before = np.zeros(powers), np.zeros(powers - 2 + m)
    energy(times[0], qs[0], vs[0], p, rates)
    constraints(times[0], qs[0], vs[0], p, g, g_t, G, drag)
    before[: powers - 2] = rates[2:]
    before[powers - 2 :] = -lambdas[0] * g_t
    for row in range(times.size - 1):
        t, h = times[row + 1], times[row + 1] - times[row]
        inner = h * h * beta
        multipliers = lambdas[row].copy()
        a = accels[row].copy()
        new = ((1.0 - alpha_f) * a + alpha_f * accels[row] - alpha_m * algorithmic) / (1.0 - alpha_m)
        v = vs[row] + h * ((1.0 - gamma) * algorithmic + gamma * new)
        q = qs[row] + h * vs[row] + h * h * ((0.5 - beta) * algorithmic + beta * new)
        converged, last = False, 0.0
        for iteration in range(20):
            counts[2] += 1
            M[:, :] = 0.0
            f[:] = 0.0
            G[:, :] = 0.0
            K[:, :] = 0.0
            C[:, :] = 0.0
            equations(t, q, v, p, M, f)
            constraints(t, q, v, p, g, g_t, G, drag)
            tangent(t, q, v, a, multipliers, p, K, C)
            # Balance times h^2 beta and multipliers in the same measure: entries then don't depend on the step.
            saddle(M, G, n, m, square)
            for r in range(n):
                total = f[r]
                for c in range(n):
                    total -= M[r, c] * a[c]
                    square[r, c] = (1.0 - alpha_m) / (1.0 - alpha_f) * M[r, c] + h * gamma * C[r, c] + inner * K[r, c]
                for c in range(m):
                    total += G[c, r] * multipliers[c]
                x[r] = inner * total
            x[n:] = -g
            if not factorise(square, pivots):
                return SINGULAR, row
            substitute(square, pivots, x)
            change = 0.0
            for c in range(n):
                q[c] += x[c]
                v[c] += gamma / (h * beta) * x[c]
                new[c] += x[c] / inner
                a[c] += (1.0 - alpha_m) / (1.0 - alpha_f) * x[c] / inner
                change = max(change, abs(x[c]) / scale[c])
            for c in range(m):
                multipliers[c] += x[n + c] / inner
            if not change < 1e200:
                break
            # At the end of what rounding allows, a change no longer falls.
            if change < 1e-3 or (iteration > 2 and change < 1.0 and change >= 0.5 * last):
                converged = True
                break
            last = change
        if not converged:
            return NO_CONVERGENCE, row
        rates[:] = 0.0
        energy(t, q, v, p, rates)
        constraints(t, q, v, p, g, g_t, G, drag)
        works[row + 1] = works[row]
        for k in range(powers - 2 + m):
            now = rates[k + 2] if k < powers - 2 else -multipliers[k - powers + 2] * g_t[k - powers + 2]
            works[row + 1, k] += 0.5 * h * (before[k] + now)
            before[k] = now
        for r in range(m):
            rate = g_t[r]
            for c in range(n):
                rate += G[r, c] * v[c]
            counts[3], counts[4] = max(counts[3], abs(g[r])), max(counts[4], abs(rate))
        counts[0] += 1
        algorithmic[:] = new
        qs[row + 1], vs[row + 1], accels[row + 1], lambdas[row + 1] = q, v, a, multipliers
    return DONE, times.size - 1


_SIGNATURES = instant.SIGNATURES | {
    integrate: types.Tuple((int64, V))(
        EQUATIONS, CONSTRAINTS, TANGENT, ENERGY, V, V, V, V, V, V, A, A, A, A, A, int64, V
    ),
    generalised_alpha: types.UniTuple(int64, 2)(
        EQUATIONS, CONSTRAINTS, TANGENT, ENERGY, V, V, V, V, V, A, A, A, A, A, int64, V
    ),
}


def compile_stepper(integrator: str | None = None) -> None:
    """Compile for kernels of any module, once on a machine: importing this file compiles nothing.

    Without an integrator only what projects states and sums up their energy.
    """
    loops = {"gauss": (integrate,), "generalised-alpha": (generalised_alpha,)}.get(integrator, ())
    for function in (*instant.SIGNATURES, *loops):
        if not function.overloads:
            function.compile(_SIGNATURES[function])
            function.disable_compile()
