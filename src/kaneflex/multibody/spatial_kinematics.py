"""Compiled kinematics of a tree of bodies in space, and of the cuts that close its loops.

Kane's method with generalised speeds: the tree's joint rates, and a ball's relative angular velocity in its own axes
(Kane & Levinson 1985, ch. 2). Positions, partial velocities, velocities and accelerations of all bodies, and the rows
of the cuts. Vectors are global unless said otherwise and refer to a body's origin.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody.spatial_tables import (
    AT,
    AXIS,
    AXIS_1,
    AXIS_2,
    BALL,
    COINCIDE,
    COORDINATE,
    COUNT,
    FIRST,
    KIND,
    PARENT,
    PERPENDICULAR,
    PLACE,
    ROTATION,
    ROW,
    SECOND,
    SHIFT,
    SLIDE,
    SPEED,
    STATION,
    TURN,
    WHAT,
)  # fmt: skip
from kaneflex.multibody.spatial_vectors import add_cross, less, times
from kaneflex.multibody.spatial_work import SECTION
from kaneflex.multibody.tables import OPTIONS, apart
from kaneflex.support.inner import once


@njit(**OPTIONS)
def _turn(kind, axis, q, k, R):
    """Axes R of a node after its rotation: by an angle about an axis, or by a ball's quaternion at q[k]."""
    apart()
    if kind == TURN:
        half = 0.5 * q[k]
        s = math.sin(half)
        w, x, y, z = math.cos(half), s * axis[AXIS], s * axis[AXIS + 1], s * axis[AXIS + 2]
        two = 2.0
    else:
        w, x, y, z = q[k], q[k + 1], q[k + 2], q[k + 3]
        two = 2.0 / (w * w + x * x + y * y + z * z)
    for i in range(3):
        a, b, c = R[i, 0], R[i, 1], R[i, 2]
        R[i, 0] = a * (1.0 - two * (y * y + z * z)) + b * two * (x * y + w * z) + c * two * (x * z - w * y)
        R[i, 1] = a * two * (x * y - w * z) + b * (1.0 - two * (x * x + z * z)) + c * two * (y * z + w * x)
        R[i, 2] = a * two * (x * z + w * y) + b * two * (y * z - w * x) + c * (1.0 - two * (x * x + y * y))


@njit(**OPTIONS)
def _beyond(m, n, of, what):
    """Angle theta or rate theta' of the section at a node whose axes follow their body's mean rotation: its shapes are
    the next node, whose coordinates (of q) or speeds (of u) begin at COORDINATE or SPEED. Zero for other nodes."""
    apart()
    found = 0.0
    for i in range(m.nodes[n, COUNT]):
        found += m.p[m.nodes[n, AT] + i] * of[m.nodes[n + 1, what] + i]
    return found


@njit(**OPTIONS)
def stands(m, n, q):
    """Coordinate of a joint by its node, including the section's rotation 2 atan(theta / 2)."""
    return q[m.nodes[n, COORDINATE]] + 2.0 * math.atan(0.5 * _beyond(m, n, q, COORDINATE))


@njit(**OPTIONS)
def goes(m, n, q, u):
    """Rate of that coordinate."""
    theta = _beyond(m, n, q, COORDINATE)
    return u[m.nodes[n, SPEED]] + _beyond(m, n, u, SPEED) / (1.0 + 0.25 * theta**2)


