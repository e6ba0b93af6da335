"""Motion of a mechanism in space between the ends of its steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.time.hermite import Pieces


@dataclass(frozen=True, eq=False)
class Steps:
    """Curve through rows of the integration: their coordinates, rates and accelerations determine quintics.

    A ball's quintic is that of the rotation vector from its axes at the beginning of the step.
    """

    system: SpatialSystem
    rows: np.ndarray

    @property
    def sides(self) -> np.ndarray:
        """Sides on which discontinuous loads stand."""
        return self.rows[0, self.system.engine.columns["modes"]]

    @cached_property
    def _ends(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates y, rates and accelerations at the beginning and the end of each step, (2 steps, n) each."""
        n = self.system.engine.size
        found = [np.repeat(self.rows[:, 1 + k * n : 1 + (k + 1) * n], 2, axis=0)[1:-1] for k in range(3)]
        for _, s, quaternions in self._balls():
            first, second = quaternions[:-1], quaternions[1:]
            theta = (first.inv() * second).as_rotvec()
            omega, alpha = (part[1::2, s : s + 3] for part in found[1:])
            found[0][1::2, s : s + 3] = theta
            found[1][1::2, s : s + 3], found[2][1::2, s : s + 3] = _rates_of(theta, omega, alpha)
        return found[0], found[1], found[2]

    def _balls(self):
        """First coordinate and speed of every ball, and its axes at all rows."""
        from scipy.spatial.transform import Rotation

        engine = self.system.engine
        for n, (k, s) in enumerate(engine.balls.tolist()):
            part = self.rows[:, engine.columns["quaternions"]][:, 4 * n : 4 * n + 4]
            yield k, s, Rotation.from_quat(np.roll(part, -1, axis=1))

    def __call__(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates q and speeds u at ``times`` [s], (n_times, .) each."""
        from scipy.spatial.transform import Rotation

        knots, system = self.rows[:, 0], self.system
        pieces = Pieces.of(knots, np.searchsorted(knots, times, side="right") - 1, times)
        y, u = Pieces(2 * pieces.k, pieces.share, pieces.length).quintic(*self._ends)
        q = np.zeros((len(times), len(system.state_coordinates)))
        own, speeds = system.engine.own.T
        q[:, own] = y[:, speeds]
        for k, s, quaternions in self._balls():
            theta = y[:, s : s + 3]
            found = (quaternions[pieces.k] * Rotation.from_rotvec(theta)).as_quat()
            q[:, k : k + 4] = np.roll(found, 1, axis=1)
            u[:, s : s + 3] = np.einsum("tij,tj->ti", _turning(theta)[0], u[:, s : s + 3])
        return q, u


def _turning(theta: np.ndarray) -> tuple[np.ndarray, ...]:
    """H (n, 3, 3) with omega = H theta' of rotation vectors, see
    :func:`kaneflex.multibody.dynamics.spatial_kinematics.turning`, and its coefficients (n,)."""
    square, b, c, b_rate, c_rate = (theta * theta).sum(axis=1), *np.ones((2, len(theta))), *np.zeros((2, len(theta)))
    for k in range(16, 0, -1):
        r_b, r_c = 1.0 / ((2 * k + 1) * (2 * k + 2)), 1.0 / ((2 * k + 2) * (2 * k + 3))
        b_rate, c_rate = -r_b * (b + square * b_rate), -r_c * (c + square * c_rate)
        b, c = 1.0 - r_b * square * b, 1.0 - r_c * square * c
    cross = np.zeros((len(theta), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[:, i, j], cross[:, j, i] = -theta[:, k], theta[:, k]
    b, c, c_rate = b / 2.0, c / 6.0, c_rate / 3.0
    return np.eye(3) - b[:, None, None] * cross + c[:, None, None] * cross @ cross, b, c, b_rate, c_rate


def _rates_of(theta: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates theta' and theta'' of rotation vectors by angular velocities and accelerations in their axes, (n, 3)."""
    H, _, c, b_rate, c_rate = _turning(theta)
    rate = np.linalg.solve(H, omega[:, :, None])[:, :, 0]
    along, turned = (theta * rate).sum(axis=1), np.cross(theta, rate)
    growing = -(b_rate * along)[:, None] * turned + (c_rate * along)[:, None] * np.cross(theta, turned)
    growing += c[:, None] * np.cross(rate, turned)
    return rate, np.linalg.solve(H, (alpha - growing)[:, :, None])[:, :, 0]
