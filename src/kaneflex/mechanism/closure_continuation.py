"""Starting values for loops closed by Newton's method: tables of the assembly over the drive's range.

The sweep starts from the scene's assembly and follows its tangent. If the determinant of the constraints' Jacobian
changes its sign, or small steps fail, the linkage locks or would change its branch. This is found before anything is
computed, and the kernels need no memory of earlier positions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import ModuleType
from typing import NamedTuple

import numpy as np

from kaneflex.mechanism.joints import Constraints, axes_of, course
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.planar import Number
from kaneflex.mechanism.position_analysis import Placement, is_same, place
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.scene import Scene
from kaneflex.scene.tables import Table
from kaneflex.support.errors import SceneError

_KNOTS = 720
"""Number of knots of a turn, or of the drive's range."""
_STRIDE = 16
"""Knots between two that are followed one by one; those in between are solved all at once."""
_ITERATIONS, _SOLVED = 8, 1e-12
"""Iterations of Newton's method, and its last correction, in rad or sizes of the mechanism."""
_HALVINGS = 16
"""Halvings of such a step before the linkage counts as locked."""
_BENT = 0.2
"""Largest correction of a tangent step, as a share of it, that counts as staying on the branch."""
_NEAR = 1e-4
"""Correction, in rad or sizes of the mechanism, below which the Jacobian is kept."""
_ROUNDING = 1e-10
"""Correction, in rad or sizes of the mechanism, that is only rounding, as when the drives dwell."""

Coordinates = Callable[[float], Mapping[str, float]]
"""Function from the tables' abscissa (a drive's coordinate or the time) to every drive's coordinate."""


