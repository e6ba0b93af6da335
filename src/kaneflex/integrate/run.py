"""Integration of a system with the table of its scalars by a method."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from kaneflex.integrate.grid import Grid, dense
from kaneflex.integrate.spectral import Orbit, periodic_orbit
from kaneflex.integrate.system import (
    LEFT,
    Floquet,
    Outcome,
    Progress,
    Run,
    Trajectory,
    check_arguments,
    given_state,
    leading,
    steps_of_cycle,
)

_LONGEST = 2.5e6
"""Times the fastest vibration's 1 / omega, of a cycle whose steps give information about stability."""
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
    moving = run.system.reached(*given_state(run))
    if moving.all() or not moving.any():
        return _by_method(run, progress)
    parts, (z, v) = list[Trajectory](), (each[moving] for each in given_state(run))
    if run.start == "periodic":  # what stays at rest may be unstable, too
        parts = [_by_method(replace(run, system=run.system.part(~moving)))]
        if parts[0].message != Outcome.COMPLETED.value:
            return _by_method(run, progress)
    start = run.start if isinstance(run.start, str) else (z, v)
    parts.append(_by_method(replace(run, system=run.system.part(moving), start=start), progress))

    found = parts[-1]
    whole = np.zeros((3, len(found.times), run.system.n))
    whole[:, :, moving] = found.z, found.v, found.a
    z, v, a = whole
    return replace(found, z=z, v=v, a=a, floquet=partial(_multipliers, parts))


def _multipliers(parts: Sequence[Trajectory]) -> np.ndarray | None:
    """Floquet multipliers of uncoupled equations; None if those of a part are unknown."""
    known = [each.multipliers for each in parts if each.multipliers is not None]
    n = sum(each.z.shape[1] for each in parts)
    return leading(np.concatenate(known), n) if len(known) == len(parts) else None


def _by_method(run: Run, progress: Progress | None = None) -> Trajectory:
    """Motion by steps, or a periodic one by its harmonics; by steps of radau if too many harmonics are needed."""
    if run.method != "spectral":
        from kaneflex.integrate.by_steps import by_steps

        return by_steps(run, progress)
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
    return Trajectory(times, z, v, a, outcome, message, multipliers, ns_per_step, orbit.description)


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
    if run.step * steps * grid.fastest > _LONGEST:
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


PIECES = 64
"""Pieces of a cycle, with the means of the matrices over each."""
FEWEST, MOST, PER_PERIOD = 256, 1024, 4
"""Smallest and largest number of steps per cycle, and number per period of the slowest vibration (error of R 1e-2)."""
_POLES = np.roots([-1.0 / 60.0, 3.0 / 20.0, -3.0 / 5.0, 1.0])
_POLES = np.array([_POLES[abs(_POLES.imag) < 1e-9][0].real, _POLES[_POLES.imag > 1e-9][0]])
_SHARES = (1.0 + 0.4 * _POLES + 0.05 * _POLES**2) / (-0.6 + 0.3 * _POLES - 0.05 * _POLES**2) * (1.0, 2.0)
"""Residues of R at the real pole and, doubled, at one of the others: R(x) is the real part of their sum."""
_MEMORY = 1e8
"""Bytes of the matrices of steps that are computed at once."""


def monodromy(grid: Grid) -> np.ndarray:
    """Matrix (2 n, 2 n) that moves (z, h z') over a cycle, from half a step h before its start on.

    With x' = A x and u = (p - h A)^-1 x it is (p^2 M + p h C + h^2 K) h u' = p M h x' - h^2 K x, p u = x + h u'.
    """
    every = grid.instants // PIECES
    pieces = grid.instants // every
    means = grid.matrices.reshape(*grid.matrices.shape[:3], pieces, every).mean(axis=-1)
    wanted = min(max(FEWEST, PER_PERIOD * grid.slowest / grid.omega), MOST)
    doubled = math.ceil(math.log2(max(wanted / pieces, 1.0)))
    step = 2.0 * math.pi / (grid.omega * pieces * 2**doubled)
    moved = np.eye(2 * grid.n)
    parts = min(math.ceil(64 * pieces * grid.n**2 / _MEMORY), pieces)
    for part in np.array_split(np.arange(pieces), parts):
        found = _propagators([dense(each) for each in means[..., part]], step)
        for _ in range(doubled):
            found = found @ found
        while len(found) > 1:
            paired = found[1::2] @ found[: len(found) // 2 * 2 : 2]
            found = np.concatenate((paired, found[len(found) // 2 * 2 :]))
        moved = found[0] @ moved
    return moved


def _propagators(matrices: Sequence[np.ndarray], h: float) -> np.ndarray:
    """Matrices (k, 2 n, 2 n) that move (z, h z') over a step h with constant M, C and K, each (k, n, n)."""
    mass, damping, stiffness = matrices
    start, found = np.eye(mass.shape[1], 2 * mass.shape[1]), np.zeros(())
    for pole, share in zip(_POLES, _SHARES, strict=True):
        p, r = (pole.real, share.real) if pole.imag == 0.0 else (pole, share)
        known = np.concatenate((-(h * h) * stiffness, p * mass), axis=2)
        rate = np.linalg.solve(p * p * mass + p * h * damping + h * h * stiffness, known)
        found = found - (r * np.concatenate(((start + rate) / p, rate), axis=1)).real
    return found
