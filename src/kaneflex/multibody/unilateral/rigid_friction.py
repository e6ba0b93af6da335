"""Friction of rigid sides in the compiled integration: impulses, and modes after them.

Coulomb's law of impulses: along a contact's face at most mu times the normal impulse, against the remaining slip
(Moreau 1988; Glocker & Pfeiffer 1995, Nonlinear Dyn. 7, 471). A joint's friction is mu times the impulse of the joint's
own reactions; as that is not a linear law, it is found by iteration. Friction by a preload, a compliant contact's force
or bristles has no impulse.

In the problem of forces, holds with a speed slip, those without are rows of the complementarity problem, which
determines their first mode; ``stick_slip.decide`` makes the final choice.
"""

from __future__ import annotations

from numba import njit

from kaneflex.mechanism.friction import LAWS
from kaneflex.multibody.unilateral.lugre import LUGRE
from kaneflex.multibody.unilateral.complementarity import (
    ACCELERATIONS, BESIDE, FORCES, IMPULSES, MAY, NEW, OLD, PRESSES, RATIO, WANTED, listed, vector,
)  # fmt: skip
from kaneflex.multibody.unilateral.contact_numbers import at, rigid
from kaneflex.multibody.unilateral.dry_friction import (
    ARM, BENDS, IDLE, LAW_AT, MU_AT, OF_AT, STATIC_AT, PRELOAD_AT, STUCK, count, exert, number_at, normal_force, row_of,
)  # fmt: skip
from kaneflex.multibody.unilateral.impulse_response import reactions_of
from kaneflex.multibody.time.state_record import works_at
from kaneflex.multibody.compile.stand_ins import of_holds
from kaneflex.multibody.unilateral.stick_slip import LET_GO, no_rate, no_speed, opens
from kaneflex.multibody.model.layout import (
    ACTS, ALONG, BEFORE, BEGUN_AT, BORE, COMPLEMENT, CONTACTS, DRIVES, DUE, HOLDING, KEPT, LAST_R, LIMIT, MODE, NOW,
    NUMBERS_AT, OPTIONS, PLACE, REACTION, REACTIONS, ROW_OF, SLIP, SLIP_RATE, STUCK_AT, TURN, WHAT, WORKS, apart,
    larger, smaller,
)  # fmt: skip

VISCOUS = LAWS.index("viscous")
_AGREE = 1e-12
"""Tolerance of a joint's friction impulse between two iterations, relative to it."""
_SETTLED = 1e-10
"""Tolerance between two iterations, as a share of the joint's largest reaction."""
_HELD = 1e-9
"""Share of the holding force that is kept in reserve for a stuck hold."""
_ROUNDING = 1e-12
"""Rounding error of cancelling rates, relative to them."""


@of_holds(0)
@njit(**OPTIONS)
def gather(m, touching):
    """List the holds that may stick or slip, after the touching contacts; returns their number. BEFORE is their mode,
    DUE marks those that are to slip, BORE their force."""
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
    """Number of the touching contact that presses a hold; -1: not one of them, -2: its sides are apart."""
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
    """Initialise the problem of impulses: no hold slips yet, and joints have no impulses."""
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
def update_joint_limits(m, A, touching, slips, part):
    """Update joints' friction by a part of the change of their reactions' impulses, at REACTION and NOW; returns the
    change in tolerances."""
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
            limit, size = mu * normal_force(m, n), mu * largest * (arm if m.acts[act, WHAT] == TURN else 1.0)
            missed = larger(missed, abs(limit - w[beside]) / (_AGREE * (limit + 0.01 * size) + 1e-300))
            w[beside] += part * (limit - w[beside])
    return missed


@of_holds(None)
@njit(**OPTIONS)
def exchange_reactions(m):
    """Exchange the reactions at NOW with those at LAST_R, about which friction is linear in the problem of forces."""
    plan, w = m.plan, m.w
    for r in range(plan[REACTIONS]):
        i, j = plan[NOW] + r, plan[LAST_R] + r
        w[i], w[j] = w[j], w[i]


@of_holds(0.0)
@njit(**OPTIONS)
def update_joint_reactions(m, A, touching, slips):
    """Add the effect of resting contacts to the reactions at NOW, if joints have friction; returns their change from
    the linearisation point in tolerances."""
    apart()
    plan, w, rubs, missed, size = m.plan, m.w, False, 0.0, 0.0
    for n in range(-count(m), 0):
        law = w[m.acts[plan[DRIVES] + n, NUMBERS_AT] + LAW_AT]
        rubs = rubs or (m.acts[plan[DRIVES] + n, WHAT] != ALONG and 0.0 <= law < VISCOUS)
    if not rubs:
        return 0.0
    reactions_of(m, A, touching + slips, vector(m, FORCES))
    for q in range(m.pivots[KEPT]):
        row = plan[plan[ROW_OF] + q]
        w[plan[NOW] + row] += A[plan[REACTION] + q]
        size = larger(size, abs(w[plan[NOW] + row]))
        missed = larger(missed, abs(w[plan[NOW] + row] - w[plan[LAST_R] + row]))
    return missed / (_SETTLED * size + 1e-300)


@of_holds(None)
@njit(**OPTIONS)
def modes_after_impact(m, t, touching, slips):
    """Modes after an impact, or none: holds with a speed slip that way, the others wait for the problem of forces.

    Bristles of touching sides exert their force as without rigid contacts.
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
def problem_of_forces(m, touching, slips):
    """Set up the problem of forces, with accelerations without them."""
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
def settle(m, state, touching, slips):
    """Record the modes of the holds, and their impulses."""
    apart()
    plan, w, f, p = m.plan, m.w, vector(m, FORCES), vector(m, IMPULSES)
    work = works_at(m) + plan[WORKS] - plan[ACTS] + plan[CONTACTS]
    for n in range(-count(m), 0):
        opens(m, n)
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        k, i = number_at(m, n), int(w[vector(m, PRESSES) + r])
        state[work + n] -= 0.5 * w[p + r] * (w[vector(m, OLD) + r] + w[vector(m, NEW) + r])
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
