"""Runs that start from a state that the scene gives: `solve.start` as a table."""

import json
import math

import numpy as np
import pytest
from command_line import cli, refused
from machines import machine
from runs import alike, model, run, solved
from scipy.linalg import eigh

from kaneflex import SceneError, load, read_scene, scene_of, with_settings
from kaneflex.solve.coupled import beginning
from kaneflex.solve.initial import given_state
from kaneflex.solve.quasistatic import first_rates, slow_start
from kaneflex.solve.simulation import solve
from kaneflex.study.plan import file_places

STILL = (
    "shaft.speed=0", "shaft.cycle=none", "damping=none", "push.value=0", "solve.duration=1 s", "solve.steps=2000",
    "gravity=none",
)  # fmt: skip
PENDULUM = ("solve.preset=coupled", "damping.rayleigh.ratio=0.1", "damping.rayleigh.at=[5, 50]")


def starting(state, *settings):
    return [*settings, f"solve.start={inline(state)}"]


def inline(state):
    """A state as TOML."""
    tables = (
        f"{key} = {{{', '.join(f'{json.dumps(name)} = {x!r}' for name, x in part.items())}}}"
        for key, part in state.items()
    )
    return f"{{{', '.join(tables)}}}"


def deflected():
    """The blade under 0.1 N at its tip, as a state at rest."""
    loaded = run("rotating-cantilever", *STILL, "push.value=0.1 N", "solve.preset=quasistatic", "solve.start=zero")
    state = loaded.state()
    assert state["displacements"]["blade.8.v"] == pytest.approx(0.1 / (3 * 70e9 * 67.5e-12), rel=1e-6)
    return {"displacements": state["displacements"]}


def test_rates_of_a_slow_start_are_the_derivatives_of_its_equilibria():
    """Of z = sin(4 t) + e^t and t^3 - 5 t^2 + 3 t: z' = 5 and 3, z'' = 1 and -10 at zero."""

    def balanced(t):
        return np.column_stack([np.sin(4.0 * t) + np.exp(t), t**3 - 5.0 * t**2 + 3.0 * t])

    v, a = first_rates(balanced, np.diag([2.0, 3.0]), 2.5)
    assert v == pytest.approx([5.0, 3.0], rel=1e-9)
    assert a == pytest.approx([1.0, -10.0], rel=1e-7)


@pytest.mark.parametrize("preset", ["linear", "stiffened"])
def test_a_blade_let_go_swings_in_its_modes(preset):
    """z(t) = sum of the modes, each from its share of the deflection by cos(omega t): no step, no integrator."""
    released = run("rotating-cantilever", *starting(deflected(), *STILL, f"solve.preset={preset}"))
    first = np.array(list(deflected()["displacements"].values()))
    M, K = released.model.M(0.0), released.model.K_s(0.0)
    squares, shapes = eigh(K, M)
    shares = shapes.T @ M @ first
    exact = shapes @ (shares[:, None] * np.cos(np.sqrt(squares)[:, None] * released.times))
    row = released.model.coordinates.index("blade.8.v")
    assert released.coordinates[0][row] == pytest.approx(exact[row], abs=1e-4 * exact[row, 0])
    # 97 % of the deflection is the first mode of a clamped-free beam, at 1.875104^2 sqrt(E I / (rho A l^4))
    omega = 1.8751040687**2 * np.sqrt(70e9 * 67.5e-12 / (2700 * 90e-6))
    assert np.sqrt(squares[0]) == pytest.approx(omega, rel=1e-4)


@pytest.mark.parametrize(
    "settings", [(), ("solve.preset=linear", "solve.reduction=modal", "solve.modes=4"), ("solve.modes=3",)],
    ids=["nodes", "modes of the mechanism", "modes of the link"],
)  # fmt: skip
def test_a_run_from_the_last_state_of_another_is_its_continuation(settings):
    """A turn of the blade from where the turn before left it, against two turns at once."""
    turn = 2 * np.pi / read_scene("rotating-cantilever").drives["shaft"].speed

    def turns(count, *more):
        horizon = (f"solve.duration={count * turn!r}", f"solve.steps={count * 720}", "solve.start=zero")
        return run("rotating-cantilever", *settings, *horizon, *more)

    whole, second = turns(2), turns(1, *starting(turns(1).state()))
    for found, expected in zip(second.coordinates, whole.coordinates, strict=True):
        assert found == pytest.approx(expected[:, 720:], rel=1e-9, abs=1e-9 * abs(expected).max())
    assert second.model.options.start == "given"


