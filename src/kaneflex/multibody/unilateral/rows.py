"""Unilateral and frictional rows: each has a gap or slip, its rate, a law, a mode, a force and a record.

Row n is a contact or a switch of loads' laws from n = 0 on, and a friction below, -1 the last one. Its rates are linear
in the motion of two sections, as those of a joint's row, so the same text serves plane and space. MODE is OPEN without
force; a contact is CLOSED, or RELEASED after it has let go; friction is SLIPPING with a force by its law
(:mod:`kaneflex.generated.friction`), or STICKING: then its force is an unknown, a rigid row of the factors, and a
reaction of NOW and of the stages like those of cut joints. FLOWING friction is a function of the state. The force of
BENDING bristles is an unknown, too, whose row of the factors is their law (``lugre``). MEMORY belongs to the mode.

The interactions of frictions precede those of the drives, their rows of CUT follow those of the cut joints, their
numbers precede the contacts'. To add a kind of friction: a number after ALONG in ``model.layout`` with its kernel in
:func:`row_of`, and its interaction in ``model.interactions``.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.generated import friction as laws
from kaneflex.generated import joints, spatial
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.mechanism.friction import LAWS
from kaneflex.multibody.compile.stand_ins import of_changes, of_contacts, of_holds, of_impacts
from kaneflex.multibody.compile.values import by_size, numbers_of, row_length, twists, width
from kaneflex.multibody.dynamics.algebra import (
    absolute, axpy, cross, dot, first, joined, last, minus, plus, scaled, zero_like,
)  # fmt: skip
from kaneflex.multibody.dynamics.kinematics import section_at, section_motion, section_place, twist_at_section
from kaneflex.multibody.dynamics.wrenches import push, row_wrench
from kaneflex.multibody.compile.types import OPTIONS, apart, larger, shifted
from kaneflex.multibody.model.layout import (
    ACROSS, ACTS, ALLOWED, ALONG, AT, AXIS_AT, BENDING, CIRCLES, CLOSED, CONTACT, CONTACTS, CONTACT_SIZE, COORDINATE_AT,
    CUT_ROWS, DRIVES, EXTENT, FLANK, FLOWING, FORCE, GAP, GAP_ACCEL, GAP_RATE, HOLDS, LARGEST, LAW, LIMIT, LOADS,
    LOSING, MEMORY, MODE, NORMAL, NUMBERS_AT, ON, OPEN, PEAK, PLACE, PRECISION, RESULTS, ROOM, ROW_AT, SLIDE, SLIP,
    SLIPPING, SLIP_RATE, SPEED_SIZE, SPRINGS, STAYS, STICKING, STORED, SWITCH, TOUCH, TURN, WHAT,
)  # fmt: skip
from kaneflex.multibody.unilateral import lugre

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
def _gap(m, n, row):
    """Row of a contact: its gap, two rates, and the Jacobian by the twists of both sections."""
    act = act_of(m, n)
    first, second = section_at(m, m.acts[act, AT]), section_at(m, m.acts[act, ON])
    touching.gap(m.acts[act, WHAT], m.sections, first, second, m.w, law_at(m, n), m.rows, row)


@njit(**OPTIONS)
def _gap_6(m, n, row):
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


_gap = by_size(_gap, _gap_6)


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
    _gap(m, n, row)
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


@njit(**OPTIONS)
def _axis(m, n, k):
    """Direction in the tangent plane of a contact's friction of its k-th reference axis."""
    normal, axis = first(row_wrench(m, row_at(m, on_contact(m, n)), 1)), m.axes[int(m.w[law_at(m, n)]) + k]
    flat = axpy(-dot(axis, normal), normal, axis)
    return scaled(1.0 / larger(math.sqrt(dot(flat, flat)), 1e-300), flat)


@njit(**OPTIONS)
def _normal_rate(m, c):
    """Rate of a contact's unit normal [1/s]: of a plane with its body, of spheres with their centres."""
    act, own, normal = act_of(m, c), law_at(m, c), first(row_wrench(m, row_at(m, c), 1))
    one, two = twist_at_section(m, m.acts[act, AT]), twist_at_section(m, m.acts[act, ON])
    if m.acts[act, WHAT] != CIRCLES:
        return cross(last(one), normal)
    apart_, v = m.w[own + REACH_AT] + m.w[own] * m.rows[row_length(m) * row_at(m, c)], minus(first(two), first(one))
    return scaled(m.w[own] / larger(apart_, 1e-300), axpy(-dot(v, normal), normal, v))


