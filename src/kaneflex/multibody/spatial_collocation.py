"""Compiled integration of deforming bodies in space by collocation with three stages.

As in :mod:`kaneflex.multibody.collocation`, the accelerations of the stages, here of the independent speeds, are the
unknowns of a simplified Newton iteration

    (M + h mu C + h^2 mu^2 K) x = M r        (Hairer & Wanner 1996, IV.8, for second-order equations)

with M r the residual of the equations of motion: r follows by the mass matrix of each stage, factorised at its first
iteration. M, K and C on the left are reduced by the partial velocities in the middle of the step; K and C of shapes,
springs and loads' laws: all stiff terms. The step size follows the defect of the polynomial at its start, as a
displacement. Quaternions of balls and dependent coordinates follow from their rates at the stages by the same
quadrature.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody import dense_lu
from kaneflex.multibody.coefficients import basis
from kaneflex.multibody.spatial_bushings import ANGLE, MOST
from kaneflex.multibody.spatial_dynamics import coordinate_rates, missed
from kaneflex.multibody.spatial_instant import DONE, GROWN, MASSLESS, OVERTURNED, TOO_SMALL, stand
from kaneflex.multibody.spatial_steps import EVALUATIONS, GROWTH, LENGTH, LONGEST, OUTCOME, ROW, WANTED
from kaneflex.multibody.spatial_stiffness import powers, reduce, reduced
from kaneflex.multibody.spatial_tables import BALL, COORDINATE, KIND, SPEED
from kaneflex.multibody.tables import OPTIONS, apart, larger, smaller

_NEAR = 1e-3
"""Largest residual of a step's equations, in errors allowed."""
_FAR = 100.0
"""Longest extrapolation of a step's polynomial, in lengths of the step."""
_LEAST = 1e-12
"""Least step, as a share of the run."""
_ITERATIONS = 10
"""Iterations of a step, before a shorter one is tried."""


@njit(**OPTIONS)
def _first_guess(m, choice, s, h):
    """First guess of the stages by extrapolation of the last step, or as at its end if that is too far."""
    apart()
    c, length = s.table.nodes, s.control[LENGTH]
    goes_on = length > 0.0 and _FAR * length > h
    if not goes_on:
        coordinate_rates(m, s.q, s.u, s.D[0])
    for n in range(len(s.q)):
        a, b, d = s.D[0, n], s.D[1, n], s.D[2, n]
        for i in range(3):
            x = 1.0 + c[i] * h / length
            s.D[i, n] = basis(c, x, 0) * a + basis(c, x, 1) * b + basis(c, x, 2) * d if goes_on else a
    for e in range(len(choice.independent)):
        n = choice.independent[e]
        a, b, d = s.A[0, n], s.A[1, n], s.A[2, n]
        for i in range(3):
            x = 1.0 + c[i] * h / length
            s.A[i, n] = basis(c, x, 0) * a + basis(c, x, 1) * b + basis(c, x, 2) * d if goes_on else s.du[n]


@njit(**OPTIONS)
def _stand(choice, k, s, h, c, a_1, a_2):
    """Set coordinates and independent speeds by the stages at a share c of the step."""
    apart()
    A, D = s.A, s.D
    for n in range(len(s.q)):
        k.q[n] = s.q[n] + h * (a_1[0] * D[0, n] + a_1[1] * D[1, n] + a_1[2] * D[2, n])
    for n in range(len(s.u)):
        k.u[n] = 0.0
    for e in range(len(choice.independent)):
        n = choice.independent[e]
        a, b, d = A[0, n], A[1, n], A[2, n]
        k.u[n] = s.u[n] + h * (a_1[0] * a + a_1[1] * b + a_1[2] * d)
        at = s.coordinate[n]
        if at >= 0:
            k.q[at] = s.q[at] + h * (c * s.u[n] + h * (a_2[0] * a + a_2[1] * b + a_2[2] * d))


