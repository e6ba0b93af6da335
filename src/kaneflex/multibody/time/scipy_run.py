"""Coupled equations through scipy's Radau, an independent check, in the independent coordinates."""

from __future__ import annotations

import math

import numpy as np

from kaneflex.integrate.by_scipy import Progress, solution
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.time import collocation


def by_scipy(
    engine: Engine, here: np.ndarray, times: np.ndarray, longest: float, tolerance: float, length: float,
    evaluations: list[int], progress: Progress | None = None,
) -> tuple[int, np.ndarray, int]:  # fmt: skip
    """Rows at ``times`` [s] after the first one, with works integrated beside the motion.

    here : row at the first time, which becomes that of the last one reached
    longest : longest step [s]
    tolerance, length : error allowed of angles [rad], and of displacements as a share of ``length`` [m]
    evaluations : one number, the evaluations so far
    progress : called with the completed share of these rows

    Returns the outcome, the rows and the number of steps.
    """
    y, v, a, _ = engine.motion
    engine.stand(here)
    engine.choose(float(times[0]))
    free = engine.choice.independent
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

    first = np.concatenate([y[free], v[free], here[-works:]])
    scale = tolerance * np.where(engine.turns[free], 1.0, length)
    allowed = np.concatenate([scale, scale / longest, np.full(works, math.inf)])
    sizes = np.concatenate([np.ones(2 * len(free)) * length, np.zeros(works)])
    ended, rows, steps = collocation.SINGULAR, list[np.ndarray](), 0
    try:
        curve, failed = solution(
            "Radau", slope, (times[0], times[-1]), first, progress, evaluations,
            max_step=longest, rtol=tolerance, atol=allowed, sizes=sizes,
        )  # fmt: skip
        reached = times[:1] if curve is None else curve.ts
        engine.stand(here)
        last = times[0]
        for t in np.union1d(reached[1:], times[1:][times[1:] <= max(reached)]):
            row = stand(float(t), curve(t))
            if t == times[len(rows) + 1]:
                here[:] = row
                rows.append(row)
        ended, steps = collocation.TOO_SMALL if failed else collocation.DONE, len(reached) - 1
    except np.linalg.LinAlgError:
        pass
    return ended, np.array(rows).reshape(-1, len(here)), steps
