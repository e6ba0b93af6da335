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
from kaneflex.multibody.compile.stand_ins import if_changes, if_contacts, if_impacts
from kaneflex.multibody.dynamics.algebra import angular_size
from kaneflex.multibody.dynamics.kinematics import twist_at_section
from kaneflex.multibody.dynamics.loop_closure import correct_accelerations, follow
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, smaller
from kaneflex.multibody.model.layout import (
    AIM, ALLOWED, AT, BENDING, CLOSED, DUE, FLANK, FLOWING, FORCE, FOUND_AT, GAP, GAP_ACCEL, GAP_RATE, HIGH, LARGEST,
    LAW, LOW, MEMORY, MODE, NODES, OPEN, PRECISION, REACTIONS, RELEASED, RESISTING_MASS, RESTED, RIGID, SHIFT, SLIPPING,
    STAGE_R, STICKING, TARGET, TOUCH, TRIAL, TRIES, WHAT,
)  # fmt: skip
from kaneflex.multibody.time.state_record import read_row
from kaneflex.multibody.time.step_curve import (
    NEVER, dips, evaluate, extrapolate_to_end, falls, fill_contacts, gap_of, node_shares, store_node,
)  # fmt: skip
from kaneflex.multibody.unilateral.active_set import (
    CLOSES, HARDENS, LETS_GO, OPENS, PUSHES, SHIFTS, apply_changes, record_impulses,
)  # fmt: skip
from kaneflex.multibody.unilateral.impact import LEAST_HEIGHT, collide
from kaneflex.multibody.unilateral.frictions import NOISE, apply_friction, motion_size
from kaneflex.multibody.unilateral.relative_rows import row_scale, zero_gap
from kaneflex.multibody.unilateral.rows import (
    EPS, act_of, at, contacts, frictions, is_at_rest, is_rigid, is_switch, law_at, row_at, zero_force,
)  # fmt: skip

PASSED, CHANGED, AT_ONCE, AGAIN, ASTRAY = range(5)
"""Findings in a step: no change, one at its end, one before it begins, one inside or beyond it; or its end does not
close."""
_MANY = 30
"""Repeated steps after which the interval is halved."""
_PRESSED = 1e-8
"""Approach acceleration, relative to the sides' accelerations, that counts as pressing."""
_NONE = -1000000
"""Index of no row."""
_FIRST_HYSTERETIC = 2
"""First law, by number, that divides by an approach speed."""
_FAR_FASTER = 3.0
"""Increase of an impact's speed that requires a new approach speed: pressing loads increase it at most 1.4 times."""
_SAME_SPEED = 1e-9
"""Share of the approach speed up to which its increase is located."""


@if_changes(False)
@njit(**OPTIONS)
def has_events(m):
    """True if steps are searched for changes."""
    return True


@if_changes(None)
@njit(**OPTIONS)
def monitor(m, t, i):
    """Store gap, rate, force and sign of the force of all contacts as those of the step's node i, and what is monitored
    of frictions."""
    no_inline()
    w = m.w
    for n in range(contacts(m)):
        k = at(m, n)
        j = k + NODES + 4 * i
        w[j], w[j + 1], w[j + 2], w[j + 3] = gap_of(m, n), w[k + GAP_RATE], w[k + FORCE], 1.0
        if is_switch(m, n):
            w[k + LARGEST] = larger(w[k + LARGEST], abs(w[k + GAP]))
        elif is_rigid(m, n):
            w[j + 3] = w[k + FORCE]
        elif w[k + MODE] != OPEN:
            # at zero depth the force is zero, only its sign counts
            least, w[j + 3] = -1e-6 * w[k + ALLOWED] / w[m.plan[TOUCH] + PRECISION], w[k + FORCE]
            if w[k + MODE] == RELEASED or w[k + GAP] > least:
                law, gap = m.acts[act_of(m, n), LAW], smaller(w[k + GAP], least)
                w[j + 3] = touching.normal_force(law, w, law_at(m, n), w[k + MEMORY], gap, w[k + GAP_RATE])
    store_node(m, t, i)


@if_changes(True)
@njit(**OPTIONS)
def restore(m, state):
    """Restore the state of a row at the start of a step; False: a loop does not close."""
    no_inline()
    read_row(m, state)
    closes = follow(m, state[0])
    begin(m, state[0])
    return closes


