"""`kaneflex run --tolerance`: what is chosen and on what evidence, the user's cache, and the scene's file."""

import ast
import functools
import json
import re
import stat
import tomllib
from pathlib import Path
from types import SimpleNamespace

import closed_forms as by_hand
import csv_tables
import numpy as np
import pytest
from command_line import cli, refused
from extreme_cases import press
from machines import machine
from runs import solved, tables

from kaneflex import SceneError, read_scene, scene_of, with_settings
from kaneflex.cli.scene import chosen_lines
from kaneflex.generated import engine as generated_engine
from kaneflex.multibody.model.module_loading import generate_text, import_file, operation_count, pruned_text
from kaneflex.report.summary import Summary
from kaneflex.scene.write_back import file_to_write, write_settings
from kaneflex.study.differences import Difference
from kaneflex.study.trade import choice as choice_cache
from kaneflex.study.trade import reference
from kaneflex.study.trade.candidates import COUPLED, STIFFENED, families, neutral
from kaneflex.study.trade.choice import choice_file, choose, remembered_choice
from kaneflex.study.trade.trials import Trial, Trials

DEFORMED = ("mid_transverse", "tip_axial", "mid_global_y", "rod_mid_strain")
"""Sensors of the engine that show the rod's deformation alone."""


def series(scene, settings, names):
    """The sensors of a scene by some settings, at its own instants, without anything of the trade."""
    solution = solved(scene, *settings)
    return solution.times, {name: solution.series[name].values for name in names}


