"""Compiled entries for Python: states at an instant, and records of rows of them.

Results of an instant are in :class:`kaneflex.multibody.dynamics.arrays.Work`; its first numbers are its record.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.stand_ins import if_changes
from kaneflex.multibody.compile.types import ENTRY, OPTIONS, kernel, larger, no_inline, shifted
from kaneflex.multibody.compile.values import after, copy, row_length
from kaneflex.multibody.dynamics import loop_closure, reduction
from kaneflex.multibody.dynamics.arrays import BALLS, KEPT, OWN
from kaneflex.multibody.dynamics.arrays import COORDINATES as ALL_COORDINATES
from kaneflex.multibody.dynamics.change_points import fastest
from kaneflex.multibody.dynamics.courses import courses
from kaneflex.multibody.dynamics.independent_speeds import open_rows
from kaneflex.multibody.dynamics.inverse_dynamics import demand, mass_matrix
from kaneflex.multibody.dynamics.loop_closure import follow as close_all
from kaneflex.multibody.dynamics.loop_closure import correct_accelerations, gradients, move_closed
from kaneflex.multibody.dynamics.loop_condition import orientation, outgrown
from kaneflex.multibody.dynamics.records import give_coordinates, store_record
from kaneflex.multibody.dynamics.reduction import settled
from kaneflex.multibody.dynamics.rotation_vectors import compose, rebase
from kaneflex.multibody.dynamics.tree import use_geometry
from kaneflex.multibody.model.codes import (
    AHEAD, APART, DONE, FAR, GROWN, INFINITE, MASSLESS, NEAR_STATES, ON_LOOPS, UNCLOSED, UNDECIDED,
)  # fmt: skip
from kaneflex.multibody.model.layout import (
    ACCEL, BENDS, COORDINATES, COURSE, COURSES, CUT_ROWS, DEPENDENT, JOINT_ROWS, MAGNITUDES, MEASURE, NOW, PASSING,
    PRESCRIBED, REACTIONS, Y,
)  # fmt: skip
from kaneflex.multibody.model.layout import KEPT as KEPT_ROWS
from kaneflex.multibody.time.state_record import read_row, row_size
from kaneflex.multibody.unilateral.active_set import choose_contact_modes, choose_sides
from kaneflex.multibody.unilateral.chosen_motion import solve_choice
from kaneflex.multibody.unilateral.decision import decide
from kaneflex.multibody.unilateral.rows import frictions

CLOSED = 1e-7
"""Largest violation of redundant rows, in rad or sizes of the mechanism."""
_GROWTH = 30.0
"""Largest ratio of the other speeds to those of the drives before dependent speeds are chosen again."""
_AT_ONCE = 256
"""Steps per call of compiled code, after which the position is recorded."""
_TRIES = 3
"""Newton iterations to close loops from afar, each from the end of the one before."""


@njit(**ENTRY)
def courses_at(m, times, count, out, width):
    """Prescribed courses of drives at many times, in as many rows."""
    for k in range(count):
        kernel(m.kernels, COURSES)(times[k], m.p, out, width * k)


@njit(**ENTRY)
def magnitudes_at(m, times, count, x, columns, out, width):
    """Sizes of the loads, and arguments of their switches, at many times; x has as many rows of the joints' states."""
    for k in range(count):
        kernel(m.kernels, MAGNITUDES)(times[k], x, columns * k, m.p, out, width * k)


@njit(**ENTRY)
def place(m, q):
    """Positions, axes and directions, with the cuts' rows and their derivatives by all speeds at J."""
    reduction.set_coordinates(m, q)
    open_rows(m)


@njit(**ENTRY)
def close(m, q):
    """Close the loops by the dependent coordinates; False if they don't."""
    reduction.set_coordinates(m, q)
    closes = False
    for _ in range(_TRIES):
        closes = closes or loop_closure.close(m, 0.0)
        rebase(m)
    give_coordinates(m)
    return closes


