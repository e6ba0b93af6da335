"""Friction of rigid sides: impulses, and modes after them.

Coulomb's law of impulses: along a contact's face at most mu times the normal impulse, against the remaining slip
(Moreau 1988; Glocker & Pfeiffer 1995, Nonlinear Dyn. 7, 471). A joint's friction is mu times the impulse of the joint's
own reactions; as that is not a linear law, it is found by iteration. Friction by a preload, a compliant contact's force
or bristles has no impulse.

In the problem of forces, frictions with a speed slip, those without are rows of the complementarity problem, which
determines their first mode; ``stick_slip.decide`` makes the final choice.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.stand_ins import of_holds
from kaneflex.multibody.compile.types import OPTIONS, apart, larger, smaller
from kaneflex.multibody.model.codes import (
    ACCELERATIONS, BESIDE, FORCES, IMPULSES, MAY, NEW, OLD, PRESSES, RATIO, WANTED,
)  # fmt: skip
from kaneflex.multibody.model.layout import (
    ALONG, BEFORE, BENDING, BORE, BY_PRESS, COORDINATES, DUE, FORCE, KEPT, LAST_R, LIMIT, MODE, OPEN, REACTION,
    REACTIONS, ROW_OF, SLIP, SLIPPING, SLIP_RATE, STICKING, TURN, WHAT, WORKS,
)  # fmt: skip
from kaneflex.multibody.time.state_record import works_at
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.complementarity import listed, moved, vector
from kaneflex.multibody.unilateral.factors import force_by_reaction
from kaneflex.multibody.unilateral.frictions import exert, normal_force, row_of, slip, stick
from kaneflex.multibody.unilateral.rows import (
    ARM, LAW_AT, LUGRE, MU_AT, PRELOAD_AT, STATIC_AT, VISCOUS_LAW, act_of, at, contacts, frictions, law_at, on_contact,
    rigid,
)  # fmt: skip
from kaneflex.multibody.unilateral.step_rows import derivatives
from kaneflex.multibody.unilateral.stick_slip import LET_GO, STILL, no_rate, no_speed, opens

_AGREE = 1e-12
"""Tolerance of a joint's friction impulse between two iterations, relative to it."""
_SETTLED = 1e-10
"""Tolerance between two iterations, as a share of the joint's largest reaction."""
_HELD = 1e-9
"""Share of the holding force that is kept in reserve for sticking friction."""
_ROUNDING = 1e-12
"""Rounding error of cancelling rates, relative to them."""


@of_holds(0)
@njit(**OPTIONS)
def gather(m, touching):
    """List the frictions that may stick or slip, after the touching contacts; returns their number. BEFORE is their
    mode, DUE marks those that are to slip, BORE their force."""
    apart()
    w, found = m.w, touching
    for n in range(-frictions(m), 0):
        law = w[law_at(m, n) + LAW_AT]
        if law == LUGRE:
            w[at(m, n) + MODE] = OPEN
        if law >= VISCOUS_LAW:
            continue
        k, presses = row_of(m, n), _pressing(m, n, touching)
        stuck = w[k + MODE] == STICKING
        w[vector(m, OLD) + found] = 0.0 if stuck else w[k + SLIP]
        w[k + BEFORE], w[k + MODE] = w[k + MODE], OPEN
        if stuck and w[k + DUE] > 0.0:
            w[k + DUE], w[k + BORE] = LET_GO, abs(w[k + FORCE])
        if presses >= -1:
            m.pivots[listed(m) + found] = n
            w[vector(m, PRESSES) + found] = presses
            found += 1
    return found - touching


@njit(**OPTIONS)
def _pressing(m, n, touching):
    """Number of the touching contact that presses a friction; -1: not one of them, -2: its sides are apart."""
    c = on_contact(m, n)
    if c < 0:
        return -1
    if not rigid(m, c):
        return -1 if m.w[at(m, c) + MODE] != OPEN else -2
    for i in range(touching):
        if m.pivots[listed(m) + i] == c:
            return i
    return -2


@of_holds(None)
@njit(**OPTIONS)
def add_friction(m, n, force, A, out):
    """Add the generalised forces of friction that a contact's force brings while it slips, or by its bristles."""
    w = m.w
    for q in range(-frictions(m) if n >= 0 else 0, 0):
        k, share = at(m, q), 0.0
        if on_contact(m, q) == n and w[k + MODE] == SLIPPING:
            share = force_by_reaction(m, q, m.pivots[KEPT])
        elif on_contact(m, q) == n and w[k + MODE] == BENDING:
            share = -lugre.firmness(w, k, law_at(m, q), 0.0) * w[k + BY_PRESS]
        if share != 0.0:
            g = derivatives(m, q)
            for i in range(m.plan[COORDINATES]):
                A[out + i] += force * share * w[g + i]


@of_holds(None)
@njit(**OPTIONS)
def begin(m, touching, slips):
    """Initialise the problem of impulses: no friction slips yet, and joints have no impulses."""
    apart()
    w = m.w
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        mu, touches = w[law_at(m, n) + MU_AT], w[vector(m, PRESSES) + r] >= 0.0
        w[at(m, n) + MODE] = OPEN
        w[vector(m, WANTED) + r], w[vector(m, BESIDE) + r] = w[vector(m, OLD) + r], 0.0
        w[vector(m, RATIO) + r] = mu if touches else 0.0
        w[vector(m, MAY) + r] = mu > 0.0 and (touches or on_contact(m, n) < 0)


