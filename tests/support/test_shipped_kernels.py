"""Kernels that an installation brings compiled: used where they fit, also on another processor, and else compiled."""

import json
import os
import subprocess
import sys
import zipfile

import pytest

RUN = """
import json, sys
from pathlib import Path

from llvmlite.binding import TargetMachine
from numba.core import event

from kaneflex import load, read_scene, simulate, with_settings
from kaneflex.support import shipped_kernels

compiled, made = [], []
emit = TargetMachine.emit_object
TargetMachine.emit_object = lambda machine, module: made.append(module.name) or emit(machine, module)


class Listener(event.Listener):
    def on_start(self, found):
        compiled.append(found.data["dispatcher"].py_func.__qualname__)

    def on_end(self, found):
        pass


event.register("numba:compile", Listener())


def values():
    scene = with_settings(read_scene("rotating-cantilever"), ["solve.preset=rigid", "solve.steps=20"])
    solution = simulate(load(scene))
    return {name: solution.series[name].values.tolist() for name in solution.keys()}


archive = Path(sys.argv[2])
if sys.argv[1] == "record":
    with shipped_kernels.recording(archive):
        found = values()
else:
    shipped_kernels._archive_here = lambda: archive
    found = values()
print(json.dumps([compiled, found, made]))
"""


def run(folder, what, archive, **environment):
    """Names of what was compiled, the sensors' values, and names of what machine code was made of bitcode for.

    By a process with a cache of its own.
    """
    own = {"NUMBA_CACHE_DIR": str(folder / f"cache-{what}-{archive.stem}")} | environment
    command = [sys.executable, "-W", "ignore", "-c", RUN, what, str(archive)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=os.environ | own)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shipped")
    archive = folder / "kernels.zip"
    return folder, archive, *run(folder, "record", archive)[:2]


def changed(archive, name, change):
    """The archive with some of its members changed."""
    other = archive.with_name(name)
    with zipfile.ZipFile(archive) as old, zipfile.ZipFile(other, "w", zipfile.ZIP_LZMA) as new:
        for member in old.namelist():
            new.writestr(member, change(member, old.read(member)))
    return other


def test_nothing_is_compiled_that_was_shipped(recorded):
    """For the plainest processor of this kind, whichever one recorded; and numba keeps what was made."""
    folder, archive, compiled, values = recorded
    assert "tabulate" in compiled
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    again, found, made = run(folder, "use", archive, **plain)
    assert again == []
    assert made
    for name, series in values.items():
        assert found[name] == pytest.approx(series, rel=1e-12, abs=1e-12), name
    kept = changed(archive, archive.name.replace("kernels", "none"), lambda member, data: b"")
    once_more, *_ = run(folder, "use", kept, NUMBA_CACHE_DIR=str(folder / "cache-use-kernels"), **plain)
    assert once_more == []


def test_machine_code_is_used_as_it_is_on_a_processor_with_the_same_instructions(recorded):
    """The name of the processor need not be the same."""
    folder, archive, _, values = recorded
    for number, environment in enumerate(({}, {"NUMBA_CPU_NAME": "x86-64"})):
        cache = str(folder / f"cache-same-{number}")
        assert run(folder, "use", archive, NUMBA_CACHE_DIR=cache, **environment) == [[], values, []]


@pytest.mark.parametrize("broken", ["sources", "kernels"])
def test_what_was_made_of_other_sources_or_is_damaged_is_compiled(recorded, broken):
    folder, archive, compiled, values = recorded

    def spoilt(member, data):
        return b"x" if (member == "sources") == (broken == "sources") else data

    again, found, _ = run(folder, "use", changed(archive, f"other-{broken}.zip", spoilt))
    assert (again, found) == (compiled, values)