def test_settings_read_a_state_anew_that_has_changed_in_its_file(tmp_path):
    file, state = tmp_path / "state.json", '{{"displacements": {{"beam.1.v": {}}}}}'
    file.write_text(state.format(0.001))
    scene = with_settings(read_scene("rotating-cantilever"), [f"solve.start.file={file}"])
    assert with_settings(scene, ["gravity=[0, -9.81]"]).solve.start.displacements == {"beam.1.v": 0.001}
    file.write_text(state.format(0.002))
    assert with_settings(scene, ["gravity=[0, -9.81]"]).solve.start.displacements == {"beam.1.v": 0.002}


def test_a_state_stands_in_a_file_beside_the_scene(tmp_path):
    """Written by json.dump or by hand; what the scene itself gives comes first, in a study's scenes, too."""
    state = {"displacements": {"blade.8.v": 1e-4, "blade.7.v": "0.08 mm"}, "velocities": {"blade.8.v": "2 mm/s"}}
    (tmp_path / "state.json").write_text(json.dumps(state))
    (tmp_path / "state.toml").write_text("\n".join(f"{key} = {inline({key: part})[len(key) + 4 : -1]}"
                                                   for key, part in state.items()))  # fmt: skip
    for name in ("state.json", "state.toml"):
        scene = tmp_path / "blade.toml"
        scene.write_text(
            f'schema = 1\nlike = "rotating-cantilever"\nsolve.start.file = "{name}"\n'
            'solve.start.displacements = {"blade.8.v" = "0.2 mm"}\n'
        )
        z, v = given_state(load(read_scene(scene)))
        row = model("rotating-cantilever").coordinates.index
        assert (z[row("blade.8.v")], z[row("blade.7.v")], v[row("blade.8.v")]) == (2e-4, 8e-5, 2e-3)
        assert np.count_nonzero(z) == 2 and np.count_nonzero(v) == 1
        assert file_places(read_scene(scene).raw) == {"solve.start.file": str(tmp_path / name)}


@pytest.mark.parametrize(("text", "reason"), [
    (None, r"no such file\. Give the path of a state's file, relative to the scene"),
    ("{", "not JSON: .*Give tables displacements and velocities, as solution"),
    ("[1]", "the file: "),
    ('{"displacements": {"tip": NaN}}', "displacements.tip: not a finite number"),
    ('{"displacements": {"tip": "3 kg"}}', "displacements.tip: 'kg' is not a unit of length"),
    ('{"rates": {}}', "rates: "),
    ('{"file": "state.json"}', "the state's file names another file"),
    ("9" * 5000, "not JSON: "),
    ("[" * 100_000, "not JSON: "),
])  # fmt: skip
def test_files_that_hold_no_state(tmp_path, monkeypatch, text, reason):
    monkeypatch.chdir(tmp_path)
    if text is not None:
        (tmp_path / "state.json").write_text(text)
    with pytest.raises(SceneError, match=rf"^solve\.start\.file = 'state\.json': {reason}"):
        with_settings(read_scene("rotating-cantilever"), ["solve.start.file=state.json"])


def test_angles_of_a_state_have_units_too():
    one_way = {"displacements": {"blade.8.theta": "3 deg"}, "velocities": {"blade.8.theta": "4 rpm"}}
    z, v = given_state(model("rotating-cantilever", *starting(one_way)))
    row = model("rotating-cantilever").coordinates.index("blade.8.theta")
    assert (z[row], v[row]) == pytest.approx((np.radians(3.0), np.radians(24.0)))
    coupled = {"displacements": {"hinge.angle": "5 deg"}, "velocities": {"hinge.angle": "6 rpm"}}
    start = beginning(model("elastic-pendulum", *PENDULUM, *starting(coupled)))
    assert (start.q[0], start.u[0]) == pytest.approx((np.radians(5.0), np.radians(36.0)))


