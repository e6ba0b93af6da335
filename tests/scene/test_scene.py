"""Reading scenes: the shipped ones in SI, defaults, `like`, settings, structure and the JSON Schema."""

import json
import math
import os
import pickle
import subprocess
import sys

import pytest
from machines import machine

import kaneflex
from kaneflex import SceneError, read_scene, scene_of, shipped_scenes, with_settings
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.scene import json_schema
from kaneflex.scene.quantities import Address
from kaneflex.scene.read import _validated
from kaneflex.scene.structure import structure_hash, structure_of
from kaneflex.support import units
from kaneflex.support.units import ANGULAR_SPEED, FREQUENCY, LENGTH, SECOND_MOMENT, to_si

FOUR_BAR = machine(
    ground=dict(far=["0.3 m", 0]),
    bodies=dict(crank="length = 0.1, mass = 0.2, points = {hole = [0.05, 0.01]}",
                coupler='length = 0.3, beam = {material = "aluminium", E = "72 GPa", A = "1 cm^2", I = "100 mm^4"}',
                rocker='like = "coupler", length = 0.25, beam = {elements = 2}'),
    joints=dict(main="revolute ground crank", a="revolute crank.end coupler", b="revolute coupler.end rocker.end",
                fixed='revolute ground.far rocker, branch = "-"'),
    drives=dict(main='speed = "60 rpm", cycle = "1 turn"'),
    loads=dict(push='force_on = "crank.hole", axes = "body", direction = [3, 4], law = "5*sin( main )+main_speed*t"'),
)


@pytest.fixture
def four_bar(tmp_path):
    path = tmp_path / "four_bar.toml"
    path.write_text(FOUR_BAR)
    return path


def test_shipped_scenes_are_those_of_the_house():
    expected = {"engine", "engine-paper", "engine-elastic-crank", "engine-3", "engine-transient", "engine-rig"}
    assert set(shipped_scenes()) >= expected


@pytest.mark.parametrize("name", sorted(shipped_scenes()))
def test_every_shipped_scene_reads_and_states_its_assumptions(name):
    scene = read_scene(name)
    assert scene.name == name and scene.description and scene.assumptions and scene.sensors


def test_reference_engine_in_si():
    scene = read_scene("engine")
    rod = scene.bodies["rod"]
    assert (scene.bodies["crank"].length, rod.length, rod.mass) == (0.04, 0.137, 0.153)
    assert rod.E_I == pytest.approx(1471.68, rel=1e-12)  # errata.md: EI = 1472 N m^2, EA = 2.99e7 N
    assert rod.E_A == pytest.approx(2.1e11 * 0.153 / (7850 * 0.137), rel=1e-12)
    assert rod.rho_A == pytest.approx(0.153 / 0.137, rel=1e-12)
    assert rod.centre == (0.0685, 0.0) and rod.inertia == pytest.approx(0.153 * 0.137**2 / 12)
    assert scene.bodies["piston"].inertia == 0 and not scene.bodies["piston"].elastic
    assert scene.drives["main"].speed == pytest.approx(200 * math.pi, rel=1e-15)
    assert scene.period == scene.horizon == pytest.approx(0.02, rel=1e-15)
    assert scene.damping.rayleigh.at == (3039.0, 4549.0)
    assert scene.loop_joints() == ("bore",)


def test_engine_has_the_sensors_of_its_interface():
    names = """tip_axial mid_axial mid_transverse mid_transverse_frame mid_global_x mid_global_y
    tip_transverse_frame rod_force_piston rod_mid_force rod_mid_strain crank_pin_force_x crank_pin_force_y
    piston_side_force main_bearing_force_x main_bearing_force_y crank_torque piston_position
    piston_acceleration rod_mid_acceleration_x rod_mid_acceleration_y""".split()
    sensors = read_scene("engine").sensors
    assert sorted(sensors) == sorted(names)
    assert sensors["mid_global_x"].axes == "global" and sensors["mid_axial"].axes == "body"
    assert sensors["rod_mid_acceleration_x"].reading == "accelerometer"
    assert sensors["piston_acceleration"].reading == "kinematic"
    assert {name: sensors[name].unit for name in ("tip_axial", "crank_torque", "rod_mid_strain")} == {
        "tip_axial": "m", "crank_torque": "N m", "rod_mid_strain": "1",
    }  # fmt: skip


