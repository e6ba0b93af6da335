"""Laws: what may be written, what is refused, and that building from a law gives the written function."""

import math

import numpy as np
import pytest
import sympy as sm
from machines import machine
from scipy.interpolate import BPoly

from kaneflex import SceneError, load, read_scene, scene_of, simulate, with_settings
from kaneflex.derive.equations.law_expression import law_expression
from kaneflex.scene.law_parser import parse_law
from kaneflex.scene.laws import ON_ARRAYS
from kaneflex.support.errors import Fault

NAMES = ("t", "main", "main_speed")
smoothstep = BPoly.from_derivatives([0.0, 1.0], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])  # 0 before, 1 after
BEYOND = "beyond 1e+60: products of such numbers are not finite"


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
    ("(-8)**(6/2)*t", lambda t: -512 * t),
    ("tan(pi/4)/(2 - 1)*t", lambda t: t),
    ("exp(-5000) + 0**0*t", lambda t: t),
    ("sign(t - 0.4) + sign(-2) + sign(0*t)", lambda t: np.sign(t - 0.4) - 1),
    ("min(t, 0.5) + max(2, 1)*max(main, 1)", lambda t: np.where(t < 0.5, t, 0.5) + 2 * np.where(3 * t > 1, 3 * t, 1)),
    ("atan2(t - 0.5, -1) + 0*atan2(0*t, 0*t)", lambda t: np.arctan2(t - 0.5, -1)),
    ("asin(t - 1) + acos(t/2) - atan(3*t)", lambda t: np.arcsin(t - 1) + np.arccos(t / 2) - np.arctan(3 * t)),
    ("asin(1)*t + acos(-1)", lambda t: math.pi * (t / 2 + 1)),
    ("step(t - 0.55) + step(0*t)", lambda t: np.where(t > 0.55, 1.5, 0.5)),
    ("step(t, 0.2, 3, 0.6, 7)", lambda t: 3 + 4 * smoothstep(np.clip((t - 0.2) / 0.4, 0, 1))),
    ("t/(0.3 - 0.2999)", lambda t: 1e4 * t),
    ("sqrt(1 - 0.5**2)*t", lambda t: math.sqrt(0.75) * t),
])  # fmt: skip
def test_a_law_is_the_function_that_was_written(text, function):
    t = np.linspace(0.1, 1.0, 7)
    values = {"t": t, "main": 3 * t, "main_speed": 3.0, "pi": math.pi}
    assert parse_law(text, NAMES).to(ON_ARRAYS, values, float) == pytest.approx(function(t), rel=1e-12)


def test_a_number_is_a_law():
    for given in (5, -2.5):
        changes = ("loads.gas=none", "main.speed=none", "main.cycle=none", f"main.law={given}", "solve.duration=0.1")
        scene = with_settings(read_scene("engine"), [*changes, "solve.start=zero"])
        assert scene.drives["main"].coordinate(0.1) == given


def test_equal_laws_have_one_text():
    assert parse_law(" 2*sin( main )+t", NAMES).text == parse_law("2 * sin(main) + t", NAMES).text


