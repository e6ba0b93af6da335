"""Compiled entries for Python: states at an instant, and records of rows of them.

Results of an instant are in :class:`kaneflex.multibody.dynamics.arrays.Work`; its first numbers are its record.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.stand_ins import of_changes
from kaneflex.multibody.compile.types import ENTRY, OPTIONS, apart, kernel, larger, shifted
from kaneflex.multibody.compile.values import after, copy, row_length
from kaneflex.multibody.dynamics import loop_closure, reduction
from kaneflex.multibody.dynamics.arrays import BALLS, KEPT, OWN
from kaneflex.multibody.dynamics.arrays import COORDINATES as ALL_COORDINATES
from kaneflex.multibody.dynamics.courses import courses, prescribe
from kaneflex.multibody.dynamics.cut_rows import cut_rows
from kaneflex.multibody.dynamics.independent_speeds import is_dependent, open_rows
from kaneflex.multibody.dynamics.inverse_dynamics import demand, mass_matrix
from kaneflex.multibody.dynamics.loop_closure import follow as close_all
from kaneflex.multibody.dynamics.loop_closure import mend, stand
from kaneflex.multibody.dynamics.loop_condition import orientation, outgrown
from kaneflex.multibody.dynamics.records import give_coordinates, keep
from kaneflex.multibody.dynamics.reduction import settled
from kaneflex.multibody.dynamics.rotation_vectors import compose, rebase
from kaneflex.multibody.dynamics.tree import use
from kaneflex.multibody.model.codes import APART, DONE, FAR, GROWN, INFINITE, MASSLESS, UNCLOSED, UNDECIDED
from kaneflex.multibody.model.layout import (
    ACCEL, COORDINATES, COURSE, COURSES, DEPENDENT, EXTENT, JOINT_ROWS, MAGNITUDES, MEASURE, NOW, PASSING,
    PRESCRIBED, RATE, REACTIONS, RIGID, TOUCH, Y,
)  # fmt: skip
from kaneflex.multibody.model.layout import KEPT as KEPT_ROWS
from kaneflex.multibody.time.state_record import give, row_size, take
from kaneflex.multibody.unilateral import stick_slip
from kaneflex.multibody.unilateral.active_set import choose_sides, stand_closed
from kaneflex.multibody.unilateral.rows import frictions

CLOSED = 1e-7
"""Largest violation of redundant rows, in rad or sizes of the mechanism."""
_OPENED = 1e-6
"""The same along a path of rigid bodies."""
_FAR = 0.05
"""Largest step of a prescribed drive [rad or sizes of the mechanism] in following loops."""
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
    reduction.stand_at(m, q)
    open_rows(m)


@njit(**ENTRY)
def close(m, q):
    """Close the loops by the dependent coordinates; False if they don't."""
    reduction.stand_at(m, q)
    closes = False
    for _ in range(_TRIES):
        closes = closes or loop_closure.close(m, 0.0)
        rebase(m)
    give_coordinates(m)
    return closes


@njit(**OPTIONS)
def _stand(m, t):
    """Close the loops and complete speeds and accelerations from the independent ones; returns the outcome."""
    apart()
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
    apart()
    plan, w = m.plan, m.w
    n = plan[COORDINATES]
    for i in range(n):
        w[plan[ACCEL] + i] = 0.0
    for r in range(plan[REACTIONS]):
        w[plan[NOW] + r] = 0.0
    outcome = _stand(m, t)
    if outcome != DONE:
        return outcome
    demand(m, t)
    if not reduction.react(m):
        return UNCLOSED
    if m.now[2] != 0.0 or frictions(m):  # else drives prescribe everything: inertia does not matter
        use(m, 0)
        if not mend(m, t, m.real, 2 if plan[RIGID] else 1) or stick_slip.settle(m, t, m.real) == 1:
            return MASSLESS
    settled(m)
    give_coordinates(m)
    for i in range(n):
        if not abs(w[plan[ACCEL] + i]) < math.inf:
            return INFINITE
    return DONE


@of_changes(0)
@njit(**OPTIONS)
def _decide(m, t):
    """Project again, after :func:`_project`, if discontinuous loads are on other sides of their jumps, and find the
    modes of contacts and frictions; the outcome."""
    outcome = _project(m, t) if choose_sides(m, t) else DONE
    if outcome != DONE:
        return outcome
    if not stand_closed(m, t, m.real):
        return MASSLESS
    undecided = stick_slip.decide(m, t, m.real)
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
    reduction.stand_at(m, q)
    copy(u, m.u, m.plan[COORDINATES])
    outcome = _find(m, t)
    if outcome == DONE:
        keep(m, t, m.kept)
    return outcome


