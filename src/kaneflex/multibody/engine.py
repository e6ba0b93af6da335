"""Compiled engine of a mechanism: its tables and kernels with a numpy interface."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.multibody.compile.addresses import by_address, kernel_address
from kaneflex.multibody.compile.library import library
from kaneflex.multibody.dynamics import independent_speeds, reduction, unfolding
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.layout import Handle
from kaneflex.multibody.model.spatial_layout import JOINT_NODE, OWNER
from kaneflex.multibody.model.state import NONE, Choice, State
from kaneflex.multibody.model.topology import Layout, build_tables
from kaneflex.multibody.time import collocation
from kaneflex.multibody.unilateral.rows import RESULTS

_HUGE = 1e9
"""Mass of a fixed coordinate, in masses of the mechanism."""


@dataclass(frozen=True, eq=False)
class Engine:
    """Tables of one mechanism with the kernels of its structure.

    Attributes
    ----------
    kernels : tuple
        Kernels of the structure's module, in the order of :data:`kaneflex.multibody.model.layout.STRUCTURE_KERNELS`.
    p : ndarray
        Values of the module's PARAMETERS with its tables.
    real, pair : ndarray
        Workspace of factors.
    shared : Handed, optional
        Kind of mechanism whose library it uses, if not its own.
    chosen : list
        Current choice of independent speeds.
    parts : mapping
        Further arrays by their names in the kind of mechanism.
    views : mapping
        Places in the numbers w, and lengths, of those that compiled functions fill.
    """

    tables: at.Tables
    layout: Layout
    kernels: tuple
    p: np.ndarray
    real: np.ndarray
    pair: np.ndarray
    shared: at.Handed | None = None
    chosen: list[Choice] = field(default_factory=lambda: [NONE])
    parts: Mapping[str, np.ndarray] = field(default_factory=dict)
    views: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        """Everything except addresses and views, which belong to one process."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def count(self, of: int) -> int:
        """Number of the plan."""
        return int(self.tables.plan[of])

    def numbers(self, where: int, count: int) -> np.ndarray:
        """View of numbers of the tables."""
        first = self.count(where)
        return self.tables.w[first : first + count]

    @cached_property
    def size(self) -> int:
        """Number of coordinates of the tree."""
        return self.count(at.COORDINATES)

    @cached_property
    def motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Views of coordinates, rates, accelerations and reactions of cut joints."""
        y, v, a = (self.numbers(part, self.size) for part in (at.Y, at.RATE, at.ACCEL))
        return y, v, a, self.numbers(at.NOW, self.count(at.REACTIONS))

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Columns of a row of the integration: coordinates q, speeds u, accelerations du, modes of contacts and holds,
        quaternions of balls, works."""
        n, reactions, modes, balls = self.size, self.count(at.REACTIONS), self.modes.size, 4 * len(self.balls)
        ends = np.cumsum([1, n, n, n, reactions, modes, balls, self.count(at.WORKS)]).tolist()
        names = "q", "u", "du", "reactions", "modes", "quaternions", "works"
        return {name: slice(*pair) for name, pair in zip(names, pairwise(ends), strict=True)}

    def row(self, t: float) -> np.ndarray:
        """Current motion at t [s] as a row of the integration, with zero works."""
        return np.concatenate([[t], *self.motion, self.modes.ravel(), self.quaternions, np.zeros(self.count(at.WORKS))])

    @property
    def quaternions(self) -> np.ndarray:
        """Current quaternions of balls, one after the other."""
        return np.zeros(0)

    def stand(self, row: np.ndarray) -> None:
        """Set the motion to that of a row."""
        first = 1
        for part in self.motion:
            part[:] = row[first : first + len(part)]
            first += len(part)
        self.modes[:] = row[self.columns["modes"]].reshape(-1, at.MODE_SIZE)

    @property
    def modes(self) -> np.ndarray:
        """View of MODE and MEMORY of frictions and contacts, (rows, MODE_SIZE)."""
        return self.rows[:, at.MODE : at.MODE + at.MODE_SIZE]

    def take_impacts(self) -> np.ndarray:
        """Finished impacts not yet taken, (impacts, IMPACT_SIZE)."""
        room = self.numbers(at.IMPACTS, 1 + at.IMPACT_SIZE * (at.MOST_IMPACTS + len(self.contacts)))
        taken, room[0] = room[1 : 1 + at.IMPACT_SIZE * int(room[0])].reshape(-1, at.IMPACT_SIZE).copy(), 0.0
        return taken

    def courses(self, times: np.ndarray) -> np.ndarray:
        """Coordinate, speed and acceleration of all prescribed drives at ``times`` [s], (n_times, 3 drives)."""
        out = np.zeros((len(times), 3 * len(self.prescribed)))
        self.call(unfolding.courses_at, np.ascontiguousarray(times, float), *out.shape[:1], out, out.shape[1])
        return out

    def magnitudes(self, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Magnitudes of all loads, (n_times, loads), at ``times`` [s] and rows x of the laws' joint coordinates and
        speeds, then accelerations."""
        loads, sides = self.count(at.SPRINGS) - self.count(at.LOADS), self._switches
        times, x = np.ascontiguousarray(times, float), np.hstack([x, np.zeros((len(x), sides))])
        out = np.zeros((len(times), loads + 2 * sides))
        for _ in range(sides + 1):  # switches may depend on others
            self.call(unfolding.magnitudes_at, times, len(times), x, x.shape[1], out, out.shape[1])
            x[:, x.shape[1] - sides :] = np.sign(out[:, loads::2])
        return out[:, :loads]

    @cached_property
    def _switches(self) -> int:
        """Number of switching arguments of the loads' laws."""
        return int(np.count_nonzero(self.tables.acts[self.count(at.CONTACTS) :, at.WHAT] == at.SWITCH))

    def part(self) -> None:
        """Open all contacts and free all frictions; switches are above zero."""
        self.modes[:], self.contacts[:, at.MEMORY] = (at.OPEN, 0.0), at.ABOVE

    def set(self, state: State) -> None:
        """Set coordinates and speeds to those of a state; contacts are open, and frictions free."""
        self.part()
        self.motion[0][:], self.motion[1][:] = state.q, state.u

    def states_of(self, rows: np.ndarray, choice: Choice) -> Iterator[State]:
        """States of rows of the integration; sizes of loads are the current ones."""
        (q, u, du), sizes = (rows[:, self.columns[name]].copy() for name in ("q", "u", "du")), self.sizes.copy()
        return (State(*each, sizes, choice) for each in zip(rows[:, 0].tolist(), q, u, du, strict=True))

    def openings(self, t: float) -> np.ndarray:
        """Opening of every row of the cut joints [m or rad] at the current coordinates."""
        out = np.zeros(self.count(at.REACTIONS))
        self.call(independent_speeds.openings, t, out)
        return out

    def choose(self, t: float, spared: Sequence[int] = ()) -> np.ndarray:
        """Choose the dependent coordinates at the current position; redundant rows are dropped and returned.

        Joint coordinates in ``spared`` stay independent if possible.
        """
        self.openings(t)
        level = self.levels.copy()
        level[list(spared)] = np.maximum(level[list(spared)], independent_speeds.NAMED)
        choice, dropped = self.chosen_by(level)
        self.choose_speeds(choice)
        return dropped

    def chosen_by(self, level: np.ndarray) -> tuple[Choice, np.ndarray]:
        """Choice by the :attr:`levels` of coordinates, and redundant rows, see
        :func:`kaneflex.multibody.dynamics.independent_speeds.choose`."""
        taken = np.zeros(self.count(at.REACTIONS), np.int64)
        self.call(independent_speeds.choose, level, taken)
        rows, free = np.flatnonzero(taken >= 0), np.flatnonzero(level < independent_speeds.PRESCRIBED)
        choice = Choice(rows, taken[rows], np.setdiff1d(free, taken[rows]), np.zeros(self.size))
        return choice, np.flatnonzero(taken == -1)

    @cached_property
    def open_speeds(self) -> np.ndarray:
        """Speeds that no drive prescribes."""
        return np.flatnonzero(self.levels < independent_speeds.PRESCRIBED)

    @property
    def prescribed(self) -> np.ndarray:
        """Speed of the joint of every prescribed drive; -1 of one that closes a loop."""
        first = self.count(at.PRESCRIBED)
        return self.tables.plan[first : first + self.inputs - len(self.sizes)]

    @cached_property
    def levels(self) -> np.ndarray:
        """Level of every coordinate in a choice."""
        freed = self.tables.plan[self.count(at.FREED) :][: self.size] == 1
        found = np.where(freed, independent_speeds.FIRST, independent_speeds.PRESCRIBED)
        for first, count in self.tables.bodies[:, [at.MODAL, at.SHAPES]]:
            found[first : first + count] = independent_speeds.OF_SHAPE
        return found

    def choose_speeds(self, choice: Choice) -> None:
        """Set the choice that compiled functions use."""
        if self.chosen[0] is choice:
            return
        plan, kept = self.tables.plan, len(choice.rows)
        for of, numbers in ((at.ROW_OF, choice.rows), (at.DEPENDENT, choice.dependent)):
            plan[plan[of] : plan[of] + kept] = numbers
        plan[at.KEPT], plan[at.BENDS] = kept, self.shapes[choice.dependent].any()
        led, nodes = bisect_right(self._last_columns, min(choice.dependent, default=self.size)), self.parts["nodes"]
        plan[at.LED] = self.parts["frames"][led, JOINT_NODE] if led < len(self._last_columns) else len(nodes)
        self.chosen[0] = choice

    @property
    def sides(self) -> np.ndarray:
        """Force and moment of each row's unit reaction on the cut joint's first side, (rows, 3)."""
        rows = self.numbers(at.CUT, at.ROW_SIZE * self.count(at.REACTIONS)).reshape(-1, at.ROW_SIZE)
        return rows[:, 3:6]

    def cut_of(self, row: int) -> str:
        """Joint of a cut's row; of a resting contact the last one."""
        cut = int(self.tables.plan[self.count(at.CUT_OF) + row])
        return self.layout.cuts[min(cut, len(self.layout.cuts) - 1)]

    @cached_property
    def _last_columns(self) -> list[int]:
        """End of every body's own coordinates."""
        return self.tables.bodies[:, [at.FIRST, at.DOF, at.SHAPES]].sum(axis=1).tolist()

    @cached_property
    def turns(self) -> np.ndarray:
        """Mask of coordinates that are angles [rad]."""
        return np.array([unit == "rad" for _, unit in self.layout.coordinates], bool)

    @cached_property
    def free_drives(self) -> list[int]:
        """Coordinates of free drives in the tree."""
        drives = self.tables.acts[self.count(at.DRIVES) : self.count(at.LOADS), at.COURSE_AT]
        return list(drives[drives >= 0].tolist())

    @property
    def choice(self) -> Choice:
        """Current choice of independent speeds."""
        return self.chosen[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the independent coordinates."""
        return tuple(self.layout.coordinates[k][0] for k in self.choice.independent)

    @property
    def measure(self) -> np.ndarray:
        """Units of the coordinates: the mechanism's size [m], or 1 rad."""
        return self.numbers(at.MEASURE, self.size)

    @property
    def balls(self) -> np.ndarray:
        """Place of every ball's quaternion among the coordinates q, and its first speed, (balls, 2)."""
        return np.zeros((0, 2), int)

    @cached_property
    def own(self) -> np.ndarray:
        """Place in q and speed of every other coordinate, (n, 2)."""
        return np.column_stack(2 * [np.arange(self.size)])

    @property
    def coordinates(self) -> np.ndarray:
        """Current coordinates q."""
        return self.motion[0].copy()

    @property
    def sizes(self) -> np.ndarray:
        """Current sizes of loads."""
        return self.numbers(at.SIZE, self.count(at.SPRINGS) - self.count(at.LOADS))

    def state(self, t: float, choice: Choice) -> State:
        """Current state, at t [s]."""
        return State(t, self.coordinates, self.motion[1].copy(), self.motion[2].copy(), self.sizes.copy(), choice)

    def advanced(self, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Coordinates (k, coordinates) of q moved by steps (k, speeds) of the speeds; a ball turns in its axes."""
        return q + steps

    def basis(self, choice: Choice) -> np.ndarray:
        """Speeds for a unit of each independent one, (independent, speeds), where the loops are closed."""
        found = np.zeros((len(choice.independent), self.size))
        self.call(reduction.basis, choice.independent, len(choice.independent), found)
        return found

    @cached_property
    def shapes(self) -> np.ndarray:
        """Mask of coordinates that are shape amplitudes."""
        return self.levels == independent_speeds.OF_SHAPE

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness of the shapes by all speeds, (speeds, speeds)."""
        return np.diag(np.where(self.shapes, self.numbers(at.STIFFNESS, self.size), 0.0))

    @property
    def axes(self) -> np.ndarray:
        """Axes of torsional springs by their numbers: in the plane a single one."""
        return np.ones((1, 1))

    @cached_property
    def modal(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of shape amplitudes among the coordinates q, and their speeds."""
        coordinates, speeds = self.own[self.shapes[self.own[:, 1]]].T
        return coordinates, speeds

    @property
    def inputs(self) -> int:
        """Number of loads and prescribed accelerations."""
        return self.count(at.WORKS) - 1 - len(self.holds) - len(self.contacts)

    @property
    def additions(self) -> np.ndarray:
        """View of the additions to the sizes of the loads and then to the accelerations of the prescribed drives."""
        return self.numbers(at.INPUT, self.inputs)

    @cached_property
    def contacts(self) -> np.ndarray:
        """View of the numbers of contacts, then of switching arguments, (contacts, CONTACT_SIZE)."""
        return self.rows[len(self.rows) - self.count(at.ACTS) + self.count(at.CONTACTS) :]

    @cached_property
    def holds(self) -> np.ndarray:
        """View of the numbers of frictions, (frictions, CONTACT_SIZE)."""
        return self.rows[: self.count(at.DRIVES) - self.count(at.HOLDS)]

    @cached_property
    def rows(self) -> np.ndarray:
        """View of the numbers of frictions, then of contacts, (rows, CONTACT_SIZE)."""
        held, touching = self.count(at.DRIVES) - self.count(at.HOLDS), self.count(at.ACTS) - self.count(at.CONTACTS)
        first = self.count(at.CONTACT) - at.CONTACT_SIZE * held
        return self.tables.w[first : first + at.CONTACT_SIZE * (held + touching)].reshape(-1, at.CONTACT_SIZE)

    @property
    def owners(self) -> np.ndarray:
        """Body of every section, -1 on the ground."""
        on = self.parts["on"]
        return np.where(on >= 0, self.parts["nodes"][on, OWNER], -1)

    @property
    def sections(self) -> np.ndarray:
        """View of the sections, (sections, 9)."""
        return self.numbers(at.SECTION, at.SEC * len(self.parts["on"])).reshape(-1, at.SEC)

    def demand(self, choice: Choice, times: np.ndarray, given: np.ndarray) -> np.ndarray:
        """Residuals of the independent speeds at ``times`` [s], then all speeds, (k, independent + speeds), see
        :func:`kaneflex.multibody.dynamics.reduction.reduced_demand`. Raises ArithmeticError if loops don't close."""
        self.choose_speeds(choice)
        times, given = np.ascontiguousarray(times, float), np.ascontiguousarray(given)
        out = np.zeros((len(times), len(choice.independent) + self.size))
        asked = times, len(times), given, given.shape[1], out
        done = self.call(reduction.reduced_demand, choice.independent, len(choice.independent), *asked)
        if done < len(times):
            raise ArithmeticError(f"the loops don't close at t = {times[done]:.6g} s")
        return out

    def project(self, t: float) -> bool:
        """Project onto the constraints for the current independent coordinates, and compute accelerations and
        reactions."""
        return bool(self.call(collocation.project, t))

    def follow(self, rows: np.ndarray, first: int, given: np.ndarray, side: np.ndarray) -> int:
        """Close the loops of rows in place, see :func:`kaneflex.multibody.dynamics.unfolding.follow_rows`."""
        return int(self.call(unfolding.follow_rows, rows, first, len(rows), given, given.shape[1], side))

    def states(self, rows: np.ndarray, held: Sequence[int] = ()) -> np.ndarray | None:
        """Rows of the integration with closed loops, accelerations and reactions, from those of nearby states; None if
        one is singular.

        Contacts with overlapping sides are closed. The ``held`` coordinates are not accelerated, as far as the joints
        allow: they have a mass much larger than all others.
        """
        n, mass = self.size, sum(self.tables.w[block] for block in self.tables.bodies[:, at.BLOCK])
        stiffness, damping = (self.numbers(part, n) for part in (at.STIFFNESS, at.DAMPING))
        kept, rows, done = (stiffness.copy(), damping.copy()), rows.copy(), 0
        if len(held):
            stiffness[:] = damping[:] = 0.0
            stiffness[list(held)] = _HUGE * mass
        while done < len(rows):
            self.stand(rows[done])  # resting contacts are kept closed
            self.choose(float(rows[done, 0]))
            before, done = done, self.call(unfolding.states, rows, len(rows), done, len(held) > 0)
            if done == before:
                break
        stiffness[:], damping[:] = kept
        return rows if done == len(rows) else None

    def integrate(
        self, method: Handle, control: np.ndarray, here: np.ndarray, *parts: np.ndarray, wide: int = 1
    ) -> int:
        """Integrate, see :func:`kaneflex.multibody.time.collocation.integrate`; parts: given, times, rows, counts,
        ends."""
        given, times, *out = parts
        return int(self.call(
            collocation.integrate, method, control, here, given, len(given), times, len(times), *out, wide
        ))  # fmt: skip

    def unfold(self, rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """Coordinates q, v, a of the bodies, joint forces, energies and powers at rows of the integration."""
        count, bodies, size = len(rows), self.count(at.BODIES), self.count(at.SPEEDS)
        exerted = 3 * bodies + self.count(at.REACTIONS) + RESULTS * len(self.rows)
        widths = (size, size, size, exerted, 4, self.count(at.WORKS))
        out = tuple(np.zeros((count, width)) for width in widths)
        self.call(unfolding.unfold, np.ascontiguousarray(rows), count, *out)
        return out

    def compile(self) -> None:
        """Compile everything now, so that compilation is reported and timed separately."""
        self._handle, self._entries  # noqa: B018 - computes the kernels' addresses

    def call(self, function: Any, *values: Any) -> Any:
        """Call a library entry with this engine's handle; arrays and handles are passed by address."""
        return self._entries[function](self._handle.address, *map(by_address, values))

    @property
    def handed(self) -> at.Handed:
        """Kind of mechanism that its library is compiled for."""
        if self.shared is not None:
            return self.shared
        if len(self.holds):
            return at.HOLD_MECHANISM
        if self.count(at.RIGID):
            return at.IMPACT_MECHANISM
        return at.CONTACT_MECHANISM if len(self.contacts) else at.MECHANISM

    @cached_property
    def _entries(self) -> Mapping[Any, Callable[..., Any]]:
        return library(self.handed)

    @property
    def workspaces(self) -> Collection[str]:
        """Names among :attr:`arrays` of those that compiled functions fill, besides those of every engine."""
        return self.views

    @property
    def arrays(self) -> Mapping[str, np.ndarray]:
        """Arrays of compiled functions by their names in :attr:`handed`."""
        t = self.tables
        found = t.plan, t.bodies, t.acts, t.w, t.plan, self._kernel_addresses, self.p, self.real, self.pair
        views = {name: t.w[first : first + count] for name, (first, count) in self.views.items()}
        every = {**dict(zip(at.PARTS, found, strict=True)), **self.parts, **views}
        return {name: every[name] for name in self.handed.parts}

    @cached_property
    def _handle(self) -> Handle:
        return Handle(*self.arrays.values())

    @cached_property
    def _kernel_addresses(self) -> np.ndarray:
        return np.array([*map(kernel_address, self.kernels, at.STRUCTURE_KERNELS.values())])


def build_engine(mechanism: NumericMechanism, module: Any, blocks: Any, p: np.ndarray) -> Engine:
    """Engine of a mechanism with its structure's module and the module's parameters; at rest, loops not closed."""
    switches = len(getattr(module, "SWITCHES", ()))
    tables, layout, size, nodes, views = build_tables(mechanism, blocks.counts, blocks, mechanism.size, switches)
    kernels = tuple(getattr(module, name) for name in at.STRUCTURE_KERNELS)
    room, pairs = np.zeros(size), np.zeros(size, complex)
    return Engine(tables, layout, kernels, p, room, pairs, parts=nodes, views=views)
