"""Where and with what something was measured."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from kaneflex.support.c_compiler import c_compiler

PACKAGES = ("numba", "numpy", "scipy", "sympy", "casadi", "pydy", "cython", "exudyn")


def describe() -> dict[str, str]:
    """Date, processor, number of cores, versions."""
    found = {
        "date": datetime.date.today().isoformat(),
        "processor": processor(),
        "cores": str(os.cpu_count()),
        "Python": platform.python_version(),
        "C compiler": compiler(),
    }
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def processor() -> str:
    """Its name, as far as the system tells."""
    about = Path("/proc/cpuinfo")
    lines = about.read_text().splitlines() if about.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def compiler() -> str:
    """The first line of what it says of its version."""
    if not (found := c_compiler()):
        return "none"
    return subprocess.run([found[0], "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]
