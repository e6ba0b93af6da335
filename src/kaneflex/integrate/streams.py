"""The table of the motion's scalars as compiled loops read it: in pieces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kaneflex.integrate.system import Table
from kaneflex.support.errors import UserError

LARGEST_PIECE = 2_000_000  # numbers in a piece of the table of a motion without a cycle: 16 MB


@dataclass
class CoefficientStream:
    """Rows of the table for the steps of one run.

    nodes: of the method, where a step reads the table
    period_steps: steps of a cycle, whose table is made once and read again; None where there is no cycle
    read: what the compiled loop reads of rows of the table; by default these
    constant: indices of scalars that must keep their first values; None where all may change
    """

    table: Table
    n_scalars: int
    t0: float
    step: float
    nodes: tuple[float, ...]
    period_steps: int | None
    read: Callable[[np.ndarray], np.ndarray] = lambda rows: rows
    constant: np.ndarray | None = None
    _cycle: np.ndarray | None = None
    _first: np.ndarray | None = None

    def first_row(self) -> np.ndarray:
        """Scalars at the start of the run, shape (n_scalars,)."""
        if self._first is None:
            self._first = self.row(self.t0)
        return self._first

    def row(self, t: float) -> np.ndarray:
        """Scalars at one time in s, shape (n_scalars,)."""
        return self._checked(np.array([t]))[0]

    def piece(self, done: int, n_steps: int) -> tuple[np.ndarray, int, int, int]:
        """For at most `n_steps` steps after step `done`: a table, its steps, those already taken, those it serves.

        Its last row is that of the end of the last step.
        """
        if self.period_steps is not None:
            if self._cycle is None:
                rows = self._checked(self._times(0, self.period_steps))
                self._cycle = self.read(np.concatenate((rows, rows[:1])))
            return self._cycle, self.period_steps, done % self.period_steps, n_steps
        steps = max(1, min(n_steps, LARGEST_PIECE // (self.n_scalars * len(self.nodes))))
        times = np.append(self._times(done, steps), self.t0 + (done + steps) * self.step)
        return self.read(self._checked(times)), steps, 0, steps

    def _times(self, done: int, steps: int) -> np.ndarray:
        at = done + np.arange(steps)
        return (self.t0 + np.add.outer(at, np.array(self.nodes)) * self.step).ravel()

    def _checked(self, times: np.ndarray) -> np.ndarray:
        rows = np.array(self.table(times), dtype=np.float64, order="C")  # a copy: the loops want it writable
        if rows.shape != (times.size, self.n_scalars):
            raise ValueError(f"the table has shape {rows.shape}: must be {(times.size, self.n_scalars)}")
        finite = np.isfinite(rows)
        if not finite.all():
            row, scalar = np.argwhere(~finite)[0]
            key, reason = f"scalar {scalar} of the motion", f"not a finite number at t = {times[row]:.9g} s"
            raise UserError(key, rows[row, scalar], reason, "Check the motion and the loads at this time")
        if self.constant is not None:
            self._check_constant(rows, times)
        return rows

    def _check_constant(self, rows: np.ndarray, times: np.ndarray) -> None:
        first = rows[0] if self._first is None else self._first
        changed = np.argwhere(rows[:, self.constant] != first[self.constant])
        if changed.size:
            reason = f"the matrices change in time (at t = {times[changed[0][0]]:.9g} s)"
            cure = "Use radau, generalised-alpha or newmark, or a model that freezes the matrices"
            raise UserError("integrator", "exact-modal", reason, cure)
