"""Limit of the work of a motion of free joints."""

from __future__ import annotations

_MOST = 5_000_000
"""Largest number of evaluations of the rates in one motion of free joints: some minutes."""
_WINDOW, _STALLED = 50_000, 1e-4
"""Number of evaluations after which the progress is checked: _MOST of them must reach a hundredth of the duration."""


class Pace:
    """Counter of the work of a motion of free joints, and test for its limit."""

    def __init__(self, duration: float) -> None:
        self.duration, self.evaluations, self.seen = duration, 0, (0, 0.0)

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
