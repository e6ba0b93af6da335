"""Results as labelled arrays, as netCDF and in numbers."""

import csv
import json
import math
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from places import DOCS
from runs import run

import kaneflex
from kaneflex.report.summary import (
    Instant,
    Operations,
    SensorError,
    SensorSummary,
    StressSummary,
    Summary,
    Timing,
    _sensor,
    drive_degrees,
    json_schema,
    summarise,
)
from kaneflex.report.tables import _sensor_row, run_lines, sensor_cells
from kaneflex.response.time_statistics import statistics
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.error_stages import REQUEST
from kaneflex.solve.modes import PeakSpread
from kaneflex.solve.summary_tables import (
    Attempt,
    Choice,
    ContactSummary,
    EnergyBalance,
    FrictionSummary,
    ParameterSensitivity,
    SensorDerivative,
    UnresolvedMode,
)
from kaneflex.support.labelled import Labelled


@pytest.fixture(scope="module")
def solution():
    from kaneflex.solve.loading import load
    from kaneflex.solve.simulation import simulate

    settings = ["solve.preset=quasistatic", "solve.steps=240", "rod.elements=1", "main.angle=10 deg"]
    return simulate(load(kaneflex.with_settings(kaneflex.read_scene("engine"), settings)))


@pytest.fixture(scope="module")
def stored(solution, tmp_path_factory):
    path = tmp_path_factory.mktemp("results") / "results.nc"
    solution.labelled.to_netcdf(path)
    return path


def test_a_table_has_the_numbers_with_their_units(solution, tmp_path):
    path = tmp_path / "results.csv"
    solution.labelled.to_csv(path, along="time")
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    assert head[:2] == ["time [s]", "drive_angle_main [degree]"]
    assert head[2:] == [f"{name} [{series.unit}]" for name, series in solution.series.items()]
    found = np.array(rows, dtype=float).T
    assert (found[0] == solution.times).all()
    for column, series in zip(found[2:], solution.series.values(), strict=True):
        assert (column == series.values).all()


def test_models_and_solutions_say_what_they_are_in_one_line(solution):
    assert repr(solution.model) == "Model(engine, quasistatic, 3 degrees of freedom)"
    assert repr(solution) == "Solution(engine, quasistatic, 3 degrees of freedom, completed, 241 instants)"


def test_a_solution_is_gone_through_by_its_sensors(solution):
    assert list(solution) == list(solution.series)
    assert "crank_torque_rigid" in solution and "torque" not in solution


@pytest.mark.parametrize(("unit", "largest", "row"), [
    ("m", 3e-3, ("mm", "3")),
    ("m", -3e-7, ("um", "-0.3")),
    ("m", 0.0, ("mm", "0")),
    ("N", -9.5, ("N", "-9.5")),
    ("N", 12.0, ("kN", "0.012")),
    ("rad", math.pi, ("deg", "180")),
])  # fmt: skip
def test_a_row_is_shown_in_the_unit_that_its_values_ask_for(unit, largest, row):
    at = Instant(time_s=0.0, drive_deg=0.0)
    low, high = sorted((0.0, largest))
    entry = SensorSummary(unit=unit, meaning="", min=low, max=high, at_min=at, at_max=at, rms=0.0, mean=0.0)
    cells = _sensor_row("tip", entry)
    assert (cells[1], cells[2] if largest < 0 else cells[4]) == row


def test_what_is_told_of_a_run_is_no_rounding_and_in_units_that_people_read(solution):
    at = Instant(time_s=0.0, drive_deg=0.0)
    entry = SensorSummary(unit="m", meaning="", min=-1.0, max=1.0, at_min=at, at_max=at, rms=0.7, mean=3e-17)
    assert _sensor_row("swing", entry)[6] == "0"
    assert _sensor_row("swing", entry.model_copy(update={"mean": 3e-9}))[6] == "3e-06"
    told = summarise(solution)
    for ns, said in ((0.0, "solve"), (450.0, "450 ns a step"), (189787.0, "189.8 us a step"), (2e7, "20 ms a step")):
        timing = told.timing.model_copy(update={"ns_per_step": ns})
        assert run_lines(told.model_copy(update={"timing": timing})).splitlines()[-1].endswith(said)


