"""Derivatives of sensors against central differences of whole runs, and against closed forms."""

import numpy as np
import pytest
from runs import model, run

from kaneflex import SceneError, sensitivities
from kaneflex.report.summary import sensor_summaries
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.loading import neighbour
from kaneflex.solve.simulation import solve
from kaneflex.study.sensitivity.parameters import find_parameters
from kaneflex.study.sensitivity.slopes import neighbour_at

STEP = 1e-3  # larger than the package's own, with differences of a higher order
WEIGHTS = {-3: -1 / 60, -2: 9 / 60, -1: -45 / 60, 1: 45 / 60, 2: -9 / 60, 3: 1 / 60}


def differences(scene, settings, parameter, frozen=True, step=STEP):
    """p dy/dp of every sensor by sixth-order differences of runs, one by one, with the same numbers of steps."""
    base, found = model(scene, *settings), {}
    for k, weight in WEIGHTS.items():
        solution = solve(neighbour(base, parameter.scaled(base.scene, 1 + k * step), frozen))
        for name, series in solution.series.items():
            found[name] = found.get(name, 0.0) + weight / step * series.values
    return found


def check(scene, settings, name, frozen=True, tolerance=1e-6):
    """Every sensor's slope against differences: of its own size, or of a hundredth of its sensor's."""
    solution = run(scene, *settings)
    found = sensitivities(solution, [name], frozen)
    expected = differences(scene, settings, found.parameters[0], frozen)
    assert found.slopes[name].keys() == solution.series.keys()
    for sensor, slope in found.slopes[name].items():
        size = max(abs(expected[sensor]).max(), 1e-2 * abs(solution.series[sensor].values).max())
        np.testing.assert_allclose(slope, expected[sensor], rtol=0, atol=tolerance * size, err_msg=f"{sensor}, {name}")


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["rod.I", "rod.mass", "rod.length", "crank.length", "main.speed"])
def test_engine(name):
    check("engine", (), name)


@pytest.mark.parametrize("name", ["rod.E", "rod.mass", "main.speed"])
def test_quasistatic_engine(name):
    # an acceleration of the quasi-static answer is a difference of differences: rounding weighs more
    check("engine", ("solve.preset=quasistatic",), name, tolerance=2e-5)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["blade.E", "blade.A", "blade.length", "push.value", "damping.rayleigh.ratio"])
def test_rotating_cantilever(name):
    check("rotating-cantilever", (), name)


@pytest.mark.parametrize("name", ["coupler.length", "masses.at_first.mass"])
def test_four_bar(name):
    check("four-bar", ("solve.steps=120",), name)


@pytest.mark.exhaustive
@pytest.mark.parametrize("integrator", ["radau", "gauss", "newmark", "generalised-alpha"])
@pytest.mark.parametrize("start", ["zero", "quasistatic", "periodic"])
def test_each_integrator_and_start(integrator, start):
    settings = (f"solve.integrator={integrator}", f"solve.start={start}", "solve.steps=200")
    # average acceleration damps nothing: rounding rings on in the differences
    check("rotating-cantilever", settings, "blade.E", tolerance=1e-5)
    check("rotating-cantilever", settings, "shaft.speed", tolerance=1e-5)


@pytest.mark.parametrize("reduction", ["craig-bampton", "modal"])
def test_modal_basis_frozen_or_recomputed(reduction):
    """Few modes bend to the parameter: what the two derivatives differ by is far beyond their errors."""
    settings = (f"solve.reduction={reduction}", "solve.modes=2", "solve.steps=360")
    check("engine", settings, "rod.length", frozen=True)
    check("engine", settings, "rod.length", frozen=False)
    solution = run("engine", *settings)
    kept, moved = (sensitivities(solution, ["rod.length"], frozen).slopes["rod.length"] for frozen in (True, False))
    assert max(abs(kept[name] - moved[name]).max() / abs(kept[name]).max() for name in kept) > 1e-4


def test_many_turns_from_rest():
    """The run has a duration of its own: at a fixed time the angle of 143 turns grows as the speed does."""
    check("spin-up", ("solve.steps=1500",), "hub.speed", tolerance=3e-6)
    solution = run("spin-up", "solve.preset=quasistatic", "solve.steps=1500", "hub.speed=40 rad/s")
    angle = solution.series["hub_angle"].values
    slopes = sensitivities(solution, ["hub.speed"]).slopes["hub.speed"]
    np.testing.assert_allclose(slopes["hub_angle"], angle, atol=1e-6)
    pull = solution.series["root_force_rigid"].values  # goes with the square of the speed
    np.testing.assert_allclose(slopes["root_force_rigid"], 2 * pull, rtol=0, atol=1e-8 * abs(pull).max())
    assert 140 * 2 * np.pi < angle[-1] < 150 * 2 * np.pi


