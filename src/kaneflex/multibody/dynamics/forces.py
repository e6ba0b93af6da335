"""Compiled forces on the bodies of a tree: sizes of loads, forces and contacts at sections in the plane.

They are subtracted from the inertia forces of the motion (:mod:`kaneflex.multibody.dynamics.kinematics`).
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.generated import joints as laws
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.multibody.compile.stand_ins import of_changes, of_contacts, of_impacts
from kaneflex.multibody.compile.values import by_size, inside
from kaneflex.multibody.dynamics.wrenches import push
from kaneflex.multibody.model.layout import (
    ABOVE, ACCEL, ACTS, AT, BEGUN_AT, BELOW, CONTACT, CONTACTS, CONTACT_SIZE, COURSE_AT, CUT, DRIVES, ELASTIC, GAP,
    GAP_RATE, INPUT, LAW, LOADS, LOSING, MAGNITUDES, NORMAL_TURN, NORMAL_X, NORMAL_Y, NOW, NUMBERS_AT, ON, OPTIONS,
    PLACE_X, PLACE_Y, PUSH_NOW, RATE, ROOM, ROW_AT, ROW_SIZE, SEC, SECTION, SIZE, SPRINGS, STAYS, SUMS, SWITCH, TURN,
    WHAT, X, Y, apart, kernel, shifted,
)  # fmt: skip


@of_impacts(None)
@njit(**OPTIONS)
def rest_rows(m):
    """Rows of contacts at rest under Newton's law: gap, rate, acceleration, and Jacobians."""
    apart()
    plan, w = m.plan, m.w
    for n in range(plan[CONTACTS], plan[ACTS]):
        if rests(m, n):
            k, row = meet(m, n), plan[CUT] + ROW_SIZE * m.acts[n, ROW_AT]
            w[row], w[row + 1], w[row + 2] = w[k + GAP], w[k + GAP_RATE], acceleration(m, n)
            lean(m, n)


@njit(**OPTIONS)
def acceleration(m, n):
    """Acceleration g'' of a contact's gap [m/s^2]."""
    first, second = m.plan[SECTION] + SEC * m.acts[n, AT], m.plan[SECTION] + SEC * m.acts[n, ON]
    return touching.gap_acceleration(m.acts[n, WHAT], m.w, first, second, m.w, m.acts[n, NUMBERS_AT])


@njit(**OPTIONS)
def rests(m, act):
    """True if a contact is at rest under Newton's law."""
    of = m.plan[CONTACT] + CONTACT_SIZE * (act - m.plan[CONTACTS])
    return m.acts[act, LAW] == NEWTON and m.w[of + BEGUN_AT] != 0.0


@njit(**OPTIONS)
def lean(m, act):
    """Jacobian of a contact's gap with respect to the twists of its sections, after :func:`meet`."""
    w, plan = m.w, m.plan
    k = plan[CONTACT] + CONTACT_SIZE * (act - plan[CONTACTS])
    x, z = w[k + NORMAL_X], w[k + NORMAL_Y]
    for side in range(2):
        section, sign = plan[SECTION] + SEC * m.acts[act, AT + side], 2.0 * side - 1.0
        j = plan[CUT] + ROW_SIZE * m.acts[act, ROW_AT] + 3 + 3 * side
        w[j], w[j + 1] = sign * x, sign * z
        arm = (w[k + PLACE_X] - w[section]) * z - (w[k + PLACE_Y] - w[section + 1]) * x
        w[j + 2] = sign * (arm + w[k + NORMAL_TURN])


@njit(**OPTIONS)
def joint_row(m, act):
    """Row of a joint in laws that is a cut, at SUMS: its coordinate and two rates, then its Jacobian; in space zero."""
    apart()
    w, sec, j = m.w, shifted(m.w, m.plan[SECTION]), m.acts[act, NUMBERS_AT]
    if m.acts[act, WHAT] == TURN:
        laws.turn(sec, m.acts[act, AT], m.acts[act, ON], w[j], w[j + 1], 0.0, w, m.plan[SUMS])
    else:
        laws.slide(sec, m.acts[act, AT], m.acts[act, ON], w[j], w[j + 1], 0.0, w, m.plan[SUMS])


@njit(**OPTIONS)
def _unknown(m, act):
    inside()


joint_row = by_size(joint_row, _unknown)


@njit(**OPTIONS)
def load_sizes(m, t):
    """Magnitudes of the loads, which may depend on joint coordinates and their rates."""
    apart()
    plan, w = m.plan, m.w
    for n in range(plan[DRIVES], plan[LOADS]):
        k, i = plan[X] + 2 * (n - plan[DRIVES]), m.acts[n, COURSE_AT]
        second_rate = plan[X] + 2 * (plan[LOADS] - plan[DRIVES]) + n - plan[DRIVES]
        if i >= 0:
            w[k], w[k + 1], w[second_rate] = w[plan[Y] + i], w[plan[RATE] + i], w[plan[ACCEL] + i]
        else:
            joint_row(m, n)
            w[k], w[k + 1], w[second_rate] = w[plan[SUMS]], w[plan[SUMS] + 1], w[plan[SUMS] + 2]
    if plan[LOADS] == plan[SPRINGS]:
        return
    take_sides(m)
    kernel(m.kernels, MAGNITUDES)(t, w, plan[X], m.p, w, plan[SIZE])
    for k in range(plan[SPRINGS] - plan[LOADS]):
        w[plan[SIZE] + k] += w[plan[INPUT] + k]


