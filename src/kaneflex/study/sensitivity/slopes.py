"""The slopes of a run's sensors along its parameters, through the runs of four neighbours each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from kaneflex.integrate.lanes import LANES
from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.model import Model
from kaneflex.solve.quasistatic import mechanism_modes
from kaneflex.solve.simulation import simulate_together, solve
from kaneflex.solve.solution import Solution
from kaneflex.study.sensitivity.neighbours import SHARES, bend, neighbours, slope
from kaneflex.study.sensitivity.parameters import Parameter
from kaneflex.support.errors import SceneError

Slopes = Mapping[str, np.ndarray]
"""Sensor -> p dy/dp over the stored times, (n_times,), in the sensor's unit."""
_STEP = 4e-4
"""Relative step from neighbour to neighbour, where the curves are as smooth as the runs of mechanisms mostly are: what
is left out and what rounding leaves are then about the same."""
_BENT = 2e-4
"""Share of a slope by which differences over one and over two steps may differ: its square times ten is left out."""
_SMALLEST = 1e-7
"""Relative step below which rounding would be louder than any slope."""
_QUIET = 1e-2
"""Share of a sensor's largest value below which its slope is weighed against that."""


def differentiated(
    solution: Solution, parameters: Sequence[Parameter], frozen: bool
) -> Iterator[tuple[Parameter, Slopes]]:
    """Each parameter with its slopes, as they are found; ``frozen`` where modal bases are kept.

    Steps are as small as the curves' bends ask for: what vibrates for long, or turns often, is shifted by many radians
    with a small change of a number.

    Raises
    ------
    SceneError
        If a neighbour has no such equations or no such run, or a quasi-static answer is held by inertia relief alone.
    """
    _refuse_relief(solution.model, solution.times[0])
    series = {sensor: series.values for sensor, series in solution.series.items()}
    run = _runs(solution)
    steps = dict.fromkeys(parameters, _STEP)
    while steps:
        some = dict(islice(steps.items(), LANES // len(SHARES)))
        models = {each: neighbours(solution.model, each, step, frozen) for each, step in some.items()}
        for parameter, solutions in run(models, some).items():
            _check_complete(parameter, solutions)
            step = steps.pop(parameter)
            at = {sensor: [found.series[sensor].values for found in solutions] for sensor in series}
            slopes = {sensor: slope(values, step) for sensor, values in at.items()}
            bent = max(
                _largest(bend(at[sensor], step)) / max(_largest(slopes[sensor]), _QUIET * _largest(values), 1e-300)
                for sensor, values in series.items()
            )
            if bent > _BENT and step > _SMALLEST:
                steps[parameter] = max(_SMALLEST, 0.9 * step * math.sqrt(_BENT / bent))
            else:
                yield parameter, slopes


Neighbours = Mapping[Parameter, list[Model]]
Runs = Mapping[Parameter, Sequence[Solution]]


def _runs(solution: Solution) -> Callable[[Neighbours, Mapping[Parameter, float]], Runs]:
    """What makes of some parameters' neighbours, and their steps, the neighbours' runs."""
    if solution.model.coupled is None:
        return _together
    from kaneflex.study.sensitivity.replay import Replay

    replay = Replay(solution)
    return lambda models, steps: {each: replay.runs(each, own, steps[each]) for each, own in models.items()}


def _together(models: Neighbours, steps: Mapping[Parameter, float]) -> Runs:
    """All runs side by side, as far as that is possible."""
    every = [model for own in models.values() for model in own]
    found = iter([run or solve(model) for run, model in zip(simulate_together(every), every, strict=True)])
    return {each: list(islice(found, len(own))) for each, own in models.items()}


def _refuse_relief(model: Model, t: float) -> None:
    if model.options.dynamics == "quasistatic" and mechanism_modes(model, t):
        raise SceneError(
            "solve.preset", model.options.preset,
            "mechanism modes are left to inertia relief, whose rounding would drown the differences",
            "Take preset stiffened, or hold the mechanism",
        )  # fmt: skip


def _check_complete(parameter: Parameter, solutions: Sequence[Solution]) -> None:
    for solution in solutions:
        if solution.outcome is not Outcome.COMPLETED:
            raise SceneError(
                parameter.name, parameter.value, f"with a small change of it there is no such run: {solution.message}",
                "Damp the motion, or start from zero or quasistatic",
            )  # fmt: skip


def _largest(values: np.ndarray) -> float:
    """The largest magnitude; what has no value, as where a rigid mechanism does not close, is left out."""
    return float(abs(values[np.isfinite(values)]).max(initial=0.0))
