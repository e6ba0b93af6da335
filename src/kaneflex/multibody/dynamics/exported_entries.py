"""Entries of exported C for mechanisms in space: records, other dependent speeds, and rates of the coordinates."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.types import ENTRY, shifted
from kaneflex.multibody.dynamics.arrays import BALLS, OWN
from kaneflex.multibody.dynamics.arrays import KEPT as KEPT_NUMBERS
from kaneflex.multibody.dynamics.independent_speeds import choose, differs, is_dependent, open_rows
from kaneflex.multibody.dynamics.spatial_entries import project
from kaneflex.multibody.dynamics.unfolding import give_coordinates
from kaneflex.multibody.model.codes import DONE, PRESCRIBED
from kaneflex.multibody.model.layout import (
    BENDS,
    COORDINATES,
    DEPENDENT,
    LED,
    LOOP_PIVOTS,
    REACTIONS,
    ROW_OF,
)  # fmt: skip
from kaneflex.multibody.time.state_record import give, take

KEPT, CHANGED, FIXED = range(3)
"""Outcomes of :func:`change`."""


@njit(**ENTRY)
def unfold(m, row):
    """Record of a row, projected as Python reads it between stored instants; NaN if its loops do not close."""
    take(m, row)
    give_coordinates(m)
    if project(m, row[0], m.q, m.u) != DONE:
        for k in range(m.counts[KEPT_NUMBERS]):
            m.kept[k] = math.nan


@njit(**ENTRY)
def change(m, row, level, independent, fixed):
    """Make other speeds dependent at a row of the integration, as Python does; returns KEPT, CHANGED or FIXED.

    ``level``: see :func:`kaneflex.multibody.dynamics.independent_speeds.choose`. ``fixed``: True if the choice must not
    change.
    """
    unfold(m, row)
    open_rows(m)
    plan, taken = m.plan, shifted(m.pivots, m.plan[LOOP_PIVOTS])
    choose(m, level, taken)
    if not differs(m, taken):
        return KEPT
    if fixed:
        return FIXED
    kept, free = 0, 0
    m.pivots[BENDS], m.pivots[LED] = 1, 0
    for r in range(plan[REACTIONS]):
        if taken[r] >= 0:
            m.pivots[plan[ROW_OF] + kept], m.pivots[plan[DEPENDENT] + kept] = r, taken[r]
            kept += 1
    for s in range(plan[COORDINATES]):
        if level[s] < PRESCRIBED and not is_dependent(m, s):
            independent[free] = s
            free += 1
    unfold(m, row)
    give(m, row[0], row)
    return CHANGED


@njit(**ENTRY)
def rates_of(m, out):
    """Rates of the coordinates, after :func:`project`."""
    for n in range(m.counts[OWN]):
        out[m.own[n, 0]] = m.u[m.own[n, 1]]
    for n in range(m.counts[BALLS]):  # 1/2 q (0, omega)
        k, s = m.balls[n, 0], m.balls[n, 1]
        a, b, c, d = m.q[k], m.q[k + 1], m.q[k + 2], m.q[k + 3]
        x, y, z = m.u[s], m.u[s + 1], m.u[s + 2]
        out[k], out[k + 1] = -0.5 * (b * x + c * y + d * z), 0.5 * (a * x + c * z - d * y)
        out[k + 2], out[k + 3] = 0.5 * (a * y + d * x - b * z), 0.5 * (a * z + b * y - c * x)
