"""Energies of a mechanism, and the powers whose time integrals are its works."""

from __future__ import annotations

from numba import njit

from kaneflex.generated import shapes, spatial_shapes
from kaneflex.multibody.compile.stand_ins import if_stiffness
from kaneflex.multibody.compile.values import after, by_size, twists, width
from kaneflex.multibody.unilateral import frictions, rows
from kaneflex.multibody.dynamics.algebra import dot, times
from kaneflex.multibody.dynamics.axes import to_axes
from kaneflex.multibody.dynamics.courses import courses
from kaneflex.multibody.dynamics.inverse_dynamics import RIGID, RIGID_PLANAR, own_inertia
from kaneflex.multibody.dynamics.interactions import spring_size, unit_wrench
from kaneflex.multibody.dynamics.kinematics import twist_at_section
from kaneflex.multibody.compile.types import OPTIONS, no_inline
from kaneflex.multibody.model.layout import (
    AT, BODIES, CONTACTS, COURSE, COURSE_AT, CUTS, DRIVES, LOADS, MODAL, ON, POWER, PRESCRIBED, PUSHED, PUSHES, ROW_AT,
    SPRINGS, SQUARE, STORED, WORKS,
)  # fmt: skip
from kaneflex.multibody.model.layout import SHAPES as COUNTED
from kaneflex.multibody.model.tree_layout import BODY, COUNT, KIND, SHAPES, SPEED


@njit(**OPTIONS)
def _energies_of_body(m, n):
    """Add those of a node's body by its mass matrix, whose first moments are about the node's origin."""
    own_inertia(m, n)
    energies, twist = m.energies, to_axes(m, n, m.twist[n])
    energies[0] += 0.5 * dot(twist, times(twists(m, m.x), twist))
    energies[2] -= m.block[m.nodes[n, BODY]] * dot(m.gravity[0], m.r[n])
    energies[2] -= dot(to_axes(m, n, m.gravity[0]), _first_moments(m, n))
    if m.nodes[n, KIND] == SHAPES:
        _energies_of_shapes(m, n, twist)


@njit(**OPTIONS)
def _first_moments(m, n):
    """First moments of mass [kg m] in a mass matrix at x; in the plane gravity has no third component."""
    return m.x[5], -m.x[2], 0.0


@njit(**OPTIONS)
def _first_moments_in_space(m, n):
    return m.x[11], m.x[15], m.x[4]


@if_stiffness(None)
@njit(**OPTIONS)
def _energies_of_shapes(m, n, twist):
    """Kinetic energy of a body's shapes, and with its motion, by its mass matrix at x; strain energy."""
    d, count, i, total = width(m), m.nodes[n, COUNT], m.nodes[n, SPEED], 0.0
    E, L = after(twists(m, m.x), d), after(m.x, d * (d + count))
    for j in range(count):
        along = dot(E[j], twist)
        for k in range(count):
            along += 0.5 * L[count * j + k] * m.u[i + k]
        total += along * m.u[i + j]
    m.energies[0] += total
    m.energies[1] += _strain(m, n, count, i)


@njit(**OPTIONS)
def _strain(m, n, count, i):
    return shapes.shaped_strain(m.block, m.nodes[n, BODY] + RIGID_PLANAR, count, m.y, i)


@njit(**OPTIONS)
def _strain_in_space(m, n, count, i):
    return spatial_shapes.shaped_strain(m.block, m.nodes[n, BODY] + RIGID, count, m.y, i)


_strain, _first_moments = by_size(_strain, _strain_in_space), by_size(_first_moments, _first_moments_in_space)


@njit(**OPTIONS)
def energies(m):
    """Kinetic energy, strain energy, and potential energy of the weight, after ``demand``."""
    no_inline()
    plan = m.plan
    for k in range(3):
        m.energies[k] = 0.0
    for b in range(plan[BODIES]):
        n = m.frames[b, 0]
        if m.nodes[n, BODY] >= 0:
            _energies_of_body(m, n)
    for n in range(1, plan[CONTACTS] - plan[SPRINGS] + 1):
        m.energies[1] += m.springs[spring_size(m) * n - 2]
    for n in range(-rows.frictions(m), rows.contacts(m)):
        m.energies[1] += m.w[rows.at(m, n) + STORED]


@njit(**OPTIONS)
def losses(m, out):
    """Powers [W] at ``out``: dissipation, loads, and after the drives frictions and contacts.

    The loss of a contact is its work less its stored energy, since the loss itself is not smooth near zero depth.
    """
    no_inline()
    plan, w, acts = m.plan, m.w, m.acts
    lost = 0.0
    for b in range(plan[BODIES]):
        size, modal, square = m.bodies[b, COUNTED], m.bodies[b, MODAL], m.bodies[b, SQUARE]
        for i in range(size):
            total = 0.0
            for j in range(size):
                total += m.C[square + size * i + j] * m.u[modal + j]
            lost += m.u[modal + i] * total
    for n in range(plan[SPRINGS], plan[CONTACTS]):
        lost += m.springs[spring_size(m) * (n - plan[SPRINGS] + 1) - 1]
    for n in range(-rows.frictions(m), rows.contacts(m)):
        w[out + plan[WORKS] - rows.contacts(m) + n] = frictions.power(m, n)
    w[out] = lost
    for n in range(plan[SPRINGS] - plan[LOADS]):
        w[out + 1 + n] = 0.0
    for n in range(plan[PUSHES], plan[PUSHED]):
        unit, load = unit_wrench(m, n), acts[n, COURSE_AT]
        rate = dot(unit, twist_at_section(m, acts[n, ON])) - dot(unit, twist_at_section(m, acts[n, AT]))
        w[out + 1 + load] += m.sizes[load] * rate


@njit(**OPTIONS)
def powers(m):
    """Powers [W] at POWER, after :func:`demand`: dissipation without contacts and friction, loads, drives, frictions,
    contacts."""
    no_inline()
    plan, w, acts = m.plan, m.w, m.acts
    losses(m, plan[POWER])
    out = plan[POWER] + 1 + plan[SPRINGS] - plan[LOADS]
    for k in range(courses(m)):
        if plan[plan[PRESCRIBED] + k] >= 0:
            w[out + k] = m.h[plan[plan[PRESCRIBED] + k]] * w[plan[COURSE] + 3 * k + 1]
    for n in range(plan[CUTS], plan[DRIVES]):
        if acts[n, COURSE_AT] >= 0:
            rate = w[plan[COURSE] + 3 * acts[n, COURSE_AT] + 1]
            w[out + acts[n, COURSE_AT]] = m.multipliers[acts[n, ROW_AT]] * rate
