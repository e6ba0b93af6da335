"""Working arrays of a choice of speeds and of an integration in space, and its stored steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.multibody.dynamics.spatial_work import Work
from kaneflex.multibody.model.layout import SHAPES, Handle
from kaneflex.multibody.model.spatial_layout import COORDINATE, COUNT, KIND, SLIDE, SPEED, TURN, Layout, Tables
from kaneflex.multibody.model.spatial_layout import SHAPES as SHAPE_NODE
from kaneflex.multibody.time.coefficients import RADAU

_TABLE = Handle(*RADAU)


@dataclass(frozen=True, eq=False)
class Choice:
    """Independent rows of the cuts, dependent, prescribed and independent speeds.

    Attributes
    ----------
    rows, dependent, prescribed, independent : ndarray
        Numbers of the rows and speeds.
    lent : ndarray (s,)
        Virtual inertia of speeds that nothing but the loops gives any, else 0.
    measure, row_measure : ndarray
        Measures of speeds and rows: 1 rad, or the mechanism's size.
    """

    rows: np.ndarray
    dependent: np.ndarray
    prescribed: np.ndarray
    independent: np.ndarray
    lent: np.ndarray
    measure: np.ndarray
    row_measure: np.ndarray
    tables: Tables
    work: Work

    def __getstate__(self) -> dict[str, Any]:
        """Everything except addresses, which belong to one process."""
        return {name: value for name, value in vars(self).items() if name not in ("handle", "basis")}

    @cached_property
    def basis(self) -> np.ndarray:
        """Speeds for a unit of each independent one, (independent, speeds), filled by compiled code."""
        return np.zeros((len(self.independent), len(self.measure)))

    @cached_property
    def handle(self) -> Handle:
        """Its arrays for compiled code, see :data:`kaneflex.multibody.dynamics.spatial_dynamics.CHOICE`."""
        lending, d, s = np.flatnonzero(self.lent), len(self.rows), len(self.measure)
        counts = np.array([d, len(self.prescribed), len(self.independent), len(lending)])
        return Handle(
            counts, self.rows, self.dependent, self.prescribed, self.independent, lending, self.lent, self.measure,
            self.row_measure, np.zeros(d * d + d), np.zeros(d * d + d), np.zeros(s), np.zeros(s), self.basis,
            np.zeros(2 * d, np.int64), self.factors(float),
        )  # fmt: skip

    def factors(self, dtype: type, extra: int = 0, shared: Handle | None = None) -> Handle:
        """Factors with rows, ``extra`` beyond those of the choice; ``shared``: others whose forces a and rows these
        have, too."""
        m, k, s = self.tables, self.work, len(self.measure)
        free = np.ones(s, np.int64)
        free[self.prescribed] = 0
        tree = Handle(
            np.array([len(m.bodies)]), m.bodies, free, *(np.zeros_like(part, dtype) for part in (k.I, k.E, k.L)),
            np.zeros((s, 6), dtype), np.zeros(s, dtype), *map(np.zeros_like, (k.joint_axes, k.phi, k.place, k.arm)),
            np.zeros((len(m.bodies), 6), dtype), np.zeros(s, dtype), np.zeros((m.bodies[:, SHAPES].max(), 6), dtype),
        )  # fmt: skip
        rows = len(self.rows) + int(np.count_nonzero(self.lent)) + extra
        common = shared.arrays[2:6] if shared else [np.zeros(3, np.int64), *(np.zeros((rows, s)) for _ in range(3))]
        return Handle(
            tree, np.array([s]), *common, np.zeros((rows, s), dtype), np.zeros(s, dtype), np.zeros((rows, s), dtype),
            np.zeros(rows * rows + rows, dtype), np.zeros(rows, np.int64),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Steps:
    """An integration with one choice of speeds.

    Attributes
    ----------
    control : ndarray (7,)
        See :mod:`kaneflex.multibody.time.spatial_collocation`.
    t : ndarray (1,)
        Current time [s].
    q, u, du : ndarray
        Current coordinates, speeds and their rates.
    works : ndarray (2,)
        Dissipated by dampers, supplied by loads and prescribed drives [J].
    scale : ndarray (s,)
        Errors allowed, as displacements.
    handle : Handle
        All arrays for compiled code: these; of the stages accelerations A (3, s), rates of the coordinates D (3, n),
        powers (3, 2), rates before, residuals as forces (s,) and as accelerations r (3, s); powers of the drives by
        accelerations; sizes of the loads at neighbouring states; factors of the mass matrix of every stage where its
        iteration began, and of the real and complex matrices of the stages.
    """

    control: np.ndarray
    t: np.ndarray
    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    works: np.ndarray
    scale: np.ndarray
    handle: Handle


def steps_of(m: Tables, choice: Choice, coordinates: int, scale: np.ndarray, loads: int) -> Steps:
    """Arrays for an integration with these errors allowed and number of loads."""
    s, coordinate = len(scale), np.full(len(scale), -1)
    for row in m.nodes.tolist():
        count = row[COUNT] if row[KIND] == SHAPE_NODE else int(row[KIND] in (TURN, SLIDE))
        coordinate[row[SPEED] : row[SPEED] + count] = np.arange(row[COORDINATE], row[COORDINATE] + count)
    control, t, q, u, du, works = (np.zeros(size) for size in (7, 1, coordinates, s, s, 2))
    A, D, powers, old = (np.zeros(size) for size in (3 * s, 3 * coordinates, 6, coordinates))
    extra = len(m.springs) + len(m.twists) + 6 * len(m.bushings) + loads
    real = choice.factors(float, extra)
    handle = Handle(
        _TABLE, control, t, q, u, du, works, scale, coordinate, A, D, powers, old, np.zeros(s), np.zeros(3 * s),
        np.zeros(s), np.zeros(loads), *(choice.factors(float) for _ in range(3)), real,
        choice.factors(complex, extra, real),
    )  # fmt: skip
    return Steps(control, t, q, u, du, works, scale, handle)


def step_size(coordinates: int, speeds: int) -> int:
    """Length of a stored step: begin and end, initial coordinates and speeds, final works, and the stages' rates of
    coordinates and accelerations."""
    return 4 + 4 * (coordinates + speeds)


def blocks_of(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping of the shapes of all bodies, placed as L is."""
    in_order = sorted(layout.shapes.items(), key=lambda each: layout.node_of[each[0]])
    found = [(np.ravel(shapes.stiffness), np.ravel(shapes.damping)) for _, shapes in in_order]
    none = [np.zeros(0)]
    return np.concatenate(none + [K for K, _ in found]), np.concatenate(none + [C for _, C in found])
