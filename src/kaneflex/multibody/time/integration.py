"""From a system and its initial state to the motion of its run, in the plane and in space."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.error_bounds import Method
from kaneflex.multibody.time.run import Run, Stop
from kaneflex.multibody.time.spatial_forward import SpatialRun
from kaneflex.multibody.time.trajectory import CoupledTrajectory


def begun(system: Any, start: State, times: np.ndarray, method: Method, ends: np.ndarray | None = None) -> Run:
    """Run of a system from a start at times[0]; ``ends`` [s], including all ``times``, prescribe the ends of steps in
    place of error control."""
    kind = SpatialRun if system.engine.in_space else Run
    return kind(system, start, times, method, ends)


def integrate(
    system: Any,
    start: State,
    times: np.ndarray,
    method: Method,
    progress: Callable[[float], None] | None = None,
    stop: Stop | None = None,
    ends: np.ndarray | None = None,
    whole: bool = False,
) -> CoupledTrajectory:
    """Integrate as :func:`begun` describes; returns the motion at ``times`` [s] up to its end.

    ``whole``: also keep the run, with the rows at the ends of all steps, as in space.
    """
    run = begun(system, start, times, method, ends)
    run.whole |= whole
    started = time.perf_counter()
    ended = run.go(progress, stop)
    return finished(run, ended, 1e9 * (time.perf_counter() - started) / max(1.0, run.counts[0] + run.counts[1]))


def finished(run: Run, ended: tuple[Outcome, str], ns: float) -> CoupledTrajectory:
    """Motion of a run up to its end, or to the position at which it left its branch; ``ns``: nanoseconds a step."""
    found = run.trajectory(run.table[: run.filled + 1], *ended, ns, run.ends)
    if run.whole:
        return replace(found, curve=run)
    if len(found.energy.jumps()):
        from kaneflex.multibody.time.lost_branch import departure  # which few runs need

        left = departure(run.system, found, run.method.integrator)
        found = found if left is None else run.cut(*left, found)
    changes = [row for row in run.changes if run.times[0] <= row[0] <= run.times[run.filled]]
    return replace(found, changes=run.trajectory(np.array(changes))) if changes else found
