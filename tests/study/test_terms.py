"""`kaneflex terms`: what the engine and the spin-up lose without each group of terms, files and pictures."""

import csv
import json
import re
from dataclasses import replace

import pytest
from command_line import cli
from machines import machine
from pages import check_printed, page
from places import DOCS

from kaneflex import SceneError, Terms, read_scene, scene_of, terms, trade, with_settings
from kaneflex.cli.trade import terms_table
from kaneflex.plots.studies import terms as figure
from kaneflex.plots.studies import trade as trade_figure
from kaneflex.study.runs import run
from kaneflex.study.trade.candidates import candidates_of, neutral
from kaneflex.study.trade.terms import groups

PAGE = page("trade.md")


def chosen(scene, *names):
    by_name = {group.name: group for group in groups(neutral(scene))}
    return [by_name[name] for name in names]


@pytest.fixture(scope="module")
def engine() -> Terms:
    scene = with_settings(read_scene("engine"), ["solve.terms.geometric=false", "solve.preset=linear"])
    return terms(scene, 0.01, 60.0, chosen=chosen(scene, "spin", "gyroscopic", "geometric", "dynamics", "load gas"))


@pytest.fixture(scope="module")
def effects(engine):
    return {effect.group.name: effect for effect in engine.effects}


def test_the_repr_is_a_line(engine):
    assert repr(engine).startswith("Terms(engine, needed: ") and len(repr(engine)) < 160


def test_groups_are_those_that_the_scene_has():
    names = [group.name for group in groups(neutral(read_scene("engine")))]
    terms_there = ["spin", "gyroscopic", "euler", "geometric", "damping"]
    assert names == [*terms_there, "axial", "load gas", "dynamics", "two-way coupling"]
    heavy = with_settings(read_scene("engine"), ["gravity=[0, -9.81]", "bodies.rod.beam.theory=rayleigh"])
    assert [group.name for group in groups(neutral(heavy))][5:7] == ["rotary", "gravity"]
    assert [group.name for group in groups(neutral(read_scene("robot-arm")))] == ["gravity"]  # rigid bodies
    still = [group.name for group in groups(neutral(scene_of("schema = 1" + COLUMN)))]
    assert still == ["geometric", "axial", "load push", "dynamics", "two-way coupling"]  # nothing turns


def test_a_scene_without_groups_is_refused():
    ball = machine(
        description="A ball that falls", gravity=[0, 0, -9.81],
        bodies=dict(ball="mass = 2, inertia = [0.01, 0.01, 0.01], free = {at = [0, 0, 0]}"),
        contacts=dict(floor='point_on_plane = ["ball", "ground"], normal = [0, 0, 1], contact = CONTACT'),
        sensors=dict(push="contact_force floor"), solve=dict(preset="coupled", duration="0.1 s", steps=10),
    )
    ball = ball.replace("CONTACT", '{law = "hertz", stiffness = 1e6}')
    with pytest.raises(SceneError, match=r"^scene = .*: no group of terms can be left out: it has no elastic link, "):
        terms(scene_of(ball))


@pytest.mark.parametrize(("name", "sensor", "change", "needed"), [
    ("load gas", "main_bearing_force_x", 1.607, True),
    ("geometric", "mid_global_y", 0.02267, True),
    ("dynamics", "main_bearing_force_x", 0.01106, True),
    ("gyroscopic", "mid_global_y", 0.00529, False),
    ("spin", "mid_global_y", 5.7e-5, False),
])  # fmt: skip
def test_what_the_engine_loses(effects, name, sensor, change, needed):
    effect = effects[name]
    assert (effect.worst.sensor, effect.needed) == (sensor, needed)
    assert effect.worst.error == pytest.approx(change, rel=0.02)
    assert 0 < effect.worst.rms_error < effect.worst.error


def test_the_largest_change_comes_first_and_operations_are_counted(engine, effects):
    assert [effect.group.name for effect in engine.effects] == [
        "load gas", "geometric", "dynamics", "gyroscopic", "spin"
    ]  # fmt: skip
    assert engine.operations == 388
    counts = {name: effect.operations for name, effect in effects.items()}
    assert counts == {"spin": 10, "gyroscopic": 35, "geometric": 90, "dynamics": None, "load gas": 1}


def test_a_group_without_which_the_run_stops_is_needed():
    scene = read_scene("spin-up")
    found = terms(scene, 0.01, 60.0, ["tip_transverse"], chosen=chosen(scene, "euler", "geometric"))
    first, second = found.effects
    assert (first.group.name, first.needed, first.differences) == ("geometric", True, ()) and "unstable" in first.reason
    assert (second.group.name, second.needed) == ("euler", False)


def test_what_can_not_be_left_out_is_named_with_the_reason():
    scene = read_scene("engine")
    found = terms(scene, 0.01, 60.0, chosen=chosen(scene, "axial", "spin"))
    assert [effect.group.name for effect in found.effects] == ["spin"]
    reason = "the fixed length of rod would couple the displacements of the joints at end, start"
    assert found.left_out == {"axial": f"{reason} (bodies.rod.beam.axially_rigid)"}


def test_what_the_budget_has_no_time_for_is_named():
    scene = read_scene("engine")
    found = terms(scene, 0.01, 1e-9, ["tip_axial"], chosen=chosen(scene, "spin", "euler"))
    assert len(found.effects) == 1 and found.left_out == {"euler": "no time left within the budget"}