@njit(**OPTIONS)
def _complete(m, t):
    """Close the loops and complete speeds and accelerations from the independent ones; returns the outcome."""
    no_inline()
    m.pivots[PASSING] = 1  # positions as exact as near change points, as readers take derivatives by differences
    if not close_all(m, t) or (settled(m) and not close_all(m, t)):
        return UNCLOSED
    if m.plan[KEPT_ROWS] < m.plan[JOINT_ROWS]:
        for row in range(m.plan[JOINT_ROWS]):
            if not abs(m.rows[row_length(m) * row]) <= CLOSED * m.row_measure[row]:
                return APART
    return DONE


@njit(**OPTIONS)
def _project(m, t):
    """The same with the accelerations of all coordinates and the reactions of the cuts."""
    no_inline()
    plan, w = m.plan, m.w
    n = plan[COORDINATES]
    for i in range(n):
        w[plan[ACCEL] + i] = 0.0
    for r in range(plan[REACTIONS]):
        w[plan[NOW] + r] = 0.0
    outcome = _complete(m, t)
    if outcome != DONE:
        return outcome
    demand(m, t)
    if not reduction.update_reactions(m):
        return UNCLOSED
    if m.now[2] != 0.0 or frictions(m):  # else drives prescribe everything: inertia does not matter
        use_geometry(m, 0)
        for r in range(plan[CUT_ROWS], plan[REACTIONS]):  # redundant contacts have their share, not zero
            m.multipliers[r] = 0.0
        turns = 2 if plan[REACTIONS] > plan[CUT_ROWS] else 1
        if not correct_accelerations(m, t, m.real, turns) or (frictions(m) and solve_choice(m, t, m.real) == 1):
            return MASSLESS
    settled(m)
    give_coordinates(m)
    for i in range(n):
        if not abs(w[plan[ACCEL] + i]) < math.inf:
            return INFINITE
    return DONE


@if_changes(0)
@njit(**OPTIONS)
def _decide(m, t):
    """Project again, after :func:`_project`, if discontinuous loads are on other sides of their jumps, and find the
    modes of contacts and frictions; the outcome."""
    outcome = _project(m, t) if choose_sides(m, t) else DONE
    if outcome != DONE:
        return outcome
    if not choose_contact_modes(m, t, m.real):
        return MASSLESS
    undecided = decide(m, t, m.real)
    return MASSLESS if undecided == 1 else UNDECIDED if undecided else DONE


@njit(**OPTIONS)
def _find(m, t):
    """Project, and find the modes of contacts and frictions, and the sides of loads; returns the outcome."""
    outcome = _project(m, t)
    return _decide(m, t) if outcome == DONE else outcome


@njit(**ENTRY)
def project(m, t, q, u):
    """State at t with accelerations and reactions, near coordinates q with speeds u; returns the outcome.

    Contacts whose sides overlap are closed.
    """
    reduction.set_coordinates(m, q)
    copy(u, m.u, m.plan[COORDINATES])
    outcome = _find(m, t)
    if outcome == DONE:
        store_record(m, t, m.kept)
    return outcome


@njit(**ENTRY)
def unfold(m, rows, count, near, out):
    """Records of rows of the integration; returns their number, with the outcome of the last one in ``now``.

    ``near``: ON_LOOPS: the rows close the loops. NEAR_STATES: they are projected first; contacts, frictions and
    discontinuous loads keep their modes. BESIDE and AHEAD: dependent coordinates and all their rates follow from the
    independent ones; where loops don't close, or violate redundant constraints, they are NaN.
    """
    m.now[1] = DONE
    for k in range(count):
        row = shifted(rows, k * row_size(m))
        m.now[0] = row[0]
        for r in range(m.plan[KEPT_ROWS] if near == AHEAD else 0):
            i = m.plan[m.plan[DEPENDENT] + r]
            row[1 + i] = m.y[i]
        read_row(m, row)
        give_coordinates(m)
        if near == NEAR_STATES:
            m.now[1] = _project(m, row[0])
            if m.now[1] != DONE:
                return k
        elif near != ON_LOOPS:
            _close_beside(m, row[0])
        else:
            move_closed(m, row[0])
        store_record(m, row[0], after(out, m.counts[KEPT] * k))
    return count


