"""The command line: what it prints and refuses, with which exit code, and conventions that all commands share."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete
from command_line import cli, refused
from machines import machine
from places import ROOT
from runs import shipped

import kaneflex
from kaneflex import SceneError, load, read_scene, simulate, with_settings
from kaneflex.cli.commands import GROUPS, main
from kaneflex.fem.mobility import check_determined
from kaneflex.integrate.methods import METHODS
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.module_loading import find_module
from kaneflex.scene import json_schema
from kaneflex.scene.parts import PRESETS
from kaneflex.scene.structure import structure_hash

pytestmark = pytest.mark.usefixtures("empty_folder")


# ---- help and lists ---------------------------------------------------------------------------------------------


def test_help_names_every_command_and_imports_nothing_heavy(tmp_path):
    code = """
import sys
from kaneflex.cli import main
try:
    main(["--help"])
except SystemExit:
    pass
heavy = ("numpy", "numba", "scipy", "sympy", "xarray", "pint", "pydantic", "matplotlib")
print([name for name in heavy if name in sys.modules])
"""
    shown = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert shown.stdout.splitlines()[-1] == "[]"
    for command in ("list", "check", "run", "modes", "derive"):
        assert re.search(rf"^  {command} ", shown.stdout, re.MULTILINE)


def test_list_shows_scenes_presets_and_integrators_with_their_descriptions():
    shown = cli("list").stdout
    described = {name: scene.description for name, scene in shipped().items()}
    described |= PRESETS | {name: method.description for name, method in METHODS.items()}
    for name, text in described.items():
        assert re.search(rf"^  {name}  .*{re.escape(text)}$", shown, re.MULTILINE), name


def test_module_runs_as_a_program(tmp_path):
    shown = subprocess.run(
        [sys.executable, "-m", "kaneflex", "--version"], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert kaneflex.__version__ in shown.stdout


@pytest.mark.parametrize("given", ["", "3"])
def test_commands_use_one_thread_of_blas_unless_told_otherwise(tmp_path, given):
    name = "OPENBLAS_NUM_THREADS"
    environment = {key: value for key, value in os.environ.items() if key != name} | ({name: given} if given else {})
    program = [sys.executable, "-c", f"import kaneflex.cli, os; print(os.environ[{name!r}])"]
    shown = subprocess.run(program, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)
    assert shown.stdout.strip() == (given or "1"), shown.stderr


def test_a_full_disk_under_the_cache_of_kernels_is_named(tmp_path):
    """No file may grow beyond 3 kB: the system refuses numba's cache as a full disk does."""
    kaneflex.load("spin-up")  # so that its module is derived
    limited = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))"
    environment = {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}  # Python would keep cut bytecode
    shown = subprocess.run(
        [sys.executable, "-c", f"{limited}; from kaneflex.cli import main; main()", "run", "spin-up", "--no-plots"],
        cwd=tmp_path, env=os.environ | environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert shown.returncode == 2 and "Traceback" not in shown.stderr
    assert "Error: File too large. Free some space, or move the caches: set NUMBA_CACHE_DIR" in shown.stderr


def test_a_plain_number_of_millimetres_is_named_before_anything_is_solved():
    assert "rod.length = 137 is 137 m" in cli("check", "engine", "--set", "rod.length=137").stderr
    for meant in ("137 mm", "137 m", "0.137"):
        assert "is 137 m" not in cli("check", "engine", "--set", f"rod.length={meant}").stderr


OWN = machine(
    bodies=dict(wheel="mass = 1, inertia = 1, points = {pen = [0.1, 0.2]}", bob="mass = 1"),
    joints=dict(shaft="revolute ground wheel", tack="revolute wheel.pen bob"),
    drives=dict(shaft='speed = 1, cycle = "360 deg"', tack='law = "sin(3 * t)"'), solve=dict(preset="rigid"),
)
"""Of a structure that no shipped module serves."""


def test_deriving_names_its_stages(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    Path("own.toml").write_text(OWN)
    stages = []
    find_module(read_scene("own.toml"), stages.append)
    head = "deriving the equations"
    later = [f"{head}: {stage}" for stage in ("Kane's equations", "programs", "module text")]
    assert stages == [f"{head}, first time only", *later]
    find_module(read_scene("own.toml"), stages.append)
    assert len(stages) == 4  # from the cache


# ---- what is refused --------------------------------------------------------------------------------------------

BAD = {
    ("run", "engin"): ("scene = 'engin'", "nearest known one is 'engine'"),
    ("run", "missing.toml"): ("missing.toml", "no such file"),
    ("run", "engine", "--preset", "stiff"): ("solve.preset = 'stiff'", "'stiffened'"),
    ("run", "engine", "--steps", "0"): ("solve.steps = 0",),
    ("run", "engine", "--steps", "many"): ("solve.steps = 'many'",),
    ("run", "engine", "--integrator", "euler"): ("solve.integrator = 'euler'",),
    ("run", "engine", "--set", "rod.lenght=1"): ("rod.lenght", "'length'"),
    ("run", "engine", "--set", "rod"): ("'rod'", "path=value"),
    ("run", "engine", "--set", "rod.length=137 kg"): ("bodies.rod.length", "137 kg"),
    ("run", "engine", "--set", "rod.length=30 mm"): ("cannot close", "main = "),
    ("run", "engine", "--set", "solve.modes=99"): ("solve.modes = 99",),
    ("run", "engine", "--set", "engin.speed=3"): ("no 'engin'. Write main.speed.",),
    ("run", "engine", "--set", "engine=3"): ("Write the path of an entry, like rod.elements=1",),
    ("run", "engine", "--set", "mian.speed=3"): ("The nearest known one is 'main'.",),
    ("run", "engine", "--set", "gas.table=nix.csv"): ("'nix.csv': no such file", "relative to the current folder"),
    ("check", "engine", "--set", "rod.elements=0"): ("elements", "0"),
    ("check", "engine", "--set", "rod.length=30 mm"): ("cannot close", "main = "),
    ("modes", "engine", "--at", "pin=0"): ("--at = 'pin=0'", "no drive 'pin'", "main"),
    ("modes", "engine", "--at", "90deg"): ("--at = '90deg'", "DRIVE=ANGLE"),
    ("modes", "engine", "--at", "main=inf"): ("--at = 'main=inf'", "not a number with a unit"),
    ("modes", "engine", "--at", "main=1_0"): ("--at = 'main=1_0'", "unknown unit '_0'"),
    ("modes", "engine", "--at", "main=\uff19"): ("--at", "not a number with a unit"),
    ("modes", "engine", "--at", "main=1e400"): ("--at = 'main=1e400'", "not a finite number"),
    ("run", "engine", "--set", "rod.length=\uff11\uff10 mm"): ("bodies.rod.length", "not a number with a unit"),
    ("run", "engine", "--set", "rod.length=1_0 mm"): ("bodies.rod.length", "unknown unit '_0 mm'"),
    ("run", "engine", "--set", "rod.I=7008 mm^\uff14"): ("bodies.rod.beam.I", "unknown unit"),
    ("modes", "engine", "--at", "main=5 mm"): ("--at = 'main=5 mm'", "angle"),
    ("modes", "engine", "--preset", "rigid"): ("no body is elastic",),
    ("modes", "engine", "--count", "99"): ("count = 99", "12 degrees of freedom"),
    ("derive", "engin", "-o", "module.py"): ("scene = 'engin'",),
}


@pytest.mark.parametrize("arguments", BAD, ids=" ".join)
def test_bad_input_is_named_with_exit_code_2_and_nothing_is_written(arguments):
    refused(cli(*arguments), *BAD[arguments])
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize(("arguments", "told"), [
    (("rn", "engine"), "No such command 'rn'. The nearest known one is 'run'."),
    (("modes", "engine", "--count", "1_0"), "Invalid value for '--count': '1_0' is not a valid integer"),
    (("modes", "engine", "--count", "\uff13"), "is not a valid integer"),
    (("plot", "nowhere", "--seconds", "nan"), "Invalid value for '--seconds': 'nan' is not a finite number"),
    (("import", "m", "k", "n", "-o", "x.npz", "--point", "start=s", "--damping", "nan"), "'nan' is not a finite"),
    (("import", "m", "k", "n", "-o", "x.npz", "--point", "start=s", "--normal", "0", "inf", "1"), "'inf' is not a"),
])  # fmt: skip
def test_what_click_refuses_is_named(arguments, told):
    result = cli(*arguments)
    assert result.exit_code == 2 and told in result.stderr


def test_every_problem_of_a_scene_file_is_told():
    Path("bad.toml").write_text(
        'schema = 1\nlike = "engine"\n[bodies]\nrod = {length = "-1 mm"}\npiston = {mass = "2 furlongs"}\n'
    )
    result = cli("check", "bad.toml")
    refused(result, "bodies.rod.length", "bodies.piston.mass")
    assert len(result.stderr.splitlines()) == 2


# ---- check, modes, derive ---------------------------------------------------------------------------------------


def test_check_says_what_a_scene_is():
    shown = cli("check", "engine", "--preset", "linear").stdout
    for words in (
        "rod     elastic, 4 elements, 137 mm, 0.153 kg", "closes a loop, branch +", "6000 rpm from 0 deg",
        "preset      linear: vibration about", "duration    20 ms, one cycle",
        "steps       1440 stored instants in a cycle, 13.8889 us apart", "elements    rod 4", "degrees of freedom  12",
        "mid_transverse          displacement of rod.mid, y in body axes, relative to chord",
        "kaneflex.generated.engine", structure_hash(read_scene("engine")),
    ):  # fmt: skip
        assert words in shown
    assert list(Path().iterdir()) == []


def test_check_says_how_large_loads_are():
    assert "gas  table gas.csv on piston.start" in cli("check", "engine").stdout
    strut = cli("check", "pulsating-strut").stdout
    assert "mean   345 N on block.start" in strut and "pulse  law 518 * cos(clock) on block.start" in strut
    long = "518 * cos(clock) + 1e-3 * " + " * ".join(["cos(clock)"] * 9)
    cut = cli("check", "pulsating-strut", "--set", f"loads.pulse.law='{long}'").stdout
    assert f"pulse  law {long[:65]}... on block.start" in cut


def test_check_warns_of_a_table_whose_curve_overshoots(tmp_path):
    """A step of 100 kN between two rows: the cubics through the rows swing beyond it."""
    table = tmp_path / "step.csv"
    table.write_text("deg,F\n" + "".join(f"{row},{1e5 * (90 < row < 450):g}\n" for row in range(0, 721, 30)))
    settings = ("--set", f"gas.table={table}", "--set", "gas.column=F")
    (line,) = cli("check", "engine", *settings).stderr.splitlines()
    assert line.startswith("Warning: loads.gas: its spline reaches ") and "interpolation = 'pchip'" in line
    assert cli("check", "engine", *settings, "--set", "gas.interpolation=pchip").stderr == ""


def test_check_prints_the_schema_of_scene_files():
    assert json.loads(cli("check", "--json-schema").stdout) == json_schema()


# errata.md: corrected mechanism, one element each, from K_s and M alone
FREQUENCIES = {
    "0deg": (3368.784, 4527.772, 15332.844, 28523.179, 33473.183, 273769.431),
    "1.5707963267948966": (3343.486, 4351.550, 15417.891, 26848.769, 35096.431, 248421.593),
}


@pytest.mark.parametrize("angle", FREQUENCIES)
def test_modes_at_an_angle(angle):
    single = ("--set", "rod.elements=1", "--set", "crank.elements=1")
    result = cli("modes", "engine-elastic-crank", *single, "--at", f"main={angle}", "--json")
    found = json.loads(result.stdout)
    assert found["frequencies_hz"] == pytest.approx(FREQUENCIES[angle], rel=1e-5)
    assert found["at_deg"] == {"main": 0.0 if angle == "0deg" else 90.0}
    assert len(found["coordinates"]) == len(found["mode_shapes"]) == 6
    assert {len(row) for row in found["mode_shapes"]} == {6}


def test_modes_as_a_table_of_the_lowest():
    lines = cli("modes", "engine", "--count", "2").stdout.splitlines()
    assert lines[0] == "engine at main = 0 deg" and len(lines) == 4
    assert [line.split()[0] for line in lines[2:]] == ["1", "2"]


def test_modes_do_not_compare_displacements_with_rotations():
    """The first mode bends the rod: its middle moves most, its ends turn most."""
    shown = cli("modes", "engine", "--count", "1", "--at", "main=1")
    assert shown.stdout.splitlines()[2].split()[2] == "rod.2.v"
    assert shown.stdout.splitlines()[2].split()[3] in ("rod.0.theta", "rod.4.theta")
    assert "a plain number is in rad, so 57.2958 deg" in shown.stderr
    assert "plain number" not in cli("modes", "engine", "--count", "1", "--at", "main=1 rad").stderr
    reduced = cli("modes", "engine", "--count", "1", "--set", "solve.modes=2").stdout.splitlines()
    assert reduced[2].split()[2:] == ["rod.2.v", "rod.0.theta"]


@pytest.mark.parametrize(("name", "changes", "said"), [
    ("engine", ["solve.preset=coupled", "solve.start=zero", "solve.steps=40"], "0.66 stored instants in a period of"),
    ("mathieu", ["pulse.law=-2*cos(clock)"], "the axial forces exceed a buckling load at t = 0 s"),
])  # fmt: skip
def test_check_warns_of_what_a_run_would_warn_of_without_a_solution(name, changes, said):
    shown = cli("check", name, *(word for change in changes for word in ("--set", change)))
    assert f"Warning: {said}" in shown.stderr
    scene = with_settings(read_scene(name), [*changes, "solve.errors=none"])
    assert any(text.startswith(said) for text in simulate(load(scene)).warnings)


def test_check_warns_of_terms_that_the_preset_has_no_place_for():
    result = cli("check", "engine", "--preset", "quasistatic", "--set", "solve.terms={gyroscopic=true, damping=true}")
    assert "solve.terms.gyroscopic, solve.terms.damping has no effect under preset quasistatic" in result.stderr
    assert "terms       spin, euler, geometric\n" in result.stdout
    assert cli("check", "engine", "--preset", "quasistatic").stderr.count("Warning") == 0


REDUNDANT = machine(
    ground=dict(far=[1, 0]), bodies=dict(rod='length = 1, mass = 1, beam = {material = "steel", I = "100 mm^4"}'),
    joints=dict(clamp="weld ground rod", pin="revolute ground.far rod.end"), solve=dict(duration=1),
)


@pytest.mark.parametrize("command", [("check",), ("derive", "-o", "rod.py"), ("equations",)])
def test_redundant_joints_are_named_and_counted(command):
    Path("rod.toml").write_text(REDUNDANT)
    result = cli(command[0], "rod.toml", *command[1:])
    assert result.exit_code == 2
    for words in ("2 constraints too many", "pin across x and across y", "constraints are clamp 3, pin 2"):
        assert words in result.stderr  # behind the stages, where deriving takes long
    assert "nothing determines" not in result.stderr and "force_x" not in result.stderr


def test_what_is_open_is_named_by_its_body():
    with pytest.raises(SceneError) as caught:
        check_determined(replace(mechanism_of(read_scene("engine")), drives={}))
    told = "nothing determines the motion of crank, rod, piston; bodies have 9 degrees of freedom, constraints are "
    assert caught.value.reason.startswith(told)
    assert caught.value.cure == "Join or drive them; a drive may be free, and under preset coupled also a body"


def test_a_derived_module_is_the_same_whatever_its_scene_is_called():
    Path("deep").mkdir()
    Path("deep/mine.toml").write_text('schema = 1\nlike = "engine"\nname = "own"\n')
    assert cli("derive", "deep/mine.toml", "-o", "mine.py").exit_code == 0
    assert Path("mine.py").read_bytes() == (ROOT / "generated/engine.py").read_bytes()
    assert "made by: kaneflex derive SCENE -o" in Path("mine.py").read_text()[:400]


def test_derive_gives_the_shipped_bytes_and_does_not_overwrite():
    result = cli("derive", "engine", "-o", "deep/module.py")
    assert result.exit_code == 0, result.output
    assert Path("deep/module.py").read_bytes() == (ROOT / "generated/engine.py").read_bytes()
    Path("deep/module.py").write_text("mine")
    refused(cli("derive", "engine", "-o", "deep/module.py"), "the file exists", "--force")
    refused(cli("derive", "engine", "-o", "deep"), "is a folder")
    refused(cli("derive", "engine", "-o", "d.txt"), "not the name of a Python module", "End it in .py")
    assert Path("deep/module.py").read_text() == "mine"


def test_derive_with_force_replaces_only_with_a_whole_module(monkeypatch):
    Path("module.py").write_text("mine")

    def stopped(scene, progress):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("kaneflex.derive.generate.generate", stopped)
        assert cli("derive", "engine", "-o", "module.py", "--force").exit_code == 130
        assert Path("module.py").read_text() == "mine"
    monkeypatch.setattr("kaneflex.derive.generate.generate", lambda scene, progress: "whole")
    assert cli("derive", "engine", "-o", "module.py", "--force").exit_code == 0
    assert Path("module.py").read_text() == "whole"
    assert [path.name for path in Path().iterdir()] == ["module.py"]


# ---- the package's front ----------------------------------------------------------------------------------------


def test_public_names_are_those_of_their_modules(tmp_path):
    """In a process of its own, where nothing was imported before."""
    code = """
import kaneflex
scene = kaneflex.with_settings(kaneflex.read_scene("engine"), ["solve.preset=rigid"])
solution = kaneflex.simulate(kaneflex.load(scene))
assert isinstance(solution, kaneflex.Solution) and isinstance(solution.model, kaneflex.Model)
assert isinstance(solution.model.scene, kaneflex.Scene)
assert set(kaneflex.__all__) <= set(dir(kaneflex))
assert all(getattr(kaneflex, name) is getattr(kaneflex, name) for name in kaneflex.__all__)  # simulate: a module too
print(solution["piston_position"].dims)
try:
    kaneflex.simulat
except AttributeError as error:
    print(error)
"""
    environment = os.environ | {"PYTHONWARNINGS": "error::UserWarning"}
    shown = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120, env=environment
    )
    assert shown.returncode == 0, shown.stderr
    assert shown.stdout.splitlines() == ["('time',)", "module 'kaneflex' has no attribute 'simulat'"]


HELP = {name: line for group in GROUPS.values() for name, (_, line) in group.items()}
COMMANDS = sorted(HELP)
WIDTH = 45
"""Characters of a line of `kaneflex --help` that a terminal of 80 always has room for."""


def test_help_lists_every_command_once_by_its_group_on_one_line():
    shown = cli("--help").stdout
    assert [group for group in re.findall(r"^(\w+):$", shown, re.MULTILINE) if group != "Options"] == list(GROUPS)
    lines = shown[shown.index("Inspect:") :].splitlines()
    assert sorted(line.split()[0] for line in lines if line.startswith("  ")) == COMMANDS
    assert all(len(line) <= WIDTH for line in HELP.values())
    assert "..." not in "".join(lines)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_one_sentence_and_an_example(command):
    shown = cli(command, "--help").stdout
    sentence = shown.split("\n\n")[1]
    assert sentence.strip().endswith(".")
    assert f"    kaneflex {command} " in shown and "None" not in shown


@pytest.mark.parametrize("command", sorted(set(COMMANDS) - {"list", "new", "plot", "import"}))
def test_commands_of_a_scene_take_settings_and_a_preset(command):
    shown = cli(command, "--help").stdout
    assert "--set PATH=VALUE" in shown and "--preset" in shown


def test_lists_take_commas_or_are_repeated():
    arguments = ("linearise", "engine", "-o")
    for number, names in enumerate([
        ("--sensors", "mid_transverse,crank_torque"), ("--sensors", "mid_transverse", "--sensors", "crank_torque"),
    ]):  # fmt: skip
        found = cli(*arguments, f"{number}.npz", *names)
        assert found.exit_code == 0 and "2 outputs" in found.stdout and not found.stderr


def test_a_new_scene_without_a_model_is_the_commented_template():
    made = cli("new", "press")
    assert made.stdout == "Written to press.toml\n"
    checked = cli("check", "press.toml")
    assert checked.exit_code == 0 and "press: Slider-crank with an elastic rod" in checked.stdout
    assert "Warning" not in checked.stderr and "Note" not in checked.stderr
    ran = cli("run", "press.toml", "--no-plots", "--json")
    assert ran.exit_code == 0 and ran.stderr == "Written to press-results\n"
    rod = json.loads(ran.stdout)["sensors"]["rod_strain"]
    assert 1e-5 < rod["max"] < 1e-3


def test_a_sweep_takes_settings():
    with open("study.toml", "w", encoding="utf-8") as file:
        file.write('scene = "engine"\nsettings = ["solve.steps=36"]\n[parameters]\n"main.speed" = ["3000 rpm"]\n')
    found = cli("sweep", "study.toml", "--no-plots", "--set", "rod.length=30 mm", "--preset", "rigid")
    assert found.exit_code == 3 and "Point 0: joints.bore" in found.stderr


@pytest.mark.parametrize("command", ["compare", "sweep", "trade", "terms", "stability", "run"])
def test_pictures_are_drawn_unless_no_plots_is_given(command):
    shown = cli(command, "--help").stdout
    assert "--no-plots" in shown and shown.count("--plots") == shown.count("--plots KINDS") == (command == "run")


def test_stability_states_the_speeds_that_it_computed():
    arguments = ("stability", "mathieu", "--no-plots", "-o", "out")
    assert "At the scene's own speed; --vary" in cli(*arguments).stdout
    found = cli(*arguments, "--force", "--vary", "clock.speed=100:300rpm", "--points", "3")
    assert found.stdout.startswith("At the scene's own speed, and at 3 speeds of clock from 100 rpm to 300 rpm\n")


def test_derive_takes_presets():
    found = cli("derive", "four-bar", "--preset", "coupled", "-o", "new.py")
    assert found.exit_code == 0 and "Drives and loads of a mechanism" in Path("new.py").read_text(encoding="utf-8")


TABLES = {
    "list": ("scenes", "presets", "integrators"),
    "check engine": ("bodies", "degrees of freedom", "warnings", "notes"),
    "show engine": ("bodies", "degrees of freedom", "warnings", "notes"),
    "modes engine": ("frequencies_hz",),
    "stability mathieu --no-plots": ("findings",),
    "linearise engine -o engine.npz": ("poles", "states", "inputs", "outputs"),
    "compare engine --presets rigid,linear --no-plots": ("differences",),
    "trade engine --budget 0.1s --sensors tip_axial --no-plots": ("chosen", "models", "left_out"),
    "terms engine --budget 0.1s --sensors tip_axial --no-plots": ("operations", "groups"),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("words", TABLES)
def test_a_table_is_also_json(words):
    found = cli(*words.split(), "--json")
    assert found.exit_code == 0
    assert set(TABLES[words]) <= set(json.loads(found.stdout))


@pytest.mark.parametrize(("words", "begun", "found"), [
    (["run"], "spin", ["spin-up", "spin-up-torque", "spinning-top"]),
    (["run", "engine", "--preset"], "st", ["stiffened"]),
    (["run", "engine", "--integrator"], "newm", ["newmark"]), (["run", "engine", "--set"], "rod.el", ["rod.elements="]),
    (["check", "engine", "--set"], "drives.main.s", ["drives.main.speed="]),
    (["check", "no-such-scene", "--set"], "solve.toler", ["solve.tolerance="]), ([], "equ", ["equations"]),
])  # fmt: skip
def test_the_shell_completes(words, begun, found):
    shell = ShellComplete(main, {}, "kaneflex", "_KANEFLEX_COMPLETE")
    assert [item.value for item in shell.get_completions(words, begun) if item.type == "plain"] == found
