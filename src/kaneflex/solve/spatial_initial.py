"""Initial states of coupled mechanisms in space."""

from __future__ import annotations

import numpy as np

from kaneflex.multibody.model.spatial_coupled import balanced, independent_shapes
from kaneflex.multibody.model.spatial_system import SpatialSystem, State
from kaneflex.multibody.time.spatial_forward import BENT_FAR
from kaneflex.multibody.time.spatial_linear import neighbours
from kaneflex.solve.initial import given_start, laid_over, shape_dimensions
from kaneflex.solve.slow_start import first_rates, followed
from kaneflex.support.errors import SceneError
from kaneflex.support.units import ANGLE

_OPEN = 1e-3
"""Change of given shapes by closing the loops that is accepted, as a share of the mechanism's size."""


def slow_state(system: SpatialSystem, start: State, duration: float) -> State:
    """Quasi-static initial state, see :mod:`kaneflex.solve.slow_start`.

    Free joints keep their initial speeds and accelerations. Raises SceneError if no equilibrium is found at the start.
    """
    try:
        still = balanced(system, start)
        columns = independent_shapes(system, still)
        beside, which = neighbours(system, still, columns), still.choice.independent[columns]
        slope = np.linalg.solve(beside.mass, beside.forces)[columns]
        inertia = beside.mass[np.ix_(columns, columns)]

        def residual(times: np.ndarray, z: np.ndarray) -> np.ndarray:
            later = (times - still.t)[:, None]
            free = np.setdiff1d(still.choice.independent, which)
            u, moved = np.tile(still.u, (len(times), 1)), np.zeros((len(times), system.speeds))
            moved[:, free] = later * still.u[free] + 0.5 * later**2 * still.du[free]
            u[:, free] += later * still.du[free]
            moved[:, which] = z
            given, out = np.hstack([system.advanced(still.q, moved), u]), np.zeros((len(times), len(system.work.kept)))
            system.near(still.choice, times, given, out)
            return system.instants(out).du[:, which]

        path = followed(residual, np.zeros(len(which)), slope, system.measure[which])
        return balanced(system, start, first_rates(path, inertia, duration))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise SceneError("solve.start", "quasistatic", str(error), f"{BENT_FAR}, or start from zero") from None


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
