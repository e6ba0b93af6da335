"""Holds of bristles in a step of the compiled integration: what they are to its factors, and how its stages bend them.

See :mod:`kaneflex.multibody.bristles` for one of them.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody import bristles
from kaneflex.multibody.holds import BENDS, count, number_at, pressed_by, presses, row_at, row_place
from kaneflex.multibody.stand_ins import of_holds
from kaneflex.multibody.tables import (
    ALONG, BY_PRESS, BY_SPEED, DRIVES, FIRMEST, KEPT, MODE, NODES, NUMBERS_AT, OPTIONS, PRECISION, REACTIONS, SCHUR,
    SLOPE, STAGE_H, STAGE_R, STUCK_AT, TOUCH, TOUCHING, WANTED, WHAT, apart, larger,
)  # fmt: skip


@of_holds(0.0)
@njit(**OPTIONS)
def resists(m, n, h):
    """Force against a hold's speed by that speed, as a step of h feels it."""
    w, k, j = m.w, number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    return w[k + SLOPE] + (bristles.firmness(w, k, j, h) * w[k + BY_SPEED] if w[k + MODE] == BENDS else 0.0)


@of_holds(False)
@njit(**OPTIONS)
def by_force(m, n, r, size, h, A):
    """Whether a row of the factors says what bristles exert; it is made so then.

    dF + h slope (row) - (by what presses) = the force that is missed, where a contact's row would be by what it yields:
    while all slides at one speed they yield without end.
    """
    plan, w = m.plan, m.w
    k = number_at(m, n)
    if n >= 0 or w[k + MODE] != BENDS:
        return False
    firm = bristles.firmness(w, k, m.acts[plan[DRIVES] + n, NUMBERS_AT], h)
    d, row = h * (w[k + SLOPE] + firm * w[k + BY_SPEED]), plan[SCHUR] + size * r
    A[plan[WANTED] + count(m) - 1 - n] = d
    for q in range(size):
        A[row + q] = d * A[row + q]
        if presses(m, n, q):
            A[row + q] += firm * w[k + BY_PRESS] * pressed_by(m, n, q)
    A[row + r] += 1.0
    return True


@of_holds(1.0)
@njit(**OPTIONS)
def weight(m, A, r):
    """By what a row of the factors counts its opening: 1, but of bristles, whose row is by force."""
    n = m.pivots[m.plan[TOUCHING] + r - m.plan[KEPT]] if r >= m.plan[KEPT] else 0
    bends = n < 0 and m.w[number_at(m, n) + MODE] == BENDS
    return A[m.plan[WANTED] + count(m) - 1 - n] if bends else 1.0 + 0.0 * A[0]


@of_holds(None)
@njit(**OPTIONS)
def bend(m, table, h, here):
    """Bend bristles in a step of h, whose stages are known; at STAGE_H is what they exert less than the stages have."""
    apart()
    plan, w = m.plan, m.w
    for n in range(-count(m), 0):
        k = number_at(m, n)
        if w[k + MODE] == BENDS:
            bristles.bend(table, h, w, k, m.acts[plan[DRIVES] + n, NUMBERS_AT], here[row_place(m, n)])
            for i in range(3):
                law, has = w[k + NODES + 7 + 4 * i], w[plan[STAGE_R] + plan[REACTIONS] * i + row_at(m, n)]
                w[plan[STAGE_H] + count(m) * (i + 1) + n] = has - law


@of_holds(None)
@njit(**OPTIONS)
def bent_at_end(m, table, h, here):
    """Have bristles where a step of h leaves them."""
    apart()
    for n in range(-count(m), 0):
        k, j = number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
        if m.w[k + MODE] == BENDS:
            for i in range(3 if m.acts[m.plan[DRIVES] + n, WHAT] == ALONG else 0):
                m.w[k + FIRMEST] = larger(m.w[k + FIRMEST], m.w[k + NODES + 5 + 4 * i])
            m.w[k + STUCK_AT] = bristles.bent_at_end(table, h, m.w, k, j, here[row_place(m, n)])


@of_holds(0.0)
@njit(**OPTIONS)
def stored(m):
    """Energy that bristles have [J]."""
    total = 0.0
    for n in range(-count(m), 0):
        k, j = number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
        if m.w[k + MODE] == BENDS:
            total += 0.5 * m.w[j + bristles.STIFFNESS_AT] * m.w[k + STUCK_AT] * m.w[k + STUCK_AT]
    return total


@of_holds(0.0)
@njit(**OPTIONS)
def minds(m, n, step):
    """By how many errors allowed a hold's bristles are bent wrongly in a step's stages for 1 m, or rad, of its own way.

    What is allowed is a share of how far they bend before they slip; while they slip they mind no way.
    """
    k, j = number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    if m.w[k + MODE] != BENDS:
        return 0.0
    return bristles.minds(m.w, k, j, step) / m.w[m.plan[TOUCH] + PRECISION]
