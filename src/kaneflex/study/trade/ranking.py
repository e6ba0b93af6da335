"""Ranking of all candidates by error and cost, and the cheapest within the tolerance."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from kaneflex.scene import Scene
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.solve.loading import Progress
from kaneflex.solve.variants import Variant
from kaneflex.study.runs import cost
from kaneflex.study.trade.candidates import candidates_of, neutral_settings, own_model
from kaneflex.study.trade.reference import KNOWN, Reference
from kaneflex.study.trade.trials import Ranked, Trial, Trials
from kaneflex.support.arguments import takes
from kaneflex.support.errors import Problem, SceneError, failed
from kaneflex.support.terminal import silent

_CLEARLY = 1.5
"""Ratio of times of single runs above which the slower model is not run again."""
_FIRST_RUNS = 0.6
"""Share of the budget after which no further candidate is run: the rest is for repeats."""


@dataclass(frozen=True, eq=False)
class Trade:
    """Models of a scene, ranked. Made by :func:`trade`.

    Attributes
    ----------
    scene : Scene
    tolerance : float
        Share of a sensor's peak.
    reference : Reference
    ranked : tuple of Ranked
        Candidates by total time, the cheapest first.
    own : Variant or None
        The scene's own model; None if only given candidates were run.
    left_out : mapping of str to str
        Sensors that are not compared, and candidates that were not run to the end, with the reason.
    """

    scene: Scene
    tolerance: float
    reference: Reference
    ranked: tuple[Ranked, ...]
    left_out: Mapping[str, str]
    own: Variant | None = None

    def __repr__(self) -> str:
        return f"Trade({self.scene.name}: {len(self.ranked)} models, chosen {self.chosen and self.chosen.name})"

    def settings_of(self, entry: Ranked) -> tuple[str, ...]:
        """Settings path=value that select this model."""
        return (*neutral_settings(self.scene.raw), *entry.candidate.settings)

    @cached_property
    def chosen(self) -> Ranked | None:
        """Cheapest candidate within the tolerance; None if there is none."""
        return next((entry for entry in self.ranked if entry.within), None)

    @property
    def of_scene(self) -> Ranked | None:
        """Entry of the scene's own model; None if it was not run."""
        return next((entry for entry in self.ranked if entry.candidate == self.own), None)

    @cached_property
    def front(self) -> tuple[Ranked, ...]:
        """Pareto front, the cheapest first: candidates without a cheaper and more accurate one."""
        found: list[Ranked] = []
        for entry in self.ranked:
            if not found or entry.error < found[-1].error:
                found.append(entry)
        return tuple(found)


@takes(scene="scene", tolerance="number", budget="number", sensors="texts", progress="function")
def trade(
    scene: SceneLike,
    tolerance: float = 0.01,
    budget: float = 60.0,
    sensors: Sequence[str] | None = None,
    progress: Progress | None = None,
    candidates: Sequence[Variant] | None = None,
) -> Trade:
    """Run candidate models of a scene and rank them by error and time.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
        Its preset, integrator, modes, reduction and terms are replaced; start and duration are kept.
    tolerance : float
        Allowed error of each sensor, as a share of the largest absolute value of the reference.
    budget : float
        Seconds for the candidates and their repeats, after the reference.
    sensors : sequence of str, optional
        Compared sensors; all by default.
    progress : callable, optional
        Called with the name of each stage that can take longer than a moment.
    candidates : sequence of Variant, optional
        Models to run, by default the scene's own and :func:`kaneflex.study.trade.candidates.candidates_of`.

    Raises
    ------
    SceneError
        If the scene has no sensor, a sensor does not exist, the reference fails or does not
        converge, or no candidate can be run.
    """
    scene = scene_from(scene)
    trials = Trials.begun(scene, tolerance, sensors, progress or silent, KNOWN, budget)
    begun, runs, reference, own = time.perf_counter(), trials.runs, trials.reference, None
    basis = runs.scene
    if candidates is None:
        candidates, own = candidates_of(basis, reference.stored), own_model(scene)
        own = next((each for each in candidates if {*each.settings} == {*own.settings}), own)
        candidates = tuple(dict.fromkeys((own, *filter(runs.kept.get, reference.levels), *candidates)))
    left_out = {sensor: f"its error estimate is {100 * doubt:.2g} %" for sensor, doubt in reference.open.items()}
    for candidate in candidates:
        if time.perf_counter() > begun + _FIRST_RUNS * budget:
            left_out[candidate.name] = "no time left within the budget"
        elif not trials.within(candidate) and not trials.tried[candidate].differences:
            left_out[candidate.name] = trials.tried[candidate].reason
    found = [trial for trial in trials.tried.values() if trial.differences]
    if not found:
        problem = Problem("--budget", budget, "no candidate was run", "Give more time")
        raise SceneError.gather([problem, *(failed(name, reason) for name, reason in left_out.items())])
    once = runs.repeats([trial.candidate for trial in found], begun)
    seconds = [first.total for (first,) in once.values()]
    close = [each.candidate for each in found if each.candidate == own or not _outdone(each, found, seconds)]
    repeats = runs.repeats(close, begun + budget) if time.perf_counter() < begun + budget else {}
    costs = (cost(runs.run(model).timing, repeats.get(model, first)) for model, first in once.items())
    ranked = [Ranked(**vars(trial), cost=each) for trial, each in zip(found, costs, strict=True)]
    ranked.sort(key=lambda entry: entry.cost.total)
    return Trade(scene, tolerance, reference, tuple(ranked), left_out, own)


def _outdone(trial: Trial, others: Sequence[Trial], seconds: Sequence[float]) -> bool:
    """True if a more accurate model is clearly faster, by the seconds of one run of each."""
    own = seconds[others.index(trial)]
    return any(each.error < trial.error and _CLEARLY * its < own for each, its in zip(others, seconds, strict=True))
