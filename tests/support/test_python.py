"""The package from Python: scenes from tables and text, what values offer, studies as functions, what is logged."""

import inspect
import logging
import pickle
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from pages import check_printed, page
from scipy.io import netcdf_file

import kaneflex
from kaneflex.cli import main
from kaneflex.generated import engine as generated_engine
from kaneflex.scene import shipped_scenes
from kaneflex.scene.structure import structure_hash

PENDULUM = {
    "schema": 1,
    "name": "mine",
    "gravity": [0, -9.81],
    "bodies": {"bar": {"length": "0.5 m", "mass": np.float64(2.0), "centre": np.array([0.25, 0.0]), "inertia": 0.05}},
    "joints": {"pivot": {"revolute": ("ground", "bar.start")}},
    "drives": {"pivot": {"law": "pi/2 + 0*t"}},
    "sensors": {"weight": {"joint_force": "pivot", "component": "y", "body": "bar"}},
    "solve": {"preset": "rigid", "duration": "1 s", "steps": 100},
}


@pytest.fixture(scope="module")
def engine():
    return kaneflex.simulate(kaneflex.load(kaneflex.read_scene("engine")))


def test_a_scene_is_the_same_from_its_file_its_text_and_its_tables():
    file = shipped_scenes()["engine"]
    tables, read = tomllib.loads(file.read_text()), kaneflex.read_scene("engine")
    for given in (tables, file.read_text()):
        found = kaneflex.scene_of(given, file.parent)
        assert structure_hash(found) == structure_hash(read)
        assert found.loads == read.loads  # its table of pressures stands beside the file


def test_tables_may_hold_numpys_numbers_and_start_from_another_scene():
    longer = {"schema": 1, "like": "engine", "bodies": {"rod": {"length": np.float64(0.14)}}}
    assert kaneflex.scene_of(longer).bodies["rod"].length == 0.14
    assert tuple(kaneflex.scene_of(PENDULUM).bodies["bar"].centre) == (0.25, 0.0)


@pytest.mark.parametrize("given, said", [
    ({"schema": 1, "like": "engine", "bodies": {"rod": {"lenght": 1}}}, "nearest known one is 'length'"),
    ("schema = 1\n[bodies.rod\n", "not TOML"),
    ("schema = 1\nlike = 'engine'\nname = 3\n", "not a text"),
])  # fmt: skip
def test_what_is_wrong_is_said_as_of_a_file(given, said):
    with pytest.raises(kaneflex.SceneError, match=said):
        kaneflex.scene_of(given)


def test_tables_without_end_and_other_things_are_refused():
    endless: dict = {"schema": 1}
    endless["bodies"] = endless
    with pytest.raises(kaneflex.SceneError, match="deep"):
        kaneflex.scene_of(endless)
    with pytest.raises(TypeError, match="tables or a text, not int"):
        kaneflex.scene_of(1)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["engine", "double-pendulum", "elastic-pendulum", "spatial-slider-crank"])
def test_models_and_solutions_travel(name):
    model = kaneflex.load(kaneflex.with_settings(kaneflex.read_scene(name), ["solve.steps=60"]))
    solution = kaneflex.simulate(model)
    there = pickle.loads(pickle.dumps(solution))
    assert there.outcome == solution.outcome
    for sensor in solution:
        np.testing.assert_array_equal(there.series[sensor].values, solution.series[sensor].values)
    again = kaneflex.simulate(pickle.loads(pickle.dumps(model)))
    np.testing.assert_array_equal(again.times, solution.times)
    assert again.model.warnings == model.warnings


def test_a_solution_is_read_like_a_mapping_and_as_a_frame(engine):
    assert "mid_transverse" in engine.keys() and set(engine) == set(engine.keys())
    assert dict(engine)["mid_transverse"].equals(engine["mid_transverse"])
    frame = engine.to_dataframe()
    assert frame.index.name == "time" and frame.attrs["units"]["piston_side_force"] == "N"
    np.testing.assert_array_equal(frame["mid_transverse"], engine.to_xarray()["mid_transverse"])


def test_reprs_are_a_line_and_a_table_in_a_notebook(engine):
    for value in (engine, engine.model, engine.model.scene, kaneflex.sensitivities(engine, ["rod.E"])):
        assert len(repr(value)) < 160 and "engine" in repr(value)
    for value in (kaneflex.linearise(engine), kaneflex.export_fmu(engine)):
        assert len(repr(value)) < 160 and "20 outputs" in repr(value)
    for value in (engine, engine.model, engine.model.scene):
        assert "<table>" in value._repr_html_()
    assert "mid_transverse" in engine._repr_html_()
    odd = kaneflex.with_settings(engine.model.scene, ['description="<b> & co"'])
    assert "&lt;b&gt; &amp; co" in odd._repr_html_()


def test_settings_are_also_a_dict(engine):
    scene = engine.model.scene
    given = {"rod.length": "140 mm", "rod.elements": 2, "solve.start": "zero", "loads.gas": "none"}
    found = kaneflex.with_settings(scene, given)
    same = kaneflex.with_settings(scene, ["rod.length=140 mm", "rod.elements=2", "solve.start=zero", "loads.gas=none"])
    assert found == same and found.bodies["rod"].length == pytest.approx(0.14)
    with pytest.raises(kaneflex.SceneError, match=r"rod.lenth = 140 mm|rod.lenth = '140 mm'"):
        kaneflex.with_settings(scene, {"rod.lenth": "140 mm"})


