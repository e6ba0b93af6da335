"""Compiled stiffness and damping of springs and laws in space, as rows of a step's factors, and powers."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.values import after, numbers_of
from kaneflex.multibody.dynamics.algebra import dot, joined, minus, scaled
from kaneflex.multibody.dynamics.constrained import ALL, LENT
from kaneflex.multibody.dynamics.spatial_bushings import POWER
from kaneflex.multibody.dynamics.spatial_dynamics import INDEPENDENT, PRESCRIBED, reduced, tie
from kaneflex.multibody.dynamics.spatial_forces import momenta
from kaneflex.multibody.dynamics.spatial_kinematics import along, goes
from kaneflex.multibody.dynamics.spatial_work import (
    BUSHINGS,
    FORCES,
    LOADS,
    NODES,
    OBSERVED,
    SPEEDS,
    SPRINGS,
    TORQUES,
    TWISTS,
)
from kaneflex.multibody.model.layout import MAGNITUDES, OPTIONS, SQUARE, apart, kernel
from kaneflex.multibody.model.spatial_layout import COUNT, KIND, ROW_OF, SHAPES, SPEED
from kaneflex.support.inner import once

_NUDGE = 1e-8
"""Change of a coordinate for a difference quotient, in rad or sizes of the mechanism: the root of rounding errors."""


@njit(**OPTIONS)
def _next_row(m, f):
    """Place of the next row, filled with zeros; it counts once ALL is increased."""
    n = m.counts[SPEEDS]
    at = n * f.rows[ALL]
    for s in range(n):
        f.a[at + s] = f.damped[at + s] = f.stiff[at + s] = 0.0
    return at


@once
@njit(**OPTIONS)
def _against(m, first, second, wrench, out):
    """Generalised forces of a wrench on the second section, and of the opposite one on the first."""
    apart()
    along(m, first, wrench, -1.0, out)
    along(m, second, wrench, 1.0, out)


@once
@njit(**OPTIONS)
def _opposed(m, f, first, second, wrench, stiffness, damping):
    """Add the row of a spring along a wrench between two sections."""
    apart()
    at = _next_row(m, f)
    _against(m, first, second, wrench, after(f.a, at))
    for s in range(m.counts[SPEEDS]):
        f.damped[at + s], f.stiff[at + s] = damping * f.a[at + s], stiffness * f.a[at + s]
    f.rows[ALL] += 1


@njit(**OPTIONS)
def _feel(m, node, share, unit, out):
    """Add derivatives of a joint's rate by all speeds, times ``share``; ``unit`` is zero before and after."""
    for s in range(m.counts[SPEEDS]):
        unit[s] = 1.0
        out[s] += share * goes(m, node, m.q, unit)
        unit[s] = 0.0


