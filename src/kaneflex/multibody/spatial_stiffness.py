"""Compiled stiffness and damping of deforming bodies in space along the independent speeds, and powers."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.spatial_bushings import POWER
from kaneflex.multibody.spatial_dynamics import weigh
from kaneflex.multibody.spatial_kinematics import along, goes
from kaneflex.multibody.spatial_tables import SPEED
from kaneflex.multibody.spatial_vectors import less
from kaneflex.multibody.tables import MAGNITUDES, OPTIONS, address, apart, kernel

_NUDGE = 1e-8
"""Change of a coordinate for a difference quotient, in rad or sizes of the mechanism: the root of rounding errors."""


@njit(**OPTIONS)
def _against(m, k, first, second, out):
    """Generalised forces of a force and moment at k.x[84] on the second section, and opposite ones on the first."""
    for n in range(len(out)):
        out[n] = 0.0
    along(m, k, first, k.x, 84, out)
    for n in range(len(out)):
        out[n] = -out[n]
    along(m, k, second, k.x, 84, out)


@njit(**OPTIONS)
def _opposed(m, choice, k, s, first, second, stiffness, damping):
    """Add a spring along a force and a moment at k.x[84] between two sections to the reduced matrices."""
    apart()
    f, B, g = len(choice.independent), choice.basis, choice.step
    _against(m, k, first, second, g)
    for e in range(f):
        s.defect[e] = 0.0
        for n in range(len(g)):
            s.defect[e] += B[e, n] * g[n]
    for e in range(f):
        for n in range(f):
            s.stiff[e, n] += stiffness * s.defect[e] * s.defect[n]
            s.damped[e, n] += damping * s.defect[e] * s.defect[n]


@njit(**OPTIONS)
def _unit(x, axis, at):
    """A unit force (at 0) or moment (at 3) along an axis at x[84]."""
    for i in range(6):
        x[84 + i] = 0.0
    for i in range(3):
        x[84 + at + i] = axis[i]


@njit(**OPTIONS)
def reduced(choice, full, out, room):
    """Reduced matrix B full B^T."""
    apart()
    f, B, dependent = len(choice.independent), choice.basis, choice.dependent
    for e in range(f):
        weigh(B[e], full, room)
        for j in range(f):
            total = room[choice.independent[j]]
            for n in range(len(dependent)):
                total += room[dependent[n]] * B[j, dependent[n]]
            out[e, j] = total


@njit(**OPTIONS)
def _drive_powers(choice, k, drives):
    """Power of the prescribed drives by accelerations of the independent speeds: B M times the rest of the speeds."""
    B, rest, speeds = choice.basis, choice.step, len(k.u)
    for n in range(speeds):
        rest[n] = k.u[n]
        for e in range(len(drives)):
            rest[n] -= B[e, n] * k.u[choice.independent[e]]
    for e in range(len(drives)):
        drives[e] = 0.0
        for i in range(speeds):
            if B[e, i] != 0.0:
                for n in range(speeds):
                    drives[e] += B[e, i] * k.M[i, n] * rest[n]


@njit(**OPTIONS)
def _pulled(m, choice, k, s, share, node, by_speed):
    """Add the derivative of a load by the coordinate or the speed of a joint to the reduced matrices.

    ``share``, the load's generalised force along every speed, is at choice.step.
    """
    apart()
    f, B, out = len(choice.independent), choice.basis, s.damped if by_speed else s.stiff
    for e in range(f):
        s.defect[e] = 0.0
        for n in range(B.shape[1]):
            s.defect[e] -= share * B[e, n] * choice.step[n]
    for n in range(f):
        moved = goes(m, node, k.q, B[n])
        for e in range(f):
            out[e, n] += s.defect[e] * moved


@njit(**OPTIONS)
def _add_slopes(m, choice, k, law, s, t, h):
    """Add derivatives of the loads' sizes by coordinates and speeds of joints, as difference quotients, to the reduced
    matrices of a step of h: otherwise a light body on a nonlinear damper would limit the step."""
    apart()
    x, sizes = k.x, address(s.sizes)
    for i in range(2 * len(law.told)):
        node, by_speed = law.told[i // 2, 1], i % 2
        at, nudge = law.told[i // 2, 0] + by_speed, _NUDGE * choice.measure[m.nodes[node, SPEED]]
        before = law.x[at]
        law.x[at] = before + (nudge / h if by_speed else nudge)
        nudge = law.x[at] - before
        kernel(address(law.kernels), MAGNITUDES)(t, address(law.x), 0, address(law.p), sizes, 0)
        law.x[at] = before
        for n in range(len(k.sizes)):
            slope = (s.sizes[n] + law.added[n] - k.sizes[n]) / nudge
            if slope == 0.0 or not abs(slope) < 1e300:
                continue
            for l in range(len(choice.step)):
                choice.step[l] = 0.0
            for l in range(len(m.forces)):
                if m.forces[l, 2] == n:
                    _unit(x, k.axes[m.forces[l, 1]], 0)
                    along(m, k, m.forces[l, 0], x, 84, choice.step)
            for l in range(len(m.torques)):
                if m.torques[l, 3] == n:
                    _unit(x, k.axes[m.torques[l, 2]], 3)
                    _against(m, k, m.torques[l, 0], m.torques[l, 1], choice.step)
            _pulled(m, choice, k, s, slope, node, by_speed)


@njit(**OPTIONS)
def reduce(m, choice, k, law, s, t, h):
    """Matrices K and C of the independent speeds after projection at t, for a step of h."""
    apart()
    x = k.x
    _drive_powers(choice, k, s.drives)
    reduced(choice, s.K, s.stiff, choice.step)
    reduced(choice, s.C, s.damped, choice.step)
    for n in range(len(m.springs)):
        first, second = m.springs[n, 0], m.springs[n, 1]
        less(k.sections[second], k.sections[first], x, 90)
        length = math.sqrt(x[90] ** 2 + x[91] ** 2 + x[92] ** 2)
        if length > 0.0:
            for i in range(3):
                x[84 + i], x[87 + i] = x[90 + i] / length, 0.0
            _opposed(m, choice, k, s, first, second, m.stiffness[n, 0], m.stiffness[n, 1])
    for n in range(len(m.twists)):
        _unit(x, k.axes[m.twists[n, 2]], 3)
        _opposed(m, choice, k, s, m.twists[n, 0], m.twists[n, 1], m.torsion[n, 0], m.torsion[n, 1])
    for n in range(len(m.bushings)):
        for i in range(6):
            _unit(x, k.axes[m.bushings[n, 2] + i % 3], 3 * (i // 3))
            stiffness, damping = m.cushions[n, i], m.cushions[n, 6 + i]
            _opposed(m, choice, k, s, m.bushings[n, 0], m.bushings[n, 1], stiffness, damping)
    _add_slopes(m, choice, k, law, s, t, h)


@njit(**OPTIONS)
def powers(m, choice, k, C, out):
    """Power dissipated by dampers, and supplied by loads and prescribed drives [W], after projection.

    The bodies' generalised inertia forces times the speeds give the power of prescribed drives: joints do no work, and
    what the equations of independent speeds miss is taken off.
    """
    apart()
    out[0] = out[1] = 0.0
    for n in range(len(k.u)):
        for e in range(len(k.u)):
            out[0] += k.u[n] * C[n, e] * k.u[e]
    for n in range(len(k.springs)):
        out[0] += k.springs[n, 6]
    for n in range(len(k.twists)):
        out[0] += k.twists[n, 3]
    for n in range(len(k.bushings)):
        out[0] += k.bushings[n, POWER]
    for n in range(len(m.forces)):
        for i in range(3):
            out[1] += k.sizes[m.forces[n, 2]] * k.axes[m.forces[n, 1], i] * k.sections[m.forces[n, 0], 3 + i]
    for n in range(len(m.torques)):
        for i in range(3):
            turned = k.sections[m.torques[n, 1], 9 + i] - k.sections[m.torques[n, 0], 9 + i]
            out[1] += k.sizes[m.torques[n, 3]] * k.axes[m.torques[n, 2], i] * turned
    if len(choice.prescribed):
        for n in range(len(k.u)):
            out[1] += k.u[n] * k.h[n]
        for e in range(len(choice.independent)):
            missing = k.h[choice.independent[e]]
            for n in range(len(choice.dependent)):
                missing += choice.basis[e, choice.dependent[n]] * k.h[choice.dependent[n]]
            out[1] -= k.u[choice.independent[e]] * missing
