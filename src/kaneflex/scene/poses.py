"""Orientation of bodies in space, poses of fixed bodies and initial states of free ones."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from pydantic import model_validator

from kaneflex.scene.quantities import Angle, AngularSpeed, AngularVelocity, Direction, Point, Velocity
from kaneflex.scene.table import SceneTable
from kaneflex.support.errors import Fault

_ALONG = 1e-6
"""Largest sine of the angle between two directions that count as equal."""


class Rotation(SceneTable):
    """Axes of a body in global axes: by the direction of its `x` axis, and of its `y` axis or a vector in the x-y
    half-plane (default: global y, or z if x is along y); or by an `angle` (rad) about an `axis`.
    """

    x: Direction | None = None
    y: Direction | None = None
    axis: Direction | None = None
    angle: Angle = 0.0

    @model_validator(mode="after")
    def _one_way(self) -> Rotation:
        if (self.x is None) == (self.axis is None):
            raise Fault("exactly one of x and axis is required", "Give the direction of x, or an axis with its angle")
        if self.axis is None and "angle" in self.model_fields_set:
            raise Fault("needs an axis", "Leave it out, or give the axis", below="angle")
        if self.axis is not None and "angle" not in self.model_fields_set:
            raise Fault("the axis has no angle", "Give it, like angle = '90 deg'", below="angle")
        if self.axis is not None and self.y is not None:
            raise Fault("needs x", "Leave it out, or give x", below="y")
        if self.x is not None and self.y is not None and len(self.x) == len(self.y) == 3:
            if np.linalg.norm(np.cross(self.x, self.y)) < _ALONG:
                raise Fault("it is along x", "Give another direction, or leave it out", below="y")
        return self

    @cached_property
    def matrix(self) -> np.ndarray:
        """Axes x, y, z as columns, (3, 3)."""
        if self.axis is not None:
            return about(np.asarray(self.axis), self.angle)
        x = np.asarray(self.x)
        y = np.array([0.0, 1.0, 0.0]) if self.y is None else np.asarray(self.y)
        if self.y is None and np.linalg.norm(np.cross(x, y)) < _ALONG:
            y = np.array([0.0, 0.0, 1.0])
        y = y - (x @ y) * x
        y /= np.linalg.norm(y)
        return np.stack([x, y, np.cross(x, y)], axis=1)


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Matrix of a rotation by an angle [rad] about a unit vector: Rodrigues' formula."""
    c, s, (x, y, z) = math.cos(angle), math.sin(angle), axis  # without scipy, whose import takes longer than a run
    return c * np.eye(3) + (1.0 - c) * np.outer(axis, axis) + s * np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


class Pose(SceneTable):
    """Pose of a body in a fixed structure: global position of its start (m) and its angle (rad)."""

    at: Point = (0.0, 0.0)
    angle: Angle = 0.0


class Free(SceneTable):
    """Initial state of a free body, in global axes: position of its start (m), angle (rad), and their rates
    (m/s, rad/s). In space the body's `rotation` gives its orientation, and `angular_velocity` has three components."""

    at: Point = (0.0, 0.0)
    angle: Angle = 0.0
    velocity: Velocity = (0.0, 0.0)
    angular_speed: AngularSpeed = 0.0
    angular_velocity: AngularVelocity | None = None

    @property
    def place(self) -> tuple[float, float, float]:
        return *self.at, self.angle

    @property
    def rates(self) -> tuple[float, float, float]:
        return *self.velocity, self.angular_speed
