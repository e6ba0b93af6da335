"""Runs of preset coupled: its integrators against each other, dense output, events, and going on from a state."""

import json
import math
import pickle
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from command_line import cli
from machines import machine
from runs import gaps, solved
from scipy.interpolate import CubicHermiteSpline
from scipy.special import ellipk
from scipy_motion import scipy_motion

import kaneflex
from kaneflex import SceneError, read_scene, scene_of, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.time.trajectory import Pieces, by_themselves
from kaneflex.report.summary import summarise
from kaneflex.solve.coupled import beginning
from kaneflex.solve.simulation import solve

SHORT = ("solve.duration=0.5 s", "solve.steps=200")


def scene(name, *settings):
    return with_settings(read_scene(name), ["solve.preset=coupled", *settings])


def run(name, *settings, after=None):
    return solve(kaneflex.load(scene(name, *settings)), after=after)


@pytest.fixture(scope="module")
def pendulum():
    """Damped, so that axial vibrations, which no output interval resolves, are gone soon."""
    return run("elastic-pendulum", "damping.rayleigh.ratio=0.1", "damping.rayleigh.at=[5, 50]", *SHORT)


def settle_damping(*settings):
    return ("damping.rayleigh.ratio=0.1", "damping.rayleigh.at=[5, 50]", *settings)


def test_scipy_gives_the_same_motion(pendulum):
    other = scipy_motion(kaneflex.load(scene("elastic-pendulum", *settle_damping(*SHORT), "solve.tolerance=1e-9")))
    for name in ("angle", "tip_bend"):
        assert other.series[name].values == pytest.approx(pendulum.series[name].values, abs=1e-6), name
    assert other.trajectory.energy.drift < 1e-6


def test_scipy_follows_the_loops_of_a_crank_that_turns():
    """Turn by turn: a loop closes on the other side of its dead centre, too, which is another motion."""
    settings = ("slider-crank-150-coupled", "solve.steps=60")
    found = scipy_motion(kaneflex.load(scene(*settings, "solve.tolerance=1e-6")))
    other = run(*settings, "solve.tolerance=1e-8").series["mid_transverse"].values
    assert found.series["mid_transverse"].values == pytest.approx(other, abs=2e-4 * abs(other).max())
    assert found.trajectory.energy.drift < 1e-4


def test_shapes_that_only_turn_the_nodes_leave_the_loops_to_the_joints():
    """Two elements have a shape without displacement at any node: scaled by that, its slopes are huge."""
    found = run("four-bar-motor", "bodies.coupler.beam.elements=2", "solve.duration=0.01 s", "solve.steps=20")
    assert found.outcome.name == "COMPLETED" and found.model.coupled.engine.count(at.KEPT) == 2


def test_loops_stay_closed():
    found = run("four-bar-motor", "solve.duration=0.1 s", "solve.steps=400")
    system, trajectory = found.model.coupled, found.trajectory
    found_gaps = [gaps(system, t, q) for t, q in zip(trajectory.times[::40], trajectory.q[::40], strict=True)]
    assert max(abs(gap) for row in found_gaps for gap in row.values()) < 1e-10


def test_a_stored_state_is_read_whatever_coordinates_the_loops_are_closed_by():
    """At its dead centre a crank does not follow from the piston; a row has it all the same."""
    system = kaneflex.load(scene("engine-torque-elastic", "drives.main.angle=0 deg")).coupled
    engine = system.engine
    engine.set(beginning(kaneflex.load(scene("engine-torque-elastic", "drives.main.angle=0 deg"))))
    engine.choose(0.0)
    assert engine.project(0.0)
    row = engine.row(0.0)[None]
    good = by_themselves(system, row)
    names = [name for name, _ in engine.layout.coordinates]
    first, count = engine.count(at.DEPENDENT), engine.count(at.KEPT)
    joints = [k for k, name in enumerate(names) if name.endswith((".angle", ".position"))]
    for chosen in combinations(joints, count):
        engine.tables.plan[first : first + count] = chosen
        system.unfold(0.5 * row)  # so that nothing of the good one is left
        found = by_themselves(system, row)
        for part in ("q", "v", "a", "multipliers"):
            assert getattr(found, part) == pytest.approx(getattr(good, part), rel=1e-12, abs=1e-12), (chosen, part)


