"""docs/scene/ states every key of a scene file with its type, default and an example, and its scenes run."""

import importlib.util
import json
import re
import runpy
import tomllib
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from places import DATA, DOCS
from pydantic import TypeAdapter

from kaneflex import Scene, SceneError, Solution, load, read_scene, scene_of, simulate, with_settings
from kaneflex.integrate.methods import METHODS
from kaneflex.scene import json_schema
from kaneflex.scene.beams import MATERIALS
from kaneflex.scene.laws import FUNCTIONS
from kaneflex.scene.options import resolve_options
from kaneflex.scene.parts import PRESETS, TERM_NAMES
from kaneflex.scene.quantities import RESERVED_NAMES
from kaneflex.scene.table import SceneTable
from kaneflex.solve.simulation import solve

PAGES = ("index", "links", "joints", "drives", "loads", "contacts", "friction", "damping", "sensors", "solve", "space",
         "units")  # fmt: skip
TEXT = "\n".join((DOCS / "scene" / f"{page}.md").read_text(encoding="utf-8") for page in PAGES)
HEADING_OF = {
    "Mass": "Masses",
    "Shape": "Sections",
    "Segment": "Segments",
    "Free": "Free bodies",
    "Pose": "Poses",  # table of the scene file -> the heading under which its keys stand
    "Scene": "The file", "Body": "Bodies", "Beam": "Beams", "Joint": "Joints", "Drive": "Drives", "Load": "Loads",
    "Spring": "Springs", "Damping": "Damping", "Rayleigh": "Rayleigh damping", "ModalDamping": "Modal damping",
    "Viscous": "Viscous damping", "Sensor": "Sensors", "Event": "Events", "Solve": "Solve",
    "Contact": "Contacts", "ContactLaw": "Contact laws", "Clearance": "Clearances", "Friction": "Friction",
    "Rotation": "Rotation", "Forward": "Forward dynamics", "Start": "Starting from a state",
}  # fmt: skip
SCHEMA = Scene.model_json_schema(by_alias=True)
TABLES = {"Scene": SCHEMA, **SCHEMA["$defs"]}
BLOCKS = re.findall(r"^```toml\n(.*?)^```", TEXT, flags=re.DOTALL | re.MULTILINE)
SCENES = {re.match(r"# (\S+)\.toml\n", block)[1]: block for block in BLOCKS if "schema = 1" in block}
FRAGMENTS = [block for block in BLOCKS if "schema = 1" not in block]
MORE_SCENES = {path.stem: path.read_text() for path in (DATA / "scenes").glob("*.toml")}
"""Further scenes of the tests below, which no page shows."""


def models(parent: type = SceneTable) -> dict[str, type]:
    """The classes of all tables by their names."""
    children = parent.__subclasses__()
    return {each.__name__: each for each in children} | {k: v for each in children for k, v in models(each).items()}


def section(heading: str) -> str:
    """The text under a heading, down to the next one of any level."""
    return re.search(rf"^#+ {re.escape(heading)}\n(.*?)(?=^#+ |\Z)", TEXT, flags=re.DOTALL | re.MULTILINE)[1]


def rows(text: str, head: str) -> dict[str, list[str]]:
    """Rows of the table whose first column is called `head`: the word in its first cell -> the other cells."""
    lines = re.search(rf"^\| {head} \|.*\n\|[ -|]*\|\n((?:\|.*\n)+)", text, flags=re.MULTILINE)[1].splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {first.strip("`"): rest for first, *rest in cells}


def words(cell: str) -> list[str]:
    return re.findall(r"`([^`]*)`", cell)


def keys_of(table: str) -> dict[str, list[str]]:
    """Rows of a table of keys; a segment's page names the keys that it shares with a beam."""
    text = section(HEADING_OF[table])
    shared = re.search(r"The keys (.*?) are those of the\s\[beam\]", text, flags=re.DOTALL)
    of_beam = {key: keys_of("Beam")[key] for key in words(shared[1])} if shared else {}
    return of_beam | rows(text, "key")


