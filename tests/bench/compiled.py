"""C to a shared library, as ``cc -O3 -march=native`` makes it."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np

from kaneflex.support.c_compiler import c_compiler

FLAGS = ("-O3", "-march=native")
HERE = Path(__file__).parent


def demand_compiler() -> str:
    """Path of the C compiler.

    Raises
    ------
    SystemExit
        If there is none.
    """
    if not (found := c_compiler()):
        raise SystemExit("no C compiler is found: install gcc or clang, or name one in CC")
    return found[0]


def compile_c(source: Path, folder: Path, compiler: str, *options: str) -> ctypes.CDLL:
    """The library of one C file, loaded."""
    library = folder / f"{source.stem}.so"
    command = [compiler, *FLAGS, *options, "-shared", "-fPIC", str(source), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library))


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    """The address of an array's first number; the caller keeps the array alive."""
    return array.ctypes.data_as(ctypes.c_void_p)