def test_a_hydraulic_cylinder_on_an_elastic_lever_is_compared_under_coupled():
    """Its guide follows the deformed lever, which only the loading of a model finds out."""
    boom = scene_of(page("scene/drives.md").partition("# boom.toml\n")[2].partition("```")[0])
    wind = "loads.wind={force_on='upper.end', direction=[1, 0], value=1e5}"
    boom = with_settings(boom, ["solve.duration=20 ms", "solve.steps=2", wind])
    found = terms(boom, 0.01, 60.0, ["push"])
    assert [(effect.group.name, effect.needed) for effect in found.effects] == [("load wind", True)]
    assert [*found.left_out] == ["axial"]


COLUMN = """
bodies.strut = {length = "1 m", beam = {material = "steel", section = {rectangle = ["20 mm", "20 mm"]}, elements = 2}}
joints.foot = {weld = ["ground", "strut.start"], relative_angle = "37 deg"}
loads.push = {force_on = "strut.end", direction = [-0.7986355100472928, -0.6018150231520483], value = "100 N"}
sensors.moment = {bending_moment = "strut.mid"}
solve = {duration = "10 ms", steps = 10}
"""


def test_a_moment_that_is_rounding_beside_the_force_needs_nothing():
    """Its own measure it can't be, where it is the only sensor of its unit."""
    scene = scene_of("schema = 1" + COLUMN)
    assert 0.0 < abs(run(scene).curves.values["moment"]).max() < 1e-12  # the push is along the strut but for that
    found = terms(scene, 0.01, 60.0, chosen=chosen(scene, "geometric", "load push"))
    assert [(effect.needed, effect.differences) for effect in found.effects] == [(False, ())] * 2
    assert terms_table(found).count("shows only rounding") == 2 and "does not run" not in terms_table(found)
    assert "shows only rounding" in {text.get_text() for text in figure(found).axes[0].texts}
    with pytest.raises(SceneError, match="zero, or rounding errors only, in the whole run"):
        trade(scene, 0.01, 1e-3)


def test_the_picture_has_a_bar_for_each_group_and_marks_what_is_needed(engine):
    stopped = replace(engine.effects[0], differences=(), operations=None)
    changes, costs = figure(replace(engine, effects=(stopped, *engine.effects[1:]))).axes
    assert [label.get_text() for label in changes.get_yticklabels()][1:3] == ["geometric", "dynamics"]
    assert len(changes.patches) == 2 * 4 and len(costs.patches) == 3  # operations of dynamics are none
    assert "needed: does not run without" in {text.get_text() for text in changes.texts}
    assert changes.patches[0].get_width() == pytest.approx(2.267, rel=0.02)


def test_the_picture_of_a_trade_names_presets_and_the_choice():
    scene = read_scene("engine")
    names = ("rigid", "quasistatic", "stiffened", "stiffened, 1 element")
    ranked = [candidate for candidate in candidates_of(neutral(scene)) if candidate.name in names]
    found = trade(scene, 0.02, 60.0, ["mid_transverse"], candidates=ranked)
    (axes,) = trade_figure(found).axes
    shown = {text.get_text() for text in axes.texts}
    chosen_name = found.chosen.name
    named = {"rigid", "quasistatic", "stiffened"} - {chosen_name}
    assert shown == {"tolerance 2 %", f"chosen: {chosen_name}", *named}
    points = [line for line in axes.lines if line.get_marker() == "o" and line.get_label()[0] != "_"]
    assert sum(len(line.get_xdata()) for line in points) == 4


def test_the_command_writes_its_folder_and_prints_the_table(tmp_path):
    folder = tmp_path / "out"
    result = cli("terms", "engine", "--sensors", "tip_axial", "-o", folder)
    assert result.exit_code == 0
    assert {path.name for path in folder.iterdir()} == {"terms.csv", "terms.json", "terms.png"}
    about = json.loads((folder / "terms.json").read_text())
    rows = list(csv.DictReader((folder / "terms.csv").open()))
    assert [row["group"] for row in rows] == [entry["group"] for entry in about["groups"]]
    assert set(about["left_out"]) == {"axial"} and about["groups"][0]["sensors"].keys() == {"tip_axial"}
    assert next(row["operations"] for row in rows if row["group"] == "geometric") == "90"
    assert "axial is left out: the fixed length of rod would couple " in result.stderr
    line = next(line for line in result.stdout.splitlines() if line.startswith("geometric"))
    assert line.split()[:6] == ["geometric", "axial", "force", "P", "no", "tip_axial"]


def test_the_page_prints_what_it_says_and_its_commands_are_accepted(capsys):
    check_printed(PAGE, capsys)
    for picture in re.findall(r"\]\((pictures/[^)]+)\)", PAGE):
        assert (DOCS / picture).exists()
    for command in ("trade", "terms", "run", "derive"):
        shown = cli(command, "--help").stdout
        lines = re.findall(rf"^kaneflex {command} .*$", PAGE, re.MULTILINE)
        assert lines and all(option in shown for line in lines for option in re.findall(r"--[a-z-]+", line))


def test_the_pages_table_is_that_of_the_engine(effects):
    for name, effect in effects.items():
        (row,) = re.findall(rf"^\| {name} \| (.*) \|$", PAGE, re.MULTILINE)
        change, rms, sensor, needed, operations = (cell.strip() for cell in row.split("|"))
        assert float(change.removesuffix(" %")) == pytest.approx(100 * effect.worst.error, rel=0.05)
        assert float(rms.removesuffix(" %")) == pytest.approx(100 * effect.worst.rms_error, rel=0.05)
        assert (sensor, needed) == (f"`{effect.worst.sensor}`", "yes" if effect.needed else "no")
        assert operations == ("" if effect.operations is None else str(effect.operations))