def test_a_solution_writes_what_a_run_writes(engine, tmp_path):
    engine.to_netcdf(tmp_path / "own.nc")
    engine.to_csv(tmp_path / "own.csv")
    assert len(engine) == len(list(engine)) and engine
    with netcdf_file(tmp_path / "own.nc", mmap=False) as found:
        np.testing.assert_array_equal(found.variables["mid_transverse"][:], engine.series["mid_transverse"].values)
    assert (tmp_path / "own.csv").read_text().count("\n") == len(engine.times) + 1


def test_a_solution_draws_and_reports(engine, tmp_path):
    assert set(engine.plot("loads")) == {"loads"} and engine.plot("loads")["loads"].axes
    assert [path.name for path in engine.plot("loads", folder=tmp_path)] == ["loads.png"]
    page = engine.report(tmp_path / "new")
    assert page == tmp_path / "new/report.html" and (tmp_path / "new/sensors.png").is_file()
    text = page.read_text(encoding="utf-8")
    assert "mid_transverse" in text and 'alt="loads"' in text
    with pytest.raises(kaneflex.SceneError, match=r"plots = 'load': no such kind of picture"):
        engine.plot("load")


def test_code_is_that_of_the_commands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = kaneflex.read_scene("engine")
    assert kaneflex.derive_code(scene) == Path(generated_engine.__file__).read_text(encoding="utf-8")
    assert CliRunner().invoke(main, ["equations", "engine"]).stdout == kaneflex.equations(scene)
    assert {"engine.h", "engine.c"} <= kaneflex.derive_code(scene, "c").keys()
    assert "def equations(t):" in kaneflex.derive_code(scene, "standalone")
    with pytest.raises(kaneflex.SceneError, match=r"form = 'cpp': no such form of the equations. .*module"):
        kaneflex.derive_code(scene, "cpp")


def test_names_are_the_public_ones():
    assert dir(kaneflex) == sorted([*kaneflex.__all__, "__version__"])
    judged = kaneflex.stability(kaneflex.read_scene("mathieu"))
    assert repr(judged).startswith("Stability(mathieu") and len(repr(judged)) < 200
    for name in filter(str.islower, kaneflex.__all__):
        assert "lambda" not in str(inspect.signature(getattr(kaneflex, name))), name


def test_modes_are_those_of_the_command():
    found = kaneflex.modes(kaneflex.read_scene("engine"), 2)
    assert found.frequencies == pytest.approx([3038.874, 4549.319], rel=1e-6)
    assert found.shapes.shape == (len(found.coordinates), 2)
    assert "3038.87" in repr(found)
    with pytest.raises(kaneflex.SceneError, match="12 degrees of freedom"):
        kaneflex.modes(kaneflex.read_scene("engine"), 13)


def test_pictures_are_figures(engine):
    assert "sensors" in kaneflex.figures(engine)
    assert kaneflex.show(engine.model.scene, {"main": 1.0}).axes
    assert len(kaneflex.show(kaneflex.read_scene("bricard")).axes) == 4
    with pytest.raises(kaneflex.SceneError, match="drawn at its start"):
        kaneflex.show(kaneflex.read_scene("bricard"), {"first": 1.0})


def test_a_sweep_takes_tables_and_a_scene(tmp_path):
    study = {"scene": kaneflex.scene_of(PENDULUM), "parameters": {"bodies.bar.mass": [1.0, 2.0]}}
    finished = kaneflex.sweep(study, tmp_path / "out")
    assert finished.total == 2 and finished.dataset.sizes["point"] == 2
    assert finished.dataset["weight"].sel(statistic="max").values == pytest.approx([9.81, 19.62], rel=1e-9)


def test_quiet_and_verbose(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    quiet = CliRunner().invoke(main, ["modes", "engine", "--count", "1", "-q"])
    assert quiet.exit_code == 0 and quiet.output == ""
    assert CliRunner().invoke(main, ["modes", "engine", "--count", "99", "-q"]).stderr.startswith("Error: count = 99")
    assert logging.getLogger("kaneflex").level == logging.NOTSET
    said: list[str] = []
    keep = logging.Handler()
    keep.emit = lambda record: said.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger("kaneflex").addHandler(keep)
    try:
        loud = CliRunner().invoke(main, ["run", "engine", "--no-plots", "-o", "loud", "-v"])
    finally:
        logging.getLogger("kaneflex").removeHandler(keep)
    assert loud.exit_code == 0 and "crank_torque" in loud.stdout
    assert any(line.startswith("solving") and line.endswith(" s") for line in said)


def test_the_page_s_examples_run_and_print_what_they_say(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    check_printed(page("python.md"), capsys)


def test_the_page_names_what_there_is():
    column = " ".join(re.findall(r"^\| (`.*?) \|", page("python.md"), flags=re.MULTILINE))
    verbs = set(re.findall(r"`(\w+)`", column))
    functions = {name for name in kaneflex.__all__ if name[0].islower()}
    assert verbs <= functions
    assert functions - verbs == {"checked", "in_processes", "read_state", "shipped_scenes"}
