"""Slopes of a run's sensors along its parameters, from the runs of four neighbours each.

A slope is the logarithmic derivative p dx/dp, in the unit of x, at a fixed share of the cycle or of the run: the
difference quotient of fourth order, (x(-2h) - 8 x(-h) + 8 x(h) - x(2h)) / 12 h (Fornberg 1988, Math. Comp. 51).
Quantities that are equal in all neighbours have a slope of exactly zero. Neighbours of a coupled run take its steps, at
the same shares of the run, which keeps the step size control out of the differences.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.fem.links import mesh
from kaneflex.integrate.system import Outcome
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.linearisation import Equations, prepare
from kaneflex.multibody.time.shooting import Cycles
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.coupled import beginning, method_of, result_of
from kaneflex.solve.loading import neighbour
from kaneflex.solve.quasistatic import mechanism_modes
from kaneflex.solve.run_result import RunResult
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution
from kaneflex.study.sensitivity.parameters import Parameter
from kaneflex.support.errors import SceneError

Slopes = Mapping[str, np.ndarray]
"""Sensor -> p dy/dp over the stored times, (n_times,), in the sensor's unit."""
_STEP = 4e-4
"""First relative step between neighbours: truncation and rounding errors are then about equal for typical curves."""
_BENT = 2e-4
"""Largest difference of the quotients over one and two steps, as a share of the slope; the truncation error is about
ten times its square."""
_SMALLEST = 1e-7
"""Relative step below which rounding errors dominate."""
_QUIET = 1e-2
"""Share of a sensor's largest value that slopes are compared with if they are smaller."""
SHARES = (-2, -1, 1, 2)
"""Neighbours' positions in relative steps of the parameter."""
_SOLVED = 1e-12
"""Tolerance of each step as a share of the mechanism's size: far below the differences between neighbours."""
_APART = 1e-2
"""Step of the differences along a state of the cycle's start, as a share of its range within the cycle."""
_SINGULAR = 1e14
"""Condition number beyond which the periodic solution is not isolated."""


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
    solver = Replay(solution) if model.options.dynamics == "coupled" else solve  # in the steps that the run chose
    largest = {sensor: _largest(series.values) for sensor, series in solution.series.items()}
    for parameter in parameters:
        step = _STEP
        while True:
            models = (neighbour_at(model, parameter, share * step, frozen) for share in SHARES)
            at = [_values(parameter, solver(each)) for each in models]
            slopes = {sensor: slope([values[sensor] for values in at], step) for sensor in largest}
            bent = max(
                _largest(bend([values[sensor] for values in at], step))
                / max(_largest(slopes[sensor]), _QUIET * size, 1e-300)
                for sensor, size in largest.items()
            )
            if bent <= _BENT or step <= _SMALLEST:
                break
            step = max(_SMALLEST, 0.9 * step * math.sqrt(_BENT / bent))
        yield parameter, slopes


def neighbour_at(model: Model, parameter: Parameter, change: float, frozen: bool) -> Model:
    """Model with the parameter multiplied by 1 + change; ``frozen``: it keeps the modal bases.

    Raises
    ------
    SceneError
        If a small change of the parameter changes the equations or the mesh, or makes the scene invalid.
    """

    def refused(effect: str, cure: str) -> SceneError:
        return SceneError(parameter.name, parameter.value, f"a small change of it {effect}", cure)

    try:
        scene = parameter.scaled(model.scene, 1.0 + change)
    except SceneError as error:
        cure = "Choose another parameter: other entries determine this one"
        raise refused(f"makes the scene invalid: {error.reason}", cure) from None
    if structure_hash(scene) != structure_hash(parameter.scaled(model.scene, 1.0)):
        raise refused("changes the equations", "Choose another value: the equations change at this one")
    elements = {name: model.options.elements or model.scene.bodies[name].beam.elements for name in model.meshes}
    of = mechanism_of(scene)
    if any(len(mesh(of, name, elements[name])) != len(link.nodes) for name, link in model.meshes.items()):
        raise refused("changes the mesh", "Choose another value: the number of elements changes at this one")
    return neighbour(model, scene, frozen)


