"""Energies of a mechanism, and the powers whose time integrals are its works."""

from __future__ import annotations

from numba import njit

from kaneflex.generated import shapes, spatial_shapes
from kaneflex.multibody.compile.stand_ins import of_stiffness
from kaneflex.multibody.compile.values import by_size, twists
from kaneflex.multibody.unilateral import frictions, rows
from kaneflex.multibody.dynamics.algebra import dot, plus, times
from kaneflex.multibody.dynamics.axes import to_axes, to_global
from kaneflex.multibody.dynamics.courses import courses
from kaneflex.multibody.dynamics.inverse_dynamics import RIGID, RIGID_PLANAR, rigid_inertia
from kaneflex.multibody.dynamics.interactions import spring_size, unit_wrench
from kaneflex.multibody.dynamics.kinematics import twist_at_section
from kaneflex.multibody.compile.types import OPTIONS, apart
from kaneflex.multibody.model.layout import (
    AT, BODIES, CONTACTS, COURSE, COURSE_AT, CUTS, DRIVES, LOADS, MODAL, ON, POWER, PRESCRIBED, PUSHED, PUSHES,
    ROW_AT, SPRINGS, SQUARE, STORED, WORKS,
)  # fmt: skip
from kaneflex.multibody.model.layout import SHAPES as COUNTED
from kaneflex.multibody.model.tree_layout import BODY, COUNT, KIND, SHAPES, SPEED


@njit(**OPTIONS)
def _energies_of_body(m, n):
    """Add those of a node's body; in the plane gravity has no third component."""
    rigid_inertia(m, n)
    o, energies, block = m.nodes[n, BODY], m.energies, m.block
    twist, centre = to_axes(m, n, m.twist[n]), (block[o + 1], block[o + 2], block[o + 3])
    energies[0] += 0.5 * dot(twist, times(twists(m, m.x), twist))
    energies[2] -= block[o] * dot(m.gravity[0], plus(m.r[n], to_global(m, n, centre)))
    if m.nodes[n, KIND] == SHAPES:
        _energies_of_shapes(m, n)


_SUMS = 10
"""Place in x of energies and first moment of a body's shapes."""


@of_stiffness(None)
@njit(**OPTIONS)
def _energies_of_shapes(m, n):
    x = m.x
    twists(m, x)[0] = to_axes(m, n, m.twist[n])
    for k in range(_SUMS, _SUMS + 5):
        x[k] = 0.0
    _shaped_energy(m, n, m.nodes[n, COUNT], m.nodes[n, SPEED])
    m.energies[0] += x[_SUMS]
    m.energies[1] += x[_SUMS + 1]
    m.energies[2] -= dot(to_axes(m, n, m.gravity[0]), (x[_SUMS + 2], x[_SUMS + 3], x[_SUMS + 4]))


@njit(**OPTIONS)
def _shaped_energy(m, n, count, i):
    shapes.shaped_energy(m.block, m.nodes[n, BODY] + RIGID_PLANAR, count, m.x, 0, m.y, m.u, i, m.x, _SUMS)


@njit(**OPTIONS)
def _shaped_energy_in_space(m, n, count, i):
    spatial_shapes.shaped_energy(m.block, m.nodes[n, BODY] + RIGID, count, m.x, 0, m.y, m.u, i, m.x, _SUMS)


_shaped_energy = by_size(_shaped_energy, _shaped_energy_in_space)


@njit(**OPTIONS)
def energies(m):
    """Kinetic energy, strain energy, and potential energy of the weight, after ``demand``."""
    apart()
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
    apart()
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
    """Powers [W] at POWER, after :func:`demand`: dissipation without contacts and friction, loads, drives, holds,
    contacts."""
    apart()
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
