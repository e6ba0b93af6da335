"""Runs of a scene's models, each once, with their curves and times."""

from __future__ import annotations

import gc
import math
import statistics
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.time_statistics import between_steps
from kaneflex.scene import Scene
from kaneflex.solve.curves import Curves
from kaneflex.solve.loading import Progress, load
from kaneflex.solve.run_result import seconds_of_steps
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution
from kaneflex.solve.variants import Variant
from kaneflex.support.errors import SceneError, StoppedEarly

ROUNDS = 5
"""Largest number of repeats of each model."""
_SOLUTIONS = 8
"""Number of runs whose solutions are in memory, the latest ones."""

clock = time.process_time
"""Clock of models' times and of the limits on them [s]: of the processor, since other programs hardly change it."""


@dataclass(frozen=True)
class Timing:
    """Times of one run by :data:`clock` [s].

    Attributes
    ----------
    once : float
        Derivation and compilation, done once.
    set_up : float
        Scene to matrices, without ``once``.
    solve : float
        Integration over ``steps`` steps.
    read : float
        Evaluation of the sensors.
    operations : int or None
        Multiply-adds of one evaluation of M, C, K and F from the scalars of the motion: one per nonzero coefficient.
        None for models without these equations.
    """

    once: float
    set_up: float
    solve: float
    read: float
    steps: int
    operations: int | None = None

    @property
    def total(self) -> float:
        """Time of a repeated run [s]."""
        return self.set_up + self.solve + self.read


@dataclass(frozen=True, eq=False)
class Run:
    """Curves of a scene, and the time that they took."""

    scene: Scene
    curves: Curves
    timing: Timing

    @cached_property
    def solution(self) -> Solution:
        """Solution of the run, which is found again if it was released."""
        return solve(load(self.scene))

    def release(self) -> None:
        """Forget the solution, which takes much more memory than the curves."""
        vars(self).pop("solution", None)


def run(scene: Scene, progress: Progress = lambda stage: None, name: str = "", most: float = math.inf) -> Run:
    """Load, solve and read all sensors once, with the time of each.

    Raises
    ------
    SceneError
        If the scene can't be solved, or takes more than ``most`` nominal seconds; StoppedEarly if the run stops early.
    """
    moments = [clock()]
    model = load(scene, progress)
    moments.append(clock())
    if model.options.dynamics in ("quasistatic", "dynamic") and seconds_of_steps(model, model.options.steps) > most:
        cure = "Give it more time by `kaneflex trade --budget`"
        raise SceneError("solve.preset", model.options.preset, "its run would take longer than it may", cure)
    progress(f"solving, {name or model.options.preset}")
    solution = solve(model)
    moments.append(clock())
    if solution.outcome is not Outcome.COMPLETED:
        cure = "Leave this preset out, or shorten solve.duration"
        raise StoppedEarly("solve.preset", model.options.preset, solution.message.rstrip("."), cure)
    values = {name: solution.series[name].values for name in solution.model.scene.sensors}
    loading, solving, reading = np.diff([*moments, clock()]).tolist()
    once, model = model.seconds["derive"] + model.seconds["compile"], solution.model
    curves = Curves(solution.times, values, {}, model.warnings, solution.seconds, tuple(between_steps(model)))
    timing = Timing(once, max(0.0, loading - once), solving, reading, model.options.steps, operations(model))
    found = Run(scene, curves, timing)
    vars(found)["solution"] = solution
    return found


def operations(model: Model) -> int | None:
    """Multiply-adds of a model's equations, see :class:`Timing`."""
    if model.options.dynamics != "dynamic":
        return None
    return sum(int(np.count_nonzero(getattr(model.system, name).data)) for name in "MCKF")


@dataclass(frozen=True, eq=False)
class Runs:
    """Variants of a scene, each run once at the first request and then kept.

    Attributes
    ----------
    scene : Scene
    progress : callable
        Called with the name of each stage that can take longer than a moment.
    kept : dict of Variant to Run
    failed : dict of Variant to SceneError
        Variants that can't be run to the end.
    """

    scene: Scene
    progress: Progress = lambda stage: None
    kept: dict[Variant, Run] = field(default_factory=dict)
    failed: dict[Variant, SceneError] = field(default_factory=dict)

    def run(self, variant: Variant, most: float = math.inf) -> Run:
        """Result of a variant; raises its SceneError if it can't be run to the end within ``most`` nominal seconds."""
        if variant in self.failed:
            raise self.failed[variant]
        if variant not in self.kept:
            try:
                self.kept[variant] = run(variant.of(self.scene), self.progress, variant.name, most)
            except SceneError as error:
                self.failed[variant] = error
                raise
            for older in [*self.kept.values()][:-_SOLUTIONS]:
                older.release()
        return self.kept[variant]

    def repeats(self, variants: Sequence[Variant], deadline: float, least: int = 1) -> dict[Variant, list[Timing]]:
        """Run every variant again, all once per round, in alternating order, to even out slow phases of the machine.

        ``least`` to ROUNDS rounds; after these no run begins after the deadline, a time of :data:`clock`.
        """
        scenes = {variant: variant.of(self.scene) for variant in variants}
        found: dict[Variant, list[Timing]] = {variant: [] for variant in variants}
        with _uncollected():
            for number in range(ROUNDS if variants else 0):
                self.progress(f"timing, round {number + 1}")
                for variant in variants[:: -1 if number % 2 else 1]:
                    if number >= least and clock() > deadline:
                        return found
                    gc.collect()
                    found[variant].append(run(scenes[variant]).timing)
        return found


@contextmanager
def _uncollected() -> Iterator[None]:
    """No garbage collection but on request, which then searches new objects only: all take longer than most runs."""
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


@dataclass(frozen=True)
class Cost:
    """Medians of repeated runs [s].

    Attributes
    ----------
    set_up, solve, read, total : float
        As in :class:`kaneflex.study.runs.Timing`; the median of the totals, not the total of the medians.
    spread : float or None
        Largest minus smallest total, as a share of the median; None for a single repeat.
    ns_per_step : float
        ``solve`` per step, rigid motion and start included.
    steps, repeats : int
    operations : int or None
    first : float
        Time of the first run, with derivation and compilation if needed.
    """

    set_up: float
    solve: float
    read: float
    total: float
    spread: float | None
    ns_per_step: float
    steps: int
    repeats: int
    operations: int | None
    first: float


def cost(first: Timing, repeats: Sequence[Timing]) -> Cost:
    """Medians and spread of at least one repeat; the first run, which compiles, is excluded."""
    keys = ("set_up", "solve", "read", "total")
    medians = {key: statistics.median(getattr(timing, key) for timing in repeats) for key in keys}
    totals = [timing.total for timing in repeats]
    return Cost(
        **medians, steps=first.steps, repeats=len(repeats), operations=first.operations, first=first.once + first.total,
        spread=(max(totals) - min(totals)) / medians["total"] if len(totals) > 1 else None,
        ns_per_step=1e9 * medians["solve"] / first.steps,
    )  # fmt: skip
