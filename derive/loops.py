"""Equations of one shape of each kind as loops over any number of them.

With one axial and one transverse shape, the equations of a body are sums of moments times coordinates. Each index of a
moment belongs to a coordinate beside it, or to the row that the equation is; so every product names its sum over the
shapes: in the row of b, m_sw a is sum_l m_sw[j, l] a[l]. (That the sums are the equations of several shapes is not
taken for granted, but proved of the text that is printed: :mod:`kaneflex.derive.body_proof`.)
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import sympy as sm

from kaneflex.derive.printers.numba_printer import NumbaPrinter
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS
from kaneflex.support.contract import Slot, block_shapes

COORDINATES = {"s": sm.symbols("b0:3"), "w": sm.symbols("a0:3")}
"""Modal coordinate of an axial (s) and of a transverse shape (w), its rate and its acceleration."""
_ALL = (*COORDINATES["s"], *COORDINATES["w"])
_AXIS = {symbol: axis for axis, symbols in COORDINATES.items() for symbol in symbols}
_COUNT = {"s": "axial", "w": "transverse", "a": "shapes"}
_BEFORE = {"s": "", "w": "axial + "}
_VECTORS = ("q", "v", "a")
_INDENT = "    "
_LINE = 108  # a kernel's loops stand three levels deep

Rows = Mapping[str, list[str]]
"""Statements of the shapes of a kind."""
_NOTHING: Mapping = MappingProxyType({})


class Term(NamedTuple):
    """A number times an entry of a slot, whose indices run along ``axes``, times coordinates."""

    number: sm.Expr
    slot: Slot
    axes: str
    coordinates: tuple[sm.Symbol, ...]


def block_symbols(
    block: Sequence[Slot], axial: int, transverse: int
) -> Iterator[tuple[sm.Expr, Slot, tuple[int, ...]]]:
    """Every number of a block in the moments' symbols, with its slot and its index there."""
    for slot, shape in zip(block, block_shapes(block, axial, transverse).values(), strict=True):
        for index in product(*(range(count) for count in shape)):
            total = sum((sm.Symbol(_called(name, index)) for name in slot.of), sm.S.Zero)
            yield total - sum((sm.Symbol(_called(name, index)) for name in slot.less), sm.S.Zero), slot, index


def _called(name: str, index: tuple[int, ...]) -> str:
    """A moment by its name in the equations, which hold the upper triangle of what is symmetric."""
    axes, pattern, _ = (ARRAYS | POINT_ARRAYS).get(name, ("", name, ""))
    symmetric = len(axes) == 2 and axes[0] == axes[1]
    return pattern.format(*(sorted(index) if symmetric else index)) if axes else name


