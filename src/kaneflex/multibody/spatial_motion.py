"""The motion of a rigid mechanism in space at any instants: prescribed, or integrated from its start."""

from __future__ import annotations

import bisect
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.mechanism.spatial_frame import AXES, SpatialFrame, slide_of, turn_of
from kaneflex.multibody.spatial_reactions import COMPONENTS, joint_wrenches
from kaneflex.multibody.spatial_system import SpatialSystem, State
from kaneflex.multibody.spatial_tables import COORDINATE
from kaneflex.multibody.spatial_turns import Count
from kaneflex.support.errors import SceneError

_XYZ = "xyz"
_BODY = (
    *(("", axis, "m", "place of the body's start, global") for axis in _XYZ),
    *(("axes_", name, "1", "of the body's axes, global") for name in AXES),
    *(("v_", axis, "m/s", "velocity of the body's start, global") for axis in _XYZ),
    *(("omega_", axis, "rad/s", "angular velocity, global") for axis in _XYZ),
    *(("a_", axis, "m/s^2", "acceleration of the body's start, global") for axis in _XYZ),
    *(("epsilon_", axis, "rad/s^2", "angular acceleration, global") for axis in _XYZ),
)
_JOINT = tuple((name, "N" if name.startswith("force") else "N m", f"{name[:-2]} on {{body}}, global")
               for name in COMPONENTS)  # fmt: skip
_STEPS = 500
"""Steps of a run, at least, in which turns are counted: also what stands still at both ends may have turned between."""
_FAR = 0.05
"""Largest step of a prescribed drive [rad or sizes of the mechanism] from place to place where loops are followed."""
_GROWTH = 30.0
"""How many times faster than the drives the other speeds may be before dependent speeds are chosen anew."""


