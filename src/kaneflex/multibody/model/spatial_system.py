"""Equations of a mechanism in space with its numbers: positions, independent speeds, accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from kaneflex.mechanism.spatial import SpatialMechanism, spatial_mechanism_of
from kaneflex.multibody.dynamics.arrays import Columns, Work
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model.assembly import engine_of
from kaneflex.multibody.model.body_parameters import SpatialBlocks
from kaneflex.multibody.model.codes import DONE, check
from kaneflex.multibody.model.layout import Kind
from kaneflex.multibody.model.module_loading import bind_parameters
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.topology import build_tables
from kaneflex.multibody.model.tree_builder import Built
from kaneflex.multibody.model.tree_layout import (
    BALL,
    COORDINATE,
    KIND,
    RIGID,
    SPEED,
    Flexible,
    Layout,
    Tables,
    leading,
)  # fmt: skip
from kaneflex.scene import Scene


@dataclass(frozen=True, eq=False)
class SpatialSystem:
    """The equations of a mechanism in space with its numbers.

    Attributes
    ----------
    scene : Scene
    module : ModuleType
        Generated: ``courses`` of drives and ``magnitudes`` of loads.
    parameters : ndarray
        Their argument p.
    mechanism : SpatialMechanism
    built : Built
    coupled : bool
        True if it deforms, or belongs to a deforming one and shares its compiled functions.
    """

    scene: Scene
    module: ModuleType
    parameters: np.ndarray
    mechanism: SpatialMechanism
    built: Built
    coupled: bool

    @property
    def tables(self) -> Tables:
        return self.built.tables

    @property
    def layout(self) -> Layout:
        return self.built.layout

    @property
    def freedom(self) -> str:
        """Entry of the scene that lets the mechanism move by forces."""
        free, floating = self.scene.free_joints, self.mechanism.floating
        return f"drives.{free[0]}" if free else f"bodies.{floating[0]}.free" if floating else "solve.preset"

    def place(self, q: np.ndarray) -> None:
        """Positions, axes and directions in ``work``."""
        self.engine.call("place", np.ascontiguousarray(q))

    def close(self, q: np.ndarray, choice: Choice) -> bool:
        """Close the loops by the dependent coordinates, in place; True if they close."""
        self.engine.choose_speeds(choice)
        closes = self.engine.call("close", q)
        q[:] = self.work.q
        return bool(closes)

    def project(self, t: float, q: np.ndarray, u: np.ndarray, choice: Choice) -> State:
        """State at t [s] near q with the independent ones of the speeds u; ``work`` has it, too.

        Sets prescribed drives, closes loops, and determines dependent speeds, then loads and all rates.

        Raises
        ------
        ArithmeticError
            If a loop does not close, or the rates are not determined; it says which.
        """
        self.engine.choose_speeds(choice)
        check(self.engine.call("project", t, np.ascontiguousarray(q), np.ascontiguousarray(u)))
        return self.engine.state(t, choice)

    def follow(self, begin: float, choice: Choice, times: np.ndarray, out: np.ndarray) -> tuple[int, float, int]:
        """Rows of :class:`Instants` at ascending ``times`` [s] from the position of ``work`` at ``begin`` [s], by
        :func:`kaneflex.multibody.dynamics.spatial_entries.follow`; returns their number, the time of ``work`` then, and
        its outcome."""
        self.engine.choose_speeds(choice)
        self.work.now[:2] = begin, DONE
        count = self.engine.call("follow", np.ascontiguousarray(times, float), len(times), out)
        t, outcome, _ = self.work.now.tolist()
        return count, t, int(outcome)

    def near(self, choice: Choice, times: np.ndarray, given: np.ndarray, out: np.ndarray) -> None:
        """Rows of :class:`Instants` at ``times`` [s] near ``given`` q and u, (n_times, coordinates + speeds), or q, u,
        u' and ``engine.additions``.

        Raises
        ------
        ArithmeticError
            As :meth:`project` does; it has the time for a second argument.
        """
        self.engine.choose_speeds(choice)
        times, given = np.ascontiguousarray(times, float), np.ascontiguousarray(given)
        asked = times, len(times), given, given.shape[1], out
        try:
            count = self.engine.call("near", *asked)
        finally:
            if given.shape[1] > len(self.layout.positions) + self.engine.size:
                self.engine.additions[:] = 0.0
        if count < len(times):
            t, outcome, _ = self.work.now.tolist()
            check(int(outcome), t)

    def passed_on(self, multipliers: np.ndarray) -> dict[str, np.ndarray]:
        """Force and moment of every joint (6,) by multipliers of the rows alone, at the position of ``work``."""
        self.work.multipliers[:] = 0.0
        self.work.multipliers[: len(multipliers)] = multipliers
        self.engine.call("pass_on")
        return dict(zip(self.mechanism.joints, self.work.exerted.copy(), strict=True))

    @cached_property
    def record(self) -> Columns:
        """Columns of the record by the coordinates of the bodies in the order of the tree, forces and moments of the
        joints, and forces of the drives."""
        kept = self.engine.numbered
        return self.engine.recorded(self.layout.node_of, [kept.exerted.ravel(), kept.along[0, self.engine.prescribed]])

    def __getstate__(self) -> dict[str, Any]:
        """Everything except addresses, which belong to one process."""
        return {name: value for name, value in vars(self).items() if name != "engine"}

    @cached_property
    def engine(self) -> Engine:
        more = {"shared": self._kind, "integrates": self.integrates}
        return engine_of(self.built, self.module, self.parameters, **more)

    @property
    def _kind(self) -> Kind:
        """Kind of the mechanism, also of the one whose joints with friction do not close loops."""
        if self.mechanism.frictions:
            return Kind.HOLD_SPACE
        if self.mechanism.contacts:
            return Kind.CONTACT_SPACE
        if self.built.switches:
            return Kind.SWITCHED_SPACE
        return Kind.SPACE if self.coupled or (self.integrates and self.has_slopes) else Kind.RIGID_SPACE

    @property
    def work(self) -> Work:
        """Working arrays of this system."""
        return self.engine.work

    @cached_property
    def integrates(self) -> bool:
        """True if a run integrates its motion: with free joints or bodies, or under preset coupled."""
        free = any(drive.kind == "free" for drive in self.scene.drives.values())
        return self.coupled or free or bool(self.mechanism.floating)

    @property
    def has_slopes(self) -> bool:
        """True if springs, or loads by the motion of joints, add to a step's matrix."""
        return bool(self.mechanism.springs or (self.mechanism.loads and self.told_joints))

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints whose courses are prescribed, in the order of the module's."""
        return self.layout.driven

    @cached_property
    def known_joints(self) -> tuple[str, ...]:
        """Joints whose coordinates and speeds may occur in laws."""
        return (*self.scene.drives, *self.scene.observed)

    def node(self, joint: str) -> int:
        """Number of the node with a joint's first coordinate; of a cylindrical joint, its rotation."""
        return leading(self.tables.nodes, self.layout.tree[joint])

    def columns(self, names: Sequence[str], what: int) -> np.ndarray:
        """Places of the first coordinates (COORDINATE) or speeds (SPEED) of joints."""
        return np.array([self.tables.nodes[self.node(name), what] for name in names], int)

    def speeds_of(self, owner: str) -> list[int]:
        """Numbers of the speeds of a joint of the tree, or of a body that moves freely."""
        return [k for k, name in enumerate(self.layout.speeds) if name.rpartition(".")[0] == owner]

    def courses(self, t: float) -> np.ndarray:
        """Coordinate, speed and acceleration of every prescribed drive, (drives, 3)."""
        return self.engine.courses(np.array([t])).reshape(-1, 3)

    def magnitudes_at(self, times: np.ndarray, coordinates: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Sizes of all loads at many instants, (n_times, loads)."""
        states = np.zeros((len(times), len(self.known_joints), 3))
        where = [self.known_joints.index(name) for name in self.told_joints]
        states[:, where, 0], states[:, where, 1] = coordinates, speeds
        return self.engine.magnitudes(times, states)

    @cached_property
    def told_joints(self) -> tuple[str, ...]:
        """Known joints with one coordinate."""
        return tuple(name for name in self.known_joints if self.mechanism.joints[name].freedoms == 1)

    @cached_property
    def at_zero(self) -> np.ndarray:
        """Coordinates with all joints at zero and free bodies at their given positions."""
        q = np.zeros(len(self.layout.positions))
        nodes = self.tables.nodes
        q[nodes[nodes[:, KIND] == BALL, COORDINATE]] = 1.0
        for name, drive in self.scene.drives.items():
            if drive.kind == "free" and self.mechanism.joints[name].freedoms == 1 and name in self.layout.tree:
                q[self.columns([name], COORDINATE)[0]] = drive.start
        for body in self.mechanism.floating:
            first = self.speeds_of(body)[0]
            place = nodes[:, COORDINATE][nodes[:, SPEED] == first][0]
            q[place : place + 3] = self.scene.vector(self.scene.floating[body].at)
        return q

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian J of the rows by the speeds, both in their measures, at a position."""
        self.place(q)
        return self.engine.jacobian


def build_spatial_system(
    scene: Scene, module: ModuleType, flexible: Flexible = RIGID, coupled: bool = False, rubs: bool = True
) -> SpatialSystem:
    """Bind a scene to its module; ``flexible``: shapes of the deforming bodies; ``rubs``: with friction."""
    mechanism = spatial_mechanism_of(scene)
    in_laws, switches = (*scene.drives, *scene.observed), len(getattr(module, "SWITCHES", ()))
    driven = [name for name, drive in scene.drives.items() if drive.kind != "free"]
    built = build_tables(mechanism, SpatialBlocks(mechanism, flexible), in_laws, driven, switches, rubs)
    return SpatialSystem(scene, module, bind_parameters(scene, module), mechanism, built, coupled)
