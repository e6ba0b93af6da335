"""Where in a step a contact changes, in the compiled integration.

The gap along a step is looked at where its stages are, and where the cubics between them come close to zero: on the
step's own polynomial, so that no dip below zero is stepped over. A step that goes past a change is taken again up to
there, until the gap is zero but for rounding.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.multibody import holds, sticking
from kaneflex.multibody.acting import rests
from kaneflex.multibody.contact_numbers import EPS, at, extent, near, no_force, rigid, switches, tolerance
from kaneflex.multibody.contacts import CLOSES, HARDENS, LETS_GO, OPENS, PUSHES, SHIFTS, change, pushed_on
from kaneflex.multibody.loops import follow, mend
from kaneflex.multibody.rows import take
from kaneflex.multibody.stand_ins import of_contacts, of_holds
from kaneflex.multibody.step_curve import NEVER, between, dips, falls, gap_of, meet_all, shares
from kaneflex.multibody.tables import (
    ACTS, AIM, ALLOWED, AT, BEGUN_AT, CONTACTS, DRIVES, DUE, FLANK, FOUND_AT, GAP, GAP_RATE, HIGH, HOLDS, LARGEST, LAW,
    LOW, MODE, NODES, NOW, NUMBERS_AT, OPTIONS, PRECISION, PUSH_NOW, REACTIONS, RESISTING_MASS, RESTED, RIGID, ROW_AT,
    SEC, SECTION, SHIFT, STAGE_R, TARGET, TOUCH, TRIAL, TRIES, WHAT, apart, larger, smaller,
)  # fmt: skip
from kaneflex.multibody.rigid_contacts import LEAST_HEIGHT, NOISE, acceleration, collide, size_of

PASSED, CHANGED, AT_ONCE, AGAIN, ASTRAY = range(5)
"""What is found in a step: no change, one at its end, one before it begins, one inside or beyond it; or its end doesn't
close."""
_MANY = 30
"""Steps that are taken again before their ends only halve what is left."""
_PRESSED = 1e-8
"""Of their accelerations, that with which sides come together that loads press on each other."""
_NONE = -1000000
"""Number of no contact, and of no hold."""
_FIRST_HYSTERETIC = 2
"""Of the laws, by their numbers, that which is the first to divide by an approach speed."""
_FAR_FASTER = 3.0
"""An impact only becomes slower than it began; loads that press it on make it 1.4 times as fast at most."""


@of_contacts(False)
@njit(**OPTIONS)
def searched(m):
    """Whether steps are searched for changes."""
    return True


@of_contacts(None)
@njit(**OPTIONS)
def note(m, t, i):
    """Keep gap, its rate, force and its sign of all contacts as they are now, as those of the step's node i."""
    apart()
    plan, w = m.plan, m.w
    for c in range(plan[ACTS] - plan[CONTACTS]):
        k, act = at(m, c), plan[CONTACTS] + c
        j = k + NODES + 4 * i
        w[j], w[j + 1], w[j + 2], w[j + 3] = gap_of(m, c), w[k + GAP_RATE], w[k + PUSH_NOW], 1.0
        if switches(m, c):
            w[k + LARGEST] = larger(w[k + LARGEST], abs(w[k + GAP]))
        elif rigid(m, c):
            w[j + 3] = w[k + PUSH_NOW]
        elif w[k + BEGUN_AT] != 0.0:
            # Where the depth is zero so is a force, but for its sign.
            least, w[j + 3] = -1e-6 * w[k + ALLOWED] / w[plan[TOUCH] + PRECISION], w[k + PUSH_NOW]
            if w[k + BEGUN_AT] < 0.0 or w[k + GAP] > least:
                law, own, gap = m.acts[act, LAW], m.acts[act, NUMBERS_AT], smaller(w[k + GAP], least)
                w[j + 3] = touching.normal_force(law, w, own, abs(w[k + BEGUN_AT]), gap, w[k + GAP_RATE])
    sticking.note(m, t, i)


@of_contacts(True)
@njit(**OPTIONS)
def back(m, here):
    """Have everything where a row has it, where a step begins; False: a loop doesn't close."""
    apart()
    take(m, here)
    closes = follow(m, here[0])
    begin(m, here[0])
    return closes


