"""The one timer: candidates take turns, so that a machine that slows down slows all of them."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

Timed = Callable[[], float]
"""Runs a candidate once and returns the seconds that count."""


@dataclass(frozen=True)
class Spread:
    """Median and quartiles [s] of so many rounds."""

    median: float
    low: float
    high: float
    rounds: int


@dataclass(frozen=True)
class Race:
    """Seconds of each candidate in every round."""

    seconds: Mapping[str, Sequence[float]]

    def __getitem__(self, name: str) -> Spread:
        low, median, high = np.percentile(self.seconds[name], (25, 50, 75))
        return Spread(float(median), float(low), float(high), len(self.seconds[name]))

    def __iter__(self) -> Iterator[str]:
        return iter(self.seconds)

    def ratio(self, name: str, reference: str) -> float | None:
        """Median of the rounds' ratios, since what slows down a round slows down both; None of the reference itself."""
        if name == reference:
            return None
        return float(np.median(np.divide(self.seconds[name], self.seconds[reference])))

    def ratio_of_best(self, name: str, reference: str) -> float | None:
        """Ratio of the fastest rounds: other programs only ever add time, and in the fastest round the least."""
        if name == reference:
            return None
        return min(self.seconds[name]) / min(self.seconds[reference])


def interleave(candidates: Mapping[str, Timed], rounds: int, budget: float = np.inf) -> Race:
    """Seconds of each candidate, one after the other in every round.

    Parameters
    ----------
    candidates : mapping
        Each is called once before the rounds begin, for caches and for compiling.
    rounds : int
        At least one is finished.
    budget : float
        Seconds after which no further round begins.
    """
    for timed in candidates.values():
        timed()
    found: dict[str, list[float]] = {name: [] for name in candidates}
    begun = time.perf_counter()
    with _collector_off():
        for _ in range(rounds):
            for name, timed in candidates.items():
                found[name].append(timed())
            if time.perf_counter() - begun > budget:
                break
    return Race(found)


def repeated(many: Callable[[int], object], at_least: float = 2e-3) -> Timed:
    """Seconds a call of what is called so often in one go, ``many(n)``, that the clock's own cost does not count.

    So often is found from the faster of two goes: one that was interrupted would stop at too small an n.
    """

    def seconds(n: int) -> float:
        started = time.perf_counter()
        many(n)
        return time.perf_counter() - started

    seconds(1)
    n = 16
    while min(seconds(n), seconds(n)) < at_least:
        n *= 2
    return lambda: seconds(n) / n


def from_python(call: Callable[[], object]) -> Callable[[int], None]:
    """``many`` of a function that is called from the interpreter, whose own loop then counts as well."""

    def many(n: int) -> None:
        for _ in range(n):
            call()

    return many


@contextmanager
def _collector_off() -> Iterator[None]:
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
