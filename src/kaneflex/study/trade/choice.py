"""Choice of a model within a tolerance: the richest one first, then cheaper ones."""

from __future__ import annotations

import math
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
from kaneflex.study.runs import Runs, clock
from kaneflex.study.trade.candidates import check_request, is_driven, neutral, neutral_settings, terms_of
from kaneflex.study.trade.reference import KNOWN, kept_curves, read_curves, recalled
from kaneflex.study.trade.trials import NEAR, Trial, Trials
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

    The models of each preset are tried in the order of their work until one is within; of these the fastest by its
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
    started, scenes, share = clock(), (scene, *others), math.inf if purpose == "run" else KNOWN
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
    model, dropped = _with_fewer_terms(own, model) if purpose == "code" else (model, [])
    choice = _choice(scene, trials, model, sensors is not None).model_copy(update={
        "dropped": dropped,
        "compared": purpose != "run" or is_driven(own.runs.scene),  # then no model is cheaper
        "seconds": clock() - started,
    })  # fmt: skip
    return choice, own.runs.run(model).solution, own.reference.curves


def check_varied(raw: Mapping[str, Any], option: str, paths: Iterable[str]) -> None:
    """Raise SceneError for a varied entry that the choice of a model sets."""
    for path in paths:
        table, *rest = resolved(raw, path)
        if rest[-1] == "elements" or (table == "solve" and rest[0] not in ("start", "duration", "mode_angle")):
            raise SceneError(option, path, "--tolerance chooses it", "Leave out one of the two")


def _largest(tables: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Largest value of each name."""
    found = dict[str, float]()
    for table in tables:
        found |= {name: max(value, found.get(name, 0.0)) for name, value in table.items()}
    return found


def _choice(scene: Scene, trials: Sequence[Trials], model: Variant, named: bool) -> Choice:
    """Choice of a tried model, with the largest errors of all trials; raises SceneError if a named sensor, or each, is
    not within the tolerance."""
    own, beyond = trials[0], [each.beyond(model) for each in trials]
    reference, tolerance = own.reference, own.tolerance
    for each, table in zip(trials, beyond, strict=True):
        for sensor, error in table.items() if named or len(table) == len(each.reference.sensors) else ():
            reason = f"between its stored instants the finest model changes {sensor} by {100 * error:.2g} %"
            raise SceneError("--tolerance", f"{100 * tolerance:.3g}%", reason, "Increase solve.steps, or add damping")
    unknown, doubts = (_largest(getattr(each.reference, key) for each in trials) for key in ("open", "doubts"))
    errors = _largest({each.sensor: each.error for each in of.tried[model].differences} for of in trials)
    missed = _largest([unknown, *beyond])
    sensors = [sensor for sensor in reference.sensors if sensor not in missed]
    return Choice(
        tolerance=tolerance,
        sensors=sensors,
        model=model.name,
        settings=[*neutral_settings(scene.raw), *model.settings],
        dropped=[],
        errors={sensor: errors[sensor] for sensor in sensors},
        open=missed,
        reference=reference.name,
        reference_settings=[*neutral_settings(scene.raw), *reference.model.settings],
        reference_note=reference.note,
        doubt={sensor: doubts[sensor] for sensor in reference.sensors if sensor not in unknown},
        attempts=list(map(_attempt, own.tried.values())),
        run_s=own.runs.run(model).timing.total,
        richest_s=own.known or own.runs.run(own.richest()).timing.total,
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
    started, runs = clock(), Runs(neutral(scene), progress)
    until = started + min(_LONGEST, _SHARE * (started + known.richest_s))
    trials = Trials(runs, known.tolerance, recalled(runs.scene, known, curves), until, known.richest_s)
    plain, coarse = trials.reference.levels[0], any(name in known.doubt for name in known.open)
    is_within, missed = known.model == plain.name and not coarse, known.attempts[0].error or 0.0
    trials.tried[plain] = Trial(plain, within=is_within, near=missed <= NEAR * known.tolerance, coarse=coarse)
    found = [model for model in trials.cheapest_models() if model is not plain]
    seconds = trials.seconds(found)
    model = min(found, key=seconds.__getitem__, default=plain)
    del trials.tried[plain]
    attempts = [*known.attempts, *map(_attempt, trials.tried.values())]
    if not found or seconds[model] >= known.richest_s:
        return known.model_copy(update={"compared": True, "attempts": attempts}), None
    update = {"attempts": attempts, "seconds": clock() - started}
    return _choice(scene, [trials], model, False).model_copy(update=update), runs.run(model).solution


def _attempt(trial: Trial) -> Attempt:
    error, sensor = (trial.error, trial.worst.sensor) if trial.differences else (None, None)
    return Attempt(model=trial.name, error=error, worst_sensor=sensor, within=trial.within, reason=trial.reason)


def _with_fewer_terms(trials: Trials, model: Variant) -> tuple[Variant, list[str]]:
    """The model without the groups of terms that the tolerance does not require, and these groups, the smallest effect
    first."""
    dynamics = {"quasistatic": "quasistatic", "stiffened": "dynamic"}.get(model.settings[0].rpartition("=")[2])

    def without(*terms: str) -> Variant:
        off = (f"solve.terms.{term}=false" for term in terms)
        return Variant(f"{model.name} without {', '.join(terms)}", (*model.settings, *off)) if terms else model

    def error(term: str) -> float:
        trials.within(without(term))
        return trials.tried[without(term)].error

    dropped = list[str]()
    for term in sorted(terms_of(trials.runs.scene, dynamics), key=error) if dynamics else ():
        dropped += [term] if trials.within(without(*dropped, term)) else []
    return without(*dropped), dropped


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
        data = None if choice.compared else kept_curves(curves)
        if data is not None:
            keep(reference, data)
    elif not choice.compared:
        curves = read_curves(reference, [*choice.doubt])
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
