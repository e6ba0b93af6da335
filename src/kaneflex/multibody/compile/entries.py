"""Functions of the compiled engine that Python calls, with their signatures and sources; numba is not imported here."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from kaneflex.multibody.model.layout import Kind
from kaneflex.support.c_library import PACKAGE

_BOTH = {
    "dynamics.entries.courses_at": "void(m, N, int64, N, int64)",
    "dynamics.entries.magnitudes_at": "void(m, N, int64, N, int64, N, int64)",
    "dynamics.entries.project": "int64(m, float64, N, N)",
    "dynamics.entries.unfold": "int64(m, N, int64, int64, N)",
    "dynamics.entries.place": "void(m, N)",
    "dynamics.entries.follow": "int64(m, N, int64, N)",
    "dynamics.entries.mass": "void(m, N)",
    "dynamics.reduction.reduced_demand": "int64(m, CPointer(int64), int64, N, int64, N, int64, N)",
    "dynamics.reduction.basis": "void(m, CPointer(int64), int64, N)",
    "dynamics.independent_speeds.openings": "void(m, float64, N)",
    "dynamics.independent_speeds.choose": "void(m, CPointer(int64), CPointer(int64))",
}
_INTEGRATE = {"time.collocation.integrate": "int64(m, TABLE, N, N, N, int64, N, int64, N, N, N, int64)"}
PLANE = _BOTH | _INTEGRATE
PRESCRIBED = _BOTH | {
    "dynamics.entries.close": "boolean(m, N)",
    "dynamics.entries.advance": "void(m, N, int64, N)",
}
SPACE = PRESCRIBED | _INTEGRATE
EXPORTED = _INTEGRATE | {
    "dynamics.exported_entries.read": "void(m, N)",
    "dynamics.exported_entries.change": "int64(m, N, CPointer(int64), N, boolean)",
    "dynamics.exported_entries.accelerate": "boolean(m, float64, N, N, N, N)",
}
"""Functions in the plane, in space for motions that drives prescribe, for all, and of exported C; with their
signatures: ``m`` is the mechanism, ``N`` the address of numbers, ``TABLE`` that of a collocation method."""


LIBRARIES = *((kind, True) for kind in Kind), (Kind.RIGID_SPACE, False)
"""Kinds of mechanisms, and whether the library integrates: of prescribed motions only rigid bodies have their own."""


def entries_of(kind: Kind, integrates: bool) -> Mapping[str, str]:
    """Functions of the library of a kind of mechanism, with their signatures."""
    return PLANE if kind.d == 3 else SPACE if integrates else PRESCRIBED


def sources() -> list[Path]:
    """Files of the engine's compiled functions: those that mention numba, and those of their constants."""
    multibody, folder = PACKAGE / "multibody", Path(str(import_module("kaneflex.generated").__file__)).parent
    files = [each for name in ("compile", "dynamics", "time", "unilateral") for each in (multibody / name).glob("*.py")]
    constants = ("model/codes", "model/layout", "model/tree_layout", "dynamics/arrays", "time/coefficients")
    names = ("contact", "friction", "joints", "shapes", "spatial", "spatial_shapes")
    return sorted([
        *(each for each in files if b"numba" in each.read_bytes()), PACKAGE / "support" / "inner.py",
        *(multibody / f"{name}.py" for name in constants), *(folder / f"{name}.py" for name in names),
    ])  # fmt: skip


@contextmanager
def compiling() -> Iterator[None]:
    """Silence numba's warning about first-class function types during compilation."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "First-class function type")
        yield
