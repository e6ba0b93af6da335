"""Starting values for loops closed by Newton's method: tables of the assembly over the drive's range.

Position analysis follows the scene's assembly. If the determinant of the constraints' Jacobian changes its sign, or
small steps leave the tangent, the linkage locks or would change its branch. This is found before anything is computed,
and the kernels need no memory of earlier positions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from kaneflex.mechanism.closure import Courses, instants
from kaneflex.mechanism.joints import Constraints, axes_of, course
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.position_analysis import Placement, is_same, place
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.scene.tables import Table
from kaneflex.support.errors import SceneError

_KNOTS = 720
"""Number of knots of a turn, or of the drive's range."""
_AHEAD, _MOST_TANGENTS = 8, 20_000
"""Least number of positions that are sought from one tangent, and the largest number of tangents, 20 s."""
_SHARES = 2.0 ** -np.arange(1, 17)
"""Shares of a step that leaves the tangent; if none of them stays on it, the linkage counts as locked."""
_FAR, _BENT = 0.25, 0.2
"""Longest step along a tangent, in rad or sizes of the mechanism, and the largest deviation from it, as a share of the
step, that counts as staying on the branch."""
_ROUNDING = 1e-10
"""Deviation, in rad or sizes of the mechanism, that is only rounding, as when the drives dwell."""
_ITERATIONS, _CLOSED = 12, 1e-12
"""Most steps of Newton's method, and the last step, in rad or sizes of the mechanism, with which a loop is closed."""


def seed_loops(
    mechanism: NumericMechanism, module: ModuleType, parameters: np.ndarray, horizon: float
) -> np.ndarray:
    """Argument p of the kernels with the tables of starting values appended; unchanged without such loops.

    Raises
    ------
    SceneError
        If a loop can't close, closes in more ways than the scene chooses from, or locks within the drive's range over
        ``horizon`` [s]; it names the joint that closes the loop and the drive's coordinate.
    """
    loops = getattr(module, "LOOPS", ())
    if not loops:
        return parameters
    sweep = _swept(mechanism, module, parameters, horizon)
    columns, axes = dict[str, np.ndarray](), axes_of(sweep.courses)
    for _, _, turning, sliding in loops:
        columns |= {f"bodies.{body}.seed_{key}": getattr(axes[body], key) for body in turning for key in "cs"}
        columns |= {f"joints.{joint}.seed_slide": course(mechanism.joints[joint], sweep.courses)
                    for joint in sliding}  # fmt: skip
    blocks = {path: Table(sweep.x, column).coefficients(sweep.period) for path, column in columns.items()}
    p, places = with_tables(module, parameters, blocks), _places(module)
    sides = {closing: places[f"joints.{closing}.side"] for closing, *_ in loops}
    p[[*sides.values()]] = 1.0
    first = RigidKinematics(module, p).at(0.0)
    for closing, side in sides.items():
        p[side] = math.copysign(1.0, first[f"{closing}.closure"][0])
    return p


def _places(module: ModuleType) -> dict[str, int]:
    """Index in p by a parameter's path."""
    return {path: k for k, (path, _) in enumerate(module.PARAMETERS)}


def with_tables(module: ModuleType, parameters: np.ndarray, blocks: Mapping[str, np.ndarray]) -> np.ndarray:
    """Argument p of the kernels with tables' blocks appended; each path's parameter holds the start of its block."""
    values, filled, places = parameters.copy(), len(parameters), _places(module)
    for path, block in blocks.items():
        values[places[path]] = filled
        filled += len(block)
    return np.concatenate([values, *blocks.values()])


@dataclass(frozen=True, eq=False)
class _Sweep:
    """Body -> its x, y and angle, (3, n), at x (n,); with a period they repeat."""

    x: np.ndarray
    courses: Courses
    period: float | None = None


