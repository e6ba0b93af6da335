"""Forward dynamics of free joints: the rigid mechanism under its loads, before anything deforms.

The generated ``inverse`` kernel gives the torque that each free joint would need for given accelerations. It is linear
in them, so the forward equations M(theta) epsilon = -h are read off a few evaluations. Positions are closed forms of
the joints' coordinates, so the constraints hold by themselves and there is no drift to project away.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from types import ModuleType

import numpy as np
from numba import njit

from kaneflex.energy import Energy, rigid_energy
from kaneflex.errors import SceneError
from kaneflex.model import Motion
from kaneflex.options import Options
from kaneflex.scene import Scene

_ABSOLUTE = 1e-2
"""Absolute tolerance, in rad, m and their rates, as a share of the relative one."""
_MOST = 5_000_000
"""Evaluations of the accelerations in a run: some minutes, and a table of a few hundred megabytes."""
_PIECES = 10
"""Cubics for each step of an integrator of eighth order: between its steps it is as exact as on them."""


def integrate_free_joints(
    scene: Scene,
    module: ModuleType,
    parameters: np.ndarray,
    options: Options,
    progress: Callable[[float], None] | None = None,
) -> tuple[Motion, Energy]:
    """Integrate the free joints over the duration of ``options``, by its method and tolerance.

    Returns
    -------
    Motion
        Its parameters end in the tables of each free joint's coordinate, speed and acceleration, piecewise cubics on a
        tenth of the integration's own steps.
    Energy
        Of the rigid mechanism, at the ends of these steps.

    Raises
    ------
    SceneError
        If the motion can't go on, by a linkage that can't close or forces that are not finite, or takes too many steps;
        it names the time.
    """
    from scipy.integrate import solve_ivp

    free, duration, tolerance = module.FREE, options.duration, options.forward_tolerance
    start = np.array(
        [scene.drives[name].start for name in free] + [scene.drives[name].initial_speed for name in free]
    )

    accelerations = forward_equations(module, parameters)
    evaluation = count(1)

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        if next(evaluation) > _MOST:
            raise SceneError(
                f"drives.{free[0]}", "free",
                f"its motion is so fast beside the duration that {_MOST} evaluations bring it to t = {t:.6g} s of "
                f"{duration:.6g} s",
                "Shorten the duration, or raise solve.forward.tolerance",
            )  # fmt: skip
        if progress is not None:
            progress(min(1.0, t / duration))
        return np.concatenate([state[len(free) :], accelerations(t, state)])

    with np.errstate(all="ignore"):
        solution = solve_ivp(
            rates, (0.0, duration), start, method=options.forward_method, rtol=tolerance, atol=_ABSOLUTE * tolerance,
            dense_output=True,
        )  # fmt: skip
    finite = np.isfinite(solution.y).all(axis=0)
    if not solution.success or not finite.all():
        why = solution.message.rstrip(".") if finite.all() else "the forces are not finite there"
        raise SceneError(
            f"drives.{free[0]}", "free", f"the motion can't go on after t = {solution.t[finite][-1]:.6g} s: {why}",
            "Shorten the duration, or change loads or start so that no linkage locks",
        )  # fmt: skip
    shares = np.arange(_PIECES) / _PIECES
    times = np.append((solution.t[:-1, None] + np.diff(solution.t)[:, None] * shares).ravel(), duration)
    states = solution.sol(times)
    epsilon = np.array([accelerations(t, s) for t, s in zip(times, states.T, strict=True)]).T
    motion = Motion(module, with_courses(module, parameters, times, states, epsilon))
    return motion, rigid_energy(scene, motion, times, _PIECES)


def at_initial_speed(scene: Scene, module: ModuleType, parameters: np.ndarray, duration: float) -> np.ndarray:
    """``parameters`` with free joints that keep their initial speeds over ``duration`` [s]."""
    times = np.array([0.0, duration / 2, duration])
    start = np.array([scene.drives[name].start for name in module.FREE])[:, None]
    speed = np.array([scene.drives[name].initial_speed for name in module.FREE])[:, None]
    states = np.concatenate([start + speed * times, np.broadcast_to(speed, (len(module.FREE), 3))])
    return with_courses(module, parameters, times, states, np.zeros((len(module.FREE), 3)))


def forward_equations(module: ModuleType, parameters: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
    """M epsilon = -h as a function of time t [s] and state, coordinates, then speeds of the n free joints.

    It gives epsilon [rad/s^2 or m/s^2], shape (n,), not finite where M is singular. Its work arrays are made once:
    an integration calls it a hundred thousand times.
    """
    inverse, n = module.inverse, len(module.FREE)
    y, h, M = np.zeros(3 * n), np.zeros(n), np.zeros((n, n))

    def accelerations(t: float, state: np.ndarray) -> np.ndarray:
        y[0::3], y[1::3] = state[:n], state[n:]
        inverse(t, y, parameters, h)
        for k in range(n):
            y[3 * k + 2] = 1.0
            inverse(t, y, parameters, M[k])  # M[k] + h: M is symmetric, so its rows are its columns
            y[3 * k + 2] = 0.0
        return _solve(M, h)

    return accelerations


@njit(cache=True, error_model="numpy")
def _solve(M, h):
    """x of (M - 1 h^T) x = -h, by elimination with row exchanges; M is overwritten."""
    n = len(h)
    x = -h
    for k in range(n):
        for j in range(n):
            M[k, j] -= h[j]
    for k in range(n):
        row = k
        for i in range(k + 1, n):
            if abs(M[i, k]) > abs(M[row, k]):
                row = i
        for j in range(n):
            M[k, j], M[row, j] = M[row, j], M[k, j]
        x[k], x[row] = x[row], x[k]
        for i in range(k + 1, n):
            factor = M[i, k] / M[k, k]
            for j in range(k, n):
                M[i, j] -= factor * M[k, j]
            x[i] -= factor * x[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= M[k, j] * x[j]
        x[k] /= M[k, k]
    return x


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
            values[position[f"drives.{name}.{course}"]] = filled
            blocks.append(block)
            filled += len(block)
    return np.concatenate([values, *blocks])
