"""The C of scenes under preset coupled: what numba compiles, printed, beside numba's own runs."""

import ctypes
import io
import re
import subprocess

import numpy as np
import pytest
from command_line import cli, refused
from hostile_names import NAME
from machines import BALL_ON_PLANE, FREE_CRANK, machine, scotch_yoke, slider_crank
from numba import njit, types
from runs import model, names_of, run, solved
from test_c import HEADS, SHARED, built

import kaneflex
from kaneflex import SceneError, read_scene, with_settings
from kaneflex.derive.printers.c_printer import Printer
from kaneflex.export import coupled_in_c as export
from kaneflex.export.coupled_in_c import begun, coupled_in_c
from kaneflex.generated import shapes
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.compile.mechanisms import HANDED
from kaneflex.multibody.compile.types import N, Z
from kaneflex.multibody.model.initial_state import start_of
from kaneflex.multibody.model.layout import STICKING, Kind

COUPLED = "solve.preset=coupled"
# A motor by a law of its speed; a chain; one free axis; a table of gas over a cycle that is found first; a clearance;
# a load that switches; friction that sticks; rigid sides, whose many impacts let rounding grow later.
SCENES = [("four-bar-motor",), ("elastic-double-pendulum",), ("spin-up-torque",), ("engine", COUPLED),
          ("slider-crank-clearance", "solve.duration=0.5 ms", "solve.steps=50"),
          ("four-bar-motor", 'loads.motor.law="0.3 * sign(main_speed - 10)"'), ("stick-slip",),
          ("bouncing-bar", "contacts.stop.contact.materials=none", "contacts.stop.contact.law=newton",
           "solve.duration=0.2 s", "solve.steps=800")]  # fmt: skip
SHORT = COUPLED, "solve.start=zero", "solve.modes=2", "solve.duration=0.02 s", "solve.steps=80"
# Loops of a ball and a universal joint.
IN_SPACE = [("spatial-slider-crank-elastic", *SHORT), ("four-bar-misaligned", *SHORT)]


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("scene", SCENES, ids=" ".join)
def test_a_run_in_c_is_that_of_python(scene, compiler, tmp_path):
    """Coordinates of all bodies and what joints exert: 3e-13 of each one's largest was seen, over some 3000 steps."""
    trajectory = run(*scene).trajectory
    level = "-O2" if scene == SCENES[2] else "-O0"
    called = {"name": NAME} if scene == SCENES[0] else {}  # which ends no comment, and is no code
    names, found = in_c(model(*scene).scene.model_copy(update=called), tmp_path, compiler, level=level)
    system = model(*scene).coupled
    assert names == ["time", *names_of(system), *system.constraints]
    expected = np.column_stack([trajectory.times, trajectory.q, trajectory.multipliers])
    assert found.shape == expected.shape
    assert (abs(found - expected).max(axis=0) <= 1e-10 * abs(expected).max(axis=0)).all()


DISC = """
schema = 1
name = "disc"
description = "A rigid disc that bounces, slips, rests and rolls"
gravity = [0.5, -9.81]
bodies.ball = {mass = 2, inertia = 0.002, free = {at = [0, 0.1], velocity = [1, 0], angular_speed = 30}}
contacts.floor.point_on_line = ["ball", "ground"]
contacts.floor.normal = [0, 1]
contacts.floor.radius = "50 mm"
contacts.floor.contact = {law = "newton", restitution = 0.4}
contacts.floor.friction = {mu = 0.2}
solve = {preset = "coupled", duration = "1.2 s", steps = 60}
"""


def test_rigid_sides_come_to_rest_in_c_as_in_python(compiler, tmp_path):
    """A contact at rest is one more constraint: other coordinates are independent then."""
    solution = solved(kaneflex.scene_of(DISC))
    _, found = in_c(solution.model.scene, tmp_path, compiler)
    expected, rubs = solution.trajectory, solution.trajectory.frictions
    assert rubs.mode[-1, 0] == STICKING and len(solution.impacts) > 5 and solution.impacts[-1].lasts
    assert found[:, 1:4] == pytest.approx(expected.q, abs=1e-11)
    assert abs(found[:, 1:4]).max() > 0.5


