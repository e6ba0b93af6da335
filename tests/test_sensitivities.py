"""Derivatives of sensors against central differences of whole runs, and against closed forms."""

import numpy as np
import pytest
from runs import model, run

from kaneflex.loading import neighbour
from kaneflex.sensitivity.report import sensitivities
from kaneflex.simulation import simulate

STEP = 5e-4  # not that of the package's own differences


def differences(scene, settings, parameter, frozen=True):
    """p dy/dp of every sensor by fourth-order differences of runs with the same numbers of steps."""
    base = model(scene, *settings)
    at = {k: simulate(neighbour(base, parameter.scaled(base.scene, 1 + k * STEP), frozen)) for k in (-2, -1, 1, 2)}
    y = {k: {name: series.values for name, series in solution.series.items()} for k, solution in at.items()}
    return {name: (y[-2][name] - 8 * (y[-1][name] - y[1][name]) - y[2][name]) / (12 * STEP) for name in y[1]}


def check(scene, settings, name, frozen=True, tolerance=1e-6):
    """Every sensor's slope against differences: of its own size, or of a hundredth of its sensor's."""
    solution = run(scene, *settings)
    found = sensitivities(solution, [name], frozen)
    expected = differences(scene, settings, found.parameters[0], frozen)
    assert found.slopes[name].keys() == solution.series.keys()
    for sensor, slope in found.slopes[name].items():
        size = max(abs(expected[sensor]).max(), 1e-2 * abs(solution.series[sensor].values).max())
        np.testing.assert_allclose(slope, expected[sensor], rtol=0, atol=tolerance * size, err_msg=f"{sensor}, {name}")


@pytest.mark.parametrize(
    "name", ["rod.E", "rod.I", "rod.mass", "rod.length", "crank.length", "piston.mass", "main.speed"]
)
def test_engine(name):
    check("engine", (), name)


@pytest.mark.parametrize("name", ["rod.E", "rod.mass", "main.speed"])
def test_quasistatic_engine(name):
    # an acceleration of the quasi-static answer is a difference of differences: rounding weighs more
    check("engine", ("solve.preset=quasistatic",), name, tolerance=2e-5)


@pytest.mark.parametrize(
    "name", ["blade.I", "blade.A", "blade.rho", "blade.length", "push.value", "shaft.speed", "damping.rayleigh.ratio"]
)
def test_rotating_cantilever(name):
    check("rotating-cantilever", (), name)
