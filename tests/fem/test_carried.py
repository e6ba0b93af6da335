"""What elastic links carry, rigid bodies and lumped masses, and in space what acts on them: springs and loads."""

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from lifting import lifted
from machines import four_bar, machine
from runs import alike, solved
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from test_spatial_elastic import STEEL, matrices

import kaneflex.scenes
from kaneflex import SceneError, load, read_scene, scene_of, with_settings
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.building import reference_modes

SCENE = """
schema = 1
like = "four-bar"
bodies.crank = {beam = "none", mass = "31.58 g"}
bodies.follower = FOLLOWER
damping.rayleigh = {ratio = 0.05, at = ["46 Hz", "75 Hz"]}
drives.main = {speed = "200 rpm"}
sensors.crank_tip = "none"
sensors.follower_mid = "none"
sensors.joint_x = {joint_force = "second", component = "x"}
sensors.joint_y = {joint_force = "second", component = "y"}
sensors.pivot_x = {joint_force = "rocker", component = "x"}
sensors.pivot_y = {joint_force = "rocker", component = "y"}
sensors.end_x = {position = "follower.end", component = "x"}
solve.steps = 360
"""
RIGID = '{beam = "none", mass = "29.83931 g"}'
STIFF = '{beam = {E = "71e12 Pa", elements = 2}}'


@pytest.fixture(scope="module")
def scenes():
    return {name: scene_of(SCENE.replace("FOLLOWER", of)) for name, of in (("rigid", RIGID), ("stiff", STIFF))}


def test_a_hinged_body_has_one_coordinate(scenes):
    coordinates = load(scenes["rigid"]).coordinates
    assert [name for name in coordinates if name.startswith("follower")] == ["follower.turn"]


def test_frequencies(scenes):
    rigid, stiff = (reference_modes(load(scenes[name]), 3)[0] for name in ("rigid", "stiff"))
    assert rigid == pytest.approx(stiff, rel=1e-5)


@pytest.mark.parametrize("terms", ["{}", "{geometric = false}", "{spin = false, euler = false}"])
def test_motion(scenes, terms):
    series = {name: solved(scene, f"solve.terms={terms}").series for name, scene in scenes.items()}
    within = {"coupler_mid": 1e-5, "crank_torque": 1e-4, "coupler_force": 1e-4, "end_x": 1e-6}
    alike(series["rigid"], series["stiff"], within)


def test_forces_without_vibrations(scenes):
    series = {name: solved(scene, "solve.preset=quasistatic").series for name, scene in scenes.items()}
    alike(series["rigid"], series["stiff"], 1e-4, ("coupler_mid", "joint_x", "joint_y", "pivot_x", "pivot_y"))


ROTATING = """
schema = 1
bodies.arm = {length = "1 m", beam = {material = "steel", A = "100 mm^2", I = "1000 mm^4", elements = 6}}
bodies.tip = TIP
joints.hub = {revolute = ["ground", "arm.start"]}
joints.flange = {weld = ["arm.end", "tip.start"]}
drives.hub = {speed = "400 rpm", cycle = "360 deg"}
loads.push = {force_on = "tip.end", axes = "body", direction = [0, 1], value = "5 N"}
sensors.arm_end = {displacement = "arm.end", component = "y"}
sensors.arm_turn = {displacement = "arm.end", component = "angle"}
sensors.tip_end = {displacement = "tip.end", component = "y"}
sensors.root_moment = {bending_moment = "arm.start"}
sensors.end_moment = {bending_moment = "arm.end"}
sensors.hub_torque = {drive_torque = "hub"}
sensors.flange_moment = {joint_force = "flange", component = "angle"}
damping.rayleigh = {ratio = 0.05, at = ["4 Hz", "40 Hz"]}
solve = {start = "periodic", steps = 360}
"""
RIGID_TIP = '{length = "0.4 m", mass = "0.314 kg"}'
STIFF_TIP = (
    '{length = "0.4 m", beam = {E = "2.1e14 Pa", rho = "7850 kg/m^3", A = "100 mm^2", I = "1000 mm^4", elements = 2}}'
)


