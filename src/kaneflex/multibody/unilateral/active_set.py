"""Changes of contacts and of loads' switches at an instant.

A contact is OPEN, without force, or CLOSED, with a force by its law (:mod:`kaneflex.generated.contact`). It closes when
its gap reaches zero from above, and opens when it returns. In between it is RELEASED when its law would pull, for
example by damping, and pushes again when it no longer would. Every change ends a step:
:mod:`kaneflex.multibody.time.event_location` finds them. A switch is an open row whose gap is the distance of a law's
argument from zero: there the law continues on the other side.

The approach speed determines the depth of an impact, by the effective mass along the normal: a share of this depth is
the tolerance of the gap. A contact that loads press together has at least the approach speed that corresponds to the
depth under these loads: slower impacts are meaningless for laws that divide by the speed. If it later moves inwards
much faster, since other contacts press it, its law continues with that speed.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.multibody.compile.stand_ins import if_changes, if_contacts
from kaneflex.multibody.dynamics.forces import load_sizes
from kaneflex.multibody.dynamics.loop_closure import correct_accelerations
from kaneflex.multibody.dynamics.loop_factors import factorise_closed
from kaneflex.multibody.dynamics.tree import assemble
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, smaller
from kaneflex.multibody.model.layout import (
    ABOVE, ALLOWED, APPROACH, BEGAN_X, BEGAN_Y, BEGAN_Z, BELOW, CLOSED, COORDINATES, DUE, FLIGHT, GAP, GAP_RATE, HELD,
    IMPACTS, IMPACT_SIZE, IMPULSE, IN_A_ROW, LARGEST, LAST_CHANGE, LOST_BEFORE, MEMORY, MODE, MOST_IMPACTS, NODES, OPEN,
    PEAK, PIVOTS, PRECISION, RELEASED, RESISTING_MASS, RESTED, ROW_AT, SINCE, STAYS, TOUCH, VIRTUAL, WORKS, YIELDING,
    ZERO_BAND,
)  # fmt: skip
from kaneflex.multibody.time.state_record import works_at, write_row
from kaneflex.multibody.unilateral.decision import decide
from kaneflex.multibody.unilateral.relative_rows import fill_contact, place_of, row_scale, zero_gap
from kaneflex.multibody.unilateral.rows import (
    EPS, ROUNDING, act_of, argument_at, at, contacts, impact_depth, is_rigid, is_switch, law_at, product,
)  # fmt: skip
from kaneflex.multibody.unilateral.step_rows import along, effective_mass

CLOSES, LETS_GO, PUSHES, OPENS, HARDENS, SHIFTS = range(1, 7)
"""Changes of a contact; SHIFTS: change of a friction."""
_LEAST = 1e-12
"""Depth of the slowest impact, in sizes of the mechanism."""
_FIRST_STEP = 0.03
"""First step, as a share of the time in which an impact reaches its depth at its approach speed."""
_MOST_AT_ONCE = 1000
"""Largest number of changes at one instant."""
_DOUBTED, _LEFT_ALONE = 4.0, 16.0
"""Numbers of changes at one instant between which steps are shortened: a contact that separates with hardly any
acceleration may close again on the polynomial of too long a step."""
_AT_REST = 1e-8
"""Share of the rates on either side of zero below which a switch at rest stays there."""


@njit(**OPTIONS)
def record_impulses(m, table, h):
    """Add a step to the impulses of closed contacts; their peaks may lie at the vertex of the step's parabola."""
    no_inline()
    w, x = m.w, table.nodes
    for n in range(contacts(m)):
        k = at(m, n)
        if w[k + MODE] == OPEN:
            continue
        j = k + NODES + 4
        f_0, f_1, f_2 = w[j + 2], w[j + 6], w[j + 10]
        w[k + IMPULSE] += h * (table.b_1[0] * f_0 + table.b_1[1] * f_1 + table.b_1[2] * f_2)
        first = (f_1 - f_0) / (x[1] - x[0])
        second = ((f_2 - f_1) / (x[2] - x[1]) - first) / (x[2] - x[0])
        top = larger(f_0, larger(f_1, f_2))
        if second < 0.0:
            s = 0.5 * (x[0] + x[1] - first / second)
            if 0.0 <= s <= 1.0:
                top = larger(top, f_0 + (s - x[0]) * (first + (s - x[1]) * second))
        w[k + PEAK] = larger(w[k + PEAK], top)
        deepest = 0.0 if is_rigid(m, n) else -smaller(w[j], smaller(w[j + 4], w[j + 8]))
        w[k + ALLOWED] = larger(w[k + ALLOWED], w[m.plan[TOUCH] + PRECISION] * deepest)


