"""Angles with whole turns from angles modulo 2 pi."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

_FAR = 1.0
"""Largest change of an angle in a step [rad], by the rate at either end, for a reliable count of turns."""


class Counts:
    """Counts of the turns of several angles from the start of a run, in steps too short for a whole turn.

    Parameters
    ----------
    at : callable
        Angles (n_times, n) at ascending times [s], from -pi to pi, and their rates [rad, rad/s].
    longest : float
        Longest step [s].
    begin : float
        Start [s].
    known : ndarray (n,)
        Angles with whole turns there; NaN: none.
    """

    def __init__(
        self, at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], longest: float, begin: float = 0.0,
        known: np.ndarray | float = math.nan,
    ) -> None:  # fmt: skip
        self.at, self.longest = at, longest
        start = np.array([begin])
        self.times, self.angles, self.rates = start, *at(start)
        self.first = np.nan_to_num(np.round((known - self.angles) / math.tau))

    def over(self, times: np.ndarray, angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Angles (n_times, n) [rad] at times [s] with whole turns; ``angles``: without these.

        Each turn is counted from the change of an angle that the rates at both ends of a step predict.
        """
        self._add(times, angles, rates)
        while len(between := self._between()):
            self._add(between, *self.at(between))
        near = 0.5 * np.diff(self.times)[:, None] * (self.rates[1:] + self.rates[:-1])
        turns = np.round((near - np.diff(self.angles, axis=0)) / math.tau)
        counted = self.angles + math.tau * np.cumsum(np.vstack([self.first, turns]), axis=0)
        return np.asarray(counted[np.searchsorted(self.times, times)])

    def _add(self, times: np.ndarray, angles: np.ndarray, rates: np.ndarray) -> None:
        """Add instants to the known ones, in their order."""
        self.times, first = np.unique(np.concatenate([self.times, times]), return_index=True)
        self.angles, self.rates = (
            np.concatenate(parts)[first] for parts in ((self.angles, angles), (self.rates, rates))
        )  # fmt: skip

    def _between(self) -> np.ndarray:
        """Instants within steps that are too long by the rates at their ends, ascending."""
        steps, fast = np.diff(self.times), abs(np.nan_to_num(self.rates)).max(axis=1, initial=0.0)
        parts = steps * np.maximum(1.0 / self.longest, np.maximum(fast[1:], fast[:-1]) / _FAR)
        long = np.flatnonzero(parts > 1.0001)
        return np.concatenate([np.zeros(0), *(
            self.times[k] + steps[k] * np.arange(1, count) / count
            for k, count in zip(long, np.ceil(parts[long]), strict=True)
        )])  # fmt: skip
