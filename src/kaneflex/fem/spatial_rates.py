"""Axes, places and directions in space with their first two rates, over the instants of a rigid motion."""

from __future__ import annotations

from typing import cast

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import Side
from kaneflex.mechanism.spatial_frame import SpatialFrame, skew

Rates3 = np.ndarray
"""A quantity and its first two rates, (3, n_times, ...)."""


def turning(motion: RigidMotion, body: str) -> Rates3:
    """Axes of a body and their rates, (3, n_times, 3, 3)."""
    frame = cast(SpatialFrame, motion.frame(body))
    R = np.moveaxis(frame.axes, 2, 0)
    spin, turn = skew(frame.omega.T), skew(frame.epsilon.T)
    return np.stack([R, spin @ R, (turn + spin @ spin) @ R])


def place_of(motion: RigidMotion, side: Side) -> Rates3:
    """A point of a body, its velocity and acceleration, (3, n_times, 3)."""
    frame = motion.frame(side.body)
    return np.stack([frame.place(side.at).T, frame.velocity(side.at).T, frame.acceleration(side.at).T])


def direction_of(d: Rates3) -> Rates3:
    """d / |d| and its rates."""
    length = np.hypot(np.hypot(d[0, :, 0], d[0, :, 1]), d[0, :, 2])[:, None]

    def along(vector: np.ndarray) -> np.ndarray:
        return (e * vector).sum(axis=1)[:, None]

    e = d[0] / length
    rate = along(d[1])
    e_rate = (d[1] - e * rate) / length
    accel = along(d[2]) + (e_rate * d[1]).sum(axis=1)[:, None]
    return np.stack([e, e_rate, (d[2] - 2.0 * e_rate * rate - e * accel) / length])


def product(a: Rates3, b: Rates3) -> Rates3:
    """a b and its rates, of matrices."""
    return np.stack([a[0] @ b[0], a[1] @ b[0] + a[0] @ b[1], a[2] @ b[0] + 2.0 * a[1] @ b[1] + a[0] @ b[2]])