def test_a_body_at_the_tip_of_a_rotating_beam():
    """Its centrifugal force turns with nothing but acts on a turned arm: K_g of the body itself."""
    found = {}
    for name, tip in (("rigid", RIGID_TIP), ("stiff", STIFF_TIP)):
        found[name] = solved(scene_of(ROTATING.replace("TIP", tip))).series
    for sensor in ("arm_end", "arm_turn", "tip_end"):
        rigid, stiff = (found[name][sensor].values.mean() for name in ("rigid", "stiff"))
        assert rigid == pytest.approx(stiff, rel=1e-3), sensor
    # The centrifugal forces meet the axis: what is left at the hub is the push at 1.4 m.
    assert found["rigid"]["root_moment"].values.mean() == pytest.approx(7.0, rel=1e-3)
    assert found["rigid"]["hub_torque"].values.mean() == pytest.approx(-7.0, rel=1e-3)
    # What the arm's end carries is what the body needs to turn with it, at any instant.
    scene = with_settings(scene_of(ROTATING.replace("TIP", RIGID_TIP)), ["solve.preset=quasistatic"])
    series = solved(scene).series
    assert series["flange_moment"].values == pytest.approx(-series["end_moment"].values, rel=1e-9)


LUMPED = ROTATING.replace("bodies.tip = TIP\n", "").replace('joints.flange = {weld = ["arm.end", "tip.start"]}\n', "")


def test_a_lumped_mass_at_the_tip_of_a_rotating_beam():
    """At rest in the turning axes its centrifugal force meets the axis, too: only the push is left at the hub."""
    sensors = 'sensors.root_moment = {bending_moment = "arm.start"}\nsensors.hub_torque = {drive_torque = "hub"}\n'
    text = LUMPED[: LUMPED.index("sensors.")] + sensors + LUMPED[LUMPED.index("damping.") :]
    text = text.replace("tip.end", "arm.end") + '\nmasses.weight = {at = "arm.end", mass = "0.5 kg"}\n'
    for preset, exact in (("quasistatic", 1e-9), ("stiffened", 1e-3)):
        scene = with_settings(scene_of(text), [f"solve.preset={preset}"])
        series = solved(scene).series
        assert series["root_moment"].values.mean() == pytest.approx(5.0, rel=exact)
        assert series["hub_torque"].values.mean() == pytest.approx(-5.0, rel=exact)


def test_a_lumped_mass_within_a_rotating_beam_pulls_at_its_inner_half():
    """Tip under a push F by integrating (E I v'')' - P v' = S, S' = rho A omega^2 v, at every angle of the hub.

    P(x) = rho A omega^2 (L^2 - x^2) / 2, before the mass at a besides m omega^2 a; there S grows by m omega^2 v.
    """
    text = LUMPED[: LUMPED.index("sensors.tip_end")] + LUMPED[LUMPED.index("damping.") :]
    text = text.replace("tip.end", "arm.end").replace("elements = 6", "elements = 16")
    text = text.replace("solve = {", 'solve = {preset = "quasistatic", ')
    text += 'masses.weight = {at = "arm.mid", mass = "2 kg"}'
    tip = solved(scene_of(text)).series["arm_end"].values
    EI, line, omega, m, F = 2.1e11 * 1e-9, 7850.0 * 1e-4, 400 * np.pi / 30, 2.0, 5.0

    def half(start, inner):
        def slopes(x, y):
            v, theta, M, S = y
            P = omega**2 * (line * (1 - x**2) / 2 + m * 0.5 * inner)
            return theta, M / EI, S + P * theta, line * omega**2 * v

        span = (0.0, 0.5) if inner else (0.5, 1.0)
        return solve_ivp(slopes, span, start, rtol=1e-10, atol=1e-12).y[:, -1]

    def end(M, S):
        middle = half((0.0, 0.0, M, S), True)
        return half(middle + np.array([0.0, 0.0, 0.0, m * omega**2 * middle[0]]), False)

    ends = np.array([end(1.0, 0.0), end(0.0, 1.0)]).T  # linear in what the root carries
    expected = ends[0] @ np.linalg.solve(ends[2:], [0.0, -F])
    assert tip == pytest.approx(expected, rel=1e-5)


