"""Linear second-order equations with coefficients affine in a table of scalars, their integration and its outcome."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from kaneflex.support.errors import UserError
from kaneflex.support.sparse_rows import Entries, SparseRows, coefficients, rows_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Rows: TypeAlias = "SparseRows | csr_array"
_MATRICES = ("M", "C", "K")


@dataclass(frozen=True, eq=False)
class AffineSystem:
    """M(t) z'' + C(t) z' + K(t) z = F(t), each a sum of scalar of the motion x constant matrix.

    n: number of coordinates z
    half_bandwidth: largest ``|i - j|`` with an entry (i, j) in M, C or K, called w below; n - 1 means dense
    M, C, K: shape ``(n * (2 w + 1), n_scalars)``; row ``i * (2 w + 1) + (j - i + w)`` times the scalars is entry (i, j)
    F: shape ``(n, n_scalars)``

    The scalars are the caller's, ``table(times) -> array (n_times, n_scalars)``; a constant matrix belongs
    to a scalar that is 1 at all times. Units are the caller's too, as long as they are consistent.

    Raises ValueError where the shapes do not fit each other or an entry lies outside the matrix.
    """

    n: int
    half_bandwidth: int
    M: Rows
    C: Rows
    K: Rows
    F: Rows

    def __post_init__(self) -> None:
        if not 0 <= self.half_bandwidth < self.n:
            raise ValueError(f"half_bandwidth = {self.half_bandwidth}: must be 0 to n - 1 = {self.n - 1}")
        rows = self.n * (2 * self.half_bandwidth + 1)
        for name in (*_MATRICES, "F"):
            expected = (self.n if name == "F" else rows, self.n_scalars)
            if getattr(self, name).shape != expected:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}: must be {expected}")
            columns = self.entries_of(name).columns
            if columns.min(initial=0) < 0 or columns.max(initial=0) >= self.n:
                raise ValueError(f"{name} has an entry in a column outside 0 to {self.n - 1}, off the matrix")

    @classmethod
    def of(cls, n: int, n_scalars: int, M: Entries, C: Entries, K: Entries, F: Entries) -> AffineSystem:
        """System with these entries, in the narrowest band."""
        w = max(int(abs(each.rows - each.columns).max(initial=0)) for each in (M, C, K))
        shape = n * (2 * w + 1), n_scalars
        banded = (coefficients(2 * w * each.rows + each.columns + w, each, shape) for each in (M, C, K))
        return cls(n, w, *(*banded, coefficients(F.rows, F, (n, n_scalars))))

    @property
    def n_scalars(self) -> int:
        """Number of scalars in a row of the table."""
        return self.F.shape[1]

    def dense(self, name: str, scalars: np.ndarray) -> np.ndarray:
        """M, C or K as an (n, n) array, or F as (n,), at one row of the table, shape (n_scalars,)."""
        scalars = np.asarray(scalars, dtype=float)
        if name == "F":
            return self.F @ scalars
        matrix, each = np.zeros((self.n, self.n)), self.entries_of(name)
        np.add.at(matrix, (each.rows, each.columns), each.values * scalars[each.scalars])
        return matrix

    @cached_property
    def stacked(self) -> SparseRows:
        """Rows of M, then C, then K, then F: the terms of each slot."""
        matrices = [getattr(self, name) for name in (*_MATRICES, "F")]
        data, indices = (np.concatenate([getattr(each, of) for each in matrices]) for of in ("data", "indices"))
        ends = np.append(0, np.cumsum(np.concatenate([np.diff(each.indptr) for each in matrices])))
        return SparseRows(data, indices.astype(np.int64), ends, (len(ends) - 1, self.n_scalars))

    def reached(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Mask of the coordinates, (n,), that move from a state (z, v) or by F, or are coupled to such ones."""
        found = (z != 0.0) | (v != 0.0)
        found[self.entries_of("F").rows] = True
        rows, columns = np.hstack([self.entries_of(name)[:2] for name in _MATRICES])
        while (between := found[rows] != found[columns]).any():
            found[rows[between]] = found[columns[between]] = True
        return found

    def part(self, chosen: np.ndarray) -> AffineSystem:
        """Equations of some coordinates, a mask of shape (n,), that are not coupled to others."""
        place, found = np.cumsum(chosen) - 1, list[Entries]()
        for each in map(self.entries_of, (*_MATRICES, "F")):
            rows, columns, *numbers = (of[chosen[each.rows]] for of in each)
            found.append(Entries(place[rows], place[columns], *numbers))
        return AffineSystem.of(int(chosen.sum()), self.n_scalars, *found)

    def entries_of(self, name: str) -> Entries:
        """Entries of M, C or K that are not zero, or of F, in a column each."""
        matrix, w = getattr(self, name), 0 if name == "F" else self.half_bandwidth
        stored = np.flatnonzero(matrix.data)
        rows, offset = np.divmod(rows_of(matrix)[stored], 2 * w + 1)
        return Entries(rows, rows + offset - w, matrix.data[stored], matrix.indices[stored])


