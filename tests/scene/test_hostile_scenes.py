"""Typical mistakes in scenes, and scenes that nobody would write: each is refused by its key, with the way out."""

import os
import tomllib
import zipfile
from importlib.resources import files

import numpy as np
import pytest
from command_line import cli, refused
from scene_fuzz import Mutants, broken

from kaneflex import SceneError, load, read_scene, shipped_scenes, simulate, with_settings
from kaneflex.scene.modal_data import read_modal_data
from kaneflex.support.mistakes import toml_advice
from kaneflex.support.units import LENGTH, to_si

ENGINE = shipped_scenes()["engine"]
GAS = (ENGINE.parent / "gas.csv").read_text()
BATCH, BATCHES = 500, 4
ROD, CRANK = '"137 mm"', 'crank = {length = "40 mm", mass = "0.952 kg"}'
LINE_OF_ROD = ENGINE.read_text().partition(ROD)[0].count("\n") + 1


@pytest.mark.exhaustive
@pytest.mark.parametrize("batch", range(BATCHES))
def test_mutated_scenes_are_read_or_refused(batch, tmp_path):
    """20,000 more with `make extremes`."""
    seeds = range(batch * BATCH, (batch + 1) * BATCH)
    assert broken(Mutants(tmp_path), seeds, limit=20.0) == []


def _read(folder, old="", new="", gas=GAS):
    text = ENGINE.read_text()
    assert old in text
    (folder / "scene.toml").write_text(text.replace(old, new, 1))
    if isinstance(gas, str):
        (folder / "gas.csv").write_text(gas)
    return read_scene(folder / "scene.toml")


@pytest.mark.parametrize(("old", "new", "key", "reason"), [
    (ROD, '"1 m/0"', "bodies.rod.length", "unknown unit 'm/0'"),
    (ROD, '"1 m**9**9**9**9"', "bodies.rod.length", "unknown unit 'm**9**9**9**9'"),
    (ROD, '"1 m^(9^9^9^9)"', "bodies.rod.length", "unknown unit 'm^(9^9^9^9)'"),
    (ROD, f'"1 {"m*" * 90}m"', "bodies.rod.length", "'m*m*m*"),
    (ROD, f'"1 {"m" * 50_000}"', "bodies.rod.length", "not a number with a unit; a length is required"),
    (ROD, f'"1{" " * 50_000}m"', "bodies.rod.length", "not a number with a unit; a length is required"),
    (ROD, "9" * 400, "bodies.rod.length", "not a finite number"),
    (ROD, f"0x{'f' * 5000}", "bodies.rod.length", "not a finite number"),
    ("schema = 1", "schema = 1\ngravity = [0, 1e59]", "gravity", "beyond 1e+15 m/s^2 the motion can't be integrated"),
    ("[joints]", "[contacts]\nc = {point_on_line = ['rod', 'ground'], normal = [0, 1], contact = {materials = "
     "['steel', ['steel']], restitution = 1}}\n[joints]", "contacts.c.contact.materials", "unknown material ['steel']"),
    (ROD, "9" * 5000, "scene", f"line {LINE_OF_ROD}: a whole number of 5000 digits"),
    ("elements = 4", f"elements = 1{'0' * 29}", "bodies.rod.beam.elements", "more than 1,000,000,000"),
    ("elements = 4", f"elements = 0x{'f' * 5000}", "bodies.rod.beam.elements", "more than 1,000,000,000"),
    (CRANK, f'{CRANK}\nx = "crank"\ny = {{like = "x"}}', "bodies.y.like", "that body is not a table"),
    (CRANK, f"{CRANK}\n{'x' * 200} = {{mass = 1}}", f"bodies.{'x' * 93}", "a name of more than 100 characters"),
    ("schema = 1", f'schema = 1\nlike = "{"x" * 5000}"', "like", "no shipped scene and no file of that name"),
    ("schema = 1", 'schema = 1\nlike = "x\\u0000"', "like", "no shipped scene and no file of that name"),
    ("schema = 1", "schema = 1\nx = " + "[" * 5000, "scene", "lists or tables are nested too deeply"),
    ("[bodies]", "[bodies]\nx" + ".x" * 500 + " = 1", "scene", "tables are nested more than 20 deep"),
    ('"gas.csv"', '"x\\u0000"', "loads.gas.table", "cannot be read: embedded null byte"),
    ('"gas.csv"', f'"{"x" * 5000}"', "loads.gas.table", "cannot be read: File name too long"),
    ('"gas.csv"', '"."', "loads.gas.table", "cannot be read: it is a folder"),
    ('"gas.csv"', '"/dev/zero"', "loads.gas.table", "cannot be read: it is a pipe or a device"),
], ids=lambda text: text[:30])  # fmt: skip
def test_a_value_beyond_all_reason_is_refused_by_its_key(old, new, key, reason, tmp_path):
    with pytest.raises(SceneError) as caught:
        _read(tmp_path, old, new)
    assert caught.value.key == key
    assert caught.value.reason.startswith(reason)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(("gas", "reason"), [
    ('a,F_gas_N\n0,0\n"1\n2",1\n720,0\n', "gas.csv, line 3: a quoted cell is not closed"),
    ("a,F_gas_N\n0,0\n100,1e308\n200,-1e308\n720,0\n", "gas.csv, line 3: 1e+308 is beyond 1e+60"),
    ("a,F_gas_N\n0,0\n1e-320,1\n2e-320,1\n720,0\n", "gas.csv, line 3: 9.99989e-321 is not above 0"),
    (f"a,F_gas_N\n0,0\n1,{'0' * 200_000}\n720,0\n", "gas.csv, line 3: field larger than field limit (131072)"),
    (f"a,F_gas_N\n0,0\n1,{'x' * 1000}\n2,0\n720,0\n", f"gas.csv, line 3: '{'x' * 40}' is not a finite number"),
])  # fmt: skip
def test_a_table_beyond_all_reason_is_refused(gas, reason, tmp_path):
    with pytest.raises(SceneError) as caught:
        _read(tmp_path, gas=gas)
    assert (caught.value.key, caught.value.reason) == ("loads.gas.table", reason)


