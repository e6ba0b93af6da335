"""Compiled forces in space: inertia forces of the bodies less those of loads and springs.

Kane's equations of each free body (``kaneflex.generated.spatial``), summed inwards over the tree along its speeds:
M u' + h (Kane & Levinson 1985, ch. 4 and 6).
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody.compile.values import after, numbers_of
from kaneflex.multibody.dynamics.algebra import (
    axpy,
    dot,
    force_at,
    joined,
    minus,
    plus,
    scaled,
    times,
    turned,
    turned_back,
    twist_at,
)
from kaneflex.multibody.dynamics.forces import meet_switches, sizes_by_laws
from kaneflex.multibody.dynamics.spatial_bushings import FORCE, MOMENT, cushion
from kaneflex.multibody.dynamics.spatial_kinematics import freedoms, relative
from kaneflex.multibody.dynamics.spatial_work import (
    BODIES,
    BUSHINGS,
    CUTS,
    FORCES,
    LOADS,
    NODES,
    OBSERVED,
    SPEEDS,
    SPRINGS,
    TORQUES,
    TWISTS,
)  # fmt: skip
from kaneflex.multibody.model.layout import COUPLING, DRIVES, MODAL, OPTIONS, SIZE, SQUARE, X, apart
from kaneflex.multibody.model.layout import LOADS as ENGINE_LOADS
from kaneflex.multibody.model.layout import SHAPES as COUNTED
from kaneflex.multibody.model.spatial_layout import (
    BODY,
    COINCIDE,
    COUNT,
    FIRST,
    KIND,
    OWNER,
    PARENT,
    ROW,
    ROW_OF,
    SECOND,
    SHAPES,
    SPEED,
    WHAT,
)
from kaneflex.support.inner import once

_OWN = len(laws.BODY)
"""Numbers of a rigid body, which precede those of its shapes."""


@njit(**OPTIONS)
def load_sizes(m, t):
    """Magnitudes of the loads, which may depend on joint coordinates and their rates."""
    apart()
    plan, w = m.plan, m.w
    for i in range(m.counts[OBSERVED]):
        at, node = plan[X] + m.observed[i, 0], m.observed[i, 1]
        speed = m.nodes[node, SPEED]
        w[at], w[at + 1] = m.y[speed], m.u[speed]
        w[plan[X] + 2 * (plan[ENGINE_LOADS] - plan[DRIVES]) + m.observed[i, 0] // 2] = m.du[speed]
    sizes_by_laws(m, t)
    for i in range(m.counts[LOADS]):
        m.sizes[i] = w[plan[SIZE] + i]


@once
@njit(**OPTIONS)
def demand(m, t):
    """Residual of the equations of motion along every coordinate of the tree, h, and the joints' wrenches.

    The bodies' inertia forces less loads, springs and reactions of the cuts, F, are summed inwards.
    """
    apart()
    x = m.x
    load_sizes(m, t)
    meet_switches(m)
    for s in range(m.counts[SPEEDS]):
        m.h[s] = 0.0
    for n in range(m.counts[NODES]):
        own = m.nodes[n, BODY]
        m.F[n] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if own < 0:
            continue
        w, e = turned_back(m.R, 3 * n, m.omega[n]), turned_back(m.R, 3 * n, m.e[n])
        a = turned_back(m.R, 3 * n, minus(m.a[n], m.gravity[0]))
        m.x3[0], m.x3[1], m.x3[2] = w, a, e
        laws.demand(m.block, own, x, 0, x, 9)
        if m.nodes[n, KIND] == SHAPES:
            u, shapes = m.nodes[n, SPEED], m.nodes[n, COUNT]
            shape_laws.shaped_demand(m.block, own + _OWN, shapes, x, 0, m.y, u, m.u, u, m.du, x, 9, m.h, u, x, 15)
        m.F[n] = joined(turned(m.R, 3 * n, m.x3[3]), turned(m.R, 3 * n, m.x3[4]))
    _act(m)
    react(m)
    pass_on(m)


@njit(**OPTIONS)
def react(m):
    """Subtract the reactions of the cuts from the bodies' inertia forces."""
    apart()
    for c in range(m.counts[CUTS]):
        for j in range(m.cuts[c, ROW], m.cuts[c, ROW] + (3 if m.cuts[c, WHAT] == COINCIDE else 1)):
            push(m, m.cuts[c, FIRST], joined(m.rows[5 * j + 1], m.rows[5 * j + 2]), m.multipliers[j])
            push(m, m.cuts[c, SECOND], joined(m.rows[5 * j + 3], m.rows[5 * j + 4]), m.multipliers[j])