@pytest.mark.parametrize(("text", "reason"), [
    ("__import__('os')", "a law cannot call '__import__'"),
    ("open('x')", "a law cannot call 'open'"),
    ("eval('1')", "a law cannot call 'eval'"),
    ("t.__class__()", "a law cannot call 't.__class__'"),
    ("max(t)", "max takes two arguments"),
    ("step(t, 0, 1)", "step takes one argument, or five"),
    ("step(t, 2, 0, 1 + 1, 5)", "step(t, 2, 0, 1 + 1, 5) begins where it ends"),
    ("floor(t)", "a law cannot call 'floor'"),
    ("1/sign(0.1 + 0.2 - 0.3)", "1 / sign(0.1 + 0.2 - 0.3) divides by zero"),  # which side it is can't be told
    ("1/atan2(0, 1)", "1 / atan2(0, 1) divides by zero"),
    ("1/(step(-1) + min(0, 3))", "1 / (step(-1) + min(0, 3)) divides by zero"),
    ("sin(t, 2)", "sin takes one argument"),
    ("sin(x=t)", "sin takes one argument"),
    ("sin", "unknown name 'sin'"),
    ("omega * t", "unknown name 'omega'"),
    ("t.real", "unknown name 't.real'"),
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
    ("2 t", "not an expression"),
    ("step(t, 0, -30 deg, 1, 0)", "'30 deg' has a unit, and numbers in a law have none"),
    ("(" * 50_000 + "t" + ")" * 50_000, "longer than 100000 characters"),
    ("+".join(["t"] * 400), "more than 100 nested operations"),
    ("sin(t) *" * 30_000 + "t", "longer than 100000 characters"),
    ("t +" * 30_000 + "t", "more than 100 nested operations"),
    ("-" * 90_000 + "t", "not an expression"),
    ("+".join(["sin(t + 1)*cos(t*t)*t*t*t*t*t*t*t"] * 90), "more than 1000 operations"),
    ("sin(" * 25 + "t" + ")" * 25, "more than 24 nested functions and powers"),
    ("t^2", "'t ^ 2' is not a power"),
    ("1/0", "1 / 0 divides by zero"),
    ("0/0", "0 / 0 divides by zero"),
    ("t/(1 - 1)", "t / (1 - 1) divides by zero"),
    ("1/(0.1 + 0.2 - 0.3)", "1 / (0.1 + 0.2 - 0.3) divides by zero"),  # in doubles the difference is 5.6e-17
    ("1/sin(pi)", "1 / sin(pi) divides by zero"),
    ("0**-1", "0 ** (-1) divides by zero"),
    ("log(0)", "log(0) is not finite"),
    ("log(cos(pi/2))", "log(cos(pi / 2)) is not finite"),
    ("tan(pi/2)", "tan(pi / 2) is not finite"),
    ("tan(-3*pi/2)", "tan(-3 * pi / 2) is not finite"),
    ("log(-1)", "log(-1) is not real"),
    ("t + sqrt(-1)", "sqrt(-1) is not real"),
    ("(-8)**(1/3)", "(-8) ** (1 / 3) is not real"),
    ("asin(1.001)", "asin(1.001) is not real"),
    ("t*acos(-2)", "acos(-2) is not real"),
    ("1/acos(1)", "1 / acos(1) divides by zero"),
    ("1/(asin(0.1 + 0.2) - asin(0.3))", "1 / (asin(0.1 + 0.2) - asin(0.3)) divides by zero"),
    ("1/(atan(0.1 + 0.2) - atan(0.3))", "1 / (atan(0.1 + 0.2) - atan(0.3)) divides by zero"),
    ("1e400", f"a number is {BEYOND}"),
    ("9" * 4000, f"a number is {BEYOND}"),
    ("2**5000", f"2 ** 5000 is {BEYOND}"),
    ("9**9**9**9", f"9 ** 9 ** 9 is {BEYOND}"),
    ("exp(1000)", f"exp(1000) is {BEYOND}"),
    ("1e50*1e50*t", f"1e+50 * 1e+50 is {BEYOND}"),
], ids=lambda text: text[:40])  # fmt: skip
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


@pytest.mark.parametrize("text", ["t**2*t+t*t/2-(-t)", "1e-3*abs(-main_speed)", "+".join(["t*t"] * 99), "-" * 99 + "t"])
def test_the_text_of_a_law_is_a_law(text):
    """Also where the spaces of the text make it far longer: 'a*b' is 'a * b'."""
    law = parse_law(text, NAMES)
    assert parse_law(law.text, NAMES).text == law.text


SCENES = {
    "two-link-arm": "loads={push={force_on='lower.end', direction=[1, 0], law='%s'}}",
    "four-bar-motor": "loads.motor.law=%s",
}


@pytest.mark.parametrize(("scene", "law", "reason"), [
    ("two-link-arm", "1/(t - t)", "it has no finite value at t = 0 s"),
    ("two-link-arm", "sqrt(0.25 - t)", "it has no finite value at t = 0.251389 s"),
    ("two-link-arm", "log(0.6 - shoulder)", "it has no finite value at t = 0.197222 s"),  # acos(1/3) / (2 pi)
    ("two-link-arm", "asin(4*t)", "it has no finite value at t = 0.251389 s"),
    ("two-link-arm", "(1e50*t)**10", "it has no finite value at t = 0.00138889 s"),
    ("four-bar-motor", "1/(main_speed - main_speed)", "it has no finite value at t = 0 s"),
    ("four-bar-motor", "1/0", "1 / 0 divides by zero"),
])  # fmt: skip
def test_a_law_without_a_value_in_the_run_is_refused_when_the_scene_is_read(scene, law, reason):
    good = read_scene(scene)
    with pytest.raises(SceneError) as caught:
        with_settings(good, [SCENES[scene] % law])
    name = "push" if scene == "two-link-arm" else "motor"
    assert (caught.value.key, caught.value.value) == (f"loads.{name}.law", law)
    assert caught.value.reason == reason


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("law", "pole"), [
    ("tan(4*t)", 0.392699), ("tan(2*pi*t)", 0.25), ("1/(t - 0.123456)", 0.123456),
    ("1/(t - 0.123456)**2", 0.123456),
])  # fmt: skip
def test_a_pole_between_steps_is_found(law, pole):
    scene = with_settings(read_scene("two-link-arm"), [SCENES["two-link-arm"] % law, "solve.preset=rigid"])
    with pytest.raises(SceneError, match=rf"^loads\.push\.law = .*: it grows without bound at t = {pole} s\."):
        load(scene)


