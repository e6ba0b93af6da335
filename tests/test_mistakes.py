"""Advice for scene files that are no TOML."""

import tomllib

import pytest

from kaneflex.support.mistakes import toml_advice

BROKEN = {
    "[bodies.crank]\n[bodies.crank]\n": ("line 2 defines bodies.crank a second time", "Rename one"),
    "a = 1\na = 2\n": ("line 2 is not TOML: a = 2, whose key has a value already", "Give each key once"),
    "a = 50 mm\n": ("line 1 is not TOML: a = 50 mm", 'in quotes, like "50 mm"'),
    "a = 4,5\n": ("line 1 is not TOML: a = 4,5", "a decimal point"),
    "main = {revolute = 1,\n  branch = 2}\n": ("line 1 is not TOML: main = {revolute = 1,", "in braces on one line"),
    "material = steel\n": ("line 1 is not TOML: material = steel", 'in quotes, like "steel"'),
    "a\n": ("not TOML:", "Correct line 1: a"),
    'a = "': ("not TOML:", 'Correct line 1: a = "'),
}


@pytest.mark.parametrize("text", BROKEN)
def test_the_line_and_its_cure_are_named(text):
    with pytest.raises(tomllib.TOMLDecodeError) as found:
        tomllib.loads(text)
    reason, cure = toml_advice(str(found.value), text)
    expected, advice = BROKEN[text]
    assert reason.startswith(expected) and advice in cure