@pytest.mark.parametrize("name", shipped_scenes())
def test_settings_go_over_what_was_changed_of_a_scene(name):
    """By `model_copy` of every table, and within one: what is set, shown and solved is one scene."""
    scene = read_scene(name)
    tables = ("bodies", "joints", "masses", "drives", "loads", "springs", "sensors")
    changed = {table: {key: entry.model_copy() for key, entry in getattr(scene, table).items()} for table in tables}
    body = next(iter(scene.bodies))
    mark, gravity = scene.vector((0.01, 0.0)), scene.vector((0.0, -1.5))
    points = {**scene.bodies[body].points, "mark": mark}
    changed["bodies"][body] = scene.bodies[body].model_copy(update={"points": points})
    changed |= {"gravity": gravity, "solve": scene.solve.model_copy(update={"steps": 77})}
    changed["sensors"] = dict(list(changed["sensors"].items())[:1])
    copy = scene.model_copy(update=changed | {"events": {}})
    found = with_settings(copy, ["solve.rho_infinity=0.5"])
    assert (found.bodies[body].points["mark"], found.gravity, found.solve.steps) == (mark, gravity, 77)
    assert found.solve.rho_infinity == 0.5 and scene.raw.get("gravity") != gravity
    expected = copy.model_copy(update={"solve": copy.solve.model_copy(update={"rho_infinity": 0.5})})
    assert found.model_dump() == expected.model_dump()
    assert pickle.loads(pickle.dumps(copy)).raw == copy.raw
    assert with_settings(found, []).raw == found.raw


def test_what_a_copy_has_no_longer_stays_away():
    scene = read_scene("engine").model_copy(update={"loads": {}, "damping": None})
    found = with_settings(scene, ["rod.elements=2"])
    assert not found.loads and found.damping is None and found.bodies["rod"].beam.elements == 2
    slower = scene.model_copy(update={"drives": {"main": scene.drives["main"].model_copy(update={"speed": 3.0})}})
    assert with_settings(slower, ["main.angle=5 deg"]).drives["main"].speed == 3.0
    assert with_settings(slower, ["main.speed=1 rpm"]).drives["main"].speed == pytest.approx(math.pi / 30)


def test_coordinates_of_joints_say_whether_they_turn_or_slide():
    scene = scene_of(machine(like="engine", sensors=dict(turn="position main angle", slide="position bore")))
    said = [scene.meaning_of(scene.sensors[name]) for name in ("turn", "slide")]
    assert said == ["position of joint main, rotation", "position of joint bore, translation"]


def test_three_cylinders_have_their_pins_and_gas_at_240_degrees():
    scene = read_scene("engine-3")
    for k in (1, 2, 3):
        x, y = scene.bodies["crank"].points[f"pin_{k}"]
        assert complex(x, y) == pytest.approx(0.04 * complex(*_direction(-240 * (k - 1))), abs=1e-15)
        assert scene.loads[f"gas_{k}"].offset == pytest.approx(math.radians(240 * (k - 1)))
    assert scene.bodies["rod_3"] == scene.bodies["rod_1"].model_copy(update={"like": None})
    assert scene.bodies["crank"].inertia == pytest.approx(3 * 0.952 * 0.04**2 / 3)
    assert scene.loop_joints() == ("bore_1", "bore_2", "bore_3")


def _direction(degrees):
    return math.cos(math.radians(degrees)), math.sin(math.radians(degrees))


def test_paper_scene_has_the_square_crank_and_no_damping():
    scene = read_scene("engine-paper")
    crank = scene.bodies["crank"]
    area = crank.E_A / crank.beam.E
    assert crank.beam.I == pytest.approx(area**2 / 12, rel=1e-12)
    assert crank.E_A == pytest.approx(6.37e8, rel=1e-3) and crank.E_I == pytest.approx(1.61e5, rel=1e-2)
    assert scene.damping is None and scene.period is None and scene.horizon == 0.04
    assert scene.joints["pin"].rotation == "shared" and scene.bodies["rod"].beam.elements == 1