@if_contacts(False)
@njit(**OPTIONS)
def is_record_full(m):
    """True if no more impacts can be stored."""
    return m.w[m.plan[IMPACTS]] >= MOST_IMPACTS


@njit(**OPTIONS)
def _is_endless(m, t):
    """True if too many changes occur at one instant, including this one."""
    w, shared = m.w, m.plan[TOUCH]
    w[shared + IN_A_ROW] = w[shared + IN_A_ROW] + 1.0 if t - w[shared + LAST_CHANGE] <= 64.0 * EPS * abs(t) else 0.0
    w[shared + LAST_CHANGE] = t
    return w[shared + IN_A_ROW] > _MOST_AT_ONCE


@njit(**OPTIONS)
def _also_due(m, t):
    """Mark further changes at this state; returns how many contacts close, whether all were open, and whether any
    changes.

    Rigid sides have changed already.
    """
    no_inline()
    w, closing, still, changing = m.w, 0, True, False
    for n in range(contacts(m)):
        if is_rigid(m, n):
            continue
        k = fill_contact(m, n)
        gap, rate, is_open = w[k + GAP], w[k + GAP_RATE], w[k + MODE] == OPEN
        zero, still = zero_gap(m, n, t, rate), still and is_open
        if w[k + DUE] == 0.0 and is_open and gap <= zero and rate < 0.0:
            w[k + DUE] = CLOSES
        elif w[k + DUE] == 0.0 and not is_open and gap >= -zero and rate > 0.0:
            w[k + DUE] = OPENS
        closing += w[k + DUE] == CLOSES and not is_switch(m, n)
        changing = changing or w[k + DUE] != 0.0
    return closing, still, changing


@njit(**OPTIONS)
def apply_changes(m, state, A, wanted):
    """Apply all changes due at this state; returns the next step [s].

    0 for an endless sequence at one instant, negative at a singular state. Accelerations are those afterwards.
    """
    no_inline()
    plan, w, shared, t = m.plan, m.w, m.plan[TOUCH], state[0]
    if _is_endless(m, t):
        return 0.0
    if _DOUBTED < w[shared + IN_A_ROW] < _LEFT_ALONE:
        wanted *= 0.5 ** (w[shared + IN_A_ROW] - _DOUBTED)
    closing, still, changing = _also_due(m, t)
    if still:
        w[shared + FLIGHT] = wanted
    if closing:
        assemble(m)
        m.pivots[YIELDING] = plan[VIRTUAL]
        if not factorise_closed(m, 0.0, A, plan[PIVOTS]):
            return -1.0
    still, sides = True, 0
    for n in range(contacts(m)):
        if is_switch(m, n):
            sides += w[at(m, n) + DUE] != 0.0
        elif not is_rigid(m, n):
            wanted = smaller(wanted, _change_contact(m, n, t, A, state[works_at(m) + plan[WORKS] - contacts(m) + n]))
            still = still and w[at(m, n) + MODE] == OPEN
    if still:
        wanted = larger(wanted, w[shared + FLIGHT])
    if sides:
        wanted = smaller(wanted, _pass_zero(m, t, A))
        if wanted <= 0.0:
            return wanted
    if changing and not correct_accelerations(m, t, A, 2):
        return -1.0
    if w[shared + RESTED] == 0.0:  # else after the coordinates are chosen again
        unsettled = decide(m, t, A)
        if unsettled:
            return -1.0 * unsettled
    write_row(m, t, state)
    return wanted


