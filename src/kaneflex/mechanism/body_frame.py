"""Kinematics of bodies: rotation of vectors with a body, and motion of its points, in the plane and in space.

Vectors have shape (D, n_times), D = 2 or 3; in the plane an angular velocity is (n_times,), about z. A point p in the
axes of a body with angular velocity omega and acceleration epsilon, which moves in these axes by p', p'', has the
velocity and acceleration relative to the body's start, in the body's axes,

    p' + omega x p,   p'' + 2 omega x p' + epsilon x p + omega x (omega x p)

(Kane & Levinson, Dynamics: Theory and Applications, 1985, sec. 2.8: one point moving on a rigid body). With -omega and
-epsilon the same formulas give the rates of a vector's components in rotating axes from its global rates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol, cast

import numpy as np

from kaneflex.mechanism.planar import GROUND, quarter_turn

Rates = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Quantity with its first and second rates, time along the last axis."""


def normal(vector) -> np.ndarray:
    """Vector S p: p rotated counterclockwise by a right angle."""
    return np.array(quarter_turn(vector))


def turning(angle) -> np.ndarray:
    """Axes rotated by an angle, as columns (2, 2, n_times)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def applied(matrices: np.ndarray, vector) -> np.ndarray:
    """Product of matrices (D, D, n_times) and a vector, (D,) or (D, n_times); einsum takes ten times as long."""
    first, *others = np.asarray(vector).reshape(len(matrices), -1)
    found = matrices[:, 0] * first
    for k, part in enumerate(others, 1):
        found += matrices[:, k] * part
    return cast(np.ndarray, found)


def cross(omega: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Cross product of vectors (3, n_times), or of an angular velocity about z with a vector (2, n_times); NumPy's
    takes five times as long for few instants."""
    if len(p) == 2:
        return np.array([-omega * p[1], omega * p[0]])
    (a, b, c), (x, y, z) = omega, p
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def velocity(omega, p, p_rate=0.0) -> np.ndarray:
    """Relative velocity p' + omega x p."""
    return p_rate + cross(omega, p)


def acceleration(omega, epsilon, p, p_rate=0.0, p_accel=0.0) -> np.ndarray:
    """Relative acceleration p'' + 2 omega x p' + epsilon x p + omega x (omega x p)."""
    return p_accel + cross(epsilon, p) + cross(omega, cross(omega, p) + 2.0 * p_rate)


class Scalars(Protocol):
    """Motion by the names of its scalars, like ``rod.omega``, each (n_times,)."""

    @property
    def times(self) -> np.ndarray: ...

    def __getitem__(self, name: str) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """Axes of a body, or of the ground, in a motion, and its points.

    Points p are given in these axes, shape (D,) or (D, n_times) [m]. Scalars are looked up on demand, since a module
    has only those that its scene requires.
    """

    motion: Scalars
    body: str
    letters: ClassVar[str] = "xy"
    """Components of vectors."""

    def _scalar(self, key: str) -> np.ndarray:
        if self.body == GROUND:
            return np.full(len(self.motion.times), float(key == "c"))
        return self.motion[f"{self.body}.{key}"]

    def _vector(self, *keys: str) -> np.ndarray:
        return np.array([self._scalar(key) for key in keys])

    @cached_property
    def c(self) -> np.ndarray:
        return self._scalar("c")

    @cached_property
    def s(self) -> np.ndarray:
        return self._scalar("s")

    @cached_property
    def axes(self) -> np.ndarray:
        """Axes as columns, (D, D, n_times)."""
        return np.array([[self.c, -self.s], [self.s, self.c]])

    @property
    def omega(self) -> np.ndarray:
        """Angular velocity [rad/s]."""
        return self._scalar("omega")

    @property
    def epsilon(self) -> np.ndarray:
        """Angular acceleration [rad/s^2]."""
        return self._scalar("epsilon")

    @property
    def origin(self) -> np.ndarray:
        """Position of the body's start, global [m]."""
        return self._vector(*self.letters)

    def to_global(self, vector) -> np.ndarray:
        """Global components of a vector given in these axes, (D, n_times)."""
        return applied(self.axes, vector)

    def to_body(self, vector) -> np.ndarray:
        """Components of a global vector in these axes, (D, n_times)."""
        return applied(self.axes.swapaxes(0, 1), vector)

    def place(self, p) -> np.ndarray:
        """Global position of a point [m], (D, n_times)."""
        return self.origin + self.to_global(p)

    def velocity(self, p, *rate) -> np.ndarray:
        """Global velocity of a point that may move by a rate p' in these axes [m/s], (D, n_times)."""
        start = self._vector(*(f"v_{axis}" for axis in self.letters))
        return start + velocity(self.omega, *map(self.to_global, (p, *rate)))

    def acceleration(self, p, *rates) -> np.ndarray:
        """Global acceleration of a point that may move by p', p'' in these axes [m/s^2], (D, n_times)."""
        start = self._vector(*(f"a_{axis}" for axis in self.letters))
        return start + acceleration(self.omega, self.epsilon, *map(self.to_global, (p, *rates)))

    def components(self, d: np.ndarray, d_rate: np.ndarray, d_accel: np.ndarray) -> Rates:
        """Components of a global vector in these axes, and the rates of these components, from its global rates."""
        omega, epsilon = self.omega, self.epsilon
        return (
            self.to_body(d),
            self.to_body(velocity(-omega, d, d_rate)),
            self.to_body(acceleration(-omega, -epsilon, d, d_rate, d_accel)),
        )

    def gap(self, p, other: BodyFrame, there) -> Rates:
        """Global position of a point of other axes relative to a point of these, with its rates; both points are fixed
        in their axes."""
        return (
            other.place(there) - self.place(p), other.velocity(there) - self.velocity(p),
            other.acceleration(there) - self.acceleration(p),
        )  # fmt: skip

    def apart(self, p, other: BodyFrame, there) -> Rates:
        """The same in these axes, with its rates there."""
        return self.components(*self.gap(p, other, there))

    def turned(self, other: BodyFrame) -> Rates:
        """Rotation of other axes relative to these, from -pi to pi, and its rates, (1, n_times) each."""
        c, s = self.to_body((other.c, other.s))
        return np.arctan2(s, c)[None], (other.omega - self.omega)[None], (other.epsilon - self.epsilon)[None]
