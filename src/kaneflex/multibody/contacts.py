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
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.multibody import holds, sticking
from kaneflex.multibody.loops import bent, factorise_closed, give, gradient, mend, middle, solve_closed, works_at
from kaneflex.multibody.tables import (
    ABOVE, ACCEL, ACTS, ALLOWED, APPROACH, BEGUN_AT, BELOW, BODIES, COLUMNS, CONTACT, CONTACTS, CONTACT_SIZE,
    COORDINATES, COURSE_OF, DRIVES, DUE, EXTENT, FIRST, FLANK, FLIGHT, GAP, GAP_RATE, HELD, HOLDS, IMPACTS, IMPACT_SIZE,
    IMPULSE, KEPT, LARGEST, LAST_CHANGE, LAW, LOADS, LOST_BEFORE, MOST_IMPACTS, NODES, NUMBERS_AT, ON, OPTIONS, PEAK,
    PIVOTS, PRECISION, RATE, REACTION, RESISTING_MASS, ROOM, ROW_AT, SEC, SECTION, SHARED, SINCE, SIZE, SLOPE, SPEEDS,
    SPRINGS, STAYS, STIFF, STUCK, SWITCH, TOUCH, TOUCHING, VISCOUS, WHAT, WORKS, YIELDING, apart, larger, of_contacts,
    shifted, smaller,
)  # fmt: skip
from kaneflex.multibody.tree import deform, lean, load_sizes, meet, move

CLOSES, LETS_GO, PUSHES, OPENS, HARDENS, SHIFTS = range(1, 7)
"""How a contact changes, and SHIFTS a hold."""
_ROUNDING = 1e-14
"""Of a gap, in sizes of the mechanism."""
EPS = 2.3e-16
"""Of numbers."""
_LEAST = 1e-12
"""In sizes of the mechanism, the depth of the slowest impact that has a law."""
_AT_REST = 1e-8
"""Share of the rates on either side of zero up to which a switch that stays there isn't moved."""
_FIRST_STEP = 0.03
"""Of the time in which an impact would come to its depth at its approach speed."""
_MOST_AT_ONCE = 1000
"""Changes without time between them that are still resolved."""


@njit(**OPTIONS)
def at(m, c):
    """Where the numbers of the c-th contact are."""
    return m.plan[CONTACT] + CONTACT_SIZE * c


@njit(**OPTIONS)
def rigid(m, c):
    """Whether the c-th contact is by Newton's law."""
    return m.acts[m.plan[CONTACTS] + c, LAW] == NEWTON


@njit(**OPTIONS)
def tolerance(m, c, t, rate):
    """How far from zero a gap counts as zero [m or rad]."""
    return _ROUNDING * extent(m, c) + 4.0 * EPS * abs(t * rate)


@njit(**OPTIONS)
def switches(m, c):
    """Whether it is no contact, but switches laws."""
    return m.acts[m.plan[CONTACTS] + c, WHAT] == SWITCH


@njit(**OPTIONS)
def near(m, c, t, rate):
    """How far from zero the gap of a contact counts as zero, or what switches laws."""
    if switches(m, c):
        return _ROUNDING * m.w[at(m, c) + LARGEST] + 4.0 * EPS * abs(t * rate)
    return tolerance(m, c, t, rate)


@njit(**OPTIONS)
def extent(m, c):
    """What a contact's gap is small against: the size of the mechanism [m], of flanks the angle at which they stand."""
    act = m.plan[CONTACTS] + c
    if m.acts[act, WHAT] == FLANK:
        return 1.0 + abs(m.w[m.plan[SECTION] + SEC * m.acts[act, ON] + 2])
    return m.w[m.plan[TOUCH] + EXTENT]


@njit(**OPTIONS)
def depth_of(w, own, mass, speed):
    """How deep an elastic impact of a mass goes [m]."""
    power = w[own + 4] + 1.0
    return (power * mass * speed * speed / (2.0 * w[own + 3])) ** (1.0 / power)


