"""The compiled law of bushings in space: six springs and dampers along and about the axes of their first side."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline
from kaneflex.multibody.dynamics.algebra import axpy, by_axis, cross, dot, last, minus, plus, scaled, turned, twist_at
from kaneflex.multibody.dynamics.kinematics import section_place, twist_at_section
from kaneflex.multibody.model.layout import AT, NUMBERS_AT, ON, ROW_AT
from kaneflex.support.inner import once

SIZE = 7
"""Numbers of a spring's row. A bushing has six, with its forces and moments along and about its axes [N, N m] for
tensions; the first one has its angle of rotation [rad] for a length, its energy [J] and dissipated power [W]."""
_NO_ANGLE = 1e-8
_HALF_TURN = 1e-6
"""Cosine of half the largest rotation, which is just below half a turn."""


@once
@njit(**OPTIONS)
def fill_bushing(m, act, row):
    """Fill the rows of a bushing at w[row], where ``move`` was.

    d is where the second point is against the first, and phi the rotation vector of the second side's axes, both in
    those of the first, E; phi' = H omega with the relative angular velocity omega there, and (Sola,
    Deray & Atchuthan 2018, arXiv:1812.01537, eq. 146)

        H = 1 - phi~/2 + (1 - theta/2 cot theta/2) phi~ phi~ / theta^2,   theta = |phi|

    The energy 1/2 d K d + 1/2 phi C phi gives the force K d and the moment H^T C phi, dampers for what is
    proportional to d' and omega.
    """
    no_inline()
    w, j, E, one, two = m.w, m.acts[act, NUMBERS_AT], m.acts[act, ROW_AT], m.acts[act, AT], m.acts[act, ON]
    other, away = E + 3, minus(section_place(m, two), section_place(m, one))
    slow = axpy(-1.0, twist_at(twist_at_section(m, one), away), twist_at_section(m, two))
    rate, omega = (slow[0], slow[1], slow[2]), last(slow)
    a, b = turned(m.axes, E, m.axes[other]), turned(m.axes, E, m.axes[other + 1])
    c = turned(m.axes, E, m.axes[other + 2])  # the second side's axes in those of the first
    cosine = larger(0.5 * math.sqrt(larger(1.0 + a[0] + b[1] + c[2], 0.0)), _HALF_TURN)
    phi = scaled(0.25 / cosine, (b[2] - c[1], c[0] - a[2], a[1] - b[0]))
    sine = math.sqrt(dot(phi, phi))
    angle = 2.0 * math.atan2(sine, cosine)
    share, curved = 2.0, 1.0 / 12.0
    if angle > _NO_ANGLE:
        share, curved = angle / sine, (1.0 - 0.5 * angle * cosine / sine) / angle**2
    phi, d = scaled(share, phi), turned(m.axes, E, away)
    rate, omega = turned(m.axes, E, rate), turned(m.axes, E, omega)
    k_d, k_phi = (w[j], w[j + 3], w[j + 6]), (w[j + 9], w[j + 12], w[j + 15])
    c_d, c_phi = (w[j + 1], w[j + 4], w[j + 7]), (w[j + 10], w[j + 13], w[j + 16])
    force, resists, turn = by_axis(k_d, d), by_axis(k_phi, phi), by_axis(c_phi, omega)
    slowed, first = by_axis(c_d, rate), cross(phi, resists)
    w[row], w[row + 5] = angle, 0.5 * (dot(force, d) + dot(resists, phi))
    w[row + 6] = dot(slowed, rate) + dot(turn, omega)
    moment = axpy(curved, cross(phi, first), axpy(0.5, first, plus(resists, turn)))
    force = plus(force, slowed)
    w[row + 1], w[row + SIZE + 1], w[row + 2 * SIZE + 1] = force
    w[row + 3 * SIZE + 1], w[row + 4 * SIZE + 1], w[row + 5 * SIZE + 1] = moment