@njit(**OPTIONS)
def _residual(m, choice, k, law, s, t, with_mass, out):
    """Residual of the equations of motion in the state of ``_stand`` at t; returns an outcome code."""
    apart()
    s.control[EVALUATIONS] += 1.0
    outcome = stand(m, choice, k, law, t)
    if outcome == DONE:
        missed(m, k, choice, k.u, k.du, k.sizes, with_mass, out)
    for n in range(len(k.bushings)):
        if outcome == DONE and k.bushings[n, ANGLE] > MOST:
            outcome = OVERTURNED
    return outcome


@njit(**OPTIONS)
def _factorise_mass(choice, k, s, factors, i):
    """Factors of a stage's reduced mass matrix; False where it is singular: shapes of the first order can take more
    inertia than there is."""
    apart()
    f = len(s.M)
    mass = factors[: f * f].reshape(f, f)
    reduced(choice, k.M, mass, choice.step)
    if i == 1:
        for e in range(f):
            for n in range(f):
                s.M[e, n] = mass[e, n]
    return dense_lu.factorise_wide(factors, 0, f, f * f)


@njit(**OPTIONS)
def _stage(m, choice, k, law, s, h, i, with_mass):
    """Residual of stage i, as accelerations; returns an outcome code."""
    apart()
    table = s.table
    _stand(choice, k, s, h, table.nodes[i], table.a_1[i], table.a_2[i])
    for e in range(len(choice.independent)):
        k.du[choice.independent[e]] = s.A[i, choice.independent[e]]
    outcome = _residual(m, choice, k, law, s, s.t[0] + table.nodes[i] * h, with_mass, s.r[i])
    coordinate_rates(m, k.q, k.u, s.D[i])
    if outcome == DONE and with_mass and not _factorise_mass(choice, k, s, s.masses[i], i):
        return MASSLESS
    f = len(s.M)
    for e in range(f):
        s.masses[i, f * f + e] = s.r[i, e]
    dense_lu.substitute_definite(s.masses[i], 0, f, f * f)
    for e in range(f):
        s.r[i, e] = s.masses[i, f * f + e]
    return outcome


@njit(**OPTIONS)
def _factors(s, h):
    """Factorise the matrices of the stages; False: singular."""
    apart()
    f, one, two = len(s.M), h * s.table.real[0], h * s.table.pair[0]
    for e in range(f):
        for n in range(f):
            s.real[f * e + n] = s.M[e, n] + one * (s.damped[e, n] + one * s.stiff[e, n])
            s.pair[f * e + n] = s.M[e, n] + two * (s.damped[e, n] + two * s.stiff[e, n])
    return dense_lu.factorise(s.real, 0, f, s.pivots, 0) and dense_lu.factorise(s.pair, 0, f, s.pivots, f)


@njit(**OPTIONS)
def _improve(choice, s, h):
    """Iteration of the stages; returns the largest change, as a displacement in errors allowed."""
    apart()
    f, into, out, r, at = len(s.M), s.table.into, s.table.out, s.r, len(s.M) ** 2
    for e in range(f):
        s.real[at + e], s.pair[at + e] = 0.0, 0.0
        for n in range(f):
            real = into[0, 0].real * r[0, n] + into[0, 1].real * r[1, n] + into[0, 2].real * r[2, n]
            s.real[at + e] += s.M[e, n] * real
            s.pair[at + e] += s.M[e, n] * (into[1, 0] * r[0, n] + into[1, 1] * r[1, n] + into[1, 2] * r[2, n])
    dense_lu.substitute(s.real, 0, f, s.pivots, 0, at)
    dense_lu.substitute(s.pair, 0, f, s.pivots, f, at)
    change = 0.0
    for e in range(f):
        n = choice.independent[e]
        for i in range(3):
            d = out[0, i].real * s.real[at + e] + 2.0 * (out[1, i] * s.pair[at + e]).real
            s.A[i, n] += d
            s.powers[i, 1] += s.drives[e] * d
            change = larger(change, h * h * abs(d) / s.scale[n])
    return change


