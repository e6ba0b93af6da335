"""Modes that a coupled run's steps do not resolve."""

from __future__ import annotations

import math

import numpy as np

from kaneflex.integrate.system import Trajectory
from kaneflex.solve.run_result import RunResult
from kaneflex.solve.summary_tables import UnresolvedMode
from kaneflex.support.errors import SceneError

FASTEST_DECAY = 20.0
"""Step of Gauss's method over a time constant from which at least a third of a decaying part remains: its stability
function (1 + z/2 + z^2/10 + z^3/120)/(1 - z/2 + z^2/10 - z^3/120) is -0.30 at z = -20, and tends to -1."""
FEWEST_STEPS = 3
"""Steps per period below which Gauss-Legendre shifts a vibration's phase by 2 % or more."""


def unresolved(solution: RunResult) -> list[UnresolvedMode]:
    """Modes with fewer than FEWEST_STEPS mean steps per period, by frequency; none without coupled equations.

    Under error control the vibration of these modes is below the tolerance, so displacements are correct within it.
    Forces and accelerations are static, except for such a vibration's contribution: omega^2 times the tolerance, which
    may exceed the accelerations of a slow mechanism.
    """
    model, trajectory = solution.model, solution.trajectory
    if model.coupled is None or isinstance(trajectory, Trajectory) or not model.coupled.engine.shapes.any():
        return []
    if trajectory.steps == 0:
        return []
    from kaneflex.solve.coupled_linearisation import modes_at_rest

    step = float(trajectory.times[-1] - trajectory.times[0]) / trajectory.steps
    try:
        names, omega, shapes = modes_at_rest(model)
    except SceneError:  # dead centre, of which the model warns
        return []
    deforming = [k for k, name in enumerate(names) if name.split(".")[1].startswith(("axial", "transverse"))]
    found = []
    for mode in np.flatnonzero(omega * step * FEWEST_STEPS > 2.0 * math.pi):
        body, coordinate = names[max(deforming, key=lambda k: abs(shapes[k, mode]))].split(".")
        shape = f"{'stretch' if coordinate.startswith('axial') else 'bending'} of {body}"
        frequency = float(omega[mode]) / (2.0 * math.pi)
        found.append(UnresolvedMode(frequency_hz=frequency, shape=shape, steps_per_period=1.0 / (frequency * step)))
    return found


def left_by_gauss(solution: RunResult) -> list[str]:
    """Warning if damping is faster than a step of Gauss's method, which is A-stable, but not L-stable.

    Steps with damping laws, or dampers between points, use Radau.
    """
    model, trajectory = solution.model, solution.trajectory
    damped = model.scene.damping is not None
    damped |= any(spring.between is None and any(spring.dampings) for spring in model.scene.springs.values())
    if isinstance(trajectory, Trajectory) or model.options.integrator != "gauss" or not damped or trajectory.steps == 0:
        return []
    from kaneflex.solve.coupled_linearisation import fastest_decay

    step = float(trajectory.times[-1] - trajectory.times[0]) / trajectory.steps
    fastest = fastest_decay(model, trajectory)
    if fastest * step < FASTEST_DECAY:
        return []
    return [
        f"steps of {step:.2g} s do not resolve the fastest decay, which takes {1.0 / fastest:.2g} s: with "
        "solve.integrator = 'gauss' overdamped modes oscillate within the tolerance; use 'radau'"
    ]