def test_a_pipe_in_the_place_of_a_table_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "gas.csv")
    with pytest.raises(SceneError, match=r"^loads\.gas\.table = .*it is a pipe or a device"):
        _read(tmp_path, gas=None)


def test_an_archive_of_arrays_is_asked_for_its_size_before_it_unpacks(tmp_path):
    """Zeros compress a thousandfold."""
    bomb = tmp_path / "rod.npz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("mass.npy", "w") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (10_000_000,)})
        for _ in range(80):
            file.write(bytes(1_000_000))
    assert bomb.stat().st_size < 1e6
    with pytest.raises(ValueError, match=r"^has 76 MiB, the limit is 64 MiB\."):
        read_modal_data(str(bomb))


@pytest.mark.parametrize("header", [(10**15,), (10**30,), (-1,), "x"])
def test_an_array_that_claims_more_than_it_holds_is_refused(header, tmp_path):
    with zipfile.ZipFile(tmp_path / "rod.npz", "w") as archive, archive.open("mass.npy", "w") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": header})
        file.write(bytes(8))
    with pytest.raises(ValueError, match=r"^cannot be read: "):
        read_modal_data(str(tmp_path / "rod.npz"))


@pytest.mark.parametrize("text", ["5 1/m", "1 m**0.5", "1 m^-1/m^-2", "1 kg m^2/(kg m)", "2e-3 km"])
def test_units_are_still_products_of_powers(text):
    if text in ("1 kg m^2/(kg m)", "2e-3 km", "1 m^-1/m^-2"):
        assert to_si(text, LENGTH) == pytest.approx({"2e-3 km": 2.0}.get(text, 1.0))
    else:
        with pytest.raises(ValueError, match="is not a unit of length"):
            to_si(text, LENGTH)


def test_a_byte_order_mark_is_no_error(tmp_path):
    (tmp_path / "scene.toml").write_bytes(b"\xef\xbb\xbf" + ENGINE.read_bytes())
    (tmp_path / "gas.csv").write_text(GAS)
    assert read_scene(tmp_path / "scene.toml").bodies == read_scene("engine").bodies


@pytest.mark.parametrize("value", ["9" * 5000, "[" * 5000, f"0x{'f' * 5000}"])
def test_settings_beyond_all_reason_are_refused(value):
    with pytest.raises(SceneError, match=r"^bodies\.rod\.length = "):
        with_settings(read_scene("engine"), [f"rod.length={value}"])


def test_a_run_of_millions_of_steps_between_two_instants_ends_by_name(monkeypatch):
    """A pendulum of a million turns a second, which a run would follow for hours."""
    monkeypatch.setattr("kaneflex.multibody.time.run._PATIENCE", 2000)
    fast = ["solve.preset=coupled", "gravity=[0, -1e12]", "solve.steps=2", "solve.duration=1 s", "solve.errors=none"]
    solution = simulate(load(with_settings(read_scene("double-pendulum"), fast)))
    assert solution.outcome.name == "STUCK" and "2,000 steps after t = 0 s" in solution.trajectory.message


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
    "bodies.crank = {}\n[bodies.crank.points]\n": ("line 2 defines bodies.crank.points a second", "be continued"),
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