@dataclass(frozen=True, eq=False)
class SpatialModule:
    """What a model reads of a module: names of what is tabulated of a mechanism in space.

    Attributes
    ----------
    system : SpatialSystem
    open_reactions : frozenset of str
        Those that no equation determines; they are no numbers.
    more : tuple
        Name, unit and meaning of what else is tabulated, for elastic bodies.
    """

    system: SpatialSystem
    open_reactions: frozenset[str] = frozenset()
    more: tuple[tuple[str, str, str], ...] = ()
    CONSTANTS: dict[str, float] = field(default_factory=dict)
    LOOPS: tuple = ()
    TERMS: tuple = ()
    LINKS: tuple = ()

    def __getattr__(self, name: str) -> object:
        """All else is the generated module's."""
        if name.startswith("_") and name not in ("__name__", "__file__"):
            raise AttributeError(name)
        return getattr(self.system.module, name)

    @cached_property
    def FREE(self) -> tuple[str, ...]:
        """What is left to the forces."""
        drives = self.system.scene.drives
        return (*(name for name, drive in drives.items() if drive.kind == "free"), *self.system.mechanism.floating)

    @cached_property
    def SCALARS(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and meaning of what is tabulated."""
        mechanism, scene = self.system.mechanism, self.system.scene
        found = []
        for name in self.coordinates:
            unit = "m" if mechanism.joints[name].kind == "prismatic" else "rad"
            found.append((f"{name}.angle", unit, "coordinate of the joint"))
        found += [(name, load.si_unit, "magnitude of the load") for name, load in scene.loads.items()]
        for body in mechanism.bodies:
            found += [(f"{body}.{head}{tail}", unit, meaning) for head, tail, unit, meaning in _BODY]
        for name, joint in mechanism.joints.items():
            found += [(f"{name}.{part}", unit, meaning.format(body=joint.sides[1].body))
                      for part, unit, meaning in _JOINT]  # fmt: skip
        for name in self.system.driven:
            unit = "N" if mechanism.joints[name].kind == "prismatic" else "N m"
            found.append((f"{name}.drive", unit, "what the drive exerts"))
        for name, spring in mechanism.springs.items():
            at = ("tension", "N") if spring.joint is None else ("torque", "N m")
            found.append((f"{name}.{at[0]}", at[1], "of the spring and its damper"))
        found += [(f"{name} energy", "J", "of the mechanism") for name in ("kinetic", "strain", "weight")]
        return (*found, *self.more)

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Joints whose coordinate is tabulated: those of the tree that have one, what is driven or free, what is read.

        Of several freedoms it is the first, of a cylindrical joint its turn; of a ball the angle of its rotation, from
        0 to pi.
        """
        mechanism, tree = self.system.mechanism, self.system.layout.tree
        known = {*self.system.scene.drives, *mechanism.read}
        return tuple(
            name
            for name, joint in mechanism.joints.items()
            if (joint.freedoms == 1 and name in tree) or (name in known and joint.freedoms)
        )

    @cached_property
    def closing(self) -> tuple[str, ...]:
        """Those that close loops: what they stand at follows from their bodies."""
        return tuple(name for name in self.coordinates if name in self.system.layout.cuts)


@dataclass(frozen=True, eq=False)
class SpatialKinematics(RigidKinematics):
    """The rigid motion of a mechanism in space: ``curve`` gives its state at an instant [s], like which the system's
    ``work`` then stands and moves."""

    module: SpatialModule  # type: ignore[assignment]
    parameters: np.ndarray
    curve: Callable[[float], State]

    def table(self, times: np.ndarray) -> np.ndarray:
        """All scalars at ``times`` [s]: shape (n_times, n_scalars), in the order of the module's SCALARS."""
        out = np.zeros((len(times), len(self.column) - len(self.module.more)))
        for k in np.argsort(times, kind="stable"):
            out[k] = self._row(self.curve(float(times[k])))
        for name in self.module.closing:
            out[:, self.column[f"{name}.angle"]] = self._closing(name, SpatialMotion(self, times, out))
        lost = [self.column[name] for name in self.module.open_reactions if name in self.column]
        out[:, lost] = np.nan
        return out

    def _row(self, state: State) -> np.ndarray:
        system, module = self.module.system, self.module
        k, tables, mechanism = system.work, system.tables, system.mechanism
        kinetic = 0.5 * state.u @ system.mass(state.sizes) @ state.u
        multipliers, wrenches, along = system.exerted(state)
        parts = [np.array([self._coordinate(name, state.q) for name in module.coordinates]), state.sizes]
        heavy = 0.0
        for name, body in mechanism.bodies.items():
            n = system.layout.node_of[name]
            parts += [k.r[n], k.R[n].ravel(), k.v[n], k.w[n], k.a[n], k.e[n]]
            heavy -= body.mass * (tables.gravity @ (k.r[n] + k.R[n] @ body.centre))
        parts += [*joint_wrenches(system, wrenches, multipliers).values(), along[system.driven_speeds]]
        between, twists = iter(k.springs), iter(k.twists)
        parts.append(np.array([next(between if s.joint is None else twists)[1] for s in mechanism.springs.values()]))
        strain = k.springs[:, 5].sum() + k.twists[:, 2].sum()
        return np.concatenate([*parts, [kinetic, strain, heavy]])

    def _closing(self, name: str, motion: SpatialMotion) -> np.ndarray:
        """Coordinate of a joint that closes a loop, turns counted from the start on."""
        coordinate, rate = self._stands(name, motion)
        if name in self._counts:
            for k in np.argsort(motion.times, kind="stable"):
                coordinate[k] = self._counts[name](float(motion.times[k]), float(coordinate[k]), float(rate[k]))
        return coordinate

    @cached_property
    def _counts(self) -> dict[str, Count]:
        """Of joints that close loops, those that turn."""
        module = self.module
        joints, longest = module.system.mechanism.joints, module.system.scene.horizon / _STEPS

        def stands(name: str) -> Callable[[float], tuple[float, float]]:
            def at(t: float) -> tuple[float, float]:
                row = self._row(self.curve(t))[None]
                coordinate, rate = self._stands(name, SpatialMotion(self, np.array([t]), row))
                return float(coordinate[0]), float(rate[0])

            return at

        return {name: Count(stands(name), longest) for name in module.closing if joints[name].kind != "prismatic"}

    def _stands(self, name: str, motion: SpatialMotion) -> tuple[np.ndarray, np.ndarray]:
        """Coordinate of a joint as its bodies stand, an angle from -pi to pi, and its rate."""
        mechanism = self.module.system.mechanism
        joint = mechanism.joints[name]
        first, second = (motion.frame(side.body) for side in joint.sides)
        if joint.kind == "prismatic":
            return slide_of(joint, first, second)[:2]
        return turn_of(joint, first, second, mechanism.relative(joint))[:2]

    def _coordinate(self, joint: str, q: np.ndarray) -> float:
        if joint in self.module.closing:
            return 0.0  # known when the bodies' rows are
        first = int(self.module.system.columns([joint], COORDINATE)[0])
        if self.module.system.mechanism.joints[joint].kind != "spherical":
            return float(q[first])
        return float(2.0 * np.arctan2(np.linalg.norm(q[first + 1 : first + 4]), abs(q[first])))

    def acting(self, times: np.ndarray, seen: RigidMotion) -> SpatialMotion:
        """Sizes of the loads alone, by laws at ``times`` [s] of joints that stand on curves through what was seen: to
        find where the mechanism is at that many instants would take longer than the run."""
        from scipy.interpolate import CubicSpline

        system, out = self.module.system, np.full((len(times), len(self.column)), np.nan)
        joints = np.array([seen[f"{name}.angle"] for name in system.told_joints]).reshape(-1, len(seen.times))
        curve = CubicSpline(seen.times, joints, axis=1)
        coordinates, speeds = curve(times).T, curve(times, 1).T
        columns = [self.column[name] for name in system.mechanism.loads]
        for k, t in enumerate(times.tolist()):
            out[k, columns] = system.magnitudes(t, coordinates[k], speeds[k])
        return SpatialMotion(self, times, out)

    def at(self, times: np.ndarray | float) -> SpatialMotion:
        """The rigid motion at ``times`` [s], scalar by name."""
        times = np.atleast_1d(np.asarray(times, dtype=float))
        return SpatialMotion(self, times, self.table(times))


@dataclass(frozen=True, eq=False)
class SpatialMotion(RigidMotion):
    """Scalars of a rigid motion in space at some times."""

    def taken(self, instants: np.ndarray) -> SpatialMotion:
        return SpatialMotion(self.motion, self.times[instants], self.values[instants])

    def frame(self, body: str) -> SpatialFrame:  # type: ignore[override]
        """The axes of a body, or of the ground."""
        return SpatialFrame(self, body)


def follow(system: SpatialSystem, start: State) -> Callable[[float], State]:
    """States of a mechanism whose drives say where it is, loops followed from place to place."""
    track = [start]

    def ahead(t: float, last: State) -> State:
        try:
            found = system.settle(t, last.q, last.u, last.choice)
            if _growth(system, found.u) <= _GROWTH:
                return found
            return system.settle(t, found.q, found.u, system.choose_anew(found.q, found.choice))
        except ArithmeticError as reason:
            raise SceneError(
                "joints", ", ".join(system.driven) or "joints", f"{reason}, at t = {t:.6g} s",
                "Change the lengths, or limit the drives' range",
            ) from None  # fmt: skip

    def state(t: float) -> State:
        last = track[max(0, bisect.bisect_right(track, t, key=lambda known: known.t) - 1)]
        while True:
            moved = abs(system.courses(t)[:, 0] - system.courses(last.t)[:, 0]) / system.measure[system.driven_speeds]
            steps = int(np.ceil(moved.max(initial=0.0) / _FAR))
            found = ahead(last.t + (t - last.t) / max(1, steps), last)
            if steps <= 1:
                return found
            last = found
            if last.t > track[-1].t:
                track.append(last)

    return state


def _growth(system: SpatialSystem, u: np.ndarray) -> float:
    """How fast the dependent speeds are beside the prescribed ones."""
    if not len(u):  # nothing moves
        return 0.0
    speeds = abs(u) * system.measure / system.measure.max()
    driven = speeds[system.driven_speeds].max(initial=0.0)
    return float(speeds.max() / driven) if driven else 0.0