BOOM = machine(
    gravity=[-4, -9],
    bodies=dict(boom='length = 1.5, beam = {material = "steel", section = {rectangle = [0.015, 0.02]}, elements = 8}',
                holder="mass = 0.001, inertia = 1e-6", car="mass = MASS, inertia = 0.02"),
    joints=dict(root="weld ground boom.start", bracket="weld boom.end holder"), damping=dict(modal=dict(ratio=0.3)),
    sensors=dict(slope="position holder angle", held_x="acceleration car x", held_y="acceleration car y",
                 force_x="joint_force hold x", force_y="joint_force hold y", own_x='joint_force hold x, axes = "body"',
                 own_y='joint_force hold y, axes = "body"'),
    solve=dict(preset="PRESET", start="quasistatic", duration=0.1, steps=10),
)
GUIDE = 'joints.hold = {prismatic = ["holder", "car"], direction = [1, 0]}\ndrives.hold = {speed = 0, position = 0.4}'
WELD = 'joints.hold = {weld = ["holder", "car"]}'


def _boom(preset, hold, mass, more=""):
    found = solved(scene_of(BOOM.replace("PRESET", preset).replace("MASS", str(mass)) + f"{hold}\n{more}"))
    return {name: series.values[-1] for name, series in found.series.items()}


def test_sensors_on_a_rigid_body_turn_with_it_where_an_elastic_one_carries_it():
    """A carriage on a guide at the end of a boom that sags by four degrees, at rest."""
    found = _boom("coupled", GUIDE, 4.0, 'sensors.slid = {position = "hold"}')
    c, s = np.cos(found["slope"]), np.sin(found["slope"])
    assert found["slope"] < -0.06 and found["slid"] == pytest.approx(0.4, abs=1e-12)
    assert (found["held_x"], found["held_y"]) == pytest.approx((4 * c + 9 * s, 9 * c - 4 * s), rel=1e-9)
    assert (found["own_x"], found["own_y"]) == pytest.approx((16 * c + 36 * s, 36 * c - 16 * s), rel=1e-9)
    assert (found["force_x"], found["force_y"]) == pytest.approx((16, 36), rel=1e-9)


def test_so_they_do_under_one_way_presets_to_the_first_order():
    found, exact = _boom("stiffened", WELD, 0.05), _boom("coupled", WELD, 0.05)
    slope = found["slope"]
    assert slope < -1e-3
    assert (found["held_x"], found["held_y"]) == pytest.approx((4 + 9 * slope, 9 - 4 * slope), rel=1e-9)
    for name in ("held_x", "held_y", "own_x", "own_y"):
        assert found[name] == pytest.approx(exact[name], rel=1e-3), name


@pytest.mark.parametrize("preset", ["quasistatic", "stiffened"])
def test_the_stretch_by_a_mass_that_turns_steadily_is_at_rest_in_the_axes_of_its_link(preset):
    """By E u'' = -rho omega^2 (x + u), E A u'(l) = m omega^2 (l + u(l)): damping does not act on it, a quasi-static
    solution has all of it."""
    found = solved(scene_of(f"""
schema = 1
gravity = [0, 0]
bodies = {{arm = {{length = 1, beam = {{E = 70e9, rho = 2700, A = 1e-4, I = 1e-9, elements = 8}}}}}}
joints = {{hub = {{revolute = ["ground", "arm.start"]}}}}
masses = {{tip = {{at = "arm.end", mass = 2}}}}
drives = {{hub = {{speed = "300 rad/s", cycle = "360 deg"}}}}
damping = {{rayleigh = {{ratio = 0.3, at = ["10 Hz", "100 Hz"]}}}}
sensors.along = {{displacement = "arm.end", component = "x"}}
sensors.across = {{displacement = "arm.end", component = "y"}}
solve = {{preset = "{preset}", start = "periodic", steps = 60}}
"""))
    k, pull = 300.0 * math.sqrt(2700 / 70e9), 2.0 * 300.0**2 / (70e9 * 1e-4)
    along = math.sin(k) / (k * math.cos(k) - pull * math.sin(k)) - 1.0
    assert found["along"].values == pytest.approx(np.full(61, along), rel=1e-5)
    assert abs(found["across"].values).max() < 1e-9 * along


