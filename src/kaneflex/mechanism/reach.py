"""Ranges of a mechanism's joints, and coinciding points, which reveal a loop closed on the wrong branch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.joints import coordinate
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.planar import GROUND, Pose, pose_at
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.mechanism.position_analysis import Placement

Courses = Mapping[str, np.ndarray]
"""Body -> x, y of its start [m] and its angle [rad] over the motion, (3, n)."""
_TURN = 360
"""Samples per turn of the fastest drive."""
_MOST = 720
"""Largest number of samples."""
_SAME = 1e-6
"""Distance below which points coincide, as a share of the mechanism's size."""


def courses_of(scene: Scene, rigid: RigidMotion) -> Courses:
    """Poses of a rigid motion."""
    found = {}
    for name in scene.bodies:
        angle = np.unwrap(np.arctan2(rigid[f"{name}.s"], rigid[f"{name}.c"]))
        found[name] = np.array([rigid[f"{name}.x"], rigid[f"{name}.y"], angle])
    return found


def followed(scene: Scene, placement: Placement) -> Courses:
    """Poses of the run by position analysis; only of the start if a joint is free, the motion is not determined by
    joints and drives, or the linkage locks."""
    from kaneflex.mechanism.closure_continuation import follow
    from kaneflex.mechanism.position_analysis import coordinate_at

    here = {name: pose[:, None] for name, pose in placement.poses.items()}
    mechanism = mechanism_of(scene)
    held = len(mechanism.drives) + sum(len(joint.rows) for joint in mechanism.joints.values())
    if scene.is_frame or not scene.drives or any(drive.free for drive in scene.drives.values()):
        return here
    if held != 3 * len(mechanism.bodies):
        return here
    times = instants(scene)
    try:
        drives = scene.drives.items()
        poses = follow(scene, times, lambda t: {name: coordinate_at(drive, t) for name, drive in drives}, placement)
    except SceneError:
        return here  # loading reports the position
    return {name: poses[:, k].T for k, name in enumerate(scene.bodies)}


def instants(scene: Scene) -> np.ndarray:
    """Times [s] at which the reach of a run is sampled: of one turn if the motion repeats, so that samples do not fall
    on the same positions again."""
    drives, horizon = scene.drives, scene.horizon
    turning = [abs(drive.speed) for name, drive in drives.items() if drive.speed and not scene.slides(name)]
    slowest = min(turning, default=0.0)
    steady = all(drive.kind == "constant speed" for drive in drives.values()) and len(turning) == len(drives) > 0
    if steady and all(math.isclose(speed / slowest, round(speed / slowest)) for speed in turning):
        horizon = min(horizon, math.tau / slowest)
    turns = max(turning, default=0.0) * horizon / math.tau
    return np.linspace(0.0, horizon, min(_MOST, max(_TURN, math.ceil(_TURN * turns))) + 1)


def reach_lines(scene: Scene, courses: Courses) -> dict[str, str]:
    """Range of each joint as text, and under "coincide" the points that coincide at the start without a joint."""
    found = {}
    for name, joint in mechanism_of(scene).joints.items():
        if joint.kind == "weld":
            continue
        course = joint_course(joint, courses)
        if joint.slides:
            course = 1e3 * course
            found[name] = f"{_range(course)} mm" + (f", a stroke of {np.ptp(course):.4g} mm" if len(course) > 1 else "")
        else:
            found[name] = "full turns" if turns_around(course) else f"{_range(np.degrees(course))} deg"
    meeting = _meeting(scene, courses)
    return found | ({"coincide": "; ".join(meeting)} if meeting else {})


def joint_course(joint: Joint, courses: Courses) -> np.ndarray:
    """Coordinate of a joint over the motion [rad or m], (n,), continuous, starting within half a turn of zero."""
    course = coordinate(joint, *(pose_over(courses, side.body).section(side.at) for side in joint.sides))
    return course if joint.slides else course - math.tau * np.round(course[0] / math.tau)


def turns_around(course: np.ndarray) -> bool:
    """True if the coordinate [rad] of a joint covers a whole turn."""
    return bool(np.ptp(course) > math.radians(359.0))


def _range(course: np.ndarray) -> str:
    low, high = (f"{value + 0.0:.4g}" for value in (course.min(), course.max()))
    return low if low == high else f"{low} to {high}"


def pose_over(courses: Courses, body: str) -> Pose:
    """Pose of a body or the ground over the motion."""
    return pose_at(*(np.zeros((3, 1)) if body == GROUND else courses[body]), cos=np.cos, sin=np.sin)


def _meeting(scene: Scene, courses: Courses) -> list[str]:
    """Points of two bodies that coincide at the start without a joint."""
    points = [Address(name, point) for name, body in scene.bodies.items() for point in body.points_all]
    start = {name: pose_at(*course[:, 0]) for name, course in courses.items()}
    places = {address: np.array(start[address.body].place(scene.point(address))) for address in points}
    size = max([abs(place).max() for place in places.values()], default=0.0) or 1.0
    return [
        f"{one} and {other}"
        for one, other in combinations(points, 2)
        if one.body != other.body
        and abs(places[one] - places[other]).max() <= _SAME * size
        and not _joined(scene, one, other)
    ]


def _joined(scene: Scene, one: Address, other: Address) -> bool:
    """True if joints at these points connect them, also through other bodies; a point may have several names."""
    pins = [{_spot(scene, side) for side in joint.addresses} for joint in scene.joints.values()]
    reached = {_spot(scene, one)}
    while more := {side for pin in pins if pin & reached for side in pin} - reached:
        reached |= more
    return _spot(scene, other) in reached


def _spot(scene: Scene, address: Address) -> tuple[str, tuple[float, ...]]:
    return address.body, tuple(scene.point(address))
