"""Models of a scene, each run and compared with its reference, and their ranking by error and cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.solve.loading import Progress
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Compared, Difference
from kaneflex.study.runs import Cost, Runs, clock, cost
from kaneflex.study.trade.candidates import (
    COUPLED,
    STIFFENED,
    candidates_of,
    check_request,
    families,
    neutral,
    neutral_settings,
    own_model,
)
from kaneflex.study.trade.reference import KNOWN, Reference, find_reference
from kaneflex.support.arguments import takes
from kaneflex.support.errors import Problem, SceneError, failed
from kaneflex.support.terminal import silent

_SHORT, _ROUNDS = 0.5, 0.3
"""Seconds of a run without set-up up to which it is repeated for its time, and of these repeats: the first run may load
compiled code."""
_CLEARLY = 1.5
"""Ratio of times of single runs above which the slower model is not run again."""
NEAR = 2.0
"""Multiple of the tolerance that the plain model of preset coupled may miss it by: cheaper ones can be within, since
their error may cancel that of the plain one."""


@dataclass(frozen=True)
class Trial(Compared):
    """A model with its errors.

    Attributes
    ----------
    candidate : Variant
    differences : tuple of Difference
        From the reference, by sensor; empty if the model can't be run.
    within : bool
        Whether every error, including the reference's uncertainty, is within the tolerance. Models whose steps do not
        resolve their loads are not: their error is a matter of luck.
    near : bool
        Whether every error is at most NEAR times as large.
    coarse : bool
        Whether only its steps are too few: it is within at its own instants, or does not resolve its loads.
    reason : str
        Why it can't be run, or the loads that it does not resolve.
    """

    candidate: Variant
    differences: tuple[Difference, ...] = ()
    within: bool = False
    near: bool = False
    coarse: bool = False
    reason: str = ""

    @property
    def name(self) -> str:
        return self.candidate.name


@dataclass(frozen=True, kw_only=True)
class Ranked(Trial):
    """A model with its errors, and the cost of repeated runs."""

    cost: Cost


@dataclass(eq=False)
class Trials:
    """Comparisons of models with a reference, each made once.

    ``until``: moment of ``clock`` after which no model is tried; ``known``: time of the richest model's run
    [s], if known before; ``tried``: results in the order of trials.
    """

    runs: Runs
    tolerance: float
    reference: Reference
    until: float = math.inf
    known: float = 0.0
    tried: dict[Variant, Trial] = field(default_factory=dict)

    @classmethod
    def begun(
        cls, scene: Scene, tolerance: float, sensors: Sequence[str] | None, progress: Progress, share: float,
        budget: float = 1.0,
    ) -> Trials:  # fmt: skip
        """Trials of a scene's models, whose reference is run; ``sensors``: those that must be within, else any.

        Raises SceneError as :func:`kaneflex.study.trade.candidates.check_request` and
        :func:`kaneflex.study.trade.reference.find_reference`, whose ``share`` it takes.
        """
        compared, runs = check_request(scene, tolerance, budget, sensors), Runs(neutral(scene), progress)
        return cls(runs, tolerance, find_reference(runs, compared, tolerance, share, sensors is not None))

    def within(self, candidate: Variant) -> bool:
        """True if a candidate is within the tolerance; False also if it can't be run, or not in time."""
        left = self.until - clock()
        if candidate not in self.tried and left > 0:
            denser = max(1.0, self.reference.stored / resolve_options(self.runs.scene).steps)
            if candidate.settings[0] == COUPLED.settings[0] and denser * self.known > left:
                return False  # it may take as long as the plain one with as many instants
            try:
                self.tried[candidate] = self._compared(candidate, left)
            except SceneError as error:
                self.tried[candidate] = Trial(candidate, reason=str(error))
        return candidate in self.tried and self.tried[candidate].within

    def _compared(self, candidate: Variant, left: float) -> Trial:
        curves, reference = self.runs.run(candidate, left).curves, self.reference
        found = reference.errors(candidate.name, curves)
        close, resolved = reference.within(found, self.tolerance), not curves.undersampled
        at_its_own = reference.within(reference.errors("", curves, between=False), self.tolerance)
        reason = "; ".join(curves.undersampled)
        near, coarse = reference.within(found, NEAR * self.tolerance), not resolved or (at_its_own and not close)
        return Trial(candidate, found, close and resolved, near, coarse, reason)

    def seconds(self, models: Sequence[Variant]) -> dict[Variant, float]:
        """Times of models' runs [s] in this process: of short ones the least of some runs in turn."""
        found = {model: [self.runs.run(model).timing] for model in models}
        short = [model for model in models if found[model][0].solve + found[model][0].read <= _SHORT]
        for model, again in self.runs.repeats(short, clock() + _ROUNDS).items():
            found[model] += again
        return {model: min(each.total for each in timings) for model, timings in found.items()}

    def richest(self) -> Variant:
        """The coarsest level of the reference within the tolerance, else the finest one that can be run."""
        within = next(filter(self.within, self.reference.levels), None)
        return within or [each for each in self.reference.levels if self.tried[each].differences][-1]

    def beyond(self, model: Variant) -> dict[str, float]:
        """Sensors of a tried model that are not within the tolerance, with their error and uncertainty."""
        doubts = self.reference.doubts
        found = {each.sensor: each.error + doubts[each.sensor] for each in self.tried[model].differences}
        return {sensor: error for sensor, error in found.items() if error > self.tolerance}

    def cheapest_models(self) -> list[Variant]:
        """Cheapest model within the tolerance of each preset that has any.

        If ``stiffened`` is not within, and not for too few steps, no other one-way preset is.
        """
        scene = self.runs.scene
        *one_way, coupled = families(scene, self.reference.stored)
        if (scene.is_spatial or scene.free_joints) and math.isfinite(self.until):
            one_way = []  # their runs take about as long as those of coupled, or longer
        found = []
        for family in (*reversed(one_way), coupled):
            one = self.tried.get(STIFFENED)
            beyond = one is not None and bool(one.differences) and not (one.within or one.coarse)
            if family is coupled or not beyond:
                self.within(family.plain)
                plain = self.tried.get(family.plain, Trial(family.plain))
                hopeful = plain.within or (plain.near and family is coupled)
                models = family.finer if plain.coarse else (*family.cheaper, family.plain) if hopeful else ()
                found += [next(filter(self.within, models), None)]
        return [model for model in found if model is not None]


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
        Seconds for all runs. The reference is found and repeated in any case, candidates as far as time is left.
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
    scene, deadline = scene_from(scene), clock() + budget
    trials = Trials.begun(scene, tolerance, sensors, progress or silent, KNOWN, budget)
    runs, reference, own = trials.runs, trials.reference, None
    basis = runs.scene
    if candidates is None:
        candidates, own = candidates_of(basis, reference.stored), own_model(scene)
        own = next((each for each in candidates if {*each.settings} == {*own.settings}), own)
        candidates = tuple(dict.fromkeys((own, *filter(runs.kept.get, reference.levels), *candidates)))
    left_out = {sensor: f"its error estimate is {100 * doubt:.2g} %" for sensor, doubt in reference.open.items()}
    trials.known = runs.run(reference.levels[0]).timing.total
    for candidate in candidates:
        again = sum(runs.run(model).timing.total for model, trial in trials.tried.items() if trial.differences)
        left = math.inf if candidate in runs.kept else deadline - clock() - again
        trials.until = clock() + left
        trials.within(candidate)
        trial = trials.tried.get(candidate, Trial(candidate, reason="no time left within the budget"))
        left_out |= {} if trial.differences else {candidate.name: trial.reason}
    found = [trial for trial in trials.tried.values() if trial.differences]
    if not found:
        problem = Problem("--budget", budget, "no candidate was run", "Give more time")
        raise SceneError.gather([problem, *(failed(name, reason) for name, reason in left_out.items())])
    once = runs.repeats([trial.candidate for trial in found], -math.inf)
    seconds = [first.total for (first,) in once.values()]
    close = [each.candidate for each in found if each.candidate == own or not _outdone(each, found, seconds)]
    repeats = runs.repeats(close, deadline, least=0)
    costs = (cost(runs.run(model).timing, repeats.get(model) or first) for model, first in once.items())
    ranked = [Ranked(**vars(trial), cost=each) for trial, each in zip(found, costs, strict=True)]
    ranked.sort(key=lambda entry: entry.cost.total)
    return Trade(scene, tolerance, reference, tuple(ranked), left_out, own)


def _outdone(trial: Trial, others: Sequence[Trial], seconds: Sequence[float]) -> bool:
    """True if a more accurate model is clearly faster, by the seconds of one run of each."""
    own = seconds[others.index(trial)]
    return any(each.error < trial.error and _CLEARLY * its < own for each, its in zip(others, seconds, strict=True))
