"""Turns of an angle that places alone say up to whole ones."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable

_FAR = 1.0
"""Largest way of an angle [rad], at the rate at either end, over which its turns are sure."""


class Count:
    """Counts on from where an angle stands at t = 0, in steps in which it can't go round.

    Parameters
    ----------
    at : callable
        Angle at a time [s], from -pi to pi, and its rate [rad, rad/s].
    longest : float
        Longest step [s].
    """

    def __init__(self, at: Callable[[float], tuple[float, float]], longest: float) -> None:
        self.at, self.longest = at, longest
        angle, rate = at(0.0)
        self.times, self.angles, self.rates = [0.0], [angle], [rate]

    def __call__(self, t: float, angle: float, rate: float) -> float:
        """The angle [rad] at t [s] with its whole turns; ``angle``: less these, ``rate``: its rate."""
        while True:
            last = bisect.bisect_right(self.times, t) - 1
            step = t - self.times[last]
            if step <= self.longest and not step * max(abs(self.rates[last]), abs(rate)) > _FAR:
                break
            between = self.times[last] + min(self.longest, 0.5 * step)
            self(between, *self.at(between))
        near = self.angles[last] + 0.5 * step * (self.rates[last] + rate)
        found = angle + 2.0 * math.pi * round((near - angle) / (2.0 * math.pi))
        if step > 0.0:
            self.times.insert(last + 1, t)
            self.angles.insert(last + 1, found)
            self.rates.insert(last + 1, rate)
        return found
