"""Choice of a model within a tolerance: the richest one first, then cheaper ones."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from kaneflex.scene import Scene
from kaneflex.scene.settings import resolved
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.curves import Curves
from kaneflex.solve.loading import Progress
from kaneflex.solve.solution import Solution
from kaneflex.solve.summary_tables import Attempt, Choice
from kaneflex.solve.variants import Variant
from kaneflex.study.plan import digest, file_places
from kaneflex.study.runs import Runs
from kaneflex.study.trade.candidates import check_request, is_driven, neutral, neutral_settings, terms_of
from kaneflex.study.trade.reference import KNOWN, kept_curves, read_curves, recalled
from kaneflex.study.trade.trials import Trial, Trials
from kaneflex.support.errors import SceneError
from kaneflex.support.module_cache import cache_folder, keep

Purpose = Literal["run", "model", "code"]
"""Use of a choice: one run, the cheapest model for many runs, or code without the terms that are not needed."""
_LONGEST, _SHARE = 1.0, 0.5
"""Most processor seconds of trying cheaper models for one run, and as a share of a command that runs the richest."""


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
        As :func:`kaneflex.study.trade.trials.trade` takes them.
    purpose : {"run", "model", "code"}
        For one run the richest model is chosen: it has been run already. For code, groups of terms are dropped one by
        one while the model stays within.

    Raises
    ------
    SceneError
        As :func:`kaneflex.study.trade.trials.trade`, for example if the reference is not converged.
    """
    return chosen(scene, tolerance, sensors, progress, purpose)[0]


def chosen(
    scene: Scene, tolerance: float, sensors: Sequence[str] | None, progress: Progress, purpose: Purpose,
    others: Sequence[Scene] = (),
) -> tuple[Choice, Solution, Curves]:  # fmt: skip
    """Choice as of :func:`choose`, the chosen model's solution, and the curves of the reference.

    The model is within the tolerance in all ``others``, too, the scene with other numbers; errors are the largest.
    """
    started, scenes, share = time.perf_counter(), (scene, *others), math.inf if purpose == "run" else KNOWN
    trials = [Trials.begun(each, tolerance, sensors, progress, share) for each in scenes]
    own, model = trials[0], trials[0].richest()
    if purpose != "run":
        found = dict.fromkeys(model for each in trials for model in (*each.cheapest_models(), each.richest()))
        good = [model for model in found if all(each.within(model) for each in trials)]
        known = set.intersection(*(set(each.reference.sensors) for each in trials))
        if others and not (good and known):
            reason = "no model is within it at all compared points"
            raise SceneError("--tolerance", f"{100 * tolerance:.3g}%", reason, "Choose a larger one, or fewer sensors")
        good = good or [model]
        times = [each.seconds(good) for each in trials]
        model = min(good, key=lambda model: sum(of[model] for of in times))
    dropped = _drop_terms(own, model) if purpose == "code" else []
    model = dropped[-1] if dropped else model
    choices = [_choice(each, trial, model, sensors is not None) for each, trial in zip(scenes, trials, strict=True)]
    update = _largest(choices) if others else {}
    update["dropped"] = [each.settings[-1].removeprefix("solve.terms.").removesuffix("=false") for each in dropped]
    compared = purpose != "run" or is_driven(own.runs.scene)  # then no model is cheaper
    update |= {"compared": compared, "seconds": time.perf_counter() - started}
    return choices[0].model_copy(update=update), own.runs.run(model).solution, own.reference.curves


def check_varied(raw: Mapping[str, Any], option: str, paths: Iterable[str]) -> None:
    """Raise SceneError for a varied entry that the choice of a model sets."""
    for path in paths:
        table, *rest = resolved(raw, path)
        if rest[-1] == "elements" or (table == "solve" and rest[0] not in ("start", "duration", "mode_angle")):
            raise SceneError(option, path, "--tolerance chooses it", "Leave out one of the two")


def _largest(choices: Sequence[Choice]) -> dict[str, Any]:
    """Sensors that are within the tolerance in all choices of one model, and the largest shares of each sensor."""
    found: dict[str, Any] = {}
    for key in ("errors", "doubt", "open"):
        tables = [getattr(choice, key) for choice in choices]
        names = dict.fromkeys(name for table in tables for name in table)
        found[key] = {name: max(table.get(name, 0.0) for table in tables) for name in names}
    found["sensors"] = [name for name in choices[0].sensors if name not in found["open"]]
    return found | {key: {name: found[key][name] for name in found["sensors"]} for key in ("errors", "doubt")}