@njit(**ENTRY)
def unfold(m, rows, count, nearby, out):
    """Records of rows of the integration; returns their number, with the outcome of the last one in ``now``.

    ``nearby``: the rows are only near states, which are projected first; contacts, frictions and discontinuous loads
    keep their modes. Otherwise they close the loops.
    """
    m.now[1] = DONE
    for k in range(count):
        row = shifted(rows, k * row_size(m))
        m.now[0] = row[0]
        take(m, row)
        give_coordinates(m)
        if not nearby:
            stand(m, row[0])
        else:
            m.now[1] = _project(m, row[0])
            if m.now[1] != DONE:
                return k
        keep(m, row[0], after(out, m.counts[KEPT] * k))
    return count


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
def _far(m, t):
    """Least number of steps from the drives' current position to that at t."""
    apart()
    plan, w, farthest = m.plan, m.w, 0.0
    kernel(m.kernels, COURSES)(t, m.p, w, plan[COURSE])
    for k in range(courses(m)):
        i = plan[plan[PRESCRIBED] + k]
        farthest = larger(farthest, abs(w[plan[COURSE] + 3 * k] - w[plan[Y] + i]) / w[plan[MEASURE] + i])
    return math.ceil(farthest / _FAR)


@njit(**OPTIONS)
def _grown(m):
    """True if dependent speeds are large relative to the prescribed ones."""
    apart()
    plan, w, largest, driven = m.plan, m.w, 0.0, 0.0
    for s in range(plan[COORDINATES]):
        largest = larger(largest, abs(w[plan[RATE] + s]) / w[plan[MEASURE] + s])
    for k in range(courses(m)):
        s = plan[plan[PRESCRIBED] + k]
        driven = larger(driven, abs(w[plan[RATE] + s]) / w[plan[MEASURE] + s])
    return driven > 0.0 and largest > _GROWTH * driven


@njit(**ENTRY)
def follow(m, times, count, out):
    """Rows at ascending times from the current position, with loops followed step by step.

    Returns their number; ``now`` has the last instant and its outcome: GROWN is valid, but the next ones need another
    choice of speeds.
    """
    t, taken = m.now[0], 0
    m.now[1] = DONE
    for i in range(count):
        reached = t == times[i]
        while not reached:
            if taken == _AT_ONCE:
                return i
            steps = _far(m, times[i])
            reached = not steps > 1.0
            t = times[i] if reached else t + (times[i] - t) / steps
            taken += 1
            m.now[0], m.now[1] = t, _find(m, t)
            if m.now[1] == DONE and _grown(m):
                m.now[1] = GROWN
            if m.now[1] != DONE:
                return i
        keep(m, t, after(out, m.counts[KEPT] * i))
    return count


@njit(**OPTIONS)
def _near(m, row):
    """True if no coordinate with a given course is far from that of a row."""
    plan, w = m.plan, m.w
    for i in range(plan[COORDINATES]):
        if not is_dependent(m, i) and not abs(w[plan[Y] + i] - row[1 + i]) <= 2.0 * FAR * w[plan[MEASURE] + i]:
            return False
    return True


@njit(**OPTIONS)
def _stays(m, side):
    """True if the closed loops are on one side of dead centres, by the sign of their determinant, and redundant
    constraints are met."""
    plan, w = m.plan, m.w
    if plan[KEPT_ROWS] == plan[JOINT_ROWS]:
        now = orientation(m)
        if side[0] * now < 0.0:
            return False
        side[0] = now
        return True
    cut_rows(m)
    for row in range(plan[JOINT_ROWS]):
        if not abs(m.rows[row_length(m) * row]) <= _OPENED * w[plan[TOUCH] + EXTENT]:
            return False
    return True


@njit(**ENTRY)
def follow_rows(m, rows, first, count, given, width, side):
    """Close the loops of rows after the ``first`` one, which is closed, each from the last one that closes.

    Returns the number of rows done; if some are left, they need another choice of dependent coordinates.

    rows: all coordinates but the dependent ones are given, or prescribed at the row's time; in a row whose loops do not
    close the dependent ones become NaN. given: of every row coordinate, speed and acceleration of the last courses,
    which no law prescribes. side: see :func:`_stays`; 0 if unknown.
    """
    apart()
    plan, w, last = m.plan, m.w, first
    for k in range(first + 1, count):
        row, before = shifted(rows, k * row_size(m)), shifted(rows, last * row_size(m))
        for r in range(plan[KEPT_ROWS]):
            row[1 + plan[plan[DEPENDENT] + r]] = before[1 + plan[plan[DEPENDENT] + r]]
        take(m, row)
        for j in range(width):
            w[plan[COURSE] + 3 * courses(m) - width + j] = given[width * k + j]
        prescribe(m, row[0])
        if (k - last <= 1 or _near(m, before)) and close_all(m, row[0]) and _stays(m, side):
            last = k
        else:
            for r in range(plan[KEPT_ROWS]):
                i = plan[plan[DEPENDENT] + r]
                w[plan[Y] + i] = w[plan[RATE] + i] = w[plan[ACCEL] + i] = math.nan
        give(m, row[0], row)
        if last == k and plan[KEPT_ROWS] < plan[JOINT_ROWS] and outgrown(m):
            return k + 1
    return count
