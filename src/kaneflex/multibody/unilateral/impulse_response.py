"""Responses of rigid contacts' rows, and of the whole mechanism, to unit impulses along these rows, in the compiled
integration.

Rows are those of touching contacts and of holds that may stick or slip. Loops stay closed, drives are kinematic, and
virtual inertia is removed. With forces of the rows, bristles exert the resulting friction.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.unilateral import dry_friction, lugre_step
from kaneflex.multibody.dynamics.courses import courses
from kaneflex.multibody.dynamics.loop_factors import column, reach
from kaneflex.multibody.unilateral.complementarity import listed
from kaneflex.multibody.model.layout import (
    COMPLEMENT, COORDINATES, COURSE, COURSE_AT, CUT_OF, FREED, KEPT, LOADS, OPTIONS, POWER, PRESCRIBED, RATE,
    REACTION, ROW_OF, SCHUR, SPRINGS, TOUCHING, WORKS, YIELDING, apart,
)  # fmt: skip


@njit(**OPTIONS)
def response_matrix(m, A, rows):
    """Fill W of the problem, at COMPLEMENT, for ``rows`` rows; False at a singular state.

    Rows of cut joints and of virtual inertia are eliminated from the responses to unit forces, at SCHUR.
    """
    apart()
    plan, w = m.plan, m.w
    for i in range(rows):
        m.pivots[plan[TOUCHING] + i] = m.pivots[listed(m) + i]
    m.pivots[YIELDING] = rows + dry_friction.rows_now(m, rows)
    if not reach(m, 0.0, A):
        return False
    cuts, total, S = m.pivots[KEPT], m.pivots[KEPT] + m.pivots[YIELDING], plan[SCHUR]
    for r in range(cuts + rows, total):
        n = m.pivots[plan[TOUCHING] + r - cuts]
        if not lugre_step.by_force(m, n, r, total, 0.0, A):
            A[S + (total + 1) * r] += dry_friction.compliance(m, n, 0.0, 0.0, 0.0)
    for s in range(total - rows):
        q = _turn(m, s, rows)
        if A[S + (total + 1) * q] == 0.0:
            return False
        for a in range(s + 1, total):
            i = _turn(m, a, rows)
            factor = A[S + total * i + q] / A[S + (total + 1) * q]
            for b in range(s + 1, total):
                j = _turn(m, b, rows)
                A[S + total * i + j] -= factor * A[S + total * q + j]
    for i in range(rows):
        for j in range(rows):
            w[plan[COMPLEMENT] + rows * i + j] = A[S + total * (cuts + i) + cuts + j]
    return True


@njit(**OPTIONS)
def _turn(m, s, rows):
    """Index of the s-th row in elimination order: cut joints, then virtual inertia, then the others."""
    cuts, total = m.pivots[KEPT], m.pivots[KEPT] + m.pivots[YIELDING]
    if s < cuts:
        return s
    return s + rows if s < total - rows else s - (total - rows - cuts)


@njit(**OPTIONS)
def reactions_of(m, A, rows, x):
    """Forces of all rows, at REACTION, for forces x of the problem's rows."""
    apart()
    cuts, total, S, R = m.pivots[KEPT], m.pivots[KEPT] + m.pivots[YIELDING], m.plan[SCHUR], m.plan[REACTION]
    for i in range(rows):
        A[R + cuts + i] = m.w[x + i]
    for s in range(total - rows - 1, -1, -1):
        q, reaction = _turn(m, s, rows), 0.0
        for b in range(s + 1, total):
            j = _turn(m, b, rows)
            reaction -= A[S + total * q + j] * A[R + j]
        A[R + q] = reaction / A[S + (total + 1) * q]


@njit(**OPTIONS)
def apply_impulses(m, A):
    """Add the effect of the impulses at REACTION to all rates; works of prescribed drives at POWER."""
    apart()
    plan, w, x = m.plan, m.w, m.plan[REACTION]
    drives = plan[POWER] + 1 + plan[SPRINGS] - plan[LOADS]
    for k in range(plan[WORKS]):
        w[plan[POWER] + k] = 0.0
    for r in range(m.pivots[KEPT] + m.pivots[YIELDING]):
        of = column(m, r)
        for course in range(courses(m)):
            k = plan[plan[PRESCRIBED] + course]
            if k >= 0:
                w[drives + course] += A[of + k] * A[x + r] * w[plan[COURSE] + 3 * course + 1]
        for k in range(plan[COORDINATES]):
            if plan[plan[FREED] + k] != 0:
                w[plan[RATE] + k] += A[of + k] * A[x + r]
        if r < m.pivots[KEPT]:
            course = m.acts[plan[plan[CUT_OF] + plan[plan[ROW_OF] + r]], COURSE_AT]
            if course >= 0:
                w[drives + course] += A[x + r] * w[plan[COURSE] + 3 * course + 1]
