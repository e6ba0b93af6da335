"""Names, kept out of the derivation: equations are derived for numbered things and take a scene's names when printed.

A symbol is made of words and of what it belongs to, like omega_rod. With a scene's own names in them two symbols could
be one: a load called omega_rod beside a body rod, or a body arm with a point left_tip beside arm_left with a tip.
Numbered, as body@1 and point@2, nothing is like anything else or like a word of ours. And as SymPy sorts by name, the
equations of a scene that is renamed are the same to the last term: its kernels compute the same bits.
"""

from __future__ import annotations

import builtins
import keyword
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sm

from kaneflex.derive.ir.program import Program
from kaneflex.support.escaping import ascii_identifier

_NUMBERED = re.compile(r"[a-z]+@\d+")
_KINDS = {"bodies": "body", "joints": "joint", "masses": "mass", "loads": "load", "springs": "spring",
          "contacts": "contact"}  # fmt: skip
"""Table of a scene -> what its entries are numbered as."""
_NUMBERED_AS = {"drives": "joints"}
"""Table whose entries have the numbers of another one's."""


@dataclass(frozen=True)
class Names:
    """Names of a scene's numbered parts: ``of`` maps "body@1" to "crank"."""

    of: Mapping[str, str]

    @cached_property
    def number(self) -> dict[tuple[str, str], str]:
        """The way back: (kind, name) -> number, like ("body", "crank") -> "body@1"."""
        return {(number.partition("@")[0], name): number for number, name in self.of.items()}

    def text(self, text: str) -> str:
        """Text with every number replaced by its name."""
        return _NUMBERED.sub(lambda found: self.of[found[0]], text)

    def apply(self, value: Any) -> Any:
        """Data with the names in all of its texts."""
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, Mapping):
            return {self.apply(key): self.apply(entry) for key, entry in value.items()}
        if isinstance(value, (list, tuple)):
            return type(value)(self.apply(entry) for entry in value)
        return value

    def identifiers(self, programs: Iterable[Program], taken: Iterable[str] = ()) -> dict[sm.Symbol, str]:
        """Symbol -> what it is called in the text of a module, no two alike.

        Our own symbols keep their names. The others are called as they read with the scene's names in them, with a
        counter behind it where that is Python's word, one in ``taken`` or another symbol's.
        """
        symbols = dict.fromkeys(
            symbol for program in programs for symbol in (*program.inputs, *(left for left, _ in program.assignments))
        )
        found = {symbol: symbol.name for symbol in symbols if "@" not in symbol.name}
        used = {*keyword.kwlist, *dir(builtins), "math", *taken, *found.values()}
        for symbol in symbols:
            if symbol in found:
                continue
            plain = name = ascii_identifier(self.text(symbol.name))
            count = 1
            while name in used:
                count += 1
                name = f"{plain}_{count}"
            used.add(name)
            found[symbol] = name
        return found


def numbered(structure: Mapping[str, Any]) -> tuple[dict[str, Any], Names]:
    """A scene's structure with numbers for names, in the scene's order; laws keep theirs."""
    number = {
        table: {name: f"{kind}@{k:0{len(str(len(structure.get(table, ()))))}}"
                for k, name in enumerate(structure.get(table, ()), start=1)}
        for table, kind in _KINDS.items()
    }  # fmt: skip
    points: dict[str, str] = {}

    def address(text: str) -> str:
        """Points that the scene names have numbers of their own; start, mid, end and origin are words of ours."""
        body, _, point = text.partition(".")
        if text in structure["points"]:
            point = points.setdefault(text, f"point@{1 + len(points)}")
        return f"{number['bodies'].get(body, body)}.{point}"

    def entry(given: Mapping[str, Any]) -> dict[str, Any]:
        found = dict(given)
        for key in ("at", "on"):
            if key in found:
                found[key] = address(found[key])
        if "between" in found:
            found["between"] = [address(end) for end in found["between"]]
        for key, owners in (("torque_at", "joints"), ("torsional_at", "joints"), ("spread_on", "bodies")):
            if key in found:
                found[key] = number[owners][found[key]]
        if "against" in found:
            joint = found["against"].removesuffix("_speed")
            found["against"] = found["against"].replace(joint, number["joints"].get(joint, joint), 1)
        return found

    tables = {
        table: {number[_NUMBERED_AS.get(table, table)][name]: entry(given) for name, given in entries.items()}
        for table, entries in structure.items()
        if table in _KINDS or table in _NUMBERED_AS
    }
    if "observed" in structure:
        tables["observed"] = [number["joints"][name] for name in structure["observed"]]
    tables["points"] = {address(text): given for text, given in structure["points"].items()}
    names = {code: name for table in number.values() for name, code in table.items()}
    names |= {code: text.partition(".")[2] for text, code in points.items()}
    return {**structure, **tables}, Names(names)
