"""A mechanism in space as a tree of :mod:`kaneflex.multibody.dynamics.articulated`, see :mod:`.planar_tree`.

The factors of a step belong to its middle, those of mass matrices to its stages: each have a geometry of their own,
which :func:`use` makes the current one.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.values import after, copy_vectors, twists, vectors
from kaneflex.multibody.dynamics.algebra import dot, force_at, joined, minus, plus, scaled, times, twist_at
from kaneflex.multibody.dynamics.articulated import transport
from kaneflex.multibody.dynamics.courses import leave_out
from kaneflex.multibody.dynamics.rotation_vectors import compose, spin
from kaneflex.multibody.dynamics.spatial_bushings import POWER
from kaneflex.multibody.dynamics.spatial_forces import inertias
from kaneflex.multibody.dynamics.spatial_kinematics import along, freedoms
from kaneflex.multibody.dynamics.spatial_work import (
    BALLS,
    BUSHINGS,
    FORCES,
    GEOMETRY,
    LOADS,
    NODES,
    PHI,
    SPRINGS,
    TORQUES,
    TWISTS,
)  # fmt: skip
from kaneflex.multibody.model import layout as of
from kaneflex.multibody.model.layout import IN_ORDER, OPTIONS, PARENT_BODY, apart, shifted
from kaneflex.multibody.model.spatial_layout import COUNT, KIND, OWNER, PARENT, ROW_OF, SPEED, STATION
from kaneflex.support.inner import once

POINTS, TWIST, ALONG_AXIS, ABOUT_AXIS = range(4)
"""Kinds of springs' rows: between two points, at a joint, of a bushing along or about one of its axes."""


@once
@njit(**OPTIONS)
def use(m, i):
    """Make the geometry of the middle of a step (0) or of one of its stages (1 to 3) that of the factors."""
    n, bodies, rows, phi = m.plan[of.COORDINATES], m.plan[of.BODIES], m.plan[of.REACTIONS], m.counts[PHI]
    first = m.counts[GEOMETRY] + i * (n * (6 + rows) + 6 * (phi + bodies))
    m.pivots[of.AXES], m.pivots[of.PHI] = first, first + 6 * n
    m.pivots[of.PLACES] = first + 6 * (n + phi)
    m.pivots[of.ARMS] = first + 6 * (n + phi) + 3 * bodies
    m.pivots[of.MIDDLE] = first + 6 * (n + phi + bodies)


@njit(**OPTIONS)
def assemble(m):
    """Inertias of all bodies, and the geometry in use, at the current position with its gradients of rows."""
    apart()
    w, n, pivots = m.w, m.plan[of.COORDINATES], m.pivots
    inertias(m)
    place, arm = vectors(shifted(w, pivots[of.PLACES])), vectors(shifted(w, pivots[of.ARMS]))
    for b in range(m.plan[of.BODIES]):
        node, on = m.frames[b, 2], m.frames[b, 1]
        if on >= 0:
            place[b] = minus(m.r[on], m.r[m.frames[m.bodies[b, PARENT_BODY], 2]])
            arm[b] = minus(m.r[node], m.r[on])
    S = twists(m, shifted(w, pivots[of.AXES]))
    for node in range(m.counts[NODES]):
        count = freedoms(m, node)
        if count:
            away = minus(m.r[m.frames[m.nodes[node, OWNER], 2]], m.r[node])
            for j in range(m.nodes[node, SPEED], m.nodes[node, SPEED] + count):
                S[j] = twist_at(m.S[j], away)
    phi = twists(m, shifted(w, pivots[of.PHI]))
    copy_vectors(m.phi, phi, m.counts[PHI])
    for node in range(m.counts[NODES]):
        up = m.nodes[node, PARENT]
        if m.nodes[node, KIND] == STATION and m.nodes[up, ROW_OF] >= 0:
            back, own = after(phi, m.nodes[up, ROW_OF]), after(phi, m.nodes[node, ROW_OF])
            for j in range(m.nodes[node, COUNT]):
                own[j] = plus(own[j], twist_at(back[j], minus(m.r[node], m.r[up])))
    for b in range(m.plan[of.BODIES]):
        if m.frames[b, 2] != m.frames[b, 0]:
            _move_inertia(m, b, after(phi, m.nodes[m.frames[b, 0], ROW_OF]))
    for k in range(n * m.plan[of.KEPT]):
        w[pivots[of.MIDDLE] + k] = w[m.plan[of.GRADIENT] + k]


