"""Friction where rigid sides meet, in the compiled integration: impulses of holds, and which slip or stick then.

Coulomb's law of impulses: along a contact's face at most mu times the impulse that presses it, against the slip that is
left (Moreau 1988; Glocker & Pfeiffer 1995, Nonlinear Dyn. 7, 471). A joint's friction has mu times the impulse of the
joint's own reactions; as that is no linear law of them, it is found by iteration. What has a size by itself, as a
preload, a compliant contact's force or that of bristles, has no impulse: what it holds gives way.

Then forces: what has a speed slips, what has none is a row of the problem that says which contacts rest, and begins as
that finds it; ``sticking.decide`` has the last word.
"""

from __future__ import annotations

from numba import njit

from kaneflex.mechanism.friction import LAWS
from kaneflex.multibody.bristles import LUGRE
from kaneflex.multibody.complementarity import (
    ACCELERATIONS, BESIDE, FORCES, IMPULSES, MAY, NEW, OLD, PRESSES, RATIO, WANTED, listed, vector,
)  # fmt: skip
from kaneflex.multibody.contact_numbers import at, rigid
from kaneflex.multibody.holds import (
    ARM, BENDS, IDLE, LAW_AT, MU_AT, OF_AT, STATIC_AT, PRELOAD_AT, STUCK, count, exert, number_at, pressed, row_of,
)  # fmt: skip
from kaneflex.multibody.impulses import answer
from kaneflex.multibody.rows import works_at
from kaneflex.multibody.stand_ins import of_holds
from kaneflex.multibody.sticking import LET_GO, lets_go, no_rate, no_speed
from kaneflex.multibody.tables import (
    ACTS, ALONG, BEFORE, BEGUN_AT, BORE, COMPLEMENT, CONTACTS, DRIVES, DUE, HOLDING, KEPT, LAST_R, LIMIT, MODE, NOW,
    NUMBERS_AT, OPTIONS, PLACE, REACTION, REACTIONS, ROW_OF, SLIP, SLIP_RATE, STUCK_AT, TURN, WHAT, WORKS, apart,
    larger, smaller,
)  # fmt: skip

VISCOUS = LAWS.index("viscous")
_AGREE = 1e-12
"""Of a joint's impulse of friction, what two turns may differ by."""
_SETTLED = 1e-10
"""Of the largest reaction of a joint, what two turns may differ by."""
_HELD = 1e-9
"""Share of what holds that is kept in reserve by what counts as stuck."""
_ROUNDING = 1e-12
"""Of rates that add up to nothing."""


@of_holds(0)
@njit(**OPTIONS)
def gather(m, touching):
    """List, after so many contacts that touch, what may stick or slip beside them; how many. BEFORE is how they stood,
    and DUE says where one is to let go, BORE by what force."""
    apart()
    plan, w, found = m.plan, m.w, touching
    for n in range(-count(m), 0):
        law = w[m.acts[plan[DRIVES] + n, NUMBERS_AT] + LAW_AT]
        if law == LUGRE:
            w[number_at(m, n) + MODE] = IDLE
        if law < 0.0 or law >= VISCOUS:
            continue
        k, presses = row_of(m, n), _pressing(m, n, touching)
        stuck = w[k + MODE] == STUCK
        w[vector(m, OLD) + found] = 0.0 if stuck else w[k + SLIP]
        w[k + BEFORE], w[k + MODE] = w[k + MODE], IDLE
        if stuck and w[k + DUE] > 0.0:
            w[k + DUE], w[k + BORE] = LET_GO, abs(w[k + HOLDING])
        if presses >= -1:
            m.pivots[listed(m) + found] = n
            w[vector(m, PRESSES) + found] = presses
            found += 1
    return found - touching


@njit(**OPTIONS)
def _pressing(m, n, touching):
    """Which of the contacts that touch presses a hold on, -1 what is none of them, -2 nothing: its sides are apart."""
    act = m.plan[DRIVES] + n
    if m.acts[act, WHAT] != ALONG:
        return -1
    c = int(m.w[m.acts[act, NUMBERS_AT] + OF_AT]) - m.plan[CONTACTS]
    if not rigid(m, c):
        return -1 if m.w[at(m, c) + BEGUN_AT] != 0.0 else -2
    for i in range(touching):
        if m.pivots[listed(m) + i] == c:
            return i
    return -2


@of_holds(None)
@njit(**OPTIONS)
def begin(m, touching, slips):
    """Put the problem of impulses: nothing slips by a law yet, and joints have no impulses."""
    apart()
    w = m.w
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        act = m.plan[DRIVES] + n
        mu, touches = w[m.acts[act, NUMBERS_AT] + MU_AT], w[vector(m, PRESSES) + r] >= 0.0
        w[number_at(m, n) + MODE] = IDLE
        w[vector(m, WANTED) + r], w[vector(m, BESIDE) + r] = w[vector(m, OLD) + r], 0.0
        w[vector(m, RATIO) + r] = mu if touches else 0.0
        w[vector(m, MAY) + r] = mu > 0.0 and (touches or m.acts[act, WHAT] != ALONG)


