"""Compiled inverse dynamics of a tree: inertia forces of the bodies less those of loads, springs and reactions.

Kane's equations of each free body (``kaneflex.generated.body`` in the plane, ``kaneflex.generated.spatial`` and
``spatial_shapes`` in space), summed inwards over the tree along its speeds: M u' + h (Kane & Levinson 1985, ch. 4 and
6).
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import body
from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody.compile.stand_ins import of_stiffness
from kaneflex.multibody.compile.types import OPTIONS, apart
from kaneflex.multibody.compile.values import after, by_size, width
from kaneflex.multibody.dynamics.algebra import (
    axpy,
    dot,
    first,
    force_at,
    joined,
    last,
    minus,
    plus,
    scaled,
    times,
    twist_at,
    zero_like,
)
from kaneflex.multibody.dynamics.arrays import BODIES, NODES, SPEEDS
from kaneflex.multibody.dynamics.axes import base, freedoms, to_axes, to_global
from kaneflex.multibody.dynamics.interactions import act, react
from kaneflex.multibody.dynamics.kinematics import relative
from kaneflex.multibody.model.layout import COUPLING, COUPLINGS, INERTIAS, MASSES, MODAL, SQUARE
from kaneflex.multibody.model.layout import SHAPES as COUNTED
from kaneflex.multibody.model.tree_layout import (
    BODY,
    COUNT,
    KIND,
    OWNER,
    PARENT,
    ROW_OF,
    SHAPES,
    SPEED,
)  # fmt: skip
from kaneflex.support.inner import once

OF_RIGID = len(laws.BODY)
"""Numbers of a rigid body in space, which precede those of its shapes."""


@njit(**OPTIONS)
def demand_of_body(m, n):
    """Wrench of a node's body by its motion less gravity, global, about the node's origin; adds the residuals of its
    shapes to h."""
    apart()
    c, s, _ = m.R[n]
    x, y, epsilon = minus(m.rate[n], m.gravity[0])
    k = m.nodes[n, SPEED]
    return body.inverse(m.block, m.nodes[n, BODY], m.y, m.u, m.du, k, c, s, m.twist[n][2], x, y, epsilon, m.h, k)


@njit(**OPTIONS)
def _demand_of_body_in_space(m, n):
    apart()
    rate = m.rate[n]
    e, w = to_axes(m, n, last(rate)), to_axes(m, n, last(m.twist[n]))
    m.x3[0], m.x3[1], m.x3[2] = w, to_axes(m, n, minus(first(rate), m.gravity[0])), e
    laws.demand(m.block, m.nodes[n, BODY], m.x, 0, m.x, 9)
    if m.nodes[n, KIND] == SHAPES:
        _demand_of_shapes(m, n)
    return to_global(m, n, joined(m.x3[3], m.x3[4]))


@of_stiffness(None)
@njit(**OPTIONS)
def _demand_of_shapes(m, n):
    own, u, x = m.nodes[n, BODY] + OF_RIGID, m.nodes[n, SPEED], m.x
    shape_laws.shaped_demand(m.block, own, m.nodes[n, COUNT], x, 0, m.y, u, m.u, u, m.du, x, 9, m.h, u, x, 15)


demand_of_body = by_size(demand_of_body, _demand_of_body_in_space)


@once
@njit(**OPTIONS)
def demand(m, t):
    """Residual of the equations of motion along every coordinate of the tree, h, and the joints' wrenches.

    The bodies' inertia forces less loads, springs and reactions of the cuts are summed inwards.
    """
    apart()
    for s in range(m.counts[SPEEDS]):
        m.h[s] = 0.0
    for n in range(m.counts[NODES]):
        m.wrenches[n] = demand_of_body(m, n) if m.nodes[n, BODY] >= 0 else zero_like(m.wrenches[n])
    act(m, t)
    react(m)
    gather(m, m.wrenches, m.h)


@njit(**OPTIONS)
def gather(m, felt, h):
    """Sum wrenches of the nodes inwards, in place, and add them along the speeds to h."""
    apart()
    for n in range(m.counts[NODES] - 1, -1, -1):
        wrench, s, parent = felt[n], m.nodes[n, SPEED], m.nodes[n, PARENT]
        if m.nodes[n, ROW_OF] >= 0:
            own = to_axes(m, base(m, n), wrench)
            for j in range(m.nodes[n, COUNT]):
                h[s + j] += dot(own, m.phi[m.nodes[n, ROW_OF] + j])
        else:
            for j in range(s, s + freedoms(m, n)):
                h[j] += dot(wrench, m.S[j])
        if parent >= 0:
            felt[parent] = plus(felt[parent], force_at(wrench, minus(m.r[n], m.r[parent])))


@njit(**OPTIONS)
def inertias(m):
    """Inertias of all bodies, their coupling to shapes, and the shapes' own, by global twists."""
    apart()
    plan, w = m.plan, m.w
    for b in range(m.counts[BODIES]):
        n = m.frames[b, 0]
        c, s, _ = m.R[n]
        body.inertia(
            m.block, m.nodes[n, BODY], m.y, m.bodies[b, MODAL], c, s, w, plan[INERTIAS] + 9 * b,
            plan[COUPLINGS] + 3 * m.bodies[b, COUPLING], plan[MASSES] + m.bodies[b, SQUARE],
        )  # fmt: skip


