"""Laws: what may be written, what is refused, and that building from a law gives the written function."""

import math

import numpy as np
import pytest

from kaneflex.errors import Fault
from kaneflex.laws import FUNCTIONS, parse_law

NAMES = ("t", "main", "main_speed")
NUMERIC = {name: {"abs": np.abs}.get(name) or getattr(np, name) for name in FUNCTIONS}


@pytest.mark.parametrize(("text", "function"), [
    ("120", lambda t: 120),
    ("-t", lambda t: -t),
    ("+t", lambda t: t),
    ("2*sin(main) + 3", lambda t: 2 * np.sin(3 * t) + 3),
    ("t**2 - main/4", lambda t: t * t - 0.75 * t),
    ("exp(-t)*cos(2*pi*50*t)", lambda t: np.exp(-t) * np.cos(100 * np.pi * t)),
    ("abs(-main_speed)", lambda t: 3.0),
    ("sqrt(tanh(t)+1) - log(2 + tan(t))", lambda t: np.sqrt(np.tanh(t) + 1) - np.log(2 + np.tan(t))),
    ("2**-1", lambda t: 0.5),
    ("-t**2", lambda t: -(t * t)),
    ("2**t**2", lambda t: 2 ** (t * t)),
    ("1 - t - 2", lambda t: -1 - t),
    ("8 / 4 / 2 * t", lambda t: t),
    ("1e-3*t", lambda t: t / 1000),
])  # fmt: skip
def test_a_law_is_the_function_that_was_written(text, function):
    t = np.linspace(0.1, 1.0, 7)
    values = {"t": t, "main": 3 * t, "main_speed": 3.0, "pi": math.pi}
    assert parse_law(text, NAMES).to(NUMERIC, values, float) == pytest.approx(function(t), rel=1e-13)


def test_equal_laws_have_one_text():
    assert parse_law(" 2*sin( main )+t", NAMES).text == parse_law("2 * sin(main) + t", NAMES).text


@pytest.mark.parametrize(("text", "reason"), [
    ("__import__('os')", "a law cannot call '__import__'"),
    ("open('x')", "a law cannot call 'open'"),
    ("eval('1')", "a law cannot call 'eval'"),
    ("t.__class__()", "a law cannot call 't.__class__'"),
    ("max(t)", "a law cannot call 'max'"),
    ("sin(t, 2)", "sin takes one argument"),
    ("sin(x=t)", "sin takes one argument"),
    ("sin", "unknown name 'sin'"),
    ("omega * t", "unknown name 'omega'"),
    ("t.real", "'t.real' is not arithmetic"),
    ("[t][0]", "'[t][0]' is not arithmetic"),
    ("t < 3", "'t < 3' is not arithmetic"),
    ("t if t else 1", "'t if t else 1' is not arithmetic"),
    ("t // 2", "'t // 2' is not arithmetic"),
    ("(y := t)", "'(y := t)' is not arithmetic"),
    ("'t'", "\"'t'\" is not arithmetic"),
    ("True", "True is not a real number"),
    ("1j", "1j is not a real number"),
    ("t +", "not an expression"),
    ("", "not an expression"),
    ("t; t", "not an expression"),
    ("(" * 500 + "t" + ")" * 500, "longer than 1000 characters"),
])  # fmt: skip
def test_everything_else_is_refused(text, reason):
    with pytest.raises(Fault) as caught:
        parse_law(text, NAMES)
    assert caught.value.reason == reason


def test_deep_nesting_is_refused_or_read_but_never_a_crash():
    text = "(" * 400 + "t" + ")" * 400
    try:
        assert parse_law(text, NAMES).text == "t"
    except Fault as fault:
        assert fault.reason == "not an expression"
