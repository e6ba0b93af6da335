"""What joints and drives demand of the bodies' places, by numbers: residuals and their derivatives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from kaneflex.scene import Scene
from kaneflex.scene.parts import Joint
from kaneflex.scene.quantities import Address

Poses = Mapping[str, np.ndarray]
"""Body -> x, y of its start [m] and its angle [rad], global."""


def constraint_count(joint: Joint) -> int:
    """Constraints of a joint in the plane."""
    return 3 if joint.kind == "weld" else 2


class Rows:
    """Residuals of joints, then of the drives among them, in the bodies' coordinates; second side minus first."""

    def __init__(self, scene: Scene, drives: Mapping[str, float]):
        self.scene, self.drives = scene, drives
        points = [math.hypot(*scene.point(side)) for joint in scene.joints.values() for side in joint.addresses]
        self.size = max([*points, *(body.length or 0.0 for body in scene.bodies.values())]) or 1.0

    def driven(self, joints: Sequence[str]) -> list[str]:
        return [name for name in joints if name in self.drives]

    def residuals(self, poses: Poses, joints: Sequence[str]) -> np.ndarray:
        """One number a constraint: lengths [m] and angles [rad]."""
        constraints, coordinates = [], []
        for name in joints:
            joint = self.scene.joints[name]
            gap, turn = self._gap(poses, joint)
            if joint.kind == "prismatic":
                t = turned(joint.direction, poses[joint.addresses[0].body][2])
                constraints += [t[0] * gap[1] - t[1] * gap[0], turn]
            else:
                constraints += [*gap, turn - joint.relative_angle][: constraint_count(joint)]
            if name in self.drives:
                moved = t @ gap if joint.kind == "prismatic" else turn
                coordinates.append(moved - self.drives[name])
        return np.array(constraints + coordinates)

    def jacobian(self, poses: Poses, bodies: Sequence[str], joints: Sequence[str]) -> np.ndarray:
        """Derivatives of the residuals by x, y, phi of some bodies."""
        constraints, coordinates = [], []
        column = {name: 3 * k for k, name in enumerate(bodies)}
        for name in joints:
            joint = self.scene.joints[name]
            by_gap = np.zeros((2, 3 * len(bodies)))
            by_turn = np.zeros(3 * len(bodies))
            for side, sign in zip(joint.addresses, (-1.0, 1.0), strict=True):
                if side.body in column:
                    k = column[side.body]
                    x, y = turned(self.scene.point(side), poses[side.body][2])
                    by_gap[:, k : k + 3] = sign * np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
                    by_turn[k + 2] = sign
            if joint.kind == "prismatic":
                carrier = joint.addresses[0].body
                t = turned(joint.direction, poses[carrier][2])
                n, (gap, _) = np.array([-t[1], t[0]]), self._gap(poses, joint)
                across, along = n @ by_gap, t @ by_gap
                if carrier in column:  # t' = n, n' = -t as the carrier turns
                    across[column[carrier] + 2] -= t @ gap
                    along[column[carrier] + 2] += n @ gap
                constraints += [across, by_turn]
            else:
                constraints += [*by_gap, by_turn][: constraint_count(joint)]
            if name in self.drives:
                coordinates.append(along if joint.kind == "prismatic" else by_turn)
        return np.array(constraints + coordinates)

    def _gap(self, poses: Poses, joint: Joint) -> tuple[np.ndarray, float]:
        first, second = joint.addresses
        gap = place_of(self.scene, poses, second) - place_of(self.scene, poses, first)
        return gap, poses[second.body][2] - poses[first.body][2]


def place_of(scene: Scene, poses: Poses, address: Address) -> np.ndarray:
    """Global position of a body's or the ground's point [m], (2,)."""
    if address.body == "ground":
        return np.array(scene.point(address))
    pose = poses[address.body]
    return pose[:2] + turned(scene.point(address), pose[2])


def turned(vector: Sequence[float], angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])
