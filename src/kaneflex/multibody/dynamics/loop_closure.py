"""Loop closure: cut joints closed by dependent coordinates, and their reactions in a tree's linear equations.

Every cut joint's rows are constraints between two sections. As many coordinates as independent rows are dependent: the
motion is integrated in the independent ones only, and the loops are closed in position, speed and acceleration on the
deformed bodies.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.unilateral import factors, frictions, relative_rows, rows
from kaneflex.multibody.dynamics.interactions import gradient
from kaneflex.multibody.dynamics.loop_factors import factorise_closed, solve_closed
from kaneflex.support.inner import once
from kaneflex.multibody.compile.values import copy, row_length
from kaneflex.multibody.compile.stand_ins import if_modes
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, shifted
from kaneflex.multibody.model.layout import (
    BENDS, CHANGE_POINT, COLUMNS, COORDINATES, CROSSING, DEPENDENT, GRADIENT, KEPT, LED, LOOP, LOOP_PIVOTS, MEASURE,
    PASSING, PIVOTS, REACH, REACTION, ROW_OF, SIDE, WHEN, YIELDING,
)  # fmt: skip
from kaneflex.multibody.dynamics.courses import prescribe
from kaneflex.multibody.dynamics.cut_rows import cut_rows
from kaneflex.multibody.dynamics.deformation import deform
from kaneflex.multibody.dynamics.inverse_dynamics import demand
from kaneflex.multibody.dynamics.kinematics import accelerate, move, place
from kaneflex.multibody.dynamics.tree import assemble

CLOSED = 1e-10
"""Correction of a dependent coordinate, in rad or sizes of the mechanism, at which iteration ends."""
EXACT = 1e-12
"""The same near a change point, where rates and accelerations are far less accurate than positions."""
ENOUGH = 4
"""Iterations after which a correction of the size of rounding errors is accepted."""
SIDES = 6
"""Number of evenly spaced positions on either side of a change point for interpolation."""
NEAR = 1e-6
"""Sufficient correction in a stage: the next one would be its square, and the gradients, with an error as large,
correct rates that are nearly known."""


@njit(**OPTIONS)
def gradients(m, bends, across):
    """Derivatives of the kept rows at the current state, those by shapes only if requested, and factors of those by
    dependent coordinates, of their transpose if ``across``; False: singular."""
    no_inline()
    plan, w = m.plan, m.w
    count, n = plan[KEPT], plan[COORDINATES]
    for r in range(count):
        at = plan[GRADIENT] + n * r
        for i in range(n):
            w[at + i] = 0.0
        gradient(m, plan[plan[ROW_OF] + r], bends, at)
        for k in range(count):
            w[plan[LOOP] + (count * k + r if across else count * r + k)] = w[at + plan[plan[DEPENDENT] + k]]
    return dense_lu.factorise(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS])


@njit(**OPTIONS)
def solve_loops(m):
    """Solve with the factors of :func:`gradients`, in place: the right-hand side is at SIDE."""
    plan = m.plan
    dense_lu.substitute(m.w, plan[LOOP], plan[KEPT], m.pivots, plan[LOOP_PIVOTS], plan[SIDE])


@njit(**OPTIONS)
def move_dependent(m, i):
    """Motions of the dependent coordinates for a negative unit of a coordinate, at SIDE."""
    for r in range(m.plan[KEPT]):
        m.w[m.plan[SIDE] + r] = m.J[m.plan[COORDINATES] * r + i]
    solve_loops(m)


@njit(**OPTIONS)
def close(m, near):
    """Close the loops by the dependent coordinates (Newton's method); False if they don't close.

    ``near``: correction at which iteration ends, at least CLOSED. If negative, positions are made accurate to rounding:
    iteration ends below EXACT.
    """
    no_inline()
    plan, w = m.plan, m.w
    count, before = plan[KEPT], math.inf
    deform(m)
    place(m, 0)
    for turn in range(20 if count else 0):
        cut_rows(m)
        if not gradients(m, plan[BENDS] != 0, False):
            return False
        for r in range(count):
            w[plan[SIDE] + r] = -m.rows[row_length(m) * plan[plan[ROW_OF] + r]]
        solve_loops(m)
        size = 0.0
        for k in range(count):
            i = plan[plan[DEPENDENT] + k]
            m.y[i] += w[plan[SIDE] + k]
            size = larger(size, abs(w[plan[SIDE] + k]) / w[plan[MEASURE] + i])
        if size < (EXACT if near < 0.0 and turn <= ENOUGH else CLOSED):
            return True
        if not size < 1e3 or (turn > 8 and size > before):
            return False
        before = size
        if plan[BENDS]:
            deform(m)
        place(m, plan[LED])
        if size < near:
            return True
    return count == 0


@njit(**OPTIONS)
def follow(m, t):
    """Kinematics from the independent coordinates, dependent ones included; False: a loop does not close."""
    if not is_near_change_point(m, t):  # there rates select the branch
        for k in range(m.plan[KEPT]):
            i = m.plan[m.plan[DEPENDENT] + k]
            m.u[i] = m.du[i] = 0.0
    return follow_on(m, t, 0.0)


@njit(**OPTIONS)
def follow_on(m, t, near):
    """The same with nearly known rates and accelerations of dependent coordinates; ``near``: see :func:`close`."""
    prescribe(m, t)
    if is_near_change_point(m, t):
        return _follow_across(m, t)
    return _follow_here(m, -1.0 if m.pivots[PASSING] else near)


@njit(**OPTIONS)
def is_near_change_point(m, t):
    """True if the loops are nearly singular at t [s], as at a change point."""
    w, shared = m.w, m.plan[CROSSING]
    return abs(t - w[shared + WHEN]) < w[shared + REACH]


@njit(**OPTIONS)
def _follow_here(m, near):
    """The same with prescribed coordinates already set."""
    no_inline()
    plan, w = m.plan, m.w
    if not close(m, near):
        return False
    count = plan[KEPT]
    for rate in range(1, 3):
        rates = m.u if rate == 1 else m.du
        for turn in range(2 if count else 1):
            if rate == 1:
                move(m, turn * plan[LED])
            else:
                accelerate(m, turn * plan[LED])
            if turn == 0 and count:
                cut_rows(m)
                for r in range(count):
                    w[plan[SIDE] + r] = -m.rows[row_length(m) * plan[plan[ROW_OF] + r] + rate]
                solve_loops(m)
                for k in range(count):
                    rates[plan[plan[DEPENDENT] + k]] += w[plan[SIDE] + k]
    return True


@njit(**OPTIONS)
def _follow_across(m, t):
    """The same close to a change point, where the loops' equations are singular but the motion is smooth.

    Dependent coordinates, rates, accelerations and derivatives are interpolated (Lagrange) between regular positions on
    either side, along the direction of the rates.
    """
    no_inline()
    plan, w = m.plan, m.w
    n, count, kept, reach = plan[COORDINATES], plan[KEPT], plan[CROSSING] + CHANGE_POINT, w[plan[CROSSING] + REACH]
    sums, here = kept + 3 * n, (t - w[plan[CROSSING] + WHEN]) / reach
    copy(m.y, shifted(w, kept), n)
    copy(m.u, shifted(w, kept + n), n)
    copy(m.du, shifted(w, kept + 2 * n), n)
    for k in range((3 + n) * count):
        w[sums + k] = 0.0
    for k in range(-SIDES, SIDES + 1):
        if k == 0:
            continue
        weight = 1.0
        for j in range(-SIDES, SIDES + 1):
            if j != k and j != 0:
                weight *= (here - j) / (k - j)
        shift = reach * (k - here)
        for i in range(n):
            m.y[i] = w[kept + i] + shift * w[kept + n + i]
        copy(shifted(w, kept + n), m.u, n)
        copy(shifted(w, kept + 2 * n), m.du, n)
        if not _follow_here(m, -1.0):
            return False
        _add_dependent(m, sums, weight)
    copy(shifted(w, kept), m.y, n)
    copy(shifted(w, kept + n), m.u, n)
    copy(shifted(w, kept + 2 * n), m.du, n)
    for r in range(count):
        i = plan[plan[DEPENDENT] + r]
        m.y[i], m.u[i] = w[sums + 3 * r], w[sums + 3 * r + 1]
        m.du[i] = w[sums + 3 * r + 2]
    deform(m)
    place(m, 0)
    move(m, 0)
    accelerate(m, 0)
    cut_rows(m)
    return True


@njit(**OPTIONS)
def _add_dependent(m, sums, weight):
    """Add positions, rates and accelerations of dependent coordinates, and their derivatives by all coordinates."""
    no_inline()
    plan, w = m.plan, m.w
    n, count = plan[COORDINATES], plan[KEPT]
    for r in range(count):
        i = plan[plan[DEPENDENT] + r]
        w[sums + 3 * r] += weight * m.y[i]
        w[sums + 3 * r + 1] += weight * m.u[i]
        w[sums + 3 * r + 2] += weight * m.du[i]
    for i in range(n):
        move_dependent(m, i)
        for r in range(count):
            w[sums + 3 * count + n * r + i] -= weight * w[plan[SIDE] + r]


@njit(**OPTIONS)
def reduce_across(m):
    """Reduce the residual to independent coordinates by the dependent ones' derivatives near a change point, without
    reactions."""
    no_inline()
    plan, w = m.plan, m.w
    n, count = plan[COORDINATES], plan[KEPT]
    derivatives = plan[CROSSING] + CHANGE_POINT + 3 * n + 3 * count
    for r in range(count):
        asked = m.h[plan[plan[DEPENDENT] + r]]
        for i in range(n):
            m.h[i] += asked * w[derivatives + n * r + i]


@njit(**OPTIONS)
def move_closed(m, t):
    """Kinematics from all coordinates, which close the loops already."""
    no_inline()
    prescribe(m, t)
    deform(m)
    place(m, 0)
    move(m, 0)
    accelerate(m, 0)
    cut_rows(m)


@if_modes(None)
@njit(**OPTIONS)
def rows_of_frictions(m):
    """Rows of the contacts and frictions at the current state."""
    no_inline()
    for n in range(rows.contacts(m)):
        if not rows.is_switch(m, n):
            relative_rows.fill_contact(m, n)
    for n in range(-rows.frictions(m), 0):
        frictions.fill_friction(m, n)


@once
@njit(**OPTIONS)
def factorise_now(m, A):
    """Factors of the mass matrix at the current state, with the rows that hold there; False: singular."""
    rows_of_frictions(m)
    assemble(m)
    factors.use_rows_now(m)
    return factorise_closed(m, 0.0, A, m.plan[PIVOTS])


@once
@njit(**OPTIONS)
def correct_accelerations(m, t, A, turns):
    """Correct accelerations and reactions at the current state in ``turns`` iterations; False: singular."""
    no_inline()
    plan = m.plan
    if not factorise_now(m, A):
        return False
    answer = plan[COLUMNS] + plan[KEPT] * plan[COORDINATES]
    for _ in range(turns):
        demand(m, t)
        for k in range(plan[COORDINATES]):
            A[answer + k] = -m.h[k]
        factors.prescribe_now(m, A)
        solve_closed(m, A, plan[PIVOTS])
        for r in range(plan[KEPT] + m.pivots[YIELDING]):
            row = factors.reaction_of(m, r)
            if row >= 0:
                m.multipliers[row] += A[plan[REACTION] + r]
        for i in range(plan[COORDINATES]):
            m.du[i] += A[answer + i]
        if not follow(m, t):
            return False
    return True
