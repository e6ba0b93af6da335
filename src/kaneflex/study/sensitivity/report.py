"""Derivatives of every sensor of a run, over time and of its extremes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.response.time_statistics import mean_over_time
from kaneflex.scene import Scene
from kaneflex.scene.contact_check import refuse_contacts
from kaneflex.scene.options import resolve_options
from kaneflex.solve.solution import Solution
from kaneflex.study.sensitivity.parameters import Parameter, find_parameters
from kaneflex.study.sensitivity.slopes import differentiated
from kaneflex.study.sensitivity.tables import ParameterSensitivity, SensorDerivative
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, refuse
from kaneflex.support.labelled import Labelled

if TYPE_CHECKING:
    import xarray

DYNAMICS = ("dynamic", "quasistatic", "coupled")
"""What can be differentiated; so named in kaneflex.scene.options."""
_NOTHING = 1e-9
"""Share of a sensor's largest value that a slope must reach somewhere, or the sensors don't depend on the parameter."""


@dataclass(frozen=True, eq=False)
class Derivative:
    """dy/dp of one sensor: what it is, its values over the stored times (n_times,), and of the statistics."""

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
        Whether the modal bases were kept.
    slopes : mapping of str to mapping of str to ndarray
        Parameter's name -> sensor -> p dy/dp over the stored times, (n_times,), in the sensor's unit. Of a parameter
        that stretches the cycle they are taken at a fixed share of it: at a fixed angle of the drive.
    """

    solution: Solution
    parameters: tuple[Parameter, ...]
    frozen: bool
    slopes: Mapping[str, Mapping[str, np.ndarray]]

    def series(self, parameter: Parameter, sensor: str) -> np.ndarray:
        """dy/dp over the stored times, (n_times,), in the sensor's unit over the parameter's."""
        return self.slopes[parameter.name][sensor] / parameter.value

    def unit(self, parameter: Parameter, sensor: str) -> str:
        """Unit of the derivative: "m/Pa", "N/(kg/m^3)"."""
        own = self.solution.series[sensor].unit
        by = parameter.unit
        return own if by == "1" else f"{own}/({by})" if set(by) & set(" /") else f"{own}/{by}"

    def of(self, parameter: Parameter, sensor: str) -> SensorDerivative:
        """Derivatives of the smallest, largest, rms and mean value."""
        y, slope = self.solution.series[sensor].values, self.slopes[parameter.name][sensor]
        times = self.solution.times
        rms = np.sqrt(mean_over_time(y**2, times))
        values = {"min": y.min(), "max": y.max(), "rms": rms, "mean": mean_over_time(y, times)}
        # an extreme moves along the curve, where the curve is flat: its value changes as the curve does there
        slopes = {"min": slope[np.argmin(y)], "max": slope[np.argmax(y)], "mean": mean_over_time(slope, times)}
        slopes["rms"] = mean_over_time(y * slope, times) / rms if rms else 0.0
        plain = {key: float(value / parameter.value) for key, value in slopes.items()}
        logarithmic = {f"log_{key}": float(slopes[key] / value) if value else None for key, value in values.items()}
        return SensorDerivative(unit=self.unit(parameter, sensor), **plain, **logarithmic)

    def peak(self, parameter: Parameter, sensor: str) -> float | None:
        """By how many per cent a sensor's largest magnitude grows with one per cent; None where that is zero."""
        y, of = self.solution.series[sensor].values, self.of(parameter, sensor)
        return of.log_max if abs(y.max()) >= abs(y.min()) else of.log_min

    def summary(self) -> dict[str, ParameterSensitivity]:
        """What ``summary.json`` holds: parameter's name -> value, unit and the derivatives by sensor."""
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

        The coordinates of the run's own; a variable ``d_SENSOR_d_PARAMETER`` for each sensor and parameter, with
        ``units``, ``long_name`` and the parameter's ``value`` in SI.
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
        Keep the modal bases; else they follow the parameter, where modes are used at all.
    progress : callable, optional
        Called with the finished share of the work, 0 to 1.

    Raises
    ------
    SceneError
        For a run that can't be differentiated, and for a path that is no number or changes no sensor.
    """
    model = solution.model
    check_differentiable(model.scene, continued=solution.whole is None and solution.times[0] != 0.0)
    if solution.outcome is not Outcome.COMPLETED or solution.whole is not None:
        reason = "only a whole run that was completed can be differentiated"
        raise SceneError("sensitivities", solution.outcome.name.lower(), reason, "Differentiate what simulate gave")
    parameters = find_parameters(model.scene, names)
    slopes = {}
    for parameter, found in differentiated(solution, parameters, frozen):
        _demand_some(solution, parameter, found)
        slopes[parameter.name] = found
        if progress is not None:
            progress(len(slopes) / len(parameters))
    return Sensitivities(solution, parameters, frozen, {each.name: slopes[each.name] for each in parameters})


def check_differentiable(scene: Scene, continued: bool) -> None:
    """Raise SceneError for a run that can't be differentiated, with the entry.

    ``continued`` tells whether it goes on from the last state of another one.
    """
    refuse(
        (continued, "after", None, "how the state that a run continues from follows the parameter is not known",
         "Differentiate a run from its start"),
    )  # fmt: skip
    options = resolve_options(scene)
    refuse(
        (options.dynamics not in DYNAMICS, "solve.preset", options.preset, "its sensors can't be differentiated",
         "Take preset linear, stiffened, quasistatic or coupled, with a body that has a beam"),
        (options.start == "given", "solve.start", "a table of a state",
         "how a given state follows the parameter is not known", "Start from zero, quasistatic or periodic"),
    )  # fmt: skip
    refuse_contacts(
        scene, "sensitivities", None, "the instants of the impacts would move with the parameter", "Leave it out"
    )
    coupled = options.dynamics == "coupled"
    for name in scene.loads:
        law = scene.law(name)
        turning = None if law is None else law.kinks() if coupled else law.jumps()
        refuse(
            (turning is not None, f"loads.{name}.law", scene.loads[name].law,
             f"the instants at which {turning} {'turns' if coupled else 'jumps'} would move with the parameter",
             "Write a law without, like sqrt(x**2 + small**2) for abs(x)"),
        )  # fmt: skip
    free = next((name for name, drive in scene.drives.items() if drive.free), None)
    stopping = next((name for name, event in scene.events.items() if event.stop), None)
    refuse(
        (options.integrator == "scipy", "solve.integrator", "scipy",
         "what it does within a step has no derivative here", "Take gauss or radau"),
        (free is not None and not coupled, f"drives.{free}.free", True,
         "a motion that follows the forces is differentiated with the links it moves",
         "Take preset coupled, or give the drive a speed, a law or a table"),
        (stopping is not None, f"events.{stopping}.stop", True,
         "the end of the run would move with the parameter", "Leave stop out"),
    )  # fmt: skip


def _demand_some(solution: Solution, parameter: Parameter, slopes: Mapping[str, np.ndarray]) -> None:
    largest = {sensor: abs(series.values).max(initial=0.0) for sensor, series in solution.series.items()}
    if not any(abs(slopes[sensor]).max(initial=0.0) > _NOTHING * size for sensor, size in largest.items()):
        raise SceneError(
            parameter.name, parameter.value, "no sensor depends on it", "Give another parameter, or add a sensor"
        )
