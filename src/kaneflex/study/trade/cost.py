"""What a model costs, from repeated runs."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from kaneflex.multibody.model import Model
from kaneflex.response.undersampling import between_steps
from kaneflex.scene import Scene
from kaneflex.solve.curves import Curves
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.study.comparison import curves_of

Name = TypeVar("Name", bound=Hashable)
Progress = Callable[[str], None]
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


@dataclass(frozen=True)
class Cost:
    """Medians of repeated runs [s].

    Attributes
    ----------
    set_up, solve, read, total : float
        As in :class:`Timing`; the median of the totals, not the total of the medians.
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


def timed_run(scene: Scene, judged: bool = False) -> tuple[Curves, Timing]:
    """Load, solve and read all sensors once, with the time of each.

    Parameters
    ----------
    judged : bool
        Whether the curves' notes hold all that the run warns of, which takes a moment.

    Raises
    ------
    SceneError
        For a scene that can't be solved, and for a run that stopped early.
    """
    started = time.perf_counter()
    model = load(scene)
    loaded = time.perf_counter()
    solution = solve(model)
    solved = time.perf_counter()
    curves = curves_of(solution)
    once = model.seconds["derive"] + model.seconds["compile"]
    ended = time.perf_counter()
    steps, operations = model.options.steps, _operations(model)
    notes = solution.warnings if judged else curves.notes
    curves = replace(curves, notes=notes, unseen=tuple(between_steps(model)))
    return curves, Timing(once, loaded - started - once, solved - loaded, ended - solved, steps, operations)


def _operations(model: Model) -> int | None:
    if model.options.dynamics != "dynamic":
        return None
    return sum(int(getattr(model.system, name).count_nonzero()) for name in "MCKF")


def timed_in_turns(
    scenes: Mapping[Name, Scene], deadline: float, progress: Progress
) -> dict[Name, list[Timing]]:
    """Repeats of every scene, all once a round, to and fro, so that a slow spell of the machine meets them all.

    One round at least, ROUNDS at most; none is begun after the deadline, of ``time.perf_counter``.
    """
    found: dict[Name, list[Timing]] = {name: [] for name in scenes}
    for number in range(ROUNDS):
        progress(f"timing, round {number + 1}")
        for name in list(scenes)[:: -1 if number % 2 else 1]:
            if number and time.perf_counter() > deadline:
                return found
            gc.collect()
            gc.disable()
            try:
                found[name].append(timed_run(scenes[name])[1])
            finally:
                gc.enable()
    return found


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