def test_cubics_between_instants_are_those_of_scipy():
    """With their slopes, also of knots that coincide and of the last one."""
    draw = np.random.default_rng(2)
    knots, (q, v) = np.sort(draw.random(9)), draw.random((2, 9, 3))
    times = np.concatenate([knots, draw.uniform(knots[0], knots[-1], 40)])
    expected = CubicHermiteSpline(knots, q, v)
    pieces = Pieces.of(knots, np.searchsorted(knots, times, side="right") - 1, times)
    for found, rate in zip(pieces.cubic(q, v), (expected(times), expected(times, 1)), strict=True):
        assert found == pytest.approx(rate, abs=1e-13 * abs(rate).max())
    twice = Pieces.of(knots[[0, 0]], np.array([1]), knots[:1])
    assert [part.tolist() for part in twice.cubic(q, v)] == [q[1:2].tolist(), v[1:2].tolist()]


def test_dense_output_meets_a_run_that_stores_those_instants(pendulum):
    finer = run("elastic-pendulum", *settle_damping("solve.duration=0.5 s", "solve.steps=600"))
    between = pendulum.at(finer.times)
    for name, tolerance in (("angle", 1e-6), ("tip_bend", 1e-6), ("mid_moment", 1e-4)):
        there = finer.series[name].values
        assert abs(between.series[name].values - there)[300:].max() < tolerance * max(1.0, abs(there).max()), name
    assert between.trajectory.energy.drift < 1e-5


def test_dense_output_of_a_run_that_motion_drives():
    """The quasi-static answer, which has no vibration that a step could fail to resolve."""
    settings = ("solve.preset=quasistatic", "solve.start=zero")
    solution = run("four-bar", *settings)
    times = 0.5 * (solution.times[1:] + solution.times[:-1])
    finer = run("four-bar", *settings, f"solve.steps={2 * len(times)}")
    for name, series in solution.at(times).series.items():
        there = finer.series[name].values[1::2]
        assert abs(series.values - there).max() < 1e-4 * abs(there).max(), name


@pytest.mark.parametrize("times", [[-1e-3], [0.1, 0.6]])
def test_instants_outside_the_run_are_refused(pendulum, times):
    with pytest.raises(ValueError, match=r"are outside the run, 0 to 0\.5 s"):
        pendulum.at(times)


def scene_with_event(like, words, *settings):
    return with_settings(scene_of(f'schema = 1\nlike = "{like}"\nevents.it = {{{words}}}\n'), list(settings))


# A steel bar so thick that it swings like a rigid one.
BAR = ("strip.beam.section.rectangle=[0.1, 0.1]", "solve.duration=10 s", "solve.steps=1000")
HANGING = "sensor = 'angle', value = '-90 deg', direction = 'down'"


def test_a_pendulum_hangs_straight_every_half_period_of_the_closed_form():
    """T = 4 K(sin(theta_0 / 2)) / omega_0 (Legendre): the bar's ends of swing are 60 deg from the vertical."""
    found = solved(scene_with_event("elastic-pendulum", HANGING, *BAR))
    period = 4 * ellipk(math.sin(math.radians(30)) ** 2) * math.sqrt(2 * 1.0 / (3 * 9.81))
    times = found.events["it"]
    assert len(times) == 6
    assert times == pytest.approx(period * (0.25 + np.arange(6)), rel=1e-4)
    # The event itself lies where the sensor has the value.
    assert found.at(times).series["angle"].values == pytest.approx(-math.pi / 2, abs=1e-9)


def test_the_first_event_ends_the_run():
    stopping, late = HANGING + ", stop = true", "events={late={sensor='angle', value='-100 deg', stop=true}}"
    found = solved(scene_with_event("elastic-pendulum", stopping, late, *BAR))
    assert found.times[-1] == pytest.approx(0.4395, abs=1e-3)
    assert found.series["angle"].values[-1] == pytest.approx(-math.pi / 2, abs=1e-9)
    assert found.outcome.name == "COMPLETED"
    assert found.trajectory.message.startswith("completed; the event it ended the run at t = 0.4")
    assert len(found.times) < 50


def test_an_event_of_a_driven_mechanism():
    """The crank's torque changes its sign where the series does, on either side of a stored instant."""
    words = "sensor = 'crank_torque', direction = 'up'"
    found = solved(scene_with_event("engine", words, "solve.preset=rigid"))
    values = found.series["crank_torque"].values
    assert len(found.events["it"]) == ((values[:-1] < 0) & (values[1:] >= 0)).sum() > 2
    assert abs(found.at(found.events["it"]).series["crank_torque"].values).max() < 1e-6 * abs(values).max()


