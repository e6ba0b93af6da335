"""`kaneflex trade`: the reference and its own error, what is chosen, files and refusals."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from bench_choice import finest_of
from command_line import cli, refused
from runs import solved

from kaneflex import SceneError, Trade, read_scene, trade, with_settings
from kaneflex.response.time_statistics import statistics
from kaneflex.solve.curves import Curves
from kaneflex.solve.error_stages import values_of
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import differences
from kaneflex.study.runs import Runs, Timing, cost, run
from kaneflex.study.trade.candidates import COUPLED, STIFFENED, candidates_of, neutral, neutral_settings, terms_of
from kaneflex.study.trade.reference import KNOWN, Reference, _finer, _stored, find_reference
from kaneflex.study.trade.trials import Trials
from kaneflex.support.terminal import silent

TRIED = ("rigid", "linear", "stiffened", "coupled", "quasistatic, 2 elements", "quasistatic, 1 element")
UNSTIFFENED = Variant("quasistatic without geometric", ("solve.preset=quasistatic", "solve.terms.geometric=false"))
BEARING = "main_bearing_force_x"


def tried(scene, *names) -> list[Variant]:
    by_name = {candidate.name: candidate for candidate in candidates_of(neutral(scene))}
    return [by_name[name] for name in names]


@pytest.fixture(scope="module")
def stages() -> list[str]:
    """What the engine's trade tells of its progress."""
    return []


@pytest.fixture(scope="module")
def engine(stages) -> Trade:
    scene = read_scene("engine")
    counting = [n for n in scene.sensors if n != BEARING]
    return trade(scene, 0.01, 60.0, counting, stages.append, [*tried(scene, *TRIED), UNSTIFFENED])


@pytest.fixture(scope="module")
def by_name(engine):
    return {entry.name: entry for entry in engine.ranked}


def test_the_reference_is_the_coupled_run_with_its_error_estimate(engine, by_name):
    """Two-way coupling changes the engine by 0.10 %, which counts as error of the others."""
    found = engine.reference
    assert found.name == "coupled" and not found.open and by_name["coupled"].error < 1e-3
    assert repr(engine).startswith("Trade(engine: ") and len(repr(engine)) < 160
    assert max(found.doubts.values()) == pytest.approx(3e-4, abs=1e-4)
    coupling = {each.sensor: each.error for each in by_name["stiffened"].differences}
    assert coupling["crank_pin_force_x"] == pytest.approx(0.00103, abs=0.0001)
    assert coupling["mid_axial"] == pytest.approx(0.00094, abs=0.0001)  # its axial modes converge, too


def test_sensors_whose_error_is_too_large_are_left_open_unless_they_are_named():
    """The twist of the blade is 1e-4 degrees, of bending in two directions: its modes converge slowly."""
    runs = Runs(neutral(read_scene("rotating-blade")))
    found = find_reference(runs, list(runs.scene.sensors), 0.01, 1.0, named=False)
    assert found.open.keys() == {"tip_twist"} and found.open["tip_twist"] > 0.05 and found.name == "coupled"
    assert found.sensors and max(found.doubts.values()) < 0.01
    with pytest.raises(SceneError, match=r"the error estimate of tip_twist is .*Use .* increase"):
        find_reference(runs, ["tip_lag", "tip_twist"], 0.001, 1.0, named=True)


def test_motions_with_impacts_are_refined_before_a_tolerance_is_refused():
    """Three modes are not enough for 1 % of the heights of a bouncing bar, seven are: compared with fifteen."""
    scene = with_settings(read_scene("bouncing-bar"), ["solve.duration=0.25 s", "solve.steps=1000"])
    found = find_reference(Runs(neutral(scene)), ["angle", "tip"], 0.01, 1.0, named=True)
    assert found.name == "coupled, 7 modes a link, tolerance 1.3e-10" and max(found.doubts.values()) < 0.01
    finer = solved(scene, "solve.modes=15", "bar.elements=16", "solve.tolerance=1e-10").statistics("tip").rms
    assert abs(statistics(found.curves.values["tip"], found.curves.times).rms / finer - 1) < max(found.doubts.values())


def test_peaks_and_rms_of_chaotic_impacts_are_not_known():
    """But the way of the piston is; what is left open is said after one richer run."""
    scene = with_settings(read_scene("slider-crank-clearance"), ["solve.duration=12 ms", "solve.steps=1200"])
    runs = Runs(neutral(scene))
    found = find_reference(runs, list(scene.sensors), 0.01, 1.0, named=False)
    assert "slide" in found.doubts and {"knock", "rod_moment"} <= found.open.keys() and len(runs.kept) == 1
    with pytest.raises(SceneError, match=r"peaks or rms of chaotic impacts: the error estimate of rod_moment is"):
        find_reference(runs, ["rod_moment"], 0.01, 1.0, named=True)


