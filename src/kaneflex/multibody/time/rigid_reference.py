"""Rigid reference of a coupled mechanism in the plane, computed by the engine without derived equations.

Bodies without shapes use the engine, too. Its drives follow their laws, its free joints and bodies have given courses:
the loops then place the bodies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.parts import Drive, floating_coordinates
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import LaterMotion, RigidKinematics, RigidMotion
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.codes import FAR
from kaneflex.multibody.model.computed_module import ComputedModule
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.system import BODY, System
from kaneflex.multibody.time.dense_output import Pieces
from kaneflex.multibody.time.revolutions import unwrapped
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

_MOST_PLACES = 2_000_000
"""Largest number of positions between instants, of some hundred numbers each: two gigabytes at most."""
_ROUNDED = 1e-6
"""Share of a step that counts as rounding."""
_SCALARS = ("x", "y", "c", "s", "v_x", "v_y", "omega", "a_x", "a_y", "epsilon")
_UNITS = ("m", "m", "1", "1", "m/s", "m/s", "rad/s", "m/s^2", "m/s^2", "rad/s^2")


class Courses(NamedTuple):
    """Courses of free joints and of the coordinates of free bodies, as in FREE: at instants [s], (n_times,), their
    coordinates, speeds and accelerations, (n_times, FREE) each.

    From a single instant on they keep their speeds.
    """

    times: np.ndarray
    q: np.ndarray
    u: np.ndarray
    du: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """Coordinates, speeds and accelerations, (3, n_times, FREE); between the instants by cubics."""
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
    """Rigid mechanism whose free joints and bodies have given courses, by names of its tabulated scalars.

    Attributes
    ----------
    system : System
        Of the rigid bodies, with given courses of free joints.
    start : Placement
        Position from which the loops are followed.
    first : Courses
        Coordinates and speeds of free joints and bodies there.
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

    @cached_property
    def given(self) -> tuple[str, ...]:
        """Free joints."""
        return tuple(name for name, drive in self.system.mechanism.drives.items() if drive.kind == "given")

    @cached_property
    def FREE(self) -> tuple[str, ...]:
        """Free joints, then the coordinates of free bodies."""
        return (*self.given, *self.system.mechanism.free)

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
        _, choice = self._first
        given = self.FREE or len(choice.independent)
        return not given and len(choice.rows) == self.engine.count(at.JOINT_ROWS)

    def known(self, times: np.ndarray, free: Courses) -> np.ndarray:
        """The first columns of SCALARS, which are known before the bodies are placed.

        Joints in laws without a drive count as at zero.
        """
        driven, count, mechanism = self.engine.layout.driven, len(self.given), self.system.mechanism
        drives = self.engine.courses(times).reshape(len(times), len(driven), 3)
        drives[:, len(driven) - count :] = free.at(times)[:, :, :count].transpose(1, 2, 0)
        drives = drives[:, [driven.index(name) for name in mechanism.drives]]
        unknown = np.zeros((len(times), len(mechanism.observed), 3))
        sizes = self.engine.magnitudes(times, np.concatenate([drives, unknown], axis=1))
        return np.concatenate([drives[:, :, 0], sizes], axis=1)

    def rows(self, times: np.ndarray, free: Courses) -> np.ndarray:
        """Rows of the engine at ``times`` [s]; coordinates that loops determine are NaN where these don't close.

        The loops are followed from the start at every call, so that results don't depend on earlier calls.
        """
        (start, choice), engine = self._first, self.engine
        path, courses, asked = self._path(times, free.at(times))
        rows = np.tile(start, (len(path), 1))
        rows[1:, 0] = path[1:]
        for k, i in self._columns.items():
            for part, course in zip(("q", "u", "du"), courses[:, 1:, k], strict=True):
                rows[1:, engine.columns[part].start + i] = course
        given = np.ascontiguousarray(courses[:, :, : len(self.given)].transpose(1, 2, 0)).reshape(len(path), -1)
        done, side = 1, np.zeros(1)
        engine.choose_speeds(choice)
        while done < len(rows):
            done = engine.follow(rows, done - 1, given, side)
            if done < len(rows):
                engine.stand(rows[done - 1])
                engine.choose(path[done - 1])
        return rows[asked]

    def _path(
        self, times: np.ndarray, courses: np.ndarray, again: int = 2
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Path from the start to all ``times`` in turn, with steps so short that loops can be followed.

        Returns its instants [s], (n,); courses of free joints and bodies there, (3, n, FREE), between ``times`` as a
        path only; the places of ``times``, where the courses are the given ones, (3, n_times, FREE). Where laws are
        uneven between ``times``, it divides the path up to twice ``again``.
        """
        times, places = np.append(0.0, times), np.concatenate([self.first.q, courses[0]])
        driven, moving = self.engine.layout.driven, self.engine.courses(times)[:, ::3]
        moving[:, len(driven) - len(self.given) :] = places[:, : len(self.given)]
        joints, size = self.system.mechanism.joints, self.system.mechanism.size
        moved = abs(np.diff(moving, axis=0)) / [size if joints[name].slides else 1.0 for name in driven]
        steps = np.maximum(1.0, np.ceil(np.nan_to_num(moved.max(axis=1, initial=0.0)) / FAR - _ROUNDED))
        steps = steps if self.engine.count(at.REACTIONS) else np.ones(len(steps))
        if steps.sum() > _MOST_PLACES:
            name = driven[int(moved.max(axis=0).argmax())]
            far = f"it turns so often that the loops would have to be closed at {steps.sum():.3g} positions"
            raise SceneError(f"drives.{name}.speed", None, far, "Give a lower speed or a shorter duration")
        ends = np.append(0, np.cumsum(steps).astype(int))
        every, path = np.arange(ends[-1] + 1), np.zeros((3, ends[-1] + 1, len(self.FREE)))
        for k, place in enumerate(places.T):
            path[0, :, k] = np.interp(every, ends, place)
        path[:, ends[1:]] = courses
        instants, asked = np.interp(every, ends, times), ends[1:]
        if again and len(every) > len(times):
            instants, path, places = self._path(instants[1:], path[:, 1:], again - 1)
            asked = places[asked - 1]
        return instants, path, asked

    @cached_property
    def _columns(self) -> dict[int, int]:
        """Places in FREE of free coordinates of the tree, and their numbers there."""
        own = [name for name, _ in self.engine.layout.coordinates]
        return {k: own.index(each) for k, name in enumerate(self.FREE)
                for each in (name, f"{name}.angle", f"{name}.position") if each in own}  # fmt: skip

    @cached_property
    def _first(self) -> tuple[np.ndarray, Choice]:
        """Row of the engine at the start, and the choice of dependent coordinates there."""
        q = np.concatenate([self.start.poses[body] for body in self.system.start])[None]
        (state,) = self.system.undeformed(np.zeros(1), q, 0.0 * q)
        choice = self.engine.chosen_at(state)
        return self.engine.row(0.0), choice


@dataclass(frozen=True, eq=False)
class ReferenceKinematics(RigidKinematics):
    """Motion of a rigid reference, whose bodies are placed on request.

    ``free``: courses of its free joints and bodies; ``run``: motion of all bodies at instants, if it is known.
    """

    module: RigidReference  # type: ignore[assignment]
    free: Courses
    run: CoupledTrajectory | None = None

    def at(self, times: np.ndarray | float) -> RigidMotion:
        return _Placed(self, np.atleast_1d(np.asarray(times, dtype=float)))

    def states(self, system: System, times: np.ndarray) -> list[State]:
        """States of a coupled system with undeformed bodies at ``times`` [s], with the full turns since the start."""
        found = by_themselves(self.module.system, self.module.rows(times, self.free))
        return system.undeformed(times, found.q, found.v)

    def table(self, times: np.ndarray) -> np.ndarray:
        """All scalars at ``times`` [s]; of bodies that the loops can't place they are not finite."""
        times, found, count = np.asarray(times, dtype=float), self.run, len(self.module.system.start)
        place = np.minimum(np.searchsorted(self.free.times, times), len(self.free.times) - 1)
        if found is None or not (self.free.times[place] == times).all():
            found = by_themselves(self.module.system, self.module.rows(times, self.free))
            place = np.arange(len(times))
        q, v, a = (part[place].reshape(len(times), count, BODY) for part in (found.q, found.v, found.a))
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


def rigid_reference(scene: Scene, system: System, start: Placement) -> ReferenceKinematics:
    """Motion of the rigid mechanism of a scene from the initial position of its bodies, with its free joints and bodies
    at their initial speeds."""
    mechanism = system.mechanism
    given = {name: Drive("given", None) if drive.free else drive for name, drive in mechanism.drives.items()}
    rigid = replace(mechanism, drives=given, contacts={}, frictions={})
    undeformed = rigid_system(scene, system.module, mechanism=rigid)
    # one library for both: compiling another takes as long again
    engine = replace(undeformed.engine, kind=system.engine.kind)
    plan, count = engine.tables.plan, sum(drive.free for drive in mechanism.drives.values())
    laws = len(engine.layout.driven) - count
    plan[plan[at.PRESCRIBED] + laws : plan[at.PRESCRIBED] + laws + count] = -1  # rows give these coordinates
    undeformed = replace(undeformed, engine=engine)
    frames = np.array([start.poses[body] for body in scene.bodies])
    frames[:, 2] = np.arctan2(np.sin(frames[:, 2]), np.cos(frames[:, 2]))
    frames = unwrapped(scene, undeformed, frames.ravel(), start.drives).reshape(-1, BODY)
    poses = dict(zip(scene.bodies, frames, strict=True))
    places = {name: (drive.start, drive.initial_speed) for name, drive in scene.drives.items()}
    for body, free in scene.floating.items():
        places |= dict(zip(floating_coordinates(body), zip(poses[body], free.rates, strict=True), strict=True))
    q, u = (np.array([[places[name][k] for name in mechanism.free]], float) for k in range(2))
    first = Courses(np.zeros(1), q, u, 0.0 * u)
    reference = RigidReference(undeformed, replace(start, poses=poses), first, system.links)
    return ReferenceKinematics(reference, engine.p, first)
