"""The one-file model: what `kaneflex derive --standalone` writes, run without kaneflex, against `kaneflex run`."""

import ast
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import cli, refused
from hostile_names import HOSTILE, NAME

from kaneflex import Scene, SceneError, load, modes, read_scene, with_settings
from kaneflex.export.standalone import MOST_LINES, standalone
from kaneflex.solve.simulation import solve

SCENES = {
    "engine": ("solve.steps=360",),  # by harmonics, a table of gas pressure, all kinds of sensors
    # by harmonics, more coordinates than modes, two links in a row
    "engine-elastic-crank": ("solve.steps=180", "sensors={slope={displacement='rod.mid', relative_to='chord', "
                             "component='angle'}}"),
    "engine-transient": ("solve.duration=2 ms", "solve.steps=144"),  # by steps, from rest
    "rotating-cantilever": (),  # by harmonics, a load on a link
    "quick-return": ("solve.steps=180",),  # by harmonics, a guide on a body that turns, gravity, a load by a law
    "spin-up": ("solve.duration=2 s", "solve.steps=200"),  # by steps, a drive by a law
}
"""Scene -> settings that make it shorter."""
RUNNER = """
import importlib.abc, json, runpy, sys

class OnlyNumerics(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in {"numpy", *sys.stdlib_module_names}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, OnlyNumerics())
for name in sys.argv[1:]:
    sys.argv = [f"{name}.py", f"{name}.csv"]
    print(json.dumps(name))
    found = runpy.run_path(sys.argv[0], run_name="__main__")
print(json.dumps([name for name in sys.modules if name.partition(".")[0] == "kaneflex"]))
"""
"""Runs files in an interpreter that has numpy alone; prints what they print."""