def test_a_coupled_run_from_the_last_state_of_another_is_its_continuation():
    def swing(seconds, *more):
        return run("elastic-pendulum", *PENDULUM, f"solve.duration={seconds}", f"solve.steps={400 * seconds:g}", *more)

    whole, rest = swing(0.5), swing(0.25, *starting(swing(0.25).state()))
    for name in ("angle", "tip_bend"):
        assert rest.series[name].values == pytest.approx(whole.series[name].values[100:], abs=1e-7), name


def test_a_coupled_state_of_a_later_turn_stands_where_the_drive_is():
    """The blade's angle after a turn is 2 pi, where the drive begins at 0: whole turns are no gap."""
    settings = ("solve.preset=coupled", "solve.start=zero", "solve.tolerance=1e-6")
    first = run("rotating-cantilever", *settings)
    state = first.state()
    assert state["displacements"]["shaft.angle"] == pytest.approx(2 * np.pi, abs=1e-9)
    start = beginning(model("rotating-cantilever", *settings, *starting(state)))
    assert start.q[0] == pytest.approx(0.0, abs=1e-9)
    assert start.q[1:] == pytest.approx(list(state["displacements"].values())[1:], rel=1e-12)
    assert start.u == pytest.approx(list(state["velocities"].values()), rel=1e-12)


COILS = machine(
    name="disc",
    bodies=dict(wheel="mass = 1.0, inertia = 0.1, points = {rim = [0.3, 0]}", hand="mass = 0.1, inertia = 0.01"),
    joints=dict(hinge="revolute ground wheel", pin="revolute wheel.rim hand"),
    drives=dict(hinge="free = true, initial_speed = 10.0", pin="free = true, initial_speed = -20.0"),
    springs=dict(coil='torsional_at = "hinge", stiffness = 0.1', hair='torsional_at = "pin", stiffness = 0.01'),
    sensors=dict(angle="position hinge angle", heading="position hand angle", coil="spring_torque coil",
                 hair="spring_torque hair"),
    solve=dict(preset="coupled", duration=1.0, steps=100),
)


FOUR_BAR = machine(
    name="four-bar", ground=dict(P=[0.28, 0]),
    bodies=dict(crank="length = 0.1, mass = 0.2", coupler="length = 0.3, mass = 0.3",
                rocker="length = 0.25, mass = 0.5"),
    joints=dict(A="revolute ground crank.start", B="revolute crank.end coupler.start",
                D="revolute ground.P rocker.start", C='revolute coupler.end rocker.end, branch = "+"'),
    drives=dict(A="free = true, angle = 1.0"), springs=dict(coil='torsional_at = "B", stiffness = 0.01'),
    sensors=dict(angle="position B angle", heading="position crank angle", torque="spring_torque coil"),
    solve=dict(preset="coupled", duration=0.1, steps=50),
)


@pytest.mark.parametrize(
    ("text", "settings"), [(COILS, ()), (FOUR_BAR, ("drives.A.initial_speed=150",))], ids=["in a row", "in a loop"]
)
def test_a_state_keeps_the_turns_that_springs_count(text, settings):
    """Coils wound by more than a turn, at free drives and at a pin that a loop turns."""
    scene = with_settings(scene_of(text), settings)
    first = solved(scene)
    wound = {name: series.values[-1] for name, series in first.series.items()}
    assert max(map(abs, wound.values())) > math.tau
    second = solved(scene, *starting(first.state()))
    for name, value in wound.items():
        assert second.series[name].values[0] == pytest.approx(value, rel=1e-9), name
    for name, angles in first.drive_angles.items():
        assert second.drive_angles[name][0] == pytest.approx(angles[-1], rel=1e-9)


