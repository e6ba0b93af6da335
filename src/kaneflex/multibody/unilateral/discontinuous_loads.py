"""Switches of loads' laws at zeros of their arguments, in the compiled integration.

Switches are among the contacts, as both look for zeros along a step.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.stand_ins import of_changes
from kaneflex.multibody.dynamics.forces import load_sizes, meet
from kaneflex.multibody.unilateral.contact_numbers import ROUNDING, at, near, switches
from kaneflex.multibody.dynamics.loop_closure import mend
from kaneflex.multibody.model.layout import (
    ABOVE, ACTS, BEGUN_AT, BELOW, CONTACTS, DUE, GAP_RATE, HELD, LARGEST, LOADS, OPTIONS, PEAK, ROOM, ROW_AT, SIZE,
    SPRINGS, STAYS, TOUCH, apart, larger,
)  # fmt: skip

_AT_REST = 1e-8
"""Share of the rates on either side of zero below which a switch at rest stays there."""


@njit(**OPTIONS)
def pass_zero(m, t, A):
    """Switch the laws that are due; returns a long time [s], 0 if a law would hold its argument at zero, -1: singular.

    The integration continues on the other side of zero. If both sides lead back, it stays at zero if no other rate
    moves it: holding against a load is friction, not a law.
    """
    apart()
    plan, w = m.plan, m.w
    count = plan[ACTS] - plan[CONTACTS]
    for c in range(count):
        k = at(m, c)
        if switches(m, c) and w[k + DUE] != 0.0:
            side, w[k + PEAK] = w[k + BEGUN_AT], w[k + GAP_RATE]
            j = plan[SIZE] + plan[SPRINGS] - plan[LOADS] + 2 * m.acts[plan[CONTACTS] + c, ROW_AT]
            w[k + ROOM] = larger(w[k + ROOM], 2.0 * abs(w[j]) + ROUNDING * w[k + LARGEST])
            if side == STAYS:
                w[k + BEGUN_AT] = ABOVE if w[j] > 0.0 or (w[j] == 0.0 and w[j + 1] > 0.0) else BELOW
            else:
                w[k + BEGUN_AT] = BELOW if side == ABOVE else ABOVE
    if not mend(m, t, A, 0.0, 2):
        return -1.0
    back = 0
    for c in range(count):
        k = at(m, c)
        if switches(m, c) and w[k + DUE] != 0.0:
            meet(m, plan[CONTACTS] + c)
            if w[k + GAP_RATE] < 0.0:
                back += 1
                w[k + PEAK] = abs(w[k + PEAK]) + abs(w[k + GAP_RATE])
                w[k + BEGUN_AT] = STAYS
            else:
                w[k + DUE] = 0.0
    if back and not mend(m, t, A, 0.0, 2):
        return -1.0
    for c in range(count):
        k = at(m, c)
        if switches(m, c) and w[k + DUE] != 0.0:
            meet(m, plan[CONTACTS] + c)
            w[k + DUE] = 0.0
            if abs(w[k + GAP_RATE]) > _AT_REST * w[k + PEAK]:
                w[plan[TOUCH] + HELD] = 1.0 + m.acts[plan[CONTACTS] + c, ROW_AT]
                return 0.0
    return 1e300


@of_changes(False)
@njit(**OPTIONS)
def choose_sides(m, t):
    """Choose the sides of switches by the values of their arguments; True if one changes.

    Arguments may depend on other switches, so the result is checked again.
    """
    apart()
    plan, w = m.plan, m.w
    count, turn, changed = plan[ACTS] - plan[CONTACTS], 0, True
    while changed and turn <= count:
        turn, changed = turn + 1, False
        load_sizes(m, t)
        for c in range(count):
            k = at(m, c)
            if switches(m, c):
                j = plan[SIZE] + plan[SPRINGS] - plan[LOADS] + 2 * m.acts[plan[CONTACTS] + c, ROW_AT]
                side = STAYS
                if abs(w[j]) > larger(near(m, c, t, w[j + 1]), w[k + ROOM]):
                    side = ABOVE if w[j] > 0.0 else BELOW
                changed = changed or side != w[k + BEGUN_AT]
                w[k + BEGUN_AT] = side
    return turn > 1


@njit(**OPTIONS)
def take_place(m, t, A):
    """Set laws by the sides of their switches; False at a singular state."""
    apart()
    plan, w = m.plan, m.w
    count = plan[ACTS] - plan[CONTACTS]
    if not choose_sides(m, t):
        return True
    if not mend(m, t, A, 0.0, 2):
        return False
    moving = 0
    for c in range(count):
        k = at(m, c)
        w[k + DUE] = 0.0
        if switches(m, c) and w[k + BEGUN_AT] == STAYS:
            meet(m, plan[CONTACTS] + c)
            w[k + DUE] = w[k + GAP_RATE] != 0.0
            moving += w[k + DUE] != 0.0
    held = w[plan[TOUCH] + HELD]
    found = pass_zero(m, t, A) if moving else 1.0
    w[plan[TOUCH] + HELD] = held
    return found >= 0.0