def test_slow_blade_is_a_static_cantilever():
    """v = F l^3 / (3 E I) at the tip and F l at the clamp, whatever the speed."""
    solution = run("rotating-cantilever", "solve.preset=quasistatic", "shaft.speed=1e-6", "solve.steps=24")
    names = ["blade.I", "blade.E", "blade.length", "push.value"]
    found = sensitivities(solution, names)
    powers = {"tip_transverse": (-1, -1, 3, 1), "root_moment": (0, 0, 1, 1), "shaft_torque": (0, 0, 1, 1)}
    for sensor, expected in powers.items():
        logarithmic = [found.of(parameter, sensor).log_max for parameter in found.parameters]
        np.testing.assert_allclose(logarithmic, expected, atol=1e-8)
    bent = found.of(found.parameters[0], "tip_transverse").max
    np.testing.assert_allclose(bent, -0.1 / (3 * 7.0e10 * 67.5e-12**2), rtol=1e-8)
    assert found.unit(found.parameters[0], "tip_transverse") == "m/m^4"
    assert found.dataset is found.dataset  # made once


def test_statistics_are_those_of_neighbouring_runs():
    settings = ("solve.steps=360",)
    found = sensitivities(run("engine", *settings), ["main.speed"])
    (parameter,) = found.parameters
    base = model("engine", *settings)
    high, low = (sensor_summaries(solve(neighbour(base, parameter.scaled(base.scene, 1 + k), True)))
                 for k in (1e-4, -1e-4))  # fmt: skip
    here = sensor_summaries(found.solution)
    for sensor in ("mid_transverse", "crank_torque", "rod_mid_strain"):
        derivative = found.of(parameter, sensor)
        for key in ("min", "max", "rms", "mean"):
            difference = (getattr(high[sensor], key) - getattr(low[sensor], key)) / (2e-4 * parameter.value)
            np.testing.assert_allclose(getattr(derivative, key), difference, rtol=2e-5, err_msg=f"{sensor} {key}")
            logarithmic = getattr(derivative, key) * parameter.value / getattr(here[sensor], key)
            np.testing.assert_allclose(getattr(derivative, f"log_{key}"), logarithmic)


def test_one_number_of_a_list():
    check("four-bar", ("solve.steps=120",), "ground.right.0")


@pytest.mark.parametrize(("scene", "name", "written", "settings"), [
    ("engine", "bore.direction", (10.0, 1.0), ("loads.gas=none", "solve.steps=60")),
    ("rotating-blade", "push.direction", (0.0, 3.0, 4.0), ("solve.steps=24",)),
])  # fmt: skip
def test_a_component_of_a_direction_is_the_number_that_is_written(scene, name, written, settings):
    """Whatever its length: against differences of the user's own numbers."""

    def at(y):
        direction = [written[0], y, *written[2:]]
        return run(scene, *settings, "solve.preset=quasistatic", f"{name}={direction}")

    y, step = written[1], 1e-3 * written[1]
    found = sensitivities(at(y), [f"{name}.1"])
    assert found.parameters[0].value == y
    high, low = at(y + step).series, at(y - step).series
    for sensor in found.slopes[f"{name}.1"]:
        expected = (high[sensor].values - low[sensor].values) / (2 * step)
        size = max(abs(expected).max(), 1e-2 * abs(high[sensor].values).max())
        derivative = found.series(found.parameters[0], sensor)
        np.testing.assert_allclose(derivative, expected, rtol=0, atol=1e-4 * size, err_msg=sensor)


def test_what_the_options_leave_out_stays_in_the_equations():
    """Without its gravity the engine at its test bench has another structure; its neighbours have the same."""
    found = model("engine-rig", "solve.terms.gravity=false", "solve.duration=0.1", "solve.steps=50")
    assert structure_hash(found.scene) != found.module.STRUCTURE
    (parameter,) = find_parameters(found.scene, ["rod.E"])
    assert neighbour_at(found, parameter, 1e-4, True).module == found.module


def test_what_can_not_depend_on_a_parameter_has_a_slope_of_exactly_zero():
    """Rigid bodies know nothing of stiffness."""
    solution = run("engine", "solve.steps=360")
    slopes = sensitivities(solution, ["rod.E"]).slopes["rod.E"]
    still = {name for name, slope in slopes.items() if not slope.any()}
    assert still == {name for name in slopes if name.endswith("_rigid")}


def test_a_number_that_no_neighbour_can_have_is_refused_by_its_own_value():
    with pytest.raises(SceneError, match=r"main\.cycle = 12\.566\d*: a small change of it makes the scene invalid: "):
        sensitivities(run("engine", "solve.steps=360"), ["main.cycle"])


def test_a_mechanism_that_floats_is_refused():
    with pytest.raises(SceneError, match="inertia relief, whose rounding"):
        sensitivities(run("free-frame", "solve.preset=quasistatic", "solve.steps=24"), ["bottom.E"])
