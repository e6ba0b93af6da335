"""Derivatives of all sensors of a run over time, and of their extremes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.response.time_statistics import mean_over_time
from kaneflex.scene import Scene
from kaneflex.scene.option_check import refuse_contacts
from kaneflex.scene.options import resolve_options
from kaneflex.solve.solution import Solution
from kaneflex.solve.summary_tables import ParameterSensitivity, SensorDerivative
from kaneflex.study.differences import rounding_levels
from kaneflex.study.sensitivity.parameters import Parameter, find_parameters
from kaneflex.study.sensitivity.slopes import differentiated
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, refuse
from kaneflex.support.labelled import Labelled

if TYPE_CHECKING:
    import xarray

DYNAMICS = ("dynamic", "quasistatic", "coupled")
"""Kinds of dynamics that can be differentiated, as in kaneflex.scene.options."""
_NOTHING = 1e-9
"""Share of a sensor's largest value below which a slope counts as zero."""


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivative dy/dp of one sensor: meaning, values over the stored times (n_times,), and those of the statistics."""

    parameter: Parameter
    meaning: str
    values: np.ndarray
    of: SensorDerivative


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of a run's sensors.

    Attributes
    ----------
    solution : Solution
        The run.
    parameters : tuple of Parameter
    frozen : bool
        Whether the modal bases were kept fixed.
    slopes : mapping of str to mapping of str to ndarray
        Parameter's name -> sensor -> p dy/dp over the stored times, (n_times,), in the sensor's unit. If the
        parameter changes the cycle's duration, derivatives are taken at a fixed angle of the drive.
    """

    solution: Solution
    parameters: tuple[Parameter, ...]
    frozen: bool
    slopes: Mapping[str, Mapping[str, np.ndarray]]

    def __repr__(self) -> str:
        return f"Sensitivities({self.solution.model.in_short}, by {', '.join(self.slopes)})"

    def series(self, parameter: Parameter, sensor: str) -> np.ndarray:
        """Derivative dy/dp over the stored times, (n_times,), in the sensor's unit divided by the parameter's."""
        return self.slopes[parameter.name][sensor] / parameter.value

    def unit(self, parameter: Parameter, sensor: str) -> str:
        """Unit of the derivative: "m/Pa", "N/(kg/m^3)"."""
        own = self.solution.series[sensor].unit
        by = parameter.unit
        return own if by == "1" else f"{own}/({by})" if set(by) & set(" /") else f"{own}/{by}"

    @cached_property
    def _levels(self) -> dict[str, float]:
        """Unit -> level of rounding error."""
        series = self.solution.series
        return rounding_levels(self.solution.model.scene, {name: each.values for name, each in series.items()})

    def of(self, parameter: Parameter, sensor: str) -> SensorDerivative:
        """Derivatives of the smallest, largest, rms and mean value; relative ones only above rounding error."""
        y, slope = self.solution.series[sensor].values, self.slopes[parameter.name][sensor]
        times = self.solution.times
        rms = np.sqrt(mean_over_time(y**2, times))
        values = {"min": y.min(), "max": y.max(), "rms": rms, "mean": mean_over_time(y, times)}
        # the slope is zero at an extreme: its shift in time does not change its value to first order
        slopes = {"min": slope[np.argmin(y)], "max": slope[np.argmax(y)], "mean": mean_over_time(slope, times)}
        slopes["rms"] = mean_over_time(y * slope, times) / rms if rms else 0.0
        plain = {key: float(value / parameter.value) for key, value in slopes.items()}
        least = self._levels.get(self.solution.series[sensor].unit, 0.0)
        known = {key: value if abs(value) > least else None for key, value in values.items()}
        logarithmic = {f"log_{key}": float(slopes[key] / value) if value else None for key, value in known.items()}
        return SensorDerivative(unit=self.unit(parameter, sensor), **plain, **logarithmic)

    def peak(self, parameter: Parameter, sensor: str) -> float | None:
        """Per cent by which a sensor's largest magnitude grows if the parameter grows by 1 %; None if rounding."""
        y, of = self.solution.series[sensor].values, self.of(parameter, sensor)
        return of.log_max if abs(y.max()) >= abs(y.min()) else of.log_min

    def summary(self) -> dict[str, ParameterSensitivity]:
        """Entries of ``summary.json``: parameter's name -> value, unit and the derivatives by sensor."""
        return {
            parameter.name: ParameterSensitivity(
                value=parameter.value,
                unit=parameter.unit,
                sensors={sensor: self.of(parameter, sensor) for sensor in self.slopes[parameter.name]},
            )
            for parameter in self.parameters
        }

    def named(self) -> dict[str, Derivative]:
        """All derivatives by their names in datasets, ``d_SENSOR_d_PARAMETER``."""
        return {
            f"d_{sensor}_d_{parameter.name}": Derivative(
                parameter,
                f"derivative of {sensor} with respect to {parameter.name}",
                self.series(parameter, sensor),
                self.of(parameter, sensor),
            )
            for parameter in self.parameters
            for sensor in self.slopes[parameter.name]
        }

    @property
    def labelled(self) -> Labelled:
        """All derivatives over time.

        A variable ``d_SENSOR_d_PARAMETER`` for each sensor and parameter, with ``units``, ``long_name`` and the
        parameter's ``value`` in SI, over the coordinates of the run.
        """
        variables = {}
        for name, derivative in self.named().items():
            about = {"units": derivative.of.unit, "long_name": derivative.meaning, "value": derivative.parameter.value}
            variables[name] = ("time", derivative.values, about)
        run = self.solution.labelled
        basis = {"modal_basis": "frozen" if self.frozen else "recomputed"}
        return Labelled(variables, run.coordinates, {**run.attributes, **basis})

    @cached_property
    def dataset(self) -> xarray.Dataset:
        """:attr:`labelled` as one labelled dataset."""
        return self.labelled.dataset()


