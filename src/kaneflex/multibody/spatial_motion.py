"""The motion of a rigid mechanism in space at any instants: prescribed, or integrated from its start."""

from __future__ import annotations

import bisect
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.mechanism.spatial_frame import AXES, SpatialFrame
from kaneflex.multibody.spatial_dynamics import Choice
from kaneflex.multibody.spatial_system import SpatialSystem
from kaneflex.multibody.spatial_tables import COORDINATE, SPEED
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
_JOINT = (
    *(("force_", axis, "N", "force on {body}, global") for axis in _XYZ),
    *(("moment_", axis, "N m", "moment on {body}, global") for axis in _XYZ),
)
_FAR = 0.05
"""Largest step of a prescribed drive [rad or sizes of the mechanism] from place to place where loops are followed."""
_GROWTH = 30.0
"""How many times faster than the drives the other speeds may be before dependent speeds are chosen anew."""


@dataclass(eq=False)
class State:
    """Where a mechanism is at an instant: coordinates, speeds, their rates, and the choice of speeds."""

    t: float
    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    choice: Choice


@dataclass(frozen=True, eq=False)
class SpatialModule:
    """What a model reads of a module: names of what is tabulated of a mechanism in space.

    Attributes
    ----------
    system : SpatialSystem
    open_reactions : frozenset of str
        Those that no equation determines; they are no numbers.
    """

    system: SpatialSystem
    open_reactions: frozenset[str] = frozenset()
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
            found += [(f"{name}.{head}{tail}", unit, meaning.format(body=joint.sides[1].body))
                      for head, tail, unit, meaning in _JOINT]  # fmt: skip
        for name in self.system.driven:
            unit = "N" if mechanism.joints[name].kind == "prismatic" else "N m"
            found.append((f"{name}.drive", unit, "what the drive exerts"))
        for name, spring in mechanism.springs.items():
            at = ("tension", "N") if spring.joint is None else ("torque", "N m")
            found.append((f"{name}.{at[0]}", at[1], "of the spring and its damper"))
        found += [(f"{name} energy", "J", "of the mechanism") for name in ("kinetic", "strain", "weight")]
        return tuple(found)

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Joints of the tree whose coordinate is tabulated: those that have one, and what is driven or free.

        Of several freedoms it is the first; of a ball the angle of its rotation, from 0 to pi.
        """
        joints, tree = self.system.mechanism.joints, self.system.layout.tree
        return tuple(
            name for name in tree
            if joints[name].freedoms == 1 or (name in self.system.scene.drives and joints[name].freedoms)
        )


@dataclass(frozen=True, eq=False)
class SpatialKinematics(RigidKinematics):
    """The rigid motion of a mechanism in space: ``curve`` gives its state at an instant [s]."""

    module: SpatialModule  # type: ignore[assignment]
    parameters: np.ndarray
    curve: Callable[[float], State]

    def table(self, times: np.ndarray) -> np.ndarray:
        """All scalars at ``times`` [s]: shape (n_times, n_scalars), in the order of the module's SCALARS."""
        out = np.zeros((len(times), len(self.column)))
        for k in np.argsort(times, kind="stable"):
            out[k] = self._row(self.curve(float(times[k])))
        lost = [self.column[name] for name in self.module.open_reactions if name in self.column]
        out[:, lost] = np.nan
        return out

    def _row(self, state: State) -> np.ndarray:
        system, module = self.module.system, self.module
        k, tables, mechanism = system.work, system.tables, system.mechanism
        q, u, du = state.q.copy(), state.u.copy(), state.du.copy()
        system.close(q, state.choice)
        sizes = system.sizes(state.t, q, u)
        system.accelerate(state.choice, u, du, sizes)
        kinetic = system.kinetic(u, sizes)
        multipliers, wrenches, along = system.exerted(state.choice, sizes)
        parts = [np.array([self._coordinate(name, q) for name in module.coordinates])]
        parts.append(sizes[np.argsort(system._forces_first)])
        heavy = 0.0
        for name, body in mechanism.bodies.items():
            n = system.layout.node_of[name]
            parts += [k.r[n], k.R[n].ravel(), k.v[n], k.w[n], k.a[n], k.e[n]]
            heavy -= body.mass * (tables.gravity @ (k.r[n] + k.R[n] @ body.centre))
        exerts = system.joint_wrenches(wrenches, multipliers)
        parts += [exerts[name] for name in mechanism.joints]
        parts.append(along[system.columns(system.driven, SPEED)] if system.driven else np.zeros(0))
        between, twists = iter(k.springs), iter(k.twists)
        parts.append(np.array([next(between if s.joint is None else twists)[1] for s in mechanism.springs.values()]))
        strain = k.springs[:, 5].sum() + k.twists[:, 2].sum()
        return np.concatenate([*parts, [kinetic, strain, heavy]])

    def _coordinate(self, joint: str, q: np.ndarray) -> float:
        first = int(self.module.system.columns([joint], COORDINATE)[0])
        if self.module.system.mechanism.joints[joint].kind != "spherical":
            return float(q[first])
        return float(2.0 * np.arctan2(np.linalg.norm(q[first + 1 : first + 4]), abs(q[first])))

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