def scene_of(name: str) -> Scene:
    return with_settings(read_scene(name), list(SCENES[name]))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A folder with the file of every scene and the CSV that it wrote, and what the files printed."""
    folder = tmp_path_factory.mktemp("standalone")
    for name in SCENES:
        (folder / f"{name}.py").write_text(standalone(scene_of(name)), encoding="utf-8")
    command = [sys.executable, "-I", "-c", RUNNER, *SCENES]
    told = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert told.returncode == 0, told.stderr
    return folder, told.stdout.splitlines()


def test_nothing_else_is_imported(run: tuple[Path, list[str]]) -> None:
    assert json.loads(run[1][-1]) == []


@pytest.mark.parametrize("name", SCENES)
def test_every_sensor_is_that_of_a_run(run: tuple[Path, list[str]], name: str) -> None:
    table = np.loadtxt(run[0] / f"{name}.csv", delimiter=",", skiprows=1)
    names = (run[0] / f"{name}.csv").read_text().split("\n", 1)[0].split(",")
    solution = solve(load(scene_of(name)))
    assert names == ["time", *solution.model.scene.sensors]
    assert table[:, 0] == pytest.approx(solution.times, abs=1e-12 * solution.times[-1])
    for sensor, values in zip(names[1:], table[:, 1:].T, strict=True):
        expected = solution.series[sensor].values
        assert abs(values - expected).max() <= 1e-12 * abs(expected).max(), sensor


@pytest.mark.parametrize("name", SCENES)
def test_the_file_can_be_read(run: tuple[Path, list[str]], name: str) -> None:
    text = (run[0] / f"{name}.py").read_text()
    assert text.count("\n") <= MOST_LINES
    assert max(map(len, text.split("\n"))) <= 120
    imported = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    modules = {alias.name for node in imported if isinstance(node, ast.Import) for alias in node.names}
    modules |= {node.module for node in imported if isinstance(node, ast.ImportFrom)}
    assert modules == {"math", "sys", "functools", "numpy"}
    documented = [node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef) and node.name != "main"]
    assert all(ast.get_docstring(node) for node in documented)


def test_a_mass_is_damped_in_the_axes_of_its_link(tmp_path: Path) -> None:
    """Of damping in global axes sag is wrong by 5e-5."""
    scene = with_settings(read_scene("two-link-arm"), ["solve.steps=360"])
    (tmp_path / "arm.py").write_text(standalone(scene), encoding="utf-8")
    subprocess.run([sys.executable, "arm.py", "arm.csv"], cwd=tmp_path, check=True, capture_output=True, timeout=300)
    found = np.loadtxt(tmp_path / "arm.csv", delimiter=",", skiprows=1).T[1:]
    solution = solve(load(scene))
    for values, name in zip(found, scene.sensors, strict=True):
        assert abs(values - solution[name].values).max() <= 1e-9 * abs(values).max(), name


def test_a_table_closes_through_the_mean_of_its_ends(tmp_path: Path) -> None:
    file = tmp_path / "force.csv"
    rows = zip(range(0, 721, 90), [5, *range(8)], strict=True)
    file.write_text("angle,force\n" + "".join(f"{x},{y}\n" for x, y in rows))
    settings = [f"loads.gas.table={file}", "loads.gas.column=force", "loads.gas.closing=1"]
    space: dict[str, Any] = {"__name__": "standalone"}
    exec(standalone(with_settings(read_scene("engine"), settings)), space)
    assert [space["TABLE_1"](math.radians(x)) for x in (0, 90, 720)] == pytest.approx([6.0, 0.0, 6.0])


def test_what_main_prints(run: tuple[Path, list[str]]) -> None:
    """Natural frequencies as `kaneflex modes` has them, and the extremes of every sensor."""
    lines = run[1][run[1].index('"engine"') + 1 :]
    frequencies = [float(word) for word in lines[0].partition(":")[2].split()]
    assert frequencies == pytest.approx(modes(read_scene("engine"), 6).frequencies, rel=1e-5)
    sensor, least, greatest = next(line for line in lines if line.startswith("crank_torque ")).split()
    table = np.loadtxt(run[0] / "engine.csv", delimiter=",", skiprows=1)
    column = table[:, 1 + list(read_scene("engine").sensors).index(sensor)]
    assert [float(least), float(greatest)] == pytest.approx([column.min(), column.max()], rel=1e-8)


@pytest.mark.parametrize("name", [NAME, HOSTILE["surrogate"]])
def test_a_hostile_name_is_text(name: str) -> None:
    """Of a scene, its description and what a scene names itself; the module still has nothing but its docstring,
    definitions and assignments."""
    scene = scene_of("rotating-cantilever").model_copy(update={"description": name})
    scene = scene.model_copy(update={"name": name})
    text = standalone(scene)
    plain = standalone(scene_of("rotating-cantilever"))
    both = [ast.parse(each.encode("utf-8")) for each in (text, plain)]
    for tree in both:
        tree.body = tree.body[1:]
    assert ast.dump(both[0]) == ast.dump(both[1])


@pytest.mark.parametrize(("scene", "settings", "said"), [
    ("engine-block", (), "solve.preset = 'coupled'"),
    ("engine-paper", (), "solve.preset = 'paper'"),
    ("double-pendulum", (), "solve.preset = 'rigid'"),
    ("robot-arm-elastic", (), "in space"),
    ("pulsating-strut", (), "damping.modal"),
    ("mathieu", (), "solve.reduction = 'modal'"),
    ("engine", ("solve.integrator=newmark",), "solve.integrator = 'newmark'"),
    ("engine", ("solve.terms.spin=false",), "solve.terms = 'spin'"),
    ("engine", ("rod.elements=3",), "sensors.mid_axial = 'rod.mid': --standalone reads links at their nodes only"),
    ("engine", ("loads.gas.interpolation=pchip",), "loads.gas.interpolation = 'pchip'"),
    ("v-engine", (), "the limit is 400"),
])  # fmt: skip
def test_what_it_has_no_place_for_is_refused(scene: str, settings: tuple[str, ...], said: str) -> None:
    with pytest.raises(SceneError) as error:
        standalone(with_settings(read_scene(scene), list(settings)))
    assert said in str(error.value)
    assert "run" in str(error.value)


def test_command(tmp_path: Path) -> None:
    file = tmp_path / "blade.py"
    result = cli("derive", "rotating-cantilever", "--standalone", "--set", "blade.elements=2", "-o", file)
    assert f"written to {file}" in result.output
    assert "np.linspace(0.0, 1.0, 3)" in file.read_text()
    refused(cli("derive", "engine", "--standalone", "-o", file), "--force")
    refused(cli("derive", "engine", "--standalone", "--preset", "coupled", "-o", file, "--force"), "solve.preset")
    plain = cli("derive", "engine", "--set", "rod.elements=1", "-o", file, "--force")
    assert "Note: the module contains no numbers of the scene, so --set has no effect\n" in plain.stderr
