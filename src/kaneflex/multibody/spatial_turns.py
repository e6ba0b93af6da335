"""Angles with whole turns from angles modulo 2 pi."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable

import numpy as np

_FAR = 1.0
"""Largest change of an angle [rad], by the rate at either end, for a reliable count of turns."""


def ball_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Quaternion (4,) of a rotation by an angle [rad] about a unit vector."""
    return np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axis)])


def angle_about(axis: np.ndarray, ball: np.ndarray) -> float:
    """Angle [rad] of a quaternion's rotation about a unit vector, from -pi to pi."""
    return 2.0 * math.remainder(math.atan2(axis @ ball[1:], ball[0]), math.pi)


class Count:
    """Count of an angle's turns from t = 0, in steps too short for a whole turn.

    Parameters
    ----------
    at : callable
        Angles at times [s] in their order, from -pi to pi, and their rates [rad, rad/s].
    longest : float
        Longest step [s].
    """

    def __init__(self, at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], longest: float) -> None:
        self.at, self.longest = at, longest
        (angle,), (rate,) = at(np.zeros(1))
        self.times, self.angles, self.rates = [0.0], [float(angle)], [float(rate)]

    def over(self, times: np.ndarray, angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Angles [rad] at ascending times [s] with whole turns; ``angles``: without these."""
        between, known = self._between(times, rates), [times, angles, rates]
        if len(between):
            known = [np.concatenate(each) for each in zip(known, (between, *self.at(between)), strict=True)]
        found = np.empty(len(known[0]))
        for k in np.argsort(known[0], kind="stable"):
            found[k] = self._counted(*(float(part[k]) for part in known))
        return found[: len(times)]

    def _between(self, times: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Instants within steps that are too long by the rates at their ends, evaluated together, as one by one would
        take longer than the run."""
        ahead = times > self.times[-1]
        ends = np.concatenate([self.times[-1:], times[ahead]])
        steps, fast = np.diff(ends), abs(np.concatenate([self.rates[-1:], rates[ahead]]))
        parts = np.ceil(1.0001 * steps * np.maximum(1.0 / self.longest, np.maximum(fast[1:], fast[:-1]) / _FAR))
        return np.concatenate([np.empty(0), *(
            begin + step * np.arange(1, count) / count
            for begin, step, count in zip(ends, steps, parts, strict=False) if count > 1
        )])  # fmt: skip

    def _counted(self, t: float, angle: float, rate: float) -> float:
        """Angle continued from the last instant, with intermediate steps if it is too far."""
        while True:
            last = bisect.bisect_right(self.times, t) - 1
            step = t - self.times[last]
            if step <= self.longest and not step * max(abs(self.rates[last]), abs(rate)) > _FAR:
                break
            between = self.times[last] + min(self.longest, 0.5 * step)
            (other,), (fast,) = self.at(np.array([between]))
            self._counted(between, float(other), float(fast))
        near = self.angles[last] + 0.5 * step * (self.rates[last] + rate)
        found = angle + 2.0 * math.pi * round((near - angle) / (2.0 * math.pi))
        if step > 0.0:
            self.times.insert(last + 1, t)
            self.angles.insert(last + 1, found)
            self.rates.insert(last + 1, rate)
        return found
