"""`kaneflex explore`: what a range leaves open, curves that follow the sliders, failing places, and no window."""

import matplotlib
import numpy as np
import pytest
from command_line import cli, refused

import kaneflex
from kaneflex import SceneError, load, read_scene, simulate, with_settings
from kaneflex.plots.explorer import Explorer
from kaneflex.plots.style import new_figure, styled
from kaneflex.study.exploration import Exploration, varied
from kaneflex.study.trade import choice

SCENE = with_settings(read_scene("engine"), ["solve.steps=144", "solve.integrator=radau"])
SPEED, LENGTH = "main.speed=2000:9000rpm", "rod.length=30:180mm"
SENSORS = ("mid_transverse", "mid_axial", "crank_torque")


@pytest.fixture
def explorer() -> Explorer:
    exploration = Exploration(SCENE, (varied(SCENE, SPEED), varied(SCENE, LENGTH)), SENSORS)
    with styled():
        return Explorer(new_figure(9.0, 9.0, "", layout="none"), exploration)


def curves(explorer: Explorer) -> dict[str, tuple[np.ndarray, str]]:
    """Sensor -> what its visible line shows, and the label of its axis."""
    axes = explorer.figure.axes[: -len(explorer.sliders)]
    return {
        line.get_label(): (line.get_ydata(), each.get_ylabel())
        for each in axes for line in each.lines if line.get_label() in SENSORS and line.get_visible()
    }  # fmt: skip


def test_a_moved_slider_shows_what_a_run_gives_there(explorer):
    speed, length = explorer.sliders
    assert (speed.val, length.val) == (6000.0, 137.0)
    speed.set_val(4500.0)
    length.set_val(150.0)
    explorer.update()
    expected = simulate(load(with_settings(SCENE, ["main.speed=4500 rpm", "rod.length=150 mm"]))).series
    factors = {"displacement [µm]": 1e6, "displacement [mm]": 1e3, "torque [N m]": 1.0}
    shown = curves(explorer)
    assert set(shown) == set(SENSORS)
    for name, (values, label) in shown.items():
        np.testing.assert_allclose(values, factors[label] * expected[name].values, rtol=1e-12, atol=1e-12)
    assert explorer.settings == ['main.speed="4500.0 rpm"', 'rod.length="150.0 mm"']


def test_where_the_linkage_cannot_close_the_window_says_so_and_goes_on(explorer):
    _, length = explorer.sliders
    length.set_val(35.0)
    explorer.update()
    assert curves(explorer) == {} and explorer.solution is None
    (said,) = [text.get_text() for text in explorer.figure.texts if "cannot close" in text.get_text()]
    assert said.startswith("joints.bore")
    length.set_val(140.0)
    explorer.update()
    assert set(curves(explorer)) == set(SENSORS)
    assert "free vibrations are not resolved" in explorer.message  # 144 steps: a run's warnings stand there, too


def test_a_window_that_opens_where_nothing_closes_has_units_and_a_message_above_the_titles():
    exploration = Exploration(SCENE, (varied(SCENE, "rod.length=30:35mm"),), SENSORS)
    with styled():
        opened = Explorer(new_figure(9.0, 9.0, "", layout="none"), exploration)
    panels = opened.figure.axes[:-1]
    assert opened.solution is None and all(each.get_ylabel().endswith("]") for each in panels)
    assert panels[-1].get_xlabel() == "angle of main [deg]"
    (message,) = [text for text in opened.figure.texts if "cannot close" in text.get_text()]
    message.set_text("\n".join(["the longest that is shown"] * 3))
    opened.figure.canvas.draw()
    assert message.get_window_extent().y0 > panels[0].title.get_window_extent().y1


def test_many_moves_of_a_slider_are_one_solution(explorer, monkeypatch):
    solved = []
    solve = Exploration.solve
    monkeypatch.setattr(Exploration, "solve", lambda self, values: solved.append(values) or solve(self, values))
    for speed in (3000.0, 3500.0, 4000.0):
        explorer.sliders[0].set_val(speed)
    assert solved == []  # the canvas's timer brings it, which one without a window does not have
    explorer.update()
    explorer.update()
    assert solved == [(4000.0, 137.0)]