@njit(**IN_ORDER)
def _move_inertia(m, b, back):
    """Move matrices I, E and L of a body from its axes to its joint's section; ``back``: the axes' twists by shapes,
    moved there, too."""
    apart()
    count, L = m.bodies[b, of.SHAPES], m.bodies[b, of.SQUARE]
    I, E = after(m.I, 6 * b), after(m.E, m.bodies[b, of.COUPLING])
    arm = minus(m.r[m.frames[b, 0]], m.r[m.frames[b, 2]])
    transport(I, arm)
    for j in range(count):
        E[j], back[j] = force_at(E[j], arm), twist_at(back[j], scaled(-1.0, arm))
    for j in range(count):
        moved = plus(E[j], times(I, back[j]))
        for l in range(j + 1):
            m.L[L + count * j + l] += dot(back[j], E[l]) + dot(moved, back[l])
    for j in range(count):
        E[j] = plus(E[j], times(I, back[j]))


@njit(**OPTIONS)
def stiffen(m, t, h):
    """Add h C + h^2 K of the shapes, and the virtual inertia of coordinates, to the tree's matrices."""
    apart()
    for k in range(m.plan[of.COORDINATES]):
        t.D[k] = m.virtual_inertia[k] + 0.0 * h
    last = m.plan[of.BODIES] - 1
    for k in range(m.bodies[last, of.SQUARE] + m.bodies[last, of.SHAPES] * m.bodies[last, of.SHAPES]):
        t.L[k] += h * (m.C[k] + h * m.K[k])


@njit(**OPTIONS)
def resist(m, h, x, A, answer):
    """Forces -(h C + h^2 K) x of the shapes for accelerations x, stored from ``answer`` on."""
    apart()
    for k in range(m.plan[of.COORDINATES]):
        A[answer + k] = 0.0 * h
    for b in range(m.plan[of.BODIES]):
        count, first, square = m.bodies[b, of.SHAPES], m.bodies[b, of.MODAL], m.bodies[b, of.SQUARE]
        for i in range(count):
            for j in range(count):
                at = square + count * i + j
                A[answer + first + i] -= h * (m.C[at] + h * m.K[at]) * x[first + j]


@njit(**OPTIONS)
def pull(m, t, r):
    """Add the generalised forces of a kept row's unit reaction, or a unit along a coordinate with virtual inertia."""
    plan = m.plan
    if r >= plan[of.KEPT]:
        t.y[m.pivots[plan[of.TOUCHING] + r - plan[of.KEPT]]] += 1.0
        return
    row = m.pivots[of.MIDDLE] + plan[of.COORDINATES] * r
    for k in range(plan[of.COORDINATES]):
        t.y[k] += m.w[row + k]


@njit(**OPTIONS)
def opening(m, t, r):
    """Rate of that row, or of that coordinate, by the rates of the coordinates."""
    plan = m.plan
    if r >= plan[of.KEPT]:
        return t.y[m.pivots[plan[of.TOUCHING] + r - plan[of.KEPT]]]
    row, total = m.pivots[of.MIDDLE] + plan[of.COORDINATES] * r, 0.0 * t.y[0]
    for k in range(plan[of.COORDINATES]):
        if t.free[k] != 0:
            total += m.w[row + k] * t.y[k]
    return total


