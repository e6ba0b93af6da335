"""Engine of a mechanism in space: its arrays for compiled code."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.multibody.compile.library import library
from kaneflex.multibody.dynamics import spatial_entries
from kaneflex.multibody.dynamics.arrays import Work, arrays_of
from kaneflex.multibody.dynamics.spatial_entries import DONE
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.determinacy import virtual_inertia
from kaneflex.multibody.model.layout import RIGID_SPACE, SPACE, STRUCTURE_KERNELS, SWITCHED_SPACE
from kaneflex.multibody.model.places import Counts, assign_rows
from kaneflex.multibody.model.spatial_layout import BALL, COORDINATE, COUNT, KIND, ROW_OF, SPEED, Layout
from kaneflex.multibody.model.state import Choice

_LIGHT = 1e-9
"""Ratio of principal moments of inertia below which the smaller one counts as none."""


@dataclass(frozen=True, eq=False)
class SpatialEngine(Engine):
    """Engine of a mechanism in space.

    Attributes
    ----------
    work : Work
        Those that compiled functions fill.
    integrates : bool
        True if it uses the library that integrates motions.
    light : bool
        True if some body has no mass, or no inertia about some axis.
    """

    layout: Layout  # type: ignore[assignment]
    work: Work = None  # type: ignore[assignment]
    integrates: bool = False
    light: bool = False

    def stand(self, row: np.ndarray) -> None:
        super().stand(row)
        self.work.q[:] = self.state_of(row)[0]

    def openings(self, t: float) -> np.ndarray:
        self.call(spatial_entries.place, self.coordinates)
        return self.work.rows[:, 0].copy()

    def chosen_by(self, level: np.ndarray) -> tuple[Choice, np.ndarray]:
        choice, dropped = super().chosen_by(level)
        return self.choice_of(choice.rows, choice.dependent), dropped

    def choice_of(self, rows: np.ndarray, dependent: np.ndarray) -> Choice:
        """Choice of the given rows and speeds at the position of ``work``."""
        inertia = np.zeros(self.size)
        if len(dependent) and self.light:
            free = np.isin(np.arange(self.size), self.open_speeds)
            inertia = virtual_inertia(dependent, self.mass(), self.measure, self.tables.bodies, free)
        return Choice(rows, dependent, np.setdiff1d(self.open_speeds, dependent), inertia)

    def mass(self) -> np.ndarray:
        """Mass matrix of all speeds at the position of ``work``, (speeds, speeds)."""
        self.call(spatial_entries.mass, np.zeros(self.size))
        return self.work.M

    def project(self, t: float) -> bool:
        return bool(self.call(spatial_entries.project, t, self.coordinates, self.motion[1].copy()) == DONE)

    def cut_of(self, row: int) -> str:
        return next(name for name, rows in self.layout.cuts.items() if row < rows.stop)

    def choose_speeds(self, choice: Choice) -> None:
        if self.chosen[0] is choice:
            return
        super().choose_speeds(choice)
        plan, speeds = self.tables.plan, np.flatnonzero(choice.virtual_inertia)
        plan[at.YIELDING] = len(speeds)
        plan[plan[at.TOUCHING] : plan[at.TOUCHING] + len(speeds)] = speeds
        self.parts["virtual_inertia"][:], self.work.now[2] = choice.virtual_inertia, len(choice.independent)

    @property
    def balls(self) -> np.ndarray:
        return self.parts["balls"]

    @property
    def own(self) -> np.ndarray:
        return self.parts["own"]

    @property
    def sections(self) -> np.ndarray:
        return self.work.sections

    @property
    def stiffness(self) -> np.ndarray:
        found, first = np.zeros((self.size, self.size)), 0
        for count, modal in self.tables.bodies[:, [at.SHAPES, at.MODAL]].tolist():
            own = slice(modal, modal + count)
            found[own, own] = self.parts["K"][first : (first := first + count**2)].reshape(count, count)
        return found

    @property
    def axes(self) -> np.ndarray:
        return self.work.axes

    @property
    def coordinates(self) -> np.ndarray:
        own, speeds = self.own.T
        self.work.q[own] = self.work.y[speeds]
        return self.work.q.copy()

    def advanced(self, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
        out = np.tile(q, (len(steps), 1))
        self.call(spatial_entries.advance, np.ascontiguousarray(steps), len(steps), out)
        return out

    @property
    def quaternions(self) -> np.ndarray:
        return self.work.q[self.balls[:, :1] + np.arange(4)].ravel()

    def state_of(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and speeds of a row of the integration."""
        q, (own, speeds), columns = np.zeros(len(self.work.q)), self.own.T, self.columns
        q[own] = row[columns["q"]][speeds]
        q[self.balls[:, :1] + np.arange(4)] = row[columns["quaternions"]].reshape(-1, 4)
        return q, row[columns["u"]].copy()

    @cached_property
    def _entries(self) -> Mapping[Any, Callable[..., Any]]:  # type: ignore[override]
        return library(self.handed, self.integrates)

    @property
    def workspaces(self) -> Collection[str]:
        return {*vars(self.work), "mass_0", "mass_1", "mass_2"}


