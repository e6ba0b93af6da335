"""Compiled records of instants: motion of the bodies, joint forces, energies and powers; loops along a path."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.model.codes import FAR
from kaneflex.multibody.dynamics import powers
from kaneflex.multibody.unilateral.active_set import stand_closed
from kaneflex.multibody.unilateral.frictions import friction_of, record
from kaneflex.multibody.unilateral.rows import at, contacts, rigid, row_at
from kaneflex.multibody.compile.values import after, by_size, copy, row_length
from kaneflex.multibody.dynamics.algebra import axpy, force_at, minus, plus, scaled
from kaneflex.multibody.dynamics.arrays import JOINTS, OWN
from kaneflex.multibody.dynamics.arrays import KEPT as KEPT_NUMBERS
from kaneflex.multibody.dynamics.axes import to_global
from kaneflex.multibody.dynamics.courses import courses, prescribe
from kaneflex.multibody.dynamics.independent_speeds import is_dependent
from kaneflex.multibody.dynamics.loop_closure import follow, project_now, stand
from kaneflex.multibody.dynamics.loop_condition import orientation, outgrown
from kaneflex.multibody.dynamics.wrenches import row_wrench
from kaneflex.multibody.time.state_record import give, row_size, take
from kaneflex.multibody.compile.types import ENTRY, OPTIONS, apart, kernel, shifted
from kaneflex.multibody.model.layout import (
    ACCEL, COORDINATES, COURSE, COURSES, DEPENDENT, EXTENT, JOINT_ROWS, KEPT, MAGNITUDES, MEASURE, MODE, OPEN, RATE,
    SHUT, TOUCH, Y,
)  # fmt: skip
from kaneflex.multibody.model.tree_layout import CARRIER, FIRST_ROW, KIND, LAST_NODE, LAST_ROW, SIDE, SLIDE, SPEED
from kaneflex.multibody.dynamics.cut_rows import cut_rows
from kaneflex.multibody.dynamics.inverse_dynamics import demand


_OPENED = 1e-6
"""Largest opening of a redundantly constrained joint, in rad or sizes of the mechanism."""


@njit(**ENTRY)
def unfold(m, rows, count, out):
    """Records, see :class:`kaneflex.multibody.dynamics.arrays.Instants`, of rows of the integration that close the
    loops."""
    for k in range(count):
        row = shifted(rows, k * row_size(m))
        take(m, row)
        give_coordinates(m)
        stand(m, row[0])
        demand(m, row[0])
        powers.powers(m)
        complete(m)
        copy(m.kept, after(out, m.counts[KEPT_NUMBERS] * k), m.counts[KEPT_NUMBERS])


@njit(**OPTIONS)
def give_coordinates(m):
    """Set the coordinates q of all nodes but balls to those of their speeds."""
    for n in range(m.counts[OWN]):
        m.q[m.own[n, 0]] = m.y[m.own[n, 1]]


@njit(**OPTIONS)
def complete(m):
    """Complete a record after :func:`demand`: forces along the speeds and of joints, energies, results of rows."""
    apart()
    copy(m.h, m.along, m.plan[COORDINATES])
    exert(m)
    powers.energies(m)
    record(m)


@njit(**OPTIONS)
def exert(m):
    """Forces and moments that the joints exert, from the wrenches of the nodes and the reactions of the cuts."""
    apart()
    for n in range(m.counts[JOINTS]):
        m.exerted[n] = _exerted(m, n)


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
    if plan[KEPT] == plan[JOINT_ROWS]:
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
        for r in range(plan[KEPT]):
            row[1 + plan[plan[DEPENDENT] + r]] = before[1 + plan[plan[DEPENDENT] + r]]
        take(m, row)
        for j in range(width):
            w[plan[COURSE] + 3 * courses(m) - width + j] = given[width * k + j]
        prescribe(m, row[0])
        if (k - last <= 1 or _near(m, before)) and follow(m, row[0]) and _stays(m, side):
            last = k
        else:
            for r in range(plan[KEPT]):
                i = plan[plan[DEPENDENT] + r]
                w[plan[Y] + i] = w[plan[RATE] + i] = w[plan[ACCEL] + i] = math.nan
        give(m, row[0], row)
        if last == k and plan[KEPT] < plan[JOINT_ROWS] and outgrown(m):
            return k + 1
    return count


@njit(**ENTRY)
def states(m, rows, count, first, held):
    """Close the loops of rows from the ``first`` one on, and compute their accelerations and reactions.

    ``held``: some coordinates have a large virtual inertia. Returns the row that is singular, or whose resting contacts
    differ from those of the dependent coordinates, or their number.
    """
    for row in range(first, count):
        out = shifted(rows, row * row_size(m))
        take(m, out)
        for n in range(contacts(m)):
            if rigid(m, n) and (m.w[at(m, n) + MODE] != OPEN) != (m.w[at(m, n) + SHUT] != 0.0):
                return row
        done = project_now(m, out[0], m.real, 1 if held else 2)
        if not (done and (held or stand_closed(m, out[0], m.real))):
            return row
        give(m, out[0], out)
    return count


@njit(**OPTIONS)
def _exerted(m, joint):
    """Force of a joint of the tree on its second body, by the joint's rows, then along its coordinate; zero of others.

    If the outer body is the first one, its normal force has the guide's arm besides.
    """
    n = m.joints[joint, LAST_NODE]
    if n < 0:
        return 0.0, 0.0, 0.0
    x, z, turn = force_at(m.wrenches[n], minus(m.r[n], m.P[n]))
    sign = float(m.joints[joint, SIDE])
    if m.nodes[n, KIND] != SLIDE:
        return sign * x, sign * z, sign * turn
    d_x, d_y, _ = m.S[m.nodes[n, SPEED]]
    normal, along = d_x * z - d_y * x, d_x * x + d_y * z
    if sign < 0.0:  # with exchanged sides the direction is reversed: n . F and d . F keep their signs
        turn = -turn - normal * m.y[m.nodes[n, SPEED]]
    return normal, turn, along


@njit(**OPTIONS)
def _exerted_in_space(m, joint):
    """Force and moment of a joint on its second body at its second point."""
    n, on, wrench = m.joints[joint, LAST_NODE], m.joints[joint, CARRIER], (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    first_row, last_row = m.joints[joint, FIRST_ROW], m.joints[joint, LAST_ROW]
    if n >= 0:
        place = m.points[joint]
        if on >= 0:
            place = plus(m.r[on], to_global(m, on, place))
        wrench = force_at(scaled(float(m.joints[joint, SIDE]), m.wrenches[n]), minus(m.r[n], place))
    for r in range(first_row, last_row):
        wrench = axpy(m.multipliers[r], row_wrench(m, r, 1), wrench)
    n = friction_of(m, first_row) if first_row < last_row else 0
    return wrench if n == 0 else axpy(m.multipliers[row_at(m, n)], row_wrench(m, row_at(m, n), 1), wrench)


_exerted = by_size(_exerted, _exerted_in_space)