@njit(**OPTIONS)
def _add_laws(m, c, f, sizes, t, h):
    """Add rows of the loads' derivatives by coordinates and speeds of joints, as difference quotients for a step of h:
    otherwise a light body on a nonlinear damper would limit the step."""
    apart()
    loads = m.counts[LOADS]
    first, n = f.rows[ALL], m.counts[SPEEDS]
    for k in range(loads if m.counts[OBSERVED] else 0):
        at = _next_row(m, f)
        for l in range(m.counts[FORCES]):
            if m.forces[l, 2] == k:
                along(m, m.forces[l, 0], joined(m.axes[m.forces[l, 1]], (0.0, 0.0, 0.0)), 1.0, after(f.a, at))
        for l in range(m.counts[TORQUES]):
            if m.torques[l, 3] == k:
                moment = joined((0.0, 0.0, 0.0), m.axes[m.torques[l, 2]])
                _against(m, m.torques[l, 0], m.torques[l, 1], moment, after(f.a, at))
        f.rows[ALL] += 1
    for s in range(n):
        c.step[s] = 0.0
    for i in range(2 * m.counts[OBSERVED]):
        node, by_speed = m.observed[i // 2, 1], i % 2
        at, nudge = m.observed[i // 2, 0] + by_speed, _NUDGE * c.measure[m.nodes[node, SPEED]]
        before = m.law_x[at]
        m.law_x[at] = before + (nudge / h if by_speed else nudge)
        nudge = m.law_x[at] - before
        kernel(m.kernels, MAGNITUDES)(t, m.law_x, 0, m.law_p, sizes, 0)
        m.law_x[at] = before
        for k in range(loads):
            slope = (sizes[k] + m.added[k] - m.sizes[k]) / nudge
            if slope != 0.0 and abs(slope) < 1e300:
                _feel(m, node, -slope, c.step, after(f.damped if by_speed else f.stiff, n * (first + k)))


@njit(**OPTIONS)
def add_rows(m, c, f, sizes, t, h):
    """Rows of springs, bushings and laws of loads at t, for a step of h, behind those of constraints."""
    apart()
    nothing = 0.0, 0.0, 0.0
    for n in range(m.counts[SPRINGS]):
        first, second = m.spring_ends[n, 0], m.spring_ends[n, 1]
        d = minus(m.sections[5 * second], m.sections[5 * first])
        length = math.sqrt(dot(d, d))
        if length > 0.0:
            k, damping, _ = m.stiffness[n]
            _opposed(m, f, first, second, joined(scaled(1.0 / length, d), nothing), k, damping)
    for n in range(m.counts[TWISTS]):
        k, damping, _ = m.torsion[n]
        axis = joined(nothing, m.axes[m.twist_ends[n, 2]])
        _opposed(m, f, m.twist_ends[n, 0], m.twist_ends[n, 1], axis, k, damping)
    for n in range(m.counts[BUSHINGS]):
        for i in range(3):
            axis, first, second = m.axes[m.bushing_ends[n, 2] + i], m.bushing_ends[n, 0], m.bushing_ends[n, 1]
            of = after(numbers_of(m.cushions), 12 * n + i)
            _opposed(m, f, first, second, joined(axis, nothing), of[0], of[6])
            _opposed(m, f, first, second, joined(nothing, axis), of[3], of[9])
    _add_laws(m, c, f, sizes, t, h)


@njit(**OPTIONS)
def resist(m, f, h):
    """Forces (h C + h^2 K) y of the accelerations y at ``given``, at the tree's y, without constraints."""
    apart()
    n, y, out = m.counts[SPEEDS], f.given, f.tree.y
    for s in range(n):
        out[s] = 0.0 * h
    for node in range(m.counts[NODES]):
        if m.nodes[node, KIND] == SHAPES:
            b, s, count = m.nodes[node, ROW_OF], m.nodes[node, SPEED], m.nodes[node, COUNT]
            square = m.bodies[b, SQUARE]
            for i in range(count):
                for j in range(count):
                    at = square + count * i + j
                    out[s + i] += h * (m.C[at] + h * m.K[at]) * y[s + j]
    for r in range(f.rows[LENT], f.rows[ALL]):
        share = 0.0 * h
        for s in range(n):
            share += f.b[n * r + s] * y[s]
        for s in range(n):
            out[s] += f.a[n * r + s] * share


@njit(**OPTIONS)
def drive_powers(m, c, out):
    """Power of the prescribed drives by accelerations of the independent speeds: B M times the rest of the speeds."""
    apart()
    rest = c.step
    for s in range(m.counts[SPEEDS]):
        rest[s] = 0.0
    for n in range(c.counts[PRESCRIBED]):
        rest[c.prescribed[n]] = m.u[c.prescribed[n]]
    tie(m, c, rest, 1)
    momenta(m, rest, c.momentum)
    reduced(m, c, c.momentum, out)


@njit(**OPTIONS)
def powers(m, c, missing, out):
    """Power dissipated by dampers, and supplied by loads and prescribed drives [W], after projection.

    The bodies' generalised inertia forces times the speeds give the power of prescribed drives: joints do no work, and
    what the equations of independent speeds miss is taken off.
    """
    apart()
    out[0] = out[1] = 0.0
    for node in range(m.counts[NODES]):
        if m.nodes[node, KIND] == SHAPES:
            b, s, count = m.nodes[node, ROW_OF], m.nodes[node, SPEED], m.nodes[node, COUNT]
            square = m.bodies[b, SQUARE]
            for i in range(count):
                for j in range(count):
                    out[0] += m.u[s + i] * m.C[square + count * i + j] * m.u[s + j]
    for n in range(m.counts[SPRINGS]):
        out[0] += m.springs[7 * n + 6]
    for n in range(m.counts[TWISTS]):
        out[0] += m.twists[4 * n + 3]
    for n in range(m.counts[BUSHINGS]):
        out[0] += m.bushings[9 * n + POWER]
    for n in range(m.counts[FORCES]):
        out[1] += m.sizes[m.forces[n, 2]] * dot(m.axes[m.forces[n, 1]], m.sections[5 * m.forces[n, 0] + 1])
    for n in range(m.counts[TORQUES]):
        rate = minus(m.sections[5 * m.torques[n, 1] + 3], m.sections[5 * m.torques[n, 0] + 3])
        out[1] += m.sizes[m.torques[n, 3]] * dot(m.axes[m.torques[n, 2]], rate)
    if c.counts[PRESCRIBED]:
        for s in range(m.counts[SPEEDS]):
            out[1] += m.u[s] * m.h[s]
        for e in range(c.counts[INDEPENDENT]):
            out[1] -= m.u[c.independent[e]] * missing[e]