@njit(**OPTIONS)
def place(m, q, k):
    """Axes and origins of all nodes, then sections and axes."""
    apart()
    x = k.x
    for n in range(len(m.nodes)):
        kind, parent, numbers, R, P, r = m.nodes[n, KIND], m.nodes[n, PARENT], m.numbers[n], k.R[n], k.P[n], k.r[n]
        if parent >= 0:
            base = k.R[parent]
            for i in range(3):
                for j in range(3):
                    R[i, j] = 0.0
                    for l in range(3):
                        R[i, j] += base[i, l] * numbers[ROTATION + 3 * l + j]
            times(base, numbers, PLACE, P, 0)
            for i in range(3):
                P[i] += k.r[parent, i]
        else:
            for i in range(3):
                P[i] = numbers[PLACE + i]
                for j in range(3):
                    R[i, j] = numbers[ROTATION + 3 * i + j]
        if kind == SLIDE:
            times(R, numbers, AXIS, x, 0)
            for i in range(3):
                P[i] += x[i] * q[m.nodes[n, COORDINATE]]
        elif kind == TURN or kind == BALL:
            _turn(kind, numbers, q, m.nodes[n, COORDINATE], R)
        elif kind == STATION:
            _deform(m, n, k, q)
        times(R, numbers, SHIFT, x, 0)
        for i in range(3):
            r[i] = P[i] - x[i]
    for n in range(len(m.twists)):
        k.twists[n, 0] = stands(m, m.twists[n, 3], q)
    for n in range(len(m.axis_on)):
        _carried_to(k, m.axis_on[n], m.axes[n], k.axes[n])
    for n in range(len(m.on)):
        on = m.on[n]
        _carried_to(k, on, m.at[n], k.sections[n])
        for i in range(3):
            k.sections[n, i] += k.r[on, i] if on >= 0 else 0.0


@njit(**OPTIONS)
def _carried_to(k, on, vector, out):
    """A vector in a node's axes, or in the ground's, in global ones."""
    apart()
    if on >= 0:
        times(k.R[on], vector, 0, out, 0)
    else:
        for i in range(3):
            out[i] = vector[i]


@once
@njit(**OPTIONS)
def _shaped(m, n, q, i, x, at):
    """x[at] = N q and psi q of a station, coordinates from q[i]."""
    apart()
    count, o = m.nodes[n, COUNT], m.nodes[n, AT]
    for row in range(6):
        x[at + row] = 0.0
        for s in range(count):
            x[at + row] += m.p[o + count * row + s] * q[i + s]


@njit(**OPTIONS)
def _deform(m, n, k, q):
    """Displace and rotate a station by N q + 1/2 G q q, and by theta = psi q."""
    apart()
    x, first, base = k.x, m.nodes[n, COORDINATE], k.R[m.nodes[n, PARENT]]
    count, o = m.nodes[n, COUNT], m.nodes[n, AT]
    _shaped(m, n, q, first, x, 0)
    for row in range(3):
        at = o + count * (6 + count * row)
        for i in range(count):
            for j in range(count):
                x[row] += 0.5 * m.p[at + count * i + j] * q[first + i] * q[first + j]
    times(base, x, 0, x, 6)
    for i in range(3):
        k.P[n, i] += x[6 + i]
        k.turned[i], k.turned[3 + i] = x[3 + i], 0.0
    shape_laws.section(k.turned, 0, k.turned, 6)
    for i in range(3):
        for j in range(3):
            k.R[n, i, j] = 0.0
            for l in range(3):
                k.R[n, i, j] += base[i, l] * k.turned[6 + 3 * l + j]


@njit(**OPTIONS)
def _deformed_partials(m, n, k):
    """Partial velocities of a station by its body's shapes, as G is symmetric N_j + G_jk q_k and T psi_j."""
    apart()
    x, base, Jv, Jw = k.x, k.R[m.nodes[n, PARENT]], k.Jv[n], k.Jw[n]
    count, o, q, u = m.nodes[n, COUNT], m.nodes[n, AT], m.nodes[n, COORDINATE], m.nodes[n, SPEED]
    for i in range(3):
        k.turned[i] = k.turned[3 + i] = 0.0
        for s in range(count):
            k.turned[i] += m.p[o + count * (3 + i) + s] * k.q[q + s]
    shape_laws.section(k.turned, 0, k.turned, 6)
    for j in range(count):
        for i in range(3):
            x[6 + i], x[9 + i] = m.p[o + count * i + j], 0.0
            for l in range(3):
                x[9 + i] += k.turned[15 + 3 * i + l] * m.p[o + count * (3 + l) + j]
            for s in range(count):
                x[6 + i] += m.p[o + count * (6 + count * i + j) + s] * k.q[q + s]
        times(base, x, 6, Jv[u + j], 0)
        times(base, x, 9, Jw[u + j], 0)


