"""Holds in the compiled equations: rows that stick at times and slip at others, as dry friction.

A hold is a row between two sections like those of joints: a slip coordinate, its two rates, and its Jacobian with
respect to the sections' twists. Its index is negative, -1 for the last one; its interaction precedes those of the
drives, its row of CUT follows the cut joints', its numbers precede the contacts'. MODE is its state: IDLE (its contact
is open), 1 or -1 while slipping in that direction, STUCK, or FLOWS if its force is a function of the state. While
slipping, its force follows its law (:mod:`kaneflex.generated.friction`); while stuck it is an unknown: a rigid row of
the factors, and a reaction of NOW and of the stages like those of cut joints. In mode BENDS, bristles exert it: also an
unknown, whose row of the factors is their force law (``lugre``). The factors also contain the friction forces caused
by the reactions.

To add a kind of hold: a number after ALONG in ``model.layout`` with its kernel in :func:`row_of`, and its interaction
in ``model.interactions``. Setting MODE to STUCK fixes it: in the stages (:func:`prescribe_in_stages`), at an instant
(``loop_closure.mend``), and in position and speed at the end of every step (``stick_slip.restore_stuck``). Its force is
at HOLDING.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.generated import friction as laws
from kaneflex.generated import joints
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.compile.stand_ins import of_holds
from kaneflex.multibody.model.layout import (
    ACTS, ALONG, AT, CONTACT, CONTACTS, CONTACT_SIZE, COORDINATES, CUT, CUT_OF, CUT_ROWS, DRIVES, HOLDING, HOLDS, KEPT,
    LIMIT, MODE, NORMAL, NOW, NUMBERS_AT, ON, OPTIONS, PLACE, PUSH_NOW, REACTION, REACTIONS, ROW_AT, ROW_OF, ROW_SIZE,
    SCHUR, SEC, SECTION, SLIP, SLIP_RATE, SLOPE, SPEED_SIZE, STAGE_H, STAGE_R, STUCK_AT, TOUCHING, TURN, WANTED, WHAT,
    YIELDING, apart, larger, shifted, smaller,
)  # fmt: skip

_SOFT = 1e-9
"""Additional compliance of a stuck row, as a share of its own, at the largest force limit."""
_SOFTEST = 1e3
"""Factor on it at a small force limit."""
IDLE, STUCK, FLOWS, BENDS = 0.0, 2.0, 3.0, 4.0
"""Modes of a hold besides 1 and -1."""
MU_AT, STATIC_AT, VISCOUS_AT, PRELOAD_AT, ARM, LAW_AT, OF_AT = 3, 4, 7, 8, 9, 10, 11
"""Places among its law's numbers: both coefficients, viscous part, preload, arm, number of its law, and the
interaction that it belongs to."""


@njit(**OPTIONS)
def count(m):
    """Number of holds."""
    return m.plan[DRIVES] - m.plan[HOLDS]


@njit(**OPTIONS)
def number_at(m, n):
    """Place of the numbers of a hold."""
    return m.plan[CONTACT] + CONTACT_SIZE * n


@njit(**OPTIONS)
def virtual_inertia(m, n):
    """Virtual inertia [kg m^2] that a hold removes, see ``model.interactions``; 0 for friction."""
    j = m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    return m.w[j + ARM] if m.w[j + LAW_AT] < 0.0 else 0.0


@njit(**OPTIONS)
def row_of(m, n):
    """Row of a hold at the current state, for a contact after :func:`meet`; returns the place of its numbers."""
    apart()
    plan, w, act, k = m.plan, m.w, m.plan[DRIVES] + n, number_at(m, n)
    first, second, j = m.acts[act, AT], m.acts[act, ON], m.acts[act, NUMBERS_AT]
    row = plan[CUT] + ROW_SIZE * row_at(m, n)
    sec = shifted(w, plan[SECTION])
    if m.acts[act, WHAT] == ALONG:
        of = int(w[j + OF_AT])
        touching.along(m.acts[of, WHAT], sec, SEC * first, SEC * second, w, m.acts[of, NUMBERS_AT], w, row)
    elif m.acts[act, WHAT] == TURN:
        joints.turn(sec, first, second, w[j], w[j + 1], w[j + 2], w, row)
    else:
        joints.slide(sec, first, second, w[j], w[j + 1], w[j + 2], w, row)
    w[k + PLACE], w[k + SLIP], w[k + SLIP_RATE] = w[row], w[row + 1], w[row + 2]
    size = 0.0
    for side in range(2):
        at, own = SEC * m.acts[act, AT + side] + 3, row + 3 + 3 * side
        for i in range(3):
            size += abs(w[own + i] * sec[at + i])
    w[k + SPEED_SIZE] = size
    return k


@njit(**OPTIONS)
def row_at(m, n):
    """Index of a hold's row."""
    return m.plan[CUT_ROWS] + n


