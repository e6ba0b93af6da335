"""Energies of a mechanism, and the powers whose time integrals are its works."""

from __future__ import annotations

from numba import njit

from kaneflex.generated import body
from kaneflex.multibody.unilateral import rows
from kaneflex.multibody.dynamics.algebra import dot
from kaneflex.multibody.dynamics.courses import courses
from kaneflex.multibody.dynamics.interactions import spring_size, unit_wrench
from kaneflex.multibody.dynamics.kinematics import twist_at_section
from kaneflex.multibody.model.layout import (
    AT, BODIES, CONTACTS, COURSE, COURSE_AT, CUTS, DRIVES, LOADS, LOSING, MODAL, ON, OPTIONS, POWER, PRESCRIBED, PUSHED,
    PUSHES, ROW_AT, SHAPES, SPRINGS, SQUARE, STORED, SUMS, WORKS, apart, shifted,
)  # fmt: skip
from kaneflex.multibody.model.tree_layout import BODY


@njit(**OPTIONS)
def energies(m):
    """At SUMS: kinetic energy, strain energy, dissipated power, and potential energy of the weight."""
    apart()
    plan, w = m.plan, m.w
    at = plan[SUMS]
    for k in range(4):
        w[at + k] = 0.0
    sums = shifted(w, at)
    g_x, g_y, _ = m.gravity[0]
    for b in range(plan[BODIES]):
        n = m.frames[b, 0]
        o = m.nodes[n, BODY]
        c, s, _ = m.R[n]
        r_x, r_y, _ = m.r[n]
        v_x, v_y, omega = m.twist[n]
        mass = m.block[o]
        x, z = body.energy(m.block, o, m.y, m.u, m.bodies[b, MODAL], c, s, v_x, v_y, omega, sums)
        w[at + 3] -= g_x * (mass * r_x + x) + g_y * (mass * r_y + z)
    for n in range(plan[CONTACTS] - plan[SPRINGS]):
        k = spring_size(m) * n
        w[at + 1] += m.springs[k + 4]
        w[at + 2] += m.springs[k + 5]
    for n in range(-rows.frictions(m), rows.contacts(m)):
        w[at + 1] += w[rows.at(m, n) + STORED]
        w[at + 2] += w[rows.at(m, n) + LOSING]


@njit(**OPTIONS)
def losses(m, out):
    """Powers [W] at ``out``: dissipation, loads, and after the drives frictions and contacts.

    The loss of a contact is its work less its stored energy, since the loss itself is not smooth near zero depth.
    """
    apart()
    plan, w, acts = m.plan, m.w, m.acts
    lost = 0.0
    for b in range(plan[BODIES]):
        size, first, square = m.bodies[b, SHAPES], m.bodies[b, MODAL], m.bodies[b, SQUARE]
        for i in range(size):
            total = 0.0
            for j in range(size):
                total += m.C[square + size * i + j] * m.u[first + j]
            lost += m.u[first + i] * total
    for n in range(plan[SPRINGS], plan[CONTACTS]):
        lost += m.springs[spring_size(m) * (n - plan[SPRINGS] + 1) - 1]
    for n in range(-rows.frictions(m), rows.contacts(m)):
        w[out + plan[WORKS] - rows.contacts(m) + n] = rows.power(m, n)
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