@pytest.mark.parametrize(("words", "message"), [
    ("sensor = 'angel'", "events.it.sensor = 'angel': no sensor of that name. The nearest known one is 'angle'."),
    ("sensor = 'angle', value = '3 mm'",
     "events.it.value = '3 mm': 'mm' is not a unit of angle. Write an angle like '720 deg', or a plain number in rad."),
])  # fmt: skip
def test_events_that_cannot_be(words, message):
    with pytest.raises(SceneError) as error:
        scene_with_event("elastic-pendulum", words)
    assert str(error.value) == message


DISC = machine(
    name="disc", bodies=dict(wheel="mass = 1.0, inertia = 0.1"), joints=dict(hinge="revolute ground wheel"),
    drives=dict(hinge="free = true, initial_speed = 10.0"),
    springs=dict(coil='torsional_at = "hinge", stiffness = 0.1'),
    sensors=dict(angle="position hinge angle", heading="position wheel angle", torque="spring_torque coil"),
    events=dict(far='sensor = "angle", value = "9 rad"'), solve=dict(preset="coupled", duration=3.0, steps=300),
)


def test_a_run_that_goes_on_counts_turns_on(tmp_path):
    """A disc on a coil, phi = 10 sin t: after a second it has turned by 8.41 rad, and passes 9 rad twice from there."""

    def turned(seconds, after=None):
        horizon = [f"solve.duration={seconds}", f"solve.steps={100 * seconds}"]
        return solve(kaneflex.load(with_settings(scene_of(DISC), horizon)), after=after)

    whole, first = turned(3), turned(1)
    first.labelled.to_netcdf(tmp_path / "results.nc")
    for found in (turned(2, first), turned(2, kaneflex.read_state(tmp_path))):
        for name in ("angle", "heading", "torque"):
            assert found.series[name].values == pytest.approx(whole.series[name].values[100:], abs=1e-6), name
        assert found.series["angle"].values[0] == pytest.approx(10.0 * math.sin(1.0), abs=1e-6)
        assert found.drive_angles["hinge"] == pytest.approx(found.series["angle"].values, abs=1e-9)
        assert found.events["far"] == pytest.approx([math.asin(0.9), math.pi - math.asin(0.9)], abs=1e-6)
        assert found.at([1.5]).series["angle"].values == pytest.approx(10.0 * math.sin(1.5), abs=1e-6)


def test_the_command_line_goes_on_from_a_result_folder(tmp_path, monkeypatch, pendulum):
    monkeypatch.chdir(tmp_path)
    options = [f"--set={setting}" for setting in settle_damping("solve.duration=0.25 s", "solve.steps=100")]
    assert cli("run", "elastic-pendulum", *options, "--no-plots", "-o", "first").exit_code == 0
    assert cli("run", "elastic-pendulum", *options, "--no-plots", "-o", "second", "--after", "first").exit_code == 0
    import xarray

    with xarray.open_dataset("second/results.nc", engine="scipy") as found:
        assert float(found["time"][0]) == 0.25
        assert json.loads(Path("second/summary.json").read_text())["duration_s"] == pytest.approx(0.25)
        assert found["tip_bend"].values[-1] == pytest.approx(pendulum.series["tip_bend"].values[-1], abs=1e-7)


def test_states_that_do_not_fit(tmp_path, pendulum):
    with pytest.raises(SceneError, match="only coupled runs can be continued"):
        run("elastic-pendulum", "solve.preset=rigid", after=pendulum)
    with pytest.raises(SceneError, match=r"the state has no coordinate strip\.axial_1"):
        run("elastic-pendulum", "solve.modes=4", after=pendulum)
    crank = run("slider-crank-150-coupled", "solve.duration=1 ms", "solve.steps=10")
    with pytest.raises(SceneError, match=r"the state opens joint \w+ by .*Continue with the lengths and drives"):
        run("slider-crank-150-coupled", "rod.length=0.35", after=crank)
    with pytest.raises(SceneError, match=r"the state opens joint main by 0\.05 .*Continue with the lengths and drives"):
        run("slider-crank-150-coupled", "main.speed=100 rad/s", after=crank)
    with pytest.raises(SceneError, match=r"after = .*: its results can't be read: the file does not exist\. Give"):
        kaneflex.read_state(tmp_path)


