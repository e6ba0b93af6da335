"""Rigid reference of a coupled mechanism in the plane, computed by the engine without derived equations, and the full
turns with which its bodies start.

Bodies without shapes use the engine, too. Its drives follow their laws, or its free joints and bodies move as those of
the coupled mechanism: the loops then place the bodies.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.parts import floating_coordinates
from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import LaterMotion, RigidKinematics, RigidMotion
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.state import NONE, State
from kaneflex.multibody.model.system import BODY, ComputedModule, System
from kaneflex.multibody.time.curves import Ahead, Beside, Curve, Followed
from kaneflex.multibody.time.trajectory import CoupledTrajectory, Pieces
from kaneflex.scene.laws import Law
from kaneflex.support.errors import SceneError

_SCALARS = ("x", "y", "c", "s", "v_x", "v_y", "omega", "a_x", "a_y", "epsilon")
_UNITS = ("m", "m", "1", "1", "m/s", "m/s", "rad/s", "m/s^2", "m/s^2", "rad/s^2")


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
class RigidReference(ComputedModule):
    """Rigid mechanism by names of its tabulated scalars.

    Attributes
    ----------
    system : System
        Of the rigid bodies.
    start : Placement
        Initial position.
    first : Courses
        All coordinates and speeds there; of dependent ones near values.
    links : mapping of str to Link
        Elastic links of the coupled mechanism.
    """

    system: System
    start: Placement
    first: Courses
    links: Mapping[str, Link]

    @property
    def engine(self) -> Engine:
        return self.system.engine

    @property
    def FREE(self) -> tuple[str, ...]:
        """Free joints, then the coordinates of free bodies."""
        return self.system.mechanism.free

    @cached_property
    def SCALARS(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and meaning of the tabulated scalars."""
        mechanism = self.system.mechanism
        found = [(f"{name}.angle", "m" if mechanism.joints[name].slides else "rad", "coordinate of the drive")
                 for name in mechanism.drives]  # fmt: skip
        found += [(name, load.unit, "magnitude of the load") for name, load in mechanism.loads.items()]
        found += [(f"{body}.{name}", unit, "of the body's start") for body in self.system.start
                  for name, unit in zip(_SCALARS, _UNITS, strict=True)]  # fmt: skip
        return tuple(found)

    @cached_property
    def determined(self) -> bool:
        """True if the drives alone determine the positions of the bodies, without redundant constraints."""
        choice = self.begin.choice
        given = self.FREE or len(choice.independent)
        return not given and len(choice.rows) == self.engine.count(at.JOINT_ROWS)

    @cached_property
    def begin(self) -> State:
        """State near that of the start, with free joints and bodies independent."""
        t, q, u, du = (part[0] for part in self.first)
        state = State(t, q, u, du, self.engine.sizes.copy(), NONE)
        return replace(state, choice=self.engine.chosen_at(state, [*self.system.free.values()]))

    @cached_property
    def followed(self) -> Followed:
        """Curve of a mechanism whose drives determine its position."""
        return Followed(self.system, self.begin)

    def known(self, times: np.ndarray, free: Courses) -> np.ndarray:
        """The first columns of SCALARS, which are known before the bodies are placed.

        Joints in laws without a drive count as at zero.
        """
        mechanism, driven = self.system.mechanism, self.engine.layout.driven
        courses = self.engine.courses(times).reshape(len(times), len(driven), 3).swapaxes(0, 1)
        of = dict(zip(driven, courses, strict=True))
        if mechanism.free_joints:
            moved = free.at(times).transpose(2, 1, 0)
            of |= {name: moved[self.system.free[name]] for name in mechanism.free_joints}
        joints = np.zeros((len(times), len(of) + len(mechanism.observed), 3))
        for k, name in enumerate(mechanism.drives):
            joints[:, k] = of[name]
        return np.concatenate([joints[:, : len(of), 0], self.engine.magnitudes(times, joints)], axis=1)

    def beside(self, times: np.ndarray, q: np.ndarray, v: np.ndarray, given: np.ndarray) -> Courses:
        """Courses of all coordinates beside a motion with frames x, y, phi at ``times`` [s], and their rates, (n_times,
        3 bodies); FREE coordinates are ``given`` with their rates, (3, n_times, FREE)."""
        found = np.stack([*self.system.coordinates_of(q, v), np.zeros((len(times), self.engine.size))])
        for k, name in enumerate(self.FREE):
            found[:, :, self.system.free[name]] = given[:, :, k]
        return Courses(times, *found)