def test_a_jump_or_a_switch_that_no_step_resolves_is_no_pole():
    laws = ("sign(t - 0.25)", "step(t - 0.1234)", "tanh((t - 0.12345)/1e-6)", "t + exp(-((t - 0.0305)/1e-5)**2)", "0*t")
    loads = ", ".join(SCENES["two-link-arm"][7:-1].replace("push", f"push_{k}") % law for k, law in enumerate(laws))
    load(with_settings(read_scene("two-link-arm"), [f"loads={{{loads}}}", "solve.preset=rigid"]))


def test_a_law_may_pass_beyond_what_its_parts_can_hold():
    """A smooth switch: exp(1000) is infinite on its way, and the quotient 0."""
    text = "1/(1 + exp(-4000*(t - 0.5)))"
    law = parse_law(text, ("t",))
    law.check_values({"t": np.linspace(0.0, 1.0, 101)})
    assert law.on_arrays({"t": np.array([0.0, 0.5, 1.0])}) == pytest.approx([0.0, 0.5, 1.0], abs=1e-15)


@pytest.mark.parametrize("law", [
    "abs(t)", "t + abs(sin(2*pi*t) + pi)/2", "sign(t)", "step(t - 0.1)", "max(t, 0.1)", "min(t, 0.1)",
    "atan2(t - 0.3, -1)", "atan2(sin(2*pi*t), 0.99 - cos(2*pi*t - pi))", "atan2(t - 0.3, t - 0.3)",
])  # fmt: skip
def test_a_drive_whose_speed_would_jump_is_refused(law):
    of_law = r"^drives\.elbow\.law = .*(kinks, at which the speed would jump|jumps where its point)"
    with pytest.raises(SceneError, match=of_law):
        with_settings(read_scene("two-link-arm"), [f"drives.elbow.law={law}"])
    good = "abs(-3)*cos(2*pi*t) + step(t, 0, 0, 0.5, 1) + max(1, 2)*t"
    assert with_settings(read_scene("two-link-arm"), [f"drives.elbow.law={good}"]).drives["elbow"].law


@pytest.mark.parametrize(("law", "t"), [
    ("asin(sin(2*pi*t))", 0.25), ("acos(1 - t)", 0), ("0.1*acos(t**2)", 1),
    ("asin((1 - 1e-13)*cos(2*pi*t - 1.3))", 0.2069),
])  # fmt: skip
def test_a_drive_whose_speed_would_have_no_bound_is_refused(law, t):
    """Where the argument of asin or acos comes to an end of its range: pi t + 1.3 is passed between two samples."""
    with pytest.raises(SceneError, match=r"^drives\.elbow\.law = .*has an infinite slope at t = ") as caught:
        with_settings(read_scene("two-link-arm"), [f"drives.elbow.law={law}"])
    assert float(caught.value.reason.split("t = ")[1].split(" s")[0]) == pytest.approx(t, abs=1e-4)


def test_an_angle_of_a_point_that_stays_off_the_cut_drives_a_wheel():
    """The angle of the point 1 - exp(-2 i t)/2, and inverse functions in a row: accelerations by hand."""
    scene = scene_of(machine(
        bodies=dict(wheel='mass = "1 kg", inertia = "0.01 kg m^2"'), joints=dict(j="revolute ground wheel"),
        drives=dict(j='law = "atan2(0.5*sin(2*t), 1 - 0.5*cos(2*t))"'), sensors=dict(a="acceleration wheel angle"),
        solve=dict(preset="rigid", duration="2 s"),
    ))
    solution = simulate(load(scene))
    s, c = np.sin(2 * solution.times), np.cos(2 * solution.times)
    # theta' = (2 cos - 1) / (2.5 - 2 cos), from the quotient rule, and once more
    rate = -4 * s / (2.5 - 2 * c) - (2 * c - 1) * 4 * s / (2.5 - 2 * c) ** 2
    assert solution.series["a"].values == pytest.approx(rate, abs=1e-12)
    both = with_settings(scene, ["j.law=asin(0.9*sin(t)) - acos(0.9*cos(t)) + atan(t)"])
    x = np.sin(solution.times), np.cos(solution.times)
    first = -0.9 * x[0] * (1 - 0.81) / (1 - 0.81 * x[0] ** 2) ** 1.5
    second = 0.9 * x[1] * (1 - 0.81) / (1 - 0.81 * x[1] ** 2) ** 1.5
    third = -2 * solution.times / (1 + solution.times**2) ** 2
    assert simulate(load(both)).series["a"].values == pytest.approx(first - second + third, abs=1e-11)


@pytest.mark.parametrize("law", ["1/(t - t)", "(1e50*t)**9"])
def test_symbols_that_are_not_finite_are_refused_under_the_name_of_the_law(law):
    """Where sampling may have met rounding, or times that are small enough."""
    with pytest.raises(SceneError, match=r"^loads\.push\.law = .*its terms cancel or multiply"):
        law_expression(law, {"t": sm.Symbol("t")}, "loads.push.law")
