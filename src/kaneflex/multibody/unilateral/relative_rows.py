"""Rows of contacts and frictions: motion of one section past another along a unit wrench, in the plane and in space.

The wrench of a contact is its normal, that of its friction lies in the tangent plane, that of a guide's or pin's
friction is fixed in the first body.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.multibody.compile.stand_ins import if_changes, if_impacts
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, shifted, turned
from kaneflex.multibody.compile.values import by_size, inline, row_length, twists, width
from kaneflex.multibody.dynamics.algebra import (
    axpy, coriolis, cross, dot, first, force_at, joined, minus, plus, scaled, twist_at, zero_like,
)  # fmt: skip
from kaneflex.multibody.dynamics.kinematics import section_motion, section_place, twist_at_section
from kaneflex.multibody.dynamics.wrenches import push, row_wrench
from kaneflex.multibody.model.layout import (
    ACROSS, AT, AXIS_AT, CIRCLES, CLOSED, COORDINATE_AT, EXTENT, FLANK, FORCE, GAP, GAP_ACCEL, GAP_RATE, LARGEST, LAW,
    MEMORY, MODE, ON, OPEN, PLACE, STAYS, STORED, TOUCH, TURN, WHAT, ZERO_BAND,
)  # fmt: skip
from kaneflex.multibody.unilateral.rows import (
    EPS, RADIUS_AT, REACH_AT, ROUNDING, act_of, argument_at, at, contact_of, contacts, is_at_rest, is_switch, law_at,
    row_at,
)  # fmt: skip


@njit(**OPTIONS)
def angle_of(m, n):
    """Angle [rad] of the second body relative to the first, for flanks or a pin, and the angle whose rounding error it
    has."""
    act, own, axes = act_of(m, n), law_at(m, n), m.axes
    if width(m) == 3:
        angle = section_place(m, m.acts[act, ON])[2]
        return angle - section_place(m, m.acts[act, AT])[2], angle
    if m.acts[act, WHAT] == FLANK:
        angle = m.y[int(m.w[own + COORDINATE_AT])]
        return angle, angle
    axis = int(m.w[own])
    angle = math.atan2(dot(axes[axis + 2], axes[axis + 3]), dot(axes[axis + 1], axes[axis + 3]))
    before = m.w[at(m, n) + PLACE]  # turns are counted from one evaluation to the next
    angle += math.tau * math.floor((before - angle) / math.tau + 0.5)
    return angle, angle


@njit(**OPTIONS)
def row_scale(m, n):
    """Reference size of a row's value: size of the mechanism [m]; for flanks their angle, for turns 1 rad."""
    act = act_of(m, n)
    if n < 0 and m.acts[act, WHAT] == TURN:
        return 1.0
    if n >= 0 and m.acts[act, WHAT] == FLANK:
        return 1.0 + abs(angle_of(m, n)[1])
    return m.w[m.plan[TOUCH] + EXTENT]


@njit(**OPTIONS)
def zero_gap(m, n, t, rate):
    """Gap of a contact [m or rad], or switching argument, that counts as zero."""
    size = m.w[at(m, n) + LARGEST] if is_switch(m, n) else row_scale(m, n)
    return ROUNDING * size + 4.0 * EPS * abs(t * rate)


@if_changes(None)
@njit(**OPTIONS)
def _fill_switch(m, n):
    """Numbers of a switching argument as a gap that closes when a load's law changes its branch.

    The gap is its distance from zero on its side; for one that stays on its side, the remaining distance.
    """
    w, k, j = m.w, at(m, n), argument_at(m, n)
    side, value, rate = w[k + MEMORY], m.sizes[j], m.sizes[j + 1]
    if rate - rate != 0.0:  # not a number, for example on one side only
        rate = 0.0
    if side == STAYS:
        rate = -rate if value > 0.0 else rate
        value = w[k + ZERO_BAND] - abs(value)
    else:
        value, rate = side * value, side * rate
    w[k + GAP], w[k + GAP_RATE] = value, rate


@njit(**OPTIONS)
def as_force(m, a):
    """Wrench without moment, of the first components of a vector or twist."""
    inline()
    return a[0], a[1], 0.0


@njit(**OPTIONS)
def _force_6(m, a):
    inline()
    return a[0], a[1], a[2], 0.0, 0.0, 0.0


@njit(**OPTIONS)
def fixed_wrench(m, n, turns, axis):
    """Unit force along a direction of the first section's body, or moment if ``turns`` is not 0, its sign in the plane;
    ``axis``: its place among the law's numbers in space."""
    inline()
    if turns != 0.0:
        return 0.0, 0.0, turns
    x, y = turned(m.w, section_place(m, m.acts[act_of(m, n), AT])[2], law_at(m, n))
    return x, y, 0.0


