"""Rigid reference of a coupled mechanism, computed by the engine without derived equations.

Bodies without shapes use the engine, too. With all drives prescribed, and free ones at given positions, the loops place
the bodies; this module computes the positions, speeds and accelerations that a mechanism's own module tabulates, and
joint forces on request.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.parts import Drive
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.multibody.engine import Engine, build_engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model import tabulated_inputs
from kaneflex.multibody.model.body_parameters import Blocks
from kaneflex.multibody.model.system import BODY, CoupledSystem
from kaneflex.multibody.time.trajectory import by_themselves
from kaneflex.scene import Scene
from kaneflex.scene.tables import evaluate_block
from kaneflex.support.contract import COURSES
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.multibody.time.trajectory import CoupledTrajectory

_FAR = 0.1
"""Largest step of a drive [rad, or sizes of the mechanism] over which Newton's method closes a loop."""
_MOST_PLACES = 2_000_000
"""Largest number of positions between instants, of some hundred numbers each: two gigabytes at most."""
_OPENED = 1e-6
"""Largest opening of a redundantly constrained joint, in rad or sizes of the mechanism."""
_SCALARS = ("x", "y", "c", "s", "v_x", "v_y", "omega", "a_x", "a_y", "epsilon")
_UNITS = ("m", "m", "1", "1", "m/s", "m/s", "rad/s", "m/s^2", "m/s^2", "rad/s^2")


