"""Coupled runs that continue others, from their state, their results and a table of the scene."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
import tomlkit
from machines import four_bar, machine
from runs import solved

import kaneflex
from kaneflex import SceneError, read_scene, scene_of, with_settings
from kaneflex.solve.initial import SavedState
from kaneflex.solve.simulation import solve

PENDULUM = ("elastic-pendulum", "damping.rayleigh.ratio=0.1", "damping.rayleigh.at=[5, 50]")
CRANK = ("spatial-slider-crank-elastic", "solve.modes=1", "solve.start=zero", "solve.tolerance=1e-9")
TOP = ("spinning-top", "solve.forward.tolerance=1e-11")
SWINGING = machine(
    name="swinging-rod",
    bodies=dict(rod='length = "1 m", '
                    'beam = {material = "aluminium", section = {rectangle = ["2 mm", "4 mm"]}, elements = 4}'),
    joints=dict(hinge="spherical ground rod.start"), drives=dict(hinge="free = true, angular_velocity = [9, 1, 4]"),
    loads=dict(push='force_on = "rod.mid", direction = [0.2, 1, 0.5], value = "0.2 N"'),
    damping=dict(rayleigh=dict(ratio=0.02, at=["5 Hz", "40 Hz"])),
    sensors=dict(x="position rod.end x", z="position rod.end z", bend="displacement rod.mid y",
                 force="joint_force hinge y"),
    solve=dict(modes=1, duration=1),
)
"""Elastic rod on a ball."""
LOOP = ("main", "first", "second", "back")
DRAG_LINK = four_bar(
    'length = "2 m", mass = 1, inertia = [0.1, 1, 1], rotation = {x = [0, 1, 0], y = [-1, 0, 0]}',
    'length = "2 m", mass = 1, inertia = [0.1, 1, 1]',
    'length = "2.2 m", mass = 1, inertia = [0.1, 1, 1], rotation = {x = [0, 1, 0], y = [-1, 0, 0]}',
    'speed = "1 rad/s"', "b", names=LOOP, deep=True, title="drag-link", ground={"b": [1, 0, 0]},
    sensors="\n".join(f'{each} = {{position = "{each}", component = "angle"}}' for each in LOOP),
    solve={"preset": "coupled", "errors": "none", "duration": 1},
)  # fmt: skip
"""Double crank, whose four joints all have sensors: the last of them closes the loop, and turns fully."""
ROD = (SWINGING, "solve.tolerance=1e-9")


def scene(given, seconds, steps):
    text, *settings = given
    horizon = [f"solve.duration={seconds!r}", f"solve.steps={steps}", "solve.errors=none"]
    found = scene_of(text) if "\n" in text else read_scene(text)
    return with_settings(found, ["solve.preset=coupled", *settings, *horizon])


def run(given, seconds, steps, after=None):
    return solve(kaneflex.load(scene(given, seconds, steps)), after=after)


@pytest.fixture(scope="module")
def crank():
    """The first half of a run of a loop with pins, a ball and an elastic rod."""
    return run(CRANK, 0.02, 20)


def same(found, whole, steps, share):
    np.testing.assert_allclose(found.times, whole.times[steps:], rtol=1e-14)
    for name, series in whole.series.items():
        expected = series.values[steps:]
        limit = share * abs(expected).max()
        np.testing.assert_allclose(found.series[name].values, expected, rtol=0, atol=limit, err_msg=name)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("given", "seconds", "steps", "share"), [
    (PENDULUM, 0.25, 100, 2e-6), (CRANK, 0.02, 20, 2e-6), (ROD, 0.2, 40, 2e-6), (TOP, 0.2, 20, 1e-8),
])  # fmt: skip
def test_two_halves_are_a_whole_run(given, seconds, steps, share, tmp_path):
    """Also from the file of results, and after a round trip between processes; the top is a rigid body on a ball."""
    whole, first = run(given, 2.0 * seconds, 2 * steps), run(given, seconds, steps)
    first.to_netcdf(tmp_path / "results.nc")
    second = run(given, seconds, steps, first)
    read, state = run(given, seconds, steps, kaneflex.read_state(tmp_path)), first.last_state()
    in_another_order = replace(state, names=state.names[::-1], q=state.q[::-1], v=state.v[::-1])
    for found in (second, run(given, seconds, steps, in_another_order), pickle.loads(pickle.dumps(read))):
        same(found, whole, steps, share)
    assert second.energy.drift < 1e-6
    between = 1.37 * seconds
    found, expected = (each.at([between]).series for each in (second, whole))
    for name, series in expected.items():
        size = abs(whole.series[name].values).max()
        np.testing.assert_allclose(found[name].values, series.values, rtol=0, atol=1e3 * share * size, err_msg=name)
    again = solve(second.model)  # starts as its scene does, and not where the continued run did
    assert again.times[0] == 0.0


@pytest.mark.parametrize(("given", "seconds", "steps"), [(CRANK, 0.02, 20), (ROD, 0.2, 40), (TOP, 0.2, 20)])
def test_a_scene_starts_from_the_complete_state_of_another_run(given, seconds, steps):
    """Drives in the scene start where the state is; the rest of the motion is the table's, quaternions included."""
    whole = run(given, 2.0 * seconds, 2 * steps)
    state = whole.state(steps)
    squares = [x**2 for name, x in state["displacements"].items() if ".quaternion_" in name]
    assert given is CRANK or math.isclose(sum(squares), 1.0)
    table = tomlkit.inline_table()
    table.update(state)
    settings = [f"solve.start={table.as_string()}"]
    if given is CRANK:
        settings.append(f"drives.shaft.angle={float(whole.drive_angles['shaft'][steps])!r} rad")
    found = solved(scene(given, seconds, steps), *settings)
    for name, series in whole.series.items():
        expected = series.values[steps:]
        limit = 2e-6 * abs(expected).max()
        np.testing.assert_allclose(found.series[name].values, expected, rtol=0, atol=limit, err_msg=name)


