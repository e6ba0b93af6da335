"""Motion of a coupled system at instants, with the outcome of its run, in the plane and in space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.mechanism.energy import Energy
from kaneflex.multibody.dynamics.arrays import Columns
from kaneflex.multibody.unilateral.results import RowRecord


@dataclass(frozen=True, eq=False)
class CoupledTrajectory:
    """Motion of a coupled system at the stored instants.

    Attributes
    ----------
    rows : ndarray (n_times, row)
        Rows of the engine, see ``Engine.columns``, whose loops are closed.
    record : ndarray (n_times, kept)
        Motion of the bodies, reactions, energies and powers there, see
        :class:`kaneflex.multibody.dynamics.arrays.Instants`.
    of : Columns
        Its columns by the coordinates of the bodies.
    energy : Energy
        Zero where it is not known.
    steps, rejected : int
        Accepted and rejected steps.
    contacts, frictions : RowRecord or None
        Gaps, forces and losses at the stored instants, and the impacts until the last; none of states by themselves.
    floquet : ndarray or None
        Floquet multipliers of a cycle, by decreasing modulus, if requested.
    curve : Run or None
        The run, see :class:`kaneflex.multibody.time.dense_output.RunCurve`; none of states by themselves.
    """

    rows: np.ndarray
    record: np.ndarray
    of: Columns
    energy: Energy
    steps: int = 0
    rejected: int = 0
    outcome: Outcome = Outcome.COMPLETED
    message: str = Outcome.COMPLETED.value
    ns_per_step: float = 0.0
    contacts: RowRecord | None = None
    frictions: RowRecord | None = None
    floquet: np.ndarray | None = None
    curve: Any = None

    @cached_property
    def times(self) -> np.ndarray:
        """Stored instants [s], (n_times,)."""
        return self.rows[:, 0].copy()

    @cached_property
    def q(self) -> np.ndarray:
        """Frames and shapes of the bodies, (n_times, n)."""
        return self.record[:, self.of.q]

    @cached_property
    def v(self) -> np.ndarray:
        """Their rates, (n_times, .)."""
        return self.record[:, self.of.v]

    @cached_property
    def a(self) -> np.ndarray:
        """Their accelerations, (n_times, .)."""
        return self.record[:, self.of.a]

    @cached_property
    def multipliers(self) -> np.ndarray:
        """Joint reactions, and forces or torques of prescribed drives, in the plane as the system's ``constraints``
        names them, (n_times, m)."""
        return self.record[:, self.of.forces]


def by_themselves(system: Any, rows: np.ndarray, record: np.ndarray | None = None) -> CoupledTrajectory:
    """Rows without a run, whose loops are closed, or near states with this record: energies, contacts and frictions are
    unknown."""
    zero, record = np.zeros(len(rows)), system.unfold(rows) if record is None else record
    return CoupledTrajectory(rows, record, system.record, Energy(zero, zero, zero, zero, zero))