@pytest.mark.parametrize("scene", [("four-bar-motor",), ("stick-slip",), IN_SPACE[0]], ids=lambda scene: scene[0])
def test_the_text_does_not_depend_on_what_was_evaluated_before(scene, monkeypatch):
    def evaluated(model):
        """The start of a run, after evaluations of another instant."""
        start = begun(model)
        engine, there = start.engine, start.state.copy()
        there[0] += 1e-3
        there[engine.columns["q"]] += 0.01 * engine.measure
        there[engine.columns["u"]] += 0.1 * engine.measure
        engine.unfold(there[None])
        engine.mass()
        engine.set_row(start.state)
        return start

    expected = coupled_in_c(model(*scene).scene)
    monkeypatch.setattr(export, "begun", evaluated)
    assert coupled_in_c(model(*scene).scene) == expected


def test_a_massless_block_moves_in_c_as_in_python(compiler, tmp_path):
    """A row of the factors removes the virtual inertia of its rotation."""
    text = scotch_yoke(FREE_CRANK, {"duration": "0.1 s", "steps": 20}, title="yoke")
    solution = kaneflex.simulate(kaneflex.load(kaneflex.scene_of(text)))
    _, found = in_c(solution.model.scene, tmp_path, compiler)
    expected = solution.trajectory
    assert solution.model.coupled.engine.work.virtual_inertia.any()
    for part in (expected.q, expected.multipliers):
        (own, found) = found[:, 1 : 1 + part.shape[1]], found[:, part.shape[1] :]
        assert own == pytest.approx(part, abs=1e-10 * abs(part).max())


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("scene", IN_SPACE, ids=lambda scene: scene[0])
def test_a_run_in_space_in_c_is_that_of_python(scene, compiler, tmp_path):
    """Places and axes of all bodies, their shapes, and what joints and drives exert, as the sensors read them: 5e-11 of
    each one's largest was seen."""
    expected, (names, found) = run(*scene).model.motion, in_c(model(*scene).scene, tmp_path, compiler)
    system = model(*scene).coupled_in_space.module.system
    shapes = [f"{body}.shape_{k}" for body, each in system.layout.shapes.items() for k in range(each.count)]
    assert {*shapes} <= {*names} and len(shapes) > 3
    assert {f"{joint}.moment_z" for joint in system.mechanism.joints} <= {*names}
    moving = expected.at(found[:, 0], run(*scene).trajectory.record)
    assert found[:, 0] == pytest.approx(run(*scene).trajectory.times, abs=1e-12)
    series = {f"{body}.shape_{k}": part for body in moving.shapes for k, part in enumerate(moving.modal(body)[0])}
    series |= {name: moving.values[:, k] for name, k in expected.column.items()}
    for k, name in enumerate(names[1:], start=1):
        peak = max(abs(part).max() for each, part in series.items() if each[:-1] == name[:-1])  # of a whole vector
        assert abs(found[:, k] - series[name]).max() <= 1e-9 * peak, name


@pytest.mark.parametrize("more", ["", ", friction = {mu = 0.2}"])
def test_a_ball_is_thrown_back_in_c_as_in_python(more, compiler, tmp_path):
    """A contact in space, by one impact: 3e-15 of each coordinate's largest was seen, with friction 5e-11."""
    law = '{law = "hertz", stiffness = "2e6 N/m", exponent = 1}'
    solution = solved(kaneflex.scene_of(BALL_ON_PLANE.replace("CONTACT", law + more)))
    names, found = in_c(solution.model.scene, tmp_path, compiler)
    motion, times = solution.model.motion, found[:, 0]
    moving = motion.at(times)
    assert len(solution.impacts) == 1 and times == pytest.approx(solution.times, abs=1e-12)
    for name in ("ball.x", "ball.y", "ball.z"):
        expected = moving.values[:, motion.column[name]]
        allowed = (1e-9 if more else 1e-11) * abs(expected).max()
        assert found[:, names.index(name)] == pytest.approx(expected, abs=allowed)


