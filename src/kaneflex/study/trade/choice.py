"""Choice of a model within a tolerance: the richest one first, then cheaper ones, priced from its motion or run."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from kaneflex.scene import Scene
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.curves import Curves
from kaneflex.solve.loading import Progress
from kaneflex.solve.solution import Solution
from kaneflex.solve.summary_tables import Attempt, Choice
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, worst
from kaneflex.study.plan import digest, file_places
from kaneflex.study.runs import Runs
from kaneflex.study.trade.candidates import (
    COUPLED,
    STIFFENED,
    Family,
    families,
    neutral,
    neutral_settings,
    terms_of,
)
from kaneflex.study.trade.linear_prices import LinearPrices, decided
from kaneflex.study.trade.ranking import check_request
from kaneflex.study.trade.reference import Reference, find_reference
from kaneflex.support.errors import SceneError
from kaneflex.support.module_cache import cache_folder, keep

Purpose = Literal["run", "model", "code"]
"""Use of a choice: one run, the cheapest model for many runs, or code without the terms that are not needed."""
_LONGEST, _SHARE = 1.0, 0.5
"""Most seconds of choosing for one run, beside the reference, and as a share of the time that this took."""
_SHORT = 0.3
"""Seconds of a run up to which it is repeated for its time: the first one may load compiled code."""


def choose(
    scene: Scene, tolerance: float = 0.01, sensors: Sequence[str] | None = None,
    progress: Progress = lambda stage: None, purpose: Purpose = "model",
) -> Choice:  # fmt: skip
    """Find the cheapest model whose sensors agree with the converged ones within a tolerance.

    Of each preset the models are tried in the order of their work until one is within; of these the fastest by its
    measured time is chosen.

    Parameters
    ----------
    scene, tolerance, sensors, progress
        As :func:`kaneflex.study.trade.ranking.trade` takes them.
    purpose : {"run", "model", "code"}
        For one run the richest model is chosen if its run took less time than trying cheaper ones may take, which is
        at most a second. For code, groups of terms are dropped one by one while the model stays within.

    Raises
    ------
    SceneError
        As :func:`kaneflex.study.trade.ranking.trade`, for example if the reference is not converged.
    """
    return chosen(scene, tolerance, sensors, progress, purpose)[0]


def chosen(
    scene: Scene, tolerance: float, sensors: Sequence[str] | None, progress: Progress, purpose: Purpose
) -> tuple[Choice, Solution]:
    """Choice as of :func:`choose`, and the chosen model's solution."""
    started = time.perf_counter()
    sensors = check_request(scene, tolerance, 1.0, sensors)
    basis = neutral(scene)
    runs, priced = Runs(basis, progress), LinearPrices.of(basis, sensors)
    trials = Trials(runs, sensors, tolerance, find_reference(runs, sensors, tolerance, priced), priced)
    model = richest = trials.richest()
    budget = min(_LONGEST, _SHARE * (time.perf_counter() - started))
    if purpose == "run":
        trials.until = time.perf_counter() + budget
    if purpose != "run" or runs.run(richest).timing.total > budget:
        model = min((*trials.cheapest_models(), richest), key=trials.seconds)
    dropped = _drop_terms(trials, model) if purpose == "code" else []
    model = dropped[-1] if dropped else model
    own = runs.run(model)
    return Choice(
        tolerance=tolerance,
        sensors=list(sensors),
        model=model.name,
        settings=[*neutral_settings(scene), *model.settings],
        dropped=[each.settings[-1].removeprefix("solve.terms.").removesuffix("=false") for each in dropped],
        errors={each.sensor: each.peak_share for each in trials.errors[model]},
        reference=trials.reference.name,
        reference_settings=[*neutral_settings(scene), *trials.reference.model.settings],
        reference_note=trials.reference.note,
        doubt={each.sensor: trials.reference.doubt(each.sensor) for each in trials.errors[model]},
        attempts=list(trials.attempts),
        run_s=own.timing.total,
        richest_s=runs.run(richest).timing.total,
        seconds=time.perf_counter() - started,
        remembered=False,
    ), own.solution


