"""Kinematics of bodies in space: rotation of vectors with a body, and motion of its points."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.mechanism.body_frame import BodyFrame, Rates, cross
from kaneflex.mechanism.planar import GROUND

if TYPE_CHECKING:
    from kaneflex.mechanism.spatial import SpatialJoint

AXES = tuple(f"{i}{j}" for i in "xyz" for j in "xyz")
"""Entries of a body's axes: ``rod.axes_xy`` is the global x of its y axis."""
_SMALL = 1e-2
"""Square of an angle below which a series, exact to 1e-12, avoids the difference of nearly equal numbers."""


class SpatialFrame(BodyFrame):
    """Axes of a body, or of the ground, in a motion in space: points p are given in these axes, (3,) or (3, n_times)
    [m]; vectors are (3, n_times)."""

    letters = "xyz"

    @cached_property
    def axes(self) -> np.ndarray:
        """Axes as columns, (3, 3, n_times)."""
        if self.body == GROUND:
            return np.repeat(np.eye(3)[:, :, None], len(self.motion.times), axis=2)
        return np.array([self.motion[f"{self.body}.axes_{name}"] for name in AXES]).reshape(3, 3, -1)

    @property
    def omega(self) -> np.ndarray:
        """Angular velocity, global [rad/s], (3, n_times)."""
        return self._vector("omega_x", "omega_y", "omega_z")

    @property
    def epsilon(self) -> np.ndarray:
        """Angular acceleration, global [rad/s^2], (3, n_times)."""
        return self._vector("epsilon_x", "epsilon_y", "epsilon_z")

    def turned(self, other: BodyFrame) -> Rates:
        """Rotation vector of other axes relative to these, the angular velocity and its rate, (3, n_times) each."""
        angle = rotation_vector(np.einsum("jit,jkt->ikt", self.axes, cast(SpatialFrame, other).axes))
        omega = other.omega - self.omega
        return angle, self.to_body(omega), self.to_body(other.epsilon - self.epsilon - cross(self.omega, omega))


def turn_of(joint: SpatialJoint, first: SpatialFrame, second: SpatialFrame, relative: np.ndarray) -> Rates:
    """Rotation of a joint about its first axis, from -pi to pi, with two rates [rad, rad/s, rad/s^2], (n_times,) each.

    ``relative``: axes of the second body in those of the first at zero joint coordinate, (3, 3).
    """
    from kaneflex.mechanism.spatial import across

    y = [*joint.axes[1:], *across(joint.axes[0])][0]  # a universal joint's second axis rotates only about the first
    z = np.cross(joint.axes[0], y)
    turned = second.to_global(relative.T @ y)
    angle = np.arctan2(_dot(turned, first.to_global(z)), _dot(turned, first.to_global(y)))
    return angle, *turn_rates(joint, first, second)


def turn_rates(joint: SpatialJoint, first: SpatialFrame, second: SpatialFrame) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity and acceleration of a joint with an axis [rad/s, rad/s^2], (n_times,) each."""
    # the axis is fixed in both bodies, so its own rotation does not enter the angular acceleration along it
    axis = first.to_global(joint.axes[0])
    return _dot(axis, second.omega - first.omega), _dot(axis, second.epsilon - first.epsilon)


def slide_of(joint: SpatialJoint, first: SpatialFrame, second: SpatialFrame) -> Rates:
    """Displacement of a joint along its axis, with two rates [m, m/s, m/s^2], (n_times,) each."""
    on_first, on_second = (side.at for side in joint.sides)
    apart = first.apart(on_first, second, on_second)
    return cast(Rates, tuple(np.asarray(joint.axes[0]) @ part for part in apart))


def rotation_vector(turned: np.ndarray) -> np.ndarray:
    """Rotation vectors [rad] of rotation matrices (3, 3, n), (3, n), with angles up to pi."""
    sines = 0.5 * np.array([turned[(k + 2) % 3, (k + 1) % 3] - turned[(k + 1) % 3, (k + 2) % 3] for k in range(3)])
    cosine, sine = 0.5 * (np.trace(turned) - 1.0), np.sqrt(_dot(sines, sines))
    if not (cosine < 0.0).any():  # NaN is kept
        angle = np.arctan2(sine, cosine)
        return sines * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0.0)
    from scipy.spatial.transform import Rotation  # its import takes longer than many runs

    found = np.full((3, turned.shape[2]), np.nan)
    known = np.isfinite(turned).all(axis=(0, 1))
    if known.any():
        found[:, known] = Rotation.from_matrix(turned[:, :, known].transpose(2, 0, 1)).as_rotvec().T
    return found


def rotation_matrix(theta: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) of rotation vectors [rad], (n, 3): Rodrigues' formula."""
    angle, tilde = np.linalg.norm(theta, axis=-1)[..., None, None] / np.pi, skew(theta)
    return np.eye(3) + np.sinc(angle) * tilde + 0.5 * np.sinc(0.5 * angle) ** 2 * tilde @ tilde


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=0)


def skew(v: np.ndarray) -> np.ndarray:
    """Matrix of the cross product with a vector from the left, (..., 3, 3) of (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(v), -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], -2)


def rotation_rates(theta: np.ndarray) -> np.ndarray:
    """Matrices H of the rates H omega of rotation vectors (..., 3), with the angular velocity in the turned axes.

    Transposed for omega in the axes from which they turn (Sola, Deray & Atchuthan 2018, arXiv:1812.01537, eq. 144 and
    146).
    """
    square, tilde = (theta * theta).sum(axis=-1)[..., None, None], skew(theta)
    far = abs(square) > _SMALL
    half = 0.5 * np.sqrt(np.where(far, square, 1.0))
    series = 1.0 / 12.0 + square / 720.0 + square**2 / 30240.0
    curved = np.where(far, (1.0 - half / np.tan(half)) / (4.0 * half**2), series)
    return np.asarray(np.eye(3) + 0.5 * tilde + curved * tilde @ tilde)


def at_point(p: np.ndarray) -> np.ndarray:
    """Displacement of a point at p [m] and the rotation from a body's six coordinates, (6, 6)."""
    found = np.eye(6)
    found[:3, 3:] = -skew(p)
    return found