@njit(**OPTIONS)
def _tangent(m, n, row):
    """Row of a contact's friction in space, along its slip or across it, in place of a position its MEMORY.

    The first row's MEMORY is its angle to a reference axis of the first body that the second row's MEMORY names.
    """
    apart()
    act, own, out, c = act_of(m, n), law_at(m, n), m.rows, on_contact(m, n)
    _gap(m, c, row_length(m) * row_at(m, c))
    beside = m.acts[act, WHAT] == ACROSS
    one, two = int(m.w[own + 1]) if beside else n, n if beside else int(m.w[own + 1])
    angle = m.w[at(m, one) + MEMORY] + (0.5 * math.pi if beside else 0.0)
    normal, axis = first(row_wrench(m, row_at(m, c), 1)), _axis(m, n, int(m.w[at(m, two) + MEMORY]))
    e = axpy(math.sin(angle), cross(normal, axis), scaled(math.cos(angle), axis))
    inner, outer, both = m.acts[act, AT], m.acts[act, ON], twists(m, shifted(out, row + 3))
    x, y = minus(place_of(m, c), section_place(m, inner)), minus(place_of(m, c), section_place(m, outer))
    both[0], both[1] = scaled(-1.0, joined(e, cross(x, e))), joined(e, cross(y, e))
    a, b, turns = twist_at_section(m, inner), twist_at_section(m, outer), _normal_rate(m, c)
    slide = minus(plus(first(b), cross(last(b), y)), plus(first(a), cross(last(a), x)))
    moves = axpy(-m.w[law_at(m, c) + RADIUS_AT], turns, first(b))  # rate of the touched place
    e_rate = axpy(-dot(e, minus(turns, cross(last(a), normal))), normal, cross(last(a), e))
    more = minus(cross(last(b), minus(moves, first(b))), cross(last(a), minus(moves, first(a))))
    out[row], out[row + 1] = m.w[at(m, n) + MEMORY], dot(e, slide)
    out[row + 2] = dot(e, more) + dot(e_rate, slide)
    out[row + 2] += dot(both[0], section_motion(m, inner, 1)) + dot(both[1], section_motion(m, outer, 1))


@njit(**OPTIONS)
def _slip(m, n, row):
    """Row of a friction: its position, speed and acceleration, and the Jacobian by the twists of both sections."""
    w, act, j, rows = m.w, act_of(m, n), law_at(m, n), m.rows
    first, second, sections = m.acts[act, AT], m.acts[act, ON], m.sections
    if m.acts[act, WHAT] == ALONG:
        of = int(w[j + OF_AT])
        first, second = section_at(m, first), section_at(m, second)
        touching.along(m.acts[of, WHAT], sections, first, second, w, m.acts[of, NUMBERS_AT], rows, row)
    elif m.acts[act, WHAT] == TURN:
        joints.turn(sections, first, second, w[j], w[j + 1], w[j + 2], rows, row)
    else:
        joints.slide(sections, first, second, w[j], w[j + 1], w[j + 2], rows, row)


@njit(**OPTIONS)
def _slip_6(m, n, row):
    act, axis, out, axes = act_of(m, n), int(m.w[law_at(m, n)]), m.rows, m.axes
    inner, outer = m.acts[act, AT], m.acts[act, ON]
    if m.acts[act, WHAT] == SLIDE:
        spatial.on_plane(m.sections, inner, outer, numbers_of(axes), axis, out, row)
        return
    if m.acts[act, WHAT] >= ALONG:
        _tangent(m, n, row)
        return
    along, one, both = axes[axis], twist_at_section(m, inner), twists(m, shifted(out, row + 3))
    both[1] = joined((0.0, 0.0, 0.0), along)
    both[0] = scaled(-1.0, both[1])
    faster = dot(along, minus(last(section_motion(m, outer, 1)), last(section_motion(m, inner, 1))))
    slow = minus(last(twist_at_section(m, outer)), last(one))
    out[row + 1], out[row + 2] = dot(along, slow), faster + dot(cross(last(one), along), slow)
    angle = math.atan2(dot(axes[axis + 2], axes[axis + 3]), dot(axes[axis + 1], axes[axis + 3]))
    before = m.w[at(m, n) + PLACE]  # turns are counted from one evaluation to the next
    out[row] = angle + math.tau * math.floor((before - angle) / math.tau + 0.5)


_slip = by_size(_slip, _slip_6)


@njit(**OPTIONS)
def row_of(m, n):
    """Row of a friction at the current state, for a contact after :func:`meet`; returns the place of its numbers."""
    apart()
    w, k, row, rows = m.w, at(m, n), row_length(m) * row_at(m, n), m.rows
    _slip(m, n, row)
    w[k + PLACE], w[k + SLIP], w[k + SLIP_RATE] = rows[row], rows[row + 1], rows[row + 2]
    w[k + SPEED_SIZE] = size_of(m, n, 0)
    return k


@njit(**OPTIONS)
def size_of(m, n, rate):
    """Sum of the sizes of the products of a row with velocities (0) or accelerations (1) of its sections."""
    size = 0.0
    for side in range(2):
        motion = section_motion(m, m.acts[act_of(m, n), AT + side], rate)
        size += dot(absolute(row_wrench(m, row_at(m, n), side)), absolute(motion))
    return size


