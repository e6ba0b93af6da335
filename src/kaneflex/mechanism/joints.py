"""What joints and drives demand of the sections that they hold, over any kind of number, and its derivatives.

A joint meets two sections, one of each body: their :class:`~.planar.Pose` says where the points are and how the
sections stand there. Residuals are second minus first, so that a positive multiplier acts on the second body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.planar import Number, Pose, Vector, cross, dot, minus, pose_at

_TINY = 1e-30
"""Imaginary step: f(x + i h) = f(x) + i h f'(x) to the last bit (Squire & Trapp 1998, SIAM Review 40)."""

Poses = Mapping[str, np.ndarray]
"""Body -> x, y of its start [m] and its angle [rad], global; the ground's are zero."""


def demanded(joint: Joint, gap: Vector, turn: Number, along: Vector) -> tuple[Number, ...]:
    """What must vanish at a joint, in the order of its ``rows``.

    ``gap`` leads from the first point to the second, ``turn`` is by how much the second section stands against the
    first beyond the joint's angle, ``along`` the guide's direction; all global.
    """
    return (cross(along, gap), turn) if joint.slides else (*gap, turn)[: len(joint.rows)]


def residuals(joint: Joint, first: Pose, second: Pose) -> tuple[Number, ...]:
    """Residuals of a joint's constraints, lengths [m] and angles [rad], in the order of its ``rows``."""
    gap = minus(second.origin, first.origin)
    return demanded(joint, gap, second.phi - first.phi - joint.angle, first.turn(joint.direction))


def coordinate(joint: Joint, first: Pose, second: Pose) -> Number:
    """Coordinate of a joint: its angle [rad], or its slide along the guide [m]."""
    if not joint.slides:
        return second.phi - first.phi
    return dot(first.turn(joint.direction), minus(second.origin, first.origin))


class Constraints:
    """Residuals of joints, then of the drives among them, in the coordinates of rigid bodies; by numbers.

    ``drives`` has the coordinates of the drives [rad or m].
    """

    def __init__(self, mechanism: Mechanism, drives: Mapping[str, float]):
        self.mechanism, self.drives = mechanism, drives

    def driven(self, joints: Sequence[str]) -> list[str]:
        return [name for name in joints if name in self.drives]

    def residuals(self, poses: Poses, joints: Sequence[str]) -> np.ndarray:
        """One number a constraint: lengths [m] and angles [rad]."""
        constraints, coordinates = [], []
        for name in joints:
            joint = self.mechanism.joints[name]
            sections = _sections(joint, poses)
            constraints += residuals(joint, *sections)
            if name in self.drives:
                coordinates.append(coordinate(joint, *sections) - self.drives[name])
        return np.array(constraints + coordinates)

    def jacobian(self, poses: Poses, bodies: Sequence[str], joints: Sequence[str]) -> np.ndarray:
        """Derivatives of the residuals by x, y, phi of some bodies, exact: by an imaginary step of each."""
        column = {name: 3 * k for k, name in enumerate(bodies)}
        held = sum(len(self.mechanism.joints[name].rows) for name in joints)
        found = np.zeros((held + len(self.driven(joints)), 3 * len(bodies)))
        row, driven = 0, held
        for name in joints:
            joint = self.mechanism.joints[name]
            rows = [*range(row, row + len(joint.rows)), *([driven] if name in self.drives else [])]
            row, driven = row + len(joint.rows), driven + (name in self.drives)
            sections = _sections(joint, poses)
            for k, side in enumerate(joint.sides):
                if side.body not in column:
                    continue
                moved = poses[side.body][:, None] + 1j * _TINY * np.eye(3)
                section = pose_at(*moved, np.cos, np.sin).section(side.at)
                first, second = (section, sections[1]) if k == 0 else (sections[0], section)
                values = [*residuals(joint, first, second)]
                values += [coordinate(joint, first, second)] if name in self.drives else []
                found[rows, column[side.body] : column[side.body] + 3] = np.imag(values) / _TINY
        return found


def _sections(joint: Joint, poses: Poses) -> list[Pose]:
    return [pose_at(*poses[side.body].tolist()).section(side.at) for side in joint.sides]
