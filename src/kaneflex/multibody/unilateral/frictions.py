"""Frictions of joints and contacts: their rows, how they stick and slip, their forces, and what counts as zero; results
of all rows."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import friction as laws
from kaneflex.multibody.compile.stand_ins import if_contacts, if_frictions
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline
from kaneflex.multibody.compile.values import row_length, width
from kaneflex.multibody.dynamics.algebra import (
    absolute, angular_size, axpy, cross, dot, first, linear_size, plus, scaled, zero_like,
)  # fmt: skip
from kaneflex.multibody.dynamics.kinematics import section_motion
from kaneflex.multibody.dynamics.wrenches import row_wrench
from kaneflex.multibody.model.layout import (
    ACROSS, ALONG, AT, BENDING, BODIES, DUE, EXTENT, FIRMEST, FLANK, FLOWING, FORCE, GAP, GAP_RATE, LIMIT, MEMORY, MODE,
    NORMAL, ON, OPEN, PLACE, RESULTS, ROW_AT, SLIP, SLIPPING, SLIP_RATE, STICKING, STORED, TOUCH, TURN, WHAT,
)  # fmt: skip
from kaneflex.multibody.model.tree_layout import BODY
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.relative_rows import (
    as_force, fill_row, fixed_wrench, reference_axis, row_scale, turn_rate,
)  # fmt: skip
from kaneflex.multibody.unilateral.rows import (
    ARM, END_AT, EPS, MU_AT, OF_AT, SLOWEST, VISCOUS_AT, across, act_of, at, contact_of, contacts, frictions, in_impact,
    is_idle, law_at, magnitude, row_at, second_row, slip_sign,
)  # fmt: skip


NOISE = 1e-12
"""Rounding error of cancelling speeds and accelerations, relative to them."""
CLOSE = 1e-11
"""Share of the largest holding force within which it counts as reached."""
WRONG = 1e-9
"""Share of neighbouring accelerations above which one against the slip is not rounding."""


@njit(**OPTIONS)
def fill_friction(m, n):
    """Row of a friction at the current state, after that of its contact; returns the place of its numbers."""
    no_inline()
    w, k, row, rows = m.w, at(m, n), row_length(m) * row_at(m, n), m.rows
    fill_row(m, n)
    w[k + PLACE], w[k + SLIP], w[k + SLIP_RATE] = rows[row], rows[row + 1], rows[row + 2]
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
def zero_speed(m, n, t):
    """Speed of a friction that counts as zero."""
    w, k = m.w, at(m, n)
    return SLOWEST * row_scale(m, n) + 8.0 * EPS * (size_of(m, n, 0) + abs(t * w[k + SLIP_RATE])) + 1e-300


@njit(**OPTIONS)
def _gravity_size(m):
    """Sum of the sizes of gravity's components."""
    g = absolute(m.gravity[0])
    return g[0] + g[1] + g[2]


@njit(**OPTIONS)
def zero_friction(m, n):
    """Force, or moment, of a friction that counts as zero: rounding error of the force that moves all bodies."""
    no_inline()
    plan, w, total = m.plan, m.w, 0.0
    for b in range(plan[BODIES]):
        node = m.frames[b, 0]
        if m.nodes[node, BODY] >= 0:
            total += m.block[m.nodes[node, BODY]] * (_gravity_size(m) + linear_size(m.rate[node]))
    return 1e-14 * total * (w[plan[TOUCH] + EXTENT] if m.acts[act_of(m, n), WHAT] == TURN else 1.0) + 1e-300


@njit(**OPTIONS)
def zero_acceleration(m, n):
    """Acceleration of a friction that counts as zero."""
    return WRONG * (size_of(m, n, 1) + _gravity_size(m)) + 1e-300


@njit(**OPTIONS)
def motion_size(m, n, rate):
    """Size of the velocities (0) or accelerations (1) of a row's two sections; for flanks that of their rotation.

    Rates of gaps are differences of these, whatever their direction: all are from one solution of the equations.
    """
    act = act_of(m, n)
    one, two = section_motion(m, m.acts[act, AT], rate), section_motion(m, m.acts[act, ON], rate)
    if m.acts[act, WHAT] == FLANK:
        return angular_size(one) + angular_size(two)
    return linear_size(one) + linear_size(two)


