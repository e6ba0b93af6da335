"""The compiled law of bushings in space: six springs and dampers along and about the axes of their first side."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from kaneflex.mechanism.spatial import SpatialMechanism
from kaneflex.multibody.spatial_vectors import add_cross, less
from kaneflex.multibody.tables import OPTIONS, apart
from kaneflex.support.inner import once

FORCE, MOMENT, ENERGY, POWER, ANGLE = 0, 3, 6, 7, 8
"""Places in a bushing's row: force and moment along and about its axes [N, N m]; energy [J], dissipated power [W],
angle of rotation [rad]."""
_NO_ANGLE = 1e-8
_HALF_TURN = 1e-6
"""cos of half the angle of a turn that is as good as a half one."""
MOST = 3.0
"""Largest rotation [rad]: at half a turn the rotation vector jumps."""


def overturned(mechanism: SpatialMechanism, rows: np.ndarray) -> tuple[str, str] | None:
    """First bushing with too large a rotation, by rows of one or many instants, (..., n_bushings, 9), and a message."""
    names = [name for name, spring in mechanism.springs.items() if spring.is_bushing]
    angles = rows[..., ANGLE].reshape(-1, len(names)).max(axis=0, initial=0.0) if names else ()
    for name, angle in zip(names, angles, strict=True):
        if angle > MOST:
            return name, f"bushing {name} is rotated by {math.degrees(angle):.0f} deg, too close to half a turn"
    return None


@once
@njit(**OPTIONS)
def cushion(m, k, n):
    """Fill the row of a bushing, where ``move`` was.

    d is where the second point is against the first, and phi the rotation vector of the second side's axes, both in
    those of the first, E; phi' = H omega with the relative angular velocity omega there, and (Sola,
    Deray & Atchuthan 2018, arXiv:1812.01537, eq. 146)

        H = 1 - phi~/2 + (1 - theta/2 cot theta/2) phi~ phi~ / theta^2,   theta = |phi|

    The energy 1/2 d K d + 1/2 phi C phi gives the force K d and the moment H^T C phi, dampers for what is
    proportional to d' and omega.
    """
    apart()
    x, row, of, E, other = k.x, k.bushings[n], m.cushions[n], m.bushings[n, 2], m.bushings[n, 3]
    one, two = k.sections[m.bushings[n, 0]], k.sections[m.bushings[n, 1]]
    less(two, one, x, 0)
    for i in range(3):
        x[3 + i] = two[3 + i] - one[3 + i]
        x[6 + i] = two[9 + i] - one[9 + i]
        x[9 + i] = -one[9 + i]
    add_cross(x, 9, x, 0, x, 3)
    trace = 0.0
    for i in range(3):
        for j in range(3):
            x[21 + 3 * i + j] = 0.0
        x[12 + i] = x[15 + i] = x[18 + i] = 0.0
        for l in range(3):
            axis = k.axes[E + i, l]
            x[12 + i] += axis * x[l]
            x[15 + i] += axis * x[3 + l]
            x[18 + i] += axis * x[6 + l]
            for j in range(3):
                x[21 + 3 * i + j] += axis * k.axes[other + j, l]
        trace += x[21 + 4 * i]
    cosine = max(0.5 * math.sqrt(max(1.0 + trace, 0.0)), _HALF_TURN)
    x[30] = (x[28] - x[26]) / (4.0 * cosine)
    x[31] = (x[23] - x[27]) / (4.0 * cosine)
    x[32] = (x[24] - x[22]) / (4.0 * cosine)
    sine = math.sqrt(x[30] ** 2 + x[31] ** 2 + x[32] ** 2)
    angle = 2.0 * math.atan2(sine, cosine)
    share, curved = 2.0, 1.0 / 12.0
    if angle > _NO_ANGLE:
        share, curved = angle / sine, (1.0 - 0.5 * angle * cosine / sine) / angle**2
    row[ENERGY] = row[POWER] = 0.0
    row[ANGLE] = angle
    for i in range(3):
        x[30 + i] *= share
        x[33 + i] = of[3 + i] * x[30 + i]
        x[36 + i] = x[39 + i] = 0.0
        row[ENERGY] += 0.5 * (of[i] * x[12 + i] ** 2 + x[33 + i] * x[30 + i])
        row[POWER] += of[6 + i] * x[15 + i] ** 2 + of[9 + i] * x[18 + i] ** 2
    add_cross(x, 30, x, 33, x, 36)
    add_cross(x, 30, x, 36, x, 39)
    for i in range(3):
        row[FORCE + i] = of[i] * x[12 + i] + of[6 + i] * x[15 + i]
        row[MOMENT + i] = x[33 + i] + 0.5 * x[36 + i] + curved * x[39 + i] + of[9 + i] * x[18 + i]