def test_rig_scene_removes_the_gas_and_keeps_the_sensors():
    scene = read_scene("engine-rig")
    assert not scene.loads and scene.gravity == (-9.81, 0.0) and scene.horizon == 30.0
    assert scene.drives["main"].speed == pytest.approx(2 * math.pi * 0.706, rel=1e-12)
    assert list(scene.sensors) == list(read_scene("engine").sensors)


def test_defaults_points_and_reuse_of_a_body(four_bar):
    scene = read_scene(four_bar)
    rocker = scene.bodies["rocker"]
    assert scene.name == "four_bar" and list(scene.bodies) == ["crank", "coupler", "rocker"]
    assert (rocker.length, rocker.beam.elements, rocker.beam.E) == (0.25, 2, 7.2e10)
    assert rocker.mass == pytest.approx(2700 * 1e-4 * 0.25)
    assert scene.bodies["coupler"].beam.elements == 4
    assert scene.bodies["crank"].points_all == {
        "start": (0, 0), "mid": (0.05, 0), "end": (0.1, 0), "hole": (0.05, 0.01),
    }  # fmt: skip
    assert scene.point(Address("ground", "far")) == (0.3, 0.0)
    assert scene.point(scene.joints["a"].addresses[0]) == (0.1, 0.0)
    assert scene.loads["push"].direction == pytest.approx((0.6, 0.8))
    assert scene.loop_joints() == ("fixed",) and scene.period == pytest.approx(1.0)
    for value in (-0.0, -5e-17):  # the latter where a law passes through zero
        assert mechanism_of(scene).written_coordinate(next(iter(scene.drives)), value) == "0 deg"


def test_scene_file_may_start_from_a_file_beside_it(four_bar, tmp_path):
    (tmp_path / "table.csv").write_text("x,F\n0,1\n90,2\n180,2\n360,1\n")
    load = 'loads.push = {law = "none", table = "table.csv", against = "main"}'
    (tmp_path / "deeper").mkdir()
    (tmp_path / "second.toml").write_text(f'schema = 1\nlike = "four_bar.toml"\n{load}')
    (tmp_path / "deeper" / "third.toml").write_text('schema = 1\nlike = "../second.toml"')
    scene = read_scene(tmp_path / "deeper" / "third.toml")
    assert scene.name == "third" and scene.loads["push"].kind == "table"
    assert scene.loads["push"].read_table().y.tolist() == [1, 2, 2, 1]


def test_settings_by_short_and_long_paths():
    engine = read_scene("engine")
    settings = "rod.elements=1|drives.main.speed=3000 rpm|solve.steps=720|rod.E=70 GPa|gravity=[0, -9.81]"
    scene = with_settings(engine, settings.split("|"))
    assert scene.bodies["rod"].beam.elements == 1 and scene.bodies["rod"].beam.E == 7e10
    assert scene.drives["main"].speed == pytest.approx(100 * math.pi) and scene.period == pytest.approx(0.04)
    assert scene.solve.steps == 720 and scene.gravity == (0, -9.81)
    assert engine.bodies["rod"].beam.elements == 4 and engine.solve.steps is None
    assert with_settings(scene, ["rod.elements=2"]).solve.steps == 720
    lump = scene_of({"schema": 1, "like": "engine", "masses": {"lump": {"at": "rod.mid", "mass": 0.1}}})
    assert with_settings(lump, ["lump.mass=50 g"]).masses["lump"].mass == 0.05


@pytest.mark.parametrize("name", ["engine", "engine-rig-clearance", "four-bar-motor", "double-pendulum", "stick-slip"])
def test_settings_read_what_they_change_anew_and_nothing_else(name):
    before = read_scene(name)
    body = next(iter(before.bodies))
    after = with_settings(before, [f"bodies.{body}.mass=0.123", "solve.duration=1.5"])
    entire = _validated(after.raw, after.source)
    assert after == entire and after.raw == entire.raw and structure_of(after) == structure_of(entire)
    assert after.bodies[body].mass == 0.123 and after.solve.duration == 1.5
    for other in before.bodies.keys() - {body}:
        assert after.bodies[other] is before.bodies[other]
    assert after.contacts == entire.contacts and after.joints == entire.joints


