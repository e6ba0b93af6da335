"""Tables of a mechanism with numpy views of its numbers: motion, state, contacts, coordinates by their kinds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from kaneflex.multibody.dynamics.arrays import Columns, Instants, Work
from kaneflex.multibody.model import codes
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.tree_layout import AXES_NODE, BODY, Layout


@dataclass(frozen=True, eq=False)
class Views:
    """Tables of one mechanism in the plane or in space.

    Attributes
    ----------
    parts : mapping
        Further arrays by their names in the kind of mechanism.
    views : mapping
        Places in the numbers w, and shapes, of those that compiled functions fill.
    """

    tables: at.Tables
    layout: Layout
    parts: Mapping[str, np.ndarray]
    views: Mapping[str, tuple[int, tuple[int, ...]]]

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
        """Columns of a row of the integration: coordinates q, speeds u, accelerations du, modes of contacts and
        frictions, quaternions of balls, works."""
        n, reactions, modes, balls = self.size, self.count(at.REACTIONS), self.modes.size, 4 * len(self.balls)
        ends = np.cumsum([1, n, n, n, reactions, modes, balls, self.count(at.WORKS)]).tolist()
        names = "q", "u", "du", "reactions", "modes", "quaternions", "works"
        return {name: slice(*pair) for name, pair in zip(names, pairwise(ends), strict=True)}

    def row(self, t: float) -> np.ndarray:
        """Current motion at t [s] as a row of the integration, with zero works."""
        return np.concatenate([[t], *self.motion, self.modes.ravel(), self.quaternions, np.zeros(self.count(at.WORKS))])

    @cached_property
    def work(self) -> Work:
        """Arrays that compiled functions fill."""
        return Work(**{each.name: self.view(each.name) for each in fields(Work)})

    def view(self, name: str) -> np.ndarray:
        """Array that compiled functions fill."""
        first, shape = self.views[name]
        return self.tables.w[first : first + math.prod(shape)].reshape(shape)

    def instants(self, records: np.ndarray) -> Instants:
        """Records (n_times, kept) by names."""
        return Instants.of(records, self.work)

    @cached_property
    def numbered(self) -> Instants:
        """Columns of the record by its names, (1, .) each."""
        return self.instants(np.arange(len(self.work.kept))[None])

    def recorded(self, bodies: Iterable[str], forces: Sequence[np.ndarray]) -> Columns:
        """Columns of the record for the coordinates of these bodies, one after the other, and for forces."""
        kept, none, parts = self.numbered, np.zeros(0, int), ([*forces], *(list[np.ndarray]() for _ in range(3)))
        for name in bodies:
            node, (places, speeds) = self.layout.node_of[name], self.amplitudes(name)
            axes = kept.R[0, node].ravel() if self.in_space else none
            parts[1].extend([kept.r[0, node], axes, kept.q[0, places]])
            parts[2].extend([kept.twist[0, node], kept.u[0, speeds]])
            parts[3].extend([kept.rate[0, node], kept.du[0, speeds]])
        exerted, q, v, a = (np.concatenate([none, *part]) for part in parts)
        return Columns(q, v, a, exerted)

    def amplitudes(self, body: str) -> tuple[np.ndarray, np.ndarray]:
        """Places of the amplitudes of a body's shapes among the coordinates q, and their speeds."""
        count, modal = self.tables.bodies[[*self.layout.node_of].index(body), [at.SHAPES, at.MODAL]].tolist()
        places, speeds = self.own[(self.own[:, 1] >= modal) & (self.own[:, 1] < modal + count)].T
        return places, speeds

    @property
    def in_space(self) -> bool:
        """True if a twist has six numbers."""
        return self.work.twist.shape[1] == 6

    @property
    def quaternions(self) -> np.ndarray:
        """Current quaternions of balls, one after the other."""
        return self.work.q[self.balls[:, :1] + np.arange(4)].ravel()

    def state_of(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and speeds of a row of the integration."""
        q, (own, speeds), columns = np.zeros(len(self.work.q)), self.own.T, self.columns
        q[own] = row[columns["q"]][speeds]
        q[self.balls[:, :1] + np.arange(4)] = row[columns["quaternions"]].reshape(-1, 4)
        return q, row[columns["u"]].copy()

    def rows_of(self, times: np.ndarray, q: np.ndarray, u: np.ndarray, du: np.ndarray | float = 0.0) -> np.ndarray:
        """Rows of the integration near states with coordinates q, speeds u and accelerations du, (n_times, .) each,
        with the current modes of contacts and frictions."""
        (own, speeds), of, found = self.own.T, self.columns, np.tile(self.row(0.0), (len(times), 1))
        found[:, 0], found[:, of["q"]], found[:, of["u"]], found[:, of["du"]] = times, 0.0, u, du
        found[:, of["q"]][:, speeds] = q[:, own]
        found[:, of["quaternions"]] = q[:, self.balls[:, :1] + np.arange(4)].reshape(len(times), -1)
        return found

    def rates_of(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Rates q' (n_times, coordinates) of coordinates q with speeds u.

        A joint's coordinate and a shape's amplitude have their speed as rate, the quaternion p of a ball p omega / 2,
        where omega is its angular velocity in its own axes.
        """
        found, (own, speeds) = np.zeros(q.shape), self.own.T
        found[:, own] = u[:, speeds]
        for k, s in self.balls.tolist():
            w, p, omega = q[:, k, None], q[:, k + 1 : k + 4], u[:, s : s + 3]
            found[:, k] = -0.5 * (p * omega).sum(axis=1)
            found[:, k + 1 : k + 4] = 0.5 * (w * omega + np.cross(p, omega))
        return found

    def speeds_of(self, q: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Speeds u (n_times, speeds) of coordinates q with rates q'."""
        found, (own, speeds) = np.zeros((len(q), self.size)), self.own.T
        found[:, speeds] = rates[:, own]
        for k, s in self.balls.tolist():
            w, p = q[:, k, None], q[:, k + 1 : k + 4]
            turned = w * rates[:, k + 1 : k + 4] - rates[:, k, None] * p
            found[:, s : s + 3] = 2.0 * (turned - np.cross(p, rates[:, k + 1 : k + 4]))
        return found

    def set_row(self, row: np.ndarray) -> None:
        """Set the motion to that of a row."""
        first = 1
        for part in self.motion:
            part[:] = row[first : first + len(part)]
            first += len(part)
        self.modes[:] = row[self.columns["modes"]].reshape(-1, at.MODE_SIZE)
        if self.in_space:
            self.work.q[:] = self.state_of(row)[0]

    @property
    def modes(self) -> np.ndarray:
        """View of MODE and MEMORY of frictions and contacts, (rows, MODE_SIZE)."""
        return self.rows[:, at.MODE : at.MODE + at.MODE_SIZE]

    def take_impacts(self) -> np.ndarray:
        """Finished impacts not yet taken, (impacts, IMPACT_SIZE)."""
        room = self.numbers(at.IMPACTS, 1 + at.IMPACT_SIZE * (at.MOST_IMPACTS + len(self.contacts)))
        taken, room[0] = room[1 : 1 + at.IMPACT_SIZE * int(room[0])].reshape(-1, at.IMPACT_SIZE).copy(), 0.0
        return taken

    def part(self) -> None:
        """Open all contacts and free all frictions; switches are above zero."""
        self.modes[:], self.contacts[:, at.MEMORY] = (at.OPEN, 0.0), at.ABOVE

    def set(self, state: State) -> None:
        """Set coordinates and speeds to those of a state; contacts are open, and frictions free."""
        self.part()
        places, speeds = self.own.T
        self.work.q[:], self.motion[0][:], self.motion[1][:] = state.q, 0.0, state.u
        self.motion[0][speeds] = state.q[places]

    @cached_property
    def open_speeds(self) -> np.ndarray:
        """Speeds that no drive prescribes."""
        return np.flatnonzero(self.levels < codes.PRESCRIBED)

    @property
    def prescribed(self) -> np.ndarray:
        """Speed of the joint of every prescribed drive; -1 of one that closes a loop."""
        first = self.count(at.PRESCRIBED)
        return self.tables.plan[first : first + self.inputs - len(self.sizes)]

    @cached_property
    def levels(self) -> np.ndarray:
        """Level of every coordinate in a choice."""
        freed = self.tables.plan[self.count(at.FREED) :][: self.size] == 1
        found = np.where(freed, codes.FIRST, codes.PRESCRIBED)
        for first, count in self.tables.bodies[:, [at.MODAL, at.SHAPES]]:
            found[first : first + count] = codes.OF_SHAPE
        return found

    @property
    def jacobian(self) -> np.ndarray:
        """Jacobian of the rows of cut joints by the speeds at the current position, both in their measures."""
        return self.work.J[: len(self.work.row_measure)] * self.measure / self.work.row_measure[:, None]

    def cut_of(self, row: int) -> str:
        """Joint of a cut's row; for a resting contact the last one."""
        return next((name for name, rows in self.layout.cuts.items() if row < rows.stop), [*self.layout.cuts][-1])

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
    def measure(self) -> np.ndarray:
        """Units of the coordinates: the mechanism's size [m], or 1 rad."""
        return self.numbers(at.MEASURE, self.size)

    @property
    def balls(self) -> np.ndarray:
        """Place of every ball's quaternion among the coordinates q, and its first speed, (balls, 2)."""
        return self.parts["balls"]

    @property
    def own(self) -> np.ndarray:
        """Place in q and speed of every other coordinate, (n, 2)."""
        return self.parts["own"]

    @property
    def coordinates(self) -> np.ndarray:
        """Current coordinates q."""
        own, speeds = self.own.T
        self.work.q[own] = self.work.y[speeds]
        return self.work.q.copy()

    @property
    def sizes(self) -> np.ndarray:
        """Current sizes of loads."""
        return self.numbers(at.SIZE, self.count(at.SPRINGS) - self.count(at.LOADS))

    def state(self, t: float, choice: Choice) -> State:
        """Current state, at t [s]."""
        return State(t, self.coordinates, self.motion[1].copy(), self.motion[2].copy(), self.sizes.copy(), choice)

    @cached_property
    def shapes(self) -> np.ndarray:
        """Mask of coordinates that are shape amplitudes."""
        return self.levels == codes.OF_SHAPE

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness of the shapes by all speeds, (speeds, speeds)."""
        found, first = np.zeros((self.size, self.size)), 0
        for count, modal in self.tables.bodies[:, [at.SHAPES, at.MODAL]].tolist():
            own = slice(modal, modal + count)
            found[own, own] = self.parts["K"][first : (first := first + count**2)].reshape(count, count)
        return found

    @property
    def masses(self) -> np.ndarray:
        """Mass [kg] of every body."""
        blocks = self.parts["nodes"][self.parts["frames"][:, AXES_NODE], BODY]
        return np.where(blocks >= 0, self.parts["block"][blocks], 0.0)

    @cached_property
    def modal(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of shape amplitudes among the coordinates q, and their speeds."""
        coordinates, speeds = self.own[self.shapes[self.own[:, 1]]].T
        return coordinates, speeds

    @property
    def inputs(self) -> int:
        """Number of loads and prescribed accelerations."""
        return self.count(at.WORKS) - 1 - len(self.frictions) - len(self.contacts)

    @property
    def additions(self) -> np.ndarray:
        """View of the additions to the sizes of the loads and then to the accelerations of the prescribed drives."""
        return self.numbers(at.INPUT, self.inputs)

    @cached_property
    def contacts(self) -> np.ndarray:
        """View of the numbers of contacts, then of switching arguments, (contacts, CONTACT_SIZE)."""
        return self.rows[len(self.rows) - self.count(at.ACTS) + self.count(at.CONTACTS) :]

    @cached_property
    def frictions(self) -> np.ndarray:
        """View of the numbers of frictions, (frictions, CONTACT_SIZE)."""
        return self.rows[: self.count(at.DRIVES) - self.count(at.FRICTIONS)]

    @cached_property
    def rows(self) -> np.ndarray:
        """View of the numbers of frictions, then of contacts, (rows, CONTACT_SIZE)."""
        held, touching = self.count(at.DRIVES) - self.count(at.FRICTIONS), self.count(at.ACTS) - self.count(at.CONTACTS)
        first = self.count(at.CONTACT) - at.CONTACT_SIZE * held
        return self.tables.w[first : first + at.CONTACT_SIZE * (held + touching)].reshape(-1, at.CONTACT_SIZE)
