"""Rigid reference of a coupled mechanism in the plane, computed by the engine without derived equations, and the full
turns with which its bodies start.

Bodies without shapes use the engine, too. Its drives follow their laws, or its free joints and bodies move as those of
the coupled mechanism: the loops then place the bodies.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.joints import Poses
from kaneflex.mechanism.parts import floating_coordinates
from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import LaterMotion, RigidKinematics
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.computed_module import ComputedModule
from kaneflex.multibody.model.state import NONE, State
from kaneflex.multibody.model.system import BODY, System
from kaneflex.multibody.time.curves import Curve, DrivenCurve, ReferenceBeforeRun, ReferenceCurve
from kaneflex.multibody.time.floating_motion import FloatingMotion
from kaneflex.multibody.time.trajectory import Pieces
from kaneflex.scene.laws import Law
from kaneflex.support.errors import SceneError


class Courses(NamedTuple):
    """Courses of coordinates: at instants [s], (n_times,), they with their speeds and accelerations, (n_times, n) each.

    From a single instant on they keep their speeds.
    """

    times: np.ndarray
    q: np.ndarray
    u: np.ndarray
    du: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """Coordinates, speeds and accelerations, (3, n_times, n); between the instants by cubics."""
        place = np.minimum(np.searchsorted(self.times, times), len(self.times) - 1)
        if not self.q.shape[1] or (self.times[place] == times).all():
            return np.stack([self.q[place], self.u[place], self.du[place]])
        if len(self.times) == 1:
            u = np.broadcast_to(self.u, (len(times), self.u.shape[1]))
            return np.stack([self.q + (times - self.times)[:, None] * u, u, 0.0 * u])
        pieces = Pieces.of(self.times, np.searchsorted(self.times, times, side="right") - 1, times)
        return np.stack([pieces.cubic(self.q, self.u)[0], *pieces.cubic(self.u, self.du)])


@dataclass(frozen=True, eq=False)
class ReferenceKinematics(RigidKinematics):
    """Motion of a rigid reference, whose bodies are placed on request.

    Attributes
    ----------
    curve : Curve
    start : Placement
        Initial position.
    links : mapping of str to Link
        Elastic links of the coupled mechanism.
    run : FloatingMotion or None
        Motion of all bodies at instants, if it is known.
    """

    module: ComputedModule  # type: ignore[assignment]
    curve: Curve
    start: Placement
    links: Mapping[str, Link]
    run: FloatingMotion | None = None

    @property
    def is_determined(self) -> bool:  # type: ignore[override]
        engine, choice = self.module.system.engine, self.curve.start.choice
        given = self.module.FREE or len(choice.independent)
        return not given and len(choice.rows) == engine.count(at.JOINT_ROWS)

    def at(self, times: np.ndarray | float) -> FloatingMotion:
        run, times = self.run, np.atleast_1d(np.asarray(times, dtype=float))
        place = np.zeros(0, int) if run is None else np.minimum(np.searchsorted(run.times, times), len(run.times) - 1)
        if run is not None and (run.times[place] == times).all():
            return run.taken(place)
        return _Placed(self, times)

    def table(self, times: np.ndarray) -> np.ndarray:
        """All scalars at ``times`` [s]; those of bodies that the loops can't place are not finite."""
        found = self.at(times)
        return np.column_stack([found[name] for name in self.column])

    def along(self, moving: FloatingMotion) -> ReferenceKinematics:
        """The same beside a coupled motion, with its coordinates of free joints and bodies."""
        module, curve = self.module, self.curve
        if module.FREE:
            frames = zip(*map(moving.body, module.system.mechanism.bodies), strict=True)
            poses, rates, _ = (np.concatenate(parts).T for parts in frames)
            beside = _courses(module.system, moving.times, poses, rates, [*map(moving.coordinate, module.FREE)])
            curve = ReferenceCurve(module.system, curve.start, beside.at)
        found = replace(self, curve=curve, run=None)
        if not moving.shapes:
            found = replace(found, run=FloatingMotion.of(moving.system, found.at(moving.times), moving.record))
        return found

    def states(self, system: System, times: np.ndarray) -> list[State]:
        """States of a coupled system with undeformed bodies at ``times`` [s], with the full turns since the start."""
        found, of = self.curve.record(times), self.module.system.record
        return system.undeformed(times, found[:, of.q], found[:, of.v])


