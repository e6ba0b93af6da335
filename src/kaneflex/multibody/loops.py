"""Loops of a mechanism: cuts closed by dependent coordinates, and what their reactions do to a tree's linear equations.

Every cut's rows are constraints between two sections. As many coordinates as there are rows follow from the others: the
motion is integrated in the independent ones alone, and where the loops are, in position, speed and acceleration, is
solved for on the bodies as they are deformed.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody import dense_lu, holds
from kaneflex.multibody.recursion import add_force, assemble, factorise, solve, twist_of
from kaneflex.multibody.tables import (
    ACCEL, ACTS, AT, BEGUN_AT, BENDS, BODIES, COLUMNS, CONTACT, CONTACTS, CONTACT_SIZE, COORDINATES, COURSE_OF, CUT,
    CUT_OF, CUT_ROWS, DEMAND, DEPENDENT, DOF, DRIVES, FIRST, FRAME, FRAME_SIZE, FREE, GRADIENT, HOLDS, INBOARD,
    JACOBIAN, JACOBIANS, JOINT, KEPT, KIND, LAST, LOOP, LOOP_PIVOTS, MEASURE, MIDDLE, MIDDLE_CUT, MODAL, NOW, NUMBERS,
    OPTIONS, OWNER, PARENT, PIVOTS, POINT, PRISMATIC, PUSH, RATE, REACTION, REACTIONS, REVOLUTE, ROW_OF, ROW_SIZE,
    SCHUR, SEC, SECTION, SECTIONS, SHAPES, SIDE, SPEEDS, STIFF, SWITCH, TOUCHING, VISCOUS, WHAT, WORKS, W_NOW, Y,
    YIELDING, apart, kernel, larger, of_holds, shifted,
)  # fmt: skip
from kaneflex.multibody.tree import accelerate, cut_rows, deform, demand, meet, move, place, prescribe, turned

CLOSED = 1e-10
"""Correction of a dependent coordinate, in rad or sizes of the mechanism, that is not worth another one."""


WORN = 8.0
"""How much more than an independent coordinate a dependent one may move, both in what counts as one in them."""


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
            kernel(m.kernels, JACOBIANS)(
                m.bodies[b, KIND], w, m.sections[n, POINT], w, plan[Y] + m.bodies[b, MODAL], w[f + 3], w[f + 4], w,
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
        gradient(m, plan[plan[ROW_OF] + r], plan[plan[CUT_OF] + r], plan[BENDS], at)
        for k in range(count):
            w[plan[LOOP] + count * r + k] = w[at + plan[plan[DEPENDENT] + k]]
    return dense_lu.factorise(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS])


@njit(**OPTIONS)
def close(m):
    """Put the dependent coordinates where the loops close (Newton); False where they don't."""
    apart()
    plan, w = m.plan, m.w
    count, before = plan[KEPT], math.inf
    deform(m)
    place(m)
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
        place(m)
    return count == 0


@njit(**OPTIONS)
def follow(m, t):
    """Everything moves as the independent coordinates say, dependent ones included; False: a loop doesn't close."""
    apart()
    plan, w = m.plan, m.w
    prescribe(m, t)
    if not close(m):
        return False
    count = plan[KEPT]
    for rate in range(1, 3):
        of = plan[RATE] if rate == 1 else plan[ACCEL]
        for k in range(count):
            w[of + plan[plan[DEPENDENT] + k]] = 0.0
        for turn in range(2 if count else 1):
            if plan[BENDS]:
                deform(m)
            if rate == 1:
                move(m)
            else:
                accelerate(m)
            if turn == 0 and count:
                cut_rows(m)
                for r in range(count):
                    w[plan[SIDE] + r] = -w[plan[CUT] + ROW_SIZE * plan[plan[ROW_OF] + r] + rate]
                dense_lu.substitute(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS], plan[SIDE])
                for k in range(count):
                    w[of + plan[plan[DEPENDENT] + k]] = w[plan[SIDE] + k]
    return True


@njit(**OPTIONS)
def stand(m, t):
    """Everything moves as all coordinates say, which close the loops already."""
    apart()
    prescribe(m, t)
    deform(m)
    place(m)
    move(m)
    accelerate(m)
    cut_rows(m)


@njit(**OPTIONS)
def reach(m, h, A):
    """Factors of M + h C + h^2 K of the tree, coordinates by unit reactions of the kept rows and of contacts, and what
    those do to these rows, at SCHUR; False: a pivot vanishes."""
    apart()
    if not factorise(m, h, A):
        return False
    plan, w = m.plan, m.w
    count = plan[KEPT] + m.pivots[YIELDING]
    for r in range(count):
        for k in range(plan[SPEEDS]):
            A[plan[PUSH] + k] = 0.0
        for k in range(plan[COORDINATES]):
            A[column(m, r) + k] = 0.0
        cut, k = row_at(m, r)
        n = holds.brought(m, r)
        for side in range(2):
            j = k + 3 * side
            add_force(m, A, m.acts[cut, AT + side], w[j], w[j + 1], w[j + 2])
            if n:
                size, j = holds.share(m, n, r), hold_row(m, n) + 3 * side
                add_force(m, A, m.acts[plan[DRIVES] + n, AT + side], size * w[j], size * w[j + 1], size * w[j + 2])
        solve(m, A, r if r < plan[KEPT] else r + 1)
        for q in range(count):
            A[plan[SCHUR] + count * q + r] = opening(m, A, q)
    return True


