"""Section: the generated kernels against hand-written C and against what SymPy's users have."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numba import njit

from bench import casadi_peers, peers, spatial_peers
from bench.compiled import demand_compiler, pointer
from bench.interleave import Race, from_python, interleave, repeated
from bench.peers import Candidate
from bench.rows import Row, Target
from bench.tasks import Task, element_task, motion_task
from kaneflex.generated import slider_crank_150 as generated
from kaneflex.support.contract import ELEMENT_KERNELS

TITLE = "Kernels"
ABOUT = """\
Times are those of one evaluation. *Beam element* evaluates M, K_s, K_d, K_g, C and F with 114 nonzero numbers (296
in space). *Slider-crank* evaluates motion and inverse dynamics, 32 numbers. *In a loop* is a compiled loop over 16
samples; its ratio is to hand-written C (`tests/bench`, `-O3 -march=native`). *From Python* is one call by the
interpreter; its ratio is to kaneflex. All programs agree to 1e-12 of the largest entry."""
TARGET = Target(1.15)
"""Limit against regressions, in times of hand-written C."""
AGREEMENT = 1e-12
ROUNDS = 31
BUDGET = 6.0
"""Seconds of rounds for one task."""


Ratio = Callable[[Race, str, str], float | None]
"""How a race compares a candidate with the reference: `Race.ratio` or `Race.ratio_of_best`."""


@dataclass(frozen=True)
class Pace:
    """How long a race is and how it is judged: rounds at most, seconds of them, seconds of one go at least."""

    rounds: int
    budget: float
    go: float = 2e-3
    ratio: Ratio = Race.ratio

    @property
    def length(self) -> tuple[int, float]:
        return self.rounds, self.budget


def rows(rounds: int = ROUNDS, budget: float = BUDGET) -> Iterator[Row]:
    compiler = demand_compiler()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hand = peers.library(folder, compiler)
        for task in (element_task(), motion_task()):
            candidates, missing = candidates_of(task, folder, compiler, hand)
            check_agreement(task, candidates)
            yield from in_a_loop(task, candidates, Pace(rounds, budget))
            yield from called(task, candidates, Pace(rounds, budget))
            yield from missing
        yield from single_kernels(hand, rounds, budget)
        yield from in_space(spatial_peers.library(folder, compiler), rounds, budget)


def candidates_of(task: Task, folder: Path, compiler: str, hand: ctypes.CDLL) -> tuple[list[Candidate], list[Row]]:
    """Hand-written C first, kaneflex second; and a row for each peer that is not installed."""
    found, missing = [peers.hand_written(task, hand), peers.generated_kernels(task)], []
    makers: dict[str, Callable[[], Candidate]] = {
        "lambdify": partial(peers.lambdified, task, cse=False),
        "lambdify, cse": partial(peers.lambdified, task, cse=True),
        "lambdify, cse, njit": partial(peers.lambdified_jitted, task),
        "PyDy, Cython": partial(peers.pydy_cython, task, folder),
        "CasADi, virtual machine": partial(casadi_peers.virtual_machine, task),
        "CasADi, its C": partial(casadi_peers.compiled_c, task, folder, compiler),
    }
    for name, make in makers.items():
        try:
            found.append(make())
        except ModuleNotFoundError as error:
            missing.append(Row(task.name, name, None, missing=f"{error.name} is not installed"))
    return found, missing


def disagreement(task: Task, one: Candidate, other: Candidate) -> float:
    """Largest difference between two candidates' matrices over all samples, relative to each matrix's largest entry.

    The slider-crank's numbers are of many units, so there each is relative to its own largest value.
    """
    worst = 0.0
    pairs = [(one.outputs(k), other.outputs(k)) for k in range(task.values.size)]
    for name, matrix in task.matrices.items():
        first, second = (np.array([pair[side][name] for pair in pairs]) for side in (0, 1))
        scale = abs(first).max(axis=0 if matrix.cols == 1 else None)
        difference = abs(first - second).max(axis=0)
        worst = max(worst, float((difference / np.where(scale > 0.0, scale, 1.0)).max()))
    return worst


def check_agreement(task: Task, candidates: list[Candidate]) -> None:
    """
    Raises
    ------
    ValueError
        Before anything is timed, if a candidate computes something else than the first one.
    """
    first, *others = candidates
    for other in others:
        found = disagreement(task, first, other)
        if not found <= AGREEMENT:
            raise ValueError(f"{task.name}: {other.name} differs from {first.name} by {found:.1e} of the largest entry")


def in_a_loop(task: Task, candidates: list[Candidate], pace: Pace) -> Iterator[Row]:
    race = interleave({one.name: repeated(one.many, pace.go) for one in candidates if one.many}, *pace.length)
    notes = {one.name: one.differs for one in candidates}
    yield from compared(f"{task.name}, in a loop", race, notes, {"kaneflex": TARGET}, pace.ratio)


def called(task: Task, candidates: list[Candidate], pace: Pace) -> Iterator[Row]:
    hand, ours, *others = candidates
    timed = {one.name: repeated(from_python(one.once), pace.go) for one in (ours, hand, *others)}
    notes = {one.name: one.differs for one in candidates}
    yield from compared(f"{task.name}, from Python", interleave(timed, *pace.length), notes, ratio=pace.ratio)


def compared(
    task: str, race: Race, notes: Mapping[str, str], targets: Mapping[str, Target] | None = None,
    ratio: Ratio = Race.ratio,
) -> Iterator[Row]:
    """A row each, the ratios to the first."""
    reference, *_ = race
    for name in race:
        found = ratio(race, name, reference)
        yield Row(task, name, race[name], found, (targets or {}).get(name), differs=notes.get(name, ""))


def single_kernels(hand: ctypes.CDLL, rounds: int, budget: float) -> Iterator[Row]:
    """Each element kernel in a loop of its own."""
    task = element_task()
    p, s = task.sample(0)
    for name in ELEMENT_KERNELS:
        out = np.zeros(6 if name == "F" else (6, 6))
        pointers = [pointer(array) for array in (task.values, p, s, out)]
        in_c = getattr(hand, f"{name}_many")
        ours = _loop(getattr(generated, name), name in ("M", "K_s"))
        timed = {
            "hand-written C": repeated(lambda n, f=in_c, rest=pointers: f(ctypes.c_long(n), *rest)),
            "kaneflex": repeated(lambda n, f=ours, out=out: f(n, task.values, p, s, out)),
        }
        race = interleave(timed, rounds, budget / len(ELEMENT_KERNELS))
        yield from compared(f"{name} alone, in a loop", race, {}, {"kaneflex": TARGET})


def in_space(hand: ctypes.CDLL, rounds: int, budget: float) -> Iterator[Row]:
    """
    Raises
    ------
    ValueError
        Before anything is timed, if C and our kernels disagree.
    """
    found = spatial_peers.disagreement(hand)
    if not found <= AGREEMENT:
        raise ValueError(f"{spatial_peers.NAME}: kaneflex differs from hand-written C by {found:.1e}")
    for task, candidates in spatial_peers.races(hand):
        timed = {name: repeated(many) for name, many in candidates.items()}
        race = interleave(timed, rounds, budget / (1 + len(ELEMENT_KERNELS)))
        yield from compared(f"{task}, in a loop", race, {}, {"kaneflex": TARGET})


def _loop(kernel: Callable, constant: bool) -> Callable:
    """The loop of kernels.c around one generated kernel; ``constant``: it does not depend on the motion."""

    @njit
    def of_parameters(n, values, p, s, out):
        for i in range(n):
            p[3] = values[i & 15]
            s[0] = values[i & 15]
            kernel(p, out)

    @njit
    def of_motion(n, values, p, s, out):
        for i in range(n):
            p[3] = values[i & 15]
            s[0] = values[i & 15]
            kernel(p, s, out)

    return of_parameters if constant else of_motion
