"""Error estimate of every sensor, by richer models of the finished motion.

A richer model of the same mechanism (a finer time grid, all modes, all terms, twice the elements) is applied to the
computed motion; its change of a sensor is the estimate: a hierarchical a-posteriori estimator (Bank and Smith 1993).
One-way equations are linear: :mod:`kaneflex.solve.one_way_corrections` corrects the motion by their residual. Coupled
equations are integrated again: :mod:`kaneflex.solve.coupled_corrections`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.response.time_statistics import statistics
from kaneflex.solve.error_stages import REQUEST, TOGETHER, Progress, Read, Stage, Unknown, max_difference
from kaneflex.solve.run_result import RunResult, nominal_seconds
from kaneflex.support.errors import SceneError

KINDS = ("time", "modes", "terms", "elements")
"""Sources of error, in the order in which the model is enriched."""
LONGEST, _RICHER = 1.0, 3.0
"""Nominal seconds of a coupled run up to which its error is estimated by default, and how many times as long a richer
run takes; without contacts as long, if its steps are longer."""
_SECOND_ORDER = 4.0 / 3.0
"""Total error relative to the change by half as long elements: forces converge with the square of the length."""


class ErrorEstimate(NamedTuple):
    """A sensor's estimated error: the largest over the run, in its SI unit.

    Attributes
    ----------
    total : float
        All sources together.
    time, modes, terms, elements : float or None
        Discretisation in time; modes that a reduction, or preset ``coupled``, truncates; groups of terms, including
        the deformation or its dynamics if the preset has none; element size. Each in addition to those before it.
        None if one richer run gives the total only: under ``coupled``, unless ``solve.errors = "all"`` requests them.
    coupling : float or None
        One-way coupling; None under ``coupled``, and unless requested by ``solve.errors = "all"``.
    statistics : float or None
        With contacts, of peak and rms: the larger relative error, times the peak. Motions with impacts diverge, so
        that their errors at an instant become as large as the values.
    """

    total: float
    time: float | None
    modes: float | None
    terms: float | None
    elements: float | None
    coupling: float | None = None
    statistics: float | None = None


def error_estimates(
    solution: RunResult, progress: Progress = lambda done: None
) -> tuple[Mapping[str, ErrorEstimate], str]:
    """Error estimate of each sensor, and the reason if there is none, or none for the one-way coupling.

    ``progress`` is called with the finished share of the work, 0 to 1.
    """
    reason = _impossible(solution)
    if reason:
        return {}, f"not estimated{reason}"
    try:
        read, stages = _stages(solution, progress)
    except Unknown as unknown:
        return {}, f"not estimated: {unknown}"
    except SceneError as error:  # a rigid run may have no elastic model
        return {}, f"not estimated: a richer model fails: {error.key}: {error.reason}"
    note, options = "", solution.model.options
    if options.errors == "all" and options.dynamics != "coupled":
        coupling, note = _coupling(read, stages, progress)
        stages += coupling
        if note and solution.model.module.FREE:  # coupling then dominates the error
            return {}, f"not estimated: {note}"
    return _estimates(read, stages), note


def _stages(solution: RunResult, progress: Progress) -> tuple[Read, list[Stage]]:
    if solution.model.options.dynamics == "coupled" or not solution.model.scene.is_elastic:
        from kaneflex.solve.coupled_corrections import coupled_stages

        return coupled_stages(solution, progress)
    from kaneflex.solve.one_way_corrections import one_way_stages

    return one_way_stages(solution)


def _coupling(read: Read, stages: list[Stage], progress: Progress) -> tuple[list[Stage], str]:
    """Stage of the one-way coupling, or the reason if it is not known."""
    from kaneflex.solve.coupled_corrections import coupling_change

    try:
        return [("coupling", coupling_change(read, stages, progress))], ""
    except Unknown as unknown:
        reason = str(unknown)
    except SceneError as error:
        reason = f"{error.key}: {error.reason}"
    return [], f"the error of the one-way coupling is not estimated: {reason}"


def _estimates(read: Read, stages: list[Stage]) -> dict[str, ErrorEstimate]:
    """Estimates by sensor; none for sensors without a value at any instant."""
    before: Mapping[str, np.ndarray] = read.values
    base = before
    found: dict[str, dict[str, float]] = {}
    for kind, values in stages:
        if kind in ("elements", TOGETHER):
            values = {name: before[name] + _SECOND_ORDER * (values[name] - before[name]) for name in values}
        if kind == "coupling":
            values = {name: before[name] + values[name] for name in values}
        found[kind] = {name: max_difference(values[name], before[name]) for name in values}
        before = values
    coupling, none = found.pop("coupling", {}), None if TOGETHER in found else 0.0
    impacts = bool(read.model.scene.contacts)

    def of(name: str) -> ErrorEstimate:
        shares = {kind: found.get(kind, {}).get(name, none) for kind in KINDS}
        both = [statistics(each[name], read.times) for each in (base, before)] if impacts else []
        shares["statistics"] = max(both[0].changes(both[1])) if both else None
        return ErrorEstimate(max_difference(before[name], base[name]), **shares, coupling=coupling.get(name))

    return {name: of(name) for name in read.model.scene.sensors if np.isfinite(before[name] - base[name]).any()}


def _impossible(solution: RunResult) -> str:
    """Reason why nothing is estimated, in words; empty if estimates are possible."""
    model, options = solution.model, solution.model.options
    if options.errors == "none":
        return ": solve.errors is none"
    if options.dynamics == "frozen":
        return f" under preset {options.preset}"
    if solution.outcome is not Outcome.COMPLETED:
        return f": the outcome of the run is {solution.outcome.name.lower()}"
    if len(solution.times) < 3:
        return ": the run has too few instants"
    if options.dynamics == "coupled" or (model.module.FREE and not model.scene.is_elastic):
        return _too_long(solution)
    if not model.scene.is_elastic:
        return ": no body is elastic, and drives prescribe the motion"
    if model.module.FREE and options.errors != "all":
        return ': the effect of the deformation on free joints is not known; request it by solve.errors = "all"'
    return ""


def _too_long(solution: RunResult) -> str:
    """Reason why a long coupled run has no estimates; empty if it is short."""
    model, seconds = solution.model, nominal_seconds(solution)
    if seconds <= LONGEST or model.options.errors != "quick":
        return ""
    from kaneflex.solve.coupled_corrections import step_of_richer

    richer = seconds if step_of_richer(model) > 1.0 and not model.scene.contacts else _RICHER * seconds
    if richer <= _RICHER * LONGEST:
        return ""
    return f": the run takes about {seconds:.2g} s, and a richer one about {richer:.2g} s; {REQUEST}"