def test_turns_that_a_drive_takes_from_a_spring_are_refused():
    """After two turns the drive begins at zero anew, and the spring at it would have lost them."""
    driven = COILS.replace("hinge = {free = true, initial_speed = 10.0}", 'hinge = {speed = "2 rps"}')
    state = solved(scene_of(driven)).state()
    with pytest.raises(SceneError, match=r"the state has hinge at 720 deg, .* starts at -?\d\S* deg, and a "
                       r"torsional spring depends on these whole turns\. Continue with --after"):  # fmt: skip
        load(with_settings(scene_of(driven), starting(state)))
    ahead = driven.replace('"2 rps"', '"2 rps", angle = "720 deg"')
    found = solved(scene_of(ahead), *starting(state))
    assert found.series["coil"].values[0] == pytest.approx(0.4 * math.pi, rel=1e-9)


ELASTIC = FOUR_BAR.replace("mass = 0.3", 'beam = {material = "steel", section = {rectangle = [0.004, 0.02]}}')
FOLLOWING = {"A.angle": 1.0, "B.angle": -0.19469540 - 1.0, "D.angle": 0.20942362}
"""Rates of the joints of FOUR_BAR to that of the crank, by hand: the velocity polygon at A = 1 rad."""


def rates_at_start(text, velocities, *settings):
    """Of a scene in the plane, as a run begins with them."""
    found = load(with_settings(scene_of(text), starting({"velocities": velocities}, *settings)))
    first = solve(found).state(0)["velocities"]
    assert beginning(found).u == pytest.approx(list(first.values()), rel=1e-9, abs=1e-9)
    return first


def test_the_velocity_polygon_is_that_of_the_loop():
    """a e(crank) w_1 + b e(coupler) w_2 = c e(rocker) w_3, with the angles that close the loop."""
    given = load(scene_of(FOUR_BAR))
    poses = given.coupled.poses(beginning(given))
    angles, sizes = np.array([pose[2] for pose in poses.values()]), np.array([0.1, 0.3, -0.25])
    columns = sizes * np.array([-np.sin(angles), np.cos(angles)])
    followed = np.linalg.solve(columns[:, 1:], -columns[:, 0])
    assert list(FOLLOWING.values()) == pytest.approx([1.0, followed[0] - 1.0, followed[1]], rel=1e-6)


@pytest.mark.parametrize("text", [FOUR_BAR, ELASTIC], ids=["rigid", "elastic"])
@pytest.mark.parametrize(("joint", "rate"), [("A", 5.0), ("B", 2.0), ("D", -7.0)])
def test_one_rate_moves_all_that_hangs_on_it(text, joint, rate):
    """A free linkage has one freedom: whichever joint's rate is given, the others follow."""
    found = rates_at_start(text, {f"{joint}.angle": rate})
    for name, share in FOLLOWING.items():
        assert found[name] == pytest.approx(rate * share / FOLLOWING[f"{joint}.angle"], rel=1e-6), name
    assert all(found[name] == 0.0 for name in found if "axial" in name or "transverse" in name)


def test_rates_of_shapes_are_kept_and_the_bodies_follow():
    """The coupler stretches by its axial shape, one at its ends against each other: crank and rocker part by that."""
    found = rates_at_start(ELASTIC, {"coupler.axial_0": "0.02 m/s", "coupler.transverse_1": 0.03, "A.angle": 5.0})
    kept = found["coupler.axial_0"], found["coupler.transverse_1"], found["A.angle"]
    assert kept == pytest.approx((0.02, 0.03, 5.0), rel=1e-12)
    still = rates_at_start(ELASTIC, {"coupler.axial_0": 0.02}, "drives.A.initial_speed=5")
    assert still["A.angle"] == pytest.approx(5.0, rel=1e-9)
    assert still["D.angle"] == pytest.approx(found["D.angle"], rel=1e-9) != 5.0 * FOLLOWING["D.angle"]


def test_rates_that_are_not_given_are_those_of_the_rigid_mechanism():
    """In a row of pins the wheel's is given; the hand's pin keeps its initial speed, zero by default."""
    unsaid = COILS.replace(", initial_speed = -20.0", "")
    assert rates_at_start(unsaid, {"hinge.angle": 3.0}) == pytest.approx({"hinge.angle": 3.0, "pin.angle": 0.0})
    assert rates_at_start(COILS, {"hinge.angle": 3.0}) == pytest.approx({"hinge.angle": 3.0, "pin.angle": -20.0})


