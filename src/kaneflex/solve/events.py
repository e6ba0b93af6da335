"""Times at which sensors pass the values of a scene's events."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.response.sensors import sensor_values
from kaneflex.scene.sensors import Event

if TYPE_CHECKING:
    from kaneflex.solve.run_result import RunResult

_RESOLUTION = 1e-12
"""Tolerance of an event's time as a share of the run."""


def find_events(solution: RunResult) -> dict[str, np.ndarray]:
    """Times of every event of the scene [s], ascending.

    A sensor that crosses a value twice between two stored instants is not detected.
    """
    return {name: _times(solution, event) for name, event in solution.model.scene.events.items()}


def happens(solution: RunResult, events: Iterable[Event]) -> bool:
    """True if any of these events lies within the solution."""
    return any(len(_passed(_gap(solution, event), event.direction)) for event in events)


def until_stop(solution: RunResult) -> RunResult:
    """The run up to the first event that stops it; unchanged if there is none."""
    if not any(event.stop for event in solution.model.scene.events.values()) or len(solution.times) < 2:
        return solution
    stops = {
        times[0]: name
        for name, times in find_events(solution).items()
        if solution.model.scene.events[name].stop and len(times)
    }
    if not stops:
        return solution
    end = min(stops)
    found = solution.at(np.append(solution.times[solution.times < end], end))
    words = f"{solution.trajectory.outcome.value}; the event {stops[end]} ended the run at t = {end:.9g} s"
    trajectory, contacts = replace(found.trajectory, message=words), getattr(found.trajectory, "contacts", None)
    if contacts is not None:  # the run went on to the next stored instants
        before = tuple(impact for impact in contacts.impacts if impact.begin <= end)
        trajectory = replace(trajectory, contacts=replace(contacts, impacts=before))
    return replace(found, trajectory=trajectory)


def _gap(solution: RunResult, event: Event) -> np.ndarray:
    scene = solution.model.scene
    return sensor_values(solution.motion, scene.sensors[event.sensor]) - scene.level(event)


def _passed(gap: np.ndarray, direction: str) -> np.ndarray:
    """Stored instants after which the gap crosses zero, from below (up) or above (down)."""
    before, after = gap[:-1], gap[1:]
    up, down = (before < 0) & (after >= 0), (before > 0) & (after <= 0)
    return np.flatnonzero({"up": up, "down": down, "both": up | down}[direction])


def _times(solution: RunResult, event: Event) -> np.ndarray:
    from scipy.optimize.elementwise import find_root

    times = solution.times
    before = _passed(_gap(solution, event), event.direction)
    if not len(before):
        return np.zeros(0)

    def gap(at: np.ndarray) -> np.ndarray:
        return _gap(solution.at(at.ravel()), event).reshape(at.shape)

    allowed = {"xatol": _RESOLUTION * (times[-1] - times[0]), "xrtol": 0.0}
    return find_root(gap, (times[before], times[before + 1]), tolerances=allowed).x
