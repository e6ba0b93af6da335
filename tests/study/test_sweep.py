"""`kaneflex sweep`: which points, every sensor's statistics, failures, going on after an interruption, refusals."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import xarray
from command_line import cli, refused
from runs import solved
from studies import dataset, plan_of, swept_in

from kaneflex import OutputError, SceneError, read_scene, sweep, with_settings
from kaneflex.report.summary import sensor_summaries
from kaneflex.response.time_statistics import statistics, statistics_of_all
from kaneflex.study.plan import Plan
from kaneflex.study.records import Record, solve_points
from kaneflex.study.store import column
from kaneflex.study.study import Study, points_of
from kaneflex.study.sweep import Progress
from kaneflex.study.trade import choice
from kaneflex.support.labelled import read_labelled

HEAD = 'scene = "engine"\nsettings = ["solve.preset=rigid", "solve.steps=36"]\n'
STUDY = HEAD + """
[parameters]
"drives.main.speed" = {from = "2000 rpm", to = "6000 rpm", count = 3}
"rod.length" = ["137 mm", "150 mm", "30 mm"]
"""
"""Nine points; with a rod of 30 mm the linkage can't close."""


def points(**tables: object) -> list[dict]:
    return points_of(Study.model_validate({"scene": "engine", **tables}))


@pytest.fixture(scope="module")
def swept(tmp_path_factory) -> tuple[Plan, xarray.Dataset]:
    return swept_in(tmp_path_factory.mktemp("sweep"), STUDY)


def test_lists_ranges_and_listed_points_are_combined_and_the_last_varies_fastest():
    found = points(
        parameters={"a.x": {"from": 1, "to": 3, "count": 3}, "a.y": ["1 mm", "2 mm"]},
        points=[{"a.p": 1, "a.q": True}, {"a.p": 2, "a.q": False}],
    )
    assert len(found) == 12 and found[0] == {"a.x": 1, "a.y": "1 mm", "a.p": 1, "a.q": True}
    assert [point["a.p"] for point in found[:4]] == [1, 2, 1, 2]
    assert [point["a.x"] for point in found[::4]] == [1, 2, 3]
    assert all(isinstance(point["a.x"], int) for point in found)


def test_a_logarithmic_range_has_equal_ratios_and_exact_ends():
    found = [float(p["a.x"].split()[0]) for p in points(
        parameters={"a.x": {"from": "1 mm", "to": "7 mm", "count": 5, "scale": "log"}}
    )]  # fmt: skip
    assert (found[0], found[-1]) == (1.0, 7.0)
    assert np.diff(np.log(found)) == pytest.approx(np.log(7) / 4, rel=1e-14)


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube"])
def test_samples_fill_every_sixteenth_of_each_parameter_once(method):
    tables = {
        "parameters": {"a.x": {"low": 0.0, "high": 16.0}, "a.y": {"low": "16 mm", "high": "32 mm"}},
        "sample": {"method": method, "count": 16, "seed": 3},
    }
    found = points(**tables)
    assert sorted(int(point["a.x"]) for point in found) == list(range(16))
    assert sorted(int(float(point["a.y"].removesuffix(" mm"))) for point in found) == list(range(16, 32))
    assert points(**tables) == found
    assert points(**tables | {"sample": {"method": method, "count": 16, "seed": 4}}) != found


def test_random_samples_keep_to_their_ends_and_are_drawn_at_each_point_of_a_grid():
    found = points(
        parameters={"a.x": {"low": 1.0, "high": 100.0, "scale": "log"}, "a.n": [1, 2]},
        sample={"method": "random", "count": 200},
    )
    drawn = np.array([point["a.x"] for point in found])
    assert np.array_equal(drawn[:200], drawn[200:]) and drawn.min() > 1 and drawn.max() < 100
    assert (drawn < 10).mean() == pytest.approx(0.5, abs=0.1)
    assert list(found[0]) == ["a.x", "a.n"]


