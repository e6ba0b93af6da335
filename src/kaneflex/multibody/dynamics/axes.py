"""Axes and joints of a tree's nodes: an angle in the plane, a rotation matrix in space.

Functions of the same name in both: the type of the tables selects them.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.types import IN_ORDER, OPTIONS, no_inline
from kaneflex.multibody.compile.values import by_size, chosen, inline, size_of, width
from kaneflex.multibody.dynamics.algebra import (
    axpy,
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
from kaneflex.multibody.dynamics.arrays import AXES
from kaneflex.multibody.dynamics.rotation_vectors import rate_coefficients, spin, spun
from kaneflex.multibody.model.tree_layout import (
    AXED,
    BALL,
    COORDINATE,
    FREE,
    KIND,
    PARENT,
    ROW_OF,
    SHAPES,
    SLIDE,
    SPEED,
    STATION,
    TURN,
)  # fmt: skip

_PLACE, _AXIS = 3, 2
"""Places of the joint's point and axis among the D vectors of a node's numbers, from their end, which is the point in
its own axes. In space three of a rotation precede them; in the plane the point has the angle."""


@njit(**OPTIONS)
def _number(m, n, place):
    """Point or axis of a node's joint."""
    inline()
    return m.numbers[width(m) * (n + 1) - place]


@njit(**IN_ORDER)
def to_global(m, n, a):
    """Global components of a vector, a twist or a wrench in the axes of a node."""
    inline()
    c, s, _ = m.R[n]
    return c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]


@njit(**IN_ORDER)
def _vector_to_global(m, n, a):
    inline()
    return turned(m.R, 3 * n, a)


@njit(**IN_ORDER)
def _twist_to_global(m, n, a):
    inline()
    return joined(turned(m.R, 3 * n, first(a)), turned(m.R, 3 * n, last(a)))


@njit(**IN_ORDER)
def to_axes(m, n, a):
    """Components of a global vector, twist or wrench in the axes of a node."""
    inline()
    c, s, _ = m.R[n]
    return c * a[0] + s * a[1], c * a[1] - s * a[0], a[2]


@njit(**IN_ORDER)
def _vector_to_axes(m, n, a):
    inline()
    return turned_back(m.R, 3 * n, a)


@njit(**IN_ORDER)
def _twist_to_axes(m, n, a):
    inline()
    return joined(turned_back(m.R, 3 * n, first(a)), turned_back(m.R, 3 * n, last(a)))


def _of(plane, vector, twist):
    """One name for a function of a vector in the plane, and of a vector and of a twist in space."""
    def choose(args):
        return plane if size_of(args[0]) == 3 else twist if size_of(args[2]) == 6 else vector

    return chosen(choose, plane)


to_global = _of(to_global, _vector_to_global, _twist_to_global)
to_axes = _of(to_axes, _vector_to_axes, _twist_to_axes)


@njit(**OPTIONS)
def freedoms(m, n):
    """Number of speeds of a joint's node."""
    kind = m.nodes[n, KIND]
    return 3 if kind == BALL else 1 if kind == TURN or kind == SLIDE else 0


@njit(**OPTIONS)
def base(m, n):
    """Node with the axes of a section's body, for sections that shapes move."""
    return m.nodes[n, PARENT] if m.nodes[n, KIND] == STATION else n


@njit(**OPTIONS)
def _turn_to(m, n, angle):
    if angle != m.R[n][2]:  # unchanged for bodies in guides, and outside the loops that an iteration corrects
        m.R[n] = math.cos(angle), math.sin(angle), angle


@njit(**OPTIONS)
def joint_place(m, n):
    """Point of a node's joint at its coordinates, in the plane with the angle there; sets the node's axes."""
    inline()
    kind, parent, s = m.nodes[n, KIND], m.nodes[n, PARENT], m.nodes[n, SPEED]
    P, axis = _number(m, n, _PLACE), _number(m, n, _AXIS)
    if kind == STATION:
        P = plus(P, m.moved[n])
    if parent >= 0:
        P = plus(to_global(m, parent, P), m.r[parent])
    if kind == SLIDE:
        _turn_to(m, n, P[2])
        P = axpy(m.y[s], to_global(m, n, axis), P)
    elif kind == TURN:
        P = axpy(m.y[s], axis, P)
    elif kind == FREE:
        P = m.y[s], m.y[s + 1], m.y[s + 2]
    if m.nodes[n, AXED]:
        _turn_to(m, n, P[2] - m.offset[n][2])
    return P


