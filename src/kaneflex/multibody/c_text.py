"""C spellings of numbers, types and names."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from numba import types

from kaneflex.multibody.tables import Fixed, Handed
from kaneflex.support.c_language import RESERVED

Expression = tuple[str, Any]
"""C text of an expression, and its type."""
NAMES = {types.void: "void", types.boolean: "bool", types.int64: "int64_t", types.float64: "double",
          types.complex128: "double complex"}  # fmt: skip
WIDTH = (types.boolean, types.int64, types.float64, types.complex128)
"""Numeric types, the narrowest first."""


def type_name(of: Any) -> str:
    """C name of a type."""
    if isinstance(of, types.CPointer):
        return f"{NAMES[of.dtype]} *"
    if isinstance(of, Fixed):
        return "const int64_t *"
    if isinstance(of, Handed):
        return f"const {handed_name(of)} *"
    return NAMES[of]


def handed_name(of: Handed) -> str:
    return of.name.split()[0].lower()


def declared(of: Any, name: str) -> str:
    """C declaration of an argument or variable."""
    kind = type_name(of)
    return f"{kind}{name}" if kind.endswith("*") else f"{kind} {name}"


def handed_structure(of: Handed) -> str:
    """C definition of a structure passed by address."""
    parts = "".join(f"    {declared(kind, name)};\n" for name, kind in of.parts.items() if name != "kernels")
    return f"typedef struct {{\n{parts}}} {handed_name(of)};\n"


def wider(one: Any, other: Any) -> Any:
    if one == other:
        return one
    return max(one, other, key=WIDTH.index)


def constant(value: object) -> Expression:
    if isinstance(value, bool):
        return str(value).lower(), types.boolean
    if isinstance(value, int):
        return (str(value) if value >= 0 else f"({value})"), types.int64
    if isinstance(value, complex):
        return f"({value.real!r} + {value.imag!r} * I)", types.complex128
    assert isinstance(value, float)
    if math.isinf(value):
        return ("INFINITY" if value > 0 else "(-INFINITY)"), types.float64
    if math.isnan(value):
        return "NAN", types.float64
    return (repr(value) if value >= 0 else f"({value!r})"), types.float64


@cache
def safe(name: str) -> str:
    """Name that is allowed for a C variable."""
    return f"{name}_" if name in RESERVED or name in ("I", "bool", "complex", "true", "false") else name


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
