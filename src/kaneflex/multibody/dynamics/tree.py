"""Tables of a mechanism as the tree of :mod:`kaneflex.multibody.dynamics.articulated`, in the plane and in space.

The origin of a body is the node at its joint: its section there where shapes move its axes against that, else its axes.

In space, the factors of a step belong to its middle, those of mass matrices to its stages: each have a geometry of
their own, which :func:`use_geometry` makes the current one.
"""

from __future__ import annotations

from collections import namedtuple

from numba import njit

from kaneflex.multibody.compile.stand_ins import if_stiffness
from kaneflex.multibody.compile.types import IN_ORDER, OPTIONS, no_inline, shifted
from kaneflex.multibody.compile.values import after, copy, inline, row_length, twists, vectors, width
from kaneflex.multibody.dynamics.algebra import axpy, dot, force_at, minus, plus, scaled, times, twist_at, zero_like
from kaneflex.multibody.dynamics.arrays import GEOMETRY, NODES, SECTIONS
from kaneflex.multibody.dynamics.arrays import PHI as ROWS
from kaneflex.multibody.dynamics.articulated import transport
from kaneflex.multibody.dynamics.axes import base, freedoms, to_global
from kaneflex.multibody.dynamics.inverse_dynamics import inertias
from kaneflex.multibody.dynamics.kinematics import section_place
from kaneflex.multibody.model import layout as of
from kaneflex.multibody.model.layout import (
    ARMS,
    AXES,
    BODIES,
    COORDINATES,
    COUPLING,
    FREED,
    MIDDLE,
    MODAL,
    PARENT_BODY,
    PHI,
    PLACES,
    SHAPES,
    SQUARE,
    TREE_D,
    TREE_E,
    TREE_I,
    TREE_L,
    TREE_U,
    TREE_WORK,
    TREE_X,
)
from kaneflex.multibody.model.tree_layout import COUNT, KIND, OWNER, ROW_OF, SPEED, STATION
from kaneflex.support.inner import once

Tree = namedtuple("Tree", "counts bodies free I E L U D S phi place arm x y room")


@njit(**OPTIONS)
def place_of(m, what):
    """Place in ``w`` of the geometry at which the current factors were made."""
    inline()
    if width(m) == 6:
        return m.pivots[what]
    return m.plan[what]


@njit(**OPTIONS)
def _row_numbers(m):
    """Count of the numbers of all rows: of cuts, frictions, contacts and switches."""
    return row_length(m) * (m.plan[of.CUT_ROWS] + m.plan[of.ACTS] - m.plan[of.CONTACTS])


@once
@njit(**OPTIONS)
def use_geometry(m, i):
    """Make the geometry of the middle of a step (0) or of one of its stages (1 to 3) that of the factors; the plane has
    only one."""
    if width(m) == 3:
        return
    n, bodies, phi, sections = m.plan[COORDINATES], m.plan[BODIES], m.counts[ROWS], 6 * m.counts[SECTIONS]
    first = m.counts[GEOMETRY] + i * (6 * (n + phi + bodies) + sections + _row_numbers(m))
    m.pivots[AXES], m.pivots[PHI] = first, first + 6 * n
    m.pivots[PLACES] = first + 6 * (n + phi)
    m.pivots[ARMS] = first + 6 * (n + phi) + 3 * bodies
    m.pivots[MIDDLE] = first + 6 * (n + phi + bodies)
    m.pivots[of.MIDDLE_CUT] = first + 6 * (n + phi + bodies) + sections