def test_settings_are_checked_with_what_they_leave_as_it_was():
    with pytest.raises(SceneError, match=r"rho A length is .* kg"):
        with_settings(read_scene("engine"), ["rod.beam.A=100 mm^2", "rod.length=200 mm"])
    with pytest.raises(SceneError, match=r"sensors\.tip_axial.*no body"):
        with_settings(read_scene("engine"), ["sensors.tip_axial.displacement=rot.end"])


def test_setting_none_removes_but_reduction_has_a_word_none():
    settings = ["loads.gas=none", "damping=none", "solve.reduction=modal", "solve.reduction=none"]
    scene = with_settings(read_scene("engine"), settings)
    assert not scene.loads and scene.damping is None and scene.solve.reduction == "none"


def test_setting_a_whole_table_adds_an_entry():
    scene = with_settings(read_scene("engine"), ["loads.knock={force_on = 'rod.mid', direction = [0, 1], value = 3}"])
    assert [*scene.loads] == ["gas", "knock"]


@pytest.mark.parametrize(("setting", "message"), [
    ("rod.elemens=1", "rod.elemens = '1': 'rod' has no such entry. The nearest known one is 'elements'."),
    ("rodd.elements=1", "rodd.elements = '1': the scene has no 'rodd'. The nearest known one is 'rod'."),
    ("main.rotation=free", "main.rotation = 'free': this path is ambiguous. "
     "Write joints.main.rotation or drives.main.rotation."),
    ("solve.step=3", "solve.step = '3': no key 'step' there. The nearest known one is 'steps'."),
    ("drives.mai.speed=1", "drives.mai.speed = '1': the scene has no 'mai' among its drives. "
     "The nearest known one is 'main'; a whole table adds it: drives.mai={...}."),
    ("crank.speed=0", "crank.speed = '0': 'crank' has no such entry. Write main.speed, of the drive."),
    ("gravity.1=-9.81", "gravity.1 = '-9.81': gravity is not a table. Give all of it: gravity=VALUE."),
    ("rod", "setting = 'rod': not of the form path=value. Write it like rod.elements=1."),
    ("rod.elements=0", "bodies.rod.beam.elements = 0: too few. Write a whole number of one or more."),
])  # fmt: skip
def test_bad_settings(setting, message):
    with pytest.raises(SceneError) as caught:
        with_settings(read_scene("engine"), [setting])
    assert str(caught.value) == message


def test_structure_holds_topology_and_zeros_only():
    found = structure_of(read_scene("engine"))
    assert found["bodies"]["rod"] == {"elastic": True, "mass": "*", "inertia": "*", "centre": ["*", 0]}
    assert found["joints"]["bore"] == {
        "kind": "prismatic",
        "between": ["ground.origin", "piston.start"],
        "direction": [1, 0],
        "closes_loop": True,
    }
    assert found["loads"]["gas"] == {
        "on": "piston.start", "axes": "global", "direction": [-1, 0], "kind": "table", "against": "main",
    }  # fmt: skip
    assert found["gravity"] == [0, 0]
    assert json.loads(json.dumps(found)) == found


def test_structure_of_named_points_and_laws(four_bar):
    found = structure_of(read_scene(four_bar))
    assert found["points"] == {"crank.hole": ["*", "*"], "ground.far": ["*", 0]}
    assert found["loads"]["push"]["law"] == "5 * sin(main) + main_speed * t"
    assert found["loads"]["push"]["direction"] == ["*", "*"]


RUN_TIME = """rod.length=150 mm|rod.elements=1|rod.I=1e-8|crank.mass=2|drives.main.speed=100 rpm
drives.main.angle=1|solve.preset=linear|solve.modes=3|solve.integrator=gauss|bore.branch=-|damping=none|solve.start=zero
sensors.tip_axial=none|loads.gas.closing=0.5|pin.rotation=shared""".replace("\n", "|").split("|")


DERIVED = ["loads.gas=none", "gravity=[0, -9.81]", "piston.inertia=1e-6", "bore.direction=[0.8, 0.6]", "gas.axes=body",
           "crank.centre=[0.01, 0.002]", 'bodies.crank.beam={material = "steel", I = 1e-6}']


