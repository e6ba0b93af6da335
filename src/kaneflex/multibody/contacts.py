"""Contacts in the compiled integration: what closed ones add to its equations, and how they change.

A contact is open, and exerts nothing, or closed, and pushes by its law (:mod:`kaneflex.generated.contact`). It closes
where its gap comes to zero from above, and opens where that comes back; in between it lets go where its law would pull,
as that of a damper does, and pushes again where it no longer would. BEGUN_AT says which it is in: 0 open, the approach
speed of its law where it pushes, less than zero where it has let go. Every change ends a step: where they are is found
in :mod:`kaneflex.multibody.contact_search`.

A speed of approach says how deep an impact goes, by the mass that resists along the normal: a share of this depth is
the error allowed in the gap while it lasts. A contact that loads press together begins at no less a speed than that
which goes as deep as these loads do: slower ones are no impacts, and a law that divides by their speeds says nothing.
Where one goes deeper far faster later than it began, as others push it on, its law goes on with the speed it has then.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.multibody import sticking
from kaneflex.multibody.acting import meet
from kaneflex.multibody.closed_factors import factorise_closed, solve_closed
from kaneflex.multibody.contact_numbers import (
    EPS, at, copy_into, depth_of, extent, near, product, rigid, switches, tolerance,
)  # fmt: skip
from kaneflex.multibody.loops import bent, mend, middle
from kaneflex.multibody.rows import give, works_at
from kaneflex.multibody.stand_ins import of_contacts
from kaneflex.multibody.switching import pass_zero, take_place
from kaneflex.multibody.tables import (
    ACCEL, ACTS, ALLOWED, APPROACH, BEGAN_X, BEGAN_Y, BEGUN_AT, BODIES, COLUMNS, CONTACTS, COORDINATES, DUE, FLIGHT,
    GAP, GAP_RATE, IMPACTS, IMPACT_SIZE, IMPULSE, IN_A_ROW, KEPT, LAST_CHANGE, LOST_BEFORE, MOST_IMPACTS, NODES,
    NUMBERS_AT, OPTIONS, PEAK, PIVOTS, PLACE_X, PLACE_Y, PRECISION, RESISTING_MASS, RESTED, SINCE, SPEEDS, TOUCH, WORKS,
    YIELDING, apart, larger, shifted, smaller,
)  # fmt: skip
from kaneflex.multibody.yielding import along

CLOSES, LETS_GO, PUSHES, OPENS, HARDENS, SHIFTS = range(1, 7)
"""How a contact changes, and SHIFTS a hold."""
_LEAST = 1e-12
"""In sizes of the mechanism, the depth of the slowest impact that has a law."""
_FIRST_STEP = 0.03
"""Of the time in which an impact would come to its depth at its approach speed."""
_MOST_AT_ONCE = 1000
"""Changes without time between them that are still resolved."""
_DOUBTED = 4.0, 16.0
"""Of these, the first and the last ones after which steps become ever shorter: what comes loose with hardly any
acceleration turns back at once on the polynomial of a step that is too long to know, is caught, comes loose again."""


@njit(**OPTIONS)
def pushed_on(m, table, h):
    """Add a step that is taken to the impulses of closed contacts, and to their peaks: its parabola's, if inside."""
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
    """Whether no more impacts are kept than may end together."""
    return m.w[m.plan[IMPACTS]] >= MOST_IMPACTS


@njit(**OPTIONS)
def _without_end(m, t):
    """Whether contacts change over and over at one instant, now being one of these changes."""
    w, shared = m.w, m.plan[TOUCH]
    w[shared + IN_A_ROW] = w[shared + IN_A_ROW] + 1.0 if t - w[shared + LAST_CHANGE] <= 64.0 * EPS * abs(t) else 0.0
    w[shared + LAST_CHANGE] = t
    return w[shared + IN_A_ROW] > _MOST_AT_ONCE


@njit(**OPTIONS)
def also_due(m, t):
    """Mark what changes where everything is beside what is due; how many contacts close, whether all were open,
    and whether any changes.

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
def change(m, here, A, wanted):
    """Have contacts change where everything is, with all others that are as far; the next step [s].

    0 where they change over and over at one instant, less than 0 at a singular state. Accelerations are those after it.
    """
    apart()
    plan, w, shared, t = m.plan, m.w, m.plan[TOUCH], here[0]
    if _without_end(m, t):
        return 0.0
    if _DOUBTED[0] < w[shared + IN_A_ROW] < _DOUBTED[1]:
        wanted *= 0.5 ** (w[shared + IN_A_ROW] - _DOUBTED[0])
    count = plan[ACTS] - plan[CONTACTS]
    closing, still, changing = also_due(m, t)
    if still:
        w[shared + FLIGHT] = wanted
    if closing:
        middle(m)
        m.pivots[YIELDING] = 0
        if plan[SPEEDS] > 3 * plan[BODIES]:
            bent(m)
        if not factorise_closed(m, 0.0, A, plan[PIVOTS]):
            return -1.0
    still, sides = True, 0
    for c in range(count):
        k = at(m, c)
        if switches(m, c) or rigid(m, c):
            sides += switches(m, c) and w[k + DUE] != 0.0
            continue
        how, lost = w[k + DUE], here[works_at(m) + plan[WORKS] - count + c]
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
    if w[shared + RESTED] == 0.0:  # else once those that rest are held by other coordinates
        unsettled = sticking.decide(m, t, A)
        if unsettled:
            return -1.0 * unsettled
    give(m, t, here)
    return wanted


@njit(**OPTIONS)
def _close(m, c, t, A, lost):
    """Begin a contact; the time [s] in which it would come to its depth at its approach speed."""
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
    """End a contact, and keep what it was as an impact."""
    w, k, count = m.w, at(m, c), int(m.w[m.plan[IMPACTS]])
    w[k + BEGUN_AT] = 0.0
    j = m.plan[IMPACTS] + 1 + IMPACT_SIZE * count
    w[j], w[j + 1], w[j + 2], w[j + 3], w[j + 4] = c, w[k + SINCE], t, w[k + APPROACH], w[k + GAP_RATE]
    w[j + 5], w[j + 6], w[j + 7] = w[k + IMPULSE], w[k + PEAK], lost - w[k + LOST_BEFORE]
    w[j + 8], w[j + 9] = w[k + BEGAN_X], w[k + BEGAN_Y]
    w[m.plan[IMPACTS]] = count + 1


@of_contacts(True)
@njit(**OPTIONS)
def stand_closed(m, t, A):
    """Contacts of a state by itself: those whose sides overlap are closed, all others open; False at a singular state.

    Those by Newton's law stay as they are. Any other that is to be closed and is not counts as begun at the speed that
    would bring it as deep as it is. Laws are on the side of zero on which their arguments are, or come to be.
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
    if plan[SPEEDS] > 3 * plan[BODIES]:
        bent(m)
    for c in range(plan[ACTS] - plan[CONTACTS]):
        k = at(m, c)
        if w[k + DUE] != 0.0 and w[k + BEGUN_AT] == 0.0:
            _close(m, c, t, A, 0.0)
        elif w[k + DUE] != 0.0:
            w[k + BEGUN_AT] = 0.0
        w[k + DUE] = 0.0
    return mend(m, t, A, 0.0, 2)