PIN = """
schema = 1
description = "A shaft that falls, tilts and slides in its bearing, and hits a ball"
gravity = [1, 0, -9.81]
bodies.shaft = {mass = 2, inertia = [1e-3, 4e-3, 4e-3], centre = [0.01, 0, 0], free = {at = [0, 0, 0]}}
bodies.ball = {mass = 1, inertia = [1e-3, 1e-3, 1e-3], free = {at = [0.2, 0, 0], velocity = [-3, 0, 0]}}
contacts.hit = {circle_on_circle = ["ball", "shaft"], radii = ["50 mm", "20 mm"], contact = LAW}
joints.bush = {revolute = ["ground", "shaft"], axis = [1, 0, 0], clearance = {radial = "0.1 mm", radius = "10 mm", \
length = "60 mm", axial = "0.5 mm", contact = LAW}}
solve = {preset = "coupled", duration = "60 ms", steps = 60, tolerance = 1e-10}
""".replace("\\\n", "").replace("LAW", "{stiffness = 1e8, restitution = 0.5}")


def test_a_pin_hits_its_bearing_and_a_ball_in_c_as_in_python(compiler, tmp_path):
    solution = solved(kaneflex.scene_of(PIN))
    names, found = in_c(solution.model.scene, tmp_path, compiler)
    motion, times = solution.model.motion, found[:, 0]
    assert {each.contact for each in solution.impacts} >= {"hit", "bush_1", "bush_2", "bush_4"}
    moving = motion.at(times)
    for name in ("shaft.x", "shaft.y", "shaft.z", "ball.x"):
        expected = moving.values[:, motion.column[name]]
        assert found[:, names.index(name)] == pytest.approx(expected, abs=1e-9 * 0.06)


def test_a_run_in_c_has_more_impacts_than_the_engine_stores(compiler, tmp_path):
    """Some 400 of them: the engine stops when it has 256 that nobody read."""
    _, found = in_c(model("slider-crank-clearance").scene, tmp_path, compiler, level="-O1")
    assert len(run("slider-crank-clearance").impacts) > 256
    assert found[-1, 0] == pytest.approx(0.04) and np.isfinite(found).all()


def in_c(scene, folder, compiler, **how):
    """Names and rows of the run that the program of a scene writes."""
    program = built(coupled_in_c(scene), folder, compiler, **how)
    written = subprocess.run([program], capture_output=True, text=True, check=True, timeout=120)
    names = [name.strip('"') for name in written.stdout.splitlines()[0].split(",")]
    return names, np.genfromtxt(io.StringIO(written.stdout), delimiter=",", skip_header=1)


