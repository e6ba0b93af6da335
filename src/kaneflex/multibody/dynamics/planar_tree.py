"""A mechanism in the plane as a tree of :mod:`kaneflex.multibody.dynamics.articulated`.

The origin of a body is its inboard section. So the shapes of a body whose frame moves against that section, as one
between its ends does, are described by the twists of the other sections from there.
"""

from __future__ import annotations

from collections import namedtuple

from numba import njit

from kaneflex.generated import body
from kaneflex.multibody.compile.values import copy_vectors, inside, vectors
from kaneflex.multibody.dynamics.algebra import axpy, dot, force_at, plus, scaled, times, twist_at
from kaneflex.multibody.dynamics.articulated import transport
from kaneflex.multibody.model.layout import (
    ARMS, AXES, BLOCK, BODIES, COORDINATES, COUPLING, COUPLINGS, DAMPING, DOF, FIRST, FRAME, FRAME_SIZE, FREED,
    IN_ORDER, INBOARD, INERTIAS, JOINT, LAST, MASSES, MIDDLE, MODAL, NUMBERS, OPTIONS, OWNER, PARENT, PHI, PHI_ROW,
    PLACES, POINT, PRISMATIC, REVOLUTE, SEC, SECTION, SECTIONS, SHAPES, SQUARE, STIFFNESS, TREE_D, TREE_E, TREE_I,
    TREE_L, TREE_ROOM, TREE_U, TREE_X, Y, apart, shifted, turned,
)  # fmt: skip

Tree = namedtuple("Tree", "counts bodies free I E L U D S phi place arm x y room")


@njit(**OPTIONS)
def tree(m, A, y):
    """Arrays of the tree in factors A, with the coordinates from y on."""
    inside()
    plan, w = m.plan, m.w
    return Tree(
        plan, m.bodies, shifted(plan, plan[FREED]), vectors(shifted(A, plan[TREE_I])),
        vectors(shifted(A, plan[TREE_E])), shifted(A, plan[TREE_L]), vectors(shifted(A, plan[TREE_U])),
        shifted(A, plan[TREE_D]), vectors(shifted(w, plan[AXES])), vectors(shifted(w, plan[PHI])),
        vectors(shifted(w, plan[PLACES])), vectors(shifted(w, plan[ARMS])), vectors(shifted(A, plan[TREE_X])),
        shifted(A, y), vectors(shifted(A, plan[TREE_ROOM])),
    )  # fmt: skip


@njit(**OPTIONS)
def _by_frame(m, b, n, place):
    """Twists of a section for a unit of each shape of its body, with the frame fixed, stored from ``place`` on."""
    f = m.plan[FRAME] + FRAME_SIZE * b
    body.twists(
        m.w, m.sections[n, POINT], m.w, m.plan[Y] + m.bodies[b, MODAL], m.w[f + 3], m.w[f + 4], m.w, place
    )  # fmt: skip


@njit(**OPTIONS)
def shape_twists(m, place):
    """Twists of all sections for a unit of each shape at the current state, stored from ``place`` on.

    Those of an inboard section have the frame fixed, all others the inboard section.
    """
    apart()
    plan, w = m.plan, m.w
    for b in range(plan[BODIES]):
        count, inboard = m.bodies[b, SHAPES], m.bodies[b, INBOARD]
        if count == 0:
            continue
        held = vectors(shifted(w, place + 3 * m.sections[inboard, PHI_ROW]))
        _by_frame(m, b, inboard, place + 3 * m.sections[inboard, PHI_ROW])
        for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
            if n != inboard:
                of, share = vectors(shifted(w, place + 3 * m.sections[n, PHI_ROW])), w[m.sections[n, POINT]]
                _by_frame(m, b, n, place + 3 * m.sections[n, PHI_ROW])
                arm = away(m, plan[SECTION], n, inboard, share)
                for j in range(count):
                    x, z, turn = held[j]
                    of[j] = axpy(-1.0, twist_at((share * x, share * z, turn), arm), of[j])


@njit(**OPTIONS)
def away(m, sections, n, inboard, share):
    """Vector from an inboard section, or from a share of its place, to the n-th section."""
    inside()
    here, there = sections + SEC * inboard, sections + SEC * n
    return m.w[there] - share * m.w[here], m.w[there + 1] - share * m.w[here + 1], 0.0


