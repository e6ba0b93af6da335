"""`kaneflex stability`: what it says and writes, and what it refuses."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from command_line import cli, refused
from matplotlib.figure import Figure

from kaneflex import SceneError, read_scene
from kaneflex.cli.stability import orders_of, range_of, speed_range
from kaneflex.plots.stability import _over_speed
from kaneflex.study.stability.sweep import ORDERS, Sweep, check_sweep


def columns(path: Path) -> dict[str, list[str]]:
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {key: [row[key] for row in rows] for key in rows[0]}


def test_trap_is_found_and_written(tmp_path):
    """The blade without K_g: unstable above 148.05 rpm, its first frequency at rest (eta = 3.516)."""
    folder = tmp_path / "trap"
    arguments = ("rotating-cantilever", "--preset", "linear", "--vary", "shaft.speed=100:200rpm", "--points", "5")
    result = cli("stability", *arguments, "-o", str(folder))
    assert result.exit_code == 0, result.output
    assert "from 100 rpm to 200 rpm, unstable from 148.05 rpm to 200 rpm" in result.output
    assert "grows 272.9-fold" in result.output and "K_g is left out" in result.output
    assert {path.name for path in folder.iterdir()} == {
        "stability.json", "cycle.csv", "speeds.csv", "stability.png", "stability.svg"
    }
    data = json.loads((folder / "stability.json").read_text())
    assert data["unstable"] and data["spectral_radius"] == pytest.approx(272.9, rel=1e-4)
    assert data["unstable_bands"] == [[pytest.approx(148.05 * np.pi / 30, rel=1e-4), pytest.approx(200 * np.pi / 30)]]
    assert data["buckling_margin"] is None
    speeds = columns(folder / "speeds.csv")
    radii = np.array(speeds["spectral_radius"], dtype=float)
    assert list(radii > 1) == [speed > 148.05 * np.pi / 30 for speed in map(float, speeds["speed"])]
    assert len(columns(folder / "cycle.csv")["frequency_1"]) == 144


def test_mathieus_scene_says_what_is_wrong_with_it(tmp_path):
    result = cli("stability", "mathieu", "--no-plots", "-o", str(tmp_path / "found"))
    assert result.exit_code == 0, result.output
    assert "unstable: a disturbance grows 4.1561-fold in a period of 3.1416 s" in result.output
    assert "the motion itself is unstable; integrators that add no growth: radau" in result.output
    assert "At the scene's own speed; --vary clock.speed=LOW:HIGH computes a range" in result.output
    assert "beyond the buckling load: the load factor is 0.5 at clock = 0 deg" in result.output
    assert {path.name for path in (tmp_path / "found").iterdir()} == {"stability.json", "cycle.csv"}
    assert cli("stability", "mathieu", "--no-plots", "-o", str(tmp_path / "found")).exit_code == 2


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [("0:12000rpm", 0.0, 400 * np.pi), ("600 rpm : 1200 rpm", 20 * np.pi, 40 * np.pi), ("10:20", 10.0, 20.0)],
)
def test_a_range_of_speeds(text, low, high, capsys):
    """A plain number is in rad/s, and that is said."""
    assert speed_range(read_scene("engine"), "main", text) == pytest.approx((low, high))
    told = "--vary 10:20: a plain number is in rad/s, so 190.986 rpm\n"
    assert capsys.readouterr().err == (told if text == "10:20" else "")


@pytest.mark.parametrize(
    ("text", "reason"),
    [("100rpm", "not of the form LOW:HIGH"), ("200:100rpm", "speeds must satisfy"), ("0:5 kg", "an angular speed")],
)
def test_a_range_that_is_none(text, reason):
    with pytest.raises(SceneError, match=reason) as found:
        speed_range(read_scene("engine"), "main", text)
    assert found.value.key == "--vary"


@pytest.mark.parametrize("text", ["100:200rpm", "crank.speed=1:2", "main.rotation=1:2"])
def test_only_the_first_drives_speed_varies(text):
    with pytest.raises(SceneError, match=r"over the speeds of the first drive. Write main.speed=LOW:HIGH"):
        range_of("main", text)


def test_a_number_of_speeds_needs_their_range():
    refused(cli("stability", "mathieu", "--points", "9"), "--points = 9: requires --vary")


def test_orders_meet_frequencies():
    """A frequency of 10 Hz meets order k at 10 / k turns a second."""
    speeds, nothing = 2 * np.pi * np.linspace(1.0, 11.5, 50), np.zeros(50)
    level = np.full((50, 1), 10.0)
    orders = (1.0, 1.5, 3.0)
    swept = Sweep("main", speeds, nothing, nothing, nothing, level, level, level, (), orders, ("mode 1",), "link")
    found = {crossing.order: crossing.speed for crossing in swept.crossings()}
    assert found == {k: pytest.approx(2 * np.pi * 10.0 / k) for k in (1.0, 1.5, 3.0)}


@pytest.mark.parametrize("text", ["", "1,,2", "0,1", "-1", "one", "nan", "inf", "1_0", "\uff11"])
def test_orders_that_are_none_are_refused(text):
    with pytest.raises(SceneError, match="orders must be positive numbers"):
        orders_of(text)


def test_orders_are_those_that_are_asked_for():
    assert orders_of("2, 0.5,1,1") == (0.5, 1.0, 2.0)


def test_campbells_diagram_names_its_curves():
    """Modes above a point of theirs, orders beside where they end; what the panel doesn't show has no name."""
    speeds, nothing = 2 * np.pi * np.linspace(1.0, 12.0, 50), np.zeros(50)
    level = np.tile([10.0, 40.0, 500.0], (50, 1))
    campbell, radii = Figure().subplots(2, 1)
    modes = ("mode 1", "mode 2", "mode 3")
    swept = Sweep("main", speeds, nothing, nothing, nothing + 0.5, level, level, level, (), ORDERS, modes, "link")
    _over_speed(campbell, radii, swept, 1.0, False)
    named = {text.get_text(): text.xy for text in campbell.texts if not text.get_text().endswith("rpm")}
    assert {*named} == {"mode 1", "mode 2", *(f"order {k}" for k in "123456")}
    assert (named["mode 1"], named["mode 2"]) == ((speeds[-1], 10.0), (speeds[-1], 40.0))
    assert named["order 3"] == pytest.approx((speeds[-1], 36.0))
    crossed = [line for line in campbell.get_lines() if line.get_marker() == "o"]
    assert len(crossed) == len(swept.crossings()) > 0
    assert (campbell.get_ylabel(), radii.get_ylabel()) == ("frequency [Hz]", "multiplier [1]")
    campbell.figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in campbell.texts if text.xy[0] == speeds[-1]]
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])
    assert "axes that turn with the links" in campbell.get_title()


@pytest.mark.parametrize("name", ["double-pendulum", "pin-ended-cross"])
def test_without_a_constant_speed_there_is_none_to_vary(name):
    """Of free joints, and of a frame that nothing drives."""
    with pytest.raises(SceneError, match="--vary: the first drive has no constant speed"):
        check_sweep(read_scene(name))
