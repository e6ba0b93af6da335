"""Newton's law of impact: speeds after impacts of rigid sides, and resting contacts.

At an instant all touching contacts act together. Impulses p along their normals and against the slip change the gaps'
rates v to v', with all loops closed and prescribed drives held; p >= 0, v' >= e (-v) if v < 0 and v' >= 0 otherwise,
and one of both is an equality (Moreau 1988, CISM 302; Pfeiffer & Glocker 1996, Multibody Dynamics with Unilateral
Contacts, ch. 8). Along a contact's face the impulse is at most mu times the normal one, against the remaining slip
(Glocker & Pfeiffer 1995, Nonlinear Dyn. 7, 471); a joint's friction is mu times the impulse of its own reactions.
Friction by a preload, a compliant contact's force or bristles has no impulse. Each row loses the energy p (v + v')/2
(Thomson & Tait 1879, Treatise on Natural Philosophy, sec. 309), the rest is work of the drives.

The same problem with forces and accelerations determines the resting contacts: those that loads press together, and
that separate so slowly that they would return before the gap exceeds rounding. This ends sequences of ever shorter
bounces. A resting contact is a row like those of the cuts: it determines a dependent coordinate, and its force is an
unknown. It opens if the force would become tensile; then forces are solved again. Redundant ones share the force by
their compliance (:mod:`.factors`). Both problems are solved by :mod:`kaneflex.multibody.unilateral.decision`.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.stand_ins import if_frictions, if_impacts
from kaneflex.multibody.compile.values import copy
from kaneflex.multibody.dynamics.algebra import angular_size, linear_size
from kaneflex.multibody.dynamics.loop_closure import correct_accelerations, factorise_now, follow, rows_of_frictions
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, shifted, smaller
from kaneflex.multibody.model.codes import FORCES, IMPULSES, NOTHING
from kaneflex.multibody.model.layout import (
    ALLOWED, ALONE, BODIES, BOUNCE, BREAKAWAY, CLOSED, COORDINATES, CUT_ROWS, DECIDES, DUE, EXTENT, FORCE, GAP,
    GAP_ACCEL, GAP_RATE, IMPULSE, KEPT, LAST_A, LAST_R, MAY, MEMORY, MEMORY_BEFORE, MET, MODE, MODE_BEFORE, NEW, OLD,
    OPEN, POWER, QUIET, REACTIONS, RESISTING_MASS, RESTED, RESTED_BEFORE, ROUNDED, ROW_OF, SHUT, SLIP, SLIPPING,
    SLIP_RATE, STICKING, STICKS, STRUCK, TOUCH, UNSURE, WORKS,
)  # fmt: skip
from kaneflex.multibody.time.state_record import works_at, write_row
from kaneflex.multibody.unilateral import decision
from kaneflex.multibody.unilateral.active_set import LETS_GO, begin_impact, open_contact
from kaneflex.multibody.unilateral.decision import LET_GO, STILL, TURNED
from kaneflex.multibody.unilateral.frictions import (
    NOISE, motion_size, open_with_contact, slip, stick, zero_acceleration, zero_speed,
)  # fmt: skip
from kaneflex.multibody.unilateral.relative_rows import fill_contact, row_scale, zero_gap
from kaneflex.multibody.unilateral.rows import (
    EPS, LAW_AT, MU_AT, VISCOUS_LAW, across, at, contact_of, contacts, frictions, is_rigid, is_second, law_at,
    magnitude, row_at, second_row, zero_force,
)  # fmt: skip
from kaneflex.multibody.unilateral.step_rows import effective_mass

_TOGETHER = 100.0
"""Tolerances of a gap within which sides meet at one instant."""
LEAST_HEIGHT = 16.0
"""Least height of a bounce, in tolerances of a gap."""


@if_impacts(0.0)
@njit(**OPTIONS)
def collide(m, state, A, wanted):
    """Solve the impacts of touching rigid sides and find those that rest; returns the next step [s], -1 at a singular
    state, -2 without a solution with friction.

    RESTED is set if other contacts rest than before: dependent coordinates must be chosen again then.
    """
    no_inline()
    plan, w, t = m.plan, m.w, state[0]
    kept, cuts = m.pivots[KEPT], 0
    if not _gather(m, t):
        return wanted
    for r in range(kept):
        cuts += plan[plan[ROW_OF] + r] < plan[CUT_ROWS]
    m.pivots[KEPT] = cuts  # resting contacts may separate
    _gather_frictions(m)
    copy(shifted(state, 1 + plan[COORDINATES]), shifted(w, plan[LAST_A]), plan[COORDINATES])
    copy(m.multipliers, shifted(w, plan[LAST_R]), plan[REACTIONS])
    undecided = _collided(m, t, A)
    m.pivots[KEPT], m.pivots[DECIDES] = kept, NOTHING
    if undecided:
        return -2.0 if undecided == 2 and frictions(m) else -1.0
    _settle(m, state)
    if kept > cuts and w[plan[TOUCH] + RESTED] == 0.0 and not (follow(m, t) and correct_accelerations(m, t, A, 2)):
        return -1.0
    write_row(m, t, state)
    return wanted


@njit(**OPTIONS)
def _gather(m, t):
    """Note the touching contacts with the rates of their gaps; True if there are any. All are marked as not resting.

    If the force of one has come to zero, all with zero force separate.
    """
    no_inline()
    w, found, parting = m.w, False, False
    for n in range(contacts(m)):
        w[at(m, n) + MET] = w[at(m, n) + MAY] = 0.0
        parting = parting or (is_rigid(m, n) and w[at(m, n) + DUE] == LETS_GO)
    for n in range(contacts(m)):
        if not is_rigid(m, n):
            continue
        k = fill_contact(m, n)
        rested = w[k + MODE] == CLOSED
        rate = 0.0 if rested or abs(w[k + GAP_RATE]) <= 0.1 * NOISE * motion_size(m, n, 0) else w[k + GAP_RATE]
        if parting and rested and w[k + FORCE] <= zero_force(m, n):
            w[k + DUE] = LETS_GO
        if rested or w[k + DUE] != 0.0 or w[k + GAP] <= _TOGETHER * zero_gap(m, n, t, rate):
            w[k + MET], w[k + OLD], w[k + RESTED_BEFORE], w[k + STICKS] = 1.0, rate, rested, 0.0
            w[k + MAY], found = 1.0, True
            w[k + MODE], m.multipliers[row_at(m, n)] = OPEN, 0.0
    return found


@if_frictions(None)
@njit(**OPTIONS)
def _gather_frictions(m):
    """Note the modes of frictions, and which may have an impulse; sticking ones that are to slip bear BREAKAWAY."""
    no_inline()
    w = m.w
    rows_of_frictions(m)
    for n in range(-frictions(m), 0):
        k, j, c = at(m, n), law_at(m, n), contact_of(m, n)
        w[k + MODE_BEFORE], w[k + MEMORY_BEFORE], w[k + OLD] = w[k + MODE], w[k + MEMORY], w[k + SLIP]
        if w[k + MODE] == STICKING:
            w[k + OLD] = 0.0
            if w[k + DUE] > 0.0:
                w[k + DUE], w[k + BREAKAWAY] = LET_GO, magnitude(m, n, FORCE)
        w[k + MAY] = (c < 0 or w[at(m, c) + MET] != 0.0) and w[j + LAW_AT] < VISCOUS_LAW and w[j + MU_AT] > 0.0
        w[k + MODE], w[k + STRUCK] = OPEN, 0.0


@njit(**OPTIONS)
def _fill_masses(m, A):
    """Effective masses along frictions and contacts that may have impulses, and rounding errors of their rates by the
    largest speed; False: singular."""
    no_inline()
    w, fastest = m.w, 0.0
    for b in range(m.plan[BODIES]):
        twist = m.twist[m.frames[b, 0]]
        fastest = larger(fastest, linear_size(twist) + w[m.plan[TOUCH] + EXTENT] * angular_size(twist))
    if not factorise_now(m, A):
        return False
    for n in range(-frictions(m), contacts(m)):
        k = at(m, n)
        if n < 0 or w[k + MAY] != 0.0:
            w[k + RESISTING_MASS] = effective_mass(m, n, A)
            w[k + ROUNDED] = NOISE * fastest * row_scale(m, n) / w[m.plan[TOUCH] + EXTENT]
    return True


@njit(**OPTIONS)
def _collided(m, t, A):
    """Speeds after the impact, and forces of the resting contacts; returns as :func:`decision.decide`."""
    no_inline()
    if not _fill_masses(m, A):
        return 1
    for _ in range(contacts(m) + 1):
        undecided = _jump(m, t, A)
        if undecided:
            return undecided
        _modes_after_impact(m, t)
        undecided, slowed = _forces(m, t, A)
        if undecided or not slowed:
            return undecided
    return 1


@njit(**OPTIONS)
def _guess(m, share):
    """Set the speeds of separation by a share of the restitution, and first modes."""
    no_inline()
    w = m.w
    for n in range(contacts(m)):
        k = at(m, n)
        w[k + MAY] = w[k + MET]
        if w[k + MET] != 0.0:
            e = w[law_at(m, n) + 6] if w[k + STICKS] == 0.0 else 0.0
            w[k + BOUNCE], w[k + MODE] = share * e * larger(-w[k + OLD], 0.0), OPEN if w[k + OLD] > 0.0 else CLOSED
    for n in range(-frictions(m), 0):
        if w[at(m, n) + MAY] == 0.0:
            w[at(m, n) + MODE] = OPEN
        elif is_second(m, n):
            continue
        elif magnitude(m, n, OLD) != 0.0:
            slip(m, n, w[at(m, n) + OLD], across(m, n, OLD))
        else:
            stick(m, n)


@njit(**OPTIONS)
def _jump(m, t, A):
    """Impulses, and all speeds after them; returns as :func:`decision.decide`."""
    no_inline()
    w = m.w
    m.pivots[DECIDES] = IMPULSES
    _guess(m, 1.0)
    undecided = decision.search(m, t, A)
    if undecided == 2:  # in a jamming wedge no impulses satisfy restitution
        _guess(m, 0.0)
        undecided = decision.search(m, t, A)
    m.pivots[DECIDES] = NOTHING
    for n in range(-frictions(m), contacts(m)):
        k = at(m, n)
        if w[k + MAY] != 0.0:  # rounding is no impulse: frictions would begin anew
            size = magnitude(m, n, FORCE) if n < 0 else abs(w[k + FORCE])
            struck = size > w[k + ROUNDED] * w[k + RESISTING_MASS]
            w[k + NEW], w[k + STRUCK] = w[k + GAP_RATE], w[k + FORCE] if struck else 0.0
    copy(shifted(w, m.plan[LAST_R]), m.multipliers, m.plan[REACTIONS])
    return undecided


@if_frictions(None)
@njit(**OPTIONS)
def _modes_after_impact(m, t):
    """First modes after an impact, or none: frictions with a speed slip that way, the others stick.

    Those without impulses have their modes before.
    """
    no_inline()
    w, jumped = m.w, False
    for n in range(contacts(m)):
        jumped = jumped or (w[at(m, n) + MET] != 0.0 and w[at(m, n) + STRUCK] > 0.0)
    for n in range(-frictions(m), 0):
        k = at(m, n)
        if w[k + MAY] == 0.0:
            w[k + MODE], w[k + MEMORY] = w[k + MODE_BEFORE], w[k + MEMORY_BEFORE]
        if w[k + MAY] == 0.0 or is_second(m, n):
            continue
        if jumped:
            w[k + DUE] = 0.0
        none = zero_speed(m, n, t) + 10.0 * w[k + ROUNDED]
        if magnitude(m, n, NEW) > (none if w[k + DUE] == 0.0 else TURNED * none if second_row(m, n) else math.inf):
            w[k + DUE] = 0.0
            slip(m, n, w[k + NEW], across(m, n, NEW))
            continue
        w[k + DUE] = smaller(w[k + DUE], STILL)
        stick(m, n)
        if w[k + MODE_BEFORE] == STICKING and not second_row(m, n):
            w[k + MEMORY] = w[k + MEMORY_BEFORE]


@njit(**OPTIONS)
def _forces(m, t, A):
    """Accelerations without contacts, and forces of the resting contacts; returns as :func:`decision.decide`, and the
    number of those that separate too slowly to bounce, and stay."""
    no_inline()
    w, slowed, undecided, stopped = m.w, 0, 0, 0.0
    for n in range(contacts(m)):
        if w[at(m, n) + MET] != 0.0:
            w[at(m, n) + MODE], m.multipliers[row_at(m, n)] = OPEN, 0.0
    m.pivots[DECIDES] = FORCES
    if not correct_accelerations(m, t, A, 1):
        return 1, 0
    m.pivots[DECIDES] = NOTHING
    for n in range(-frictions(m), 0):  # sticking beyond its limit stops what moves without it
        if w[at(m, n) + MODE] == STICKING:
            stopped = larger(stopped, abs(m.multipliers[row_at(m, n)]) / w[at(m, n) + RESISTING_MASS] / row_scale(m, n))
    for n in range(-frictions(m), contacts(m)):
        k, fast = at(m, n), motion_size(m, n, 0) if n < 0 or is_rigid(m, n) else 0.0
        if n < 0 or w[k + MET] != 0.0:
            w[k + UNSURE] = NOISE * (motion_size(m, n, 1) + fast * fast / row_scale(m, n) + stopped * row_scale(m, n))
        if n >= 0 and w[k + MET] != 0.0:
            k = fill_contact(m, n)
            w[k + ALONE], w[k + MODE] = w[k + GAP_ACCEL], CLOSED
    if not decision.begin(m, t, A):
        return 1, 0
    m.pivots[DECIDES] = FORCES
    for turn in range(2):  # by all of them, then by those alone that don't bounce
        for n in range(contacts(m)):
            if w[at(m, n) + MET] != 0.0:
                k = at(m, n)
                w[k + MAY] = w[k + DUE] != LETS_GO and (turn == 0 or w[k + STICKS] != 0.0)
                w[k + MODE], m.multipliers[row_at(m, n)] = CLOSED if w[k + MAY] != 0.0 else OPEN, 0.0
        undecided = decision.search(m, t, A)
        slowed, others = _slowed(m, t, undecided == 0) if turn == 0 and undecided != 1 else (0, False)
        if slowed or not others:
            break
    m.pivots[DECIDES] = NOTHING
    return 0 if slowed else undecided, slowed


@njit(**OPTIONS)
def _slowed(m, t, known):
    """Number of the contacts that separate too slowly to bounce, and whether others that bounce would be pressed.

    Forces that would also hold those that bounce are not always ``known``.
    """
    no_inline()
    w, slowed, others = m.w, 0, False
    for n in range(contacts(m)):
        if w[at(m, n) + MET] == 0.0:
            continue
        k = at(m, n)
        v, pressing = abs(w[k + NEW]), w[k + FORCE] / w[k + RESISTING_MASS] if known else 0.0
        noise = NOISE * abs(w[k + OLD]) + w[k + ROUNDED]
        if not known or w[k + GAP_ACCEL] <= 10.0 * w[k + UNSURE]:  # or others keep it closed
            pressing = larger(pressing, -w[k + ALONE])
        low = math.sqrt(larger(2.0 * LEAST_HEIGHT * zero_gap(m, n, t, v) * pressing, 0.0))
        low = larger(low, 32.0 * EPS * abs(t) * pressing)
        w[k + QUIET] = larger(noise, low)  # negligible rate, also after the impact of another contact
        if w[k + STICKS] == 0.0 and v <= larger(noise, low):
            w[k + STICKS] = 1.0
            slowed += v > noise
        others = others or (w[k + STICKS] == 0.0 and (w[k + FORCE] > 0.0 or not known))
    return slowed, others


@njit(**OPTIONS)
def _settle(m, state):
    """Update the modes of the contacts, and record the impacts."""
    no_inline()
    plan, w, t, works = m.plan, m.w, state[0], works_at(m)
    for k in range(plan[WORKS]):
        state[works + k] += w[plan[POWER] + k]
    w[plan[TOUCH] + RESTED] = 0.0
    for n in range(contacts(m)):
        if w[at(m, n) + MET] == 0.0:
            continue
        k, work, row = at(m, n), works + plan[WORKS] - contacts(m) + n, row_at(m, n)
        old, new, p, f, rested = w[k + OLD], w[k + NEW], w[k + STRUCK], w[k + FORCE], w[k + RESTED_BEFORE] != 0.0
        nothing = 100.0 * w[k + UNSURE] * w[k + RESISTING_MASS]
        held = abs(w[k + GAP_ACCEL]) <= 10.0 * w[k + UNSURE] and (rested or old < 0.0 or p > 0.0)
        resting = w[k + STICKS] != 0.0 and w[k + DUE] != LETS_GO and abs(new) <= w[k + QUIET]
        resting = resting and (f > nothing or held)
        if not rested and (resting or p > 0.0):
            begin_impact(m, n, t, larger(-old, 0.0), state[work])
        w[k + IMPULSE] += p
        state[work] -= 0.5 * p * (old + new)
        w[k + ALLOWED] = 1e-10 * f + nothing
        w[k + GAP_RATE], w[k + DUE], w[k + MODE], m.multipliers[row] = new, 0.0, OPEN, 0.0
        if resting:
            w[k + MODE] = CLOSED
        elif rested or p > 0.0:
            open_contact(m, n, t, state[work])
        if resting != (w[k + SHUT] != 0.0):
            w[plan[TOUCH] + RESTED] = 1.0
    _settle_frictions(m, state)


@if_frictions(None)
@njit(**OPTIONS)
def _settle_frictions(m, state):
    """Record the works of the frictions' impulses; none acts at an open contact, and those that needn't slip stick."""
    w, work = m.w, works_at(m) + m.plan[WORKS] - contacts(m)
    for n in range(-frictions(m), 0):
        k = at(m, n)
        if is_second(m, n):
            continue
        if w[k + MAY] != 0.0:
            state[work + n] -= 0.5 * w[k + STRUCK] * (w[k + OLD] + w[k + NEW])
            state[work + n] -= 0.5 * across(m, n, STRUCK) * (across(m, n, OLD) + across(m, n, NEW))
        if open_with_contact(m, n):
            w[k + DUE] = 0.0
        elif w[k + DUE] < 0.0 and w[k + MODE] == SLIPPING and magnitude(m, n, SLIP_RATE) <= zero_acceleration(m, n):
            stick(m, n)