@njit(**OPTIONS)
def no_force(m, c):
    """Force [N] of a contact that is as good as none."""
    if rigid(m, c):
        return m.w[at(m, c) + ALLOWED] + 1e-11 * m.w[at(m, c) + PEAK]
    w, own = m.w, m.acts[m.plan[CONTACTS] + c, NUMBERS_AT]
    depth = w[at(m, c) + ALLOWED] / w[m.plan[TOUCH] + PRECISION]
    return 1e-9 * (w[at(m, c) + PEAK] + touching.elastic(w, own, -depth))


@njit(**OPTIONS)
def gradient_at(m, c):
    """Where a contact's gradient is, or a hold's, which come last."""
    place = c if c >= 0 else m.plan[ACTS] - m.plan[CONTACTS] - 1 - c
    return m.plan[TOUCH] + SHARED + m.plan[COORDINATES] * place


@njit(**OPTIONS)
def along(m, c):
    """A contact's row by the twists of its sections, and where its gap's gradient by all but prescribed coordinates is.

    It has been met where everything is now; of a hold, by its number below zero, the row is known already.
    """
    apart()
    plan, w = m.plan, m.w
    act, n = (plan[CONTACTS] if c >= 0 else plan[DRIVES]) + c, plan[COORDINATES]
    row, out = m.acts[act, ROW_AT], gradient_at(m, c)
    if c >= 0:
        lean(m, act)
    for i in range(n):
        w[out + i] = 0.0
    gradient(m, row, act, plan[SPEEDS] > 3 * plan[BODIES], out)
    for b in range(plan[BODIES]):
        if m.bodies[b, COURSE_OF] >= 0:
            w[out + m.bodies[b, FIRST]] = 0.0
    return out


@of_contacts(None)
@njit(**OPTIONS)
def let_yield(m, h, here):
    """Have the factors of a step know contacts that push, by their slopes half way, and holds; positions are those
    there."""
    apart()
    plan, w, n, count = m.plan, m.w, m.plan[COORDINATES], 0
    for c in range(plan[ACTS] - plan[CONTACTS]):
        if w[at(m, c) + BEGUN_AT] > 0.0 and not rigid(m, c):
            m.pivots[plan[TOUCHING] + count] = c
            count += 1
    m.pivots[YIELDING] = count
    if count == 0 and plan[HOLDS] == plan[DRIVES]:
        return
    for k in range(n):
        w[plan[RATE] + k] = here[1 + n + k] + 0.5 * h * here[1 + 2 * n + k]
    deform(m)
    move(m)
    if plan[SPEEDS] > 3 * plan[BODIES]:
        bent(m)
    for r in range(count):
        c = m.pivots[plan[TOUCHING] + r]
        act = plan[CONTACTS] + c
        k = meet(m, act)
        by_gap, by_rate = touching.normal_slopes(
            m.acts[act, LAW], w, m.acts[act, NUMBERS_AT], w[k + BEGUN_AT], w[k + GAP], w[k + GAP_RATE]
        )
        w[k + STIFF], w[k + VISCOUS] = larger(-by_gap, 1e-200), larger(-by_rate, 0.0)
        along(m, c)
    more = holds.known_rows(m, count)
    m.pivots[YIELDING] = count + more
    for r in range(count, count + more):
        along(m, m.pivots[plan[TOUCHING] + r])


@njit(**OPTIONS)
def product(w, gradient_at, values, count):
    total = 0.0
    for i in range(count):
        total += w[gradient_at + i] * values[i]
    return total


@of_contacts(0.0)
@njit(**OPTIONS)
def change_of_gaps(m, h, real, pair, one, two, A, B):
    """Largest change of a gap by an iteration's answers for one stage, in errors allowed."""
    apart()
    plan, w, largest = m.plan, m.w, 0.0
    step, steps = h * real, h * pair
    for r in range(m.pivots[YIELDING]):
        touching, x = m.pivots[plan[TOUCHING] + r], plan[REACTION] + plan[KEPT] + r
        k = at(m, touching)
        if touching < 0:
            continue
        c, s = w[k + VISCOUS], w[k + STIFF]
        d = one * A[x] / (step * (c + step * s)) + (two * B[x] / (steps * (c + steps * s))).real
        largest = larger(largest, (h * h * abs(d) - EPS * 8.0 * extent(m, touching)) / w[k + ALLOWED])
    return largest


