"""Solution of a scene: a run with its warnings, error estimates and labelled results."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np

from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.solve.run_result import RunResult
from kaneflex.support.errors import installed, naming
from kaneflex.support.labelled import Entry, Labelled
from kaneflex.support.terminal import silent

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import pandas
    import xarray
    from matplotlib.figure import Figure

    from kaneflex.multibody.time.trajectory import CoupledTrajectory
    from kaneflex.scene import Scene
    from kaneflex.solve.error_estimates import ErrorEstimate

PLOTS = "mechanism,sensors,loads"
"""Kinds of pictures that a run draws by default."""


class Solution(RunResult):
    """A finished run: motion, sensors, warnings and error estimates."""

    @classmethod
    def of(cls, run: RunResult) -> Solution:
        """Solution of a run."""
        return cls(run.model, run.trajectory, run.seconds, None if run.whole is None else cls.of(run.whole))

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

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the model, then of the run; a part of a run has those of the complete run."""
        if isinstance(self.whole, Solution):
            return self.whole.warnings
        from kaneflex.solve.validity import validity_warnings

        return (*self.model.warnings, *validity_warnings(self, self.frequencies))

    @property
    def errors(self) -> tuple[Mapping[str, ErrorEstimate], str]:
        """Error estimates by sensor, and the reason if they are missing."""
        return self.estimated()

    def estimated(self, progress: Callable[[float], None] | None = None) -> tuple[Mapping[str, ErrorEstimate], str]:
        """Same as :attr:`errors`; at the first call ``progress`` is called with the finished share, 0 to 1."""
        if "_errors" not in vars(self):
            from kaneflex.solve.error_estimates import error_estimates

            vars(self)["_errors"] = error_estimates(self, progress or silent)
        found: tuple[Mapping[str, ErrorEstimate], str] = vars(self)["_errors"]
        return found

    def judge(self, shares: Mapping[str, float]) -> None:
        """Store errors that a comparison with a richer run found, as shares of the sensors' peaks, as :attr:`errors`,
        unless these are estimated already."""
        from kaneflex.solve.error_estimates import ErrorEstimate

        sizes = {name: share * float(abs(self.series[name].values).max()) for name, share in shares.items()}
        found = {name: ErrorEstimate(size, None, None, None, None) for name, size in sizes.items()}
        vars(self).setdefault("_errors", (found, ""))

    @cached_property
    def events(self) -> dict[str, np.ndarray]:
        """Times of every event of the scene [s]."""
        if not self.model.scene.events:
            return {}
        from kaneflex.solve.events import find_events

        return find_events(self)

    @cached_property
    def labelled(self) -> Labelled:
        """All sensors as labelled arrays; see :func:`labelled`."""
        return labelled(self)

    @cached_property
    def dataset(self) -> xarray.Dataset:
        """All sensors as one labelled dataset; see :func:`labelled`."""
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
        with naming("to_dataframe", None), installed("pandas", "tables", "pandas"):
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
    from kaneflex.solve.loading import integrated, load

    model = load(scene)
    if isinstance(trajectory, Trajectory):
        return Solution(integrated(model), trajectory, seconds, whole)
    from kaneflex.solve.coupled import result_of

    trajectory = replace(trajectory, curve=trajectory.curve.of(model.coupled_system))
    return replace(Solution.of(result_of(model, trajectory, seconds)), whole=whole)


def labelled(solution: RunResult) -> Labelled:
    """All sensors of a solution as labelled arrays.

    Parameters
    ----------
    solution : RunResult

    Returns
    -------
    Labelled
        Dimension ``time`` [s]; coordinate ``drive_angle_<drive>`` [degree] for each drive, continued over cycles, or
        ``drive_position_<drive>`` [m] of a guide; a variable for each sensor, and ``NAME_rigid`` for forces, with CF
        ``units`` and ``long_name``. Coupled runs also have dimension ``state``, the names of its coordinates, with
        ``last_state`` and ``last_rate`` at the last time; those with contacts dimensions ``contact`` and ``impact``,
        those with friction ``friction``, see :mod:`kaneflex.solve.touching`.

        Attributes describe the scene and the outcome; none depends on the machine or the clock.
    """
    import kaneflex

    model = solution.model
    coordinates: dict[str, Entry] = {"time": ("time", solution.times, {"units": "s", "long_name": "time", "axis": "T"})}
    for drive, angle in solution.drive_angles.items():
        if model.scene.slides(drive):
            attributes = {"units": "m", "long_name": f"position of the drive {drive}"}
            coordinates[f"drive_position_{drive}"] = ("time", angle, attributes)
            continue
        attributes = {"units": "degree", "long_name": f"angle of the drive {drive}"}
        coordinates[f"drive_angle_{drive}"] = ("time", np.degrees(angle), attributes)
    variables: dict[str, Entry] = {
        name: ("time", series.values, {"units": series.unit, "long_name": series.meaning})
        for name, series in solution.series.items()
    }
    if model.options.dynamics == "coupled" and len(solution.times):
        coordinates["state"], more = _last_state(solution)
        variables |= more
    if len(solution.times) and (model.scene.contacts or model.scene.frictions):
        from kaneflex.solve.touching import labelled_contacts, labelled_frictions

        for names, found in (labelled_contacts(solution), labelled_frictions(solution)):
            coordinates |= names
            variables |= found
    about = {
        "Conventions": "CF-1.11",
        "title": model.scene.description or model.scene.name,
        "source": f"kaneflex {kaneflex.__version__}",
        "scene": model.scene.name,
        "structure": model.motion.module.STRUCTURE,
        "preset": model.options.preset,
        "outcome": solution.outcome.name.lower(),
    }
    return Labelled(variables, coordinates, about)


def _last_state(solution: RunResult) -> tuple[tuple, dict[str, tuple]]:
    """Names of the coordinates, and their last values and rates, from which another run can continue."""
    state = solution.last_state()
    about = {"long_name": "coordinates at the last time", "units": "1", "comment": "m; rad where a name ends in phi"}
    return ("state", np.array(state.names), {"long_name": "coordinates of all bodies"}), {
        "last_state": ("state", state.q, about),
        "last_rate": ("state", state.v, about | {"long_name": "their rates at the last time"}),
    }
