"""Advice for common mistakes in scene files: invalid TOML and misspelled units. Imported only for an error."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

from kaneflex.support.errors import nearest

_NAMES = {
    "millimetre": "mm", "millimeter": "mm", "centimetre": "cm", "centimeter": "cm", "metre": "m", "meter": "m",
    "micrometre": "um", "micrometer": "um", "micron": "um", "kilogram": "kg", "gram": "g", "newton": "N",
    "kilonewton": "kN", "newtonmetre": "N m", "newtonmeter": "N m", "pascal": "Pa", "megapascal": "MPa",
    "gigapascal": "GPa", "degree": "deg", "radian": "rad", "second": "s", "millisecond": "ms", "hertz": "Hz",
    "kilohertz": "kHz", "percent": "%", "revolutionsperminute": "rpm",
}  # fmt: skip
_NUMBER = r"[-+]?\d+(?:\.\d+)?"


def unit_advice(unit: str, known: Iterable[str]) -> str:
    """Advice for an unknown unit: the unit that was probably meant, or the known units."""
    if re.match(r",\d", unit):
        return "Write a point, as 50.5 mm, where a comma separates decimals"
    word = re.sub(r"[^a-z]", "", unit.lower())
    close = difflib.get_close_matches(word.removesuffix("s"), _NAMES, 1, 0.75) if len(word) > 2 else []
    return f"Write {_NAMES[close[0]]!r}" if close else nearest(unit, known)


def toml_advice(problem: str, text: str) -> tuple[str, str]:
    """Reason and advice for invalid TOML, from the parser's message."""
    place = re.search(r"at line (\d+)", problem)
    lines = text.splitlines()
    number = int(place[1]) if place else len(lines)
    line = lines[number - 1].partition("#")[0].strip() if 0 < number <= len(lines) else ""
    reason = f"line {number} is not TOML: {line[:200]}" if line else f"not TOML: {problem}"
    twice = re.search(r"Cannot declare \((.*?),?\) twice", problem)
    if twice:
        name = ".".join(re.findall(r"'(.*?)'", twice[1]))
        cure = "Rename one of them, or write their keys in one place: a table in braces can't be continued"
        return f"line {number} defines {name} a second time", cure
    if "Cannot overwrite a value" in problem:
        return f"{reason} (the key already has a value)", "Give each key once"
    if re.search(rf"[=\[,]\s*{_NUMBER}\s*(?:[^\W\d_]|%)", line):
        return reason, 'Write a number with a unit in quotes, like "50 mm"'
    if re.search(rf"=\s*{_NUMBER},\d", line):
        return reason, "Write a decimal point, not a comma"
    if line.count("{") > line.count("}"):
        cure = "Write a table in braces on one line, or give it a header like [joints.main] and one key a line"
        return reason, cure
    if re.search(r"=\s*[^\W\d]", line):
        return reason, 'Write a text in quotes, like "steel"'
    if line.count('"') % 2 or line.count("'") % 2:
        return reason, "Close the quotes in this line"
    if line.startswith("[") and not line.endswith("]"):
        return reason, "Close the header with ], like [bodies.rod]"
    if re.match(r"[\w.\-]+\s*:", line):
        return reason, "Write = between a key and its value"
    return f"{reason} ({problem[:200]})", 'Write lines like key = "50 mm", or headers like [bodies.rod]'
