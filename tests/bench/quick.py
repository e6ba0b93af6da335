"""The kernels against hand-written C and lambdify, in seconds, with bounds that only a blunder breaks.

Judged are the fastest of many rounds. A go is far shorter than what a scheduler lets a process run, so that some goes
of every candidate are not interrupted where the machine is busy with something else.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from bench import peers
from bench.compiled import demand_compiler
from bench.interleave import Race
from bench.kernels import Pace, called, check_agreement, in_a_loop
from bench.rows import Row
from bench.tasks import element_task, motion_task

MOST = {"kaneflex": 2.0}
"""Candidate -> largest ratio to hand-written C in a loop."""
LEAST = {"lambdify": 5.0, "lambdify, cse": 3.0}
"""Candidate -> least ratio to kaneflex from Python."""
PACE = Pace(rounds=300, budget=4.0, go=2e-4, ratio=Race.ratio_of_best)


def rows() -> Iterator[Row]:
    compiler = demand_compiler()
    with tempfile.TemporaryDirectory() as folder:
        hand = peers.library(Path(folder), compiler)
        for task in (element_task(), motion_task()):
            candidates = [peers.hand_written(task, hand), peers.generated_kernels(task)]
            candidates += [peers.lambdified(task, cse) for cse in (False, True)]
            check_agreement(task, candidates)
            yield from in_a_loop(task, candidates, PACE)
            yield from called(task, candidates, PACE)


def broken(found: Iterable[Row]) -> list[str]:
    """Which bounds the rows break, in words."""
    wrong = []
    for row in found:
        bounds, sign = (MOST, 1) if row.task.endswith("in a loop") else (LEAST, -1)
        bound = bounds.get(row.candidate)
        if bound is not None and row.ratio is not None and sign * row.ratio > sign * bound:
            relation = "above" if sign > 0 else "below"
            wrong.append(f"{row.task}, {row.candidate}: ratio {row.ratio:.2f} is {relation} {bound:g}")
    return wrong