@njit(**OPTIONS)
def _turned(m, s, i, h):
    """Change of a ball's rates in stage i, as a displacement in errors allowed."""
    apart()
    change = 0.0
    for n in range(len(m.nodes)):
        if m.nodes[n, KIND] == BALL:
            allowed = s.scale[m.nodes[n, SPEED]]
            for j in range(m.nodes[n, COORDINATE], m.nodes[n, COORDINATE] + 4):
                change = larger(change, h * abs(s.D[i, j] - s.old[j]) / allowed)
    return change


@njit(**OPTIONS)
def _iterate(m, choice, k, law, s, h):
    """Solve the stage equations; returns an outcome code."""
    apart()
    before = 0.0
    for iteration in range(_ITERATIONS):
        turned = 0.0
        for i in range(3):
            for n in range(len(s.old)):
                s.old[n] = s.D[i, n]
            outcome = _stage(m, choice, k, law, s, h, i, iteration == 0)
            if outcome != DONE:
                return outcome
            if iteration > 0:
                turned = larger(turned, _turned(m, s, i, h))
                powers(m, choice, k, s.C, s.powers[i])
            elif i == 1:
                reduce(m, choice, k, law, s, s.t[0] + s.table.nodes[i] * h, h)
                if not _factors(s, h):
                    return TOO_SMALL
        change = larger(_improve(choice, s, h), turned)
        if not change < 1e200:
            return TOO_SMALL
        if iteration > 0:
            rate = change / before
            if rate >= 1.0 and change > 1e-3:
                return TOO_SMALL
            if change * rate < _NEAR * larger(1.0 - rate, 0.0) or change < 1e-6:
                return DONE
        before = change
    return TOO_SMALL


@njit(**OPTIONS)
def _error(choice, s, h):
    """Error of the step in errors allowed, of all displacements: S^-1 M d = d - S^-1 (h mu C + h^2 mu^2 K) d."""
    apart()
    f, c, one, at, B = len(s.M), s.table.nodes, h * s.table.real[0], len(s.M) ** 2, choice.basis
    w_0, w_1, w_2 = basis(c, 0.0, 0), basis(c, 0.0, 1), basis(c, 0.0, 2)
    for e in range(f):
        n = choice.independent[e]
        s.defect[e] = w_0 * s.A[0, n] + w_1 * s.A[1, n] + w_2 * s.A[2, n] - s.du[n]
    for e in range(f):
        s.real[at + e] = 0.0
        for n in range(f):
            s.real[at + e] -= one * (s.damped[e, n] + one * s.stiff[e, n]) * s.defect[n]
    dense_lu.substitute(s.real, 0, f, s.pivots, 0, at)
    error = 1e-12
    for n in range(len(s.u)):
        missed = 0.0
        for e in range(f):
            missed += B[e, n] * (s.defect[e] + s.real[at + e])
        error = larger(error, 0.5 * h * h * abs(missed) / s.scale[n])
    return error


@njit(**OPTIONS)
def _keep(choice, s, h, end, row):
    """Store a step in its row, before it is taken."""
    apart()
    n, u, a_1 = len(s.q), len(s.u), s.table.a_1
    for e in range(len(choice.independent)):  # of what the last iteration made of the stages
        of = choice.independent[e]
        if s.coordinate[of] >= 0:
            for i in range(3):
                rate = a_1[i, 0] * s.A[0, of] + a_1[i, 1] * s.A[1, of] + a_1[i, 2] * s.A[2, of]
                s.D[i, s.coordinate[of]] = s.u[of] + h * rate
    row[0], row[1], at = s.t[0], end, 4
    for i in range(n):
        row[at + i] = s.q[i]
    for i in range(u):
        row[at + n + i] = s.u[i]
    for j in range(3):
        at += n + u
        for i in range(n):
            row[at + i] = s.D[j, i]
        for i in range(u):
            row[at + n + i] = s.A[j, i]


