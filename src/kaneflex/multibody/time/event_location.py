"""Search for contact changes within a step of the compiled integration.

The gap is checked at the stages, and at points of the step's own polynomial where cubics between them come close to
zero, so that no penetration is missed. A step beyond a change is repeated up to it, until the gap is zero up to
rounding.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.multibody.unilateral import dry_friction, stick_slip
from kaneflex.multibody.dynamics.forces import rests
from kaneflex.multibody.unilateral.contact_numbers import EPS, at, extent, near, no_force, rigid, switches, tolerance
from kaneflex.multibody.unilateral.contacts import CLOSES, HARDENS, LETS_GO, OPENS, PUSHES, SHIFTS, change, pushed_on
from kaneflex.multibody.dynamics.loop_closure import follow, mend
from kaneflex.multibody.time.state_record import take
from kaneflex.multibody.compile.stand_ins import of_changes, of_contacts, of_holds, of_impacts
from kaneflex.multibody.time.step_curve import NEVER, between, dips, falls, gap_of, meet_all, shares
from kaneflex.multibody.model.layout import (
    ACTS, AIM, ALLOWED, AT, BEGUN_AT, CONTACTS, DRIVES, DUE, FLANK, FOUND_AT, GAP, GAP_RATE, HIGH, HOLDS, LARGEST, LAW,
    LOW, MODE, NODES, NOW, NUMBERS_AT, OPTIONS, PRECISION, PUSH_NOW, REACTIONS, RESISTING_MASS, RESTED, RIGID, ROW_AT,
    SEC, SECTION, SHIFT, STAGE_R, TARGET, TOUCH, TRIAL, TRIES, WHAT, apart, larger, smaller,
)  # fmt: skip
from kaneflex.multibody.unilateral.impact import LEAST_HEIGHT, NOISE, acceleration, collide, size_of

PASSED, CHANGED, AT_ONCE, AGAIN, ASTRAY = range(5)
"""Findings in a step: no change, one at its end, one before it begins, one inside or beyond it; or its end does not
close."""
_MANY = 30
"""Repeated steps after which the interval is halved."""
_PRESSED = 1e-8
"""Approach acceleration, relative to the sides' accelerations, that counts as pressing."""
_NONE = -1000000
"""Index of no contact and no hold."""
_FIRST_HYSTERETIC = 2
"""First law, by number, that divides by an approach speed."""
_FAR_FASTER = 3.0
"""Increase of an impact's speed that requires a new approach speed: pressing loads increase it at most 1.4 times."""


@of_changes(False)
@njit(**OPTIONS)
def searched(m):
    """True if steps are searched for changes."""
    return True


@of_changes(None)
@njit(**OPTIONS)
def note(m, t, i):
    """Store gap, rate, force and sign of the force of all contacts as those of the step's node i."""
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
            # at zero depth the force is zero, only its sign counts
            least, w[j + 3] = -1e-6 * w[k + ALLOWED] / w[plan[TOUCH] + PRECISION], w[k + PUSH_NOW]
            if w[k + BEGUN_AT] < 0.0 or w[k + GAP] > least:
                law, own, gap = m.acts[act, LAW], m.acts[act, NUMBERS_AT], smaller(w[k + GAP], least)
                w[j + 3] = touching.normal_force(law, w, own, abs(w[k + BEGUN_AT]), gap, w[k + GAP_RATE])
    stick_slip.store_node(m, t, i)


@of_changes(True)
@njit(**OPTIONS)
def back(m, here):
    """Restore the state of a row at the start of a step; False: a loop does not close."""
    apart()
    take(m, here)
    closes = follow(m, here[0])
    begin(m, here[0])
    return closes


@of_changes(0.0)
@njit(**OPTIONS)
def go_on(m, table, h, here, A, wanted, found):
    """Begin the next step after one with this finding; returns its largest length [s], see ``contacts.change``."""
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
    """True if contacts rest under Newton's law without being constraints of dependent coordinates, or vice versa."""
    return m.w[m.plan[TOUCH] + RESTED] != 0.0


