"""Section: how long a user waits, process by process."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.interleave import interleave
from bench.rows import Row, Target
from kaneflex.scene import read_scene
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import simulate

TITLE = "Latency"
ABOUT = """Wall time of whole processes, the interpreter's start included: imports, and `kaneflex run engine --no-plots`
to its written results. *Cold* finds nothing compiled but Python's own byte code, as after an installation; with
gravity the engine has a structure that is not shipped, so that its module has to be derived, too. *Cached* finds what
the run before it left. *Warm* is no process: reading, loading, solving and all sensors where that was done before."""
COLD, CACHED = Target(5.0, 2.5), Target(1.0, 0.15)
RUN = ("-m", "kaneflex", "run", "engine", "--no-plots", "--force", "-o")
GRAVITY = ("--set", "gravity=[0, -9.81]")
CACHES = {"XDG_CACHE_HOME": "user", "NUMBA_CACHE_DIR": "numba"}
"""Variables that say where derived modules and compiled kernels are kept."""
BYTE_CODE = {"PYTHONPYCACHEPREFIX": "byte code", "PYTHONDONTWRITEBYTECODE": ""}
"""Variables by which the sources are compiled once, wherever they lie and whatever the tests' own process wants."""
IMPORTS = {"python alone": "", "import kaneflex": "import kaneflex", "import numba": "import numba"}
ROUNDS, COLD_ROUNDS = 7, 2


def rows() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        imports = {name: lambda code=code: seconds(folder, "-c", code) for name, code in IMPORTS.items()}
        race = interleave(imports, ROUNDS)
        for name in race:
            yield Row("a process", name, race[name])
        yield Row("engine", "warm", interleave({"warm": warm}, ROUNDS)["warm"])
        yield from runs(folder, "engine", (), None)
        yield from runs(folder, "engine with gravity, not shipped", GRAVITY, COLD)


def runs(folder: Path, task: str, settings: Sequence[str], cold: Target | None) -> Iterator[Row]:
    """A run that finds nothing, again and again, then runs that find what the last one left."""
    command = (*RUN, str(folder / "results"), *settings)
    # not interleaved: a cold run ends with the caches that the next one must not have
    first = interleave({"cold": lambda: emptied(folder, command)}, COLD_ROUNDS)["cold"]
    yield Row(task, "cold", first, None, cold, True, f"{'nothing derived, ' if cold else ''}nothing compiled")
    again = interleave({"cached": lambda: seconds(folder, *command)}, ROUNDS)["cached"]
    yield Row(task, "cached", again, None, CACHED, True)


def warm() -> float:
    started = time.perf_counter()
    _ = simulate(load(read_scene("engine"))).series  # computed when it is asked for
    return time.perf_counter() - started


def emptied(folder: Path, command: Sequence[str]) -> float:
    """Seconds of a command that finds no cache."""
    for cache in CACHES.values():
        shutil.rmtree(folder / cache, ignore_errors=True)
    return seconds(folder, *command)


def seconds(folder: Path, *arguments: str) -> float:
    """Of a Python process with caches in a folder. Raises RuntimeError with what it said, if it failed."""
    variables = {name: cache and str(folder / cache) for name, cache in (CACHES | BYTE_CODE).items()}
    started = time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], env=os.environ | variables, capture_output=True, text=True)
    spent = time.perf_counter() - started
    if done.returncode:
        raise RuntimeError(f"python {' '.join(arguments)}: {done.stderr}")
    return spent
