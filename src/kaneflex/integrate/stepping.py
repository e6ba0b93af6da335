"""Control of a compiled loop over a run, piece by piece, so that Python can show progress and be interrupted."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from kaneflex.integrate.conventions import COMPLETED, OUTCOMES, SINGULAR, UNBOUNDED, Plan
from kaneflex.integrate.methods import Method
from kaneflex.integrate.streams import CoefficientStream
from kaneflex.integrate.system import AffineSystem, Outcome, Progress
from kaneflex.support.c_library import FAST, addresses_of, by_address

_WORK_OF_A_CALL = 1e8  # multiplications between two looks at the keyboard: about a tenth of a second
_RUNAWAY = 1e12  # times the largest displacement that the forces could cause on the free masses
_LARGEST = 1e150  # its square is still a number

_OUTCOMES = {
    COMPLETED: Outcome.COMPLETED,
    SINGULAR: Outcome.SINGULAR,
    UNBOUNDED: Outcome.UNSTABLE,
}
_STEPPERS = "newmark", "collocation", "exact_modal"
_PARTS = ("integrate.conventions",)
_ARGUMENTS = *(ctypes.c_void_p,) * 17, ctypes.c_double


@cache
def stepper(name: str) -> Callable[..., int]:
    """Compiled loop of `kaneflex.integrate.steppers`."""
    addresses = addresses_of("integrate.steppers", _STEPPERS, _PARTS, FAST)
    return ctypes.CFUNCTYPE(ctypes.c_int64, *_ARGUMENTS)(addresses[_STEPPERS.index(name)])


class State(NamedTuple):
    """Columns of states, each array of shape (n, columns).

    Displacements, velocities, the method's own accelerations and those of the equation of motion.
    """

    z: np.ndarray
    v: np.ndarray
    a: np.ndarray
    q: np.ndarray

    @classmethod
    def zeros(cls, n: int, columns: int) -> State:
        return cls(*(np.zeros((n, columns)) for _ in cls._fields))


class Stored(NamedTuple):
    """Stored steps of the first column, each array of shape (n_out, n)."""

    z: np.ndarray
    v: np.ndarray
    a: np.ndarray

    @classmethod
    def of(cls, state: State, rows: int) -> Stored:
        """Room for so many rows, with the start in the first one."""
        stored = cls(*(np.zeros((rows, len(state.z))) for _ in cls._fields))
        for out, now in zip(stored, (state.z, state.v, state.q), strict=True):
            out[0] = now[:, 0]
        return stored


class Advance(NamedTuple):
    """Progress of the compiled loop, its outcome, and the time per step [ns]."""

    steps: int
    outcome: Outcome
    ns_per_step: float


@dataclass(frozen=True, eq=False)
class Setup:
    """All that does not change during a run.

    coefficients: numbers of the method
    scales: factors of z, v and, where the method carries accelerations of its own, a, that make their sizes alike
    progress: see :data:`Progress`
    """

    system: AffineSystem
    method: Method
    stream: CoefficientStream
    coefficients: np.ndarray
    scales: tuple[float, ...]
    progress: Progress | None = None

    def slots(self, copies: int) -> int:
        """Numbers in the band of a matrix with every coordinate `copies` times, side by side."""
        return self.system.n * (2 * self.system.half_bandwidth + 1) * copies**2

    @cached_property
    def layouts(self) -> list[np.ndarray]:
        """Layouts of the matrices of the system and of all stages: base, first and last, one after the other.

        Zeros within the profile of M, C and K are stored, too: elimination fills no others (Jennings 1966).
        """
        n, w, found = self.system.n, self.system.half_bandwidth, list[np.ndarray]()
        last = np.arange(n) + 1
        for rows, columns, *_ in map(self.system.entries_of, "MCK"):
            np.maximum.at(last, np.minimum(rows, columns), np.maximum(rows, columns) + 1)
        last = np.maximum.accumulate(last)
        first = np.searchsorted(last, np.arange(n), side="right")
        for copies in (1, max(1, self.method.stages)):
            rows, blocks = np.arange(n * copies), np.repeat(np.arange(n), copies)
            base = (rows * (2 * w + 1) - blocks + w) * copies
            found.append(np.concatenate((base, first[blocks] * copies, last[blocks] * copies)).astype(np.int64))
        return found

    @cached_property
    def work(self) -> dict[int, np.ndarray]:
        """Room for the loop, by the number of columns."""
        return {}

    def loop(
        self, piece: tuple[np.ndarray, int, int, int], coefficients: np.ndarray, load_factor: np.ndarray, state: State,
        counted: tuple[int, int], stored: Stored, bound: float,
    ) -> tuple[int, int]:  # fmt: skip
        """Steps that the method's compiled loop completed, and its outcome; see `kaneflex.integrate.steppers`.

        piece: table, steps in it, those already taken, those to take; counted: steps done before, and between stored
        ones.
        """
        (n, columns), stages, (scalars, period, position, n_steps) = state.z.shape, self.method.stages, piece
        slots, n_scalars = self.slots(1), scalars.shape[1]
        plan = np.array(Plan(n, columns, slots, stages, n_scalars, period, position, n_steps, *counted), np.int64)
        if columns not in self.work:
            matrices = 3 * (3 * slots + n) + stages * n + (stages**2 + 1) * slots
            self.work[columns] = np.empty(matrices + (stages + 1) * n * columns)
        terms = self.system.stacked
        sums = terms.indptr, terms.indices, terms.data
        given = plan, *self.layouts, *sums, scalars, coefficients, load_factor
        arrays = *given, *state, self.work[columns], *stored
        return divmod(stepper(self.method.stepper)(*map(by_address, arrays), bound), OUTCOMES)

    def consistent(self, state: State, load_factor: np.ndarray) -> bool:
        """Fill `state.q` with the true accelerations at the start; False where M is singular there.

        They are the method's own, too, if it carries none of its own. A step of no length finds them, of as many
        columns as the method's steps read: no other loop has to be compiled.
        """
        still = self.method.still(self.coefficients)
        scalars = self.stream.read(np.tile(self.stream.first_row(), (len(self.method.nodes) + 1, 1)))
        once = scalars, 1, 0, 1
        _, status = self.loop(once, still, load_factor, state, (0, 1), Stored.of(state, 2), np.inf)
        return status != SINGULAR

    def free_acceleration(self, table: np.ndarray) -> float:
        """Largest of free masses under the forces of a table, as the loop reads it."""
        if not self.method.varying:
            return float(np.abs(table * self.coefficients[8]).max())
        width = self.system.half_bandwidth
        mass = np.abs(self.system.M @ table[0])[width :: 2 * width + 1]
        force = np.abs(self.system.F @ table.T).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.nan_to_num(force / mass, nan=0.0, posinf=_LARGEST).max())


def advance(
    setup: Setup, state: State, load_factor: np.ndarray, n_steps: int, every: int, stored: Stored, bounded: bool
) -> Advance:
    """Take `n_steps` steps from the beginning with all columns of `state`, in place; store the first one in `stored`.

    load_factor: shape (columns,), factor on F. bounded: stop where z is beyond what the forces could cause on free
    masses; else only where its square is no longer a number.
    """
    # one cycle of a unit state may well grow beyond what forces cause: it only has to stay a number
    bound = _Bound(setup, state, n_steps) if bounded else None
    most = _steps_of_a_call(setup, state.z.shape[1])
    done, spent, outcome = 0, 0.0, Outcome.COMPLETED
    while done < n_steps and outcome is Outcome.COMPLETED:
        scalars, period, position, steps = setup.stream.piece(done, min(most, n_steps - done))
        limit = bound.square(scalars) if bound else _LARGEST**2
        rest = (setup.coefficients, load_factor, state, (done, every), stored, limit)
        if done == 0:
            setup.loop((scalars, period, position, 0), *rest)  # compiles, outside the clock
        started = time.perf_counter()
        taken, status = setup.loop((scalars, period, position, steps), *rest)
        spent += time.perf_counter() - started
        done += taken
        outcome = _OUTCOMES[status]
        if setup.progress:
            setup.progress(done / n_steps)
    return Advance(done, outcome, 1e9 * spent / max(done, 1))


class _Bound:
    """A displacement that only a runaway motion reaches.

    Free masses under the largest forces move by z_0 + v_0 T + F T^2 / m in the time T of the run; the
    springs and dampers of a stable system only lower that, by orders of magnitude.
    """

    def __init__(self, setup: Setup, state: State, n_steps: int) -> None:
        self._setup = setup
        self._duration = n_steps * setup.stream.step
        self._free = np.abs(state.z).max() + self._duration * np.abs(state.v).max()
        self._acceleration = 0.0
        self._seen: np.ndarray | None = None

    def square(self, scalars: np.ndarray) -> float:
        """Its square, for the forces met so far and those in this piece of the table."""
        if scalars is not self._seen:
            self._seen = scalars
            self._acceleration = max(self._acceleration, self._setup.free_acceleration(scalars))
        reach = float(self._free + self._duration**2 * self._acceleration)
        return (min(_RUNAWAY * reach, _LARGEST) if reach > 0.0 else _LARGEST) ** 2


def _steps_of_a_call(setup: Setup, columns: int) -> int:
    stages = max(setup.method.stages, 1)
    n_slots = setup.slots(stages)
    factor = n_slots * stages * (setup.system.half_bandwidth + 1)
    # sums at every node of the table, the factorisation, and C v, K z and a solve in every column
    work = len(setup.method.nodes) * setup.system.stacked.data.size + factor + columns * 4 * n_slots
    return max(1, int(_WORK_OF_A_CALL / work))