@njit(**OPTIONS)
def begin(m, t):
    """Record the state at the start of a step.

    Rigid sides that separate without speed, as when a force vanishes, are still within rounding: only a return beyond
    that closes them again. Sides pressed together at the start close at once.
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
            # too short a time to leave a gap of rounding size
            if w[k + GAP] + w[k + SHIFT] > zero and 16.0 * EPS * abs(t) < aim < w[m.plan[TOUCH] + AIM]:
                w[m.plan[TOUCH] + AIM] = aim
    stick_slip.begin(m)
    note(m, t, 0)


@njit(**OPTIONS)
def _meets(gap, rate, bent):
    """Time until a gap with this rate and acceleration closes [s]; infinity if never."""
    root = rate * rate - 2.0 * bent * gap
    if not gap > 0.0 or root < 0.0 or (bent >= 0.0 and rate >= 0.0):
        return math.inf
    return 2.0 * gap / (math.sqrt(root) - rate) if bent >= 0.0 or rate < 0.0 else (-rate - math.sqrt(root)) / bent


@of_changes(0.0)
@njit(**OPTIONS)
def aimed(m, h):
    """Step [s] instead of h that ends at the predicted closing of rigid sides, to avoid repetitions."""
    return smaller(h, m.w[m.plan[TOUCH] + AIM])


@njit(**OPTIONS)
def forget(m):
    """End the search for a change in a step."""
    m.w[m.plan[TOUCH] + HIGH] = m.w[m.plan[TOUCH] + LOW] = m.w[m.plan[TOUCH] + TRIES] = 0.0


@njit(**OPTIONS)
def again(m, low, trial, high):
    """Repeat a step with an end between two others: at the trial, or halfway after too many of these."""
    w, shared = m.w, m.plan[TOUCH]
    w[shared + TRIES] += 1.0
    w[shared + LOW], w[shared + HIGH] = low, high
    w[shared + TRIAL] = trial if low < trial < high and w[shared + TRIES] < _MANY else 0.5 * (low + high)
    return AGAIN


@of_changes(0.0)
@njit(**OPTIONS)
def next_trial(m, found):
    """Length of the repeated step [s], 0 if there is none."""
    return m.w[m.plan[TOUCH] + TRIAL] if found == AGAIN else 0.0


@of_contacts(1e300)
@njit(**OPTIONS)
def unturned(m):
    """Longest step [s] in which no body with an open contact turns by more than 1 rad; without flanks."""
    plan, w, fastest = m.plan, m.w, 1e-300
    for c in range(plan[ACTS] - plan[CONTACTS]):
        if w[at(m, c) + BEGUN_AT] == 0.0 and m.acts[plan[CONTACTS] + c, WHAT] != FLANK:
            for side in range(2):
                fastest = larger(fastest, abs(w[plan[SECTION] + SEC * m.acts[plan[CONTACTS] + c, AT + side] + 5]))
    return 1.0 / fastest


@of_changes(0)
@njit(**OPTIONS)
def look(m, table, t, h, here, searched):
    """Find the first change of a contact in a solved step; see PASSED. TRIAL is the step to take instead.

    The change is between LOW and HIGH if one was ``searched`` before.
    """
    apart()
    plan, w, shared = m.plan, m.w, m.plan[TOUCH]
    last = 3 if table.ends[0] != 0.0 else 4
    if not between(m, table, t, h, here, 1.0):
        return ASTRAY
    note(m, t + h, last)
    stick_slip.extrapolate_to_end(m, table, last)
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
        return PASSED  # longer steps cross zero within their error
    w[at(m, which) + DUE] = how
    return CHANGED


@of_impacts(True)
@njit(**OPTIONS)
def _note_rests(m, t, h, last):
    """Store the forces of rigid sides at rest, in the stages and at the end; False: singular.

    Forces of stages are as accurate as displacements within the step: smaller tensions are ignored.
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
    """First change of a contact in the step, as a share of it, and its kind."""
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
    """First stick, slip or reversal of a hold in the step, as a share of it."""
    apart()
    w, k = m.w, at(m, n)
    mode = w[k + MODE]
    if mode == dry_friction.IDLE or mode == dry_friction.FLOWS or mode == dry_friction.BENDS:
        return NEVER
    for i in range(last):
        x_a, x_b = shares(table, i, last)
        j = k + NODES + 4 * i
        p_0, m_0, p_1, m_1, near = w[j], w[j + 1] * h, w[j + 4], w[j + 5] * h, w[j + 6]
        wide = x_b - x_a
        if mode == dry_friction.STUCK:
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
    """True if a contact changes at the step's end, up to rounding."""
    w = m.w
    j = at(m, c) + NODES + 4 * last
    if how == SHIFTS:
        return stick_slip.due(m, c, last)
    if how == CLOSES or how == OPENS:
        return abs(w[j]) <= near(m, c, t, w[j + 1]) and (w[j + 1] < 0.0 if how == CLOSES else w[j + 1] > 0.0)
    return abs(w[j + 3]) <= no_force(m, c)


@njit(**OPTIONS)
def _is_short_of(m, t, c, how, last):
    """True if an open contact at the step's end has yet to close, or a hold to slip, stick or reverse."""
    j = at(m, c) + NODES + 4 * last
    if how == SHIFTS:
        return m.w[j] > m.w[j + 2]
    return how == CLOSES and m.w[j] > near(m, c, t, m.w[j + 1])


@njit(**OPTIONS)
def _ahead(m, table, h, c, how, last):
    """Time from a step's end to a contact's change, by linear extrapolation [s]."""
    w, j = m.w, at(m, c) + NODES + 4 * last
    if how == CLOSES or how == OPENS or (how == SHIFTS and w[at(m, c) + MODE] != dry_friction.STUCK):
        return -w[j] / w[j + 1] if w[j + 1] != 0.0 else 0.0
    slope = (w[j + 3] - w[j - 1]) / (h * (1.0 - table.nodes[last - 2]))
    return -w[j + 3] / slope if slope != 0.0 else 0.0


@njit(**OPTIONS)
def _harden(m, last):
    """Mark contacts whose speed at the step's end far exceeds the approach speed by which their law divides."""
    apart()
    plan, w, found = m.plan, m.w, False
    for c in range(plan[ACTS] - plan[CONTACTS]):
        k = at(m, c)
        if w[k + BEGUN_AT] > 0.0 and _FIRST_HYSTERETIC <= m.acts[plan[CONTACTS] + c, LAW] < NEWTON:
            if -w[k + NODES + 4 * last + 1] > _FAR_FASTER * w[k + BEGUN_AT]:
                w[k + DUE], found = HARDENS, True
    return found