@njit(**OPTIONS)
def stick(m, n):
    """Let a friction stick where it is."""
    if second(m, n):
        _face(m, n, 1.0, 0.0)
    else:
        m.w[at(m, n) + MEMORY] = m.w[at(m, n) + PLACE]
    set_mode(m, n, STICKING)


@njit(**OPTIONS)
def slip(m, n, direction, beside):
    """Let a friction slip, by the sign of the direction; in a tangent plane along both components."""
    _face(m, n, direction, beside)
    set_mode(m, n, SLIPPING)


@njit(**OPTIONS)
def set_mode(m, n, mode):
    """Set the mode of a friction, also of its second row."""
    m.w[at(m, n) + MODE], other = mode, second(m, n)
    if other:
        m.w[at(m, other) + MODE] = FLOWING if mode == SLIPPING else mode


@njit(**OPTIONS)
def _face(m, n, direction, beside):
    """Store a direction of slip: its sign, or turn both rows to it."""
    m.w[at(m, n) + MEMORY] = 1.0 if direction >= 0.0 else -1.0


@njit(**OPTIONS)
def _face_6(m, n, direction, beside):
    other = second(m, n)
    if other == 0:
        m.w[at(m, n) + MEMORY] = 1.0 if direction >= 0.0 else -1.0
        return
    e, beside_e = first(row_wrench(m, row_at(m, n), 1)), first(row_wrench(m, row_at(m, other), 1))
    e = axpy(beside, beside_e, scaled(direction if direction != 0.0 or beside != 0.0 else 1.0, e))
    normal, axis = first(row_wrench(m, row_at(m, on_contact(m, n)), 1)), int(m.w[law_at(m, n)])
    k, least = 0, 2.0
    for i in range(3):  # the one that is farthest from the normal
        if abs(dot(m.axes[axis + i], normal)) < least - 1e-3:
            k, least = i, abs(dot(m.axes[axis + i], normal))
    flat = _axis(m, n, k)
    m.w[at(m, other) + MEMORY], m.w[at(m, n) + MEMORY] = k, math.atan2(dot(e, cross(normal, flat)), dot(e, flat))
    row_of(m, other)
    row_of(m, n)


_face = by_size(_face, _face_6)


@njit(**OPTIONS)
def normal_force(m, n):
    """Normal force of a friction [N or N m]: its contact's force, or its joint's reactions in NOW."""
    w, what, arm = m.w, m.acts[act_of(m, n), WHAT], m.w[law_at(m, n) + ARM]
    if what >= ALONG:
        return larger(w[at(m, on_contact(m, n)) + FORCE], 0.0)
    return _bearing(m, n, arm)


@njit(**OPTIONS)
def _bearing(m, n, arm):
    """Normal force of a joint's friction by the reactions of the joint in NOW."""
    row = m.acts[int(m.w[law_at(m, n) + OF_AT]), ROW_AT]
    one, two = m.multipliers[row], m.multipliers[row + 1]
    turns = m.acts[act_of(m, n), WHAT] == TURN
    return arm * math.sqrt(one * one + two * two) if turns else larger(abs(one), arm * abs(two))


@njit(**OPTIONS)
def borne(m, n, wrench):
    """Parts of a joint's wrench at both ends of a guide's block, across its direction; of a pin the force in two equal
    parts."""
    own, along = law_at(m, n), m.axes[int(m.w[law_at(m, n)])]
    force = first(wrench)
    half = scaled(0.5, axpy(-dot(along, force), along, force))
    if m.acts[act_of(m, n), WHAT] == TURN:
        return half, half
    apart_ = scaled(0.5 * m.w[own + ARM], cross(last(wrench), along))
    return plus(half, apart_), minus(half, apart_)


@of_holds(0)
@njit(**OPTIONS)
def friction_of(m, row):
    """Friction of the joint with this first row; 0 if it has none."""
    for n in range(-frictions(m), 0):
        if m.acts[int(m.w[law_at(m, n) + OF_AT]), ROW_AT] == row:
            return n
    return 0


@njit(**OPTIONS)
def joint_wrench(m, n):
    """Wrench of the reactions in NOW that a joint with friction exerts on its second body."""
    total = zero_like(m.wrenches[0])
    for row in range(m.acts[int(m.w[law_at(m, n) + OF_AT]), ROW_AT], int(m.w[law_at(m, n) + 1])):
        total = axpy(m.multipliers[row], row_wrench(m, row, 1), total)
    return total


@njit(**OPTIONS)
def _bearing_6(m, n, arm):
    one, two = borne(m, n, joint_wrench(m, n))
    total = math.sqrt(dot(one, one)) + math.sqrt(dot(two, two))
    return arm * total if m.acts[act_of(m, n), WHAT] == TURN else total


