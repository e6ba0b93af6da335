"""Compiled measures of how well the loops determine the dependent coordinates."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline
from kaneflex.multibody.compile.values import width
from kaneflex.multibody.dynamics.algebra import linear_size
from kaneflex.multibody.dynamics.cut_rows import is_kept
from kaneflex.multibody.dynamics.interactions import gradient
from kaneflex.multibody.dynamics.loop_closure import move_dependent, solve_loops
from kaneflex.multibody.dynamics.wrenches import row_wrench
from kaneflex.multibody.model.layout import (
    BENDS,
    BODIES,
    CHANGE_POINT,
    COORDINATES,
    CROSSING,
    DEPENDENT,
    DOF,
    FIRST,
    FREED,
    GRADIENT,
    JOINT_ROWS,
    KEPT,
    LOOP,
    LOOP_PIVOTS,
    MEASURE,
    ROW_OF,
    SHAPES,
    SIDE,
)
from kaneflex.support.inner import once

WORN = 8.0
"""Ratio of a dependent coordinate's motion to an independent one's, in their units, above which they are exchanged."""
_MOVED = 1e-6
"""Ratio of motions, in their units, above which an independent coordinate moves a dependent one."""
_SLIGHT = 0.1
"""Share of the largest derivative with respect to any coordinate: smaller ones don't scale a pivot."""


@njit(**OPTIONS)
def orientation(m):
    """Sign of the determinant of the kept rows' derivatives with respect to dependent coordinates."""
    plan, sign = m.plan, 1.0
    for k in range(plan[KEPT]):
        if (m.w[plan[LOOP] + (plan[KEPT] + 1) * k] < 0.0) != (m.pivots[plan[LOOP_PIVOTS] + k] != k):
            sign = -sign
    return sign


@njit(**OPTIONS)
def is_dependent(m, i):
    """True if a coordinate is dependent by the current choice."""
    for r in range(m.plan[KEPT]):
        if m.plan[m.plan[DEPENDENT] + r] == i:
            return True
    return False


@njit(**OPTIONS)
def _largest(m, row):
    """Largest of the derivatives at ``row``, in units of each coordinate."""
    size = 0.0
    for i in range(m.plan[COORDINATES]):
        size = larger(size, abs(m.w[row + i]) * m.w[m.plan[MEASURE] + i])
    return size


@njit(**OPTIONS)
def pushes(m, row):
    """True if a row's reaction is a force and not just a moment."""
    return linear_size(row_wrench(m, row, 0)) != 0.0


@njit(**OPTIONS)
def margin(m):
    """Least pivot of these derivatives, as a share of its coordinate's largest derivative: 0 at a singular
    position; and the number of its row."""
    no_inline()
    plan, w, least, of_least = m.plan, m.w, 1.0, 0
    of_forces = of_moments = 1e-300
    for r in range(plan[KEPT]):
        size = _largest(m, plan[GRADIENT] + plan[COORDINATES] * r)
        if pushes(m, plan[plan[ROW_OF] + r]):
            of_forces = larger(of_forces, size)
        else:
            of_moments = larger(of_moments, size)
    for k in range(plan[KEPT]):
        row, i = m.pivots[plan[LOOP_PIVOTS] + k], plan[plan[DEPENDENT] + k]
        for j in range(k - 1, -1, -1):  # undo the row exchanges
            if row == m.pivots[plan[LOOP_PIVOTS] + j]:
                row = j
        force = pushes(m, plan[plan[ROW_OF] + row])
        size = _SLIGHT * (of_forces if force else of_moments)
        for r in range(plan[KEPT]):
            if pushes(m, plan[plan[ROW_OF] + r]) == force:
                derivative = m.J[plan[COORDINATES] * r + i]
                size = larger(size, abs(derivative) * w[plan[MEASURE] + i])
        share = w[plan[MEASURE] + i] / (size * abs(w[plan[LOOP] + (plan[KEPT] + 1) * k]))
        if share < least:
            least, of_least = share, row
    return least, of_least


@njit(**OPTIONS)
def determined(m):
    """True if bodies are rigid and at most one independent coordinate moves each dependent one."""
    no_inline()
    plan, w, count, movers = m.plan, m.w, m.plan[KEPT], m.plan[CROSSING] + CHANGE_POINT
    for b in range(plan[BODIES]):
        if m.bodies[b, SHAPES]:
            return False
    for k in range(count):
        w[movers + k] = 0.0
    for i in range(plan[COORDINATES]):
        if is_dependent(m, i):
            continue
        move_dependent(m, i)
        for k in range(count):
            one = w[plan[MEASURE] + plan[plan[DEPENDENT] + k]]
            w[movers + k] += abs(w[plan[SIDE] + k]) * w[plan[MEASURE] + i] > _MOVED * one
            if w[movers + k] > 1.0:
                return False
    return True


@once
@njit(**OPTIONS)
def outgrown(m):
    """True if a dropped row of a cut joint depends on the kept ones with a much larger coefficient than its own size.

    If two kept rows become equal, a third one that depends on both becomes independent.
    """
    no_inline()
    plan, w = m.plan, m.w
    count, n = plan[KEPT], plan[COORDINATES]
    out, most = plan[GRADIENT] + n * count, 0.0
    for r in range(count):
        most = larger(most, _largest(m, plan[GRADIENT] + n * r))
    for row in range(plan[JOINT_ROWS]):
        if is_kept(m, row):
            continue
        for i in range(n):
            w[out + i] = 0.0
        gradient(m, row, plan[BENDS] != 0, out)
        least = WORN * larger(_largest(m, out), 1e-6 * most)
        for r in range(count):
            for k in range(count):
                w[plan[SIDE] + k] = 1.0 if k == r else 0.0
            solve_loops(m)
            share = 0.0
            for k in range(count):
                share += w[out + plan[plan[DEPENDENT] + k]] * w[plan[SIDE] + k]
            if abs(share) * _largest(m, plan[GRADIENT] + n * r) > least:
                return True
    return False


@njit(**OPTIONS)
def ill_conditioned(m):
    """True if an independent coordinate of a joint, or in space of a shape, should replace a dependent one that moves
    much more.

    Near a dead centre the loops no longer determine the dependent coordinates chosen far from it, but others. Gradients
    are those of the last loop closure.
    """
    no_inline()
    plan, w = m.plan, m.w
    count = plan[KEPT]
    if count == 0:
        return False
    if count < plan[JOINT_ROWS] and outgrown(m):
        return True
    for b in range(plan[BODIES]):
        shapes = m.bodies[b, SHAPES] if width(m) == 6 else 0
        for i in range(m.bodies[b, FIRST], m.bodies[b, FIRST] + m.bodies[b, DOF] + shapes):
            if plan[plan[FREED] + i] == 0 or is_dependent(m, i):
                continue
            move_dependent(m, i)
            for r in range(count):
                moved = abs(w[plan[SIDE] + r]) / w[plan[MEASURE] + plan[plan[DEPENDENT] + r]]
                if moved * w[plan[MEASURE] + i] > WORN:
                    return True
    return False
