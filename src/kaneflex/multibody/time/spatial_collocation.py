"""Compiled integration of deforming bodies in space by collocation with three stages.

As in :mod:`kaneflex.multibody.time.collocation`, the accelerations of the stages, here of the independent speeds, are
the unknowns of a simplified Newton iteration

    S x = M r,   S = M + h mu C + h^2 mu^2 K        (Hairer & Wanner 1996, IV.8, for second-order equations),

with M r the residual of the equations of motion: r follows by the mass matrix of each stage, factorised at its first
iteration (with a single one per step the iteration diverges: it changes within a step by more than S). S belongs to the
middle of the step, with K and C of shapes, springs and loads' laws: all stiff terms. As S^-1 M r = r - S^-1 (h mu C +
h^2 mu^2 K) r, no product with M is needed. The step size follows the defect of the polynomial at its start, as a
displacement. Quaternions of balls and dependent coordinates follow from their rates at the stages by the same
quadrature.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.values import after
from kaneflex.multibody.dynamics.constrained import ALL, PAIR_ROWS, REAL_ROWS, factorise_rows, solve_rows
from kaneflex.multibody.dynamics.spatial_bushings import ANGLE, MOST
from kaneflex.multibody.dynamics.spatial_dynamics import (
    INDEPENDENT,
    KEPT_ROWS,
    PRESCRIBED,
    coordinate_rates,
    fill,
    missed,
    solve_reduced,
    tie,
)  # fmt: skip
from kaneflex.multibody.dynamics.spatial_dynamics import basis as speed_basis
from kaneflex.multibody.dynamics.spatial_instant import DONE, GROWN, MASSLESS, OVERTURNED, TOO_SMALL, stand
from kaneflex.multibody.dynamics.spatial_stiffness import add_rows, drive_powers, powers, resist
from kaneflex.multibody.dynamics.spatial_work import BUSHINGS, COORDINATES, NODES, SPEEDS
from kaneflex.multibody.model.layout import OPTIONS, Fixed, Handed, N, apart, larger, smaller
from kaneflex.multibody.model.spatial_layout import BALL, COORDINATE, KIND, SPEED
from kaneflex.multibody.time.coefficients import TABLE, basis

WANTED, LENGTH, LONGEST, GROWTH, ROW, OUTCOME, EVALUATIONS = range(7)
"""Entries of ``control``: next step, last one or 0, longest one [s]; largest dependent speed per independent one
before another choice is requested; next of the times that end a step; outcome of the piece; number of evaluations."""
STEPS = Handed(
    "Steps in space", table=TABLE, control=N, t=N, q=N, u=N, du=N, works=N, scale=N, coordinate=Fixed(1), A=N, D=N,
    powers=N, old=N, missing=N, r=N, drives=N, sizes=N, mass_0=REAL_ROWS, mass_1=REAL_ROWS, mass_2=REAL_ROWS,
    real=REAL_ROWS, pair=PAIR_ROWS,
)  # fmt: skip
"""An integration with one choice of speeds, see :class:`kaneflex.multibody.time.spatial_steps.Steps`."""

_NEAR = 1e-3
"""Largest residual of a step's equations, in errors allowed."""
_FAR = 100.0
"""Longest extrapolation of a step's polynomial, in lengths of the step."""
_LEAST = 1e-12
"""Least step, as a share of the run."""
_ITERATIONS = 10
"""Iterations of a step, before a shorter one is tried."""


@njit(**OPTIONS)
def _first_guess(m, c, s, h):
    """First guess of the stages by extrapolation of the last step, or as at its end if that is too far."""
    apart()
    nodes, length, count, speeds = s.table.nodes, s.control[LENGTH], m.counts[COORDINATES], m.counts[SPEEDS]
    goes_on = length > 0.0 and _FAR * length > h
    if not goes_on:
        coordinate_rates(m, s.q, s.u, s.D)
    for n in range(count):
        a, b, d = s.D[n], s.D[count + n], s.D[2 * count + n]
        for i in range(3):
            x = 1.0 + nodes[i] * h / length
            further = basis(nodes, x, 0) * a + basis(nodes, x, 1) * b + basis(nodes, x, 2) * d
            s.D[count * i + n] = further if goes_on else a
    for e in range(c.counts[INDEPENDENT]):
        n = c.independent[e]
        a, b, d = s.A[n], s.A[speeds + n], s.A[2 * speeds + n]
        for i in range(3):
            x = 1.0 + nodes[i] * h / length
            further = basis(nodes, x, 0) * a + basis(nodes, x, 1) * b + basis(nodes, x, 2) * d
            s.A[speeds * i + n] = further if goes_on else s.du[n]


