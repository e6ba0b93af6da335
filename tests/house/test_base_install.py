"""An installation without extras and what it says of missing packages; what runs import, against a budget."""

import json
import re
import subprocess
import sys
import tomllib
from itertools import pairwise
from pathlib import Path

import pytest
from places import DATA, ROOT

HERE = ROOT
PROJECT = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
USERS = ("tables", "peer", "nastran", "vtk")
"""Extras for users; the others are for building, testing and measuring kaneflex."""
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
    missing = {"rich", *(name for extra in USERS for name in names(PROJECT["optional-dependencies"][extra]))}
    program = WITHOUT.format(blocked=missing) + code
    done = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def first_example(page: str, language: str = "python") -> str:
    return re.search(rf"```{language}\n(.*?)```", (HERE / page).read_text(encoding="utf-8"), re.DOTALL)[1]


def test_a_shipped_scene_runs_without_extras(tmp_path):
    commands = (
        ["list"], ["check", "engine"], ["show", "engine"], ["modes", "engine"],
        ["run", "engine", "--no-plots", "-o", "engine"], ["plot", "engine", "spectra"],
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
finished = k.sweep("study.toml", "swept")
print(finished.total, finished.failures)
told(lambda: finished.dataset)
for each in (["run", "engine", "--vtk", "-o", "v"], ["compare", "engine", "--with", "exudyn", "-o", "c"]):
    kaneflex(*each)
print("code", kaneflex("sweep", "study.toml", "-o", "pictured"))
""")
    tables = 'is not installed. Run: pip install "kaneflex[tables]"'
    expected = [
        f"dataset: xarray {tables}.", f"to_dataframe: pandas {tables}.",
        "2 {}", f"dataset: xarray {tables}.",
        '--vtk: meshio is not installed. Run: pip install "kaneflex[vtk]", or leave it out.',
        "--with = 'exudyn': the package exudyn is not installed. Run: pip install \"kaneflex[peer]\".",
    ]  # fmt: skip
    shown = said.splitlines()
    for line in expected:
        assert any(line in each for each in shown), (line, said)
    assert "code 0" in shown and (tmp_path / "pictured" / "sweep.png").is_file()
    assert "nothing was said" not in shown and "Traceback" not in said
    assert not any((tmp_path / name).exists() for name in "svmc")


@pytest.mark.parametrize("extra", USERS)
def test_every_extra_is_tested_with_the_tests_or_in_ci(extra):
    """Extras that only CI installs are named there; all others come with ``test``."""
    everywhere = names(PROJECT["optional-dependencies"]["test"])
    in_ci = re.search(r"^export EXTRAS=(\S+)", (HERE / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE)[1]
    assert extra in in_ci.split(",") or names(PROJECT["optional-dependencies"][extra]) <= everywhere


BUDGET = DATA / "budget.json"
RUN = """
import json, sys
from pathlib import Path

lines = set()

def line(frame, event, argument):
    lines.add((frame.f_code.co_filename, frame.f_lineno))
    return line

def call(frame, event, argument):
    name, module = frame.f_globals.get("__name__", ""), frame.f_code.co_name == "<module>"
    kernel = name.startswith("kaneflex.generated.") and "njit" in frame.f_globals and not module
    return line if "kaneflex" in name and not kernel else None  # no kernel counts, compiled or not

sys.settrace(call)
from kaneflex.cli import main
main({arguments}, standalone_mode=False)
sys.settrace(None)
modules = [name for name in sys.modules if name.split(".")[0] == "kaneflex"]
print(json.dumps({{"modules": len(modules), "lines": len(lines)}}))
"""


def told(code, folder, good):
    """Lines that a program prints; it runs again if they are not good, because the first run may have compiled.

    What was compiled is called without numba, and compiling executes lines, too.
    """
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        lines = done.stdout.splitlines()
        if good(lines):
            break
    return lines


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="lines are counted as Python 3.11 executes them")
@pytest.mark.parametrize("command", sorted(json.loads(BUDGET.read_text())))
def test_a_command_stays_within_its_budget(command, tmp_path):
    budget = json.loads(BUDGET.read_text())[command]

    def over(found):
        return {what: (found[what], most) for what, most in budget.items() if found[what] > most}

    found = told(RUN.format(arguments=command.split()), tmp_path, lambda lines: not over(json.loads(lines[-1])))
    found = json.loads(found[-1])
    assert not over(found), f"found, allowed: {over(found)}"
    slack = {what: (found[what], most) for what, most in budget.items() if found[what] < 0.98 * most}
    assert not slack, f"lower the budget in {BUDGET.name}; found, allowed: {slack}"


HEAVY = ("matplotlib", "numba", "pandas", "pint", "rich", "scipy.interpolate", "scipy.linalg", "scipy.sparse", "sympy")
HEAVY += ("xarray", "kaneflex.plots", "numpy.ma", "numpy.random", "email")
IMPORTS = """
import gc, sys
from kaneflex.cli import main
for arguments in {commands}:
    collected = [each["collections"] for each in gc.get_stats()]
    main(arguments, standalone_mode=False)
    print(sum(each["collections"] for each in gc.get_stats()) - sum(collected), gc.isenabled())
    print([name for name in {heavy} if name in sys.modules])
if "matplotlib" in sys.modules:
    from matplotlib.axes import Axes
    assert "antialiased" not in Axes.plot.__doc__, "lists of properties in docstrings take 0.1 s"
"""
LIGHT = ("list", "check engine", "check four-bar", "modes engine", "run engine --no-plots -o results --force")
"""Commands that import none of these, one after the other in one process."""


@pytest.mark.parametrize(("commands", "used"), [
    (LIGHT, []),
    (["check swept-blade"], ["scipy.sparse", "numpy.ma", "numpy.random", "email"]),
    (["show engine -o shown.png --force"], ["matplotlib", "kaneflex.plots", "numpy.ma", "numpy.random"]),
    (["run engine -o results --force"], ["matplotlib", "kaneflex.plots", "numpy.ma"]),
])  # fmt: skip
def test_a_command_imports_only_what_it_uses(commands, used, tmp_path):
    code = IMPORTS.format(commands=[command.split() for command in commands], heavy=HEAVY)
    lines = told(code, tmp_path, lambda lines: lines[-1] == str(used))
    found = [pair for pair in pairwise(lines) if re.fullmatch(r"\d+ (True|False)", pair[0])]
    assert [imported for _, imported in found] == [str(used)] * len(commands)
    for command, (collections, _) in zip(commands, found, strict=True):
        number, enabled = collections.split()
        assert enabled == "True"
        assert int(number) <= 20 or "run" in command  # 178 of check where garbage is looked for meanwhile
