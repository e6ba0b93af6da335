"""What solve.tolerance of preset coupled promises: errors that follow it, whatever vibrates, and the modes given up."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from machines import cantilever, machine
from runs import derived_on_the_fly, folded, names_of, solved, starts_of
from scipy.linalg import eigh

from kaneflex import scene_of, with_settings
from kaneflex.multibody.model.assembly import build_system
from kaneflex.multibody.time.error_bounds import Method
from kaneflex.multibody.time.run import integrate
from kaneflex.scene.options import resolve_options
from kaneflex.solve.coupled_linearisation import unresolved
from kaneflex.solve.simulation import solve

TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def discs(stiffnesses, torques):
    """A system of discs of 1 kg m^2, whose equations are linear in their angles; torques between it and the one before.

    stiffnesses [N m/rad], torques: entries of a load.
    """
    names = [f"disc_{k}" for k in range(len(stiffnesses))]
    scene = {
        "schema": 1, "bodies": {name: {"mass": 1, "inertia": 1} for name in names},
        "joints": {f"at_{b}": {"revolute": [a, b]} for a, b in pairwise(["ground", *names])},
        "springs": {f"of_{name}": {"torsional_at": f"at_{name}", "stiffness": k}
                    for name, k in zip(names, stiffnesses, strict=True)},
        "drives": {f"at_{name}": {"free": True} for name in names},
        "loads": {f"on_{name}": {"torque_at": f"at_{name}", **torque}
                  for name, torque in zip(names, torques, strict=True)},
        "solve": {"preset": "coupled", "duration": "1 s"},
    }  # fmt: skip
    return build_system(scene_of(scene), lambda stage: None, 3)[0]


def integrated(system, start, times, tolerance, integrator):
    """Angles and speeds of the discs at ``times`` from rest at these angles, and how many steps that took."""
    q, turns = np.zeros(len(names_of(system))), [k + 2 for k in starts_of(system).values()]
    q[turns] = start
    found = integrate(system, folded(system, times[0], q, 0.0 * q), times, Method(integrator, tolerance, 1.0))
    assert found.outcome.name == "COMPLETED"
    return found.q[:, turns], found.v[:, turns], found.steps


FORCED = 0.7
"""Frequency of the torque that swings, of the oscillator's own."""
TORQUES = {
    "free": {"value": 0}, "switched on": {"value": 0.5}, "forced": {"law": f"{1.0 - FORCED**2!r} * sin({FORCED} * t)"},
}  # fmt: skip


