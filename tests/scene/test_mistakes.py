"""Typical mistakes in scene files, as `kaneflex check` answers them: by the entry, its value and the fix.

What the reader refuses is in test_bad_scenes.py, with its exact message."""

import tomllib
from importlib.resources import files

import pytest
from command_line import cli, refused

from kaneflex.support.mistakes import toml_advice

SCENE = (files("kaneflex.scene") / "template.toml").read_text(encoding="utf-8")
MISTAKES = {  # what is replaced by what in the template; how the answer begins and ends
    "no drive": ('[drives]\nmain = {speed = "1500 rpm", cycle = "360 deg"}', "", "Error: solve.duration",
        "Give a drive, like drives.main = {speed = '1500 rpm', cycle = '360 deg'}, or solve.duration"),
    "missing pin": ('pin = {revolute = ["crank.end", "rod.start"]}\n', "", "Error: joints.guide.branch = '+'",
        'Add the missing joint, like pin = {revolute = ["crank.end", "rod.start"]}, or leave branch out'),
    "wrong point": ('["crank.end", "rod.start"]', '["crank.end", "rod.begin"]',
        "Error: joints.pin.revolute = 'rod.begin'", "Known: end, mid, start"),
    "unknown kind of joint": ("pin = {revolute", "pin = {hinge",
        "Error: joints.pin.hinge = ['crank.end', 'rod.start']",
        "Known: axes, axis, branch, clearance, cylindrical, direction, friction, near, prismatic, "
        "relative_angle, revolute, rotation, spherical, universal, weld"),
    "unknown section": ("rectangle = [", "square = [",
        "Error: bodies.rod.beam.section.square = ['20 mm', '12 mm']", "Known: I, circle, rectangle, tube"),
    "loop cannot close": ('length = "200 mm"', 'length = "40 mm"',
        "Error: joints.guide.branch = '+'", "Change the lengths, or limit the drive's range"),
    "drive of the dependent joint": ('main = {speed = "1500 rpm", cycle = "360 deg"}',
        'main = {speed = "1500 rpm", cycle = "360 deg"}\nwrist = {speed = "10 rpm"}',
        "Error: drives.wrist", "Leave a joint or a drive out, or give every body a pose for a fixed structure"),
    "drive without motion": ('main = {speed = "1500 rpm", cycle = "360 deg"}', 'main = {cycle = "360 deg"}',
        "Error: drives.main", "Give exactly one of speed, law, table, free"),
    "cycle in degrees as a number": ('cycle = "360 deg"', "cycle = 360",
        "Error: drives.main.cycle = 360", "Give a multiple of 360 deg; plain numbers are in rad"),
    "law with a power sign": (
        "400*sin(main)", "400*main^2", "Error: loads.work.law = '400 + 400*main^2'", "Write ** for a power, like t**2",
    ),
    "unknown component": ('component = "x"}\ntorque', 'component = "horizontal"}\ntorque',
        "Error: sensors.pin_force.component = 'horizontal'", "Write one of these"),
    "gravity of one component": ('gravity = [0, "-9.81 m/s^2"]', "gravity = -9.81",
        "Error: gravity = -9.81", "Write two components, [x, y], or three in space"),
    "damping above one": (
        'ratio = "1 %"', "ratio = 5", "Warning: damping.rayleigh.ratio = 5", "write per cent with the sign, like '2 %'",
    ),
    "angle in degrees as a number": ('cycle = "360 deg"}', 'cycle = "360 deg", angle = 90}',
        "Warning: drives.main.angle = 90", "write '90 deg' with its unit where degrees are meant"),
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