def test_a_linkage_that_can_not_turn_around_swings_back():
    """A coupler too short for the crank to pass: stretched to its limit it throws flywheel and crank back."""
    settings = ("coupler.length=100 mm", "main.angle=60 deg", "solve.duration=0.6 s")
    found = run("four-bar-motor", *settings)
    speed = found.series["crank_speed"].values
    assert speed.max() > 20 and speed.min() < -10
    assert found.drive_angles["main"].max() < 2 * math.pi
    assert found.trajectory.energy.drift < 1e-6
    # For some instants the elastic linkage stands where the rigid one doesn't close: what is not measured against that
    # one has its values there, too.
    summary = summarise(found)
    assert not any(np.isnan(found.series[name].values).any() for name in ("rocker_angle", "coupler_force"))
    assert [text[:33] for text in summary.warnings if "no value" in text] == ["coupler_mid has no value at 7 of "]
    assert summary.sensors["rocker_angle"].max == pytest.approx(3.955, abs=1e-3)
    other = run("four-bar-motor", *settings, "solve.integrator=gauss", "solve.tolerance=1e-9")
    assert other.series["crank_speed"].values[-1] == pytest.approx(speed[-1], abs=1e-4)


@pytest.mark.parametrize("thickness", ["1.5 mm", "15 um"])
def test_no_moment_at_hinge_and_free_end_of_a_strip(thickness):
    """However slender: its tension is then all that holds it straight, and E I a millionth of that."""
    section = f'strip.beam.section.rectangle=["{thickness}", "10 mm"]'
    short = ("solve.duration=0.5 s", "solve.steps=200", section)
    start, mid, end = (
        abs(run("elastic-pendulum", f"mid_moment.bending_moment=strip.{at}", *short).series["mid_moment"].values).max()
        for at in ("start", "mid", "end")
    )
    assert max(start, end) < 1e-9 * mid


def test_an_engine_goes_to_another_process_without_its_addresses():
    engine = kaneflex.load(scene("elastic-pendulum", *SHORT)).coupled.engine
    engine.compile()
    again = pickle.loads(pickle.dumps(engine))
    assert "_handle" in vars(engine) and "_handle" not in vars(again)
    assert again.tables.w.tolist() == engine.tables.w.tolist()


PRESCRIBED = machine(
    bodies=dict(crank='length = "45 mm", mass = "1 kg"'), joints=dict(main="revolute ground crank.start"),
    drives=dict(main='law = "0.2*sin(300*t)"'), sensors=dict(torque="drive_torque main"),
    solve=dict(preset="coupled", start="zero", duration="20 ms", steps=50),
)


def test_a_mechanism_without_a_freedom_is_one_too():
    """A rigid crank that swings as prescribed: m l^2 / 3 times its acceleration; nothing is solved for."""
    model = kaneflex.load(kaneflex.scene_of(PRESCRIBED))
    solution = solve(model)
    expected = 0.045**2 / 3 * -0.2 * 300**2 * np.sin(300 * solution.times)
    np.testing.assert_allclose(solution.series["torque"].values, expected, atol=1e-9 * abs(expected).max())
    assert summarise(solution).unresolved_modes == []


def test_a_cycle_without_a_freedom_repeats():
    text = PRESCRIBED.replace('{law = "0.2*sin(300*t)"}', '{speed = "5000 rpm", cycle = "360 deg"}')
    text = text.replace('"zero", duration = "20 ms"', '"periodic"')
    solution = solved(kaneflex.scene_of(text))
    assert solution.outcome is Outcome.COMPLETED


@pytest.mark.parametrize("steps", [1, 2])
def test_a_free_joint_is_where_it_went_however_few_instants_are_stored(steps):
    scene = with_settings(kaneflex.read_scene("elastic-pendulum"), ["solve.duration=0.1 s"])
    few, many = (solved(scene, f"solve.steps={n}") for n in (steps, 20))
    for name in ("angle", "tip_bend"):
        assert few[name].values[-1] == pytest.approx(many[name].values[-1], rel=1e-6)


def test_a_speed_that_no_loop_can_be_followed_at_is_refused():
    shorter = ("solve.start=quasistatic", "solve.duration=0.3 s", "solve.steps=20")
    far = scene("engine", *shorter, "drives.main.speed=1e20", "drives.main.cycle=none")
    with pytest.raises(SceneError, match=r"drives\.main\.speed: .* closed at 6e\+20 positions. Give a lower"):
        kaneflex.load(far)


@pytest.mark.filterwarnings("ignore::kaneflex.ValidityWarning")
def test_masses_too_far_apart_to_still_a_link_leave_its_forces_as_they_are():
    """Beside a hub of 1e30 kg m^2 nothing turns: the axial force is that of the beam at rest, zero."""
    hub = "masses.hub_inertia.inertia=1.77e30 kg m^2"
    solution = solved(scene("spin-up-torque", hub, "solve.duration=0.15 s", "solve.steps=20", "solve.start=zero"))
    assert all(np.isfinite(series.values).all() for series in solution.series.values())
