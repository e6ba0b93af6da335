"""Result of a run: motion of the mechanism's coordinates, and every sensor as a labelled series."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, KeysView, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np

from kaneflex.integrate.outcome import Outcome, Trajectory
from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import Model
from kaneflex.response.elastic_motion import elastic_motion
from kaneflex.response.motion import Motion
from kaneflex.response.time_statistics import Statistics, statistics_of_all
from kaneflex.scene import Scene
from kaneflex.solve.initial import STATE, start_coordinates
from kaneflex.support.errors import SceneError, installed, told
from kaneflex.support.terminal import silent
from kaneflex.support.units import LARGEST

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from kaneflex.mechanism.energy import Energy
    from kaneflex.multibody.impacts import Impact
    from kaneflex.multibody.trajectory import CoupledTrajectory
    from kaneflex.response.sensors import Series
    from kaneflex.response.stresses import LinkStresses
    from kaneflex.solve.error_estimates import ErrorEstimate
    from kaneflex.support.labelled import Labelled

PLOTS = "mechanism,sensors,loads"
"""Kinds of pictures that a run draws by default."""
MOST_FREQUENCIES = 50
"""Largest number of natural frequencies of a run: more would take longer than the run."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A finished run.

    Attributes
    ----------
    model : Model
    trajectory : Trajectory or CoupledTrajectory
        Integrated coordinates at the stored times; CoupledTrajectory under preset ``coupled``.
    seconds : float
        Wall time of the run.
    whole : Solution or None
        The complete run, if this is a part of it made by :meth:`at`.
    """

    model: Model
    trajectory: Trajectory | CoupledTrajectory
    seconds: float
    whole: Solution | None = None

    def __repr__(self) -> str:
        return f"Solution({self.model.in_short}, {self.outcome.name.lower()}, {len(self.times)} instants)"

    def _repr_html_(self) -> str:
        """Table for notebooks: warnings, then every sensor's extremes in SI with error estimates."""
        from kaneflex.support.html import shown

        off, _ = self.errors
        rows = []
        for name, series in self.series.items():
            found = self.statistics(name)
            numbers = (found.min, found.max, found.mean, found.rms)
            rows.append((name, series.unit, *map(float, numbers), float(off[name].total) if name in off else ""))
        head = ("sensor", "unit", "min", "max", "mean", "rms", "+-")
        stopped = () if self.outcome is Outcome.COMPLETED else (self.message,)
        return shown(repr(self), head, rows, (*stopped, *self.warnings))

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the scene, from which the model is loaded again."""
        return _restored, (self.model.given, self.trajectory, self.seconds, self.whole)

    def __iter__(self) -> Iterator[str]:
        """Names of the sensors."""
        return iter(self.series)

    def __len__(self) -> int:
        """Number of sensors."""
        return len(self.series)

    def __bool__(self) -> bool:
        """True, also without sensors."""
        return True

    def keys(self) -> KeysView[str]:
        """Names of the sensors, including ``NAME_rigid``, so that ``dict(solution)`` has their series."""
        return self.series.keys()

    @property
    def times(self) -> np.ndarray:
        """Stored instants [s], shape (n_times,)."""
        return self.trajectory.times

    @property
    def outcome(self) -> Outcome:
        """Outcome of the run."""
        return self.trajectory.outcome

    @property
    def message(self) -> str:
        """Outcome of the run in words, with time and reason if it stopped early."""
        return self.trajectory.message

    @property
    def energy(self) -> Energy | None:
        """Energies [J] at the steps and the error of their balance, for free joints or preset ``coupled``; else None,
        as the drives' motion is not integrated."""
        return self.motion.energy

    @property
    def multipliers(self) -> np.ndarray | None:
        """Floquet multipliers of a periodic motion (2 n,), by decreasing modulus; None if not known."""
        own = self.trajectory
        return own.multipliers if isinstance(own, Trajectory) else own.floquet

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the model, then of the run; those of the complete run for a part of it."""
        if self.whole is not None:
            return self.whole.warnings
        from kaneflex.solve.validity import validity_warnings

        return (*self.model.warnings, *validity_warnings(self, self.frequencies))

    @property
    def errors(self) -> tuple[Mapping[str, ErrorEstimate], str]:
        """Error estimates by sensor, and the reason if they are missing."""
        return self.estimated()

    def estimated(
        self, progress: Callable[[float], None] | None = None
    ) -> tuple[Mapping[str, ErrorEstimate], str]:
        """Same as :attr:`errors`; at the first call ``progress`` is called with the finished share, 0 to 1."""
        if "_errors" not in vars(self):
            from kaneflex.solve.error_estimates import error_estimates

            vars(self)["_errors"] = error_estimates(self, progress or silent)
        found: tuple[Mapping[str, ErrorEstimate], str] = vars(self)["_errors"]
        return found

    @cached_property
    def frequencies(self) -> tuple[float, ...]:
        """Natural frequencies at ``solve.mode_angle`` [Hz], ascending, at most MOST_FREQUENCIES."""
        return natural_frequencies(self.model)

    @cached_property
    def rigid(self) -> RigidMotion:
        """Rigid motion at the stored times."""
        return self.model.motion.at(self.times)

    @property
    def motion(self) -> Motion:
        """Motion for sensors, events and pictures; it caches its results, so request it once."""
        whole = None if self.whole is None else self.whole.motion
        if self.model.coupled is not None:
            from kaneflex.response.coupled_motion import CoupledMotion

            return CoupledMotion(self.model, self.rigid, self.trajectory, whole=whole)
        if self.model.coupled_in_space is not None:
            from kaneflex.response.spatial_coupled_motion import SpatialCoupledMotion

            return SpatialCoupledMotion(self.model, self.rigid, whole=whole)
        series = (self.trajectory.z.T, self.trajectory.v.T, self.trajectory.a.T)
        basis = self.model.modal_basis
        coordinates = series if basis is None else tuple(basis @ part for part in series)
        return elastic_motion(self.model, self.rigid, coordinates, whole=whole)

    @cached_property
    def coordinates(self) -> Rates:
        """Coordinates z, z', z'' of the mechanism, each (n, n_times)."""
        return self.motion.coordinates

    def state(self, instant: int = -1) -> dict[str, dict[str, float]]:
        """Coordinates and rates at a stored instant, by default the last one, in the form of ``solve.start``.

        Parameters
        ----------
        instant : int
            Index in ``times``.

        Returns
        -------
        dict
            ``displacements`` and ``velocities``: coordinate -> number in SI.
        """
        names, moved = start_coordinates(self.model), self.motion.state
        # too small for a scene, and for a run the same as zero
        numbers = ([0.0 if abs(x) < 1.0 / LARGEST else float(x) for x in part[:, instant]] for part in moved)
        return {key: dict(zip(names, part, strict=True)) for key, part in zip(STATE, numbers, strict=True)}

    def at(self, times: np.ndarray) -> Solution:
        """The same motion at other instants within the run (dense output).

        Coordinates follow the quintic through the stored displacements, velocities and accelerations; under preset
        ``coupled`` they are projected onto the constraints, and accelerations and reactions are computed again.

        Parameters
        ----------
        times : array_like (n_times,)
            Instants [s] from the first to the last stored one.

        Raises
        ------
        ValueError
            For instants outside the run.
        """
        times = np.atleast_1d(np.asarray(times, dtype=float))
        first, last = (self.times[0], self.times[-1]) if len(self.times) > 1 else (np.nan, np.nan)
        if not ((times >= first) & (times <= last)).all():
            asked = f"{times.min():.9g} to {times.max():.9g} s"
            raise ValueError(f"instants from {asked} are outside the run, {first:.9g} to {last:.9g} s")
        if self.model.coupled is not None:
            from kaneflex.multibody.dense_output import between

            return replace(self, trajectory=between(self.model.coupled, self.trajectory, times), whole=self)
        return replace(self, trajectory=self.trajectory.at(times), whole=self)

    @cached_property
    def events(self) -> dict[str, np.ndarray]:
        """Times of every event of the scene [s]."""
        from kaneflex.solve.events import find_events

        return find_events(self)

    @property
    def impacts(self) -> tuple[Impact, ...]:
        """Impacts of contacts, by their ends; those that last at the end of the run come last."""
        record = getattr(self.trajectory, "contacts", None)
        return () if record is None else record.impacts

    @cached_property
    def series(self) -> dict[str, Series]:
        """Values of every sensor with unit and meaning, companions ``NAME_rigid`` included.

        Raises SceneError if a completed run has a value that is not finite. Under preset coupled the mechanism may pass
        positions where its rigid reference does not close; readings relative to that are NaN.
        """
        from kaneflex.response.sensors import measure

        measured = measure(self.motion)
        strict = self.outcome is Outcome.COMPLETED and self.model.coupled is None
        for name, series in measured.items() if strict else ():
            lost = ~np.isfinite(series.values)
            if lost.any():
                raise SceneError(
                    f"sensors.{name.removesuffix('_rigid')}", None,
                    f"it has no finite value at t = {self.times[lost.argmax()]:.6g} s",
                    "Check the numbers that make it so large, or leave the sensor out",
                )  # fmt: skip
        return measured

    @cached_property
    def stresses(self) -> dict[str, LinkStresses]:
        """Stresses of every elastic link with section shapes, at the stored times."""
        from kaneflex.response.stresses import stresses_of

        return stresses_of(self.motion)

    def keep(self, measured: dict[str, Series]) -> None:
        """Store series read elsewhere as :attr:`series`; all values must be finite."""
        vars(self)["series"] = measured

    def statistics(self, name: str) -> Statistics:
        """Minimum, maximum, mean and root mean square of a series of :attr:`series` over the stored times.

        The maximum of a contact's force or torque includes the peaks of impacts between stored times, assigned to the
        nearest stored time. Raises ValueError if the run stopped before its first instant.
        """
        if not len(self.times):
            raise ValueError(f"{name} has no values: {self.message}")
        found = self._statistics[name]
        if not self.impacts:
            return found
        sensor = self.model.scene.sensors.get(name)
        contact = sensor and (sensor.contact_force or sensor.contact_torque)
        own = [impact for impact in self.impacts if impact.contact == contact]
        hardest = max(own, key=lambda impact: impact.peak, default=None)
        if hardest is None or hardest.peak <= found.max:
            return found
        return found._replace(max=hardest.peak, at_max=int(np.abs(self.times - hardest.begin).argmin()))

    @cached_property
    def _statistics(self) -> dict[str, Statistics]:
        """Statistics of every series, without impacts."""
        return statistics_of_all({name: each.values for name, each in self.series.items()}, self.times)

    @property
    def drive_angles(self) -> dict[str, np.ndarray]:
        """Coordinate of each drive at the stored times [rad or m]."""
        return {drive: self.rigid[f"{drive}.angle"] for drive in self.model.scene.drives}

    @cached_property
    def labelled(self) -> Labelled:
        """All sensors as labelled arrays; see :mod:`kaneflex.solve.results`."""
        from kaneflex.solve.results import labelled

        return labelled(self)

    @cached_property
    def dataset(self) -> xarray.Dataset:
        """All sensors as one labelled dataset; see :mod:`kaneflex.solve.results`."""
        return self.labelled.dataset()

    def to_xarray(self) -> xarray.Dataset:
        """Same as :attr:`dataset`, by the name that pandas uses."""
        return self.dataset

    def to_netcdf(self, path: Path | str) -> None:
        """Write all sensors with their units as a run's results.nc."""
        self.labelled.to_netcdf(Path(path))

    def to_csv(self, path: Path | str) -> None:
        """Write all sensors over time as a run's results.csv."""
        self.labelled.to_csv(Path(path), along="time")

    @overload
    def plot(self, kinds: str = PLOTS, folder: None = None) -> dict[str, Figure]: ...
    @overload
    def plot(self, kinds: str = PLOTS, *, folder: Path | str) -> list[Path]: ...
    def plot(self, kinds: str = PLOTS, folder: Path | str | None = None) -> dict[str, Figure] | list[Path]:
        """Figures of these kinds by name, or their files where a folder is given; see :func:`kaneflex.draw_all`."""
        import kaneflex  # pictures and reports are layers above

        if folder is None:
            return kaneflex.figures(self, kinds)
        return kaneflex.draw_all(self, folder, kinds=kinds)

    def report(self, folder: Path | str) -> Path:
        """Write report.html of a run with its pictures into a folder; returns its path."""
        import kaneflex

        return kaneflex.write_report(self, folder, self.plot(folder=folder))

    def to_dataframe(self) -> pandas.DataFrame:
        """Sensors as columns over ``time`` [s]; ``attrs`` has their units by name."""
        values = {name: series.values for name, series in self.series.items()}
        with told("to_dataframe", None), installed("pandas", "tables", "pandas"):
            import pandas
        frame = pandas.DataFrame(values, index=pandas.Index(self.times, name="time"))
        frame.attrs["units"] = {name: series.unit for name, series in self.series.items()}
        return frame

    def __getitem__(self, sensor: str) -> xarray.DataArray:
        """One sensor as a labelled array over ``time`` [s].

        Raises
        ------
        KeyError
            For an unknown sensor; names the nearest one.
        ValueError
            If the run stopped before its first instant.
        """
        if sensor not in self.series:
            from kaneflex.support.errors import nearest

            raise KeyError(f"no sensor {sensor!r}. {nearest(sensor, self.series)}.")
        if not len(self.times):
            raise ValueError(f"{sensor} has no values: {self.message}")
        return self.dataset[sensor]


def _restored(
    scene: Scene, trajectory: Trajectory | CoupledTrajectory, seconds: float, whole: Solution | None
) -> Solution:
    """Solution from its pickled parts."""
    from kaneflex.solve.free_motion import integrated
    from kaneflex.solve.loading import load

    model = integrated(load(scene))
    if isinstance(trajectory, Trajectory):
        return Solution(model, trajectory, seconds, whole)
    from kaneflex.solve.coupled import as_solution

    return replace(as_solution(model, trajectory, seconds), whole=whole)


def natural_frequencies(model: Model) -> tuple[float, ...]:
    """Natural frequencies at ``solve.mode_angle`` [Hz], ascending, at most MOST_FREQUENCIES."""
    from kaneflex.multibody.building import has_modes, reference_modes

    count = min(model.equations.size, MOST_FREQUENCIES) if has_modes(model) else 0
    omega = reference_modes(model, count)[0] if count else ()
    return tuple(float(value) / (2.0 * math.pi) for value in omega)