def error(scene, choice, finer):
    """Largest error of a choice against settings that are finer, as a share of each sensor's peak."""
    names = list(choice.errors)
    (times, ours), (fine, theirs) = (series(scene, s, names) for s in (choice.settings, finer))
    gaps = {n: abs(np.interp(fine, times, ours[n]) - theirs[n]).max() / abs(theirs[n]).max() for n in names}
    return max(gaps.values())


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """An empty cache of choices."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choice_cache, "cache_folder", lambda: folder)
        yield folder


RANKS = {"rigid": 0.1, "quasistatic": 1.0, "linear": 2.0, "stiffened": 3.0, "coupled": 100.0}
"""Times that do not depend on the machine: the presets in this order."""


@pytest.fixture(scope="module", autouse=True)
def _ranked():
    def seconds(_, models):
        return {model: RANKS[model.settings[0].rpartition("=")[2]] for model in models}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choice_cache.Trials, "seconds", seconds)
        yield


@pytest.fixture(scope="module")
def engine():
    scene = read_scene("engine")
    return scene, choose(scene, 0.015, DEFORMED, purpose="code")


def test_the_engines_rod_is_answered_quasi_statically_with_two_elements_and_the_geometric_stiffness(engine):
    scene, found = engine
    assert found.model.startswith("quasistatic, 2 elements, 360 steps")
    assert found.dropped == ["euler", "spin"]
    finer = ["solve.preset=stiffened", "rod.elements=8", "solve.steps=4320"]
    assert error(scene, found, finer) == pytest.approx(max(found.errors.values()), abs=0.0005)
    assert max(found.errors.values()) + max(found.doubt.values()) <= 0.015


def test_the_evidence_says_what_was_tried_and_why_the_rest_was_not_enough(engine):
    _, found = engine
    by_name = {attempt.model: attempt for attempt in found.attempts}
    single = by_name["quasistatic, 1 element, 360 steps"]
    assert (single.worst_sensor, single.within) == ("mid_transverse", False)
    assert single.error == pytest.approx(0.204, abs=0.001)
    without = by_name["quasistatic, 2 elements, 360 steps without euler, spin, geometric"]
    assert without.error == pytest.approx(0.0239, abs=0.0005) and not without.within
    assert by_name[found.model].within and by_name[found.model].error == max(found.errors.values())
    assert found.reference == "coupled" and found.open == {}


def test_terms_are_dropped_for_code_only(engine):
    scene, _ = engine
    found = choose(scene, 0.015, DEFORMED)
    assert found.model == "quasistatic, 2 elements, 360 steps" and found.dropped == []


def test_a_repeated_command_compares_cheaper_models_with_the_reference_of_the_first(engine, cache, monkeypatch):
    """The first one runs the richest model alone; the second runs no coupled model; later ones know its choice."""
    scene, _ = engine
    first, solution = remembered_choice(scene, 0.015, DEFORMED, purpose="run")
    assert first.model == solution.model.options.preset == "coupled" and not first.compared
    assert [attempt.model for attempt in first.attempts] == ["coupled"]
    assert "the next command tries cheaper ones. Models tried: 1" in chosen_lines(first)
    kept = list(cache.rglob("*.npy"))
    assert len(kept) == 1
    monkeypatch.delattr(choice_cache, "chosen")
    monkeypatch.setattr(choice_cache, "_LONGEST", 100.0)
    slow = first.model_copy(update={"richest_s": 50.0})  # the time does not depend on the machine
    choice_file(scene, 0.015, DEFORMED, "run").write_text(slow.model_dump_json())
    second, solution = remembered_choice(scene, 0.015, DEFORMED, purpose="run")
    assert second.model.startswith("quasistatic") and second.compared and not second.remembered
    assert solution.model.options.preset == "quasistatic" and not kept[0].exists()
    assert error(scene, second, second.reference_settings) == pytest.approx(max(second.errors.values()), abs=0.0005)
    assert (second.doubt, second.reference) == (first.doubt, first.reference)
    assert "A run takes 0" in chosen_lines(second) and "coupled" in {each.model for each in second.attempts}
    third, solution = remembered_choice(scene, 0.015, DEFORMED, purpose="run")
    assert third == second.model_copy(update={"remembered": True}) and solution is None


def test_a_repeated_command_stores_densely_what_the_richest_model_did_not(cache, monkeypatch):
    """The engine by 24 steps a cycle: with 96 all sensors are within."""
    scene = with_settings(read_scene("engine"), ["solve.steps=24"])
    first, _ = remembered_choice(scene, 0.05, purpose="run")
    assert "rod_force_piston" in first.open and not first.errors.keys() & first.open.keys()
    monkeypatch.setattr(choice_cache, "_LONGEST", 100.0)
    slow = first.model_copy(update={"richest_s": 50.0})
    choice_file(scene, 0.05, scene.sensors, "run").write_text(slow.model_dump_json())
    second, solution = remembered_choice(scene, 0.05, purpose="run")
    assert second.model.endswith(", 96 steps") and len(solution.times) == 97
    assert second.open == {} and set(second.errors) == set(second.sensors) == {*first.errors, *first.open}


def test_errors_of_several_points_are_the_largest_of_sensors_that_are_within_in_all():
    def found(errors, doubts, unknown):
        gaps = tuple(Difference(name, "", "m", 1.0, 1.0, error, error) for name, error in errors.items())
        about = {"name": "coupled", "note": "", "model": COUPLED, "sensors": tuple(errors)}
        reference = SimpleNamespace(doubts=doubts, open=unknown, **about)
        runs = SimpleNamespace(run=lambda model: SimpleNamespace(timing=SimpleNamespace(total=1.0)))
        return Trials(runs, 0.5, reference, known=2.0, tried={COUPLED: Trial(COUPLED, gaps, True)})

    trials = [found({"a": 0.1, "b": 0.2}, {"a": 0.0, "b": 0.3}, {}), found({"a": 0.05}, {"a": 0.01}, {"b": 0.4})]
    largest = choice_cache._choice(read_scene("engine"), trials, COUPLED, False)
    assert (largest.errors, largest.doubt, largest.sensors) == ({"a": 0.1}, {"a": 0.01}, ["a"])
    assert largest.open == {"b": 0.4}


@pytest.mark.parametrize("damage", [lambda file: file.unlink(), lambda file: file.write_bytes(b"\x93NUMPY")])
def test_without_the_reference_or_time_the_richest_model_stays_the_answer(engine, cache, monkeypatch, damage):
    scene, _ = engine
    first, _ = remembered_choice(scene, 0.016, DEFORMED, purpose="run")
    monkeypatch.setattr(choice_cache, "_LONGEST", 0.0)
    path = choice_file(scene, 0.016, DEFORMED, "run")
    kept = path.with_suffix(".npy").read_bytes()
    damage(path.with_suffix(".npy"))
    again, solution = remembered_choice(scene, 0.016, DEFORMED, purpose="run")
    assert again == first.model_copy(update={"remembered": True}) and solution is None
    path.with_suffix(".npy").write_bytes(kept)
    again, solution = remembered_choice(scene, 0.016, DEFORMED, purpose="run")
    assert again == first.model_copy(update={"remembered": True, "compared": True}) and solution is None
    assert "Nothing to trade: the richest model takes " in chosen_lines(again)
    path.unlink()


@pytest.mark.exhaustive(group="choice", share=3)
def test_all_sensors_of_the_engine_need_its_dynamics():
    """The main bearing's force misses 1.1 % quasi-statically."""
    found = choose(read_scene("engine"), purpose="code")
    assert found.model.startswith("stiffened, 2 modes, 360 steps") and "geometric" not in found.dropped
    failed = next(a for a in found.attempts if a.model == "quasistatic")
    assert failed.worst_sensor == "main_bearing_force_x" and failed.error == pytest.approx(0.0115, abs=0.0005)