def test_each_model_is_run_once_before_the_repeats(engine, stages):
    """That coupled one, too, which has shown the reference that coupling is not needed."""
    solved = [stage for stage in stages if stage.startswith("solving, ")]
    assert "solving, coupled" in solved and len(set(solved)) == len(solved) == len(engine.ranked)


def test_the_engine_is_answered_quasi_statically_with_the_geometric_stiffness(engine, by_name):
    """0.88 % off with two elements and K_g; 2.4 % without K_g, 20 % with one element."""
    quasistatic = by_name["quasistatic, 2 elements"]
    assert quasistatic.error == pytest.approx(0.0088, abs=0.0002) and quasistatic.within
    # which of those that are good enough is cheaper by how little, a busy machine says otherwise every time
    assert engine.chosen.within and engine.chosen.cost.total <= quasistatic.cost.total
    without, single = by_name["quasistatic without geometric"], by_name["quasistatic, 1 element"]
    assert (without.worst.sensor, without.error) == ("mid_global_y", pytest.approx(0.0236, abs=0.0005))
    assert (single.worst.sensor, single.error) == ("mid_transverse", pytest.approx(0.2036, abs=0.001))
    assert not without.within and not single.within
    assert engine.settings_of(quasistatic) == ("solve.preset=quasistatic", "bodies.rod.beam.elements=2")
    assert by_name["rigid"].error == 1.0


def test_the_front_falls_and_holds_every_cheapest(engine):
    errors = [entry.error for entry in engine.front]
    assert errors == sorted(errors, reverse=True) and engine.front[0] is engine.ranked[0]
    totals = [entry.cost.total for entry in engine.ranked]
    assert totals == sorted(totals)
    assert min(engine.ranked, key=lambda entry: entry.error) in engine.front


def test_the_spin_up_needs_the_geometric_stiffness():
    """Without it the beam goes unstable, and is left out with the reason."""
    scene = with_settings(read_scene("spin-up"), ["solve.preset=linear", "solve.integrator=newmark"])
    assert neutral_settings(scene.raw) == ("solve.integrator=none",)
    names = ("linear", "stiffened, 2 elements", "stiffened")
    found = trade(scene, 0.02, 60.0, ["tip_transverse"], candidates=tried(scene, *names))
    assert "unstable" in found.left_out["linear"]
    assert found.chosen is not None and found.chosen.name.startswith("stiffened")


def test_preset_coupled_is_refined_by_modes_with_the_elements_to_carry_them():
    """The crank of two elements has three fixed-interface modes and no more."""
    finer = _finer(neutral(read_scene("engine-elastic-crank")), COUPLED, 2)
    assert finer.name == "coupled, 7 modes a link, tolerance 1.3e-09"
    assert "bodies.crank.beam.elements=8" in finer.settings


def test_errors_are_taken_at_the_instants_of_both():
    """y_ref = 3 for 1 s; the model is 3, 4, 3: peak 1/3, mean square 1/2; what it does after that does not count.

    A reference that is 9 within 0.02 s around 0.75 s has a peak that no instant of the model meets.
    """
    scene = with_settings(read_scene("spin-up"), ["sensors.hub_torque=none"])
    names = list(scene.sensors)
    flat = Curves(np.array([0.0, 1.0]), {name: np.array([3.0, 3.0]) for name in names}, {})
    ours = {name: np.array([3.0, 4.0, 3.0, 7.0]) for name in names}
    curves = Curves(np.array([0.0, 0.5, 1.0, 1.5]), ours, {})
    found, *_ = differences(scene, names, "ours", curves, flat)
    assert found.error == pytest.approx(1 / 3) and found.rms_error == pytest.approx(0.5**0.5 / 3)
    pulse_times, pulse = np.array([0.0, 0.74, 0.75, 0.76, 1.0]), np.array([3.0, 3.0, 9.0, 3.0, 3.0])
    pulsed = Curves(pulse_times, {name: pulse for name in names}, {})
    missed, *_ = differences(scene, names, "ours", curves, pulsed)
    assert (missed.peak, missed.reference_peak) == (4.0, 9.0)
    assert missed.peak_difference == pytest.approx(9.0 - 3.5)
    own, *_ = differences(scene, names, "ours", curves, pulsed, between=False)
    assert own.peak_difference == 1.0
    nothing = Curves(flat.times, {name: np.array([0.0, 0.0]) for name in names}, {})
    assert differences(scene, names, "ours", curves, nothing) == ()