def test_every_table_of_the_schema_has_its_heading():
    assert set(HEADING_OF) == set(TABLES) == {"Scene", *json_schema()["$defs"]}


@pytest.mark.parametrize("table", HEADING_OF)
def test_every_key_is_there_and_no_other(table):
    assert set(keys_of(table)) == set(TABLES[table]["properties"])


@pytest.mark.parametrize("table", HEADING_OF)
def test_defaults_are_those_of_the_schema(table):
    for key, (_, default, *_) in keys_of(table).items():
        entry = TABLES[table]["properties"][key]
        assert (default == "required") == (key in TABLES[table].get("required", [])), key
        if words(default):
            assert tomllib.loads(f"value = {words(default)[0]}")["value"] == entry["default"], key
        elif default != "all defaults":
            assert not entry.get("default"), key


@pytest.mark.parametrize("table", HEADING_OF)
def test_words_that_a_key_can_be_are_all_named(table):
    for key, (kind, *_) in keys_of(table).items():
        entry = TABLES[table]["properties"][key]
        allowed = [choice for option in entry.get("anyOf", [entry]) for choice in option.get("enum", [])]
        if allowed and key not in ("integrator", "reduction"):  # these have tables of their own
            assert sorted(words(kind)) == sorted(allowed), key


@pytest.mark.parametrize("table", HEADING_OF)
def test_examples_are_what_the_keys_take(table):
    """Each cell of the column `example`, read as TOML and validated as the field's own type."""
    for key, (_, _, example, _) in keys_of(table).items():
        value = tomllib.loads(f"value = {words(example)[0]}")["value"]
        model = models()[table]
        (name,) = [name for name, field in model.model_fields.items() if (field.alias or name) == key]
        field, checks = model.model_fields[name], model.__pydantic_decorators__.field_validators.values()
        if any(name in check.info.fields and check.info.mode == "before" for check in checks):
            continue  # its unit depends on other entries
        TypeAdapter(Annotated[field.annotation, "", *field.metadata]).validate_python(value)


def test_presets_integrators_and_reductions_are_those_of_the_code():
    assert tuple(rows(section("Presets"), "preset")) == tuple(PRESETS)
    assert set(rows(section("Integrators"), "integrator")) == set(METHODS)
    reductions = TABLES["Solve"]["properties"]["reduction"]["anyOf"][0]["enum"]
    assert list(rows(section("Reductions"), "reduction")) == reductions


@pytest.mark.parametrize("preset", PRESETS)
def test_each_preset_keeps_the_terms_that_the_page_says(preset):
    text = section("Groups of terms")
    options = resolve_options(with_settings(read_scene("engine"), [f"solve.preset={preset}"]))
    for term, (_, left_out) in rows(text, "term").items():
        assert (preset in words(left_out)) is not getattr(options, term), term
        assert set(words(left_out)) <= set(PRESETS), term


def test_the_terms_that_can_be_switched_are_those_of_the_page():
    def switches(term: str) -> bool:
        try:
            resolve_options(with_settings(read_scene("engine"), [f"solve.terms.{term}=false"]))
        except SceneError:
            return False
        return True

    assert set(filter(switches, TERM_NAMES)) == set(rows(section("Groups of terms"), "term"))


def test_materials_functions_and_reserved_names_are_those_of_the_code():
    table = rows(section("Materials"), "material")
    assert {name: tuple(map(float, numbers)) for name, numbers in table.items()} == MATERIALS
    laws = re.search(r"the functions (.*?)\. Nothing else", section("Laws"), flags=re.DOTALL)[1]
    assert sorted(words(laws)) == sorted(FUNCTIONS)
    reserved = re.search(r"can't be names:\n\n(.*?)\n\n", section("Names") + "\n\n", flags=re.DOTALL)[1]
    assert sorted(words(reserved)) == sorted(RESERVED_NAMES)


