"""Motion of a coupled system at instants, with the outcome of its run, in the plane and in space."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

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
        Rows of the engine, see ``Engine.columns``, whose loops are closed; in space their times alone.
    bodies : Unfolded or None
        Motion of the bodies and reactions there; None in space, where they are read from ``curve``.
    energy : Energy
        In space at the ends of the steps; zero where it is not known.
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
    curve : SpatialRun or None
        The run of a mechanism in space, see :mod:`kaneflex.multibody.time.spatial_forward`.
    """

    rows: np.ndarray
    bodies: Unfolded | None
    energy: Energy
    steps: int = 0
    rejected: int = 0
    outcome: Outcome = Outcome.COMPLETED
    message: str = Outcome.COMPLETED.value
    ns_per_step: float = 0.0
    ends: np.ndarray = field(default_factory=lambda: _NONE)
    contacts: RowRecord | None = None
    frictions: RowRecord | None = None
    changes: CoupledTrajectory | None = None
    floquet: np.ndarray | None = None
    curve: Any = None

    @cached_property
    def times(self) -> np.ndarray:
        """Stored instants [s], (n_times,)."""
        return self.rows[:, 0].copy()

    @property
    def q(self) -> np.ndarray:
        """Frames and shapes of the bodies in the plane, (n_times, n)."""
        return self._bodies.q

    @property
    def v(self) -> np.ndarray:
        """Their rates, (n_times, n)."""
        return self._bodies.v

    @property
    def a(self) -> np.ndarray:
        """Their accelerations, (n_times, n)."""
        return self._bodies.a

    @property
    def multipliers(self) -> np.ndarray:
        """Joint reactions, and forces or torques of prescribed drives, as the system's ``constraints`` names them,
        (n_times, m)."""
        return self._bodies.reactions

    @property
    def loss(self) -> np.ndarray:
        """Dissipated power [W], (n_times,)."""
        return self._bodies.sums[:, 2]

    @property
    def power(self) -> np.ndarray:
        """Supplied power [W], (n_times,)."""
        return self._bodies.powers[:, 1:].sum(axis=1)

    @property
    def _bodies(self) -> Unfolded:
        assert self.bodies is not None
        return self.bodies


def by_themselves(rows: np.ndarray, found: Unfolded) -> CoupledTrajectory:
    """Rows without a run, with the motion of the bodies there: energies, contacts and frictions are unknown."""
    return CoupledTrajectory(rows, found, unknown_energy(len(rows)))


def unknown_energy(count: int) -> Energy:
    """Zero energies at as many instants."""
    zero = np.zeros(count)
    return Energy(zero, zero, zero, zero, zero)