@of_contacts(0.0)
@njit(**OPTIONS)
def go_on(m, table, h, here, A, wanted, found):
    """Begin the next step after one in which this was ``found``; how long it may be [s], see ``contacts.change``."""
    apart()
    if found != AT_ONCE:
        pushed_on(m, table, h)
    if found != PASSED:
        if m.plan[RIGID]:
            wanted = collide(m, here, A, wanted)
        if wanted > 0.0:
            wanted = change(m, here, A, wanted)
    begin(m, here[0])
    return wanted


@of_contacts(False)
@njit(**OPTIONS)
def others_rest(m):
    """Whether contacts rest by Newton's law that dependent coordinates don't keep closed, or the other way round."""
    return m.w[m.plan[TOUCH] + RESTED] != 0.0


@njit(**OPTIONS)
def begin(m, t):
    """Note where a step begins: where everything is.

    Rigid sides that part without a speed, as where a force has come to zero, are still where rounding has them: only
    what comes back beyond that closes again. What loads press together from the start closes at once.
    """
    apart()
    w = m.w
    w[m.plan[TOUCH] + AIM] = math.inf
    meet_all(m, t)
    for act in range(m.plan[CONTACTS], m.plan[ACTS]):
        k = at(m, act - m.plan[CONTACTS])
        if m.acts[act, LAW] == NEWTON and w[k + BEGUN_AT] == 0.0:
            rate = w[k + GAP_RATE]
            zero = tolerance(m, act - m.plan[CONTACTS], t, rate)
            slow = larger(math.sqrt(2.0 * LEAST_HEIGHT * zero * size_of(m, act, 6)), NOISE * size_of(m, act, 3))
            w[k + SHIFT] = 0.0
            bent = acceleration(m, act)
            if abs(rate) <= slow and w[k + GAP] <= zero and bent >= -_PRESSED * size_of(m, act, 6):
                w[k + SHIFT] = 8.0 * zero
            aim = _meets(w[k + GAP] + w[k + SHIFT], rate, bent)
            aim += 3.0 * EPS * larger(abs(t), aim)
            # Nothing moves on from a gap of rounding in the time that it would take.
            if w[k + GAP] + w[k + SHIFT] > zero and 16.0 * EPS * abs(t) < aim < w[m.plan[TOUCH] + AIM]:
                w[m.plan[TOUCH] + AIM] = aim
    sticking.begin(m)
    note(m, t, 0)


@njit(**OPTIONS)
def _meets(gap, rate, bent):
    """When a gap that changes so by now is closed [s]; never, infinity."""
    root = rate * rate - 2.0 * bent * gap
    if not gap > 0.0 or root < 0.0 or (bent >= 0.0 and rate >= 0.0):
        return math.inf
    return 2.0 * gap / (math.sqrt(root) - rate) if bent >= 0.0 or rate < 0.0 else (-rate - math.sqrt(root)) / bent


@of_contacts(0.0)
@njit(**OPTIONS)
def aimed(m, h):
    """The step [s] to take in place of h, at whose end rigid sides are to meet: so that none has to be taken again."""
    return smaller(h, m.w[m.plan[TOUCH] + AIM])


@njit(**OPTIONS)
def forget(m):
    """Give up the search for a change in a step."""
    m.w[m.plan[TOUCH] + HIGH] = m.w[m.plan[TOUCH] + LOW] = m.w[m.plan[TOUCH] + TRIES] = 0.0


@njit(**OPTIONS)
def again(m, low, trial, high):
    """Have a step taken again that ends between two others: at the trial, or half way after too many of these."""
    w, shared = m.w, m.plan[TOUCH]
    w[shared + TRIES] += 1.0
    w[shared + LOW], w[shared + HIGH] = low, high
    w[shared + TRIAL] = trial if low < trial < high and w[shared + TRIES] < _MANY else 0.5 * (low + high)
    return AGAIN


@of_contacts(0.0)
@njit(**OPTIONS)
def next_trial(m, found):
    """The step to take again [s], 0 where none is."""
    return m.w[m.plan[TOUCH] + TRIAL] if found == AGAIN else 0.0


@of_contacts(0.0)
@njit(**OPTIONS)
def unturned(m):
    """The longest step [s] in which no body with an open contact turns by more than 1 rad; flanks but turn."""
    plan, w, fastest = m.plan, m.w, 1e-300
    for c in range(plan[ACTS] - plan[CONTACTS]):
        if w[at(m, c) + BEGUN_AT] == 0.0 and m.acts[plan[CONTACTS] + c, WHAT] != FLANK:
            for side in range(2):
                fastest = larger(fastest, abs(w[plan[SECTION] + SEC * m.acts[plan[CONTACTS] + c, AT + side] + 5]))
    return 1.0 / fastest


