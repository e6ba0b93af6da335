"""Ranking of all candidates by error and cost, and the cheapest within the tolerance."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from kaneflex.scene import Scene
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.scene.start import Start
from kaneflex.solve.loading import Progress
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, check_sensors, worst
from kaneflex.study.runs import Cost, Run, Runs, cost
from kaneflex.study.trade.candidates import candidates_of, elements_of, neutral, neutral_settings, own_model
from kaneflex.study.trade.linear_prices import LinearPrices
from kaneflex.study.trade.reference import Reference, find_reference
from kaneflex.support.arguments import takes
from kaneflex.support.errors import Problem, SceneError, failed, refuse
from kaneflex.support.terminal import silent

_FIRST_RUNS = 0.6
"""Share of the budget after which no further candidate is run: the rest is for repeats."""


@dataclass(frozen=True)
class Ranked:
    """A candidate with its errors by sensor, its cost, and the loads that its steps do not resolve."""

    candidate: Variant
    differences: tuple[Difference, ...]
    cost: Cost
    undersampled: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return self.candidate.name

    @property
    def worst(self) -> Difference:
        """Sensor with the largest error as a share of its peak."""
        return worst(self.differences)

    @property
    def error(self) -> float:
        """Largest error max|y - y_ref| / max|y_ref| of a sensor."""
        return self.worst.peak_share

    @property
    def rms(self) -> float:
        """Largest rms error of a sensor as a share of its peak."""
        return max(difference.rms_share for difference in self.differences)


@dataclass(frozen=True, eq=False)
class Trade:
    """Models of a scene, ranked. Made by :func:`trade`.

    Attributes
    ----------
    scene : Scene
    sensors : tuple of str
    tolerance : float
        Share of a sensor's peak.
    reference : Reference
    ranked : tuple of Ranked
        Candidates by total time, the cheapest first.
    own : Variant or None
        The scene's own model; None if only given candidates were run.
    left_out : mapping of str to str
        Candidates that were not run to the end, with the reason.
    """

    scene: Scene
    sensors: tuple[str, ...]
    tolerance: float
    reference: Reference
    ranked: tuple[Ranked, ...]
    left_out: Mapping[str, str]
    own: Variant | None = None

    def __repr__(self) -> str:
        return f"Trade({self.scene.name}: {len(self.ranked)} models, chosen {self.chosen and self.chosen.name})"

    def good_enough(self, entry: Ranked) -> bool:
        """True if every sensor stays within the tolerance, including the reference's uncertainty."""
        return self.reference.within(entry.differences, self.tolerance, entry.undersampled)

    def settings_of(self, entry: Ranked) -> tuple[str, ...]:
        """Settings path=value that select this model."""
        return (*neutral_settings(self.scene), *entry.candidate.settings)

    @cached_property
    def chosen(self) -> Ranked | None:
        """Cheapest candidate within the tolerance; None if there is none."""
        return next((entry for entry in self.ranked if self.good_enough(entry)), None)

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
        If the scene has no elastic body or no sensor, a sensor does not exist, the reference fails or does not
        converge, or no candidate can be run.
    """
    scene = scene_from(scene)
    sensors = check_request(scene, tolerance, budget, sensors)
    basis = neutral(scene)
    runs = Runs(basis, progress or silent)
    reference = find_reference(runs, sensors, tolerance, LinearPrices.of(basis, sensors))
    deadline = time.perf_counter() + budget
    own = None
    if candidates is None:
        candidates, own = candidates_of(basis), own_model(scene)
        own = next((each for each in candidates if {*each.settings} == {*own.settings}), own)
        candidates = dict.fromkeys((own, *candidates))
    found, left_out = _first_runs(runs, candidates, time.perf_counter() + _FIRST_RUNS * budget)
    if not found:
        problem = Problem("--budget", budget, "no candidate was run", "Give more time")
        raise SceneError.gather([problem, *(failed(name, reason) for name, reason in left_out.items())])
    repeats = runs.repeats(list(found), deadline)
    ranked = []
    for candidate, first in found.items():
        errors = reference.errors(sensors, candidate.name, first.curves)
        ranked.append(Ranked(candidate, errors, cost(first.timing, repeats[candidate]), first.curves.undersampled))
    ranked.sort(key=lambda entry: entry.cost.total)
    return Trade(scene, sensors, tolerance, reference, tuple(ranked), left_out, own)


def check_request(scene: Scene, tolerance: float, budget: float, sensors: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the compared sensors; raises SceneError for an invalid request before anything is computed."""
    refuse(
        (not 0 < tolerance < 1, "--tolerance", tolerance, "not a share of each sensor's peak",
         "Give a value between 0 and 100 %"),
        (not budget > 0, "--budget", budget, "not a positive time", "Write for example 60s"),
    )  # fmt: skip
    check_sensors(scene, sensors)
    modal = next((name for name, body in scene.bodies.items() if body.modal is not None), None)
    refuse(
        (isinstance(scene.solve.start, Start), "solve.start", "a table of a state",
         "the compared models have different coordinates", "Start from zero, quasistatic or periodic"),
        (modal is not None, f"bodies.{modal}.modal_data", modal and Path(str(scene.bodies[modal].modal_data)).name,
         "only preset coupled accepts modal data, so there is nothing to compare", "Give the body a beam"),
        (not elements_of(scene), "bodies", None, "no body has a beam: there is only one model", "Give a body a beam"),
    )  # fmt: skip
    return tuple(sensors or scene.sensors)


def _first_runs(
    runs: Runs, candidates: Iterable[Variant], until: float
) -> tuple[dict[Variant, Run], dict[str, str]]:
    found, left_out = {}, {}
    for candidate in candidates:
        if time.perf_counter() > until:
            left_out[candidate.name] = "no time left within the budget"
            continue
        try:
            found[candidate] = runs.run(candidate)
        except SceneError as error:
            left_out[candidate.name] = str(error)
    return found, left_out