@pytest.mark.parametrize(("reason", "lines"), [("", 2), (f"not estimated: slow; {REQUEST}", 3), ("not estimated", 2)])
def test_a_run_says_why_errors_are_not_estimated_where_they_could_be(solution, reason, lines):
    text = run_lines(summarise(solution).model_copy(update={"errors": reason}))
    assert len(text.splitlines()) == lines and (reason in text) == (lines == 3 or not reason)


def test_dataset_has_a_variable_for_each_sensor_with_units_and_meaning(solution):
    dataset = solution.dataset
    assert set(dataset.data_vars) == set(solution.series) and "crank_torque_rigid" in dataset
    for name, series in solution.series.items():
        assert dataset[name].dims == ("time",)
        assert dataset[name].attrs == {"units": series.unit, "long_name": series.meaning}
        np.testing.assert_array_equal(dataset[name], series.values)
    assert dataset.time.attrs["units"] == "s" and dataset.time.values[-1] == pytest.approx(0.02)
    assert dataset.drive_angle_main.attrs["units"] == "degree"
    np.testing.assert_allclose(dataset.drive_angle_main, 10.0 + np.linspace(0.0, 720.0, 241), atol=1e-9)


def test_a_sensor_is_a_labelled_array_and_an_unknown_one_names_the_nearest(solution):
    series = solution["rod_force_piston"]
    assert series.sel(time=0.01, method="nearest") == series.values[120]
    with pytest.raises(KeyError, match="'rod_force_piston'"):
        solution["rod_force_pistn"]


def test_file_opens_with_plain_xarray_in_a_fresh_process(stored):
    code = f"""
import sys, xarray
data = xarray.open_dataset({str(stored)!r})
print(data.time.dtype, *(data[name].attrs["units"] for name in ("time", "drive_angle_main", "mid_transverse")))
print("drive_angle_main" in data.coords, data.attrs["scene"], [m for m in ("netCDF4", "h5netcdf") if m in sys.modules])
"""
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert shown.stdout.splitlines() == ["float64 s degree m", "True engine []"], shown.stderr


def test_file_holds_what_the_dataset_holds(solution, stored):
    with xarray.open_dataset(stored) as found:
        xarray.testing.assert_identical(found.load(), solution.dataset)
        assert found.attrs["outcome"] == "completed" and found.attrs["preset"] == "quasistatic"
        assert found.attrs["structure"] == structure_hash(solution.model.scene)


def test_file_is_the_one_that_xarray_writes(tmp_path):
    """Every kind of value, coordinates of one, of all and of no variable, texts beyond ASCII."""
    time, two = np.linspace(0.0, 1.0, 3), ("state", "time")
    labelled = Labelled(
        {"z": ("time", time, {"units": "m", "value": 2.5}), "both": (two, np.array([[1.0, np.nan, 2.0]] * 2)),
         "said": ("time", np.array(["ä", "xx", ""])), "ran": ("state", np.array([True, False])), "one": ((), 1.5)},
        {"time": ("time", time, {"units": "s"}), "angle": ("time", time), "state": ("state", np.array(["p", "qq"])),
         "number": ("state", np.array([1, 2])), "lonely": ("other", np.zeros(2))},
        {"title": "Stößel"},
    )  # fmt: skip
    ours, theirs = tmp_path / "ours.nc", tmp_path / "theirs.nc"
    labelled.to_netcdf(ours)
    labelled.dataset().to_netcdf(theirs, engine="scipy", format="NETCDF3_64BIT")
    for decode in (True, False):
        with xarray.open_dataset(ours, decode_cf=decode) as found, xarray.open_dataset(theirs, decode_cf=decode) as x:
            xarray.testing.assert_identical(found.load(), x.load())


def test_an_integer_beyond_32_bits_is_a_double_in_the_file(tmp_path):
    Labelled({"E": ("point", np.array([210_000_000_000, 1]))}, {}, {}).to_netcdf(tmp_path / "E.nc")
    with xarray.open_dataset(tmp_path / "E.nc") as found:
        assert found["E"].dtype == np.float64 and found["E"].values.tolist() == [2.1e11, 1.0]


