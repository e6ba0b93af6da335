"""Typical mistakes in scene files: each answer names the entry, its value and the fix."""

import tomllib
from importlib.resources import files

import pytest
from command_line import cli, refused

from kaneflex.support.mistakes import toml_advice

SCENE = (files("kaneflex.scene") / "template.toml").read_text(encoding="utf-8")
MISTAKES = {  # what is replaced by what in the template; how the answer begins and ends
    "misspelled key": (
        'length = "200 mm"', 'lenght = "200 mm"',
        "Error: bodies.rod.lenght = '200 mm'", "The nearest known one is 'length'",
    ),
    "misspelled table": ("[sensors]", "[sensor]", "Error: sensor", "The nearest known one is 'sensors'"),
    "schema left out": ("schema = 1\n", "", "Error: schema", "Write schema = 1 first"),
    "misspelled unit": (
        'length = "200 mm"', 'length = "200 milimeter"',
        "Error: bodies.rod.length = '200 milimeter'", "Write 'mm'",
    ),
    "decimal comma": (
        'length = "200 mm"', 'length = "200,5 mm"',
        "Error: bodies.rod.length = '200,5 mm'", "Write a point, as 50.5 mm, where a comma separates decimals",
    ),
    "unit of another dimension": (
        'length = "200 mm"', 'length = "200 kg"',
        "Error: bodies.rod.length = '200 kg'", "Write a length like '137 mm', or a plain number in m",
    ),
    "number in quotes without unit": (
        'length = "200 mm"', 'length = "200"',
        "Error: bodies.rod.length = '200'", "Write a length like '137 mm', or a plain number in m",
    ),
    "unit without quotes": (
        'length = "200 mm"', "length = 200 mm",
        "Error: scene = 'mine.toml': line 11 is not TOML: length = 200 mm",
        'Write a number with a unit in quotes, like "50 mm"',
    ),
    "capitals of a unit": (
        'length = "200 mm"', 'length = "200 MM"',
        "Error: bodies.rod.length = '200 MM'", "Write 'mm': capitals count",
    ),
    "missing closing brace": (
        'mass = "0.5 kg"', 'beam = {material = "steel"',
        'Error: scene = \'mine.toml\': line 14 is not TOML: beam = {material = "steel"',
        "Write a table in braces on one line, or give it a header like [joints.main] and one key a line",
    ),
    "text without quotes": (
        'material = "steel"', "material = steel",
        "Error: scene = 'mine.toml': line 12 is not TOML: beam = {material = steel, section = {rectangle = "
        '["20 mm", "12 mm"]}, elements = 4}',
        'Write a text in quotes, like "steel"',
    ),
    "missing quote": (
        'mass = "0.5 kg"', 'mass = "0.5 kg',
        'Error: scene = \'mine.toml\': line 14 is not TOML: mass = "0.5 kg', "Close the quotes in this line",
    ),
    "line break in braces": (
        'wrist = {revolute = ["rod.end", "slider"]}', 'wrist = {revolute = ["rod.end", "slider"],\n  branch = "+"}',
        'Error: scene = \'mine.toml\': line 21 is not TOML: wrist = {revolute = ["rod.end", "slider"],',
        "Write a table in braces on one line, or give it a header like [joints.main] and one key a line",
    ),
    "table twice": (
        "[bodies.slider]", "[bodies.rod]",
        "Error: scene = 'mine.toml': line 13 defines bodies.rod a second time",
        "Rename one of them, or write their keys under one header",
    ),
    "name twice": (
        "torque = {drive_torque", "pin_force = {drive_torque",
        'Error: scene = \'mine.toml\': line 40 is not TOML: pin_force = {drive_torque = "main"} '
        "(the key already has a value)",
        "Give each key once",
    ),
    "colon for equals": (
        'mass = "0.5 kg"', 'mass: "0.5 kg"',
        'Error: scene = \'mine.toml\': line 14 is not TOML: mass: "0.5 kg"', "Write = between a key and its value",
    ),
    "header not closed": (
        "[bodies.slider]", "[bodies.slider",
        "Error: scene = 'mine.toml': line 13 is not TOML: [bodies.slider", "Close the header with ], like [bodies.rod]",
    ),
    "no drive": (
        '[drives]\nmain = {speed = "1500 rpm", cycle = "360 deg"}', "",
        "Error: solve.duration",
        "Give a drive, like drives.main = {speed = '1500 rpm', cycle = '360 deg'}, or solve.duration",
    ),
    "missing pin": (
        'pin = {revolute = ["crank.end", "rod.start"]}\n', "",
        "Error: joints.guide.branch = '+'",
        'Add the missing joint, like pin = {revolute = ["crank.end", "rod.start"]}, or leave branch out',
    ),
    "unknown body": (
        '["crank.end", "rod.start"]', '["crank.end", "rodd.start"]',
        "Error: joints.pin.revolute = 'rodd.start'", "The nearest known one is 'rod'",
    ),
    "wrong point": (
        '["crank.end", "rod.start"]', '["crank.end", "rod.begin"]',
        "Error: joints.pin.revolute = 'rod.begin'", "Known: end, mid, start",
    ),
    "same body": (
        '["crank.end", "rod.start"]', '["crank.end", "crank.start"]',
        "Error: joints.pin.revolute = ['crank.end', 'crank.start']", "Join two bodies",
    ),
    "one point": (
        '["crank.end", "rod.start"]', '["crank.end"]',
        "Error: joints.pin.revolute = ['crank.end']", "Write two addresses, like ['crank.end', 'rod.start']",
    ),
    "unknown kind of joint": (
        "pin = {revolute", "pin = {hinge",
        "Error: joints.pin.hinge = ['crank.end', 'rod.start']",
        "Known: axes, axis, branch, clearance, cylindrical, direction, friction, near, prismatic, "
        "relative_angle, revolute, rotation, spherical, universal, weld",
    ),
    "guide without direction": (
        ", direction = [1, 0], branch", ", branch",
        "Error: joints.guide", "Give it, like direction = [1, 0], in space [1, 0, 0]",
    ),
    "direction of zero": (
        "direction = [1, 0], branch", "direction = [0, 0], branch",
        "Error: joints.guide.direction = [0, 0]", "Write two components, like [1, 0], or three in space",
    ),
    "zero length": ('length = "200 mm"', "length = 0", "Error: bodies.rod.length = 0", "Write one like '137 mm'"),
    "negative mass": (
        'mass = "0.5 kg"', 'mass = "-0.5 kg"',
        "Error: bodies.slider.mass = '-0.5 kg'", "Write one like '0.153 kg'",
    ),
    "negative section": (
        '"20 mm", "12 mm"', '"-20 mm", "12 mm"',
        "Error: bodies.rod.beam.section.rectangle = ['-20 mm', '12 mm']", "Write [height, width]",
    ),
    "unknown section": (
        "rectangle = [", "square = [",
        "Error: bodies.rod.beam.section.square = ['20 mm', '12 mm']", "Known: I, circle, rectangle, tube",
    ),
    "one side of a rectangle": (
        '["20 mm", "12 mm"]', '["20 mm"]',
        "Error: bodies.rod.beam.section.rectangle = ['20 mm']", "Write [height, width]",
    ),
    "unknown material": (
        'material = "steel"', 'material = "stel"',
        "Error: bodies.rod.beam.material = 'stel'", "The nearest known one is 'steel'",
    ),
    "beam without section": (
        ', section = {rectangle = ["20 mm", "12 mm"]}', "",
        "Error: bodies.rod.beam.I", "Give I, or a section by its shape",
    ),
    "no elements": (
        "elements = 4", "elements = 0",
        "Error: bodies.rod.beam.elements = 0", "Write a whole number of one or more",
    ),
    "wrong branch": (', branch = "+"}', ', branch = "up"}', "Error: joints.guide.branch = 'up'", "Write one of these"),
    "loop cannot close": (
        'length = "200 mm"', 'length = "40 mm"',
        "Error: joints.guide.branch = '+'", "Change the lengths, or limit the drive's range",
    ),
    "drive on unknown joint": (
        "main = {speed", "motor = {speed",
        "Error: drives.motor", "Known: guide, main, pin, wrist",
    ),
    "drive of the dependent joint": (
        'main = {speed = "1500 rpm", cycle = "360 deg"}',
        'main = {speed = "1500 rpm", cycle = "360 deg"}\nwrist = {speed = "10 rpm"}',
        "Error: drives.wrist", "Leave a joint or a drive out, or give every body a pose for a fixed structure",
    ),
    "drive without motion": (
        'main = {speed = "1500 rpm", cycle = "360 deg"}', 'main = {cycle = "360 deg"}',
        "Error: drives.main", "Give exactly one of speed, law, table, free",
    ),
    "speed in Hz": (
        '"1500 rpm"', '"25 Hz"',
        "Error: drives.main.speed = '25 Hz'", "Write an angular speed like '6000 rpm', or a plain number in rad/s",
    ),
    "speed in m/s": (
        '"1500 rpm"', '"3 m/s"',
        "Error: drives.main.speed = '3 m/s'", "Write an angular speed like '6000 rpm', or a plain number in rad/s",
    ),
    "cycle in degrees as a number": (
        'cycle = "360 deg"', "cycle = 360",
        "Error: drives.main.cycle = 360", "Give a multiple of 360 deg; plain numbers are in rad",
    ),
    "force on unknown body": (
        'force_on = "slider"', 'force_on = "sliders"',
        "Error: loads.work.force_on = 'sliders.start'", "The nearest known one is 'slider'",
    ),
    "force without direction": (
        "direction = [-1, 0]\nlaw", "law",
        "Error: loads.work.direction", "Give it, like direction = [1, 0], in space [1, 0, 0]",
    ),
    "law with unknown name": (
        "400*sin(main)", "400*sin(crank)",
        "Error: loads.work.law = '400 + 400*sin(crank)'",
        "Known: guide, guide_speed, main, main_speed, pi, pin, pin_speed, t, wrist, wrist_speed",
    ),
    "law with a power sign": (
        "400*sin(main)", "400*main^2",
        "Error: loads.work.law = '400 + 400*main^2'", "Write ** for a power, like t**2",
    ),
    "sensor on unknown point": (
        'axial_force = "rod.mid"', 'axial_force = "rod.middle"',
        "Error: sensors.rod_force.axial_force = 'rod.middle'", "The nearest known one is 'mid'",
    ),
    "sensor of unknown kind": (
        'axial_force = "rod.mid"', 'normal_force = "rod.mid"',
        "Error: sensors.rod_force.normal_force = 'rod.mid'", "The nearest known one is 'axial_force'",
    ),
    "strain of rigid body": (
        'strain = "rod.mid"', 'strain = "crank.mid"',
        "Error: sensors.rod_strain.strain = 'crank.mid'", "Give the body a beam",
    ),
    "strain without fibre": (
        ', fibre = "10 mm"', "",
        "Error: sensors.rod_strain", "Give fibre, its height above the axis",
    ),
    "unknown component": (
        'component = "x"}\ntorque', 'component = "horizontal"}\ntorque',
        "Error: sensors.pin_force.component = 'horizontal'", "Write one of these",
    ),
    "joint force of unknown joint": (
        'joint_force = "pin"', 'joint_force = "pins"',
        "Error: sensors.pin_force.joint_force = 'pins'", "The nearest known one is 'pin'",
    ),
    "torque of a joint without drive": (
        'drive_torque = "main"', 'drive_torque = "pin"',
        "Error: sensors.torque.drive_torque = 'pin'", "Known: main",
    ),
    "unknown preset": (
        'preset = "stiffened"', 'preset = "stiffend"',
        "Error: solve.preset = 'stiffend'", "The nearest known one is 'stiffened'",
    ),
    "gravity of one component": (
        'gravity = [0, "-9.81 m/s^2"]', "gravity = -9.81",
        "Error: gravity = -9.81", "Write two components, [x, y], or three in space",
    ),
    "damping above one": (
        'ratio = "1 %"', "ratio = 5",
        "Warning: damping.rayleigh.ratio = 5", "write per cent with the sign, like '2 %'",
    ),
    "two parts not joined": (
        'wrist = {revolute = ["rod.end", "slider"]}\n', "",
        "Error: joints.guide.branch = '+'",
        'Add the missing joint, like pin = {revolute = ["rod.end", "slider"]}, or leave branch out',
    ),
    "angle in degrees as a number": (
        'cycle = "360 deg"}', 'cycle = "360 deg", angle = 90}',
        "Warning: drives.main.angle = 90", "write '90 deg' with its unit where degrees are meant",
    ),
    "mass as text without number": (
        'mass = "0.5 kg"', 'mass = "heavy"',
        "Error: bodies.slider.mass = 'heavy'", "Write a mass like '0.153 kg', or a plain number in kg",
    ),
    "key in the wrong table": (
        'length = "200 mm"', 'length = "200 mm"\nelements = 4',
        "Error: bodies.rod.elements = 4", "It belongs to bodies.rod.beam",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_answer_names_entry_value_and_fix(mistake, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    old, new, begin, fix = MISTAKES[mistake]
    assert SCENE.count(old) == 1
    (tmp_path / "mine.toml").write_text(SCENE.replace(old, new), encoding="utf-8")
    result = cli("check", "mine.toml")
    assert result.exit_code == (2 if begin.startswith("Error") else 0)
    lines = result.stderr.splitlines()
    assert [line for line in lines if line.startswith(begin) and line.rstrip(".").endswith(fix)], result.stderr


def test_a_study_that_is_no_toml_is_answered_like_a_scene(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('scene = "engine"\n[parameters]\nrod.length = [137 mm]\n', encoding="utf-8")
    refused(cli("sweep", path), "line 3 is not TOML: rod.length = [137 mm]", "in quotes, like \"50 mm\"")


BROKEN = {
    "[bodies.crank]\n[bodies.crank]\n": ("line 2 defines bodies.crank a second time", "Rename one"),
    "a = 1\na = 2\n": ("line 2 is not TOML: a = 2 (the key already has a value)", "Give each key once"),
    "a = 50 mm\n": ("line 1 is not TOML: a = 50 mm", 'in quotes, like "50 mm"'),
    "a = 4,5\n": ("line 1 is not TOML: a = 4,5", "a decimal point"),
    "main = {revolute = 1,\n  branch = 2}\n": ("line 1 is not TOML: main = {revolute = 1,", "in braces on one line"),
    "material = steel\n": ("line 1 is not TOML: material = steel", 'in quotes, like "steel"'),
    "a\n": ("line 1 is not TOML: a (Expected '='", "Write lines like key = "),
    'a = "': ("line 1 is not TOML: a = \"", "Close the quotes in this line"),
    'a = "50 mm\nb = 1': ("line 1 is not TOML: a = \"50 mm", "Close the quotes in this line"),
    "[bodies.rod\n": ("line 1 is not TOML: [bodies.rod", "Close the header with ]"),
    'mass: "1 kg"\n': ("line 1 is not TOML: mass: ", "Write = between a key and its value"),
}


@pytest.mark.parametrize("text", BROKEN)
def test_the_line_and_its_cure_are_named(text):
    with pytest.raises(tomllib.TOMLDecodeError) as found:
        tomllib.loads(text)
    reason, cure = toml_advice(str(found.value), text)
    expected, advice = BROKEN[text]
    assert reason.startswith(expected) and advice in cure