def test_statistics_are_those_of_a_run_by_itself(swept):
    _, found = swept
    scene = with_settings(
        read_scene("engine"),
        ["solve.preset=rigid", "solve.steps=36", "drives.main.speed='4000 rpm'", "rod.length='150 mm'"],
    )
    alone = sensor_summaries(solved(scene))
    row = found.isel(point=4)
    assert (float(row["drives.main.speed"]), float(row["rod.length"])) == (4000.0, 150.0)
    for name, entry in alone.items():
        assert row[name].attrs["units"] == entry.unit
        assert [float(row[name].sel(statistic=key)) for key in ("min", "max", "rms", "mean")] == [
            entry.min, entry.max, entry.rms, entry.mean
        ]  # fmt: skip


def test_coordinates_carry_the_studys_unit_and_can_be_unstacked(swept):
    _, found = swept
    assert found["drives.main.speed"].attrs["units"] == "rpm"
    texts, about = column(["137 mm", "0.14 m"])  # in no common one
    assert (texts.tolist(), about) == (["137 mm", "0.14 m"], {})
    laws, about = column(["20*cos(main)", "60*cos(main)"])  # which are no numbers in a unit
    assert (laws.tolist(), about) == (["20*cos(main)", "60*cos(main)"], {})
    grid = found["crank_torque"].set_index(point=["drives.main.speed", "rod.length"]).unstack("point")
    peaks = grid.sel(statistic="max", **{"rod.length": 137.0})
    assert dict(grid.sizes) == {"statistic": 4, "drives.main.speed": 3, "rod.length": 3}
    assert (np.diff(peaks.sel({"drives.main.speed": [2000.0, 6000.0]})) != 0).all()


def test_a_point_that_fails_has_its_reason_and_stops_nothing(swept):
    _, found = swept
    assert list(found["outcome"].values) == ["completed", "completed", "refused"] * 3
    assert "the loop cannot close" in str(found["reason"].values[2]) and str(found["reason"].values[0]) == ""
    assert np.isnan(found["crank_torque"].values[2]).all() and not np.isnan(found["crank_torque"].values[3]).any()


def test_an_unexpected_error_is_recorded_too(tmp_path, monkeypatch):
    def broken(model):
        raise ZeroDivisionError("of all things")

    monkeypatch.setattr("kaneflex.solve.variants.solve", broken)
    record = next(solve_points(plan_of(tmp_path, STUDY), [0]))
    assert (record.outcome, record.reason) == ("failed", "ZeroDivisionError: of all things")


def test_interrupted_and_resumed_no_point_is_lost_or_repeated(tmp_path, swept):
    plan, whole = swept
    solved: list[int] = []

    def counting(plan, todo):
        for record in solve_points(plan, todo):
            solved.append(record.point)
            yield record

    def interrupted(plan, todo):
        yield from counting(plan, todo[:3])
        raise KeyboardInterrupt

    journal = tmp_path / "out" / "journal.jsonl"
    for so_far in (3, 6):
        with pytest.raises(KeyboardInterrupt):
            sweep(plan, tmp_path / "out", interrupted)
        assert solved == list(range(so_far)) and not (tmp_path / "out" / "sweep.nc").exists()
        with journal.open("a") as file:
            file.write('{"point": 6, "outcome": "comp')  # the machine went down while it wrote
    sweep(plan, tmp_path / "out", counting)
    assert solved == list(range(9))
    assert dataset(tmp_path / "out").identical(whole)
    assert not journal.exists()
    sweep(plan, tmp_path / "out", counting)
    assert len(solved) == 9


def test_two_sweeps_at_once_do_not_share_a_folder(tmp_path, swept):
    plan, whole = swept

    def twice(plan, todo):
        with pytest.raises(OutputError, match="another sweep is writing into it"):
            sweep(plan, tmp_path / "out", force=True)
        yield from solve_points(plan, todo)

    sweep(plan, tmp_path / "out", twice)
    assert dataset(tmp_path / "out").identical(whole)


def test_whatever_order_the_points_end_in_the_dataset_is_the_same(tmp_path, swept):
    plan, whole = swept
    sweep(plan, tmp_path / "out", lambda plan, todo: solve_points(plan, todo[::-1]))
    assert dataset(tmp_path / "out").identical(whole)


