"""The modes that the steps of a coupled run are too long for."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from kaneflex.integrate.outcome import Trajectory
from kaneflex.solve.solution import Solution
from kaneflex.support.errors import SceneError
from kaneflex.support.plain_table import PlainTable

FASTEST_DECAY = 20.0
"""Step of Gauss's method over a time constant from which it leaves a third and more of what decays: its stability
function (1 + z/2 + z^2/10 + z^3/120)/(1 - z/2 + z^2/10 - z^3/120) is -0.30 at z = -20, and tends to -1."""
FEWEST_STEPS = 3
"""Steps in a period below which Gauss-Legendre shifts a vibration's phase by 2 % and more of each radian."""


class UnresolvedMode(PlainTable):
    """Mode of the reference configuration that the steps of a coupled run do not resolve.

    Steps under control of their error leave out only vibrations that are smaller than the error allowed; what such a
    mode bears of forces is then its static share.
    """

    frequency_hz: float = Field(description="natural frequency, Hz")
    shape: str = Field(description="main motion: stretch or bending of a link")
    steps_per_period: float = Field(description="mean steps per period, below 3")


def unresolved(solution: Solution) -> list[UnresolvedMode]:
    """The modes with fewer than FEWEST_STEPS mean steps in a period, by frequency; none where no coupled equations were
    integrated.

    Under error control these are modes whose own vibration is smaller than the error allowed: their share of
    displacements is right within it. Forces and accelerations are the static ones but for what such a vibration is
    worth: omega^2 times the displacement allowed, which a slow mechanism's accelerations may not exceed by far.
    """
    model, trajectory = solution.model, solution.trajectory
    if model.coupled is None or isinstance(trajectory, Trajectory) or not model.coupled.shape_columns:
        return []
    if trajectory.steps == 0:
        return []
    from kaneflex.solve.coupled_linearisation import modes_at_rest

    step = float(trajectory.times[-1] - trajectory.times[0]) / trajectory.steps
    try:
        names, omega, shapes = modes_at_rest(model)
    except SceneError:  # of a dead centre, which the model warns of
        return []
    deforming = [k for k, name in enumerate(names) if name.split(".")[1].startswith(("axial", "transverse"))]
    found = []
    for mode in np.flatnonzero(omega * step * FEWEST_STEPS > 2.0 * math.pi):
        body, coordinate = names[max(deforming, key=lambda k: abs(shapes[k, mode]))].split(".")
        shape = f"{'stretch' if coordinate.startswith('axial') else 'bending'} of {body}"
        frequency = float(omega[mode]) / (2.0 * math.pi)
        found.append(UnresolvedMode(frequency_hz=frequency, shape=shape, steps_per_period=1.0 / (frequency * step)))
    return found


def left_by_gauss(solution: Solution) -> list[str]:
    """A warning where dampers stop something within a step of Gauss's method: that is A-stable, but not L-stable.

    Steps know laws and springs between points by their slopes, and are Radau's where these damp.
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
        f"solve.integrator = 'gauss' lets ring what is overdamped, by the error allowed: the fastest decay takes "
        f"{1.0 / fastest:.2g} s, a step {step:.2g} s; take solve.integrator = 'radau'"
    ]
