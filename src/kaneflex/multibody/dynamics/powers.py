"""Energies of a mechanism, and the powers whose time integrals are its works."""

from __future__ import annotations

from numba import njit

from kaneflex.generated import body
from kaneflex.multibody.unilateral import friction_powers, lugre_step
from kaneflex.multibody.dynamics.forces import load_direction
from kaneflex.multibody.compile.values import by_size
from kaneflex.multibody.dynamics import spatial_tree
from kaneflex.multibody.dynamics.courses import courses
from kaneflex.multibody.model.layout import (
    ACTS, AT, BLOCK, BODIES, CONTACT, CONTACTS, CONTACT_SIZE, COURSE, COURSE_AT, CUTS, DAMPED, DEMAND, DRIVES, ELASTIC,
    FRAME, FRAME_SIZE, GAP_RATE, GRAVITY, LOADS, LOSING, MODAL, NOW, ON, OPTIONS, POWER, PRESCRIBED, PUSH_NOW, RATE,
    ROW_AT, SEC, SECTION, SHAPES, SIZE, SPRING, SPRINGS, SPRING_SIZE, SUMS, TORQUE, WHAT, WORKS, Y, apart, shifted,
)  # fmt: skip


@njit(**OPTIONS)
def energies(m):
    """At SUMS: kinetic energy, strain energy, dissipated power, and potential energy of the weight."""
    apart()
    plan, w = m.plan, m.w
    at = plan[SUMS]
    for k in range(4):
        w[at + k] = 0.0
    sums = shifted(w, at)
    for b in range(plan[BODIES]):
        f, o = plan[FRAME] + FRAME_SIZE * b, m.bodies[b, BLOCK]
        x, z = body.energy(
            w, o, shifted(w, plan[Y]), shifted(w, plan[RATE]), m.bodies[b, MODAL], w[f + 3],
            w[f + 4], w[f + 5], w[f + 6], w[f + 7], sums,
        )  # fmt: skip
        w[at + 3] -= w[plan[GRAVITY]] * (w[o] * w[f] + x) + w[plan[GRAVITY] + 1] * (w[o] * w[f + 1] + z)
    for n in range(plan[CONTACTS] - plan[SPRINGS]):
        k = plan[SPRING] + SPRING_SIZE * n
        w[at + 1] += w[k + 4]
        w[at + 2] += w[k + 5]
    for n in range(plan[ACTS] - plan[CONTACTS]):
        k = plan[CONTACT] + CONTACT_SIZE * n
        w[at + 1] += w[k + ELASTIC]
        w[at + 2] += w[k + LOSING]
    w[at] -= friction_powers.not_moved(m)
    w[at + 1] += lugre_step.stored(m)
    w[at + 2] += friction_powers.lost(m)


@njit(**OPTIONS)
def losses(m, out):
    """Powers [W] at ``out``: dissipation, loads, and after the drives holds and contacts.

    The loss of a contact is its work less its stored energy, since the loss itself is not smooth near zero depth.
    """
    apart()
    plan, w, acts = m.plan, m.w, m.acts
    lost = 0.0
    for b in range(plan[BODIES]):
        size, rates, c = m.bodies[b, SHAPES], plan[RATE] + m.bodies[b, MODAL], m.bodies[b, DAMPED]
        for i in range(size):
            total = 0.0
            for j in range(size):
                total += w[c + size * i + j] * w[rates + j]
            lost += w[rates + i] * total
    for n in range(plan[CONTACTS] - plan[SPRINGS]):
        lost += w[plan[SPRING] + SPRING_SIZE * n + 5]
    contacts = plan[ACTS] - plan[CONTACTS]
    for n in range(contacts):
        k = plan[CONTACT] + CONTACT_SIZE * n
        w[out + plan[WORKS] - contacts + n] = -w[k + PUSH_NOW] * w[k + GAP_RATE]
    friction_powers.losses(m, out + plan[WORKS] - contacts)
    w[out] = lost
    for n in range(plan[LOADS], plan[SPRINGS]):
        size = w[plan[SIZE] + n - plan[LOADS]]
        one, two = plan[SECTION] + SEC * acts[n, AT], plan[SECTION] + SEC * acts[n, ON]
        if acts[n, WHAT] == TORQUE:
            rate = w[two + 5] - w[one + 5]
        else:
            x, z = load_direction(m, n)
            rate = x * w[one + 3] + z * w[one + 4]
        w[out + 1 + n - plan[LOADS]] = size * rate


losses = by_size(losses, spatial_tree.losses)


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
            w[out + k] = w[plan[DEMAND] + plan[plan[PRESCRIBED] + k]] * w[plan[COURSE] + 3 * k + 1]
    for n in range(plan[CUTS], plan[DRIVES]):
        if acts[n, COURSE_AT] >= 0:
            rate = w[plan[COURSE] + 3 * acts[n, COURSE_AT] + 1]
            w[out + acts[n, COURSE_AT]] = w[plan[NOW] + acts[n, ROW_AT]] * rate
