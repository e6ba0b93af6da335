"""The rigid mechanism beside a coupled one, by the engine's numbers: nothing of it is derived.

A body without shapes is one of the engine's, too. With all drives prescribed, the free ones where they are said to
stand, the loops place the bodies, and what a mechanism's own module tabulates of places, speeds and accelerations is
found here. It knows no forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.parts import Drive
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.multibody import rigid_kernels
from kaneflex.multibody import tables as at
from kaneflex.multibody.blocks import body_block, point_block
from kaneflex.multibody.engine import Engine, build_engine
from kaneflex.multibody.system import BODY, CoupledSystem
from kaneflex.scene import Scene
from kaneflex.scene.tables import evaluate_block
from kaneflex.support.contract import COURSES

if TYPE_CHECKING:
    from kaneflex.multibody.run import CoupledTrajectory

_FAR = 0.1
"""Largest step of a drive [rad, or sizes of the mechanism] over which Newton's method closes a loop."""
_SCALARS = ("x", "y", "c", "s", "v_x", "v_y", "omega", "a_x", "a_y", "epsilon")
_UNITS = ("m", "m", "1", "1", "m/s", "m/s", "rad/s", "m/s^2", "m/s^2", "rad/s^2")


class _PlainBlocks:
    """Blocks of bodies without shapes; nothing has mass, as nothing is pushed."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def body(self, name: str) -> np.ndarray:
        none = {"mass": 0.0, "mass_X": 0.0, "mass_X_X": 0.0, "inertia": 0.0}
        return body_block(none, 0, 0)

    def point(self, body: str, point: str) -> np.ndarray:
        return point_block(dict(zip("XY", self.scene.bodies[body].points_all[point], strict=True)), 0, 0)


@dataclass(frozen=True, eq=False)
class RigidTwin:
    """What a :class:`~kaneflex.mechanism.rigid_motion.RigidKinematics` reads of a module.

    Attributes
    ----------
    mechanism : NumericMechanism
        As the scene says.
    system : CoupledSystem
        Whose courses of drives and sizes of loads these are.
    engine : Engine
        Of the rigid bodies.
    start : Placement
        From where the loops are followed.
    """

    mechanism: NumericMechanism
    system: CoupledSystem
    engine: Engine
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
        """Elements and the like are those of the structure's coupled module."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.system.module, name)

    @cached_property
    def FREE(self) -> tuple[str, ...]:
        """What is left to the forces: joints, then the coordinates of bodies."""
        return self.mechanism.free

    @cached_property
    def floating(self) -> dict[str, int]:
        """Bodies that move freely -> the first of their coordinates in the engine."""
        bodies, names = self.engine.tables.bodies, list(self.engine.layout.bodies)
        return {name: int(bodies[names.index(name), at.FIRST]) for name in self.mechanism.floating}

    @cached_property
    def PARAMETERS(self) -> tuple[tuple[str, str], ...]:
        """Where p has the courses of what is free."""
        return tuple((f"drives.{name}.{course}", "1") for name in self.FREE for course in COURSES)

    @cached_property
    def SCALARS(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and meaning of what is tabulated."""
        joints = self.mechanism.joints
        found = [(f"{name}.angle", "m" if joints[name].slides else "rad", "coordinate of the drive")
                 for name in self.mechanism.drives]  # fmt: skip
        found += [(name, load.unit, "magnitude of the load") for name, load in self.mechanism.loads.items()]
        found += [(f"{body}.{name}", unit, "of the body's start") for body in self.engine.layout.bodies
                  for name, unit in zip(_SCALARS, _UNITS, strict=True)]  # fmt: skip
        return tuple(found)

    def motion(self, t: float, p: np.ndarray, s: np.ndarray) -> None:
        """Scalars at one instant."""
        s[:] = self._table(np.array([t]), p)[0]

    def tabulate(self, times: np.ndarray, p: np.ndarray, out: np.ndarray) -> None:
        """Scalars at all instants, (n_times, SCALARS); bodies that the loops can't place are not finite."""
        out[:] = self._table(times, p)

    def said(self, times: np.ndarray, p: np.ndarray) -> np.ndarray:
        """The first columns: what of SCALARS is known before the bodies are placed."""
        drives = self._drives(times, p)[:, : 3 * len(self.mechanism.drives)]
        return np.concatenate([drives[:, ::3], self._loads(times, drives)], axis=1)

    def _table(self, times: np.ndarray, p: np.ndarray) -> np.ndarray:
        drives = self._drives(times, p)
        bodies = np.full((len(times), len(self.engine.layout.bodies), len(_SCALARS)), math.nan)
        for k, row in enumerate(drives):
            moved = self._placed(row)
            if moved is not None:
                q, v, a = (part.reshape(-1, BODY) for part in moved)
                turn = np.column_stack([np.cos(q[:, 2]), np.sin(q[:, 2])])
                bodies[k] = np.column_stack([q[:, :2], turn, v, a])
        return np.concatenate([self.said(times, p), bodies.reshape(len(times), -1)], axis=1)

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
        courses, own, out = self.system.engine.kernels[at.COURSES], self.system.engine.p, np.zeros(3 * len(driven))
        columns = [3 * names.index(name) + k for name in driven for k in range(3)]
        for k, t in enumerate(times if driven else ()):
            courses(float(t), own, out, 0)
            found[k, columns] = out
        return found

    def _loads(self, times: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """Sizes of all loads, (n_times, loads); joints without a drive stand at zero, as their places aren't known."""
        unknown = np.zeros((len(times), 3 * len(self.mechanism.observed)))
        return self.system.load_sizes(times, np.column_stack([drives, unknown]))

    def _placed(self, drives: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """q, v, a of the bodies where the drives are, their loops followed from where they stood last."""
        engine, before = self.engine, self._stood
        drives, free = np.split(drives, [3 * len(self.mechanism.drives)])
        if not before:
            self._begin(before)
        steps = 1
        if engine.count(at.REACTIONS):
            steps = max(1, math.ceil((abs(drives[::3] - before["drives"]) / self._measure).max(initial=0.0) / _FAR))
        for k in range(1, steps + 1):
            engine.p[1:] = drives
            engine.p[1::3] = before["drives"] + k / steps * (drives[::3] - before["drives"])
            self._let_float(free)
            if not engine.move_on(0.0) or self._opened() > 1e-6:
                engine.stand(before["row"])
                engine.p[1::3] = before["drives"]
                engine.choose(0.0)
                return None
            if k == steps or k % 8 == 0:
                before["row"], before["drives"] = engine.row(0.0), engine.p[1::3].copy()
                if engine.count(at.REACTIONS):
                    engine.choose(0.0)
        q, v, a, *_ = engine.unfold(engine.row(0.0)[None])
        return q[0], v[0], a[0]

    def _let_float(self, courses: np.ndarray) -> None:
        """Take coordinates, rates and accelerations of the bodies that move freely."""
        for part, values in zip(self.engine.motion, courses.reshape(-1, 3).T, strict=False):
            for k, first in enumerate(self.floating.values()):
                part[first : first + 3] = values[3 * k : 3 * k + 3]

    def _opened(self) -> float:
        """Largest opening of a cut [rad or sizes of the mechanism]."""
        return float(abs(self.engine.openings(0.0)).max(initial=0.0)) / max(self.mechanism.size, 1e-300)

    @cached_property
    def _stood(self) -> dict[str, np.ndarray]:
        """Row of the engine and coordinates of the drives where the loops were closed last."""
        return {}

    @cached_property
    def _measure(self) -> np.ndarray:
        joints = self.mechanism.joints
        return np.array([self.mechanism.size if joints[name].slides else 1.0 for name in self.mechanism.drives])

    def _begin(self, stood: dict[str, np.ndarray]) -> None:
        engine = self.engine
        q = np.concatenate([self.start.poses[body] for body in engine.layout.bodies])
        stood["drives"] = np.array([self.start.drives[name] for name in self.mechanism.drives])
        engine.p[1::3] = stood["drives"]
        engine.fold(q, np.zeros_like(q))
        engine.choose(0.0)
        stood["row"] = engine.row(0.0)


class TwinKinematics(RigidKinematics):
    """The motion of a twin: bodies are placed when one is asked for."""

    module: Any

    def at(self, times: np.ndarray | float) -> RigidMotion:
        return _Placed(self, np.atleast_1d(np.asarray(times, dtype=float)))


@dataclass(frozen=True, eq=False)
class FollowedKinematics(TwinKinematics):
    """The same where nothing deforms: at the instants of a trajectory the bodies are where that brought them."""

    followed: CoupledTrajectory

    def table(self, times: np.ndarray) -> np.ndarray:
        """As the twin tabulates it."""
        t = self.followed
        place = np.minimum(np.searchsorted(t.times, times), len(t.times) - 1)
        if not (t.times[place] == times).all():
            return super().table(times)
        start = self.module.system.start
        rows = [slice(start[body], start[body] + BODY) for body in self.module.engine.layout.bodies]
        q, v, a = (np.stack([part[place, row] for row in rows], 1) for part in (t.q, t.v, t.a))
        turn = np.stack([np.cos(q[..., 2]), np.sin(q[..., 2])], -1)
        bodies = np.concatenate([q[..., :2], turn, v, a], -1).reshape(len(times), -1)
        return np.concatenate([self.module.said(times, self.parameters), bodies], 1)


class _Placed(RigidMotion):
    def __init__(self, motion: TwinKinematics, times: np.ndarray) -> None:
        self.__dict__.update(motion=motion, times=times)

    motion: Any

    def __getitem__(self, name: str) -> np.ndarray:
        column = self.motion.column[name]
        return (self.said if column < self.said.shape[1] else self.values)[:, column]

    def taken(self, instants: np.ndarray) -> RigidMotion:
        return _Placed(self.motion, self.times[instants])

    @cached_property
    def said(self) -> np.ndarray:
        """What is known before the bodies are placed."""
        return self.motion.module.said(self.times, self.motion.parameters)

    @cached_property
    def values(self) -> np.ndarray:
        return self.motion.table(self.times)


def build_twin(scene: Scene, system: CoupledSystem, start: Placement) -> RigidTwin:
    """The rigid mechanism of a scene, from where its bodies stand at first."""
    mechanism = mechanism_of(scene)
    drives = {name: Drive("law", None) for name in mechanism.drives}
    placed = replace(mechanism, drives=drives, loads={}, springs={}, contacts={}, observed=(), frictions={})
    kernels = {name: getattr(rigid_kernels, name) for name in ("KINDS", *at.KERNEL_NAMES)}
    module = SimpleNamespace(BODIES=dict.fromkeys(mechanism.bodies, (0, 0, 0)), **kernels)
    stand = np.zeros(1 + 3 * len(drives))
    stand[0] = 3 * len(drives)
    engine = build_engine(placed, module, _PlainBlocks(scene), stand)
    return RigidTwin(mechanism, system, engine, start)