DEEP = machine(
    name="deep", like="spatial-slider-crank-elastic",
    bodies=dict(bob="mass = 0.02, inertia = [2e-6, 2e-6, 1e-6], centre = [0.01, 0, -0.03]"),
    joints=dict(hanger="spherical rod.end bob.start"), drives=dict(hanger="free = true"),
    solve=dict(preset="coupled", modes=2, start="zero"),
)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["deep", "spinning_top", "slider_crank_150_coupled"])
def test_accelerations_in_c_are_those_of_the_engine(name, compiler, tmp_path):
    """Of states by themselves: a loop with shapes and a bob on a ball, as the tree goes through the universal joint and
    not through the rod's ball; a top; a loop in the plane."""
    found = kaneflex.load(kaneflex.scene_of(DEEP)) if name == "deep" else model(name.replace("_", "-"), COUPLED)
    system, texts = found.coupled_system, coupled_in_c(found.scene)
    start = run(name.replace("_", "-")).trajectory.curve(0.0) if found.coupled else start_of(system)
    library = ctypes.CDLL(str(built(texts, tmp_path, compiler, *SHARED)))
    size = {key: int(value) for key, value in re.findall(rf"{name.upper()}_(\w+) = (\d+),", texts[f"{name}.h"])}
    assert size["POSITIONS"] == len(system.engine.layout.positions) and size["SPEEDS"] == system.engine.size
    random, state = np.random.default_rng(5), np.zeros(2 * sum(size.values()))
    getattr(library, f"{name}_start")(_address(state))
    accelerate, unit = getattr(library, f"{name}_accelerations"), system.engine.measure
    for t in (0.0, 1e-3):
        steps = 1e-4 * unit * random.normal(size=system.engine.size)
        (q,), u = system.engine.advanced(start.q, steps[None]), unit * random.normal(size=system.engine.size)
        expected, rates, found = system.project(t, q, u, start.choice), np.zeros(len(q)), np.zeros(len(u))
        assert accelerate(_address(state), ctypes.c_double(t), *map(_address, (q, u, rates, found))) == 0
        assert abs(expected.du).max() > 0.0
        assert (found - expected.du) / unit == pytest.approx(0.0, abs=1e-9 * abs(expected.du / unit).max())
        wanted = system.engine.rates_of(expected.q[None], expected.u[None])[0]
        assert rates == pytest.approx(wanted, abs=1e-12 * abs(rates).max())


ASTRAY = """
schema = 1
name = "astray"
bodies.crank = {length = 0.1, mass = 1.0, inertia = [1e-3, 1e-3, 1e-3], rotation = {x = [1, 11.43, 0]}}
bodies.piston = {mass = 0.2, inertia = [1e-4, 1e-4, 1e-4]}
bodies.rod.length = 0.25
bodies.rod.rotation = {x = [0.91718, -0.398478, 0]}
bodies.rod.beam = {material = "steel", section = {circle = 0.01}, elements = 2}
joints.main = {revolute = ["ground", "crank.start"], axis = [0, 0, 1]}
joints.pin = {spherical = ["crank.end", "rod.start"]}
joints.wrist = {revolute = ["rod.end", "piston.start"], axis = [0, 0, 1]}
joints.guide = {prismatic = ["ground", "piston.start"], direction = [1, 0, 0]}
drives.guide = {free = true, initial_speed = "-10 m/s"}
solve = {preset = "coupled", modes = 1, duration = "12 ms", steps = 60}
[sensors]
"""


def test_a_run_in_space_takes_other_speeds_where_python_does(compiler, tmp_path):
    """The slider's speed is independent at first, and zero at the dead centre, which the crank passes."""
    scene = kaneflex.scene_of(ASTRAY)
    motion = kaneflex.simulate(kaneflex.load(scene)).model.motion
    first, *_, last = (choice.independent.tolist() for _, choice in motion.curve.pieces)
    assert first != last
    names, found = in_c(scene, tmp_path, compiler)
    assert len(found) == 61
    table = motion.table(found[:, 0])
    for k, name in enumerate(names[1:], start=1):
        if ".axes_" in name or name.startswith("piston."):
            assert abs(found[:, k] - table[:, motion.column[name]]).max() <= 1e-12, name


def _address(array):
    return ctypes.c_void_p(array.ctypes.data)


CRANK = slider_crank(
    "length = 0.1, mass = 1.0, inertia = 1e-3", "length = 0.1005, mass = 1.0, inertia = 1e-2", "mass = 0.2",
    'free = true, angle = "85 deg", initial_speed = "30 rad/s"', guide="guide", title="crank",
    solve={"preset": "coupled", "duration": "20 ms", "steps": 40},
)


def test_a_run_goes_on_where_python_chooses_other_coordinates(compiler, tmp_path):
    """A rod hardly longer than its crank, which the angle between both leads at first."""
    scene = kaneflex.scene_of(CRANK)
    trajectory = kaneflex.simulate(kaneflex.load(scene)).trajectory
    assert trajectory.outcome is Outcome.COMPLETED
    _, found = in_c(scene, tmp_path, compiler)
    assert found[:, 1:10] == pytest.approx(trajectory.q, abs=1e-10)


