"""Starting values for loops closed by Newton's method: tables of the assembly over the drive's range.

The compiled engine follows the scene's assembly. If the determinant of the constraints' Jacobian changes its sign, or
small steps leave the tangent, the linkage locks or would change its branch. This is found before anything is computed,
and the kernels need no memory of earlier positions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from kaneflex.mechanism.closure import Courses, instants
from kaneflex.mechanism.joints import Constraints, axes_of, course
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.parts import Drive
from kaneflex.mechanism.position_analysis import Placement, is_same, place
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.codes import FAR
from kaneflex.multibody.time.curves import Ahead
from kaneflex.multibody.time.rigid_reference import rigid_reference
from kaneflex.scene import Scene
from kaneflex.scene.tables import Table
from kaneflex.support.errors import SceneError

_KNOTS = 720
"""Number of knots of a turn, or of the drive's range."""
_PARTS, _LEAST = 16, 2.0**-16
"""Parts into which a step is divided that leaves the tangent, and the share of a step below which the linkage counts
as locked."""
_BENT = 0.2
"""Largest deviation from the tangent, as a share of a step, that counts as staying on the branch."""
_ROUNDING = 1e-10
"""Deviation, in rad or sizes of the mechanism, that is only rounding, as when the drives dwell."""

Coordinates = Callable[[np.ndarray], np.ndarray]
"""Function from the tables' abscissa (a drive's coordinate or the time), (n,), to every drive's coordinate, (n,
drives)."""