@of_contacts(0)
@njit(**OPTIONS)
def look(m, table, t, h, here, searched):
    """Look for the first change of a contact in a step that is solved; see PASSED. TRIAL is the step to take instead.

    The change is between LOW and HIGH where one was ``searched`` already.
    """
    apart()
    plan, w, shared = m.plan, m.w, m.plan[TOUCH]
    last = 3 if table.ends[0] != 0.0 else 4
    if not between(m, table, t, h, here, 1.0):
        return ASTRAY
    note(m, t + h, last)
    sticking.end(m, table, last)
    if plan[RIGID] and not _note_rests(m, t, h, last):
        return ASTRAY
    if not searched:
        forget(m)
    first, which, how, at_end = NEVER, _NONE, 0, True
    for c in range(plan[HOLDS] - plan[DRIVES], plan[ACTS] - plan[CONTACTS]):
        w[at(m, c) + DUE] = 0.0
        if c >= 0:
            x, kind = _first_change(m, table, t, h, here, c, last)
        else:
            x, kind = _first_shift(m, table, t, h, here, c, last), SHIFTS
        at_end = at_end and (x == NEVER or (x > 0.9 and _due(m, t, c, kind, last)))
        if x < first:
            first, which, how = x, c, kind
    high = w[shared + HIGH]
    finest = 4.0 * EPS * larger(abs(t), h)
    if which != _NONE and first * h <= finest and not (searched and w[shared + LOW] > 0.0):
        w[at(m, which) + DUE] = how
        return AT_ONCE
    if which == _NONE:
        if not searched:
            return CHANGED if _harden(m, last) else PASSED
        which, how = int(w[shared + TARGET]), int(w[shared + FOUND_AT])
        if not _due(m, t, which, how, last):
            if high - h > finest:
                return again(m, h, h + _ahead(m, table, h, which, how, last), high)
            at_end = False
    elif not at_end and not (searched and h - w[shared + LOW] <= finest):
        w[shared + TARGET], w[shared + FOUND_AT] = which, how
        return again(m, w[shared + LOW] if searched else 0.0, first * h, h)
    if not at_end and _is_short_of(m, t, which, how, last):
        return PASSED  # longer steps passed zero on their way by less than they are exact
    w[at(m, which) + DUE] = how
    return CHANGED


@njit(**OPTIONS)
def _note_rests(m, t, h, last):
    """Keep the forces of rigid sides that rest, as stages have them and as the end asks for them; False: singular.

    Those of stages are as exact as displacements by them within the step: what may be no more than that is no pull.
    """
    apart()
    plan, w, found = m.plan, m.w, False
    for c in range(plan[ACTS] - plan[CONTACTS]):
        row = m.acts[plan[CONTACTS] + c, ROW_AT]
        if rests(m, plan[CONTACTS] + c):
            if not found and not mend(m, t + h, m.real, 0.0, 1):
                return False
            k, found = at(m, c), True
            unsure = 1e-6 * w[plan[TOUCH] + PRECISION] * extent(m, c) * w[k + RESISTING_MASS] / (h * h)
            for i in range(1, 4):
                j = k + NODES + 4 * i
                w[j + 2] = w[plan[STAGE_R] + plan[REACTIONS] * (i - 1) + row]
                w[j + 3] = w[j + 2] + unsure
            w[k + NODES + 4 * last + 3] = w[plan[NOW] + row]
    return True


