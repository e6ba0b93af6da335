"""Compiled motion of the bodies from coordinates of the tree, with energies and joint forces; loops along a path."""

from __future__ import annotations

import math

from numba import njit
from numba.types import boolean, int64, void

from kaneflex.multibody.dynamics import powers
from kaneflex.multibody.unilateral.active_set import stand_closed
from kaneflex.multibody.unilateral.rows import RESULTS, at, contacts, frictions, results, rigid
from kaneflex.multibody.compile.values import after, row_length
from kaneflex.multibody.dynamics.algebra import force_at, minus, store
from kaneflex.multibody.dynamics.courses import courses, prescribe
from kaneflex.multibody.dynamics.independent_speeds import is_dependent
from kaneflex.multibody.dynamics.loop_closure import follow, project_now, stand
from kaneflex.multibody.dynamics.loop_condition import orientation, outgrown
from kaneflex.multibody.time.state_record import give, row_size, take
from kaneflex.multibody.model.layout import (
    ACCEL, BODIES, COORDINATES, COURSE, COURSES, DEPENDENT, ENTRY, EXTENT, JOINT_ROWS, KEPT, MAGNITUDES, MEASURE,
    MECHANISM, MODAL, MODE, N, NOW, OPEN, OPTIONS, POWER, RATE, REACTIONS, SHAPES, SHUT, SUMS, TOUCH, WORKS, Y, apart,
    kernel, shifted,
)  # fmt: skip
from kaneflex.multibody.model.tree_layout import JOINT_NODE, KIND, SIGN, SLIDE, SPEED
from kaneflex.multibody.dynamics.cut_rows import cut_rows
from kaneflex.multibody.dynamics.inverse_dynamics import demand


FAR = 0.1
"""Largest step of a drive [rad, or sizes of the mechanism] over which Newton's method closes a loop."""
_OPENED = 1e-6
"""Largest opening of a redundantly constrained joint, in rad or sizes of the mechanism."""


@njit(**ENTRY)
def unfold(m, rows, count, q, v, a, exerted, sums, rates):
    """Motion of the bodies at every row (t, coordinates, rates, accelerations, reactions of the cuts), with forces,
    energies and powers.

    exerted: of every body three numbers of its inboard joint, in the order of the joint's rows with a drive last, then
    the reactions of cuts and frictions, on the joint's second body; then ``rows.results``. sums: kinetic energy, strain
    energy, dissipated power, potential energy of the weight. rates: powers of dissipation, loads, drives, frictions,
    contacts. The rows close the loops.
    """
    plan, w = m.plan, m.w
    k = 0
    for row in range(count):
        here = shifted(rows, row * row_size(m))
        take(m, here)
        stand(m, here[0])
        demand(m, here[0])
        powers.powers(m)
        powers.energies(m)
        touching = RESULTS * (contacts(m) + frictions(m))
        out = shifted(exerted, row * (3 * plan[BODIES] + plan[REACTIONS] + touching))
        for b in range(plan[BODIES]):
            n, i, size = m.frames[b, 0], m.bodies[b, MODAL], m.bodies[b, SHAPES]
            store(after(q, k), m.r[n])
            store(after(v, k), m.twist[n])
            store(after(a, k), m.rate[n])
            for j in range(size):
                q[k + 3 + j], v[k + 3 + j] = w[plan[Y] + i + j], w[plan[RATE] + i + j]
                a[k + 3 + j] = w[plan[ACCEL] + i + j]
            k += 3 + size
            store(after(out, 3 * b), _exerted(m, b))
        for r in range(plan[REACTIONS]):
            out[3 * plan[BODIES] + r] = w[plan[NOW] + r]
        results(m, shifted(out, 3 * plan[BODIES] + plan[REACTIONS]))
        for j in range(4):
            sums[4 * row + j] = w[plan[SUMS] + j]
        for j in range(plan[WORKS]):
            rates[plan[WORKS] * row + j] = w[plan[POWER] + j]


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
def _exerted(m, b):
    """Force of a body's inboard joint on the joint's second body, by the joint's rows, then along its coordinate.

    If the body is the first one, its normal force has the guide's arm besides.
    """
    n = m.frames[b, JOINT_NODE]
    x, z, turn = force_at(m.wrenches[n], minus(m.r[n], m.P[n]))
    sign = float(m.frames[b, SIGN])
    if m.nodes[n, KIND] != SLIDE:
        return sign * x, sign * z, sign * turn
    d_x, d_y, _ = m.S[m.nodes[n, SPEED]]
    normal, along = d_x * z - d_y * x, d_x * x + d_y * z
    if sign < 0.0:  # with exchanged sides the direction is reversed: n . F and d . F keep their signs
        turn = -turn - normal * m.y[m.nodes[n, SPEED]]
    return normal, turn, along


ENTRIES = {
    unfold: void(MECHANISM, N, int64, N, N, N, N, N, N),
    courses_at: void(MECHANISM, N, int64, N, int64),
    magnitudes_at: void(MECHANISM, N, int64, N, int64, N, int64),
    follow_rows: int64(MECHANISM, N, int64, int64, N, int64, N),
    states: int64(MECHANISM, N, int64, int64, boolean),
}
"""Signatures of the functions that Python calls."""