@pytest.mark.parametrize(("velocities", "message"), [
    ({"A.angle": 5.0, "D.angle": "-7 rad/s"}, r"\w\.angle = \S+( rad/s')?: joints and drives make it "
     r"(1\.04712|-33\.425) rad/s\. Give rates consistent with the joints"),
    ({"crank.phi": 1.0}, r"crank\.phi = 1\.0: the run has no such coordinate\. Known: A\.angle"),
])  # fmt: skip
def test_rates_that_contradict_each_other_are_refused(velocities, message):
    with pytest.raises(SceneError, match=rf"^solve\.start\.velocities\.{message}"):
        rates_at_start(ELASTIC, velocities)


HELD = machine(
    name="held", ground=dict(P=[1, 0]),
    bodies=dict(rod='length = 1, beam = {material = "aluminium", section = {rectangle = [0.01, 0.01]}, elements = 4}',
                arm="length = 0.3, mass = 1.0"),
    joints=dict(pin="revolute ground rod.start", far="revolute ground.P rod.end", on="revolute rod.mid arm.start"),
    drives=dict(on='free = true, angle = "-30 deg"'), gravity=[0, -9.81],
    solve=dict(preset="coupled", modes=2, duration="20 ms", steps=20),
)


def test_where_a_loop_must_bend_its_shapes_start_as_they_are_given_too():
    """A rod between two pins can't stretch, but bends; its state at the end of a run is one to start from."""
    assert rates_at_start(HELD, {"rod.transverse_0": 0.1, "on.angle": 2.0})["rod.transverse_0"] == 0.1
    with pytest.raises(SceneError, match=r"axial_0 = 0\.1: joints and drives make it 0 m/s\. Give rates consistent"):
        rates_at_start(HELD, {"rod.axial_0": 0.1})
    first = solved(scene_of(HELD))
    start = beginning(load(with_settings(scene_of(HELD), starting(first.state()))))
    assert start.u == pytest.approx(list(first.state()["velocities"].values()), rel=1e-9, abs=1e-9)


def test_shapes_that_a_given_state_leaves_out_do_not_change_either():
    """Between its pins the rod can only bend so far if it stretches."""
    with pytest.raises(SceneError, match=r"rod\.axial_0 = 0\.0: joints and drives make it -0\.0123\d* m\."):
        load(with_settings(scene_of(HELD), starting({"displacements": {"rod.transverse_0": 0.1}})))


def test_a_rate_that_a_drive_prescribes_is_refused_where_it_is_another_one():
    driven = FOUR_BAR.replace("A = {free = true, angle = 1.0}", 'A = {speed = "5 rad/s", angle = 1.0}')
    assert rates_at_start(driven, {"D.angle": 1.047})["D.angle"] == pytest.approx(1.0471175, rel=1e-6)
    with pytest.raises(SceneError, match=r"A\.angle = 4\.0: joints and drives make it 5 rad/s"):
        rates_at_start(driven, {"A.angle": 4.0})


@pytest.mark.parametrize(("start", "message"), [
    ("{displacements = {'blade.8.w' = 1.0}}", "blade.8.w = 1.0: the run has no such coordinate. "
     "The nearest known one is 'blade.8.v'. Known: blade.1.u, blade.1.v, blade.1.theta, blade.2.u,"),
    ("{displacements = {'blade.8.v' = '1 deg'}}", "blade.8.v = '1 deg': 'deg' is not a unit of length."),
    ("{displacements = {'blade.8.theta' = '1 mm'}}", "blade.8.theta = '1 mm': 'mm' is not a unit of angle."),
    ("{velocities = {'blade.8.v' = '1 rpm'}}", "velocities.blade.8.v = '1 rpm': 'rpm' is not a unit of speed."),
    ("{displacements = {tip = nan}}", "displacements.tip = nan: not a finite number."),
    ("{displacements = {tip = '3 kg'}}", "displacements.tip = '3 kg': 'kg' is not a unit of length."),
    ("{rates = {tip = 1}}", "solve.start.rates"),
    ("rest", "solve.start = 'rest': must be 'zero', 'quasistatic', 'periodic' or a table of a state."),
])  # fmt: skip
def test_states_that_cannot_be(start, message):
    with pytest.raises(SceneError) as error:
        model("rotating-cantilever", f"solve.start={start}")
    assert message in str(error.value)


