"""Initial states of coupled mechanisms in space."""

from __future__ import annotations

import numpy as np

from kaneflex.multibody.model.spatial_system import SpatialSystem, State
from kaneflex.solve.initial import given_start, laid_over, shape_dimensions
from kaneflex.support.errors import SceneError
from kaneflex.support.units import ANGLE

_OPEN = 1e-3
"""Change of given shapes by closing the loops that is accepted, as a share of the mechanism's size."""


def given_state(system: SpatialSystem, start: State) -> State:
    """Initial state with the shapes and rates that the scene gives.

    Raises SceneError as ``laid_over``, and for shapes that the loops change.
    """
    q, u, at, rates = start.q.copy(), start.u.copy(), system.modal_coordinates, system.modal_speeds
    q[at], u[rates] = laid_over(system.scene, shape_dimensions(system), q[at], u[rates])
    try:
        found = system.project(start.t, q, u, start.choice)
        far, reason = abs(found.q - q)[at].max(initial=0.0), "the loops don't close with these shapes"
    except ArithmeticError as error:
        far, reason = np.inf, f"in this state {error}"
    if not far <= _OPEN * system.mechanism.size:
        cure = "Give shapes that keep the joints closed, for example those of solution.state()"
        raise SceneError("solve.start", "a table of a state", reason, cure)
    _check_rates(system, u, found.u)
    return found


def _check_rates(system: SpatialSystem, asked: np.ndarray, found: np.ndarray) -> None:
    """Raise SceneError if the loops change a given rate of a shape."""
    given, largest = given_start(system.scene).velocities, abs(found / system.measure).max(initial=0.0)
    for (name, dimension), k in zip(shape_dimensions(system).items(), system.modal_speeds, strict=True):
        if name in given and abs(found[k] - asked[k]) > _OPEN * system.measure[k] * largest:
            made = f"{found[k] + 0.0:.6g} {'rad/s' if dimension is ANGLE else 'm/s'}"
            raise SceneError(
                f"solve.start.velocities.{name}", given[name], f"joints and drives make it {made}",
                "Give rates consistent with the joints, for example those of solution.state()",
            )  # fmt: skip
