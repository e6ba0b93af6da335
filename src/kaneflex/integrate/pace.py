"""Work of a motion of free joints: its limit, and stiffness of what an explicit method integrates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_NUDGE = float(np.sqrt(np.finfo(float).eps))
"""Relative step of difference quotients."""
_MOST = 5_000_000
"""Largest number of evaluations of the rates in one motion of free joints: some minutes."""
_WINDOW, _STALLED = 50_000, 1e-4
"""Number of evaluations after which the progress is checked: _MOST of them must reach a hundredth of the duration."""
_STEPS = 500
"""Steps of an explicit method between checks for stiffness."""
_DECAYS = 1e5
"""Number of time constants of the fastest decay in a run above which it is stiff from its start."""


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

    def stiff(self, solver) -> bool:
        """True if a fast decay, not accuracy, limits the steps of an explicit solver of scipy.

        Checked before the first step and after every _STEPS. An explicit step h is stable up to some value of h lambda
        (6 for DOP853), with the fastest decay lambda; a step limited by accuracy resolves it, with h lambda below 1.
        Before the first step the number of time constants 1/lambda in the run decides.
        """
        looked, step = self.steps % _STEPS == 0, solver.step_size if self.steps else self.duration / _DECAYS
        self.steps += 1
        if not looked:
            return False
        J = jacobian(solver.fun, solver.t, solver.y)
        if not np.isfinite(J).all():
            return False
        values = np.linalg.eigvals(J)
        fastest = values[abs(values).argmax()]
        return bool(-fastest.real > abs(fastest.imag) and -fastest.real * step > 1.0)


def jacobian(rates: Callable[[float, np.ndarray], np.ndarray], t: float, y: np.ndarray) -> np.ndarray:
    """Jacobian of ``rates`` by y, (n, n), from differences.

    scipy's own differences grow tenfold each time if the rates don't depend on a variable, like an angle, until the
    rates are not finite.
    """
    here, found = rates(t, y), np.zeros((len(y), len(y)))
    for k in range(len(y)):
        for side in (1.0, -1.0):  # of a variable at the border of what is possible there is one
            moved = y.copy()
            moved[k] += side * _NUDGE * max(1.0, abs(y[k]))
            found[:, k] = (rates(t, moved) - here) / (moved[k] - y[k])
            if np.isfinite(found[:, k]).all():
                break
    return found
