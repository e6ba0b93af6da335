"""Equations of a mechanism in space with its numbers: positions, independent speeds, accelerations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from kaneflex.mechanism.spatial import SpatialMechanism, spatial_mechanism_of
from kaneflex.multibody.compile.addresses import by_address, compiling, kernel_address, kernel_of_c
from kaneflex.multibody.compile.spatial_library import library
from kaneflex.multibody.dynamics import spatial_entries
from kaneflex.multibody.dynamics.spatial_entries import LACKED, NEAR
from kaneflex.multibody.dynamics.spatial_instant import DONE, check
from kaneflex.multibody.dynamics.spatial_work import Instants, Laws, Work, work_of
from kaneflex.multibody.model.determinacy import virtual_inertia
from kaneflex.multibody.model.layout import STRUCTURE_KERNELS, Handle
from kaneflex.multibody.model.module_loading import bind_parameters
from kaneflex.multibody.model.spatial_layout import (
    AXIS,
    BALL,
    COORDINATE,
    COORDINATES,
    COUNT,
    KIND,
    RIGID,
    ROWS,
    SHAPES,
    SHIFT,
    SLIDE,
    SPEED,
    SPEEDS,
    TURN,
    WHAT,
    Flexible,
    Layout,
    Tables,
)  # fmt: skip
from kaneflex.multibody.model.spatial_topology import build_tables
from kaneflex.multibody.time.spatial_revolutions import ball_about
from kaneflex.multibody.time.spatial_steps import Choice, Steps, blocks_of
from kaneflex.scene import Scene

_LIGHT = 1e-9
"""Ratio of principal moments of inertia below which the smaller one counts as none."""


@dataclass(frozen=True, eq=False)
class State:
    """State of a mechanism at an instant: coordinates, speeds, their rates, sizes of loads, the choice of speeds."""

    t: float
    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    sizes: np.ndarray
    choice: Choice


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
    tables : Tables
    layout : Layout
    coupled : bool
        True if it deforms, or belongs to a deforming one and shares its compiled functions.
    """

    scene: Scene
    module: ModuleType
    parameters: np.ndarray
    mechanism: SpatialMechanism
    tables: Tables
    layout: Layout
    coupled: bool

    def compile(self) -> None:
        """Compile all functions, timed separately."""
        with compiling():
            self.place(self.at_zero)

    def place(self, q: np.ndarray) -> None:
        """Positions, axes and directions in ``work``."""
        self.work.q[:] = q
        self._call(spatial_entries.place)

    def close(self, q: np.ndarray, choice: Choice) -> bool:
        """Close the loops by the dependent coordinates, in place; True if they close."""
        self.work.q[:] = q
        closes = self._call(spatial_entries.close, choice)
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
        self.work.q[:], self.work.u[:] = q, u
        check(self._call(spatial_entries.project, choice, t))
        return self.state(t, choice)

    def state(self, t: float, choice: Choice) -> State:
        """State of ``work`` after :meth:`project` at t [s]."""
        k = self.work
        return State(t, k.q.copy(), k.u.copy(), k.du.copy(), k.sizes.copy(), choice)

    def follow(self, begin: float, choice: Choice, times: np.ndarray, out: np.ndarray) -> tuple[int, float, int]:
        """Rows of :class:`Instants` at ascending ``times`` [s] from the position of ``work`` at ``begin`` [s], by
        :func:`kaneflex.multibody.dynamics.spatial_entries.follow`; returns their number, the time of ``work`` then, and
        its outcome."""
        self._laws.now[:] = begin, DONE
        count = self._call(spatial_entries.follow, choice, np.ascontiguousarray(times, float), len(times), out)
        t, outcome = self._laws.now.tolist()
        return count, t, int(outcome)

    def near(self, choice: Choice, times: np.ndarray, given: np.ndarray, out: np.ndarray, what: int = NEAR) -> None:
        """Rows of :class:`Instants` at ``times`` [s] near ``given`` q and u, (n_times, coordinates + speeds), or q, u,
        u' and :attr:`inputs`; with MOVED and LACKED see these in :mod:`kaneflex.multibody.dynamics.spatial_entries`.

        Raises
        ------
        ArithmeticError
            As :meth:`project` does; it has the time for a second argument.
        """
        times, given = np.ascontiguousarray(times, float), np.ascontiguousarray(given)
        asked = times, len(times), given, given.shape[1], out
        try:
            if what == LACKED:
                count = self._call(spatial_entries.lacked, choice, *asked)
            else:
                count = self._call(spatial_entries.near, choice, *asked, what == NEAR)
        finally:
            if given.shape[1] > self.coordinates + self.speeds:
                self.inputs[:] = 0.0
        if count < len(times):
            t, outcome = self._laws.now.tolist()
            check(int(outcome), t)

    def collocate(self, choice: Choice, steps: Steps, times: np.ndarray, out: np.ndarray) -> int:
        """See :func:`kaneflex.multibody.time.spatial_collocation.collocate`."""
        return self._call(spatial_entries.collocate, choice, steps.handle, times, len(times), out, *out.shape)

    def row(self, state: State) -> np.ndarray:
        """Row of an instant, ``work`` being as left by :meth:`project`, (n,)."""
        self._call(spatial_entries.exert, state.choice)
        return self.work.kept.copy()

    def instants(self, rows: np.ndarray) -> Instants:
        """Rows by names."""
        return Instants.of(rows, self.work)

    def gaps(self) -> np.ndarray:
        """Absolute violation of every row at the position of ``work``, in rad or sizes of the mechanism."""
        return abs(self.work.rows[:, 0]) / self.row_measure

    def passed_on(self, multipliers: np.ndarray) -> Instants:
        """Joint forces of multipliers of the rows alone, at the position of ``work``."""
        self.work.F[:] = 0.0  # no inertia forces
        self.work.multipliers[:] = multipliers
        self._call(spatial_entries.pass_on)
        return self.instants(self.work.kept[None])

    def mass(self) -> np.ndarray:
        """Mass matrix of all speeds at the position of ``work``, (speeds, speeds)."""
        self._call(spatial_entries.mass, np.zeros(self.speeds))
        return self.work.M

    def rates(self, choice: Choice) -> tuple[np.ndarray, np.ndarray]:
        """Rates q', and powers [W] dissipated by dampers and supplied by loads and prescribed drives, ``work`` being
        as left by :meth:`project`."""
        rates, powers = np.zeros(self.coordinates), np.zeros(2)
        self._call(spatial_entries.rates, choice, rates, powers)
        return rates, powers

    def advanced(self, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Coordinates (n, coordinates) of q moved by steps (n, speeds) of the speeds; a ball turns in its axes."""
        out = np.tile(q, (len(steps), 1))
        self._call(spatial_entries.advance, np.ascontiguousarray(steps), len(steps), out)
        return out

    @property
    def inputs(self) -> np.ndarray:
        """Additions to the sizes of the loads and then to the accelerations of the prescribed drives."""
        return self._laws.added

    def basis(self, choice: Choice) -> np.ndarray:
        """Speeds for a unit of each independent one, (independent, speeds), where the loops are closed."""
        self._call(spatial_entries.basis, choice)
        return choice.basis

    def _call(self, function: Any, *values: Any) -> Any:
        """Call a library entry with this system's handle; arrays, choices and handles are passed by address."""
        given = [by_address(value.handle if isinstance(value, Choice) else value) for value in values]
        return library(self.coupled)[function](self._handle.address, *given)

    @cached_property
    def _handle(self) -> Handle:
        """All arrays for compiled code, see :data:`kaneflex.multibody.dynamics.spatial_work.SPACE`."""
        m, k, laws = self.tables, self.work, self._laws
        counts = [
            len(m.nodes), self.speeds, self.coordinates, len(m.on), len(m.axis_on), len(m.cuts), self.row_count,
            len(m.forces), len(m.torques), len(m.springs), len(m.twists), len(m.bushings), len(self.mechanism.loads),
            len(m.bodies), len(k.kept), len(self.driven), len(laws.observed), len(k.phi), len(k.E), len(k.L),
        ]  # fmt: skip
        return Handle(np.array(counts), *m, *k, *laws, *blocks_of(self.layout))

    def __getstate__(self) -> dict[str, Any]:
        """Everything except addresses, which belong to one process."""
        return {name: value for name, value in vars(self).items() if name not in ("_handle", "_laws", "_kernels")}

    @cached_property
    def _laws(self) -> Laws:
        """Kernels of the module with their arguments; addresses are valid in this process only."""
        reads = 3 * len(self.known_joints)  # coordinates and speeds, then accelerations
        loads = len(self.mechanism.loads)
        kernels = [kernel_address(getattr(self.module, name), of) for name, of in STRUCTURE_KERNELS.items()]
        where = [[2 * self.known_joints.index(name), self.node(name)] for name in self.told_joints]
        return Laws(
            np.array(kernels), np.ascontiguousarray(self.parameters, float), self.driven_coordinates,
            np.array(where, int).reshape(-1, 2), np.zeros(reads), np.zeros(3 * len(self.driven)), np.zeros(2),
            np.zeros(loads + len(self.driven)),
        )  # fmt: skip

    def choice_of(self, rows: np.ndarray, dependent: np.ndarray, independent: np.ndarray) -> Choice:
        """Choice of the given rows and speeds at the position of ``work``."""
        rows, dependent, independent = (np.ascontiguousarray(part, np.int64) for part in (rows, dependent, independent))
        lent = np.zeros(self.speeds)
        if len(dependent) and self._has_light_bodies:
            free = np.isin(np.arange(self.speeds), self.open_speeds)
            lent = virtual_inertia(dependent, self.mass(), self.measure, self.tables.bodies, free)
        measures = self.measure, self.row_measure
        return Choice(rows, dependent, self.driven_speeds, independent, lent, *measures, self.tables, self.work)

    @cached_property
    def _has_light_bodies(self) -> bool:
        """True if some body has no mass, or no inertia about some axis."""
        bodies = self.mechanism.bodies.values()
        return any(body.mass <= 0.0 or min(body.inertia[:3]) <= _LIGHT * max(body.inertia[:3]) for body in bodies)

    @property
    def speeds(self) -> int:
        return len(self.layout.speeds)

    @cached_property
    def coordinates(self) -> int:
        """Coordinates of the tree, four a ball."""
        return int(sum(COORDINATES[kind] for kind in self.tables.nodes[:, KIND])) + len(self.modal_speeds)

    @cached_property
    def modal_speeds(self) -> np.ndarray:
        """Numbers of the shapes' speeds."""
        return self._shapes(SPEED)

    @cached_property
    def modal_coordinates(self) -> np.ndarray:
        """Places of the shapes' coordinates."""
        return self._shapes(COORDINATE)

    def _shapes(self, what: int) -> np.ndarray:
        of = self.tables.nodes[self.tables.nodes[:, KIND] == SHAPES]
        return np.concatenate([np.zeros(0, int), *(row[what] + np.arange(row[COUNT]) for row in of)])

    @cached_property
    def row_count(self) -> int:
        return int(sum(ROWS[what] for what in self.tables.cuts[:, WHAT]))

    @cached_property
    def work(self) -> Work:
        """Working arrays of this system."""
        return work_of(self.tables, self.coordinates, self.speeds, self.row_count, len(self.mechanism.loads))

    @cached_property
    def driven(self) -> tuple[str, ...]:
        """Joints whose courses are prescribed, in the order of the module's."""
        return tuple(name for name, drive in self.scene.drives.items() if drive.kind != "free")

    @cached_property
    def known_joints(self) -> tuple[str, ...]:
        """Joints whose coordinates and speeds may occur in laws."""
        return (*self.scene.drives, *self.scene.observed)

    def node(self, joint: str) -> int:
        """Number of the node that has a joint's first coordinate; of a cylindrical one's, its turn."""
        nodes, sign = self.layout.tree[joint]
        if self.mechanism.joints[joint].kind != "cylindrical":
            return nodes[0 if sign > 0 else -1]
        return next(node for node in nodes if self.tables.nodes[node, KIND] != SLIDE)

    def pin(self, joint: str) -> np.ndarray:
        """Axis of the pin for which a joint's ball stands, in its node's axes, (3,)."""
        return self.tables.numbers[self.node(joint), AXIS:SHIFT]

    def columns(self, names: Sequence[str], what: int) -> np.ndarray:
        """Places of the first coordinates (COORDINATE) or speeds (SPEED) of joints."""
        return np.array([self.tables.nodes[self.node(name), what] for name in names], int)

    def speeds_of(self, owner: str) -> list[int]:
        """Numbers of the speeds of a joint of the tree, or of a body that moves freely."""
        return [k for k, name in enumerate(self.layout.speeds) if name.rpartition(".")[0] == owner]

    @cached_property
    def measure(self) -> np.ndarray:
        """Unit of each speed: 1 rad, also for shapes of twist, or the mechanism's size."""
        found = np.ones(self.speeds)
        for kind, speed in self.tables.nodes[:, [KIND, SPEED]].tolist():
            if SPEEDS[kind] == 1 and kind != TURN:
                found[speed] = self.mechanism.size
        twisting = [shapes.twisting for shapes in self.layout.shapes.values()]
        found[self.modal_speeds] = np.where(np.concatenate([np.zeros(0, bool), *twisting]), 1.0, self.mechanism.size)
        return found

    @cached_property
    def row_measure(self) -> np.ndarray:
        found: list[float] = []
        for what in self.tables.cuts[:, WHAT].tolist():
            found += [1.0 if what == 1 else self.mechanism.size] * ROWS[what]
        return np.array(found)

    def courses(self, t: float) -> np.ndarray:
        """Coordinate, speed and acceleration of every prescribed drive, (drives, 3)."""
        out = np.zeros(3 * len(self.driven))
        self._kernels["courses"](t, self._laws.p.ctypes.data, out.ctypes.data, 0)
        return out.reshape(-1, 3)

    def magnitudes_at(self, times: np.ndarray, coordinates: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Sizes of all loads at many instants, (n_times, loads)."""
        x, out = (np.zeros((len(times), n)) for n in (len(self._laws.x), len(self.mechanism.loads)))
        where = self._laws.observed[:, 0]
        x[:, where], x[:, where + 1] = coordinates, speeds
        kernel, p = self._kernels["magnitudes"], self._laws.p.ctypes.data
        told, sizes = x.ctypes.data, out.ctypes.data
        for k, t in enumerate(times.tolist()):
            kernel(t, told + k * x.strides[0], 0, p, sizes + k * out.strides[0], 0)
        return out

    @cached_property
    def _kernels(self) -> dict[str, Callable[..., None]]:
        """The module's as Python calls them."""
        return {name: kernel_of_c(getattr(self.module, name), of) for name, of in STRUCTURE_KERNELS.items()}

    @cached_property
    def told_joints(self) -> tuple[str, ...]:
        """Known joints with one coordinate."""
        return tuple(name for name in self.known_joints if self.mechanism.joints[name].freedoms == 1)

    @cached_property
    def driven_coordinates(self) -> np.ndarray:
        return self.columns(self.driven, COORDINATE)

    @cached_property
    def driven_speeds(self) -> np.ndarray:
        return self.columns(self.driven, SPEED)

    @cached_property
    def open_speeds(self) -> np.ndarray:
        """Speeds that no drive prescribes."""
        return np.setdiff1d(np.arange(self.speeds), self.driven_speeds)

    @cached_property
    def at_zero(self) -> np.ndarray:
        """Coordinates with all joints at zero and free bodies at their given positions."""
        q = np.zeros(self.coordinates)
        nodes = self.tables.nodes
        q[nodes[nodes[:, KIND] == BALL, COORDINATE]] = 1.0
        for name, drive in self.scene.drives.items():
            if drive.kind == "free" and self.mechanism.joints[name].freedoms == 1:
                k = int(self.columns([name], COORDINATE)[0])
                stands = ball_about(self.pin(name), drive.start) if name in self.layout.kept else [drive.start]
                q[k : k + len(stands)] = stands
        for body in self.mechanism.floating:
            first = self.speeds_of(body)[0]
            place = nodes[:, COORDINATE][nodes[:, SPEED] == first][0]
            q[place : place + 3] = self.scene.vector(self.scene.floating[body].at)
        return q

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian J of the rows by the speeds, both in their measures, at a position."""
        self.place(q)
        return self.work.J * self.measure / self.row_measure[:, None]


def build_spatial_system(
    scene: Scene, module: ModuleType, flexible: Flexible = RIGID, coupled: bool = False, balls: Collection[str] = ()
) -> SpatialSystem:
    """Bind a scene to its module; ``flexible``: shapes of the deforming bodies; ``balls``: joints of the tree that are
    modelled as balls in any case."""
    mechanism = spatial_mechanism_of(scene)
    tables, layout = build_tables(mechanism, flexible, balls)
    return SpatialSystem(scene, module, bind_parameters(scene, module), mechanism, tables, layout, coupled)
