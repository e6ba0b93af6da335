"""Compiled inverse dynamics of a tree: inertia forces of the bodies less those of loads, springs and reactions.

Kane's equations of each free body in its axes (``kaneflex.generated.joints`` and ``shapes`` in the plane, ``spatial``
and ``spatial_shapes`` in space), summed inwards over the tree along its speeds: M u' + h (Kane & Levinson 1985, ch. 4
and 6).
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import joints as planar
from kaneflex.generated import shapes as planar_shapes
from kaneflex.generated import spatial, spatial_shapes
from kaneflex.multibody.compile.stand_ins import if_stiffness
from kaneflex.multibody.compile.types import OPTIONS, no_inline
from kaneflex.multibody.compile.values import after, by_size, twists, width
from kaneflex.multibody.dynamics.algebra import (
    axpy,
    dot,
    first,
    force_at,
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
from kaneflex.multibody.dynamics.interactions import apply_interactions, apply_reactions
from kaneflex.multibody.dynamics.kinematics import relative
from kaneflex.multibody.model.layout import COUPLING, MODAL, SQUARE
from kaneflex.multibody.model.layout import SHAPES as COUNTED
from kaneflex.multibody.model.tree_layout import BODY, COUNT, KIND, OWNER, PARENT, ROW_OF, SHAPES, SPEED
from kaneflex.support.inner import once

RIGID_PLANAR, RIGID = len(planar.BODY), len(spatial.BODY)
"""Numbers of a rigid body in the plane and in space, which precede those of its shapes."""
_WRENCH = 9
"""Place in x of a body's wrench, behind its motion; in space room for its shapes follows."""


@njit(**OPTIONS)
def demand_of_body(m, n):
    """Wrench of a node's body by its motion less gravity, global, about the node's origin; adds the residuals of its
    shapes to h."""
    no_inline()
    _own_demand(m, n)
    return to_global(m, n, twists(m, after(m.x, _WRENCH))[0])


@njit(**OPTIONS)
def _own_demand(m, n):
    """Motion and wrench of a node's body in its axes, at x."""
    m.x[0] = m.twist[n][2]
    m.x[1], m.x[2], m.x[3] = to_axes(m, n, minus(m.rate[n], m.gravity[0]))
    planar.demand(m.block, m.nodes[n, BODY], m.x, 0, m.x, _WRENCH)
    if m.nodes[n, KIND] == SHAPES:
        _demand_of_shapes(m, n)


@if_stiffness(None)
@njit(**OPTIONS)
def _demand_of_shapes(m, n):
    own, i, x = m.nodes[n, BODY] + RIGID_PLANAR, m.nodes[n, SPEED], m.x
    planar_shapes.shaped_demand(m.block, own, m.nodes[n, COUNT], x, 0, m.y, m.u, m.du, i, x, _WRENCH, m.h)


@njit(**OPTIONS)
def _own_demand_in_space(m, n):
    rate = m.rate[n]
    e, w = to_axes(m, n, last(rate)), to_axes(m, n, last(m.twist[n]))
    m.x3[0], m.x3[1], m.x3[2] = w, to_axes(m, n, minus(first(rate), m.gravity[0])), e
    spatial.demand(m.block, m.nodes[n, BODY], m.x, 0, m.x, _WRENCH)
    if m.nodes[n, KIND] == SHAPES:
        _demand_of_shapes_in_space(m, n)


@if_stiffness(None)
@njit(**OPTIONS)
def _demand_of_shapes_in_space(m, n):
    own, i, x = m.nodes[n, BODY] + RIGID, m.nodes[n, SPEED], m.x
    spatial_shapes.shaped_demand(m.block, own, m.nodes[n, COUNT], x, 0, m.y, m.u, m.du, i, x, _WRENCH, m.h, x, 15)


_own_demand = by_size(_own_demand, _own_demand_in_space)