@pytest.mark.exhaustive(group="choice", share=3)
def test_at_six_times_the_speed_the_rod_acts_back_on_the_engine():
    """One-way deformation is 8 % off, so that no simpler one is tried."""
    scene = with_settings(read_scene("engine"), ["main.speed=36000 rpm"])
    found = choose(scene, 0.01, ["mid_transverse"])
    assert found.settings[0] == "solve.preset=coupled" and found.dropped == []
    assert not any(attempt.model.startswith("quasistatic") for attempt in found.attempts)
    one_way = next(attempt for attempt in found.attempts if attempt.model == "stiffened")
    assert one_way.error > 0.05 and not one_way.within


@pytest.mark.parametrize(("near", "expected"), [(True, 1), (False, 0)])
def test_where_the_plain_coupled_model_is_nearly_within_cheaper_ones_are_tried(near, expected):
    """At 10 % the elastic pendulum has 10.7 % with three modes, and 9.9 % with two in a thirtieth of the time."""
    scene = neutral(read_scene("elastic-pendulum"))
    coupled = families(scene)[-1]
    tried = {model: Trial(model, within=model == coupled.cheaper[1]) for model in coupled.cheaper}
    tried |= {STIFFENED: Trial(STIFFENED), COUPLED: Trial(COUPLED, near=near)}
    tried |= {model: Trial(model) for family in families(scene)[:-1] for model in (family.plain, *family.cheaper)}
    trials = Trials(SimpleNamespace(scene=scene), 0.1, SimpleNamespace(stored=0), tried=tried)
    assert trials.cheapest_models() == [coupled.cheaper[1]][:expected]


@pytest.mark.exhaustive(group="choice", share=3)
def test_where_coupled_cannot_be_run_the_reference_is_stiffened_and_says_so():
    """Shaken at its resonance the cross is 98 % off quasi-statically; coupled can't place bars on pins by poses."""
    scene = with_settings(read_scene("pin-ended-cross"), ["solve.duration=0.5 s", "solve.steps=1000"])
    found = choose(scene)
    assert found.reference_note.startswith("preset coupled can't be run")
    assert f"\n  Not verified: {found.reference_note}" in chosen_lines(found)
    assert any(a.model == "coupled" and "only if all joints are welds" in a.reason for a in found.attempts)
    assert found.model.startswith(("linear, 2 modes", "stiffened, 2 modes"))


def test_a_looser_tolerance_takes_less_and_is_kept(engine):
    """At 10 % the rod does without K_g, but not with one element."""
    scene, tight = engine
    loose = choose(scene, 0.1, DEFORMED, purpose="code")
    assert loose.model.startswith("quasistatic, 2 elements, 360 steps")
    assert loose.dropped == ["euler", "spin", "geometric"]
    assert max(tight.errors.values()) < 0.015 < error(scene, loose, loose.reference_settings) < 0.1


def test_where_the_reference_does_not_converge_nothing_is_chosen():
    """The slider-crank's rod rings in tension, undamped: its peaks depend on the steps."""
    scene = with_settings(read_scene("slider-crank-150"), ["solve.steps=360"])
    with pytest.raises(SceneError, match=r"the error estimate of rod_force is .*\. (Use .* increase|Increase)"):
        choose(scene, 1e-4, ["mid_transverse", "rod_force"])


