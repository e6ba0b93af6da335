"""Rows of the cuts that close a tree's loops, in the plane and in space."""

from __future__ import annotations

from numba import njit

from kaneflex.generated import joints as planar_laws
from kaneflex.generated import spatial as laws
from kaneflex.multibody.compile.values import by_size, numbers_of
from kaneflex.multibody.dynamics.arrays import SECTION as ROW
from kaneflex.multibody.dynamics.forces import rest_rows
from kaneflex.multibody.model import layout as of
from kaneflex.multibody.model.layout import OPTIONS, apart, shifted
from kaneflex.multibody.model.tree_layout import COINCIDE, PERPENDICULAR


@njit(**OPTIONS)
def cut_rows(m):
    """Residuals of the cuts with their rates and Jacobians by the sections' twists; in the plane those of drives less
    their courses."""
    apart()
    plan, w, acts = m.plan, m.w, m.acts
    sec = shifted(w, plan[of.SECTION])
    for n in range(plan[of.CUTS], plan[of.HOLDS]):
        kind, one, two, j = acts[n, of.WHAT], acts[n, of.AT], acts[n, of.ON], acts[n, of.NUMBERS_AT]
        k = plan[of.CUT] + of.ROW_SIZE * acts[n, of.ROW_AT]
        if kind == of.REVOLUTE:
            planar_laws.revolute(sec, one, two, w[j], w[j + 1], w[j + 2], w, k)
        elif kind == of.PRISMATIC:
            planar_laws.prismatic(sec, one, two, w[j], w[j + 1], w[j + 2], w, k)
        elif kind == of.WELD:
            planar_laws.weld(sec, one, two, w[j], w[j + 1], w[j + 2], w, k)
        elif kind == of.TURN:
            planar_laws.turn(sec, one, two, w[j], w[j + 1], w[j + 2], w, k)
        else:
            planar_laws.slide(sec, one, two, w[j], w[j + 1], w[j + 2], w, k)
        if acts[n, of.COURSE_AT] >= 0:
            course = plan[of.COURSE] + 3 * acts[n, of.COURSE_AT]
            w[k] -= w[course]
            w[k + 1] -= w[course + 1]
            w[k + 2] -= w[course + 2]
    if plan[of.RIGID]:
        rest_rows(m)


@njit(**OPTIONS)
def _cut_rows_in_space(m):
    apart()
    sections, axes, out = numbers_of(m.sections), numbers_of(m.axes), numbers_of(m.rows)
    for c in range(m.plan[of.CUTS], m.plan[of.HOLDS]):
        what, one, two, n = m.acts[c, of.WHAT], m.acts[c, of.AT], m.acts[c, of.ON], ROW * m.acts[c, of.ROW_AT]
        axis = m.acts[c, of.NUMBERS_AT]
        if what == COINCIDE:
            laws.coincide(sections, one, two, out, n)
        elif what == PERPENDICULAR:
            laws.perpendicular(sections, one, two, axes, axis, axis + 1, out, n)
        else:
            laws.on_plane(sections, one, two, axes, axis, out, n)


cut_rows = by_size(cut_rows, _cut_rows_in_space)
