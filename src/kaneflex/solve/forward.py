"""Motion of the free joints of one-way models: the engine integrates the rigid mechanism under its loads.

In the plane it becomes courses of the free joints, from which the generated module computes all other scalars.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.mechanism.closure import check_closure, check_loops, drive_positions, margins_of, reason_open
from kaneflex.mechanism.closure_continuation import with_tables
from kaneflex.mechanism.parts import Mechanism
from kaneflex.mechanism.planar import wrapped
from kaneflex.mechanism.position_analysis import place
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion, not_integrated
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import moving
from kaneflex.multibody.model.determinacy import check_freedoms
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.rigid_reference import Courses, rigid_reference
from kaneflex.multibody.time.run import Run, integrate
from kaneflex.multibody.time.trajectory import CURE, CoupledTrajectory
from kaneflex.solve.coupled import method_of, motion_along_run
from kaneflex.solve.engine_loading import check_stage
from kaneflex.solve.run_checks import check_laws
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.multibody.time.spatial_motion import SpatialKinematics

_AROUND = np.array([0.0, 0.5, 1.0])
"""Instants [s] of the courses with constant acceleration that give the motion at the start."""
_FINE = 1001
"""Instants between two stored ones at which a loop that locks is searched."""
_APART = 1e-3
"""Largest sum of the bodies' distances from their positions in the run, in sizes of the mechanism or rad: branches of a
loop's motion are soon farther apart, and near a dead centre an error of 1e-8 becomes its root."""
_LOCKED, _NEAR, _TOUCHED = 1e-3, 1e-2, 1e-7
"""Margins of a loop (squared sine of the transmission angle): below the first a loop that can't continue counts as
locked, below the second its minimum is searched, below the third it has reached its limit."""


@dataclass(frozen=True, eq=False)
class StartKinematics(RigidKinematics):
    """Rigid motion at its start, before free joints are integrated.

    ``given``: parameters without their courses; ``system``: rigid mechanism; ``state``: its initial state.
    """

    given: np.ndarray
    system: System
    state: State

    is_start = True

    @property
    def initial(self) -> tuple[System, State]:
        """Equations of the motion, and its initial state."""
        return self.system, self.state

    def at(self, times: np.ndarray | float) -> RigidMotion:
        if np.any(times):
            raise not_integrated(float(np.max(times)))
        return super().at(times)


def at_start(system: System, motion: RigidKinematics) -> StartKinematics:
    """Rigid motion at the start of the free joints; ``motion``: that of the module, without courses of these joints.

    Raises SceneError if it can't start: the linkage can't close, the mass matrix is singular, or forces are not finite.
    """
    module, given, mechanism, none = motion.module, motion.parameters, system.mechanism, np.zeros(1)
    starts = np.array([[mechanism.drives[name].start for name in module.FREE]])
    rigid = _started(motion, given, Courses(none, starts, 0.0 * starts, 0.0 * starts)).at(0.0)
    check_loops(mechanism, rigid)
    placement = place(mechanism)
    check_freedoms(system, placement)
    (start,) = rigid_reference(system, placement).states(system, none)
    try:
        state = system.project(0.0, start.q, start.u, system.engine.chosen_at(start, system.engine.free_drives))
    except ArithmeticError:
        raise SceneError(
            f"drives.{module.FREE[0]}", "free",
            f"the forces are not finite at the start, {drive_positions(mechanism, rigid)}", "Change loads or start",
        ) from None  # fmt: skip
    first = _courses(system, system.engine.row(0.0)[None])
    return StartKinematics(module, _started(motion, given, first).parameters, given, system, state)


def integrate_free_joints(model: Model, share: Callable[[float], None]) -> Model:
    """Model with the motion of its free joints over the run; ``share`` is called with the finished share, 0 to 1.

    In the plane the parameters then end with tables of each free joint's coordinate, speed and acceleration: piecewise
    cubics over the steps of the integration.

    Raises
    ------
    SceneError
        If the motion can't continue: a loop locks, forces are not finite, or too many steps are needed. Names joint or
        drive, and time.
    """
    motion = cast("StartKinematics | SpatialKinematics", model.motion)
    system, start = motion.initial
    times = model.step * np.arange(model.options.steps + 1)
    found = integrate(system, start, times, method_of(model), share, limited=True)
    run = found.curve
    if found.outcome is not Outcome.COMPLETED:
        locked = _locked(motion, run) if isinstance(motion, StartKinematics) else None
        raise locked or run.stopped(found.message, CURE)
    if isinstance(motion, StartKinematics):
        return moving(model, _along_steps(model, motion, found), found.energy)
    moved = moving(model, motion_along_run(model, run), found.energy)
    check_stage(moved)
    return moved


def _along_steps(model: Model, start: StartKinematics, found: CoupledTrajectory) -> RigidKinematics:
    """Motion of a planar mechanism along its run, with the checks that need it."""
    system, rows = start.system, np.concatenate([rows for rows, _ in found.curve.pieces])
    rows = rows[np.append(np.diff(rows[:, 0]) > 0.0, True)]  # of instants with a change those after it
    motion = _with_courses(start, start.given, _courses(system, rows))
    left = _first_departure(motion, found, system)
    _check_passage(system.mechanism, motion, rows[rows[:, 0] <= found.times[left], 0])
    if left >= 0:
        rigid = motion.at(np.linspace(found.times[left - 1], found.times[left], _FINE))
        raise _locked_loop(system.mechanism, rigid) or SceneError(
            "joints", ", ".join(system.mechanism.loop_joints),
            f"the loops pass a singular position before t = {found.times[left]:.6g} s: branches of the motion meet "
            "there, and joint forces are not finite",
            "Use preset coupled, which continues along a branch, or shorten the duration",
        )  # fmt: skip
    check_closure(system.mechanism, motion, model.options.duration)
    check_laws(replace(model, motion=motion))
    return motion