@njit(**OPTIONS)
def normal_force(m, n):
    """Normal force of a hold [N or N m]: its contact's force, or its joint's reactions in NOW."""
    plan, w, j = m.plan, m.w, m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    of, arm = int(w[j + OF_AT]), w[j + ARM]
    if m.acts[plan[DRIVES] + n, WHAT] == ALONG:
        return larger(w[plan[CONTACT] + CONTACT_SIZE * (of - plan[CONTACTS]) + PUSH_NOW], 0.0)
    row = plan[NOW] + m.acts[of, ROW_AT]
    if m.acts[plan[DRIVES] + n, WHAT] == TURN:
        return arm * math.sqrt(w[row] * w[row] + w[row + 1] * w[row + 1])
    return larger(abs(w[row]), arm * abs(w[row + 1]))


@of_holds(None)
@njit(**OPTIONS)
def exert(m):
    """Force of every hold at the current state, at NOW and HOLDING; contacts are evaluated before."""
    apart()
    plan, w = m.plan, m.w
    for n in range(-count(m), 0):
        k, j = row_of(m, n), m.acts[plan[DRIVES] + n, NUMBERS_AT]
        place, v, mode = plan[NOW] + row_at(m, n), w[k + SLIP], w[k + MODE]
        if virtual_inertia(m, n) > 0.0:
            w[place] = virtual_inertia(m, n) * w[k + SLIP_RATE]
            continue
        N = normal_force(m, n)
        w[k + NORMAL], w[k + LIMIT] = N, laws.limit(w, j, N)
        if mode == IDLE:
            w[place] = 0.0
        elif mode == FLOWS:
            w[place] = -w[j + VISCOUS_AT] * v
        elif mode != STUCK and mode != BENDS:
            w[place] = -mode * laws.dry(w, j, N, v) - w[j + VISCOUS_AT] * v
        w[k + HOLDING] = w[place]


@of_holds(0)
@njit(**OPTIONS)
def rows_now(m, first):
    """Add stuck holds to the rows of factors at an instant, after ``first`` others; returns their number."""
    apart()
    found = 0
    for n in range(-count(m), 0):
        w, k = m.w, number_at(m, n)
        if w[k + MODE] == STUCK or w[k + MODE] == BENDS or virtual_inertia(m, n) > 0.0:
            m.pivots[m.plan[TOUCHING] + first + found] = n
            found += 1
            w[k + SLOPE] = 0.0
        if w[k + MODE] == BENDS:
            j = m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
            lugre.know(w, k, j, normal_force(m, n), w[k + SLIP], w[k + STUCK_AT], 0.0)
    return found


@of_holds(0)
@njit(**OPTIONS)
def rows_of_step(m, first, h, state):
    """Add holds to the rows of a step's factors, with the state halfway from ``here``, after ``first`` contacts;
    returns their number."""
    apart()
    plan, w, found = m.plan, m.w, 0
    for r in range(plan[REACTIONS]):
        w[plan[NOW] + r] = state[1 + 3 * plan[COORDINATES] + r]
    for n in range(-count(m), 0):
        k, j = row_of(m, n), m.acts[plan[DRIVES] + n, NUMBERS_AT]
        mode, w[k + SLOPE] = w[k + MODE], 0.0
        if mode == BENDS:
            lugre.know(w, k, j, normal_force(m, n), w[k + SLIP], state[row_place(m, n)], 0.5 * h)
        elif mode != IDLE and mode != STUCK and virtual_inertia(m, n) == 0.0:
            w[k + SLOPE] = w[j + VISCOUS_AT]
            if mode != FLOWS:
                w[k + SLOPE] = larger(w[j + VISCOUS_AT] + laws.dry_slope(w, j, normal_force(m, n), w[k + SLIP]), 0.0)
        if mode == STUCK or mode == BENDS or w[k + SLOPE] > 0.0 or virtual_inertia(m, n) > 0.0:
            m.pivots[plan[TOUCHING] + first + found] = n
            found += 1
    return found


