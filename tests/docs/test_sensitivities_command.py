"""docs/sensitivities.md: its command and Python say what it says; derivatives in folders and studies; refusals."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import xarray
from command_line import cli, refused
from pages import check_printed, commands, page
from runs import model, run

import kaneflex
from kaneflex import SceneError, read_scene, sensitivities, with_settings
from kaneflex.plots import studies
from kaneflex.study.sensitivity.parameters import find_parameters

TEXT = page("sensitivities.md")
QUICK = ("solve.preset=quasistatic", "solve.steps=72")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> tuple[Path, str]:
    """The folder that the page's command makes, and what it prints."""
    path = tmp_path_factory.mktemp("page") / "out"
    (command,) = commands(TEXT)
    found = cli(*command, "-o", path, "--no-plots")
    assert found.exit_code == 0, found.output
    return path, found.stdout


def test_the_command_prints_the_table_of_the_page(folder):
    table = re.findall(r"^    (.*\S)$", TEXT.partition("writes")[0], flags=re.MULTILINE)
    printed = [" ".join(line.split()) for line in folder[1].splitlines()]
    assert len(table) == 4
    for line in table:
        assert " ".join(line.split()) in printed


def test_the_files_hold_what_the_page_says(folder):
    about = json.loads((folder[0] / "summary.json").read_text())
    with xarray.open_dataset(folder[0] / "sensitivities.nc", engine="scipy") as found:
        derivative = found["d_mid_transverse_d_rod.E"]
        assert (derivative.units, found.modal_basis) == ("m/Pa", "frozen")
        highest = about["sensors"]["mid_transverse"]["at_max"]["time_s"]
        entry = about["sensitivities"]["rod.E"]
        at_peak = float(derivative.sel(time=highest, method="nearest"))
        np.testing.assert_allclose(entry["sensors"]["mid_transverse"]["max"], at_peak, rtol=1e-12)
        assert len(found.data_vars) == 4 * len(about["sensors"])
    assert (entry["value"], entry["unit"]) == (2.1e11, "Pa")


def test_the_bars_are_the_numbers_of_the_table(tmp_path, monkeypatch):
    """A heavier, thicker rod strains less, and more speed bends it by its square."""
    asked = [part for text in QUICK for part in ("--set", text)] + ["--sensitivities", "rod.I,main.speed"]
    monkeypatch.setattr("kaneflex.plots.draw_all", lambda *_: [])  # seconds of other pictures
    printed = cli("run", "engine", *asked, "-o", tmp_path / "out")
    found = sensitivities(run("engine", *QUICK), ["rod.I", "main.speed"])
    axes = studies.sensitivities(found).axes[0]
    bars = {each.get_label(): [bar.get_width() for bar in each] for each in axes.containers}
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == [*found.solution.model.scene.sensors] and len(names) > 9 and [*bars] == ["rod.I", "main.speed"]
    for name, inertia, speed in zip(names, *bars.values(), strict=True):
        row = [line.split() for line in printed.stdout.splitlines() if line.startswith(f"{name} ")][-1]
        assert [f"{round(value, 4) + 0.0:+.4f}" for value in (inertia, speed)] == row[1:]
    assert (tmp_path / "out" / "sensitivities.png").exists() and axes.get_xlabel().endswith("[%]")
    assert "sensitivities</figcaption>" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_the_python_prints_what_its_comments_say(capsys):
    check_printed(TEXT, capsys)


def test_links_and_options_of_the_page_are_there():
    shown = cli("run", "--help").stdout
    assert all(option in shown for option in re.findall(r"--(?:sensitivities|basis)", TEXT))


def test_a_study_has_the_derivatives_of_a_point(tmp_path):
    (tmp_path / "study.toml").write_text(
        f'scene = "engine"\nsettings = {json.dumps(QUICK)}\nsensitivities = ["rod.E"]\nseries = true\n'
        '[parameters]\n"drives.main.speed" = ["3000 rpm"]\n'
    )
    assert cli("sweep", tmp_path / "study.toml", "--no-plots", "-o", tmp_path / "out").exit_code == 0
    solution = run("engine", *QUICK, "drives.main.speed=3000 rpm")
    expected = sensitivities(solution, ["rod.E"])
    of = expected.of(expected.parameters[0], "mid_transverse")
    with xarray.open_dataset(tmp_path / "out" / "sweep.nc", engine="scipy") as found:
        column = found["d_mid_transverse_d_rod.E"].sel(point=0)
        assert column.units == "m/Pa"
        np.testing.assert_allclose(column, [of.min, of.max, of.rms, of.mean], rtol=1e-9)
        series = found["d_mid_transverse_d_rod.E_series"].sel(point=0)
        np.testing.assert_allclose(series, expected.series(expected.parameters[0], "mid_transverse"), rtol=1e-9)
    (tmp_path / "wrong.toml").write_text((tmp_path / "study.toml").read_text().replace("rod.E", "rod.F"))
    refused(cli("sweep", tmp_path / "wrong.toml", "-o", tmp_path / "none"), "rod.F", "no such entry")


