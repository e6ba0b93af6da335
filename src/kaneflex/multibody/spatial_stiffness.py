"""Compiled: what is stiff in bodies in space that deform, along the independent speeds, and what it dissipates."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.spatial_bushings import POWER
from kaneflex.multibody.spatial_dynamics import weigh
from kaneflex.multibody.spatial_kinematics import along
from kaneflex.multibody.spatial_vectors import less
from kaneflex.multibody.tables import OPTIONS, apart


@njit(**OPTIONS)
def _opposed(m, choice, k, s, first, second, stiffness, damping):
    """Add a spring along a force and a moment at k.x[84] between two sections to the reduced matrices."""
    apart()
    f, B, g = len(choice.independent), choice.basis, choice.step
    for n in range(len(g)):
        g[n] = 0.0
    along(m, k, first, k.x, 84, g)
    for n in range(len(g)):
        g[n] = -g[n]
    along(m, k, second, k.x, 84, g)
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
def _reduced(choice, full, out, room):
    """B full B^T."""
    apart()
    f, B = len(choice.independent), choice.basis
    for e in range(f):
        weigh(B[e], full, room)
        for j in range(f):
            total = 0.0
            for n in range(B.shape[1]):
                total += room[n] * B[j, n]
            out[e, j] = total


@njit(**OPTIONS)
def reduce(m, choice, k, s):
    """M, K and C of the independent speeds where the mechanism was projected."""
    apart()
    x = k.x
    _reduced(choice, k.M, s.M, choice.step)
    _reduced(choice, s.K, s.stiff, choice.step)
    _reduced(choice, s.C, s.damped, choice.step)
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


@njit(**OPTIONS)
def powers(m, choice, k, C, out):
    """Dissipated by dampers, supplied by loads and prescribed drives [W], where the mechanism was projected.

    What bodies ask for along all speeds, as these go, is what prescribed drives give: joints do no work, and along
    independent speeds nothing is asked for. M x stands for the accelerations that were unknown when h was found.
    """
    apart()
    f, B = len(choice.independent), choice.basis
    x = len(choice.dependent) ** 2 + len(choice.dependent) + f * f
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
            found = 0.0
            for e in range(f):
                found += choice.room[x + e] * B[e, n]
            choice.step[n] = found
        for n in range(len(k.u)):
            asked = k.h[n]
            for e in range(len(k.u)):
                asked += k.M[n, e] * choice.step[e]
            out[1] += k.u[n] * asked
