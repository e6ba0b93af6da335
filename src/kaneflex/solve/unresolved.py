"""The modes that the steps of a coupled run are too long for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kaneflex.solve.coupled_linearisation import modes_at_rest
from kaneflex.solve.solution import Solution

FEWEST_STEPS = 3
"""Steps in a period below which Gauss-Legendre shifts a vibration's phase by 2 % and more of each radian."""


@dataclass(frozen=True)
class Unresolved:
    """A mode at the reference configuration that a run does not follow.

    Attributes
    ----------
    frequency : float
        [Hz]
    shape : str
        What moves most in it, like "stretch of rod".
    steps : float
        Mean steps in its period.
    """

    frequency: float
    shape: str
    steps: float


def unresolved(solution: Solution) -> tuple[Unresolved, ...]:
    """The modes with fewer than FEWEST_STEPS mean steps in a period, by frequency; none where nothing was integrated.

    Under error control these are modes whose own vibration is smaller than the error allowed: their share of
    displacements is right within it. Forces and accelerations are the static ones but for what such a vibration is
    worth: omega^2 times the displacement allowed, which a slow mechanism's accelerations may not exceed by far.
    """
    model, trajectory = solution.model, solution.trajectory
    if trajectory.steps == 0:
        return ()
    step = float(trajectory.times[-1] - trajectory.times[0]) / trajectory.steps
    names, omega, shapes = modes_at_rest(model)
    deforming = [k for k, name in enumerate(names) if name.split(".")[1].startswith(("axial", "transverse"))]
    found = []
    for mode in np.flatnonzero(omega * step * FEWEST_STEPS > 2.0 * math.pi):
        body, coordinate = names[max(deforming, key=lambda k: abs(shapes[k, mode]))].split(".")
        shape = f"{'stretch' if coordinate.startswith('axial') else 'bending'} of {body}"
        found.append(Unresolved(float(omega[mode]) / (2.0 * math.pi), shape, 2.0 * math.pi / float(omega[mode] * step)))
    return tuple(found)
