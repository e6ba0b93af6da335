"""Extremes in their short form: every case ends within its accuracy or in a named outcome, never in silence."""

import re

import csv_tables
import numpy as np
import pytest
from extreme_cases import CASES, spike_cases, spiked
from extreme_numerics import ANGLE_OF_A_STEP, drift, single_precision
from extremes import METHODS, Case, Ending, attempt, judge
from machines import block, cantilever, pendulum
from places import DOCS
from runs import derived_on_the_fly, model, run

from kaneflex import SceneError, load, scene_of
from kaneflex.response.time_statistics import at_least, between_steps
from kaneflex.solve.simulation import solve
from kaneflex.solve.validity import FEWEST_STEPS, few_steps, validity_warnings

PAGE = DOCS / "extremes.md"


def pressed(law):
    """A cantilever under a force by a law."""
    return cantilever(
        'length = "500 mm", beam = {material = "steel", A = "400 mm^2", I = "13333 mm^4"}', root="wall",
        loads=f'push = {{force_on = "bar.end", direction = [0, -1], law = "{law}"}}',
        sensors='tip = {displacement = "bar.end", component = "x"}',
        solve={"preset": "quasistatic", "duration": "1 s", "steps": 10},
    )


@pytest.mark.parametrize(("law", "message"), [
    ("100 / t", r"loads\.push\.law = '100 / t': it has no finite value at t = 0 s\. Give a law that is finite"),
    ("sqrt(0.55 - t)", r"loads\.push\.law = 'sqrt\(0\.55 - t\)': it has no finite value at t = 0\.551389 s"),
])  # fmt: skip
def test_a_load_without_a_value_is_refused_before_anything_is_computed(law, message, tmp_path):
    with pytest.raises(SceneError, match=message):
        derived_on_the_fly(pressed(law), tmp_path)


def test_a_drive_without_a_speed_is_refused_before_anything_is_computed(tmp_path):
    text = pendulum(
        'inertia = "1 kg m^2", mass = "1 kg"', 'law = "sqrt(t)"', "rotor", "shaft", solve={"duration": "1 s"},
    )
    with pytest.raises(SceneError, match=r"drives\.shaft = 'sqrt\(t\)': the motion or a derivative of it has no"):
        derived_on_the_fly(text, tmp_path)


def test_what_leaves_double_precision_on_the_way_is_named(tmp_path):
    """The force is a number, the square of the slope that it causes is none."""
    solution = solve(derived_on_the_fly(pressed("1e60 * t * 1e60 * 1e60 * 1e20"), tmp_path))
    with np.errstate(over="ignore", invalid="ignore"), pytest.raises(SceneError) as error:
        _ = solution.series
    assert str(error.value).startswith("sensors.tip: it has no finite value at t = 0.1 s. Check the numbers")


def test_a_spike_between_two_steps_is_named(tmp_path):
    """0.2 degrees wide at 370.25 degrees: steps of half a degree pass it by, unless they are finer."""
    near = np.arange(365.05, 374.99, 0.05)
    spike = spiked(tmp_path / "spike.csv", np.array([*range(0, 366, 5), *near, *range(375, 721, 5)]), 370.25)
    spike = (*spike, "gas.interpolation=pchip")  # which stays between its rows
    (said,) = between_steps(model("engine", *spike))
    assert said.startswith("loads.gas is not resolved: within a step, at t = 0.01028 s, it differs by 100% of its")
    assert between_steps(model("engine", *spike, "solve.steps=28800")) == []


def test_a_spike_between_all_instants_that_are_looked_at_is_named(tmp_path):
    """0.004 degrees of it, a third of the distance of the instants that a step is looked at."""
    table = tmp_path / "spike.csv"
    beside = 0.002 * 2.0 ** np.arange(11)
    near = [370.2537 - beside, [370.2537], 370.2537 + beside]
    rows = np.sort(np.concatenate([range(0, 370, 5), *near, range(375, 725, 5)]))
    table.write_text("deg,F\n" + "".join(f"{row:.4f},{1e5 * (row == 370.2537):g}\n" for row in rows))
    (said,) = between_steps(model("engine", f"gas.table={table}", "gas.column=F"))
    assert said.startswith("loads.gas is not resolved: within a step, at t = 0.01028 s, it differs by 100% of its")


