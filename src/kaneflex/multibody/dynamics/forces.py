"""Compiled forces on the bodies of a tree: sizes of loads, forces and contacts at sections in the plane.

They are subtracted from the inertia forces of the motion (:mod:`kaneflex.multibody.dynamics.kinematics`).
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.generated import joints as laws
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.multibody.compile.stand_ins import of_changes, of_impacts
from kaneflex.multibody.compile.values import by_size, inside, row_length
from kaneflex.multibody.dynamics.algebra import scaled
from kaneflex.multibody.dynamics.kinematics import section_at
from kaneflex.multibody.dynamics.wrenches import push, row_wrench
from kaneflex.multibody.model.layout import (
    ACTS, AT, CLOSED, CONTACT, CONTACTS, CONTACT_SIZE, COURSE_AT, DRIVES, FORCE, GAP, GAP_ACCEL, GAP_RATE, INPUT, LAW,
    LOADS, LOSING, MAGNITUDES, MEMORY, MODE, NUMBERS_AT, ON, OPEN, OPTIONS, ROOM, ROW_AT, SIZE, SPRINGS, STAYS, STORED,
    SUMS, SWITCH, TURN, WHAT, X, apart, kernel,
)  # fmt: skip


@of_impacts(None)
@njit(**OPTIONS)
def rest_rows(m):
    """Rows of contacts at rest under Newton's law: gap, rate, acceleration, and Jacobians."""
    apart()
    for n in range(m.plan[CONTACTS], m.plan[ACTS]):
        if rests(m, n):
            meet(m, n)


@njit(**OPTIONS)
def rests(m, act):
    """True if a contact is at rest under Newton's law."""
    return m.acts[act, LAW] == NEWTON and m.w[numbers_at(m, act) + MODE] == CLOSED


@njit(**OPTIONS)
def joint_row(m, act):
    """Row of a joint in laws that is a cut, at SUMS: its coordinate and two rates, then its Jacobian; in space zero."""
    apart()
    w, j = m.w, m.acts[act, NUMBERS_AT]
    if m.acts[act, WHAT] == TURN:
        laws.turn(m.sections, m.acts[act, AT], m.acts[act, ON], w[j], w[j + 1], 0.0, w, m.plan[SUMS])
    else:
        laws.slide(m.sections, m.acts[act, AT], m.acts[act, ON], w[j], w[j + 1], 0.0, w, m.plan[SUMS])


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
            w[k], w[k + 1], w[second_rate] = m.y[i], m.u[i], m.du[i]
        else:
            joint_row(m, n)
            w[k], w[k + 1], w[second_rate] = w[plan[SUMS]], w[plan[SUMS] + 1], w[plan[SUMS] + 2]
    if plan[LOADS] == plan[SPRINGS]:
        return
    take_sides(m)
    kernel(m.kernels, MAGNITUDES)(t, w, plan[X], m.p, w, plan[SIZE])
    for k in range(plan[SPRINGS] - plan[LOADS]):
        m.sizes[k] += w[plan[INPUT] + k]


@of_changes(None)
@njit(**OPTIONS)
def take_sides(m):
    """Select the branch of discontinuous laws by the side of zero of their switching arguments."""
    apart()
    plan, w = m.plan, m.w
    first = plan[X] + 3 * (plan[LOADS] - plan[DRIVES])
    for n in range(plan[CONTACTS], plan[ACTS]):
        if m.acts[n, WHAT] == SWITCH:
            w[first + m.acts[n, ROW_AT]] = w[numbers_at(m, n) + MEMORY]


@of_changes(None)
@njit(**OPTIONS)
def meet_switch(m, n, k):
    """Numbers of a switching argument as a gap that closes when a load's law changes its branch.

    The gap is its distance from zero on its side; for one that stays on its side, the remaining distance.
    """
    plan, w = m.plan, m.w
    j, side = plan[SIZE] + plan[SPRINGS] - plan[LOADS] + 2 * m.acts[n, ROW_AT], w[k + MEMORY]
    value, rate = w[j], w[j + 1]
    if rate - rate != 0.0:  # not a number, for example on one side only
        rate = 0.0
    if side == STAYS:
        rate = -rate if value > 0.0 else rate
        value = w[k + ROOM] - abs(value)
    else:
        value, rate = side * value, side * rate
    w[k + GAP], w[k + GAP_RATE] = value, rate


@of_changes(None)
@njit(**OPTIONS)
def press(m, n):
    """Contact force of a closed contact on its sections; of a switch its numbers alone."""
    apart()
    w, k = m.w, meet(m, n)
    if w[k + FORCE] != 0.0:
        for side in range(2):
            push(m, m.acts[n, AT + side], scaled(w[k + FORCE], row_wrench(m, m.acts[n, ROW_AT], side)))


@njit(**OPTIONS)
def numbers_at(m, act):
    """Place of the numbers of a contact or switch."""
    return m.plan[CONTACT] + CONTACT_SIZE * (act - m.plan[CONTACTS])


@njit(**OPTIONS)
def _gap(m, n, j, row):
    """Row of a contact; in space there are none yet."""
    first, second = section_at(m, m.acts[n, AT]), section_at(m, m.acts[n, ON])
    touching.gap(m.acts[n, WHAT], m.sections, first, second, m.w, j, m.rows, row)


@njit(**OPTIONS)
def _no_gap(m, n, j, row):
    inside()


_gap = by_size(_gap, _no_gap)


@njit(**OPTIONS)
def meet(m, n):
    """Row and numbers of a contact, and their place; nothing else is changed.

    A released contact exerts no force and loses its stored energy. One at rest under Newton's law exerts the reaction
    of its row, an unknown.
    """
    w, k, j, law, row = m.w, numbers_at(m, n), m.acts[n, NUMBERS_AT], m.acts[n, LAW], row_length(m) * m.acts[n, ROW_AT]
    w[k + FORCE] = w[k + STORED] = w[k + LOSING] = 0.0
    if m.acts[n, WHAT] == SWITCH:
        meet_switch(m, n, k)
        return k
    _gap(m, n, j, row)
    w[k + GAP], w[k + GAP_RATE], w[k + GAP_ACCEL] = m.rows[row], m.rows[row + 1], m.rows[row + 2]
    mode, gap, rate = w[k + MODE], w[k + GAP], w[k + GAP_RATE]
    if mode == OPEN:
        return k
    if law == NEWTON:
        w[k + FORCE] = m.multipliers[m.acts[n, ROW_AT]]
        return k
    if mode == CLOSED:
        w[k + FORCE] = touching.normal_force(law, w, j, w[k + MEMORY], gap, rate)
    w[k + STORED] = touching.stored(w, j, gap)
    w[k + LOSING] = (touching.elastic(w, j, gap) - w[k + FORCE]) * rate
    return k