@njit(**OPTIONS)
def _deformed_accelerations(m, n, u, du, k):
    """Add a station's motion relative to its body to a and e: 2 omega x d' + d'', omega x omega' and so on."""
    apart()
    x, parent, base = k.x, m.nodes[n, PARENT], k.R[m.nodes[n, PARENT]]
    q, s = m.nodes[n, COORDINATE], m.nodes[n, SPEED]
    count, o = m.nodes[n, COUNT], m.nodes[n, AT]
    _shaped(m, n, k.q, q, x, 15)
    _shaped(m, n, u, s, x, 21)
    _shaped(m, n, du, s, x, 27)
    for row in range(3):
        at = o + count * (6 + count * row)
        for i in range(count):
            for j in range(count):
                G = m.p[at + count * i + j]
                x[21 + row] += G * k.q[q + i] * u[s + j]
                x[27 + row] += G * (k.q[q + i] * du[s + j] + u[s + i] * u[s + j])
    for i in range(3):
        k.turned[i], k.turned[3 + i] = x[18 + i], x[24 + i]
    shape_laws.section(k.turned, 0, k.turned, 6)
    for i in range(3):
        x[36 + i], x[39 + i] = 0.0, k.turned[24 + i]
        for j in range(3):
            x[36 + i] += k.turned[15 + 3 * i + j] * x[24 + j]
            x[39 + i] += k.turned[15 + 3 * i + j] * x[30 + j]
    times(base, x, 21, x, 0)
    times(base, x, 27, x, 3)
    times(base, x, 36, x, 6)
    times(base, x, 39, x, 9)
    for i in range(3):
        k.a[n, i] += x[3 + i]
        k.e[n, i] += x[9 + i]
        x[i] *= 2.0
    add_cross(k.w[parent], 0, x, 0, k.a[n], 0)
    add_cross(k.w[parent], 0, x, 6, k.e[n], 0)


@njit(**OPTIONS)
def partials(m, k):
    """Partial velocities of all nodes (Kane & Levinson 1985, sec. 2.14) and J of the cuts, after ``place``."""
    apart()
    x = k.x
    for n in range(len(m.nodes)):
        kind, parent, u, Jv, Jw, R = m.nodes[n, KIND], m.nodes[n, PARENT], m.nodes[n, SPEED], k.Jv[n], k.Jw[n], k.R[n]
        for s in range(len(k.h)):
            for i in range(3):
                Jw[s, i] = k.Jw[parent, s, i] if parent >= 0 else 0.0
                Jv[s, i] = k.Jv[parent, s, i] if parent >= 0 else 0.0
        if parent >= 0:
            less(k.r[n], k.r[parent], x, 0)
            for s in range(u):
                add_cross(Jw[s], 0, x, 0, Jv[s], 0)
        less(k.r[n], k.P[n], x, 0)
        if kind == SLIDE:
            times(R, m.numbers[n], AXIS, Jv[u], 0)
        elif kind == TURN:
            times(R, m.numbers[n], AXIS, Jw[u], 0)
            add_cross(Jw[u], 0, x, 0, Jv[u], 0)
        elif kind == BALL:
            for j in range(3):
                for i in range(3):
                    Jw[u + j, i] = R[i, j]
                add_cross(Jw[u + j], 0, x, 0, Jv[u + j], 0)
        elif kind == STATION:
            _deformed_partials(m, n, k)
    rows(m, k)
    for c in range(len(m.cuts)):
        for j in range(m.cuts[c, ROW], m.cuts[c, ROW] + (3 if m.cuts[c, WHAT] == COINCIDE else 1)):
            for s in range(len(k.h)):
                k.J[j, s] = 0.0
            along(m, k, m.cuts[c, FIRST], k.rows[j], 3, k.J[j])
            along(m, k, m.cuts[c, SECOND], k.rows[j], 9, k.J[j])


@once
@njit(**OPTIONS)
def along(m, k, section, wrench, at, out):
    """Add the generalised forces of a force and a moment at a section along every speed."""
    apart()
    on, x = m.on[section], k.x
    if on < 0:
        return
    less(k.sections[section], k.r[on], x, 0)
    for i in range(3):
        x[3 + i] = wrench[at + 3 + i]
    add_cross(x, 0, wrench, at, x, 3)
    for s in range(len(out)):
        for i in range(3):
            out[s] += wrench[at + i] * k.Jv[on, s, i] + x[3 + i] * k.Jw[on, s, i]


