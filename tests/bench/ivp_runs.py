"""Section: one cycle of the engine at equal error, by kaneflex and by scipy's solve_ivp."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import sympy as sm
from numba import njit
from scipy.integrate import solve_ivp
from scipy.optimize import OptimizeResult

from bench.interleave import interleave
from bench.rows import Row
from kaneflex import Model, load, read_scene, with_settings
from kaneflex.derive.generate import derive_equations
from kaneflex.integrate.run import Run, integrate
from kaneflex.integrate.system import Trajectory
from kaneflex.scene.structure import structure_of

TITLE = "Whole runs against solve_ivp"
ABOUT = """\
The tasks are one cycle (720 degrees, 20 ms) of the engine from rest with 6 coordinates, and its damped periodic motion
with 6, 12 and 192 coordinates. All programs solve the same equations. Errors are rms, relative to the largest
displacement. Each program uses its fastest method with the loosest tolerance that reaches the stated error. *In all* is
a call of `integrate`, *steps alone* its compiled loop. A *lambdified* right-hand side is made by SymPy with NumPy, a
*jitted* one by numba. Ratios are to kaneflex *in all*."""
SETTINGS = ("solve.start=zero", "solve.modes=5")
PERIODIC = {"6 coordinates": ("solve.modes=5",), "4 elements": (), "64 elements": ("rod.elements=64",)}
METHODS = ("newmark", "generalised-alpha", "gauss")
FINEST = 46080
STEPS = tuple(n for n in range(180, FINEST // 4 + 1) if FINEST % n == 0)
TOLERANCES = tuple(10.0 ** (-k / 2) for k in range(6, 24))
SCIPY = ("LSODA", "Radau", "DOP853")
FINE, ROUGH = 1e-6, 1e-4
CYCLES = (("6 coordinates", ROUGH), ("4 elements", ROUGH), ("64 elements", ROUGH), ("6 coordinates", FINE))
MOST_CYCLES, STORED = 8, 720
LARGE, FINEST_TOLERANCE = 20, 1e-9
"""Coordinates beyond which periodic motions are found by harmonics alone, and how exactly."""
HARMONICS = tuple(10.0 ** (-k / 2) for k in range(4, 18))
ROUNDS, BUDGET = 15, 12.0
Slope = Callable[[float, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Case:
    """A model, its start, and its answer at FINEST steps, far more exact than any that is compared with it."""

    model: Model
    start: str = "zero"

    @cached_property
    def exact(self) -> np.ndarray:
        if self.model.system.n > LARGE:  # whose cycle takes as many runs as there are coordinates
            return self.solved("spectral", FINEST_TOLERANCE).z
        return self.solved("gauss", FINEST).z

    def solved(self, method: str, effort: float) -> Trajectory:
        """By so many steps, or by harmonics to a tolerance, given at STORED instants."""
        model, by_harmonics = self.model, method == "spectral"
        steps = STORED if by_harmonics else int(effort)
        step, cycle = model.options.duration / steps, steps if self.start == "periodic" else None
        run = Run(model.system, model.scalars, 0.0, step, steps, method, start=self.start, period_steps=cycle)
        return integrate(replace(run, tolerance=effort) if by_harmonics else run)

    def by_scipy(self, slope: Slope, method: str, tolerance: float, cycles: int = 1) -> OptimizeResult:
        """From rest, at STORED instants of the last cycle; absolute tolerances by the largest motion."""
        n, duration = self.model.system.n, self.model.options.duration
        largest = np.abs(self.exact).max()
        speed = np.abs(np.diff(self.exact, axis=0)).max() * (len(self.exact) - 1) / duration
        absolute = tolerance * np.repeat((largest, speed), n)
        times = np.linspace((cycles - 1) * duration, cycles * duration, STORED + 1)
        return solve_ivp(slope, (0.0, times[-1]), np.zeros(2 * n), method, times, rtol=tolerance, atol=absolute)

    def error(self, z: np.ndarray) -> float:
        """Rms of the distance at equally spaced instants, of the largest displacement; modes have unit masses."""
        exact = self.exact[:: (len(self.exact) - 1) // (len(z) - 1)]
        return float(np.sqrt(np.mean(np.sum((z - exact) ** 2, axis=1))) / np.linalg.norm(exact, axis=1).max())


def rows() -> Iterator[Row]:
    for name, error in CYCLES:
        yield from periodic(name, error)
    yield from periodic_by_scipy()
    case = Case(load(with_settings(read_scene("engine"), list(SETTINGS))))
    yield from by_kaneflex(case)
    yield from by_scipy(case)


def periodic(name: str, error: float) -> Iterator[Row]:
    """The damped motion that repeats itself, found and computed over its cycle, within an error."""
    case = of_cycle(name)
    method, effort = quickest(case, error)
    race = interleave({"in all": lambda: seconds(case, method, effort)}, ROUNDS, BUDGET)
    task = f"engine, {name}, its periodic cycle to {error:g}"
    yield Row(task, "kaneflex, in all", race["in all"], differs=described(case, method, effort))


def of_cycle(name: str) -> Case:
    return Case(load(with_settings(read_scene("engine"), list(PERIODIC[name]))), "periodic")


def described(case: Case, method: str, effort: float) -> str:
    work = f"a tolerance of {effort:.0e}" if method == "spectral" else f"{effort:.0f} steps"
    return f"{method}, {work}, error {case.error(case.solved(method, effort).z):.1e}"


def periodic_by_scipy() -> Iterator[Row]:
    """The same motion of 6 coordinates within the finer error, by scipy over as many cycles as its transient takes."""
    case, scipy = of_cycle("6 coordinates"), SCIPY[0]
    method, effort = quickest(case, FINE)
    jitted = jitted_slope(case.model)

    def error(tolerance: float, cycles: int) -> float:
        return case.error(case.by_scipy(jitted, scipy, tolerance, cycles).y[: case.model.system.n].T)

    cycles = next(count for count in range(1, MOST_CYCLES) if error(TOLERANCES[-1], count) < FINE / 2)
    tolerance = next(loose for loose in TOLERANCES if error(loose, cycles) <= FINE)
    candidates = {"kaneflex, in all": lambda: seconds(case, method, effort)}
    notes = {"kaneflex, in all": described(case, method, effort)}
    for kind, slope in {"jitted": jitted, "lambdified": lambdified_slope(case.model)}.items():
        candidate = f"solve_ivp {scipy}, {kind}"
        candidates[candidate] = lambda slope=slope: scipy_seconds(case, slope, scipy, tolerance, cycles)
        notes[candidate] = f"rtol {tolerance:.0e}, {cycles} cycles"
    race = interleave(candidates, ROUNDS, BUDGET)
    for candidate in race:
        ratio = race.ratio(candidate, "kaneflex, in all")
        yield Row(f"engine, periodic to {FINE:g}", candidate, race[candidate], ratio, differs=notes[candidate])


def by_kaneflex(case: Case) -> Iterator[Row]:
    """A cycle within the rougher error."""
    method, steps = quickest(case, ROUGH)
    race = interleave(
        {"in all": lambda: seconds(case, method, steps), "steps alone": lambda: steps_alone(case, method, steps)},
        ROUNDS, BUDGET,
    )  # fmt: skip
    note = described(case, method, steps)
    for name in race:
        yield Row(f"engine, one cycle to {ROUGH:g}", f"kaneflex, {name}", race[name], differs=note)


def by_scipy(case: Case) -> Iterator[Row]:
    """A cycle within the finer error."""
    task = f"engine, one cycle to {FINE:g}"
    method, steps = quickest(case, FINE)
    jitted = jitted_slope(case.model)
    slopes = {"jitted": jitted, "lambdified": lambdified_slope(case.model)}
    chosen = {name: loosest(case, jitted, name) for name in SCIPY}
    candidates = {"kaneflex, in all": lambda: seconds(case, method, steps)}
    notes = {"kaneflex, in all": described(case, method, steps)}
    for kind, slope in slopes.items():
        for name, (tolerance, error, calls) in chosen.items():
            candidate = f"solve_ivp {name}, {kind}"
            candidates[candidate] = lambda slope=slope, name=name, at=tolerance: scipy_seconds(case, slope, name, at)
            notes[candidate] = f"rtol {tolerance:.0e}, error {error:.1e}, {calls} evaluations"
    race = interleave(candidates, ROUNDS, BUDGET)
    for name in race:
        yield Row(task, name, race[name], race.ratio(name, "kaneflex, in all"), differs=notes[name])


def seconds(case: Case, method: str, effort: float) -> float:
    started = time.perf_counter()
    case.solved(method, effort)
    return time.perf_counter() - started


def steps_alone(case: Case, method: str, steps: float) -> float:
    return 1e-9 * case.solved(method, steps).ns_per_step * steps


def scipy_seconds(case: Case, slope: Slope, method: str, tolerance: float, cycles: int = 1) -> float:
    started = time.perf_counter()
    case.by_scipy(slope, method, tolerance, cycles)
    return time.perf_counter() - started


def quickest(case: Case, error: float) -> tuple[str, float]:
    """Method and steps, or tolerance of the harmonics, of the quickest run within an error."""
    efforts: dict[str, tuple[float, ...]] = dict.fromkeys(METHODS, STEPS)
    if case.start == "periodic":
        efforts["spectral"] = HARMONICS
    if case.model.system.n > LARGE:
        efforts = {"spectral": HARMONICS}
    good = []
    for method, tried in efforts.items():
        effort = next((n for n in tried if case.error(case.solved(method, n).z) <= error), None)
        if effort is not None:
            good.append((min(seconds(case, method, effort) for _ in range(5)), method, effort))
    _, method, effort = min(good)
    return method, effort


def loosest(case: Case, slope: Slope, method: str) -> tuple[float, float, int]:
    """The loosest tolerance of a method of scipy within the finer error, its error and its evaluations."""
    for tolerance in TOLERANCES:
        found = case.by_scipy(slope, method, tolerance)
        error = case.error(found.y[: case.model.system.n].T)
        if error <= FINE:
            return tolerance, error, found.nfev
    raise ValueError(f"{method} does not reach an error of {FINE:g} with a tolerance of {TOLERANCES[-1]:.0e}")


def stacked(model: Model) -> np.ndarray:
    """M, C, K and F of every monomial side by side, shape (n_monomials, n (3 n + 1))."""
    unit = np.eye(model.system.n_scalars)
    return np.stack([np.concatenate([model.system.dense(name, row).ravel() for name in "MCKF"]) for row in unit])


def lambdified_slope(model: Model) -> Slope:
    """M, C, K and F by lambdify, the solve by NumPy."""
    time_symbol, monomials = symbolic_monomials(model)
    lookup = {"table": lambda x, start: model.motion.module.table(x, model.motion.parameters, int(start))}
    n = model.system.n
    ends = (n * n, 2 * n * n, 3 * n * n)
    entries = [sm.Add(*(c * m for c, m in zip(column, monomials, strict=True) if c)) for column in stacked(model).T]
    entries_at = sm.lambdify(time_symbol, entries, modules=[lookup, "math"], cse=True)

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        M, C, K, F = np.split(np.array(entries_at(t)), ends)
        force = F - C.reshape(n, n) @ x[n:] - K.reshape(n, n) @ x[:n]
        return np.concatenate((x[n:], np.linalg.solve(M.reshape(n, n), force)))

    return slope


def symbolic_monomials(model: Model) -> tuple[sm.Symbol, list[sm.Expr]]:
    """Time, and the products of the motion's scalars that the equations are made of, with the scene's numbers."""
    equations = derive_equations(structure_of(model.scene))
    parameters = [symbol for symbol, _ in equations.mechanism.parameters.values()]
    program = equations.motion.program(tuple(parameters))
    numbers = model.motion.parameters[: len(parameters)]
    known = {symbol: sm.Float(float(number)) for symbol, number in zip(parameters, numbers, strict=True)}
    for symbol, expression in program.assignments:
        known[symbol] = sm.sympify(expression).xreplace(known)
    named = equations.mechanism.names.apply
    scalars = {named(scalar.name): sm.sympify(scalar.value).xreplace(known) for scalar in equations.motion.stored}
    return program.inputs[0], [sm.prod([scalars[name] for name in names]) for names in model.monomials]


def jitted_slope(model: Model) -> Slope:
    """All in numba: the generated motion, its monomials, their sums and the solve."""
    motion, p, n = model.motion.module.motion, model.motion.parameters, model.system.n
    columns = model.motion.column
    factors = np.full((len(model.monomials), max(map(len, model.monomials))), -1)
    for k, names in enumerate(model.monomials):
        factors[k, : len(names)] = [columns[name] for name in names]
    stack, scalars = stacked(model), np.zeros(len(columns))

    @njit
    def evaluate(t, x, p, s, factors, stack):
        motion(t, p, s)
        x = x.copy()  # contiguous
        total = np.zeros(stack.shape[1])
        for k in range(factors.shape[0]):
            weight = 1.0
            for column in factors[k]:
                if column >= 0:
                    weight *= s[column]
            total += weight * stack[k]
        matrices = total[: 3 * n * n].reshape(3, n, n)
        force = total[3 * n * n :] - matrices[1] @ x[n:] - matrices[2] @ x[:n]
        return np.concatenate((x[n:], np.linalg.solve(matrices[0], force)))

    return lambda t, x: evaluate(t, x, p, scalars, factors, stack)
