"""What a run gives: the motion of the mechanism's coordinates, and every sensor as a labelled series."""

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
"""Natural frequencies of a run at most: those of hundreds of elements take longer than the run."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A finished run.

    Attributes
    ----------
    model : Model
    trajectory : Trajectory or CoupledTrajectory
        Motion of what was integrated, at the stored times: the latter under preset ``coupled``.
    seconds : float
        Wall time of the run.
    whole : Solution or None
        The run that these instants were sampled from, by :meth:`at`.
    """

    model: Model
    trajectory: Trajectory | CoupledTrajectory
    seconds: float
    whole: Solution | None = None

    def __repr__(self) -> str:
        return f"Solution({self.model.in_short}, {self.outcome.name.lower()}, {len(self.times)} instants)"

    def _repr_html_(self) -> str:
        """In a notebook: warnings, then every sensor's extremes in SI with what they may be off by."""
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
        """Pickled with its scene, of which the model is loaded anew."""
        return _restored, (self.model.given, self.trajectory, self.seconds, self.whole)

    def __iter__(self) -> Iterator[str]:
        """The names of the sensors."""
        return iter(self.series)

    def __len__(self) -> int:
        """How many sensors there are."""
        return len(self.series)

    def __bool__(self) -> bool:
        """True, also without sensors."""
        return True

    def keys(self) -> KeysView[str]:
        """The names of the sensors, those of ``NAME_rigid`` included, so that ``dict(solution)`` has their series."""
        return self.series.keys()

    @property
    def times(self) -> np.ndarray:
        """Stored instants [s], shape (n_times,)."""
        return self.trajectory.times

    @property
    def outcome(self) -> Outcome:
        """How the run ended."""
        return self.trajectory.outcome

    @property
    def message(self) -> str:
        """How the run ended in words, with the time and the reason where it stopped early."""
        return self.trajectory.message

    @property
    def energy(self) -> Energy | None:
        """Energies [J] at the steps and what of their balance is missing, where joints are free or the preset is
        ``coupled``; else None, as the drives' motion is not integrated."""
        return self.motion.energy

    @property
    def multipliers(self) -> np.ndarray | None:
        """Floquet multipliers of a periodic motion (2 n,), by decreasing modulus; None where they are not known."""
        own = self.trajectory
        return own.multipliers if isinstance(own, Trajectory) else own.floquet

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What to know before trusting the numbers: of the model, then of the run; of all of it for a part of it."""
        if self.whole is not None:
            return self.whole.warnings
        from kaneflex.solve.validity import validity_warnings

        return (*self.model.warnings, *validity_warnings(self, self.frequencies))

    @property
    def errors(self) -> tuple[Mapping[str, ErrorEstimate], str]:
        """By sensor what its values may be off by, estimated, and why that is not known where it is not."""
        return self.estimated()

    def estimated(
        self, progress: Callable[[float], None] | None = None
    ) -> tuple[Mapping[str, ErrorEstimate], str]:
        """:attr:`errors`; the first time ``progress`` is called with the finished share of the work, 0 to 1."""
        if "_errors" not in vars(self):
            from kaneflex.solve.error_estimates import error_estimates

            vars(self)["_errors"] = error_estimates(self, progress or silent)
        found: tuple[Mapping[str, ErrorEstimate], str] = vars(self)["_errors"]
        return found

    @cached_property
    def frequencies(self) -> tuple[float, ...]:
        """Natural frequencies at ``solve.mode_angle`` [Hz], ascending, the MOST_FREQUENCIES lowest at most."""
        return natural_frequencies(self.model)

    @cached_property
    def rigid(self) -> RigidMotion:
        """The rigid motion at the stored times."""
        return self.model.motion.at(self.times)

    @property
    def motion(self) -> Motion:
        """What sensors, events and pictures read; it keeps what it computes, so that a reader asks for it once."""
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
        """z, z', z'' of the mechanism's coordinates, each of shape (n, n_times)."""
        return self.motion.coordinates

    def state(self, instant: int = -1) -> dict[str, dict[str, float]]:
        """The coordinates and their rates at a stored instant, the last one by default, as ``solve.start`` takes them.

        Parameters
        ----------
        instant : int
            Its number among ``times``.

        Returns
        -------
        dict
            ``displacements`` and ``velocities``: coordinate -> number in SI.
        """
        names, moved = start_coordinates(self.model), self.motion.state
        # what no scene can say, and no run can tell from zero
        numbers = ([0.0 if abs(x) < 1.0 / LARGEST else float(x) for x in part[:, instant]] for part in moved)
        return {key: dict(zip(names, part, strict=True)) for key, part in zip(STATE, numbers, strict=True)}

    def at(self, times: np.ndarray) -> Solution:
        """The same motion at other instants within the run (dense output).

        Coordinates follow the quintic through the stored displacements, velocities and accelerations; under preset
        ``coupled`` they are put onto the constraints, and accelerations and reactions computed anew.

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
            raise ValueError(f"instants from {asked} asked for, where the run has {first:.9g} to {last:.9g} s")
        if self.model.coupled is not None:
            from kaneflex.multibody.dense_output import between

            return replace(self, trajectory=between(self.model.coupled, self.trajectory, times), whole=self)
        return replace(self, trajectory=_between(self.trajectory, times), whole=self)

    @cached_property
    def events(self) -> dict[str, np.ndarray]:
        """Times of every event of the scene [s]."""
        from kaneflex.solve.events import find_events

        return find_events(self)

    @property
    def impacts(self) -> tuple[Impact, ...]:
        """What contacts did from closing to opening, by their ends, those that last at the end of the run last."""
        record = getattr(self.trajectory, "contacts", None)
        return () if record is None else record.impacts

    @cached_property
    def series(self) -> dict[str, Series]:
        """Every sensor's values with unit and meaning, companions ``NAME_rigid`` included.

        Raises SceneError where a run that came to its end has a value that left double precision on the way. Under
        preset coupled a mechanism may go where its rigid one doesn't close: what is measured against that has no value.
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
                    "Correct the numbers that make it so large, or leave the sensor out",
                )  # fmt: skip
        return measured

    @cached_property
    def stresses(self) -> dict[str, LinkStresses]:
        """Stresses of every elastic link whose sections have a shape, at the stored times."""
        from kaneflex.response.stresses import stresses_of

        return stresses_of(self.motion)

    def keep(self, measured: dict[str, Series]) -> None:
        """Take what someone else has read of the motion as its :attr:`series`: values that are finite everywhere."""
        vars(self)["series"] = measured

    def statistics(self, name: str) -> Statistics:
        """Least, greatest, mean and root mean square of a series of :attr:`series` over the stored times.

        The greatest of a contact's force or torque is that of its impacts, which may lie between stored times, at the
        nearest of them. Raises ValueError where a run stopped before its first instant.
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
        """Those of every series, impacts apart."""
        return statistics_of_all({name: each.values for name, each in self.series.items()}, self.times)

    @property
    def drive_angles(self) -> dict[str, np.ndarray]:
        """Each drive's coordinate at the stored times [rad or m]."""
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
        """:attr:`dataset`, by the name that pandas has for it."""
        return self.dataset

    def to_netcdf(self, path: Path | str) -> None:
        """Write all sensors with their units as results.nc of a run."""
        self.labelled.to_netcdf(Path(path))

    def to_csv(self, path: Path | str) -> None:
        """Write all sensors over time as results.csv of a run."""
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
        """The sensors as columns over ``time`` [s]; ``attrs`` holds their units by name."""
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
            For a name that is not a sensor; it names the nearest one.
        ValueError
            Where a run stopped before its first instant: it says why.
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
    """The solution that was pickled."""
    from kaneflex.solve.loading import load

    model = load(scene)
    if isinstance(trajectory, Trajectory):
        return Solution(model, trajectory, seconds, whole)
    from kaneflex.solve.coupled import as_solution

    return replace(as_solution(model, trajectory, seconds), whole=whole)


def _between(trajectory: Trajectory, times: np.ndarray) -> Trajectory:
    """The motion at other instants: the quintic through z, z', z'' of those that are stored."""
    from scipy.interpolate import BPoly

    knots = np.stack([trajectory.z, trajectory.v, trajectory.a], axis=1)
    if not knots.size:
        empty = np.zeros((len(times), 0))
        return replace(trajectory, times=times, z=empty, v=empty, a=empty)
    curve = BPoly.from_derivatives(trajectory.times, knots)
    z, v, a = curve(times), curve.derivative(1)(times), curve.derivative(2)(times)
    return replace(trajectory, times=times, z=z, v=v, a=a)


def natural_frequencies(model: Model) -> tuple[float, ...]:
    """Natural frequencies at ``solve.mode_angle`` [Hz], ascending, the MOST_FREQUENCIES lowest at most."""
    from kaneflex.multibody.building import has_modes, reference_modes

    count = min(model.equations.size, MOST_FREQUENCIES) if has_modes(model) else 0
    omega = reference_modes(model, count)[0] if count else ()
    return tuple(float(value) / (2.0 * math.pi) for value in omega)