def test_file_depends_on_neither_clock_nor_place(solution, stored, tmp_path):
    solution.labelled.to_netcdf(tmp_path / "again.nc")
    assert (tmp_path / "again.nc").read_bytes() == stored.read_bytes()
    assert str(stored.parent).encode() not in stored.read_bytes()


def test_the_summary_counts_elements_as_the_run_has_them():
    written, overruled = (summarise(run("engine", *more)) for more in ((), ("solve.preset=paper",)))
    assert written.elements == {"rod": 4} != overruled.elements


# ---- the summary ------------------------------------------------------------------------------------------------


def test_summary_of_a_solution(solution):
    summary = summarise(solution, ["rod.elements=1"])
    assert summary.settings == ["rod.elements=1"]
    assert summary.options == solution.model.options.as_dict()
    force = solution.series["rod_force_piston"].values
    entry = summary.sensors["rod_force_piston"]
    assert (entry.unit, entry.min, entry.max) == ("N", force.min(), force.max())
    index = int(force.argmin())
    assert entry.at_min == Instant(time_s=solution.times[index], drive_deg=(10.0 + 3.0 * index) % 720.0)
    # a periodic cycle: the mean over equal steps, its last instant being its first
    assert entry.mean == pytest.approx(force[:-1].mean(), rel=1e-4)
    assert entry.rms == pytest.approx(np.sqrt((force[:-1] ** 2).mean()), rel=1e-4)
    assert summary.timing.integrate_s == solution.seconds > 0
    assert Summary.model_validate_json(summary.model_dump_json()) == summary


def test_a_run_from_python_warns_of_what_the_terminal_and_the_summary_say():
    """Without K_g the spin takes a blade's stiffness away above 1.01 of its critical speed; 1e17 m come out."""
    from kaneflex.solve.loading import load
    from kaneflex.solve.simulation import simulate, solve

    model = load(kaneflex.with_settings(kaneflex.read_scene("spin-up"), ["solve.preset=linear"]))
    with pytest.warns(kaneflex.ValidityWarning) as said:
        found = simulate(model)
    assert [str(each.message) for each in said] == [found.message, *found.warnings]
    assert all(Path(each.filename) == Path(__file__) for each in said)
    assert found.message.startswith("unstable: the motion grows without bound, at t = ")
    assert any("because of the spin" in text for text in found.warnings)
    assert summarise(found).warnings == list(found.warnings)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # for those who pass them on themselves, like the terminal
        assert solve(model).warnings == found.warnings


def test_a_part_of_a_run_has_the_warnings_of_the_whole(solution):
    assert solution.at(solution.times[:2]).warnings == solution.warnings
    none = solution.at(solution.times[:0])
    with pytest.raises(ValueError, match=f"has no values: {none.message}"):  # not NumPy's, of the largest of nothing
        none[next(iter(none.series))]


def test_frequencies_are_those_of_the_modes(solution):
    from kaneflex.multibody.model.building import reference_modes

    omega, _ = reference_modes(solution.model, "all")
    np.testing.assert_allclose(summarise(solution).frequencies_hz, omega / (2 * np.pi), rtol=1e-12)


@pytest.mark.parametrize(
    ("modes", "reduction", "kept"), [(2, "craig-bampton", 3), (3, "modal", 3), ("all", "none", 12)]
)
def test_degrees_of_freedom_are_counted_before_reduction(modes, reduction, kept):
    from kaneflex.solve.loading import load
    from kaneflex.solve.simulation import simulate

    settings = [f"solve.modes={modes}", f"solve.reduction={reduction}", "solve.steps=240"]
    model = load(kaneflex.with_settings(kaneflex.read_scene("engine"), settings))
    summary = summarise(simulate(model))
    assert (summary.degrees_of_freedom, summary.modes_kept) == (12, kept)
    assert summary.floquet_multiplier_max is not None


def sensor(values, times):
    values, times = np.asarray(values), np.asarray(times)
    return _sensor(SimpleNamespace(values=values, unit="m", meaning="made up"), statistics(values, times), times, None)


