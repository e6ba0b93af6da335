"""Tables of the motion laid out in lanes: for steps that follow one another, and for segments of a cycle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.integrate.lanes import LANES


def in_lanes(rows: np.ndarray, nodes: int, steps: np.ndarray) -> np.ndarray:
    """The table of steps (blocks, LANES), shape (blocks * nodes, n_scalars, LANES).

    rows: shape (n * nodes + 1, n_scalars): row `nodes * k` at the start of step k, then its stages, then its end.
    """
    places = nodes * steps[:, None, :] + np.arange(1, nodes + 1)[None, :, None]
    return np.ascontiguousarray(rows[places.reshape(-1, LANES)].transpose(0, 2, 1))


def one_after_the_other(rows: np.ndarray, nodes: int) -> np.ndarray:
    """The table of all steps in their order; the last block is filled up with the last step."""
    count = (len(rows) - 1) // nodes
    steps = np.minimum(np.arange(-(-count // LANES) * LANES), count - 1)
    return in_lanes(rows, nodes, steps.reshape(-1, LANES))


@dataclass(frozen=True, eq=False)
class TimeSegments:
    """A cycle cut into segments of time that are integrated side by side, one in each lane: their stream.

    The first `longer` segments have one step more than the others.

    rows: shape (period_steps * nodes + 1, n_scalars), of the whole cycle
    """

    rows: np.ndarray
    nodes: int
    step: float

    @property
    def period_steps(self) -> int:
        return (len(self.rows) - 1) // self.nodes

    @property
    def least(self) -> int:
        """Steps of a shorter segment."""
        return self.period_steps // LANES

    @property
    def longer(self) -> int:
        return self.period_steps % LANES

    @property
    def most(self) -> int:
        """Steps of a longer segment, if there is one; a shorter one then has a step beyond its end."""
        return self.least + (self.longer > 0)

    @cached_property
    def counts(self) -> np.ndarray:
        """Steps of each segment, shape (LANES,)."""
        return self.least + (np.arange(LANES) < self.longer)

    @cached_property
    def starts(self) -> np.ndarray:
        """Their first steps, shape (LANES,)."""
        return np.cumsum(self.counts) - self.counts

    @cached_property
    def scalars(self) -> np.ndarray:
        """The table of all segments, shape (most * nodes, n_scalars, LANES)."""
        steps = np.add.outer(np.arange(self.most), self.starts) % self.period_steps
        return in_lanes(self.rows, self.nodes, steps)

    def first_row(self) -> np.ndarray:
        """Scalars at the start of every segment, shape (n_scalars, LANES)."""
        return self.rows[self.nodes * self.starts].T

    def piece(self, done: int, n_steps: int) -> tuple[np.ndarray, int, int, int]:
        """The table for `n_steps` steps after step `done` of every segment, as :meth:`CoefficientStream.piece`."""
        return self.scalars, self.most, done, n_steps

    def joined(self, stored: np.ndarray) -> np.ndarray:
        """Rows of the whole cycle, shape (period_steps, n), from those of its segments, (most + 1, n, LANES).

        All are the ends of steps. What begins a segment was found by products of the segments' matrices: its
        accelerations, what is left of loads and stiffness, would be those of their rounding.
        """
        ends = np.concatenate([stored[1 : count + 1, :, lane] for lane, count in enumerate(self.counts)])
        return np.roll(ends, 1, axis=0)
