"""Rows of the cuts that close a tree's loops, in the plane and in space."""

from __future__ import annotations

from numba import njit

from kaneflex.generated import joints as planar_laws
from kaneflex.generated import spatial as laws
from kaneflex.multibody.compile.stand_ins import if_impacts
from kaneflex.multibody.compile.types import OPTIONS, no_inline
from kaneflex.multibody.compile.values import by_size, numbers_of, row_length
from kaneflex.multibody.model import layout as of
from kaneflex.multibody.model.tree_layout import COINCIDE, PERPENDICULAR
from kaneflex.multibody.unilateral.relative_rows import fill_rest_rows
from kaneflex.multibody.unilateral.rows import is_at_rest, row_at


@njit(**OPTIONS)
def cut_rows(m):
    """Residuals of the cuts with their rates and Jacobians by the sections' twists; in the plane those of drives less
    their courses."""
    no_inline()
    plan, w, acts, sections, rows = m.plan, m.w, m.acts, m.sections, m.rows
    for n in range(plan[of.CUTS], plan[of.FRICTIONS]):
        kind, one, two, j = acts[n, of.WHAT], acts[n, of.AT], acts[n, of.ON], acts[n, of.NUMBERS_AT]
        k = row_length(m) * acts[n, of.ROW_AT]
        if kind == of.REVOLUTE:
            planar_laws.revolute(sections, one, two, w[j], w[j + 1], w[j + 2], rows, k)
        elif kind == of.PRISMATIC:
            planar_laws.prismatic(sections, one, two, w[j], w[j + 1], w[j + 2], rows, k)
        elif kind == of.WELD:
            planar_laws.weld(sections, one, two, w[j], w[j + 1], w[j + 2], rows, k)
        elif kind == of.TURN:
            planar_laws.turn(sections, one, two, w[j], w[j + 1], w[j + 2], rows, k)
        else:
            planar_laws.slide(sections, one, two, w[j], w[j + 1], w[j + 2], rows, k)
        if acts[n, of.COURSE_AT] >= 0:
            course = plan[of.COURSE] + 3 * acts[n, of.COURSE_AT]
            rows[k] -= w[course]
            rows[k + 1] -= w[course + 1]
            rows[k + 2] -= w[course + 2]
    if plan[of.RIGID]:
        fill_rest_rows(m)


@njit(**OPTIONS)
def _cut_rows_in_space(m):
    no_inline()
    sections, axes, out = m.sections, numbers_of(m.axes), m.rows
    for c in range(m.plan[of.CUTS], m.plan[of.FRICTIONS]):
        what, one, two, n = m.acts[c, of.WHAT], m.acts[c, of.AT], m.acts[c, of.ON], row_length(m) * m.acts[c, of.ROW_AT]
        axis = m.acts[c, of.NUMBERS_AT]
        if what == COINCIDE:
            laws.coincide(sections, one, two, out, n)
        elif what == PERPENDICULAR:
            laws.perpendicular(sections, one, two, axes, axis, axis + 1, out, n)
        else:
            laws.on_plane(sections, one, two, axes, axis, out, n)
    if m.plan[of.RIGID]:
        fill_rest_rows(m)


cut_rows = by_size(cut_rows, _cut_rows_in_space)


@njit(**OPTIONS)
def is_kept(m, row):
    """True if a row determines a dependent coordinate by the current choice."""
    for r in range(m.plan[of.KEPT]):
        if m.plan[m.plan[of.ROW_OF] + r] == row:
            return True
    return False


@if_impacts(False)
@njit(**OPTIONS)
def left_out(m, n):
    """True if a contact at rest is no kept row: it is redundant, or modes are decided."""
    return is_at_rest(m, n) and not is_kept(m, row_at(m, n))
