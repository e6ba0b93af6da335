"""Types of mechanisms and tables that compiled functions receive: all arrays of a mechanism, by name."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from numba import types
from numba.types import CPointer, Type, float64, int64

from kaneflex.multibody.compile.types import Fixed, Handed, N, Z
from kaneflex.multibody.compile.values import Vectors
from kaneflex.multibody.dynamics.arrays import FIXED, NUMBERS, TWISTS, VECTORS
from kaneflex.multibody.model.layout import Kind
from kaneflex.multibody.time.coefficients import Table

_TABLES = {
    "plan": Fixed(1), "bodies": Fixed(8), "acts": Fixed(6), "w": N, "pivots": CPointer(int64),
    "kernels": CPointer(int64), "p": N, "real": N, "pair": Z,
}  # fmt: skip


def _handed(kind: Kind) -> Handed:
    fixed: dict[str, Type] = {name: Fixed(width) for name, width in FIXED.items()}
    vectors = dict.fromkeys(VECTORS, Vectors(float64, 3)) | dict.fromkeys(TWISTS, Vectors(float64, kind.d))
    return Handed(kind.value, kind.d, **_TABLES, **fixed, **dict.fromkeys(NUMBERS, N), **vectors)


HANDED = {kind: _handed(kind) for kind in Kind}
"""All numbers of a mechanism of each kind for compiled code, as :data:`kaneflex.multibody.dynamics.arrays.ORDER` names
them."""
TABLE = Handed("Table", **dict(zip(Table._fields, [N] * 7 + [Z] * 3, strict=True)))
"""Coefficients of a collocation method."""


def typed(entries: Mapping[str, str], m: Any) -> dict[Any, Any]:
    """Compiled functions with their signatures as types; ``m``: the type of a mechanism."""
    found, names = {}, {**vars(types), "N": N, "TABLE": TABLE, "m": m}
    for path, signature in entries.items():
        module, _, name = path.rpartition(".")
        found[getattr(import_module(f"kaneflex.multibody.{module}"), name)] = eval(signature, names)
    return found