def _choice(scene: Scene, trials: Trials, model: Variant, named: bool) -> Choice:
    """Choice of a tried model; raises SceneError if a named sensor is not within the tolerance."""
    reference, beyond, tolerance = trials.reference, trials.beyond(model), trials.tolerance
    for sensor, error in beyond.items() if named or len(beyond) == len(reference.sensors) else ():
        reason = f"between its stored instants the finest model changes {sensor} by {100 * error:.2g} %"
        raise SceneError("--tolerance", f"{100 * tolerance:.3g}%", reason, "Increase solve.steps, or add damping")
    return Choice(
        tolerance=tolerance,
        sensors=[sensor for sensor in reference.sensors if sensor not in beyond],
        model=model.name,
        settings=[*neutral_settings(scene.raw), *model.settings],
        dropped=[],
        errors={each.sensor: each.error for each in trials.tried[model].differences if each.sensor not in beyond},
        open=dict(reference.open) | beyond,
        reference=reference.name,
        reference_settings=[*neutral_settings(scene.raw), *reference.model.settings],
        reference_note=reference.note,
        doubt=dict(reference.doubts),
        attempts=list(map(_attempt, trials.tried.values())),
        run_s=trials.runs.run(model).timing.total,
        richest_s=trials.known or trials.runs.run(trials.richest()).timing.total,
        compared=True,
        seconds=0.0,
        remembered=False,
    )


def cheaper(
    scene: Scene, known: Choice, curves: Curves, progress: Progress = lambda stage: None
) -> tuple[Choice, Solution | None]:
    """Choice of a cheaper model than the richest one, which an earlier command chose and compared with none, and its
    solution; the same choice if no model is cheaper and within.

    Trying takes at most about half the time of a command that runs the richest model. ``curves`` are those of its
    reference.
    """
    started, begun, runs = time.perf_counter(), time.process_time(), Runs(neutral(scene), progress)
    until = begun + min(_LONGEST, _SHARE * (begun + known.richest_s))
    trials = Trials(runs, known.tolerance, recalled(runs.scene, known, curves), until, known.richest_s)
    plain, coarse = trials.reference.levels[0], any(name in known.doubt for name in known.open)
    trials.tried[plain] = Trial(plain, within=known.model == plain.name and not coarse, coarse=coarse)
    found = [model for model in trials.cheapest_models() if model is not plain]
    seconds = trials.seconds(found)
    model = min(found, key=seconds.__getitem__, default=plain)
    del trials.tried[plain]
    attempts = [*known.attempts, *map(_attempt, trials.tried.values())]
    if not found or seconds[model] >= known.richest_s:
        return known.model_copy(update={"compared": True, "attempts": attempts}), None
    update = {"attempts": attempts, "seconds": time.perf_counter() - started}
    return _choice(scene, trials, model, False).model_copy(update=update), runs.run(model).solution


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
    purpose: Purpose = "model", others: Sequence[Scene] = (),
) -> tuple[Choice, Solution | None]:  # fmt: skip
    """Choice from the cache, else of :func:`chosen`, which is then stored; and the solution if there is one.

    Unreadable cache files are replaced. Parameters and errors are those of :func:`choose`; OutputError if the cache
    can't be written.
    """
    known_by = purpose, *(_digest(each.raw) for each in others)
    path = choice_file(scene, tolerance, check_request(scene, tolerance, 1.0, sensors), *known_by)
    reference, choice, solution = path.with_suffix(".npy"), _read(path), None
    known, curves = choice is not None, None
    if choice is None:
        choice, solution, curves = chosen(scene, tolerance, sensors, progress, purpose, others)
        data = None if choice.compared else kept_curves(curves, list(scene.sensors))
        if data is not None:
            keep(reference, data)
    elif not choice.compared:
        curves = read_curves(reference, list(scene.sensors))
        if curves is not None:
            choice, solution = cheaper(scene, choice, curves, progress)
            reference.unlink(missing_ok=True)
    if curves is not None or not known:
        keep(path, (choice.model_dump_json(indent=2) + "\n").encode())
    return choice.model_copy(update={"remembered": known and solution is None}), solution


def choice_file(scene: Scene, tolerance: float, sensors: Sequence[str], *others: str) -> Path:
    """Cache file of a scene's choice, named by digests of the structure and of everything else that it depends on.

    These are the scene's entries and tables, the sensors, the tolerance, ``others`` (the purpose, or other scenes) and
    kaneflex's own sources.
    """
    about = _digest(scene.raw, sorted(sensors), tolerance, *others)
    return cache_folder() / "choices" / f"{structure_hash(scene)}-{about}.json"


def _digest(raw: Mapping[str, Any], *about: object) -> str:
    files = {place: Path(file).read_bytes() for place, file in file_places(raw).items()}
    return digest(raw, files, *about)


def _read(path: Path) -> Choice | None:
    """Choice of a file; None if there is none, or it is damaged."""
    try:
        return Choice.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValidationError):
        return None