@of_holds(0.0)
@njit(**OPTIONS)
def update_joint_limits(m, A, touching, slips, part):
    """Update joints' friction by a part of the change of their reactions' impulses, at REACTION and NOW; returns the
    change in tolerances."""
    apart()
    plan, w, largest, missed = m.plan, m.w, 0.0, 0.0
    for q in range(m.pivots[KEPT]):
        m.multipliers[plan[plan[ROW_OF] + q]] = A[plan[REACTION] + q]
        largest = larger(largest, abs(A[plan[REACTION] + q]))
    for r in range(touching, touching + slips):
        n, beside = m.pivots[listed(m) + r], vector(m, BESIDE) + r
        if w[vector(m, MAY) + r] != 0.0 and on_contact(m, n) < 0:
            mu, arm = w[law_at(m, n) + MU_AT], w[law_at(m, n) + ARM]
            size = mu * largest * (arm if m.acts[act_of(m, n), WHAT] == TURN else 1.0)
            change = mu * normal_force(m, n) - w[beside]
            missed = larger(missed, abs(change) / (_AGREE * (w[beside] + change + 0.01 * size) + 1e-300))
            w[beside] += part * change
    return missed


@of_holds(None)
@njit(**OPTIONS)
def exchange_reactions(m):
    """Exchange the reactions at NOW with those at LAST_R, about which friction is linear in the problem of forces."""
    plan, w = m.plan, m.w
    for r in range(plan[REACTIONS]):
        m.multipliers[r], w[plan[LAST_R] + r] = w[plan[LAST_R] + r], m.multipliers[r]


@of_holds(False)
@njit(**OPTIONS)
def joints_rub(m):
    """True if joints have friction that sticks and slips."""
    rubs = False
    for n in range(-frictions(m), 0):
        law = m.w[law_at(m, n) + LAW_AT]
        rubs = rubs or (m.acts[act_of(m, n), WHAT] != ALONG and law < VISCOUS_LAW)
    return rubs


@of_holds(0.0)
@njit(**OPTIONS)
def update_joint_reactions(m, A):
    """Add the effect of resting contacts, at REACTION, to the reactions at NOW, if joints have friction; returns their
    change from the linearisation point in tolerances."""
    apart()
    plan, w, missed, size = m.plan, m.w, 0.0, 0.0
    for q in range(m.pivots[KEPT] if joints_rub(m) else 0):
        row = plan[plan[ROW_OF] + q]
        m.multipliers[row] += A[plan[REACTION] + q]
        size = larger(size, abs(m.multipliers[row]))
        missed = larger(missed, abs(m.multipliers[row] - w[plan[LAST_R] + row]))
    return missed / (_SETTLED * size + 1e-300)


@of_holds(None)
@njit(**OPTIONS)
def modes_after_impact(m, t, touching, slips):
    """Modes after an impact, or none: frictions with a speed slip that way, the others wait for the problem of forces.

    Bristles of touching sides exert their force as without rigid contacts.
    """
    apart()
    w, p, rows, jumped = m.w, vector(m, IMPULSES), touching + slips, False
    for n in range(-frictions(m), 0):
        if w[law_at(m, n) + LAW_AT] == LUGRE and _pressing(m, n, touching) >= -1:
            w[at(m, n) + MODE] = BENDING
    for i in range(touching):
        jumped = jumped or w[p + i] > 0.0
    for r in range(touching, rows):
        n = m.pivots[listed(m) + r]
        k, speed = row_of(m, n), w[vector(m, NEW) + r]
        if jumped:
            w[k + DUE] = 0.0
        none = no_speed(m, n, t) + _ROUNDING * moved(m, r, p, rows)[1]
        w[vector(m, MAY) + r] = w[k + DUE] != 0.0 or abs(speed) <= none
        if w[vector(m, MAY) + r] == 0.0:
            slip(m, n, speed, 0.0)


@of_holds(None)
@njit(**OPTIONS)
def problem_of_forces(m, touching, slips):
    """Set up the problem of forces, with accelerations without them."""
    apart()
    w = m.w
    exert(m)
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        k, j, touches = at(m, n), law_at(m, n), w[vector(m, PRESSES) + r] >= 0.0
        w[vector(m, WANTED) + r] = w[k + SLIP_RATE]
        w[vector(m, RATIO) + r] = w[j + STATIC_AT] if touches else 0.0
        w[vector(m, BESIDE) + r] = w[j + PRELOAD_AT] if touches else w[k + LIMIT]


@of_holds(None)
@njit(**OPTIONS)
def settle(m, state, touching, slips):
    """Record the modes of the frictions, and their impulses."""
    apart()
    w, f, p = m.w, vector(m, FORCES), vector(m, IMPULSES)
    work = works_at(m) + m.plan[WORKS] - contacts(m)
    for n in range(-frictions(m), 0):
        opens(m, n)
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        k, i = at(m, n), int(w[vector(m, PRESSES) + r])
        state[work + n] -= 0.5 * w[p + r] * (w[vector(m, OLD) + r] + w[vector(m, NEW) + r])
        if i >= 0 and w[at(m, m.pivots[listed(m) + i]) + MODE] == OPEN:
            w[k + MODE], w[k + DUE] = OPEN, 0.0
            continue
        if w[vector(m, MAY) + r] == 0.0:
            continue
        limit = w[vector(m, BESIDE) + r]
        if i >= 0:
            limit += w[vector(m, RATIO) + r] * w[f + i]
        if abs(w[f + r]) > (1.0 - _HELD) * limit and abs(w[vector(m, ACCELERATIONS) + r]) > no_rate(m, n):
            slip(m, n, -w[f + r], 0.0)
        elif w[k + BEFORE] == STICKING:
            w[k + MODE] = STICKING
        else:
            stick(m, n)
        w[k + DUE] = smaller(w[k + DUE], STILL)