class Loops:
    """Two loops, over the axial and over the transverse shapes, with what they sum up.

    Equations are given with one shape of each kind, in the symbols of COORDINATES and of the moments; ``motion`` are
    the symbols that are no sums.
    """

    def __init__(self, block: Sequence[Slot], motion: Sequence[sm.Symbol] = ()) -> None:
        self._motion = tuple(motion)
        entries = block_symbols(block, 1, 1)
        self._entries = [(expression, slot, _axes(slot, index)) for expression, slot, index in entries]
        self._totals: dict[str, sm.Expr] = {}
        self._starts: dict[str, sm.Expr] = {}
        self._inner: dict[str, dict[sm.Symbol, tuple[str, sm.Symbol]]] = {"s": {}, "w": {}}
        self._read: dict[str, set[sm.Symbol]] = {"s": set(), "w": set()}
        self._grown: dict[str, dict[str, sm.Expr]] = {"s": {}, "w": {}}

    def row(self, axis: str, expression: sm.Expr) -> sm.Expr:
        """An equation of the j-th shape of a kind."""
        return self._by_motion(expression, lambda part: sum((self._at(axis, t) for t in self._terms(part)), sm.S.Zero))

    def total(self, name: str, expression: sm.Expr) -> None:
        """A sum over all shapes, which is called so from now on."""
        self._totals[name] = expression
        starts, grown = sm.S.Zero, {"s": sm.S.Zero, "w": sm.S.Zero}
        for term in self._terms(expression):
            if not term.axes:
                starts += term.number * sm.Symbol(f"p[o + {term.slot.name}]")
                continue
            axis, factor, rest = self._split(term)
            self._read[axis].add(factor)
            grown[axis] += self._at(axis, rest) * factor
        self._starts[name] = starts
        for axis, increment in grown.items():
            if increment:
                self._grown[axis][name] = sm.factor_terms(sm.collect(increment.expand(), COORDINATES[axis]))

    def scalar(self, expression: sm.Expr) -> sm.Expr:
        """An equation of the body as a whole, in the totals that there are."""
        return self._by_motion(expression, self._in_totals)

    def matrix(self, axis: str, other: str, expression: sm.Expr) -> str:
        """Place of an entry of a matrix of j-th shapes of a kind and l-th ones of the other."""
        if expression == 0:
            return "0.0"
        (term,) = self._terms(expression)
        return _address(_turned(term, axis), axis)

    def text(self, rows: Rows = _NOTHING, inner: Mapping[str, Rows] = _NOTHING) -> list[str]:
        """Lines of the two loops, with statements of each j-th shape, and ``inner`` ones of each pair j, l."""
        given = {name: start for name, start in self._starts.items() if start}
        starts = assigned({name: code(start) for name, start in given.items()})
        starts += zeroed(name for name in self._starts if name not in given)
        return [*starts, *(line for axis in "sw" for line in self._loop(axis, rows.get(axis, []), inner.get(axis, {})))]

    def _loop(self, axis: str, rows: list[str], stores: Rows) -> list[str]:
        sums = dict(sorted(self._inner[axis].items(), key=lambda item: str(item[0])))
        lines = assigned({str(name): _vector(name, "j") for name in COORDINATES[axis] if name in self._read[axis]})
        lines += zeroed(map(str, sums))
        for other in "sw":
            of_other = {name: at for name, (at, coordinate) in sums.items() if _AXIS[coordinate] == other}
            body = []
            for entry in dict.fromkeys(of_other.values()):
                names = [name for name, at in of_other.items() if at == entry]
                shared = entry if len(names) == 1 else "m"
                body += [f"m = {entry}"] if shared == "m" else []
                body += [f"{name} += {shared} * {_vector(sums[name][1], 'l')}" for name in names]
            body += stores.get(other, [])
            if body:
                lines += [f"for l in range({_COUNT[other]}):", *(_INDENT + line for line in body)]
        lines += rows
        lines += [line for name, increment in self._grown[axis].items() for line in added(name, increment)]
        return [f"for j in range({_COUNT[axis]}):", *(_INDENT + line for line in lines)] if lines else []

    def _by_motion(self, expression: sm.Expr, summed: Callable[[sm.Expr], sm.Expr]) -> sm.Expr:
        """Every coefficient of a product of the motion's symbols, summed over the shapes."""
        if not self._motion:
            return summed(expression)
        terms = sm.Poly(expression, *self._motion).terms()
        found = sm.S.Zero
        for powers, part in terms:
            sums, sign = summed(part), 1
            if sums.is_Add and sums.could_extract_minus_sign():
                sums, sign = -sums, -1
            found += sign * sm.prod(x**n for x, n in zip(self._motion, powers, strict=True)) * sums
        return found

    def _in_totals(self, expression: sm.Expr) -> sm.Expr:
        if not expression.free_symbols & set(_ALL):
            return sum((t.number * sm.Symbol(f"p[o + {t.slot.name}]") for t in self._terms(expression)), sm.S.Zero)
        for name, total in self._totals.items():
            number = _ratio(expression, total)
            if number is not None:
                return number * sm.Symbol(name)
        raise ValueError(f"{expression} is no total: name it")

    def _terms(self, expression: sm.Expr) -> Iterator[Term]:
        """Products of an expression, each with one entry of the block."""
        for powers, coefficient in sm.Poly(expression, *_ALL).terms():
            if coefficient == 0:
                continue
            symbols = tuple(x for x, n in zip(_ALL, powers, strict=True) for _ in range(n))
            fitting = ((_ratio(coefficient, entry), slot, axes) for entry, slot, axes in self._entries)
            term = next((Term(number, *at, symbols) for number, *at in fitting if number is not None), None)
            if term is None:
                raise ValueError(f"no slot of the block holds {coefficient}")
            yield term

    def _split(self, term: Term) -> tuple[str, sm.Symbol, Term]:
        """Loop that sums a product: its own coordinate there, and the row that is multiplied by it.

        Of two possible loops, the one that already has the sum over the other index.
        """
        options = []
        for factor in dict.fromkeys(term.coordinates):
            others = list(term.coordinates)
            others.remove(factor)
            axis = _AXIS[factor]
            options.append((axis, factor, term._replace(coordinates=tuple(others))))
        return max(options, key=lambda option: len(term.axes) == 2 and _sum(option[2]) in self._inner[option[0]])

    def _at(self, axis: str, term: Term) -> sm.Expr:
        """A product in the row of the j-th shape of a kind."""
        if len(term.axes) == 1:  # of a diagonal matrix the coordinate is that of the same shape
            self._read[axis] |= set(term.coordinates)
            return term.number * sm.Symbol(_address(term, axis)) * sm.prod(term.coordinates)
        (coordinate,) = term.coordinates
        self._inner[axis][_sum(term)] = (_address(_turned(term, axis), axis), coordinate)
        return term.number * _sum(term)