@njit(**OPTIONS)
def _fixed_6(m, n, turns, axis):
    along = m.axes[int(m.w[law_at(m, n) + axis])]
    if turns != 0.0:
        return joined((0.0, 0.0, 0.0), along)
    return joined(along, (0.0, 0.0, 0.0))


as_force, fixed_wrench = by_size(as_force, _force_6), by_size(fixed_wrench, _fixed_6)


@njit(**OPTIONS)
def turn_rate(t, a):
    """Rate of a vector or wrench that turns with a twist."""
    inline()
    return scaled(0.5, coriolis(t, a))


@njit(**OPTIONS)
def separation(m, act):
    """Vector [m] from the first section to the second."""
    inline()
    return as_force(m, minus(section_place(m, m.acts[act, ON]), section_place(m, m.acts[act, AT])))


@njit(**OPTIONS)
def _radial(m, n, a):
    """Part of a vector across the axis of a bearing of circles; all of it in the plane and for spheres."""
    inline()
    if width(m) == 3:
        return a
    k = int(m.w[law_at(m, n) + AXIS_AT])
    if k < 0:
        return a
    axis = as_force(m, m.axes[k])
    return axpy(-dot(axis, a), axis, a)


@njit(**OPTIONS)
def normal_and_gap(m, n):
    """Unit normal of a contact, a force on its second section, or a moment of flanks, and the gap."""
    act, own, d = act_of(m, n), law_at(m, n), separation(m, act_of(m, n))
    what, way, reach = m.acts[act, WHAT], m.w[own], m.w[own + REACH_AT]
    if what == CIRCLES:  # about one centre they have no normal
        d = _radial(m, n, d)
        length = math.sqrt(dot(d, d) + 1e-300)
        return scaled(way / length, d), way * (length - reach)
    normal = fixed_wrench(m, n, way if what == FLANK else 0.0, AXIS_AT)
    return normal, (way * angle_of(m, n)[0] if what == FLANK else dot(normal, d)) - reach


@njit(**OPTIONS)
def _normal_rate(m, n, normal):
    """Rate of the normal of circles or spheres [1/s] against the first body: it turns with their centres."""
    act, own = act_of(m, n), law_at(m, n)
    a = twist_at(twist_at_section(m, m.acts[act, AT]), separation(m, act))
    v = _radial(m, n, as_force(m, minus(twist_at_section(m, m.acts[act, ON]), a)))
    length = larger(m.w[own + REACH_AT] + m.w[own] * m.rows[row_length(m) * row_at(m, n)], 1e-150)
    return scaled(m.w[own] / length, axpy(-dot(v, normal), normal, v))


@njit(**OPTIONS)
def reference_axis(m, n, normal, k):
    """Direction in the tangent plane of a contact's friction of its k-th reference axis."""
    axis = m.axes[int(m.w[law_at(m, n)]) + k]
    flat = axpy(-dot(axis, normal), normal, axis)
    return scaled(1.0 / larger(math.sqrt(dot(flat, flat)), 1e-300), flat)


@njit(**OPTIONS)
def _direction(m, n, normal):
    """Unit vector of a contact's friction: its normal turned by 90 deg; in space along the slip or across it.

    The first row's MEMORY is its angle to a reference axis of the first body that the second row's MEMORY names.
    """
    if width(m) == 3:
        return as_force(m, (-normal[1], normal[0], 0.0))
    beside, other = m.acts[act_of(m, n), WHAT] == ACROSS, int(m.w[law_at(m, n) + 1])
    one, two = other if beside else n, n if beside else other
    angle = m.w[at(m, one) + MEMORY] + (0.5 * math.pi if beside else 0.0)
    away = first(normal)
    axis = reference_axis(m, n, away, int(m.w[at(m, two) + MEMORY]))
    return as_force(m, axpy(math.sin(angle), cross(away, axis), scaled(math.cos(angle), axis)))


@njit(**OPTIONS)
def _friction_position(m, n, c, along):
    """Position [m] of a contact's friction; 0 for circles, its MEMORY in space: these are no functions of places."""
    if width(m) == 6:
        return m.w[at(m, n) + MEMORY]
    act, radius = act_of(m, c), m.w[law_at(m, c) + RADIUS_AT]
    x, y, phi = minus(section_place(m, m.acts[act, ON]), section_place(m, m.acts[act, AT]))
    return along[0] * x + along[1] * y - radius * phi if m.acts[act, WHAT] != CIRCLES else 0.0


@njit(**OPTIONS)
def _rubs_outside(m, c, radius):
    """True if the friction of a contact acts at the surface of the first body, as for points on planes and pins in
    space; that of spheres acts at their radius.

    The feet of a body then act in one plane, and the ends of a pin on one line, whatever their depths: a body whose
    feet all stick can still tilt.
    """
    if width(m) == 3:
        return False
    axis = m.w[law_at(m, c) + AXIS_AT] if m.acts[act_of(m, c), WHAT] == CIRCLES else -1.0
    return axis >= 0.0 or (radius == 0.0 and m.acts[act_of(m, c), WHAT] != CIRCLES)