Floquet = np.ndarray | Callable[[], np.ndarray | None] | None


class Outcome(Enum):
    """Outcome of a run; the value is the text for the user."""

    COMPLETED = "completed"
    UNSTABLE = "unstable: the motion grows without bound"
    STUCK = "stuck: the motion can't be continued"
    SINGULAR = "singular step: a pivot of its equations vanishes"
    NO_PERIODIC_STATE = "no periodic state: a Floquet multiplier equals one"
    CASCADE = "cascade: contacts close and open without end at one instant"
    PARADOX = "paradox: no combination of sticking and sliding satisfies the friction laws"


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Motion at the stored steps, in the units of the system.

    times: shape (n_out,), in s
    z, v, a: shape (n_out, n), displacements, velocities, accelerations; they satisfy the equation
    outcome, message: outcome; the message adds time and reason
    floquet: the multipliers, or a function that computes them on demand
    ns_per_step: wall time of a step in the compiled loop, without compiling and without the table, in ns
    solver: method used and the reason, as text; empty without a choice

    A run that stopped early holds the steps before; without a periodic state it is empty.
    """

    times: np.ndarray
    z: np.ndarray
    v: np.ndarray
    a: np.ndarray
    outcome: Outcome
    message: str
    floquet: Floquet
    ns_per_step: float
    solver: str = ""

    def at(self, times: np.ndarray) -> Trajectory:
        """Motion at other instants: the quintic through the stored z, z', z''."""
        from scipy.interpolate import BPoly

        knots = np.stack([self.z, self.v, self.a], axis=1)
        if not knots.size:
            empty = np.zeros((len(times), 0))
            return replace(self, times=times, z=empty, v=empty, a=empty)
        curve = BPoly.from_derivatives(self.times, knots)
        z, v, a = curve(times), curve.derivative(1)(times), curve.derivative(2)(times)
        return replace(self, times=times, z=z, v=v, a=a)

    @cached_property
    def multipliers(self) -> np.ndarray | None:
        """Complex, shape (2 n,), Floquet multipliers of the *discrete* equations by decreasing modulus.

        None if not computed.
        """
        return self.floquet() if callable(self.floquet) else self.floquet


def leading(multipliers: np.ndarray, n: int) -> np.ndarray:
    """Multipliers of largest modulus (2 n of them), largest first."""
    return multipliers[np.argsort(-np.abs(multipliers), kind="stable")][: 2 * n].astype(complex)


LEFT = "; the result is the unstable periodic motion"
"""Message about a periodic motion whose disturbances grow."""
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
    tolerance: float = 1e-6


def check_arguments(run: Run) -> None:
    """Raise UserError for the first argument of a run that is invalid."""
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


def steps_of_cycle(run: Run) -> int:
    """Number of steps in a cycle of a run that has one."""
    assert run.period_steps is not None  # or no periodic start was asked for: `check_arguments`
    return run.period_steps


def given_state(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Initial z and v of a run, zero unless it gives them; raises UserError if they are not n finite numbers."""
    if isinstance(run.start, str):
        return np.zeros(run.system.n), np.zeros(run.system.n)
    n = run.system.n
    z, v = (np.asarray(part, dtype=float) for part in run.start)
    for name, part in (("z", z), ("v", v)):
        if part.shape != (n,) or not np.isfinite(part).all():
            raise UserError(f"start {name}", part, f"must be {n} finite numbers", "Give one number for each coordinate")
    return z, v
