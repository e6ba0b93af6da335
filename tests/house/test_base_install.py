"""An installation without extras: what it runs, and what it says where a package is missing."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from places import ROOT

HERE = ROOT
PROJECT = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
USERS = ("tables", "peer", "cluster", "zarr", "nastran", "uff", "vtk")
"""Extras for users; the others are for building, testing and measuring kaneflex."""
IMPORTED = {"distributed": "dask"}
WITHOUT = """
import sys

class Without:
    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, path=None, target=None):
        return None if name.partition(".")[0] in {blocked} else self.finder.find_spec(name, path, target)

sys.meta_path[:] = map(Without, sys.meta_path)
from kaneflex.cli import main

def kaneflex(*arguments):
    try:
        main(arguments, prog_name="kaneflex")
    except SystemExit as ended:
        return ended.code

"""


def names(requirements: list[str]) -> set[str]:
    return {re.match(r"[\w-]+", text)[0] for text in requirements}


def without_extras(folder: Path, code: str) -> str:
    """What a program prints that runs where no package of an extra for users can be imported."""
    missing = {name for extra in USERS for name in names(PROJECT["optional-dependencies"][extra])}
    missing = {IMPORTED.get(name, name) for name in missing} | {"distributed", "rich"}
    program = WITHOUT.format(blocked=missing) + code
    done = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def first_example(page: str, language: str = "python") -> str:
    return re.search(rf"```{language}\n(.*?)```", (HERE / page).read_text(encoding="utf-8"), re.DOTALL)[1]


def test_a_shipped_scene_runs_without_extras(tmp_path):
    commands = (
        ["list"], ["check", "engine"], ["show", "engine"], ["modes", "engine"],
        ["run", "engine", "-o", "engine"], ["plot", "engine", "spectra"],
    )  # fmt: skip
    (tmp_path / "crank.toml").write_text(first_example("README.md", "toml"), encoding="utf-8")
    said = without_extras(tmp_path, f"print([kaneflex(*each) for each in {commands}])\n" + first_example("README.md")
                          + first_example("PACKAGE.md"))  # fmt: skip
    assert "[0, 0, 0, 0, 0, 0]" in said, said
    assert (tmp_path / "engine" / "orders.png").is_file()
    assert "0.61 mm" in said and "3010 N" in said


STUDY = """
scene = "engine"
parameters = {"solve.steps" = [90, 91]}
"""


def test_a_missing_package_is_named_with_the_command_that_brings_it(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "k.op4").write_text("")
    (tmp_path / "modes.unv").write_text("")
    said = without_extras(tmp_path, """
import kaneflex as k

def told(ask):
    try:
        ask()
    except ValueError as error:
        print(error)
    else:
        print("nothing was said")

engine = k.with_settings(k.read_scene("engine"), ["solve.steps=90"])
solution = k.simulate(k.load(engine))
told(lambda: solution["tip_axial"])
told(lambda: solution.to_dataframe())
told(lambda: k.sweep("study.toml", "zarr", form="zarr"))
finished = k.sweep("study.toml", "swept")
print(finished.total, finished.failures)
told(lambda: finished.dataset)
for each in (["run", "engine", "--vtk", "-o", "v"], ["compare", "engine", "--with", "exudyn", "-o", "c"],
             ["sweep", "study.toml", "--scheduler", "tcp://localhost:1", "-o", "d"]):
    kaneflex(*each)
print("code", kaneflex("sweep", "study.toml", "-o", "without-pictures"))
""")
    tables = 'is not installed. Run: pip install "kaneflex[tables]"'
    expected = [
        f"dataset: xarray {tables}.", f"to_dataframe: pandas {tables}.",
        '--format = \'zarr\': zarr is not installed. Run: pip install "kaneflex[zarr]", or use netcdf.', "2 {}",
        f"dataset: xarray {tables}.",
        '--vtk: meshio is not installed. Run: pip install "kaneflex[vtk]", or leave it out.',
        "--with = 'exudyn': the package exudyn is not installed. Run: pip install \"kaneflex[peer]\".",
        "--scheduler = 'tcp://localhost:1': distributed is not installed. Run: pip install \"kaneflex[cluster]\".",
    ]  # fmt: skip
    shown = said.splitlines()
    for line in expected:
        assert any(line in each for each in shown), (line, said)
    assert "code 0" in shown and (tmp_path / "without-pictures" / "sweep.nc").is_file()
    assert "nothing was said" not in shown and "Traceback" not in said
    assert not any((tmp_path / name).exists() for name in "svmcd")


@pytest.mark.parametrize("extra", USERS)
def test_every_extra_is_tested_with_the_tests_or_in_ci(extra):
    """Extras that only CI installs are named there; all others come with ``test``."""
    everywhere = names(PROJECT["optional-dependencies"]["test"])
    in_ci = re.search(r"^export EXTRAS=(\S+)", (HERE / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE)[1]
    assert extra in in_ci.split(",") or names(PROJECT["optional-dependencies"][extra]) <= everywhere