ACTING = {
    "masses": {
        "bob": {"at": "rod.mid", "mass": "30 g", "inertia": "2e-6 kg m^2"}, "bush": {"at": "rod.end", "mass": "20 g"},
        "insert": {"at": "piston.start", "mass": "50 g"},
    },
    "springs": {
        "strut": {"between": ["ground.stand", "rod.mid"], "stiffness": "9e4 N/m", "damping": "40 N s/m",
                  "length": "60 mm"},
        "bungee": {"between": ["crank.mid", "rod.mid"], "stiffness": "3e4 N/m"},
        "buffer": {"between": ["ground.stand", "piston"], "stiffness": "2e4 N/m", "damping": "25 N s/m"},
    },
    "loads": {
        "wind": {"spread_on": "rod", "direction": [0.3, -1], "law": "2000 + 300 * cos(main)", "profile": [1, 2.5]},
        "stream": {"spread_on": "crank", "direction": [1, 0.4], "axes": "body", "value": "900 N/m"},
    },
    "sensors": {
        "strut_force": {"spring_force": "strut"}, "bungee_force": {"spring_force": "bungee"},
        "buffer_force": {"spring_force": "buffer"}, "bending_at": {"bending_moment": "rod.mid"},
        "axial_at": {"axial_force": "rod.start"}, "of_rod": {"displacement": "rod.mid", "component": "y"},
        "torque": {"drive_torque": "main"}, "pin_force": {"joint_force": "pin", "axes": "body", "component": "x"},
    },
}  # fmt: skip


def test_what_acts_in_the_plane_acts_the_same_in_space():
    """Masses, springs, dampers and loads along links of an engine, turned by any rotation: every sensor.

    Without the damping by mass, which planar masses have in global axes and those in space in their link's.
    """
    tables = kaneflex.scenes.__path__[0]
    raw = read_scene("engine-elastic-crank").raw
    raw = {**raw, "ground": {"stand": ["90 mm", "70 mm"]}, "events": {}}
    raw |= {table: {**raw.get(table, {}), **given} for table, given in ACTING.items()}
    raw["solve"] = {"preset": "stiffened", "start": "periodic", "tolerance": 1e-10}
    raw["damping"] = {"rayleigh": {"ratio": 0, "at": ["3039 Hz", "4549 Hz"]}}
    planar = scene_of(raw, tables)
    flat = solved(planar)
    given = lifted(planar) | {"solve": raw["solve"]}
    solution = solved(scene_of(given, tables))
    assert set(ACTING["sensors"]) <= set(given["sensors"])
    alike(solution, flat, 1e-7, given["sensors"])


def test_coordinates_follow_from_enough_rows_as_from_all():
    """A four-bar in space, whose parallel axes hold it three times more than they need to."""
    raw = read_scene("four-bar").raw
    four_bar = lifted(read_scene("four-bar")) | {"solve": raw["solve"]}
    model = load(scene_of(four_bar))
    joined, choice = model.motion.deforming.map.joined, model.motion.deforming.map.choice
    motion = model.motion.rigid_only.at(np.linspace(0.0, model.scene.horizon, 40))
    every = np.flatnonzero(np.isin(choice.independent, joined.tied))
    assert joined.row_count > len(choice.rows) == len(choice.dependent)
    all_rows = replace(choice, rows=np.arange(joined.row_count))
    by_enough, by_all = (joined.tied_maps(motion, each, every) for each in (choice, all_rows))
    for rate in range(3):
        assert abs(by_enough[rate] - by_all[rate]).max() < 1e-9 * abs(by_all[rate]).max()


