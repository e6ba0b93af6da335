"""What a run gives: the motion of the mechanism's coordinates, and every sensor as a labelled series."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.integrate.outcome import Outcome, Trajectory
from kaneflex.model import Model, RigidMotion

if TYPE_CHECKING:
    import xarray

    from kaneflex.coupled.motion import CoupledMotion
    from kaneflex.sensors import Series


@dataclass(frozen=True, eq=False)
class Solution:
    """A finished run.

    Attributes
    ----------
    model : Model
    trajectory : Trajectory
        Motion of what was integrated, at the stored times.
    seconds : float
        Wall time of the run.
    coupled : CoupledMotion or None
        Motion of all bodies, reactions and energies, under preset ``coupled``.
    """

    model: Model
    trajectory: Trajectory
    seconds: float
    coupled: CoupledMotion | None = None

    def __repr__(self) -> str:
        return f"Solution({self.model.in_short}, {self.outcome.name.lower()}, {len(self.times)} instants)"

    def __iter__(self) -> Iterator[str]:
        """The names of the sensors."""
        return iter(self.series)

    @property
    def times(self) -> np.ndarray:
        """Stored instants [s], shape (n_times,)."""
        return self.trajectory.times

    @property
    def outcome(self) -> Outcome:
        """How the run ended."""
        return self.trajectory.outcome

    @cached_property
    def rigid(self) -> RigidMotion:
        """The rigid motion at the stored times."""
        return self.model.motion.at(self.times)

    @cached_property
    def coordinates(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """z, z', z'' of the mechanism's coordinates, each of shape (n, n_times)."""
        series = (self.trajectory.z.T, self.trajectory.v.T, self.trajectory.a.T)
        basis = self.model.modal_basis
        return series if basis is None else tuple(basis @ part for part in series)

    @cached_property
    def series(self) -> dict[str, Series]:
        """Every sensor's values with unit and meaning, companions ``NAME_rigid`` included."""
        from kaneflex.sensors import measure

        return measure(self)

    @property
    def drive_angles(self) -> dict[str, np.ndarray]:
        """Each drive's coordinate at the stored times [rad or m]."""
        return {drive: self.rigid[f"{drive}.angle"] for drive in self.model.scene.drives}

    @cached_property
    def dataset(self) -> xarray.Dataset:
        """All sensors as one labelled dataset; see :mod:`kaneflex.results`."""
        from kaneflex.results import to_dataset

        return to_dataset(self)

    def __getitem__(self, sensor: str) -> xarray.DataArray:
        """One sensor as a labelled array over ``time`` [s].

        Raises
        ------
        KeyError
            For a name that is not a sensor; it names the nearest one.
        """
        if sensor not in self.series:
            from kaneflex.errors import nearest

            raise KeyError(f"no sensor {sensor!r}. {nearest(sensor, self.series)}.")
        return self.dataset[sensor]