@njit(**OPTIONS)
def _change_contact(m, n, t, A, lost):
    """Apply the change of a contact; returns the longest next step [s]."""
    w, k = m.w, at(m, n)
    how, w[k + DUE] = w[k + DUE], 0.0
    if how == CLOSES:
        return _FIRST_STEP * _close_contact(m, n, t, A, lost)
    if how == LETS_GO:
        w[k + MODE] = RELEASED
    elif how == PUSHES:
        w[k + MODE] = CLOSED
    elif how == OPENS:
        open_contact(m, n, t, lost)
    elif how == HARDENS:
        w[k + MEMORY] = -w[k + GAP_RATE]
        depth = impact_depth(w, law_at(m, n), w[k + RESISTING_MASS], w[k + MEMORY])
        w[k + ALLOWED] = larger(w[k + ALLOWED], w[m.plan[TOUCH] + PRECISION] * depth)
        return _FIRST_STEP * depth / w[k + MEMORY]
    return 1e300


@njit(**OPTIONS)
def _close_contact(m, n, t, A, lost):
    """Close a contact; returns the time [s] in which it reaches its depth at its approach speed."""
    no_inline()
    plan, w, size = m.plan, m.w, m.plan[COORDINATES]
    k, own, g = at(m, n), law_at(m, n), along(m, n)
    pressing = larger(-product(w, g, m.du, size), 0.0)
    mass = effective_mass(m, n, A)
    stiffness, exponent = w[own + 3], w[own + 4]
    least = (mass * pressing / stiffness) ** (1.0 / exponent)
    least = larger(larger(least, _LEAST * row_scale(m, n)), -w[k + GAP])
    approach = abs(smaller(w[k + GAP_RATE], 0.0))
    speed = larger(approach, math.sqrt(2.0 * touching.stored(w, own, least) / mass))
    depth = smaller(impact_depth(w, own, mass, speed), row_scale(m, n))
    w[k + MODE], w[k + MEMORY] = CLOSED, speed
    w[k + RESISTING_MASS], w[k + ALLOWED] = mass, w[plan[TOUCH] + PRECISION] * depth
    begin_impact(m, n, t, approach, lost - touching.stored(w, own, smaller(w[k + GAP], 0.0)))
    return depth / speed


@njit(**OPTIONS)
def begin_impact(m, n, t, approach, lost):
    """Begin the record of an impact; ``lost``: energy [J] that the contact has lost before."""
    w, k = m.w, at(m, n)
    w[k + SINCE], w[k + APPROACH], w[k + LOST_BEFORE] = t, approach, lost
    w[k + IMPULSE] = w[k + PEAK] = 0.0
    w[k + BEGAN_X], w[k + BEGAN_Y], w[k + BEGAN_Z] = place_of(m, n)


@njit(**OPTIONS)
def open_contact(m, n, t, lost):
    """Open a contact, and record its impact."""
    w, k, count = m.w, at(m, n), int(m.w[m.plan[IMPACTS]])
    w[k + MODE] = OPEN
    j = m.plan[IMPACTS] + 1 + IMPACT_SIZE * count
    w[j], w[j + 1], w[j + 2], w[j + 3], w[j + 4] = n, w[k + SINCE], t, w[k + APPROACH], w[k + GAP_RATE]
    w[j + 5], w[j + 6], w[j + 7] = w[k + IMPULSE], w[k + PEAK], lost - w[k + LOST_BEFORE]
    w[j + 8], w[j + 9], w[j + 10] = w[k + BEGAN_X], w[k + BEGAN_Y], w[k + BEGAN_Z]
    w[m.plan[IMPACTS]] = count + 1


@if_changes(True)
@njit(**OPTIONS)
def choose_contact_modes(m, t, A):
    """Contact modes of a single state: closed if the sides overlap, else open; False at a singular state.

    Those by Newton's law keep their mode. The approach speed of others that close is the one that leads to the present
    depth. Discontinuous laws take the side of their present or imminent argument.
    """
    no_inline()
    w, changing = m.w, False
    if not _take_sides(m, t, A):
        return False
    for n in range(contacts(m)):
        k = fill_contact(m, n)
        deep = w[k + GAP] < -zero_gap(m, n, t, 0.0)
        w[k + DUE] = not is_switch(m, n) and not is_rigid(m, n) and deep != (w[k + MODE] != OPEN)
        changing = changing or w[k + DUE] != 0.0
    if not changing:
        return True
    for n in range(contacts(m)):
        k = at(m, n)
        if w[k + DUE] != 0.0 and w[k + MODE] == OPEN:
            _close_contact(m, n, t, A, 0.0)
        elif w[k + DUE] != 0.0:
            w[k + MODE] = OPEN
        w[k + DUE] = 0.0
    return correct_accelerations(m, t, A, 2)


