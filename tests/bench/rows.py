"""What the sections yield and the report writes: rows, each a candidate's time at a task."""

from __future__ import annotations

from dataclasses import dataclass

from bench.interleave import Spread


@dataclass(frozen=True)
class Target:
    """A limit of what a row states, its ratio or its value: ``reach`` is aimed at, ``dream`` hoped for.

    at_least : for ratios that say how many times as fast, where more is better.
    """

    reach: float
    dream: float | None = None
    at_least: bool = False

    def verdict(self, value: float) -> str:
        for limit, name in ((self.dream, "dream"), (self.reach, "met")):
            if limit is not None and ((value >= limit) if self.at_least else (value <= limit)):
                return name
        return "missed"


@dataclass(frozen=True)
class Row:
    """One line of a section's table.

    time : the value, seconds unless ``unit`` says otherwise.
    ratio : of this row to its task's reference, as the section's heading says; None for the reference itself.
    of_time : the target is one of the value, not of the ratio.
    differs : what is not the same as in the reference, so that the ratio can be judged.
    error : of the candidate's answer, where time is shown over it.
    """

    task: str
    candidate: str
    time: Spread | None
    ratio: float | None = None
    target: Target | None = None
    of_time: bool = False
    differs: str = ""
    missing: str = ""
    error: float | None = None
    unit: str = ""

    def verdict(self) -> str | None:
        """Whether the target is met; None where there is none, or nothing was timed."""
        value = (self.time.median if self.time else None) if self.of_time else self.ratio
        return None if self.target is None or value is None else self.target.verdict(value)
