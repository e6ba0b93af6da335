"""Loops over the shapes of a body by their kinds (:mod:`kaneflex.derive.bodies.kinds`), as text.

One loop for each kind, in it one for each kind with which its shapes form pairs. All numbers are read one after the
other from p[o], so that an address is never computed.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import sympy as sm

from kaneflex.derive.bodies.kinds import SPACE, Kinds, numbers
from kaneflex.derive.printers.bracketed import reads
from kaneflex.derive.printers.numba_printer import NumbaPrinter

INDENT = "    "
_VECTORS = {"q": "q[i + {}]", "v": "v[i + {}]", "b": "b[i + {}]"}
"""Places of modal coordinates, their rates and their accelerations."""
_LINE = 108  # a kernel's loops stand three levels deep


@dataclass
class Shape:
    """Numbers and sums of the j-th shape of a kind, as the statements of its loop may use them.

    ``own`` has the numbers that are used; ``sums``: kind -> (stored name, vector) -> symbol of the sum over its shapes.
    """

    kind: str
    kinds: Kinds = SPACE
    own: list[str] = field(default_factory=list)
    sums: dict[str, dict[tuple[str, str], sm.Symbol]] = field(default_factory=dict)

    def single(self, name: str) -> sm.Expr:
        """A sum over the mass of this shape alone."""
        value = numbers(self.kind, kinds=self.kinds).of.get(name, sm.S.Zero)
        self.own += [str(symbol) for symbol in value.free_symbols]
        return value.xreplace({symbol: sm.Symbol(f"{symbol}_0") for symbol in value.free_symbols})

    def total(self, name: str, vector: str) -> sm.Expr:
        """Sum over all pairs of this shape, times the vector's entry of the other one."""
        found = sm.S.Zero
        for other in self.kinds.names:
            value = numbers(self.kind, other, self.kinds).of.get(name, sm.S.Zero)
            sums = self.sums.setdefault(other, {})
            for stored in sorted(map(str, value.free_symbols)):
                symbol = sums.setdefault((stored, vector), sm.Symbol(f"{stored}_{other}{vector}"))
                value = value.xreplace({sm.Symbol(stored): symbol})
            found += value
        return found

    def grown(self, name: str) -> sm.Expr:
        """The first and the second together."""
        return self.single(name) + self.total(name, "q")


Statements = Callable[[Shape], list[str]]
Stores = Callable[[str, str], list[str]]


def loops(statements: Statements, stores: Stores = lambda a, b: [], kinds: Kinds = SPACE) -> list[str]:
    """Lines of all loops; ``statements`` of every shape j, ``stores`` of every pair j, l by their kinds."""
    lines = []
    for kind in kinds.names:
        shape = Shape(kind, kinds)
        after = statements(shape)
        body = _read(shape, after)
        for other in kinds.names:
            body += _inner(shape, other, stores(kind, other))
        lines += [f"for j in range({bounds(kind, kinds)}):", *(INDENT + line for line in [*body, *after])]
    return lines


def bounds(kind: str, kinds: Kinds = SPACE) -> str:
    """First shape of a kind, and the one behind its last."""
    before = kinds.names[: kinds.names.index(kind)]
    return f"{f'to_{before[-1]}, ' if before else ''}to_{kind}"


def ends(kinds: Kinds) -> list[str]:
    """Statements that read the ends of the kinds among the shapes."""
    *first, last = kinds.names
    lines = [f"to_{kind} = {f'to_{first[k - 1]} + ' if k else ''}int(p[o{f' + {k}' if k else ''}])"
             for k, kind in enumerate(first)]  # fmt: skip
    return [*lines, f"to_{last} = count", f"o += {len(first)}"]


def _read(shape: Shape, after: Iterable[str]) -> list[str]:
    """Reads of a shape's own numbers and coordinates, and zeros of its sums."""
    text, stored = " ".join(after), numbers(shape.kind, kinds=shape.kinds).stored
    places = {f"{x}_j": place.format("j") for x, place in _VECTORS.items() if f"{x}_j" in text}
    places |= {f"{name}_0": f"p[o{f' + {k}' if k else ''}]" for k, name in enumerate(stored) if name in shape.own}
    sums = (symbol for of in shape.sums.values() for symbol in of.values())
    return [*reads(places.items()), f"o += {len(stored)}", *zeroed(sums)]


def zeroed(names: Iterable[object]) -> list[str]:
    """Statements that set so many names to zero."""
    names = list(map(str, names))
    return [" = ".join([*names[k : k + 8], "0.0"]) for k in range(0, len(names), 8)]


def _inner(shape: Shape, other: str, stores: list[str]) -> list[str]:
    """Loop over the pairs with another kind, if there are such."""
    stored, body = numbers(shape.kind, other, shape.kinds).stored, list[str]()
    for k, name in enumerate(stored):
        at, one = f"p[o{f' + {k}' if k else ''}]", f"{name}_l"
        sums = {vector: symbol for (of, vector), symbol in shape.sums.get(other, {}).items() if of == name}
        if len(sums) > 1 or any(one in line for line in stores):
            body.append(f"{one} = {at}")
            at = one
        body += [f"{symbol} += {at} * {_VECTORS[vector].format('l')}" for vector, symbol in sums.items()]
    lines = [*body, *stores, f"o += {len(stored)}"]
    return [f"for l in range({bounds(other, shape.kinds)}):", *(INDENT + line for line in lines)] if stored else []


def named(values: Mapping[str, sm.Expr]) -> tuple[list[str], dict[str, sm.Expr]]:
    """Statements for the expressions that are more than one symbol, and what to write in their place."""
    lines, found, known = [], {}, {}
    for name, value in values.items():
        if value != 0:
            if not value.is_Symbol and value not in known:
                lines.append(f"{name} = {code(value)}")
                known[value] = sm.Symbol(name)
            found[name] = known.get(value, value)
    return lines, found


def grow(values: Mapping[str, sm.Expr]) -> list[str]:
    """A statement for each sum that adds to it."""
    return [line for name, value in values.items() if value != 0 for line in added(name, value)]


def code(expression: sm.Expr) -> str:
    """An expression as it is written by hand."""
    return ast.unparse(ast.parse(NumbaPrinter().doprint(expression)))


def added(target: str, expression: sm.Expr) -> list[str]:
    """A statement that adds an expression, or subtracts what is negative; over several lines if it is long."""
    sign = "-" if expression.could_extract_minus_sign() else "+"
    line = f"{target} {sign}= {code(-expression if sign == '-' else expression)}"
    if len(line) <= _LINE:
        return [line]
    head, _, rest = line.partition(f" {sign}= ")
    rest = re.sub(r" ([+-]) (?![^\[(]*[\])])", r"\n\1 ", rest).split("\n")  # before the signs outside of all brackets
    lines = [INDENT + rest[0]]
    for term in rest[1:]:
        if len(lines[-1]) + len(term) < _LINE:
            lines[-1] += f" {term}"
        else:
            lines.append(INDENT + term)
    return [f"{head} {sign}= (", *lines, ")"]