@pytest.mark.exhaustive(group="fine", share=2)
@pytest.mark.parametrize(("name", "sensors", "modes"), [
    ("slider-crank-150", ["mid_transverse"], 7), ("engine", ["tip_axial", "mid_global_x"], 15),
])  # fmt: skip
def test_a_hundredth_of_a_per_cent_is_answered_by_as_many_modes_as_it_takes(name, sensors, modes):
    """Against a model with twice as many and elements half as long."""
    short = ["solve.duration=10 ms", "solve.steps=750"]
    scene = with_settings(read_scene(name), ["main.speed=36000 rpm"] if name == "engine" else short)
    found = choose(scene, 1e-4, sensors, purpose="run")
    assert f"solve.modes={modes}" in found.settings and max(found.errors.values()) + max(found.doubt.values()) <= 1e-4
    finer = [f"solve.modes={2 * modes}", "solve.tolerance=1e-11", *(s for s in found.settings if "preset" in s)]
    finer += [f"rod.elements={4 * modes}", f"solve.steps={2 * solved(scene, *found.settings).model.options.steps}"]
    assert error(scene, found, finer) < 1e-4


def test_sensors_that_no_model_stores_densely_enough_are_not_said_to_be_within(monkeypatch):
    """The engine by 24 steps a cycle: its forces are not straight lines between them; if named they get more."""
    monkeypatch.setattr(choice_cache.Trials, "cheapest_models", lambda self: [])
    scene = with_settings(read_scene("engine"), ["solve.steps=24"])
    found = choose(scene, 0.05, purpose="run")
    assert "rod_force_piston" in found.open and not found.errors.keys() & found.open.keys()
    assert max(found.errors.values()) <= 0.05 < min(found.open.values())
    assert "\n  Not within 5 %: " in chosen_lines(found)
    named = choose(scene, 0.05, ["rod_force_piston"], purpose="run")
    assert named.model.endswith("1.3e-09, 192 steps") and named.open == {}
    assert error(scene, named, ["solve.preset=coupled", "solve.steps=1440"]) < 0.05
    monkeypatch.setattr(reference, "_DENSEST", 1)
    with pytest.raises(SceneError, match="between its stored instants the finest model changes rod_force_piston by"):
        choose(scene, 0.05, ["rod_force_piston"], purpose="run")
    assert "rod_force_piston" in choose(scene, 0.05).open


@pytest.mark.exhaustive(group="choice", share=3)
def test_a_model_that_steps_over_the_force_of_a_press_is_not_chosen(tmp_path):
    """50 kN for 1.9 degrees between two steps of 180: where the rod is at 103 degrees it carries F / cos(phi_2)."""
    scene = with_settings(read_scene("engine"), press(tmp_path))
    found = choose(scene, 0.1, ["rod_force_piston"])
    peak = max(abs(series(scene, found.settings, found.errors)[1]["rod_force_piston"]))
    assert peak == pytest.approx(5e4 / np.sqrt(1 - (40 / 137 * np.sin(np.radians(103))) ** 2), rel=0.01)
    coarse = next(attempt for attempt in found.attempts if attempt.model == "quasistatic")
    assert coarse.error == pytest.approx(0.124, abs=0.01) and not coarse.within  # between its instants
    assert found.model == "quasistatic, 1440 steps"


def test_a_force_that_the_finest_model_steps_over_leaves_nothing_to_choose_by(tmp_path):
    scene = with_settings(read_scene("engine"), [*press(tmp_path), "solve.steps=45"])
    with pytest.raises(SceneError, match=r"in the finest model \(coupled, .*\) loads.gas is not resolved"):
        choose(scene, 0.1, ["rod_force_piston"])


@pytest.mark.exhaustive(group="choice", share=3)
def test_a_run_from_rest_stays_one_from_rest():
    """The piston's acceleration from rest is about twice that of the periodic state."""
    scene = with_settings(read_scene("engine"), ["solve.start=zero", "solve.duration=0.01 s", "solve.steps=720"])
    found = choose(scene, 0.1, ["piston_acceleration"])
    assert not any(setting.startswith("solve.start") for setting in (*found.settings, *found.reference_settings))
    (_, chosen), (_, own) = (series(scene, settings, found.errors) for settings in (found.settings, ()))
    peak, expected = (abs(values["piston_acceleration"]).max() for values in (chosen, own))
    assert peak == pytest.approx(expected, rel=0.1)