@pytest.fixture(scope="module")
def oscillators():
    return {kind: discs([1.0], [torque]) for kind, torque in TORQUES.items()}


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
@pytest.mark.parametrize("step", [0.01, 0.1, 0.3, 0.59, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("kind", TORQUES)
def test_ten_periods_of_an_oscillator_are_wrong_by_the_tolerance(kind, step, integrator, oscillators):
    """q'' + q = s + c sin(0.7 t) against its closed form; displacement and velocity, both with a peak of 1.

    ``step`` is w h of the stored instants. Errors are a tenth of the tolerance to ten times as much, or less where it
    is the stored instants that keep the steps short. Those of gauss are smaller: its defect says less than it does.
    """
    times = np.linspace(0.0, 20 * math.pi, round(20 * math.pi / step) + 1)
    start, steady = {"free": (1.0, 0.0), "switched on": (0.0, 0.5), "forced": (0.0, 0.0)}[kind]
    exact = steady + (start - steady) * np.cos(times)
    rate = -(start - steady) * np.sin(times)
    if kind == "forced":
        exact = np.sin(FORCED * times) - FORCED * np.sin(times)
        rate = FORCED * (np.cos(FORCED * times) - np.cos(times))
    peak = max(abs(exact).max(), abs(rate).max())
    for tolerance in TOLERANCES:
        q, v, steps = integrated(oscillators[kind], start, times, tolerance * peak, integrator)
        ratio = np.hypot(q[:, 0] - exact, v[:, 0] - rate).max() / peak / tolerance
        assert ratio < 10.0, (tolerance, ratio)
        assert ratio > 0.1 or steps < 1.2 * len(times) or integrator == "gauss", (tolerance, ratio)


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
def test_a_chain_with_a_stiff_spring_is_wrong_by_the_tolerance(integrator):
    """Six discs, one spring a million times the others, against its modes; unresolved is only what is too small."""
    n, springs = 6, np.array([1.0, 1.0, 1e6, 1.0, 1.0, 1.0])
    K = np.diag(springs + np.append(springs[1:], 0.0)) - np.diag(springs[1:], 1) - np.diag(springs[1:], -1)
    squares, shapes = eigh(K)
    times = np.linspace(0.0, 20 * math.pi, 101)
    load = np.linspace(0.1, 0.2, n)
    between = np.cumsum(load[::-1])[::-1]  # a torque between two discs acts on both
    system = discs(springs.tolist(), [{"value": torque} for torque in between.tolist()])
    shares = (shapes.T @ load) / squares
    exact = (1.0 - np.cos(np.outer(times, np.sqrt(squares)))) * shares @ shapes.T
    peak = abs(exact).max()
    ratios = []
    for tolerance in TOLERANCES:
        q, _, _ = integrated(system, 0.0, times, tolerance * peak, integrator)
        ratios.append(abs(q - exact).max() / peak / tolerance)
    assert max(ratios) < 10.0, ratios
    assert max(ratios) < 10.0 * min(ratios) or integrator == "gauss", ratios


BEAM = cantilever(
    'length = "350 mm", beam = {material = "steel", section = {rectangle = ["10 mm", "20 mm"]}, elements = 8}',
    "beam", "wall", loads='push = {force_on = "beam.end", direction = [0, 1], law = "100"}',
    sensors='tip = {position = "beam.end", component = "y"}\nroot = {bending_moment = "beam.start"}',
    solve={"preset": "coupled", "modes": 1, "duration": "150 ms", "steps": 200},
)


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """Its scene, its first frequency [Hz] and static deflection [m] by Euler and Bernoulli."""
    found = derived_on_the_fly(BEAM, tmp_path_factory.mktemp("beam"))
    E, rho, b, h, length = 210e9, 7850.0, 0.02, 0.01, 0.35
    stiffness, mass = E * b * h**3 / 12, rho * b * h
    return found, 1.8751**2 / length**2 * math.sqrt(stiffness / mass) / (2 * math.pi), 100 * length**3 / (3 * stiffness)


def run(model, *settings):
    scene = with_settings(model.scene, list(settings))
    return solve(replace(model, scene=scene, options=resolve_options(scene)))


def test_a_clamped_beam_under_a_sudden_force(beam):
    """Ten periods of its first mode, of which 200 stored instants are less than enough by far."""
    model, frequency, deflection = beam
    reference = run(model, "solve.tolerance=1e-12")
    tip, moment = (reference.series[name].values for name in ("tip", "root"))
    assert reference.frequencies[0] == pytest.approx(frequency, rel=5e-3)
    assert tip.max() == pytest.approx(2 * deflection, rel=2e-2)
    ratios = []
    for tolerance in (1e-5, 1e-6, 1e-7, 1e-8, 1e-9):
        found = run(model, f"solve.tolerance={tolerance}")
        ratios.append(abs(found.series["tip"].values - tip).max() / 0.35 / tolerance)
    assert max(ratios) < 10.0, ratios
    assert max(ratios) < 10.0 * min(ratios), ratios
    assert abs(found.series["root"].values - moment).max() < 1e-4 * abs(moment).max()
    assert 2 * deflection * 1e-2 > 1e-5 * 0.35 and not found.warnings


def test_a_tolerance_too_loose_for_the_deformation_is_named(beam):
    (loose,) = run(beam[0], "solve.tolerance=1e-3").warnings
    assert loose.startswith("solve.tolerance = 0.001 allows errors of 0.00035 m, but links deform by at most")


def test_the_modes_that_a_run_gives_up_are_named(beam):
    """Stretching at 3.7 kHz: E A / L holds a force of 100 N by 5e-7 m, far less than 1e-5 of the length."""
    model, _, _ = beam
    found = unresolved(run(model, "solve.tolerance=1e-5"))
    assert [mode.shape for mode in found] == ["stretch of beam", "stretch of beam"]
    assert found[0].frequency_hz == pytest.approx(math.sqrt(210e9 / 7850) / (4 * 0.35), rel=1e-2)
    assert not unresolved(run(model, "solve.tolerance=1e-12"))


def test_bounded_reactions_are_not_lost_by_the_end_of_a_short_step():
    """A thrown chain with a stiff link and few stored instants: accelerations at the end of a short step had errors
    above the tolerance, which no shorter step could mend, and the run ended after 0.72 s as stuck."""
    solution = solved(scene_of(machine(
        gravity=[0, "-9.81 m/s^2"],
        bodies=dict(a='length = "0.3 m", mass = "1 kg"',
                    b='length = "0.4 m", beam = {material = "steel", section = {rectangle = ["4 mm", "10 mm"]}, '
                      'elements = 4}'),
        joints=dict(h="revolute ground a.start", k="revolute a.end b.start"),
        drives=dict(h='free = true, angle = "90 deg"', k='free = true, angle = "20 deg"'),
        loads=dict(f='torque_at = "h", law = "3 * sin(30 * t)"'),
        damping=dict(rayleigh=dict(ratio="2 %", at=["30 Hz", "3000 Hz"])),
        sensors=dict(force="joint_force k x"),
        solve=dict(preset="coupled", duration="0.8 s", steps=50, modes=2, errors="none", tolerance=1e-5,
                   bounded=["reactions"]),
    )))  # fmt: skip
    assert solution.message == "completed"
