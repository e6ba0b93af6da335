"""Loops of a mechanism: cuts closed by dependent coordinates, and what their reactions do to a tree's linear equations.

Every cut's rows are constraints between two sections. As many coordinates as there are rows follow from the others: the
motion is integrated in the independent ones alone, and where the loops are, in position, speed and acceleration, is
solved for on the bodies as they are deformed.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody import dense_lu, holds
from kaneflex.multibody.acting import meet
from kaneflex.multibody.closed_factors import factorise_closed, solve_closed
from kaneflex.multibody.inner import once
from kaneflex.multibody.recursion import assemble
from kaneflex.multibody.rows import copy
from kaneflex.multibody.stand_ins import of_holds
from kaneflex.multibody.tables import (
    ACCEL, ACTS, AT, BENDS, BODIES, COLUMNS, CONTACTS, COORDINATES, COURSE_OF, CUT, CUTS, CUT_OF, CUT_ROWS, DEMAND,
    DEPENDENT, DOF, FIRST, FRAME, FRAME_SIZE, FREE, GRADIENT, HOLDS, INBOARD, JACOBIAN, JACOBIANS, JOINT, JOINT_ROWS,
    KEPT, LAST, LED, LOOP, LOOP_PIVOTS, MEASURE, MIDDLE, MIDDLE_CUT, MODAL, NOW, NUMBERS, OPTIONS, OWNER, PARENT,
    PIVOTS, POINT, PRISMATIC, RATE, REACTION, REACTIONS, REVOLUTE, ROW_AT, ROW_OF, ROW_SIZE, SEC, SECTION, SECTIONS,
    SHAPES, SIDE, SWITCH, WHAT, W_NOW, Y, YIELDING, apart, kernel, larger, of_body, turned,
)  # fmt: skip
from kaneflex.multibody.tree import accelerate, cut_rows, deform, demand, move, place, prescribe

CLOSED = 1e-10
"""Correction of a dependent coordinate, in rad or sizes of the mechanism, that is not worth another one."""
NEAR = 1e-6
"""Correction of one that is small enough in a stage: the next would be its square, and the gradients that it was found
by, wrong by as much, find what is missing of rates that are nearly known."""


WORN = 8.0
"""How much more than an independent coordinate a dependent one may move, both in what counts as one in them."""


@once
@njit(**OPTIONS)
def gradient(m, row, cut, bends, out):
    """Add a cut's row's derivatives by all coordinates to those at ``out``; by shapes only where asked.

    A section's force goes inwards from body to body as it is, its moment changes with the point.
    """
    apart()
    plan, w = m.plan, m.w
    for side in range(2):
        n, k = m.acts[cut, AT + side], plan[CUT] + ROW_SIZE * row + 3 + 3 * side
        x, z, turn = w[k], w[k + 1], w[k + 2]
        while m.sections[n, OWNER] >= 0:
            b = m.sections[n, OWNER]
            inboard, first, kind = m.bodies[b, INBOARD], out + m.bodies[b, FIRST], m.bodies[b, JOINT]
            at, own = plan[SECTION] + SEC * n, plan[SECTION] + SEC * inboard
            moved = turn + (w[at] - w[own]) * z - (w[at + 1] - w[own + 1]) * x
            if bends:
                size, i = m.bodies[b, SHAPES], out + m.bodies[b, MODAL]
                p, q = plan[W_NOW] + m.sections[n, JACOBIAN] + 3, plan[W_NOW] + m.sections[inboard, JACOBIAN] + 3
                for j in range(size):
                    w[i + j] += w[p + j] * x + w[p + j + 3 + size] * z + w[p + j + 2 * (3 + size)] * turn
                    w[i + j] -= w[q + j] * x + w[q + j + 3 + size] * z + w[q + j + 2 * (3 + size)] * moved
            turn, n = moved, m.bodies[b, PARENT]
            up = plan[SECTION] + SEC * n
            if kind == REVOLUTE:
                w[first] += w[m.bodies[b, NUMBERS]] * turn
            elif kind == PRISMATIC:
                d_x, d_y = turned(w, w[up + 2], m.bodies[b, NUMBERS] + 2)
                w[first] += x * d_x + z * d_y
            elif kind == FREE:
                w[first] += x
                w[first + 1] += z
                w[first + 2] += turn
                break
            turn += (w[own] - w[up]) * z - (w[own + 1] - w[up + 1]) * x


@njit(**OPTIONS)
def bent(m):
    """W of all sections where the bodies are now."""
    apart()
    plan, w = m.plan, m.w
    for b in range(plan[BODIES]):
        f = plan[FRAME] + FRAME_SIZE * b
        for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
            kernel(of_body(m, b), JACOBIANS)(
                w, m.sections[n, POINT], w, plan[Y] + m.bodies[b, MODAL], w[f + 3], w[f + 4], w,
                plan[W_NOW] + m.sections[n, JACOBIAN],
            )  # fmt: skip


@njit(**OPTIONS)
def gradients(m):
    """Derivatives of the kept rows where everything is, and the factors of those by dependent coordinates."""
    apart()
    plan, w = m.plan, m.w
    count, n = plan[KEPT], plan[COORDINATES]
    if plan[BENDS]:
        bent(m)
    for r in range(count):
        at = plan[GRADIENT] + n * r
        for i in range(n):
            w[at + i] = 0.0
        gradient(m, plan[plan[ROW_OF] + r], plan[plan[CUT_OF] + r], plan[BENDS] != 0, at)
        for k in range(count):
            w[plan[LOOP] + count * r + k] = w[at + plan[plan[DEPENDENT] + k]]
    return dense_lu.factorise(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS])


@njit(**OPTIONS)
def orientation(m):
    """Sign of the determinant of the kept rows' derivatives by dependent coordinates, by the factors of these."""
    plan, sign = m.plan, 1.0
    for k in range(plan[KEPT]):
        if (m.w[plan[LOOP] + (plan[KEPT] + 1) * k] < 0.0) != (m.pivots[plan[LOOP_PIVOTS] + k] != k):
            sign = -sign
    return sign