@of_contacts(None)
@njit(**OPTIONS)
def resist_defect(m, step, A, answer):
    """Take what contacts make of a defect, at ACCEL, off the forces at the answer: see ``collocation._error``."""
    apart()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    for r in range(m.pivots[YIELDING]):
        c = m.pivots[plan[TOUCHING] + r]
        k, g = at(m, c), gradient_at(m, c)
        slope = w[k + VISCOUS] + step * w[k + STIFF] if c >= 0 else w[k + SLOPE]
        size = step * slope * product(w, g, shifted(w, plan[ACCEL]), n)
        for i in range(n):
            A[answer + i] -= size * w[g + i]


@of_contacts(0.0)
@njit(**OPTIONS)
def error_of_gaps(m, h, A, answer):
    """Largest error of a gap by the defect at ACCEL and the answer to it, as an acceleration in errors allowed."""
    apart()
    plan, w, n, largest = m.plan, m.w, m.plan[COORDINATES], 0.0
    for r in range(m.pivots[YIELDING]):
        c = m.pivots[plan[TOUCHING] + r]
        k, g = at(m, c), gradient_at(m, c)
        if c < 0:
            continue
        error = abs(product(w, g, shifted(w, plan[ACCEL]), n) + product(w, g, shifted(A, answer), n))
        largest = larger(largest, (error - 16.0 * EPS * extent(m, c) / (h * h)) / w[k + ALLOWED])
    return largest


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
    w[shared + STUCK] = w[shared + STUCK] + 1.0 if t - w[shared + LAST_CHANGE] <= 64.0 * EPS * abs(t) else 0.0
    w[shared + LAST_CHANGE] = t
    return w[shared + STUCK] > _MOST_AT_ONCE


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
    unsettled = sticking.decide(m, t, A)
    if unsettled:
        return -1.0 * unsettled
    give(m, t, here)
    return wanted


@njit(**OPTIONS)
def pass_zero(m, t, A):
    """Have laws change whose switches are due; a long time [s], 0 where one would hold at zero, -1: singular.

    On the other side of zero it goes on from there. Where both sides lead back, it stays at zero if nothing moves it
    there by itself: what holds against a load is friction, and no law of it.
    """
    apart()
    plan, w = m.plan, m.w
    count = plan[ACTS] - plan[CONTACTS]
    for c in range(count):
        k = at(m, c)
        if switches(m, c) and w[k + DUE] != 0.0:
            side, w[k + PEAK] = w[k + BEGUN_AT], w[k + GAP_RATE]
            j = plan[SIZE] + plan[SPRINGS] - plan[LOADS] + 2 * m.acts[plan[CONTACTS] + c, ROW_AT]
            w[k + ROOM] = larger(w[k + ROOM], 2.0 * abs(w[j]) + _ROUNDING * w[k + LARGEST])
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
    return depth / speed


@njit(**OPTIONS)
def part(m, c, t, lost):
    """End a contact, and keep what it was as an impact."""
    w, k, count = m.w, at(m, c), int(m.w[m.plan[IMPACTS]])
    w[k + BEGUN_AT] = 0.0
    j = m.plan[IMPACTS] + 1 + IMPACT_SIZE * count
    w[j], w[j + 1], w[j + 2], w[j + 3], w[j + 4] = c, w[k + SINCE], t, w[k + APPROACH], w[k + GAP_RATE]
    w[j + 5], w[j + 6], w[j + 7] = w[k + IMPULSE], w[k + PEAK], lost - w[k + LOST_BEFORE]
    w[m.plan[IMPACTS]] = count + 1


@njit(**OPTIONS)
def copy_into(A, answer, w, of, count):
    """Copy numbers of the tables to factors."""
    for i in range(count):
        A[answer + i] = w[of + i]


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


@njit(**OPTIONS)
def take_place(m, t, A):
    """Have laws on the side of zero on which their switches are, or come to be; False at a singular state.

    An argument may hang on others' sides, so that what was changed is looked at again.
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
    if turn == 1:
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
