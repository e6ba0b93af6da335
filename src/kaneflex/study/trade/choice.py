"""Choice of a model within a tolerance: the richest one first, then cheaper ones."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from kaneflex.scene import Scene
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.loading import Progress
from kaneflex.solve.solution import Solution
from kaneflex.solve.summary_tables import Attempt, Choice
from kaneflex.solve.variants import Variant
from kaneflex.study.plan import digest, file_places
from kaneflex.study.runs import Runs
from kaneflex.study.trade.candidates import neutral, neutral_settings, terms_of
from kaneflex.study.trade.ranking import check_request
from kaneflex.study.trade.reference import KNOWN, find_reference
from kaneflex.study.trade.trials import Trial, Trials
from kaneflex.support.errors import SceneError
from kaneflex.support.module_cache import cache_folder, keep

Purpose = Literal["run", "model", "code"]
"""Use of a choice: one run, the cheapest model for many runs, or code without the terms that are not needed."""
_QUICK = 2.0
"""Processor seconds of the richest model with its error estimate up to which no cheaper one is tried for one run."""
_LONGEST = 1.0
"""Most seconds of trying cheaper models for one run."""


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
        For one run the richest model is chosen if it took about as long, with its error estimate, as trying cheaper
        ones takes. For code, groups of terms are dropped one by one while the model stays within.

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
    started, computed = time.perf_counter(), time.process_time()  # a busy machine does not change the choice
    named, sensors = sensors is not None, check_request(scene, tolerance, 1.0, sensors)
    runs = Runs(neutral(scene), progress)
    share = 1.0 if purpose == "run" else KNOWN
    trials = Trials(runs, tolerance, find_reference(runs, sensors, tolerance, share, named))
    model = richest = trials.richest()
    quick = trials.within(richest) and time.process_time() - computed <= _QUICK
    if purpose != "run" or not quick:
        trials.until = time.perf_counter() + _LONGEST if purpose == "run" else math.inf
        found = [*trials.cheapest_models(), *([richest] if trials.within(richest) else [])]
        model = min(found or [richest], key=trials.seconds)
    beyond = trials.beyond(model)
    for sensor, error in beyond.items() if named else ():
        reason = f"between its stored instants the finest model changes {sensor} by {100 * error:.2g} %"
        raise SceneError("--tolerance", f"{100 * tolerance:.3g}%", reason, "Increase solve.steps, or add damping")
    dropped = _drop_terms(trials, model) if purpose == "code" else []
    model = dropped[-1] if dropped else model
    own, reference = runs.run(model), trials.reference
    return Choice(
        tolerance=tolerance,
        sensors=[sensor for sensor in reference.sensors if sensor not in beyond],
        model=model.name,
        settings=[*neutral_settings(scene), *model.settings],
        dropped=[each.settings[-1].removeprefix("solve.terms.").removesuffix("=false") for each in dropped],
        errors={each.sensor: each.error for each in trials.tried[model].differences if each.sensor not in beyond},
        open=dict(reference.open) | beyond,
        reference=reference.name,
        reference_settings=[*neutral_settings(scene), *reference.model.settings],
        reference_note=reference.note,
        doubt=dict(reference.doubts),
        attempts=list(map(_attempt, trials.tried.values())),
        run_s=own.timing.total,
        richest_s=runs.run(richest).timing.total,
        seconds=time.perf_counter() - started,
        remembered=False,
    ), own.solution


def _attempt(trial: Trial) -> Attempt:
    error, sensor = (trial.error, trial.worst.sensor) if trial.differences else (None, None)
    return Attempt(model=trial.name, error=error, worst_sensor=sensor, within=trial.within, reason=trial.reason)


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
        return trials.tried[single].error

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