@njit(**OPTIONS)
def _stand(m, c, s, h, share, a_1, a_2):
    """Set coordinates and independent speeds by the stages at a share of the step."""
    apart()
    A, D, count, speeds = s.A, s.D, m.counts[COORDINATES], m.counts[SPEEDS]
    for n in range(count):
        m.q[n] = s.q[n] + h * (a_1[0] * D[n] + a_1[1] * D[count + n] + a_1[2] * D[2 * count + n])
    for n in range(speeds):
        m.u[n] = 0.0
    for e in range(c.counts[INDEPENDENT]):
        n = c.independent[e]
        a, b, d = A[n], A[speeds + n], A[2 * speeds + n]
        m.u[n] = s.u[n] + h * (a_1[0] * a + a_1[1] * b + a_1[2] * d)
        at = s.coordinate[n]
        if at >= 0:
            m.q[at] = s.q[at] + h * (share * s.u[n] + h * (a_2[0] * a + a_2[1] * b + a_2[2] * d))


@njit(**OPTIONS)
def _mass(s, i):
    """Factors of the mass matrix of a stage."""
    return s.mass_0 if i == 0 else s.mass_1 if i == 1 else s.mass_2


@njit(**OPTIONS)
def _stage(m, c, s, h, i, with_mass):
    """Residual of stage i, as accelerations r of all speeds; returns an outcome code."""
    apart()
    table, speeds, r = s.table, m.counts[SPEEDS], after(s.r, m.counts[SPEEDS] * i)
    _stand(m, c, s, h, table.nodes[i], after(table.a_1, 3 * i), after(table.a_2, 3 * i))
    for e in range(c.counts[INDEPENDENT]):
        m.du[c.independent[e]] = s.A[speeds * i + c.independent[e]]
    s.control[EVALUATIONS] += 1.0
    outcome = stand(m, c, s.t[0] + table.nodes[i] * h)
    if outcome != DONE:
        return outcome
    missed(m, c, with_mass, s.missing)
    for n in range(m.counts[BUSHINGS]):
        if m.bushings[9 * n + ANGLE] > MOST:
            return OVERTURNED
    coordinate_rates(m, m.q, m.u, after(s.D, m.counts[COORDINATES] * i))
    mass = _mass(s, i)
    if with_mass:
        fill(m, c, mass, 0.0)
        if not factorise_rows(mass, 0.0):
            return MASSLESS
    solve_reduced(m, c, mass, s.missing)
    for n in range(speeds):
        r[n] = -mass.tree.y[n] if mass.tree.free[n] != 0 else 0.0
    return outcome


@njit(**OPTIONS)
def _factors(m, c, s, h):
    """Factorise the matrices of the stages at the middle one; False: singular."""
    apart()
    real, pair, one, two = s.real, s.pair, h * s.table.real[0], h * s.table.pair[0]
    fill(m, c, real, one)
    fill(m, c, pair, two)
    add_rows(m, c, real, s.sizes, s.t[0] + s.table.nodes[1] * h, h)
    pair.rows[ALL] = real.rows[ALL]
    return factorise_rows(real, one) and factorise_rows(pair, two)


@njit(**OPTIONS)
def _solve(m, f, h):
    """Subtract S^-1 (h C + h^2 K) y from the accelerations y at ``given``."""
    apart()
    resist(m, f, h)
    solve_rows(f)
    for n in range(m.counts[SPEEDS]):
        f.given[n] -= f.tree.y[n]