@njit(**OPTIONS)
def _first_change(m, table, t, h, here, c, last):
    """Where in the step a contact changes first, as a share of it, and how."""
    apart()
    w, k = m.w, at(m, c)
    begun_at, j = w[k + BEGUN_AT], k + NODES
    for i in range(last):
        x_a, x_b = shares(table, i, last)
        wide, a, b = x_b - x_a, j + 4 * i, j + 4 * (i + 1)
        p_0, m_0, p_1, m_1 = w[a], w[a + 1] * h, w[b], w[b + 1] * h
        if begun_at == 0.0 or switches(m, c):
            if p_1 <= 0.0 and (m_1 < 0.0 or p_0 > 0.0 or m_0 < 0.0):
                return x_a + wide * falls(p_0, m_0 * wide, p_1, m_1 * wide), CLOSES
            if p_1 > 0.0:
                x = dips(m, table, t, h, here, c, i, last)
                if x < NEVER:
                    return x, CLOSES
            continue
        x, how = NEVER, 0
        if p_1 > 0.0 and m_1 > 0.0 and not rigid(m, c):
            x, how = x_a + wide * falls(-p_0, -m_0 * wide, -p_1, -m_1 * wide), OPENS
        sign_0, sign_1, none = w[a + 3], w[b + 3], no_force(m, c)
        if begun_at > 0.0 and sign_1 < -none and (m_1 > 0.0 or rigid(m, c)):
            share = sign_0 / (sign_0 - sign_1) if sign_0 > 0.0 else 0.0
            if x_a + wide * share < x:
                x, how = x_a + wide * share, LETS_GO
        if begun_at < 0.0 and sign_1 > none:
            share = sign_0 / (sign_0 - sign_1) if sign_0 < 0.0 else 0.0
            if x_a + wide * share < x:
                x, how = x_a + wide * share, PUSHES
        if how:
            return x, how
    return NEVER, 0


@of_holds(NEVER)
@njit(**OPTIONS)
def _first_shift(m, table, t, h, here, n, last):
    """Where in the step a hold sticks, slips or turns round first, as a share of it."""
    apart()
    w, k = m.w, at(m, n)
    mode = w[k + MODE]
    if mode == holds.IDLE or mode == holds.FLOWS or mode == holds.BENDS:
        return NEVER
    for i in range(last):
        x_a, x_b = shares(table, i, last)
        j = k + NODES + 4 * i
        p_0, m_0, p_1, m_1, near = w[j], w[j + 1] * h, w[j + 4], w[j + 5] * h, w[j + 6]
        wide = x_b - x_a
        if mode == holds.STUCK:
            if p_1 < -near:
                return x_a + wide * (p_0 / (p_0 - p_1) if p_0 > 0.0 else 0.0)
        elif p_1 < -near or (p_1 <= near and m_1 < 0.0 and p_0 > near):
            return x_a + wide * falls(p_0, m_0 * wide, p_1, m_1 * wide)
        elif p_1 > near:
            x = dips(m, table, t, h, here, n, i, last)
            if x < NEVER:
                return x
    return NEVER


@njit(**OPTIONS)
def _due(m, t, c, how, last):
    """Whether a contact is where it changes at the step's end, but for rounding."""
    w = m.w
    j = at(m, c) + NODES + 4 * last
    if how == SHIFTS:
        return sticking.due(m, c, last)
    if how == CLOSES or how == OPENS:
        return abs(w[j]) <= near(m, c, t, w[j + 1]) and (w[j + 1] < 0.0 if how == CLOSES else w[j + 1] > 0.0)
    return abs(w[j + 3]) <= no_force(m, c)


@njit(**OPTIONS)
def _is_short_of(m, t, c, how, last):
    """Whether an open contact at the step's end is yet to close, or a hold to slip, stick or turn round."""
    j = at(m, c) + NODES + 4 * last
    if how == SHIFTS:
        return m.w[j] > m.w[j + 2]
    return how == CLOSES and m.w[j] > near(m, c, t, m.w[j + 1])


@njit(**OPTIONS)
def _ahead(m, table, h, c, how, last):
    """How long after a step's end a contact changes, as things go there [s]."""
    w, j = m.w, at(m, c) + NODES + 4 * last
    if how == CLOSES or how == OPENS or (how == SHIFTS and w[at(m, c) + MODE] != holds.STUCK):
        return -w[j] / w[j + 1] if w[j + 1] != 0.0 else 0.0
    slope = (w[j + 3] - w[j - 1]) / (h * (1.0 - table.nodes[last - 2]))
    return -w[j + 3] / slope if slope != 0.0 else 0.0


@njit(**OPTIONS)
def _harden(m, last):
    """Mark contacts that go deeper at the step's end far faster than they began, by whose speed their law divides."""
    apart()
    plan, w, found = m.plan, m.w, False
    for c in range(plan[ACTS] - plan[CONTACTS]):
        k = at(m, c)
        if w[k + BEGUN_AT] > 0.0 and _FIRST_HYSTERETIC <= m.acts[plan[CONTACTS] + c, LAW] < NEWTON:
            if -w[k + NODES + 4 * last + 1] > _FAR_FASTER * w[k + BEGUN_AT]:
                w[k + DUE], found = HARDENS, True
    return found