_bearing = by_size(_bearing, _bearing_6)


@of_holds(None)
@njit(**OPTIONS)
def exert(m):
    """Force of every friction at the current state, also at NOW, with its energy; contacts are evaluated before."""
    apart()
    w = m.w
    for n in range(-frictions(m), 0):
        k, j = row_of(m, n), law_at(m, n)
        row, v, mode = row_at(m, n), w[k + SLIP], w[k + MODE]
        N = normal_force(m, n)
        w[k + NORMAL], w[k + LIMIT] = N, laws.limit(w, j, N)
        if mode == OPEN:
            m.multipliers[row] = 0.0
        elif mode == FLOWING:
            m.multipliers[row] = -w[j + VISCOUS_AT] * v
        elif mode == SLIPPING and second(m, n):
            _rub(m, n, N)
        elif mode == SLIPPING:
            m.multipliers[row] = -w[k + MEMORY] * laws.dry(w, j, N, v) - w[j + VISCOUS_AT] * v
        w[k + FORCE], w[k + STORED] = m.multipliers[row], 0.0
        w[k + LOSING] = power(m, n)
        if mode == BENDING:
            w[k + STORED] = 0.5 * w[j + lugre.STIFFNESS_AT] * w[k + MEMORY] * w[k + MEMORY]
            w[k + LOSING] -= w[j + lugre.STIFFNESS_AT] * w[k + MEMORY] * lugre.by_now(w, k, j)[1]


@njit(**OPTIONS)
def sliding_size(m, n):
    """Slip speed by which both components of a friction's force are divided, never zero."""
    return math.hypot(abs(m.w[at(m, n) + SLIP]) + SLOWEST * extent(m, n), across(m, n, SLIP))


@njit(**OPTIONS)
def _rub(m, n, N):
    """Both components of a slipping friction's force, against the slip in the tangent plane.

    Beyond zero of its first component the force goes on without reversal, as that of one row.
    """
    w, j, k, other = m.w, law_at(m, n), at(m, n), at(m, second(m, n))
    v, beside = w[k + SLIP], w[other + SLIP]
    share = laws.dry(w, j, N, magnitude(m, n, SLIP)) / sliding_size(m, n)
    m.multipliers[row_at(m, n)] = -share * (abs(v) + SLOWEST * extent(m, n)) - w[j + VISCOUS_AT] * v
    w[other + FORCE] = -share * (beside if v >= 0.0 else -beside) - w[j + VISCOUS_AT] * beside
    m.multipliers[row_at(m, second(m, n))] = w[other + FORCE]


@njit(**OPTIONS)
def power(m, n):
    """Power [W] that a row takes, the first of two for both; zero while sticking, whatever its rounding slip."""
    k = at(m, n)
    if m.w[k + MODE] == STICKING or (n < 0 and m.acts[act_of(m, n), WHAT] == ACROSS):
        return 0.0
    more = across(m, n, FORCE) * across(m, n, SLIP) if n < 0 else 0.0
    return -m.w[k + FORCE] * m.w[k + GAP_RATE] - more


@njit(**OPTIONS)
def _force_of(m, n):
    """Force of friction in a tangent plane by its second row, global."""
    along, beside = int(m.w[law_at(m, n) + 1]), m.w[at(m, n) + FORCE]
    force = scaled(m.w[at(m, along) + FORCE], row_wrench(m, row_at(m, along), 1))
    force = axpy(beside, row_wrench(m, row_at(m, n), 1), force)
    return force[0], force[1], force[2]


@njit(**OPTIONS)
def results(m, out):
    """Results of every row, frictions first: gap or position, rate, force, normal force, stored energy, lost power,
    MODE and MEMORY; of a friction with two rows sizes, and with the second one the force's components."""
    w, i = m.w, 0
    for n in range(-frictions(m), contacts(m)):
        k = at(m, n)
        out[i], out[i + 1], out[i + 2] = w[k + GAP], w[k + GAP_RATE], w[k + FORCE]
        if n < 0 and m.acts[act_of(m, n), WHAT] == ACROSS:
            out[i], out[i + 1], out[i + 2] = _force_of(m, n)
        elif n < 0 and second(m, n):
            out[i + 1], out[i + 2] = magnitude(m, n, SLIP), magnitude(m, n, FORCE)
        out[i + 3] = w[k + (NORMAL if n < 0 else FORCE)]
        out[i + 4], out[i + 5], out[i + 6], out[i + 7] = w[k + STORED], w[k + LOSING], w[k + MODE], w[k + MEMORY]
        i += RESULTS


@of_contacts(None)
@njit(**OPTIONS)
def record(m):
    """Store the results of every row with an instant in space."""
    results(m, m.touching)
