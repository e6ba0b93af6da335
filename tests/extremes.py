"""Extremes as data: a case names a scene, how it is driven to its limit, and what it must come to.

Every case ends in a result within its accuracy, in a result with a warning, or in a named outcome or refusal: see
`attempt`. The cases themselves stand in `extreme_cases`.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass, field

import numpy as np

import kaneflex
from kaneflex import Solution, UserError, with_settings
from kaneflex.solve.simulation import solve

METHODS = {
    "rigid": ("solve.preset=rigid",),
    "quasistatic": ("solve.preset=quasistatic",),
    "paper": ("solve.preset=paper",),
    "linear": ("solve.preset=linear", "solve.integrator=radau"),
    "radau": ("solve.preset=stiffened", "solve.integrator=radau"),
    "newmark": ("solve.preset=stiffened", "solve.integrator=newmark"),
    "generalised-alpha": ("solve.preset=stiffened", "solve.integrator=generalised-alpha"),
    "gauss": ("solve.preset=stiffened", "solve.integrator=gauss"),
    "coupled": ("solve.preset=coupled",),
}
"""Column of the table -> its settings; the integrators are those of preset stiffened."""
STEPPED = ("linear", "radau", "newmark", "generalised-alpha")
"""The methods that integrate the linear equations of the deformation step by step; gauss only where forces are asked
for, since its displacements are as good as radau's."""


@dataclass(frozen=True, eq=False)
class Case:
    """One scene at one extreme.

    settings: of the scene, without those of the method
    error: of a finished run, against an expectation from elsewhere; relative, 0 where only the end is stated
    within: the accuracy that `accurate` methods must reach
    accurate: methods that must finish within it
    named: method -> how its message begins, where it must not finish
    also: further methods, which may end in any of the three ways that are allowed
    slow: methods that the short form leaves out
    """

    group: str
    name: str
    scene: str
    settings: tuple[str, ...]
    error: Callable[[Solution], float]
    within: float
    accurate: tuple[str, ...]
    named: dict[str, str] = field(default_factory=dict)
    also: tuple[str, ...] = ()
    slow: Container[str] = ()

    @property
    def methods(self) -> tuple[str, ...]:
        return tuple(name for name in METHODS if name in {*self.accurate, *self.named, *self.also})

    def __str__(self) -> str:
        return f"{self.group}, {self.name}"


@dataclass(frozen=True)
class Ending:
    """Outcome of a case, or "rejected"; its error if it finished; messages, and warnings if the error is larger than
    the case allows."""

    outcome: str
    error: float | None
    message: str
    warnings: tuple[str, ...]


def attempt(case: Case, method: str) -> Ending:
    """Load, run and measure; raises AssertionError where a number of any sensor is none."""
    try:
        found = kaneflex.load(with_settings(kaneflex.read_scene(case.scene), [*METHODS[method], *case.settings]))
        solution = solve(found)
        values = {name: series.values for name, series in solution.series.items()}
    except UserError as error:
        return Ending("rejected", None, str(error), ())
    assert all(np.isfinite(series).all() for series in values.values()), f"{case}, {method}: not a number"
    if solution.outcome.name != "COMPLETED":
        return Ending(solution.outcome.name.lower(), None, solution.trajectory.message, ())
    error = float(case.error(solution))
    if error <= case.within:  # what it says then is asked for by none, and takes longer than the run
        return Ending("completed", error, "", ())
    return Ending("completed", error, "", solution.warnings[len(found.warnings) :])  # less what its preset leaves out


def judge(case: Case, method: str, ending: Ending) -> str:
    """Why an ending is not what the case states; empty where it is."""
    if method in case.named:
        if case.named[method] in ending.message:
            return ""
        return f"{ending.outcome} {ending.error} {ending.message}: must say {case.named[method]!r}"
    accurate = ending.error is not None and ending.error <= case.within
    if method in case.accurate:
        return "" if accurate else f"{ending.outcome} {ending.message}: error {ending.error}, stated {case.within:g}"
    silent = ending.outcome == "completed" and not accurate and not ending.warnings
    return f"error {ending.error} beyond {case.within:g} without a word" if silent else ""


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over the largest expected value."""
    return float(abs(found - expected).max() / abs(expected).max())
