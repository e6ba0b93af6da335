"""Models of a scene run one by one, each once: their curves, and what they took."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.model import Model
from kaneflex.response.undersampling import between_steps
from kaneflex.scene import Scene
from kaneflex.solve.curves import Curves
from kaneflex.solve.loading import Progress, load
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution
from kaneflex.solve.variants import Variant
from kaneflex.support.errors import SceneError, StoppedEarly

ROUNDS = 5
"""Repeats of each model, at most."""


@dataclass(frozen=True)
class Timing:
    """Wall times of one run [s].

    Attributes
    ----------
    once : float
        Deriving and compiling: not paid again.
    set_up : float
        From the scene to the matrices, without ``once``.
    solve : float
        The motion, over ``steps`` steps.
    read : float
        The sensors, from the motion.
    operations : int or None
        Multiply-adds by which M, C, K and F follow from the scalars of the motion, once: one for each number that is
        not zero. None where no equations of this form are integrated.
    """

    once: float
    set_up: float
    solve: float
    read: float
    steps: int
    operations: int | None = None

    @property
    def total(self) -> float:
        """What a run costs that is not the first."""
        return self.set_up + self.solve + self.read


@dataclass(frozen=True, eq=False)
class Run:
    """What came of a model: its curves and what they took.

    ``judged`` tells whether the curves' notes hold all that the run warns of, which may take a second run; else what
    its model does.
    """

    curves: Curves
    timing: Timing
    judged: bool


def run(scene: Scene, judged: bool = False, progress: Progress = lambda stage: None, name: str = "") -> Run:
    """Load, solve and read all sensors once, with the time of each.

    Raises
    ------
    SceneError
        For a scene that can't be solved; StoppedEarly for a run that did.
    """
    started = time.perf_counter()
    model = load(scene, progress)
    loaded = time.perf_counter()
    progress(f"solving, {name or model.options.preset}")
    solution = solve(model)
    solved = time.perf_counter()
    values = _values(solution)
    ended = time.perf_counter()
    once = model.seconds["derive"] + model.seconds["compile"]
    times = (once, loaded - started - once, solved - loaded, ended - solved)
    notes = solution.warnings if judged else model.warnings
    curves = Curves(solution.times, values, {}, tuple(notes), solution.seconds, tuple(between_steps(model)))
    return Run(curves, Timing(*times, model.options.steps, operations(model)), judged)


def _values(solution: Solution) -> dict[str, np.ndarray]:
    if solution.outcome is not Outcome.COMPLETED:
        cure = "Compare the others, or shorten solve.duration"
        raise StoppedEarly("solve.preset", solution.model.options.preset, solution.message.rstrip("."), cure)
    return {name: solution.series[name].values for name in solution.model.scene.sensors}


def operations(model: Model) -> int | None:
    """Multiply-adds of its equations, see :class:`Timing`."""
    if model.options.dynamics != "dynamic":
        return None
    return sum(int(np.count_nonzero(getattr(model.system, name).data)) for name in "MCKF")


@dataclass(frozen=True, eq=False)
class Runs:
    """Variants of a scene, each run once when it is first asked for: what came of it is kept.

    Attributes
    ----------
    scene : Scene
    progress : callable
        Called with the name of each stage that can take longer than a moment.
    kept : dict of Variant to Run
    failed : dict of Variant to SceneError
        Those that can't be run to their end.
    """

    scene: Scene
    progress: Progress = lambda stage: None
    kept: dict[Variant, Run] = field(default_factory=dict)
    failed: dict[Variant, SceneError] = field(default_factory=dict)

    def run(self, variant: Variant, judged: bool = False) -> Run:
        """What came of a variant; raises the SceneError for which it can't be run to its end."""
        if variant in self.failed:
            raise self.failed[variant]
        if variant not in self.kept or (judged and not self.kept[variant].judged):
            try:
                self.kept[variant] = run(variant.of(self.scene), judged, self.progress, variant.name)
            except SceneError as error:
                self.failed[variant] = error
                raise
        return self.kept[variant]

    def repeats(self, variants: Sequence[Variant], deadline: float) -> dict[Variant, list[Timing]]:
        """Every variant run again, all once a round, to and fro, so that a slow spell of the machine meets them all.

        One round at least, ROUNDS at most; none is begun after the deadline, of ``time.perf_counter``.
        """
        scenes = {variant: variant.of(self.scene) for variant in variants}
        found: dict[Variant, list[Timing]] = {variant: [] for variant in variants}
        for number in range(ROUNDS):
            self.progress(f"timing, round {number + 1}")
            for variant in variants[:: -1 if number % 2 else 1]:
                if number and time.perf_counter() > deadline:
                    return found
                gc.collect()
                gc.disable()
                try:
                    found[variant].append(run(scenes[variant]).timing)
                finally:
                    gc.enable()
        return found


@dataclass(frozen=True)
class Cost:
    """Medians of repeated runs [s].

    Attributes
    ----------
    set_up, solve, read, total : float
        As in :class:`kaneflex.study.runs.Timing`; the median of the totals, not the total of the medians.
    spread : float or None
        Largest total less the smallest, as a share of the median; None of a single repeat.
    ns_per_step : float
        Of ``solve``, rigid motion and start included.
    steps, repeats : int
    operations : int or None
    first : float
        Wall time of the first run of all, with deriving and compiling where they were still to be done.
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
    """Medians and spread of at least one repeat; the first run, which compiles, counts in none of them."""
    totals = [timing.total for timing in repeats]
    total, solve = statistics.median(totals), statistics.median(timing.solve for timing in repeats)
    return Cost(
        set_up=statistics.median(timing.set_up for timing in repeats),
        solve=solve,
        read=statistics.median(timing.read for timing in repeats),
        total=total,
        spread=(max(totals) - min(totals)) / total if len(totals) > 1 else None,
        ns_per_step=1e9 * solve / first.steps,
        steps=first.steps,
        repeats=len(repeats),
        operations=first.operations,
        first=first.once + first.total,
    )
