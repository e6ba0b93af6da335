"""Distance of a mechanism to its dead centres (singular positions)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kaneflex.mechanism.closure import Courses, joint_course, turns_around
from kaneflex.mechanism.joints import axes_of
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.planar import cross, dot
from kaneflex.mechanism.position_analysis import Dyad, Group, closing_groups

_NEAR = math.radians(10.0)
"""Transmission angle below which forces are more than five times amplified."""
_WEAK = 0.1
"""Smallest singular value without a warning, as a share of its maximum over the motion: at a fold of the closure it
falls with the root of the remaining distance."""
_INSTANTS = 180
"""Largest number of instants at which singular values are computed."""


@dataclass(frozen=True)
class Closing:
    """Distance of a group of bodies to singular positions over a motion.

    Attributes
    ----------
    name : str
        The joint between the two bodies of a dyad; the bodies of a larger group.
    is_angle : bool
        True if ``values`` are transmission angles [rad], 0 at a dead centre and pi/2 at best; else they are smallest
        singular values of the group's constraints, lengths in sizes of the mechanism.
    values : ndarray (n,)
    position : str
        Coordinates of the drives at the minimum.
    """

    name: str
    is_angle: bool
    values: np.ndarray
    position: str

    @property
    def text(self) -> str:
        """Range of the values, as text."""
        scaled = np.degrees(self.values) if self.is_angle else self.values
        low, high = (f"{value:.3g}" for value in (scaled.min(), scaled.max()))
        unit = " deg" if self.is_angle else ""
        at = f", minimum at {self.position}" if self.position and low != high else ""
        return f"{self.name} {low if low == high else f'{low} to {high}'}{unit}{at}"

    @property
    def note(self) -> str:
        """Warning; empty far from dead centres."""
        least, at = float(self.values.min()), f"at {self.position} " if self.position else ""
        if self.is_angle and least < _NEAR:
            return (
                f"{at}the transmission angle at {self.name} is {math.degrees(least):.2g} deg (0 at a dead centre): "
                f"joint forces reach {1.0 / max(math.sin(least), 1e-9):.3g} times the transmitted force, and with "
                "clearance the loop may change its branch; at least 40 deg is usual"
            )
        if not self.is_angle and least < _WEAK * self.values.max():
            return (
                f"{at}the smallest singular value of {self.name} is {least / self.values.max():.2g} of its largest "
                "value: the loop is near a dead centre or a change of branch, where forces grow without bound"
            )
        return ""


def closings(mechanism: NumericMechanism, courses: Courses) -> list[Closing]:
    """Distance of each loop of a planar mechanism to its dead centres over a motion.

    The transmission angle (Alt 1932; Norton, Design of Machinery) of three pins is that between the two links at the
    middle one; of a rod and a slider that between the rod and the guide's normal; of a slider on a lever that between
    the line of the pivots and the slide's normal. All three are zero where the loop's constraints are singular.
    """
    if mechanism.frame or not mechanism.joints:
        return []
    found = []
    for group in closing_groups(mechanism):
        if len(group.bodies) == 1:
            continue
        values = None if group.dyad is None else _transmission(group.dyad, courses)
        name, is_angle, every = ", ".join(group.bodies), values is not None, 1
        if values is None:
            every = -(-courses[group.bodies[0]].shape[1] // _INSTANTS)
            values = _smallest(mechanism, group, courses, every)
        elif group.dyad is not None:
            name = group.dyad.middle.name
        found.append(Closing(name, is_angle, values, _position(mechanism, courses, every * int(values.argmin()))))
    return found


def _smallest(mechanism: NumericMechanism, group: Group, courses: Courses, every: int) -> np.ndarray:
    """Smallest singular value of the constraints by joints and drives on a group, lengths in sizes of the mechanism; at
    every n-th instant."""
    constraints = group.constraints(mechanism, dict.fromkeys(mechanism.drives, 0.0))
    poses = {name: course[:, ::every] for name, course in courses.items()}
    return np.linalg.svd(constraints.scaled_jacobian(poses), compute_uv=False)[:, -1]


def _transmission(dyad: Dyad, courses: Courses) -> np.ndarray | None:
    """Transmission angle of a dyad over the motion [rad], (n,); None if not defined."""
    vectors = dyad.vectors(axes_of(courses))
    return None if vectors is None else np.arctan2(abs(cross(*vectors)), abs(dot(*vectors)))


def _position(mechanism: NumericMechanism, courses: Courses, k: int) -> str:
    """Coordinates of the drives at an instant, "main = 90 deg"."""
    found = {}
    for name in mechanism.drives:
        joint = mechanism.joints[name]
        course = joint_course(joint, courses)
        found[name] = course[k] % math.tau if not joint.slides and turns_around(course) else course[k]
    return mechanism.written(found)