@njit(**OPTIONS)
def factorise_closed(m, h, A, pivots):
    """Factors of M + h C + h^2 K with its loops closed; False where motion or reactions are not determined.

    Beside the tree's factors: coordinates by unit reactions of the kept rows, and what those do to the cuts.
    """
    apart()
    if not reach(m, h, A):
        return False
    plan, w = m.plan, m.w
    count = plan[KEPT] + m.pivots[YIELDING]
    for r in range(plan[KEPT], count):
        n = m.pivots[plan[TOUCHING] + r - plan[KEPT]]
        k = plan[CONTACT] + CONTACT_SIZE * n
        own = plan[SCHUR] + (count + 1) * r
        soft = 1.0 / (h * (w[k + VISCOUS] + h * w[k + STIFF])) if n >= 0 else holds.compliance(m, n, h, A[own])
        A[own] += soft
    return dense_lu.factorise(A, plan[SCHUR], count, m.pivots, pivots)


@njit(**OPTIONS)
def row_at(m, r):
    """The act of a kept row, or of a contact or a hold after these, and where its Jacobian is."""
    plan = m.plan
    if r < plan[KEPT]:
        return plan[plan[CUT_OF] + r], plan[MIDDLE_CUT] + ROW_SIZE * plan[plan[ROW_OF] + r] + 3
    n = m.pivots[plan[TOUCHING] + r - plan[KEPT]]
    return (plan[CONTACTS] if n >= 0 else plan[DRIVES]) + n, hold_row(m, n)


@njit(**OPTIONS)
def hold_row(m, n):
    """Where the Jacobian of a contact or a hold is."""
    return m.plan[MIDDLE_CUT] + ROW_SIZE * (m.plan[CUT_ROWS] + n) + 3


@njit(**OPTIONS)
def column(m, r):
    """Where the coordinates by such a row's unit force are: the answer stands between those of cuts and contacts."""
    return m.plan[COLUMNS] + m.plan[COORDINATES] * (r if r < m.plan[KEPT] else r + 1)


@njit(**OPTIONS)
def opening(m, A, r):
    """Rate of a row by the speeds at PUSH."""
    w = m.w
    cut, k = row_at(m, r)
    total = 0.0 * A[m.plan[PUSH]]
    for side in range(2):
        t_0, t_1, t_2 = twist_of(m, A, m.acts[cut, AT + side])
        j = k + 3 * side
        total += w[j] * t_0 + w[j + 1] * t_1 + w[j + 2] * t_2
    return total


@njit(**OPTIONS)
def solve_closed(m, A, pivots):
    """What forces of the coordinates bring about: both in the row of COLUMNS after the kept ones, and at REACTION what
    these need to stay closed, and what contacts push back."""
    apart()
    plan = m.plan
    count, n, x = plan[KEPT] + m.pivots[YIELDING], plan[COORDINATES], plan[REACTION]
    for k in range(plan[SPEEDS]):
        A[plan[PUSH] + k] = 0.0
    solve(m, A, plan[KEPT])
    if count:
        for r in range(count):
            A[x + r] = holds.wanted(m, A, r) - opening(m, A, r)
        dense_lu.substitute(A, plan[SCHUR], count, m.pivots, pivots, x)
        answer = plan[COLUMNS] + n * plan[KEPT]
        for r in range(count):
            for i in range(n):
                A[answer + i] += A[column(m, r) + i] * A[x + r]


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
def row_size(m):
    """Numbers of a row of the integration: t, coordinates, rates, accelerations, reactions of the cuts and holds, modes
    of the holds, BEGUN_AT of the contacts, where holds stuck, works."""
    return works_at(m) + m.plan[WORKS]


@njit(**OPTIONS)
def works_at(m):
    """Where the works are in a row."""
    return 1 + 3 * m.plan[COORDINATES] + m.plan[REACTIONS] + standing(m)


@njit(**OPTIONS)
def standing(m):
    """Numbers of a row that say how contacts and holds stand."""
    return m.plan[ACTS] - m.plan[CONTACTS] + 2 * (m.plan[DRIVES] - m.plan[HOLDS])


@njit(**OPTIONS)
def take(m, row):
    """The motion of a row."""
    apart()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    for i in range(n):
        w[plan[Y] + i], w[plan[RATE] + i], w[plan[ACCEL] + i] = row[1 + i], row[1 + n + i], row[1 + 2 * n + i]
    for r in range(plan[REACTIONS]):
        w[plan[NOW] + r] = row[1 + 3 * n + r]
    stands(m, shifted(row, 1 + 3 * n + plan[REACTIONS]))


@njit(**OPTIONS)
def stands(m, row):
    """How contacts and holds stand by a row."""
    plan, w = m.plan, m.w
    held, touching = plan[DRIVES] - plan[HOLDS], plan[ACTS] - plan[CONTACTS]
    for k in range(held + touching):
        w[plan[CONTACT] + CONTACT_SIZE * (k - held) + BEGUN_AT] = row[k]
    holds.taken(m, row, held + touching)


@njit(**OPTIONS)
def give(m, t, row):
    """The motion as a row, its works left."""
    apart()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    row[0] = t
    for i in range(n):
        row[1 + i], row[1 + n + i], row[1 + 2 * n + i] = w[plan[Y] + i], w[plan[RATE] + i], w[plan[ACCEL] + i]
    for r in range(plan[REACTIONS]):
        row[1 + 3 * n + r] = w[plan[NOW] + r]
    held, touching = plan[DRIVES] - plan[HOLDS], plan[ACTS] - plan[CONTACTS]
    for k in range(held + touching):
        row[1 + 3 * n + plan[REACTIONS] + k] = w[plan[CONTACT] + CONTACT_SIZE * (k - held) + BEGUN_AT]
    holds.given(m, row, 1 + 3 * n + plan[REACTIONS] + held + touching)


@njit(**OPTIONS)
def copy(w, of, into, count):
    """Copy numbers of the tables."""
    for k in range(count):
        w[into + k] = w[of + k]


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


@njit(**OPTIONS)
def settle_now(m, t, A, h, turns):
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