class _Locked(Exception):
    """Stop of the sweep at ``x``; ``joint`` closes the loop that locks there."""

    def __init__(self, x: float, joint: str) -> None:
        self.x, self.joint = x, joint


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
    follower = _Follower(mechanism_of(scene), place(scene))
    sweep = _swept(follower, module, parameters, horizon)
    columns, axes = dict[str, np.ndarray](), axes_of(sweep.courses)
    for _, _, turning, sliding in loops:
        columns |= {f"bodies.{body}.seed_{key}": getattr(axes[body], key) for body in turning for key in "cs"}
        columns |= {f"joints.{joint}.seed_slide": course(follower.mechanism.joints[joint], sweep.courses)
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
    courses: Mapping[str, np.ndarray]
    period: float | None


def _swept(follower: _Follower, module: ModuleType, parameters: np.ndarray, horizon: float) -> _Sweep:
    """Assembly over a whole turn of the only drive if it rotates fully, else over the drives' range."""
    mechanism, drives = follower.mechanism, list(follower.mechanism.drives)
    if len(drives) > 1:
        motion = RigidKinematics(module, parameters)

        def at_time(t: float) -> dict[str, float]:
            rigid = motion.at(t)
            return {name: float(rigid[f"{name}.angle"][0]) for name in drives}

        rigid = motion.at(np.linspace(0.0, horizon, _KNOTS + 1))
        turns = max(np.ptp(rigid[f"{name}.angle"]) for name in drives) / (2 * math.pi)
        steps = max(_KNOTS, math.ceil(_KNOTS * turns))
        return follower.over(np.linspace(0.0, horizon, steps + 1), at_time)
    (drive,) = drives
    slides = mechanism.joints[drive].slides

    def only(x: float) -> dict[str, float]:
        return {drive: x}

    start = follower.start.drives[drive]
    locked = None
    if not slides:
        try:
            turn = follower.over(start + np.linspace(0.0, 2 * math.pi, _KNOTS + 1), only, 2 * math.pi)
            begin, end = ({name: course[:, k] for name, course in turn.courses.items()} for k in (0, -1))
            if is_same(begin, end, mechanism.size):
                return turn
        except SceneError as error:
            locked = error
    if mechanism.drives[drive].free:
        raise locked or SceneError(
            f"drives.{drive}", "free", "the linkage does not return to its start after a turn", "Prescribe this drive"
        )
    angles = RigidKinematics(module, parameters).at(np.linspace(0.0, horizon, _KNOTS + 1))[f"{drive}.angle"]
    knots = max(_KNOTS, math.ceil(_KNOTS * np.ptp(angles) / (2 * math.pi)) if not slides else _KNOTS)
    there = follower.over(np.linspace(start, max(angles.max(), start), knots + 1), only)
    back = follower.over(np.linspace(start, min(angles.min(), start), knots + 1), only)
    # If the drive moves only to one side of its start, the other sweep is empty.
    x, first = np.unique(np.concatenate([back.x[::-1], there.x]), return_index=True)
    if len(x) == 1:  # a fixed drive: the table has one value
        x, first = x + np.array([-1.0, 0.0, 1.0, 2.0]), np.zeros(4, dtype=int)
    both = {name: np.hstack([back.courses[name][:, ::-1], course]) for name, course in there.courses.items()}
    return _Sweep(x, {name: course[:, first] for name, course in both.items()}, None)


def follow(
    mechanism: NumericMechanism, start: Placement, times: np.ndarray, drives: Coordinates
) -> dict[str, np.ndarray]:
    """Poses of an assembly from its start on, by numerical computation only: body -> x, y and angle, (3, n_times).

    Raises
    ------
    SceneError
        If it locks on the way.
    """
    return dict(_Follower(mechanism, start).over(times, drives).courses)


class _Place(NamedTuple):
    """Poses of all bodies in one vector, or of several instants (n, ...), and the constraints' Jacobian there."""

    poses: np.ndarray
    jacobian: np.ndarray


class _Follower:
    """Continuation of the assembly that a mechanism starts from, on the branch with the sign ``side`` of the Jacobian's
    determinant."""

    def __init__(self, mechanism: NumericMechanism, start: Placement) -> None:
        self.mechanism, self.start = mechanism, start
        self.constraints = Constraints(mechanism, start.drives)
        self.first = self._place(np.concatenate([start.poses[name] for name in mechanism.bodies]))
        self.side = np.linalg.slogdet(self.first.jacobian)[0]

    def over(self, xs: np.ndarray, drives: Coordinates, period: float | None = None) -> _Sweep:
        """Poses at all of ``xs``; the first is the start."""
        few = [*range(0, len(xs) - 1, _STRIDE), len(xs) - 1]
        try:
            found = self._along(xs[few], drives)
            if len(few) < len(xs):
                between = self._between(xs, few, found, drives)
                found = self._along(xs, drives) if between is None else between
        except _Locked as locked:
            raise SceneError(
                f"joints.{locked.joint}", None,
                f"the loop cannot close beyond {self.mechanism.written(drives(locked.x))}: the linkage locks there, or "
                "would change its branch",
                "Change the lengths, or limit the drive's range",
            ) from None  # fmt: skip
        return _Sweep(np.array(xs), self.constraints.split(found.T), period)

    def _along(self, xs: np.ndarray, drives: Coordinates) -> np.ndarray:
        """Poses at some ``xs`` from the start on, (n, 3 bodies), one after the other. Raises _Locked."""
        place, found = self.first, [self.first.poses]
        for x, to in pairwise(xs):
            place = place if x == to else self._step(place, x, to, drives, 0)
            found.append(place.poses)
        return np.array(found)

    def _between(self, xs: np.ndarray, few: list[int], poses: np.ndarray, drives: Coordinates) -> np.ndarray | None:
        """Poses at all ``xs`` from those at ``few`` of them, by Newton's method for all at once; None if :meth:`_step`
        would reject some of them."""
        each = [drives(x) for x in xs]
        coordinates = {name: np.array([at[name] for at in each]) for name in each[0]}
        near = [np.interp(np.arange(len(xs)), few, pose) for pose in poses.T]
        found = self._closed(coordinates, np.array(near).T)
        if found is None:
            return None
        before, after = (_Place(found.poses[part], found.jacobian[part]) for part in (slice(-1), slice(1, None)))
        guess = self._predicted(before, {name: np.diff(values) for name, values in coordinates.items()})
        return found.poses if self._continues(before, guess, after).all() else None

    def _step(self, start: _Place, x: float, to: float, drives: Coordinates, depth: int) -> _Place:
        """Poses at ``to`` from those at ``x``: along the tangent, corrected by Newton's method, else in two halves."""
        before, after = drives(x), drives(to)
        guess = self._predicted(start, {name: after[name] - before[name] for name in after})
        found = self._closed(after, guess)
        if found is not None and self._continues(start, guess, found):
            return found
        if depth == _HALVINGS:
            raise _Locked(x, self._locking(start))
        middle = 0.5 * (x + to)
        half = self._step(start, x, middle, drives, depth + 1)
        return self._step(half, middle, to, drives, depth + 1)

    def _predicted(self, start: _Place, moved: Mapping[str, Number]) -> np.ndarray:
        """Poses along the tangent for small movements of the drives."""
        right = np.zeros_like(start.poses)
        for row, name in enumerate(reversed(self.constraints.driven), 1):
            right[..., -row] = moved[name]
        return start.poses + np.linalg.solve(start.jacobian, right[..., None])[..., 0]

    def _closed(self, drives: Mapping[str, Number], poses: np.ndarray) -> _Place | None:
        """Poses (..., 3 bodies) corrected by Newton's method until the joints hold; None if it does not converge."""
        constraints, last = Constraints(self.mechanism, drives), np.inf
        try:
            for _ in range(_ITERATIONS):
                if last > _NEAR:
                    jacobian = self._place(poses).jacobian
                residuals = constraints.residuals(constraints.split(poses.T))
                change = np.linalg.solve(jacobian, residuals[..., None])[..., 0]
                poses, last = poses - change, abs(change / constraints.scales).max()
                if last < _SOLVED:
                    return self._place(poses)
                if not np.isfinite(last):
                    break
        except np.linalg.LinAlgError:
            pass
        return None

    def _continues(self, start: _Place, guess: np.ndarray, found: _Place) -> np.ndarray:
        """True if poses stay on the branch, along the tangent to a guess and corrected from it."""
        changes = guess - start.poses, found.poses - guess
        step, bend = (abs(change / self.constraints.scales).max(axis=-1) for change in changes)
        return (np.linalg.slogdet(found.jacobian)[0] == self.side) & (bend <= np.maximum(_BENT * step, _ROUNDING))

    def _place(self, poses: np.ndarray) -> _Place:
        """Poses with the constraints' Jacobian, which does not depend on the drives' positions."""
        return _Place(poses, self.constraints.jacobian(self.constraints.split(poses.T)))

    def _locking(self, place: _Place) -> str:
        """Joint that closes the loop near its limit: it has the largest share in the self-equilibrated forces."""
        stress, closing = abs(np.linalg.svd(place.jacobian)[0][:, -1]), self.mechanism.loop_joints
        rows = [name for name, joint in self.mechanism.joints.items() for _ in joint.rows]
        return max((row for row in zip(stress, rows, strict=False) if row[1] in closing), key=lambda row: row[0])[1]
