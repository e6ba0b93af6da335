"""What the compiled loops read of several systems side by side, one in each lane."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.integrate.coefficient_stream import LARGEST_PIECE, CoefficientStream
from kaneflex.integrate.lanes import LANES
from kaneflex.integrate.system import AffineSystem, Packed, pack


@dataclass(frozen=True, eq=False)
class Systems:
    """LANES systems of as many coordinates."""

    each: tuple[AffineSystem, ...]

    @property
    def n(self) -> int:
        """Number of coordinates of each."""
        return self.each[0].n

    @property
    def half_bandwidth(self) -> int:
        """That of the widest."""
        return max(system.half_bandwidth for system in self.each)

    @cached_property
    def packed(self) -> Packed:
        """Their numbers, ``data`` of shape (numbers, LANES)."""
        return pack(self.each)

    def with_tables(self, scalars: np.ndarray) -> Iterator[tuple[AffineSystem, np.ndarray]]:
        """Each with its table, shape (rows, n_scalars), from the table of all of them."""
        for lane, system in enumerate(self.each):
            yield system, scalars[:, : system.n_scalars, lane]


@dataclass(frozen=True, eq=False)
class BatchStream:
    """Rows of the tables of LANES runs, one in each lane: their stream. All have as many steps, and in a cycle, too."""

    streams: tuple[CoefficientStream, ...]

    @cached_property
    def step(self) -> np.ndarray:
        """Their steps in s, shape (LANES,)."""
        return np.array([stream.step for stream in self.streams])

    def first_row(self) -> np.ndarray:
        """Scalars at the start of every run, shape (n_scalars, LANES); zeros where a run has fewer."""
        return _lane_table([stream.first_row()[None] for stream in self.streams])[0]

    @cached_property
    def _cycle(self) -> np.ndarray:
        return _lane_table([stream.cycle()[1:] for stream in self.streams])

    def piece(self, done: int, n_steps: int) -> tuple[np.ndarray, int, int, int]:
        """The table for at most `n_steps` steps after step `done` of every run, as :meth:`CoefficientStream.piece`."""
        first = self.streams[0]
        if first.period_steps is not None:
            return self._cycle, first.period_steps, done % first.period_steps, n_steps
        most = LARGEST_PIECE // (LANES * len(first.nodes) * max(stream.n_scalars for stream in self.streams))
        steps = max(1, min(n_steps, most))
        return _lane_table([stream.rows(done, steps)[1:] for stream in self.streams]), steps, 0, steps


def _lane_table(tables: list[np.ndarray]) -> np.ndarray:
    """One table of all lanes, shape (rows, n_scalars, LANES)."""
    table = np.zeros((len(tables[0]), max(rows.shape[1] for rows in tables), LANES))
    for lane, rows in enumerate(tables):
        table[:, : rows.shape[1], lane] = rows
    return table