def test_panels_have_titles_units_and_legends(explorer):
    panels = explorer.figure.axes[: -len(explorer.sliders)]
    assert len(panels) == 3
    for axes in panels:
        assert axes.get_title(loc="left") and axes.get_ylabel().endswith("]")
        assert "pale: the unchanged scene" in [text.get_text() for text in axes.get_legend().get_texts()]
    assert panels[-1].get_xlabel() == "angle of main [deg]"
    assert [slider.label.get_text() for slider in explorer.sliders] == ["main.speed", "rod.length"]


def test_a_range_says_unit_start_and_whole_numbers():
    speed = varied(SCENE, SPEED)
    assert (speed.unit, speed.low, speed.high, speed.start, speed.whole) == ("rpm", 2000.0, 9000.0, 6000.0, False)
    assert varied(SCENE, "rod.length=10:100 mm").start == 100.0  # the end next to 137 mm
    assert varied(SCENE, "main.speed=100.0:300.0").start == 200.0  # the scene says it in rpm
    elements = varied(SCENE, "rod.elements=1:8")
    assert elements.whole and elements.setting(3.0) == "rod.elements=3"


@pytest.mark.parametrize(("text", "words"), [
    ("main.speed=2000rpm", "not of the form"),
    ("main.speed=2000rpm:3000mm", "different units"),
    ("main.speed=2000:3000mm", ": the start value 2500 mm is not allowed: 'mm' is not a unit of angular speed"),
    ("main.speed=3000:2000rpm", "not greater than the first"),
    ("main.sped=1:2", "no such entry"),
    ("rod.elements=1.5:3.0", "whole number"),
])  # fmt: skip
def test_a_range_that_is_none_is_refused(text, words):
    with pytest.raises(SceneError, match=words):
        varied(SCENE, text)


def test_what_cannot_be_explored_is_refused(tmp_path):
    picture = tmp_path / "explored.png"
    refused(cli("explore", "engine", "-o", picture), "--vary", "nothing varies")
    refused(cli("explore", "engine", "--vary", SPEED, "--vary", "drives.main.speed=1:2rpm", "-o", picture), "twice")
    refused(cli("explore", "engine", "--vary", SPEED, "--sensors", "crank_torqe", "-o", picture), "crank_torque")
    refused(cli("explore", "engine", "--vary", SPEED, "-o", tmp_path / "explored.txt"), "not a kind of picture")
    with pytest.raises(SceneError, match="crank_torque"):
        kaneflex.explore(SCENE, [SPEED], ["crank_torqe"])
    shown = kaneflex.explore(SCENE, [SPEED], SENSORS, window=False)
    assert {line.get_label() for axes in shown.axes for line in axes.lines} >= set(SENSORS)
    assert list(tmp_path.iterdir()) == []


def test_a_window_shows_the_model_that_a_tolerance_chooses_at_the_ends_of_its_sliders(tmp_path, monkeypatch):
    """At 36000 rpm the rod acts back on the engine: one-way deformation is 8 % off."""
    monkeypatch.setattr(choice, "cache_folder", lambda: tmp_path)
    opened = []
    monkeypatch.setattr("kaneflex.plots.explore", lambda scene, *others: opened.append(scene) or ["main.speed=1"])
    command = "explore", "engine", "--set", "solve.steps=360", "--tolerance", "4%", "--sensors", "mid_transverse"
    result = cli(*command, "--vary", "main.speed=3000:36000rpm")
    assert result.exit_code == 0, result.output
    assert "Compared at the start and the ends of the sliders; elsewhere errors may be larger" in result.output
    assert opened[0].solve.preset == "coupled" and opened[0].drives == read_scene("engine").drives
    assert "--set solve.preset=coupled" in result.output and "--set main.speed=1" in result.output
    again = cli(*command, "--vary", "main.speed=3000:36000rpm")
    assert ", as found before\n" in again.output and opened[1] == opened[0]
    refused(cli(*command, "--vary", "rod.elements=1:8"), "--vary = 'rod.elements'", "--tolerance chooses it")
    refused(cli(*command), "--vary", "nothing varies")
    assert len(opened) == 2


def test_without_a_screen_it_says_how_to_have_a_picture():
    with matplotlib.rc_context({"backend": "agg"}):
        refused(cli("explore", "engine", "--vary", SPEED), "opens no window", "-o FILE.png")