@if_changes(0.0)
@njit(**OPTIONS)
def next_step(m, table, h, state, A, wanted, found):
    """Begin the next step after one with this finding; returns its largest length [s], see ``apply_changes``."""
    no_inline()
    if found != AT_ONCE:
        record_impulses(m, table, h)
    if found != PASSED:
        if m.plan[RIGID]:
            wanted = collide(m, state, A, wanted)
        if wanted > 0.0:
            wanted = apply_changes(m, state, A, wanted)
    begin(m, state[0])
    return wanted


@if_contacts(False)
@njit(**OPTIONS)
def rest_changed(m):
    """True if contacts rest under Newton's law without being constraints of dependent coordinates, or vice versa."""
    return m.w[m.plan[TOUCH] + RESTED] != 0.0


@njit(**OPTIONS)
def begin(m, t):
    """Record the state at the start of a step.

    Rigid sides that separate without speed, as when a force vanishes, are still within rounding: only a return beyond
    that closes them again. Sides pressed together at the start close at once.
    """
    no_inline()
    w, shared = m.w, m.plan[TOUCH]
    w[shared + AIM] = math.inf
    fill_contacts(m, t)
    for n in range(contacts(m)):
        k, rate = at(m, n), w[at(m, n) + GAP_RATE]
        if is_rigid(m, n) and w[k + MODE] == OPEN:
            zero, bent = zero_gap(m, n, t, rate), w[k + GAP_ACCEL]
            fast, faster = motion_size(m, n, 0), motion_size(m, n, 1)
            slow = larger(math.sqrt(2.0 * LEAST_HEIGHT * zero * faster), NOISE * fast)
            pressed = bent < -_PRESSED * faster - NOISE * fast * fast / row_scale(m, n)
            still = abs(rate) <= slow and w[k + GAP] <= zero
            w[k + SHIFT] = 8.0 * zero if still and not pressed else 0.0
            if still and pressed:
                w[k + GAP], w[k + GAP_RATE] = smaller(w[k + GAP], 0.0), 0.0  # which rounding must not let part first
            aim = _time_to_close(gap_of(m, n), rate, bent)
            aim += 3.0 * EPS * larger(abs(t), aim)
            # too short a time to leave a gap of rounding size
            if gap_of(m, n) > zero and 16.0 * EPS * abs(t) < aim < w[shared + AIM]:
                w[shared + AIM] = aim
    apply_friction(m)
    monitor(m, t, 0)


@njit(**OPTIONS)
def _time_to_close(gap, rate, bent):
    """Time until a gap with this rate and acceleration closes [s]; infinity if never."""
    root = rate * rate - 2.0 * bent * gap
    if not gap > 0.0 or root < 0.0 or (bent >= 0.0 and rate >= 0.0):
        return math.inf
    return 2.0 * gap / (math.sqrt(root) - rate) if bent >= 0.0 or rate < 0.0 else (-rate - math.sqrt(root)) / bent


@if_changes(0.0)
@njit(**OPTIONS)
def step_to_contact(m, h):
    """Step [s] instead of h that ends at the predicted closing of rigid sides, to avoid repetitions."""
    return smaller(h, m.w[m.plan[TOUCH] + AIM])


@njit(**OPTIONS)
def end_search(m):
    """End the search for a change in a step."""
    m.w[m.plan[TOUCH] + HIGH] = m.w[m.plan[TOUCH] + LOW] = m.w[m.plan[TOUCH] + TRIES] = 0.0


@njit(**OPTIONS)
def repeat_step(m, low, trial, high):
    """Repeat a step with an end between two others: at the trial, or halfway after too many of these."""
    w, shared = m.w, m.plan[TOUCH]
    w[shared + TRIES] += 1.0
    w[shared + LOW], w[shared + HIGH] = low, high
    w[shared + TRIAL] = trial if low < trial < high and w[shared + TRIES] < _MANY else 0.5 * (low + high)
    return AGAIN


@if_changes(0.0)
@njit(**OPTIONS)
def next_trial(m, found):
    """Length of the repeated step [s], 0 if there is none."""
    return m.w[m.plan[TOUCH] + TRIAL] if found == AGAIN else 0.0


