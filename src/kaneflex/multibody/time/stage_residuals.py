"""Residuals of a step's stages as right-hand sides of its Newton iteration

    S x = M a,   S = M + h mu C + h^2 mu^2 K,

with M a the residual of the equations of motion as forces. In the plane these forces are taken as they are. In space
the mass matrix may change within a step, where shapes of twist have little inertia of their own: with the S of the
step's middle the iteration then diverges (links whose pins alternate between two axes need 1,574 steps instead of 313).
From then on a follows by the mass matrix of each stage, factorised at its first iteration, and

    x = a - S^-1 (h mu C + h^2 mu^2 K) a.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.types import OPTIONS, no_inline, shifted
from kaneflex.multibody.compile.values import copy, inline, width
from kaneflex.multibody.dynamics import load_derivatives, rotation_vectors, tree
from kaneflex.multibody.dynamics.bushings import SIZE
from kaneflex.multibody.dynamics.loop_factors import factorise_closed, solve_closed
from kaneflex.multibody.dynamics.tree import assemble, resist
from kaneflex.multibody.model.codes import MOST_TURNED
from kaneflex.multibody.model.layout import (
    BUSHING,
    BY_FORCES,
    COLUMNS,
    CONTACTS,
    COORDINATES,
    GIVEN,
    GIVEN_REACTION,
    KEPT,
    MASS_PIVOTS,
    MASS_ROWS,
    REACTION,
    RESISTING,
    RESISTING_R,
    SLOPED,
    SPRINGS,
    WHAT,
)


@njit(**OPTIONS)
def store_residual(m, i, first):
    """Store the residual of stage i as forces, or as accelerations and reactions.

    False: singular, or a bushing or a ball has turned too far. ``first``: in the first iteration.
    """
    no_inline()
    plan, w = m.plan, m.w
    n, kept = plan[COORDINATES], plan[KEPT]
    if width(m) == 6:
        for act in range(plan[SPRINGS], plan[CONTACTS]):
            if m.acts[act, WHAT] == BUSHING and not m.springs[SIZE * (act - plan[SPRINGS])] <= MOST_TURNED:
                return False
        if not rotation_vectors.note_turns(m, i):
            return False
    if width(m) == 3 or m.pivots[BY_FORCES]:
        copy(m.h, shifted(w, plan[RESISTING] + n * i), n)
        return True
    A, pivots, answer = _mass(m, i), plan[MASS_PIVOTS] + plan[MASS_ROWS] * i, plan[COLUMNS] + kept * n
    tree.use_geometry(m, i + 1)
    if first:
        assemble(m)
        if not factorise_closed(m, 0.0, A, pivots):
            return False
    for k in range(n):
        A[answer + k] = -m.h[k]
    solve_closed(m, A, pivots)
    copy(shifted(A, answer), shifted(w, plan[RESISTING] + n * i), n)
    copy(shifted(A, plan[REACTION]), shifted(w, plan[RESISTING_R] + kept * i), kept)
    tree.use_geometry(m, 0)
    return True


@njit(**OPTIONS)
def _mass(m, i):
    """Factors of the mass matrix of a stage."""
    inline()
    return m.mass_0 if i == 0 else m.mass_1 if i == 1 else m.mass_2


@njit(**OPTIONS)
def _combine(w, into, of, count, sign, A, B, out):
    """Stages' numbers, ``count`` each, times a sign, as those of the two systems."""
    no_inline()
    for k in range(count):
        r_0, r_1, r_2 = w[of + k], w[of + count + k], w[of + 2 * count + k]
        A[out + k] = sign * (into[0].real * r_0 + into[1].real * r_1 + into[2].real * r_2)
        B[out + k] = sign * (into[3] * r_0 + into[4] * r_1 + into[5] * r_2)


@njit(**OPTIONS)
def fill_right_hand_sides(m, table, h, A, B):
    """Right-hand sides of the real and the complex system of the stages."""
    plan, n = m.plan, m.plan[COORDINATES]
    if width(m) == 3 or m.pivots[BY_FORCES]:
        _combine(m.w, table.into, plan[RESISTING], n, -1.0, A, B, plan[COLUMNS] + plan[KEPT] * n)
        return
    _combine(m.w, table.into, plan[RESISTING], n, 1.0, A, B, plan[GIVEN])
    _combine(m.w, table.into, plan[RESISTING_R], plan[KEPT], 1.0, A, B, plan[GIVEN_REACTION])
    resist_given(m, h * table.real[0], A)
    resist_given(m, h * table.pair[0], B)


@njit(**OPTIONS)
def resist_given(m, h, A):
    """Forces -(h C + h^2 K) a of given accelerations."""
    answer, given = m.plan[COLUMNS] + m.plan[KEPT] * m.plan[COORDINATES], shifted(A, m.plan[GIVEN])
    resist(m, h, given, A, answer)
    if m.pivots[SLOPED]:
        load_derivatives.resist_defect(m, h, given, A, answer)


@njit(**OPTIONS)
def complete_solution(m, A):
    """Complete the solution."""
    if width(m) == 3 or m.pivots[BY_FORCES]:
        return
    plan, n = m.plan, m.plan[COORDINATES]
    answer = plan[COLUMNS] + plan[KEPT] * n
    for k in range(n):
        A[answer + k] += A[plan[GIVEN] + k]
    for r in range(plan[KEPT]):
        A[plan[REACTION] + r] += A[plan[GIVEN_REACTION] + r]


@njit(**OPTIONS)
def prepare_next_step(m):
    """Prepare the next step at the end of one."""
    if width(m) == 6:
        rotation_vectors.settle(m)