@njit(**OPTIONS)
def stick(m, n):
    """Let a friction stick where it is."""
    if second_row(m, n):
        _set_direction(m, n, 1.0, 0.0)
    else:
        m.w[at(m, n) + MEMORY] = m.w[at(m, n) + PLACE]
    set_mode(m, n, STICKING)


@njit(**OPTIONS)
def slip(m, n, direction, beside):
    """Let a friction slip, by the sign of the direction; in a tangent plane along both components."""
    _set_direction(m, n, direction, beside)
    set_mode(m, n, SLIPPING)


@njit(**OPTIONS)
def set_mode(m, n, mode):
    """Set the mode of a friction, also of its second row."""
    m.w[at(m, n) + MODE], other = mode, second_row(m, n)
    if other:
        m.w[at(m, other) + MODE] = FLOWING if mode == SLIPPING else mode


@njit(**OPTIONS)
def open_with_contact(m, n):
    """True if a friction belongs to an open contact, which exerts no force; its bristles relax."""
    w, k, of = m.w, at(m, n), contact_of(m, n)
    if of < 0 or w[at(m, of) + MODE] != OPEN:
        return False
    set_mode(m, n, OPEN)
    w[k + MEMORY], w[k + FIRMEST] = 0.0, 0.0
    return True


@njit(**OPTIONS)
def _set_direction(m, n, direction, beside):
    """Store a direction of slip: its sign, or turn both rows to it."""
    other = second_row(m, n)
    if width(m) == 3 or other == 0:
        m.w[at(m, n) + MEMORY] = 1.0 if direction >= 0.0 else -1.0
        return
    e, beside_e = first(row_wrench(m, row_at(m, n), 1)), first(row_wrench(m, row_at(m, other), 1))
    e = axpy(beside, beside_e, scaled(direction if direction != 0.0 or beside != 0.0 else 1.0, e))
    normal, axis = first(row_wrench(m, row_at(m, contact_of(m, n)), 1)), int(m.w[law_at(m, n)])
    k, least = 0, 2.0
    for i in range(3):  # the one that is farthest from the normal
        if abs(dot(m.axes[axis + i], normal)) < least - 1e-3:
            k, least = i, abs(dot(m.axes[axis + i], normal))
    flat = reference_axis(m, n, normal, k)
    m.w[at(m, other) + MEMORY], m.w[at(m, n) + MEMORY] = k, math.atan2(dot(e, cross(normal, flat)), dot(e, flat))
    fill_friction(m, other)
    fill_friction(m, n)


@njit(**OPTIONS)
def normal_force(m, n):
    """Normal force of a friction [N or N m]: its contact's force, or that of the joint's reactions in NOW."""
    w, what, arm = m.w, m.acts[act_of(m, n), WHAT], m.w[law_at(m, n) + ARM]
    if what >= ALONG:
        return larger(w[at(m, contact_of(m, n)) + FORCE], 0.0)
    one, two = bearing_forces(m, n, joint_wrench(m, n))
    total = math.sqrt(dot(one, one)) + math.sqrt(dot(two, two))
    return arm * total if what == TURN else total


@njit(**OPTIONS)
def bearing_forces(m, n, wrench):
    """Parts of a joint's wrench at both ends of a guide's block, across its direction; for a pin the force in two equal
    parts."""
    along = fixed_wrench(m, n, 0.0, 0)
    half = as_force(m, scaled(0.5, axpy(-dot(along, wrench), along, wrench)))
    if m.acts[act_of(m, n), WHAT] == TURN:
        return half, half
    apart_ = scaled(0.5 * m.w[law_at(m, n) + ARM], turn_rate(wrench, along))  # moment x direction
    return plus(half, apart_), axpy(-1.0, apart_, half)


@if_frictions(0)
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
    for row in range(m.acts[int(m.w[law_at(m, n) + OF_AT]), ROW_AT], int(m.w[law_at(m, n) + END_AT])):
        total = axpy(m.multipliers[row], row_wrench(m, row, 1), total)
    return total