class _Placed(LaterMotion, FloatingMotion):
    """Motion at some times, whose bodies are placed when they are asked for."""

    motion: Any

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        if owner in self.mechanism.springs and key in ("c", "s"):
            return self._direction(owner)["cs".index(key)]
        return self.known[name] if name in self.known else super().__getitem__(name)

    def _direction(self, spring: str) -> np.ndarray:
        """Cosine and sine of a spring's direction."""
        start, end = (self.frame(side.body).place(side.at) for side in self.mechanism.springs[spring].sides)
        return (end - start) / np.hypot(*(end - start))

    @property
    def system(self) -> System:  # type: ignore[override]
        return self.motion.module.system

    @cached_property
    def record(self) -> np.ndarray:  # type: ignore[override]
        return self.motion.curve.record(self.times)

    @cached_property
    def known(self) -> dict[str, np.ndarray]:
        """Scalars that are known before the bodies are placed: of drives and loads.

        Joints in laws without a drive count as at zero.
        """
        mechanism, engine, times = self.mechanism, self.system.engine, self.times
        courses = engine.courses(times).reshape(len(times), len(engine.layout.driven), 3).swapaxes(0, 1)
        of = dict(zip(engine.layout.driven, courses, strict=True))
        if mechanism.free_joints:
            moved = np.asarray(self.motion.curve.near(times)).transpose(2, 1, 0)
            of |= {name: moved[self.system.free[name]] for name in mechanism.free_joints}
        joints = np.zeros((len(times), len(of) + len(mechanism.observed), 3))
        for k, name in enumerate(mechanism.drives):
            joints[:, k] = of[name]
        sizes = dict(zip(mechanism.loads, engine.magnitudes(times, joints).T, strict=True))
        return {f"{name}.angle": joints[:, k, 0] for k, name in enumerate(mechanism.drives)} | sizes


def rigid_reference(system: System, start: Placement) -> ReferenceKinematics:
    """Motion of a system's rigid mechanism from the initial position of its bodies, with its free joints and bodies at
    their initial speeds."""
    mechanism = system.mechanism
    alone = replace(mechanism, contacts={}, frictions={})
    undeformed = rigid_system(alone, system.module, system.parameters)
    # one library for both: compiling another takes as long again
    undeformed = replace(undeformed, engine=replace(undeformed.engine, kind=system.engine.kind))
    near = ((body, *start.poses[body]) for body in mechanism.bodies)
    wrapped = {body: np.array([x, y, np.arctan2(np.sin(angle), np.cos(angle))]) for body, x, y, angle in near}
    engine, poses = undeformed.engine, unwrapped(undeformed, wrapped, start.drives)
    frames = np.concatenate([*poses.values()])
    places = {name: (start.drives[name], drive.initial_speed, 0.0) for name, drive in mechanism.drives.items()}
    for body, free in mechanism.frees.items():
        moves = zip(poses[body], free.rates, np.zeros(BODY), strict=True)
        places |= dict(zip(floating_coordinates(body), moves, strict=True))
    given = [np.array(places[name], float)[:, None] for name in mechanism.free]
    first = _courses(undeformed, np.zeros(1), frames[None], 0.0 * frames[None], given)
    state = State(0.0, first.q[0], first.u[0], first.du[0], engine.sizes.copy(), NONE)
    state = replace(state, choice=engine.chosen_at(state, [*undeformed.free.values()]))
    curve = ReferenceBeforeRun(undeformed, state, first.at) if mechanism.free else DrivenCurve(undeformed, state)
    start = replace(start, poses=poses)
    return ReferenceKinematics(ComputedModule(undeformed), engine.p, curve, start, system.links)


def _courses(
    system: System, times: np.ndarray, poses: np.ndarray, rates: np.ndarray, free: Sequence[Any]
) -> Courses:
    """Courses of all coordinates beside a motion with frames x, y, phi at ``times`` [s], and their rates, (n_times, 3
    bodies); ``free``: free coordinates with their rates, (3, n_times) each."""
    found = np.stack([*system.coordinates_of(poses, rates), np.zeros((len(times), system.engine.size))])
    for name, own in zip(system.mechanism.free, free, strict=True):
        found[:, :, system.free[name]] = own
    return Courses(times, *found)


