"""Findings of `kaneflex check` without a solution: the model, dead centres, doubtful entries."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from kaneflex.fem.freedom import count_freedom, mobility_by_rank
from kaneflex.mechanism.closure import Courses, courses_of, instants
from kaneflex.mechanism.dead_centres import Closing, closings
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import has_modes, reference_modes
from kaneflex.report.presentation import (
    Blocks,
    closing_lines,
    is_followed,
    mobility,
    modelled,
    spatial_mobility,
)
from kaneflex.scene.plausible import stubby_links
from kaneflex.solve.initial import start_coordinates
from kaneflex.solve.run_result import natural_frequencies
from kaneflex.solve.validity import foreseen
from kaneflex.support.weak_cache import WeakCache

_MOST_INSTANTS = 20_000
"""Number of instants at which the stiffness is evaluated."""
_MOST_NAMES = 12
"""Number of coordinates that fit into two lines of a terminal."""
_CLOSINGS: WeakCache[Model, list[Closing]] = WeakCache()


def description(model: Model) -> Blocks:
    """One line for each part of the mechanism, then how near its loops are to dead centres, and what is solved."""
    state = start_coordinates(model) if model.options.dynamics == "coupled" else ()
    equations = {
        "degrees of freedom": str(model.degrees_of_freedom),
        **{title: _named(names) for title, names in (
            ("coordinates", (*model.coordinates, *model.shapes_given)), ("coordinates of a state", state)) if names},
        **_lowest(model),
        "structure": model.motion.module.STRUCTURE,
        "module": _module(model),
    }
    return {
        **modelled(model),
        "loops over the run" if is_followed(model) else "loops at the start": closing_lines(_closings(model)),
        **_mobility(model),
        "equations": equations,
    }


def _named(coordinates: Sequence[str]) -> str:
    """All coordinates of a small model; the first and the last ones of a larger one."""
    shown = list(coordinates)
    if len(shown) > _MOST_NAMES:
        shown = [*shown[: _MOST_NAMES - 2], "...", shown[-1]]
    return " ".join(shown)


def warnings(model: Model) -> tuple[str, ...]:
    """Warnings of a run that need no solution: numbers in a wrong unit, too few steps, rounding, buckling loads."""
    times = np.linspace(0.0, model.options.duration, min(model.options.steps, _MOST_INSTANTS) + 1)
    frequencies = natural_frequencies(model) if model.options.dynamics in ("dynamic", "coupled") else ()
    return (*model.warnings, *foreseen(model, frequencies, times, model.options.integrator != "spectral"))


def notes(model: Model) -> Iterator[str]:
    """Findings that may be intended: loops near dead centres, and beams too short for beam theory."""
    yield from (found.note for found in _closings(model) if found.note)
    yield from stubby_links(model.scene.bodies, model.in_space is not None)


def _closings(model: Model) -> list[Closing]:
    def find() -> list[Closing]:
        if model.in_space is not None:
            from kaneflex.multibody.time.spatial_motion import firmness

            return firmness(model.in_space, _times(model))
        return closings(*_over_the_run(model))

    return _CLOSINGS.of(model, find)


def _over_the_run(model: Model) -> tuple[NumericMechanism, Courses]:
    """Planar mechanism and its poses, as far as they are known."""
    mechanism = mechanism_of(model.scene)
    return mechanism, courses_of(mechanism, model.motion.at(_times(model)))


def _times(model: Model) -> np.ndarray:
    return instants(mechanism_of(model.scene)) if is_followed(model) else np.zeros(1)


def _mobility(model: Model) -> Blocks:
    if model.in_space is not None:
        from kaneflex.multibody.model.assembly import rigid_system
        from kaneflex.multibody.model.initial_state import choose, start_of

        system = model.in_space.module.system
        if system.engine.shapes.any():  # shapes are no freedoms of joints
            system = rigid_system(system.mechanism, system.module, system.parameters)
            return spatial_mobility(system, choose(system, start_of(system).q, prefer=True))
        (start,) = system.engine.instants(model.in_space.curve.rows(np.zeros(1))).q
        return spatial_mobility(system, choose(system, start, prefer=True))
    mechanism, courses = _over_the_run(model)
    by_rank = None if mechanism.frame else mobility_by_rank(mechanism, courses)
    return mobility(count_freedom(mechanism), None, by_rank)


def _lowest(model: Model) -> dict[str, str]:
    """Lowest natural frequency at the reference configuration with the steps per period; empty without vibration."""
    vibrates = model.options.dynamics == "dynamic" and has_modes(model)
    lowest = float(reference_modes(model, 1)[0][0]) / (2.0 * math.pi) if vibrates else 0.0
    if not lowest:
        return {}
    resolved = f"{1.0 / (lowest * model.step):.3g} steps in a period"
    if model.options.integrator == "spectral":
        resolved = f"{lowest * model.options.duration:.3g} times the frequency of the cycle"
    return {"lowest mode": f"{lowest:.4g} Hz, {resolved}"}


def _module(model: Model) -> str:
    name = model.module.__name__
    return name if name.startswith("kaneflex.generated.") else f"{model.module.__file__}, derived from this structure"
