"""Extremes in their short form: every case ends within its accuracy or in a named outcome, never in silence."""

from pathlib import Path

import numpy as np
import pytest
from runs import derived_on_the_fly, model, run

from kaneflex.doubts import doubts
from kaneflex.errors import SceneError
from kaneflex.sampling import unseen
from kaneflex.simulation import simulate

CANTILEVER = """
schema = 1
[bodies]
bar = {{length = "500 mm", beam = {{material = "steel", A = "400 mm^2", I = "13333 mm^4"}}}}
[joints]
wall = {{weld = ["ground", "bar.start"]}}
[loads]
push = {{force_on = "bar.end", direction = [0, -1], law = "{law}"}}
[sensors]
tip = {{displacement = "bar.end", component = "x"}}
[solve]
preset = "quasistatic"
duration = "1 s"
steps = 10
"""


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("100 / t", r"loads\.push = '100 / t': it has no finite value at t = 0 s\. Give a law that is smooth"),
        ("sqrt(0.55 - t)", r"loads\.push = 'sqrt\(0\.55 - t\)': it has no finite value at t = 0\.6 s"),
    ],
)
def test_a_load_without_a_value_is_refused_before_anything_is_computed(law, message, tmp_path):
    with pytest.raises(SceneError, match=message):
        derived_on_the_fly(CANTILEVER.format(law=law), tmp_path)


def test_a_drive_without_a_speed_is_refused_before_anything_is_computed(tmp_path):
    text = """
schema = 1
[bodies]
rotor = {inertia = "1 kg m^2", mass = "1 kg"}
[joints]
shaft = {revolute = ["ground", "rotor"]}
[drives]
shaft = {law = "sqrt(t)"}
[solve]
duration = "1 s"
"""
    with pytest.raises(SceneError, match=r"drives\.shaft = 'sqrt\(t\)': the motion or one of its rates has no finite"):
        derived_on_the_fly(text, tmp_path)


def test_what_leaves_double_precision_on_the_way_is_named(tmp_path):
    """The force is a number, the square of the slope that it causes is none."""
    solution = simulate(derived_on_the_fly(CANTILEVER.format(law="1e200 * t"), tmp_path))
    with np.errstate(over="ignore", invalid="ignore"), pytest.raises(SceneError) as error:
        _ = solution.series
    assert str(error.value).startswith("sensors.tip: it has no finite value at t = 0.1 s. Correct the numbers")


def test_a_spike_between_two_steps_is_named(tmp_path):
    """0.2 degrees wide at 370.25 degrees: steps of half a degree pass it by, unless they are finer."""
    near = np.round(np.arange(365.05, 375, 0.05), 2)
    spike = spiked(tmp_path / "spike.csv", [*range(0, 366, 5), *near, *range(375, 721, 5)], 370.25)
    (said,) = unseen(model("engine", *spike))
    assert said.startswith("loads.gas comes and goes between two steps, by 100% of its") and "t = 0.01028 s" in said
    assert unseen(model("engine", *spike, "solve.steps=28800")) == []


def test_a_table_whose_curve_overshoots_is_named(tmp_path):
    """Rows of 0.05 degrees between rows of 5: the smooth curve turns the flank into a high wave."""
    rows = [*range(0, 370, 5), 370, 370.05, 370.1, 370.15, 370.2, *range(375, 721, 5)]
    (said,) = (text for text in unseen(model("engine", *spiked(tmp_path / "spike.csv", rows, 370.1))) if "rows" in text)
    assert said.startswith("loads.gas: the smooth curve through its rows overshoots them by ")
    assert not any("rows" in text for text in unseen(model("engine")))


def spiked(table: Path, rows: list[float], at: float) -> tuple[str, ...]:
    """Settings of the engine whose gas pushes with 100 kN at one angle [deg], with half of it 0.05 degrees beside."""
    force = {at - 0.05: 5e4, at: 1e5, at + 0.05: 5e4}
    pushed = [next((F for place, F in force.items() if abs(row - place) < 1e-6), 0.0) for row in rows]
    table.write_text("deg,F\n" + "".join(f"{row},{F}\n" for row, F in zip(rows, pushed, strict=True)))
    return f"gas.table={table}", "gas.column=F"


def test_steps_of_whole_turns_are_named():
    said = unseen(model("engine", "solve.preset=paper", "main.speed=600000 rpm", "solve.steps=400"))
    assert said[0].startswith("main turns by 360 deg in a step") and "give solve.steps = 5027 or more" in said[0]


STILL = ("bodies.piston.mass=1e6 kg", "loads.gas=none", "damping=none", "solve.start=zero")


def test_a_link_that_stretches_is_named():
    """A piston of 1e6 kg stands still while the crank turns: the rod is stretched by the stroke, 80 mm."""
    solution = run("engine", "solve.preset=linear", *STILL)
    (said,) = (text for text in doubts(solution, [1e3]) if "stretches" in text)
    assert said.startswith("rod stretches by 0.58 of its length")
