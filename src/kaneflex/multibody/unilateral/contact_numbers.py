"""Kind and tolerances of a contact in the compiled integration."""

from __future__ import annotations

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.multibody.model.layout import (
    ACTS, ALLOWED, CONTACT, CONTACTS, CONTACT_SIZE, COORDINATES, EXTENT, FLANK, LARGEST, LAW, NUMBERS_AT, ON, OPTIONS,
    PEAK, PRECISION, SEC, SECTION, SHARED, SWITCH, TOUCH, WHAT,
)  # fmt: skip

ROUNDING = 1e-14
"""Rounding error of a gap, in sizes of the mechanism."""
EPS = 2.3e-16
"""Relative rounding error of numbers."""


@njit(**OPTIONS)
def at(m, c):
    """Place of the numbers of the c-th contact."""
    return m.plan[CONTACT] + CONTACT_SIZE * c


@njit(**OPTIONS)
def rigid(m, c):
    """True if the c-th contact follows Newton's law."""
    return m.acts[m.plan[CONTACTS] + c, LAW] == NEWTON


@njit(**OPTIONS)
def tolerance(m, c, t, rate):
    """Gap that counts as zero [m or rad]."""
    return ROUNDING * extent(m, c) + 4.0 * EPS * abs(t * rate)


@njit(**OPTIONS)
def switches(m, c):
    """True for a switching argument of laws instead of a contact."""
    return m.acts[m.plan[CONTACTS] + c, WHAT] == SWITCH


@njit(**OPTIONS)
def near(m, c, t, rate):
    """Gap of a contact, or switching argument, that counts as zero."""
    if switches(m, c):
        return ROUNDING * m.w[at(m, c) + LARGEST] + 4.0 * EPS * abs(t * rate)
    return tolerance(m, c, t, rate)


@njit(**OPTIONS)
def extent(m, c):
    """Reference size of a contact's gap: size of the mechanism [m], for flanks their angle."""
    act = m.plan[CONTACTS] + c
    if m.acts[act, WHAT] == FLANK:
        return 1.0 + abs(m.w[m.plan[SECTION] + SEC * m.acts[act, ON] + 2])
    return m.w[m.plan[TOUCH] + EXTENT]


@njit(**OPTIONS)
def depth_of(w, own, mass, speed):
    """Depth of an elastic impact of a mass [m]."""
    power = w[own + 4] + 1.0
    return (power * mass * speed * speed / (2.0 * w[own + 3])) ** (1.0 / power)


@njit(**OPTIONS)
def no_force(m, c):
    """Force [N] of a contact that counts as zero."""
    if rigid(m, c):
        return m.w[at(m, c) + ALLOWED] + 1e-11 * m.w[at(m, c) + PEAK]
    w, own = m.w, m.acts[m.plan[CONTACTS] + c, NUMBERS_AT]
    depth = w[at(m, c) + ALLOWED] / w[m.plan[TOUCH] + PRECISION]
    return 1e-9 * (w[at(m, c) + PEAK] + touching.elastic(w, own, -depth))


@njit(**OPTIONS)
def gradient_at(m, c):
    """Place of the gradient of a contact, or of a hold, which come last."""
    place = c if c >= 0 else m.plan[ACTS] - m.plan[CONTACTS] - 1 - c
    return m.plan[TOUCH] + SHARED + m.plan[COORDINATES] * place


@njit(**OPTIONS)
def product(w, row, values, count):
    """Product of a row of the tables and a column of values."""
    total = 0.0
    for i in range(count):
        total += w[row + i] * values[i]
    return total


@njit(**OPTIONS)
def copy_into(A, answer, w, of, count):
    """Copy numbers of the tables to factors."""
    for i in range(count):
        A[answer + i] = w[of + i]
