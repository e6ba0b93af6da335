"""`kaneflex trade`: the reference and its own error, what is chosen, what clearances change, files and refusals."""

import csv
import json

import numpy as np
import pytest
from command_line import cli, refused
from machines import slider_crank
from runs import solved

from kaneflex import SceneError, Trade, read_scene, scene_of, trade, with_settings
from kaneflex.solve.curves import Curves
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import differences
from kaneflex.study.runs import Timing, cost
from kaneflex.study.trade.candidates import candidates_of, neutral, neutral_settings, terms_of
from kaneflex.study.trade.price import has_price, price, tightened
from kaneflex.study.trade.reference import _coupled_levels

TRIED = (
    "rigid", "paper", "linear", "stiffened", "coupled", "quasistatic, 2 elements", "quasistatic, 1 element",
    "quasistatic without geometric",
)  # fmt: skip
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
    return trade(scene, 0.01, 60.0, counting, stages.append, tried(scene, *TRIED))


@pytest.fixture(scope="module")
def by_name(engine):
    return {entry.name: entry for entry in engine.ranked}


def test_the_reference_is_known_well_enough_and_coupling_is_not_needed(engine):
    """Two-way coupling changes the engine by 0.10 %, less than a quarter of 1 %; it counts as doubt."""
    found = engine.reference
    assert found.name == "stiffened, 8 elements, 2880 steps"
    assert repr(engine).startswith("Trade(engine: ") and len(repr(engine)) < 160
    assert max(found.refinement.values()) == pytest.approx(8e-5, abs=3e-5)
    assert max(found.coupling, key=found.coupling.get) == "crank_pin_force_x"
    assert found.coupling["crank_pin_force_x"] == pytest.approx(0.00103, abs=0.0001)
    assert found.coupling["mid_axial"] == pytest.approx(0.00094, abs=0.0001)  # its axial modes converge, too
    assert found.doubt("mid_axial") == found.refinement["mid_axial"] + found.coupling["mid_axial"]


def test_each_model_is_run_once_before_the_repeats(engine, stages):
    """That coupled one, too, which has shown the reference that coupling is not needed."""
    solved = [stage for stage in stages if stage.startswith("solving, ")]
    assert "solving, coupled" in solved and len(set(solved)) == len(solved) == len(engine.ranked)


def test_the_engine_is_answered_quasi_statically_with_the_geometric_stiffness(engine, by_name):
    """0.85 % off with two elements and K_g; 2.4 % without K_g, 20 % with one element."""
    quasistatic = by_name["quasistatic, 2 elements"]
    assert quasistatic.error == pytest.approx(0.0085, abs=0.0002) and engine.good_enough(quasistatic)
    # which of those that are good enough is cheaper by how little, a busy machine says otherwise every time
    assert engine.good_enough(engine.chosen) and engine.chosen.cost.total <= quasistatic.cost.total
    without, single = by_name["quasistatic without geometric"], by_name["quasistatic, 1 element"]
    assert (without.worst.sensor, without.error) == ("mid_global_y", pytest.approx(0.0236, abs=0.0005))
    assert (single.worst.sensor, single.error) == ("mid_transverse", pytest.approx(0.2036, abs=0.001))
    assert not engine.good_enough(without) and not engine.good_enough(single)
    assert engine.settings_of(quasistatic) == ("solve.preset=quasistatic", "bodies.rod.beam.elements=2")
    assert by_name["rigid"].error == 1.0


def test_the_paper_is_ranked_over_its_last_cycle_with_its_true_error(by_name):
    """It starts undeformed and never settles, without damping: accelerations are off by their whole size."""
    paper = by_name["paper"]
    assert paper.worst.sensor == "piston_acceleration" and paper.error == pytest.approx(1.0, abs=0.05)
    assert paper.cost.steps == 2880  # two cycles


def test_the_front_falls_and_holds_every_cheapest(engine):
    errors = [entry.error for entry in engine.front]
    assert errors == sorted(errors, reverse=True) and engine.front[0] is engine.ranked[0]
    totals = [entry.cost.total for entry in engine.ranked]
    assert totals == sorted(totals)
    assert min(engine.ranked, key=lambda entry: entry.error) in engine.front


