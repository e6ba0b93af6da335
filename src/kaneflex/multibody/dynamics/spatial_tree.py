"""A mechanism in space as a tree of :mod:`kaneflex.multibody.dynamics.articulated`, see :mod:`.planar_tree`.

The factors of a step belong to its middle, those of mass matrices to its stages: each have a geometry of their own,
which :func:`use` makes the current one.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.stand_ins import of_stiffness
from kaneflex.multibody.compile.values import after, copy_vectors, twists, vectors
from kaneflex.multibody.dynamics.algebra import dot, force_at, minus, plus, scaled, times, twist_at
from kaneflex.multibody.dynamics.articulated import transport
from kaneflex.multibody.dynamics.rotation_vectors import compose, spin
from kaneflex.multibody.dynamics.spatial_forces import inertias
from kaneflex.multibody.dynamics.spatial_kinematics import freedoms
from kaneflex.multibody.dynamics.spatial_work import BALLS, GEOMETRY, NODES, PHI
from kaneflex.multibody.model import layout as of
from kaneflex.multibody.model.layout import IN_ORDER, OPTIONS, PARENT_BODY, apart, shifted
from kaneflex.multibody.model.spatial_layout import COUNT, KIND, OWNER, PARENT, ROW_OF, SPEED, STATION
from kaneflex.support.inner import once


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


@of_stiffness(None)
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
    damping = m.plan[of.DAMPED]
    for k in range(m.plan[of.COORDINATES]):
        t.D[k] = m.virtual_inertia[k] + 0.0 * h
    last = m.plan[of.BODIES] - 1
    for k in range(m.bodies[last, of.SQUARE] + m.bodies[last, of.SHAPES] * m.bodies[last, of.SHAPES]):
        t.L[k] += h * (m.w[damping + k] + h * m.K[k])


@njit(**OPTIONS)
def resist(m, h, x, A, answer):
    """Forces -(h C + h^2 K) x of the shapes for accelerations x, stored from ``answer`` on."""
    apart()
    damping = m.plan[of.DAMPED]
    for k in range(m.plan[of.COORDINATES]):
        A[answer + k] = 0.0 * h
    for b in range(m.plan[of.BODIES]):
        count, first, square = m.bodies[b, of.SHAPES], m.bodies[b, of.MODAL], m.bodies[b, of.SQUARE]
        for i in range(count):
            for j in range(count):
                at = square + count * i + j
                A[answer + first + i] -= h * (m.w[damping + at] + h * m.K[at]) * x[first + j]


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
