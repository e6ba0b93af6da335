"""Where kernels are cached when the usual folders can't be written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit, types

import kaneflex
from kaneflex.stamp import stamp

KERNEL = "import numba\n\n\n@numba.njit(cache=True)\ndef double(x):\n    return 2.0 * x\n"


def run_copy(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Import a copy of kaneflex from `folder`, then compile a cached kernel that lies beside it."""
    code = "import kaneflex, kernel, numba; print(kernel.double(21.0)); print(numba.config.CACHE_DIR)"
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    inherited |= {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=300, env=inherited | environment
    )


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
    assert "set NUMBA_CACHE_DIR" in result.stderr
    assert "kaneflex-numba-" in cache_folder and not Path(cache_folder).exists()  # removed at exit


def test_a_writable_folder_is_left_to_numba(tmp_path):
    copy_with_blocked_pycache(tmp_path)
    result = run_copy(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert result.returncode == 0, result.stderr
    assert "NUMBA_CACHE_DIR" not in result.stderr
    assert list((tmp_path / "cache").rglob("kernel.double*.nbi"))


MOTION = """
import numpy as np
from integrate_cases import affine
from kaneflex.integrate.run import integrate
system = affine(1, 0, {"M": [np.eye(1)], "C": [np.eye(1)], "K": [np.eye(1)]}, np.ones((1, 1)))
print(integrate(system, lambda t: np.ones((len(t), 1)), 0.0, 0.1, 1, METHOD).v[-1, 0])
"""


@pytest.mark.parametrize(
    ("method", "file", "before", "after"),
    [
        ("exact-modal", "matrices.py", "+ scalar * data[offset + i]", "+ 2.0 * scalar * data[offset + i]"),
        ("newmark", "lanes.py", '((operator.add, operator.iadd), "fadd")', '((operator.add, operator.iadd), "fsub")'),
    ],
)
def test_what_a_cached_loop_is_made_of_is_compiled_anew_after_an_edit(tmp_path, method, file, before, after):
    """numba looks at the loop's own file only; its parts are in others."""
    package = tmp_path / "kaneflex"
    shutil.copytree(Path(kaneflex.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).parent)]),
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1",
    }  # fmt: skip

    def moved() -> float:
        command = [sys.executable, "-c", MOTION.replace("METHOD", repr(method))]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment, check=True)
        return float(done.stdout)

    first = moved()
    assert moved() == first
    part = package / "integrate" / file
    text = part.read_text()
    assert text.count(before) == 1
    part.write_text(text.replace(before, after))
    assert moved() != first


@pytest.mark.parametrize("part", [__file__, kaneflex.__file__])
def test_loops_with_stamps_of_their_own_meet_in_one_process(part):
    """Compiled beforehand, the later one would not be found if numba took its stamp for that of the first."""
    own = stamp(part)

    @njit
    def loop(x, made_of=own):
        return 2.0 * x

    loop.compile(types.float64(types.float64, types.Omitted(own)))
    loop.disable_compile()
    assert loop(1.0) == 2.0
