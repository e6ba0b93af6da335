"""C spellings of numbers, types and names."""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterable
from typing import Any

from numba import types

from kaneflex.support.c_language import RESERVED

Expression = tuple[str, Any]
"""C text of an expression, and its type."""
NAMES = {types.void: "void", types.boolean: "bool", types.int64: "int64_t", types.float64: "double",
          types.complex128: "double complex"}  # fmt: skip
_LETTERS = {types.boolean: "b", types.int64: "i", types.float64: "d", types.complex128: "z"}
WIDTH = (types.boolean, types.int64, types.float64, types.complex128)
"""Numeric types, the narrowest first."""


class ReadOnly(types.CPointer):
    """Address of numbers that a function only reads."""

    @property
    def key(self) -> Any:
        return "read", self.dtype


class Square(types.Type):
    """Address of a matrix with rows of 6 numbers."""

    def __init__(self) -> None:
        super().__init__("Square")


class Structures:
    """Structures of the types that are no numbers: C names, added to ``taken``, and definitions in C's order."""

    def __init__(self, taken: set[str]) -> None:
        self.definitions, self._taken = dict[str, str](), taken
        self._names: dict[Any, str] = {}

    def declared(self, of: Any, name: str = "") -> str:
        """C declaration of an argument or variable of this type; the type alone without a name."""
        if isinstance(of, Square):
            return f"double {name}[6][6]"
        kind = self._name(of)
        return f"{kind}{name}" if kind.endswith("*") else f"{kind} {name}".rstrip()

    def _name(self, of: Any) -> str:
        if of in NAMES:
            return NAMES[of]
        if isinstance(of, types.CPointer):
            return f"{'const ' * isinstance(of, ReadOnly)}{NAMES[of.dtype]} *"
        if hasattr(of, "width"):
            return "const int64_t *"
        if of not in self._names:
            self._names[of] = self._structure(of)
        return self._names[of]

    def _structure(self, of: Any) -> str:
        if hasattr(of, "parts"):
            parts = ((safe(name), kind) for name, kind in of.parts.items())
            return f"const {self._defined(of.name.split()[0].lower(), parts)} *"
        if isinstance(of, types.BaseNamedTuple):
            return self._defined(f"{of.instance_class.__name__.lower()}_record", parts_of(of))
        if isinstance(of, types.BaseTuple):
            letters = "".join(_LETTERS.get(kind) or re.sub(r"\W", "", self._name(kind)) for kind in of.types)
            return self._defined(f"several_{letters}", parts_of(of))
        return f"{self._name(types.UniTuple(of.dtype, of.d))} *"

    def _defined(self, stem: str, parts: Iterable[tuple[str, Any]]) -> str:
        inside = "".join(f"    {self.declared(kind, part)};\n" for part, kind in parts)
        free = (name for k in range(1, 1000) if (name := f"{stem}_{k}" if k > 1 else stem) not in self._taken)
        name = next(free)
        self._taken.add(name)
        self.definitions[name] = f"typedef struct {{\n{inside}}} {name};\n"
        return name


def parts_of(of: Any) -> list[tuple[str, Any]]:
    """C names and types of the parts of a tuple."""
    names = getattr(of, "fields", [f"_{k}" for k in range(len(of.types))])
    return [(safe(name), kind) for name, kind in zip(names, of.types, strict=True)]


def wider(one: Any, other: Any) -> Any:
    """The type that holds the numbers of both; ValueError if there is none."""
    return one if one == other else max(one, other, key=WIDTH.index)


def constant(value: object) -> Expression:
    """C text and type of a number; TypeError for what is none."""
    if isinstance(value, bool):
        return str(value).lower(), types.boolean
    if isinstance(value, int):
        return (str(value) if value >= 0 else f"({value})"), types.int64
    if isinstance(value, complex):
        return f"CMPLX({value.real!r}, {value.imag!r})", types.complex128
    if not isinstance(value, float):
        raise TypeError(value)
    if math.isinf(value):
        return ("INFINITY" if value > 0 else "(-INFINITY)"), types.float64
    if math.isnan(value):
        return "NAN", types.float64
    return (repr(value) if value >= 0 else f"({value!r})"), types.float64


def safe(name: str, taken: Container[str] = ()) -> str:
    """Name that is allowed for a C variable, and is none of these."""
    while name in _RESERVED or name in taken:
        name += "_"
    return name


_RESERVED = {*RESERVED, "I", "bool", "complex", "true", "false", "int64_t", "remainder_of", "whole_remainder_of",
             "quotient_of"}  # fmt: skip


def bare(text: str) -> str:
    """Text without its outer parentheses."""
    if not text.startswith("("):
        return text
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return text[1:-1] if k == len(text) - 1 else text
    return text


def grouped(text: str) -> str:
    return text if (text.startswith("(") and bare(text) != text) or text.replace("_", "").isalnum() else f"({text})"