BAR = cantilever(
    'length = 0.5, beam = {material = "steel", section = {rectangle = [0.02, 0.02]}, elements = 2}',
    loads='push = {force_on = "bar.end", direction = [0, -1], law = "LAW"}',
    solve={"preset": "coupled", "duration": 0.1, "steps": 100, "modes": 1},
)


@pytest.mark.parametrize(("law", "count"), [("1 - step(t - 0.0305)", 0), ("exp(-((t - 0.0305) / 0.0001)**2)", 1)])
def test_preset_coupled_sees_what_jumps_but_not_what_comes_and_goes(law, count):
    assert len(between_steps(load(scene_of(BAR.replace("LAW", law))))) == count


SLIDER = block(
    "mass = 1", "free = true, initial_speed = 0.3",
    loads='pull = {force_on = "block", direction = [1, 0], MAGNITUDE}',
    sensors='x = {position = "slide"}', solve={"preset": "coupled", "duration": 2, "steps": 50},
)


@pytest.mark.parametrize(("law", "count"), [
    ("exp(-((t - 0.77) / 0.0005)**2) - 0.1 * slide - 0.1 * slide_speed", 1), ("step(t - 0.77) - slide", 0),
    ("-slide", 0), ("sin(3 * t)", 0),
])  # fmt: skip
def test_so_it_does_where_joints_are_free(law, count):
    assert len(between_steps(load(scene_of(SLIDER.replace("MAGNITUDE", f'law = "{law}"'))))) == count


def test_a_load_by_the_coordinate_of_a_joint_without_a_drive_is_not_looked_at():
    assert between_steps(model("four-bar-motor", 'loads.motor.law="0.3 * cos(t) + 0.01 * rocker"')) == []


@pytest.mark.parametrize(("height", "count"), [(5.0, 1), (0.01, 0)])
def test_a_table_over_time_is_looked_at_between_steps_where_joints_are_free(height, count, tmp_path):
    table = tmp_path / "pull.csv"
    table.write_text(f"s,N\n0,0\n0.77,0.01\n0.7701,{height}\n0.7702,0.01\n2,1\n")
    given = f'table = "{table}", against = "t", interpolation = "pchip"'
    assert len(between_steps(load(scene_of(SLIDER.replace("MAGNITUDE", given))))) == count


def test_a_table_whose_curve_overshoots_is_named(tmp_path):
    """Rows of 0.05 degrees between rows of 5: the smooth curve turns the flank into a high wave."""
    rows = [*range(0, 370, 5), 370, 370.05, 370.1, 370.15, 370.2, *range(375, 721, 5)]
    spike = spiked(tmp_path / "spike.csv", np.array(rows), 370.1)
    (said,) = (text for text in model("engine", *spike).warnings if "rows" in text)
    assert said.startswith("loads.gas: its spline reaches ") and "interpolation = 'pchip'" in said
    assert not any("rows" in text for text in model("engine", *spike, "gas.interpolation=pchip").warnings)
    assert not any("rows" in text for text in model("engine").warnings)


def test_steps_of_whole_turns_are_named():
    said = between_steps(model("engine", "solve.preset=paper", "main.speed=600000 rpm", "solve.steps=400"))
    assert said[0].startswith("main turns by 360 deg in a step") and "give solve.steps = 5027 or more" in said[0]