FROM_REST = """
schema = 1
name = "arm"
gravity = {gravity}
bodies.arm = {{length = 0.8, beam = {{material = "aluminium", section = {{rectangle = [0.01, 0.03]}}, elements = 2}}}}
joints.root = {{revolute = ["ground", "arm.start"]{axis}}}
drives.root.law = "{law}"
solve = {{preset = "linear", start = "quasistatic", duration = 0.5, steps = 500}}
"""


@pytest.mark.parametrize(("gravity", "axis"), [("[0, -9.81]", ""), ("[0, 0, -9.81]", ", axis = [0, -1, 0]")])
def test_a_slow_start_knows_nothing_of_what_laws_are_before_it(gravity, axis):
    """A swing from rest has a kink at t = 0, which its polynomial alone has not; nor do the steps matter."""
    swing = "0.8*step(t, 0, 0, 0.8, 1)"
    smooth = "0.8*((t/0.8)**3*(10 - 15*(t/0.8) + 6*(t/0.8)**2))"
    found = [
        np.concatenate(slow_start(load(with_settings(scene_of(text), [f"solve.steps={steps}"]))))
        for law, steps in ((smooth, 500), (swing, 50), (swing, 8000))
        for text in (FROM_REST.format(gravity=gravity, axis=axis, law=law),)
    ]
    for other in found[1:]:
        assert other == pytest.approx(found[0], rel=1e-7, abs=1e-7 * abs(found[0]).max())


SLOW = {
    "engine": ("solve.duration=5 ms", "solve.steps=360", "solve.errors=all"),
    "robot-arm-elastic": ("solve.duration=0.1 s", "solve.steps=100"),
}


@pytest.mark.parametrize("scene", SLOW)
def test_the_slow_motion_is_the_same_under_every_preset(scene):
    """In the plane and in space. Where coupling hardly matters both ways to solve it ring as little as each other."""
    settings = ("solve.start=quasistatic", *SLOW[scene])
    one_way, coupled = (run(scene, *settings, f"solve.preset={preset}") for preset in ("stiffened", "coupled"))
    alike(coupled, one_way, 4e-3, one_way.model.scene.sensors)
    for name, estimate in one_way.errors[0].items() if scene == "engine" else ():
        assert estimate.coupling < 4e-3 * abs(one_way.series[name].values).max(), name


L_FRAME = """
schema = 1
bodies.post = {{length = 1, beam = {{material = "steel", A = "1e4 mm^2", I = "8.333e6 mm^4", elements = 8}}}}
bodies.arm = {{like = "post"}}
joints.base = {{revolute = ["ground", "post.start"]{axis}}}
joints.corner = {{weld = ["post.end", "arm.start"]{turned}}}
drives.base.law = "pi / 2"
loads.push = {{force_on = "arm.end", direction = {down}, value = "{push} MN"}}
sensors.reach = {{position = "arm.end", component = "x"}}
sensors.drop = {{position = "arm.end", component = "y"}}
sensors.held = {{drive_torque = "base"}}
solve = {{preset = "coupled", start = "quasistatic", duration = "0.1 ms", steps = 2, modes = 2}}
"""


def test_a_large_load_is_balanced_in_load_steps():
    """Newton's method alone finds no balance from 3 MN on, or one far away: the drive holds the force by its arm."""
    dropped = []
    for push in (2, 3, 4):
        text = L_FRAME.format(push=push, axis="", turned=', relative_angle = "-90 deg"', down="[0, -1]")
        first = {name: series.values[0] for name, series in solved(scene_of(text)).series.items()}
        assert first["held"] == pytest.approx(push * 1e6 * first["reach"], rel=1e-9)
        dropped.append(first["drop"])
    assert np.all(np.diff(dropped) < 0.0) and np.diff(dropped, 2) > -0.02