@of_holds(0.0)
@njit(**OPTIONS)
def largest_limit(m, rows, A):
    """Largest force limit of stuck rows of the factors, as its square times the row's response to a unit force."""
    largest = 0.0
    for r in range(m.plan[KEPT], rows):
        n = m.pivots[m.plan[TOUCHING] + r - m.plan[KEPT]]
        if n < 0 and m.w[number_at(m, n) + MODE] == STUCK:
            largest = larger(largest, m.w[number_at(m, n) + LIMIT] ** 2 * abs(A[m.plan[SCHUR] + (rows + 1) * r]))
    return largest


@of_holds(0.0)
@njit(**OPTIONS)
def compliance(m, n, h, own, largest):
    """Additional compliance of a hold's row in the factors; ``largest``: see :func:`largest_limit`.

    Almost zero for a stuck hold, and without effect after iterative refinement. For redundant holds it determines the
    distribution of force: in proportion to their limits.
    """
    slope, limit = m.w[number_at(m, n) + SLOPE], m.w[number_at(m, n) + LIMIT]
    if virtual_inertia(m, n) > 0.0:
        return 0.0 * h - 1.0 / virtual_inertia(m, n)
    if slope > 0.0:
        return 1.0 / (h * slope)
    share = math.sqrt(largest / (limit * limit * abs(own) + 1e-300))
    return _SOFT * own * larger(1.0, smaller(share, _SOFTEST)) + 0.0 * h


@of_holds(0.0)
@njit(**OPTIONS)
def prescribed(m, A, r):
    """Acceleration prescribed to a stuck row of the factors; for bristles the missing force."""
    if r < m.plan[KEPT]:
        return 0.0 * A[0]
    n = m.pivots[m.plan[TOUCHING] + r - m.plan[KEPT]]
    return A[m.plan[WANTED] - 1 - n] if n < 0 else 0.0 * A[0]


@of_holds(None)
@njit(**OPTIONS)
def prescribe_nothing(m, A):
    """Set prescribed accelerations of all rows to zero."""
    for n in range(count(m)):
        A[m.plan[WANTED] + n] = 0.0 * A[0]


@of_holds(0)
@njit(**OPTIONS)
def slips_by(m, r):
    """Slipping hold whose friction depends on the reaction of a factors' row; 0: none."""
    apart()
    for n in range(-count(m), 0):
        mode = m.w[number_at(m, n) + MODE]
        if (mode == 1.0 or mode == -1.0) and presses(m, n, r):
            return n
    return 0


@njit(**OPTIONS)
def presses(m, n, r):
    """True if the reaction of a factors' row is the normal force of a hold."""
    plan = m.plan
    of = plan[CONTACTS] + m.pivots[plan[TOUCHING] + r - plan[KEPT]]
    if r < plan[KEPT]:
        of = plan[plan[CUT_OF] + plan[plan[ROW_OF] + r]]
    return int(m.w[m.acts[plan[DRIVES] + n, NUMBERS_AT] + OF_AT]) == of


@of_holds(0.0)
@njit(**OPTIONS)
def force_by_reaction(m, n, r):
    """Derivative of a slipping hold's force with respect to the reaction of a factors' row."""
    w, k, j = m.w, number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    v = w[k + SLIP]
    return -w[k + MODE] * (laws.dry(w, j, 1.0, v) - laws.dry(w, j, 0.0, v)) * normal_force_by_reaction(m, n, r)


@njit(**OPTIONS)
def normal_force_by_reaction(m, n, r):
    """Derivative of a hold's normal force with respect to the reaction of a factors' row."""
    apart()
    plan, w = m.plan, m.w
    j, what = m.acts[plan[DRIVES] + n, NUMBERS_AT], m.acts[plan[DRIVES] + n, WHAT]
    if r >= plan[KEPT] or what == ALONG:
        return 1.0
    first, arm, row = m.acts[int(w[j + OF_AT]), ROW_AT], w[j + ARM], plan[plan[ROW_OF] + r]
    one, two, own = w[plan[NOW] + first], w[plan[NOW] + first + 1], w[plan[NOW] + row]
    if what == TURN:
        return arm * own / larger(math.sqrt(one * one + two * two), 1e-300)
    if (abs(one) >= arm * abs(two)) != (row == first):
        return 0.0
    return (1.0 if own >= 0.0 else -1.0) * (1.0 if row == first else arm)