@njit(**OPTIONS)
def assemble(m):
    """Inertias of all bodies, and the geometry in use, at the current position."""
    no_inline()
    inertias(m)
    place, arm = vectors(shifted(m.w, place_of(m, PLACES))), vectors(shifted(m.w, place_of(m, ARMS)))
    for b in range(m.plan[BODIES]):
        node, on = m.frames[b, 2], m.frames[b, 1]
        if on >= 0:
            place[b] = minus(m.r[on], m.r[m.frames[m.bodies[b, PARENT_BODY], 2]])
            arm[b] = minus(m.r[node], m.r[on])
    S = twists(m, shifted(m.w, place_of(m, AXES)))
    for node in range(m.counts[NODES]):
        count = freedoms(m, node)
        if count:
            away = minus(m.r[m.frames[m.nodes[node, OWNER], 2]], m.r[node])
            for j in range(m.nodes[node, SPEED], m.nodes[node, SPEED] + count):
                S[j] = twist_at(m.S[j], away)
    phi = twists(m, shifted(m.w, place_of(m, PHI)))
    for node in range(m.counts[NODES]):
        if m.nodes[node, ROW_OF] >= 0:
            _turn_shapes(m, node, phi)
    for b in range(m.plan[BODIES]):
        if m.frames[b, 2] != m.frames[b, 0]:
            _move_inertia(m, b, after(phi, m.nodes[m.frames[b, 0], ROW_OF]))
    keep_rows(m)


@if_stiffness(None)
@njit(**OPTIONS)
def _turn_shapes(m, node, phi):
    """Global twists of a section by shapes, relative to its body's node at the joint."""
    no_inline()
    on = base(m, node)
    own, out = after(m.phi, m.nodes[node, ROW_OF]), after(phi, m.nodes[node, ROW_OF])
    for j in range(m.nodes[node, COUNT]):
        out[j] = to_global(m, on, own[j])
    if m.nodes[node, KIND] == STATION and m.nodes[on, ROW_OF] >= 0:
        back, away = after(phi, m.nodes[on, ROW_OF]), minus(m.r[node], m.r[on])
        for j in range(m.nodes[node, COUNT]):
            out[j] = plus(out[j], twist_at(back[j], away))


@if_stiffness(None)
@njit(**IN_ORDER)
def _move_inertia(m, b, back):
    """Move matrices I, E and L of a body from its axes to its joint's section; ``back``: the axes' twists by shapes,
    moved there, too."""
    no_inline()
    count, L = m.bodies[b, SHAPES], m.bodies[b, SQUARE]
    I, E = after(m.I, width(m) * b), after(m.E, m.bodies[b, COUPLING])
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
def keep_rows(m):
    """Rows of cuts and contacts for the factors: their Jacobians, and the sections' places from their bodies' nodes and
    from their own."""
    no_inline()
    arms = vectors(shifted(m.w, place_of(m, MIDDLE)))
    for n in range(m.counts[SECTIONS]):
        on = m.on[n]
        if on >= 0:
            arms[2 * n] = minus(section_place(m, n), m.r[m.frames[m.nodes[on, OWNER], 2]])
            arms[2 * n + 1] = minus(section_place(m, n), m.r[on])
    copy(m.rows, shifted(m.w, place_of(m, of.MIDDLE_CUT)), _row_numbers(m))


@njit(**OPTIONS)
def tree_arrays(m, A, y):
    """Arrays of the tree in factors A, with the coordinates from y on."""
    inline()
    plan, w = m.plan, m.w
    return Tree(
        plan, m.bodies, shifted(plan, plan[FREED]), twists(m, shifted(A, plan[TREE_I])),
        twists(m, shifted(A, plan[TREE_E])), shifted(A, plan[TREE_L]), twists(m, shifted(A, plan[TREE_U])),
        shifted(A, plan[TREE_D]), twists(m, shifted(w, place_of(m, AXES))), twists(m, shifted(w, place_of(m, PHI))),
        vectors(shifted(w, place_of(m, PLACES))), vectors(shifted(w, place_of(m, ARMS))),
        twists(m, shifted(A, plan[TREE_X])), shifted(A, y), twists(m, shifted(A, plan[TREE_WORK])),
    )  # fmt: skip


