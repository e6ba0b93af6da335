"""Choice of the cheapest model within a tolerance, by indicators and few runs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ValidationError

from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.curves import Curves
from kaneflex.solve.loading import Progress
from kaneflex.solve.quasistatic import LARGEST_DENSE
from kaneflex.solve.summary_tables import Attempt, Choice
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, differences, worst
from kaneflex.study.plan import digest, file_places
from kaneflex.study.runs import Runs
from kaneflex.study.trade.candidates import candidates_of, elements_of, neutral, neutral_settings, terms_of
from kaneflex.study.trade.indicators import indicators
from kaneflex.study.trade.linear_prices import LinearPrices, decided
from kaneflex.study.trade.ranking import check_request
from kaneflex.study.trade.reference import Reference, find_reference
from kaneflex.support.errors import SceneError
from kaneflex.support.module_cache import cache_folder, keep

_DYNAMICS = {"quasistatic": "quasistatic", "stiffened": "dynamic"}
_FAMILIES = ("rigid", *_DYNAMICS, "coupled")
"""Presets that can be chosen. Preset linear is stiffened without K_g; preset paper is for comparisons only."""
_HOPELESS = 3.0
"""Multiple of the tolerance above which a first-order indicator excludes a model."""
_INTEGRATING = {"none": 0.0, "spectral": 1.0, "radau": 1.7, "gauss": 1.0, "generalised-alpha": 0.65, "newmark": 0.5}
"""Relative work of a step of each integrator."""


def choose(
    scene: Scene, tolerance: float = 0.01, sensors: Sequence[str] | None = None,
    progress: Progress = lambda stage: None,
) -> Choice:  # fmt: skip
    """Find the cheapest model whose sensors agree with the converged ones within a tolerance.

    Candidates (:func:`kaneflex.study.trade.candidates.candidates_of`) are tried in order of expected work until one is
    within the tolerance. Then groups of terms are dropped one by one, the smallest indicator first, while it stays
    within. A preset with unfavourable indicators is first tried at its finest, and given up if that fails.

    Parameters
    ----------
    scene, tolerance, sensors, progress
        As :func:`kaneflex.study.trade.ranking.trade` takes them.

    Raises
    ------
    SceneError
        As :func:`kaneflex.study.trade.ranking.trade`, for example if the reference is not converged.
    """
    started = time.perf_counter()
    sensors = check_request(scene, tolerance, 1.0, sensors)
    basis = neutral(scene)
    progress("indicators along the rigid motion")
    found = indicators(basis)
    runs, priced = Runs(basis, progress), LinearPrices.of(basis, sensors)
    trials = Trials(runs, sensors, tolerance, find_reference(runs, sensors, tolerance, priced), priced)
    candidate = cheapest(trials, found)
    candidate, dropped = _without_terms(trials, candidate, found)
    return Choice(
        tolerance=tolerance,
        sensors=list(sensors),
        model=candidate.name,
        settings=[*neutral_settings(scene), *candidate.settings],
        dropped=dropped,
        errors={each.sensor: each.peak_share for each in trials.errors[candidate]},
        reference=trials.reference.name,
        reference_settings=[*neutral_settings(scene), *trials.reference.model.settings],
        reference_note=trials.reference.note,
        doubt={each.sensor: trials.reference.doubt(each.sensor) for each in trials.errors[candidate]},
        indicators=found,
        attempts=list(trials.attempts),
        seconds=time.perf_counter() - started,
        remembered=False,
    )


@dataclass(frozen=True, eq=False)
class Trials:
    """Comparisons of models with a reference, and a record of each."""

    runs: Runs
    sensors: tuple[str, ...]
    tolerance: float
    reference: Reference
    priced: LinearPrices | None = None
    attempts: list[Attempt] = field(default_factory=list)
    errors: dict[Variant, tuple[Difference, ...]] = field(default_factory=dict)
    kept: set[Variant] = field(default_factory=set)

    def within(self, candidate: Variant) -> bool:
        """True if a candidate is within the tolerance, by its price if that decides, else by a run; False if it can't
        be run."""
        if candidate not in self.errors:
            self.errors[candidate] = ()
            try:
                price = None if self.priced is None else self.priced.curves(candidate)
                if not self._judge(candidate, price):
                    self._judge(candidate, self.runs.run(candidate).curves, run=True)
            except SceneError as error:
                self.note(candidate.name, str(error))
        return candidate in self.kept

    def _judge(self, candidate: Variant, curves: Curves | None, run: bool = False) -> bool:
        """True if curves decide if a candidate is within the tolerance; curves of a run always do."""
        if curves is None:
            return False
        reference, tolerance = self.reference, self.tolerance
        compared = (candidate.name, curves, reference.curves, reference.period)
        found = differences(self.runs.scene, self.sensors, *compared)
        if not run and not decided(found, tolerance, reference.doubt):
            return False
        self.errors[candidate] = found
        most, within = worst(found), reference.within(found, tolerance, curves.undersampled)
        if within:
            self.kept.add(candidate)
        self.attempts.append(
            Attempt(
                model=candidate.name, error=most.peak_share, worst_sensor=most.sensor,
                within=within, priced=not run, reason="; ".join(curves.undersampled),
            )
        )  # fmt: skip
        return True

    def note(self, name: str, reason: str) -> None:
        """Record why a model was not run to the end."""
        self.attempts.append(
            Attempt(model=name, error=None, worst_sensor=None, within=False, priced=False, reason=reason)
        )


def cheapest(trials: Trials, found: Mapping[str, float | None]) -> Variant:
    """Candidate of least expected work within the tolerance; the reference itself if there is none."""
    work = {}
    for each in (candidate for candidate in candidates_of(trials.runs.scene) if _preset(candidate) in _FAMILIES):
        try:
            work[each] = expected_work(trials.runs.scene, each)
        except SceneError as error:
            trials.note(each.name, str(error))
    given_up = {preset for preset in _DYNAMICS if _doubtful(trials, preset, found) and _fails(trials, preset, work)}
    for candidate in sorted(work, key=work.__getitem__):
        if not _sets(candidate, "solve.terms.") and _preset(candidate) not in given_up and trials.within(candidate):
            return candidate
    trials.within(trials.reference.model)
    return trials.reference.model


def _preset(candidate: Variant) -> str:
    return candidate.settings[0].removeprefix("solve.preset=")


def _sets(candidate: Variant, *keys: str) -> bool:
    return any(setting.startswith(keys) for setting in candidate.settings)


def _doubtful(trials: Trials, preset: str, found: Mapping[str, float | None]) -> bool:
    inertia = found["dynamics"]
    hopeless = preset == "quasistatic" and (inertia is None or inertia > _HOPELESS * trials.tolerance)
    return hopeless or trials.reference.model.settings[0] == "solve.preset=coupled"


def _fails(trials: Trials, preset: str, work: Mapping[Variant, float]) -> bool:
    """True if the finest model of a preset is out of tolerance; then its coarser models are not tried."""

    def fineness(candidate: Variant) -> tuple[int, int]:
        model = candidate.of(trials.runs.scene)
        return sum(elements_of(model).values()), resolve_options(model).steps

    whole = (each for each in work if _preset(each) == preset and not _sets(each, "solve.terms.", "solve.modes="))
    finest = max(whole, key=fineness)
    if trials.within(finest):
        return False
    trials.note(f"{preset}, coarser", f"{finest.name}, the finest of its preset, is out of tolerance")
    return True


def _without_terms(
    trials: Trials, candidate: Variant, found: Mapping[str, float | None]
) -> tuple[Variant, list[str]]:
    """Candidate without all groups of terms that the tolerance allows to drop, and those groups."""
    dropped: list[str] = []
    dynamics = _DYNAMICS.get(_preset(candidate))
    if dynamics is None:
        return candidate, dropped
    for term in sorted(terms_of(trials.runs.scene, dynamics), key=lambda name: found.get(name) or 0.0):
        name = f"{candidate.name} without {term}" if not dropped else f"{candidate.name}, {term}"
        if (found.get(term) or 0.0) > _HOPELESS * trials.tolerance:
            trials.note(name, f"the term changes displacements by {100 * found[term]:.2g} %, to first order")
            continue
        leaner = Variant(name, (*candidate.settings, f"solve.terms.{term}=false"))
        if trials.within(leaner):
            candidate = leaner
            dropped.append(term)
    return candidate, dropped


def expected_work(scene: Scene, candidate: Variant) -> float:
    """Estimated wall time of a run [us], measured on one machine; only the order of candidates matters.

    Set-up, and per step: a dense solve (quasi-static) or band matrices (dynamic), and reading the sensors, for which a
    modal reduction is expanded.
    """
    model = candidate.of(scene)
    options, elements = resolve_options(model), elements_of(model)
    reduced = options.reduction == "craig-bampton"
    size = sum(min(3 * count, options.modes + 1) if reduced else 3 * count for count in elements.values())
    by_step = {
        "rigid": 0.0,
        "quasistatic": 0.6 + (0.05 * size**2 if size <= LARGEST_DENSE else 0.75 * size),
        "dynamic": (0.2 * size + 0.004 * size**2) * _INTEGRATING[options.integrator],
        "coupled": 60.0 + 2.0 * size,
    }[options.dynamics]
    reading = 2.0 + 0.2 * len(scene.sensors) + 2.5 * reduced
    set_up = {"rigid": 1e3, "quasistatic": 5e3, "dynamic": 8e3, "coupled": 1e5}[options.dynamics] + 3e3 * reduced
    tight = 1.3 if options.dynamics == "coupled" and options.tolerance < 1e-6 else 1.0
    return set_up + options.steps * (reading + tight * by_step)


def remembered_choice(
    scene: Scene, tolerance: float, sensors: Sequence[str] | None = None, progress: Progress = lambda stage: None
) -> Choice:
    """Choice from the cache, else from :func:`kaneflex.study.trade.choice.choose`, which is then stored.

    Unreadable cache files are replaced. Parameters and errors are those of ``choose``; OutputError if the cache can't
    be written.
    """
    path = choice_file(scene, tolerance, check_request(scene, tolerance, 1.0, sensors))
    try:
        return Choice.model_validate_json(path.read_text(encoding="utf-8")).model_copy(update={"remembered": True})
    except (OSError, UnicodeDecodeError, ValidationError):
        found = choose(scene, tolerance, sensors, progress)
    keep(path, (found.model_dump_json(indent=2) + "\n").encode())
    return found


def choice_file(scene: Scene, tolerance: float, sensors: Sequence[str]) -> Path:
    """Cache file of a scene's choice, named by digests of the structure and of everything else that it depends on.

    These are the scene's entries and tables, the sensors, the tolerance and kaneflex's own sources.
    """
    files = {place: Path(file).read_bytes() for place, file in file_places(scene).items()}
    about = digest(scene, files, sorted(sensors), tolerance)
    return cache_folder() / "choices" / f"{structure_hash(scene)}-{about}.json"