@njit(**OPTIONS)
def _finish(m, choice, k, law, s, h, end):
    """Take the step, whose last stage is its end; returns the outcome there."""
    apart()
    b_1 = s.table.b_1
    _stand(choice, k, s, h, 1.0, b_1, s.table.b_2)
    outcome = stand(m, choice, k, law, end)
    if outcome != DONE:
        return outcome
    for n in range(len(m.nodes)):
        if m.nodes[n, KIND] == BALL:
            at = m.nodes[n, COORDINATE]
            size = math.sqrt(k.q[at] ** 2 + k.q[at + 1] ** 2 + k.q[at + 2] ** 2 + k.q[at + 3] ** 2)
            for i in range(4):
                k.q[at + i] /= size
    for i in range(2):
        s.works[i] += h * (b_1[0] * s.powers[0, i] + b_1[1] * s.powers[1, i] + b_1[2] * s.powers[2, i])
    for n in range(len(s.q)):
        s.q[n] = k.q[n]
    for n in range(len(s.u)):
        s.u[n], s.du[n] = k.u[n], k.du[n]
    for e in range(len(choice.independent)):
        n = choice.independent[e]
        s.du[n] = s.A[2, n]
    s.t[0] = end
    return DONE


@njit(**OPTIONS)
def largest_share(choice):
    """Largest entry of the basis, in the measures of the speeds."""
    apart()
    largest, B = 0.0, choice.basis
    for e in range(len(choice.independent)):
        for n in range(B.shape[1]):
            largest = larger(largest, abs(B[e, n]) * choice.measure[choice.independent[e]] / choice.measure[n])
    return largest


@njit(**OPTIONS)
def collocate(m, choice, k, law, s, times, out):
    """Take steps, each stored in a row of ``out``, until it is full or the last of ``times`` [s], which all end a
    step; returns their number. ``control`` has the outcome of the last one."""
    apart()
    control, taken, failed = s.control, 0, TOO_SMALL
    control[OUTCOME] = DONE
    while taken < len(out) and int(control[ROW]) < len(times):
        t, aim = s.t[0], times[int(control[ROW])]
        control[WANTED] = smaller(control[WANTED], control[LONGEST])
        if control[WANTED] < _LEAST * times[len(times) - 1]:
            control[OUTCOME] = failed
            return taken
        left = aim - t
        h = left / math.ceil(left / control[WANTED] * (1.0 - 1e-9))
        reaches = h >= left * (1.0 - 1e-9)
        end = aim if reaches else t + h
        h = end - t
        _first_guess(m, choice, s, h)
        outcome = _iterate(m, choice, k, law, s, h)
        if outcome != DONE:
            failed, control[WANTED], control[LENGTH] = outcome, 0.4 * h, 0.0
            continue
        error = _error(choice, s, h)
        growth = smaller(3.0, larger(0.2, 0.9 * error ** (-0.2)))
        if not error <= 1.0:
            control[WANTED], control[LENGTH], failed = h * smaller(growth, 0.9), 0.0, TOO_SMALL
            continue
        _keep(choice, s, h, end, out[taken])
        outcome = _finish(m, choice, k, law, s, h, end)
        if outcome != DONE:
            failed, control[WANTED], control[LENGTH] = outcome, 0.4 * h, 0.0
            continue
        out[taken, 2], out[taken, 3] = s.works[0], s.works[1]
        control[WANTED] = larger(control[WANTED], h * growth) if growth >= 1.0 else h * growth
        control[LENGTH] = h
        taken += 1
        if reaches:
            control[ROW] += 1.0
        if len(choice.dependent) and largest_share(choice) > control[GROWTH]:
            control[OUTCOME] = GROWN
            return taken
    return taken
