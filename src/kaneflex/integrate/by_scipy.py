"""Solutions by scipy's methods, with progress and a limit, and the Jacobian that its implicit methods need."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kaneflex.support.errors import UserError

IMPLICIT = ("Radau", "BDF", "LSODA")
"""Methods of scipy that use one."""
_NUDGE = float(np.sqrt(np.finfo(float).eps))
"""Share of a variable, or of its size, by which it is changed for a difference quotient."""

MOST_EVALUATIONS = 1_000_000
"""Evaluations of the rates in one solution: one to two minutes."""

_MOST = 5_000_000
"""Evaluations of the rates in one motion of free joints: some minutes."""
_WINDOW, _STALLED = 50_000, 1e-4
"""Evaluations after which a motion that moved on by less than a share of its duration stands still: _MOST of them would
not bring it to a hundredth of it."""
SLOW = 'Shorten the duration, raise solve.forward.tolerance, or set solve.forward.method = "Radau"'
"""Advice where they bring a motion to no end."""
_STEPS = 500
"""Steps of an explicit method between which it is looked at for stiffness."""
_DECAYS = 1e5
"""Times of the fastest decay in a run beyond which it is stiff from its start."""

Rates = Callable[[float, np.ndarray], np.ndarray]
Progress = Callable[[float], None]


def solution(
    method: str, rates: Rates, span: tuple[float, float], first: np.ndarray, progress: Progress | None,
    before: list[int], **options: Any,
):  # fmt: skip
    """The solution over a span of time from ``first``, as scipy's ``OdeSolution``, and why it ended early, or nothing.

    progress: called with the share of the span after each step; before: one number, the evaluations so far, which goes
    on here; options: of the method.

    Raises
    ------
    UserError
        If it takes too many evaluations.
    """
    import scipy.integrate  # 0.7 s: only where it is used

    def counted(t: float, y: np.ndarray) -> np.ndarray:
        before[0] += 1
        if before[0] > MOST_EVALUATIONS:
            raise UserError(
                "solve.integrator", "scipy",
                f"{MOST_EVALUATIONS} evaluations bring it to t = {t:.4g} s of {span[1]:.4g} s: its steps follow the "
                "fastest vibrations",
                "Take radau or gauss, or shorten solve.duration",
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
    """The work of a motion of free joints, counted: where it is too much, and where an implicit method takes less."""

    def __init__(self, duration: float) -> None:
        self.duration, self.evaluations, self.steps, self.seen = duration, 0, 0, (0, 0.0)

    def too_slow(self, t: float) -> bool:
        """Whether the evaluations so far bring it to no end."""
        stalled = False
        if self.evaluations - self.seen[0] > _WINDOW:
            stalled, self.seen = t - self.seen[1] < _STALLED * self.duration, (self.evaluations, t)
        return stalled or self.evaluations > _MOST

    def message(self, t: float) -> str:
        """Problem of a motion that is too slow at t [s]."""
        return (
            f"its motion is so fast beside the duration that {self.evaluations} evaluations bring it to t = {t:.6g} s "
            f"of {self.duration:.6g} s"
        )

    def stiff(self, solver, sizes: np.ndarray) -> bool:
        """Whether what decays fast, not accuracy, sets the steps of an explicit solver of scipy's.

        Looked at before the first step and after every _STEPS. An explicit step h is stable for h lambda of some
        units (3.3 for RK45, 6 for DOP853), with the fastest decay lambda; a step that only accuracy binds resolves it,
        with h lambda below 1. The first step is none of these: there it counts how often 1/lambda fits the run.
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
    """The derivatives of ``rates`` at (t, y) by y, (n, n), from differences by shares of ``sizes`` (n,).

    scipy's own differences grow tenfold each time where the rates don't depend on a variable, as on an angle, a
    dependent coordinate or a work integral, until the rates are no numbers. A variable of size 0 counts as one of
    these.
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
