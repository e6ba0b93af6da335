"""Friction of rigid sides: impulses.

Coulomb's law of impulses: along a contact's face at most mu times the normal impulse, against the remaining slip
(Moreau 1988; Glocker & Pfeiffer 1995, Nonlinear Dyn. 7, 471). A joint's friction is mu times the impulse of the joint's
own reactions; as that is not a linear law, it is found by iteration. Friction by a preload, a compliant contact's force
or bristles has no impulse. Modes after the impulses are found as at any instant.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.stand_ins import of_holds
from kaneflex.multibody.compile.types import OPTIONS, apart, larger
from kaneflex.multibody.model.codes import BESIDE, IMPULSES, MAY, NEW, OLD, PRESSES, RATIO, RESTED_BEFORE, WANTED
from kaneflex.multibody.model.layout import (
    BORE, DUE, FORCE, KEPT, MODE, OPEN, REACTION, ROUNDED, ROW_OF, SLIP, STICKING, TURN, WHAT, WORKS,
)  # fmt: skip
from kaneflex.multibody.time.state_record import works_at
from kaneflex.multibody.unilateral.complementarity import listed, moved, vector
from kaneflex.multibody.unilateral.frictions import normal_force, row_of, stick
from kaneflex.multibody.unilateral.rows import (
    ARM, LAW_AT, MU_AT, VISCOUS_LAW, act_of, at, contacts, frictions, law_at, on_contact, rigid,
)  # fmt: skip
from kaneflex.multibody.unilateral.stick_slip import LET_GO, first_mode, no_speed

_AGREE = 1e-12
"""Tolerance of a joint's friction impulse between two iterations, relative to it."""
_ROUNDING = 1e-12
"""Rounding error of cancelling rates, relative to them."""


@of_holds(0)
@njit(**OPTIONS)
def gather(m, touching):
    """List the frictions that may stick or slip, after the touching contacts; returns their number. RESTED_BEFORE is 1
    if they stick, DUE marks those that are to slip, BORE their force."""
    apart()
    w, found = m.w, touching
    for n in range(-frictions(m), 0):
        law = w[law_at(m, n) + LAW_AT]
        if law >= VISCOUS_LAW:
            continue
        k, presses = row_of(m, n), _pressing(m, n, touching)
        stuck = w[k + MODE] == STICKING
        w[vector(m, OLD) + found], w[vector(m, RESTED_BEFORE) + found] = 0.0 if stuck else w[k + SLIP], stuck
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
def begin(m, touching, slips):
    """Initialise the problem of impulses: no friction sticks or slips yet, and joints have no impulses."""
    apart()
    w = m.w
    for n in range(-frictions(m), 0):
        if w[law_at(m, n) + LAW_AT] != VISCOUS_LAW:
            w[at(m, n) + MODE] = OPEN
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        mu, touches = w[law_at(m, n) + MU_AT], w[vector(m, PRESSES) + r] >= 0.0
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
def after_impact(m, t, touching, slips):
    """Modes after an impact: sticking friction without speed goes on, :func:`stick_slip.first_mode` finds the others'.
    """
    apart()
    w, p, rows, jumped = m.w, vector(m, IMPULSES), touching + slips, False
    for i in range(touching):
        jumped = jumped or w[p + i] > 0.0
    for r in range(touching, rows):
        n = m.pivots[listed(m) + r]
        k = row_of(m, n)
        if jumped:
            w[k + DUE] = 0.0
        w[k + ROUNDED] = _ROUNDING * moved(m, r, p, rows)[1]
        stuck = w[vector(m, RESTED_BEFORE) + r] != 0.0 and abs(w[vector(m, NEW) + r]) <= no_speed(m, n, t)
        w[k + MODE] = OPEN
        if stuck:  # here, as an earlier choice may have let it slip
            stick(m, n)


@of_holds(None)
@njit(**OPTIONS)
def first_modes(m, t):
    """First modes of all frictions with the contacts as they are."""
    for n in range(-frictions(m), 0):
        first_mode(m, n, t)


@of_holds(None)
@njit(**OPTIONS)
def record_works(m, state, touching, slips):
    """Record the work of the frictions' impulses."""
    apart()
    w, p, work = m.w, vector(m, IMPULSES), works_at(m) + m.plan[WORKS] - contacts(m)
    for r in range(touching, touching + slips):
        n = m.pivots[listed(m) + r]
        state[work + n] -= 0.5 * w[p + r] * (w[vector(m, OLD) + r] + w[vector(m, NEW) + r])