def seed_loops(scene: Scene, module: ModuleType, parameters: np.ndarray, horizon: float) -> np.ndarray:
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
    sweep = _swept(scene, module, parameters, horizon)
    columns, axes = dict[str, np.ndarray](), axes_of(sweep.courses)
    for _, _, turning, sliding in loops:
        columns |= {f"bodies.{body}.seed_{key}": getattr(axes[body], key) for body in turning for key in "cs"}
        columns |= {f"joints.{joint}.seed_slide": course(mechanism_of(scene).joints[joint], sweep.courses)
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


def _swept(scene: Scene, module: ModuleType, parameters: np.ndarray, horizon: float) -> _Sweep:
    """Assembly over a whole turn of the only drive if it rotates fully, else over the drives' range."""
    mechanism, placement = mechanism_of(scene), place(scene)
    motion, drives = RigidKinematics(module, parameters), list(mechanism.drives)

    def at_time(times: np.ndarray) -> np.ndarray:
        rigid = motion.at(times)
        return np.array([rigid[f"{name}.angle"] for name in drives]).T

    times = np.linspace(0.0, horizon, _KNOTS + 1)
    if len(drives) > 1:
        turns = np.ptp(at_time(times), axis=0).max() / (2 * math.pi)
        steps = max(_KNOTS, math.ceil(_KNOTS * turns))
        times = np.linspace(0.0, horizon, steps + 1)
        return _Sweep(times, follow(scene, placement, times, at_time))
    (drive,) = drives
    slides, start = mechanism.joints[drive].slides, placement.drives[drive]

    def along(xs: np.ndarray) -> _Sweep:
        return _Sweep(xs, follow(scene, placement, xs, lambda xs: xs[:, None]))

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


def followed(scene: Scene, placement: Placement) -> Courses:
    """Poses of the run by position analysis; only of the start if a joint is free, the motion is not determined by
    joints and drives, or the linkage locks."""
    at_start = {name: pose[:, None] for name, pose in placement.poses.items()}
    mechanism, drives = mechanism_of(scene), scene.drives.values()
    held = len(mechanism.drives) + sum(len(joint.rows) for joint in mechanism.joints.values())
    if scene.is_frame or not drives or scene.free_joints or held != 3 * len(mechanism.bodies):
        return at_start

    def at_time(times: np.ndarray) -> np.ndarray:
        return np.array([[drive.coordinate(t) for drive in drives] for t in times])

    try:
        return follow(scene, placement, instants(scene), at_time)
    except SceneError:
        return at_start  # loading reports the position


def follow(scene: Scene, start: Placement, xs: np.ndarray, drives: Coordinates) -> Courses:
    """Poses of an assembly from its start on, before anything is derived: body -> x, y and angle, (3, n).

    Raises
    ------
    SceneError
        If it locks on the way.
    """
    mechanism, whole = mechanism_of(scene), np.arange(len(xs), dtype=float)
    constraints = Constraints(mechanism, start.drives)

    def coordinates(steps: np.ndarray) -> np.ndarray:
        return drives(np.interp(steps, whole, xs))

    curve, steps = _curve(scene, start, coordinates), whole
    order = [[*mechanism.drives].index(name) for name in constraints.driven]
    while True:
        poses = curve.record(steps)[:, curve.system.record.q]
        wrong = _strayed(constraints, poses, coordinates(steps)[:, order])
        if not len(wrong):
            return constraints.split(poses[np.searchsorted(steps, whole)].T)
        if steps[wrong[0] + 1] - steps[wrong[0]] <= _LEAST:
            last = wrong[0]
            at = dict(zip(mechanism.drives, coordinates(steps[[last]])[0].tolist(), strict=True))
            raise SceneError(
                f"joints.{_locking(constraints, poses[last])}", None,
                f"the loop cannot close beyond {mechanism.written(at)}: the linkage locks there, or would change its "
                "branch",
                "Change the lengths, or limit the drive's range",
            )  # fmt: skip
        parts = [np.linspace(steps[k], steps[k + 1], _PARTS + 1)[1:-1] for k in wrong]
        steps = np.sort(np.concatenate([steps, *parts]))


def _curve(scene: Scene, start: Placement, drives: Coordinates) -> Ahead:
    """Curve of the rigid bodies alone, with the drives as independent coordinates, which are functions of the time."""
    from kaneflex.generated.laws import no_courses, no_magnitudes

    module: Any = SimpleNamespace(courses=no_courses, magnitudes=no_magnitudes, PARAMETERS=())
    mechanism, none = mechanism_of(scene), dict[str, Any]()
    free = dict.fromkeys(mechanism.drives, Drive("free", None))
    alone = replace(mechanism, drives=free, loads=none, springs=none, contacts=none, frictions=none, observed=())
    reference = rigid_reference(rigid_system(scene, module, mechanism=alone), start).module
    first, where = reference.first, [reference.system.free[name] for name in free]

    def near(times: np.ndarray) -> tuple[np.ndarray, ...]:
        q, still = (np.tile(part, (len(times), 1)) for part in (first.q, first.du))
        q[:, where] = drives(times)
        return q, still, still

    return Ahead(reference.system, reference.begin, near)


def _strayed(constraints: Constraints, poses: np.ndarray, drives: np.ndarray) -> np.ndarray:
    """Numbers of the short steps between poses (n, 3 bodies) that leave the tangent, up to the first step that leaves
    the branch."""
    known, drive = np.isfinite(poses).all(axis=1), poses.shape[1] - drives.shape[1]
    jacobian = constraints.jacobian(constraints.split(np.nan_to_num(poses).T))
    sides = known * np.linalg.slogdet(jacobian)[0]
    other = np.flatnonzero(sides * sides[0] != 1.0)[:1]
    count = max(1, int(other[0])) if len(other) else len(poses)
    moved, driven = np.diff(poses[:count], axis=0), np.diff(drives[:count], axis=0)
    short = (abs(driven) <= FAR * constraints.units[drive:]).all(axis=1)
    right = np.pad(driven, ((0, 0), (drive, 0)))[..., None]
    along = np.linalg.solve(jacobian[: count - 1], right)[..., 0]
    step, bend = (abs(part / constraints.scales).max(axis=1) for part in (along, moved - along))
    bent = np.flatnonzero(short & (bend > np.maximum(_BENT * step, _ROUNDING)))
    return np.append(bent, np.maximum(other - 1, 0))


def _locking(constraints: Constraints, poses: np.ndarray) -> str:
    """Joint that closes the loop near its limit: it has the largest share in the self-equilibrated forces."""
    mechanism: NumericMechanism = constraints.mechanism
    stress = abs(np.linalg.svd(constraints.jacobian(constraints.split(poses)))[0][:, -1])
    rows = [name for name, joint in mechanism.joints.items() for _ in joint.rows]
    closing = ((share, name) for share, name in zip(stress, rows, strict=False) if name in mechanism.loop_joints)
    return max(closing, key=lambda row: row[0])[1]
