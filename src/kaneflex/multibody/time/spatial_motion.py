"""Motion of a mechanism in space at any instants: prescribed, or integrated from its start; under preset coupled with
its rigid reference."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from kaneflex.mechanism.dead_centres import Closing
from kaneflex.mechanism.rigid_motion import LaterMotion, RigidKinematics, RigidMotion
from kaneflex.mechanism.spatial import Side, SpatialJoint
from kaneflex.mechanism.spatial_frame import SpatialFrame, slide_of, turn_of
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.computed_module import ComputedModule
from kaneflex.multibody.model.initial_state import choose, least_singular_values, start_of
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.model.tree_layout import COORDINATE
from kaneflex.multibody.time.curves import AtStart, Curve, DrivenCurve, ReferenceCurve
from kaneflex.multibody.time.sections import DeformingMotion

_FAR = 1.0
"""Largest change of an angle in a step [rad], by the rate at either end, for a reliable count of turns."""
_STEPS = 500
"""Least number of steps of a run in which turns are counted: a joint at rest at both ends may have turned between."""
_AT_ONCE = 1024
"""Instants evaluated at once, to limit memory."""


@dataclass(frozen=True, eq=False)
class SpatialKinematics(RigidKinematics):
    """Rigid motion of a mechanism in space; ``curve`` gives its states."""

    module: ComputedModule  # type: ignore[assignment]
    parameters: np.ndarray
    curve: Curve

    @property
    def is_start(self) -> bool:  # type: ignore[override]
        return isinstance(self.curve, AtStart)

    @property
    def initial(self) -> tuple[System, State]:
        """Equations of the motion, and its initial state."""
        return self.module.system, self.curve.start

    @property
    def begin(self) -> float:  # type: ignore[override]
        return self.curve.start.t

    def at(self, times: np.ndarray | float, record: np.ndarray | None = None) -> SpatialMotion:
        """Rigid motion at ``times`` [s], with scalars by name; ``record``: that of the curve there, if it is known."""
        motion = self._open(np.ascontiguousarray(np.atleast_1d(times), dtype=float), record)
        self._close(motion)
        lost = [self.column[name] for name in self.module.open_reactions if name in self.column]
        motion.values[:, lost] = np.nan
        return motion

    def _open(self, times: np.ndarray, record: np.ndarray | None = None) -> SpatialMotion:
        """The same without coordinates of joints that close loops."""
        out = np.zeros((len(times), len(self.column) - len(self.module.more)))
        order, deforms = np.argsort(times, kind="stable"), bool(self.module.system.layout.shapes)
        if record is None and deforms:
            record = self.curve.record(times)
        for first in range(0, len(times), _AT_ONCE):
            part = order[first : first + _AT_ONCE]
            out[part] = self._scalars(self.curve.rows(times[part]) if record is None else record[part])
        return SpatialMotion(self, times, out, record)

    def _close(self, motion: SpatialMotion) -> None:
        """Fill in coordinates of joints that close loops, with turns counted from the start."""
        for name in self._closing:
            if name not in self._turning:
                motion.values[:, self.column[f"{name}.angle"]] = self._closed_coordinate(name, motion)[0]
        if self._turning:
            columns = [self.column[f"{name}.angle"] for name in self._turning]
            motion.values[:, columns] = self._counts.over(motion.times, *self._angles(motion))

    def _scalars(self, rows: np.ndarray) -> np.ndarray:
        """Scalars of records, without coordinates of joints that close loops."""
        system, found = self.module.system, np.zeros((len(rows), len(self.column) - len(self.module.more)))
        q, coordinates = system.engine.instants(rows).q, self.module.coordinates
        for k, name in enumerate(coordinates):
            found[:, k] = self._coordinate(name, q)
        found[:, len(coordinates) :] = rows[:, [each.column for each in system.scalars.values()]]
        return found

    @cached_property
    def _closing(self) -> list[str]:
        """Joints whose coordinates follow from the bodies: those that close loops."""
        return [name for name in self.module.coordinates if name in self.module.system.layout.cuts]

    @cached_property
    def _turning(self) -> list[str]:
        """Joints that close loops and have turns to count."""
        joints = self.module.system.mechanism.joints
        return [name for name in self._closing if joints[name].kind not in ("prismatic", "spherical")]

    def _angles(self, motion: SpatialMotion) -> tuple[np.ndarray, np.ndarray]:
        """Angles of these, from -pi to pi, and their rates, (n_times, n)."""
        angles, rates = zip(*(self._closed_coordinate(name, motion) for name in self._turning), strict=True)
        return np.array(angles).T, np.array(rates).T

    @cached_property
    def _counts(self) -> Counts:
        def at(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self._angles(self._open(times))

        known = self.curve.turned or {}
        angles = np.array([known.get(name, np.nan) for name in self._turning])
        return Counts(at, self.module.system.mechanism.horizon / _STEPS, self.begin, angles)

    def turned(self, t: float) -> dict[str, tuple[float, float]]:
        """Angle with whole turns and its rate of the joints whose turns are counted, at t [s], by their names."""
        if not self._turning:
            return {}
        motion = self.at(t)
        rates = self._angles(motion)[1][0].tolist()
        return {name: (float(motion[f"{name}.angle"][0]), rate)
                for name, rate in zip(self._turning, rates, strict=True)}  # fmt: skip

    def _closed_coordinate(self, name: str, motion: SpatialMotion) -> tuple[np.ndarray, np.ndarray]:
        """Coordinate of a joint from its bodies' positions, an angle from -pi to pi, and its rate; a ball has none."""
        from scipy.spatial.transform import Rotation

        mechanism = self.module.system.mechanism
        joint = mechanism.joints[name]
        joint, first, second = motion.joined_frames(joint)
        if joint.kind == "prismatic":
            return slide_of(joint, first, second)[:2]
        if joint.kind == "spherical":
            turned = np.einsum("jit,jkt->tik", first.axes, second.axes) @ mechanism.relative(joint).T
            return Rotation.from_matrix(turned).magnitude(), np.zeros(len(motion.times))
        return turn_of(joint, first, second, mechanism.relative(joint))[:2]

    def _coordinate(self, joint: str, q: np.ndarray) -> np.ndarray:
        system = self.module.system
        if joint in self._closing:
            return np.zeros(len(q))  # known when the bodies' rows are
        first = int(system.columns([joint], COORDINATE)[0])
        if system.mechanism.joints[joint].kind == "spherical":
            return 2.0 * np.arctan2(np.linalg.norm(q[:, first + 1 : first + 4], axis=1), abs(q[:, first]))
        return q[:, first]

    def acting(self, times: np.ndarray, seen: RigidMotion) -> SpatialMotion:
        """Sizes of the loads at ``times`` [s], with joint coordinates interpolated from known instants, as
        evaluating the mechanism at that many would take longer than the run."""
        from scipy.interpolate import CubicSpline

        system, out = self.module.system, np.full((len(times), len(self.column)), np.nan)
        joints = np.array([seen[f"{name}.angle"] for name in system.scalar_joints]).reshape(-1, len(seen.times))
        curve = CubicSpline(seen.times, joints, axis=1)
        coordinates, speeds = curve(times).T, curve(times, 1).T
        columns = [self.column[name] for name in system.mechanism.loads]
        out[:, columns] = system.magnitudes_at(times, coordinates, speeds)
        return SpatialMotion(self, times, out)

    @property
    def rigid_only(self) -> SpatialKinematics:
        """Motion without the scalars for elastic bodies."""
        module = replace(self.module, more=(), open_reactions=frozenset())
        return SpatialKinematics(module, self.parameters, self.curve)

    def later(self, times: np.ndarray) -> SpatialMotion:
        """The same, tabulated on request."""
        return _Later(self, times)


