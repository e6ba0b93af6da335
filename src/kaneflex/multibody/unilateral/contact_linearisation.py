"""Contact and friction rows of a step's Newton matrix, and their share of the error estimate.

A contact has the stiffness and damping of its law in the middle of the step; its gap may be wrong by a share of its
depth.
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.unilateral import dry_friction, lugre_step
from kaneflex.multibody.dynamics.forces import lean, meet
from kaneflex.multibody.unilateral.contact_numbers import EPS, at, extent, gradient_at, product, rigid
from kaneflex.multibody.dynamics.courses import leave_out
from kaneflex.multibody.dynamics.kinematics import move
from kaneflex.multibody.dynamics.arrays import PHI
from kaneflex.multibody.dynamics.interactions import gradient
from kaneflex.multibody.compile.stand_ins import of_contacts, of_holds
from kaneflex.multibody.model.layout import (
    ACCEL, ACTS, ALLOWED, BEGUN_AT, CONTACTS, COORDINATES, DRIVES, GAP, GAP_RATE, HOLDS, JAMS,
    KEPT, LAW, NUMBERS_AT, OPTIONS, PIVOTS, RATE, REACTION, ROW_AT, SCHUR, SPEED_SIZE, STIFF, TOUCHING, VISCOUS,
    YIELDING, apart, larger, shifted,
)  # fmt: skip

_NO_JAM = 1e-9
"""Share of a contact's compliance that counts as rounding."""


@njit(**OPTIONS)
def along(m, c):
    """Row of a contact by the twists of its sections; returns the place of its gap's gradient by all but prescribed
    coordinates.

    The contact has been evaluated at the current position; of a hold, by its number below zero, the row is known
    already.
    """
    apart()
    plan, w = m.plan, m.w
    act, n = (plan[CONTACTS] if c >= 0 else plan[DRIVES]) + c, plan[COORDINATES]
    row, out = m.acts[act, ROW_AT], gradient_at(m, c)
    if c >= 0:
        lean(m, act)
    for i in range(n):
        w[out + i] = 0.0
    gradient(m, row, m.counts[PHI] > 0, out)
    leave_out(m, out)
    return out


@of_contacts(None)
@njit(**OPTIONS)
def let_yield(m, h, state):
    """Collect closed contacts, by their slopes in the middle of the step, and holds for the factors; positions are
    those there."""
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
        w[plan[RATE] + k] = state[1 + n + k] + 0.5 * h * state[1 + 2 * n + k]
    move(m, 0)
    for r in range(count):
        c = m.pivots[plan[TOUCHING] + r]
        act = plan[CONTACTS] + c
        k = meet(m, act)
        by_gap, by_rate = touching.normal_slopes(
            m.acts[act, LAW], w, m.acts[act, NUMBERS_AT], w[k + BEGUN_AT], w[k + GAP], w[k + GAP_RATE]
        )
        w[k + STIFF], w[k + VISCOUS] = larger(-by_gap, 1e-200), larger(-by_rate, 0.0)
        along(m, c)
    more = dry_friction.rows_of_step(m, count, h, state)
    m.pivots[YIELDING] = count + more
    for r in range(count, count + more):
        along(m, m.pivots[plan[TOUCHING] + r])


@of_holds(None)
@njit(**OPTIONS)
def notice_jams(m, t, step, A):
    """Record the first time at which friction jams a contact, by the factors of a step that is taken.

    A separating force with its friction then brings the sides closer: rigid sides would have no consistent force, or
    several (Painleve's paradox); these are compliant.
    """
    apart()
    plan, w, x = m.plan, m.w, m.plan[REACTION]
    count = plan[KEPT] + m.pivots[YIELDING]
    for r in range(plan[KEPT], count):
        c = m.pivots[plan[TOUCHING] + r - plan[KEPT]]
        for n in range(-dry_friction.count(m) if c >= 0 else 0, 0):
            since = dry_friction.number_at(m, n) + JAMS
            if w[since] == w[since] or not dry_friction.presses(m, n, r):
                continue
            for q in range(count):
                A[x + q] = 0.0
            A[x + r] = 1.0
            dense_lu.substitute(A, plan[SCHUR], count, m.pivots, plan[PIVOTS], x)
            soft = 1.0 / (step * (w[at(m, c) + VISCOUS] + step * w[at(m, c) + STIFF]))
            if 1.0 / A[x + r] < (1.0 - _NO_JAM) * soft:  # opening by a unit force, and the contact's compliance
                w[since] = t


@of_contacts(0.0)
@njit(**OPTIONS)
def change_of_gaps(m, h, real, pair, one, two, A, B):
    """Largest change of a gap by an iteration of one stage, in errors allowed."""
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
    """Subtract the effect of contacts on a defect, at ACCEL, from the forces: see ``collocation._error``."""
    apart()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    for r in range(m.pivots[YIELDING]):
        c = m.pivots[plan[TOUCHING] + r]
        k, g = at(m, c), gradient_at(m, c)
        slope = w[k + VISCOUS] + step * w[k + STIFF] if c >= 0 else lugre_step.resists(m, c, step)
        size = step * slope * product(w, g, shifted(w, plan[ACCEL]), n)
        for i in range(n):
            A[answer + i] -= size * w[g + i]


@of_contacts(0.0)
@njit(**OPTIONS)
def error_of_gaps(m, h, step, A, answer):
    """Largest error of a gap, and of the deflection of bristles, by the defect at ACCEL and the answer to it, as an
    acceleration in errors allowed."""
    apart()
    plan, w, n, largest = m.plan, m.w, m.plan[COORDINATES], 0.0
    for r in range(m.pivots[YIELDING]):
        c = m.pivots[plan[TOUCHING] + r]
        k, g = at(m, c), gradient_at(m, c)
        error = abs(product(w, g, shifted(w, plan[ACCEL]), n) + product(w, g, shifted(A, answer), n))
        if c < 0:
            largest = larger(largest, (error - 16.0 * EPS * w[k + SPEED_SIZE] / h) * lugre_step.minds(m, c, step))
            continue
        largest = larger(largest, (error - 16.0 * EPS * extent(m, c) / (h * h)) / w[k + ALLOWED])
    return largest
