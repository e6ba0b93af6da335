"""Unilateral and frictional rows: each has a gap or slip, its rate, a law, a mode, a force and a record.

Row n is a contact or a switch of loads' laws from n = 0 on, and a friction below, -1 the last one. Its rates are linear
in the motion of two sections, as those of a joint's row, so the same text serves plane and space. MODE is OPEN without
force; a contact is CLOSED, or RELEASED after it has let go; friction is SLIPPING with a force by its law
(:mod:`kaneflex.generated.friction`), or STICKING: then its force is an unknown, a rigid row of the factors, and a
reaction of NOW and of the stages like those of cut joints. FLOWING friction is a function of the state. The force of
BENDING bristles is an unknown, too, whose row of the factors is their law (``lugre``). MEMORY belongs to the mode.

The interactions of frictions precede those of the drives, their rows of CUT follow those of the cut joints, their
numbers precede the contacts'. To add a kind of friction: a number after ALONG in ``model.layout`` with its kernel in
:mod:`.frictions`, and its interaction in ``model.interactions``.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.generated import spatial
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.mechanism.friction import LAWS
from kaneflex.multibody.compile.stand_ins import of_changes, of_impacts
from kaneflex.multibody.compile.values import by_size, numbers_of, row_length, twists, width
from kaneflex.multibody.dynamics.algebra import (
    joined, scaled,
)  # fmt: skip
from kaneflex.multibody.dynamics.kinematics import section_at, section_place
from kaneflex.multibody.dynamics.wrenches import push, row_wrench
from kaneflex.multibody.compile.types import OPTIONS, apart, shifted
from kaneflex.multibody.model.layout import (
    ACTS, ALLOWED, ALONG, AT, AXIS_AT, CIRCLES, CLOSED, CONTACT, CONTACTS, CONTACT_SIZE, COORDINATE_AT, CUT_ROWS,
    DRIVES, EXTENT, FLANK, FORCE, GAP, GAP_ACCEL, GAP_RATE, HOLDS, LARGEST, LAW, LOADS, LOSING, MEMORY, MODE,
    NUMBERS_AT, ON, OPEN, PEAK, PRECISION, ROOM, ROW_AT, SPRINGS, STAYS, STORED, SWITCH, TOUCH, TURN, WHAT,
)  # fmt: skip

SLOWEST = 1e-11
"""Speed of a friction that counts as zero, in sizes of the mechanism, or rad, a second."""
ROUNDING = 1e-14
"""Rounding error of a gap, in sizes of the mechanism."""
EPS = 2.3e-16
"""Relative rounding error of numbers."""
REACH_AT, RADIUS_AT = 2, 7
"""Places among the numbers of a contact: distance at first touch, and radius of the second side."""
MU_AT, STATIC_AT, VISCOUS_AT, PRELOAD_AT, ARM, LAW_AT, OF_AT = 3, 4, 7, 8, 9, 10, 11
"""Places among the numbers of a friction law: both coefficients, viscous part, preload, arm, number of the law, and the
interaction that it belongs to."""
VISCOUS_LAW, LUGRE = float(LAWS.index("viscous")), float(LAWS.index("lugre"))
"""Numbers of laws that neither stick nor slip."""


@njit(**OPTIONS)
def contacts(m):
    """Number of contacts and switches."""
    return m.plan[ACTS] - m.plan[CONTACTS]


@njit(**OPTIONS)
def frictions(m):
    """Number of frictions."""
    return m.plan[DRIVES] - m.plan[HOLDS]


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
def rigid(m, n):
    """True if a contact follows Newton's law."""
    return m.acts[act_of(m, n), LAW] == NEWTON


@njit(**OPTIONS)
def switches(m, n):
    """True for a switching argument of laws instead of a contact."""
    return m.acts[act_of(m, n), WHAT] == SWITCH


@njit(**OPTIONS)
def on_contact(m, n):
    """Contact that a friction belongs to; below zero if it belongs to a joint."""
    return int(m.w[law_at(m, n) + OF_AT]) - m.plan[CONTACTS] if m.acts[act_of(m, n), WHAT] >= ALONG else -1