def test_a_choice_is_remembered_until_anything_changes(engine, cache, monkeypatch):
    scene, found = engine
    monkeypatch.setattr(choice_cache, "chosen", lambda *arguments: (found, None, None))
    assert not remembered_choice(scene, 0.01, DEFORMED)[0].remembered
    monkeypatch.delattr(choice_cache, "chosen")
    again, solution = remembered_choice(scene, 0.01, DEFORMED)
    assert solution is None
    assert again.remembered and again.model_copy(update={"remembered": False}) == found
    faster = with_settings(scene, ["main.speed=6001 rpm"])
    others = [(faster, 0.01, DEFORMED), (scene, 0.02, DEFORMED), (scene, 0.01, DEFORMED[1:])]
    files = {choice_file(*each, "model") for each in [(scene, 0.01, DEFORMED), *others]}
    known = choice_file(scene, 0.01, DEFORMED, "model")
    assert len(files) == 4 and {file for file in files if file.exists()} == {known}


def test_a_changed_table_is_another_scene(tmp_path):
    assert cli("new", "my", "--like", "engine", "-o", tmp_path / "my.toml").exit_code == 0
    scene = read_scene(tmp_path / "my.toml")
    before = choice_file(scene, 0.01, DEFORMED, "model")
    table = tmp_path / "gas.csv"
    table.write_text(table.read_text().replace("1", "2", 1))
    assert choice_file(scene, 0.01, DEFORMED, "model") != before


@pytest.mark.parametrize("content", [b"{", b"{}", b"\xff"])
def test_a_broken_file_of_the_cache_is_replaced(engine, cache, monkeypatch, content):
    scene, found = engine
    path = choice_file(scene, 0.01, DEFORMED, "model")
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    monkeypatch.setattr(choice_cache, "chosen", lambda *arguments: (found, None, None))
    assert not remembered_choice(scene, 0.01, DEFORMED)[0].remembered
    assert remembered_choice(scene, 0.01, DEFORMED)[0].remembered


def test_run_writes_the_choice_into_the_summary_and_the_scenes_file(engine, cache, tmp_path, monkeypatch):
    _, found = engine
    assert cli("new", "my", "--like", "engine", "-o", tmp_path / "my.toml").exit_code == 0
    path = tmp_path / "my.toml"
    text = path.read_text()
    monkeypatch.setattr(choice_cache, "chosen", lambda *arguments: (found, None, None))
    sensors = [word for name in DEFORMED for word in ("--sensors", name)]
    result = cli("run", path, "--tolerance", "1%", *sensors, "--write-back", "--no-plots", "-o", tmp_path / "out")
    assert result.exit_code == 0
    assert f"Chosen within 1.5 %: {found.model}, found in" in result.stdout
    summary = Summary.model_validate_json((tmp_path / "out" / "summary.json").read_text())
    assert summary.choice == found and summary.settings == found.settings
    assert (summary.preset, summary.elements, summary.steps) == ("quasistatic", {"rod": 2}, 360)
    new = path.read_text()
    assert tomllib.loads(new)["solve"] == {
        "preset": "quasistatic", "start": "periodic", "steps": 360, "terms": {"spin": False, "euler": False},
    }  # fmt: skip
    changed = set(new.splitlines()) - set(text.splitlines())
    assert len(changed) == 4 and "# Forces: tension positive; a joint's force on the second of its bodies." in new
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["choice"]["remembered"] is False


@pytest.mark.parametrize(("text", "expected"), [
    ('like = "engine"\n', '\n[solve]\npreset = "quasistatic"\nsteps = 360\n'),
    ('like = "engine"\n[bodies.rod.beam]\nelements = 6  # fine\n', "elements = 2  # fine\n"),
    ('like = "engine"\n[bodies.rod.beam]\n[solve]\nsteps = 5 # few\n', 'steps = 360 # few\npreset = "quasi'),
    ('like = "engine"\n[bodies]\nrod = {mass = "1 kg"}\n', 'rod = {mass = "1 kg", beam = {elements = 2}}'),
    ('like = "engine"\n[bodies.rod]\nbeam = {elements = 3} # "so"\n', 'beam = {elements = 2} # "so"'),
    ('like = "engine"\n[solve]\nintegrator = "newmark"\n\n[damping]\n', "steps = 360\n\n[damping]\n"),
])  # fmt: skip
def test_a_file_is_changed_where_it_says_so_and_gives_the_scene(tmp_path, text, expected):
    path = tmp_path / "mine.toml"
    path.write_text(f'schema = 1\n{text}')
    settings = ["solve.preset=quasistatic", "rod.elements=2", "solve.steps=360"]
    if "newmark" in text:
        settings.insert(0, "solve.integrator=none")
    wanted = with_settings(read_scene(path), settings)
    write_settings(path, settings)
    assert expected in path.read_text()
    assert read_scene(path).model_dump() == wanted.model_dump()
    assert [file.name for file in tmp_path.iterdir()] == ["mine.toml"]