def _swept(mechanism: NumericMechanism, module: ModuleType, parameters: np.ndarray, horizon: float) -> _Sweep:
    """Assembly over a whole turn of the only drive if it rotates fully, else over the drives' range."""
    placement, motion, drives = place(mechanism), RigidKinematics(module, parameters), list(mechanism.drives)

    def at_time(times: np.ndarray) -> np.ndarray:
        rigid = motion.at(times)
        return np.array([rigid[f"{name}.angle"] for name in drives]).T

    times = np.linspace(0.0, horizon, _KNOTS + 1)
    if len(drives) > 1:
        turns = np.ptp(at_time(times), axis=0).max() / (2 * math.pi)
        steps = max(_KNOTS, math.ceil(_KNOTS * turns))
        times = np.linspace(0.0, horizon, steps + 1)
        return _Sweep(times, follow(mechanism, placement, at_time(times)))
    (drive,) = drives
    slides, start = mechanism.joints[drive].slides, placement.drives[drive]

    def along(xs: np.ndarray) -> _Sweep:
        return _Sweep(xs, follow(mechanism, placement, xs[:, None]))

    locked = None
    if not slides:
        try:
            turn = along(start + np.linspace(0.0, 2 * math.pi, _KNOTS + 1))
            begin, end = ({name: course[:, k] for name, course in turn.courses.items()} for k in (0, -1))
            if is_same(begin, end, mechanism.size):
                return replace(turn, period=2 * math.pi)
        except SceneError as error:
            locked = error
    if mechanism.drives[drive].free:
        raise locked or SceneError(
            f"drives.{drive}", "free", "the linkage does not return to its start after a turn", "Prescribe this drive"
        )
    angles = at_time(times)
    knots = max(_KNOTS, math.ceil(_KNOTS * np.ptp(angles) / (2 * math.pi)) if not slides else _KNOTS)
    there = along(np.linspace(start, max(angles.max(), start), knots + 1))
    back = along(np.linspace(start, min(angles.min(), start), knots + 1))
    # If the drive moves only to one side of its start, the other sweep is empty.
    x, first = np.unique(np.concatenate([back.x[::-1], there.x]), return_index=True)
    if len(x) == 1:  # a fixed drive: the table has one value
        x, first = x + np.array([-1.0, 0.0, 1.0, 2.0]), np.zeros(4, dtype=int)
    both = {name: np.hstack([back.courses[name][:, ::-1], course]) for name, course in there.courses.items()}
    return _Sweep(x, {name: course[:, first] for name, course in both.items()})


def followed(mechanism: NumericMechanism, placement: Placement) -> Courses:
    """Poses of the run by position analysis; only of the start if a joint is free, the motion is not determined by
    joints and drives, or the linkage locks."""
    at_start = {name: pose[:, None] for name, pose in placement.poses.items()}
    drives = mechanism.drives.values()
    held = len(mechanism.drives) + sum(len(joint.rows) for joint in mechanism.joints.values())
    if mechanism.frame or not drives or mechanism.free_joints or held != 3 * len(mechanism.bodies):
        return at_start
    try:
        path = [[drive.coordinate(t) for drive in drives] for t in instants(mechanism)]
        return follow(mechanism, placement, np.array(path))
    except SceneError:
        return at_start  # loading reports the position


