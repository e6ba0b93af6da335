"""Compiled engine of a mechanism in the plane or in space: its tables and kernels with a numpy interface.

Compiled functions are called by address. numba is imported only where there is no C compiler, or no library yet.
"""

from __future__ import annotations

import ctypes
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kaneflex.multibody.compile.entries import LIBRARIES, compiling, entries_of, sources
from kaneflex.multibody.dynamics.arrays import ORDER, TABLES
from kaneflex.multibody.model import codes
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.layout import STRUCTURE_KERNELS, Handle, Kind
from kaneflex.multibody.model.state import NONE, Choice, State, virtual_inertia
from kaneflex.multibody.model.tree_layout import JOINT_NODE
from kaneflex.multibody.model.views import Views
from kaneflex.support.c_library import address_by_numba, by_address, c_addresses

_C_TYPES = {"int64": ctypes.c_int64, "float64": ctypes.c_double, "boolean": ctypes.c_bool, "void": None}


class Library(NamedTuple):
    """Compiled functions by name, and whether a C compiler made them."""

    functions: Mapping[str, Callable[..., Any]]
    in_c: bool


@cache
def library(kind: Kind, integrates: bool = True) -> Library:
    """C functions of all entries by name, all compiled on the first call.

    Libraries of mechanisms with contacts, impacts, friction, elastic bodies in space or discontinuous loads have more
    functions. For rigid bodies in space without ``integrates`` they are fewer, and compile faster.
    """
    integrates = integrates or kind is not Kind.RIGID_SPACE
    name, entries = kind.name.lower() if integrates else "prescribed", entries_of(kind, integrates)
    addresses = c_addresses(f"engine-{name}", sources(), lambda: _typed(kind, entries))
    in_c = bool(addresses)
    if not in_c:
        from kaneflex.multibody.compile import library as by_numba

        with compiling():
            addresses = by_numba.addresses((0,) * (1 + LIBRARIES.index((kind, integrates))))
    found: dict[str, Callable[..., Any]] = {}
    for (function, signature), address in zip(entries.items(), addresses, strict=True):
        returned, _, given = signature.partition("(")
        kinds: list[Any] = [_C_TYPES.get(each, ctypes.c_void_p) for each in given[:-1].split(", ")]
        found[function.rpartition(".")[2]] = ctypes.CFUNCTYPE(_C_TYPES[returned], *kinds)(address)
    return Library(found, in_c)


def _typed(kind: Kind, entries: Mapping[str, str]) -> list[tuple[Any, Sequence[Any]]]:
    """Entries with the types of their arguments."""
    from kaneflex.multibody.compile.mechanisms import HANDED, typed

    return [(function, of.args) for function, of in typed(entries, HANDED[kind]).items()]


def kernel_addresses(kernels: Sequence[Any], in_c: bool) -> list[int]:
    """Addresses of a structure's kernels for a library from a C compiler, or from numba.

    A library of C that came without a C compiler calls functions of numba's by C's conventions.
    """
    if in_c and (found := _kernels_in_c(kernels)):
        return found
    with compiling():
        pairs = zip(kernels, _signatures(), strict=True)
        return [(address_by_numba if in_c else _address)(each, of) for each, of in pairs]


def _kernels_in_c(kernels: Sequence[Any]) -> list[int]:
    """Addresses of kernels from a library of their own; they may be of several modules."""
    modules = dict.fromkeys(Path(each.py_func.__code__.co_filename) for each in kernels)
    parts = [Path(str(import_module(f"kaneflex.generated.{name}").__file__)) for name in ("laws", "tables")]
    pairs = lambda: [(each, of.args) for each, of in zip(kernels, _signatures(), strict=True)]  # noqa: E731
    return c_addresses("-".join(("kernels", *(each.stem for each in modules))), [*modules, *parts], pairs)


def _signatures() -> list[Any]:
    from numba import types

    return [eval(each, vars(types)) for each in STRUCTURE_KERNELS.values()]


def _address(kernel: Any, of: Any) -> int:
    """Address of a function that numba compiles, for other functions of numba's."""
    made = kernel.get_compile_result(of)
    return made.library.get_pointer_to_function(made.fndesc.llvm_func_name)


