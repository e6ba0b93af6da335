"""LaTeX of single symbols and equations; :mod:`kaneflex.derive.latex` makes documents of them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable

import sympy as sm
from sympy.printing.latex import LatexPrinter

from kaneflex.derive.equations.mechanism import SymbolicMechanism
from kaneflex.derive.ir.program import Program
from kaneflex.support.escaping import visible

_WIDTH = 78
"""Characters of a line of an equation, roughly as wide as the text."""
_GREEK = {"omega", "epsilon", "gamma", "tau", "phi", "rho"}
_WORDS = {
    "length": r"\ell", "mass": "m", "inertia": "J", "force": "F", "moment": "M", "normal": "N", "drive": "T",
    "coordinate": r"\theta", "rate": r"\dot\theta", "acceleration": r"\ddot\theta", "speed": r"\Omega",
    "centre": "r", "gravity": "g", "direction": "d",
}  # fmt: skip
"""Words of names that have a letter of their own; the others are written out."""
_SILENT = r"\\(mathrm|mathtt|mathbf|left|right|bigl|bigr|frac|dot|ddot|quad|operatorname)"


def broken(text: str) -> str:
    """A right-hand side on as many lines as it needs, broken before a sign outside of all braces."""
    if seen_length(text) <= _WIDTH:
        return text
    text = text.replace(r"\left(", r"\bigl(").replace(r"\right)", r"\bigr)")  # unlike those, not bound to one line
    pieces, depth, start = [], 0, 0
    for match in re.finditer(r"[{}]| [+-] ", text):
        if match[0] in "{}":
            depth += 1 if match[0] == "{" else -1
        elif depth == 0:
            pieces.append(text[start : match.start()])
            start = match.start()
    pieces.append(text[start:])
    lines = [pieces[0]]
    for piece in pieces[1:]:
        if seen_length(lines[-1] + piece) > _WIDTH:
            lines.append(piece)
        else:
            lines[-1] += piece
    return " \\\\\n&\\quad".join(lines)


def seen_length(text: str) -> int:
    """Characters that are seen of some LaTeX, roughly; both sides of a fraction count."""
    named = re.sub(r"\\[a-zA-Z]+", "x", re.sub(_SILENT + r"\b", "", text))
    return len(re.sub(r"[{}_^\\ ]", "", named))


class EquationPrinter(LatexPrinter):
    """LaTeX of scalar equations: names from a table, every digit of a number."""

    def __init__(self, names: Callable[[sm.Symbol], str]):
        super().__init__({"fold_short_frac": False, "mul_symbol": r" \, "})
        self._name = names

    def _print_Symbol(self, expr: sm.Symbol, style: str = "plain") -> str:
        return self._name(expr)

    def _print_Float(self, expr: sm.Float) -> str:
        mantissa, _, exponent = repr(float(expr)).partition("e")
        return rf"({mantissa} \cdot 10^{{{int(exponent)}}})" if exponent else mantissa


class SymbolNames:
    """LaTeX of every symbol of the rigid stage, no two alike.

    A name is taken apart at the body, joint or load that it belongs to: ``v_x_rod`` is v with the subscripts x, rod.
    Where two symbols would look alike both are printed as they are called in the module.
    """

    def __init__(self, mechanism: SymbolicMechanism, programs: Iterable[Program]):
        programs = list(programs)
        self._names = mechanism.names
        called = mechanism.names.identifiers(programs)
        nice = {symbol: self._nice(symbol.name) for symbol in called}
        taken = Counter(nice.values())
        self._latex = {
            symbol: text if taken[text] == 1 else rf"\mathtt{{{escaped(called[symbol])}}}"
            for symbol, text in nice.items()
        }

    def __call__(self, symbol: sm.Symbol) -> str:
        return self._latex[symbol]

    def _nice(self, name: str) -> str:
        plain = name.rstrip("_")
        primes = "'" * (len(name) - len(plain))
        if numbered := re.fullmatch(r"w(\d+)", plain):
            return f"w_{{{numbered[1]}}}"
        words = plain.split("_")
        owner = next((word for word in words if "@" in word or word == "ground"), None)
        if owner is None:
            return subscripted(words, None, primes)
        words.remove(owner)
        owner, words = self._names.text(owner), [part for word in words for part in self._names.text(word).split("_")]
        if not words:
            return rf"{{\mathrm{{{escaped(owner)}}}{primes}}}" if primes else rf"\mathrm{{{escaped(owner)}}}"
        return subscripted(words, owner, primes)


def subscripted(words: list[str], owner: str | None, primes: str) -> str:
    """The first word as the letter, the others and the owner as its subscripts."""
    raised = primes
    if words[0] == "link" and len(words) > 1:
        words, raised = words[1:], rf"^{{\mathrm{{link}}{primes}}}"
    first = words[0]
    if first in _WORDS:
        letter = _WORDS[first]
    elif first in _GREEK:
        letter = f"\\{first}"
    else:
        letter = first if len(first) == 1 else rf"\mathrm{{{escaped(first)}}}"
    below = [word if len(word) == 1 else rf"\mathrm{{{escaped(word)}}}" for word in words[1:]]
    if owner is not None:
        below.append(rf"\mathrm{{{escaped(owner)}}}")
    base = f"{{{letter}{raised}}}" if raised else letter  # in braces, for powers of it
    return base + (f"_{{{', '.join(below)}}}" if below else "")


def escaped(text: str) -> str:
    """Literal text of one paragraph of LaTeX."""
    shown = "".join(c if c <= _LAST_OF_LATEX else f"<U+{ord(c):04X}>" for c in visible(text))
    return re.sub(r"[\\~^#$%&_{}<>|]", lambda match: _LATEX.get(match[0], f"\\{match[0]}"), shown)


_LATEX = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\ensuremath{<}", ">": r"\ensuremath{>}", "|": r"\ensuremath{|}",  # plain fonts have others in their places
}  # fmt: skip
_LAST_OF_LATEX = "\u017f"
"""Last letter of Latin Extended-A; LaTeX needs packages for letters beyond it."""