@njit(**OPTIONS)
def _improve(m, c, s, h):
    """Iteration of the stages; returns the largest change, as a displacement in errors allowed."""
    apart()
    n, into, out, r = m.counts[SPEEDS], s.table.into, s.table.out, s.r
    for k in range(n):
        s.real.given[k] = into[0].real * r[k] + into[1].real * r[n + k] + into[2].real * r[2 * n + k]
        s.pair.given[k] = into[3] * r[k] + into[4] * r[n + k] + into[5] * r[2 * n + k]
    _solve(m, s.real, h * s.table.real[0])
    _solve(m, s.pair, h * s.table.pair[0])
    change = 0.0
    for e in range(c.counts[INDEPENDENT]):
        k = c.independent[e]
        for i in range(3):
            d = out[i].real * s.real.given[k] + 2.0 * (out[3 + i] * s.pair.given[k]).real
            s.A[n * i + k] += d
            s.powers[2 * i + 1] += s.drives[e] * d
            change = larger(change, h * h * abs(d) / s.scale[k])
    return change


@njit(**OPTIONS)
def _turned(m, s, i, h):
    """Change of a ball's rates in stage i, as a displacement in errors allowed."""
    apart()
    change = 0.0
    for n in range(m.counts[NODES]):
        if m.nodes[n, KIND] == BALL:
            allowed = s.scale[m.nodes[n, SPEED]]
            for j in range(m.nodes[n, COORDINATE], m.nodes[n, COORDINATE] + 4):
                change = larger(change, h * abs(s.D[m.counts[COORDINATES] * i + j] - s.old[j]) / allowed)
    return change


@njit(**OPTIONS)
def _iterate(m, c, s, h):
    """Solve the stage equations; returns an outcome code."""
    apart()
    before, count = 0.0, m.counts[COORDINATES]
    for iteration in range(_ITERATIONS):
        turned = 0.0
        for i in range(3):
            for n in range(count):
                s.old[n] = s.D[count * i + n]
            outcome = _stage(m, c, s, h, i, iteration == 0)
            if outcome != DONE:
                return outcome
            if iteration > 0:
                turned = larger(turned, _turned(m, s, i, h))
                powers(m, c, s.missing, after(s.powers, 2 * i))
            elif i == 1:
                if not _factors(m, c, s, h):
                    return TOO_SMALL
                if c.counts[PRESCRIBED]:
                    drive_powers(m, c, s.drives)
        change = larger(_improve(m, c, s, h), turned)
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
def _error(m, c, s, h):
    """Error of the step in errors allowed, of all displacements: S^-1 M d of the defect d."""
    apart()
    n, nodes, d = m.counts[SPEEDS], s.table.nodes, s.real.given
    w_0, w_1, w_2 = basis(nodes, 0.0, 0), basis(nodes, 0.0, 1), basis(nodes, 0.0, 2)
    for k in range(n):
        d[k] = 0.0
    for e in range(c.counts[INDEPENDENT]):
        k = c.independent[e]
        d[k] = w_0 * s.A[k] + w_1 * s.A[n + k] + w_2 * s.A[2 * n + k] - s.du[k]
    if c.counts[KEPT_ROWS]:
        tie(m, c, d, 1)
    _solve(m, s.real, h * s.table.real[0])
    error = 1e-12
    for k in range(n):
        if s.real.tree.free[k] != 0:
            error = larger(error, 0.5 * h * h * abs(d[k]) / s.scale[k])
    return error


@njit(**OPTIONS)
def _keep(m, c, s, h, end, row):
    """Store a step in its row, before it is taken."""
    apart()
    n, u, a_1, A, D = m.counts[COORDINATES], m.counts[SPEEDS], s.table.a_1, s.A, s.D
    for e in range(c.counts[INDEPENDENT]):  # of what the last iteration made of the stages
        of = c.independent[e]
        if s.coordinate[of] >= 0:
            for i in range(3):
                rate = a_1[3 * i] * A[of] + a_1[3 * i + 1] * A[u + of] + a_1[3 * i + 2] * A[2 * u + of]
                D[n * i + s.coordinate[of]] = s.u[of] + h * rate
    row[0], row[1], at = s.t[0], end, 4
    for i in range(n):
        row[at + i] = s.q[i]
    for i in range(u):
        row[at + n + i] = s.u[i]
    for j in range(3):
        at += n + u
        for i in range(n):
            row[at + i] = D[n * j + i]
        for i in range(u):
            row[at + n + i] = A[u * j + i]