def test_a_bearing_force_needs_the_rods_vibration():
    """Quasi-statically it is 1.1 % off: with it, only dynamics is within 1 %."""
    scene = read_scene("engine")
    found = trade(scene, 0.01, 60.0, [BEARING], candidates=tried(scene, "quasistatic", "stiffened"))
    quasistatic = next(entry for entry in found.ranked if entry.name == "quasistatic")
    assert quasistatic.error == pytest.approx(0.0111, abs=0.0002)
    assert found.chosen.name == "stiffened"


def test_the_spin_up_needs_the_geometric_stiffness():
    """Without it the beam goes unstable, and is left out with the reason."""
    scene = with_settings(read_scene("spin-up"), ["solve.preset=linear", "solve.integrator=newmark"])
    assert neutral_settings(scene) == ("solve.integrator=none",)
    names = ("linear", "stiffened, 2 elements", "stiffened")
    found = trade(scene, 0.02, 5.0, ["tip_transverse"], candidates=tried(scene, *names))
    assert "unstable" in found.left_out["linear"]
    assert found.chosen is not None and found.chosen.name.startswith("stiffened")


def test_preset_coupled_is_refined_by_modes_with_the_elements_to_carry_them():
    """The crank of two elements has three fixed-interface modes and no more."""
    levels = _coupled_levels(neutral(read_scene("engine-elastic-crank")))
    expected = ((5, "3.3e-09"), (15, "1.1e-09"))
    finer = [f"coupled, {n} modes a link, tolerance {t}" for n, t in expected]
    assert [level.name for level in levels] == ["coupled", *finer]
    elements = [[s.rpartition("=")[2] for s in each.settings if s.startswith("bodies.crank")] for each in levels]
    assert elements == [[], ["5"], ["15"]]


def test_errors_are_taken_at_the_instants_of_both_over_the_models_last_cycle():
    """y_ref = 3 on a cycle of 1 s; the model is 1, then in its last cycle 3, 4, 3: peak 1/3, mean square 1/3.

    A reference that is 9 within 0.02 s around 0.75 s has a peak that no instant of the model meets.
    """
    scene = with_settings(read_scene("spin-up"), ["sensors.hub_torque=none"])
    names = list(scene.sensors)
    flat = Curves(np.array([0.0, 1.0]), {name: np.array([3.0, 3.0]) for name in names}, {})
    ours = {name: np.array([1.0, 1.0, 3.0, 4.0, 3.0]) for name in names}
    curves = Curves(np.array([0.0, 0.5, 1.0, 1.5, 2.0]), ours, {})
    found, *_ = differences(scene, names, "ours", curves, flat, 1.0)
    assert found.peak_share == pytest.approx(1 / 3) and found.rms_share == pytest.approx(0.5**0.5 / 3)
    started, *_ = differences(scene, names, "ours", curves, flat, None)
    assert started.peak_difference == 2.0
    pulse_times, pulse = np.array([0.0, 0.74, 0.75, 0.76, 1.0]), np.array([3.0, 3.0, 9.0, 3.0, 3.0])
    pulsed = Curves(pulse_times, {name: pulse for name in names}, {})
    missed, *_ = differences(scene, names, "ours", curves, pulsed, 1.0)
    assert (missed.peak, missed.reference_peak) == (4.0, 9.0)
    assert missed.peak_difference == pytest.approx(9.0 - 3.5)
    own, *_ = differences(scene, names, "ours", curves, pulsed, 1.0, between=False)
    assert own.peak_difference == 1.0
    nothing = Curves(flat.times, {name: np.array([0.0, 0.0]) for name in names}, {})
    assert differences(scene, names, "ours", curves, nothing, 1.0) == ()


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
        f"solve.preset={preset}" for preset in ("rigid", "quasistatic", "linear", "stiffened", "paper", "coupled")
    }


def test_a_structure_that_stands_still_has_no_rigid_model():
    names = {candidate.name for candidate in candidates_of(neutral(read_scene("free-frame")))}
    assert {"quasistatic", "stiffened"} < names and "rigid" not in names


def test_what_the_budget_has_no_time_for_is_named():
    scene = read_scene("engine")
    with pytest.raises(SceneError, match="no candidate was run"):
        trade(scene, 0.01, 1e-9, ["tip_axial"])
    found = trade(scene, 0.01, 1e-3, ["tip_axial"], candidates=tried(scene, "stiffened", "linear"))
    assert found.left_out == {"linear": "no time left within the budget"} and found.ranked[0].cost.repeats == 1