def test_rows_are_compared_by_pure_numbers():
    """Displacements count by the mechanism's size, so rows of one that is 2^-10 as large are the same."""
    rows = []
    for size in (1.0, 2.0**-10):
        beam = f"beam = {{E = 2e9, nu = 0.3, rho = 2000, section = {{circle = {0.01 * size}}}, elements = 2}}"
        text = four_bar(
            f"length = {0.1 * size}, mass = 1, inertia = [1, 1, 1], rotation = {{axis = [0, 0, 1], angle = 1}}",
            f"length = {0.3 * size}, {beam}",
            f"length = {0.3 * size}, rotation = {{axis = [0, 0, 1], angle = 1.2}}, {beam}",
            'speed = "60 rpm", cycle = "360 deg"', "right", deep=True, ground={"right": [0.28 * size, 0, 0]},
            solve={"preset": "linear", "start": "zero", "duration": "0.1 s", "steps": 4},
        )
        motion = load(scene_of(text)).motion
        rows.append(motion.deforming.map.joined._scaled_rows(motion.rigid_only.at(np.linspace(0.0, 0.1, 3))))
    np.testing.assert_allclose(*rows, rtol=0.0, atol=1e-9)


def test_maps_keep_the_joints_closed():
    """J L = 0 with its first two rates, at a joint of every kind of the arm and its drives."""
    model = load(read_scene("robot-arm-elastic"))
    joined, choice = model.motion.deforming.map.joined, model.motion.deforming.map.choice
    motion = model.motion.rigid_only.at(np.linspace(0.0, model.scene.horizon, 7))
    every = np.flatnonzero(np.isin(choice.independent, joined.tied))
    J, L = joined.rows(motion), joined.tied_maps(motion, choice, every)
    sums = J[0] @ L[0], J[1] @ L[0] + J[0] @ L[1], J[2] @ L[0] + 2 * J[1] @ L[1] + J[0] @ L[2]
    for rate, total in enumerate(sums):
        assert abs(total).max() < 1e-9 * abs(J[rate]).max() * abs(L).max()


CANTILEVER = f"""
schema = 1
gravity = [0, 0, 0]
bodies.arm.length = "1 m"
bodies.arm.beam = {{{STEEL}, section = {{circle = "20 mm"}}, elements = 4}}
bodies.arm.points = {{aside = ["1 m", "30 mm", "40 mm"], third = ["0.3 m", 0, 0]}}
joints.root = {{revolute = ["ground", "arm.start"], axis = [0, 0, 1]}}
drives.root = {{speed = "0 rpm"}}
sensors.tip = {{displacement = "arm.end", component = "z", axes = "global"}}
sensors.moment = {{bending_moment = "arm.start", component = "y"}}
sensors.between = {{bending_moment = "arm.third", component = "y"}}
sensors.root_force = {{joint_force = "root", component = "z"}}
solve = {{preset = "PRESET", start = "zero", duration = "1 s", steps = 4}}
"""
EI = 200e9 * math.pi * 0.02**4 / 64


def cantilever(more, preset="quasistatic"):
    return scene_of(CANTILEVER.replace("PRESET", preset) + more)


def test_a_load_along_a_cantilever():
    """One that grows from p to 3 p: tip p l^4 (1/8 + 2 * 11/120)/(E I), M and V of the part beyond each section."""
    more = 'loads.wind = {spread_on = "arm", direction = [0, 0, 1], value = "60 N/m", profile = [1, 3]}'
    for preset in ("quasistatic", "rigid"):
        solution = solved(cantilever(more, preset))
        assert solution["root_force"].values == pytest.approx(-120.0, rel=1e-9)
        for sensor, x in (("moment", 0.0), ("between", 0.3)):
            wanted = -60 * ((1 + 2 * x) * (1 - x) ** 2 / 2 + 2 * (1 - x) ** 3 / 3)  # M_y = -E I_y w''
            assert solution[sensor].values == pytest.approx(wanted, rel=1e-9), (preset, sensor)
        if preset == "quasistatic":
            assert solution["tip"].values == pytest.approx(60 * (1 / 8 + 2 * 11 / 120) / EI, rel=1e-9)


