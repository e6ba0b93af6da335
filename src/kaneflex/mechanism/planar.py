"""Vectors, poses and points of moving bodies in the plane, over any kind of number.

SymPy's expressions, plain floats and NumPy's arrays (over time, or complex ones for derivatives) go through the same
lines, so that what is derived and what is computed by numbers is written once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

Number = Any
"""A SymPy expression, a float, or an ndarray of floats or complex numbers."""
Vector = tuple[Number, Number]
"""Two components [m, or what the quantity has]."""
GROUND = "ground"


@dataclass(frozen=True)
class BodyPoint:
    """A point of a body: its coordinates [m] in the body's axes, from the body's start; of the ground global ones."""

    body: str
    name: str
    at: Vector


class Pose(NamedTuple):
    """Where axes stand: global position of their origin [m], direction cosines of their x axis, and its angle [rad].

    The angle is None where the cosines alone are known.
    """

    x: Number
    y: Number
    c: Number
    s: Number
    phi: Number = None

    def turn(self, vector: Vector) -> Vector:
        """Global components of a vector that is fixed in these axes: R v."""
        return self.c * vector[0] - self.s * vector[1], self.s * vector[0] + self.c * vector[1]

    def place(self, at: Vector) -> Vector:
        """Global position of a point that is fixed in these axes: p = r + R r_P."""
        dx, dy = self.turn(at)
        return self.x + dx, self.y + dy

    def section(self, at: Vector) -> Pose:
        """These axes with a point of theirs as the origin: what a joint holds of a rigid body."""
        return Pose(*self.place(at), self.c, self.s, self.phi)

    def nudged(self, step: Number) -> tuple[Pose, Pose, Pose]:
        """These axes moved by a step so small that its square is nothing: along x, along y, and turned."""
        x, y, c, s, phi = self
        turned = Pose(x, y, c - s * step, s + c * step, phi + step)
        return Pose(x + step, y, c, s, phi), Pose(x, y + step, c, s, phi), turned

    @property
    def origin(self) -> Vector:
        return self.x, self.y


def pose_at(
    x: Number, y: Number, phi: Number, cos: Callable[[Number], Number] = math.cos, sin: Callable = math.sin
) -> Pose:
    """The pose of an angle, by the cosine and sine of its kind of number."""
    return Pose(x, y, cos(phi), sin(phi), phi)


def whole_turns(angle: float | np.ndarray) -> np.ndarray:
    """As many whole turns as are nearest to an angle [rad]."""
    return 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


def wrapped(angle: float | np.ndarray) -> np.ndarray:
    """An angle less whole turns, from -pi to pi [rad]."""
    return np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi


def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1]


def dot(a: Vector | np.ndarray, b: Vector | np.ndarray) -> Number:
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Vector | np.ndarray, b: Vector | np.ndarray) -> Number:
    """(S a) . b: the component of b a quarter turn ahead of a."""
    return a[0] * b[1] - a[1] * b[0]


def quarter_turn(a: Vector) -> Vector:
    """S a: a quarter turn counter-clockwise."""
    return -a[1], a[0]


def carried_velocity(arm: Vector, omega: Number) -> Vector:
    """omega S r: what the turning of its body adds to the velocity of a point at the arm r from the body's start."""
    return -omega * arm[1], omega * arm[0]


def carried_acceleration(arm: Vector, omega: Number, epsilon: Number) -> Vector:
    """epsilon S r - omega^2 r: the same of its acceleration (Kane & Levinson 1985, sec. 2.7: two points of a body)."""
    square = omega**2
    return -epsilon * arm[1] - square * arm[0], epsilon * arm[0] - square * arm[1]


def relative_acceleration(arm: Vector, arm_rate: Vector, omega: Number, epsilon: Number) -> Vector:
    """2 omega S r' + epsilon S r - omega^2 r: the same of a point that moves in axes that turn (ibid., sec. 2.8)."""
    x, y = carried_acceleration(arm, omega, epsilon)
    return x - 2 * omega * arm_rate[1], y + 2 * omega * arm_rate[0]
