"""Compiled linear equations of a tree with closed loops: the tree's factors, and the responses to unit reactions.

Rows are those of the kept cut joints, then of virtual inertia, compliant contacts and frictions.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.unilateral import factors
from kaneflex.multibody.unilateral.rows import is_rigid
from kaneflex.multibody.compile.stand_ins import if_impacts
from kaneflex.multibody.compile.values import row_length, twists, width
from kaneflex.multibody.dynamics.algebra import dot, scaled
from kaneflex.multibody.dynamics.articulated import factorise, solve
from kaneflex.multibody.dynamics.tree import (
    add_force, clear_bodies, clear_forces, fill_matrices, place_of, tree_arrays, twist_of,
)  # fmt: skip
from kaneflex.multibody.compile.types import OPTIONS, no_inline, shifted
from kaneflex.multibody.model.layout import (
    AT, COLUMNS, COORDINATES, CUT_OF, CUT_ROWS, DRIVES, FACTOR_ROWS, KEPT, MIDDLE_CUT, ON, REACTION, ROW_OF, SCHUR,
    VIRTUAL, YIELDING,
)  # fmt: skip


@njit(**OPTIONS)
def add_unit_reaction(m, t, r):
    """Add the generalised forces of a row's unit reaction, with the friction that it brings."""
    no_inline()
    if factors.virtual_coordinate(m, r) >= 0:
        t.y[factors.virtual_coordinate(m, r)] += 1.0
        return
    cut, k = row_at(m, r)
    n = factors.friction_by_reaction(m, r)
    for side in range(2):
        add_force(m, t, m.acts[cut, AT + side], twists(m, shifted(m.w, k))[side])
        if n:
            friction = scaled(factors.force_by_reaction(m, n, r), twists(m, shifted(m.w, row_jacobian(m, n)))[side])
            add_force(m, t, m.acts[m.plan[DRIVES] + n, AT + side], friction)


@njit(**OPTIONS)
def row_rate(m, t, r):
    """Rate of a row for the rates of the tree's bodies and coordinates."""
    no_inline()
    if factors.virtual_coordinate(m, r) >= 0:
        return t.y[factors.virtual_coordinate(m, r)]
    cut, k = row_at(m, r)
    sides = twists(m, shifted(m.w, k))
    return dot(sides[0], twist_of(m, t, m.acts[cut, AT])) + dot(sides[1], twist_of(m, t, m.acts[cut, ON]))


@njit(**OPTIONS)
def factorise_tree(m, h, A):
    """Factors of M + h C + h^2 K of the tree, responses of the coordinates to unit reactions of kept rows and
    contacts, and of these rows at SCHUR; False: zero pivot."""
    no_inline()
    plan = m.plan
    t = tree_arrays(m, A, column(m, 0))
    fill_matrices(m, t, h)
    if not factorise(t):
        return False
    count = plan[KEPT] + m.pivots[YIELDING]
    for r in range(count):
        t = tree_arrays(m, A, column(m, r))
        clear_forces(m, t)
        add_unit_reaction(m, t, r)
        solve(t)
        for q in range(count):
            A[plan[SCHUR] + count * q + r] = row_rate(m, t, q)
    return True


@njit(**OPTIONS)
def factorise_closed(m, h, A, pivots):
    """Factors of M + h C + h^2 K with closed loops; False if motion or reactions are not determined.

    In addition to the tree's factors: responses of coordinates and cut joints to unit reactions of the kept rows.
    """
    no_inline()
    if not factorise_tree(m, h, A):
        return False
    plan, count = m.plan, m.plan[KEPT] + m.pivots[YIELDING]
    most = factors.largest_limit(m, count, A)
    for r in range(0 if _is_shared(m) else plan[KEPT], count):
        add_compliance(m, r, count, h, A, most)
    return dense_lu.factorise(A, plan[SCHUR], count, m.pivots, pivots)


@if_impacts(False)
@njit(**OPTIONS)
def _is_shared(m):
    """True if the factors contain rigid contacts that are no kept rows: then all contacts at rest are compliant."""
    for r in range(m.plan[VIRTUAL], m.pivots[YIELDING]):
        n = m.pivots[m.plan[FACTOR_ROWS] + r]
        if n >= 0 and is_rigid(m, n):
            return True
    return False


@njit(**OPTIONS)
def add_compliance(m, r, count, h, A, most):
    """Add the compliance of a row, none of cuts, negative where it removes virtual inertia; ``most``: largest
    force limit of frictions."""
    own, k = m.plan[SCHUR] + (count + 1) * r, factors.virtual_coordinate(m, r)
    if k >= 0:
        A[own] -= 1.0 / m.virtual_inertia[k]
        return
    n = factors.row_in(m, r) if r >= m.plan[KEPT] else m.plan[m.plan[ROW_OF] + r] - m.plan[CUT_ROWS]
    if r < m.plan[KEPT] and n < 0:
        return
    if not factors.use_force_law(m, n, r, count, h, A):
        A[own] += factors.compliance(m, n, h, r, count, A, most)


@njit(**OPTIONS)
def row_at(m, r):
    """Interaction of a kept row, or of a contact or friction after these, and place of its Jacobian."""
    plan = m.plan
    if r < plan[KEPT]:
        row = plan[plan[ROW_OF] + r]
        return plan[plan[CUT_OF] + row], place_of(m, MIDDLE_CUT) + row_length(m) * row + 3
    n = factors.row_in(m, r)
    return factors.act_of(m, n), row_jacobian(m, n)


@njit(**OPTIONS)
def row_jacobian(m, n):
    """Place of the Jacobian of a contact or friction."""
    return place_of(m, MIDDLE_CUT) + row_length(m) * (m.plan[CUT_ROWS] + n) + 3


@njit(**OPTIONS)
def column(m, r):
    """Place of the coordinates' response to a row's unit force; the solution lies between those of cut joints and
    contacts."""
    return m.plan[COLUMNS] + m.plan[COORDINATES] * (r if r < m.plan[KEPT] else r + 1)


@njit(**OPTIONS)
def solve_closed(m, A, pivots):
    """Response to generalised forces: both in the row of COLUMNS after the kept ones; at REACTION the reactions that
    keep loops closed, and contact forces."""
    no_inline()
    plan = m.plan
    count, n, x = plan[KEPT] + m.pivots[YIELDING], plan[COORDINATES], plan[REACTION]
    answer = plan[COLUMNS] + n * plan[KEPT]
    t = tree_arrays(m, A, answer)
    clear_bodies(m, t)
    solve(t)
    if count:
        for r in range(count):
            A[x + r] = factors.right_hand_side(m, A, r, row_rate(m, t, r))
        dense_lu.substitute(A, plan[SCHUR], count, m.pivots, pivots, x)
        if width(m) == 6:  # in the plane few rows are redundant, and none nearly
            factors.leave_out_idle(m, A, count, pivots)
        for r in range(count):
            for i in range(n):
                A[answer + i] += A[column(m, r) + i] * A[x + r]