@njit(**OPTIONS)
def dry(m, n, N, v):
    """Dry friction at a speed [N or N m]; its impulse by one, without preload and Stribeck's part."""
    return m.w[law_at(m, n) + MU_AT] * N if in_impact(m) else laws.dry(m.w, law_at(m, n), N, v)


@if_frictions(None)
@njit(**OPTIONS)
def apply_friction(m):
    """Force, or impulse, of every friction at the current state, also at NOW, with its energy.

    Contacts are evaluated before.
    """
    no_inline()
    w = m.w
    for n in range(-frictions(m), 0):
        k, j = fill_friction(m, n), law_at(m, n)
        row, v, mode = row_at(m, n), 0.0 if in_impact(m) else w[k + SLIP], w[k + MODE]
        N = normal_force(m, n)
        w[k + NORMAL], w[k + LIMIT] = N, dry(m, n, N, 0.0) if in_impact(m) else laws.limit(w, j, N)
        if mode == OPEN or is_idle(m, n):
            m.multipliers[row] = 0.0
        elif mode == FLOWING:
            m.multipliers[row] = -w[j + VISCOUS_AT] * v
        elif mode == SLIPPING and second_row(m, n) and not in_impact(m):
            _slip_in_plane(m, n, N)
        elif mode == SLIPPING:
            m.multipliers[row] = -slip_sign(m, n) * dry(m, n, N, v) - w[j + VISCOUS_AT] * v
        w[k + FORCE], w[k + STORED] = m.multipliers[row], 0.0
        if mode == BENDING:
            w[k + STORED] = 0.5 * w[j + lugre.STIFFNESS_AT] * w[k + MEMORY] * w[k + MEMORY]


@njit(**OPTIONS)
def sliding_size(m, n):
    """Slip speed by which both components of a friction's force are divided, never zero."""
    return math.hypot(abs(m.w[at(m, n) + SLIP]) + SLOWEST * row_scale(m, n), across(m, n, SLIP))


@njit(**OPTIONS)
def _slip_in_plane(m, n, N):
    """Both components of a slipping friction's force, against the slip in the tangent plane.

    Beyond a zero of its first component the force continues without reversal, as with one row.
    """
    w, j, k, other = m.w, law_at(m, n), at(m, n), at(m, second_row(m, n))
    v, beside, least = w[k + SLIP], w[other + SLIP], SLOWEST * row_scale(m, n)
    if w[k + DUE] < 0.0:  # both are rounding
        v = beside = 0.0
    share = laws.dry(w, j, N, math.hypot(v, beside)) / math.hypot(abs(v) + least, beside)
    m.multipliers[row_at(m, n)] = -share * (abs(v) + least) - w[j + VISCOUS_AT] * v
    w[other + FORCE] = -share * (beside if v >= 0.0 else -beside) - w[j + VISCOUS_AT] * beside
    m.multipliers[row_at(m, second_row(m, n))] = w[other + FORCE]


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


@if_contacts(None)
@njit(**OPTIONS)
def record(m):
    """Store the results of every row with an instant, frictions first: gap or position, rate, force, normal force,
    stored energy, MODE and MEMORY; for a friction with two rows sizes, and with the second one the force's
    components."""
    w, i, out = m.w, 0, m.touching
    for n in range(-frictions(m), contacts(m)):
        k = at(m, n)
        out[i], out[i + 1], out[i + 2] = w[k + GAP], w[k + GAP_RATE], w[k + FORCE]
        if n < 0 and m.acts[act_of(m, n), WHAT] == ACROSS:
            out[i], out[i + 1], out[i + 2] = _force_of(m, n)
        elif n < 0 and second_row(m, n):
            out[i + 1], out[i + 2] = magnitude(m, n, SLIP), magnitude(m, n, FORCE)
        out[i + 3] = w[k + (NORMAL if n < 0 else FORCE)]
        out[i + 4], out[i + 5], out[i + 6] = w[k + STORED], w[k + MODE], w[k + MEMORY]
        i += RESULTS
