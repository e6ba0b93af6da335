"""Planar kinematics: rotation of vectors with a body, and motion of a body's points.

Vectors have shape (2, n_times); S p = (-y, x) is a vector rotated by a right angle. A point p in the axes of a body
with angular velocity omega and acceleration epsilon, which moves in these axes by p', p'', has the velocity and
acceleration relative to the body's start, in the body's axes,

    p' + omega S p,   p'' + 2 omega S p' + epsilon S p - omega^2 p

(Kane & Levinson, Dynamics: Theory and Applications, 1985, sec. 2.8: one point moving on a rigid body). With -omega and
-epsilon the same formulas give the rates of a vector's components in rotating axes from its global rates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from kaneflex.mechanism.planar import GROUND, Pose, carried_velocity, quarter_turn, relative_acceleration

Rates = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Quantity with its first and second rates, time along the last axis."""
STILL = np.zeros((3, 1))
"""Zero rate of a point that is fixed in its body, in the plane or in space."""


def rotate(c, s, vector) -> np.ndarray:
    """Global components of a vector given in axes rotated by an angle with cosine c and sine s."""
    return np.array(Pose(0.0, 0.0, c, s).turn(vector))


def rotate_back(c, s, vector) -> np.ndarray:
    """Components of a global vector in axes rotated by an angle with cosine c and sine s."""
    return rotate(c, -s, vector)


def normal(vector) -> np.ndarray:
    """Vector S p: p rotated counterclockwise by a right angle."""
    return np.array(quarter_turn(vector))


def velocity(omega, p, p_rate=STILL[:2]) -> np.ndarray:
    """Relative velocity p' + omega S p."""
    return p_rate + np.array(carried_velocity(p, omega))


def acceleration(omega, epsilon, p, p_rate=STILL[:2], p_accel=STILL[:2]) -> np.ndarray:
    """Relative acceleration p'' + 2 omega S p' + epsilon S p - omega^2 p."""
    return p_accel + np.array(relative_acceleration(p, p_rate, omega, epsilon))


class Scalars(Protocol):
    """Motion by the names of its scalars, like ``rod.omega``, each (n_times,)."""

    @property
    def times(self) -> np.ndarray: ...

    def __getitem__(self, name: str) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """Axes of a body, or of the ground, in a motion, and its points.

    Points p are given in these axes, shape (2,) or (2, n_times) [m]. Scalars are looked up on demand, since a module
    has only those that its scene requires.
    """

    motion: Scalars
    body: str
    relative: ClassVar[tuple[Callable[..., np.ndarray], Callable[..., np.ndarray]]] = velocity, acceleration
    """Velocity and acceleration relative to an origin, by the rotation."""
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
        """Global components of a vector given in these axes, (2, n_times)."""
        return rotate(self.c, self.s, vector)

    def to_body(self, vector) -> np.ndarray:
        """Components of a global vector in these axes, (2, n_times)."""
        return rotate_back(self.c, self.s, vector)

    def place(self, p) -> np.ndarray:
        """Global position of a point [m], (2, n_times)."""
        return self.origin + self.to_global(p)

    def velocity(self, p, p_rate=STILL) -> np.ndarray:
        """Global velocity of a point that moves by p' in these axes [m/s], (2 or 3, n_times)."""
        start = self._vector(*(f"v_{axis}" for axis in self.letters))
        return start + self.relative[0](self.omega, self.to_global(p), self.to_global(p_rate))

    def acceleration(self, p, p_rate=STILL, p_accel=STILL) -> np.ndarray:
        """Global acceleration of a point that moves by p', p'' in these axes [m/s^2], (2 or 3, n_times)."""
        start, moved = self._vector(*(f"a_{axis}" for axis in self.letters)), map(self.to_global, (p, p_rate, p_accel))
        return start + self.relative[1](self.omega, self.epsilon, *moved)

    def components(self, d: np.ndarray, d_rate: np.ndarray, d_accel: np.ndarray) -> Rates:
        """Components of a global vector in these axes, and the rates of these components, from its global rates."""
        omega, epsilon, (velocity, acceleration) = self.omega, self.epsilon, self.relative
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
