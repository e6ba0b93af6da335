"""Motion of the bodies and joint forces in space, from a row of the integration; printed as C.

Python computes the same for many instants at once, see :mod:`kaneflex.multibody.time.spatial_motion`.
"""

from __future__ import annotations

from numba import njit
from numba.types import CPointer, boolean, int64, void

from kaneflex.multibody.compile.values import after, vectors
from kaneflex.multibody.dynamics.algebra import axpy, first, force_at, last, minus, plus, scaled, store, turned
from kaneflex.multibody.dynamics.arrays import BALLS, OWN, SPACE
from kaneflex.multibody.dynamics.independent_speeds import PRESCRIBED, choose, differs, is_dependent, open_rows
from kaneflex.multibody.dynamics.spatial_entries import project
from kaneflex.multibody.dynamics.wrenches import row_wrench
from kaneflex.multibody.model.layout import (
    BENDS,
    BODIES,
    COORDINATES,
    DEPENDENT,
    ENTRY,
    LED,
    LOOP_PIVOTS,
    MODAL,
    OPTIONS,
    REACTIONS,
    ROW_OF,
    SHAPES,
    Fixed,
    N,
    shifted,
)  # fmt: skip
from kaneflex.multibody.time.state_record import give, take

NODE, SIGN, ON, FIRST_ROW, LAST_ROW = range(5)
"""Columns of the table of joints: last node of its chain, or -1 outside the tree; -1 if the tree passes from its second
body to its first, else 1; node of its second point, or -1 on the ground; its rows among those of the cuts."""
NO_JOINT = -2
"""Node in the row behind the last joint."""
KEPT, CHANGED, FIXED = range(3)
"""Outcomes of :func:`change`."""


@njit(**ENTRY)
def unfold(m, row, joints, points, q, v, a, exerted):
    """Motion of all bodies and joint forces; returns the outcome of :func:`project`.

    q: of every body origin and axes, row by row, then its shapes; v, a: velocity and angular velocity, then the shapes'
    rates, and the rates of these. exerted: force and moment of every joint on its second body at its second point,
    which ``points`` has in the axes of its node. All vectors are global.
    """
    outcome = _project(m, row)
    i = j = 0
    for b in range(m.plan[BODIES]):
        node, modal, shapes = m.frames[b, 0], m.bodies[b, MODAL], m.bodies[b, SHAPES]
        store(after(q, i), m.r[node])
        for k in range(3):
            store(after(q, i + 3 + 3 * k), m.R[3 * node + k])
        store(after(v, j), first(m.twist[node]))
        store(after(v, j + 3), last(m.twist[node]))
        store(after(a, j), first(m.rate[node]))
        store(after(a, j + 3), last(m.rate[node]))
        for k in range(shapes):
            q[i + 12 + k], v[j + 6 + k], a[j + 6 + k] = m.y[modal + k], m.u[modal + k], m.du[modal + k]
        i, j = i + 12 + shapes, j + 6 + shapes
    n = 0
    while joints[n, NODE] > NO_JOINT:
        wrench = _exerted(m, joints, vectors(points), n)
        store(after(exerted, 6 * n), first(wrench))
        store(after(exerted, 6 * n + 3), last(wrench))
        n += 1
    return outcome


@njit(**OPTIONS)
def _project(m, row):
    """State of a row with accelerations and wrenches; returns the outcome."""
    take(m, row)
    for k in range(m.counts[OWN]):
        m.q[m.own[k, 0]] = m.y[m.own[k, 1]]
    return project(m, row[0], m.q, m.u)


@njit(**OPTIONS)
def _exerted(m, joints, points, n):
    """Force and moment of a joint on its second body at its second point."""
    wrench = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if joints[n, NODE] >= 0:
        place, on = points[n], joints[n, ON]
        if on >= 0:
            place = plus(m.r[on], turned(m.R, 3 * on, place))
        arm = minus(m.r[joints[n, NODE]], place)
        wrench = force_at(scaled(float(joints[n, SIGN]), m.wrenches[joints[n, NODE]]), arm)
    for r in range(joints[n, FIRST_ROW], joints[n, LAST_ROW]):
        wrench = axpy(m.multipliers[r], row_wrench(m, r, 1), wrench)
    return wrench


@njit(**ENTRY)
def change(m, row, level, independent, fixed):
    """Make other speeds dependent at a row of the integration, as Python does; returns KEPT, CHANGED or FIXED.

    ``level``: see :func:`kaneflex.multibody.dynamics.independent_speeds.choose`. ``fixed``: True if the choice must not
    change.
    """
    _project(m, row)
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
    _project(m, row)
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


ENTRIES = {
    unfold: int64(SPACE, N, Fixed(5), N, N, N, N, N),
    change: int64(SPACE, N, CPointer(int64), CPointer(int64), boolean),
    rates_of: void(SPACE, N),
}
"""Signatures of the functions that C calls."""
