"""Slopes of a run's sensors along its parameters, from the runs of four neighbours each.

A slope is the logarithmic derivative p dx/dp, in the unit of x, at a fixed share of the cycle or of the run: the
difference quotient of fourth order, (x(-2h) - 8 x(-h) + 8 x(h) - x(2h)) / 12 h (Fornberg 1988, Math. Comp. 51).
Quantities that are equal in all neighbours have a slope of exactly zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import groupby

import numpy as np

from kaneflex.fem.links import mesh
from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.time.cycles import PlanarCycles
from kaneflex.multibody.time.planar_linear import PlanarEquations, prepare
from kaneflex.multibody.time.run import integrate
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.coupled import Start, as_result, beginning, method_of
from kaneflex.solve.loading import neighbour
from kaneflex.solve.quasistatic import mechanism_modes
from kaneflex.solve.run_result import RunResult
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution
from kaneflex.solve.variants import Solver, read
from kaneflex.study.sensitivity.parameters import Parameter
from kaneflex.support.errors import SceneError

_SOLVED = 1e-12
"""Tolerance of each step as a share of the mechanism's size: far below the differences between neighbours."""
_APART = 1e-2
"""Step of the differences along a state of the cycle's start, as a share of its range within the cycle."""
_SINGULAR = 1e14
"""Condition number beyond which the periodic solution is not isolated."""
Slopes = Mapping[str, np.ndarray]
"""Sensor -> p dy/dp over the stored times, (n_times,), in the sensor's unit."""
SHARES = (-2, -1, 1, 2)
"""Neighbours' positions in relative steps of the parameter."""
_STEP = 4e-4
"""First relative step between neighbours: truncation and rounding errors are then about equal for typical curves."""
_BENT = 2e-4
"""Largest difference of the quotients over one and two steps, as a share of the slope; the truncation error is about
ten times its square."""
_SMALLEST = 1e-7
"""Relative step below which rounding errors dominate."""
_QUIET = 1e-2
"""Share of a sensor's largest value that slopes are compared with if they are smaller."""


def differentiated(
    solution: Solution, parameters: Sequence[Parameter], frozen: bool
) -> Iterator[tuple[Parameter, Slopes]]:
    """Yield each parameter with its slopes; ``frozen``: modal bases are kept fixed.

    Steps are reduced until the quotients over one and two steps agree: a small change of a parameter may shift the
    phase of a long vibration by many radians.

    Raises
    ------
    SceneError
        If a neighbour has other equations or its run fails, or a quasi-static solution relies on inertia relief.
    """
    model = solution.model
    _refuse_relief(model, solution.times[0])
    solver: Solver = solve
    if model.coupled is not None:
        solver = Replay(solution)
    largest = {sensor: _largest(series.values) for sensor, series in solution.series.items()}
    steps = dict.fromkeys(parameters, _STEP)
    while steps:
        models = {
            (parameter, share): partial(neighbour_at, model, parameter, share * step, frozen)
            for parameter, step in steps.items()
            for share in SHARES
        }
        for parameter, four in groupby(read(models, _values, solver), key=lambda found: found[0][0]):
            at = [_demanded(values) for _, values in four]
            step = steps.pop(parameter)
            slopes = {sensor: slope([values[sensor] for values in at], step) for sensor in largest}
            bent = max(
                _largest(bend([values[sensor] for values in at], step))
                / max(_largest(slopes[sensor]), _QUIET * size, 1e-300)
                for sensor, size in largest.items()
            )
            if bent > _BENT and step > _SMALLEST:
                steps[parameter] = max(_SMALLEST, 0.9 * step * math.sqrt(_BENT / bent))
            else:
                yield parameter, slopes