@njit(**OPTIONS)
def _pass_zero(m, t, A):
    """Switch the laws that are due; returns a long time [s], 0 if a law would hold its argument at zero, -1: singular.

    The integration continues on the other side of zero. If both sides lead back, it stays at zero if no other rate
    moves it: holding against a load is friction, not a law.
    """
    no_inline()
    w, back = m.w, 0
    for turn in range(3):
        for n in range(contacts(m)):
            if not is_switch(m, n) or w[at(m, n) + DUE] == 0.0:
                continue
            k, j = at(m, n) if turn == 0 else fill_contact(m, n), argument_at(m, n)
            if turn == 0:
                w[k + PEAK] = w[k + GAP_RATE]
                if w[k + MEMORY] == STAYS:
                    rate = m.sizes[j + 1]  # the sign of the value itself is rounding
                    w[k + MEMORY] = ABOVE if (rate if abs(rate) > 0.0 else m.sizes[j]) > 0.0 else BELOW
                else:
                    w[k + ZERO_BAND] = larger(w[k + ZERO_BAND], 2.0 * abs(m.sizes[j]) + ROUNDING * w[k + LARGEST])
                    w[k + MEMORY] = -w[k + MEMORY]
            elif turn == 1 and w[k + GAP_RATE] < 0.0:
                back += 1
                w[k + PEAK] = abs(w[k + PEAK]) + abs(w[k + GAP_RATE])
                w[k + MEMORY] = STAYS
            else:
                w[k + DUE] = 0.0
                if turn == 2 and abs(w[k + GAP_RATE]) > _AT_REST * w[k + PEAK]:
                    w[m.plan[TOUCH] + HELD] = 1.0 + m.acts[act_of(m, n), ROW_AT]
                    return 0.0
        if (turn == 0 or (turn == 1 and back > 0)) and not correct_accelerations(m, t, A, 2):
            return -1.0
    return 1e300


@if_changes(False)
@njit(**OPTIONS)
def choose_sides(m, t):
    """Choose the sides of switches by the values of their arguments; True if one changes.

    Arguments may depend on other switches, so the result is checked again.
    """
    no_inline()
    w, turn, changed = m.w, 0, True
    while changed and turn <= contacts(m):
        turn, changed = turn + 1, False
        load_sizes(m, t)
        for n in range(contacts(m)):
            k, j = at(m, n), argument_at(m, n)
            if is_switch(m, n):
                side = STAYS
                if abs(m.sizes[j]) > larger(zero_gap(m, n, t, m.sizes[j + 1]), w[k + ZERO_BAND]):
                    side = ABOVE if m.sizes[j] > 0.0 else BELOW
                changed = changed or side != w[k + MEMORY]
                w[k + MEMORY] = side
    return turn > 1


@njit(**OPTIONS)
def _take_sides(m, t, A):
    """Set laws by the sides of their switches; False at a singular state."""
    no_inline()
    w, moving = m.w, False
    if choose_sides(m, t) and not correct_accelerations(m, t, A, 2):
        return False
    for n in range(contacts(m)):
        w[at(m, n) + DUE] = 0.0
        if is_switch(m, n) and w[at(m, n) + MEMORY] == STAYS:
            k = fill_contact(m, n)
            w[k + DUE] = w[k + GAP_RATE] != 0.0
            moving = moving or w[k + DUE] != 0.0
    held = w[m.plan[TOUCH] + HELD]
    found = _pass_zero(m, t, A) if moving else 1.0
    w[m.plan[TOUCH] + HELD] = held
    return found >= 0.0