def follow(mechanism: NumericMechanism, start: Placement, drives: np.ndarray) -> Courses:
    """Poses of an assembly from its start on, before anything is derived: body -> x, y and angle, (3, n).

    Every position is found by Newton's method from the tangent at an earlier one, many at once; ``drives`` has the
    coordinates of the drives on the way, (n, drives) in the mechanism's order.

    Raises
    ------
    SceneError
        If it locks on the way, or turns more often than some seconds allow.
    """
    constraints = Constraints(mechanism, start.drives)
    drives = drives[:, [[*mechanism.drives].index(name) for name in constraints.driven]]
    here = np.concatenate([start.poses[name] for name in constraints.bodies])
    at = np.array([start.drives[name] for name in constraints.driven])
    found, count, ahead = np.empty((len(drives), len(here))), 0, _AHEAD
    for _ in range(_MOST_TANGENTS):
        poses, good = _from_tangent(constraints, here, at, drives[count : count + ahead])
        reached = int(np.argmin(np.append(good, False)))
        if reached:
            found[count : count + reached] = poses[:reached]
            count, ahead = count + reached, max(_AHEAD, 2 * reached)
            here, at = found[count - 1], drives[count - 1]
            if count == len(drives):
                return constraints.split(found.T)
            continue
        shorter = at + _SHARES[:, None] * (drives[count] - at)
        poses, good = _from_tangent(constraints, here, at, shorter)
        if not good.any():
            raise _locked(constraints, here, at)
        here, at = poses[int(np.argmax(good))], shorter[int(np.argmax(good))]
    raise SceneError(
        "drives", ", ".join(constraints.driven), "they turn so often that it takes long to close the loops on the way",
        "Give a lower speed or a shorter duration",
    )  # fmt: skip


def _from_tangent(
    constraints: Constraints, start: np.ndarray, at: np.ndarray, drives: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n, 3 bodies) by Newton's method, and which of them are on the branch of a closed pose (3 bodies,).

    These are near the tangent at it, with the same sign of the determinant. ``at``: coordinates of its drives
    (drives,), and ``drives`` of those wanted (n, drives), in the order of the constraints.
    """
    jacobian = constraints.jacobian(constraints.split(start))
    side, right = np.linalg.slogdet(jacobian)[0], np.zeros((len(start), len(drives)))
    right[len(start) - len(at) :] = (drives - at).T
    along = np.linalg.solve(jacobian, right).T if side else np.full((len(drives), len(start)), np.nan)
    wanted = Constraints(constraints.mechanism, dict(zip(constraints.driven, drives.T, strict=True)))
    poses, scales = start + along, constraints.scales
    for _ in range(_ITERATIONS):
        placed = constraints.split(np.nan_to_num(poses).T)
        jacobian = wanted.jacobian(placed)
        sides = np.linalg.slogdet(jacobian)[0]
        jacobian[sides == 0.0] = np.eye(len(start))
        change = np.linalg.solve(jacobian, wanted.residuals(placed)[..., None])[..., 0]
        poses = poses - change
        left = abs(change / scales).max(axis=1)
        if (left[np.isfinite(left)] <= _CLOSED).all():
            break
    step, bend = (abs(np.nan_to_num(part) / scales).max(axis=1) for part in (along, poses - start - along))
    near = (step <= _FAR) & (bend <= np.maximum(_BENT * step, _ROUNDING))
    return poses, (left <= _CLOSED) & (sides * side == 1.0) & near


def _locked(constraints: Constraints, poses: np.ndarray, drives: np.ndarray) -> SceneError:
    """Error for a linkage that can't be followed beyond these poses; it names the joint that closes the loop."""
    at = dict(zip(constraints.driven, drives.tolist(), strict=True))
    return SceneError(
        f"joints.{_locking(constraints, poses)}", None,
        f"the loop cannot close beyond {constraints.mechanism.written(at)}: the linkage locks there, or would change "
        "its branch",
        "Change the lengths, or limit the drive's range",
    )  # fmt: skip


def _locking(constraints: Constraints, poses: np.ndarray) -> str:
    """Joint that closes the loop near its limit: it has the largest share in the self-equilibrated forces."""
    mechanism: NumericMechanism = constraints.mechanism
    stress = abs(np.linalg.svd(constraints.jacobian(constraints.split(poses)))[0][:, -1])
    rows = [name for name, joint in mechanism.joints.items() for _ in joint.rows]
    closing = ((share, name) for share, name in zip(stress, rows, strict=False) if name in mechanism.loop_joints)
    return max(closing, key=lambda row: row[0])[1]
