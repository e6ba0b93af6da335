"""Constraints of planar joints and drives, for any kind of number, and their derivatives.

A joint connects two sections, one of each body, whose :class:`~.planar.Pose` is position and orientation. Residuals
are second minus first, so that a positive multiplier acts on the second body.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence

import numpy as np

from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.planar import GROUND, Number, Pose, Vector, cross, dot, minus, pose_at, quarter_turn

_REACTIONS = {
    "force_x": ("N", "force {on}, global x"),
    "force_y": ("N", "force {on}, global y"),
    "normal": ("N", "force {on}, normal to the guide"),
    "moment": ("N m", "moment {on}"),
}
"""Row of a joint -> unit and meaning of its multiplier."""

Poses = Mapping[str, np.ndarray]
"""Body -> global x, y of its start [m] and its angle [rad]: (3,), or (3, n) for n instants; zero for the ground."""


def demanded(joint: Joint, gap: Vector, turn: Number, along: Vector) -> tuple[Number, ...]:
    """Constraint residuals of a joint, in the order of its ``rows``.

    ``gap`` is the vector from the first point to the second, ``turn`` the relative rotation of the sections beyond the
    joint's angle, ``along`` the guide's direction; all global.
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


def course(joint: Joint, poses: Poses) -> Number:
    """Coordinate of a joint between bodies at some poses [rad or m], (n,) for n instants."""
    return coordinate(joint, *_sections(joint, axes_of(poses)))


def reactions(joint: Joint) -> list[tuple[str, str, str]]:
    """Name, unit and meaning of a joint's reactions on its second body, in the order of its ``rows``."""
    on = f"on {joint.second.body} by {joint.first.body}"
    found = [(row, *_REACTIONS[row]) for row in joint.rows]
    return [(f"{joint.name}.{row}", unit, meaning.format(on=on)) for row, unit, meaning in found]


def drive_reaction(joint: Joint) -> tuple[str, str, str]:
    """Name, unit and meaning of a prescribed drive's force or torque on the second body of its joint."""
    unit, meaning = ("N", "force") if joint.slides else ("N m", "torque")
    return f"{joint.name}.drive", unit, f"{meaning} of the drive"


class Constraints:
    """Residuals of joints, then of drives, in the coordinates of rigid bodies; numerical.

    ``drives`` holds the coordinates of the drives [rad or m], one number each or one per instant; ``bodies`` move, and
    ``joints`` act on them, by default all.
    """

    def __init__(
        self, mechanism: NumericMechanism, drives: Mapping[str, Number], bodies: Sequence[str] | None = None,
        joints: Sequence[str] | None = None,
    ) -> None:  # fmt: skip
        self.mechanism, self.drives = mechanism, drives
        self.bodies = tuple(mechanism.bodies if bodies is None else bodies)
        self.joints = tuple(mechanism.joints if joints is None else joints)

    @property
    def driven(self) -> list[str]:
        return [name for name in self.joints if name in self.drives]

    @property
    def scales(self) -> np.ndarray:
        """Scales of the coordinates: the mechanism's size [m], 1 rad for angles."""
        return np.tile([self.mechanism.size, self.mechanism.size, 1.0], len(self.bodies))

    def split(self, coordinates: np.ndarray) -> dict[str, np.ndarray]:
        """Poses by body from the coordinates of all, (3 bodies,), or (3 bodies, n) of n instants."""
        return {name: coordinates[3 * k : 3 * k + 3] for k, name in enumerate(self.bodies)}

    def residuals(self, poses: Poses) -> np.ndarray:
        """Residuals of all constraints, lengths [m] and angles [rad]: (rows,), or (n, rows) for n instants."""
        axes, coordinates = axes_of(poses), []
        constraints: list[Number] = []
        for name in self.joints:
            joint = self.mechanism.joints[name]
            sections = _sections(joint, axes)
            constraints += residuals(joint, *sections)
            if name in self.drives:
                coordinates.append(coordinate(joint, *sections) - self.drives[name])
        found = np.empty((*_instants(poses), len(constraints) + len(coordinates)))
        for row, value in enumerate(constraints + coordinates):
            found[..., row] = value
        return found

    @property
    def units(self) -> np.ndarray:
        """Scales of the residuals: the mechanism's size [m], 1 rad for angles."""
        parts = self.mechanism.joints
        angles = [row == "moment" for name in self.joints for row in parts[name].rows]
        angles += [not parts[name].slides for name in self.driven]
        return np.where(angles, 1.0, self.mechanism.size)

    def jacobian(self, poses: Poses) -> np.ndarray:
        """Jacobian of the residuals by x, y, phi of the bodies, (rows, 3 bodies), or (n, rows, 3 bodies)."""
        axes, column = axes_of(poses), {name: 3 * k for k, name in enumerate(self.bodies)}
        held = sum(len(self.mechanism.joints[name].rows) for name in self.joints)
        found = np.zeros((*_instants(poses), held + len(self.driven), 3 * len(self.bodies)))
        row, drive = 0, held
        for name in self.joints:
            joint, driven = self.mechanism.joints[name], name in self.drives
            rows = [*range(row, row + len(joint.rows)), *[drive] * driven]
            for body, derivatives in derivatives_of(joint, axes, driven, column):
                for k, values in enumerate(derivatives, column[body]):
                    for at, value in zip(rows, values, strict=True):
                        found[..., at, k] = value
            row, drive = row + len(joint.rows), drive + driven
        return found

    def scaled_jacobian(self, poses: Poses) -> np.ndarray:
        """The same with lengths in sizes of the mechanism."""
        return self.jacobian(poses) * self.scales / self.units[:, None]