@of_changes(None)
@njit(**OPTIONS)
def take_sides(m):
    """Select the branch of discontinuous laws by the side of zero of their switching arguments."""
    apart()
    plan, w = m.plan, m.w
    first = plan[X] + 3 * (plan[LOADS] - plan[DRIVES])
    for n in range(plan[CONTACTS], plan[ACTS]):
        if m.acts[n, WHAT] == SWITCH:
            side = w[plan[CONTACT] + CONTACT_SIZE * (n - plan[CONTACTS]) + BEGUN_AT]
            w[first + m.acts[n, ROW_AT]] = 1.0 if side == ABOVE else (-1.0 if side == BELOW else 0.0)


@of_changes(None)
@njit(**OPTIONS)
def meet_switches(m):
    """Numbers of all switching arguments, where there are no contacts."""
    plan = m.plan
    for n in range(plan[CONTACTS], plan[ACTS]):
        meet_switch(m, n, plan[CONTACT] + CONTACT_SIZE * (n - plan[CONTACTS]))


@of_changes(None)
@njit(**OPTIONS)
def meet_switch(m, n, k):
    """Numbers of a switching argument as a gap that closes when a load's law changes its branch.

    The gap is its distance from zero on its side; for one that stays on its side, the remaining distance.
    """
    plan, w = m.plan, m.w
    j, side = plan[SIZE] + plan[SPRINGS] - plan[LOADS] + 2 * m.acts[n, ROW_AT], w[k + BEGUN_AT]
    value, rate = w[j], w[j + 1]
    if rate - rate != 0.0:  # not a number, for example on one side only
        rate = 0.0
    if side == BELOW:
        value, rate = -value, -rate
    elif side == STAYS:
        rate = -rate if value > 0.0 else rate
        value = w[k + ROOM] - abs(value)
    w[k + GAP], w[k + GAP_RATE] = value, rate
    w[k + NORMAL_X] = w[k + NORMAL_Y] = 0.0


@of_contacts(None)
@njit(**OPTIONS)
def press(m, n):
    """Contact force of a closed contact on its sections."""
    apart()
    plan, w = m.plan, m.w
    k = meet(m, n)
    if w[k + PUSH_NOW] != 0.0:
        x, z = w[k + PUSH_NOW] * w[k + NORMAL_X], w[k + PUSH_NOW] * w[k + NORMAL_Y]
        for side in range(2):
            at, sign = plan[SECTION] + SEC * m.acts[n, AT + side], 2.0 * side - 1.0
            turn = (w[k + PLACE_X] - w[at]) * z - (w[k + PLACE_Y] - w[at + 1]) * x
            turn += w[k + PUSH_NOW] * w[k + NORMAL_TURN]
            push(m, m.acts[n, AT + side], (sign * x, sign * z, sign * turn))


@njit(**OPTIONS)
def meet(m, n):
    """Gap and derived numbers of a contact, and their place; nothing else is changed.

    A contact that has let go (negative BEGUN_AT) exerts no force and loses its stored energy. One at rest under
    Newton's law exerts the reaction of its row, an unknown.
    """
    plan, w, sec = m.plan, m.w, m.plan[SECTION]
    k, j, law = plan[CONTACT] + CONTACT_SIZE * (n - plan[CONTACTS]), m.acts[n, NUMBERS_AT], m.acts[n, LAW]
    w[k + PUSH_NOW] = w[k + ELASTIC] = w[k + LOSING] = 0.0
    if m.acts[n, WHAT] == SWITCH:
        meet_switch(m, n, k)
        return k
    touching.gap(m.acts[n, WHAT], w, sec + SEC * m.acts[n, AT], sec + SEC * m.acts[n, ON], w, j, w, k)
    begun_at, gap, rate = w[k + BEGUN_AT], w[k + GAP], w[k + GAP_RATE]
    if law == NEWTON:
        if begun_at != 0.0:
            w[k + PUSH_NOW] = w[plan[NOW] + m.acts[n, ROW_AT]]
    elif begun_at != 0.0:
        if begun_at > 0.0:
            w[k + PUSH_NOW] = touching.normal_force(law, w, j, begun_at, gap, rate)
        w[k + ELASTIC] = touching.stored(w, j, gap)
        w[k + LOSING] = (touching.elastic(w, j, gap) - w[k + PUSH_NOW]) * rate
    return k
