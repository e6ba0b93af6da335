"""Models of a scene, each run and compared with its reference."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.solve.loading import Progress
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, worst
from kaneflex.study.runs import Cost, Runs
from kaneflex.study.trade.candidates import COUPLED, STIFFENED, check_request, families, neutral
from kaneflex.study.trade.reference import Reference, find_reference
from kaneflex.support.errors import SceneError

_SHORT = 0.3
"""Seconds of a run up to which it is repeated for its time, and of these repeats: the first run may load compiled code.
"""


@dataclass(frozen=True)
class Trial:
    """A model with its errors.

    Attributes
    ----------
    candidate : Variant
    differences : tuple of Difference
        From the reference, by sensor; empty if the model can't be run.
    within : bool
        Whether every error, including the reference's uncertainty, is within the tolerance. Models whose steps do not
        resolve their loads are not: their error is a matter of luck.
    coarse : bool
        Whether only its steps are too few: it is within at its own instants, or does not resolve its loads.
    reason : str
        Why it can't be run, or the loads that it does not resolve.
    """

    candidate: Variant
    differences: tuple[Difference, ...] = ()
    within: bool = False
    coarse: bool = False
    reason: str = ""

    @property
    def name(self) -> str:
        return self.candidate.name

    @property
    def worst(self) -> Difference:
        """Sensor with the largest error as a share of its peak."""
        return worst(self.differences)

    @property
    def error(self) -> float:
        """Largest error max|y - y_ref| / max|y_ref| of a sensor; infinite if the model can't be run."""
        return self.worst.error if self.differences else math.inf

    @property
    def rms(self) -> float:
        """Largest rms error of a sensor as a share of its peak."""
        return max(difference.rms_error for difference in self.differences)


@dataclass(frozen=True, kw_only=True)
class Ranked(Trial):
    """A model with its errors, and the cost of repeated runs."""

    cost: Cost


@dataclass(eq=False)
class Trials:
    """Comparisons of models with a reference, each made once.

    ``until``: moment of ``time.process_time`` after which no model is tried; ``known``: time of the richest model's run
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
        left = self.until - time.process_time()
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
        return Trial(candidate, found, close and resolved, not resolved or (at_its_own and not close), reason)

    def seconds(self, models: Sequence[Variant]) -> dict[Variant, float]:
        """Times of models' runs [s] in this process: of short ones the least of some runs in turn."""
        found = {model: [self.runs.run(model).timing] for model in models}
        short = [model for model in models if found[model][0].total <= _SHORT]
        for model, again in self.runs.repeats(short, time.perf_counter() + _SHORT).items():
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
                models = (*family.cheaper, family.plain) if self.within(family.plain) else ()
                coarse = family.plain in self.tried and self.tried[family.plain].coarse
                found += [next(filter(self.within, family.finer if coarse else models), None)]
        return [model for model in found if model is not None]