def test_what_the_base_chose_is_taken_away_by_name(tmp_path):
    (tmp_path / "base.toml").write_text('schema = 1\nlike = "engine"\n[solve]\nmodes = 4\n')
    path = tmp_path / "mine.toml"
    path.write_text('schema = 1\nlike = "base.toml"\n')
    write_settings(path, ["solve.modes=none", "solve.steps=360"])
    assert tomllib.loads(path.read_text())["solve"] == {"steps": 360, "modes": "none"}
    assert read_scene(path).solve.modes == "all"


def test_an_inline_table_is_changed_where_it_stands(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('schema = 1\nlike = "engine"\nsolve = {steps = 100}  # few\n')
    write_settings(path, ["solve.steps=360"])
    assert path.read_text() == 'schema = 1\nlike = "engine"\nsolve = {steps = 360}  # few\n'


def test_a_text_that_would_not_give_the_scene_is_not_written(tmp_path, monkeypatch):
    path = tmp_path / "mine.toml"
    text = 'schema = 1\nlike = "engine"\n'
    path.write_text(text)
    monkeypatch.setattr("kaneflex.scene.write_back._with_solve", lambda text, old, new: text)
    with pytest.raises(SceneError, match=r"solve.steps=360.*Write these settings into it yourself"):
        write_settings(path, ["solve.steps=360"])
    assert path.read_text() == text and [file.name for file in tmp_path.iterdir()] == ["mine.toml"]


def test_write_back_keeps_line_ends_mode_and_links(tmp_path):
    file, link = tmp_path / "real" / "mine.toml", tmp_path / "link.toml"
    file.parent.mkdir()
    file.write_bytes(b'schema = 1\r\nlike = "engine"\r\n[solve]  # mine\r\nsteps = 90\r\n')
    file.chmod(0o640)
    link.symlink_to(file)
    write_settings(link, ["solve.steps=360"])
    assert link.is_symlink() and stat.S_IMODE(file.stat().st_mode) == 0o640
    assert file.read_bytes() == b'schema = 1\r\nlike = "engine"\r\n[solve]  # mine\r\nsteps = 360\r\n'


@pytest.mark.parametrize(("arguments", "words"), [
    (("--tolerance", "1%", "--preset", "linear"), ("--preset = 'linear'", "--tolerance chooses the model")),
    (("--tolerance", "1%", "--integrator", "gauss"), ("--integrator = 'gauss'",)),
    (("--tolerance", "1%", "--after", "x"), ("--after = 'x'",)),
    (("--tolerance", "200%"), ("between 0 and 100 %",)),
    (("--tolerance", "1%", "--sensors", "tip_axia"), ("nearest known one is 'tip_axial'",)),
    (("--tolerance", "1%", "--write-back"), ("a shipped scene is not changed", "kaneflex new")),
    (("--sensors", "tip_axial"), ("--sensors: requires --tolerance",)),
    (("--write-back",), ("--write-back: requires --tolerance",)),
])  # fmt: skip
def test_what_is_refused_before_anything_runs(tmp_path, cache, arguments, words):
    refused(cli("run", "engine", "-o", tmp_path / "out", *arguments), *words)
    assert list(tmp_path.iterdir()) == []


def test_a_choice_for_a_changed_scene_is_not_written_back():
    with pytest.raises(SceneError, match="for the changed scene"):
        file_to_write("mine.toml", ["main.speed=1 rpm"])


def sensed_by(text, scene, tmp_path, monkeypatch):
    """The sensors of a scene by a module's text in place of the one that its structure has."""
    path = tmp_path / "module.py"
    path.write_text(text)
    structure = re.search(r'^STRUCTURE = "(\w+)"', text, flags=re.MULTILINE)[1]
    module = import_file(path, structure)
    monkeypatch.setattr("kaneflex.solve.loading.find_module", lambda scene, progress: (module, 0.0))
    solution = solved(scene)
    assert solution.model.module.STRUCTURE == structure
    return {name: found.values for name, found in solution.series.items()}


WHOLE = Path(generated_engine.__file__).read_text(encoding="utf-8")
"""The engine's module with every term, which a test of generated modules derives."""


@functools.cache
def pruned(*settings):
    """The text of the engine's module without what settings leave out."""
    return pruned_text(with_settings(read_scene("engine"), settings))


def offered(text):
    """What a module defines or imports, and its terms."""
    tree = ast.parse(text)
    names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    names |= {alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    return names | {name for name, *_ in tables(tree)["TERMS"]}


PRUNED = {
    "dynamics": (("solve.terms.spin=false", "solve.terms.gyroscopic=false"), {"spin", "gyroscopic", "C"}),
    "quasi-statics": (("solve.preset=quasistatic", "solve.terms.geometric=false"), {"K_g", "tension_origin"}),
    "quasi-statics without spin": (("solve.preset=quasistatic", "solve.terms.spin=false"), {"gyroscopic", "C"}),
}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("case", PRUNED)
def test_a_pruned_module_gives_the_same_without_the_dropped_terms(tmp_path, monkeypatch, case):
    settings, gone = PRUNED[case]
    scene = with_settings(read_scene("engine"), ["solve.steps=120", "rod.elements=1", *settings])
    _, expected = series(scene, [], scene.sensors)
    text = pruned(*settings)
    assert gone <= offered(WHOLE) - offered(text)
    assert operation_count(text) < operation_count(WHOLE)
    found = sensed_by(text, scene, tmp_path, monkeypatch)
    for name, values in expected.items():
        assert found[name] == pytest.approx(values, rel=1e-9, abs=1e-9 * abs(values).max()), name


BLADE = machine(
    bodies=dict(blade='length = 1, points = {third = [0.25, 0]}, beam = {material = "aluminium", A = 1e-4, I = 1e-9}'),
    joints=dict(hub="revolute ground blade.start"), drives=dict(hub='speed = "10 rad/s", cycle = "360 deg"'),
    masses=dict(rider='at = "blade.mid", mass = 0.1'),
    loads=dict(push='force_on = "blade.third", direction = [1, 0], value = "20 N", axes = "body"',
               wind='spread_on = "blade", direction = [0.6, 0.8], law = "3 * sin(hub)", profile = [1, 2]'),
    springs=dict(tie='between = ["ground", "blade.third"], stiffness = "1 kN/m", length = 0.2'),
    sensors=dict(bend="displacement blade.end y", pull="axial_force blade.mid"),
    solve=dict(steps=400, terms=dict(geometric=False)),
)


def test_a_pruned_module_serves_what_acts_between_the_ends_of_a_link(tmp_path, monkeypatch):
    """Masses, forces, springs and spread loads there change the axial force, of which no term is left."""
    scene = scene_of(BLADE)
    _, expected = series(scene, [], scene.sensors)
    found = sensed_by(pruned_text(scene), scene, tmp_path, monkeypatch)
    for name, values in expected.items():
        assert np.array_equal(found[name], values), name


def test_a_kernel_of_which_a_part_is_dropped_is_the_modules_own(tmp_path):
    """K_d without the spin terms is epsilon G alone."""
    text, path = pruned("solve.terms.spin=false"), tmp_path / "module.py"
    path.write_text(text)
    module = import_file(path, re.search(r'^STRUCTURE = "(\w+)"', text, flags=re.MULTILINE)[1])
    p, s, found = np.array([1.1, 3e7, 1500.0, 0.03, 0.06]), np.array([600.0, 1e5, 2e4, 2e4, 3e4]), np.zeros((6, 6))
    module.K_d(p, s, found)
    assert found == pytest.approx(by_hand.dynamic_stiffness(p[0], p[3], 0.0, s[1]), rel=1e-12, abs=1e-9)


def test_the_gyroscopic_matrix_stays_with_the_spin_terms_that_it_is_part_of():
    """L^T C_d L' of joint axes that turn against the rod: left out, quasi-static displacements would change."""
    assert "gyroscopic" in offered(pruned("solve.preset=quasistatic"))
    assert "gyroscopic" not in offered(pruned("solve.preset=quasistatic", "solve.terms.spin=false"))


def test_a_rigid_module_has_the_motion_alone():
    text = pruned("solve.preset=rigid")
    motion = re.search(r"^def motion.*?^@njit", WHOLE, flags=re.MULTILINE | re.DOTALL)[0]
    assert motion in text and offered(text) == {"njit", "rows", "table", "motion", "tabulate"}
    assert "The rigid motion alone: nothing deforms." in text and operation_count(text) == 83


def test_gravity_and_shear_that_are_switched_off_are_not_in_the_pruned_module():
    scene = with_settings(read_scene("two-link-arm"), ["gravity=[0, -9.81]"])
    gone = with_settings(scene, ["solve.preset=stiffened", "solve.terms.gravity=false"])
    assert "gravity" in generate_text(scene) and "('gravity" not in pruned_text(gone)


def test_a_model_with_every_term_has_the_whole_module():
    assert pruned() == WHOLE


def test_a_run_by_tolerance_is_that_of_the_chosen_settings(engine, cache, tmp_path, monkeypatch):
    """Its results come from the trial that chose the model, and its error estimates from the choice."""
    scene, _ = engine
    monkeypatch.setattr(choice_cache.Trials, "seconds", lambda self, models: dict.fromkeys(models, 0.0))
    command = "run", "engine", "--tolerance", "1.2%", "--sensors", "tip_axial", "--no-plots", "--force"
    result = cli(*command, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    summary = Summary.model_validate_json((tmp_path / "out" / "summary.json").read_text())
    choice = summary.choice
    _, expected = series(scene, choice.settings, ["tip_axial"])
    rows = np.genfromtxt(tmp_path / "out" / "results.csv", delimiter=",", names=True)
    peak = abs(expected["tip_axial"]).max()
    assert rows[next(n for n in rows.dtype.names if n.startswith("tip_axial"))] == pytest.approx(
        expected["tip_axial"], abs=1e-7 * peak
    )
    for _ in range(2):  # the second command tries cheaper models, the third one runs the chosen model
        assert cli(*command, "-o", tmp_path / "out").exit_code == 0
        summary = Summary.model_validate_json((tmp_path / "out" / "summary.json").read_text())
        own = summary.choice.errors["tip_axial"] + summary.choice.doubt["tip_axial"]
        assert summary.preset != "coupled"
        assert summary.sensors["tip_axial"].plus_minus.total == pytest.approx(own * peak, rel=0.02)


def test_derive_writes_the_chosen_models_module_and_counts(engine, cache, tmp_path, monkeypatch):
    _, found = engine
    monkeypatch.setattr(choice_cache, "chosen", lambda *arguments: (found, None, None))
    path = tmp_path / "engine.py"
    result = cli("derive", "engine", "--tolerance", "0.01", "--sensors", "tip_axial", "-o", path)
    count = "Kernels of the motion and one element: 196 operations, 228 with every term\n"
    assert result.exit_code == 0 and count in result.stdout
    text = path.read_text()
    head = text[: text.index("import math")]
    assert "M q'' + (K_s + K_g) q = F" in head and "Without the terms spin, gyroscopic, euler, damping." in head
    assert "made by: kaneflex derive SCENE --tolerance SHARE -o FILE.py" in head
    refused(cli("derive", "engine", "--tolerance", "1%", "--preset", "coupled", "-o", tmp_path / "b.py"), "--preset")
    refused(cli("derive", "engine", "--sensors", "tip_axial", "-o", tmp_path / "b.py"), "requires --tolerance")


def test_the_choices_compared_with_brute_force_are_what_the_page_says_of_them():
    rows = [row for row in csv_tables.read("choices") if row[1].endswith("%")]
    assert len({row[0] for row in rows}) >= 45 and len({row[1] for row in rows}) == 4
    chosen, others = [row for row in rows if row[3]], [row[2] for row in rows if not row[3]]
    assert len(chosen) >= 170 and all(re.search("error estimate of|rounding errors", reason) for reason in others)
    for case, tolerance, _, error_shown, _, _, _ in chosen:
        allowed, found = (float(cell.removesuffix(" %")) for cell in (tolerance, error_shown))
        assert found <= allowed, case
    ratios = [float(row[5]) for row in chosen]
    page, fast = (csv_tables.DOCS / "choice-table.md").read_text(), sum(ratio <= 1.3 for ratio in ratios)
    assert f"Of {len(chosen)} chosen models {len(chosen)} are within their tolerance. {fast} of them" in page
    assert f"all at most {max(ratios):.2f} times" in page and fast > 0.95 * len(chosen) and max(ratios) < 2.0
