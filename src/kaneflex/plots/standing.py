"""Points and directions of a scene at one configuration, as a drawing shows them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.plots.drawing import MM
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address


class Standing:
    """A scene in the plane at a placement, or in space at the first instant of a motion."""

    def __init__(self, scene: Scene, placed: Placement | RigidMotion) -> None:
        self.scene, self.placed = scene, placed
        self.view = np.eye(2)
        if scene.is_spatial:
            from kaneflex.plots.axonometric import VIEW

            self.view = VIEW

    @property
    def drives(self) -> Mapping[str, float]:
        """Coordinates of the drives that have one [rad or m]."""
        if isinstance(self.placed, Placement):
            return self.placed.drives
        known = [name for name in self.scene.drives if f"{name}.angle" in self.placed]
        return {name: float(self.placed[f"{name}.angle"][0]) for name in known}

    def point(self, body: str, at: Any) -> np.ndarray:
        """Place in the drawing of a point in a body's axes [mm], (2,)."""
        if isinstance(self.placed, Placement):
            return MM * np.array(self.placed.pose(body).place(at))
        return MM * self.view @ self.placed.frame(body).place(at)[:, 0]

    def at(self, address: Address) -> np.ndarray:
        """Place in the drawing of an address [mm], (2,)."""
        return self.point(address.body, self.scene.point(address))

    def direction(self, body: str, vector: Any) -> np.ndarray:
        """A vector in a body's axes as it is drawn, (2,); shorter where it points to or from the viewer."""
        if isinstance(self.placed, Placement):
            return np.array(self.placed.pose(body).turn(vector))
        return self.view @ self.placed.frame(body).to_global(np.reshape(vector, (3, 1)))[:, 0]

    def around(self, joint: str, turn: np.ndarray) -> np.ndarray:
        """Points at angles [rad] of the unit circle around a joint's axis, as they are drawn, (n, 2)."""
        first, axes = self.scene.joints[joint].addresses[0].body, self.scene.joints[joint].given_axes
        if not self.scene.is_spatial:
            return np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        axis = np.array(axes[-1] if axes else (0.0, 0.0, 1.0))
        helper = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        one = helper / np.linalg.norm(helper)
        other = np.cross(axis / np.linalg.norm(axis), one)
        drawn = [self.direction(first if axes else GROUND, tuple(each)) for each in (one, other)]
        return np.outer(np.cos(turn), drawn[0]) + np.outer(np.sin(turn), drawn[1])