@njit(**OPTIONS)
def _finish(m, c, s, h, end):
    """Take the step, whose last stage is its end; returns the outcome there."""
    apart()
    b_1 = s.table.b_1
    _stand(m, c, s, h, 1.0, b_1, s.table.b_2)
    outcome = stand(m, c, end)
    if outcome != DONE:
        return outcome
    for n in range(m.counts[NODES]):
        if m.nodes[n, KIND] == BALL:
            at = m.nodes[n, COORDINATE]
            size = math.sqrt(m.q[at] ** 2 + m.q[at + 1] ** 2 + m.q[at + 2] ** 2 + m.q[at + 3] ** 2)
            for i in range(4):
                m.q[at + i] /= size
    for i in range(2):
        s.works[i] += h * (b_1[0] * s.powers[i] + b_1[1] * s.powers[2 + i] + b_1[2] * s.powers[4 + i])
    for n in range(m.counts[COORDINATES]):
        s.q[n] = m.q[n]
    for n in range(m.counts[SPEEDS]):
        s.u[n], s.du[n] = m.u[n], m.du[n]
    for e in range(c.counts[INDEPENDENT]):
        n = c.independent[e]
        s.du[n] = s.A[2 * m.counts[SPEEDS] + n]
    s.t[0] = end
    return DONE


@njit(**OPTIONS)
def largest_share(m, c):
    """Largest entry of the basis, in the measures of the speeds."""
    apart()
    largest, n = 0.0, m.counts[SPEEDS]
    speed_basis(m, c)
    for e in range(c.counts[INDEPENDENT]):
        for k in range(n):
            share = abs(c.basis[n * e + k]) * c.measure[c.independent[e]]
            largest = larger(largest, share / c.measure[k])
    return largest


@njit(**OPTIONS)
def collocate(m, c, s, times, count, out, most, width):
    """Take steps, each stored in a row of ``out``, until these are ``most``, or to the last of the ``count`` times [s],
    which all end a step; returns their number. ``control`` has the outcome of the last one."""
    apart()
    control, taken, failed = s.control, 0, TOO_SMALL
    control[OUTCOME] = DONE
    while taken < most and int(control[ROW]) < count:
        t, aim, row = s.t[0], times[int(control[ROW])], after(out, width * taken)
        control[WANTED] = smaller(control[WANTED], control[LONGEST])
        if control[WANTED] < _LEAST * times[count - 1]:
            control[OUTCOME] = failed
            return taken
        left = aim - t
        h = left / math.ceil(left / control[WANTED] * (1.0 - 1e-9))
        reaches = h >= left * (1.0 - 1e-9)
        end = aim if reaches else t + h
        h = end - t
        _first_guess(m, c, s, h)
        outcome = _iterate(m, c, s, h)
        if outcome != DONE:
            failed, control[WANTED], control[LENGTH] = outcome, 0.4 * h, 0.0
            continue
        error = _error(m, c, s, h)
        growth = smaller(3.0, larger(0.2, 0.9 * error ** (-0.2)))
        if not error <= 1.0:
            control[WANTED], control[LENGTH], failed = h * smaller(growth, 0.9), 0.0, TOO_SMALL
            continue
        _keep(m, c, s, h, end, row)
        outcome = _finish(m, c, s, h, end)
        if outcome != DONE:
            failed, control[WANTED], control[LENGTH] = outcome, 0.4 * h, 0.0
            continue
        row[2], row[3] = s.works[0], s.works[1]
        control[WANTED] = larger(control[WANTED], h * growth) if growth >= 1.0 else h * growth
        control[LENGTH] = h
        taken += 1
        if reaches:
            control[ROW] += 1.0
        if c.counts[KEPT_ROWS] and largest_share(m, c) > control[GROWTH]:
            control[OUTCOME] = GROWN
            return taken
    return taken