def test_joints_that_close_loops_count_turns_on(tmp_path):
    def turned(seconds, after=None):
        settings = [f"solve.duration={seconds!r}", f"solve.steps={round(20 * seconds)}"]
        return solve(kaneflex.load(with_settings(scene_of(DRAG_LINK), settings)), after=after)

    whole, first = turned(16.0), turned(8.0)
    assert abs(first.series["back"].values[-1]) > 2.0 * math.pi
    first.to_netcdf(tmp_path / "results.nc")
    for found in (turned(8.0, first), turned(8.0, kaneflex.read_state(tmp_path))):
        for name in ("main", "first", "second", "back"):
            np.testing.assert_allclose(found.series[name].values, whole.series[name].values[160:], atol=1e-9)


@pytest.mark.parametrize("zeros", ["", ", 0"])
def test_a_slide_of_a_small_mechanism_must_stand_where_its_drive_does(zeros):
    """A gap of 0.8 mm is little against 1 m, but not against a body of 10 mm, in the plane and in space."""
    inertia = '["1 g cm^2", "1 g cm^2", "1 g cm^2"]' if zeros else '"1 g cm^2"'
    text = f"""
schema = 1
name = "slide"
bodies.block = {{mass = "1 g", centre = [0, 0{zeros}], inertia = {inertia}, points = {{p = ["1 cm", 0{zeros}]}}}}
joints.rail = {{prismatic = ["ground", "block.p"], direction = [1, 0{zeros}]}}
drives.rail = {{law = "START + 0.001*sin(100*t)"}}
solve = {{preset = "coupled", duration = "0.01 s", steps = 10}}
"""

    def along(start, after=None):
        return solve(kaneflex.load(scene_of(tomlkit.parse(text.replace("START", start)).unwrap())), after=after)

    first = along("0.0")
    assert along("0.0", first).times[-1] == pytest.approx(0.02)
    with pytest.raises(SceneError, match="the state opens joint rail by"):
        along("0.0008", first)


def test_states_that_do_not_fit(crank):
    state, longer = crank.last_state(), [*CRANK, "rod.length=0.35"]
    with pytest.raises(SceneError, match=r"after = .*: the state opens joint \w+ by .*Continue with the lengths"):
        run(longer, 0.02, 20, crank)
    with pytest.raises(SceneError, match=r"after = .*: the state opens joint shaft by"):
        run(CRANK, 0.02, 20, replace(state, t=0.021))
    with pytest.raises(SceneError, match=r"the state has no coordinate rod\.shape_6"):
        run([*CRANK, "solve.modes=3"], 0.02, 20, crank)
    with pytest.raises(SceneError, match="only coupled runs can be continued"):
        run([*CRANK, "solve.preset=rigid"], 0.02, 20, crank)
    with pytest.raises(SceneError, match="it has no state: only coupled runs can be continued"):
        run(CRANK, 0.02, 20, run([*CRANK, "solve.preset=rigid"], 0.001, 2))


def test_quaternions_that_are_not_of_unit_length():
    state = run(ROD, 0.01, 2).last_state()
    with pytest.raises(SceneError, match=r"after = .*: the quaternion of hinge has length 1\.01, which is not 1"):
        run(ROD, 0.01, 2, replace(state, q=state.q * np.where(np.arange(len(state.q)) < 4, 1.01, 1.0)))
    with pytest.raises(SceneError, match=r"solve\.start = .*: the quaternion of hinge has length 0\.5"):
        run([*ROD, "solve.start={displacements = {'hinge.quaternion_w' = 0.5}}"], 0.01, 2)


def test_a_state_with_other_names_is_refused(crank):
    state = SavedState("by hand", 0.0, ("blade.x",), np.zeros(1), np.zeros(1))
    with pytest.raises(SceneError, match=r"after = 'by hand': the scene has no coordinate blade\.x"):
        run(CRANK, 0.02, 20, state)


@pytest.mark.parametrize(("law", "bends", "says"), [
    ('law = "hertz", stiffness = 1e5', "", ()),
    ('law = "exact", stiffness = 1e5, restitution = 0.5', "", ("stop is closed",)),
    ('law = "exact", stiffness = 1e5, restitution = 0.5', ', law = "lugre", bristle_stiffness = 1e4',
     ("bristles of law lugre at slide", "stop is closed")),
])  # fmt: skip
def test_what_a_continued_run_does_not_know_is_warned_of(law, bends, says):
    """Bristles and approach speeds are no part of a state: the force of a stop in an impact jumped silently."""
    half = scene_of(f"""
schema = 1
gravity = [0, "-9.81 m/s^2"]
bodies.block = {{mass = "1 kg"}}
joints.slide.prismatic = ["ground", "block"]
joints.slide.direction = [1, 0]
joints.slide.friction = {{preload = "0.1 N"{bends}}}
drives.slide = {{free = true, position = "-1 mm", initial_speed = 0.1}}
contacts.stop.point_on_line = ["block", "ground"]
contacts.stop.normal = [-1, 0]
contacts.stop.contact = {{{law}}}
sensors.x = {{position = "slide"}}
solve = {{preset = "coupled", duration = "13 ms", steps = 13, errors = "none"}}
""")
    model = kaneflex.load(half)
    first = solve(model)
    second = solve(model, after=first)
    assert first.trajectory.contacts.force[-1, 0] > 0
    assert not first.warnings and len(second.warnings) == len(says)
    assert all(any(word in warning for warning in second.warnings) for word in says)
