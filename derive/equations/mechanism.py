"""A scene's mechanism in symbols.

Built from `structure_of(scene)` alone, so that nothing can enter the equations that the structure hash
does not know: a number of the scene is here either a symbol (a run-time parameter) or exactly 0, 1 or -1. Bodies,
joints and the like are numbered, their names are kept beside them (see :mod:`kaneflex.derive.ir.names`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy as sm

from kaneflex.derive.ir.names import Names, numbered
from kaneflex.mechanism.mechanism import read
from kaneflex.mechanism.parts import Mechanism
from kaneflex.mechanism.planar import GROUND


@dataclass
class Parameters:
    """Parameters in the order in which they are first used: path in the scene -> symbol, unit."""

    entries: dict[str, tuple[sm.Symbol, str]] = field(default_factory=dict)

    def __call__(self, path: str, unit: str) -> sm.Symbol:
        if path not in self.entries:
            self.entries[path] = (_symbol(path), unit)
        return self.entries[path][0]


def _symbol(path: str) -> sm.Symbol:
    """bodies.body@1.points.point@1.x is body@1_point@1_x: the numbers tell the tables."""
    table, _, inside = path.partition(".")
    words = path if table in (GROUND, "gravity") else inside.replace(".points.", ".")
    return sm.Symbol(words.replace(".", "_"))


@dataclass(frozen=True)
class SymbolicMechanism(Mechanism):
    """A mechanism whose numbers are symbols.

    ``parameters`` maps the dotted path of a scene's number to its symbol and unit; ``names`` has what the scene calls
    bodies, joints, masses, loads, springs and points, which are numbered everywhere else.
    """

    parameters: dict[str, tuple[sm.Symbol, str]]
    names: Names

    def symbol(self, path: str) -> sm.Symbol:
        return self.parameters[path][0]

    @property
    def tables(self) -> tuple[str, ...]:
        """Paths of the loads and drives that are tables."""
        readers = {"loads": self.loads, "drives": self.drives}
        return tuple(
            f"{kind}.{name}" for kind, of in readers.items() for name, reader in of.items() if reader.kind == "table"
        )

    def parameter(self, path: str, unit: str) -> sm.Symbol:
        """The symbol of a number that no scene gives but the derivation needs; entered on first use."""
        return Parameters(self.parameters)(path, unit)


def read_structure(structure: Mapping[str, Any]) -> SymbolicMechanism:
    """Turn `structure_of(scene)` into symbols."""
    structure, names = numbered(structure)
    parameters = Parameters()

    def pattern(path: str, unit: str, entry: Any) -> sm.Expr:
        """An exact 0, 1, -1 stays a number; everything else is a parameter."""
        return sm.Integer(entry) if isinstance(entry, int) else parameters(path, unit)

    return SymbolicMechanism(**vars(read(structure, pattern)), parameters=parameters.entries, names=names)