@njit
def several(w, k):
    w[k], w[k + 1] = w[k + 1], w[k]
    return w[k] - 1.0, k + 1


@njit
def example(w, n, x):
    """Bounds count once, values before targets, remainders have the sign of what divides."""
    total = 0
    for k in range(n):
        n += 1
        if k % 2 == 1:
            continue
        total += k
    while True:
        total += 0.5
        if not total < 40.0:
            break
    for k in range(n - 1, 2, -3):
        total -= float(k) / 3
    a, b = several(w, 1)
    a, total = total, a if n > 3 and x < 0.0 <= total else -total
    w[0] = w[4] = abs(x) + b**2 + (-7.5) % 2.0 + n / 4 + (b - 5) % 3 + (b - 9) // 4
    return total + a * (x % -3.0) - k + min(x, 0.5) * max(total, x - 1.0, 3.0)


def test_what_python_means_in_c(compiler, tmp_path):
    printer = Printer()
    name, returned = printer.function(example, (types.CPointer(types.float64), types.int64, types.float64), "")
    assert returned == types.float64
    library = ctypes.CDLL(str(built({"example.c": HEADS + printer.text()}, tmp_path, compiler, *SHARED)))
    function = getattr(library, name)
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_void_p, ctypes.c_int64, ctypes.c_double]
    for n, x in ((4, 1.25), (9, -7.0), (2, -0.5), (5, 0.0)):
        expected, found = np.arange(6.0), np.arange(6.0)
        wanted = example(expected, n, x)
        assert function(found.ctypes.data, n, x) == wanted
        assert (found == expected).all()


def test_a_function_is_printed_once_for_every_list_of_types():
    printer = Printer()
    kinds = [N, types.int64, types.int64, N, types.int64, N, types.int64]
    name, returned = printer.function(shapes.displace, kinds)
    assert (name, returned) == ("shapes_displace", types.UniTuple(types.float64, 3))
    assert printer.function(shapes.displace, kinds)[0] == name
    assert printer.function(shapes.displace, [*kinds[:3], Z, types.int64, Z, types.int64])[0] != name
    assert printer.declared(HANDED[Kind.PLAIN], "m") == "const mechanism *m"
    assert "int64_t *pivots;" in printer.text()


def test_what_c_does_not_know_is_refused_by_name():
    said = r"solve.bounded = 'speeds': steps in C control the error of displacements"
    with pytest.raises(SceneError, match=said):
        coupled_in_c(with_settings(read_scene("four-bar-motor"), ['solve.bounded=["speeds"]']))
    for name in ("spinning-top", "slider-crank-150"):
        scene, stages = read_scene(name), []
        preset = scene.solve.preset
        with pytest.raises(SceneError, match=rf"solve\.preset = .*{preset}.*: the engine .*Choose preset coupled"):
            coupled_in_c(scene, stages.append)
        assert stages == []


def test_the_command_writes_a_folder(compiler, tmp_path):
    """Also of a scene whose name is that of a room of the engine, whose functions' names begin so."""
    (tmp_path / "unfolding.toml").write_text('schema = 1\nlike = "four-bar-motor"\n', encoding="utf-8")
    cli("derive", tmp_path / "unfolding.toml", "--language", "c", "-o", tmp_path / "b")
    sources = ["unfolding.c", "unfolding_run.c", "-o", "built", "-lm"]
    subprocess.run([compiler, "-std=c11", *sources], cwd=tmp_path / "b", check=True)
    cli("derive", "four-bar-motor", "--language", "c", "-o", tmp_path / "c")
    assert sorted(path.name for path in (tmp_path / "c").iterdir()) == [
        "CMakeLists.txt", "four_bar_motor.c", "four_bar_motor.h", "four_bar_motor_run.c",
    ]
    bounded = "--set", 'solve.bounded=["speeds"]'
    refused(cli("derive", "four-bar-motor", *bounded, "--language", "c", "-o", tmp_path / "d"), "solve.bounded")
    assert not (tmp_path / "d").exists()