def test_the_command_writes_its_folder_and_prints_the_choice(tmp_path):
    folder = tmp_path / "out"
    arguments = ("trade", "engine", "--sensors", "tip_axial", "--budget", "0.3s", "--tolerance", "2%", "-o", folder)
    result = cli(*arguments)
    assert result.exit_code == 0
    assert {path.name for path in folder.iterdir()} == {"trade.csv", "trade.json", "trade.png", "trade.svg"}
    about = json.loads((folder / "trade.json").read_text())
    rows = list(csv.DictReader((folder / "trade.csv").open()))
    assert [row["model"] for row in rows] == [model["model"] for model in about["models"]]
    assert float(rows[0]["total_s"]) == about["models"][0]["cost"]["total"]
    assert about["tolerance"] == 0.02 and f"Cheapest within 2 %: {about['chosen']}\n" in result.stdout
    chosen = next(model for model in about["models"] if model["model"] == about["chosen"])
    assert f"  --set {' --set '.join(chosen['settings'])}\n" in result.stdout
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


def test_a_scene_without_elastic_links_is_refused():
    with pytest.raises(SceneError, match="no body has a beam"):
        trade(read_scene("double-pendulum"))


SHORT = ("solve.duration=6 ms", "solve.steps=600", "rod.beam.elements=2")
TIGHT = slider_crank(
    'length = "50 mm", mass = "0.3 kg", inertia = "100 kg mm^2"',
    'length = "120 mm", beam = {material = "steel", section = {rectangle = ["6 mm", "12 mm"]}, elements = 2}',
    'mass = "0.14 kg"', 'speed = "3000 rpm"',
    sensors="""
slide = {position = "bore", component = "x"}
knock = {acceleration = "piston", axes = "global"}
crank_torque = {drive_torque = "main"}
rod_moment = {bending_moment = "rod.mid"}""",
    solve={"preset": "coupled", "duration": "6 ms", "steps": 600},
)
COUPLED = """
schema = 1
bodies.motor = {mass = "4 kg", inertia = "0.01 kg m^2"}
bodies.mill = {mass = "9 kg", inertia = "0.05 kg m^2"}
joints.shaft = {revolute = ["ground", "motor"]}
joints.bearing = {revolute = ["ground", "mill"]}
joints.coupling.revolute = ["motor", "mill"]
joints.coupling.clearance = {angle = "0.25 deg", middle = "20 deg", contact = {stiffness = 2e6, restitution = 0.6}}
drives.shaft = {free = true, initial_speed = "10 rad/s"}
drives.bearing = {free = true, initial_speed = "10 rad/s", angle = "20 deg"}
loads.ripple = {torque_at = "shaft", law = "6 * sin(40 * t)"}
sensors.speed = {velocity = "mill", component = "angle"}
sensors.play = {position = "coupling", component = "angle"}
solve = {preset = "coupled", duration = "0.1 s", steps = 200}
"""


@pytest.fixture(scope="module")
def priced():
    return price(with_settings(read_scene("slider-crank-clearance"), SHORT))


def test_what_is_compared_with_is_the_tight_mechanism(priced):
    """Written by hand: its statistics are those without the clearance."""
    solution = solved(scene_of(TIGHT))
    (found,) = priced.prices
    assert (found.part, set(found.gone)) == ("clearance of wrist", {"pin_force", "pin_x", "pin_y"})
    assert {change.sensor for change in found.changes} == set(solution.model.scene.sensors)
    for change in found.changes:
        values = solution.series[change.sensor].values
        mean = ((values[1:] ** 2 + values[:-1] ** 2) / 2).mean()
        assert change.peak[1] == pytest.approx(abs(values).max(), rel=1e-5), change.sensor
        assert change.rms[1] == pytest.approx(np.sqrt(mean), rel=1e-5), change.sensor


def test_what_is_compared_is_the_scene_as_it_is(priced):
    solution = solved(priced.scene)
    for change in priced.prices[0].changes:
        assert change.peak[0] == abs(solution.series[change.sensor].values).max()


