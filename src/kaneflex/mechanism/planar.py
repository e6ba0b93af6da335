"""Vectors, poses and points of moving bodies in the plane, for any kind of number.

SymPy's expressions, floats and NumPy's arrays (over time, or complex for derivatives) use the same code, so that
derivation and numerical computation share their formulas.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

Number = Any
"""Number: a SymPy expression, a float, or an ndarray of floats or complex numbers."""
Vector = tuple[Number, Number]
"""Vector of two components."""
GROUND = "ground"


@dataclass(frozen=True)
class BodyPoint:
    """Point of a body: coordinates [m] in the body's axes, from its start; global for the ground."""

    body: str
    name: str
    at: Vector


class Pose(NamedTuple):
    """Pose of axes: global position of their origin [m], direction cosines of their x axis, and its angle [rad].

    The angle is None if only the cosines are known.
    """

    x: Number
    y: Number
    c: Number
    s: Number
    phi: Number = None

    def turn(self, vector: Vector) -> Vector:
        """Global components R v of a vector fixed in these axes."""
        return self.c * vector[0] - self.s * vector[1], self.s * vector[0] + self.c * vector[1]

    def place(self, at: Vector) -> Vector:
        """Global position p = r + R r_P of a point fixed in these axes."""
        dx, dy = self.turn(at)
        return self.x + dx, self.y + dy

    def section(self, at: Vector) -> Pose:
        """Axes with a point as the origin: the section of a rigid body at a joint."""
        return Pose(*self.place(at), self.c, self.s, self.phi)

    @property
    def origin(self) -> Vector:
        return self.x, self.y


def pose_at(
    x: Number, y: Number, phi: Number, cos: Callable[[Number], Number] = math.cos, sin: Callable = math.sin
) -> Pose:
    """Pose with an angle, by the cosine and sine of its kind of number."""
    return Pose(x, y, cos(phi), sin(phi), phi)


def whole_turns(angle: float | np.ndarray) -> np.ndarray:
    """Whole turns nearest to an angle [rad]."""
    return 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


def wrapped(angle: float | np.ndarray) -> np.ndarray:
    """Angle without whole turns, from -pi to pi [rad]."""
    return np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi


def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1]


def dot(a: Vector | np.ndarray, b: Vector | np.ndarray) -> Number:
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Vector | np.ndarray, b: Vector | np.ndarray) -> Number:
    """Cross product (S a) . b."""
    return a[0] * b[1] - a[1] * b[0]


def quarter_turn(a: Vector) -> Vector:
    """Vector S a: a rotated counterclockwise by a right angle."""
    return -a[1], a[0]


def carried_velocity(arm: Vector, omega: Number) -> Vector:
    """Velocity omega S r of a point at the arm r relative to its body's start."""
    return -omega * arm[1], omega * arm[0]


def carried_acceleration(arm: Vector, omega: Number, epsilon: Number) -> Vector:
    """Relative acceleration epsilon S r - omega^2 r (Kane & Levinson 1985, sec. 2.7: two points of a body)."""
    square = omega**2
    return -epsilon * arm[1] - square * arm[0], epsilon * arm[0] - square * arm[1]