@njit(**OPTIONS)
def _close_beside(m, t):
    """Close the loops at the current independent coordinates, speeds and accelerations; else dependent ones are NaN."""
    if _complete(m, t) != DONE:
        for r in range(m.plan[KEPT_ROWS]):
            i = m.plan[m.plan[DEPENDENT] + r]
            m.y[i] = m.u[i] = m.du[i] = math.nan
        move_closed(m, t)
    give_coordinates(m)


@njit(**ENTRY)
def advance(m, steps, count, out):
    """Move rows of coordinates by rows of steps of the speeds: a ball turns by the rotation vector in its axes."""
    for i in range(count):
        q, step = after(out, m.counts[ALL_COORDINATES] * i), after(steps, m.plan[COORDINATES] * i)
        for n in range(m.counts[OWN]):
            q[m.own[n, 0]] += step[m.own[n, 1]]
        for n in range(m.counts[BALLS]):
            s = m.balls[n, 1]
            compose(q, m.balls[n, 0], step[s], step[s + 1], step[s + 2])


@njit(**ENTRY)
def mass(m, unit):
    """Mass matrix M of all speeds at the place of m; ``unit`` is zero before and after, one number a speed."""
    mass_matrix(m, unit)


@njit(**OPTIONS)
def _pace(m):
    """Largest speed of the drives, in their measures."""
    plan, fastest = m.plan, 0.0
    for k in range(courses(m)):
        i = plan[plan[PRESCRIBED] + k]
        if i >= 0:
            fastest = larger(fastest, abs(m.u[i]) / m.w[plan[MEASURE] + i])
    return fastest


@njit(**OPTIONS)
def _steps_to(m, t):
    """Least number of steps from the drives' current position to that at t; loops are followed in more than one."""
    no_inline()
    plan, w, farthest = m.plan, m.w, 0.0
    kernel(m.kernels, COURSES)(t, m.p, w, plan[COURSE])
    for k in range(courses(m) if plan[JOINT_ROWS] else 0):
        i = plan[plan[PRESCRIBED] + k]
        if i >= 0:  # in the plane drives at cuts only repeat what others prescribe
            farthest = larger(farthest, abs(w[plan[COURSE] + 3 * k] - w[plan[Y] + i]) / w[plan[MEASURE] + i])
    return math.ceil(farthest / FAR)


@njit(**OPTIONS)
def _grown(m):
    """True if dependent speeds are large relative to the prescribed ones, or a dropped row to the kept ones."""
    no_inline()
    plan, driven = m.plan, _pace(m)
    if plan[KEPT_ROWS] < plan[JOINT_ROWS] and gradients(m, plan[BENDS] != 0, False) and outgrown(m):
        return True
    return driven > 0.0 and fastest(m, -1) > _GROWTH * driven


@njit(**ENTRY)
def follow(m, times, count, out):
    """Rows at ascending times from the current position, with loops followed step by step.

    Returns their number; ``now`` has the last instant and its outcome: GROWN is valid, but the next ones need another
    choice of speeds. If drives prescribe everything, loops without redundant rows don't pass singular positions.
    """
    t, taken, side = m.now[0], 0, orientation(m)
    fixed = m.now[2] == 0.0 and m.plan[KEPT_ROWS] == m.plan[JOINT_ROWS]
    m.now[1] = DONE
    for i in range(count):
        reached = t == times[i]
        while not reached:
            if taken == _AT_ONCE:
                return i
            steps = _steps_to(m, times[i])
            reached = not steps > 1.0
            before, t = t, times[i] if reached else t + (times[i] - t) / steps
            straight = _pace(m) * (t - before) <= 2.0 * FAR  # else a drive turns back before the end
            for r in range(m.plan[KEPT_ROWS] if straight else 0):  # past a change point near the branch of the rates
                k = m.plan[m.plan[DEPENDENT] + r]
                m.y[k] += (t - before) * m.u[k]
            taken += 1
            m.now[0], m.now[1] = t, _find(m, t)
            if m.now[1] == DONE:
                passed = fixed and side * orientation(m) < 0.0
                m.now[1] = UNCLOSED if passed else GROWN if _grown(m) else DONE
            if m.now[1] != DONE:
                return i
        store_record(m, t, after(out, m.counts[KEPT] * i))
    return count
