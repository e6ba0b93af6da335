"""Compiled kinematics of a tree of bodies in space, and of the cuts that close its loops.

Kane's method with generalised speeds: the tree's joint rates, and a ball's relative angular velocity in its own axes
(Kane & Levinson 1985, ch. 2). Outward passes over the tree (Kane's equations of order n, Rosenthal 1990): positions,
velocities and accelerations of all nodes. Vectors are global unless said otherwise and refer to a node's origin.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody.compile.stand_ins import of_stiffness
from kaneflex.multibody.compile.values import after, inside, numbers_of
from kaneflex.multibody.dynamics.algebra import (
    axpy,
    cross,
    first,
    joined,
    last,
    minus,
    plus,
    scaled,
    turned,
    turned_back,
    twist_at,
)
from kaneflex.multibody.dynamics.rotation_vectors import spin, spun, turning
from kaneflex.multibody.dynamics.spatial_work import AXES, NODES, SECTION, SECTIONS
from kaneflex.multibody.model import layout as of
from kaneflex.multibody.model.layout import OPTIONS, apart
from kaneflex.multibody.model.spatial_layout import (
    AT,
    BALL,
    COINCIDE,
    COORDINATE,
    COUNT,
    KIND,
    PARENT,
    PERPENDICULAR,
    ROW_OF,
    SHAPES,
    SLIDE,
    SPEED,
    STATION,
    TURN,
)  # fmt: skip
from kaneflex.support.inner import once

_NUMBERS, _PLACE, _AXIS, _SHIFT = 6, 3, 4, 5
"""Vectors of a node's numbers, and the places of its joint's point, axis, and the joint's point in its own axes."""
_NOTHING = 0.0, 0.0, 0.0


@njit(**OPTIONS)
def _turn(m, n, w, x, y, z, two):
    """Rotate the axes of a node by a quaternion (w, x, y, z), whose square is 2 / ``two``."""
    apart()
    for i in range(3 * n, 3 * n + 3):
        a, b, c = m.R[i]
        m.R[i] = (
            a * (1.0 - two * (y * y + z * z)) + b * two * (x * y + w * z) + c * two * (x * z - w * y),
            a * two * (x * y - w * z) + b * (1.0 - two * (x * x + z * z)) + c * two * (y * z + w * x),
            a * two * (x * z + w * y) + b * two * (y * z - w * x) + c * (1.0 - two * (x * x + y * y)),
        )