def test_a_load_along_a_cantilever_whose_shapes_carry_it():
    """The same under preset coupled, of a hundredth of the load, so that it bends by 3 mm: the tip by its shapes."""
    more = 'sensors.shear = {shear_force = "arm.third", component = "z"}\n'
    more += 'loads.wind = {spread_on = "arm", direction = [0, 0, 1], value = "0.6 N/m", profile = [1, 3]}'
    text = CANTILEVER.replace("PRESET", "coupled") + more
    text = text.replace('"zero"', '"quasistatic", modes = 4').replace('"1 s"', '"1 ms"')
    solution = solved(scene_of(text))
    assert solution["root_force"].values == pytest.approx(-1.2, rel=1e-9)
    assert solution["shear"].values == pytest.approx(0.6 * (1.6 * 0.7 + 0.7**2), rel=1e-7)
    for sensor, x in (("moment", 0.0), ("between", 0.3)):
        wanted = -0.6 * ((1 + 2 * x) * (1 - x) ** 2 / 2 + 2 * (1 - x) ** 3 / 3)
        assert solution[sensor].values == pytest.approx(wanted, rel=1e-7), sensor
    assert solution["tip"].values == pytest.approx(0.6 * (1 / 8 + 2 * 11 / 120) / EI, rel=1e-4)


def test_a_spring_holds_a_cantilever():
    """Two springs in parallel with its own 3 E I/l^3: one along z, already 50 mm too long, one without free length."""
    more = '''
sensors.above = {spring_force = "above"}
ground = {high = ["1 m", 0, "0.25 m"], tip = ["1 m", 0, "-0.1 m"]}
springs.above = {between = ["ground.high", "arm.end"], stiffness = "8000 N/m", length = "0.2 m"}
springs.below = {between = ["arm.end", "ground.tip"], stiffness = "3000 N/m"}
'''
    solution = solved(cantilever(more))
    tip = (8000 * 0.05 - 3000 * 0.1) / (3 * EI + 8000 + 3000)
    assert solution["tip"].values == pytest.approx(tip, rel=1e-9)
    assert solution["above"].values == pytest.approx(8000 * (0.05 - tip), rel=1e-9)
    assert solution["root_force"].values == pytest.approx(-3 * EI * tip, rel=1e-9)


def test_a_mass_beside_the_axis_is_a_body_welded_there():
    """Frequencies of a cantilever whose tip carries it; on a rigid body it is part of that, by Steiner's theorem."""
    aside = 'masses.bob = {at = "arm.aside", mass = "2 kg", inertia = [0.004, 0.003, 0.002]}'
    welded = """
bodies.bob = {mass = "2 kg", centre = [0, "30 mm", "40 mm"], inertia = [0.004, 0.003, 0.002]}
joints.tip = {weld = ["arm.end", "bob"]}
"""
    found = (matrices(load(cantilever(more))) for more in (aside, welded))
    one, two = (eigh(each["K"], each["M"])[0] for each in found)
    assert one == pytest.approx(two, rel=1e-9)
    raw = tomllib.loads(CANTILEVER.replace("PRESET", "rigid") + aside)
    raw["bodies"]["arm"] |= {"mass": "1 kg", "inertia": [0, 0.1, 0.1]}
    del raw["bodies"]["arm"]["beam"], raw["sensors"]
    body = mechanism_of(scene_of(raw)).bodies["arm"]
    c, m = body.centre, body.mass
    assert (m, *c) == pytest.approx((3.0, 2.5 / 3, 0.02, 0.08 / 3))
    about_start = [0.004 + 2 * 0.05**2, 0.35 + 0.003 + 2 * (1 + 0.04**2), 0.35 + 0.002 + 2 * (1 + 0.03**2)]
    assert body.inertia[:3] + m * (c @ c - c**2) == pytest.approx(about_start)
    assert body.inertia[3] - m * c[0] * c[1] == pytest.approx(-2 * 0.03)


@pytest.mark.parametrize(("more", "said"), [
    ('masses.bob = {at = "arm.end", mass = "1 kg", inertia = 0.1}', r"bob.inertia = 0.1.*three principal"),
    ('masses.arm = {at = "arm.end", mass = "1 kg"}', r"masses.arm: bodies has an entry of this name"),
    ('springs.s = {between = ["ground", "arm.aside"], stiffness = "1 N/m"}', r"points.aside.*springs.s acts"),
])  # fmt: skip
def test_what_is_wrong_with_what_acts_is_named(more, said):
    with pytest.raises(SceneError, match=said):
        load(cantilever(more))