@njit(**OPTIONS)
def _turn(m, n, w, x, y, z, two):
    """Rotate the axes of a node by a quaternion (w, x, y, z), whose square is 2 / ``two``."""
    no_inline()
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


@njit(**OPTIONS)
def _joint_place_in_space(m, n):
    no_inline()
    kind, parent, own, s = m.nodes[n, KIND], m.nodes[n, PARENT], width(m) * n, m.nodes[n, SPEED]
    P, axis, y, q, R = _number(m, n, _PLACE), _number(m, n, _AXIS), m.y, m.q, 3 * n
    if kind == STATION:
        P = plus(P, m.moved[n])
    for i in range(3):
        if kind == STATION:
            m.R[R + i] = turned_back(m.bent, R, m.R[3 * parent + i])
        elif kind == SHAPES:
            m.R[R + i] = turned(m.bent, R, m.R[3 * parent + i]) if m.nodes[n, ROW_OF] >= 0 else m.R[3 * parent + i]
        else:
            m.R[R + i] = turned_back(m.numbers, own, m.R[3 * parent + i]) if parent >= 0 else m.numbers[own + i]
    if parent >= 0:
        P = plus(turned(m.R, 3 * parent, P), m.r[parent])
    if kind == SLIDE:
        P = axpy(y[s], turned(m.R, R, axis), P)
    elif kind == TURN:
        a, b, c = scaled(math.sin(0.5 * y[s]), axis)
        _turn(m, n, math.cos(0.5 * y[s]), a, b, c, 2.0)
    elif kind == BALL:
        k = m.nodes[n, COORDINATE]
        w, a, b, c = q[k], q[k + 1], q[k + 2], q[k + 3]
        _turn(m, n, w, a, b, c, 2.0 / (w * w + a * a + b * b + c * c))
        _turn_by(m, n, y[s], y[s + 1], y[s + 2])
    return P


@njit(**OPTIONS)
def directions(m, n):
    """Twists of a joint's node for a unit of every speed, relative to the parent."""
    inline()
    kind, s = m.nodes[n, KIND], m.nodes[n, SPEED]
    if kind == TURN or kind == SLIDE:
        axis = to_global(m, n, _number(m, n, _AXIS))
        m.S[s] = twist_at(axis, minus(m.r[n], m.P[n]))
    elif kind == FREE:
        m.S[s], m.S[s + 1], m.S[s + 2] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@njit(**OPTIONS)
def _directions_in_space(m, n):
    no_inline()
    kind, s, arm, nothing = m.nodes[n, KIND], m.nodes[n, SPEED], minus(m.r[n], m.P[n]), (0.0, 0.0, 0.0)
    if kind == SLIDE:
        m.S[s] = joined(turned(m.R, 3 * n, _number(m, n, _AXIS)), nothing)
    elif kind == TURN:
        m.S[s] = twist_at(joined(nothing, turned(m.R, 3 * n, _number(m, n, _AXIS))), arm)
    elif kind == BALL:
        theta = m.y[s], m.y[s + 1], m.y[s + 2]
        b, c, _, _ = rate_coefficients(theta)
        _ball_axis(m, n, s, arm, spun(theta, b, c, (1.0, 0.0, 0.0)))
        _ball_axis(m, n, s + 1, arm, spun(theta, b, c, (0.0, 1.0, 0.0)))
        _ball_axis(m, n, s + 2, arm, spun(theta, b, c, (0.0, 0.0, 1.0)))


@njit(**OPTIONS)
def _ball_axis(m, n, s, arm, omega):
    m.S[s] = twist_at(joined((0.0, 0.0, 0.0), turned(m.R, 3 * n, omega)), arm)


@njit(**OPTIONS)
def free_rates(m, n):
    """Acceleration relative to the parent of a node that moves freely or of a ball."""
    inline()
    s = m.nodes[n, SPEED]
    return m.du[s], m.du[s + 1], m.du[s + 2]


@njit(**OPTIONS)
def _ball_rates(m, n):
    inline()
    return joined((0.0, 0.0, 0.0), turned(m.R, 3 * n, spin(m, m.nodes[n, SPEED])[1]))


@njit(**OPTIONS)
def turn_axes(m):
    """Axes of cuts, loads and springs, in space."""
    for n in range(m.counts[AXES] if width(m) == 6 else 0):
        on = m.axis_on[n]
        m.axes[n] = turned(m.R, 3 * on, m.axis_at[n]) if on >= 0 else m.axis_at[n]


joint_place, directions = by_size(joint_place, _joint_place_in_space), by_size(directions, _directions_in_space)
free_rates = by_size(free_rates, _ball_rates)