def test_statistics_of_a_known_signal():
    times = np.linspace(0.0, 2.0, 2001)
    entry = sensor(3.0 + np.sin(np.pi * times), times)
    assert entry.mean == pytest.approx(3.0, abs=1e-12)
    assert entry.rms == pytest.approx(np.sqrt(9.5), rel=1e-12)
    assert (entry.at_min.time_s, entry.at_max.time_s) == pytest.approx((1.5, 0.5))
    assert entry.at_min.drive_deg is None


def test_statistics_of_one_instant_of_nothing_and_of_an_explosion():
    assert (sensor([2.0], [0.0]).mean, sensor([2.0], [0.0]).rms) == (2.0, 2.0)
    assert sensor([0.0, 0.0], [0.0, 1.0]).rms == 0.0
    assert sensor([1e200, -1e200], [0.0, 1.0]).rms == pytest.approx(1e200)
    unknown_first = sensor([np.nan, 3.0, 1.0, 2.0], [0.0, 1.0, 2.0, 3.0])
    assert (unknown_first.at_min.time_s, unknown_first.at_max.time_s, unknown_first.mean) == (2.0, 1.0, 1.75)


def test_the_drives_angle_lies_within_its_cycle(solution):
    degrees = drive_degrees(solution)
    assert degrees[0] == pytest.approx(10.0) and degrees[-1] == pytest.approx(10.0)
    assert degrees.min() >= 0.0 and degrees.max() < 720.0
    drive = solution.model.scene.drives["main"]
    endless = solution.model.scene.model_copy(update={"drives": {"main": drive.model_copy(update={"cycle": None})}})
    running = drive_degrees(replace(solution, model=replace(solution.model, scene=endless)))
    assert running[-1] == pytest.approx(730.0)


SWINGS = ("drives.main.speed=none", "drives.main.cycle=none", "drives.main.period=0.01 s",
          "drives.main.law='0.5 * sin(200 * pi * t)'")  # fmt: skip


@pytest.mark.parametrize(("scene", "settings"), [
    ("engine", [*SWINGS, "solve.steps=36"]),
    ("engine", ["solve.duration=0.03 s", "solve.steps=90", "solve.start=zero"]),  # one and a half cycles
    ("robot-arm", ["solve.steps=20"]),  # three drives
])  # fmt: skip
def test_an_angle_that_does_not_name_one_instant_gives_way_to_the_time(scene, settings):
    solution = run(scene, "solve.preset=rigid", *settings)
    assert drive_degrees(solution) is None
    head, rows = sensor_cells(summary := summarise(solution))
    assert head[3] == head[5] == "at s"
    for (name, *cells), entry in zip(rows, summary.sensors.values(), strict=True):
        assert float(cells[4]) == pytest.approx(entry.at_max.time_s, rel=1e-4), name


def test_the_schema_beside_it_is_that_of_the_code():
    """If this fails: python -m kaneflex.report.summary > docs/data/summary.schema.json"""
    assert json.loads((DOCS / "data/summary.schema.json").read_text(encoding="utf-8")) == json_schema()


def test_every_field_of_the_summary_is_described():
    tables = (Summary, SensorSummary, Instant, PeakSpread, EnergyBalance, Choice, Attempt, Timing, Operations)
    tables += (ParameterSensitivity, SensorDerivative, SensorError, UnresolvedMode, ContactSummary, FrictionSummary)
    tables += (StressSummary,)
    fields = [(table.__name__, name, field) for table in tables for name, field in table.model_fields.items()]
    assert [(table, name) for table, name, field in fields if not field.description] == []
    assert set(json_schema()["$defs"]) == {table.__name__ for table in tables[1:]}
    assert set(json_schema()["required"]) == set(Summary.model_fields)


def test_fields_of_the_summary_change_only_with_its_version():
    """Whoever takes a field away or renames it raises SCHEMA_VERSION and writes the new list here."""
    promised = """schema_version kaneflex scene settings structure preset options elements outcome message warnings
    duration_s step_s steps stored sensors mode_angle_spread frequencies_hz degrees_of_freedom modes_kept
    floquet_multiplier_max timing operations"""
    version = re.search(r"has version (\d+)\.", (DOCS / "summary.md").read_text(encoding="utf-8"))[1]
    assert (version, set(promised.split()) - set(Summary.model_fields)) == ("1", set())