@dataclass(frozen=True, eq=False)
class CoupledKinematics(SpatialKinematics):
    """Motion of deforming bodies: their axes and shapes. Before a run bodies are undeformed, and follow the drives or,
    with free joints, are at their start.

    Attributes
    ----------
    first : State
        Initial state of a run, as the scene gives it.
    rigid : SpatialKinematics
        Motion of the rigid mechanism with the same positions of free joints.
    """

    first: State
    rigid: SpatialKinematics

    def along(self, curve: Curve) -> CoupledKinematics:
        """This mechanism with another motion."""
        engine, rigid = self.module.system.engine, self.rigid
        counts = len(engine.layout.positions), engine.size
        q, u = (np.setdiff1d(np.arange(count), modal) for count, modal in zip(counts, engine.modal, strict=True))

        def near(times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            found = engine.instants(curve.rows(times))
            return found.q[:, q], found.u[:, u], found.du[:, u]

        beside = ReferenceCurve(rigid.module.system, replace(rigid.curve.start, t=curve.start.t), near)
        beside.turned = curve.turned
        return replace(self, curve=curve, rigid=replace(rigid, curve=beside))

    def states(self, system: System, times: np.ndarray) -> list[State]:
        """States at ``times`` [s] with zero shapes at rest: by the drives if these prescribe them, else by the motion.
        """
        if not self.module.FREE:
            return list(map(DrivenCurve(system, start_of(system)), times.tolist()))
        return [self._at_rest(system, self.curve(t)) for t in times.tolist()]

    def _at_rest(self, system: System, found: State) -> State:
        """State with zero shapes at rest."""
        q, u = found.q.copy(), found.u.copy()
        coordinates, speeds = system.engine.modal
        q[coordinates] = u[speeds] = 0.0
        return system.project(found.t, q, u, choose(system, q, prefer=True))


def before_run(module: ComputedModule, start: State, first: State) -> CoupledKinematics:
    """Motion of a coupled system as far as it is known before a run, from its undeformed ``start`` and its ``first``
    state."""
    system, p = module.system, module.system.parameters
    alone = rigid_system(system.mechanism, system.module, p, coupled=True)
    rigid = SpatialKinematics(ComputedModule(alone), p, DrivenCurve(alone, start_of(alone)))
    if not module.FREE:
        return CoupledKinematics(module, p, DrivenCurve(system, start), first, rigid)
    found = CoupledKinematics(module, p, AtStart(system, first), first, rigid)
    return found.along(found.curve)


@dataclass(frozen=True, eq=False)
class SpatialMotion(DeformingMotion):
    """Scalars of a rigid motion in space at some times; for deforming bodies those of their axes and shapes."""

    motion: Any
    record: np.ndarray | None = None
    freedoms = 6

    @property
    def system(self) -> System:  # type: ignore[override]
        return self.motion.module.system

    def clearance(self, name: str) -> np.ndarray:
        """Position of the second side of a joint with clearance, or of a contact, from the first, global [m],
        (3, n_times)."""
        loose, contacts, point = self.mechanism.loose, self.mechanism.contacts, self.mechanism.point
        sides = [Side(at.body, point(at)) for at in loose[name].sides] if name in loose else contacts[name].sides
        (first, one), (second, other) = (self.section_frame(side) for side in sides)
        return second.place(other.at) - first.place(one.at)

    def recording(self, record: np.ndarray) -> SpatialMotion:  # type: ignore[override]
        moved: SpatialMotion = self.motion.at(self.times, record)
        return moved

    def taken(self, instants: np.ndarray) -> Self:
        record = None if self.record is None else self.record[instants]
        return type(self)(self.motion, self.times[instants], self.values[instants], record)

    def frame(self, body: str) -> SpatialFrame:  # type: ignore[override]
        """The axes of a body, or of the ground."""
        return SpatialFrame(self, body)

    def joined_frames(self, joint: SpatialJoint) -> tuple[SpatialJoint, SpatialFrame, SpatialFrame]:
        """Joint with its sides in the axes of their sections, and these axes."""
        (first, at_first), (second, at_second) = (self.section_frame(side) for side in joint.sides)
        return replace(joint, sides=(at_first, at_second)), first, second


class _Later(LaterMotion, SpatialMotion):
    """Motion in space that is tabulated on request."""


def firmness(motion: SpatialKinematics, times: np.ndarray) -> list[Closing]:
    """Conditioning of the loops of a mechanism in space at some instants [s]."""
    system = motion.module.system
    if not system.layout.cuts:
        return []
    rows = motion.curve.rows(times)
    values = least_singular_values(system, system.engine.instants(rows).q, system.engine.open_speeds)
    at = motion.rigid_only.at(times[[values.argmin()]])
    drives = (name for name in system.mechanism.drives if f"{name}.angle" in motion.column)
    places = {name: float(at[f"{name}.angle"][0]) for name in drives}
    return [Closing(", ".join(system.layout.cuts), False, values, system.mechanism.written(places))]


class Counts:
    """Counts of the turns of several angles from the start of a run, in steps too short for a whole turn.

    Parameters
    ----------
    at : callable
        Angles (n_times, n) at ascending times [s], from -pi to pi, and their rates [rad, rad/s].
    longest : float
        Longest step [s].
    begin : float
        Start [s].
    known : ndarray (n,)
        Angles with whole turns there; NaN: none.
    """

    def __init__(
        self, at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], longest: float, begin: float = 0.0,
        known: np.ndarray | float = math.nan,
    ) -> None:  # fmt: skip
        self.at, self.longest = at, longest
        start = np.array([begin])
        self.times, self.angles, self.rates = start, *at(start)
        self.first = np.nan_to_num(np.round((known - self.angles) / math.tau))

    def over(self, times: np.ndarray, angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Angles (n_times, n) [rad] at times [s] with whole turns; ``angles``: without these.

        Each turn is counted from the change of an angle that the rates at both ends of a step predict.
        """
        self._add(times, angles, rates)
        while len(between := self._between()):
            self._add(between, *self.at(between))
        near = 0.5 * np.diff(self.times)[:, None] * (self.rates[1:] + self.rates[:-1])
        turns = np.round((near - np.diff(self.angles, axis=0)) / math.tau)
        counted = self.angles + math.tau * np.cumsum(np.vstack([self.first, turns]), axis=0)
        return np.asarray(counted[np.searchsorted(self.times, times)])

    def _add(self, times: np.ndarray, angles: np.ndarray, rates: np.ndarray) -> None:
        """Add instants to the known ones, in their order."""
        self.times, first = np.unique(np.concatenate([self.times, times]), return_index=True)
        self.angles, self.rates = (
            np.concatenate(parts)[first] for parts in ((self.angles, angles), (self.rates, rates))
        )  # fmt: skip

    def _between(self) -> np.ndarray:
        """Instants within steps that are too long by the rates at their ends, ascending."""
        steps, fast = np.diff(self.times), abs(np.nan_to_num(self.rates)).max(axis=1, initial=0.0)
        parts = steps * np.maximum(1.0 / self.longest, np.maximum(fast[1:], fast[:-1]) / _FAR)
        long = np.flatnonzero(parts > 1.0001)
        return np.concatenate([np.zeros(0), *(
            self.times[k] + steps[k] * np.arange(1, count) / count
            for k, count in zip(long, np.ceil(parts[long]), strict=True)
        )])  # fmt: skip