@njit(**OPTIONS)
def pass_on(m):
    """Wrenches of the joints, from the bodies' residuals F."""
    apart()
    for n in range(m.counts[NODES]):
        m.wrenches[n] = m.F[n]
    gather(m, m.wrenches, m.h)


@njit(**OPTIONS)
def gather(m, felt, h):
    """Sum wrenches of the nodes inwards, in place, and add them along the speeds to h."""
    apart()
    for n in range(m.counts[NODES] - 1, -1, -1):
        wrench, s, parent = felt[n], m.nodes[n, SPEED], m.nodes[n, PARENT]
        for j in range(s, s + freedoms(m, n)):
            h[j] += dot(wrench, m.S[j])
        if m.nodes[n, ROW_OF] >= 0:
            for j in range(m.nodes[n, COUNT]):
                h[s + j] += dot(wrench, m.phi[m.nodes[n, ROW_OF] + j])
        if parent >= 0:
            felt[parent] = plus(felt[parent], force_at(wrench, minus(m.r[n], m.r[parent])))


@njit(**OPTIONS)
def _own_inertia(m, n):
    """Mass matrix of a node's body in its axes at x: (6, 6), coupling to its shapes, and the shapes' own."""
    if m.nodes[n, BODY] < 0:
        for i in range(36):
            m.x[i] = 0.0
        return
    laws.inertia(m.block, m.nodes[n, BODY], m.x, 0)
    if m.nodes[n, KIND] == SHAPES:
        shapes, q = m.nodes[n, COUNT], m.nodes[n, SPEED]
        room = 36 + (6 + shapes) * shapes
        shape_laws.shaped_inertia(m.block, m.nodes[n, BODY] + _OWN, shapes, m.y, q, m.x, 0, m.x, room)


@njit(**OPTIONS)
def inertias(m):
    """Inertias of all bodies, their coupling to shapes, and the shapes' own, by global twists."""
    apart()
    x = m.x
    for b in range(m.counts[BODIES]):
        n, shapes = m.frames[b, 0], m.bodies[b, COUNTED]
        _own_inertia(m, n)
        I, R = after(m.I, 6 * b), 3 * n
        for k in range(6):  # rows by global twists, then columns
            I[k] = joined(turned(m.R, R, m.x3[2 * k]), turned(m.R, R, m.x3[2 * k + 1]))
        for half in range(0, 6, 3):
            rows = I[half], I[half + 1], I[half + 2]
            for i in range(3):
                a, b_, c = m.R[R + i]
                I[half + i] = axpy(c, rows[2], axpy(b_, rows[1], scaled(a, rows[0])))
        E, at = after(m.E, m.bodies[b, COUPLING]), 36
        for j in range(shapes):
            force = x[at + j], x[at + shapes + j], x[at + 2 * shapes + j]
            moment = x[at + 3 * shapes + j], x[at + 4 * shapes + j], x[at + 5 * shapes + j]
            E[j] = joined(turned(m.R, R, force), turned(m.R, R, moment))
        for j in range(shapes * shapes):
            m.L[m.bodies[b, SQUARE] + j] = x[36 + 6 * shapes + j]


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
            m.F[n] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            continue
        momentum, E, shapes = times(after(m.I, 6 * b), twist), after(m.E, m.bodies[b, COUPLING]), m.bodies[b, COUNTED]
        s, L = m.bodies[b, MODAL], after(m.L, m.bodies[b, SQUARE])
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


