"""A mechanism in the plane as a tree of :mod:`kaneflex.multibody.dynamics.articulated`.

The origin of a body is its inboard section. So the shapes of a body whose frame moves against that section, as one
between its ends does, are described by the twists of the other sections from there.
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import body
from kaneflex.multibody.compile.values import copy, inside, vectors
from kaneflex.multibody.dynamics.algebra import axpy, dot, force_at, plus, scaled, times, twist_at
from kaneflex.multibody.dynamics.articulated import transport
from kaneflex.support.inner import once
from kaneflex.multibody.model.layout import (
    ACTS, ARMS, AXES, BLOCK, BODIES, CONTACTS, COORDINATES, COUPLING, COUPLINGS, CUT, CUT_ROWS, DAMPING, DOF, FIRST,
    FRAME, FRAME_SIZE, FREE, INBOARD, INERTIAS, IN_ORDER, JOINT, LAST, MASSES, MIDDLE, MIDDLE_CUT, MODAL, NUMBERS,
    OPTIONS, OWNER, PARENT, PHI, PHI_NOW, PHI_ROW, PLACES, POINT, PRISMATIC, REVOLUTE, ROW_SIZE, SEC, SECTION, SECTIONS,
    SHAPES, SQUARE, STIFFNESS, Y, apart, shifted, turned,
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
    """Matrices for the next factors at the current state: inertias of all bodies, twists of their sections, axes and
    places, rows of cuts."""
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
    copy(w, plan[SECTION], plan[MIDDLE], SEC * m.bodies[plan[BODIES] - 1, LAST])
    copy(w, plan[CUT], plan[MIDDLE_CUT], ROW_SIZE * (plan[CUT_ROWS] + plan[ACTS] - plan[CONTACTS]))


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


@njit(**OPTIONS)
def stiffen(m, t, h):
    """Add h C + h^2 K of shapes and joints to the tree's matrices."""
    apart()
    plan, damping, stiffness = m.plan, shifted(m.w, m.plan[DAMPING]), shifted(m.w, m.plan[STIFFNESS])
    for k in range(plan[COORDINATES]):
        t.D[k] = h * (damping[k] + h * stiffness[k])
    for b in range(plan[BODIES]):
        size, square, first = m.bodies[b, SHAPES], m.bodies[b, SQUARE], m.bodies[b, MODAL]
        for j in range(size):
            t.L[square + (size + 1) * j] += t.D[first + j]


@njit(**OPTIONS)
def resist(m, h, x, A, answer):
    """Forces -(h C + h^2 K) x of shapes and joints for accelerations x, stored from ``answer`` on."""
    plan, w = m.plan, m.w
    for k in range(plan[COORDINATES]):
        A[answer + k] = -h * (w[plan[DAMPING] + k] + h * w[plan[STIFFNESS] + k]) * x[k]


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


@once
@njit(**OPTIONS)
def along(m, n, wrench, bends, out):
    """Add the generalised forces of a section's wrench along all coordinates at ``out``; shapes only if requested.

    A force is passed inwards from body to body unchanged, its moment changes with the point.
    """
    apart()
    plan, w = m.plan, m.w
    x, z, turn = wrench
    while m.sections[n, OWNER] >= 0:
        b = m.sections[n, OWNER]
        inboard, first, kind = m.bodies[b, INBOARD], out + m.bodies[b, FIRST], m.bodies[b, JOINT]
        own, share = plan[SECTION] + SEC * inboard, w[m.sections[n, POINT]]
        arm = away(m, plan[SECTION], n, inboard, share)
        if bends and n != inboard:
            phi, i = vectors(shifted(w, plan[PHI_NOW] + 3 * m.sections[n, PHI_ROW])), out + m.bodies[b, MODAL]
            for j in range(m.bodies[b, SHAPES]):
                w[i + j] += dot(phi[j], (x, z, turn))
        x, z, turn = share * x, share * z, turn + arm[0] * z - arm[1] * x
        n = m.bodies[b, PARENT]
        up = plan[SECTION] + SEC * n
        if kind == REVOLUTE:
            w[first] += w[m.bodies[b, NUMBERS]] * turn
        elif kind == PRISMATIC:
            d_x, d_y = turned(w, w[up + 2], m.bodies[b, NUMBERS] + 2)
            w[first] += x * d_x + z * d_y
        elif kind == FREE:
            w[first] += x
            w[first + 1] += z
            w[first + 2] += turn
            return
        turn += (w[own] - w[up]) * z - (w[own + 1] - w[up + 1]) * x


@njit(**OPTIONS)
def bent(m):
    """Twists of all sections by shapes at the current state."""
    shape_twists(m, m.plan[PHI_NOW])