def unwrapped(system: System, poses: Poses, drives: Mapping[str, float], given: Collection[str] = ()) -> Poses:
    """Poses with full turns added to the bodies' angles, consistent with ``drives`` [rad or m], welds and guides.

    Joints with springs, laws or free drives start within half a turn of their rest or start; between bodies with
    ``given`` angles they keep their turns.
    """
    before = {name: float(pose[2]) for name, pose in poses.items()}
    angles = _counted(system, before, drives, _between(system, before, given))
    return {name: np.append(pose[:2], angles[name]) for name, pose in poses.items()}


def check_turns_kept(system: System, laws: Collection[Law], before: Poses, poses: Poses) -> None:
    """Raise SceneError if springs and laws of loads have other turns at some poses than at those given ``before``."""
    was, now = (_between(system, {name: float(pose[2]) for name, pose in each.items()}, each)
                for each in (before, poses))  # fmt: skip
    sprung = {spring.joint for spring in system.mechanism.springs.values()}
    for name, turned in was.items():
        knows = "a torsional spring" if name in sprung else "a law" if any(law.uses_any([name]) for law in laws) else ""
        if knows and round((turned - now[name]) / math.tau):
            raise SceneError(
                "solve.start", "a table of a state",
                f"the state has {name} at {math.degrees(turned):.6g} deg, but by drives, welds and guides it starts at "
                f"{math.degrees(now[name]):.6g} deg, and {knows} depends on these whole turns",
                "Continue with --after, or simulate(model, after=...), which also continues drives, or add turns to "
                "the drives' angles",
            )  # fmt: skip


def _between(system: System, angles: Mapping[str, float], given: Collection[str]) -> dict[str, float]:
    """Coordinates [rad] of pins between ``given`` bodies whose turns a spring, a law or a free drive counts."""
    mechanism = system.mechanism
    sprung = [spring.joint for spring in mechanism.springs.values() if spring.joint is not None]
    known, found = {"ground": 0.0, **{name: angles[name] for name in given}}, {}
    for name in dict.fromkeys([*sprung, *mechanism.observed, *mechanism.free_joints]):
        first, second = mechanism.joints[name].bodies
        if mechanism.joints[name].kind == "revolute" and first in known and second in known:
            found[name] = known[second] - known[first]
    return found


def _counted(
    system: System, angles: Mapping[str, float], drives: Mapping[str, float], kept: Mapping[str, float]
) -> dict[str, float]:
    """Angles of the bodies [rad] with the turns prescribed by joints, or ``kept`` between them.

    ``drives``: coordinates of the drives.
    """
    mechanism = system.mechanism
    counted, angle = {"ground"}, {"ground": 0.0, **angles}
    pins = {name for name, joint in mechanism.joints.items() if joint.kind == "revolute"}
    turns = {name: joint.angle for name, joint in mechanism.joints.items() if name not in pins}
    turning = {name: drive.kind for name, drive in mechanism.drives.items() if name in pins}
    turns |= {name: drives[name] for name, kind in turning.items() if kind != "free"}
    near = {name: 0.0 for name in mechanism.observed if name in pins}
    near |= {spring.joint: spring.free for spring in mechanism.springs.values() if spring.joint is not None}
    near |= mechanism.backlash
    near = {name: drives[name] for name in turning} | {name: at for name, at in near.items() if name not in turning}
    near |= kept
    turns |= {name: angle for name, angle in near.items() if name not in turns}  # prescribed ones take precedence
    ends = [(*mechanism.joints[name].bodies, turn) for name, turn in turns.items()]
    ways = [way for first, second, turn in ends for way in ((first, second, turn), (second, first, -turn))]
    while len(counted) < len(angle):
        leading = [way for way in ways if way[0] in counted and way[1] not in counted]
        if not leading:  # no joint determines the remaining turns
            counted.add(next(name for name in angle if name not in counted))
            continue
        base, other, turn = leading[0]
        angle[other] += float(whole_turns(angle[base] + turn - angle[other]))
        counted.add(other)
    return angle
