"""Coupled runs in the plane through SciPy's Radau, an independent check of the compiled integration."""

import math
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from kaneflex.integrate.system import Outcome
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.time.run import Run, finished
from kaneflex.solve.coupled import beginning, method_of, result_of
from kaneflex.solve.solution import Solution

PIECE = 100
"""Stored instants between choices of independent coordinates."""
NUDGE = float(np.sqrt(np.finfo(float).eps))
"""Relative step of difference quotients."""


def scipy_motion(model) -> Solution:
    """The run of a coupled model, in its independent coordinates, by the tolerance of its scene."""
    times = model.step * np.arange(model.options.steps + 1)
    run = Run(model.coupled, beginning(model), times, method_of(model))
    for first in range(0, len(times) - 1, PIECE):
        follow(run, times[first : first + PIECE + 1])
    run.pieces.append((run.table, run.engine.choice))
    return Solution.of(result_of(model, finished(run, (Outcome.COMPLETED, "completed"), 0.0), 0.0))


def follow(run, times):
    """Rows of the run at its next instants ``times`` [s], the first of which is its last one."""
    engine, tolerance, length = run.engine, run.method.tolerance, run.method.length
    y, v, a, _ = engine.motion
    engine.set_row(run.state)
    engine.choose(times[0])
    free, works, last = engine.choice.independent, engine.count(at.WORKS), times[0]

    def row(t, x):
        """Motion at t; loops are followed from their last position."""
        nonlocal last
        y[:] += (t - last) * v
        last = t
        y[free], v[free] = x[: len(free)], x[len(free) : 2 * len(free)]
        assert engine.project(t)
        found = engine.row(t)
        found[-works:] = x[2 * len(free) :]
        return found

    def slope(t, x):
        now = row(t, x)
        powers = engine.instants(engine.unfold(now[None])).powers[0]
        return np.concatenate([x[len(free) : 2 * len(free)], a[free], powers])

    scale = tolerance * np.where(engine.turns[free], 1.0, length)
    first = np.concatenate([y[free], v[free], run.state[-works:]])
    found = solve_ivp(
        slope, (times[0], times[-1]), first, "Radau", dense_output=True, max_step=run.longest, rtol=tolerance,
        atol=np.concatenate([scale, scale / run.longest, np.full(works, math.inf)]), jac=partial(jacobian, slope),
    )  # fmt: skip
    assert found.success
    curve = found.sol
    engine.set_row(run.state)
    last = times[0]
    for t in np.union1d(curve.ts[1:], times[1:]):  # so that no loop closes on another side
        now = row(t, curve(t))
        if t == run.times[run.filled + 1]:
            run.filled += 1
            run.table[run.filled] = run.state = now
    run.counts[0] += len(curve.ts) - 1


def jacobian(rates, t, y):
    """Jacobian of ``rates`` by y, (n, n), from differences.

    scipy's own differences grow tenfold each time if the rates don't depend on a variable, like an angle, until the
    rates are not finite.
    """
    here, found = rates(t, y), np.zeros((len(y), len(y)))
    for k in range(len(y)):
        for side in (1.0, -1.0):  # of a variable at the border of what is possible there is one
            moved = y.copy()
            moved[k] += side * NUDGE * max(1.0, abs(y[k]))
            found[:, k] = (rates(t, moved) - here) / (moved[k] - y[k])
            if np.isfinite(found[:, k]).all():
                break
    return found
