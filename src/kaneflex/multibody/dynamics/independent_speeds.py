"""Compiled choice of dependent coordinates: Gauss-Jordan elimination of the rows of cuts with complete pivoting."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.model.codes import OF_SHAPE
from kaneflex.multibody.compile.stand_ins import if_impacts
from kaneflex.multibody.compile.values import row_length
from kaneflex.multibody.dynamics.courses import prescribe
from kaneflex.multibody.dynamics.cut_rows import cut_rows
from kaneflex.multibody.dynamics.deformation import deform
from kaneflex.multibody.dynamics.kinematics import place
from kaneflex.multibody.dynamics.interactions import gradient
from kaneflex.multibody.dynamics.loop_condition import is_dependent, pushes
from kaneflex.multibody.compile.types import ENTRY, OPTIONS, larger, no_inline, shifted
from kaneflex.multibody.model.layout import (
    CHANGE_POINT, CONTACTS, COORDINATES, CROSSING, CUT_OF, CUT_ROWS, EXTENT, FRICTIONS, GRADIENT, JOINT_ROWS, KEPT,
    MEASURE, MODE, OPEN, REACTIONS, RESTED, ROW_OF, SHUT, TOUCH,
)  # fmt: skip
from kaneflex.multibody.unilateral.rows import at, contacts, is_at_rest, is_rigid

_FIRM, _RANK = 1e-4, 1e-9
"""Shares of a row's largest derivative: above the first, a joint's coordinate becomes dependent before any shape; below
the second, a row is redundant."""
_ROUNDED = 1e-5
"""Share of the mechanism's size or of 1 rad: rows whose derivatives are smaller than this times _RANK change by
rounding."""
_EXACT = OPTIONS | {"fastmath": False}
"""Numba options that make ties alike on all machines and in C."""


@njit(**OPTIONS)
def is_constraint(m, row):
    """True if a row is a constraint now: of a cut joint, or of a contact at rest under Newton's law."""
    no_inline()
    act = m.plan[m.plan[CUT_OF] + row]
    return act < m.plan[FRICTIONS] or (act >= m.plan[CONTACTS] and is_at_rest(m, act - m.plan[CONTACTS]))


@njit(**OPTIONS)
def open_rows(m):
    """Residuals of all these rows at the current coordinates, with their derivatives by all coordinates at GRADIENT."""
    no_inline()
    plan, n = m.plan, m.plan[COORDINATES]
    deform(m)
    place(m, 0)
    cut_rows(m)
    for k in range(plan[REACTIONS] * n):
        m.J[k] = 0.0
    for row in range(plan[REACTIONS]):
        if is_constraint(m, row):
            gradient(m, row, True, plan[GRADIENT] + n * row)


@njit(**ENTRY)
def openings(m, t, out):
    """The same with prescribed drives at t; residuals of all rows, zero of rows that are no constraints."""
    prescribe(m, t)
    open_rows(m)
    for row in range(m.plan[REACTIONS]):
        out[row] = m.rows[row_length(m) * row] if is_constraint(m, row) else 0.0


@if_impacts(None)
@njit(**OPTIONS)
def _shut(m):
    """Note which contacts dependent coordinates keep closed."""
    w = m.w
    for n in range(contacts(m)):
        if is_rigid(m, n):
            w[at(m, n) + SHUT] = 1.0 if w[at(m, n) + MODE] != OPEN else 0.0
    w[m.plan[TOUCH] + RESTED] = 0.0


@njit(**ENTRY)
def choose(m, level, taken):
    """Choose kept rows and dependent coordinates, after :func:`open_rows`.

    ``level``: of every coordinate, FIRST to PRESCRIBED. ``taken``: filled by every row's dependent coordinate, -1 for
    a redundant row, -2 for a row that is no constraint.

    The coordinate with the largest share in a row is taken at a time; shapes only if joints are too few, as in a frame.
    Contacts at rest follow the cut joints. Rows are scaled by their largest derivative, all alike if some are
    redundant, as the remainder of a row must not compete with other rows.
    """
    _shut(m)
    if _eliminate(m, level, False, taken):
        _eliminate(m, level, True, taken)