@pytest.mark.parametrize(("setting", "same"), [(text, text in RUN_TIME) for text in (*RUN_TIME, *DERIVED)])
def test_the_structure_changes_by_what_the_equations_depend_on_alone(setting, same):
    engine = read_scene("engine")
    assert (structure_hash(with_settings(engine, [setting])) == structure_hash(engine)) == same


def test_structure_keeps_the_order_of_the_file_which_the_equations_are_derived_in(four_bar):
    """Not that of the names: a scene that is renamed has the same equations."""
    lines = FOUR_BAR.splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("bodies."))
    lines[at : at + 3] = [lines[at + 2], lines[at + 1], lines[at]]
    other = scene_of("\n".join(lines))
    found, plain = structure_of(other), structure_of(read_scene(four_bar))
    assert found == plain and [*found["bodies"]] == [*plain["bodies"]][::-1]
    assert structure_hash(other) != structure_hash(read_scene(four_bar))


def test_structure_hash_is_the_same_over_hash_seeds():
    code = "from kaneflex.scene import read_scene, structure; print(structure.structure_hash(read_scene('engine-3')))"
    command = [sys.executable, "-c", code]
    first, second = (
        subprocess.run(command, env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, check=True)
        for seed in ("1", "2")
    )
    assert first.stdout == second.stdout != b""


def test_json_schema_describes_every_table():
    schema = json_schema()
    assert set(schema["properties"]) == {
        "schema", "like", "name", "description", "assumptions", "gravity", "ground", "bodies", "joints", "masses",
        "drives", "loads", "springs", "contacts", "damping", "sensors", "events", "solve",
    }  # fmt: skip
    assert schema["$defs"]["Beam"]["additionalProperties"] is False
    assert schema["$defs"]["Beam"]["properties"]["elements"]["minimum"] == 1
    assert "required" not in json.dumps(schema)
    assert {"const": "none"} in schema["properties"]["loads"]["additionalProperties"]["anyOf"]


def test_common_units_are_those_of_pint():
    import pint  # takes a second, which only one of several processes needs

    registry = pint.UnitRegistry()
    one = [prefix + unit for prefix in units._PREFIXES for unit in units._UNITS if unit not in ("%", "1") or not prefix]
    for unit in [*units._COMMON, *one, "mN m", "kN/mm^2", "N mm/deg", "g/cm^3", "1/ms", "kg m/s^2", "W/rpm", "N/m/s"]:
        factor, powers = units._read(unit)
        by_pint, root = registry.get_root_units(registry.parse_units(unit))
        assert powers == [root._units.get(name, 0) for name in ("meter", "gram", "second", "radian")], unit
        assert by_pint * 1e-3 ** root._units.get("gram", 0) == pytest.approx(factor, rel=1e-14), unit
    assert [units._read(unit)[1] for unit in ("N/m s", "m  s", "", "m/", "k%", "min", "m^-1", "m^0")] == [None] * 8


@pytest.mark.parametrize(("text", "dimension", "expected"), [
    ("137 mm", LENGTH, 0.137),
    ("-5.4 inch", LENGTH, -0.13716),
    ("7008 mm^4", SECOND_MOMENT, 7.008e-9),
    ("2 turn/s", ANGULAR_SPEED, 4 * math.pi),
    (3, LENGTH, 3.0),
])  # fmt: skip
def test_units(text, dimension, expected):
    assert to_si(text, dimension) == pytest.approx(expected, rel=1e-15)


def test_decimal_prefixes_are_exact():
    assert 9 * 1e-3 != 0.009
    assert to_si("9 mm", LENGTH) == 0.009


@pytest.mark.parametrize(("text", "dimension"), [("0.706 Hz", ANGULAR_SPEED), ("60 rpm", FREQUENCY)])
def test_turns_and_frequencies_are_not_mixed_up(text, dimension):
    with pytest.raises(ValueError, match="is not a unit of"):
        to_si(text, dimension)


@pytest.mark.parametrize("name", ["engine", "rotating-cantilever", "pulsating-strut"])
def test_a_scene_that_was_used_can_be_sent_to_another_process(name):
    scene = read_scene(name)
    kaneflex.load(scene)
    assert pickle.loads(pickle.dumps(scene)) == scene