def slope(values: Sequence[np.ndarray], step: float) -> np.ndarray:
    """Derivative p dx/dp from the values at the neighbours, in the order of SHARES."""
    lowest, low, high, highest = values
    return (8.0 * (high - low) - (highest - lowest)) / (12.0 * step)


def bend(values: Sequence[np.ndarray], step: float) -> np.ndarray:
    """Difference of the second-order quotients over 2 h and 4 h: h^2 / 2 times the third derivative."""
    lowest, low, high, highest = values
    return (highest - lowest) / (4.0 * step) - (high - low) / (2.0 * step)


def _values(parameter: Parameter, solution: RunResult) -> Slopes:
    """Sensors of a neighbour's run, which must be complete."""
    if solution.outcome is not Outcome.COMPLETED:
        raise SceneError(
            parameter.name, parameter.value, f"with a small change of it the run fails: {solution.message}",
            "Add damping, or start from zero or quasistatic",
        )  # fmt: skip
    return {sensor: series.values for sensor, series in solution.series.items()}


def _refuse_relief(model: Model, t: float) -> None:
    if model.options.dynamics == "quasistatic" and mechanism_modes(model, t):
        raise SceneError(
            "solve.preset", model.options.preset,
            "unconstrained degrees of freedom need inertia relief, whose rounding errors exceed the differences",
            "Use preset stiffened, or restrain the mechanism",
        )  # fmt: skip


def _largest(values: np.ndarray) -> float:
    """Largest magnitude of the finite values; a rigid mechanism that does not close has none."""
    return float(abs(values[np.isfinite(values)]).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Replay:
    """Solver of a run's neighbours in the steps of the run."""

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
        cycles, start = self.cycles(model), self.first(model)
        if model.options.start == "periodic":
            start = cycles.moved(start, self._deformed)
            cycle = cycles.run(start)
            if not cycles.completed(cycle):
                return result_of(model, cycle, 0.0)
            if not np.linalg.cond(self._returning) < _SINGULAR:
                raise SceneError(
                    "solve.start", "periodic", "the periodic motion is not isolated: others exist nearby",
                    "Add damping, or start from zero or quasistatic",
                )  # fmt: skip
            start = cycles.moved(start, -np.linalg.solve(self._returning, cycles.missed(cycle)))
        return result_of(model, cycles.run(start), 0.0)

    @cached_property
    def own(self) -> Any:
        """The run of the model itself, as a cycle."""
        return self.solution.trajectory

    def first(self, model: Model) -> State:
        """Start of a model's run; for a periodic one that of the undeformed mechanism."""
        return replace(beginning(model), t=float(self.own.times[0]), choice=self._equations.choice)

    def cycles(self, model: Model) -> Cycles:
        """Cycles of a model in the steps of the own run, by the same independent coordinates."""
        stretch, method = model.step / self.solution.model.step, replace(method_of(model), tolerance=_SOLVED)
        equations = replace(self._equations, system=model.coupled_system)
        return Cycles(equations, self.own.times * stretch, method, ends=self.own.curve.ends * stretch)

    @cached_property
    def _equations(self) -> Equations:
        return prepare(self.solution.model.coupled_system, next(self.own.curve.states(self.own.times[:1])))[0]

    @cached_property
    def _cycles(self) -> Cycles:
        return self.cycles(self.solution.model)

    @cached_property
    def _start(self) -> Any:
        return next(iter(self._cycles.states(self.own, 2)))

    @cached_property
    def _deformed(self) -> np.ndarray:
        """Start of the own run less that of the undeformed mechanism, (2 k,)."""
        return self._cycles.apart(self.first(self.solution.model), self._start)[0]

    @cached_property
    def _returning(self) -> np.ndarray:
        """Derivative of the change over a cycle with respect to the start, (2 k, 2 k): the monodromy matrix minus the
        identity."""
        cycles, columns = self._cycles, []
        for unit in np.diag(cycles.sizes(self.own)):
            starts = (cycles.moved(self._start, share * _APART * unit) for share in SHARES)
            gaps = [cycles.missed(cycles.run(start)) for start in starts]
            columns.append(slope(gaps, _APART) / unit.max())
        return np.array(columns).T