@njit(**OPTIONS)
def differs(m, taken):
    """True if a choice by :func:`choose` has other rows or dependent coordinates than the current one, and as many.

    Near a singular position fewer rows would leave a freedom unconstrained.
    """
    kept, other = 0, False
    for row in range(m.plan[REACTIONS]):
        if taken[row] >= 0 and kept < m.plan[KEPT]:
            other = other or m.plan[m.plan[ROW_OF] + kept] != row or not is_dependent(m, taken[row])
        kept += taken[row] >= 0
    return other and kept == m.plan[KEPT]


@njit(**_EXACT)
def _eliminate(m, level, even, taken):
    """Eliminate the rows with either scale; returns the number of redundant ones."""
    no_inline()
    plan, left = m.plan, 0
    _scale(m, level, even)
    for row in range(plan[REACTIONS]):
        taken[row] = -1 if is_constraint(m, row) else -2
        left += taken[row] == -1
    for touching in range(2):  # impacts need the cut joints without contacts
        first, end = (plan[CUT_ROWS], plan[REACTIONS]) if touching else (0, plan[JOINT_ROWS])
        for most in range(OF_SHAPE + 1):
            least = _RANK if most == OF_SHAPE else _FIRM
            row, i = _pivot(m, level, most, least, first, end, taken)
            while row >= 0:
                taken[row] = i
                left -= 1
                _subtract(m, row, first, taken)
                row, i = _pivot(m, level, most, least, first, end, taken)
    return left


@njit(**_EXACT)
def _by_joints(m, level, row):
    """Largest derivative of a row by a joint's coordinate, in units of the coordinates."""
    no_inline()
    plan, size = m.plan, 0.0
    for i in range(plan[COORDINATES]):
        if level[i] < OF_SHAPE:
            size = larger(size, abs(m.J[plan[COORDINATES] * row + i]) * m.w[plan[MEASURE] + i])
    return size


@njit(**_EXACT)
def _scale(m, level, even):
    """Fill the matrix: derivatives in units of the coordinates, as shares of a row's largest one by a joint, or of the
    mechanism's size, for moments 1 rad, if ``even``."""
    no_inline()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    for row in range(plan[REACTIONS]):
        unit = w[plan[TOUCH] + EXTENT] if pushes(m, row) else 1.0
        if not even:
            unit = larger(_ROUNDED * unit, _by_joints(m, level, row))
        for i in range(n * row, n * row + n):
            w[_matrix(m) + i] = m.J[i] * w[plan[MEASURE] + i - n * row] / unit


@njit(**_EXACT)
def _matrix(m):
    """Place of the matrix, which numbers of change points leave free between the steps."""
    return m.plan[CROSSING] + CHANGE_POINT


@njit(**_EXACT)
def _pivot(m, level, most, least, first, end, taken):
    """Row and coordinate of the largest share of all rows left, by coordinates of up to a level; -1 if below the
    least."""
    no_inline()
    A, n = shifted(m.w, _matrix(m)), m.plan[COORDINATES]
    largest, row, column = 0.0, -1, -1
    for r in range(first, end):
        if taken[r] != -1:
            continue
        for i in range(n):
            if level[i] <= most and not abs(A[n * r + i]) <= largest:
                largest, row, column = abs(A[n * r + i]), r, i
    return -1 if largest < least else row, column  # NaN is the largest, so unknown positions keep all rows


@njit(**_EXACT)
def _subtract(m, pivot, first, taken):
    """Eliminate the coordinate that a row has taken from all rows left."""
    no_inline()
    A, n, i = shifted(m.w, _matrix(m)), m.plan[COORDINATES], taken[pivot]
    for row in range(first, m.plan[REACTIONS]):
        if taken[row] == -1:
            share = A[n * row + i] / A[n * pivot + i]
            for k in range(n):
                A[n * row + k] -= share * A[n * pivot + k]
            A[n * row + i] = 0.0