@pytest.fixture(scope="module")
def three_cylinders() -> tuple[Runs, Reference]:
    """Runs of a scene whose stored instants are not close enough, and the reference of 1 % for many models."""
    scene = with_settings(read_scene("engine-torque"), ["solve.duration=0.1 s", "solve.steps=1000"])
    runs = Runs(neutral(scene))
    return runs, find_reference(runs, list(scene.sensors), 0.01, KNOWN, named=False)


def lines_off(runs: Runs, found: Reference) -> dict[str, float]:
    """Deviation of straight lines between the instants of a reference as a share of each sensor's peak."""
    times, found_off = found.curves.times, dict[str, float]()
    between = values_of(runs.run(found.model).solution.at(0.5 * (times[1:] + times[:-1])).motion)
    for name in (*found.doubts, *found.open):
        own = found.curves.values[name]
        found_off[name] = abs(between[name] - 0.5 * (own[1:] + own[:-1])).max() / abs(own).max()
    return found_off


def test_lines_of_a_reference_of_many_models_are_as_close_as_they_must_be(three_cylinders):
    """They were refined beside at most 128 instants of each sensor: lines of the bearing were 0.61 % off."""
    runs, found = three_cylinders
    assert found.doubts and not found.open
    for name, off in lines_off(runs, found).items():
        assert off < min(0.005, 0.01 - found.doubts[name])


def test_lines_of_the_benchmarks_reference_are_close_also_where_its_least_tolerance_knows_no_sensor(three_cylinders):
    """They were those between stored instants, which showed an error of 1.4 % of a model 0.0003 % off."""
    runs, known = three_cylinders
    unknown = replace(known, doubts={}, open=known.doubts, curves=runs.run(known.model).curves)
    assert max(lines_off(runs, unknown).values()) > 0.01
    found = finest_of(runs, {0.01: known, 0.0001: unknown})
    assert max(lines_off(runs, found).values()) < 0.005 and found.open is known.doubts


def test_a_coupled_model_stores_as_few_instants_as_a_parabola_needs():
    """Lines through y = t^2 at distances h deviate by h^2/4; contacts are not compared between instants."""
    scene, times = read_scene("engine"), np.linspace(0.0, 1.0, 65)
    parabola = Curves(times, {"tip_axial": times**2}, {})
    for steps, needed in ((8, 4), (16, 4), (4, 4), (2, 4), (1, 4)):
        assert _stored(scene, parabola, steps, {"tip_axial": 1.01 * (1 / 4) ** 2 / 4}) == needed
    assert _stored(scene, parabola, 4, {"tip_axial": 1e-5}) == 4  # none is enough
    assert _stored(read_scene("bouncing-bar"), parabola, 4, {"tip_axial": 1.0}) == 4


def test_costs_are_medians_and_the_first_run_is_apart():
    first = Timing(once=7.0, set_up=1.0, solve=2.0, read=1.0, steps=100)
    repeats = [Timing(0.0, 1.0, solve, 1.0, 100) for solve in (2.0, 3.0, 10.0)]
    found = cost(first, repeats)
    assert (found.total, found.solve, found.ns_per_step) == (5.0, 3.0, 3e7)
    assert (found.first, found.repeats, found.spread) == (11.0, 3, 8.0 / 5.0)
    assert cost(first, repeats[:1]).spread is None


def test_the_ladder_names_each_model_once_and_leaves_out_terms_that_the_scene_has():
    scene = neutral(read_scene("engine"))
    names = [candidate.name for candidate in candidates_of(scene)]
    assert len(set(names)) == len(names) and {"coupled, tolerance 1e-06", "coupled, tolerance 1e-04"} < set(names)
    assert terms_of(scene, "dynamic") == ("spin", "gyroscopic", "euler", "geometric", "damping")
    assert terms_of(scene, "quasistatic") == ("spin", "euler", "geometric")
    assert {candidate.settings[0] for candidate in candidates_of(scene)} == {
        f"solve.preset={preset}" for preset in ("rigid", "quasistatic", "linear", "stiffened", "coupled")
    }


def test_a_structure_that_stands_still_has_no_rigid_model():
    names = {candidate.name for candidate in candidates_of(neutral(read_scene("free-frame")))}
    assert {"quasistatic", "stiffened"} < names and "rigid" not in names


