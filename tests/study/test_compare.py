"""`kaneflex compare` over presets: peaks and differences, what is left out and why, files and refusals."""

import csv
import json
import re

import numpy as np
import pytest
import xarray
from command_line import cli, refused, unrendered
from pages import check_printed, page
from places import DOCS
from runs import run

import kaneflex
from kaneflex import SceneError, compare, read_scene, with_settings
from kaneflex.solve.curves import Curves
from kaneflex.study.comparison import side_by_side

PAGE = page("comparison.md")
PRESETS = ("rigid", "quasistatic", "linear", "stiffened")


@pytest.fixture(scope="module")
def engine() -> kaneflex.Comparison:
    return compare(read_scene("engine"), PRESETS)


def test_the_repr_is_a_line(engine):
    assert repr(engine) == f"Comparison(engine: {', '.join(engine.curves)} against {engine.against})"


def of(comparison, sensor, model):
    (found,) = (e for e in comparison.differences if (e.sensor, e.model) == (sensor, model))
    return found


def test_the_last_preset_is_the_reference_and_its_curves_are_those_of_a_run(engine):
    assert (engine.against, list(engine.curves), engine.left_out) == ("stiffened", list(PRESETS), {})
    assert engine.times == pytest.approx(run("engine").times)
    for name in engine.scene.sensors:
        assert np.array_equal(engine.curves["stiffened"].values[name], run("engine").series[name].values)


def test_differences_are_those_of_the_curves(engine):
    """Without K_g the rod's transverse peak is 0.0291 mm instead of 0.0293: what a rigid rod lacks is the whole."""
    linear, rigid = (of(engine, "mid_transverse", model) for model in ("linear", "rigid"))
    assert linear.reference_peak == pytest.approx(0.0293e-3, abs=1e-7)
    assert linear.peak == pytest.approx(0.0291e-3, abs=1e-7)
    gap = engine.curves["linear"].values["mid_transverse"] - engine.curves["stiffened"].values["mid_transverse"]
    assert linear.peak_difference == abs(gap).max() > abs(linear.peak - linear.reference_peak)
    assert linear.error == linear.peak_difference / linear.reference_peak
    assert (rigid.peak, rigid.error) == (0.0, 1.0)
    assert {e.model for e in engine.differences} == {"rigid", "quasistatic", "linear"}
    assert len(engine.differences) == 3 * len(engine.scene.sensors)


def test_labelled_curves(engine):
    force = engine.dataset["rod_force_piston"]
    assert force.dims == ("model", "time") and force.attrs["units"] == "N"
    assert float(force.sel(model="rigid").min()) == pytest.approx(-33.08e3, abs=10)


def test_the_mean_square_is_over_time_and_curves_meet_at_the_references_instants():
    """A gap of 0, 2, 2 at 0, 1, 3 s has the mean square (2 + 8)/3; a straight line is met exactly on any instants."""
    scene = with_settings(read_scene("spin-up"), ["sensors.hub_torque=none"])
    coarse, fine = np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.5, 2.0, 3.0, 4.0])
    line = Curves(coarse, {"hub_angle": coarse, "root_force": np.zeros(3)}, {})
    above = Curves(fine, {"hub_angle": fine + np.array([0.0, 2.0, 2.0, 2.0, 2.0])}, {"root_force": "a reason"})
    found = side_by_side(scene, {"above": above, "line": line}, {}, None)
    (difference,) = found.differences
    assert difference.rms_difference == pytest.approx((10 / 3) ** 0.5, rel=1e-14)
    assert (difference.sensor, difference.peak, difference.reference_peak) == ("hub_angle", 5.0, 3.0)
    assert np.isnan(found.dataset["root_force"].sel(model="above")).all()
    both = side_by_side(scene, {"above": above, "line": line}, {}, "above")
    assert both.times[-1] == 3.0  # what both cover
    assert both.curves["above"].notes == ("peaks and differences cover the first 3 s only: the run of line ends there",)
    assert both.curves["line"].notes == ()


def test_a_preset_that_can_not_be_run_is_left_out_with_its_reason():
    scene = with_settings(read_scene("spin-up"), ["solve.integrator=newmark", "solve.steps=200"])
    found = compare(scene, ("linear", "quasistatic", "stiffened", "coupled"))
    assert list(found.curves) == ["quasistatic", "stiffened"] and found.against == "stiffened"
    assert "unstable" in found.left_out["linear"]  # without K_g the beam fails
    assert "this integrator is for equations that are linear in the displacements" in found.left_out["coupled"]


def test_too_few_that_run_and_a_lost_reference_are_refused():
    scene = with_settings(read_scene("spin-up"), ["solve.integrator=newmark", "solve.steps=200"])
    said = r"fewer than two of them can be run. Choose other presets.\ncoupled: solve.integrator.*\.$"
    with pytest.raises(SceneError, match=said):
        compare(scene, ("quasistatic", "coupled"))
    with pytest.raises(SceneError, match="coupled, the reference, can't be run"):
        compare(scene, ("quasistatic", "stiffened", "coupled"), against="coupled")


@pytest.mark.parametrize(("arguments", "words"), [
    (("--presets", "linear,stifened"), ("--presets = 'stifened'", "nearest known one is 'stiffened'")),
    (("--presets", "linear"), ("two or more", "Name at least two")),
    (("--presets", "linear,linear"), ("Name each model once",)),
    (("--against", "rigid"), ("--against = 'rigid'", "not one of the compared models")),
    (("--set", "sensors=none"), ("sensors", "no sensors to compare")),
])  # fmt: skip
def test_what_is_refused_before_anything_runs(tmp_path, arguments, words):
    folder = tmp_path / "out"
    refused(cli("compare", "engine", "-o", folder, *arguments), *words)
    assert not folder.exists()


def test_the_command_writes_its_folder_and_prints_the_table(tmp_path, monkeypatch):
    unrendered(monkeypatch)
    folder = tmp_path / "out"
    arguments = ("compare", "engine", "--presets", "rigid,stiffened", "-o", folder)
    result = cli(*arguments)
    assert result.exit_code == 0
    files = {"comparison.json", "differences.csv", "curves.nc", "overlay.png"}
    assert {path.name for path in folder.iterdir()} == files
    row = next(line.split() for line in result.stdout.splitlines() if line.startswith("tip_axial "))
    assert row == ["tip_axial", "rigid", "mm", "0", "0.1464", "0.1464", "100", "%", *row[8:]]
    about = json.loads((folder / "comparison.json").read_text())
    rows = list(csv.DictReader((folder / "differences.csv").open()))
    assert about["against"] == "stiffened" and len(rows) == len(about["differences"]) == 20
    assert float(rows[0]["reference_peak"]) == about["differences"][0]["reference_peak"]
    with xarray.open_dataset(folder / "curves.nc", engine="scipy") as curves:
        assert list(curves["model"].values) == ["rigid", "stiffened"]
    refused(cli(*arguments, "--no-plots"), "the folder exists")
    assert cli(*arguments, "--no-plots", "--force").exit_code == 0
    assert not (folder / "overlay.png").exists()


def test_the_page_prints_what_it_says(capsys):
    check_printed(PAGE, capsys)
    for picture in re.findall(r"\]\((pictures/[^)]+)\)", PAGE):
        assert (DOCS / picture).exists()


def test_the_pages_commands_are_accepted():
    options = {option for command in re.findall(r"^kaneflex compare .*$", PAGE, re.MULTILINE) for option in
               re.findall(r"--[a-z-]+", command)}  # fmt: skip
    shown = cli("compare", "--help").stdout
    assert options and all(option in shown for option in options)
