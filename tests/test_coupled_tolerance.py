"""What solve.tolerance of preset coupled promises: errors that follow it, whatever vibrates, and the modes given up."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import float64, njit, void
from runs import derived_on_the_fly
from scipy.linalg import eigh

import kaneflex
from kaneflex.multibody import stepping
from kaneflex.multibody.instant import A, V
from kaneflex.multibody.run import first_step
from kaneflex.scene import with_settings
from kaneflex.scene.options import resolve_options
from kaneflex.solve.unresolved import unresolved

TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
OPTIONS = {"error_model": "numpy"}


# M q'' + K q = s + c sin(p[0] t): p holds the frequency, then s, c, M and K row by row.
@njit(void(float64, V, V, V, A, V), **OPTIONS)
def equations(t, q, v, p, M, f):
    n = q.size
    for i in range(n):
        f[i] += p[1 + i] + p[1 + n + i] * math.sin(p[0] * t)
        for j in range(n):
            M[i, j] += p[1 + 2 * n + i * n + j]
            f[i] -= p[1 + 2 * n + n * n + i * n + j] * q[j]


@njit(void(float64, V, V, V, V, V, A, V), **OPTIONS)
def constraints(t, q, v, p, g, g_t, G, gamma):
    pass


@njit(void(float64, V, V, V, V, V, A, A), **OPTIONS)
def tangent(t, q, v, a, multipliers, p, K, C):
    n = q.size
    for i in range(n):
        for j in range(n):
            K[i, j] += p[1 + 2 * n + n * n + i * n + j]


@njit(void(float64, V, V, V, V), **OPTIONS)
def energy(t, q, v, p, out):
    pass


def integrated(M, K, q, times, tolerance, steady=0.0, swinging=0.0, frequency=1.0):
    """q and v at ``times`` from rest at q, and how many steps that took."""
    n, rows = len(M), len(times)
    stepping.compile_stepper("gauss")
    loads = [np.broadcast_to(part, n) for part in (steady, swinging)]
    p = np.concatenate([[frequency], *loads, M.ravel(), K.ravel()])
    qs, vs, accels = np.zeros((3, rows, n))
    qs[0], accels[0] = q, np.linalg.solve(M, loads[0] - K @ q)
    scale, longest = np.full(n, tolerance), times[1] - times[0]
    control, counts = np.array([first_step(accels[0], scale, longest), longest, math.inf, 0.0]), np.zeros(5)
    here = np.concatenate([times[:1], qs[0], vs[0], accels[0], [0.0]])
    tables = times, qs, vs, accels, np.zeros((rows, 0)), np.zeros((rows, 1))
    ended, _ = stepping.integrate(
        equations, constraints, tangent, energy, p, scale, control, here, np.zeros(0), *tables, 3, counts
    )
    assert ended == stepping.DONE
    return qs, vs, counts[0]


@pytest.mark.parametrize("step", [0.01, 0.1, 0.3, 0.59, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("kind", ["free", "switched on", "forced"])
def test_ten_periods_of_an_oscillator_are_wrong_by_the_tolerance(kind, step):
    """q'' + q = s + c sin(0.7 t) against its closed form; displacement and velocity, both with a peak of 1.

    ``step`` is w h of the stored instants. Errors are a tenth of the tolerance to ten times as much, or less where it
    is the stored instants that keep the steps short.
    """
    times = np.linspace(0.0, 20 * math.pi, round(20 * math.pi / step) + 1)
    one, W = np.eye(1), 0.7
    start, steady = {"free": (1.0, 0.0), "switched on": (0.0, 0.5), "forced": (0.0, 0.0)}[kind]
    swing = 1.0 - W**2 if kind == "forced" else 0.0
    exact = steady + (start - steady) * np.cos(times)
    rate = -(start - steady) * np.sin(times)
    if kind == "forced":
        exact, rate = np.sin(W * times) - W * np.sin(times), W * (np.cos(W * times) - np.cos(times))
    peak = max(abs(exact).max(), abs(rate).max())
    for tolerance in TOLERANCES:
        q, v, steps = integrated(one, one, np.array([start]), times, tolerance * peak, steady, swing, W)
        ratio = np.hypot(q[:, 0] - exact, v[:, 0] - rate).max() / peak / tolerance
        assert ratio < 10.0, (tolerance, ratio)
        assert ratio > 0.1 or steps < 1.2 * len(times), (tolerance, ratio)


def test_a_chain_with_a_stiff_spring_is_wrong_by_the_tolerance():
    """Six masses, one spring a million times the others, against its modes; unresolved is only what is too small."""
    n, springs = 6, np.array([1.0, 1.0, 1e6, 1.0, 1.0, 1.0])
    M, K = np.eye(n), np.diag(springs + np.append(springs[1:], 0.0))
    K -= np.diag(springs[1:], 1) + np.diag(springs[1:], -1)
    squares, shapes = eigh(K, M)
    times = np.linspace(0.0, 20 * math.pi, 101)
    load = np.linspace(0.1, 0.2, n)
    shares = (shapes.T @ load) / squares
    exact = (1.0 - np.cos(np.outer(times, np.sqrt(squares)))) * shares @ shapes.T
    peak = abs(exact).max()
    ratios = []
    for tolerance in TOLERANCES:
        q, _, _ = integrated(M, K, np.zeros(n), times, tolerance * peak, load)
        ratios.append(abs(q - exact).max() / peak / tolerance)
    assert max(ratios) < 10.0, ratios
    assert max(ratios) < 10.0 * min(ratios), ratios


BEAM = """
schema = 1
description = "A clamped beam under a force that is switched on"
[bodies]
beam = {length = "350 mm", beam = {material = "steel", section = {rectangle = ["10 mm", "20 mm"]}, elements = 8}}
[joints]
wall = {weld = ["ground", "beam.start"]}
[loads]
push = {force_on = "beam.end", direction = [0, 1], law = "100"}
[sensors]
tip = {position = "beam.end", component = "y"}
root = {bending_moment = "beam.start"}
[solve]
preset = "coupled"
modes = 1
duration = "150 ms"
steps = 200
"""


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """Its scene, its first frequency [Hz] and static deflection [m] by Euler and Bernoulli."""
    found = derived_on_the_fly(BEAM, tmp_path_factory.mktemp("beam"))
    E, rho, b, h, length = 210e9, 7850.0, 0.02, 0.01, 0.35
    stiffness, mass = E * b * h**3 / 12, rho * b * h
    return found, 1.8751**2 / length**2 * math.sqrt(stiffness / mass) / (2 * math.pi), 100 * length**3 / (3 * stiffness)


def run(model, *settings):
    scene = with_settings(model.scene, list(settings))
    return kaneflex.simulate(replace(model, scene=scene, options=resolve_options(scene)))


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
    loose = run(beam[0], "solve.tolerance=1e-3").warnings
    assert len(loose) == 1
    assert loose[0].startswith("solve.tolerance = 0.001 allows errors of 0.00035 m where no link deforms by more")


def test_the_modes_that_a_run_gives_up_are_named(beam):
    """Stretching at 3.7 kHz: E A / L holds a force of 100 N by 5e-7 m, far less than 1e-5 of the length."""
    model, _, _ = beam
    found = unresolved(run(model, "solve.tolerance=1e-5"))
    assert [mode.shape for mode in found] == ["stretch of beam", "stretch of beam"]
    assert found[0].frequency == pytest.approx(math.sqrt(210e9 / 7850) / (4 * 0.35), rel=1e-2)
    assert not unresolved(run(model, "solve.tolerance=1e-10"))