def spatial_engine(system: Any) -> SpatialEngine:
    """Engine of a :class:`kaneflex.multibody.model.spatial_system.SpatialSystem`; at rest, loops not closed."""
    m, layout, counts = system.tables, system.layout, _counts(system)
    speeds, coordinates = len(layout.coordinates), len(layout.positions)
    plan, w, work, places, size = arrays_of(m, counts, coordinates)
    in_order = sorted(layout.shapes.items(), key=lambda each: layout.node_of[each[0]])
    K, C = (np.concatenate([np.zeros(0), *(getattr(shapes, of).ravel() for _, shapes in in_order)])
            for of in ("stiffness", "damping"))  # fmt: skip
    measure = [1.0 if unit == "rad" else system.mechanism.size for _, unit in layout.coordinates]
    for place, numbers in ((plan[at.MEASURE], measure), (places["springs"], m.stiffness.ravel()), (plan[at.DAMPED], C)):
        w[place : place + len(numbers)] = numbers
    w[plan[at.TOUCH] + at.EXTENT] = system.mechanism.size or 1.0
    balls = m.nodes[m.nodes[:, KIND] == BALL][:, [COORDINATE, SPEED]]
    of_balls = zip((coordinates, speeds), balls.T, (4, 3), strict=True)
    own = np.column_stack([np.setdiff1d(np.arange(count), first[:, None] + np.arange(wide))
                           for count, first, wide in of_balls])  # fmt: skip
    real, *masses = (np.zeros(size) for _ in range(4))
    parts = m._asdict() | vars(work) | {
        "counts": None, "block": m.p, "axis_at": m.axes, "K": K,
        "virtual_inertia": np.zeros(speeds), "row_measure": system.row_measure, "own": own,
        "balls": np.ascontiguousarray(balls),
        **{f"mass_{i}": each for i, each in enumerate(masses)},
    }  # fmt: skip
    parts["counts"] = np.array([
        len(m.nodes), speeds, coordinates, len(m.on), len(m.axis_on),
        len(m.bodies), len(work.kept), len(work.phi), places["geometry"], len(balls), len(own),
    ])  # fmt: skip
    del parts["p"], parts["bodies"], parts["acts"]  # of the nodes; those of the engine have these names
    acts, (first, end) = m.acts.copy(), counts.ranges[4:6]
    acts[first:end, at.NUMBERS_AT] = places["springs"] + 3 * np.arange(end - first)
    assign_rows(plan, acts)
    tables = at.Tables(plan, m.bodies, acts, w)
    kernels = tuple(getattr(system.module, name) for name in STRUCTURE_KERNELS)
    p = np.ascontiguousarray(system.parameters, float)
    stiff = system.coupled or (system.integrates and system.has_slopes)
    space, pair = SWITCHED_SPACE if counts.switches else SPACE if stiff else RIGID_SPACE, np.zeros(size, complex)
    inertias = [(body.mass, *body.inertia[:3]) for body in system.mechanism.bodies.values()]
    light = any(mass <= 0.0 or min(axes) <= _LIGHT * max(axes) for mass, *axes in inertias)
    return SpatialEngine(
        tables, layout, kernels, p, real, pair, space, parts=parts, work=work, integrates=system.integrates, light=light
    )


def _counts(system: Any) -> Counts:
    m = system.tables
    twists = m.nodes[m.nodes[:, ROW_OF] >= 0, COUNT]
    return Counts(
        6, m.bodies[:, at.SHAPES].tolist(), len(system.layout.coordinates), 0, int(twists.sum()), m.ranges,
        len(system.row_measure), system.columns(system.driven, SPEED).tolist(), m.ranges[6] - m.ranges[5], False,
    )  # fmt: skip
