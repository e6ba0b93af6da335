"""Many models of one scene: each is the scene with settings over it, loaded like the one before, and solved.

Every study is a question put to these: a sweep reads its points of them, sensitivities the neighbours of a run, the
stability over speeds its models; runs whose time counts go one by one, see :mod:`kaneflex.study.runs`.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar, cast

from kaneflex.fem.assembly import ElasticEquations
from kaneflex.integrate.outcome import Outcome, Trajectory
from kaneflex.multibody.building import of_an_instant
from kaneflex.multibody.model import Model
from kaneflex.response.compiled_readings import CompiledReadings
from kaneflex.scene import Scene, with_settings
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution

Settings = Sequence[str]
"""Of the form path=value, laid over a scene."""
Solver = Callable[[Model], Solution]
Name = TypeVar("Name", bound=Hashable)
Found = TypeVar("Found")

@dataclass(frozen=True)
class Variant:
    """A model of a scene: its name, and its settings over the scene."""

    name: str
    settings: tuple[str, ...]

    def of(self, scene: Scene) -> Scene:
        """The scene by this model."""
        return with_settings(scene, self.settings)


class Variants:
    """Models of one scene. What one has in common with the one loaded before is taken from that.

    ``alike``: whether so many of them are to be read that have the same equations that reading is worth compiling.
    """

    def __init__(self, scene: Scene, alike: bool = False) -> None:
        self.scene, self.alike = scene, alike
        self._last: Model | None = None
        self._readings: tuple[ElasticEquations | None, CompiledReadings | None] = None, None

    def load(self, settings: Settings) -> Model:
        """The model of the scene with these settings; raises what ``load`` and ``with_settings`` raise."""
        model, last = load(with_settings(self.scene, settings), like=self._last), self._last
        self._last = model if last is None else model.sharing(last)
        return self._last

    def solve(self, settings: Settings) -> Solution:
        """The solution of that model, its sensors read where that is compiled; which of them are does not depend on
        the models before.
        """
        solution = solve(self.load(settings))
        if self.alike and solution.outcome is Outcome.COMPLETED and has_compiled_readings(solution.model):
            trajectory = cast(Trajectory, solution.trajectory)
            series = self._readings_of(solution).measure(solution.motion, (trajectory.z, trajectory.v, trajectory.a))
            if series is not None:  # else it is for the readers to say what is wrong
                solution.keep(series)
        return solution

    def _readings_of(self, solution: Solution) -> CompiledReadings:
        model, (equations, readings) = solution.model, self._readings
        if readings is None or equations is not model.reduced or readings.sensors != model.scene.sensors:
            readings = CompiledReadings.of(solution.motion)
            self._readings = model.reduced, readings
        return readings


def has_compiled_readings(model: Model) -> bool:
    """Whether models that differ by drives' speeds have the same equations, of which reading can be compiled."""
    return model.coupled is None and not model.scene.is_spatial and not of_an_instant(model.scene, model.options)


def read(
    models: Mapping[Name, Callable[[], Model]],
    reader: Callable[[Name, Solution], Found],
    solver: Solver = solve,
) -> Iterator[tuple[Name, Found | Exception]]:
    """What is read of each model's solution, in their order, or the exception that came instead.

    What is found of one does not depend on the others, whatever goes wrong with them.
    """
    for name, model in models.items():
        found: Found | Exception
        try:
            found = reader(name, solver(model()))
        except Exception as error:  # whatever one model breaks, the others are to be computed
            found = error
        yield name, found
