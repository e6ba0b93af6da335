"""Input of an integration, and its checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kaneflex.integrate.methods import method_named
from kaneflex.integrate.system import AffineSystem
from kaneflex.support.errors import UserError

LEFT = "; the result is the unstable periodic motion"
"""Message about a periodic motion whose disturbances grow."""
LONGEST_STEP = 1e4  # of a cycle that is cut, times the fastest vibration's 1 / omega
Progress = Callable[[float], None]
"""Called with the finished share of the work, 0 to 1, a few times a second."""
Table = Callable[[np.ndarray], np.ndarray]
"""Scalars of the motion, shape (n_times, n_scalars), at times, shape (n_times,), in s."""
Start = str | tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Run:
    """Input of an integration: system, table, start, steps and method.

    table: scalars of the motion, shape (n_times, n_scalars), at an array of times in s; asked once for a
        cycle if `period_steps` is given, else for one piece of the run after the other.
    t0, step: in s. n_steps: at least 1.
    method: a name in `methods.METHODS`.
    start: "zero", a pair (z, v) of arrays of shape (n,), or "periodic": the motion that repeats itself after
        `period_steps` steps, from one cycle of every unit state (2 n + 1 columns that share one
        factorisation a step), so that no transient has to die.
    period_steps: steps of one cycle of the table.
    every: store one step in so many, the first one included.
    rho_infinity: spectral radius of generalised-alpha at infinite frequency, 0 to 1.
    scipy_method: of solve_ivp, for the method "scipy".
    tolerance: of the method "spectral": error of the motion, relative, in the energy norm.
    """

    system: AffineSystem
    table: Table
    t0: float
    step: float
    n_steps: int
    method: str = "newmark"
    start: Start = "zero"
    period_steps: int | None = None
    every: int = 1
    rho_infinity: float = 0.8
    scipy_method: str = "DOP853"
    tolerance: float = 1e-6


def check_arguments(run: Run) -> None:
    """Raise UserError for the first argument of a run that is invalid."""
    method_named(run.method)
    step, start = run.step, run.start
    if not (np.isfinite(step) and step > 0.0):
        raise UserError("step", step, "a step must be a positive time", "Give it in s")
    for name, value in (("steps", run.n_steps), ("every", run.every), ("period_steps", run.period_steps)):
        if value is not None and value < 1:
            raise UserError(name, value, "there must be at least one step", "Give a whole number from 1 on")
    if isinstance(start, str) and start not in ("zero", "periodic"):
        raise UserError("start", start, "unknown start", "Give zero, periodic or a state")
    if start == "periodic" and run.period_steps is None:
        raise UserError("start", start, "the motion has no cycle", "Give the drive a speed and a cycle")
    if start != "periodic" and run.method == "spectral":
        raise UserError("start", start, "the integrator spectral finds periodic motions only", "Use radau")
    if start == "periodic" and run.method == "scipy":
        raise UserError("start", start, "scipy can't find a periodic start", "Start from a state that radau found")


def steps_of_cycle(run: Run) -> int:
    """Number of steps in a cycle of a run that has one."""
    assert run.period_steps is not None  # or no periodic start was asked for: `check_arguments`
    return run.period_steps