@njit(**OPTIONS)
def soften(m, r, count, h, A, most):
    """Add the negative compliance of a row that removes virtual inertia."""
    plan = m.plan
    A[plan[of.SCHUR] + (count + 1) * r] -= 1.0 / m.virtual_inertia[m.pivots[plan[of.TOUCHING] + r - plan[of.KEPT]]]


@njit(**OPTIONS)
def gradient(m, row, cut, bends, out):
    """Add the derivatives of a cut's row by all coordinates at ``out``."""
    apart()
    along(m, m.acts[cut, of.AT], joined(m.rows[5 * row + 1], m.rows[5 * row + 2]), 1.0, after(m.w, out))
    along(m, m.acts[cut, of.ON], joined(m.rows[5 * row + 3], m.rows[5 * row + 4]), 1.0, after(m.w, out))


@once
@njit(**OPTIONS)
def _opposed(m, first, second, wrench, out):
    """Generalised forces of a wrench on the second section, and of the opposite one on the first."""
    apart()
    along(m, first, wrench, -1.0, out)
    along(m, second, wrench, 1.0, out)


@njit(**OPTIONS)
def _way_of_spring(m, act, out):
    """Derivatives of a spring's length or angle, or of one of a bushing's displacements, by all coordinates."""
    apart()
    what, n, i, nothing = m.acts[act, of.WHAT], m.acts[act, of.AT], m.acts[act, of.ON], (0.0, 0.0, 0.0)
    if what == POINTS:
        first, second = m.spring_ends[n, 0], m.spring_ends[n, 1]
        d = minus(m.sections[5 * second], m.sections[5 * first])
        length = math.sqrt(dot(d, d))
        if length > 0.0:
            _opposed(m, first, second, joined(scaled(1.0 / length, d), nothing), out)
    elif what == TWIST:
        _opposed(m, m.twist_ends[n, 0], m.twist_ends[n, 1], joined(nothing, m.axes[m.twist_ends[n, 2]]), out)
    else:
        axis, one, two = m.axes[m.bushing_ends[n, 2] + i], m.bushing_ends[n, 0], m.bushing_ends[n, 1]
        _opposed(m, one, two, joined(axis, nothing) if what == ALONG_AXIS else joined(nothing, axis), out)


@njit(**OPTIONS)
def fill_ways(m):
    """Gradients of joints' coordinates and springs, and partial velocities of loads, at the current position; of all
    but loads without prescribed coordinates."""
    apart()
    plan, n, nothing = m.plan, m.plan[of.COORDINATES], (0.0, 0.0, 0.0)
    for k in range(n * (plan[of.CONTACTS] - plan[of.DRIVES])):
        m.w[plan[of.WAYS] + k] = 0.0
    for act in range(plan[of.DRIVES], plan[of.LOADS]):
        node, out = m.acts[act, of.AT], plan[of.WAYS] + n * (act - plan[of.DRIVES])
        if node >= 0:
            m.w[out + m.nodes[node, SPEED]] = 1.0
            leave_out(m, out)
    ways = after(m.w, plan[of.WAYS] + n * (plan[of.LOADS] - plan[of.DRIVES]))
    for l in range(m.counts[FORCES]):
        along(m, m.forces[l, 0], joined(m.axes[m.forces[l, 1]], nothing), 1.0, after(ways, n * m.forces[l, 2]))
    for l in range(m.counts[TORQUES]):
        moment = joined(nothing, m.axes[m.torques[l, 2]])
        _opposed(m, m.torques[l, 0], m.torques[l, 1], moment, after(ways, n * m.torques[l, 3]))
    for act in range(plan[of.SPRINGS], plan[of.CONTACTS]):
        out = plan[of.WAYS] + n * (act - plan[of.DRIVES])
        _way_of_spring(m, act, after(m.w, out))
        leave_out(m, out)