@dataclass(eq=False)
class Trials:
    """Comparisons of models with a reference, and a record of each.

    ``until``: moment of ``time.perf_counter`` after which no model is tried; ``kept``: models within the tolerance;
    ``coarse``: others that are within at their own instants, or whose steps do not resolve a load.
    """

    runs: Runs
    sensors: tuple[str, ...]
    tolerance: float
    reference: Reference
    priced: LinearPrices | None = None
    until: float = math.inf
    attempts: list[Attempt] = field(default_factory=list)
    errors: dict[Variant, tuple[Difference, ...]] = field(default_factory=dict)
    kept: set[Variant] = field(default_factory=set)
    coarse: set[Variant] = field(default_factory=set)

    def within(self, candidate: Variant) -> bool:
        """True if a candidate is within the tolerance, by its price if that decides, else by a run; False if it can't
        be run, or not in time."""
        left = self.until - time.perf_counter()
        if candidate not in self.errors and left > 0:
            self.errors[candidate] = ()
            known = self.runs.kept.get(COUPLED)
            if candidate.settings[0] == COUPLED.settings[0] and known is not None and known.timing.total > left:
                return False  # a coupled model may take as long as the plain one
            try:
                price = None if self.priced is None else self.priced.curves(candidate)
                if not self._judge(candidate, price):
                    self._judge(candidate, self.runs.run(candidate, left).curves, run=True)
            except SceneError as error:
                self._note(candidate.name, str(error))
        return candidate in self.kept

    def _judge(self, candidate: Variant, curves: Curves | None, run: bool = False) -> bool:
        """True if curves decide if a candidate is within the tolerance; curves of a run always do."""
        if curves is None:
            return False
        reference, tolerance = self.reference, self.tolerance
        found = reference.errors(self.sensors, candidate.name, curves)
        if not run and not decided(found, tolerance, reference.doubt):
            return False
        self.errors[candidate] = found
        most, within = worst(found), reference.within(found, tolerance, curves.undersampled)
        if within:
            self.kept.add(candidate)
        elif curves.undersampled or reference.within(reference.errors(self.sensors, "", curves, False), tolerance):
            self.coarse.add(candidate)
        reason = "; ".join(curves.undersampled)
        self._note(candidate.name, reason, most, within, not run)
        return True

    def _note(
        self, name: str, reason: str, most: Difference | None = None, within: bool = False, priced: bool = False
    ) -> None:
        error, sensor = (None, None) if most is None else (most.peak_share, most.sensor)
        self.attempts.append(
            Attempt(model=name, error=error, worst_sensor=sensor, within=within, priced=priced, reason=reason)
        )

    def seconds(self, model: Variant) -> float:
        """Time of a model's run [s] in this process; of short ones that of the second run."""
        first = self.runs.run(model).timing.total
        return first if first > _SHORT else self.runs.again(model).total

    def richest(self) -> Variant:
        """First model within the tolerance on the way to the reference, beginning with the plain one of its preset."""
        model, levels = self.reference.model, self.reference.levels[1:]
        plain = COUPLED if model.settings[0] == COUPLED.settings[0] else STIFFENED
        return next((each for each in (plain, *levels) if self.within(each)), model)

    def cheapest_models(self) -> list[Variant]:
        """Cheapest model within the tolerance of each preset that has any.

        If ``stiffened`` is not within, and not for too few steps, no other one-way preset is.
        """
        *one_way, coupled = families(self.runs.scene)
        if self.runs.scene.is_spatial and math.isfinite(self.until):
            one_way = []  # their runs take about as long as those of coupled, or longer
        found = []
        for family in (*reversed(one_way), coupled):
            beyond = bool(self.errors.get(STIFFENED)) and not {STIFFENED} & (self.kept | self.coarse)
            model = None if beyond and family is not coupled else self._cheapest_of(family)
            found += [] if model is None else [model]
        return found

    def _cheapest_of(self, family: Family) -> Variant | None:
        """Cheapest model of a family within the tolerance; finer ones than the plain one if this is too coarse."""
        models = (*family.cheaper, family.plain) if self.within(family.plain) else ()
        models = family.finer if family.plain in self.coarse else models
        return next((model for model in models if self.within(model)), None)


def _drop_terms(trials: Trials, model: Variant) -> list[Variant]:
    """Models with one group of terms less each, the smallest effect first, while they are within the tolerance."""
    dynamics = {"quasistatic": "quasistatic", "stiffened": "dynamic"}.get(model.settings[0].rpartition("=")[2])
    if dynamics is None:
        return []

    def without(base: Variant, term: str) -> Variant:
        name = f"{base.name}, {term}" if " without " in base.name else f"{base.name} without {term}"
        return Variant(name, (*base.settings, f"solve.terms.{term}=false"))

    def error(term: str) -> float:
        single = without(model, term)
        trials.within(single)
        found = trials.errors[single]
        return worst(found).peak_share if found else math.inf

    found: list[Variant] = []
    for term in sorted(terms_of(trials.runs.scene, dynamics), key=error):
        leaner = without(found[-1] if found else model, term)
        if trials.within(leaner):
            found.append(leaner)
    return found


def remembered_choice(
    scene: Scene, tolerance: float, sensors: Sequence[str] | None = None, progress: Progress = lambda stage: None,
    purpose: Purpose = "model",
) -> tuple[Choice, Solution | None]:  # fmt: skip
    """Choice from the cache, else of :func:`chosen`, which is then stored; and the solution if there is one.

    Unreadable cache files are replaced. Parameters and errors are those of :func:`choose`; OutputError if the cache
    can't be written.
    """
    path = choice_file(scene, tolerance, check_request(scene, tolerance, 1.0, sensors), purpose)
    try:
        kept = Choice.model_validate_json(path.read_text(encoding="utf-8"))
        return kept.model_copy(update={"remembered": True}), None
    except (OSError, UnicodeDecodeError, ValidationError):
        choice, solution = chosen(scene, tolerance, sensors, progress, purpose)
    keep(path, (choice.model_dump_json(indent=2) + "\n").encode())
    return choice, solution


def choice_file(scene: Scene, tolerance: float, sensors: Sequence[str], purpose: Purpose = "model") -> Path:
    """Cache file of a scene's choice, named by digests of the structure and of everything else that it depends on.

    These are the scene's entries and tables, the sensors, the tolerance, the purpose and kaneflex's own sources.
    """
    files = {place: Path(file).read_bytes() for place, file in file_places(scene).items()}
    about = digest(scene, files, sorted(sensors), tolerance, purpose)
    return cache_folder() / "choices" / f"{structure_hash(scene)}-{about}.json"
