"""Orientation of a body in space."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from pydantic import model_validator

from kaneflex.scene.quantities import Angle, Direction
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
    """Matrix of a rotation by an angle [rad] about a unit vector."""
    from scipy.spatial.transform import Rotation as Turn

    return Turn.from_rotvec(angle * axis).as_matrix()