@njit(**OPTIONS)
def _own_inertia(m, n):
    """Mass matrix of a node's body in its axes at x: (6, 6), coupling to its shapes, and the shapes' own."""
    if m.nodes[n, BODY] < 0:
        for i in range(36):
            m.x[i] = 0.0
        return
    laws.inertia(m.block, m.nodes[n, BODY], m.x, 0)
    if m.nodes[n, KIND] == SHAPES:
        _inertia_of_shapes(m, n)


@of_stiffness(None)
@njit(**OPTIONS)
def _inertia_of_shapes(m, n):
    shapes, q = m.nodes[n, COUNT], m.nodes[n, SPEED]
    room = 36 + (6 + shapes) * shapes
    shape_laws.shaped_inertia(m.block, m.nodes[n, BODY] + OF_RIGID, shapes, m.y, q, m.x, 0, m.x, room)


@njit(**OPTIONS)
def _inertias_in_space(m):
    apart()
    x = m.x
    for b in range(m.counts[BODIES]):
        n, shapes = m.frames[b, 0], m.bodies[b, COUNTED]
        _own_inertia(m, n)
        I, R = after(m.I, 6 * b), 3 * n
        for k in range(6):  # rows by global twists, then columns
            I[k] = to_global(m, n, joined(m.x3[2 * k], m.x3[2 * k + 1]))
        for half in range(0, 6, 3):
            rows = I[half], I[half + 1], I[half + 2]
            for i in range(3):
                a, b_, c = m.R[R + i]
                I[half + i] = axpy(c, rows[2], axpy(b_, rows[1], scaled(a, rows[0])))
        E, at = after(m.E, m.bodies[b, COUPLING]), 36
        for j in range(shapes):
            force = x[at + j], x[at + shapes + j], x[at + 2 * shapes + j]
            moment = x[at + 3 * shapes + j], x[at + 4 * shapes + j], x[at + 5 * shapes + j]
            E[j] = to_global(m, n, joined(force, moment))
        for j in range(shapes * shapes):
            m.L[m.bodies[b, SQUARE] + j] = x[36 + 6 * shapes + j]


inertias = by_size(inertias, _inertias_in_space)


@njit(**OPTIONS)
def momenta(m, u, out):
    """Generalised momenta M u of all speeds, for the ``inertias`` and directions of the place of m; fills F."""
    apart()
    for s in range(m.counts[SPEEDS]):
        out[s] = 0.0
    for n in range(m.counts[NODES]):
        parent, twist = m.nodes[n, PARENT], relative(m, n, u)
        if parent >= 0:
            twist = plus(twist, twist_at(m.F[parent], minus(m.r[n], m.r[parent])))
        m.F[n] = twist
    for n in range(m.counts[NODES]):  # from twists to momenta
        twist, b = m.F[n], m.nodes[n, OWNER]
        if m.frames[b, 0] != n:
            m.F[n] = zero_like(m.F[n])
            continue
        momentum, E = times(after(m.I, width(m) * b), twist), after(m.E, m.bodies[b, COUPLING])
        s, L, shapes = m.bodies[b, MODAL], after(m.L, m.bodies[b, SQUARE]), m.bodies[b, COUNTED]
        for j in range(shapes):
            momentum = axpy(u[s + j], E[j], momentum)
            out[s + j] += dot(E[j], twist)
            for k in range(shapes):
                out[s + j] += L[shapes * j + k] * u[s + k]
        m.F[n] = momentum
    gather(m, m.F, out)


@njit(**OPTIONS)
def mass_matrix(m, unit):
    """Fill the mass matrix M of all speeds; ``unit``, one number each, is zero before and after."""
    apart()
    inertias(m)
    for s in range(m.counts[SPEEDS]):
        unit[s] = 1.0
        momenta(m, unit, after(m.M, m.counts[SPEEDS] * s))
        unit[s] = 0.0
