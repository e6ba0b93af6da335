"""What runs and `check` say of freedoms, stored steps and time, of what the coupling is worth, and of resonance."""

import math
import re
import time

import numpy as np
import pytest
from machines import machine
from runs import run, solved

import kaneflex
from kaneflex import load, read_scene, scene_of, with_settings
from kaneflex.multibody.time.run import Run
from kaneflex.report import checked
from kaneflex.report.summary import summarise
from kaneflex.solve.simulation import solve

TORQUE_FREE = machine(
    bodies=dict(top="mass = 1, inertia = [1, 2, 3], free = {at = [0, 0, 0], angular_velocity = [0.01, 2, 0]}"),
    sensors=dict(x="position top x"), solve=dict(preset="coupled", duration="10 s", steps=50, errors="none"),
)
SPACE = "spatial-slider-crank-elastic"


def test_a_torque_free_body_loses_no_energy():
    """Only the tolerance changes its energy; an integration that is wrong by more is still warned of."""
    found = solved(scene_of(TORQUE_FREE))
    assert found.energy.drift < 1e-5 and not [text for text in found.warnings if "energy balance" in text]
    rough = solved(scene_of(TORQUE_FREE), "solve.tolerance=1e-2")
    assert [text for text in rough.warnings if "energy balance" in text]


def test_forward_is_an_idle_setting_of_coupled_bodies_in_space():
    settings = ["solve.preset=coupled", "solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    for scene in (scene_of(TORQUE_FREE), read_scene(SPACE)):
        idle = load(with_settings(scene, [*settings, "solve.forward.tolerance=1e-4"]))
        assert [text for text in idle.warnings if text.startswith("solve.forward has no effect")]


def test_steps_that_are_not_stored_are_said():
    scene = with_settings(read_scene("engine"), ["solve.steps=1000000"])
    assert "solve.steps = 1000000: one instant is stored every 25 steps, 40001 in all" in checked.warnings(load(scene))
    assert not [text for text in load(read_scene("engine")).warnings if "stored" in text]


@pytest.mark.parametrize("settings", [(), ("solve.preset=coupled",), ("solve.preset=rigid",)])
def test_check_warns_of_what_is_between_two_steps_as_a_run_does(settings):
    model = load(with_settings(read_scene("engine"), ["solve.steps=1", *settings]))
    found = checked.warnings(model)
    assert any("turns by 720 deg in a step" in text for text in found)
    assert set(found) >= {text for text in solve(model).warnings if "between two steps" in text or "in a step" in text}


COUNT = "degrees of freedom"


def test_shapes_are_no_freedoms_of_joints():
    settings = ["solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    freedoms = [
        checked.description(load(with_settings(read_scene(SPACE), [*settings, f"solve.preset={preset}"])))[COUNT]
        for preset in ("coupled", "stiffened")
    ]
    assert freedoms[0] == freedoms[1] and "4 at shaft, guide, cross" in freedoms[0]["joints"]


def test_an_integration_counts_as_solving(monkeypatch):
    go = Run.go

    def slow(run, *given):
        time.sleep(0.3)
        return go(run, *given)

    monkeypatch.setattr(Run, "go", slow)
    began = time.perf_counter()
    timing = summarise(solved(scene_of(TORQUE_FREE))).timing
    spent = time.perf_counter() - began
    assert timing.integrate_s >= 0.3 and timing.set_up_s <= spent - 0.3


def _run(scene, *settings):
    return solve(kaneflex.load(with_settings(kaneflex.read_scene(scene), settings)))


def _warned(solution):
    """(share of the peak, sensor) of the warning; None where there is none."""
    found = (re.search(r"changes (\w+) by about (\d+)% of its peak", text) for text in solution.warnings)
    return next(((int(match[2]) / 100.0, match[1]) for match in found if match), None)


def test_the_slider_crank_parts_from_the_coupled_one_by_about_as_much_as_is_said():
    one_way, both = _run("slider-crank-150"), _run("slider-crank-150-coupled")
    worth, sensor = _warned(one_way)
    mine = one_way.series[sensor].values
    theirs = np.interp(one_way.times, both.times, both.series[sensor].values)
    assert abs(mine - theirs).max() / abs(theirs).max() == pytest.approx(worth, rel=0.5)


@pytest.mark.parametrize(("speed", "worst"), [(300, 0.378), (250, 0.194)])  # by preset coupled, coupler_mid
def test_a_four_bar_near_resonance_is_in_doubt(speed, worst):
    worth, _ = _warned(_run("four-bar", f"main.speed={speed} rpm"))
    assert worst / 2.0 < worth < 2.0 * worst


@pytest.mark.parametrize(("scene", "settings"), [
    ("four-bar", ["main.speed=150 rpm"]),  # 1.1 % by preset coupled
    ("engine", []),  # 0.2 %
    ("two-link-arm", []),  # an open chain: 0.6 %, where the arm sags by 2.6 % of its length
])  # fmt: skip
def test_where_little_is_left_out_nothing_is_said(scene, settings):
    assert _warned(_run(scene, *settings)) is None


def test_a_run_that_an_event_ends_is_weighed_over_what_both_have(tmp_path):
    """The other stiffness meets the event elsewhere, or never."""
    scene = tmp_path / "scene.toml"
    scene.write_text('like = "four-bar"\n[events]\ntop = {sensor = "coupler_mid", value = "1 mm", stop = true}\n')
    solution = _run(str(scene))
    assert solution.times[-1] < 0.1
    worth, _ = _warned(solution)
    assert 0.05 < worth < 1.0


def test_a_moment_that_a_pin_leaves_zero_has_no_peak_to_be_a_share_of():
    """Read with the links' own stiffness, not the changed one, it is some 1e-5 of the moments between the pins."""
    moments = {"pin": {"bending_moment": "coupler.start"}, "between": {"bending_moment": "coupler.mid"}}
    solution = solve(kaneflex.load(kaneflex.scene_of({"schema": 1, "like": "four-bar", "sensors": moments})))
    assert abs(solution["pin"].values).max() < 1e-9 * abs(solution["between"].values).max()
    assert _warned(solution)[1] != "pin"


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
    """A second limits the resonance as a decay by exp(-t) would, beside the damping by mass and stiffness."""
    driven, mode, frequency, amplified, change = said(wiper(0.85, **FOR_A_SECOND))
    assert (driven, mode) == (12.0, 1) and change > 5.0
    own, turning, low, high = (2.0 * math.pi * hertz for hertz in (frequency, driven, 5.0, 100.0))
    damping = 0.02 * (low * high + own**2) / (low + high) + 2.0
    assert amplified == pytest.approx(own**2 / math.hypot(own**2 - turning**2, damping * turning), rel=0.03)


def test_no_word_far_from_resonance_or_where_little_hangs_on_it():
    """An order is always near to the engine's modes at 13 and 93 times its cycle's frequency."""
    assert said(wiper(1.0, **PERIODIC)) is said(wiper(1.0, **FOR_A_SECOND)) is None
    for scene in ("engine", "four-bar", "slider-crank-150"):
        assert said(run(scene)) is None, scene
    assert said(run("engine", "solve.preset=coupled")) is None
