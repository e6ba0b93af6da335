"""Checks that loops close, ranges of joints, and coinciding points, which reveal a loop closed on the wrong branch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations

import numpy as np

from kaneflex.mechanism.joints import axes_of, course
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.numbers import Numbers
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError

_OPEN = 1e-9
"""Largest gap of a closed loop, as a share of the mechanism's size; a coordinate below it is printed as zero."""
SWEEP = 720
"""Samples of a cycle at which the linkage must close before anything is computed."""
_SINGULAR = 1e-14
"""Margin of rounding, a hundred times that of a squared length."""
_SMALL, _PARTS, _LEVELS = 1e-2, 64, 4
"""Share of a loop's largest margin below which its least value is searched between instants, and how finely: the
distance shrinks to 1e-6 of a sample, its square to rounding."""


def check_closure(mechanism: NumericMechanism, motion: RigidKinematics, horizon: float) -> None:
    """Raise SceneError unless every loop closes with a margin over the drives' range up to ``horizon`` [s]."""
    check_loops(mechanism, motion.at(np.linspace(0.0, horizon, SWEEP + 1)))


def check_loops(mechanism: NumericMechanism, rigid: RigidMotion) -> None:
    """Raise SceneError unless every loop closes at all instants of a rigid motion, up to rounding."""
    for name in (name for name in rigid.motion.column if name.endswith(".gap")):
        size = max(abs(rigid[f"{body}.{axis}"]).max() for body in mechanism.bodies for axis in "xy")
        worst = int(np.argmax(np.nan_to_num(rigid[name], nan=np.inf)))
        if not rigid[name][worst] <= _OPEN * size:
            raise SceneError(
                f"joints.{name.removesuffix('.gap')}", None,
                f"the loop cannot close: a gap of {rigid[name][worst]:.2g} m remains at "
                f"{drive_positions(mechanism, rigid, worst)}, near a dead centre",
                "Change the lengths, or limit the drive's range",
            )  # fmt: skip
    for name in margins_of(rigid):
        near = _nearest_end(rigid, name)
        closes = near[name] > -_SINGULAR
        if (near[name] > _SINGULAR).all():
            continue
        joint = mechanism.joints[name.removesuffix(".closure")]
        at = drive_positions(mechanism, near, int(np.argmin(near[name] if closes.all() else closes)))
        reason = f"the loop cannot close: at {at} {reason_open(joint)}"
        if closes.all():
            reason = f"singular position: at {at} {' and '.join(joint.bodies)} lie on one line, joint forces are "
            reason += "infinite and two branches meet"
        free = mechanism.free_joints
        other = f"let {', '.join(free)} start elsewhere" if free else "limit the drive's range"
        raise SceneError(f"joints.{joint.name}.branch", joint.written_branch, reason, f"Change the lengths, or {other}")


def _nearest_end(rigid: RigidMotion, name: str) -> RigidMotion:
    """The motion around the least value of a loop's margin, which may lie between two instants, where the margin is
    small: a change point is a touched zero, a square of the distance."""
    for _ in range(_LEVELS if len(rigid.times) > 2 else 0):
        margin = rigid[name]
        k = int(np.argmin(margin))
        if not 0.0 < margin[k] < _SMALL * margin.max() or not 0 < k < len(margin) - 1:
            break
        rigid = rigid.motion.at(np.linspace(rigid.times[k - 1], rigid.times[k + 1], _PARTS + 1))
    return rigid


def changed_speed(entry: str, given: float, found: float) -> SceneError:
    """Error for a given initial speed that the loops change."""
    return SceneError(
        entry, given,
        f"the loops and other speeds make it {found:.9g}: a loop locks this joint, or is in a singular position",
        "Start near this position, or give as many initial speeds as the mechanism has degrees of freedom",
    )  # fmt: skip


def reason_open(joint: Joint) -> str:
    """Reason why a loop's closing joint can't close it."""
    first, second = joint.bodies
    if joint.slides:
        return f"{second} does not reach its guide on {first}"
    return f"{first} and {second} do not meet"


def margins_of(rigid: RigidMotion) -> list[str]:
    return [name for name in rigid.motion.column if name.endswith(".closure")]


def drive_positions(mechanism: NumericMechanism, rigid: RigidMotion, index: int = 0) -> str:
    """Positions of the first three drives at an instant, like "main = 90 deg"."""
    return mechanism.written({name: rigid[f"{name}.angle"][index] for name in list(mechanism.drives)[:3]})


Courses = Mapping[str, np.ndarray]
"""Body -> x, y of its start [m] and its angle [rad] over the motion, (3, n)."""
_TURN = 360
"""Samples per turn of the fastest drive."""
_MOST = 720
"""Largest number of samples."""
_SAME = 1e-6
"""Distance below which points coincide, as a share of the mechanism's size."""