@njit(**OPTIONS)
def losses(m, out):
    """Powers [W] at ``out``: dissipation, then of loads."""
    apart()
    w, lost = m.w, 0.0
    for b in range(m.plan[of.BODIES]):
        count, first, square = m.bodies[b, of.SHAPES], m.bodies[b, of.MODAL], m.bodies[b, of.SQUARE]
        for i in range(count):
            for j in range(count):
                lost += m.u[first + i] * m.C[square + count * i + j] * m.u[first + j]
    for n in range(m.counts[SPRINGS]):
        lost += m.springs[7 * n + 6]
    for n in range(m.counts[TWISTS]):
        lost += m.twists[4 * n + 3]
    for n in range(m.counts[BUSHINGS]):
        lost += m.bushings[9 * n + POWER]
    w[out] = lost
    for n in range(m.counts[LOADS]):
        w[out + 1 + n] = 0.0
    for n in range(m.counts[FORCES]):
        load = m.forces[n, 2]
        w[out + 1 + load] += m.sizes[load] * dot(m.axes[m.forces[n, 1]], m.sections[5 * m.forces[n, 0] + 1])
    for n in range(m.counts[TORQUES]):
        load, rate = m.torques[n, 3], minus(m.sections[5 * m.torques[n, 1] + 3], m.sections[5 * m.torques[n, 0] + 3])
        w[out + 1 + load] += m.sizes[load] * dot(m.axes[m.torques[n, 2]], rate)


@njit(**OPTIONS)
def rebase(m):
    """Make the current axes of balls those of their quaternions, where speeds are angular velocities in these axes;
    True if one has turned since."""
    apart()
    turned = False
    for n in range(m.counts[BALLS]):
        k, s = m.balls[n, 0], m.balls[n, 1]
        if m.y[s] != 0.0 or m.y[s + 1] != 0.0 or m.y[s + 2] != 0.0:
            turned = True
            omega, faster = spin(m, s)
            compose(m.q, k, m.y[s], m.y[s + 1], m.y[s + 2])
            for j in range(3):
                m.y[s + j], m.u[s + j], m.du[s + j] = 0.0, omega[j], faster[j]
    return turned


@njit(**OPTIONS)
def note_turns(m, i):
    """Store the angular accelerations of balls in stage i; False: one has turned too far in the step."""
    apart()
    for n in range(m.counts[BALLS]):
        s = m.balls[n, 1]
        if m.y[s] ** 2 + m.y[s + 1] ** 2 + m.y[s + 2] ** 2 > FARTHEST**2:
            return False
        faster = spin(m, s)[1]
        for j in range(3):
            m.alpha[m.plan[of.COORDINATES] * i + s + j] = faster[j]
    return True


@njit(**OPTIONS)
def settle(m):
    """Begin the next step where the axes of balls are those of their quaternions; the last step's accelerations, from
    which its first guess comes, are those in these axes."""
    rebase(m)
    n = m.plan[of.COORDINATES]
    for ball in range(m.counts[BALLS]):
        for i in range(3):
            for s in range(m.balls[ball, 1], m.balls[ball, 1] + 3):
                m.w[m.plan[of.LAST_A] + n * i + s] = m.alpha[n * i + s]


@njit(**OPTIONS)
def standing(m):
    """Number of entries of a row for the quaternions of balls."""
    return 4 * m.counts[BALLS]


@njit(**OPTIONS)
def stands(m, row):
    """Set the quaternions of balls from a row."""
    for k in range(4 * m.counts[BALLS]):
        m.q[m.balls[k // 4, 0] + k % 4] = row[k]


@njit(**OPTIONS)
def stored(m, row):
    """Store them in a row."""
    for k in range(4 * m.counts[BALLS]):
        row[k] = m.q[m.balls[k // 4, 0] + k % 4]


FARTHEST = 2.0
"""Largest rotation of a ball in a step [rad]: at a full turn its rotation vector is singular."""
