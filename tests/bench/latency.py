"""Section: how long a user waits, for a command, for its first run and for the installation."""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from bench.interleave import Spread, interleave
from bench.rows import Row, Target

ROOT = Path(__file__).parents[2]
FIXED = "sum(k * k % 7 for k in range(4_000_000))"
TITLE = "Latency"
ABOUT = f"""\
Times are processor seconds (user and system) of whole processes; rows named *clock* are wall time. Ratios are relative
to the time of a *reference computation*, `{FIXED}`.

- *Install*: installation into an empty environment, either by `make run` (which writes no `.pyc` files) or by `pip
  install` of a wheel. MB are 10^6 bytes.
- *Cold*: the first `kaneflex run SCENE --no-plots` on a machine. The equations of the engine with gravity are not
  shipped and must first be derived. *From a wheel*: with a wheel that contains compiled kernels.
- *Warm*: the kernels were compiled in an earlier run."""
WARM = {
    "list": 0.4, "check engine": 0.4, "show engine --force -o shown.png": 0.4, "modes engine": 0.4,
    "run engine --no-plots --force -o warm": 0.5, "run engine --force -o drawn": 2.0,
}  # fmt: skip
"""Commands, with the seconds that they may take."""
COLD = {"engine": 5.0, "four-bar-motor": 8.0, "slider-crank-clearance": 10.0, "spatial-slider-crank-elastic": 10.0}
OWN = ("engine", "--set", "gravity=[0, -9.81]")
"""A structure that is not shipped."""
EXAMPLE, FROM_WHEEL, INSTALL, MEGABYTES, FRESH, SUITE = 0.8, 2.0, 20.0, 450.0, 40.0, 360.0
LINES, MODULES = 4500, 80
ROUNDS = 5
CACHES = {"XDG_CACHE_HOME": "user", "NUMBA_CACHE_DIR": "numba", "MPLCONFIGDIR": "matplotlib"}
"""Variables that say where derived modules, compiled kernels and the list of fonts are kept."""
UNSET = ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "VIRTUAL_ENV", "EXTRAS", "MAKEFLAGS", "MAKEOVERRIDES", "MAKELEVEL")
"""Variables of the process that measures, of which a user's processes know nothing."""
SUITE_SECONDS = ROOT / ".build" / "test-seconds"
"""Written by `make test`, which takes too long to be run here."""


class Spent(NamedTuple):
    """Seconds of the processor and of the clock."""

    cpu: float
    clock: float


def rows() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clone = copied(folder / "clone")
        empty = environment(folder / "empty")
        yield from fresh_clone(folder, clone, empty)
        tools = clone / ".build" / "venv" / "bin"
        yield from cold(folder, tools, "cold", COLD)
        yield first_run(folder, tools, "cold", "engine with gravity, derived", OWN, None)
        yield from warm(folder, tools)
        execute(folder, ["make", "wheel", f"SCENES={' '.join(COLD)}"], clone)
        (wheel,) = (clone / ".build" / "dist").glob("*.whl")
        fresh = environment(folder / "fresh")
        spent, ratio = beside_fixed(folder, [fresh / "bin" / "pip", "install", "--quiet", wheel])
        yield single("install", "pip install, a wheel", spent.cpu, ratio, Target(INSTALL))
        yield size("pip install, with bytecode", added(fresh, empty, bytecode=True))
        yield from cold(folder, fresh / "bin", "cold, from a wheel", dict.fromkeys(COLD, FROM_WHEEL))
    yield from of_files()


def fresh_clone(folder: Path, clone: Path, empty: Path) -> Iterator[Row]:
    """`make run`, first what it installs, then the rest."""
    install, ratio = beside_fixed(folder, ["make", ".build/venv/ready"], clone)
    yield single("install", "by make run", install.cpu, ratio, Target(INSTALL))
    yield size("by make run, no bytecode", added(clone / ".build" / "venv", empty, bytecode=False))
    run = execute(folder, ["make", "run"], clone)
    yield single("make run on a fresh clone", "clock", install.clock + run.clock, None, Target(FRESH))
    fixed = execute(folder, [sys.executable, "-c", FIXED]).cpu
    yield single("make run on a fresh clone", "processor", install.cpu + run.cpu, (install.cpu + run.cpu) / fixed)


def cold(folder: Path, tools: Path, task: str, scenes: Mapping[str, float]) -> Iterator[Row]:
    for scene, most in scenes.items():
        yield first_run(folder, tools, task, scene, [scene], Target(most))


