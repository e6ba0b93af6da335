"""Coupled equations through scipy's Radau, an independent check, in the independent coordinates."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.integrate.by_scipy import Progress, solution
from kaneflex.multibody import collocation
from kaneflex.multibody import tables as at

if TYPE_CHECKING:
    from kaneflex.multibody.run import Run


def by_scipy(run: Run, rows: slice, progress: Progress | None = None) -> int:
    """Fill rows of a run, with works integrated beside the motion; returns the outcome.

    progress: called with the completed share of these rows.
    """
    engine, times = run.engine, run.times[rows]
    y, v, a, _ = engine.motion
    engine.stand(run.here)
    engine.choose(float(times[0]))
    free = engine.independent
    works, last = engine.count(at.WORKS), times[0]

    def stand(t: float, x: np.ndarray) -> np.ndarray:
        """Motion at t; loops are followed from their last position."""
        nonlocal last
        y[:] += (t - last) * v
        last = t
        y[free], v[free] = x[: len(free)], x[len(free) : 2 * len(free)]
        if not engine.project(t):
            raise np.linalg.LinAlgError
        row = engine.row(t)
        row[-works:] = x[2 * len(free) :]
        return row

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        row = stand(t, x)
        return np.concatenate([x[len(free) : 2 * len(free)], a[free], engine.unfold(row[None])[5][0]])

    first = np.concatenate([y[free], v[free], run.here[-works:]])
    scale = run.scale[free]
    allowed = np.concatenate([scale, scale / run.longest, np.full(works, math.inf)])
    sizes = np.concatenate([np.ones(2 * len(free)) * run.method.length, np.zeros(works)])
    try:
        curve, failed = solution(
            "Radau", slope, (times[0], times[-1]), first, progress, run.evaluations,
            max_step=run.longest, rtol=run.method.tolerance, atol=allowed, sizes=sizes,
        )  # fmt: skip
        steps = [] if curve is None else curve.ts
        engine.stand(run.here)
        last = times[0]
        for t in np.union1d(steps[1:], times[1:][times[1:] <= max(steps, default=times[0])]):
            row = stand(float(t), curve(t))
            if t == run.times[run.filled + 1]:
                run.filled += 1
                run.rows[run.filled] = run.here[:] = row
    except np.linalg.LinAlgError:
        return collocation.SINGULAR
    run.counts[0] += max(0, len(steps) - 1)
    return collocation.TOO_SMALL if failed else collocation.DONE