def start_of(system: SpatialSystem) -> State:
    """Where a mechanism starts: drives where they are said to stand, loops closed, speeds as given.

    Raises
    ------
    SceneError
        If a loop can't close, drives fight the loops, or something moves that no one named.
    """
    q, u, du = system.at_zero.copy(), np.zeros(system.speeds), np.zeros(system.speeds)
    system.set_drives(0.0, q, u, du)
    choice = system.choose(q, prefer=True)
    _check_drives(system, choice)
    if not system.close(q, choice):
        free = system.choose(q)
        if not system.close(q, free):
            system.check_closing(q)
    choice = system.choose(q, prefer=True)
    system.check_closing(q)
    _check_named(system, choice, q)
    given = system.given_speeds()
    for k in choice.independent:
        u[k] = given.get(int(k), 0.0)
    system.accelerate(choice, u, du, system.sizes(0.0, q, u))
    for k, wanted in given.items():
        if abs(u[k] - wanted) > 1e-9 * (abs(u).max() + abs(wanted)):
            name = system.layout.speeds[k].rpartition(".")[0]
            raise SceneError(
                f"drives.{name}.initial_speed", wanted,
                f"with the other speeds it is {u[k]:.9g}: the loops tie them to each other",
                "Give initial speeds to as many joints as the mechanism has freedoms",
            )  # fmt: skip
    return State(0.0, q, u, du, choice)


def _check_drives(system: SpatialSystem, choice: Choice) -> None:
    """Prescribed drives must be left free by the loops."""
    J = system.work.J[choice.rows]
    whole = np.linalg.matrix_rank(system.work.J, 1e-9 * max(abs(system.work.J).max(initial=0.0), 1e-300)) if len(
        system.work.J
    ) else 0
    if whole > len(J):
        name = system.driven[-1]
        raise SceneError(
            f"drives.{name}", None, "the loops and the other drives say already how this joint moves",
            "Leave one drive out, or let it be free = true",
        )  # fmt: skip


def _check_named(system: SpatialSystem, choice: Choice, q: np.ndarray) -> None:
    """Every freedom must be driven, or named as free."""
    from scipy.linalg import null_space

    named = np.array(system.named(), int)
    free = [name for name, drive in system.scene.drives.items() if drive.kind == "free"]
    if free and not len(choice.independent):
        raise SceneError(
            f"drives.{free[0]}", "free", "joints and drives leave the mechanism no freedom",
            "Leave a joint or a drive out, or check their axes",
        )  # fmt: skip
    J = system.work.J[choice.rows] * system.measure
    held = np.concatenate([choice.prescribed, named])
    selected = np.zeros((len(held), system.speeds))
    selected[np.arange(len(held)), held] = 1.0
    left = null_space(np.vstack([J, selected]), rcond=1e-9)
    if left.shape[1]:
        moving = [system.layout.speeds[k] for k in np.flatnonzero(abs(left).max(axis=1) > 1e-6)]
        joints = list(dict.fromkeys(name.rpartition(".")[0] for name in moving))
        count = f"{left.shape[1]} freedom{'s' * (left.shape[1] > 1)}"
        raise SceneError(
            "drives", None, f"{count} of the mechanism that nothing drives: of {', '.join(joints)}",
            f"Drive a joint, or leave it to the forces, like drives.{joints[0]} = {{free = true}}",
        )  # fmt: skip


def follow(system: SpatialSystem, start: State) -> Callable[[float], State]:
    """States of a mechanism whose drives say where it is, loops followed from place to place."""
    track = [start]

    def ahead(t: float, last: State) -> State:
        q, u, du = last.q.copy(), np.zeros(system.speeds), np.zeros(system.speeds)
        system.set_drives(t, q, u, du)
        choice = last.choice
        if not system.close(q, choice):
            raise _stuck(system, t)
        system.check_closing(q)
        system.accelerate(choice, u, du, system.sizes(t, q, u))
        if not np.isfinite(du).all():
            raise _stuck(system, t)
        if _growth(system, u) > _GROWTH:
            choice = system.choose(q)
        return State(t, q, u, du, choice)

    def state(t: float) -> State:
        last = track[max(0, bisect.bisect_right(track, t, key=lambda known: known.t) - 1)]
        while True:
            moved = abs(system.courses(t)[:, 0] - system.courses(last.t)[:, 0]) / system.measure[system._driven_speeds]
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
    speeds = abs(u) * system.measure / system.measure.max()
    driven = speeds[system._driven_speeds].max(initial=0.0)
    return float(speeds.max() / driven) if driven else 0.0


def _stuck(system: SpatialSystem, t: float) -> SceneError:
    names = ", ".join(system.driven) or "joints"
    return SceneError(
        "joints", names, f"the loops can't close, or leave open how they go on, at t = {t:.6g} s",
        "Change the lengths, or limit the drives' range",
    )  # fmt: skip