@njit(**OPTIONS)
def fill_row(m, n):
    """Row of a contact, or of a friction after its contact: gap or position, its two rates, Jacobian by both twists.

    It is the motion of the second section past the first along a unit wrench, at a place that is fixed in the second
    body; for circles and spheres the place stays on their normal.
    """
    no_inline()
    act, row, c, radius, turns = act_of(m, n), row_length(m) * row_at(m, n), n if n >= 0 else contact_of(m, n), 0.0, 0.0
    sinks = 0.0
    one, two, out = m.acts[act, AT], m.acts[act, ON], m.rows
    a, b = twist_at_section(m, one), twist_at_section(m, two)
    normal = zero_like(a)
    if n >= 0:
        normal, out[row] = normal_and_gap(m, n)
        along = normal
    elif c >= 0:
        normal, radius = row_wrench(m, row_at(m, c), 1), m.w[law_at(m, c) + RADIUS_AT]
        if _rubs_outside(m, c, radius):
            radius, sinks = radius + out[row_length(m) * row_at(m, c)], out[row_length(m) * row_at(m, c) + 1]
        along = _direction(m, n, normal)
        out[row] = _friction_position(m, n, c, along)
    else:
        turns = 1.0 if m.acts[act, WHAT] == TURN else 0.0
        along = fixed_wrench(m, n, turns, 0)
        out[row] = angle_of(m, n)[0] if turns != 0.0 else dot(along, separation(m, act))
    place = minus(section_place(m, two), scaled(radius, normal))
    x, y = minus(place, section_place(m, one)), minus(place, section_place(m, two))
    slide, slow, bends = axpy(-1.0, twist_at(a, x), twist_at(b, y)), turn_rate(a, normal), 0.0
    if c >= 0 and m.acts[act_of(m, c), WHAT] == CIRCLES:
        own = _normal_rate(m, c, normal)
        bends = dot(own, slide) if n >= 0 else -dot(along, own) * dot(normal, slide)
        slow = plus(slow, own)
    moves = axpy(-sinks, normal, as_force(m, axpy(-radius, slow, b)))  # rate of the place
    back, on = axpy(-1.0, as_force(m, a), plus(moves, slide)), axpy(-1.0, as_force(m, b), moves)
    faster = axpy(-1.0, twist_at(section_motion(m, one, 1), x), twist_at(section_motion(m, two, 1), y))
    faster = plus(faster, axpy(-1.0, turn_rate(a, back), turn_rate(b, on)))
    out[row + 1], out[row + 2] = dot(along, slide), dot(along, faster) + bends
    both = twists(m, shifted(out, row + 3))
    both[0], both[1] = scaled(-1.0, force_at(along, x)), force_at(along, y)


@njit(**OPTIONS)
def place_of(m, n):
    """Touched place of a contact after :func:`fill_contact` [m], global; for flanks that of the second section."""
    place, push = section_place(m, m.acts[act_of(m, n), ON]), row_wrench(m, row_at(m, n), 1)
    radius = m.w[law_at(m, n) + RADIUS_AT]
    z = place[2] - radius * push[2] if width(m) == 6 else 0.0
    return place[0] - radius * push[0], place[1] - radius * push[1], z


@njit(**OPTIONS)
def fill_contact(m, n):
    """Row and numbers of a contact or switch, and their place; nothing else is changed.

    A released contact exerts no force and loses its stored energy. One at rest under Newton's law exerts the reaction
    of its row, an unknown.
    """
    w, k, j, row, law = m.w, at(m, n), law_at(m, n), row_length(m) * row_at(m, n), m.acts[act_of(m, n), LAW]
    w[k + FORCE] = w[k + STORED] = 0.0
    if is_switch(m, n):
        _fill_switch(m, n)
        return k
    fill_row(m, n)
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
    return k


@if_changes(None)
@njit(**OPTIONS)
def apply_contact_forces(m):
    """Contact forces of closed contacts on their sections, with the numbers of all contacts and switches."""
    no_inline()
    for n in range(contacts(m)):
        force = m.w[fill_contact(m, n) + FORCE]
        if force != 0.0:
            for side in range(2):
                push(m, m.acts[act_of(m, n), AT + side], scaled(force, row_wrench(m, row_at(m, n), side)))


@if_impacts(None)
@njit(**OPTIONS)
def fill_rest_rows(m):
    """Rows of contacts at rest under Newton's law: gap, rate, acceleration, and Jacobians."""
    no_inline()
    for n in range(contacts(m)):
        if is_at_rest(m, n):
            fill_contact(m, n)