@njit(**OPTIONS)
def rows(m, k):
    """Residuals of the cuts, their rates and Jacobians by the sections' twists."""
    apart()
    sections, axes, out = k.sections.reshape(-1), k.axes.reshape(-1), k.rows.reshape(-1)
    for c in range(len(m.cuts)):
        what, first, second, n = m.cuts[c, WHAT], m.cuts[c, FIRST], m.cuts[c, SECOND], SECTION * m.cuts[c, ROW]
        if what == COINCIDE:
            laws.coincide(sections, first, second, out, n)
        elif what == PERPENDICULAR:
            laws.perpendicular(sections, first, second, axes, m.cuts[c, AXIS_1], m.cuts[c, AXIS_2], out, n)
        else:
            laws.on_plane(sections, first, second, axes, m.cuts[c, AXIS_1], out, n)


@njit(**OPTIONS)
def move(m, u, k):
    """Velocities of all nodes and sections, after ``partials``."""
    apart()
    for n in range(len(m.nodes)):
        for i in range(3):
            k.v[n, i] = k.w[n, i] = 0.0
            for s in range(len(u)):
                k.v[n, i] += k.Jv[n, s, i] * u[s]
                k.w[n, i] += k.Jw[n, s, i] * u[s]
    for n in range(len(m.on)):
        on, section = m.on[n], k.sections[n]
        for i in range(3, SECTION):
            section[i] = 0.0
        if on >= 0:
            less(section, k.r[on], k.x, 0)
            for i in range(3):
                section[3 + i], section[9 + i] = k.v[on, i], k.w[on, i]
            add_cross(k.w[on], 0, k.x, 0, section, 3)


@njit(**OPTIONS)
def accelerate(m, u, du, k):
    """Accelerations of all nodes and sections, and the cuts' rows with their second rates, after ``move``."""
    apart()
    x = k.x
    for n in range(len(m.nodes)):
        kind, parent, s, a, e, R = m.nodes[n, KIND], m.nodes[n, PARENT], m.nodes[n, SPEED], k.a[n], k.e[n], k.R[n]
        for i in range(3):
            a[i] = k.a[parent, i] if parent >= 0 else 0.0
            e[i] = k.e[parent, i] if parent >= 0 else 0.0
            x[i] = k.w[parent, i] if parent >= 0 else 0.0
            x[3 + i] = k.P[n, i] - (k.r[parent, i] if parent >= 0 else 0.0)
        _centripetal(x, 0, e, x, 3, a, 0, x)
        if kind == SLIDE:
            times(R, m.numbers[n], AXIS, x, 6)
            for i in range(3):
                a[i] += x[6 + i] * du[s]
                x[6 + i] *= 2.0 * u[s]
            add_cross(x, 0, x, 6, a, 0)
        elif kind == TURN:
            times(R, m.numbers[n], AXIS, x, 6)
            for i in range(3):
                e[i] += x[6 + i] * du[s]
                x[6 + i] *= u[s]
            add_cross(x, 0, x, 6, e, 0)
        elif kind == BALL:
            times(R, du, s, x, 9)
            times(R, u, s, x, 6)
            for i in range(3):
                e[i] += x[9 + i]
            add_cross(x, 0, x, 6, e, 0)
        elif kind == STATION:
            _deformed_accelerations(m, n, u, du, k)
        less(k.r[n], k.P[n], x, 3)
        _centripetal(k.w[n], 0, e, x, 3, a, 0, x)
    for n in range(len(m.on)):
        on, section = m.on[n], k.sections[n]
        if on >= 0:
            less(section, k.r[on], x, 3)
            for i in range(3):
                section[6 + i], section[12 + i] = k.a[on, i], k.e[on, i]
            _centripetal(k.w[on], 0, k.e[on], x, 3, section, 6, x)
    rows(m, k)


@once
@njit(**OPTIONS)
def _centripetal(w, i, e, arm, j, a, k, x):
    """a += e x arm + w x (w x arm): acceleration of a point of a body against its origin's; x from 12 is filled."""
    apart()
    x[12] = x[13] = x[14] = 0.0
    add_cross(w, i, arm, j, x, 12)
    add_cross(e, 0, arm, j, a, k)
    add_cross(w, i, x, 12, a, k)
