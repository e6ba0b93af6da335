"""Unilateral and frictional rows: each has a gap or slip, its rate, a law, a mode, a force and a record.

Row n is a contact or a switch of loads' laws from n = 0 on, and a friction below, -1 the last one. Its rates are linear
in the motion of two sections, as those of a joint's row, so the same text serves plane and space. MODE is OPEN without
force; a contact is CLOSED, or RELEASED after it has let go; friction is SLIPPING with a force by its law
(:mod:`kaneflex.generated.friction`), or STICKING: then its force is an unknown, a rigid row of the factors, and a
reaction of NOW and of the stages like those of cut joints. FLOWING friction is a function of the state. The force of
BENDING bristles is an unknown, too, whose row of the factors is their law (``lugre``). MEMORY belongs to the mode.

The interactions of frictions precede those of the drives, their rows of CUT follow those of the cut joints, their
numbers precede the contacts'. To add a kind of friction: a number after ALONG in ``model.layout`` with its wrench in
:mod:`.relative_rows`, and its interaction in ``model.interactions``.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.mechanism.friction import LAWS
from kaneflex.multibody.compile.types import OPTIONS
from kaneflex.multibody.compile.values import width
from kaneflex.multibody.model.codes import IMPULSES, NOTHING
from kaneflex.multibody.model.layout import (
    ACROSS, ACTS, ALLOWED, ALONG, CLOSED, CONTACT, CONTACTS, CONTACT_SIZE, CUT_ROWS, DECIDES, DRIVES, FRICTIONS, LAW,
    LOADS, MEMORY, MODE, NUMBERS_AT, OPEN, PEAK, PRECISION, ROW_AT, SPRINGS, SWITCH, TOUCH, WHAT,
)  # fmt: skip

SLOWEST = 1e-11
"""Speed of a friction that counts as zero, in sizes of the mechanism, or rad, a second."""
ROUNDING = 1e-14
"""Rounding error of a gap, in sizes of the mechanism."""
EPS = 2.3e-16
"""Relative rounding error of numbers."""
REACH_AT, RADIUS_AT = 2, 7
"""Places among the numbers of a contact: distance at first touch, and radius of the second side."""
END_AT, MU_AT, VISCOUS_AT, ARM, LAW_AT, OF_AT = 2, 3, 7, 9, 10, 11
"""Places among the numbers of a friction law: end of its joint's rows, coefficient of sliding, viscous part, arm,
number of the law, and the interaction that it belongs to."""
VISCOUS_LAW, LUGRE = float(LAWS.index("viscous")), float(LAWS.index("lugre"))
"""Numbers of laws that neither stick nor slip."""


@njit(**OPTIONS)
def contacts(m):
    """Number of contacts and switches."""
    return m.plan[ACTS] - m.plan[CONTACTS]


@njit(**OPTIONS)
def frictions(m):
    """Number of frictions."""
    return m.plan[DRIVES] - m.plan[FRICTIONS]


@njit(**OPTIONS)
def at(m, n):
    """Place of the numbers of a row."""
    return m.plan[CONTACT] + CONTACT_SIZE * n


@njit(**OPTIONS)
def act_of(m, n):
    """Interaction of a row."""
    return (m.plan[CONTACTS] if n >= 0 else m.plan[DRIVES]) + n


@njit(**OPTIONS)
def law_at(m, n):
    """Place of the numbers of a row's law."""
    return m.acts[act_of(m, n), NUMBERS_AT]


@njit(**OPTIONS)
def row_at(m, n):
    """Index of a row among those of the cut joints."""
    return m.plan[CUT_ROWS] + n


@njit(**OPTIONS)
def is_rigid(m, n):
    """True if a contact follows Newton's law."""
    return m.acts[act_of(m, n), LAW] == NEWTON


@njit(**OPTIONS)
def is_switch(m, n):
    """True for a switching argument of laws instead of a contact."""
    return m.acts[act_of(m, n), WHAT] == SWITCH


@njit(**OPTIONS)
def contact_of(m, n):
    """Contact that a friction belongs to; below zero if it belongs to a joint."""
    return int(m.w[law_at(m, n) + OF_AT]) - m.plan[CONTACTS] if m.acts[act_of(m, n), WHAT] >= ALONG else -1


@njit(**OPTIONS)
def second_row(m, n):
    """Row across the slip of a contact's friction in space; 0 for other frictions, which have one row."""
    return int(m.w[law_at(m, n) + 1]) if width(m) == 6 and m.acts[act_of(m, n), WHAT] == ALONG else 0


@njit(**OPTIONS)
def is_second(m, n):
    """True for the row across the slip of a contact's friction in space."""
    return m.acts[act_of(m, n), WHAT] == ACROSS


@njit(**OPTIONS)
def across(m, n, what):
    """Number of a friction's second row; 0 without one."""
    other = second_row(m, n)
    return m.w[at(m, other) + what] if other else 0.0


@njit(**OPTIONS)
def magnitude(m, n, what):
    """Size of a friction's slip, or force, with both rows."""
    return math.hypot(m.w[at(m, n) + what], across(m, n, what))


@njit(**OPTIONS)
def slip_sign(m, n):
    """Direction of slip along a friction's row, 1 or -1."""
    return 1.0 if second_row(m, n) else m.w[at(m, n) + MEMORY]


@njit(**OPTIONS)
def impact_depth(w, own, mass, speed):
    """Depth of an elastic impact of a mass [m]."""
    power = w[own + 4] + 1.0
    return (power * mass * speed * speed / (2.0 * w[own + 3])) ** (1.0 / power)


@njit(**OPTIONS)
def zero_force(m, n):
    """Force [N] of a contact that counts as zero."""
    w, k = m.w, at(m, n)
    if is_rigid(m, n):
        return w[k + ALLOWED] + 1e-11 * w[k + PEAK]
    return 1e-9 * (w[k + PEAK] + touching.elastic(w, law_at(m, n), -w[k + ALLOWED] / w[m.plan[TOUCH] + PRECISION]))


@njit(**OPTIONS)
def in_impact(m):
    """1 while impulses are decided, else 0."""
    return 1 if m.pivots[DECIDES] == IMPULSES else 0


@njit(**OPTIONS)
def is_idle(m, n):
    """True if the contact of a friction is open while modes are decided."""
    c = contact_of(m, n)
    return m.pivots[DECIDES] != NOTHING and c >= 0 and m.w[at(m, c) + MODE] == OPEN


@njit(**OPTIONS)
def product(w, row, values, count):
    """Product of a row of the tables and a column of values."""
    total = 0.0
    for i in range(count):
        total += w[row + i] * values[i]
    return total


@njit(**OPTIONS)
def argument_at(m, n):
    """Place of a switch's argument and its rate among the sizes of loads."""
    return m.plan[SPRINGS] - m.plan[LOADS] + 2 * m.acts[act_of(m, n), ROW_AT]


@njit(**OPTIONS)
def is_at_rest(m, n):
    """True if a contact is at rest under Newton's law."""
    return is_rigid(m, n) and m.w[at(m, n) + MODE] == CLOSED
