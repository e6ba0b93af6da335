"""Forward dynamics of free joints: the rigid mechanism under its loads, before anything deforms.

The generated ``inverse`` kernel gives the torque that each free joint would need for given accelerations. It is linear
in them, so the forward equations M(theta) epsilon = -h are read off a few evaluations. Positions are closed forms of
the joints' coordinates, so the constraints hold by themselves and there is no drift to project away.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np

from kaneflex.errors import SceneError
from kaneflex.scene import Scene

RELATIVE, ABSOLUTE = 1e-9, 1e-11
"""Tolerances of the integration."""
_PIECES = 10
"""Cubics for each step of an integrator of eighth order: between its steps it is as exact as on them."""


def integrate_free_joints(
    scene: Scene,
    module: ModuleType,
    parameters: np.ndarray,
    duration: float,
    progress: Callable[[float], None] | None = None,
) -> np.ndarray:
    """Integrate the free joints over ``duration`` [s] and append their courses to the kernels' argument p.

    Returns
    -------
    ndarray
        ``parameters`` with the tables of each free joint's coordinate, speed and acceleration, piecewise cubics on a
        tenth of the integration's own steps.

    Raises
    ------
    SceneError
        If the motion can't go on: a linkage that can't close, or forces that are not finite; it names the time.
    """
    from scipy.integrate import solve_ivp

    free = module.FREE
    start = np.array(
        [scene.drives[name].start for name in free] + [scene.drives[name].initial_speed for name in free]
    )

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        if progress is not None:
            progress(min(1.0, t / duration))
        return np.concatenate([state[len(free) :], accelerations(module, parameters, t, state)])

    with np.errstate(all="ignore"):
        solution = solve_ivp(
            rates, (0.0, duration), start, method="DOP853", rtol=RELATIVE, atol=ABSOLUTE, dense_output=True
        )
    if not solution.success or not np.isfinite(solution.y).all():
        raise SceneError(
            f"drives.{free[0]}", "free", f"the motion can't go on after t = {solution.t[-1]:.6g} s: {solution.message}",
            "Shorten the duration, or change loads or start so that no linkage locks",
        )  # fmt: skip
    shares = np.arange(_PIECES) / _PIECES
    times = np.append((solution.t[:-1, None] + np.diff(solution.t)[:, None] * shares).ravel(), duration)
    states = solution.sol(times)
    epsilon = np.array([accelerations(module, parameters, t, s) for t, s in zip(times, states.T, strict=True)]).T
    return with_courses(module, parameters, times, states, epsilon)


def at_initial_speed(scene: Scene, module: ModuleType, parameters: np.ndarray, duration: float) -> np.ndarray:
    """``parameters`` with free joints that keep their initial speeds over ``duration`` [s]."""
    times = np.array([0.0, duration / 2, duration])
    start = np.array([scene.drives[name].start for name in module.FREE])[:, None]
    speed = np.array([scene.drives[name].initial_speed for name in module.FREE])[:, None]
    states = np.concatenate([start + speed * times, np.broadcast_to(speed, (len(module.FREE), 3))])
    return with_courses(module, parameters, times, states, np.zeros((len(module.FREE), 3)))


def accelerations(module: ModuleType, parameters: np.ndarray, t: float, state: np.ndarray) -> np.ndarray:
    """Accelerations of the free joints [rad/s^2] at time t [s] and state (coordinates, then speeds)."""
    count = len(module.FREE)
    y = np.zeros((count, 3))
    y[:, 0], y[:, 1] = state[:count], state[count:]
    needed = np.zeros((count + 1, count))
    for k in range(count + 1):
        y[:, 2] = 0.0
        if k < count:
            y[k, 2] = 1.0
        module.inverse(t, y.ravel(), parameters, needed[k])
    inertia = (needed[:count] - needed[count]).T
    return np.linalg.solve(inertia, -needed[count])


def with_courses(module, parameters, times, states, epsilon) -> np.ndarray:
    """Append one block of cubics for each course; see ``kaneflex.tables`` for the layout."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    count = len(module.FREE)
    position = {path: k for k, (path, _) in enumerate(module.PARAMETERS)}
    values, blocks, filled = parameters.copy(), [], len(parameters)
    for k, name in enumerate(module.FREE):
        courses = {
            "angle_table": CubicHermiteSpline(times, states[k], states[count + k]),
            "speed_table": CubicHermiteSpline(times, states[count + k], epsilon[k]),
            "acceleration_table": CubicSpline(times, epsilon[k]),
        }
        for course, cubic in courses.items():
            block = np.concatenate([[len(times) - 1, 0.0], times, cubic.c[::-1].T.ravel()])
            values[position[f"{name}.{course}"]] = filled
            blocks.append(block)
            filled += len(block)
    return np.concatenate([values, *blocks])