def test_what_the_budget_has_no_time_for_is_named():
    scene = read_scene("engine")
    with pytest.raises(SceneError, match="no candidate was run"):
        trade(scene, 0.01, 1e-3, ["tip_axial"], candidates=tried(scene, "linear"))
    found = trade(scene, 0.01, 1e-3, ["tip_axial"])
    assert found.left_out["linear"] == "no time left within the budget"
    assert {(entry.name, entry.cost.repeats) for entry in found.ranked} == {("coupled", 1)}


def test_the_command_writes_its_folder_and_prints_the_choice(tmp_path):
    folder = tmp_path / "out"
    arguments = ("trade", "engine", "--sensors", "tip_axial", "--budget", "0.3s", "--tolerance", "2%", "-o", folder)
    result = cli(*arguments)
    assert result.exit_code == 0
    assert {path.name for path in folder.iterdir()} == {"trade.csv", "trade.json", "trade.png"}
    about = json.loads((folder / "trade.json").read_text())
    rows = list(csv.DictReader((folder / "trade.csv").open()))
    assert [row["model"] for row in rows] == [model["model"] for model in about["models"]]
    assert float(rows[0]["total_s"]) == about["models"][0]["cost"]["total"]
    assert about["tolerance"] == 0.02 and f"Cheapest within 2 %: {about['chosen']}\n" in result.stdout
    chosen = next(model for model in about["models"] if model["model"] == about["chosen"])
    assert f"  --set {' --set '.join(chosen['settings'])}\n" in result.stdout
    assert result.stderr.count(" left out: ") == len({*about["left_out"].values()})
    refused(cli(*arguments), "the folder exists")


@pytest.mark.parametrize(("arguments", "words"), [
    (("--tolerance", "0"), ("--tolerance", "between 0 and 100 %")),
    (("--tolerance", "100%"), ("--tolerance", "between 0 and 100 %")),
    (("--tolerance", "1 mm"), ("--tolerance = '1 mm'",)),
    (("--budget", "0s"), ("--budget", "positive time")),
    (("--sensors", "tip_axia"), ("--sensors = 'tip_axia'", "nearest known one is 'tip_axial'")),
    (("--set", "sensors=none"), ("no sensors to compare",)),
])  # fmt: skip
def test_what_is_refused_before_anything_runs(tmp_path, arguments, words):
    folder = tmp_path / "out"
    refused(cli("trade", "engine", "-o", folder, *arguments), *words)
    assert not folder.exists()


def test_rigid_bodies_differ_by_their_steps_alone():
    scene = with_settings(read_scene("double-pendulum"), ["solve.duration=1 s", "solve.steps=400"])
    found = trade(scene)
    names = {entry.name for entry in found.ranked}
    assert {"rigid", "coupled"} < names and {name.partition(",")[0] for name in names} == {"rigid", "coupled"}
    assert 0.0 < max(found.reference.doubts.values()) < 1e-4 and found.chosen.within


def test_a_short_run_is_repeated_for_its_time():
    trials = Trials.begun(read_scene("engine"), 0.01, ["tip_axial"], silent, math.inf)
    model = trials.richest()
    assert 0.0 < trials.seconds([model])[model] <= trials.runs.run(model).timing.total


def test_nothing_is_told_of_repeats_where_there_are_none():
    told = []
    assert Runs(read_scene("engine"), told.append).repeats([], math.inf) == {} and told == []


def test_solutions_of_earlier_runs_are_released_and_found_again(monkeypatch):
    monkeypatch.setattr("kaneflex.study.runs._SOLUTIONS", 1)
    runs = Runs(neutral(read_scene("engine")))
    first, second = (runs.run(model) for model in (COUPLED, STIFFENED))
    assert "solution" not in vars(first) and "solution" in vars(second)
    assert np.array_equal(first.solution["tip_axial"].values, first.curves.values["tip_axial"])


def test_rigid_bodies_that_drives_move_are_exact_and_never_run_as_coupled():
    told, scene = [], with_settings(read_scene("robot-arm"), ["solve.steps=200"])
    found = trade(scene, 1e-3, 60.0, ["torque_1", "torque_2"], told.append)
    assert found.reference.name == "rigid" and set(found.reference.doubts.values()) == {1e-9}
    assert not any("coupled" in stage for stage in told) and found.chosen.within
    own, coupled = (run(with_settings(scene, [f"solve.preset={each}"])).curves.values for each in ("rigid", "coupled"))
    for name in found.reference.sensors:
        assert own[name] == pytest.approx(coupled[name], abs=1e-9 * abs(coupled[name]).max())
