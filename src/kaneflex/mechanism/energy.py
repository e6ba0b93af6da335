"""Energy balance of a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LARGEST_JUMP = 1e-3
"""Loss between two instants, as a share of the energy exchanged, that is not an error of steps: ten times the loss of
a whole run without a warning."""
_LEAST_TURNED = 1e-3
"""Smallest exchange that counts, as a share of the existing energy: a torque-free body exchanges only rounding and
integration errors."""


@dataclass(frozen=True, eq=False)
class Energy:
    """Energy of the mechanism at some instants [J], each of shape (n_times,).

    ``stored`` is kinetic, strain and potential energy together; ``dissipated`` by damping and ``supplied`` by loads and
    prescribed drives since the start.
    """

    kinetic: np.ndarray
    strain: np.ndarray
    weight: np.ndarray
    dissipated: np.ndarray
    supplied: np.ndarray

    @property
    def stored(self) -> np.ndarray:
        return self.kinetic + self.strain + self.weight

    @property
    def gap(self) -> np.ndarray:
        """Balance stored + dissipated - supplied - initially stored: zero for an exact solution."""
        return self.stored - self.stored[0] + self.dissipated - self.supplied

    @property
    def turned(self) -> float:
        """Largest energy exchanged, or at least a small share of the existing energy."""
        parts = (self.kinetic, self.strain, self.weight, self.dissipated, self.supplied)
        largest = max(float(abs(part).max()) for part in (self.kinetic, self.strain))
        return max(*(float(np.ptp(part)) for part in parts), _LEAST_TURNED * largest)

    @property
    def drift(self) -> float:
        """Largest gap relative to the energy exchanged."""
        turned = self.turned
        return float(abs(self.gap).max()) / turned if turned else 0.0

    def jumps(self, share: float = LARGEST_JUMP) -> np.ndarray:
        """Instants before those at which the gap has changed by more than a share of the energy exchanged."""
        return np.flatnonzero(abs(np.diff(self.gap)) > share * self.turned)