def anchors_of(page: Path) -> set[str]:
    """Anchors of a page's headings, as the site and a repository's viewer make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    if page.name == "summary.md":
        text += runpy.run_path(str(DOCS / "summary_fields.py"))["documentation"]()
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE))
    return {heading.replace(" ", "-") for heading in plain}


def test_links_between_the_pages_lead_somewhere():
    broken = []
    for page in [*DOCS.rglob("*.md"), DOCS.parent / "README.md"]:
        text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            file, _, anchor = target.partition("#")
            found = page if not file else (page.parent / file)
            if target.startswith("http"):
                continue
            if not found.exists() or (anchor and anchor not in anchors_of(found)):
                broken.append(f"{page.name}: {target}")
    assert not broken


def test_every_picture_of_the_pages_is_shown():
    shown = "".join(page.read_text(encoding="utf-8") for page in [*DOCS.rglob("*.md"), DOCS.parent / "README.md"])
    assert [path.name for path in (DOCS / "pictures").rglob("*.png") if path.name not in shown] == []


@pytest.mark.parametrize("fragment", FRAGMENTS, ids=lambda text: text.split("\n")[0].strip("[]").split(" ")[0])
def test_every_fragment_runs_on_top_of_the_engine(fragment, tmp_path):
    for name, rows in {
        "force": "angle,force\n0,0\n240,5\n480,-1\n720,0\n",
        "motor": "Speed (rpm),Torque (N m)\n0,20\n2000,15\n4000,10\n8000,0\n",
        "indicator": "Crank angle [deg],p [bar]\n0,0\n240,5\n380,40\n480,2\n",
    }.items():
        (tmp_path / f"{name}.csv").write_text(rows)
    path = tmp_path / "engine_and_more.toml"
    path.write_text(f'schema = 1\nlike = "engine"\n{fragment}')
    solution = solve(load(read_scene(path)))
    assert solution.outcome.name == "COMPLETED", solution.trajectory.message
    assert all(np.isfinite(series.values).all() for series in solution.series.values())


@pytest.fixture(scope="module")
def solved() -> dict[str, Solution]:
    """The complete scenes of the pages and of this file, each run as it stands there."""
    texts = SCENES | MORE_SCENES
    return {name: solve(load(scene_of(text))) for name, text in texts.items()}


def test_every_complete_scene_runs(solved):
    assert set(solved) == {
        "cantilever", "arm", "frame", "boom", "band-brake", "belt", "brake", "coupling", "knock", "slow-engine",
        "mount",
    }  # fmt: skip
    for name, solution in solved.items():
        assert solution.outcome.name == "COMPLETED", f"{name}: {solution.trajectory.message}"
        assert all(np.isfinite(series.values).all() for series in solution.series.values()), name


def test_the_cantilever_bends_as_textbooks_say(solved):
    quasistatic = with_settings(solved["cantilever"].model.scene, ["solve.preset=quasistatic"])
    series = simulate(load(quasistatic)).series
    E_I = 2.1e11 * 1.3333e-8
    assert series["tip"].values.min() == pytest.approx(-100 * 0.5**3 / (3 * E_I), rel=1e-4)  # F l^3 / (3 E I)
    assert series["root_moment"].values.min() == pytest.approx(-100 * 0.5, rel=1e-6)  # hollow towards -y
    assert series["wall_force"].values.max() == pytest.approx(100, rel=1e-6)  # the wall's force on the bar


def test_the_arm_weighs_on_its_drive(solved):
    series = solved["arm"].series
    mass, omega = 2700 * 300e-6 * 0.8, 4 * np.pi
    assert series["torque_rigid"].values.max() == pytest.approx(mass * 9.81 * (0.05 + 0.4), rel=1e-4)
    assert series["tension"].values[:-1].mean() == pytest.approx(mass * omega**2 * (0.05 + 0.4), rel=1e-3)
    assert series["tip_reading"].values[:-1].mean() == pytest.approx(-(omega**2) * 0.85, rel=1e-3)


def test_the_pin_knocks_and_an_elastic_rod_lowers_its_peaks(solved):
    """Against a rigid rod of the same mass: a peak, and not a number, as what goes before decides each impact."""
    knocking = solved["knock"]
    settings = ["rod.beam=none", "rod.mass=0.067824 kg", "rod.inertia=81.8 kg mm^2", "sensors.moment=none"]
    rigid = simulate(load(with_settings(knocking.model.scene, [*settings, "rod.centre=[0.06, 0]"])))
    peaks = [max(impact.peak for impact in found.impacts) for found in (knocking, rigid)]
    assert len(knocking.impacts) > 20 and 1.5 < peaks[1] / peaks[0] < 4
    assert knocking.series["room"].values.max() <= 0.2e-3 * (1 + 1e-9)
    assert knocking.trajectory.energy.drift < 1e-6 and rigid.trajectory.energy.drift < 1e-6


def test_the_brake_stops_its_drum_and_the_belt_drives_its_mill(solved):
    """J w/T after the brake closes; a belt that is stiff beside the rest has both pulleys turn as one."""
    times, speed = solved["band-brake"].times, solved["band-brake"].series["speed"].values
    stops = 0.2 + 0.4 * 10 * np.pi / (0.15 * 40 * (np.exp(0.3 * 3.5) - 1))
    assert speed == pytest.approx(10 * np.pi * np.clip((stops - times) / (stops - 0.2), 0, 1), abs=1e-10)
    times, speed = solved["belt"].times, solved["belt"].series["speed"].values
    drag = 0.1 + 6 / 150 * 2.4**2
    assert speed[200:] == pytest.approx(
        6 * 2.4 / drag * (1 - np.exp(-times[200:] * drag / (0.2 + 0.01 * 2.4**2))), rel=1e-2
    )


def test_the_boom_rests_on_its_cylinder(solved):
    """At rest, by virtual work: what the weights rise by is what the cylinder's eyes move apart."""
    base, beam = np.array([0.6, -0.4]), 7850 * 0.06
    side = (2.5**2 + base @ base - 2.6**2) / (2 * 2.5 * np.hypot(*base))
    luff = np.arctan2(*base[::-1]) + np.arccos(side)

    def weights_and_length(angle):
        knee = 2.5 * np.array([np.cos(angle), np.sin(angle)])
        tip = knee + 3.2 * np.array([np.cos(angle - np.pi / 6), np.sin(angle - np.pi / 6)])
        length = np.hypot(*(knee - base))
        barrel, rod = (base + at * (knee - base) / length for at in (0.75, length - 0.7))
        beams = 0.5 * 2.5 * beam * knee * 0.5 + 3.2 * beam * 0.45 * (knee + tip) / 2
        return 9.81 * (beams + 1500 * tip + 120 * barrel + 60 * rod)[1], length

    ahead, behind = weights_and_length(luff + 1e-5), weights_and_length(luff - 1e-5)
    push = (ahead[0] - behind[0]) / (ahead[1] - behind[1])
    series = solved["boom"].series
    assert series["push_rigid"].values[-1] == pytest.approx(push, rel=1e-8)
    assert series["push"].values[-1] == pytest.approx(push, rel=2e-2)  # still swinging, by 0.8 %
    assert np.degrees(series["luff"].values[-1]) == pytest.approx(np.degrees(luff), abs=0.02)


def test_the_slow_engine_has_no_gas_and_eight_elements(solved):
    model = solved["slow-engine"].model
    assert not model.scene.loads and len(model.links["rod"].nodes) == 9
    assert json.loads(json.dumps(model.scene.raw))["drives"]["main"] == {"speed": "60 rpm", "cycle": "720 deg"}


def test_every_name_of_the_architecture_page_is_there():
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`(kaneflex(?:\.\w+)+)`", text))
    assert len(names) > 20
    for name in names:
        parts = name.split(".")
        depth = next(k for k in range(len(parts), 0, -1) if parts[k - 1].islower() and _is_module(".".join(parts[:k])))
        found = importlib.import_module(".".join(parts[:depth]))
        for part in parts[depth:]:
            found = getattr(found, part)


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:  # its parent is no package
        return False