@njit(**OPTIONS)
def _turn_by(m, n, x, y, z):
    """Rotate the axes of a node by a rotation vector in them."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle > 0.0:
        share = math.sin(0.5 * angle) / angle
        _turn(m, n, math.cos(0.5 * angle), share * x, share * y, share * z, 2.0)


@once
@njit(**OPTIONS)
def place(m, first_body):
    """Axes and origins of all nodes, then sections and axes, and twists for a unit of every speed."""
    apart()
    y, q = m.y, m.q
    for n in range(m.counts[NODES]):
        kind, parent, own, s = m.nodes[n, KIND], m.nodes[n, PARENT], _NUMBERS * n, m.nodes[n, SPEED]
        P, moved = m.numbers[own + _PLACE], (0.0, 0.0, 0.0)
        if parent >= 0:
            for i in range(3):
                m.R[3 * n + i] = turned_back(m.numbers, own, m.R[3 * parent + i])
            P = plus(turned(m.R, 3 * parent, P), m.r[parent])
        else:
            for i in range(3):
                m.R[3 * n + i] = m.numbers[own + i]
        if kind == SLIDE:
            P = axpy(y[s], turned(m.R, 3 * n, m.numbers[own + _AXIS]), P)
        elif kind == TURN:
            a, b, c = scaled(math.sin(0.5 * y[s]), m.numbers[own + _AXIS])
            _turn(m, n, math.cos(0.5 * y[s]), a, b, c, 2.0)
        elif kind == BALL:
            k = m.nodes[n, COORDINATE]
            w, a, b, c = q[k], q[k + 1], q[k + 2], q[k + 3]
            _turn(m, n, w, a, b, c, 2.0 / (w * w + a * a + b * b + c * c))
            _turn_by(m, n, y[s], y[s + 1], y[s + 2])
        elif kind == STATION:
            P = plus(P, _deform(m, n))
        elif kind == SHAPES and m.nodes[n, AT] >= 0:
            moved = _deform_back(m, n)
        m.P[n] = P
        m.r[n] = minus(minus(P, turned(m.R, 3 * n, m.numbers[own + _SHIFT])), moved)
        _direct(m, n, kind)
    for n in range(m.counts[AXES]):
        on = m.axis_on[n]
        m.axes[n] = turned(m.R, 3 * on, m.axis_at[n]) if on >= 0 else m.axis_at[n]
    for n in range(m.counts[SECTIONS]):
        on = m.on[n]
        m.sections[5 * n] = plus(turned(m.R, 3 * on, m.at[n]), m.r[on]) if on >= 0 else m.at[n]


@once
@njit(**OPTIONS)
def _shaped(m, n, row, q):
    """Vector of the rows N q or psi q (``row`` 0 or 3) of a station, coordinates from q on."""
    apart()
    count, o = m.nodes[n, COUNT], m.nodes[n, AT] + m.nodes[n, COUNT] * row
    x = y = z = 0.0
    for s in range(count):
        x += m.block[o + s] * q[s]
        y += m.block[o + count + s] * q[s]
        z += m.block[o + 2 * count + s] * q[s]
    return x, y, z


@njit(**OPTIONS)
def _bent(m, n, u):
    """Vector G u u of a station."""
    apart()
    x, at = (0.0, 0.0, 0.0), m.nodes[n, AT] + 6 * m.nodes[n, COUNT]
    for _ in range(int(m.block[at])):
        i, j = int(m.block[at + 1]), int(m.block[at + 2])
        share = (1.0 if i == j else 2.0) * u[i] * u[j]
        x = axpy(share, (m.block[at + 3], m.block[at + 4], m.block[at + 5]), x)
        at += 5
    return x


@njit(**OPTIONS)
def _section(m, theta, rate):
    """Rotation R, T and T' theta' of a section with its angles and their rates, at x[6], x[15] and x[24]."""
    for i in range(3):
        m.x[i], m.x[3 + i] = theta[i], rate[i]
    shape_laws.section(m.x, 0, m.x, 6)


@njit(**OPTIONS)
def _of_x(m, k, a):
    """The matrix at x[k], row by row, times a vector."""
    return (m.x[k] * a[0] + m.x[k + 1] * a[1] + m.x[k + 2] * a[2],
            m.x[k + 3] * a[0] + m.x[k + 4] * a[1] + m.x[k + 5] * a[2],
            m.x[k + 6] * a[0] + m.x[k + 7] * a[1] + m.x[k + 8] * a[2])  # fmt: skip


@of_stiffness(_NOTHING)
@njit(**OPTIONS)
def _deform(m, n):
    """Rotate a station by theta = psi q, and return its displacement."""
    apart()
    base = 3 * m.nodes[n, PARENT]
    _section(m, _shaped(m, n, 3, after(m.y, m.nodes[n, SPEED])), (0.0, 0.0, 0.0))
    for i in range(3):
        a, b, c = m.R[base + i]
        m.R[3 * n + i] = (a * m.x[6] + b * m.x[9] + c * m.x[12], a * m.x[7] + b * m.x[10] + c * m.x[13],
                          a * m.x[8] + b * m.x[11] + c * m.x[14])  # fmt: skip
    return _displace(m, n, base)


@of_stiffness(_NOTHING)
@njit(**OPTIONS)
def _deform_back(m, n):
    """Rotate the axes of a node of shapes back from the section of its joint, and return the section's displacement."""
    apart()
    _section(m, _shaped(m, n, 3, after(m.y, m.nodes[n, SPEED])), (0.0, 0.0, 0.0))
    for i in range(3):
        a, b, c = m.R[3 * n + i]
        m.R[3 * n + i] = (m.x[6] * a + m.x[7] * b + m.x[8] * c, m.x[9] * a + m.x[10] * b + m.x[11] * c,
                          m.x[12] * a + m.x[13] * b + m.x[14] * c)  # fmt: skip
    return _displace(m, n, 3 * n)


