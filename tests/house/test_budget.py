"""Modules imported and lines executed by a plain run and by `list`, against a budget that only falls.

Also which large packages the quick commands import.
"""

import json
import re
import subprocess
import sys
from itertools import pairwise

import pytest
from places import DATA

BUDGET = DATA / "budget.json"
RUN = """
import json, sys
from pathlib import Path

lines = set()

def line(frame, event, argument):
    lines.add((frame.f_code.co_filename, frame.f_lineno))
    return line

def call(frame, event, argument):
    return line if "kaneflex" in frame.f_globals.get("__name__", "") else None

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
IMPORTED = """
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
    (["check swept-blade"], ["numba", "scipy.linalg", "scipy.sparse", "numpy.ma", "numpy.random", "email"]),
    (["show engine -o shown.png --force"], ["matplotlib", "kaneflex.plots", "numpy.ma", "numpy.random"]),
    (["run engine -o results --force"], ["matplotlib", "kaneflex.plots", "numpy.ma"]),
])  # fmt: skip
def test_a_command_imports_only_what_it_uses(commands, used, tmp_path):
    code = IMPORTED.format(commands=[command.split() for command in commands], heavy=HEAVY)
    lines = told(code, tmp_path, lambda lines: lines[-1] == str(used))
    found = [pair for pair in pairwise(lines) if re.fullmatch(r"\d+ (True|False)", pair[0])]
    assert [imported for _, imported in found] == [str(used)] * len(commands)
    for command, (collections, _) in zip(commands, found, strict=True):
        number, enabled = collections.split()
        assert enabled == "True"
        assert int(number) <= 20 or "run" in command  # 178 of check where garbage is looked for meanwhile