@of_holds(None)
@njit(**OPTIONS)
def store_stage(m, i):
    """Store results of holds in a stage: accelerations of all, and forces of slipping ones."""
    apart()
    plan, w = m.plan, m.w
    for n in range(-count(m), 0):
        k = number_at(m, n)
        w[plan[STAGE_H] + count(m) * (i + 1) + n] = w[k + SLIP_RATE]
        w[plan[STAGE_R] + plan[REACTIONS] * i + row_at(m, n)] = w[k + HOLDING]


@njit(**OPTIONS)
def row_place(m, n):
    """Place of a hold's sticking position or bristle deflection in a row of the integration."""
    plan = m.plan
    return 1 + 3 * plan[COORDINATES] + plan[REACTIONS] + plan[ACTS] - plan[CONTACTS] + 2 * count(m) + n


@of_holds(None)
@njit(**OPTIONS)
def prescribe_in_stages(m, into, A, B):
    """Prescribe zero accelerations of stuck holds to an iteration of the stages; for bristles the missing force."""
    apart()
    plan, w, own = m.plan, m.w, m.plan[STAGE_H] + count(m)
    for n in range(-count(m), 0):
        a_0, a_1, a_2 = w[own + n], w[own + count(m) + n], w[own + 2 * count(m) + n]
        stuck = w[number_at(m, n) + MODE] == STUCK or w[number_at(m, n) + MODE] == BENDS
        one = -(into[0].real * a_0 + into[1].real * a_1 + into[2].real * a_2)
        two = -(into[3] * a_0 + into[4] * a_1 + into[5] * a_2)
        A[plan[WANTED] - 1 - n] = one if stuck else 0.0
        B[plan[WANTED] - 1 - n] = two if stuck else 0.0 * two


@of_holds(None)
@njit(**OPTIONS)
def add_in_stages(m, i, one, two, A, B):
    """Add an iteration's solution to the forces of holds in a stage."""
    apart()
    plan, w = m.plan, m.w
    for r in range(m.pivots[YIELDING]):
        n, x = m.pivots[plan[TOUCHING] + r], plan[REACTION] + plan[KEPT] + r
        if n < 0:
            w[plan[STAGE_R] + plan[REACTIONS] * i + row_at(m, n)] += one * A[x] + (two * B[x]).real


@of_holds(None)
@njit(**OPTIONS)
def prescribe_now(m, A):
    """Prescribe zero acceleration to stuck holds at the current state, and to bristles their force law."""
    w = m.w
    for n in range(-count(m), 0):
        k = number_at(m, n)
        A[m.plan[WANTED] - 1 - n] = -w[k + SLIP_RATE] if w[k + MODE] == STUCK else 0.0
        if w[k + MODE] == BENDS:
            force, _ = lugre.by_now(w, k, m.acts[m.plan[DRIVES] + n, NUMBERS_AT])
            A[m.plan[WANTED] - 1 - n] = force - w[k + HOLDING]


@of_holds(None)
@njit(**OPTIONS)
def add_now(m, A):
    """Add the solution at an instant to the forces of holds."""
    plan = m.plan
    for r in range(m.pivots[YIELDING]):
        n = m.pivots[plan[TOUCHING] + r]
        if n < 0:
            m.w[plan[NOW] + row_at(m, n)] += A[plan[REACTION] + plan[KEPT] + r]


@of_holds(None)
@njit(**OPTIONS)
def read_row(m, row, first):
    """Read the sticking positions of holds from a row of the integration, from ``first`` on."""
    for n in range(count(m)):
        m.w[number_at(m, n - count(m)) + STUCK_AT] = row[first + n]


@of_holds(None)
@njit(**OPTIONS)
def write_row(m, row, first):
    """Write the sticking positions of holds to a row."""
    for n in range(count(m)):
        row[first + n] = m.w[number_at(m, n - count(m)) + STUCK_AT]


@of_holds(None)
@njit(**OPTIONS)
def results_at(m, out):
    """Results of every hold at the current state: force, speed, normal force, mode, bristle deflection."""
    for n in range(count(m)):
        k = number_at(m, n - count(m))
        out[5 * n], out[5 * n + 1], out[5 * n + 2] = m.w[k + HOLDING], m.w[k + SLIP], m.w[k + NORMAL]
        out[5 * n + 3], out[5 * n + 4] = m.w[k + MODE], m.w[k + STUCK_AT] if m.w[k + MODE] == BENDS else 0.0