@njit(**OPTIONS)
def _displace(m, n, base):
    """Displacement N q + 1/2 G q q of a section at hand, with the body's axes at R[base].

    Its twists for a unit of every shape are, as G is symmetric, N_j + G_jk q_k and T psi_j in these axes.
    """
    apart()
    count, o, q = m.nodes[n, COUNT], m.nodes[n, AT], after(m.y, m.nodes[n, SPEED])
    for k in range(15, 18):  # T in global axes
        m.x[k], m.x[k + 3], m.x[k + 6] = turned(m.R, base, (m.x[k], m.x[k + 3], m.x[k + 6]))
    phi, at, moved = after(m.phi, m.nodes[n, ROW_OF]), o + 6 * count, (0.0, 0.0, 0.0)
    for j in range(count):
        v = turned(m.R, base, (m.block[o + j], m.block[o + count + j], m.block[o + 2 * count + j]))
        psi = o + 3 * count + j
        phi[j] = joined(v, _of_x(m, 15, (m.block[psi], m.block[psi + count], m.block[psi + 2 * count])))
        moved = axpy(q[j], v, moved)
    for _ in range(int(m.block[at])):
        i, j = int(m.block[at + 1]), int(m.block[at + 2])
        g = turned(m.R, base, (m.block[at + 3], m.block[at + 4], m.block[at + 5]))
        phi[i] = joined(axpy(q[j], g, first(phi[i])), last(phi[i]))
        if i != j:
            phi[j] = joined(axpy(q[i], g, first(phi[j])), last(phi[j]))
        moved = axpy((0.5 if i == j else 1.0) * q[i] * q[j], g, moved)
        at += 5
    return moved


@njit(**OPTIONS)
def _direct(m, n, kind):
    """Twists of a joint's node, or of axes turned back by shapes, for a unit of every speed relative to the parent."""
    apart()
    s, arm = m.nodes[n, SPEED], minus(m.r[n], m.P[n])
    if kind == SLIDE:
        m.S[s] = joined(turned(m.R, 3 * n, m.numbers[_NUMBERS * n + _AXIS]), (0.0, 0.0, 0.0))
    elif kind == TURN:
        axis = turned(m.R, 3 * n, m.numbers[_NUMBERS * n + _AXIS])
        m.S[s] = joined(cross(axis, arm), axis)
    elif kind == BALL:
        theta = m.y[s], m.y[s + 1], m.y[s + 2]
        b, c, _, _ = turning(theta)
        _ball_axis(m, n, s, arm, spun(theta, b, c, (1.0, 0.0, 0.0)))
        _ball_axis(m, n, s + 1, arm, spun(theta, b, c, (0.0, 1.0, 0.0)))
        _ball_axis(m, n, s + 2, arm, spun(theta, b, c, (0.0, 0.0, 1.0)))
    elif kind == SHAPES and m.nodes[n, AT] >= 0:
        phi = after(m.phi, m.nodes[n, ROW_OF])
        for j in range(m.nodes[n, COUNT]):
            omega = scaled(-1.0, last(phi[j]))
            phi[j] = joined(minus(cross(omega, arm), first(phi[j])), omega)


@njit(**OPTIONS)
def _ball_axis(m, n, s, arm, omega):
    axis = turned(m.R, 3 * n, omega)
    m.S[s] = joined(cross(axis, arm), axis)


@njit(**OPTIONS)
def freedoms(m, n):
    """Number of speeds of a joint's node."""
    kind = m.nodes[n, KIND]
    return 3 if kind == BALL else 1 if kind == TURN or kind == SLIDE else 0


@njit(**OPTIONS)
def cut_rows(m):
    """Residuals of the cuts, their rates and Jacobians by the sections' twists."""
    apart()
    sections, axes, out = numbers_of(m.sections), numbers_of(m.axes), numbers_of(m.rows)
    for c in range(m.plan[of.CUTS], m.plan[of.HOLDS]):
        what, one, two, n = m.acts[c, of.WHAT], m.acts[c, of.AT], m.acts[c, of.ON], SECTION * m.acts[c, of.ROW_AT]
        axis = m.acts[c, of.NUMBERS_AT]
        if what == COINCIDE:
            laws.coincide(sections, one, two, out, n)
        elif what == PERPENDICULAR:
            laws.perpendicular(sections, one, two, axes, axis, axis + 1, out, n)
        else:
            laws.on_plane(sections, one, two, axes, axis, out, n)