_HUGE = 1e9
"""Mass of a fixed coordinate, in masses of the mechanism."""


@dataclass(frozen=True, eq=False)
class Engine(Views):
    """Tables of one mechanism with the kernels of its structure.

    Attributes
    ----------
    kernels : tuple
        Kernels of the structure's module, in the order of :data:`kaneflex.multibody.model.layout.STRUCTURE_KERNELS`.
    p : ndarray
        Values of the module's PARAMETERS with its tables.
    real, pair : ndarray
        Workspace of factors.
    kind : Kind
        Kind of mechanism that its library is compiled for.
    integrates : bool
        True if it uses the library that integrates motions.
    light : bool
        True if some body has no mass, or no inertia about some axis.
    chosen : list
        Current choice of independent speeds.
    """

    kernels: tuple
    p: np.ndarray
    real: np.ndarray
    pair: np.ndarray
    kind: at.Kind = at.Kind.PLAIN
    integrates: bool = True
    light: bool = False
    chosen: list[Choice] = field(default_factory=lambda: [NONE])

    def courses(self, times: np.ndarray) -> np.ndarray:
        """Coordinate, speed and acceleration of all prescribed drives at ``times`` [s], (n_times, 3 drives)."""
        out = np.zeros((len(times), 3 * len(self.prescribed)))
        self.call("courses_at", np.ascontiguousarray(times, float), *out.shape[:1], out, out.shape[1])
        return out

    def magnitudes(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Magnitudes of all loads [N, N m or N/m], (n_times, loads), at ``times`` [s] and coordinates, speeds and
        accelerations of the joints in laws, the drives first, (n_times, joints, 3)."""
        x = np.hstack([states[:, :, :2].reshape(len(times), 2 * states.shape[1]), states[:, :, 2]])
        loads, sides = self.count(at.SPRINGS) - self.count(at.LOADS), self._switches
        times, x = np.ascontiguousarray(times, float), np.hstack([x, np.zeros((len(x), sides))])
        out = np.zeros((len(times), loads + 2 * sides))
        for _ in range(sides + 1):  # switches may depend on others
            self.call("magnitudes_at", times, len(times), x, x.shape[1], out, out.shape[1])
            x[:, x.shape[1] - sides :] = np.sign(out[:, loads::2])
        return out[:, :loads]

    @cached_property
    def _switches(self) -> int:
        """Number of switching arguments of the loads' laws."""
        return int(np.count_nonzero(self.tables.acts[self.count(at.CONTACTS) :, at.WHAT] == at.SWITCH))

    def openings(self, t: float) -> np.ndarray:
        """Opening of every row of the cut joints [m or rad] at the current coordinates."""
        out = np.zeros(self.count(at.REACTIONS))
        self.call("openings", t, out)
        return out

    def choose(self, t: float, spared: Sequence[int] = ()) -> np.ndarray:
        """Choose the dependent coordinates at the current position; redundant rows are dropped and returned.

        Joint coordinates in ``spared`` stay independent if possible.
        """
        self.openings(t)
        level = self.levels.copy()
        level[list(spared)] = np.maximum(level[list(spared)], codes.NAMED)
        choice, dropped = self.chosen_by(level)
        self.choose_speeds(choice)
        return dropped

    def chosen_at(self, state: State, spared: Sequence[int] = ()) -> Choice:
        """Choice of the independent speeds at a state, see :meth:`choose`."""
        self.set(state)
        self.choose(state.t, spared)
        return self.choice

    def gaps(self, state: State) -> Iterator[tuple[str, float, float]]:
        """Joints, by how much a state opens them [m or rad], and the unit of that."""
        self.set(state)
        gaps = self.openings(state.t)[: self.count(at.JOINT_ROWS)].tolist()
        for place, k in self.own.tolist():  # the drives now have their positions
            name = self.layout.speeds[k].rpartition(".")[0]
            yield name, float(state.q[place] - self.motion[0][k]), float(self.measure[k])
        for row, gap in enumerate(gaps):
            yield self.cut_of(row), gap, float(self.work.row_measure[row])

    def chosen_by(self, level: np.ndarray) -> tuple[Choice, np.ndarray]:
        """Choice by the :attr:`levels` of coordinates, and redundant rows, see
        :func:`kaneflex.multibody.dynamics.independent_speeds.choose`."""
        taken = np.zeros(self.count(at.REACTIONS), np.int64)
        self.call("choose", level, taken)
        rows = np.flatnonzero(taken >= 0)
        return self.choice_of(rows, taken[rows]), np.flatnonzero(taken == -1)

    def choice_of(self, rows: np.ndarray, dependent: np.ndarray) -> Choice:
        """Choice of the given rows and speeds at the current position."""
        inertia = np.zeros(self.size)
        if len(dependent) and self.light:
            free = np.isin(np.arange(self.size), self.open_speeds)
            inertia = virtual_inertia(self.mass(), self.measure, self.tables.bodies, free)
        return Choice(rows, dependent, np.setdiff1d(self.open_speeds, dependent), inertia)

    def mass(self) -> np.ndarray:
        """Mass matrix of all speeds at the current position, (speeds, speeds)."""
        self.call("mass", np.zeros(self.size))
        return self.work.M

    def choose_speeds(self, choice: Choice) -> None:
        """Set the choice that compiled functions use."""
        if self.chosen[0] is choice:
            return
        plan, kept = self.tables.plan, len(choice.rows)
        for of, numbers in ((at.ROW_OF, choice.rows), (at.DEPENDENT, choice.dependent)):
            plan[plan[of] : plan[of] + kept] = numbers
        plan[at.KEPT], plan[at.BENDS] = kept, self.shapes[choice.dependent].any()
        led, nodes = bisect_right(self._last_columns, min(choice.dependent, default=self.size)), self.parts["nodes"]
        plan[at.LED] = self.parts["frames"][led, JOINT_NODE] if led < len(self._last_columns) else len(nodes)
        speeds = np.flatnonzero(choice.virtual_inertia)
        plan[[at.VIRTUAL, at.YIELDING]] = len(speeds)
        plan[plan[at.FACTOR_ROWS] : plan[at.FACTOR_ROWS] + len(speeds)] = speeds
        self.work.virtual_inertia[:], self.work.now[2] = choice.virtual_inertia, len(choice.independent)
        self.chosen[0] = choice

    @cached_property
    def _last_columns(self) -> list[int]:
        """End of every body's own coordinates."""
        return self.tables.bodies[:, [at.FIRST, at.DOF, at.SHAPES]].sum(axis=1).tolist()

    @property
    def choice(self) -> Choice:
        """Current choice of independent speeds."""
        return self.chosen[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the independent coordinates."""
        return tuple(self.layout.coordinates[k][0] for k in self.choice.independent)

    def advanced(self, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Coordinates (k, coordinates) of q moved by steps (k, speeds) of the speeds; a ball turns in its axes."""
        if not len(self.balls):
            return q + steps
        out = np.tile(q, (len(steps), 1))
        self.call("advance", np.ascontiguousarray(steps), len(steps), out)
        return out

    def basis(self, choice: Choice) -> np.ndarray:
        """Speeds for a unit of each independent one, (independent, speeds), where the loops are closed."""
        found = np.zeros((len(choice.independent), self.size))
        self.call("basis", choice.independent, len(choice.independent), found)
        return found

    def demand(self, choice: Choice, times: np.ndarray, given: np.ndarray) -> np.ndarray:
        """Residuals of the independent speeds at ``times`` [s], then all speeds, (k, independent + speeds), see
        :func:`kaneflex.multibody.dynamics.reduction.reduced_demand`. Raises ArithmeticError if loops don't close."""
        self.choose_speeds(choice)
        times, given = np.ascontiguousarray(times, float), np.ascontiguousarray(given)
        out = np.zeros((len(times), len(choice.independent) + self.size))
        asked = times, len(times), given, given.shape[1], out
        done = self.call("reduced_demand", choice.independent, len(choice.independent), *asked)
        if done < len(times):
            raise ArithmeticError(f"the loops don't close at t = {times[done]:.6g} s")
        return out

    def project(self, t: float) -> bool:
        """Project onto the constraints for the current independent coordinates, and compute accelerations and
        reactions."""
        q, u = self.coordinates, self.motion[1].copy()
        return bool(self.call("project", t, q, u) == codes.DONE)

    def nearby(self, rows: np.ndarray, held: Sequence[int] = ()) -> np.ndarray:
        """Records of the states near rows of the integration, (n_times, kept). Raises ArithmeticError at a singular
        one.

        The ``held`` coordinates are not accelerated, as far as the joints allow: they have a mass much larger than all
        others.
        """
        out, done = np.zeros((len(rows), len(self.work.kept))), 0
        shut = rows[:, self.columns["modes"]][:, at.MODE_SIZE * len(self.frictions) :: at.MODE_SIZE] != at.OPEN
        ends = np.append(1 + np.flatnonzero((shut[1:] != shut[:-1]).any(axis=1)), len(rows))
        while done < len(rows):
            self.set_row(rows[done])  # resting contacts are kept closed
            self.choose(float(rows[done, 0]))
            self.work.virtual_inertia[list(held)] = _HUGE * self.masses.sum()
            alike = slice(done, ends[np.searchsorted(ends, done, "right")])
            found = self._unfolded(rows[alike], codes.NEAR_STATES, out[alike])
            done += found
            if not found:
                break
        self.work.virtual_inertia[:] = self.choice.virtual_inertia
        if done < len(rows):
            raise ArithmeticError("the constraints of a state determine neither accelerations nor reactions")
        return out

    def integrate(self, method: Handle, control: np.ndarray, state: np.ndarray, *parts: np.ndarray) -> int:
        """Integrate, see :func:`kaneflex.multibody.time.collocation.integrate`; parts: given, times, rows, counts,
        ends (., wide)."""
        given, times, *out = parts
        asked = given, len(given), times, len(times), *out, out[-1].shape[1]
        return int(self.call("integrate", method, control, state, *asked))

    def unfold(self, rows: np.ndarray, near: int = codes.ON_LOOPS) -> np.ndarray:
        """Records, see :class:`kaneflex.multibody.dynamics.arrays.Instants`, of rows of the integration, (n_times,
        kept), see :func:`kaneflex.multibody.dynamics.entries.unfold`.

        With NEAR_STATES up to the first one that can't be projected; ``work.now`` has its time and outcome.
        """
        out = np.zeros((len(rows), len(self.work.kept)))
        return out[: self._unfolded(rows, near, out)]

    def _unfolded(self, rows: np.ndarray, near: int, out: np.ndarray) -> int:
        """Number of records written into ``out``, which is contiguous."""
        return int(self.call("unfold", np.ascontiguousarray(rows), len(rows), near, out))

    def compile(self) -> None:
        """Compile everything now, so that compilation is reported and timed separately."""
        self._handle, self._library  # noqa: B018 - computes the kernels' addresses

    def call(self, function: str, *values: Any) -> Any:
        """Call a function of :mod:`.compile.entries` with this engine; arrays and handles are passed by address."""
        return self._library.functions[function](self._handle.address, *map(by_address, values))

    @cached_property
    def _library(self) -> Library:
        return library(self.kind, self.integrates)

    @property
    def arrays(self) -> Mapping[str, np.ndarray]:
        """Arrays of compiled functions by their names, in the order of compiled code."""
        t = self.tables
        found = t.plan, t.bodies, t.acts, t.w, t.plan, self._kernel_addresses, self.p, self.real, self.pair
        views = {name: self.view(name) for name in self.views}
        every = {**dict(zip(TABLES, found, strict=True)), **self.parts, **views}
        return {name: every[name] for name in ORDER}

    @cached_property
    def _handle(self) -> Handle:
        return Handle(*self.arrays.values())

    @cached_property
    def _kernel_addresses(self) -> np.ndarray:
        return np.array(kernel_addresses(self.kernels, self._library.in_c))