@njit(**OPTIONS)
def close(m, near):
    """Put the dependent coordinates where the loops close (Newton); False where they don't.

    ``near``: a correction after which no other one is asked for; that may be larger than CLOSED, or 0.
    """
    apart()
    plan, w = m.plan, m.w
    count, before = plan[KEPT], math.inf
    deform(m)
    place(m, 0)
    for turn in range(20 if count else 0):
        cut_rows(m)
        if not gradients(m):
            return False
        for r in range(count):
            w[plan[SIDE] + r] = -w[plan[CUT] + ROW_SIZE * plan[plan[ROW_OF] + r]]
        dense_lu.substitute(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS], plan[SIDE])
        size = 0.0
        for k in range(count):
            i = plan[plan[DEPENDENT] + k]
            w[plan[Y] + i] += w[plan[SIDE] + k]
            size = larger(size, abs(w[plan[SIDE] + k]) / w[plan[MEASURE] + i])
        if size < CLOSED:
            return True
        if not size < 1e3 or (turn > 8 and size > before):
            return False
        before = size
        if plan[BENDS]:
            deform(m)
        place(m, plan[LED])
        if size < near:
            return True
    return count == 0


@njit(**OPTIONS)
def follow(m, t):
    """Everything moves as the independent coordinates say, dependent ones included; False: a loop doesn't close."""
    for k in range(m.plan[KEPT]):
        i = m.plan[m.plan[DEPENDENT] + k]
        m.w[m.plan[RATE] + i] = m.w[m.plan[ACCEL] + i] = 0.0
    return follow_on(m, t, 0.0)


@njit(**OPTIONS)
def follow_on(m, t, near):
    """The same where rates and accelerations of dependent coordinates are nearly known; ``near``: see :func:`close`."""
    apart()
    plan, w = m.plan, m.w
    prescribe(m, t)
    if not close(m, near):
        return False
    count = plan[KEPT]
    for rate in range(1, 3):
        of = plan[RATE] if rate == 1 else plan[ACCEL]
        for turn in range(2 if count else 1):
            if plan[BENDS]:
                deform(m)
            if rate == 1:
                move(m, turn * plan[LED])
            else:
                accelerate(m, turn * plan[LED])
            if turn == 0 and count:
                cut_rows(m)
                for r in range(count):
                    w[plan[SIDE] + r] = -w[plan[CUT] + ROW_SIZE * plan[plan[ROW_OF] + r] + rate]
                dense_lu.substitute(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS], plan[SIDE])
                for k in range(count):
                    w[of + plan[plan[DEPENDENT] + k]] += w[plan[SIDE] + k]
    return True


@njit(**OPTIONS)
def stand(m, t):
    """Everything moves as all coordinates say, which close the loops already."""
    apart()
    prescribe(m, t)
    deform(m)
    place(m, 0)
    move(m, 0)
    accelerate(m, 0)
    cut_rows(m)


@njit(**OPTIONS)
def _largest(m, row):
    """Of the derivatives at ``row``, by what counts as one in each coordinate."""
    size = 0.0
    for i in range(m.plan[COORDINATES]):
        size = larger(size, abs(m.w[row + i]) * m.w[m.plan[MEASURE] + i])
    return size