def first_run(folder: Path, tools: Path, task: str, name: str, arguments: Sequence[str], target: Target | None) -> Row:
    for cache in CACHES.values():
        shutil.rmtree(folder / cache, ignore_errors=True)
    command = [tools / "kaneflex", "run", *arguments, "--no-plots", "--force", "-o", folder / "results"]
    spent, ratio = beside_fixed(folder, command)
    return single(task, name, spent.cpu, ratio, target)


def warm(folder: Path, tools: Path) -> Iterator[Row]:
    (folder / "crank.toml").write_text(readme("toml"), encoding="utf-8")
    commands: dict[str, tuple[Sequence[str | Path], Target | None]] = {
        "reference computation": ([sys.executable, "-c", FIXED], None),
        "python alone": ([tools / "python", "-c", ""], None),
    }
    for command, most in WARM.items():
        commands[re.sub(r" --force| -o \S+", "", command)] = ([tools / "kaneflex", *command.split()], Target(most))
    commands["the README's first example"] = ([tools / "python", "-c", readme("python")], Target(EXAMPLE))
    reference, *_ = commands
    race = interleave({name: lambda c=c: execute(folder, c).cpu for name, (c, _) in commands.items()}, ROUNDS)
    for name, (_, target) in commands.items():
        yield Row("warm", name, race[name], race.ratio(name, reference), target, target is not None)


def of_files() -> Iterator[Row]:
    """What other checks found."""
    if SUITE_SECONDS.exists():
        yield single("make test", "clock, without compiling", float(SUITE_SECONDS.read_text()), None, Target(SUITE))
    else:
        yield Row("make test", "clock, without compiling", None, missing="measured by make test, not run here")
    budget = json.loads((ROOT / "tests" / "data" / "budget.json").read_text(encoding="utf-8"))
    (found,) = (each for command, each in budget.items() if command.startswith("run engine --no-plots"))
    for unit, most in {"lines": LINES, "modules": MODULES}.items():
        yield single("run engine --no-plots", f"{unit} of kaneflex", found[unit], None, Target(most), unit)


def single(
    task: str, name: str, value: float, ratio: float | None = None, target: Target | None = None, unit: str = ""
) -> Row:
    """A row of what is measured once, its target one of the value."""
    return Row(task, name, Spread(value, value, value, 1), ratio, target, target is not None, unit=unit)


def size(name: str, found: float) -> Row:
    return single("install", name, found, None, Target(MEGABYTES), "MB")


def readme(language: str) -> str:
    """Its first example in a language."""
    return re.search(rf"```{language}\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)[1]


def copied(folder: Path) -> Path:
    """What git knows of this checkout, or would take: a clone of it, with its changes."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    for file in map(Path, filter(None, listed.stdout.decode().split("\0"))):
        if (ROOT / file).is_file():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / file, folder / file)
    return folder


def environment(folder: Path) -> Path:
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    return folder


def added(environment: Path, empty: Path, bytecode: bool) -> float:
    """Megabytes of an environment beyond those of an empty one."""
    return megabytes(environment, bytecode) - megabytes(empty, bytecode)


def megabytes(folder: Path, bytecode: bool) -> float:
    """Bytes of files [10^6], each counted once."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return 1e-6 * sum(path.stat().st_size for path in files if bytecode or path.suffix != ".pyc")


def beside_fixed(folder: Path, command: Sequence[str | Path], within: Path | None = None) -> tuple[Spent, float]:
    """What a command takes, and its ratio to the fixed piece of work before and after it."""
    fixed = [sys.executable, "-c", FIXED]
    before, spent, after = execute(folder, fixed), execute(folder, command, within), execute(folder, fixed)
    return spent, 2.0 * spent.cpu / (before.cpu + after.cpu)


def execute(folder: Path, command: Sequence[str | Path], within: Path | None = None) -> Spent:
    """Run a command whose caches lie in a folder, in which it runs, too, or `within` another one.

    Raises RuntimeError with what it said, if it failed.
    """
    kept = {name: value for name, value in os.environ.items() if name not in UNSET}
    caches = {name: str(folder / cache) for name, cache in CACHES.items()} | {"PIP_CACHE_DIR": str(folder / "pip")}
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, cwd=within or folder, env=kept | caches, capture_output=True, text=True)
    clock, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}: {done.stdout}{done.stderr}")
    return Spent(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, clock)
