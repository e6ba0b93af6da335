"""Extremes in their short form: every case ends within its accuracy or in a named outcome, never in silence."""

import numpy as np
import pytest
from runs import derived_on_the_fly

from kaneflex.errors import SceneError
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
