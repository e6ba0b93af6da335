"""Kernels as Python executes them, operation by operation."""

from types import FunctionType, ModuleType, SimpleNamespace


def interpreted(module: ModuleType) -> SimpleNamespace:
    """The names of a module of kernels, which call each other without numba."""
    names = {name: getattr(value, "py_func", value) for name, value in vars(module).items()}
    for name, value in names.items():
        if isinstance(value, FunctionType) and value.__module__ == module.__name__:
            names[name] = FunctionType(value.__code__, names)
    return SimpleNamespace(**names)