@njit(**OPTIONS)
def deforming(m):
    """Contributions of shapes to energies and dissipated power, after ``accelerate``."""
    apart()
    x = m.x
    for i in range(4):
        m.deforming[i] = 0.0
    for n in range(m.counts[NODES]):
        if m.nodes[n, KIND] != SHAPES:
            continue
        shapes, u = m.nodes[n, COUNT], m.nodes[n, SPEED]
        weight = turned_back(m.R, 3 * n, m.gravity[0])
        m.x3[0], m.x3[1], m.x3[2] = turned_back(m.R, 3 * n, m.v[n]), turned_back(m.R, 3 * n, m.omega[n]), weight
        m.x3[3] = m.x3[4] = 0.0, 0.0, 0.0
        shape_laws.shaped_energy(m.block, m.nodes[n, BODY] + _OWN, shapes, x, 0, m.y, u, m.u, u, x, 9)
        m.deforming[0] += x[9]
        m.deforming[1] += x[10]
        m.deforming[2] -= dot(weight, m.x3[4])
        m.deforming[3] += x[11]


@once
@njit(**OPTIONS)
def push(m, section, wrench, share):
    """Subtract a force and a moment at a section, times ``share``, from the inertia forces of its body."""
    apart()
    on = m.on[section]
    if on >= 0:
        m.F[on] = axpy(-share, force_at(wrench, minus(m.sections[5 * section], m.r[on])), m.F[on])


@njit(**OPTIONS)
def _act(m):
    """Subtract loads and springs from the bodies' inertia forces."""
    apart()
    sections, nothing = m.sections, (0.0, 0.0, 0.0)
    for n in range(m.counts[FORCES]):
        push(m, m.forces[n, 0], joined(m.axes[m.forces[n, 1]], nothing), m.sizes[m.forces[n, 2]])
    for n in range(m.counts[SPRINGS]):
        k, c, free = m.stiffness[n]
        at = 7 * n
        laws.pull(numbers_of(sections), m.spring_ends[n, 0], m.spring_ends[n, 1], k, c, free, m.springs, at)
        wrench = m.springs[at + 2], m.springs[at + 3], m.springs[at + 4], 0.0, 0.0, 0.0
        push(m, m.spring_ends[n, 1], wrench, 1.0)
        push(m, m.spring_ends[n, 0], wrench, -1.0)
    for n in range(m.counts[TORQUES]):
        moment, size = joined(nothing, m.axes[m.torques[n, 2]]), m.sizes[m.torques[n, 3]]
        push(m, m.torques[n, 1], moment, size)
        push(m, m.torques[n, 0], moment, -size)
    for n in range(m.counts[TWISTS]):
        k, c, free = m.torsion[n]
        one, two = m.twist_ends[n, 0], m.twist_ends[n, 1]
        axis, at = m.axes[m.twist_ends[n, 2]], 4 * n
        angle, rate = m.twists[at] - free, dot(axis, minus(sections[5 * two + 3], sections[5 * one + 3]))
        torque = k * angle + c * rate
        m.twists[at + 1], m.twists[at + 2], m.twists[at + 3] = torque, 0.5 * k * angle**2, c * rate**2
        push(m, two, joined(nothing, axis), -torque)
        push(m, one, joined(nothing, axis), torque)
    for n in range(m.counts[BUSHINGS]):
        cushion(m, n)
        one, two, at, axes = m.bushing_ends[n, 0], m.bushing_ends[n, 1], 9 * n, m.bushing_ends[n, 2]
        force = about = nothing
        for j in range(3):
            force = axpy(m.bushings[at + FORCE + j], m.axes[axes + j], force)
            about = axpy(m.bushings[at + MOMENT + j], m.axes[axes + j], about)
        wrench = joined(force, about)
        push(m, two, wrench, -1.0)
        push(m, one, force_at(wrench, minus(sections[5 * two], sections[5 * one])), 1.0)