def test_series_are_those_of_the_run_and_filled_up_to_the_longest(tmp_path):
    plan = plan_of(tmp_path, 'series = true\nscene = "engine"\nsettings = ["solve.preset=rigid"]\n'
                   '[parameters]\n"solve.steps" = [36, 18]\n')  # fmt: skip
    sweep(plan, tmp_path / "out")
    found = dataset(tmp_path / "out")
    alone = solved(plan.at(1))
    assert np.array_equal(found["piston_position_series"][1, :19], alone.series["piston_position"].values)
    assert np.array_equal(found["time"][1, :19], alone.times)
    assert np.isnan(found["piston_position_series"][1, 19:]).all() and found.sizes["instant"] == 37
    assert not (tmp_path / "out" / "journal.jsonl").exists()


def test_a_gas_curve_is_found_beside_the_study_and_its_content_counts(tmp_path):
    for name, force in (("weak.csv", 1.0), ("strong.csv", 9.0)):
        (tmp_path / name).write_text(f"angle_deg,F_gas_N\n0,{force}\n240,{force}\n480,{force}\n720,{force}\n")
    text = HEAD + '[parameters]\n"loads.gas.table" = ["weak.csv", "strong.csv"]\n'
    plan = plan_of(tmp_path, text)
    assert {Path(path).name for path in plan.files} >= {"weak.csv", "strong.csv"}
    torques = [record.statistics["crank_torque"] for record in solve_points(plan, (0, 1))]
    assert torques[0] != torques[1]
    (tmp_path / "weak.csv").write_text("angle_deg,F_gas_N\n0,2\n240,2\n480,2\n720,2\n")
    assert plan_of(tmp_path, text).digest != plan.digest


def test_another_study_is_not_mixed_in_and_other_things_are_left_alone(tmp_path, swept):
    plan, _ = swept
    sweep(plan, tmp_path / "out")
    other = plan_of(tmp_path, STUDY.replace("count = 3", "count = 2"))
    with pytest.raises(OutputError, match="begun with another study"):
        sweep(other, tmp_path / "out")
    assert sweep(other, tmp_path / "out", force=True).total == 6
    with pytest.raises(OutputError, match=r"no study\.json"):
        sweep(plan, tmp_path, force=True)


