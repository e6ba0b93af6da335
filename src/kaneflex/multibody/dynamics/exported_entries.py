"""Entries of exported C: records, other dependent coordinates, and accelerations with rates of the coordinates."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.types import ENTRY, OPTIONS, shifted
from kaneflex.multibody.compile.values import copy
from kaneflex.multibody.dynamics.arrays import BALLS, OWN
from kaneflex.multibody.dynamics.courses import prescribe
from kaneflex.multibody.dynamics.entries import project, unfold
from kaneflex.multibody.dynamics.independent_speeds import choose, differs, open_rows
from kaneflex.multibody.dynamics.loop_condition import is_dependent
from kaneflex.multibody.dynamics.records import give_coordinates
from kaneflex.multibody.model.codes import DONE, ON_LOOPS, PRESCRIBED
from kaneflex.multibody.model.layout import (
    BENDS,
    COORDINATES,
    DEPENDENT,
    FACTOR_ROWS,
    KEPT,
    LED,
    LOOP_PIVOTS,
    REACTIONS,
    ROW_OF,
    VIRTUAL,
    YIELDING,
)  # fmt: skip
from kaneflex.multibody.time.state_record import read_row, write_row

SAME, CHANGED, PROJECTED, FAILED = range(4)
"""Outcomes of :func:`change`."""


@njit(**ENTRY)
def read(m, row):
    """Record of a row of the integration."""
    unfold(m, row, 1, ON_LOOPS, m.kept)


@njit(**ENTRY)
def change(m, row, level, virtual, rests):
    """Make other coordinates dependent at a row of the integration, as Python does; returns SAME, CHANGED, or
    with other kept rows PROJECTED or FAILED.

    ``level``: see :func:`kaneflex.multibody.dynamics.independent_speeds.choose`. ``virtual``: virtual inertia of all
    speeds if some body has no inertia, else zero. ``rests``: True if other contacts rest than before, which changes the
    rows.
    """
    read_row(m, row)
    prescribe(m, row[0])
    open_rows(m)
    plan, taken = m.plan, shifted(m.pivots, m.plan[LOOP_PIVOTS])
    choose(m, level, taken)
    if not rests and not differs(m, taken):
        return SAME
    kept, free, inert, others = 0, 0, 0, rests
    m.pivots[BENDS], m.pivots[LED] = 1, 0
    for r in range(plan[REACTIONS]):
        if taken[r] >= 0:
            others = others or plan[plan[ROW_OF] + kept] != r
            m.pivots[plan[ROW_OF] + kept], m.pivots[plan[DEPENDENT] + kept] = r, taken[r]
            kept += 1
    m.pivots[KEPT] = kept
    for s in range(plan[COORDINATES]):
        free += level[s] < PRESCRIBED and not is_dependent(m, s)
        if virtual[s] > 0.0:
            m.virtual_inertia[s], m.pivots[plan[FACTOR_ROWS] + inert] = virtual[s], s
            inert += 1
    if inert > 0:
        m.pivots[VIRTUAL] = m.pivots[YIELDING] = inert
    m.now[2] = free
    if not others:
        return CHANGED
    give_coordinates(m)
    if project(m, row[0], m.q, m.u) != DONE:
        return FAILED
    write_row(m, row[0], row)
    return PROJECTED


@njit(**ENTRY)
def accelerate(m, t, q, u, rates, du):
    """Rates of the coordinates, and accelerations, near coordinates q with speeds u; False at a singular state."""
    if project(m, t, q, u) != DONE:
        return False
    _rates_of(m, rates)
    copy(m.du, du, m.plan[COORDINATES])
    return True


@njit(**OPTIONS)
def _rates_of(m, out):
    """Rates of the coordinates."""
    for n in range(m.counts[OWN]):
        out[m.own[n, 0]] = m.u[m.own[n, 1]]
    for n in range(m.counts[BALLS]):  # 1/2 q (0, omega)
        k, s = m.balls[n, 0], m.balls[n, 1]
        a, b, c, d = m.q[k], m.q[k + 1], m.q[k + 2], m.q[k + 3]
        x, y, z = m.u[s], m.u[s + 1], m.u[s + 2]
        out[k], out[k + 1] = -0.5 * (b * x + c * y + d * z), 0.5 * (a * x + c * z - d * y)
        out[k + 2], out[k + 3] = 0.5 * (a * y + d * x - b * z), 0.5 * (a * z + b * y - c * x)