@dataclass(frozen=True, eq=False)
class ReferenceKinematics(RigidKinematics):
    """Motion of a rigid reference, whose bodies are placed on request.

    ``free``: courses of its coordinates with free joints or bodies; ``run``: motion of all bodies at instants, if it is
    known.
    """

    module: RigidReference  # type: ignore[assignment]
    free: Courses
    run: CoupledTrajectory | None = None

    def at(self, times: np.ndarray | float) -> RigidMotion:
        return _Placed(self, np.atleast_1d(np.asarray(times, dtype=float)))

    @cached_property
    def curve(self) -> Curve:
        """Curve of the bodies."""
        module = self.module
        if not module.FREE:
            return module.followed
        return (Ahead if self.free is module.first else Beside)(module.system, module.begin, self.free.at)

    def states(self, system: System, times: np.ndarray) -> list[State]:
        """States of a coupled system with undeformed bodies at ``times`` [s], with the full turns since the start."""
        found, of = self.curve.record(times), self.module.system.record
        return system.undeformed(times, found[:, of.q], found[:, of.v])

    def table(self, times: np.ndarray) -> np.ndarray:
        """All scalars at ``times`` [s]; of bodies that the loops can't place they are not finite."""
        times, of, run = np.asarray(times, dtype=float), self.module.system.record, self.run
        place = np.zeros(0, int) if run is None else np.minimum(np.searchsorted(run.times, times), len(run.times) - 1)
        if run is not None and (run.times[place] == times).all():
            found = run.q[place], run.v[place], run.a[place]
        else:
            record = self.curve.record(times)
            found = record[:, of.q], record[:, of.v], record[:, of.a]
        count = len(self.module.system.start)
        q, v, a = (part.reshape(len(times), count, BODY) for part in found)
        turn = np.stack([np.cos(q[..., 2]), np.sin(q[..., 2])], axis=-1)
        bodies = np.concatenate([q[..., :2], turn, v, a], axis=-1).reshape(len(times), len(_SCALARS) * count)
        return np.concatenate([self.module.known(times, self.free), bodies], axis=1)


class _Placed(LaterMotion):
    """Motion at some times, whose bodies are placed when they are asked for."""

    motion: Any

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        if owner in self.motion.module.system.mechanism.springs:
            return self._direction(owner)["cs".index(key)]
        column = self.motion.column[name]
        return (self.known if column < self.known.shape[1] else self.values)[:, column]

    def _direction(self, spring: str) -> np.ndarray:
        """Cosine and sine of a spring's direction."""
        sides = self.motion.module.system.mechanism.springs[spring].sides
        start, end = (self.frame(side.body).place(side.at) for side in sides)
        return (end - start) / np.hypot(*(end - start))

    @cached_property
    def known(self) -> np.ndarray:
        """Scalars that are known before the bodies are placed."""
        return self.motion.module.known(self.times, self.motion.free)


def rigid_reference(system: System, start: Placement) -> ReferenceKinematics:
    """Motion of a system's rigid mechanism from the initial position of its bodies, with its free joints and bodies at
    their initial speeds."""
    mechanism = system.mechanism
    alone = replace(mechanism, contacts={}, frictions={})
    undeformed = rigid_system(alone, system.module, system.parameters)
    # one library for both: compiling another takes as long again
    undeformed = replace(undeformed, engine=replace(undeformed.engine, kind=system.engine.kind))
    frames = np.array([start.poses[body] for body in mechanism.bodies])
    frames[:, 2] = np.arctan2(np.sin(frames[:, 2]), np.cos(frames[:, 2]))
    frames = unwrapped(undeformed, frames.ravel(), start.drives)
    poses = dict(zip(mechanism.bodies, frames.reshape(-1, BODY), strict=True))
    places = {name: (start.drives[name], drive.initial_speed, 0.0) for name, drive in mechanism.drives.items()}
    for body, free in mechanism.frees.items():
        moves = zip(poses[body], free.rates, np.zeros(BODY), strict=True)
        places |= dict(zip(floating_coordinates(body), moves, strict=True))
    none = Courses(*(np.zeros((1, undeformed.engine.size)) for _ in Courses._fields))
    reference = RigidReference(undeformed, replace(start, poses=poses), none, system.links)
    given = np.array([places[name] for name in mechanism.free], float).reshape(-1, 3).T[:, None]
    first = reference.beside(np.zeros(1), frames[None], 0.0 * frames[None], given)
    return ReferenceKinematics(replace(reference, first=first), undeformed.engine.p, first)


def unwrapped(
    system: System, q: np.ndarray, drives: Mapping[str, float], given: Collection[str] = ()
) -> np.ndarray:
    """State q with full turns added to the bodies' angles, consistent with ``drives`` [rad or m], welds and guides.

    Joints with springs, laws or free drives start within half a turn of their rest or start; between bodies with
    ``given`` angles they keep their turns.
    """
    before = {name: float(q[k + 2]) for name, k in system.start.items()}
    angles = _counted(system, before, drives, _between(system, before, given))
    q = q.copy()
    for name, k in system.start.items():
        q[k + 2] = angles[name]
    return q


def check_turns_kept(system: System, laws: Collection[Law], before: np.ndarray, q: np.ndarray) -> None:
    """Raise SceneError if springs and laws of loads have other turns in q than in the given state ``before``."""
    was, now = ({name: float(part[k + 2]) for name, k in system.start.items()} for part in (before, q))
    now = _between(system, now, system.start)
    sprung = {spring.joint for spring in system.mechanism.springs.values()}
    for name, turned in _between(system, was, system.start).items():
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
