"""Integration of a system with the table of its scalars by a method."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial, reduce

import numpy as np

from kaneflex.integrate.conventions import LANES, aligned
from kaneflex.integrate.spectral import Grid, Orbit, periodic_orbit
from kaneflex.integrate.system import (
    LEFT,
    Floquet,
    Outcome,
    Progress,
    Run,
    Trajectory,
    check_arguments,
    leading,
    steps_of_cycle,
)
from kaneflex.support.machine_code import Kernel

_LONGEST_STEP = 1e4
"""Times the fastest vibration's 1 / omega, of steps that tell something about stability."""
_CLEAR, _SQUARED = 0.5, 8
"""Smallest growth per cycle for which piecewise constant equations do not decide on stability; number of squarings of
the monodromy matrix."""


def integrate(run: Run, progress: Progress | None = None) -> Trajectory:
    """Integrate M z'' + C z' + K z = F.

    progress: called with the finished share of the work, first of the periodic start, then of the run.

    A run that grows without bound or has a singular step stops there with a named outcome, as does a periodic start
    without a periodic state. An unstable periodic motion is returned for its cycle, with that outcome. Raises UserError
    for invalid arguments, and for a table with numbers that are not finite.
    """
    check_arguments(run)
    if run.method == "spectral":
        return _spectral(run, progress)
    from kaneflex.integrate.by_steps import by_steps

    return by_steps(run, progress)


def _spectral(run: Run, progress: Progress | None) -> Trajectory:
    """Periodic motion by its harmonics, or by steps of radau if too many harmonics are needed."""
    started, steps = time.perf_counter(), steps_of_cycle(run)
    period = run.step * steps
    orbit = periodic_orbit(run.system, run.table, run.t0, period, run.tolerance)
    if orbit.reason:
        return _in_steps(run, progress, orbit.reason)
    outcome, message, multipliers = _judged(run, orbit, progress)
    if outcome is Outcome.UNSTABLE:
        message += LEFT
    elif outcome is not Outcome.COMPLETED:
        return _in_steps(run, progress, "stability is uncertain with harmonics")
    message = "; ".join(filter(None, ("" if outcome is Outcome.UNSTABLE else outcome.value, message)))
    at = run.every * np.arange(run.n_steps // run.every + 1)
    z, v, a = np.ascontiguousarray(orbit.at(steps).swapaxes(1, 2)).take(at, axis=1, mode="wrap")
    ns_per_step = 1e9 * (time.perf_counter() - started) / steps
    times = run.t0 + run.step * at
    return Trajectory(times, z, v, a, outcome, message, multipliers, ns_per_step, orbit.said)


def _in_steps(run: Run, progress: Progress | None, reason: str) -> Trajectory:
    from kaneflex.integrate.by_steps import by_steps

    found = by_steps(replace(run, method="radau"), progress)
    return replace(found, solver=f"radau with time steps, since {reason}")


def _judged(run: Run, orbit: Orbit, progress: Progress | None) -> tuple[Outcome, str, Floquet]:
    """Stability of a periodic motion: whether disturbances grow, a message, and the Floquet multipliers.

    By steps with constant equations, or by radau if these are uncertain. They give no information about vibrations much
    faster than the steps, as in a machine that hardly moves.
    """
    steps, grid = steps_of_cycle(run), orbit.grid
    if run.step * steps / FEWEST * grid.fastest > _LONGEST_STEP:
        return Outcome.COMPLETED, "the stability is unknown: the steps are too long", None
    moved = monodromy(grid)
    if dies_away(moved):
        return Outcome.COMPLETED, "", partial(_eigenvalues, moved)
    from kaneflex.integrate.by_steps import periodic_start

    judged = periodic_start(replace(run, method="radau", n_steps=steps), progress)
    return judged.outcome, judged.message, judged.multipliers


def dies_away(moved: np.ndarray) -> bool:
    """True if a monodromy matrix certainly damps disturbances.

    The root of a power's norm is an upper bound of the spectral radius, and close to it.
    """
    power = moved
    with np.errstate(over="ignore", invalid="ignore"):  # of disturbances that grow
        for _ in range(_SQUARED):
            power = power @ power
        return float(np.linalg.norm(power)) ** (0.5**_SQUARED) < _CLEAR


def _eigenvalues(matrix: np.ndarray) -> np.ndarray:
    return leading(np.linalg.eigvals(matrix), len(matrix) // 2)


FEWEST, MOST, PER_PERIOD = 256, 1024, 4
"""Smallest and largest number of steps per cycle, and number per period of the slowest vibration (error of R 1e-2)."""
_POLES = np.roots([-1.0 / 60.0, 3.0 / 20.0, -3.0 / 5.0, 1.0])
_POLES = np.array([_POLES[abs(_POLES.imag) < 1e-9][0].real, _POLES[_POLES.imag > 1e-9][0]])
_SHARES = (1.0 + 0.4 * _POLES + 0.05 * _POLES**2) / (-0.6 + 0.3 * _POLES - 0.05 * _POLES**2) * (1.0, 2.0)
"""Residues of R at the real pole and, doubled, at one of the others: R(x) is the real part of their sum."""


_eighths = Kernel("integrate.instants", "eighths")


def monodromy(grid: Grid) -> np.ndarray:
    """Matrix (2 n, 2 n) that moves (z, h z') over a cycle, from half a step h before its start on."""
    every = max(1, grid.instants // FEWEST)
    instants = grid.instants // every
    wanted = PER_PERIOD * grid.slowest / grid.omega
    repeats = math.ceil(min(max(FEWEST, wanted), MOST) / instants)
    step = 2.0 * math.pi / (grid.omega * instants * repeats)
    poles = np.array([_POLES[0].real, _POLES[1].real, _POLES[1].imag])
    shares = np.array([_SHARES[0].real, _SHARES[1].real, _SHARES[1].imag])
    n, w = grid.n, grid.half_bandwidth
    state, entries, vectors = aligned(2 * n, 2 * n, LANES), aligned(5, n * (2 * w + 1), LANES), aligned(3, n, LANES)
    state[...] = np.eye(2 * n)[..., None]
    _eighths(n, w, grid.sums, every, repeats, step, poles, shares, entries, vectors, state)
    return reduce(lambda before, then: then @ before, state.transpose(2, 1, 0))