@njit(**IN_ORDER)
def fill_matrices(m, t, h):
    """Fill the tree's matrices with those of M + h C + h^2 K at the middle of the step."""
    no_inline()
    plan = m.plan
    last = plan[BODIES] - 1
    copy(m.I, t.I, width(m) * plan[BODIES])
    copy(m.E, t.E, m.bodies[last, COUPLING] + m.bodies[last, SHAPES])
    for k in range(m.bodies[last, SQUARE] + m.bodies[last, SHAPES] * m.bodies[last, SHAPES]):
        t.L[k] = m.L[k] + h * (m.C[k] + h * m.K[k])
    _fill_joints(m, t, h)


@njit(**OPTIONS)
def _fill_joints(m, t, h):
    """Fill D with h C + h^2 K of springs at joints, and with virtual inertia, which shapes have on their diagonals."""
    no_inline()
    plan = m.plan
    for k in range(plan[COORDINATES]):
        t.D[k] = m.virtual_inertia[k] + h * (m.joint_damping[k] + h * m.joint_stiffness[k])
    for b in range(plan[BODIES]):
        size, square, first = m.bodies[b, SHAPES], m.bodies[b, SQUARE], m.bodies[b, MODAL]
        for j in range(size):
            t.L[square + (size + 1) * j] += t.D[first + j]


@njit(**OPTIONS)
def resist(m, h, x, A, answer):
    """Forces -(h C + h^2 K) x of shapes and joints' springs for accelerations x, stored from ``answer`` on."""
    no_inline()
    for k in range(m.plan[COORDINATES]):
        A[answer + k] = -h * (m.joint_damping[k] + h * m.joint_stiffness[k]) * x[k]
    for b in range(m.plan[BODIES]):
        count, first, square = m.bodies[b, SHAPES], m.bodies[b, MODAL], m.bodies[b, SQUARE]
        for i in range(count):
            for j in range(count):
                at = square + count * i + j
                A[answer + first + i] -= h * (m.C[at] + h * m.K[at]) * x[first + j]


@njit(**OPTIONS)
def clear_forces(m, t):
    """Set all forces of the tree to zero."""
    no_inline()
    for k in range(m.plan[COORDINATES]):
        t.y[k] = 0.0
    clear_bodies(m, t)


@njit(**OPTIONS)
def clear_bodies(m, t):
    """Set the forces on all bodies to zero."""
    for b in range(m.plan[BODIES]):
        t.x[b] = zero_like(t.x[b])


@njit(**OPTIONS)
def twist_of(m, t, n):
    """Twist of a section from the rates of bodies and coordinates."""
    no_inline()
    on = m.on[n]
    if on < 0:
        return scaled(0.0, t.x[0])
    b, phi, arms = m.nodes[on, OWNER], m.nodes[on, ROW_OF], vectors(shifted(m.w, place_of(m, MIDDLE)))
    twist, bent = twist_at(t.x[b], arms[2 * n]), scaled(0.0, t.x[b])
    if phi >= 0:
        for j in range(m.bodies[b, SHAPES]):
            bent = axpy(t.y[m.bodies[b, MODAL] + j], t.phi[phi + j], bent)
        twist = plus(twist, twist_at(bent, arms[2 * n + 1]))
    return twist


@njit(**OPTIONS)
def add_force(m, t, n, force):
    """Add a section's force and moment to the forces of its body and shapes."""
    no_inline()
    on = m.on[n]
    if on < 0:
        return
    b, phi, arms = m.nodes[on, OWNER], m.nodes[on, ROW_OF], vectors(shifted(m.w, place_of(m, MIDDLE)))
    if phi >= 0:
        own = force_at(force, arms[2 * n + 1])
        for j in range(m.bodies[b, SHAPES]):
            t.y[m.bodies[b, MODAL] + j] += dot(t.phi[phi + j], own)
    t.x[b] = plus(t.x[b], force_at(force, arms[2 * n]))