@dataclass(frozen=True, eq=False)
class RigidTwin:
    """Counterpart of a generated module for a :class:`~kaneflex.mechanism.rigid_motion.RigidKinematics`.

    Attributes
    ----------
    mechanism : NumericMechanism
        Mechanism of the scene.
    system : CoupledSystem
        Whose courses of drives and sizes of loads these are.
    rigid : CoupledSystem
        Of the rigid bodies, whose drives and loads are as row after row of its parameters says.
    start : Placement
        Position from which the loops are followed.
    """

    mechanism: NumericMechanism
    system: CoupledSystem
    rigid: CoupledSystem
    start: Placement
    CONSTANTS: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    LOOPS: tuple = ()

    @property
    def __name__(self) -> str:
        return self.system.module.__name__

    @property
    def __file__(self) -> str | None:
        return self.system.module.__file__

    def __getattr__(self, name: str) -> object:
        """Other attributes are those of the module of the laws."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.system.module, name)

    @cached_property
    def FREE(self) -> tuple[str, ...]:
        """Free joints, then the free coordinates of bodies."""
        return self.mechanism.free

    @property
    def links(self) -> Mapping[str, Link]:
        """Elastic links of the coupled mechanism."""
        return self.system.links

    @property
    def engine(self) -> Engine:
        return self.rigid.engine

    @cached_property
    def floating(self) -> dict[str, int]:
        """Bodies that move freely -> the first of their coordinates in the engine."""
        bodies, names = self.engine.tables.bodies, list(self.engine.layout.bodies)
        return {name: int(bodies[names.index(name), at.FIRST]) for name in self.mechanism.floating}

    @cached_property
    def PARAMETERS(self) -> tuple[tuple[str, str], ...]:
        """Places in p of the courses of free coordinates."""
        return tuple((f"drives.{name}.{course}", "1") for name in self.FREE for course in COURSES)

    @cached_property
    def SCALARS(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and meaning of the tabulated scalars."""
        joints = self.mechanism.joints
        found = [(f"{name}.angle", "m" if joints[name].slides else "rad", "coordinate of the drive")
                 for name in self.mechanism.drives]  # fmt: skip
        found += [(name, load.unit, "magnitude of the load") for name, load in self.mechanism.loads.items()]
        found += [(f"{body}.{name}", unit, "of the body's start") for body in self.rigid.start
                  for name, unit in zip(_SCALARS, _UNITS, strict=True)]  # fmt: skip
        return tuple(found)

    def motion(self, t: float, p: np.ndarray, s: np.ndarray) -> None:
        """Scalars at one instant."""
        s[:] = self._table(np.array([t]), p)[0]

    def tabulate(self, times: np.ndarray, p: np.ndarray, out: np.ndarray) -> None:
        """Scalars at all instants, (n_times, SCALARS); bodies that the loops can't place are not finite."""
        out[:] = self._table(times, p)

    def said(self, times: np.ndarray, p: np.ndarray) -> np.ndarray:
        """The first columns of SCALARS, which are known before the bodies are placed."""
        return self._said(times, self._drives(times, p))

    def _said(self, times: np.ndarray, drives: np.ndarray) -> np.ndarray:
        joints = drives[:, : 3 * len(self.mechanism.drives)]
        return np.concatenate([joints[:, ::3], self._loads(times, joints)], axis=1)

    def _table(self, times: np.ndarray, p: np.ndarray) -> np.ndarray:
        drives = self._drives(times, p)
        said = self._said(times, drives)
        # bodies that the drives place by themselves are known anywhere
        found = self._told(drives, said).unfold(self._followed(drives))
        return self.table_of(said, found.q, found.v, found.a)

    def table_of(self, said: np.ndarray, *moved: np.ndarray) -> np.ndarray:
        """Scalars from the first columns, and q, v, a of the bodies, (n_times, BODY bodies)."""
        q, v, a = (part.reshape(len(said), part.shape[1] // BODY, BODY) for part in moved)
        turn = np.stack([np.cos(q[..., 2]), np.sin(q[..., 2])], axis=-1)
        bodies = np.concatenate([q[..., :2], turn, v, a], axis=-1)
        return np.concatenate([said, bodies.reshape(len(said), math.prod(bodies.shape[1:]))], axis=1)

    def trajectory(self, times: np.ndarray, p: np.ndarray, shift: Mapping[str, np.ndarray]) -> CoupledTrajectory:
        """Motion as states of ``rigid``, with joint forces. Raises ArithmeticError at a singular state.

        ``shift`` has additions to the sizes of loads, by name (n_times,).
        """
        drives = self._drives(times, p)
        said = self._said(times, drives)
        for k, name in enumerate(self.mechanism.loads, start=len(self.mechanism.drives)):
            said[:, k] += shift.get(name, 0.0)
        told = self._told(drives, said)
        rows = told.states(self._followed(drives))
        found = told.unfold(rows)
        rows[:, 0] = times
        return by_themselves(rows, found)

    def _drives(self, times: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Coordinate, speed and acceleration of all drives, then of bodies that move freely, (n_times, 3 of them)."""
        names, driven = list(dict.fromkeys([*self.mechanism.drives, *self.FREE])), self.system.engine.layout.driven
        found = np.zeros((len(times), 3 * len(names)))
        place = {path: k for k, (path, _) in enumerate(self.PARAMETERS)}
        for name in self.FREE:
            for k, course in enumerate(COURSES):
                first = int(p[place[f"drives.{name}.{course}"]])
                block = p[first : first + 3 + 5 * int(p[first])]
                found[:, 3 * names.index(name) + k] = evaluate_block(block, times)
        columns = [3 * names.index(name) + k for name in driven for k in range(3)]
        found[:, columns] = self.system.engine.courses(times)
        return found

    def _loads(self, times: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """Sizes of all loads, (n_times, loads); joints without a drive count as at zero, as their positions aren't
        known."""
        unknown = np.zeros((len(times), 3 * len(self.mechanism.observed)))
        return self.system.load_sizes(times, np.column_stack([drives, unknown]))

    def _followed(self, drives: np.ndarray) -> np.ndarray:
        """Rows of the engine along the drives' path, at times 0, 1, 2, ...; NaN if the loops can't be followed.

        Beyond such a position every further one is tried by itself, from the last closed position. Every call begins at
        the initial position, so that results don't depend on earlier calls.
        """
        stood, done, ahead = {name: value.copy() for name, value in self._stood.items()}, 0, len(drives)
        self.engine.stand(stood["row"])
        self.engine.choose(0.0)
        rows = np.full((len(drives), len(stood["row"])), math.nan)
        while done < len(drives):
            wanted = drives[done : done + ahead]
            path, ends = self._path(stood["drives"], wanted)
            passed = self._passed(path, ends, stood["side"], rows[done : done + ahead])
            if passed:
                stood["row"], stood["drives"] = rows[done + passed - 1].copy(), wanted[passed - 1]
            if passed < ahead:
                self.engine.stand(stood["row"])
            done += passed + (passed < ahead)
            ahead = len(drives) - done if passed else min(1, len(drives) - done)
        rows[:, 0] = np.arange(len(rows))
        return rows

    def _told(self, drives: np.ndarray, said: np.ndarray | None = None) -> CoupledSystem:
        """``rigid`` with tabulated positions of its drives, at times 0, 1, 2, ..., and sizes of its loads."""
        courses = drives[:, : 3 * len(self.mechanism.drives)]
        loads = np.zeros((len(drives), len(self.mechanism.loads)))
        if said is not None:
            loads = said[:, len(self.mechanism.drives) :]
        return replace(self.rigid, engine=replace(self.engine, p=tabulated_inputs.parameters(courses, loads)))

    def _path(self, start: np.ndarray, drives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions of the drives (n, as many), sufficiently close to each other, and which of them were requested."""
        before, places = np.vstack([start, drives[:-1]]), slice(0, 3 * len(self._measure), 3)
        steps = np.ones(len(drives), int)
        if self.engine.count(at.REACTIONS):
            moved = abs(drives - before)[:, places] / self._measure
            between = np.maximum(1.0, np.ceil(np.nan_to_num(moved.max(axis=1, initial=0.0)) / _FAR))
            if between.sum() > _MOST_PLACES:
                name = list(self.mechanism.drives)[int(moved.max(axis=0).argmax())]
                far = f"it turns so often that the loops would have to be closed at {between.sum():.3g} positions"
                raise SceneError(f"drives.{name}.speed", None, far, "Give a lower speed or a shorter duration")
            steps = between.astype(int)
        ends = np.cumsum(steps) - 1
        of = np.repeat(np.arange(len(drives)), steps)
        share = 1.0 - (ends[of] - np.arange(len(of))) / steps[of]
        path = drives[of]
        path[:, places] = before[of, places] + share[:, None] * (drives - before)[of, places]
        path[ends] = drives
        return path, ends

    def _passed(self, path: np.ndarray, ends: np.ndarray, side: np.ndarray, rows: np.ndarray) -> int:
        """Fill rows of the engine at the ``ends`` of a path; returns the number of those reached."""
        engine = self._told(path).engine
        if self.determined:
            into = np.full(len(path), -1.0)
            into[ends] = np.arange(len(ends))
            return int(np.searchsorted(ends, engine.follow(into, side, rows)))
        for k, place in enumerate(path):
            self._let_float(place[3 * len(self.mechanism.drives) :])
            if not engine.move_on(float(k)) or self._opened(engine, float(k)) > _OPENED:
                return int(np.searchsorted(ends, k))
            if k in ends:
                rows[np.searchsorted(ends, k)] = engine.row(float(k))
            if engine.count(at.REACTIONS) and (k in ends or k % 8 == 7):
                engine.choose(float(k))
        return len(ends)

    def _let_float(self, courses: np.ndarray) -> None:
        """Set coordinates, rates and accelerations of free bodies."""
        for part, values in zip(self.engine.motion, courses.reshape(-1, 3).T, strict=False):
            for k, first in enumerate(self.floating.values()):
                part[first : first + 3] = values[3 * k : 3 * k + 3]

    def _opened(self, engine: Engine, t: float) -> float:
        """Largest opening of a cut [rad or sizes of the mechanism]."""
        return float(abs(engine.openings(t)).max(initial=0.0)) / max(self.mechanism.size, 1e-300)

    @cached_property
    def determined(self) -> bool:
        """True if the drives alone determine the positions of the bodies, without redundant constraints."""
        return not self.floating and not len(self._stood["spare"]) and not len(self.engine.choice.independent)

    @cached_property
    def _stood(self) -> dict[str, np.ndarray]:
        """Row of the engine and positions of the drives at the initial position, the side of a dead centre, and rows
        of redundant constraints."""
        engine = self.engine
        q = np.concatenate([self.start.poses[body] for body in engine.layout.bodies])
        engine.fold(q, np.zeros_like(q))
        spare = engine.choose(0.0)
        drives = np.zeros(3 * len(dict.fromkeys([*self.mechanism.drives, *self.FREE])))
        drives[: 3 * len(self.mechanism.drives) : 3] = engine.p[2::3][: len(self.mechanism.drives)]
        return {"row": engine.row(0.0), "drives": drives, "side": np.zeros(1), "spare": spare}

    @cached_property
    def _measure(self) -> np.ndarray:
        joints = self.mechanism.joints
        return np.array([self.mechanism.size if joints[name].slides else 1.0 for name in self.mechanism.drives])


class TwinKinematics(RigidKinematics):
    """Motion of a rigid reference, whose bodies are placed on request."""

    module: Any

    def at(self, times: np.ndarray | float) -> RigidMotion:
        return _Placed(self, np.atleast_1d(np.asarray(times, dtype=float)))


@dataclass(frozen=True, eq=False)
class FollowedKinematics(TwinKinematics):
    """Motion of rigid bodies read from a trajectory."""

    followed: CoupledTrajectory

    def table(self, times: np.ndarray) -> np.ndarray:
        """Table of scalars, as of the rigid reference."""
        t = self.followed
        place = np.minimum(np.searchsorted(t.times, times), len(t.times) - 1)
        if not (t.times[place] == times).all():
            return super().table(times)
        start = self.module.system.start
        columns = [start[body] + k for body in self.module.rigid.start for k in range(BODY)]
        moved = (part[np.ix_(place, columns)] for part in (t.q, t.v, t.a))
        return self.module.table_of(self.module.said(times, self.parameters), *moved)


class _Placed(RigidMotion):
    def __init__(self, motion: TwinKinematics, times: np.ndarray) -> None:
        self.__dict__.update(motion=motion, times=times)

    motion: Any

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        if owner in self.motion.module.mechanism.springs:
            return self._direction(owner)["cs".index(key)]
        column = self.motion.column[name]
        return (self.said if column < self.said.shape[1] else self.values)[:, column]

    def _direction(self, spring: str) -> np.ndarray:
        """Cosine and sine of a spring's direction."""
        sides = self.motion.module.mechanism.springs[spring].sides
        start, end = (self.frame(side.body).place(side.at) for side in sides)
        return (end - start) / np.hypot(*(end - start))

    def taken(self, instants: np.ndarray) -> RigidMotion:
        return _Placed(self.motion, self.times[instants])

    @cached_property
    def said(self) -> np.ndarray:
        """Scalars that are known before the bodies are placed."""
        return self.motion.module.said(self.times, self.motion.parameters)

    @cached_property
    def values(self) -> np.ndarray:
        return self.motion.table(self.times)


def build_twin(scene: Scene, system: CoupledSystem, start: Placement) -> RigidTwin:
    """Rigid mechanism of a scene at the initial position of its bodies."""
    mechanism = mechanism_of(scene)
    drives = {name: Drive("law", None) for name in mechanism.drives}
    placed = replace(mechanism, drives=drives, contacts={}, observed=(), frictions={})
    laws = tabulated_inputs
    module: Any = SimpleNamespace(courses=laws.courses, magnitudes=laws.magnitudes)
    place = np.array([[start.drives[name], 0.0, 0.0] for name in drives])
    p = tabulated_inputs.parameters(place.reshape(1, -1), np.zeros((1, len(mechanism.loads))))
    none = dict.fromkeys(mechanism.bodies, (0, 0))
    engine = build_engine(placed, module, Blocks(scene, none, {}), p)
    engine = replace(engine, shared=system.engine.handed)  # one library for both: compiling another takes as long again
    return RigidTwin(mechanism, system, CoupledSystem(module, engine, placed, {}, {}, none), start)
