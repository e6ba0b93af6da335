"""Where kernels are cached when the usual folders can't be written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import kaneflex

KERNEL = "import numba\n\n\n@numba.njit(cache=True)\ndef double(x):\n    return 2.0 * x\n"


def run_copy(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Import a copy of kaneflex from `folder`, then compile a cached kernel that lies beside it."""
    code = "import kaneflex, kernel, numba; print(kernel.double(21.0)); print(numba.config.CACHE_DIR)"
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    inherited |= {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, env=inherited | environment)


def copy_with_blocked_pycache(folder: Path) -> None:
    """A file where each `__pycache__` should be: nothing can be cached there, whoever runs the test."""
    package = folder / "kaneflex"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(kaneflex.__file__).parent, package, ignore=ignored)
    (folder / "kernel.py").write_text(KERNEL)
    for place in (folder, package, *(path for path in package.rglob("*") if path.is_dir())):
        (place / "__pycache__").touch()


def test_no_writable_folder_warns_and_works(tmp_path):
    copy_with_blocked_pycache(tmp_path)
    nowhere = str(tmp_path / "kernel.py" / "below-a-file")
    result = run_copy(tmp_path, XDG_CACHE_HOME=nowhere, HOME=nowhere)
    assert result.returncode == 0, result.stderr
    value, cache_folder = result.stdout.split()
    assert value == "42.0"
    (line,) = result.stderr.splitlines()  # as the commands warn: no file and line of ours
    assert line.startswith("Warning: no folder for compiled kernels can be written") and "set NUMBA_CACHE_DIR" in line
    assert "kaneflex-numba-" in cache_folder and not Path(cache_folder).exists()  # removed at exit


def test_a_writable_folder_is_left_to_numba(tmp_path):
    copy_with_blocked_pycache(tmp_path)
    result = run_copy(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert result.returncode == 0, result.stderr
    assert "NUMBA_CACHE_DIR" not in result.stderr
    assert list((tmp_path / "cache").rglob("kernel.double*.nbi"))


LOOP = """
import numpy as np
from numba import njit
from kaneflex.integrate import lanes
from kaneflex.integrate.conventions import FASTMATH, LANES
from kaneflex.integrate.lanes import load, store
from kaneflex.support.fingerprint import made_of

@njit(cache=True, error_model="numpy", fastmath=FASTMATH)
@made_of(lanes.__file__)
def doubled(x):
    store(x, 0, load(x, 0) + load(x, 0))
"""
CALL = "import loop; x = loop.np.ones((1, loop.LANES)); loop.doubled(x); print(x[0, 0])"


def test_what_a_cached_loop_is_made_of_is_compiled_anew_after_an_edit(tmp_path):
    """numba looks at the loop's own file only; its parts are in others, all of which test_house finds stamped."""
    package = tmp_path / "kaneflex"
    shutil.copytree(Path(kaneflex.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "loop.py").write_text(LOOP)
    environment = os.environ | {
        "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(tmp_path / "bytecode"),
    }  # fmt: skip

    def called() -> float:
        command = [sys.executable, "-c", CALL]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment, check=True)
        return float(done.stdout)

    assert called() == called() == 2.0
    part = package / "integrate" / "lanes.py"
    text, added = part.read_text(), '((operator.add, operator.iadd), "fadd")'
    assert text.count(added) == 1
    part.write_text(text.replace(added, added.replace("fadd", "fsub")))
    assert called() == 0.0


def test_a_first_run_compiles_the_motion_and_the_steps_once_and_nothing_else(tmp_path):
    """One specialisation of each function that Python calls; what these call is compiled with them."""
    command = [sys.executable, "-m", "kaneflex", "run", "engine", "--no-plots", "-o", str(tmp_path / "results")]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert result.returncode == 0, result.stderr
    compiled = sorted(path.name.partition("-")[0] for path in (tmp_path / "cache").rglob("*.nbc"))
    assert compiled == [
        "beam_euler_bernoulli.element_matrices", "corrections.corrected", "engine.tabulate",
        "instants.eighths", "instants.equations", "instants.mean_products", "kernels.multiply_rows",
    ]  # fmt: skip
