"""``Program``: the one intermediate form between symbols and text; ``Steps``: the record that it is made from.

A program is a list of scalar assignments in an order in which they can be executed, with its inputs and its
outputs. Common-subexpression elimination, pruning and operation counts are functions from programs to
programs (or to numbers); printing is the business of :mod:`kaneflex.derive.printers`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import sympy as sm

Assignment = tuple[sm.Symbol, sm.Expr]

LARGEST_PRODUCT = 8
"""Powers up to this one are printed as products, x*x*x."""


@dataclass(frozen=True)
class Program:
    """Scalar assignments from inputs to outputs.

    Parameters
    ----------
    name : str
        Name of the function that will be printed.
    inputs : tuple of Symbol
        Symbols that the caller supplies.
    assignments : tuple of (Symbol, Expr)
        Every right-hand side uses inputs and symbols assigned before it only; no symbol is assigned twice.
    outputs : tuple of (str, Expr)
        Slot (printed as it stands, e.g. ``"out[0, 3]"``) and the expression stored there.

    Raises
    ------
    ValueError
        If a symbol is used before it is assigned, is assigned twice, or stands for two inputs.
    """

    name: str
    inputs: tuple[sm.Symbol, ...]
    assignments: tuple[Assignment, ...]
    outputs: tuple[tuple[str, sm.Expr], ...]

    def __post_init__(self) -> None:
        known = set(self.inputs)
        if len(known) < len(self.inputs):
            raise ValueError(f"program {self.name}: two inputs have one symbol")
        for symbol, expression in self.assignments:
            _demand_known(self.name, str(symbol), expression, known)
            if symbol in known:
                raise ValueError(f"program {self.name}: {symbol} is assigned twice")
            known.add(symbol)
        for slot, expression in self.outputs:
            _demand_known(self.name, slot, expression, known)


def _demand_known(program: str, target: str, expression: sm.Expr, known: set[sm.Symbol]) -> None:
    unknown = sorted(str(symbol) for symbol in expression.free_symbols - known)
    if unknown:
        raise ValueError(f"program {program}: {target} uses {', '.join(unknown)} before it is assigned")


def prune(program: Program) -> Program:
    """Drop the assignments that no output depends on."""
    needed = set().union(*(expression.free_symbols for _, expression in program.outputs))
    kept: list[Assignment] = []
    for symbol, expression in reversed(program.assignments):
        if symbol in needed:
            kept.append((symbol, expression))
            needed |= expression.free_symbols
    return replace(program, assignments=tuple(reversed(kept)))


def share(program: Program, prefix: str = "w") -> Program:
    """Common-subexpression elimination over all assignments and outputs at once.

    Named assignments keep their names, so that the printed code can still be read against the theory;
    what they have in common becomes ``w0, w1, ...``, but for what is one of them as a whole, which goes by its name, or
    the negative of another symbol. Outputs that are equal, as those of a symmetric matrix, stay equal: they are printed
    as one statement and need no symbol for what they have in common.
    """
    # An assignment of a mere number or symbol is inlined first: it would only hide a common subexpression.
    alias: dict[sm.Symbol, sm.Expr] = {}
    named: list[Assignment] = []
    for symbol, expression in program.assignments:
        expression = expression.xreplace(alias)
        if is_signed(expression):
            alias[symbol] = expression
        else:
            named.append((symbol, expression))
    outputs = [expression.xreplace(alias) for _, expression in program.outputs]
    distinct = list(dict.fromkeys(outputs))
    taken = {*program.inputs, *(symbol for symbol, _ in named)}
    temporaries, reduced = sm.cse(
        [expression for _, expression in named] + distinct,
        symbols=(symbol for symbol in sm.numbered_symbols(prefix) if symbol not in taken),
        order="canonical",
    )
    given, asked = reduced[: len(named)], reduced[len(named) :]
    given = list(zip((symbol for symbol, _ in named), given, strict=True))
    free = (symbol for symbol in sm.numbered_symbols(prefix) if symbol not in taken)
    assignments, replaced = _renamed(temporaries, given, free)
    stored = {output: expression.xreplace(replaced) for output, expression in zip(distinct, asked, strict=True)}
    return prune(
        replace(
            program,
            assignments=_executable_order(assignments, program.inputs),
            outputs=tuple((slot, stored[output]) for (slot, _), output in zip(program.outputs, outputs, strict=True)),
        )
    )


def _renamed(
    temporaries: Sequence[Assignment], named: Sequence[Assignment], free: Iterator[sm.Symbol]
) -> tuple[list[Assignment], dict[sm.Symbol, sm.Expr]]:
    """All assignments but those of mere symbols and temporary negatives; what stands for the symbols that go."""
    spare = dict(temporaries)
    names: dict[sm.Expr, sm.Symbol] = {}
    for symbol, value in named:
        if value in spare:
            names.setdefault(value, symbol)
    gone = {symbol: value for symbol, value in temporaries if (-value).is_Symbol and symbol not in names}
    gone |= {symbol: value for symbol, value in named if value in spare and names[value] != symbol}
    while (closed := {symbol: value.xreplace(gone) for symbol, value in gone.items()}) != gone:
        gone = closed
    kept = {symbol: names[symbol] if symbol in names else next(free) for symbol in spare if symbol not in gone}
    replaced = kept | {symbol: value.xreplace(kept) for symbol, value in gone.items()}
    found = [(kept[symbol], value) for symbol, value in temporaries if symbol in kept]
    found += [(symbol, value) for symbol, value in named if value not in spare]
    return [(symbol, value.xreplace(replaced)) for symbol, value in found], replaced


def named(program: Program, prefix: str = "v") -> Program:
    """With a symbol for every output that is an expression, but for mere signs; equal ones have the same."""
    taken = {*program.inputs, *(symbol for symbol, _ in program.assignments)}
    free = (symbol for symbol in sm.numbered_symbols(prefix) if symbol not in taken)
    values = dict.fromkeys(value for _, value in program.outputs if not is_signed(value))
    found = dict(zip(values, free, strict=False))
    assignments = (*program.assignments, *((symbol, value) for value, symbol in found.items()))
    outputs = tuple((slot, found.get(value, value)) for slot, value in program.outputs)
    return replace(program, assignments=assignments, outputs=outputs)


def is_signed(expression: sm.Expr) -> bool:
    """True for a symbol or number, perhaps with a sign."""
    return bool(expression.is_Atom or (-expression).is_Atom)


def _executable_order(assignments: Iterable[Assignment], inputs: Iterable[sm.Symbol]) -> tuple[Assignment, ...]:
    """Depth-first order: each assignment right after what it needs, so that values stay close to their use."""
    pending = dict(assignments)
    done: set[sm.Symbol] = set(inputs)
    ordered: list[Assignment] = []

    def place(symbol: sm.Symbol) -> None:
        stack = [symbol]
        while stack:
            top = stack[-1]
            missing = sorted((s for s in pending[top].free_symbols if s not in done), key=str)
            if missing:
                stack.extend(missing)
                continue
            stack.pop()
            if top not in done:
                done.add(top)
                ordered.append((top, pending[top]))

    for symbol in pending:
        if symbol not in done:
            place(symbol)
    return tuple(ordered)


def operation_count(program: Program) -> int:
    """Number of arithmetic operations and function calls of one evaluation, as printed: equal outputs once."""
    outputs = dict.fromkeys(expression for _, expression in program.outputs)
    return sum(_cost(expression, {}) for expression in (*(right for _, right in program.assignments), *outputs))


def expanded_operation_count(program: Program) -> int:
    """The same count without sharing: every output written out in terms of the inputs.

    Counted bottom-up on the graph; the expanded expressions themselves are never built.
    """
    cost: dict[sm.Symbol, int] = {}
    for symbol, expression in program.assignments:
        cost[symbol] = _cost(expression, cost)
    return sum(_cost(expression, cost) for _, expression in program.outputs)


def _cost(expression: sm.Expr, cost_of: Mapping[sm.Symbol, int]) -> int:
    """Operations of an expression as it is printed: a sign is free, x**3 is two products, 1/x**3 one division more.

    What stands in brackets more than once counts once, as the compiler computes it.
    """
    if expression.is_Symbol:
        return cost_of.get(expression, 0)
    own = 0
    if expression.is_Add:
        own = len(expression.args) - 1
    elif expression.is_Mul:
        # A negative power brings its own division: a/(b c) is two operations, as 1/(b c) is.
        factors = [factor for factor in expression.args if factor != -1 and not _is_divisor(factor)]
        own = max(len(factors) - 1, 0)
    elif expression.is_Pow:
        exponent = expression.exp
        product = exponent.is_Integer and abs(exponent) <= LARGEST_PRODUCT
        own = (abs(int(exponent)) - 1 if product else 1) + _is_divisor(expression)
    elif expression.args:
        own = 1
    return own + sum(_cost(argument, cost_of) for argument in expression.args)


def _is_divisor(expression: sm.Expr) -> bool:
    return bool(expression.is_Pow and expression.exp.is_negative)


@dataclass(frozen=True)
class Scalar:
    """Scalar of the motion for the elastic stage and sensors: name, unit, meaning, and its expression (a number where
    the scene fixes it)."""

    name: str
    unit: str
    meaning: str
    value: sm.Expr


class Steps:
    """Assignments in the order in which they were derived.

    What turns out to be a number or another symbol is handed on instead of being assigned: this is how a zero
    (a fixed pivot, a constant speed, a piston that can't turn) prunes every term that it multiplies.
    """

    def __init__(self, taken: Iterable[sm.Symbol] = ()) -> None:
        self.assignments: list[Assignment] = []
        self._taken = {symbol.name for symbol in taken}

    def assign(self, symbol: sm.Symbol | str, expression: sm.Expr) -> sm.Expr:
        """Record ``symbol = expression`` and return the symbol or number that replaces the expression."""
        expression, name = sm.sympify(expression), str(symbol)
        if is_signed(expression):
            return expression
        while name in self._taken:  # a scene's own name may be one that the derivation uses
            name += "_"
        self._taken.add(name)
        self.assignments.append((sm.Symbol(name), expression))
        return sm.Symbol(name)