@once
@njit(**OPTIONS)
def demand(m, t):
    """Residual of the equations of motion along every coordinate of the tree, h, and the joints' wrenches.

    The bodies' inertia forces less loads, springs and reactions of the cuts are summed inwards.
    """
    no_inline()
    for s in range(m.counts[SPEEDS]):
        m.h[s] = 0.0
    for n in range(m.counts[NODES]):
        m.wrenches[n] = demand_of_body(m, n) if m.nodes[n, BODY] >= 0 else zero_like(m.wrenches[n])
    apply_interactions(m, t)
    apply_reactions(m)
    gather(m, m.wrenches, m.h)


@njit(**OPTIONS)
def gather(m, felt, h):
    """Sum wrenches of the nodes inwards, in place, and add them along the speeds to h."""
    no_inline()
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
    no_inline()
    x, d = m.x, width(m)
    for b in range(m.counts[BODIES]):
        n, shapes = m.frames[b, 0], m.bodies[b, COUNTED]
        if m.nodes[n, BODY] >= 0:
            own_inertia(m, n)
        else:
            for i in range(d * d):
                x[i] = 0.0
        I, own = after(m.I, d * b), twists(m, x)
        for k in range(d):  # rows by global twists, then columns
            I[k] = to_global(m, n, own[k])
        _turn_rows(m, n, I)
        E = after(m.E, m.bodies[b, COUPLING])
        for j in range(shapes):
            E[j] = to_global(m, n, own[d + j])
        for j in range(shapes * shapes):
            m.L[m.bodies[b, SQUARE] + j] = x[d * (d + shapes) + j]


@njit(**OPTIONS)
def own_inertia(m, n):
    """Mass matrix of a node's body in its axes at x: (d, d), coupling to its shapes, and the shapes' own."""
    rigid_inertia(m, n)
    if m.nodes[n, KIND] == SHAPES:
        _inertia_of_shapes(m, n)


@njit(**OPTIONS)
def rigid_inertia(m, n):
    """Mass matrix of a node's body without shapes, in its axes at x, (d, d)."""
    planar.inertia(m.block, m.nodes[n, BODY], m.x, 0)


@njit(**OPTIONS)
def _rigid_inertia_in_space(m, n):
    spatial.inertia(m.block, m.nodes[n, BODY], m.x, 0)


@if_stiffness(None)
@njit(**OPTIONS)
def _inertia_of_shapes(m, n):
    _add_shapes(m, n, m.nodes[n, COUNT], m.nodes[n, SPEED])


@njit(**OPTIONS)
def _add_shapes(m, n, shapes, i):
    """Add the inertia of a body's shapes at x."""
    planar_shapes.shaped_inertia(m.block, m.nodes[n, BODY] + RIGID_PLANAR, shapes, m.y, i, m.x, 0)


@njit(**OPTIONS)
def _add_shapes_in_space(m, n, shapes, i):
    room = 36 + (6 + shapes) * shapes
    spatial_shapes.shaped_inertia(m.block, m.nodes[n, BODY] + RIGID, shapes, m.y, i, m.x, 0, m.x, room)


@njit(**OPTIONS)
def _turn_rows(m, n, I):
    """Rotate the columns of a matrix by global twists from a node's axes, in place."""
    c, s, _ = m.R[n]
    x, y = I[0], I[1]
    I[0], I[1] = axpy(-s, y, scaled(c, x)), axpy(s, x, scaled(c, y))


@njit(**OPTIONS)
def _turn_rows_in_space(m, n, I):
    for half in range(0, 6, 3):
        rows = I[half], I[half + 1], I[half + 2]
        for i in range(3):
            a, b, c = m.R[3 * n + i]
            I[half + i] = axpy(c, rows[2], axpy(b, rows[1], scaled(a, rows[0])))


rigid_inertia, _add_shapes = by_size(rigid_inertia, _rigid_inertia_in_space), by_size(_add_shapes, _add_shapes_in_space)
_turn_rows = by_size(_turn_rows, _turn_rows_in_space)


@njit(**OPTIONS)
def momenta(m, u, out):
    """Generalised momenta M u of all speeds, for the ``inertias`` and directions of the place of m; fills F."""
    no_inline()
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
    no_inline()
    inertias(m)
    for s in range(m.counts[SPEEDS]):
        unit[s] = 1.0
        momenta(m, unit, after(m.M, m.counts[SPEEDS] * s))
        unit[s] = 0.0