def normalised(jacobian: np.ndarray, size: float) -> np.ndarray:
    """Normalised rows, with angles scaled by the mechanism's size: ranks do not depend on the unit of length."""
    jacobian[..., 2::3] /= size
    lengths = np.linalg.norm(jacobian, axis=-1, keepdims=True)
    return jacobian / np.where(lengths > 0.0, lengths, 1.0)


def derivatives_of(
    joint: Joint, axes: Mapping[str, Pose], driven: bool, bodies: Container[str]
) -> Iterator[tuple[str, list[list[Number]]]]:
    """Derivatives of a joint's residuals and, if driven, of its coordinate by x, y, phi of each side's body.

    Both are linear in the gap and in the rotation; the guide's direction rotates with the first body. These are also
    the force x, y and the moment about a body's start by unit reactions.
    """
    first, second = _sections(joint, axes)
    along, gap = first.turn(joint.direction), minus(second.origin, first.origin)
    for side, sign in zip(joint.sides, (-1.0, 1.0), strict=True):
        if side.body not in bodies:
            continue
        x, y = quarter_turn(axes[side.body].turn(side.at)) if any(side.at) else (0.0, 0.0)
        found = []
        for shift, turn in (((sign, 0.0), 0.0), ((0.0, sign), 0.0), ((sign * x, sign * y), sign)):
            values = [*demanded(joint, shift, turn, along)]
            if driven:
                values.append(dot(along, shift) if joint.slides else turn)
            found.append(values)
        if joint.slides and sign < 0.0:
            across = quarter_turn(along)
            found[2][0] += cross(across, gap)
            if driven:
                found[2][-1] += dot(across, gap)
        yield side.body, found


def _sections(joint: Joint, axes: Mapping[str, Pose]) -> list[Pose]:
    """Axes of both bodies' sections at a joint."""
    return [axes[side.body].section(side.at) for side in joint.sides]


def axes_of(poses: Poses) -> dict[str, Pose]:
    """Axes of bodies and of the ground."""
    found = {GROUND: Pose(0.0, 0.0, 1.0, 0.0, 0.0)}
    for name, pose in poses.items():
        x, y, phi = pose.tolist() if pose.ndim == 1 else pose  # a quarter of the time for floats
        found[name] = pose_at(x, y, phi) if pose.ndim == 1 else pose_at(x, y, phi, np.cos, np.sin)
    return found


def _instants(poses: Poses) -> tuple[int, ...]:
    return np.broadcast_shapes(*(pose.shape[1:] for pose in poses.values()))