@njit(**OPTIONS)
def relative(m, n, u):
    """Twist of a node relative to its parent, from the speeds."""
    apart()
    s, twist = m.nodes[n, SPEED], (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if m.nodes[n, ROW_OF] >= 0:
        for j in range(m.nodes[n, COUNT]):
            twist = axpy(u[s + j], m.phi[m.nodes[n, ROW_OF] + j], twist)
    for j in range(s, s + freedoms(m, n)):
        twist = axpy(u[j], m.S[j], twist)
    return twist


@once
@njit(**OPTIONS)
def move(m, first_body):
    """Velocities of all nodes and sections, after ``place``."""
    apart()
    for n in range(m.counts[NODES]):
        parent, twist = m.nodes[n, PARENT], relative(m, n, m.u)
        if parent >= 0:
            twist = plus(twist, twist_at(joined(m.v[parent], m.omega[parent]), minus(m.r[n], m.r[parent])))
        m.v[n], m.omega[n] = first(twist), last(twist)
    nothing = 0.0, 0.0, 0.0
    for n in range(m.counts[SECTIONS]):
        on, at = m.on[n], 5 * n
        m.sections[at + 1] = m.sections[at + 2] = m.sections[at + 3] = m.sections[at + 4] = nothing
        if on >= 0:
            m.sections[at + 1] = plus(m.v[on], cross(m.omega[on], minus(m.sections[at], m.r[on])))
            m.sections[at + 3] = m.omega[on]


@once
@njit(**OPTIONS)
def accelerate(m, first_body):
    """Accelerations of all nodes and sections, after ``move``."""
    apart()
    u, du = m.u, m.du
    for n in range(m.counts[NODES]):
        kind, parent, s = m.nodes[n, KIND], m.nodes[n, PARENT], m.nodes[n, SPEED]
        a = e = w = arm = 0.0, 0.0, 0.0
        if parent >= 0:
            e, w = m.e[parent], m.omega[parent]
            a = plus(m.a[parent], _centripetal(w, e, minus(m.P[n], m.r[parent])))
        if kind == SLIDE:
            axis = first(m.S[s])
            a = plus(axpy(du[s], axis, a), cross(w, scaled(2.0 * u[s], axis)))
        elif kind == TURN:
            axis = last(m.S[s])
            e = plus(axpy(du[s], axis, e), cross(w, scaled(u[s], axis)))
        elif kind == BALL:
            slow, fast = spin(m, s)
            e = plus(e, turned(m.R, 3 * n, fast))
            e = plus(e, cross(w, turned(m.R, 3 * n, slow)))
        elif kind == STATION:
            moved, faster, turned_on, e_turned = _station_accelerations(m, n)
            a = plus(plus(a, faster), cross(w, scaled(2.0, moved)))
            e = plus(plus(e, e_turned), cross(w, turned_on))
        elif kind == SHAPES and m.nodes[n, AT] >= 0:
            slower, turning_back = _back_accelerations(m, n)
            a, e = plus(a, slower), plus(e, turning_back)
        arm = minus(m.r[n], m.P[n])
        m.a[n], m.e[n] = plus(a, _centripetal(m.omega[n], e, arm)), e
    for n in range(m.counts[SECTIONS]):
        on, at = m.on[n], 5 * n
        if on >= 0:
            m.sections[at + 2] = plus(m.a[on], _centripetal(m.omega[on], m.e[on], minus(m.sections[at], m.r[on])))
            m.sections[at + 4] = m.e[on]


@of_stiffness(4 * (_NOTHING,))
@njit(**OPTIONS)
def _station_accelerations(m, n):
    """Velocity, acceleration, angular velocity and acceleration of a station relative to its body's axes, global."""
    apart()
    u, base = after(m.u, m.nodes[n, SPEED]), 3 * m.nodes[n, PARENT]
    twist, faster = relative(m, n, m.u), relative(m, n, m.du)
    _section(m, _shaped(m, n, 3, after(m.y, m.nodes[n, SPEED])), _shaped(m, n, 3, u))
    growing = turned(m.R, base, _bent(m, n, u)), turned(m.R, base, (m.x[24], m.x[25], m.x[26]))
    return first(twist), plus(first(faster), growing[0]), last(twist), plus(last(faster), growing[1])


@of_stiffness(2 * (_NOTHING,))
@njit(**OPTIONS)
def _back_accelerations(m, n):
    """Acceleration by displacements, and angular acceleration, of the axes of a node of shapes, less those of the
    section from which they turn back."""
    apart()
    u, omega, arm = after(m.u, m.nodes[n, SPEED]), m.omega[n], minus(m.r[n], m.P[n])
    slow, fast = relative(m, n, m.u), relative(m, n, m.du)
    _section(m, _shaped(m, n, 3, after(m.y, m.nodes[n, SPEED])), _shaped(m, n, 3, u))
    rate = minus(cross(last(slow), arm), first(slow))
    faster = plus(minus(cross(last(fast), arm), first(fast)), turned(m.R, 3 * n, _bent(m, n, u)))
    growing = turned(m.R, 3 * n, (m.x[24], m.x[25], m.x[26]))
    slower = scaled(-1.0, plus(faster, cross(omega, scaled(2.0, rate))))
    return slower, minus(plus(last(fast), cross(omega, last(slow))), growing)


@njit(**OPTIONS)
def _centripetal(w, e, arm):
    """e x arm + w x (w x arm): acceleration of a point of a body relative to its origin."""
    inside()
    return plus(cross(e, arm), cross(w, cross(w, arm)))
