"""Solution by scipy's methods, with progress and a limit, and the Jacobian for its implicit methods."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.integrate.outcome import Outcome, Progress, Trajectory
from kaneflex.support.errors import UserError

if TYPE_CHECKING:
    from kaneflex.integrate.streams import CoefficientStream
    from kaneflex.integrate.system import AffineSystem

IMPLICIT = ("Radau", "BDF", "LSODA")
"""Implicit methods of scipy, which use a Jacobian."""
_NUDGE = float(np.sqrt(np.finfo(float).eps))
"""Relative step of difference quotients."""

MOST_EVALUATIONS = 1_000_000
"""Largest number of evaluations of the rates in one solution: one to two minutes."""

_MOST = 5_000_000
"""Largest number of evaluations of the rates in one motion of free joints: some minutes."""
_WINDOW, _STALLED = 50_000, 1e-4
"""Number of evaluations after which the progress is checked: _MOST of them must reach a hundredth of the duration."""
SLOW = 'Shorten the duration, raise solve.forward.tolerance, or set solve.forward.method = "Radau"'
"""Advice if a motion is too slow."""
_STEPS = 500
"""Steps of an explicit method between checks for stiffness."""
_DECAYS = 1e5
"""Number of time constants of the fastest decay in a run above which it is stiff from its start."""

Rates = Callable[[float, np.ndarray], np.ndarray]


def solution(
    method: str, rates: Rates, span: tuple[float, float], first: np.ndarray, progress: Progress | None, **options: Any
):  # fmt: skip
    """The solution over a span of time from ``first``, as scipy's ``OdeSolution``, and why it ended early, or nothing.

    progress: called with the share of the span after each step; options: of the method.

    Raises
    ------
    UserError
        If it takes too many evaluations.
    """
    import scipy.integrate  # 0.7 s: only where it is used

    evaluations = 0

    def counted(t: float, y: np.ndarray) -> np.ndarray:
        nonlocal evaluations
        evaluations += 1
        if evaluations > MOST_EVALUATIONS:
            raise UserError(
                "solve.integrator", "scipy",
                f"{MOST_EVALUATIONS} evaluations reach only t = {t:.4g} s of {span[1]:.4g} s: the steps follow "
                "the fastest vibrations",
                "Use radau or gauss, or shorten solve.duration",
            )  # fmt: skip
        return rates(t, y)

    if method in IMPLICIT:
        options["jac"] = jacobian_of(counted, options.pop("sizes", np.ones(len(first))))
    solver = getattr(scipy.integrate, method)(counted, span[0], first, span[1], **options)
    times, curves, message = [span[0]], [], None
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed":
            break
        times.append(solver.t)
        curves.append(solver.dense_output())
        if progress is not None:
            progress((solver.t - span[0]) / (span[1] - span[0]))
    return scipy.integrate.OdeSolution(times, curves) if curves else None, message


class Pace:
    """Counter of the work of a motion of free joints, and tests for a limit and for stiffness."""

    def __init__(self, duration: float) -> None:
        self.duration, self.evaluations, self.steps, self.seen = duration, 0, 0, (0, 0.0)

    def too_slow(self, t: float) -> bool:
        """True if the evaluations so far show that the motion takes too long."""
        stalled = False
        if self.evaluations - self.seen[0] > _WINDOW:
            stalled, self.seen = t - self.seen[1] < _STALLED * self.duration, (self.evaluations, t)
        return stalled or self.evaluations > _MOST

    def message(self, t: float) -> str:
        """Problem of a motion that is too slow at t [s]."""
        return (
            f"the motion is too fast for the duration: {self.evaluations} evaluations reach only t = {t:.6g} s "
            f"of {self.duration:.6g} s"
        )

    def stiff(self, solver, sizes: np.ndarray) -> bool:
        """True if a fast decay, not accuracy, limits the steps of an explicit solver of scipy.

        Checked before the first step and after every _STEPS. An explicit step h is stable up to some value of h lambda
        (3.3 for RK45, 6 for DOP853), with the fastest decay lambda; a step limited by accuracy resolves it, with
        h lambda below 1. Before the first step the number of time constants 1/lambda in the run decides.
        """
        looked, step = self.steps % _STEPS == 0, solver.step_size if self.steps else self.duration / _DECAYS
        self.steps += 1
        if type(solver).__name__ in IMPLICIT or not looked:
            return False
        J = jacobian_of(solver.fun, sizes)(solver.t, solver.y)
        if not np.isfinite(J).all():
            return False
        values = np.linalg.eigvals(J)
        fastest = values[abs(values).argmax()]
        return bool(-fastest.real > abs(fastest.imag) and -fastest.real * step > 1.0)


def jacobian_of(rates: Rates, sizes: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
    """Jacobian of ``rates`` at (t, y) by y, (n, n), from differences with steps relative to ``sizes`` (n,).

    scipy's own differences grow tenfold each time if the rates don't depend on a variable, like an angle, a dependent
    coordinate or a work integral, until the rates are not finite. A variable of size 0 counts as such.
    """

    def jacobian(t: float, y: np.ndarray) -> np.ndarray:
        here, found = rates(t, y), np.zeros((len(y), len(y)))
        for k in np.flatnonzero(sizes):
            for side in (1.0, -1.0):  # of a variable at the border of what is possible there is one
                moved = y.copy()
                moved[k] += side * _NUDGE * max(sizes[k], abs(y[k]))
                found[:, k] = (rates(t, moved) - here) / (moved[k] - y[k])
                if np.isfinite(found[:, k]).all():
                    break
        return found

    return jacobian


_RELATIVE, _ABSOLUTE = 1e-11, 1e-16  # tolerances: near the best that the methods of solve_ivp reach
_METHODS = ("DOP853", "Radau", "LSODA", "RK45", "BDF")


def solve_ivp_run(
    system: AffineSystem,
    stream: CoefficientStream,
    n_steps: int,
    every: int,
    start: tuple[np.ndarray, np.ndarray],
    scipy_method: str,
    progress: Progress | None = None,
) -> Trajectory:
    """Integrate with steps chosen by scipy's method and report at every `every`-th step of the stream."""
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
    curve, failed = solution(scipy_method, slope, span, first, progress, rtol=_RELATIVE, atol=_ABSOLUTE)
    spent = time.perf_counter() - started
    times = times[times <= (span[0] if curve is None else curve.t_max)]
    states = first[None] if curve is None else curve(times).T
    z, v = states[:, :n], states[:, n:]
    a = np.array([accelerations(*each) for each in zip(times, z, v, strict=True)]).reshape(-1, n)
    outcome = Outcome.UNSTABLE if failed else Outcome.COMPLETED
    message = f"{outcome.value}: {failed}" if failed else outcome.value
    return Trajectory(times, z, v, a, outcome, message, None, 1e9 * spent / n_steps)