@pytest.mark.parametrize(("scene", "name", "words"), [
    ("engine-paper", "rod.E", ("solve.preset = 'paper'", "Use preset linear, stiffened, quasistatic or coupled")),
    ("engine", "rod.A", ("rod.A: the scene gives no such number", "--set rod.A=VALUE")),
    ("engine", "rod.elements", ("rod.elements = '4'", "not a real number")),
    ("engine", "bore.direction", ("bore.direction = '(1.0, 0.0)'", "a list", "for example bore.direction.0")),
    ("engine", "bore.direction.0", ("bore.direction.0 = 1.0", "no sensor depends on it")),
    ("engine", "damping.rayleigh.at.2", ("a list of numbers", "Choose one of its 2")),
    ("engine", "rod.length.0", ("rod.length.0 = 0.137", "not a list")),
    ("engine", "main.angle", ("main.angle = 0.0", "zero")),
    ("engine", "rod.E,", ("sensitivities = '': an empty path",)),
    ("engine", "rod.EI", ("rod.EI", "nearest known one is 'I'")),
    ("engine", "solve.mode_angle", ("solve.mode_angle", "not a number of the mechanism")),
    ("engine", "rod.nu", ("rod.nu = 0.3", "no sensor depends on it")),
    ("engine", "rod.E,bodies.rod.beam.E", ("given twice, first as rod.E",)),
])  # fmt: skip
def test_refusals_name_key_value_and_cure(tmp_path, scene, name, words):
    refused(cli("run", *shlex.split(scene), "-o", tmp_path / "out", "--no-plots", "--sensitivities", name), *words)
    assert not (tmp_path / "out").exists()


def test_what_follows_the_forces_or_stops_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"drives\.\w+\.free = True: .* Use preset coupled"):
        sensitivities(run("engine-torque-elastic", "solve.preset=stiffened", "solve.duration=0.002"), ["rod.E"])
    scene = tmp_path / "stops.toml"
    scene.write_text('like = "engine"\n[events]\ntop = {sensor = "mid_transverse", stop = true}\n')
    with pytest.raises(SceneError, match=r"events\.top\.stop = True: the end of the run depends on"):
        sensitivities(run(str(scene), *QUICK), ["rod.E"])
    solution = run("engine", *QUICK)
    with pytest.raises(SceneError, match="only a complete run"):
        sensitivities(solution.at(solution.times[:5]), ["rod.E"])


@pytest.mark.parametrize(("scene", "name", "unit"), [
    ("engine", "rod.length", "m"), ("engine", "main.speed", "rad/s"), ("engine", "rod.beam.I", "m^4"),
    ("engine", "gas.period", "rad"), ("rotating-cantilever", "push.value", "N"),
    ("four-bar", "masses.at_first.mass", "kg"), ("spin-up", "hub.spin_up", "s"),
    ("engine", "damping.rayleigh.ratio", "1"), ("engine", "rod_mid_strain.fibre", "m"),
    ("engine", "damping.rayleigh.at.1", "Hz"), ("four-bar", "ground.right.0", "m"),
    ("robot-arm", "column.inertia.0", "kg m^2"), ("spinning-top", "tip.angular_velocity.0", "rad/s"),
])  # fmt: skip
def test_units_of_parameters(scene, name, unit):
    (parameter,) = find_parameters(read_scene(scene), [name])
    assert parameter.unit == unit


def test_the_functions_are_public():
    assert kaneflex.sensitivities is sensitivities
    scaled = find_parameters(read_scene("engine"), ["rod.length"])[0].scaled(read_scene("engine"), 2.0)
    assert scaled.bodies["rod"].length == pytest.approx(0.274)
    assert with_settings(scaled, []).bodies["crank"].length == model("engine", *QUICK).scene.bodies["crank"].length
