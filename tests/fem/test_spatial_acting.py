"""What acts on elastic links in space: lumped masses, springs with dampers between points, loads along them."""

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from lifting import lifted
from runs import solved
from scipy.linalg import eigh
from test_spatial_elastic import STEEL, matrices

import kaneflex.scenes
from kaneflex import SceneError, load, read_scene, scene_of
from kaneflex.mechanism.spatial import spatial_mechanism_of

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
    for sensor in given["sensors"]:
        wanted, found = flat[sensor].values, solution[sensor].values
        assert abs(found - wanted).max() <= 1e-7 * abs(wanted).max(), sensor


def test_coordinates_follow_from_enough_rows_as_from_all():
    """A four-bar in space, whose parallel axes hold it three times more than they need to."""
    raw = read_scene("four-bar").raw
    four_bar = lifted(read_scene("four-bar")) | {"solve": raw["solve"]}
    model = load(scene_of(four_bar))
    joined, choice = model.motion.deforming.map.joined, model.motion.deforming.map.choice
    motion = model.motion.bare.at(np.linspace(0.0, model.scene.horizon, 40))
    each, whole = choice.blocks, joined._in_order(np.arange(joined.row_count), choice.dependent)
    assert len(each) > len(whole) == 1 and len(whole[0].rows) > len(choice.dependent)
    sizes = [sum(len(part) for part in parts) for parts in zip(*((b.rows, b.dependent) for b in each), strict=True)]
    assert sizes == 2 * [len(choice.dependent)]
    every = np.arange(len(choice.independent))
    by_enough, by_all = (joined.tied_maps(motion, replace(choice, blocks=blocks), every) for blocks in (each, whole))
    for rate in range(3):
        assert abs(by_enough[rate] - by_all[rate]).max() < 1e-9 * abs(by_all[rate]).max()


@pytest.mark.parametrize("backwards", [False, True])
def test_coordinates_follow_from_those_before_them(backwards):
    found = load(read_scene("robot-arm-elastic")).motion.deforming.map
    rows = np.concatenate([block.rows for block in found.choice.blocks])
    blocks = found.joined._in_order(np.sort(rows)[:: -1 if backwards else 1], found.choice.dependent)
    known, dependent = set(), set(found.joined.places(found.choice.dependent).tolist())
    for block in blocks:
        assert not (dependent - known) & set(block.given.tolist())
        known |= set(block.dependent.tolist())
    assert known == dependent and len(blocks) == 6


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
    body = spatial_mechanism_of(scene_of(raw)).bodies["arm"]
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