def test_the_steps_that_are_asked_for_are_enough_and_not_one_too_many():
    found = model("engine", "solve.preset=paper")
    (said,) = few_steps(found, 0.5 / found.step)  # two steps in a period
    wanted = int(re.search(r"give solve\.steps = (\d+) or more", said)[1])
    assert 2.0 * (wanted - 1) / found.options.steps <= FEWEST_STEPS < 2.0 * wanted / found.options.steps
    assert few_steps(found, 1.0 / (FEWEST_STEPS * found.step)) == []


def test_steps_that_no_run_can_have_are_not_asked_for():
    options = model("engine", "solve.preset=paper").options
    assert at_least(10**9, options) == "give solve.steps = 1000000000 or more"
    shorter = f"give solve.duration = {options.duration / 1e3:.2g} s or less and more of solve.steps"
    assert at_least(10**12, options) == shorter


STILL = ("bodies.piston.mass=1e6 kg", "loads.gas=none", "damping=none", "solve.start=zero")


def test_a_link_that_stretches_is_named():
    """A piston of 1e6 kg stands still while the crank turns: the rod is stretched by the stroke, 80 mm."""
    solution = run("engine", "solve.preset=linear", *STILL)
    (said,) = (text for text in validity_warnings(solution, [1e3]) if "stretches" in text)
    assert said.startswith("rod stretches by 0.58 of its length")


SHORT = [(case, method) for case in CASES for method in case.methods if method not in case.slow]


@pytest.mark.exhaustive(share=9)
@pytest.mark.parametrize(("case", "method"), SHORT, ids=[f"{case}, {method}" for case, method in SHORT])
def test_extreme(case, method):
    assert judge(case, method, attempt(case, method)) == ""


def test_spikes_of_gas(tmp_path, exhaustive):
    """By every method, of which CI runs half."""
    for case in spike_cases(tmp_path):
        for method in case.methods[:: 1 if exhaustive else 2]:
            assert judge(case, method, attempt(case, method)) == "", method


def test_silence_is_a_fault():
    """What is neither accurate nor said is what the suite is there to find."""
    named = {"paper": "no cycle"}
    case = Case("group", "name", "engine", (), lambda solution: 0.0, 1e-3, ("radau",), named, ("linear",))
    silent, said = Ending("completed", 0.1, "", ()), Ending("completed", 0.1, "", ("steps are long",))
    assert judge(case, "linear", silent) == "error 0.1 beyond 0.001 without a word"
    assert judge(case, "linear", said) == judge(case, "linear", Ending("unstable", None, "unstable: ...", ())) == ""
    assert judge(case, "radau", said) == "completed : error 0.1, stated 0.001"
    assert "must say 'no cycle'" in judge(case, "paper", Ending("completed", 0.0, "", ()))


@pytest.mark.parametrize("method", ANGLE_OF_A_STEP)
def test_twenty_thousand_cycles_lose_what_the_method_says(method):
    """Amplitude to rounding, phase by the method's own rational function of omega h."""
    amplitude, _, unexplained = drift(method, 20_000, 32)
    assert abs(amplitude) < 1e-9 and unexplained < 1e-8


@pytest.mark.parametrize("scene", ["engine", "rotating-cantilever"])
def test_kernels_in_single_precision(scene):
    assert max(single_precision(scene).values()) < 2e-6


def test_the_table_has_every_case(tmp_path):
    """A number or a named end where a method is meant, and accurate where it is stated so."""
    rows = {name: cells for _, name, _, *cells in csv_tables.read("extremes")}
    for case in (*CASES, *spike_cases(tmp_path)):
        cells = dict(zip(METHODS, rows[case.name], strict=True))
        assert [method for method, cell in cells.items() if cell != "-"] == list(case.methods), case.name
        for method in case.accurate if case.within else ():
            assert float(cells[method]) <= 1.1 * case.within, (case.name, method)
        for method in case.named:
            assert cells[method] in ("rejected", "unstable", "singular", "no periodic state"), (case.name, method)
    assert (PAGE.parent / "pictures" / "extremes.png").is_file()