@pytest.mark.parametrize(("text", "words"), [
    ('[parameters]\n"rod.lenght" = [1, 2]', ("rod.lenght", "length")),
    ('[parameters]\n"rod.length" = [1, 1]', ("parameters.rod.length", "is listed twice")),
    ('[parameters]\n"rod.length" = 1', ("neither a list nor a table", "settings")),
    ('[parameters]\n"rod.length" = {from = 1, to = 2}', ("count is missing",)),
    ('[parameters]\n"rod.length" = {from = 1, to = "2 mm", count = 2}', ("same unit",)),
    ('[parameters]\n"rod.length" = {from = 0, to = 2, count = 2, scale = "log"}', ("positive numbers",)),
    ('[parameters]\n"rod.length" = {low = 1, high = 2}', ("needs a sample table", "method = 'sobol'")),
    ('sample = {count = 12}\n[parameters]\n"rod.length" = {low = 1, high = 2}', ("sample.count = 12", "Use 16")),
    ('sample = {count = 8}\n[parameters]\n"rod.length" = [1]', ("no parameter is sampled",)),
    ('points = [{"rod.length" = 1}, {"rod.mass" = 1}]', ("the points set different entries",)),
    ('points = [{"rod.length" = 1}]\n[parameters]\n"rod.length" = [1]', ("points = 'rod.length': given twice",)),
    ('points = [{"rod.length" = 1, "bodies.rod.length" = 2}]', ("bodies.rod.length': given twice, first as rod",)),
    ('[parameters]\n"rod.E" = [1]\n"rod.beam.E" = [2]', ("first as rod.E in parameters",)),
    ('settings = ["rod.E=1"]\n[parameters]\n"bodies.rod.beam.E" = [2]', ("first as rod.E in settings", "once")),
    ('sensitivities = ["rod.E", "rod.beam.E"]\n[parameters]\n"rod.E" = [1]', ("sensitivities = 'rod.beam.E'",)),
    ("", ("nothing varies",)),
    ('[parameters]\n"ground.bearing" = [[1, 2], [3, 4]]', ("bearing.values.0: not a single value", "Give numbers")),
    ('settings = "rod.E=1"\n[parameters]\n"rod.length" = [1]', ("settings = 'rod.E=1': not a list", "brackets")),
    ('series = "yes"\n[parameters]\n"rod.length" = [1]', ("series = 'yes': neither true nor false",)),
    ('[parameters]\n"rod.length" = {form = 1, to = 2, count = 3}', ("rod.length.form", "unknown key", "'from'")),
    ("[bodies]\nrod = {length = 1}", ("it is a scene", "Write another file", "table of parameters")),
    ('parameter = {"rod.length" = [1]}', ("parameter", "unknown key", "'parameters'")),
])  # fmt: skip
def test_what_is_refused_before_anything_runs(tmp_path, text, words):
    file = tmp_path / "study.toml"
    file.write_text(f'scene = "engine"\n{text}\n')
    refused(cli("sweep", file, "-o", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()


def test_more_points_than_memory_holds_are_refused_before_they_are_made(tmp_path, monkeypatch):
    monkeypatch.setattr("kaneflex.study.plan.installed", lambda: 8 * 2**30)
    with pytest.raises(SceneError, match=r"200,000,000 points need 119 GiB, and this machine has 8 GiB\. Use .* 6,"):
        many = '"rod.length" = {from = 1, to = 2, count = 100000000}'
        plan_of(tmp_path, f'{HEAD}[parameters]\n{many}\n"rod.E" = [1, 2]\n')


def test_a_scene_that_is_not_there_and_a_name_that_the_dataset_has(tmp_path):
    with pytest.raises(SceneError, match=r"neither a shipped scene nor a file .* nearest known one is 'engine'"):
        plan_of(tmp_path, 'scene = "engin"\n[parameters]\n"rod.length" = [1]\n')
    with pytest.raises(SceneError, match=r"sensors\.outcome: .* Rename the sensor"):
        (tmp_path / "own.toml").write_text('like = "engine"\n[sensors]\noutcome = {drive_torque = "main"}\n')
        plan_of(tmp_path, STUDY.replace('"engine"', '"own.toml"'))


def test_progress_tells_rate_and_time_left():
    assert str(Progress(30, 90, 2, 20, 2.0)) == "30 of 90 points, 2 failed, 2 a second, 30 s left"
    assert str(Progress(0, 90, 0, 0, 0.0)) == "0 of 90 points, 0 a second"
    assert str(Progress(1, 7201, 0, 1, 1.0)).endswith("2 h 0 min left")


def test_the_command_says_what_failed_and_where_the_results_are(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(STUDY)
    result = cli("sweep", file, "--no-plots", "-o", tmp_path / "out")
    assert result.exit_code == 0 and "6 of 9 points completed" in result.stdout
    assert "Point 2: joints.bore" in result.stderr and "failed in all" not in result.stderr
    assert json.loads((tmp_path / "out" / "study.json").read_text())["points"] == 9
    file.write_text(HEAD + '[parameters]\n"rod.length" = [0.03, 0.031, 0.032, 0.033, 0.034, 0.035]\n')
    none = cli("sweep", file, "-o", tmp_path / "none")
    assert none.exit_code == 3 and "... 6 failed in all" in none.stderr and "Point 5" not in none.stderr


def test_a_sweep_by_a_tolerance_solves_all_points_by_one_model(tmp_path, monkeypatch):
    """It is within at the first, the middle and the last point, and the same when the sweep continues."""
    monkeypatch.setattr(choice, "cache_folder", lambda: tmp_path / "cache")
    file, out = tmp_path / "study.toml", tmp_path / "out"
    speeds = '{from = "1000 rpm", to = "9000 rpm", count = 4}'
    file.write_text(f'scene = "engine"\nsettings = ["solve.steps=240"]\n[parameters]\n"main.speed" = {speeds}\n')
    command = "sweep", file, "--no-plots", "-o", out, "--sensors", "mid_transverse"
    refused(cli(*command), "--sensors: requires --tolerance")
    refused(cli(*command, "--tolerance", "5%", "--preset", "rigid"), "--preset = 'rigid'")
    result = cli(*command, "--tolerance", "5%")
    assert result.exit_code == 0, result.output
    assert "Compared at points 0, 2, 3; elsewhere errors may be larger" in result.stdout
    settings = re.findall(r"--set (\S+)", result.stdout)
    assert settings[0] != "solve.preset=coupled"
    swept = dataset(out)
    for point, speed in ((0, "1000 rpm"), (3, "9000 rpm")):
        scene = with_settings(read_scene("engine"), ["solve.steps=240", f"main.speed={speed}"])
        own, rich = (solved(scene, *each) for each in (settings, ["solve.preset=coupled"]))
        peak = abs(rich.series["mid_transverse"].values).max()
        assert abs(own.series["mid_transverse"].values).max() == pytest.approx(peak, rel=0.05)
        found = swept["mid_transverse"].sel(point=point, statistic="max")
        assert float(found) == pytest.approx(own.statistics("mid_transverse").max, rel=1e-12)
    assert ", as found before\n" in cli(*command, "--tolerance", "5%").stdout
    file.write_text('scene = "engine"\n[parameters]\n"rod.elements" = [1, 2]\n')
    refused(cli(*command, "--tolerance", "5%"), "parameters = 'rod.elements'", "--tolerance chooses it")


def test_an_interrupt_leaves_what_is_finished_and_says_so(tmp_path, monkeypatch):
    file = tmp_path / "study.toml"
    file.write_text(STUDY)

    def solve(plan, points):
        yield from (Record(point, "refused", "not tried") for point in points[:2])
        raise KeyboardInterrupt

    monkeypatch.setattr("kaneflex.study.records.solve_points", solve)
    result = cli("sweep", file, "--no-plots", "-o", tmp_path / "out")
    assert result.exit_code == 130 and "The same command continues" in result.stderr
    assert len((tmp_path / "out" / "journal.jsonl").read_text().splitlines()) == 2


def test_an_interrupt_while_pictures_are_drawn_tells_of_the_dataset(tmp_path, monkeypatch):
    file = tmp_path / "study.toml"
    file.write_text('scene = "engine"\nsettings = ["solve.preset=rigid"]\n[parameters]\n"piston.mass" = [1, 2]\n')

    def draw(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("kaneflex.plots.draw", draw)
    result = cli("sweep", file, "-o", tmp_path / "out")
    assert result.exit_code == 130 and "finished points are kept" in result.stderr
    assert (tmp_path / "out" / "sweep.nc").is_file()


# ---- Poincare sections -------------------------------------------------------------------------------------------

SECTION = HEAD + """
poincare = {drive = "main", periods = 3, discard = 1}
[parameters]
"drives.main.speed" = ["3000 rpm", "6000 rpm", "-6000 rpm"]
"""


def test_a_section_is_read_once_a_period(tmp_path):
    """The engine's cycle is of two turns; 36 steps of each were asked for."""
    plan = plan_of(tmp_path, SECTION)
    sweep(plan, tmp_path / "out")
    found = dataset(tmp_path / "out")
    assert (found.outcome == "completed").all()
    assert found.time.values == pytest.approx(np.array([[0.08, 0.12], [0.04, 0.06], [0.04, 0.06]]), rel=1e-12)
    whole = solved(plan.at(0))
    two = plan.poincare.model_copy(update={"periods": 2})
    assert np.arange(73)[two.instants(73)].tolist() == [72]
    assert len(whole.times) == 3 * 36 + 1 and whole.times[-1] == pytest.approx(0.12)
    for name, series in whole.series.items():
        assert np.array_equal(found[f"{name}_series"].values[0], series.values[[72, 108]]), name
        assert found[name].sel(statistic="max").values[0] == series.values.max()


@pytest.mark.parametrize(("old", "new", "message"), [
    ("discard = 1", "discard = 3", "poincare.discard = 3: a run has only 3 periods. Discard fewer"),
    ('"main", p', '"mian", p', "poincare.drive = 'mian': no drive of that name. The nearest known one is 'main'."),
    ('"solve.steps=36"', '"solve.start=zero"', "poincare: the number of stored instants per period is not given. "
     "Give settings = [\"solve.steps=200\"]."),
    ("poincare", "series = true\npoincare", "poincare: it can't be combined with series or sensitivities. Leave"),
    ('scene = "engine"', 'scene = "engine-torque"', "its motion has no period. Choose a drive with a speed"),
])  # fmt: skip
def test_what_no_section_can_be_read_of_is_refused(tmp_path, old, new, message):
    text = SECTION.replace(old, new)
    text = text.replace("drives.main.speed", "drives.main.angle") if "torque" in text else text
    with pytest.raises(SceneError) as error:
        plan_of(tmp_path, text)
    assert message in str(error.value)


def test_a_point_whose_drive_stands_still_is_refused_and_the_dataset_can_be_read(tmp_path):
    """Of series that no point has, none are written."""
    text = SECTION.replace('"3000 rpm", "6000 rpm", "-6000 rpm"', '"0 rpm"').replace("3, d", "2, d")
    sweep(plan_of(tmp_path, text), tmp_path / "out")
    found = dataset(tmp_path / "out")
    assert found.outcome.values.tolist() == ["refused"] and "no rotating drive" in str(found.reason.values[0])
    assert not [name for name in found.data_vars if str(name).endswith("_series")]


def test_a_sweeps_picture_has_a_curve_for_each_value_of_the_other_parameters(swept, tmp_path):
    from kaneflex.plots.studies import sweep as figure
    from kaneflex.plots.style import styled

    swept[1].to_netcdf(tmp_path / "sweep.nc", engine="scipy")
    with styled():
        page = figure(read_labelled(tmp_path / "sweep.nc"))
    axes = next(axes for axes in page.axes if axes.get_title("left").startswith("crank_torque:"))
    (curve, least), found = axes.lines[:2], swept[1].isel(point=swept[1]["rod.length"] == 137)
    assert [line.get_label() for line in axes.lines[::2]] == ["rod.length = 137 mm", "rod.length = 150 mm"]
    assert curve.get_xdata().tolist() == [2000, 4000, 6000]
    assert curve.get_ydata() == pytest.approx(found.crank_torque.sel(statistic="max").values)
    assert least.get_ydata() == pytest.approx(found.crank_torque.sel(statistic="min").values)
    assert page.axes[-1].get_xlabel() == "drives.main.speed [rpm]"


def test_what_can_not_be_drawn_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(
        'scene = "engine"\nsettings = ["solve.steps=36"]\n[parameters]\n"solve.preset" = ["rigid", "quasistatic"]\n'
    )
    told = cli("sweep", "study.toml")
    assert told.exit_code == 0 and "No picture sweep: no parameter of the study is a number that varies" in told.stderr


def test_statistics_of_many_series_are_those_of_each():
    times = np.linspace(0.0, 2.0, 201)
    wave = np.sin(7.0 * times) + 0.3
    series = {"wave": wave, "large": 1e200 * wave, "none": np.full(201, np.nan), "still": np.zeros(201)}
    series["gaps"] = np.where(abs(times - 1.0) < 0.3, np.nan, wave)
    found = statistics_of_all(series, times)
    for name, values in series.items():
        np.testing.assert_allclose(found[name], statistics(values, times), rtol=1e-14)
    step = times[1]
    mean_square = step * (np.sum(wave**2) - (wave[0] ** 2 + wave[-1] ** 2) / 2) / 2.0  # the trapezoidal rule
    assert found["large"].rms == pytest.approx(1e200 * math.sqrt(mean_square))
    assert found["wave"].at_max == np.argmax(wave) and found["gaps"].at_min == np.nanargmin(series["gaps"])
    assert found["gaps"].min == np.nanmin(series["gaps"]) and math.isnan(found["none"].mean)
    assert found["still"] == (0.0, 0.0, 0.0, 0.0, 0, 0)
