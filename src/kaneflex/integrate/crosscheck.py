"""The same equations through scipy.integrate.solve_ivp: slow, and independent of the compiled loops."""

from __future__ import annotations

import time

import numpy as np

from kaneflex.integrate.outcome import Outcome, Trajectory
from kaneflex.integrate.streams import CoefficientStream
from kaneflex.integrate.system import AffineSystem
from kaneflex.support.errors import UserError

_RELATIVE, _ABSOLUTE = 1e-11, 1e-16  # tolerances: near the best that the methods of solve_ivp reach
_METHODS = ("DOP853", "Radau", "LSODA", "RK45", "BDF")


def solve_ivp_run(
    system: AffineSystem,
    stream: CoefficientStream,
    n_steps: int,
    every: int,
    start: tuple[np.ndarray, np.ndarray],
    scipy_method: str,
) -> Trajectory:
    """Integrate with steps chosen by scipy's method and report at every `every`-th step of the stream."""
    from scipy.integrate import solve_ivp  # 0.7 s: only where it is used

    if scipy_method not in _METHODS:
        cure = f"Use one of {', '.join(_METHODS)}"
        raise UserError("scipy_method", scipy_method, "unknown to solve_ivp", cure)
    n = system.n
    times = stream.t0 + stream.step * (every * np.arange(n_steps // every + 1))

    def accelerations(t: float, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        row = stream.row(t)
        mass, damping, stiffness, force = (system.dense(name, row) for name in ("M", "C", "K", "F"))
        return np.linalg.solve(mass, force - damping @ v - stiffness @ z)

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate((x[n:], accelerations(t, x[:n], x[n:])))

    span, first = (times[0], times[-1]), np.concatenate(start)
    started = time.perf_counter()
    found = solve_ivp(slope, span, first, scipy_method, times, rtol=_RELATIVE, atol=_ABSOLUTE)
    spent = time.perf_counter() - started
    z, v = found.y[:n].T, found.y[n:].T
    reached = np.arange(found.t.size)
    a = np.array([accelerations(found.t[k], z[k], v[k]) for k in reached]).reshape(-1, n)
    outcome = Outcome.COMPLETED if found.success else Outcome.UNSTABLE
    message = outcome.value if found.success else f"{outcome.value}: {found.message}"
    return Trajectory(found.t, z, v, a, outcome, message, None, 1e9 * spent / n_steps)
