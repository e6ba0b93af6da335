"""Contacts in the compiled integration: forces of closed contacts, and changes of state.

A contact is open, without force, or closed, with a force by its law (:mod:`kaneflex.generated.contact`). It closes when
its gap reaches zero from above, and opens when it returns. In between it lets go when its law would pull, for example
by damping, and pushes again when it no longer would. BEGUN_AT is its state: 0 open, the approach speed of its law while
it pushes, negative after it has let go. Every change ends a step: :mod:`kaneflex.multibody.time.event_location` finds
them.

The approach speed determines the depth of an impact, by the effective mass along the normal: a share of this depth is
the tolerance of the gap. A contact that loads press together has at least the approach speed that corresponds to the
depth under these loads: slower impacts are meaningless for laws that divide by the speed. If it later moves inwards
much faster, since other contacts press it, its law continues with that speed.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.multibody.unilateral import stick_slip
from kaneflex.multibody.dynamics.tree import assemble
from kaneflex.multibody.dynamics.forces import meet
from kaneflex.multibody.dynamics.loop_factors import factorise_closed, solve_closed
from kaneflex.multibody.unilateral.contact_numbers import (
    EPS, at, copy_into, depth_of, extent, near, product, rigid, switches, tolerance,
)  # fmt: skip
from kaneflex.multibody.dynamics.loop_closure import mend
from kaneflex.multibody.time.state_record import give, works_at
from kaneflex.multibody.compile.stand_ins import of_changes, of_contacts
from kaneflex.multibody.unilateral.discontinuous_loads import pass_zero, take_place
from kaneflex.multibody.model.layout import (
    ACCEL, ACTS, ALLOWED, APPROACH, BEGAN_X, BEGAN_Y, BEGUN_AT, COLUMNS, CONTACTS, COORDINATES, DUE, FLIGHT,
    GAP, GAP_RATE, IMPACTS, IMPACT_SIZE, IMPULSE, IN_A_ROW, KEPT, LAST_CHANGE, LOST_BEFORE, MOST_IMPACTS, NODES,
    NUMBERS_AT, OPTIONS, PEAK, PIVOTS, PLACE_X, PLACE_Y, PRECISION, RESISTING_MASS, RESTED, SINCE, TOUCH, WORKS,
    YIELDING, apart, larger, shifted, smaller,
)  # fmt: skip
from kaneflex.multibody.unilateral.contact_linearisation import along

CLOSES, LETS_GO, PUSHES, OPENS, HARDENS, SHIFTS = range(1, 7)
"""Changes of a contact; SHIFTS: change of a hold."""
_LEAST = 1e-12
"""Depth of the slowest impact, in sizes of the mechanism."""
_FIRST_STEP = 0.03
"""First step, as a share of the time in which an impact reaches its depth at its approach speed."""
_MOST_AT_ONCE = 1000
"""Largest number of changes at one instant."""
_DOUBTED = 4.0, 16.0
"""Range of this number in which steps are shortened: a contact that separates with hardly any acceleration may close
again on the polynomial of too long a step."""


@njit(**OPTIONS)
def pushed_on(m, table, h):
    """Add a step to the impulses of closed contacts, and to their peaks, by its parabola if inside."""
    apart()
    plan, w, x = m.plan, m.w, table.nodes
    for c in range(plan[ACTS] - plan[CONTACTS]):
        k = at(m, c)
        if w[k + BEGUN_AT] == 0.0 or switches(m, c):
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
        deepest = 0.0 if rigid(m, c) else -smaller(w[j], smaller(w[j + 4], w[j + 8]))
        w[k + ALLOWED] = larger(w[k + ALLOWED], w[plan[TOUCH] + PRECISION] * deepest)


@of_contacts(False)
@njit(**OPTIONS)
def full(m):
    """True if no more impacts can be stored."""
    return m.w[m.plan[IMPACTS]] >= MOST_IMPACTS


@njit(**OPTIONS)
def _without_end(m, t):
    """True if too many changes occur at one instant, including this one."""
    w, shared = m.w, m.plan[TOUCH]
    w[shared + IN_A_ROW] = w[shared + IN_A_ROW] + 1.0 if t - w[shared + LAST_CHANGE] <= 64.0 * EPS * abs(t) else 0.0
    w[shared + LAST_CHANGE] = t
    return w[shared + IN_A_ROW] > _MOST_AT_ONCE


@njit(**OPTIONS)
def also_due(m, t):
    """Mark further changes at this state; returns how many contacts close, whether all were open, and whether any
    changes.

    Rigid sides have changed already.
    """
    apart()
    plan, w, closing, still, changing = m.plan, m.w, 0, True, False
    for c in range(plan[ACTS] - plan[CONTACTS]):
        if rigid(m, c):
            continue
        k = meet(m, plan[CONTACTS] + c)
        how, gap, rate, switch = w[k + DUE], w[k + GAP], w[k + GAP_RATE], switches(m, c)
        is_open, zero = switch or w[k + BEGUN_AT] == 0.0, near(m, c, t, rate)
        still = still and is_open
        if how == 0.0 and is_open and gap <= zero and rate < 0.0:
            how = CLOSES
        elif how == 0.0 and not is_open and gap >= -zero and rate > 0.0:
            how = OPENS
        w[k + DUE] = how
        closing += how == CLOSES and not switch
        changing = changing or how != 0.0
    return closing, still, changing


@njit(**OPTIONS)
def change(m, state, A, wanted):
    """Apply all changes due at this state; returns the next step [s].

    0 for an endless sequence at one instant, negative at a singular state. Accelerations are those afterwards.
    """
    apart()
    plan, w, shared, t = m.plan, m.w, m.plan[TOUCH], state[0]
    if _without_end(m, t):
        return 0.0
    if _DOUBTED[0] < w[shared + IN_A_ROW] < _DOUBTED[1]:
        wanted *= 0.5 ** (w[shared + IN_A_ROW] - _DOUBTED[0])
    count = plan[ACTS] - plan[CONTACTS]
    closing, still, changing = also_due(m, t)
    if still:
        w[shared + FLIGHT] = wanted
    if closing:
        assemble(m)
        m.pivots[YIELDING] = 0
        if not factorise_closed(m, 0.0, A, plan[PIVOTS]):
            return -1.0
    still, sides = True, 0
    for c in range(count):
        k = at(m, c)
        if switches(m, c) or rigid(m, c):
            sides += switches(m, c) and w[k + DUE] != 0.0
            continue
        how, lost = w[k + DUE], state[works_at(m) + plan[WORKS] - count + c]
        if how == CLOSES:
            wanted = smaller(wanted, _FIRST_STEP * _close(m, c, t, A, lost))
        elif how == LETS_GO or how == PUSHES:
            w[k + BEGUN_AT] = -w[k + BEGUN_AT]
        elif how == OPENS:
            part(m, c, t, lost)
        elif how == HARDENS:
            own = m.acts[plan[CONTACTS] + c, NUMBERS_AT]
            w[k + BEGUN_AT] = -w[k + GAP_RATE]
            depth = depth_of(w, own, w[k + RESISTING_MASS], w[k + BEGUN_AT])
            w[k + ALLOWED] = larger(w[k + ALLOWED], w[shared + PRECISION] * depth)
            wanted = smaller(wanted, _FIRST_STEP * depth / w[k + BEGUN_AT])
        w[k + DUE] = 0.0
        still = still and w[k + BEGUN_AT] == 0.0
    if still:
        wanted = larger(wanted, w[shared + FLIGHT])
    if sides:
        wanted = smaller(wanted, pass_zero(m, t, A))
        if wanted <= 0.0:
            return wanted
    if changing and not mend(m, t, A, 0.0, 2):
        return -1.0
    if w[shared + RESTED] == 0.0:  # else after the coordinates are chosen again
        unsettled = stick_slip.decide(m, t, A)
        if unsettled:
            return -1.0 * unsettled
    give(m, t, state)
    return wanted


@njit(**OPTIONS)
def _close(m, c, t, A, lost):
    """Close a contact; returns the time [s] in which it reaches its depth at its approach speed."""
    apart()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    k, own = at(m, c), m.acts[plan[CONTACTS] + c, NUMBERS_AT]
    g, answer = along(m, c), plan[COLUMNS] + plan[COORDINATES] * plan[KEPT]
    pressing = larger(-product(w, g, shifted(w, plan[ACCEL]), n), 0.0)
    copy_into(A, answer, w, g, n)
    solve_closed(m, A, plan[PIVOTS])
    mass = 1.0 / larger(product(w, g, shifted(A, answer), n), 1e-200)
    stiffness, power, size = w[own + 3], w[own + 4], extent(m, c)
    least = larger(larger((mass * pressing / stiffness) ** (1.0 / power), _LEAST * size), -w[k + GAP])
    approach = abs(smaller(w[k + GAP_RATE], 0.0))
    speed = larger(approach, math.sqrt(2.0 * touching.stored(w, own, least) / mass))
    depth = smaller(depth_of(w, own, mass, speed), size)
    w[k + RESISTING_MASS] = mass
    w[k + BEGUN_AT], w[k + ALLOWED] = speed, w[plan[TOUCH] + PRECISION] * depth
    w[k + SINCE], w[k + APPROACH] = t, approach
    w[k + LOST_BEFORE] = lost - touching.stored(w, own, smaller(w[k + GAP], 0.0))
    w[k + IMPULSE] = w[k + PEAK] = 0.0
    w[k + BEGAN_X], w[k + BEGAN_Y] = w[k + PLACE_X], w[k + PLACE_Y]
    return depth / speed


@njit(**OPTIONS)
def part(m, c, t, lost):
    """Open a contact, and record its impact."""
    w, k, count = m.w, at(m, c), int(m.w[m.plan[IMPACTS]])
    w[k + BEGUN_AT] = 0.0
    j = m.plan[IMPACTS] + 1 + IMPACT_SIZE * count
    w[j], w[j + 1], w[j + 2], w[j + 3], w[j + 4] = c, w[k + SINCE], t, w[k + APPROACH], w[k + GAP_RATE]
    w[j + 5], w[j + 6], w[j + 7] = w[k + IMPULSE], w[k + PEAK], lost - w[k + LOST_BEFORE]
    w[j + 8], w[j + 9] = w[k + BEGAN_X], w[k + BEGAN_Y]
    w[m.plan[IMPACTS]] = count + 1


@of_changes(True)
@njit(**OPTIONS)
def stand_closed(m, t, A):
    """Contact states of a single state: closed if the sides overlap, else open; False at a singular state.

    Those by Newton's law keep their state. The approach speed of others that close is the one that leads to the present
    depth. Discontinuous laws take the side of their present or imminent argument.
    """
    apart()
    plan, w, changing = m.plan, m.w, 0
    if not take_place(m, t, A):
        return False
    for c in range(plan[ACTS] - plan[CONTACTS]):
        k = meet(m, plan[CONTACTS] + c)
        deep = w[k + GAP] < -tolerance(m, c, t, 0.0)
        w[k + DUE] = not switches(m, c) and not rigid(m, c) and deep != (w[k + BEGUN_AT] != 0.0)
        changing += w[k + DUE] != 0.0
    if changing == 0:
        return True
    for c in range(plan[ACTS] - plan[CONTACTS]):
        k = at(m, c)
        if w[k + DUE] != 0.0 and w[k + BEGUN_AT] == 0.0:
            _close(m, c, t, A, 0.0)
        elif w[k + DUE] != 0.0:
            w[k + BEGUN_AT] = 0.0
        w[k + DUE] = 0.0
    return mend(m, t, A, 0.0, 2)
