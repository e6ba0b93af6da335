"""What the deflections do to the motion, which one-way presets leave out, is warned of by what it is worth."""

import re

import numpy as np
import pytest

import kaneflex
from kaneflex.scene import with_settings
from kaneflex.solve.simulation import solve


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
