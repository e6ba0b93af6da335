"""A cycle cut into stretches of time that are integrated side by side, one in each lane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.integrate.feed import Feed
from kaneflex.integrate.steppers import LANES


@dataclass(frozen=True, eq=False)
class Stretches:
    """The feed of a cycle's stretches: rows of the table with an axis of LANES more, one for each stretch.

    The first `longer` stretches have one step more than the others.
    """

    feed: Feed
    period_steps: int

    @property
    def step(self) -> float:
        """Of the cycle, in s."""
        return self.feed.step

    @property
    def least(self) -> int:
        """Steps of a shorter stretch."""
        return self.period_steps // LANES

    @property
    def longer(self) -> int:
        return self.period_steps % LANES

    @property
    def counts(self) -> np.ndarray:
        """Steps of each stretch, shape (LANES,)."""
        return self.least + (np.arange(LANES) < self.longer)

    @property
    def most(self) -> int:
        """Steps of a longer stretch, if there is one; a shorter one then has a step beyond its end."""
        return self.least + (self.longer > 0)

    @cached_property
    def scalars(self) -> np.ndarray:
        """The table, shape (most * nodes + 1, n_scalars, LANES)."""
        rows, _, _ = self.feed.piece(0, self.period_steps)
        nodes = len(self.feed.nodes)
        starts = nodes * (np.cumsum(self.counts) - self.counts)
        places = np.add.outer(np.arange(nodes * self.most + 1), starts) % (nodes * self.period_steps)
        return np.ascontiguousarray(rows[places].transpose(0, 2, 1))

    def first_row(self) -> np.ndarray:
        """Scalars at the start of every stretch, shape (n_scalars, LANES)."""
        return self.scalars[0]

    def piece(self, done: int, n_steps: int) -> tuple[np.ndarray, int, int]:
        """The table for `n_steps` steps after step `done` of every stretch, as :meth:`Feed.piece`."""
        return self.scalars, done, n_steps

    def joined(self, stored: np.ndarray) -> np.ndarray:
        """Rows of the whole cycle, shape (period_steps, n), from those of its stretches, (most + 1, n, LANES)."""
        return np.concatenate([stored[:count, :, lane] for lane, count in enumerate(self.counts)])