def _first_departure(motion: RigidKinematics, found: CoupledTrajectory, system: System) -> int:
    """First stored instant, after the start, at which a body is not where the run has it, which continues where
    branches of a loop's motion meet; -1 without one."""
    rigid, apart = motion.at(found.times), np.zeros(len(found.times))
    for name in system.mechanism.bodies:
        x, y, angle = (found.record[:, system.scalars[f"{name}.{part}"].column] for part in ("x", "y", "phi"))
        apart += np.hypot(rigid[f"{name}.x"] - x, rigid[f"{name}.y"] - y) / system.mechanism.size
        apart += abs(wrapped(np.arctan2(rigid[f"{name}.s"], rigid[f"{name}.c"]) - angle))
    lost = np.flatnonzero(~(apart[1:] <= _APART))
    return 1 + int(lost[0]) if len(lost) else -1


def _check_passage(mechanism: Mechanism, motion: RigidKinematics, times: np.ndarray) -> None:
    """Raise SceneError if free joints move the linkage into a limit position (dead centre).

    ``times`` [s] are those of the integration; between them every loop's smallest margin is searched.
    """
    rigid = motion.at(times)
    for name in margins_of(rigid):
        margin, first = rigid[name], None
        lowest = np.r_[True, margin[1:] <= margin[:-1]] & np.r_[margin[:-1] <= margin[1:], True] & (margin < _NEAR)
        for k in np.flatnonzero(lowest).tolist():
            fine = motion.at(np.linspace(times[max(k - 1, 0)], times[min(k + 1, len(times) - 1)], 1001))
            if not fine[name].min() > _TOUCHED:
                first = fine, int(np.argmin(fine[name]))
                break
        if first is not None:
            raise _dead_centre_error(mechanism, name.removesuffix(".closure"), *first)


def _dead_centre_error(mechanism: Mechanism, joint: str, rigid: RigidMotion, index: int = 0) -> SceneError:
    """Error for a linkage that moves into the limit position of the loop that a joint closes."""
    return SceneError(
        f"joints.{joint}", None,
        f"the linkage reaches a dead centre at t = {rigid.times[index]:.6g} s, "
        f"{drive_positions(mechanism, rigid, index)}: beyond it {reason_open(mechanism.joints[joint])}",
        "Shorten the duration, change lengths, loads or start, or use preset coupled, which can continue",
    )  # fmt: skip


def _locked_loop(mechanism: Mechanism, rigid: RigidMotion) -> SceneError | None:
    """Error for the loop that comes closest to its limit position, if one is locked at an instant of a motion."""
    margins = {name: np.where(rigid[name] > 0.0, rigid[name], 0.0) for name in margins_of(rigid)}
    name = min(margins, key=lambda name: margins[name].min(), default=None)
    if name is None or margins[name].min() > _LOCKED:
        return None
    return _dead_centre_error(mechanism, name.removesuffix(".closure"), rigid, int(margins[name].argmin()))


def _locked(start: StartKinematics, run: Run) -> SceneError | None:
    """Error of a motion that ends where a loop of a planar mechanism locks; None elsewhere."""
    here = _courses(start.system, run.state[None])
    rigid = _started(start, start.given, here._replace(u=0.0 * here.u, du=0.0 * here.du)).at(here.times)
    return _locked_loop(start.system.mechanism, rigid)


def _courses(system: System, rows: np.ndarray) -> Courses:
    """Courses of the free joints at rows of the engine."""
    columns, own = system.engine.columns, [*system.free.values()]
    return Courses(rows[:, 0], *(rows[:, columns[part]][:, own] for part in ("q", "u", "du")))


def _started(motion: RigidKinematics, given: np.ndarray, first: Courses) -> RigidKinematics:
    """Motion around an instant with constant accelerations of the free joints."""
    t = _AROUND[:, None]
    q, u = first.q + t * (first.u + 0.5 * t * first.du), first.u + t * first.du
    return _with_courses(motion, given, Courses(first.times + _AROUND, q, u, first.du + 0.0 * t))


def _with_courses(motion: RigidKinematics, given: np.ndarray, free: Courses) -> RigidKinematics:
    """Motion with one block of cubics for each course of a free joint; see ``kaneflex.scene.tables`` for the layout."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    blocks, times = {}, free.times
    for name, q, u, du in zip(motion.module.FREE, free.q.T, free.u.T, free.du.T, strict=True):
        courses = {
            "angle_table": CubicHermiteSpline(times, q, u),
            "speed_table": CubicHermiteSpline(times, u, du),
            "acceleration_table": CubicSpline(times, du),
        }
        for course, cubic in courses.items():
            block = np.concatenate([[len(times) - 1, 0.0], times, cubic.c[::-1].T.ravel()])
            blocks[f"drives.{name}.{course}"] = block
    return RigidKinematics(motion.module, with_tables(motion.module, given, blocks))