@once
@njit(**OPTIONS)
def _outgrown(m):
    """Whether a cut's row that is dropped follows from the kept ones by far more of one of them than there is of it.

    Where two of them come to say the same, a third one that follows from both no longer does.
    """
    apart()
    plan, w = m.plan, m.w
    count, n = plan[KEPT], plan[COORDINATES]
    out, most = plan[GRADIENT] + n * count, 0.0
    for r in range(count):
        most = larger(most, _largest(m, plan[GRADIENT] + n * r))
    for cut in range(plan[CUTS], plan[HOLDS]):
        last = m.acts[cut + 1, ROW_AT] if cut + 1 < plan[HOLDS] else plan[JOINT_ROWS]
        for row in range(m.acts[cut, ROW_AT], last):
            kept = False
            for r in range(count):
                kept = kept or plan[plan[ROW_OF] + r] == row
            if kept:
                continue
            for i in range(n):
                w[out + i] = 0.0
            gradient(m, row, cut, plan[BENDS] != 0, out)
            least = WORN * larger(_largest(m, out), 1e-6 * most)
            for r in range(count):
                for k in range(count):
                    w[plan[SIDE] + k] = 1.0 if k == r else 0.0
                dense_lu.substitute(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS], plan[SIDE])
                share = 0.0
                for k in range(count):
                    share += w[out + plan[plan[DEPENDENT] + k]] * w[plan[SIDE] + k]
                if abs(share) * _largest(m, plan[GRADIENT] + n * r) > least:
                    return True
    return False


@njit(**OPTIONS)
def worn(m):
    """Whether an independent joint's coordinate should take the place of a dependent one that moves far more than it.

    Where a linkage nears its dead centre the loops no longer determine the coordinates that were chosen far from there;
    by others they do. Gradients are those of the last closing.
    """
    apart()
    plan, w = m.plan, m.w
    count, n = plan[KEPT], plan[COORDINATES]
    if count == 0:
        return False
    if count < plan[JOINT_ROWS] and _outgrown(m):
        return True
    for b in range(plan[BODIES]):
        if m.bodies[b, COURSE_OF] >= 0:
            continue
        for i in range(m.bodies[b, FIRST], m.bodies[b, FIRST] + m.bodies[b, DOF]):
            chosen = False
            for r in range(count):
                chosen = chosen or plan[plan[DEPENDENT] + r] == i
                w[plan[SIDE] + r] = w[plan[GRADIENT] + n * r + i]
            if chosen:
                continue
            dense_lu.substitute(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS], plan[SIDE])
            for r in range(count):
                moved = abs(w[plan[SIDE] + r]) / w[plan[MEASURE] + plan[plan[DEPENDENT] + r]]
                if moved * w[plan[MEASURE] + i] > WORN:
                    return True
    return False


@njit(**OPTIONS)
def middle(m):
    """Matrices of the factors to come where everything is now."""
    apart()
    plan, w = m.plan, m.w
    assemble(m)
    copy(w, plan[SECTION], plan[MIDDLE], SEC * m.bodies[plan[BODIES] - 1, LAST])
    copy(w, plan[CUT], plan[MIDDLE_CUT], ROW_SIZE * (plan[CUT_ROWS] + plan[ACTS] - plan[CONTACTS]))


@of_holds(None)
@njit(**OPTIONS)
def hold_now(m):
    """Rows of the holds where everything is."""
    apart()
    for act in range(m.plan[CONTACTS], m.plan[ACTS]):
        if m.acts[act, WHAT] != SWITCH:
            meet(m, act)
    for n in range(-holds.count(m), 0):
        holds.row_of(m, n)


@once
@njit(**OPTIONS)
def mend(m, t, A, h, turns):
    """Mend accelerations and reactions where everything is, in as many turns; False: singular.

    ``h``: 0, or 1 where STIFFNESS is a mass that coordinates have besides.
    """
    apart()
    plan, w = m.plan, m.w
    hold_now(m)
    middle(m)
    m.pivots[YIELDING] = holds.stuck_rows(m, 0)
    if not factorise_closed(m, h, A, plan[PIVOTS]):
        return False
    answer = plan[COLUMNS] + plan[KEPT] * plan[COORDINATES]
    for _ in range(turns):
        demand(m, t)
        for k in range(plan[COORDINATES]):
            A[answer + k] = -w[plan[DEMAND] + k]
        holds.hold_still(m, A)
        solve_closed(m, A, plan[PIVOTS])
        for r in range(plan[KEPT]):
            w[plan[NOW] + plan[plan[ROW_OF] + r]] += A[plan[REACTION] + r]
        holds.take_up(m, A)
        for i in range(plan[COORDINATES]):
            w[plan[ACCEL] + i] += A[answer + i]
        if not follow(m, t):
            return False
    return True


@once
@njit(**OPTIONS)
def project_now(m, t, A, h, turns):
    """Accelerations and reactions of the cuts where and as fast as the independent coordinates are; False: singular.

    ``h`` and ``turns``: see :func:`mend`.
    """
    apart()
    plan, w = m.plan, m.w
    for i in range(plan[COORDINATES]):
        w[plan[ACCEL] + i] = 0.0
    for r in range(plan[REACTIONS]):
        w[plan[NOW] + r] = 0.0
    return follow(m, t) and mend(m, t, A, h, turns)
