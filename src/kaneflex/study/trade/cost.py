"""What a model costs, from repeated runs."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from kaneflex.study.runs import Timing


@dataclass(frozen=True)
class Cost:
    """Medians of repeated runs [s].

    Attributes
    ----------
    set_up, solve, read, total : float
        As in :class:`kaneflex.study.runs.Timing`; the median of the totals, not the total of the medians.
    spread : float or None
        Largest total less the smallest, as a share of the median; None of a single repeat.
    ns_per_step : float
        Of ``solve``, rigid motion and start included.
    steps, repeats : int
    operations : int or None
    first : float
        Wall time of the first run of all, with deriving and compiling where they were still to be done.
    """

    set_up: float
    solve: float
    read: float
    total: float
    spread: float | None
    ns_per_step: float
    steps: int
    repeats: int
    operations: int | None
    first: float


def cost(first: Timing, repeats: Sequence[Timing]) -> Cost:
    """Medians and spread of at least one repeat; the first run, which compiles, counts in none of them."""
    totals = [timing.total for timing in repeats]
    total, solve = statistics.median(totals), statistics.median(timing.solve for timing in repeats)
    return Cost(
        set_up=statistics.median(timing.set_up for timing in repeats),
        solve=solve,
        read=statistics.median(timing.read for timing in repeats),
        total=total,
        spread=(max(totals) - min(totals)) / total if len(totals) > 1 else None,
        ns_per_step=1e9 * solve / first.steps,
        steps=first.steps,
        repeats=len(repeats),
        operations=first.operations,
        first=first.once + first.total,
    )
