"""Tables of a mechanism as the tree of :mod:`kaneflex.multibody.dynamics.articulated`, in the plane and in space."""

from __future__ import annotations

from collections import namedtuple

from numba import njit

from kaneflex.multibody.compile.values import copy_vectors, inside, twists, vectors, width
from kaneflex.multibody.dynamics.algebra import zero_like
from kaneflex.multibody.dynamics.dimensions import place_of, stiffen
from kaneflex.multibody.model.layout import (
    ARMS,
    AXES,
    BODIES,
    COORDINATES,
    COUPLING,
    COUPLINGS,
    FREED,
    IN_ORDER,
    INERTIAS,
    MASSES,
    OPTIONS,
    PHI,
    PLACES,
    SHAPES,
    SQUARE,
    TREE_D,
    TREE_E,
    TREE_I,
    TREE_L,
    TREE_ROOM,
    TREE_U,
    TREE_X,
    apart,
    shifted,
)  # fmt: skip

Tree = namedtuple("Tree", "counts bodies free I E L U D S phi place arm x y room")


@njit(**OPTIONS)
def tree(m, A, y):
    """Arrays of the tree in factors A, with the coordinates from y on."""
    inside()
    plan, w = m.plan, m.w
    return Tree(
        plan, m.bodies, shifted(plan, plan[FREED]), twists(m, shifted(A, plan[TREE_I])),
        twists(m, shifted(A, plan[TREE_E])), shifted(A, plan[TREE_L]), twists(m, shifted(A, plan[TREE_U])),
        shifted(A, plan[TREE_D]), twists(m, shifted(w, place_of(m, AXES))), twists(m, shifted(w, place_of(m, PHI))),
        vectors(shifted(w, place_of(m, PLACES))), vectors(shifted(w, place_of(m, ARMS))),
        twists(m, shifted(A, plan[TREE_X])), shifted(A, y), twists(m, shifted(A, plan[TREE_ROOM])),
    )  # fmt: skip


@njit(**IN_ORDER)
def fill(m, t, h):
    """Fill the tree's matrices with those of M + h C + h^2 K at the middle of the step."""
    apart()
    plan, w = m.plan, m.w
    last = plan[BODIES] - 1
    copy_vectors(twists(m, shifted(w, plan[INERTIAS])), t.I, width(m) * plan[BODIES])
    copy_vectors(twists(m, shifted(w, plan[COUPLINGS])), t.E, m.bodies[last, COUPLING] + m.bodies[last, SHAPES])
    masses = shifted(w, plan[MASSES])
    for k in range(m.bodies[last, SQUARE] + m.bodies[last, SHAPES] * m.bodies[last, SHAPES]):
        t.L[k] = masses[k]
    stiffen(m, t, h)


@njit(**OPTIONS)
def clear(m, t):
    """Set all forces of the tree to zero."""
    apart()
    for k in range(m.plan[COORDINATES]):
        t.y[k] = 0.0
    clear_bodies(m, t)


@njit(**OPTIONS)
def clear_bodies(m, t):
    """Set the forces on all bodies to zero."""
    for b in range(m.plan[BODIES]):
        t.x[b] = zero_like(t.x[b])