@njit(**OPTIONS)
def assemble(m):
    """Inertias of all bodies, twists of their sections, axes and places, at the current state."""
    apart()
    plan, w = m.plan, m.w
    shape_twists(m, plan[PHI])
    for b in range(plan[BODIES]):
        f, own, up = plan[FRAME] + FRAME_SIZE * b, m.bodies[b, INBOARD], m.bodies[b, PARENT]
        body.inertia(
            w, m.bodies[b, BLOCK], w, plan[Y] + m.bodies[b, MODAL], w[f + 3], w[f + 4], w, plan[INERTIAS] + 9 * b,
            plan[COUPLINGS] + 3 * m.bodies[b, COUPLING], plan[MASSES] + m.bodies[b, SQUARE],
        )  # fmt: skip
        _shift_inertia(m, b)
        on = m.sections[up, OWNER]
        base = m.bodies[on, INBOARD] if on >= 0 else up
        vectors(shifted(w, plan[PLACES]))[b] = away(m, plan[SECTION], up, base, 1.0)
        vectors(shifted(w, plan[ARMS]))[b] = away(m, plan[SECTION], own, up, 1.0)
        S = vectors(shifted(w, plan[AXES] + 3 * m.bodies[b, FIRST]))
        if m.bodies[b, JOINT] == REVOLUTE:
            S[0] = 0.0, 0.0, w[m.bodies[b, NUMBERS]]
        elif m.bodies[b, JOINT] == PRISMATIC:
            d_x, d_y = turned(w, w[plan[SECTION] + SEC * up + 2], m.bodies[b, NUMBERS] + 2)
            S[0] = d_x, d_y, 0.0
        elif m.bodies[b, DOF] == 3:
            S[0] = 1.0, 0.0, 0.0
            S[1] = 0.0, 1.0, 0.0
            S[2] = 0.0, 0.0, 1.0


@njit(**IN_ORDER)
def _shift_inertia(m, b):
    """Move matrices I, E and L of a body from its frame to its inboard section."""
    apart()
    plan, w, count = m.plan, m.w, m.bodies[b, SHAPES]
    f, own = plan[FRAME] + FRAME_SIZE * b, m.bodies[b, INBOARD]
    at = plan[SECTION] + SEC * own
    arm = w[f] - w[at], w[f + 1] - w[at + 1], 0.0
    I, L = vectors(shifted(w, plan[INERTIAS] + 9 * b)), shifted(w, plan[MASSES] + m.bodies[b, SQUARE])
    E = vectors(shifted(w, plan[COUPLINGS] + 3 * m.bodies[b, COUPLING]))
    phi = vectors(shifted(w, plan[PHI] + 3 * m.sections[own, PHI_ROW]))
    transport(I, arm)
    for j in range(count):
        E[j] = force_at(E[j], arm)
    for j in range(count):
        moved = axpy(-1.0, times(I, phi[j]), E[j])
        for l in range(j + 1):
            L[count * j + l] -= dot(phi[j], E[l]) + dot(moved, phi[l])
    for j in range(count):
        E[j] = axpy(-1.0, times(I, phi[j]), E[j])


@njit(**IN_ORDER)
def fill(m, t, h):
    """Fill the tree's matrices with those of M + h C + h^2 K at the middle of the step."""
    apart()
    plan, w = m.plan, m.w
    count, n = plan[BODIES], plan[COORDINATES]
    last = count - 1
    copy_vectors(vectors(shifted(w, plan[INERTIAS])), t.I, 3 * count)
    copy_vectors(vectors(shifted(w, plan[COUPLINGS])), t.E, m.bodies[last, COUPLING] + m.bodies[last, SHAPES])
    masses, damping, stiffness = shifted(w, plan[MASSES]), shifted(w, plan[DAMPING]), shifted(w, plan[STIFFNESS])
    for k in range(m.bodies[last, SQUARE] + m.bodies[last, SHAPES] * m.bodies[last, SHAPES]):
        t.L[k] = masses[k]
    for k in range(n):
        t.D[k] = h * (damping[k] + h * stiffness[k])
    for b in range(count):
        size, square, first = m.bodies[b, SHAPES], m.bodies[b, SQUARE], m.bodies[b, MODAL]
        for j in range(size):
            t.L[square + (size + 1) * j] += t.D[first + j]


@njit(**OPTIONS)
def clear(m, t):
    """Set all forces of the tree to zero."""
    apart()
    nothing = 0.0 * t.y[0]
    for k in range(m.plan[COORDINATES]):
        t.y[k] = nothing
    for b in range(m.plan[BODIES]):
        t.x[b] = nothing, nothing, nothing


@njit(**OPTIONS)
def twist_of(m, t, n):
    """Twist of a section from the rates of bodies and coordinates."""
    apart()
    b = m.sections[n, OWNER]
    if b < 0:
        return scaled(0.0, t.x[0])
    inboard, twist = m.bodies[b, INBOARD], t.x[b]
    if n != inboard:
        phi, first = m.sections[n, PHI_ROW], m.bodies[b, MODAL]
        twist = twist_at(twist, away(m, m.plan[MIDDLE], n, inboard, 1.0))
        for j in range(m.bodies[b, SHAPES]):
            twist = axpy(t.y[first + j], t.phi[phi + j], twist)
    return twist


@njit(**OPTIONS)
def add_force(m, t, n, force):
    """Add a section's force and moment to the forces of its body and shapes."""
    apart()
    b = m.sections[n, OWNER]
    if b < 0:
        return
    inboard = m.bodies[b, INBOARD]
    if n != inboard:
        phi, first = m.sections[n, PHI_ROW], m.bodies[b, MODAL]
        for j in range(m.bodies[b, SHAPES]):
            t.y[first + j] += dot(t.phi[phi + j], force)
        force = force_at(force, away(m, m.plan[MIDDLE], n, inboard, 1.0))
    t.x[b] = plus(t.x[b], force)
