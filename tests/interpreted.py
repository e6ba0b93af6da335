"""Kernels as Python executes them, operation by operation."""

from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from kaneflex.support.contract import ELEMENT_KERNELS


def interpreted(module: ModuleType) -> SimpleNamespace:
    """The names of a module of kernels, which call each other without numba."""
    names = {name: getattr(value, "py_func", value) for name, value in vars(module).items()}
    for name, value in names.items():
        if isinstance(value, FunctionType) and value.__module__ == module.__name__:
            names[name] = FunctionType(value.__code__, names)
    return SimpleNamespace(**names)


def every_kernel(module: Any, p: np.ndarray, s: np.ndarray) -> dict[str, np.ndarray]:
    """Every kernel of an element's module at its parameters p and at scalars s of the motion."""
    size = 12 if len(module.LINK_SCALARS) > 5 else 6
    found = {name: np.zeros((size,) if name == "F" else (size, size)) for name in ELEMENT_KERNELS}
    for name, out in found.items():
        getattr(module, name)(*((p, out) if name in ("M", "K_s") else (p, s, out)))
    return found