IN_SPACE = """
schema = 1
bodies.post = {{length = 1, {beam}, rotation = {{axis = [0, 0, 1], angle = "90 deg"}}}}
bodies.arm = {{length = 1, {beam}}}
joints.base = {{revolute = ["ground", "post.start"], axis = [0, 0, 1]}}
joints.corner = {{weld = ["post.end", "arm.start"]}}
drives.base.law = "0"
loads.push = {{force_on = "arm.end", direction = [0, -1, 0], value = "0.22 MN"}}
sensors.held = {{drive_torque = "base"}}
sensors.reach = {{position = "arm.end", component = "x"}}
solve = {{preset = "coupled", start = "quasistatic", duration = "0.1 ms", steps = 2, modes = {modes}}}
"""


def test_a_large_load_in_space_is_balanced():
    """Also with modes of which the mass matrix is not positive definite there; the planar frame under the same load has
    its torque."""
    section = "A = '1e4 mm^2', I_y = '8.333e6 mm^4', I_z = '8.333e6 mm^4', J = '14e6 mm^4'"
    beam = f"beam = {{material = 'steel', {section}, elements = 8}}"
    for modes in (1, 2, 6):
        held = solved(scene_of(IN_SPACE.format(beam=beam, modes=modes))).series
        assert held["held"].values[0] == pytest.approx(220e3 * held["reach"].values[0], rel=1e-9)
    text = L_FRAME.format(push=0.22, axis="", turned=', relative_angle = "-90 deg"', down="[0, -1]")
    flat = solved(scene_of(text))
    assert held["held"].values[0] == pytest.approx(flat.series["held"].values[0], rel=5e-4) and not flat.warnings
    for given in (text, IN_SPACE.format(beam=beam, modes=6)):
        (said,) = solved(scene_of(given.replace("0.22 MN", "0.5 MN"))).warnings
        assert said.startswith("post bends by 15% of its length")


@pytest.mark.parametrize("preset", ["rigid", "quasistatic", "paper"])
def test_presets_that_integrate_from_no_state_refuse_one(preset):
    with pytest.raises(SceneError, match=r"solve\.start = .*Use preset linear, stiffened or coupled"):
        model("rotating-cantilever", f"solve.preset={preset}", "solve.start={velocities = {'blade.8.v' = 1}}")


def test_a_coupled_state_must_close_its_joints():
    given = starting({"displacements": {"A.angle": 1.0, "D.angle": 2.5}})
    with pytest.raises(SceneError, match=r"displacements\.[AD]\.angle = .*: joints and drives make it \S+ rad\. Give"):
        load(with_settings(scene_of(FOUR_BAR), given))


def test_what_can_not_begin_from_a_given_state_says_so(tmp_path):
    first = ("solve.duration=10 ms", "solve.steps=10")
    given = model("elastic-pendulum", *starting({"velocities": {"hinge.angle": 0.1}}, *PENDULUM, *first))
    with pytest.raises(SceneError, match=r"after = .*: the scene also gives an initial state"):
        solve(given, after=run("elastic-pendulum", *PENDULUM, *first))
    setting = "--set=solve.start={velocities = {'blade.8.v' = 1}}"
    refused(cli("trade", "rotating-cantilever", setting, "-o", tmp_path / "no"), "solve.start", "Start from zero")
    command = ("run", "rotating-cantilever", setting, "--sensitivities", "blade.length", "-o", tmp_path / "no")
    refused(cli(*command), "solve.start", "Start from zero")


def test_a_rod_that_spins_between_two_balls_does_not_return_after_a_cycle():
    joints = 'cross = "none"\nknee.spherical = ["rod.end", "slider.start"]'
    spun = machine(like="spatial-slider-crank-elastic", joints=joints, drives=dict(knee="free = true"))
    with pytest.raises(SceneError, match=r"^solve\.start = 'periodic': knee moves freely, and does not return after a"):
        solved(scene_of(spun))