def _turned(term: Term, axis: str) -> Term:
    """A symmetric matrix of all shapes is read by rows, too, where the row comes second."""
    return term._replace(axes=term.axes[::-1]) if term.slot.axes == "aa" and term.axes[0] != axis else term


def _sum(term: Term) -> sm.Symbol:
    """Symbol of the sum over the l-th shapes."""
    return sm.Symbol(f"{term.slot.name.lower()}_{term.coordinates[0]}")


def _axes(slot: Slot, index: tuple[int, ...]) -> str:
    """Kinds of the shapes of an entry, one of each kind there."""
    return "".join("sw"[k] if axis == "a" else axis for axis, k in zip(slot.axes, index, strict=True))


def _address(term: Term, axis: str) -> str:
    """Place in p of an entry of the j-th shape of a kind (and the l-th of another)."""
    slot = term.slot
    index = ["j"] if len(term.axes) == 1 else ["j", "l"] if term.axes[0] == axis else ["l", "j"]
    among_all = [axis == "a" for axis in slot.axes]
    index = [_BEFORE[own] * all_ + k for own, all_, k in zip(term.axes, among_all, index, strict=True)]
    if len(index) == 1:
        return f"p[o + {slot.name} + {index[0]}]"
    first = f"({index[0]})" if "+" in index[0] else index[0]
    return f"p[o + {slot.name} + {_COUNT[slot.axes[1]]} * {first} + {index[1]}]"


def _vector(coordinate: sm.Symbol, index: str) -> str:
    name = str(coordinate)
    return f"{_VECTORS[int(name[1])]}[i + {_BEFORE[_AXIS[coordinate]]}{index}]"


def _ratio(expression: sm.Expr, of: sm.Expr) -> sm.Expr | None:
    """The number by which one expression is a multiple of another."""
    if expression.free_symbols != of.free_symbols:
        return None
    ratio = sm.cancel(expression / of)
    return ratio if ratio.is_number else None


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
    lines = [_INDENT + rest[0]]
    for term in rest[1:]:
        if len(lines[-1]) + len(term) < _LINE:
            lines[-1] += f" {term}"
        else:
            lines.append(_INDENT + term)
    return [f"{head} {sign}= (", *lines, ")"]


def assigned(values: Mapping[str, str]) -> list[str]:
    """One statement for all names, none if there are none."""
    return [f"{', '.join(values)} = {', '.join(values.values())}"] if values else []


def zeroed(names: Iterable[str]) -> list[str]:
    return [" = ".join([*names, "0.0"])] if (names := list(names)) else []
