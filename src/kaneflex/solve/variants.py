"""Variants of one scene: settings over it, loaded with reuse of the previous model, and solved.

Studies use them: a sweep for its points, stability for speeds; runs whose time is measured are loaded separately, see
:mod:`kaneflex.study.runs`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from kaneflex.fem.assembly import ElasticEquations
from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import of_an_instant
from kaneflex.response.compiled_readings import CompiledReadings
from kaneflex.scene import Scene, with_settings
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution

Settings = Sequence[str]
"""Settings path=value over a scene."""


@dataclass(frozen=True)
class Variant:
    """A model of a scene: its name, and its settings over the scene."""

    name: str
    settings: tuple[str, ...]

    def of(self, scene: Scene) -> Scene:
        """The scene with these settings."""
        return with_settings(scene, self.settings)


class Variants:
    """Models of one scene, each loaded with the common parts of the previous one.

    ``alike``: whether many of them have the same equations, so that compiling the sensors pays off.
    """

    def __init__(self, scene: Scene, alike: bool = False) -> None:
        self.scene, self.alike = scene, alike
        self._last: Model | None = None
        self._readings: tuple[ElasticEquations | None, CompiledReadings | None] = None, None

    def load(self, settings: Settings) -> Model:
        """Model of the scene with these settings; raises as ``load`` and ``with_settings``."""
        model, last = load(with_settings(self.scene, settings), like=self._last), self._last
        self._last = model if last is None else model.sharing(last)
        return self._last

    def solve(self, settings: Settings) -> Solution:
        """Solution with these settings; sensors are read by compiled code if possible, which does not depend on
        previous models."""
        solution = solve(self.load(settings))
        if self.alike and solution.outcome is Outcome.COMPLETED and has_compiled_readings(solution.model):
            trajectory = cast(Trajectory, solution.trajectory)
            series = self._readings_of(solution).measure(solution.motion, (trajectory.z, trajectory.v, trajectory.a))
            if series is not None:  # else the usual readers report the error
                solution.keep(series)
        return solution

    def _readings_of(self, solution: Solution) -> CompiledReadings:
        model, (equations, readings) = solution.model, self._readings
        if readings is None or equations is not model.reduced or readings.sensors != model.scene.sensors:
            readings = CompiledReadings.of(solution.motion)
            self._readings = model.reduced, readings
        return readings


def has_compiled_readings(model: Model) -> bool:
    """True if models that differ in drives' speeds only share equations, so that reading can be compiled."""
    return model.coupled is None and not model.scene.is_spatial and not of_an_instant(model)