@if_contacts(1e300)
@njit(**OPTIONS)
def turn_limit(m):
    """Longest step [s] in which no body with an open contact turns by more than 1 rad; without flanks."""
    w, fastest = m.w, 1e-300
    for n in range(contacts(m)):
        act = act_of(m, n)
        if w[at(m, n) + MODE] == OPEN and m.acts[act, WHAT] != FLANK:
            for side in range(2):
                fastest = larger(fastest, angular_size(twist_at_section(m, m.acts[act, AT + side])))
    return 1.0 / fastest


@if_changes(0)
@njit(**OPTIONS)
def find_change(m, table, t, h, state, searched):
    """Find the first change of a contact in a solved step; see PASSED. TRIAL is the step to take instead.

    The change is between LOW and HIGH if one was ``searched`` before.
    """
    no_inline()
    plan, w, shared = m.plan, m.w, m.plan[TOUCH]
    last = 3 if table.ends[0] != 0.0 else 4
    if not evaluate(m, table, t, h, state, 1.0):
        return ASTRAY
    monitor(m, t + h, last)
    extrapolate_to_end(m, table, last)
    if plan[RIGID] and not _store_rest_forces(m, t, h, last):
        return ASTRAY
    if not searched:
        end_search(m)
    first, which, how, at_end = NEVER, _NONE, 0, True
    for n in range(-frictions(m), contacts(m)):
        w[at(m, n) + DUE] = 0.0
        x, kind = _first_change(m, table, t, h, state, n, last)
        at_end = at_end and (x == NEVER or (x > 0.9 and _due(m, t, n, kind, last)))
        if x < first:
            first, which, how = x, n, kind
    high = w[shared + HIGH]
    finest = 4.0 * EPS * larger(abs(t), h)
    if which != _NONE and first * h <= finest and not (searched and w[shared + LOW] > 0.0):
        w[at(m, which) + DUE] = how
        return AT_ONCE
    if which == _NONE:
        if not searched:
            return PASSED
        which, how = int(w[shared + TARGET]), int(w[shared + FOUND_AT])
        if not _due(m, t, which, how, last):
            if high - h > finest:
                return repeat_step(m, h, h + _time_to_change(m, table, h, which, how, last), high)
            at_end = False
    elif not at_end and not (searched and h - w[shared + LOW] <= finest):
        w[shared + TARGET], w[shared + FOUND_AT] = which, how
        return repeat_step(m, w[shared + LOW] if searched else 0.0, first * h, h)
    if not at_end and _is_short_of(m, t, which, how, last):
        return PASSED  # longer steps cross zero within their error
    w[at(m, which) + DUE] = how
    return CHANGED


@if_impacts(True)
@njit(**OPTIONS)
def _store_rest_forces(m, t, h, last):
    """Store the forces of rigid sides at rest, in the stages and at the end; False: singular.

    Forces of stages are as accurate as displacements within the step: smaller tensions are ignored.
    """
    no_inline()
    plan, w, found = m.plan, m.w, False
    for n in range(contacts(m)):
        if is_at_rest(m, n):
            if not found and not correct_accelerations(m, t + h, m.real, 1):
                return False
            k, row, found = at(m, n), row_at(m, n), True
            unsure = 1e-6 * w[plan[TOUCH] + PRECISION] * row_scale(m, n) * w[k + RESISTING_MASS] / (h * h)
            for i in range(1, 4):
                j = k + NODES + 4 * i
                w[j + 2] = w[plan[STAGE_R] + plan[REACTIONS] * (i - 1) + row]
                w[j + 3] = w[j + 2] + unsure
            w[k + NODES + 4 * last + 3] = m.multipliers[row]
    return True


