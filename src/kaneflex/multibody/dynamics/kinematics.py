"""Compiled kinematics of a tree of bodies, in the plane and in space.

Kane's method with generalised speeds: the rates of joints and shapes, and a ball's relative angular velocity in its own
axes (Kane & Levinson 1985, ch. 2). Outward passes over the nodes of the tree, with work proportional to their number
(Kane's equations of order n, Rosenthal 1990): positions, velocities and accelerations. Vectors are global unless said
otherwise; twists refer to a node's origin.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.stand_ins import if_stiffness
from kaneflex.multibody.compile.values import inline, row_length, twists, vectors
from kaneflex.multibody.dynamics.algebra import (
    axpy,
    coriolis,
    minus,
    plus,
    rate_at,
    scaled,
    twist_at,
    zero_like,
)
from kaneflex.multibody.dynamics.axes import (
    base,
    directions,
    free_rates,
    freedoms,
    joint_place,
    to_global,
    turn_axes,
)
from kaneflex.multibody.dynamics.deformation import bias_acceleration
from kaneflex.multibody.dynamics.arrays import NODES, SECTIONS
from kaneflex.multibody.compile.types import OPTIONS, no_inline, shifted
from kaneflex.multibody.model.tree_layout import COUNT, KIND, PARENT, ROW_OF, SPEED, STATION
from kaneflex.support.inner import once


@njit(**OPTIONS)
def section_at(m, n):
    """Place of a section's numbers in ``sections``."""
    inline()
    return row_length(m) * n


@njit(**OPTIONS)
def section_place(m, n):
    """Place of a section, in the plane with its angle."""
    inline()
    return vectors(shifted(m.sections, section_at(m, n)))[0]


@njit(**OPTIONS)
def section_motion(m, n, rate):
    """Twist of a section (``rate`` 0), or its rate (1)."""
    inline()
    return twists(m, shifted(m.sections, section_at(m, n) + 3))[rate]


@njit(**OPTIONS)
def twist_at_section(m, n):
    """Velocity and angular velocity of a section."""
    inline()
    return section_motion(m, n, 0)


@once
@njit(**OPTIONS)
def place(m, first_node):
    """Axes and origins of all nodes from the first one on, twists for a unit of every joint's speeds, and sections."""
    no_inline()
    for n in range(first_node, m.counts[NODES]):
        P = joint_place(m, n)
        m.P[n] = P
        m.r[n] = minus(P, to_global(m, n, m.offset[n]))
        directions(m, n)
    turn_axes(m)
    for n in range(m.counts[SECTIONS]):
        on = m.on[n]
        if on >= first_node:
            point = vectors(shifted(m.sections, section_at(m, n)))
            point[0] = plus(to_global(m, on, m.at[n]), m.r[on])


@njit(**OPTIONS)
def relative(m, n, u):
    """Twist of a node relative to its parent, from the speeds."""
    inline()
    s, twist = m.nodes[n, SPEED], zero_like(m.S[0])
    if m.nodes[n, ROW_OF] >= 0:
        for j in range(m.nodes[n, COUNT]):
            twist = axpy(u[s + j], m.phi[m.nodes[n, ROW_OF] + j], twist)
        return to_global(m, base(m, n), twist)
    for j in range(s, s + freedoms(m, n)):
        twist = axpy(u[j], m.S[j], twist)
    return twist


@once
@njit(**OPTIONS)
def move(m, first_node):
    """Velocities of these nodes and sections, after ``place``."""
    no_inline()
    for n in range(first_node, m.counts[NODES]):
        parent, twist = m.nodes[n, PARENT], relative(m, n, m.u)
        m.slow[n] = twist
        if parent >= 0:
            twist = plus(twist, twist_at(m.twist[parent], minus(m.r[n], m.r[parent])))
        m.twist[n] = twist
    for n in range(m.counts[SECTIONS]):
        on = m.on[n]
        if on >= first_node:
            motion = twists(m, shifted(m.sections, section_at(m, n) + 3))
            motion[0] = twist_at(m.twist[on], minus(section_place(m, n), m.r[on]))


@once
@njit(**OPTIONS)
def accelerate(m, first_node):
    """Accelerations of these nodes and sections, after ``move``."""
    no_inline()
    for n in range(first_node, m.counts[NODES]):
        parent, arm, s = m.nodes[n, PARENT], minus(m.P[n], m.r[n]), m.nodes[n, SPEED]
        rate = w = zero_like(m.S[0])
        if parent >= 0:
            w = m.twist[parent]
            rate = rate_at(m.rate[parent], w, minus(m.P[n], m.r[parent]))
        if m.nodes[n, KIND] == STATION:
            m.rate[n] = plus(plus(rate, _by_shapes(m, n)), coriolis(w, m.slow[n]))
            continue
        slow = twist_at(m.slow[n], arm)
        if m.nodes[n, ROW_OF] >= 0:  # axes that move against the section of their joint
            rate, w = plus(rate, twist_at(_by_shapes(m, n), arm)), m.twist[n]
        elif freedoms(m, n) == 1:
            rate = axpy(m.du[s], twist_at(m.S[s], arm), rate)
        elif freedoms(m, n) == 3:
            rate = plus(rate, free_rates(m, n))
        m.rate[n] = rate_at(plus(rate, coriolis(w, slow)), m.twist[n], scaled(-1.0, arm))
    for n in range(m.counts[SECTIONS]):
        on = m.on[n]
        if on >= first_node:
            motion = twists(m, shifted(m.sections, section_at(m, n) + 3))
            motion[1] = rate_at(m.rate[on], m.twist[on], minus(section_place(m, n), m.r[on]))


@if_stiffness(6 * (0.0,))
@njit(**OPTIONS)
def _by_shapes(m, n):
    """Acceleration of a section relative to its body's axes, or of axes relative to the section of their joint."""
    no_inline()
    if m.nodes[n, KIND] == STATION:
        return plus(relative(m, n, m.du), to_global(m, m.nodes[n, PARENT], bias_acceleration(m, n)))
    back = twist_at(to_global(m, n, bias_acceleration(m, n)), minus(m.r[n], m.P[n]))
    return axpy(-1.0, back, relative(m, n, m.du))