@takes(solution="solution", names="texts", progress="function")
def sensitivities(
    solution: Solution, names: Sequence[str], frozen: bool = True, progress: Callable[[float], None] | None = None
) -> Sensitivities:
    """Differentiate every sensor of a finished run with respect to numbers of its scene.

    Parameters
    ----------
    solution : Solution
        From :func:`kaneflex.simulate`, under preset linear, stiffened, quasistatic or coupled.
    names : sequence of str
        Paths of the scene like "rod.E" or "drives.main.speed".
    frozen : bool
        Keep the modal bases fixed, else recompute them for each value of the parameter.
    progress : callable, optional
        Called with the finished share of the work, 0 to 1.

    Raises
    ------
    SceneError
        If the run can't be differentiated, or a path is not a number or changes no sensor.
    """
    model = solution.model
    check_differentiable(model.scene, continued=solution.whole is None and solution.times[0] != 0.0)
    if solution.outcome is not Outcome.COMPLETED or solution.whole is not None:
        reason = "only a complete run can be differentiated"
        raise SceneError("sensitivities", solution.outcome.name.lower(), reason, "Use the solution of simulate")
    parameters = find_parameters(model.scene, names)
    slopes = {}
    for parameter, found in differentiated(solution, parameters, frozen):
        _demand_some(solution, parameter, found)
        slopes[parameter.name] = found
        if progress is not None:
            progress(len(slopes) / len(parameters))
    return Sensitivities(solution, parameters, frozen, slopes)


def check_differentiable(scene: Scene, continued: bool) -> None:
    """Raise SceneError for a run that can't be differentiated, with the entry.

    ``continued``: whether it starts from the last state of another run.
    """
    refuse(
        (continued, "after", None, "the initial state comes from another run, and its derivative is not known",
         "Differentiate a run from its start"),
    )  # fmt: skip
    options = resolve_options(scene)
    refuse(
        (options.dynamics not in DYNAMICS, "solve.preset", options.preset, "sensors can't be differentiated with it",
         "Use preset linear, stiffened, quasistatic or coupled, with a body that has a beam"),
        (options.start == "given", "solve.start", "a table of a state",
         "the derivative of a given initial state is not known", "Start from zero, quasistatic or periodic"),
    )  # fmt: skip
    refuse_contacts(
        scene, "sensitivities", None, "the instants of impacts depend on the parameter", "Leave it out"
    )
    coupled = options.dynamics == "coupled"
    for name in scene.loads:
        law = scene.law(name)
        turning = None if law is None else law.kinks() if coupled else law.jumps()
        refuse(
            (turning is not None, f"loads.{name}.law", scene.loads[name].law,
             f"the instants at which {turning} {'has a kink' if coupled else 'jumps'} depend on the parameter",
             "Use a smooth law, for example sqrt(x**2 + small**2) for abs(x)"),
        )  # fmt: skip
    free = next(iter(scene.free_joints), None)
    stopping = next((name for name, event in scene.events.items() if event.stop), None)
    refuse(
        (free is not None and not coupled, f"drives.{free}.free", True,
         "a free drive can be differentiated under preset coupled only",
         "Use preset coupled, or give the drive a speed, a law or a table"),
        (stopping is not None, f"events.{stopping}.stop", True,
         "the end of the run depends on the parameter", "Leave stop out"),
    )  # fmt: skip


def _demand_some(solution: Solution, parameter: Parameter, slopes: Mapping[str, np.ndarray]) -> None:
    largest = {sensor: abs(series.values).max(initial=0.0) for sensor, series in solution.series.items()}
    if not any(abs(slopes[sensor]).max(initial=0.0) > _NOTHING * size for sensor, size in largest.items()):
        raise SceneError(
            parameter.name, parameter.value, "no sensor depends on it", "Choose another parameter, or add a sensor"
        )