@njit(**OPTIONS)
def second(m, n):
    """Row across the slip of a contact's friction in space; 0 of other frictions, which have one row."""
    return int(m.w[law_at(m, n) + 1]) if width(m) == 6 and m.acts[act_of(m, n), WHAT] == ALONG else 0


@njit(**OPTIONS)
def across(m, n, what):
    """Number of a friction's second row; 0 without one."""
    other = second(m, n)
    return m.w[at(m, other) + what] if other else 0.0


@njit(**OPTIONS)
def magnitude(m, n, what):
    """Size of a friction's slip, or force, with both rows."""
    return math.hypot(m.w[at(m, n) + what], across(m, n, what))


@njit(**OPTIONS)
def way(m, n):
    """Direction of slip along a friction's row, 1 or -1."""
    return 1.0 if second(m, n) else m.w[at(m, n) + MEMORY]


@njit(**OPTIONS)
def _angle(m, n):
    """Angle [rad] of the second body of flanks, in space against their first one."""
    return section_place(m, m.acts[act_of(m, n), ON])[2]


@njit(**OPTIONS)
def _angle_6(m, n):
    return m.y[int(m.w[law_at(m, n) + COORDINATE_AT])]


_angle = by_size(_angle, _angle_6)


@njit(**OPTIONS)
def extent(m, n):
    """Reference size of a row's value: size of the mechanism [m]; for flanks their angle, for turns 1 rad."""
    act = act_of(m, n)
    if n < 0 and m.acts[act, WHAT] == TURN:
        return 1.0
    if n >= 0 and m.acts[act, WHAT] == FLANK:
        return 1.0 + abs(_angle(m, n))
    return m.w[m.plan[TOUCH] + EXTENT]


@njit(**OPTIONS)
def near(m, n, t, rate):
    """Gap of a contact [m or rad], or switching argument, that counts as zero."""
    size = m.w[at(m, n) + LARGEST] if switches(m, n) else extent(m, n)
    return ROUNDING * size + 4.0 * EPS * abs(t * rate)


@njit(**OPTIONS)
def depth_of(w, own, mass, speed):
    """Depth of an elastic impact of a mass [m]."""
    power = w[own + 4] + 1.0
    return (power * mass * speed * speed / (2.0 * w[own + 3])) ** (1.0 / power)


@njit(**OPTIONS)
def no_force(m, n):
    """Force [N] of a contact that counts as zero."""
    w, k = m.w, at(m, n)
    if rigid(m, n):
        return w[k + ALLOWED] + 1e-11 * w[k + PEAK]
    return 1e-9 * (w[k + PEAK] + touching.elastic(w, law_at(m, n), -w[k + ALLOWED] / w[m.plan[TOUCH] + PRECISION]))


@njit(**OPTIONS)
def product(w, row, values, count):
    """Product of a row of the tables and a column of values."""
    total = 0.0
    for i in range(count):
        total += w[row + i] * values[i]
    return total


@njit(**OPTIONS)
def argument(m, n):
    """Place of a switch's argument and its rate among the sizes of loads."""
    return m.plan[SPRINGS] - m.plan[LOADS] + 2 * m.acts[act_of(m, n), ROW_AT]


@of_changes(None)
@njit(**OPTIONS)
def _meet_switch(m, n):
    """Numbers of a switching argument as a gap that closes when a load's law changes its branch.

    The gap is its distance from zero on its side; for one that stays on its side, the remaining distance.
    """
    w, k, j = m.w, at(m, n), argument(m, n)
    side, value, rate = w[k + MEMORY], m.sizes[j], m.sizes[j + 1]
    if rate - rate != 0.0:  # not a number, for example on one side only
        rate = 0.0
    if side == STAYS:
        rate = -rate if value > 0.0 else rate
        value = w[k + ROOM] - abs(value)
    else:
        value, rate = side * value, side * rate
    w[k + GAP], w[k + GAP_RATE] = value, rate