@of_holds(0.0)
@njit(**OPTIONS)
def joints_ask(m, A, touching, slips, part):
    """Have joints' friction know a part of how the impulses of their reactions, at REACTION and NOW, have changed; how
    many times what is allowed that is."""
    apart()
    plan, w, largest, missed = m.plan, m.w, 0.0, 0.0
    for q in range(m.pivots[KEPT]):
        w[plan[NOW] + plan[plan[ROW_OF] + q]] = A[plan[REACTION] + q]
        largest = larger(largest, abs(A[plan[REACTION] + q]))
    for r in range(touching, touching + slips):
        n, beside = m.pivots[listed(m) + r], vector(m, BESIDE) + r
        act = plan[DRIVES] + n
        if w[vector(m, MAY) + r] != 0.0 and m.acts[act, WHAT] != ALONG:
            mu, arm = w[m.acts[act, NUMBERS_AT] + MU_AT], w[m.acts[act, NUMBERS_AT] + ARM]
            limit, size = mu * pressed(m, n), mu * largest * (arm if m.acts[act, WHAT] == TURN else 1.0)
            missed = larger(missed, abs(limit - w[beside]) / (_AGREE * (limit + 0.01 * size) + 1e-300))
            w[beside] += part * (limit - w[beside])
    return missed


@of_holds(None)
@njit(**OPTIONS)
def exchange(m):
    """Exchange the reactions at NOW with those at LAST_R, about which friction is linear in the problem of forces."""
    plan, w = m.plan, m.w
    for r in range(plan[REACTIONS]):
        i, j = plan[NOW] + r, plan[LAST_R] + r
        w[i], w[j] = w[j], w[i]


@of_holds(0.0)
@njit(**OPTIONS)
def joints_know(m, A, touching, slips):
    """Add what contacts that rest do to reactions at NOW, where joints rub; how many times what is allowed these differ
    from those about which the friction was taken."""
    apart()
    plan, w, rubs, missed, size = m.plan, m.w, False, 0.0, 0.0
    for n in range(-count(m), 0):
        law = w[m.acts[plan[DRIVES] + n, NUMBERS_AT] + LAW_AT]
        rubs = rubs or (m.acts[plan[DRIVES] + n, WHAT] != ALONG and 0.0 <= law < VISCOUS)
    if not rubs:
        return 0.0
    answer(m, A, touching + slips, vector(m, FORCES))
    for q in range(m.pivots[KEPT]):
        row = plan[plan[ROW_OF] + q]
        w[plan[NOW] + row] += A[plan[REACTION] + q]
        size = larger(size, abs(w[plan[NOW] + row]))
        missed = larger(missed, abs(w[plan[NOW] + row] - w[plan[LAST_R] + row]))
    return missed / (_SETTLED * size + 1e-300)


@of_holds(None)
@njit(**OPTIONS)
def wait(m, t, touching, slips):
    """After an impact, or none: what has a speed slips that way, what has none waits for the problem of forces.

    Bristles of sides that touch exert what they do where nothing is known of rigid sides' forces.
    """
    apart()
    w, p, rows, jumped = m.w, vector(m, IMPULSES), touching + slips, False
    for n in range(-count(m), 0):
        if w[m.acts[m.plan[DRIVES] + n, NUMBERS_AT] + LAW_AT] == LUGRE and _pressing(m, n, touching) >= -1:
            w[number_at(m, n) + MODE] = BENDS
    for i in range(touching):
        jumped = jumped or w[p + i] > 0.0
    for r in range(touching, rows):
        n = m.pivots[listed(m) + r]
        k, speed = row_of(m, n), w[vector(m, NEW) + r]
        none = no_speed(m, n, t)
        for j in range(rows):
            none += _ROUNDING * abs(w[m.plan[COMPLEMENT] + rows * r + j] * w[p + j])
        if jumped:
            w[k + DUE] = 0.0
        w[vector(m, MAY) + r] = w[k + DUE] != 0.0 or abs(speed) <= none
        if w[vector(m, MAY) + r] == 0.0:
            w[k + MODE] = 1.0 if speed > 0.0 else -1.0


@of_holds(None)
@njit(**OPTIONS)
def put(m, touching, slips):
    """Put the problem of forces, where accelerations are those without them."""
    apart()
    w = m.w
    exert(m)
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        k, j = number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
        touches = w[vector(m, PRESSES) + r] >= 0.0
        w[vector(m, WANTED) + r] = w[k + SLIP_RATE]
        w[vector(m, RATIO) + r] = w[j + STATIC_AT] if touches else 0.0
        w[vector(m, BESIDE) + r] = w[j + PRELOAD_AT] if touches else w[k + LIMIT]


@of_holds(None)
@njit(**OPTIONS)
def settle(m, here, touching, slips):
    """Note what the holds do from here on, and what they have taken up."""
    apart()
    plan, w, f, p = m.plan, m.w, vector(m, FORCES), vector(m, IMPULSES)
    work = works_at(m) + plan[WORKS] - plan[ACTS] + plan[CONTACTS]
    for n in range(-count(m), 0):
        lets_go(m, n)
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        k, i = number_at(m, n), int(w[vector(m, PRESSES) + r])
        here[work + n] -= 0.5 * w[p + r] * (w[vector(m, OLD) + r] + w[vector(m, NEW) + r])
        if i >= 0 and w[at(m, m.pivots[listed(m) + i]) + BEGUN_AT] == 0.0:
            w[k + MODE], w[k + DUE] = IDLE, 0.0
            continue
        if w[vector(m, MAY) + r] == 0.0:
            continue
        limit = w[vector(m, BESIDE) + r]
        if i >= 0:
            limit += w[vector(m, RATIO) + r] * w[f + i]
        if abs(w[f + r]) <= (1.0 - _HELD) * limit or abs(w[vector(m, ACCELERATIONS) + r]) <= no_rate(m, n):
            if w[k + BEFORE] != STUCK:
                w[k + STUCK_AT] = w[k + PLACE]
            w[k + MODE] = STUCK
        else:
            w[k + MODE] = -1.0 if w[f + r] > 0.0 else 1.0
        w[k + DUE] = smaller(w[k + DUE], -1.0)
