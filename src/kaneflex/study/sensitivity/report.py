"""Derivatives of every sensor of a run, over time and of its extremes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.mechanism.rigid_motion import Motion
from kaneflex.response.sensors import measure
from kaneflex.response.time_statistics import mean_over_time
from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.solve.solution import Solution
from kaneflex.study.sensitivity.parameters import Parameter, find_parameters
from kaneflex.study.sensitivity.tables import ParameterSensitivity, SensorDerivative
from kaneflex.study.sensitivity.tangent import Tangent, own_cycle, tangent
from kaneflex.study.sensitivity.varied import SHARES, STEP, Varied, slope_of, vary
from kaneflex.support.errors import SceneError
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

    @property
    def dataset(self) -> xarray.Dataset:
        """:attr:`labelled` as one labelled dataset."""
        return self.labelled.dataset()


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
    differentiate, slopes = _coupled(solution, frozen) if model.coupled is not None else _linear(solution, frozen), {}
    for k, parameter in enumerate(parameters):
        slopes[parameter.name] = differentiate(parameter)
        _demand_some(solution, parameter, slopes[parameter.name])
        if progress is not None:
            progress((k + 1) / len(parameters))
    return Sensitivities(solution, parameters, frozen, slopes)


def _linear(solution: Solution, frozen: bool) -> Callable[[Parameter], dict[str, np.ndarray]]:
    """Parameter -> p dy/dp of every sensor, in a run of the elastic equations."""
    cycle = own_cycle(solution.model)

    def differentiate(parameter: Parameter) -> dict[str, np.ndarray]:
        varied = vary(solution.model, parameter, frozen)
        return _sensor_slopes(solution, varied, tangent(solution, varied, cycle))

    return differentiate


def _coupled(solution: Solution, frozen: bool) -> Callable[[Parameter], dict[str, np.ndarray]]:
    """The same in a run of the coupled ones."""
    from kaneflex.study.sensitivity.coupled import coupled_path, coupled_slopes

    path = coupled_path(solution)
    return lambda parameter: coupled_slopes(path, vary(solution.model, parameter, frozen, step=path.neighbour_step))


def check_differentiable(scene: Scene, continued: bool) -> None:
    """Raise SceneError for a run that can't be differentiated, naming what stands in the way.

    ``continued`` tells whether it goes on from the last state of another one.
    """
    if continued:
        raise SceneError(
            "after", None, "how the state that a run continues from follows the parameter is not known",
            "Differentiate a run from its start",
        )  # fmt: skip
    options = resolve_options(scene)
    if options.dynamics not in DYNAMICS:
        raise SceneError(
            "solve.preset", options.preset, "its sensors can't be differentiated",
            "Take preset linear, stiffened, quasistatic or coupled, with a body that has a beam",
        )  # fmt: skip
    if options.start == "given":
        raise SceneError(
            "solve.start", "a table of a state", "how a given state follows the parameter is not known",
            "Start from zero, quasistatic or periodic",
        )  # fmt: skip
    if options.integrator == "scipy":
        raise SceneError(
            "solve.integrator", "scipy", "what it does within a step has no derivative here",
            "Take gauss or generalised-alpha",
        )  # fmt: skip
    free = next((name for name, drive in scene.drives.items() if drive.free), None)
    if free is not None and options.dynamics != "coupled":
        raise SceneError(
            f"drives.{free}.free", True, "a motion that follows the forces is differentiated with the links it moves",
            "Take preset coupled, or give the drive a speed, a law or a table",
        )  # fmt: skip
    stopping = next((name for name, event in scene.events.items() if event.stop), None)
    if stopping is not None:
        raise SceneError(
            f"events.{stopping}.stop", True, "the end of the run would move with the parameter", "Leave stop out"
        )


@dataclass(frozen=True, eq=False)
class _Shifted(Motion):
    """The motion's scalars at the instants of one run, and at no others."""

    values: np.ndarray

    def table(self, times: np.ndarray) -> np.ndarray:
        return self.values


def _sensor_slopes(solution: Solution, varied: Varied, slope: Tangent) -> dict[str, np.ndarray]:
    """p dy/dp of every sensor: it is read from each neighbour's constants, with the motion moved along its slope."""
    times, trajectory = solution.times, solution.trajectory
    values, rates = varied.scalars(times)
    read = []
    for share, model in zip(SHARES, varied.neighbours, strict=True):
        step = share * STEP
        scalars = values + step * rates
        _turn(scalars, values, step * rates, model.motion.column)
        motion = _Shifted(model.motion.module, model.motion.parameters, scalars)
        moved = replace(
            trajectory,
            times=times * (model.step / varied.model.step),
            z=trajectory.z + step * slope.z,
            v=trajectory.v + step * slope.v,
            a=trajectory.a + step * slope.a,
        )
        read.append(measure(Solution(replace(model, motion=motion), moved, 0.0)))
    return {sensor: slope_of([series[sensor].values for series in read]) for sensor in read[0]}


def _turn(scalars: np.ndarray, values: np.ndarray, changes: np.ndarray, column: Mapping[str, int]) -> None:
    """Let cosines and sines turn by the change of their angle: along a straight line they leave the circle.

    Over a run of many turns the angle's change is large, however small that of the parameter.
    """
    for name in column:
        if not name.endswith(".c") or f"{name[:-1]}s" not in column:
            continue
        at = [column[name], column[f"{name[:-1]}s"]]
        (c, s), (c_change, s_change) = values[:, at].T, changes[:, at].T
        angle = c * s_change - s * c_change
        scalars[:, at] = np.stack([c * np.cos(angle) - s * np.sin(angle), s * np.cos(angle) + c * np.sin(angle)], 1)


def _demand_some(solution: Solution, parameter: Parameter, slopes: Mapping[str, np.ndarray]) -> None:
    largest = {sensor: abs(series.values).max(initial=0.0) for sensor, series in solution.series.items()}
    if not any(abs(slopes[sensor]).max(initial=0.0) > _NOTHING * size for sensor, size in largest.items()):
        raise SceneError(
            parameter.name, parameter.value, "no sensor depends on it", "Give another parameter, or add a sensor"
        )
