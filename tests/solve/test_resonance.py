"""A run near resonance says which order meets which mode, and by how much the peak depends on their distance."""

import math
import re

import pytest
from runs import run, solved

from kaneflex.scene import scene_of

WIPER = """
schema = 1
name = "wiper"
bodies.arm = {{length = {length}, beam = {{material = "aluminium", section.rectangle = [0.01, 0.02], elements = 2}}}}
joints.hub = {{revolute = ["ground", "arm.start"]}}
drives.hub = {{law = "0.006 * sin(2 * pi * 12 * t)"{period}}}
sensors.tip = {{displacement = "arm.end", component = "y"}}
damping.rayleigh = {{ratio = 0.01, at = ["5 Hz", "100 Hz"]}}
solve = {{preset = "{preset}", errors = "none"{more}}}
"""
PERIODIC = {"period": ', period = "83.333333333333333 ms"', "more": ', start = "periodic", steps = 400'}
FOR_A_SECOND = {"period": "", "more": ', start = "quasistatic", duration = "1 s", steps = 2000'}


def wiper(length, preset="stiffened", settings=(), **more):
    return solved(scene_of(WIPER.format(length=length, preset=preset, **more)), *settings)


def said(solution):
    """(driven Hz, mode, Hz, amplified, change) of the warning; None where there is none."""
    pattern = r"(\S+) Hz, is near mode (\d+), (\S+) Hz, which amplifies it (\S+) times: .* by about (\S+)%, which"
    pattern = pattern.replace("Hz, is", "Hz,? is")
    found = [match for match in (re.search(pattern, text) for text in solution.warnings) if match]
    return tuple(map(float, found[0].groups())) if found else None


@pytest.mark.parametrize("preset", ["stiffened", "coupled"])
def test_a_wiper_near_resonance_says_how_much_hangs_on_it(preset):
    """1 % of frequency is 2 % of E. A clamped arm has its first frequency at 1.875104^2 sqrt(E I / (rho A l^4))."""
    found = wiper(0.85, preset, **PERIODIC)
    driven, mode, frequency, amplified, change = said(found)
    E, rho, thick = 70e9, 2700.0, 0.01
    exact = 1.875104**2 / (2.0 * math.pi * 0.85**2) * math.sqrt(E / rho / 12.0) * thick
    assert (driven, mode) == (12.0, 1) and frequency == pytest.approx(exact, rel=5e-3)
    assert amplified == pytest.approx(1.0 / abs(1.0 - (driven / frequency) ** 2), rel=0.05)
    peaks = [abs(other.series["tip"].values).max() for other in (
        found, *(wiper(0.85, preset, [f"arm.E={70 * (1.0 + by) ** 2} GPa"], **PERIODIC) for by in (-0.01, 0.01))
    )]  # fmt: skip
    true = max(abs(peak / peaks[0] - 1.0) for peak in peaks[1:])
    assert change / 100.0 == pytest.approx(true, rel=0.25)


def test_without_a_period_the_frequency_is_found_in_the_load():
    driven, mode, _, _, change = said(wiper(0.85, **FOR_A_SECOND))
    assert (driven, mode) == (12.0, 1) and change > 5.0


def test_no_word_far_from_resonance_or_where_little_hangs_on_it():
    """An order is always near to the engine's modes at 13 and 93 times its cycle's frequency."""
    assert said(wiper(1.0, **PERIODIC)) is said(wiper(1.0, **FOR_A_SECOND)) is None
    for scene in ("engine", "four-bar", "slider-crank-150"):
        assert said(run(scene)) is None, scene
    assert said(run("engine", "solve.preset=coupled")) is None
