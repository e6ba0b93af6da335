"""Compiled functions called without numba, and kernels that an installation brings compiled: used where they fit."""

import json
import os
import subprocess
import sys
import zipfile
from typing import NamedTuple

import numba
import numpy as np
import pytest

from kaneflex.support import machine_code

FUNCTIONS = """
import math
import numpy as np
from kaneflex.support.machine_code import njit

@njit(cache=True, error_model="numpy")
def scaled(numbers, factor, out):
    if factor < 0.0:
        raise ValueError("a factor below zero")
    for k in range(numbers.size):
        out[k] = math.sin(numbers[k]) * math.exp(factor)
    return numbers.size, factor
"""
CALL = """
import functions, json, numpy as np, sys
found, other = np.zeros(5), np.zeros(5, dtype=np.float32)
rest = functions.scaled(np.arange(5.0), 0.3, found)
by_numba = "numba" in sys.modules
try:
    functions.scaled(np.arange(5.0), -1.0, found)
except ValueError as error:
    said = str(error)
functions.scaled(np.arange(5.0), 1, other)
functions.scaled(np.arange(5.0), 1.0, other)
print(json.dumps([by_numba, found.tolist(), rest, said, other.tolist()]))
"""


@pytest.fixture
def called(tmp_path):
    """Call the function in a process of its own, whose cache is the test's."""
    (tmp_path / "functions.py").write_text(FUNCTIONS)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def call():
        command = [sys.executable, "-c", CALL]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, env=environment)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return call


def test_a_second_process_computes_the_same_without_numba(called, tmp_path):
    """Also what it returns, and raises; arguments of other types are compiled for."""
    by_numba, *found = called()
    assert by_numba
    np.testing.assert_allclose(found[0], np.sin(np.arange(5.0)) * np.exp(0.3), rtol=1e-15)
    assert found[1:3] == [[5, 0.3], "a factor below zero"]
    assert called() == [False, *found]
    kept = {place: place.read_bytes() for place in (tmp_path / "cache").glob("functions.scaled-*.machine")}
    empty, torn, of_other_files = kept.items()
    empty[0].write_bytes(b"")
    torn[0].write_bytes(torn[1][:40])
    of_other_files[0].write_bytes(bytes(32) + of_other_files[1][32:])
    assert called() == [True, *found]
    assert {place: place.read_bytes() for place in kept} == kept
    source = tmp_path / "functions.py"
    source.write_text(FUNCTIONS.replace("math.exp(factor)", "1.0"))
    assert called()[:2] == [True, np.sin(np.arange(5.0)).tolist()]


class Pair(NamedTuple):
    one: float
    other: np.ndarray


def test_what_numba_tells_apart_is_told_apart():
    square, readonly = np.ones((3, 3)), np.ones(3)
    readonly.flags.writeable = False
    values = [
        1, 2**40, 1.0, True, np.float64(1.0), np.uint64(1), (1, 2), (1, 2.0), ((1,), 2), Pair(1.0, np.ones(2)),
        Pair(1.0, np.ones(2, dtype=int)), np.ones(3), np.ones(1), np.ones(6)[::2], readonly, square, square.T,
        np.ones((1, 3)), np.ones((5, 5))[:3, :3], np.ones(3, dtype=np.float32), np.ones(3, dtype=complex),
        np.frombuffer(bytearray(25), dtype=np.uint8)[1:].view(float),
    ]  # fmt: skip
    kinds, types = [machine_code._kind(value) for value in values], [numba.typeof(value) for value in values]
    for one, mine in zip(kinds, types, strict=True):
        for other, theirs in zip(kinds, types, strict=True):
            assert one != other or mine == theirs, (one, mine, theirs)
    assert len(set(kinds)) >= len(set(types))
    for value in (2**63, -(2**63) - 1, "text", None, {}, np.ones(2, dtype=[("a", float)]), np.ma.ones(2), (1, "2")):
        with pytest.raises(TypeError):
            machine_code._kind(value)


def test_machine_code_of_another_state_is_not_used(monkeypatch, tmp_path):
    """Of files beside it that were changed, of other settings of numba, of another processor."""
    (tmp_path / "beside.py").write_text("")
    state = machine_code._state.__wrapped__
    states = {state(tmp_path / "beside.py")}
    assert state(tmp_path / "beside.py") in states
    (tmp_path / "beside.py").write_text("changed")
    states.add(state(tmp_path / "beside.py"))
    monkeypatch.setenv("NUMBA_OPT", "1")
    states.add(state(tmp_path / "beside.py"))
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "another")
    states.add(state(tmp_path / "beside.py"))
    assert len(states) == 4


def test_an_object_that_refers_to_an_unknown_symbol_is_refused():
    """LLVM would end the process."""
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine()

    def code(symbol):
        text = f"declare void @{symbol}()\ndefine void @f() {{\n call void @{symbol}()\n ret void\n}}"
        return machine.emit_object(binding.parse_assembly(text))

    assert machine_code._links(code("NRT_Free"))
    assert machine_code._links(code("cos"))
    assert not machine_code._links(code("no_such_function_anywhere"))
    assert not machine_code._links(b"\xcf\xfa\xed\xfe" + code("cos")[4:])  # not in ELF


def test_other_compiled_functions_call_it_and_it_looks_like_numbas():
    from kaneflex.generated import beam_euler_bernoulli as beam

    @numba.njit
    def mass(p, out):
        beam.M(p, out)
        return out[0, 0]

    p, out, own = np.array([1.1, 3e7, 1500.0, 0.03, 0.06]), np.zeros((6, 6)), np.zeros((6, 6))
    assert mass(p, out) == out[0, 0] > 0.0
    beam.M(p, own)
    np.testing.assert_array_equal(own, out)
    assert beam.M.__name__ == beam.M.py_func.__name__ == "M" and beam.M.signatures


def test_functions_made_within_others_are_numbas():
    """They share their name and file, not what they enclose."""

    def raised(power):
        @machine_code.njit()
        def power_of(x):
            return x**power

        return power_of

    assert (raised(2)(3), raised(3)(3)) == (9, 27)
    assert not isinstance(raised(2), machine_code.Kernel)


RUN = """
import json, sys
from pathlib import Path

import numpy as np
from llvmlite.binding import TargetMachine
from numba.core import event

from kaneflex import load, read_scene
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
    model, times = load(read_scene("rotating-cantilever")), np.array([0.0, 1e-3])
    out = np.zeros((2, len(model.module.SCALARS)))
    model.module.tabulate(times, model.motion.parameters, out)
    return {name: values.tolist() for (name, *_), values in zip(model.module.SCALARS, out.T, strict=True)}


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