@njit(**OPTIONS)
def _first_change(m, table, t, h, state, n, last):
    """First change of a row in the step, as a share of it, and its kind.

    The gap of an open contact, or the speed of slipping friction, falls to zero; the gap of a closed contact rises to
    zero, or its approach speed to that which replaces the first one; the force of a closed contact, the reserve of
    sticking friction, or the pull of a released contact ends.
    """
    no_inline()
    w, mode = m.w, m.w[at(m, n) + MODE]
    if mode == FLOWING or mode == BENDING or (mode == OPEN and n < 0):
        return NEVER, 0
    for i in range(last):
        x_a, x_b = node_shares(table, i, last)
        wide, a = x_b - x_a, at(m, n) + NODES + 4 * i
        b = a + 4
        p_0, m_0, p_1, m_1 = w[a], w[a + 1] * h, w[b], w[b + 1] * h
        if mode == OPEN or mode == SLIPPING:
            zero = w[b + 2] if n < 0 else 0.0
            due = p_1 <= 0.0 and (m_1 < 0.0 or p_0 > 0.0 or m_0 < 0.0)
            if n < 0:
                due = p_1 < -zero or (p_1 <= zero and m_1 < 0.0 and p_0 > zero)
            x = NEVER
            if due:
                x = x_a + wide * falls(p_0, m_0 * wide, p_1, m_1 * wide)
            elif p_1 > zero:
                x = dips(m, table, t, h, state, n, i, last)
            if x < NEVER:
                return x, SHIFTS if n < 0 else CLOSES
            continue
        x, how = NEVER, 0
        if n >= 0 and p_1 > 0.0 and m_1 > 0.0 and not is_rigid(m, n):
            x, how = x_a + wide * falls(-p_0, -m_0 * wide, -p_1, -m_1 * wide), OPENS
        sign, none = -1.0 if mode == RELEASED else 1.0, zero_force(m, n) if n >= 0 else w[b + 2]
        f_0, f_1 = sign * w[a + 3], sign * w[b + 3]
        if f_1 < -none and (mode != CLOSED or m_1 > 0.0 or is_rigid(m, n)):
            share = x_a + wide * (f_0 / (f_0 - f_1) if f_0 > 0.0 else 0.0)
            if share < x:
                x, how = share, SHIFTS if n < 0 else LETS_GO if mode == CLOSED else PUSHES
        if n >= 0 and _slower(m, n, w[b + 1]) < 0.0:
            v_0, v_1 = _slower(m, n, w[a + 1]), _slower(m, n, w[b + 1])
            share = x_a + wide * (v_0 / (v_0 - v_1) if v_0 > 0.0 else 0.0)
            if share < x:
                x, how = share, HARDENS
        if how:
            return x, how
    return NEVER, 0


@njit(**OPTIONS)
def _slower(m, n, rate):
    """Approach speed missing to that which replaces a contact's first one [m/s]; 1 if its law divides by none."""
    k = at(m, n)
    if m.w[k + MODE] == CLOSED and _FIRST_HYSTERETIC <= m.acts[act_of(m, n), LAW] < NEWTON:
        return _FAR_FASTER * m.w[k + MEMORY] + rate
    return 1.0


@njit(**OPTIONS)
def _due(m, t, n, how, last):
    """True if a row changes at the step's end, up to rounding."""
    w, j = m.w, at(m, n) + NODES + 4 * last
    if how == SHIFTS:
        return abs(w[j]) <= w[j + 2] and (w[at(m, n) + MODE] == STICKING or w[j + 1] < 0.0)
    if how == CLOSES or how == OPENS:
        return abs(w[j]) <= zero_gap(m, n, t, w[j + 1]) and (w[j + 1] < 0.0 if how == CLOSES else w[j + 1] > 0.0)
    if how == HARDENS:
        return abs(_slower(m, n, w[j + 1])) <= _SAME_SPEED * w[at(m, n) + MEMORY]
    return abs(w[j + 3]) <= zero_force(m, n)


@njit(**OPTIONS)
def _is_short_of(m, t, n, how, last):
    """True if an open contact at the step's end has yet to close, or a friction to slip, stick or reverse."""
    j = at(m, n) + NODES + 4 * last
    if how == SHIFTS:
        return m.w[j] > m.w[j + 2]
    return how == CLOSES and m.w[j] > zero_gap(m, n, t, m.w[j + 1])


@njit(**OPTIONS)
def _time_to_change(m, table, h, n, how, last):
    """Time from a step's end to a row's change, by linear extrapolation [s]."""
    w, j = m.w, at(m, n) + NODES + 4 * last
    if how == CLOSES or how == OPENS or w[at(m, n) + MODE] == SLIPPING:
        return -w[j] / w[j + 1] if w[j + 1] != 0.0 else 0.0
    before, value = w[j - 1], w[j + 3]
    if how == HARDENS:
        before, value = _slower(m, n, w[j - 3]), _slower(m, n, w[j + 1])
    slope = (value - before) / (h * (1.0 - table.nodes[last - 2]))
    return -value / slope if slope != 0.0 else 0.0
