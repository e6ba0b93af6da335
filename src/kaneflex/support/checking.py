"""Wrappers of generated kernels that check their arrays first.

Compiled kernels do not check array sizes; a short array causes out-of-bounds access. These wrappers cost some
microseconds per call; use them for trying things out. Jitted code cannot call them.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from types import ModuleType, SimpleNamespace
from typing import Any, Protocol

import numpy as np

from kaneflex.support.arguments import takes
from kaneflex.support.contract import ELEMENT_KERNELS

Shape = tuple[int, ...]


class MechanismKernels(Protocol):
    """Attributes of ``kaneflex.mechanism.kernels.Kernels`` that are checked here."""

    parameters: Any
    shapes: Any


_TABLES = ("table", ".seed_c", ".seed_s", ".seed_slide")
"""Name endings of the numbers in p that hold the start of a table."""
_PLACES = {"x": "i", "out": "k"}
"""Argument -> the argument that holds the start of a kernel's numbers in it."""


@takes(module="kernels")
def checked(module: ModuleType | MechanismKernels) -> SimpleNamespace:
    """Checked kernels of a generated module or a mechanism, which raise for an array of the wrong size.

    Parameters
    ----------
    module : ModuleType or Kernels
        Module or kernels, like ``kaneflex.generated.engine``, ``model.module``, ``model.coupled.module`` or
        ``model.kernels``.

    Returns
    -------
    SimpleNamespace
        The module's tables, and its kernels by name. A kernel raises TypeError unless the argument is an array of
        float64, and ValueError for a wrong shape or for a table that ends beyond p; both name the argument. A module
        accepts a p longer than required, a mechanism only its own p.

    >>> from kaneflex.generated import engine
    >>> checked(engine).M(np.zeros(4), np.zeros((6, 6)))
    Traceback (most recent call last):
        ...
    ValueError: M: p has shape (4,), at least (5,) is required
    """
    if not isinstance(module, ModuleType):
        return SimpleNamespace(**vars(module), **{name: _of_mechanism(name, module) for name in module.shapes})
    public = {name: value for name, value in vars(module).items() if not name.startswith("_")}
    kernels = {name: _wrapped(name, module, shapes) for name, shapes in _shapes(module).items() if name in public}
    return SimpleNamespace(**public | kernels)


def _shapes(module: ModuleType) -> dict[str, dict[str, Shape]]:
    """Shapes by kernel and argument; -1 stands for any length."""
    found = dict[str, dict[str, Shape]]()
    if hasattr(module, "DRIVES"):  # kernels of laws share long arrays by offsets
        numbers: dict[str, Shape] = {"p": (len(module.PARAMETERS),)}
        prescribed = sum(kind != "free" for kind in module.DRIVES.values())
        found |= {"courses": numbers | {"out": (3 * prescribed,)}, "magnitudes": numbers | _of_laws(module)}
    if not hasattr(module, "LINK_SCALARS"):
        return found
    count = len(module.ELEMENT_PARAMETERS)
    # displacements and rotations of an element's two nodes; in the plane there is no a_z
    nodes = 12 if "a_z" in {name for name, *_ in module.LINK_SCALARS} else 6
    element: dict[str, Shape] = {"p": (count,), "s": (len(module.LINK_SCALARS),)}
    found |= {name: element | {"out": (nodes, nodes)} for name in ELEMENT_KERNELS if name != "F"}
    found["F"] = element | {"out": (nodes,)}
    if not hasattr(module, "FREE"):  # a module of elements, or of laws with the element of its links
        return found
    numbers = {"p": (len(module.PARAMETERS),)}
    scalars = len(module.SCALARS)
    return found | {
        "motion": numbers | {"s": (scalars,)},
        "tabulate": numbers | {"times": (-1,), "out": (-1, scalars)},
    }


def _of_laws(module: ModuleType) -> dict[str, Shape]:
    """Shapes of the joint arrays that a kernel of magnitudes reads and writes."""
    switches = len(getattr(module, "SWITCHES", ()))
    joints, loads = len(module.DRIVES) + len(getattr(module, "OBSERVED", ())), len(module.LOADS)
    return {"x": (3 * joints + switches if switches else 2 * joints,), "out": (loads + 2 * switches,)}


def _wrapped(name: str, module: ModuleType, shapes: Mapping[str, Shape]) -> Callable[..., None]:
    kernel = getattr(module, name)
    signature = inspect.signature(kernel.py_func)
    numbers = () if name in ELEMENT_KERNELS else module.PARAMETERS
    tables = [k for k, (path, _) in enumerate(numbers) if path.endswith(_TABLES)]

    @functools.wraps(kernel.py_func)
    def call(*arguments: object) -> None:
        given = signature.bind(*arguments).arguments
        for argument, shape in shapes.items():
            if argument in given:
                place = given.get(_PLACES.get(argument, ""))
                wanted = shape if place is None else (place + shape[0],)
                _check(f"{name}: {argument}", given[argument], wanted, longer=argument == "p" or place is not None)
        if "times" in given and len(given["out"]) < len(given["times"]):
            raise ValueError(f"{name}: out has {len(given['out'])} rows for {len(given['times'])} times")
        for k in tables:
            _check_table(f"{name}: p", given["p"], module.PARAMETERS[k][0], given["p"][k])
        kernel(*arguments)

    return call


def _of_mechanism(name: str, kernels: MechanismKernels) -> Callable[..., None]:
    kernel, own = getattr(kernels, name), kernels.parameters
    signature = inspect.signature(kernel.py_func)

    @functools.wraps(kernel.py_func)
    def call(*arguments: object) -> None:
        given = signature.bind(*arguments).arguments
        p = given["p"]
        if type(p) is not type(own):
            raise TypeError(f"{name}: p is a {type(p).__name__}, the parameters of the kernels are required")
        for part, mine in own._asdict().items():
            if isinstance(mine, np.ndarray) and p._asdict()[part].shape != mine.shape:
                raise ValueError(f"{name}: p belongs to another mechanism: its {part} have another length")
        for argument, shape in kernels.shapes[name].items():
            _check(f"{name}: {argument}", given[argument], shape, longer=False)
            if not given[argument].flags.c_contiguous:
                raise ValueError(f"{name}: {argument} is not contiguous, a contiguous copy is required")
        kernel(*arguments)

    return call


def _check(what: str, array: object, shape: Shape, longer: bool) -> None:
    if not isinstance(array, np.ndarray) or array.dtype != np.float64:
        kind = f"an array of {array.dtype}" if isinstance(array, np.ndarray) else f"a {type(array).__name__}"
        raise TypeError(f"{what} is {kind}, an array of float64 is required")
    right = array.ndim == len(shape) and all(
        wanted in (-1, size) or (longer and size > wanted) for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not right:
        wanted = str(shape).replace("-1", "any")
        raise ValueError(f"{what} has shape {array.shape}, {'at least ' if longer else ''}{wanted} is required")


def _check_table(what: str, p: np.ndarray, path: str, start: float) -> None:
    """Check a table in p: number of intervals, period, breakpoints and four coefficients per interval."""
    first = int(start) if np.isfinite(start) else -1
    count = p[first] if 0 <= first < len(p) else np.nan
    if not (count >= 1 and first + 3 + 5 * count <= len(p)):
        raise ValueError(f"{what} does not hold the whole table of {path}: it begins at {start:g} of {len(p)} numbers")