def courses_of(mechanism: NumericMechanism, rigid: RigidMotion) -> Courses:
    """Poses of a rigid motion."""
    found = {}
    for name in mechanism.bodies:
        angle = np.unwrap(np.arctan2(rigid[f"{name}.s"], rigid[f"{name}.c"]))
        found[name] = np.array([rigid[f"{name}.x"], rigid[f"{name}.y"], angle])
    return found


def instants(mechanism: NumericMechanism) -> np.ndarray:
    """Times [s] at which the reach of a run is sampled: of one turn if the motion repeats, so that samples do not fall
    on the same positions again."""
    drives, horizon, joints = mechanism.drives, mechanism.horizon, mechanism.joints
    assert horizon is not None  # checked with the scene
    turning = [abs(drive.speed) for name, drive in drives.items() if drive.speed and joints[name].kind != "prismatic"]
    slowest = min(turning, default=0.0)
    steady = all(drive.kind == "constant speed" for drive in drives.values()) and len(turning) == len(drives) > 0
    if steady and all(math.isclose(speed / slowest, round(speed / slowest)) for speed in turning):
        horizon = min(horizon, math.tau / slowest)
    turns = max(turning, default=0.0) * horizon / math.tau
    return np.linspace(0.0, horizon, min(_MOST, max(_TURN, math.ceil(_TURN * turns))) + 1)


def reach_lines(mechanism: NumericMechanism, courses: Courses) -> dict[str, str]:
    """Range of each joint as text, and under "coincide" the points that coincide at the start without a joint."""
    found = {}
    for name, joint in mechanism.joints.items():
        if joint.kind == "weld":
            continue
        found[name] = reach_line(mechanism, joint_course(joint, courses), joint.slides)
    meeting = _meeting(mechanism, courses)
    return found | ({"coincide": "; ".join(meeting)} if meeting else {})


def reach_line(mechanism: Numbers, course: np.ndarray, slides: bool) -> str:
    """Range of the coordinate of a joint over the motion [rad or m], (n,), as text, without differences from zero or
    from its start below 1e-9 of a turn or of the mechanism's size."""
    points = [at for own in mechanism.points.values() for at in own.values()]
    size = max(abs(np.array(each)).max() for each in points) or 1.0
    least = _OPEN * (max(size, abs(course).max()) if slides else math.tau)
    values = np.where(abs(course) < least, 0.0, np.where(abs(course - course[0]) < least, course[0], course))
    if slides:
        stroke = f", a stroke of {1e3 * np.ptp(values):.4g} mm" if len(values) > 1 else ""
        return f"{_range(1e3 * values)} mm{stroke}"
    return "full turns" if turns_around(values) else f"{_range(np.degrees(values))} deg"


def joint_course(joint: Joint, courses: Courses) -> np.ndarray:
    """Coordinate of a joint over the motion [rad or m], (n,), continuous, starting within half a turn of zero."""
    found = course(joint, courses)
    return found if joint.slides else found - math.tau * np.round(found[0] / math.tau)


def turns_around(course: np.ndarray) -> bool:
    """True if the coordinate [rad] of a joint covers a whole turn."""
    return bool(np.ptp(course) > math.radians(359.0))


def _range(course: np.ndarray) -> str:
    low, high = (f"{value + 0.0:.4g}" for value in (course.min(), course.max()))
    return low if low == high else f"{low} to {high}"


def _meeting(mechanism: NumericMechanism, courses: Courses) -> list[str]:
    """Points of two bodies that coincide at the start without a joint."""
    points = [Address(name, point) for name in mechanism.bodies for point in mechanism.points[name]]
    start = axes_of({name: poses[:, 0] for name, poses in courses.items()})
    places = {address: np.array(start[address.body].place(mechanism.point(address))) for address in points}
    size = max([abs(place).max() for place in places.values()], default=0.0) or 1.0

    def spot(address: Address) -> tuple[str, tuple[float, ...]]:
        return address.body, mechanism.point(address)

    def joined(one: Address, other: Address) -> bool:
        """True if joints at these points connect them, also through other bodies; a point may have several names."""
        reached = {spot(one)}
        while more := {side for pin in pins if pin & reached for side in pin} - reached:
            reached |= more
        return spot(other) in reached

    pins = [{(side.body, side.at) for side in joint.sides} for joint in mechanism.joints.values()]
    return [
        f"{one} and {other}"
        for one, other in combinations(points, 2)
        if one.body != other.body
        and abs(places[one] - places[other]).max() <= _SAME * size
        and not joined(one, other)
    ]
