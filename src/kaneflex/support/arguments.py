"""Type checks of the arguments of public functions; the error says how to get the right type."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])


class Kind(NamedTuple):
    """Kind of argument: its name in a message, a test of a value, and how to get one."""

    name: str
    fits: Callable[[Any], bool]
    cure: str


def takes(**kinds: str) -> Callable[[Function], Function]:
    """Check arguments by the names of their kinds in KINDS before a function is called.

        The argument's default is accepted, too. Raises TypeError like "load takes a Scene, not str: read_scene(...)
    makes one".
    """

    def decorate(function: Function) -> Function:
        signature = inspect.signature(function)
        first = next(iter(signature.parameters))

        @functools.wraps(function)
        def checked(*arguments: Any, **named: Any) -> Any:
            given = signature.bind(*arguments, **named).arguments
            for argument, kind in kinds.items():
                value, wanted = given.get(argument), KINDS[kind]
                default = argument not in given or value is signature.parameters[argument].default
                if not (default or wanted.fits(value)):
                    place = "" if argument == first else f" as {argument}"
                    found = f"{function.__name__} takes {wanted.name}{place}, not {_called(value)}"
                    raise TypeError(f"{found}: {wanted.cure}")
            return function(*arguments, **named)

        return checked  # type: ignore[return-value]

    return decorate


def _called(value: object) -> str:
    """Name of the type of a value; for a list also the types of its items."""
    inside = {type(each).__name__ for each in value} if isinstance(value, list | tuple) else ()
    return f"{type(value).__name__} of {' and '.join(sorted(inside))}" if inside else type(value).__name__


def _ours(name: str) -> Callable[[Any], bool]:
    """Test for instances of kaneflex's class of this name, without importing it."""
    return lambda value: any(
        each.__name__ == name and each.__module__.startswith("kaneflex.") for each in type(value).__mro__
    )


def _texts(value: Any) -> bool:
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        return False
    return not isinstance(value, list | tuple) or all(isinstance(each, str) for each in value)


def _number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _whole(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _numbers(value: Any) -> bool:
    return isinstance(value, Iterable) and np.asarray(value).ndim == 1 and np.asarray(value).dtype.kind in "fiu"


def _kernels(value: Any) -> bool:
    if isinstance(value, ModuleType):  # of an element, a structure, or laws
        return hasattr(value, "LINK_SCALARS") or hasattr(value, "DRIVES")
    return hasattr(value, "shapes") and hasattr(value, "parameters")


_SCENE, _MODEL, _SOLUTION, _STATE = (_ours(name) for name in ("Scene", "Model", "Solution", "State"))


def _scene_like(value: Any) -> bool:
    return isinstance(value, str | Path) or _SCENE(value) or _MODEL(value) or _SOLUTION(value)


KINDS = {
    "scene": Kind("a Scene, Model, Solution or path", _scene_like, "read_scene(...) makes a Scene"),
    "model": Kind("a Model, Solution, Scene or path", _scene_like, "load(scene) makes a Model"),
    "loaded": Kind("a Model", _MODEL, "load(scene) makes one"),
    "solution": Kind("a Solution", _SOLUTION, "simulate(model) makes one"),
    "state": Kind("a Solution or a State", lambda value: _SOLUTION(value) or _STATE(value), "read_state(path) has one"),
    "tables": Kind("tables or a text", lambda value: isinstance(value, str | Mapping), "give {'bodies': ...}, or TOML"),
    "study": Kind(
        "a study", lambda value: isinstance(value, str | os.PathLike | Mapping) or _ours("Plan")(value),
        "give the path of its file, or {'scene': ..., 'parameters': ...}",
    ),
    "path": Kind("a path", lambda value: isinstance(value, str | os.PathLike), "give a text or a pathlib.Path"),
    "text": Kind("a text", lambda value: isinstance(value, str), "write it in quotes"),
    "points": Kind("paths by point", lambda value: isinstance(value, Mapping), "write {'start': 'bore.txt'}"),
    "texts": Kind("a list of texts", _texts, "write ['...', '...']"),
    "settings": Kind(
        "a list or a dict of settings",
        lambda value: isinstance(value, str) or _texts(list(value) if isinstance(value, Mapping) else value),
        "write {'rod.I': '7000 mm^4'} or ['rod.I=1']",
    ),
    "number": Kind("a number", _number, "give it in SI, without a unit"),
    "whole": Kind("a whole number", _whole, "give one like 4"),
    "numbers": Kind("a list of numbers", _numbers, "give them in SI, like [100.0, 200.0]"),
    "function": Kind("a function", callable, "give a function of one argument"),
    "places": Kind("places of drives", lambda value: isinstance(value, Mapping), "write {'main': 0.5}"),
    "kernels": Kind(
        "a generated module or a mechanism's kernels", _kernels, "kaneflex.generated.engine and model.kernels are such"
    ),
}  # fmt: skip
