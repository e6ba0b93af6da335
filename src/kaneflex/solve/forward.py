"""Forward dynamics of free joints of the rigid mechanism under its loads.

The generated ``inverse`` kernel gives the torque that each free joint needs for given accelerations. It is linear in
them, so that M and h of M(theta) epsilon = -h follow from a few evaluations. Positions are closed forms of the joints'
coordinates: constraints hold exactly, without drift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numba import njit

from kaneflex.integrate.pace import Pace
from kaneflex.mechanism.closure import check_passage, check_start, locking, swung
from kaneflex.mechanism.closure_continuation import with_tables
from kaneflex.mechanism.energy import Energy, rigid_energy
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion, not_integrated
from kaneflex.scene import Scene
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError

_ABSOLUTE = 1e-2
"""Absolute tolerance, in rad, m and their rates, relative to the relative one."""
_SINGULAR = 1e-3
"""Transmission angle [rad], or least singular value of the constraints, below which a loop counts as singular."""
_PIECES = 10
"""Cubics per stretch of an integrator of eighth order with dense output as accurate as its steps."""
_MOST_NUMBERS = 2e7
"""Largest count of numbers in the tables of all courses (160 MB); beyond it several steps share a stretch."""
_AROUND = np.array([0.0, 0.5, 1.0])
"""Instants [s] of the courses with constant acceleration that give the motion at the start."""
_COURSES = 5 * 3
"""Numbers per instant and joint: time and cubic, for coordinate, speed and acceleration."""


@dataclass(frozen=True, eq=False)
class StartKinematics(RigidKinematics):
    """Rigid motion at its start, before free joints are integrated.

    ``given``: parameters without their courses; ``state``: coordinates, then speeds of the free joints, (2 n,).
    """

    given: np.ndarray
    state: np.ndarray

    is_start = True

    def table(self, times: np.ndarray) -> np.ndarray:
        if np.any(times):
            raise not_integrated(float(np.max(times)))
        return super().table(times)


def at_start(scene: Scene, module: ModuleType, parameters: np.ndarray) -> StartKinematics:
    """Rigid motion at the start of the free joints.

    Raises SceneError if it can't start: the linkage can't close, the mass matrix is singular, or forces are not finite.
    """
    accelerations, inertia = forward_equations(module, parameters)
    start = np.array([getattr(scene.drives[name], key) for key in ("start", "initial_speed") for name in module.FREE])
    count = len(module.FREE)
    epsilon = accelerations(0.0, start)
    check_start(mechanism_of(scene), standing(module, parameters, 0.0, start), epsilon, inertia(0.0, start))
    states, own = np.repeat(start[:, None], 3, axis=1), np.repeat(epsilon[:, None], 3, axis=1)
    states[:count, 1:] += start[count:, None] * _AROUND[1:] + 0.5 * epsilon[:, None] * _AROUND[1:] ** 2
    states[count:, 1:] += epsilon[:, None] * _AROUND[1:]
    return StartKinematics(module, with_courses(module, parameters, _AROUND, states, own), parameters, start)


def integrate_free_joints(
    mechanism: NumericMechanism, start: StartKinematics, options: Options,
    share: Callable[[float], None] = lambda done: None,
) -> tuple[RigidKinematics, Energy]:  # fmt: skip
    """Integrate the free joints over the duration of ``options``, by its tolerance.

    ``share`` is called with the finished share, 0 to 1.

    Returns
    -------
    RigidKinematics
        Its parameters end with tables of each free joint's coordinate, speed and acceleration: piecewise cubics on
        tenths of the integration's steps, or of several steps together if these are very many.
    Energy
        Energy of the rigid mechanism at the ends of these steps.

    Raises
    ------
    SceneError
        If the motion can't continue: a loop locks, forces are not finite, or too many steps are needed. Names joint,
        position and time.
    """
    module, parameters, accelerations = start.module, start.given, forward_equations(start.module, start.given)[0]
    times, states, epsilon = [0.0], [start.state], [accelerations(0.0, start.state)]
    run = _Steps(mechanism, module, parameters, options, accelerations)
    for stretch in run.stretches(start.state):
        share(times[-1] / options.duration)
        for t, state in stretch:
            times.append(t)
            states.append(state)
            epsilon.append(accelerations(t, state))
            if not np.isfinite(epsilon[-1]).all():
                raise run.stopped(times[-2], states[-2], "its accelerations are not finite afterwards")
    columns = np.array(states).T, np.array(epsilon).T
    motion = RigidKinematics(module, with_courses(module, parameters, np.array(times), *columns))
    check_passage(mechanism, motion, np.array(times))
    return motion, rigid_energy(mechanism, motion, np.array(times), _PIECES)


class _Steps:
    """Steps of DOP853, of Radau from where the motion is stiff, grouped into stretches."""

    def __init__(
        self, mechanism: NumericMechanism, module: ModuleType, parameters: np.ndarray, options: Options, accelerations
    ) -> None:
        self.mechanism, self.module, self.parameters, self.options = mechanism, module, parameters, options
        self.accelerations, self.pace = accelerations, Pace(options.duration)
        most = max(options.steps, _MOST_NUMBERS / (_COURSES * _PIECES * len(module.FREE)))
        self.shortest = options.duration / most

    def stretches(self, start: np.ndarray):
        """Lists of _PIECES instants with their states, from after the start to the end."""
        from scipy.integrate import DOP853, Radau

        options, duration, count = self.options, self.options.duration, len(self.module.FREE)

        def rates(t: float, state: np.ndarray) -> np.ndarray:
            self.pace.evaluations += 1
            return np.concatenate([state[count:], self.accelerations(t, state)])

        tolerance = options.forward_tolerance
        tolerances = {"rtol": tolerance, "atol": _ABSOLUTE * tolerance}
        solver = DOP853(rates, 0.0, start, duration, **tolerances)
        begun, curves = 0.0, []
        while solver.status == "running":
            if isinstance(solver, DOP853) and self.pace.stiff(solver):
                solver = Radau(rates, solver.t, solver.y, duration, **tolerances)
            before, state = solver.t, solver.y.copy()
            try:
                with np.errstate(all="ignore"):
                    message = solver.step()
            except (ValueError, np.linalg.LinAlgError):  # an implicit method meets a Jacobian that is not finite
                message = "its rates are not finite there"
            if solver.status == "failed" or message is not None or not np.isfinite(solver.y).all():
                raise self.stopped(before, state, message or "its rates are not finite there")
            curves.append(solver.dense_output())
            if self.pace.too_slow(solver.t):
                raise self.stopped(solver.t, solver.y)
            if solver.t - begun >= self.shortest or solver.status == "finished":
                yield _sampled(curves, begun, solver.t)
                begun, curves = solver.t, []

    def stopped(self, t: float, state: np.ndarray, message: str | None = None) -> SceneError:
        """Error of a motion that ends at a time and state; without a message it is too slow."""
        free = self.module.FREE
        rigid = standing(self.module, self.parameters, t, state)
        joint = locking(rigid)
        if joint is not None:
            return swung(self.mechanism, joint, rigid)
        if message is not None:
            return SceneError(
                f"drives.{free[0]}", "free", f"the motion can't continue after t = {t:.6g} s: {message.rstrip('.')}",
                "Shorten the duration, or change loads or start so that no linkage locks",
            )  # fmt: skip
        cure = "Shorten the duration, or raise solve.forward.tolerance"
        return self._singular(t, rigid) or SceneError(f"drives.{free[0]}", "free", self.pace.message(t), cure)

    def _singular(self, t: float, rigid: RigidMotion) -> SceneError | None:
        """Error of a motion at a singular position of a loop; None elsewhere."""
        from kaneflex.mechanism.closure import courses_of
        from kaneflex.mechanism.dead_centres import closings

        courses = courses_of(self.mechanism, rigid)
        found = [each for each in closings(self.mechanism, courses) if each.values.min() < _SINGULAR]
        if not found:
            return None
        return SceneError(
            f"joints.{found[0].name}", None,
            f"the loop that it closes is in a singular position at t = {t:.6g} s, {found[0].position}: branches of its "
            "motion meet there, and joint forces are not finite",
            "Use preset coupled, which continues along a branch, or shorten the duration",
        )  # fmt: skip


def _sampled(curves: list, begun: float, end: float) -> list[tuple[float, np.ndarray]]:
    """States at _PIECES equally spaced instants of a stretch, from the dense output of its steps."""
    times = np.append(begun + (end - begun) * np.arange(1, _PIECES) / _PIECES, end)
    places = np.searchsorted([curve.t for curve in curves[:-1]], times)
    states = np.concatenate([curves[k](times[places == k]) for k in np.unique(places)], axis=1)
    return list(zip(times.tolist(), states.T, strict=True))


def standing(module: ModuleType, parameters: np.ndarray, t: float, state: np.ndarray) -> RigidMotion:
    """Rigid mechanism at a time t [s], its free joints at rest at a state (2 n,)."""
    times, still = t + np.array([0.0, 0.5, 1.0]), np.zeros((len(module.FREE), 3))
    places = np.repeat(state[: len(module.FREE), None], 3, axis=1)
    courses = with_courses(module, parameters, times, np.concatenate([places, still]), still)
    return RigidKinematics(module, courses).at(t)


def forward_equations(
    module: ModuleType, parameters: np.ndarray
) -> tuple[Callable[[float, np.ndarray], np.ndarray], Callable[[float, np.ndarray], np.ndarray]]:
    """Functions of time t [s] and state (coordinates, then speeds of the n free joints) of M epsilon = -h.

    The first returns epsilon [rad/s^2 or m/s^2], (n,), not finite if M is singular; its work arrays are allocated once.
    The second returns M (n, n).
    """
    inverse, n = module.inverse, len(module.FREE)
    y, h, M = np.zeros(3 * n), np.zeros(n), np.zeros((n, n))

    def evaluate(t: float, state: np.ndarray) -> None:
        y[0::3], y[1::3] = state[:n], state[n:]
        inverse(t, y, parameters, h)
        for k in range(n):
            y[3 * k + 2] = 1.0
            inverse(t, y, parameters, M[k])  # M[k] + h: M is symmetric, so its rows are its columns
            y[3 * k + 2] = 0.0

    def accelerations(t: float, state: np.ndarray) -> np.ndarray:
        evaluate(t, state)
        return _solve(M, h)

    def inertia(t: float, state: np.ndarray) -> np.ndarray:
        evaluate(t, state)
        return M - h

    return accelerations, inertia


@njit(cache=True, error_model="numpy")
def _solve(M, h):
    """Solve (M - 1 h^T) x = -h by Gaussian elimination with row exchanges; M is overwritten."""
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
    """Append one block of cubics for each course; see ``kaneflex.scene.tables`` for the layout."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    count, blocks = len(module.FREE), {}
    for k, name in enumerate(module.FREE):
        courses = {
            "angle_table": CubicHermiteSpline(times, states[k], states[count + k]),
            "speed_table": CubicHermiteSpline(times, states[count + k], epsilon[k]),
            "acceleration_table": CubicSpline(times, epsilon[k]),
        }
        for course, cubic in courses.items():
            block = np.concatenate([[len(times) - 1, 0.0], times, cubic.c[::-1].T.ravel()])
            blocks[f"drives.{name}.{course}"] = block
    return with_tables(module, parameters, blocks)
