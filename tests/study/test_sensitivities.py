"""Derivatives of one-way and coupled runs against central differences of whole runs, and against closed forms."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import tomlkit
import xarray
from command_line import cli, refused
from lifting import lifted
from runs import model, run

from kaneflex import SceneError, load, read_scene, sensitivities, with_settings
from kaneflex.multibody.time import shooting
from kaneflex.multibody.time.run import Run
from kaneflex.report.summary import sensor_summaries
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.loading import neighbour
from kaneflex.solve.simulation import solve
from kaneflex.study.sensitivity.parameters import find_parameters
from kaneflex.study.sensitivity.report import _demand_some
from kaneflex.study.sensitivity.slopes import Replay, neighbour_at

STEP = 4e-4  # larger than the package's own, with differences of a higher order
WEIGHTS = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}


def differences(scene, settings, parameter, frozen=True, step=STEP):
    """p dy/dp of every sensor by fourth-order differences of runs, one by one, with the same numbers of steps."""
    base, found = model(scene, *settings), {}
    for k, weight in WEIGHTS.items():
        solution = solve(neighbour(base, parameter.scaled(base.scene, 1 + k * step), frozen))
        for name, series in solution.series.items():
            found[name] = found.get(name, 0.0) + weight / step * series.values
    return found


def check(scene, settings, *names, frozen=True, step=STEP, tolerance=1e-6):
    """Every sensor's slope against differences: of its own size, or of a hundredth of its sensor's."""
    solution = run(scene, *settings)
    found = sensitivities(solution, list(names), frozen)
    for parameter in found.parameters:
        expected = differences(scene, settings, parameter, frozen, step)
        assert found.slopes[parameter.name].keys() == solution.series.keys()
        for sensor, slope in found.slopes[parameter.name].items():
            size = max(abs(expected[sensor]).max(), 1e-2 * abs(solution.series[sensor].values).max())
            where = f"{sensor}, {parameter.name}"
            np.testing.assert_allclose(slope, expected[sensor], rtol=0, atol=tolerance * size, err_msg=where)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["rod.I", "rod.mass", "rod.length", "crank.length", "main.speed"])
def test_engine(name):
    check("engine", (), name)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["rod.E", "rod.mass", "main.speed"])
def test_quasistatic_engine(name):
    # an acceleration of the quasi-static answer is a difference of differences: rounding weighs more
    check("engine", ("solve.preset=quasistatic",), name, tolerance=2e-5)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["blade.E", "blade.A", "blade.length", "push.value", "damping.rayleigh.ratio"])
def test_rotating_cantilever(name):
    check("rotating-cantilever", (), name)


@pytest.mark.exhaustive(share=2)
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


@pytest.mark.exhaustive(share=2)
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


def test_rounding_errors_have_no_relative_derivatives():
    end = "sensors.end={bending_moment='rod.start'}"  # of a pin
    found = sensitivities(run("engine", "solve.steps=360", end), ["rod.E"])
    assert 0.0 < abs(found.solution.series["end"].values).max() < 1e-6
    assert found.peak(found.parameters[0], "end") is None
    assert found.peak(found.parameters[0], "mid_transverse") == pytest.approx(-1.0, abs=0.2)


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


PENDULUM = ("elastic-pendulum", "solve.duration=0.01", "solve.steps=200", "solve.tolerance=1e-9")
RINGING = ("elastic-pendulum", "solve.duration=0.5", "solve.steps=40", "solve.tolerance=1e-10")
FOUR_BAR = (
    "four-bar-motor", "solve.duration=0.01", "solve.steps=50", "solve.integrator=gauss",
    "solve.tolerance=1e-11", "masses.flywheel.inertia=1e-4 kg m^2",
)  # fmt: skip
ENGINE = ("engine", "solve.preset=coupled", "solve.modes=1", "solve.tolerance=1e-10")
FIXED = ("solve.integrator=radau", "solve.tolerance=1e-8", "solve.steps=1440")
START = (*FIXED[:2], "solve.steps=360", "solve.duration=5 ms", "solve.start=quasistatic")
"""A quarter of the cycle by the same steps."""
CYCLE = ("spatial-slider-crank-elastic", "solve.preset=coupled", "solve.modes=1", "solve.steps=100",
         "solve.tolerance=1e-10")  # fmt: skip
CRANK = (*CYCLE[:3], "solve.steps=20", "solve.tolerance=1e-7", "solve.start=zero", "solve.duration=0.01")
FLYING = """
schema = 1
gravity = [0, "-9.81 m/s^2", 0]
bodies.rod.length = "1 m"
bodies.rod.beam = {material = "steel", section = {circle = "8 mm"}, elements = 4}
bodies.rod.free = {velocity = ["2 m/s", 0, "1 m/s"], angular_velocity = ["3 rad/s", "2 rad/s", 0]}
bodies.bob = {length = "0.3 m", mass = "0.2 kg", inertia = ["1e-4 kg m^2", "2e-3 kg m^2", "2e-3 kg m^2"]}
joints.ball = {spherical = ["rod.end", "bob.start"]}
drives.ball = {free = true}
loads.push = {force_on = "bob.end", direction = [0, 1, 2], value = "5 N"}
damping.rayleigh = {ratio = 0.01, at = ["30 Hz", "100 Hz"]}
sensors.bow = {displacement = "rod.mid", relative_to = "chord", component = "z"}
sensors.tip = {position = "bob.end", component = "z"}
sensors.ball_force = {joint_force = "ball", component = "x"}
solve = {preset = "coupled", modes = 1, duration = "20 ms", steps = 40, tolerance = 1e-11}
"""


def compared(scene, names, frozen=True, step=5e-4):
    """As for the other presets, to 3e-6; small steps are for what rings on, large ones for what rounding hides.

    Accelerations, and forces of stiff links, leave 3e-6 of rounding; and the runs that are compared with solve their
    steps to a thousandth of their tolerance, the neighbours to rounding, which makes 1e-6 of what rings.

    Stored instants lie so close that the control of the error has no say: a neighbour would answer it with other steps.
    """
    check(scene[0], scene[1:], *names, frozen=frozen, step=step, tolerance=3e-6)


@pytest.mark.exhaustive(group="runs", share=2)
def test_pendulum_that_swings_freely():
    compared(PENDULUM, ["strip.length", "hinge.angle", "gravity.1"], step=1e-4)


@pytest.mark.exhaustive(group="runs", share=2)
def test_closed_loop_that_a_motor_turns():
    compared(FOUR_BAR, ["coupler.length", "masses.flywheel.inertia", "ground.right.0"], step=2e-3)
    compared(FOUR_BAR, ["damping.rayleigh.ratio"], step=3e-3)


@pytest.mark.exhaustive(group="runs", share=2)
@pytest.mark.parametrize("frozen", [True, False])
def test_driven_engine_from_equilibrium(frozen):
    engine = (*ENGINE, *START)
    compared(engine, ["main.speed" if frozen else "rod.length"], frozen, step=1e-4)
    compared(engine, ["rod.mass" if frozen else "rod.E"], frozen, step=1e-3)


@pytest.mark.exhaustive(group="runs", share=2)
def test_periodic_mechanism_in_space(monkeypatch):
    monkeypatch.setattr(shooting, "REPEATS", 1e-12)
    compared((*CYCLE, "solve.start=periodic"), ["rod.E"], step=1e-3)


@pytest.mark.exhaustive(group="runs", share=2)
@pytest.mark.parametrize("frozen", [True, False])
def test_free_bodies_in_space(tmp_path, frozen):
    """An elastic rod that flies with a bob on a ball: against whole runs."""
    (tmp_path / "flying.toml").write_text(FLYING)
    names = ["rod.length"] if not frozen else [
        "rod.E", "push.value", "damping.rayleigh.ratio", "rod.free.angular_velocity.0",
    ]  # fmt: skip
    compared((str(tmp_path / "flying.toml"),), names, frozen, step=3e-4)


@pytest.mark.exhaustive(group="runs", share=2)
@pytest.mark.parametrize("frozen", [True, False])
def test_a_planar_loop_lifted_into_space_has_the_same_slopes(tmp_path, frozen, exhaustive):
    flat = with_settings(read_scene("four-bar-motor"), [
        "solve.duration=0.005", "solve.steps=10", "solve.tolerance=1e-11", "solve.modes=1",
        "drives.main.initial_speed=20 rad/s", "masses.flywheel.inertia=1e-4 kg m^2",
    ])  # fmt: skip
    (tmp_path / "deep.toml").write_text(tomlkit.dumps(lifted(flat) | {"solve": flat.raw["solve"]}))
    names = ["coupler.length", "main.initial_speed", "coupler.E", "damping.rayleigh.ratio"]
    names = names[: (4 if exhaustive else 2) if frozen else 1]
    plane = sensitivities(solve(load(flat)), names, frozen)
    space = sensitivities(run(str(tmp_path / "deep.toml")), names, frozen)
    for name, slopes in space.slopes.items():
        assert len(slopes) == 3
        for sensor, slope in slopes.items():
            expected = plane.slopes[name][sensor]
            size = max(abs(expected).max(), 1e-2 * abs(plane.solution.series[sensor].values).max())
            np.testing.assert_allclose(slope, expected, rtol=0, atol=3e-6 * size, err_msg=f"{sensor}, {name}")


@pytest.mark.parametrize("scene", [(*ENGINE, *START), CRANK])
def test_the_basis_moves(scene):
    solution = run(*scene)
    kept, moved = (sensitivities(solution, ["rod.length"], frozen).slopes["rod.length"] for frozen in (True, False))
    assert max(abs(kept[name] - moved[name]).max() / abs(kept[name]).max() for name in kept) > 1e-4


@pytest.mark.exhaustive(group="runs", share=2)
def test_periodic_engine(monkeypatch):
    monkeypatch.setattr(shooting, "REPEATS", 1e-12)
    scene = (*ENGINE, *FIXED, "solve.start=periodic")
    compared(scene, ["main.speed"])


def test_a_heavier_and_stiffer_pendulum_moves_alike():
    """E and rho together scale all forces and no motion, however long it rings and whatever steps are taken."""
    solution = run(*RINGING)
    found = sensitivities(solution, ["strip.E", "strip.rho"]).slopes
    for sensor, series in solution.series.items():
        whole = found["strip.E"][sensor] + found["strip.rho"][sensor]
        size = max(abs(found["strip.E"][sensor]).max(), abs(series.values).max())
        expected = 0.0 if sensor in ("angle", "tip_bend") else series.values
        np.testing.assert_allclose(whole, expected, rtol=0, atol=1e-7 * size, err_msg=sensor)


def test_neighbours_take_the_steps_of_the_run():
    """Of a run that chose its steps, from one stored instant to the next many; each neighbour takes as many."""
    solution = run(*RINGING)
    own = solution.trajectory
    assert len(own.curve.ends) == own.steps > 4 * len(own.times)
    assert set(own.times[1:]) <= set(own.curve.ends)
    (parameter,) = find_parameters(solution.model.scene, ["strip.E"])
    again = Replay(solution)(neighbour_at(solution.model, parameter, -1e-15, True)).trajectory
    assert (again.steps, again.rejected) == (own.steps, 0)
    np.testing.assert_array_equal(again.curve.ends, own.curve.ends)
    np.testing.assert_allclose(again.q, own.q, rtol=0, atol=1e-9 * abs(own.q).max())


def end(run):
    """Final state of a run in space."""
    return run(float(run.ends[-1]))


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
def test_neighbours_in_space_take_the_steps_of_the_run(integrator):
    solution = run(*CRANK, f"solve.integrator={integrator}")
    own, parameters = solution.model.motion.curve, find_parameters(solution.model.scene, ["rod.E", "shaft.speed"])
    assert len(own.ends) > 2 * solution.model.options.steps
    for parameter in parameters:
        found = Replay(solution)(neighbour_at(solution.model, parameter, 1e-8, True)).model
        stretch = found.options.duration / solution.model.options.duration
        np.testing.assert_array_equal(found.motion.curve.ends, own.ends * stretch)
        assert 0 < abs(end(found.motion.curve).q - end(own).q).max() < 1e-7


def test_a_run_in_space_divides_no_given_step():
    own = run(*CRANK).model.motion.curve
    long = Run(own.system, own.start, own.times[[0, -1]], own.method, own.ends[-1:])
    long.go()
    assert long.ends == own.ends[-1:] and abs(end(long).q - end(own).q).max() > 1e-6


def test_command_study_and_refusals(tmp_path):
    settings = ["--set", "solve.duration=0.03", "--set", "solve.steps=100"]
    command = ("run", "elastic-pendulum", *settings, "--no-plots", "--sensitivities", "strip.E")
    shown = cli(*command, "-o", tmp_path / "out")
    assert shown.exit_code == 0 and "% of the peak by 1 % of" in shown.stdout
    solution = run("elastic-pendulum", "solve.duration=0.03", "solve.steps=100")
    expected = sensitivities(solution, ["strip.E"])
    (parameter,) = expected.parameters
    with xarray.open_dataset(tmp_path / "out" / "sensitivities.nc", engine="scipy") as found:
        derivative = found["d_tip_bend_d_strip.E"]
        assert (derivative.units, found.modal_basis) == ("m/Pa", "frozen")
        np.testing.assert_allclose(derivative, expected.series(parameter, "tip_bend"), rtol=1e-9)
    about = json.loads((tmp_path / "out" / "summary.json").read_text())["sensitivities"]["strip.E"]
    assert about["sensors"]["tip_bend"]["min"] == pytest.approx(expected.of(parameter, "tip_bend").min)
    (tmp_path / "study.toml").write_text(
        'scene = "elastic-pendulum"\nsettings = ["solve.duration=0.03", "solve.steps=100"]\n'
        'sensitivities = ["strip.E"]\n[parameters]\n"drives.hinge.angle" = ["-30 deg"]\n'
    )
    assert cli("sweep", tmp_path / "study.toml", "--no-plots", "-o", tmp_path / "swept").exit_code == 0
    with xarray.open_dataset(tmp_path / "swept" / "sweep.nc", engine="scipy") as found:
        column = found["d_tip_bend_d_strip.E"].sel(point=0, statistic="min")
        assert float(column) == pytest.approx(expected.of(parameter, "tip_bend").min)
    refused(cli(*command, "--after", tmp_path / "out", "-o", tmp_path / "no"), "after", "from its start")
    assert not (tmp_path / "no").exists()


def test_slopes_within_rounding_of_a_large_sensor_are_none():
    (parameter,) = find_parameters(read_scene("engine"), ["rod.length"])
    solution = SimpleNamespace(series={"force": SimpleNamespace(values=np.array([1e6]))})
    _demand_some(solution, parameter, {"force": np.array([2e-3])})
    with pytest.raises(SceneError, match="no sensor depends on it"):
        _demand_some(solution, parameter, {"force": np.array([1e-4])})
