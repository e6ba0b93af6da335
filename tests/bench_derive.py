"""How deriving and compiling grow with the number of links: ``make bench-derive`` writes ``docs/derive-times.md``.

Run it on an idle machine: each number is the smallest of several tries.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import csv_tables
from chains import chain
from rich.progress import track

from kaneflex.multibody.model.module_loading import generate_text, import_file
from kaneflex.scene.structure import structure_hash
from kaneflex.support.contract import REQUIRED_ATTRIBUTES
from kaneflex.support.files import write_text

PAGE = Path(__file__).parent.parent / "docs" / "derive-times.md"
COUNTS = {False: (1, 2, 4, 6, 8), True: (4, 6, 8)}
COMPILE = """
import sys, time
import numpy as np
from numba import njit
from kaneflex.multibody.model.module_loading import import_file
from kaneflex.support.contract import REQUIRED_ATTRIBUTES
from pathlib import Path
njit(lambda: 0)()  # numba's own start-up
module = import_file(Path(sys.argv[1]), sys.argv[2], REQUIRED_ATTRIBUTES)
p, s = np.ones(len(module.PARAMETERS)), np.zeros(len(module.SCALARS))
started = time.perf_counter()
module.motion(0.0, p, s)
print(time.perf_counter() - started)
"""
HEAD = """# Times to derive and to compile

The mechanisms are chains of elastic links (`tests/chains.py`): open chains with all joints driven, and closed chains
from ground to ground. Operations are those of the kernel `motion`. Their number grows linearly with the number of
links; without shared subexpressions it would grow exponentially. Each chain is compiled in a new process with an empty
cache.

Tables as CSV: [kernels](data/derive-times.csv), [coupled](data/derive-times-coupled.csv)

"""
COLUMNS = (
    "chain", "links", "derive [s]", "module [kB]", "operations written out", "operations shared", "compile motion [s]"
)  # fmt: skip
COUPLED_LINKS, COUPLED_MODES = (1, 2, 4, 8), (1, 3, 6)
COUPLED = """
import sys
import kaneflex
scene = kaneflex.read_scene(sys.argv[1])
settings = [f"solve.modes={sys.argv[2]}", "solve.steps=1000"]
model = kaneflex.load(kaneflex.with_settings(scene, ["solve.preset=coupled", *settings]))
kaneflex.simulate(model)  # compiles the engine where it is the first run on a machine
found = kaneflex.simulate(model).trajectory
size = model.coupled.engine.size
print(size, model.seconds["derive"], model.seconds["compile"], found.ns_per_step / 1e3, found.steps, found.rejected)
"""
COUPLED_HEAD = """
## The coupled equations

Runs of 1 s of the open chains under preset `coupled`, with 1 to 6 modes per link. The first row includes compiling
the `coupled` solver, which all scenes share.

"""
COUPLED_COLUMNS = ("links", "modes", "coordinates", "derive [s]", "compile [s]", "a step [us]", "steps", "rejected")
FOOT = """
{date}, {cores} cores, Python {python}, SymPy {sympy}, numba {numba}. Times are the smallest of {tries} tries, for the
coupled equations single ones. Made by `make bench-derive`; do not edit.
"""


def derive_seconds(count: int, closed: bool, folder: Path) -> tuple[float, Path, str]:
    """Seconds to derive the module of a chain, its file and its structure."""
    scene = chain(count, closed, folder)
    started = time.perf_counter()
    text = generate_text(scene)
    seconds = time.perf_counter() - started
    path = folder / f"{scene.name.replace('-', '_')}.py"
    write_text(path, text)
    return seconds, path, structure_hash(scene)


def compile_seconds(path: Path, structure: str) -> float:
    """Seconds of the first call of ``motion`` in a process of its own that finds nothing compiled."""
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [sys.executable, "-c", COMPILE, str(path), structure],
            env=os.environ | {"NUMBA_CACHE_DIR": cache}, capture_output=True, text=True, check=True,
        )  # fmt: skip
    return float(done.stdout)


def row(count: int, closed: bool, tries: int, folder: Path) -> list[str]:
    """One row of the table."""
    derived = [derive_seconds(count, closed, folder) for _ in range(tries)]
    _, path, structure = derived[0]
    compiled = min(compile_seconds(path, structure) for _ in range(tries))
    written_out, shared = import_file(path, structure, REQUIRED_ATTRIBUTES).OPERATIONS["motion"]
    seconds = min(seconds for seconds, *_ in derived)
    return [
        "closed" if closed else "open", str(count), f"{seconds:.2f}", f"{path.stat().st_size / 1e3:.0f}",
        f"{written_out:,}", str(shared), f"{compiled:.2f}",
    ]  # fmt: skip


def coupled_row(count: int, modes: int, numba: str, folder: Path) -> list[str]:
    """One row of the coupled equations' table: a process that finds nothing derived, and compiles anew."""
    path = folder / f"open-chain-{count}.toml"
    chain(count, False, folder)
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [sys.executable, "-c", COUPLED, str(path), str(modes)],
            env=os.environ | {"NUMBA_CACHE_DIR": numba, "XDG_CACHE_HOME": cache}, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
    size, derive, compile_, step, steps, rejected = done.stdout.split()
    return [
        str(count), str(modes), size, f"{float(derive):.1f}", f"{float(compile_):.1f}", f"{float(step):.0f}", steps,
        rejected,
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=PAGE, help="file to write")
    parser.add_argument("--most", type=int, default=8, metavar="N", help="links of the longest chain")
    parser.add_argument("--tries", type=int, default=3, metavar="N", help="of which the fastest counts")
    asked = parser.parse_args()
    chains = [(count, closed) for closed, counts in COUNTS.items() for count in counts if count <= asked.most]
    with tempfile.TemporaryDirectory() as folder:
        derive_seconds(1, False, Path(folder))  # SymPy's own start-up
        rows = [row(count, closed, asked.tries, Path(folder)) for count, closed in track(chains, "chains")]
        pairs = [(count, modes) for count in COUPLED_LINKS for modes in COUPLED_MODES if count <= asked.most]
        numba = str(Path(folder) / "numba")  # one for all: the stepper is compiled once on a machine
        coupled = [coupled_row(count, modes, numba, Path(folder)) for count, modes in track(pairs, "coupled")]
    foot = FOOT.format(
        date=datetime.date.today().isoformat(), cores=os.cpu_count(), python=platform.python_version(),
        sympy=version("sympy"), numba=version("numba"), tries=asked.tries,
    )  # fmt: skip
    docs = asked.output.parent
    text = HEAD + csv_tables.write("derive-times", COLUMNS, rows, docs)
    text += COUPLED_HEAD + csv_tables.write("derive-times-coupled", COUPLED_COLUMNS, coupled, docs) + foot
    asked.output.write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
