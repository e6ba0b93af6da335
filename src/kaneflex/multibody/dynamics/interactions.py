"""Springs, loads and reactions of cuts between sections, in the plane and in space: one name, chosen by the tables.

A wrench at a section has D numbers, a force and a moment, like a twist.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import joints as planar_laws
from kaneflex.generated import spatial as spatial_laws
from kaneflex.multibody.compile.values import by_size, width
from kaneflex.multibody.dynamics.algebra import axpy, cross, dot, joined, minus, scaled, zero_like
from kaneflex.multibody.dynamics.forces import load_sizes
from kaneflex.multibody.dynamics.bushings import fill_bushing
from kaneflex.multibody.dynamics.kinematics import section_place, twist_at_section
from kaneflex.multibody.dynamics.wrenches import along, push, row_wrench
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, turned
from kaneflex.multibody.model.layout import (
    AT, BUSHING, CONTACTS, COURSE_AT, CUTS, CUT_OF, CUT_ROWS, DRIVES, FOLLOWER, NUMBERS_AT, ON, PUSHED, PUSHES, ROW_AT,
    SPRING, SPRINGS, STRAIGHT, TORQUE, TORSIONAL, WHAT,
)  # fmt: skip
from kaneflex.multibody.unilateral.frictions import apply_friction
from kaneflex.multibody.unilateral.relative_rows import apply_contact_forces
from kaneflex.support.inner import once


@njit(**OPTIONS)
def unit_wrench(m, act):
    """Wrench on the second section for a unit of a load or of a spring's tension; the opposite acts on the first."""
    w, what, first, second = m.w, m.acts[act, WHAT], m.acts[act, AT], m.acts[act, ON]
    if what >= TORQUE:
        return 0.0, 0.0, 1.0
    if what == STRAIGHT:
        x, z, _ = minus(section_place(m, second), section_place(m, first))
        length = larger(math.sqrt(x * x + z * z), 1e-300)
        return x / length, z / length, 0.0
    theta = section_place(m, m.acts[act, ROW_AT])[2] if what == FOLLOWER else 0.0
    x, z = turned(w, theta, m.acts[act, NUMBERS_AT])
    return x, z, 0.0


@njit(**OPTIONS)
def _unit_wrench_6(m, act):
    what, nothing = m.acts[act, WHAT], (0.0, 0.0, 0.0)
    if what == STRAIGHT:
        d = minus(section_place(m, m.acts[act, ON]), section_place(m, m.acts[act, AT]))
        return joined(scaled(1.0 / larger(math.sqrt(dot(d, d)), 1e-300), d), nothing)
    axis = m.axes[m.acts[act, ROW_AT]]
    if what >= TORQUE:
        return joined(nothing, axis)
    return joined(axis, nothing)


@njit(**OPTIONS)
def spring_size(m):
    """Numbers of a spring: length or angle, tension or torque, force, energy [J], dissipated power [W]."""
    return 5 + width(m) // 3


@njit(**OPTIONS)
def fill_spring(m, act, k):
    """Fill the numbers of a spring at w[k]; returns its wrench on the second section."""
    w, j, first, second = m.w, m.acts[act, NUMBERS_AT], m.acts[act, AT], m.acts[act, ON]
    if m.acts[act, WHAT] == TORSIONAL:
        planar_laws.twist(m.sections, first, second, w[j], w[j + 1], w[j + 2], w, k)
        return 0.0, 0.0, -w[k + 1]
    planar_laws.pull(m.sections, first, second, w[j], w[j + 1], w[j + 2], w, k)
    return w[k + 2], w[k + 3], 0.0


@njit(**OPTIONS)
def _fill_spring_6(m, act, k):
    w, j, what, first, second = m.w, m.acts[act, NUMBERS_AT], m.acts[act, WHAT], m.acts[act, AT], m.acts[act, ON]
    if what == STRAIGHT:
        spatial_laws.pull(m.sections, first, second, w[j], w[j + 1], w[j + 2], w, k)
        return w[k + 2], w[k + 3], w[k + 4], 0.0, 0.0, 0.0
    unit = unit_wrench(m, act)
    if what == TORSIONAL:  # at a joint of the tree, whose coordinate counts turns
        w[k] = m.y[m.acts[act, COURSE_AT]]
        angle, rate = w[k] - w[j + 2], dot(unit, axpy(-1.0, twist_at_section(m, first), twist_at_section(m, second)))
        w[k + 1], w[k + 5], w[k + 6] = w[j] * angle + w[j + 1] * rate, 0.5 * w[j] * angle**2, w[j + 1] * rate**2
    elif what == BUSHING:
        fill_bushing(m, act, k)
    force = scaled(w[k + 1], unit)
    if what < TORQUE:  # of a bushing, whose force acts at the second point on both sides
        away = minus(section_place(m, second), section_place(m, first))
        push(m, first, joined((0.0, 0.0, 0.0), cross(away, (force[0], force[1], force[2]))))
    return scaled(-1.0, force)


unit_wrench, fill_spring = by_size(unit_wrench, _unit_wrench_6), by_size(fill_spring, _fill_spring_6)


@once
@njit(**OPTIONS)
def _push_both(m, act, wrench):
    """Subtract a wrench on the second section of an act, and the opposite on the first, from the inertia forces."""
    push(m, m.acts[act, ON], wrench)
    push(m, m.acts[act, AT], scaled(-1.0, wrench))


@once
@njit(**OPTIONS)
def along_both(m, act, wrench, bends, out):
    """Add their generalised forces along all coordinates at ``out``; shapes only if requested."""
    along(m, m.acts[act, ON], wrench, bends, out)
    along(m, m.acts[act, AT], scaled(-1.0, wrench), bends, out)


@njit(**OPTIONS)
def apply_interactions(m, t):
    """Subtract loads, springs and contacts from the inertia forces."""
    no_inline()
    plan, acts = m.plan, m.acts
    load_sizes(m, t)
    for n in range(plan[PUSHES], plan[PUSHED]):
        _push_both(m, n, scaled(m.sizes[acts[n, COURSE_AT]], unit_wrench(m, n)))
    for n in range(plan[SPRINGS], plan[CONTACTS]):
        _push_both(m, n, fill_spring(m, n, plan[SPRING] + spring_size(m) * (n - plan[SPRINGS])))
    apply_contact_forces(m)
    apply_friction(m)


@njit(**OPTIONS)
def apply_reactions(m):
    """Subtract the reactions of the cuts from the inertia forces."""
    no_inline()
    plan, acts = m.plan, m.acts
    for n in range(plan[CUTS], plan[DRIVES]):
        first, end = acts[n, ROW_AT], acts[n + 1, ROW_AT] if n + 1 < plan[DRIVES] else plan[CUT_ROWS]
        for side in range(2):
            wrench = zero_like(row_wrench(m, first, side))
            for row in range(first, end):
                wrench = axpy(m.multipliers[row], row_wrench(m, row, side), wrench)
            push(m, acts[n, AT + side], wrench)


@once
@njit(**OPTIONS)
def gradient(m, row, bends, out):
    """Add the derivatives of a cut joint's row with respect to all coordinates at ``out``; shapes only if requested."""
    no_inline()
    cut = m.plan[m.plan[CUT_OF] + row]
    for side in range(2):
        along(m, m.acts[cut, AT + side], row_wrench(m, row, side), bends, out)