@dataclass(frozen=True, eq=False)
class Replay:
    """Runs of a coupled model's neighbours in the steps of the model's own run.

    Fixed steps keep the step size control out of the differences: the number of steps and their shares of the run are
    those of the model's run.
    """

    solution: Solution

    def __call__(self, model: Model) -> RunResult:
        """Run of a neighbour; if its first cycle is not completed, that cycle.

        For periodic runs, one Newton step with the monodromy matrix of the own run moves the start of the cycle to the
        neighbour's periodic solution. Its error is the same for all neighbours to second order of their distance.

        Raises
        ------
        SceneError
            If the periodic solution is not isolated.
        """
        start = beginning(model)
        if self.solution.model.options.start == "periodic":
            start = self._beside(start)
            cycle = self._run(model, *start)
            if cycle.outcome is not Outcome.COMPLETED:
                return as_result(model, cycle, 0.0)
            if not np.linalg.cond(self._returning) < _SINGULAR:
                raise SceneError(
                    "solve.start", "periodic", "the periodic motion is not isolated: others exist nearby",
                    "Add damping, or start from zero or quasistatic",
                )  # fmt: skip
            equations = PlanarEquations(model.coupled, self._cycles.equations.which)
            beside = PlanarCycles(equations, cycle.times, method_of(model))
            near = equations.at(float(cycle.times[0]), *start)
            start = equations.bodies(beside.moved(near, -np.linalg.solve(self._returning, beside.missed(cycle))))
        return as_result(model, self._run(model, *start), 0.0)

    @property
    def _own(self) -> CoupledTrajectory:
        return self.solution.trajectory

    def _run(self, model: Model, q: np.ndarray, v: np.ndarray) -> CoupledTrajectory:
        """Run of a model from q and v, which are projected onto the constraints."""
        stretch = model.step / self.solution.model.step
        method = replace(method_of(model), tolerance=_SOLVED)
        return integrate(model.coupled, q, v, self._own.times * stretch, method, ends=self._own.ends * stretch)

    def _beside(self, rigid: Start) -> Start:
        """Start of the run's cycle, shifted by the difference of the two undeformed mechanisms' states."""
        q, v = beginning(self.solution.model)
        return self._own.q[0] + rigid[0] - q, self._own.v[0] + rigid[1] - v

    @cached_property
    def _cycles(self) -> PlanarCycles:
        """Cycles from the start of the run."""
        own, model = self._own, self.solution.model
        equations = prepare(model.coupled, float(own.times[0]), own.q[0], own.v[0])
        return PlanarCycles(equations, own.times, method_of(model))

    @cached_property
    def _returning(self) -> np.ndarray:
        """Derivative of the change over a cycle with respect to the start, (2 k, 2 k): the monodromy matrix minus the
        identity."""
        own, model, cycles, columns = self._own, self.solution.model, self._cycles, []
        first = next(iter(cycles.states(own, 2)))
        for unit in np.diag(cycles.sizes(own)):
            starts = (cycles.equations.bodies(cycles.moved(first, share * _APART * unit)) for share in SHARES)
            gaps = [cycles.missed(self._run(model, *start)) for start in starts]
            columns.append(slope(gaps, _APART) / unit.max())
        return np.array(columns).T


def neighbour_at(model: Model, parameter: Parameter, change: float, frozen: bool) -> Model:
    """Model with the parameter multiplied by 1 + change; ``frozen``: it keeps the modal bases.

    Raises
    ------
    SceneError
        If a small change of the parameter changes the equations or the mesh, or makes the scene invalid.
    """
    try:
        scene = parameter.scaled(model.scene, 1.0 + change)
    except SceneError as error:
        raise SceneError(
            parameter.name, parameter.value, f"a small change of it makes the scene invalid: {error.reason}",
            "Choose another parameter: other entries determine this one",
        ) from None  # fmt: skip
    if structure_hash(scene) != structure_hash(parameter.scaled(model.scene, 1.0)):
        raise SceneError(
            parameter.name, parameter.value, "a small change of it changes the equations",
            "Choose another value: the equations change at this one",
        )  # fmt: skip
    elements = {name: model.options.elements or model.scene.bodies[name].beam.elements for name in model.links}
    if any(len(mesh(scene, name, elements[name])) != len(link.nodes) for name, link in model.links.items()):
        raise SceneError(
            parameter.name, parameter.value, "a small change of it changes the mesh",
            "Choose another value: the number of elements changes at this one",
        )  # fmt: skip
    return neighbour(model, scene, frozen)


def slope(values: Sequence[np.ndarray], step: float) -> np.ndarray:
    """Derivative p dx/dp from the values at the neighbours, in the order of SHARES."""
    lowest, low, high, highest = values
    return (8.0 * (high - low) - (highest - lowest)) / (12.0 * step)


def bend(values: Sequence[np.ndarray], step: float) -> np.ndarray:
    """Difference of the second-order quotients over 2 h and 4 h: h^2 / 2 times the third derivative."""
    lowest, low, high, highest = values
    return (highest - lowest) / (4.0 * step) - (high - low) / (2.0 * step)


def _values(neighbour: tuple[Parameter, int], solution: RunResult) -> Slopes:
    """Sensors of a neighbour's run, which must be complete."""
    parameter, _ = neighbour
    if solution.outcome is not Outcome.COMPLETED:
        raise SceneError(
            parameter.name, parameter.value, f"with a small change of it the run fails: {solution.message}",
            "Add damping, or start from zero or quasistatic",
        )  # fmt: skip
    return {sensor: series.values for sensor, series in solution.series.items()}


def _demanded(values: Slopes | Exception) -> Slopes:
    if isinstance(values, Exception):
        raise values
    return values


def _refuse_relief(model: Model, t: float) -> None:
    if model.options.dynamics == "quasistatic" and mechanism_modes(model, t):
        raise SceneError(
            "solve.preset", model.options.preset,
            "rigid-body modes are carried by inertia relief, whose rounding errors exceed the differences",
            "Use preset stiffened, or restrain the mechanism",
        )  # fmt: skip


def _largest(values: np.ndarray) -> float:
    """Largest magnitude of the finite values; a rigid mechanism that does not close has none."""
    return float(abs(values[np.isfinite(values)]).max(initial=0.0))
