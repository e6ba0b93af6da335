"""Motion of a coupled system at instants, with the outcome of its run."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.mechanism.energy import Energy
from kaneflex.multibody.model.system import Unfolded
from kaneflex.multibody.unilateral.results import RowRecord

_NONE = np.zeros(0)


@dataclass(frozen=True, eq=False)
class CoupledTrajectory:
    """Motion of a coupled system at the stored instants.

    Attributes
    ----------
    rows : ndarray (n_times, row)
        Rows of the engine, see ``Engine.columns``; their loops are closed.
    q, v, a : ndarray (n_times, n)
        Frames and shapes of the system's bodies with their rates.
    multipliers : ndarray (n_times, m)
        Joint reactions and forces or torques of prescribed drives, as the system's ``constraints`` names them.
    energy : Energy
    loss, power : ndarray (n_times,)
        Dissipated and supplied power [W].
    steps, rejected : int
        Accepted and rejected steps.
    ends : ndarray (steps,)
        Instants [s] at which the steps of a whole run under the control of their error ended.
    contacts, frictions : RowRecord or None
        Gaps, forces and losses at the stored instants, and the impacts until the last; none of states by themselves.
    changes : CoupledTrajectory or None
        The states before and after each change of a contact or a friction, one after the other, as far as they are
        kept: speeds and accelerations may jump there.
    floquet : ndarray or None
        Floquet multipliers of a cycle, by decreasing modulus, if requested.
    """

    rows: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    multipliers: np.ndarray
    energy: Energy
    loss: np.ndarray
    power: np.ndarray
    steps: int
    rejected: int
    outcome: Outcome
    message: str
    ns_per_step: float
    ends: np.ndarray = field(default_factory=lambda: _NONE)
    contacts: RowRecord | None = None
    frictions: RowRecord | None = None
    changes: CoupledTrajectory | None = None
    floquet: np.ndarray | None = None

    @cached_property
    def times(self) -> np.ndarray:
        """Stored instants [s], (n_times,)."""
        return self.rows[:, 0].copy()


def by_themselves(rows: np.ndarray, found: Unfolded) -> CoupledTrajectory:
    """Rows without a run, with the motion of the bodies there: energies, contacts and frictions are unknown."""
    zero = np.zeros(len(rows))
    energy = Energy(zero, zero, zero, zero, zero)
    ended = (0, 0, Outcome.COMPLETED, Outcome.COMPLETED.value, 0.0)
    return CoupledTrajectory(rows, found.q, found.v, found.a, found.reactions, energy, zero, zero, *ended)