def test_a_knock_matters_and_the_way_of_the_piston_does_not(priced):
    changes = {change.sensor: change for change in priced.prices[0].changes}
    assert changes["knock"].shares[0] > 1 and changes["knock"].matters(0.01)
    assert abs(changes["slide"].shares[0]) < 2e-3 and not changes["slide"].matters(0.01)
    assert changes["slide"].matters(1e-6)
    assert all(np.isfinite(change.doubt).all() for change in changes.values())


def test_a_smaller_clearance_changes_less():
    scene = with_settings(read_scene("slider-crank-clearance"), [*SHORT, "joints.wrist.clearance.radial=2 um"])
    (found,) = price(scene, sensors=["slide"]).prices
    assert abs(found.changes[0].shares[0]) < 2e-5


def test_backlash_is_compared_with_a_shaft_in_one_piece():
    """Without play both turn as one: w' = torque/(sum of inertias)."""
    scene = scene_of(COUPLED)
    settings, gone = tightened(scene, ["coupling"])
    assert gone == ("play",)
    solution = solved(scene, *settings)
    expected = 10 + 6 / 0.06 / 40 * (1 - np.cos(40 * solution.times))
    assert solution.series["speed"].values == pytest.approx(expected, rel=1e-7)
    (found,) = price(scene).prices
    assert found.changes[0].peak[1] == pytest.approx(expected.max(), rel=1e-7)
    assert found.changes[0].shares[0] != 0


def test_a_guide_made_tight_closes_as_it_stands():
    settings, gone = tightened(read_scene("engine-rig-clearance"), ["bore"])
    tight = with_settings(read_scene("engine-rig-clearance"), settings)
    assert list(tight.drives) == ["main"] and not tight.contacts and "piston_tilt" in gone


def test_the_command_writes_its_folder(tmp_path):
    folder = tmp_path / "out"
    arguments = [part for setting in SHORT for part in ("--set", setting)]
    result = cli("trade", "slider-crank-clearance", *arguments, "--sensors", "slide", "-o", folder)
    assert result.exit_code == 0, result.output
    assert {path.name for path in folder.iterdir()} == {"price.csv", "price.json", "price.png", "price.svg"}
    about = json.loads((folder / "price.json").read_text())
    (row,) = csv.DictReader((folder / "price.csv").open())
    (part,) = about["parts"]
    assert (row["part"], row["sensor"]) == ("clearance of wrist", "slide")
    assert float(row["rms_with"]) == part["sensors"][0]["rms_with"]
    assert "motions with impacts diverge" in result.stdout
    assert "drives.bore=none" in part["without"]
    (shown,) = (line.split() for line in result.stdout.splitlines() if line.split()[:2] == ["slide", "mm"])
    found, keys = part["sensors"][0], ("peak_without", "peak_with", "rms_without", "rms_with")
    assert [shown[k] for k in (2, 3, 8, 9)] == [f"{1e3 * found[key]:.4g}" for key in keys]
    shares = found["rms_change"], found["rms_doubt"] / found["rms_without"]
    assert [shown[k] for k in (10, 12)] == [f"{100 * share:.2g}" for share in shares]


def test_friction_is_compared_with_none():
    """Without friction the block on its belt hangs on its spring, at rest where it began."""
    scene = with_settings(read_scene("stick-slip"), ["solve.duration=1 s", "solve.steps=200"])
    (found,) = price(scene).prices
    assert (found.part, found.gone) == ("friction of rub", ("drag",))
    assert found.settings == ("joints.rub.friction=none", "sensors.drag=none")
    without = solved(scene, *found.settings)
    for change in found.changes:
        assert change.peak[1] == abs(without.series[change.sensor].values).max()
        assert change.peak[0] > 0 and change.matters(0.01)


def test_what_can_t_be_priced_is_refused(tmp_path):
    assert not has_price(read_scene("engine")) and has_price(read_scene("slider-crank-clearance"))
    result = cli("trade", "slider-crank-clearance", "--sensors", "slid", "-o", tmp_path / "out")
    refused(result, "no such sensor", "slide")
    scene = with_settings(read_scene("slider-crank-clearance"), [*SHORT, "solve.duration=1 ms", "solve.steps=10"])
    with pytest.raises(SceneError, match="no requested sensor exists without the "):
        price(scene, sensors=["pin_force"])