@njit(**OPTIONS)
def gap_row(m, n, row):
    """Row of a contact: its gap, two rates, and the Jacobian by the twists of both sections."""
    act = act_of(m, n)
    first, second = section_at(m, m.acts[act, AT]), section_at(m, m.acts[act, ON])
    touching.gap(m.acts[act, WHAT], m.sections, first, second, m.w, law_at(m, n), m.rows, row)


@njit(**OPTIONS)
def _gap_row_6(m, n, row):
    act, own, out = act_of(m, n), law_at(m, n), m.rows
    axis, reach, first, second = int(m.w[own + AXIS_AT]), m.w[own + REACH_AT], m.acts[act, AT], m.acts[act, ON]
    if m.acts[act, WHAT] == FLANK:
        k, turn, both = int(m.w[own + COORDINATE_AT]), m.w[own], twists(m, shifted(out, row + 3))
        out[row], out[row + 1], out[row + 2] = turn * m.y[k] - reach, turn * m.u[k], turn * m.du[k]
        both[1] = joined((0.0, 0.0, 0.0), m.axes[axis])
        both[0] = scaled(-1.0, both[1])
    elif m.acts[act, WHAT] == CIRCLES:
        spatial.spheres(m.sections, first, second, m.w[own], reach, out, row)
    else:
        spatial.on_plane(m.sections, first, second, numbers_of(m.axes), axis, out, row)
        out[row] -= reach


gap_row = by_size(gap_row, _gap_row_6)


@njit(**OPTIONS)
def place_of(m, n):
    """Touched place of a contact after :func:`meet` [m], global; of flanks that of the second section."""
    place, push = section_place(m, m.acts[act_of(m, n), ON]), row_wrench(m, row_at(m, n), 1)
    radius = m.w[law_at(m, n) + RADIUS_AT]
    z = place[2] - radius * push[2] if width(m) == 6 else 0.0
    return place[0] - radius * push[0], place[1] - radius * push[1], z


@njit(**OPTIONS)
def meet(m, n):
    """Row and numbers of a contact or switch, and their place; nothing else is changed.

    A released contact exerts no force and loses its stored energy. One at rest under Newton's law exerts the reaction
    of its row, an unknown.
    """
    w, k, j, row, law = m.w, at(m, n), law_at(m, n), row_length(m) * row_at(m, n), m.acts[act_of(m, n), LAW]
    w[k + FORCE] = w[k + STORED] = w[k + LOSING] = 0.0
    if switches(m, n):
        _meet_switch(m, n)
        return k
    gap_row(m, n, row)
    w[k + GAP], w[k + GAP_RATE], w[k + GAP_ACCEL] = m.rows[row], m.rows[row + 1], m.rows[row + 2]
    mode, gap, rate = w[k + MODE], w[k + GAP], w[k + GAP_RATE]
    if mode == OPEN:
        return k
    if law == NEWTON:
        w[k + FORCE] = m.multipliers[row_at(m, n)]
        return k
    if mode == CLOSED:
        w[k + FORCE] = touching.normal_force(law, w, j, w[k + MEMORY], gap, rate)
    w[k + STORED] = touching.stored(w, j, gap)
    w[k + LOSING] = (touching.elastic(w, j, gap) - w[k + FORCE]) * rate
    return k


@of_changes(None)
@njit(**OPTIONS)
def press(m):
    """Contact forces of closed contacts on their sections, with the numbers of all contacts and switches."""
    apart()
    for n in range(contacts(m)):
        force = m.w[meet(m, n) + FORCE]
        if force != 0.0:
            for side in range(2):
                push(m, m.acts[act_of(m, n), AT + side], scaled(force, row_wrench(m, row_at(m, n), side)))


@njit(**OPTIONS)
def rests(m, n):
    """True if a contact is at rest under Newton's law."""
    return rigid(m, n) and m.w[at(m, n) + MODE] == CLOSED


@of_impacts(None)
@njit(**OPTIONS)
def rest_rows(m):
    """Rows of contacts at rest under Newton's law: gap, rate, acceleration, and Jacobians."""
    apart()
    for n in range(contacts(m)):
        if rests(m, n):
            meet(m, n)
