"""Bristles of LuGre friction in a step of the compiled integration: rows of its factors, and their deflection in the
stages.

See :mod:`kaneflex.multibody.unilateral.lugre` for a single friction.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.dry_friction import (
    BENDS, count, number_at, normal_force_by_reaction, presses, row_at, row_place,
)  # fmt: skip
from kaneflex.multibody.compile.stand_ins import of_holds
from kaneflex.multibody.model.layout import (
    ALONG, BY_PRESS, BY_SPEED, DRIVES, FIRMEST, KEPT, MODE, NODES, NUMBERS_AT, OPTIONS, PRECISION, REACTIONS, SCHUR,
    SLOPE, STAGE_H, STAGE_R, STUCK_AT, TOUCH, TOUCHING, WANTED, WHAT, apart, larger,
)  # fmt: skip


@of_holds(0.0)
@njit(**OPTIONS)
def resists(m, n, h):
    """Derivative of a hold's resisting force with respect to its speed, for a step of h."""
    w, k, j = m.w, number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    return w[k + SLOPE] + (lugre.firmness(w, k, j, h) * w[k + BY_SPEED] if w[k + MODE] == BENDS else 0.0)


@of_holds(False)
@njit(**OPTIONS)
def by_force(m, n, r, size, h, A):
    """Replace a bristle's row of the factors by its force law; True if the row is one.

    dF + h slope (row) - (normal force) = missing force, where a contact's row is by its compliance: in uniform sliding
    the compliance is infinite.
    """
    plan, w = m.plan, m.w
    k = number_at(m, n)
    if n >= 0 or w[k + MODE] != BENDS:
        return False
    firm = lugre.firmness(w, k, m.acts[plan[DRIVES] + n, NUMBERS_AT], h)
    d, row = h * (w[k + SLOPE] + firm * w[k + BY_SPEED]), plan[SCHUR] + size * r
    A[plan[WANTED] + count(m) - 1 - n] = d
    for q in range(size):
        A[row + q] = d * A[row + q]
        if presses(m, n, q):
            A[row + q] += firm * w[k + BY_PRESS] * normal_force_by_reaction(m, n, q)
    A[row + r] += 1.0
    return True


@of_holds(1.0)
@njit(**OPTIONS)
def weight(m, A, r):
    """Weight of a row's opening: 1, except for bristles, whose row is a force."""
    n = m.pivots[m.plan[TOUCHING] + r - m.plan[KEPT]] if r >= m.plan[KEPT] else 0
    bends = n < 0 and m.w[number_at(m, n) + MODE] == BENDS
    return A[m.plan[WANTED] + count(m) - 1 - n] if bends else 1.0 + 0.0 * A[0]


@of_holds(None)
@njit(**OPTIONS)
def bend(m, table, h, state):
    """Deflection of bristles in the stages of a step h; STAGE_H gets their force minus the stages'."""
    apart()
    plan, w = m.plan, m.w
    for n in range(-count(m), 0):
        k = number_at(m, n)
        if w[k + MODE] == BENDS:
            lugre.bend(table, h, w, k, m.acts[plan[DRIVES] + n, NUMBERS_AT], state[row_place(m, n)])
            for i in range(3):
                law, has = w[k + NODES + 7 + 4 * i], w[plan[STAGE_R] + plan[REACTIONS] * i + row_at(m, n)]
                w[plan[STAGE_H] + count(m) * (i + 1) + n] = has - law


@of_holds(None)
@njit(**OPTIONS)
def bent_at_end(m, table, h, state):
    """Set the bristles' deflection at the end of a step h."""
    apart()
    for n in range(-count(m), 0):
        k, j = number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
        if m.w[k + MODE] == BENDS:
            for i in range(3 if m.acts[m.plan[DRIVES] + n, WHAT] == ALONG else 0):
                m.w[k + FIRMEST] = larger(m.w[k + FIRMEST], m.w[k + NODES + 5 + 4 * i])
            m.w[k + STUCK_AT] = lugre.bent_at_end(table, h, m.w, k, j, state[row_place(m, n)])


@of_holds(0.0)
@njit(**OPTIONS)
def stored(m):
    """Energy stored in bristles [J]."""
    total = 0.0
    for n in range(-count(m), 0):
        k, j = number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
        if m.w[k + MODE] == BENDS:
            total += 0.5 * m.w[j + lugre.STIFFNESS_AT] * m.w[k + STUCK_AT] * m.w[k + STUCK_AT]
    return total


@of_holds(0.0)
@njit(**OPTIONS)
def minds(m, n, step):
    """Error of a hold's bristles in the stages, in tolerances, per 1 m or rad of its slip.

    The tolerance is a share of the deflection before slip; sliding bristles are insensitive.
    """
    k, j = number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    if m.w[k + MODE] != BENDS:
        return 0.0
    return lugre.minds(m.w, k, j, step) / m.w[m.plan[TOUCH] + PRECISION]
