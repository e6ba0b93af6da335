"""What the cases of the extremes suite must come to: closed forms, laws of scaling, limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from extremes import METHODS, relative
from runs import solved
from scipy.linalg import expm

import kaneflex
from kaneflex.solve.solution import Solution

CRANK, ROD, STEEL, STEEL_DENSITY = 0.040, 0.137, 2.1e11, 7850.0
ROD_AREA = 0.153 / (STEEL_DENSITY * ROD)
BLADE_AREA, BLADE_I, ALUMINIUM, ALUMINIUM_DENSITY = 90e-6, 67.5e-12, 7.0e10, 2700.0
FIRST = 1.8751040687119611**2  # of a clamped-free beam, times sqrt(EI / (rho A L^4)): Blevins 1979, table 8-1


def _rod_angle(solution: Solution) -> np.ndarray:
    """Angle of the engine's rod, from its crank's."""
    return -np.arcsin(CRANK / ROD * np.sin(solution.drive_angles["main"]))


def gas_alone(solution: Solution) -> float:
    """A rod under the gas force, without inertia: shorter by F l / (E A cos(phi_2))."""
    expected = -solution.rigid["gas"] * ROD / (STEEL * ROD_AREA * np.cos(_rod_angle(solution)))
    return relative(solution.series["tip_axial"].values, expected)


def peak_of_spike(degrees: float, force: float = 1e5) -> Callable[[Solution], float]:
    """The shortest rod under a force [N] at one angle."""
    expected = force * ROD / (STEEL * ROD_AREA * math.cos(math.asin(CRANK / ROD * math.sin(math.radians(degrees)))))
    return lambda solution: abs(-solution.series["tip_axial"].values.min() / expected - 1.0)


def piston_at_rest(solution: Solution) -> float:
    """A piston that is too heavy to move: the rod is stretched by what the crank draws."""
    phi = solution.drive_angles["main"]
    x = CRANK * np.cos(phi) + ROD * np.cos(_rod_angle(solution))
    return relative(solution.series["tip_axial"].values, (x[0] - x) * np.cos(_rod_angle(solution)))


def reaches_the_piston(solution: Solution) -> float:
    """r cos(phi) + sqrt((l - r)(l + r) + r^2 cos^2(phi)), which loses no digits at the dead centre."""
    length = solution.model.scene.bodies["rod"].length
    c = CRANK * np.cos(solution.drive_angles["main"])
    return relative(solution.series["piston_position"].values, c + np.sqrt((length - CRANK) * (length + CRANK) + c * c))


def blade(stiffness: float, force: float) -> Callable[[Solution], float]:
    """The tip of a blade that turns so slowly that only the force at its end, of fixed direction, bends it."""

    def error(solution: Solution) -> float:
        expected = force / (3 * stiffness) * np.cos(solution.drive_angles["shaft"])
        return relative(solution.series["tip_transverse"].values, expected)

    return error


def slow_blade(E: float, I: float) -> tuple[str, ...]:
    """A quarter turn in 1e4 periods of the lowest frequency, from the static deflection on; force as stiffness."""
    omega = FIRST * math.sqrt(E * I / (ALUMINIUM_DENSITY * BLADE_AREA))
    beam = f"bodies.blade.beam={{E={E!r}, rho={ALUMINIUM_DENSITY!r}, A={BLADE_AREA!r}, I={I!r}, elements=8}}"
    return (
        beam, "damping.modal={ratio=0.01}", "damping.rayleigh=none", f"shaft.speed={1e-4 * omega!r}",
        f"push.value={1e-6 * E * I!r}", f"solve.duration={0.5e4 * math.pi / omega!r}", "solve.start=quasistatic",
        "solve.steps=200",
    )  # fmt: skip


def step_response(solution: Solution) -> float:
    """Constant M, C, K and F from rest: x' = A x + b by the matrix exponential, step by step."""
    kept = {name: affine.value({n: float(solution.rigid[n][0]) for m in affine.terms for n in m})
            for name, affine in solution.model.kept.items()}  # fmt: skip
    n, times = len(kept["M"]), solution.times
    inverse = np.linalg.inv(kept["M"])
    flow = np.zeros((2 * n + 1, 2 * n + 1))
    flow[:n, n : 2 * n] = np.eye(n)
    flow[n : 2 * n] = np.hstack([-inverse @ kept["K"], -inverse @ kept["C"], inverse @ kept["F"]])
    step, x = expm(flow * (times[1] - times[0])), np.eye(2 * n + 1)[-1]
    exact = [x := step @ x for _ in times[1:]]
    z = np.vstack([np.zeros(n), np.array(exact)[:, :n]])
    expected = replace(solution, trajectory=replace(solution.trajectory, z=z))
    return relative(solution.series["tip_transverse"].values, expected.series["tip_transverse"].values)


def against(settings: tuple[str, ...], *sensors: str, scene: str | None = None) -> Callable[[Solution], float]:
    """Against another run by the same method, by default of the same scene: what scaling, symmetry or a limit says must
    be the same."""

    def error(solution: Solution) -> float:
        method = next(value for value in METHODS.values() if _is_of(solution, value))
        beside = kaneflex.read_scene(scene or solution.model.scene.name)
        other = solved(beside, *method, *settings)
        return max(relative(solution.series[name].values, other.series[name].values) for name in sensors)

    return error


def same_rods(solution: Solution) -> float:
    """Three rods of equal frequencies on cranks 120 degrees apart: each does what the first did a third earlier."""
    first, *others = (solution.series[f"mid_transverse_{k}"].values[:-1] for k in (1, 2, 3))
    third = len(first) // 6  # of a turn, where the cycle is two
    return max(min(relative(np.roll(first, k * third), other) for k in (2, 4)) for other in others)


def forces(settings: tuple[str, ...], *sensors: str) -> Callable[[Solution], float]:
    """Forces and accelerations against those of another run of the scene; its steps are a multiple of the run's."""

    def error(solution: Solution) -> float:
        scene = solution.model.scene
        other = solved(kaneflex.read_scene(scene.name), *settings)
        every = (len(other.times) - 1) // (len(solution.times) - 1)
        assert other.times[::every] == pytest.approx(solution.times)
        return max(relative(solution.series[name].values, other.series[name].values[::every]) for name in sensors)

    return error


def as_rigid_crank(start: str, *sensors: str) -> Callable[[Solution], float]:
    """Against the engine whose crank is rigid, after the first twentieth of a cycle: from rest a stiff crank rings."""

    def error(solution: Solution) -> float:
        other = solved(kaneflex.read_scene("engine"), f"solve.start={start}")
        after = len(solution.times) // 20
        pairs = ((solution.series[name].values[after:], other.series[name].values[after:]) for name in sensors)
        return max(relative(*pair) for pair in pairs)

    return error


def without_mass(solution: Solution) -> float:
    """A massless rod: -(F + m a) l / (E A cos(phi_2))."""
    push = solution.rigid["gas"] + 0.214 * solution.rigid["piston.a_x"]
    expected = -push * ROD / (STEEL * ROD_AREA * np.cos(_rod_angle(solution)))
    return relative(solution.series["tip_axial"].values, expected)


def _is_of(solution: Solution, method: tuple[str, ...]) -> bool:
    options = solution.model.options
    asked = dict(setting.removeprefix("solve.").split("=") for setting in method)
    default = {"stiffened": "radau", "linear": "radau"}.get(options.preset, options.integrator)
    return (options.preset, options.integrator) == (asked["preset"], asked.get("integrator", default))


def ended(solution: Solution) -> float:
    """For cases that state how a run ends, not what it gives."""
    return 0.0
