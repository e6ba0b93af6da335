"""Wrong arguments of public functions, each named with the way out; and what a person sees while waiting."""

import inspect
import sys
import time

import numpy as np
import pytest
from runs import run

import kaneflex
from kaneflex.generated import engine
from kaneflex.solve.simulation import solve
from kaneflex.support import terminal

SCENE, MODEL = " takes a Scene, Model, Solution or path, not ", " takes a Model, Solution, Scene or path, not "
SOLUTION = " takes a Solution, not "
READ, LOADED, SIMULATED = "read_scene(...) makes a Scene", "load(scene) makes a Model", "simulate(model) makes one"
TEXTS, PATH = " takes a list of texts as ", "give a text or a pathlib.Path"
FUNCTION = "give a function of one argument"
# function, arguments (scene, model, solution stand for real ones), what the message says
WRONG = [
    ("checked", ("engine",), " takes a generated module or a mechanism's kernels, not str: kaneflex.generated.engine"),
    ("checked", (np,), "not module"),
    ("compare", (3,), SCENE + f"int: {READ}"),
    ("compare", ("scene", "coupled"), TEXTS + "presets, not str: write ["),
    ("compare", ("scene", ["linear", 3]), TEXTS + "presets, not list of int and str"),
    ("compare", ("scene", None, 3), " takes a text as against, not int: write it in quotes"),
    ("derive_code", (3,), SCENE + f"int: {READ}"),
    ("derive_code", ("scene", 3), " takes a text as form, not int"),
    ("draw_all", ("model", "x"), SOLUTION + f"Model: {SIMULATED}"),
    ("draw_all", ("solution", 3), f" takes a path as folder, not int: {PATH}"),
    ("draw_all", ("solution", "x", None, 2.5), " takes a whole number as frames, not float"),
    ("equations", (3,), SCENE + f"int: {READ}"),
    ("explore", (3, ["main.speed=1:2"]), SCENE + f"int: {READ}"),
    ("explore", ("scene", "main.speed=1:2"), TEXTS + "vary, not str"),
    ("export_fmu", (3,), SCENE + f"int: {READ}"),
    ("figures", ("model",), SOLUTION + f"Model: {SIMULATED}"),
    ("figures", ("scene",), SOLUTION + f"Scene: {SIMULATED}"),
    ("import_mesh", (1, "k", "n", {}), f" takes a path, not int: {PATH}"),
    ("import_mesh", ("m", "k", "n", ["start"]), " takes paths by point as points, not list of str: write {'start'"),
    ("in_processes", ("2",), " takes a whole number, not str: give one like 4"),
    ("in_processes", (True,), " takes a whole number, not bool"),
    ("linearise", ({},), MODEL + f"dict: {LOADED}"),
    ("linearise", ("model", "0.1 s"), " takes a number as t, not str: give it in SI, without a unit"),
    ("linearise", ("model", 0.0, "angle"), TEXTS + "sensors, not str"),
    ("load", ({},), SCENE + f"dict: {READ}"),
    ("load", (None,), SCENE + "NoneType"),
    ("load", ("scene", "loud"), f" takes a function as progress, not str: {FUNCTION}"),
    ("load", ("scene", print, "scene"), " takes a Model as like, not Scene"),
    ("modes", (4,), SCENE + f"int: {READ}"),
    ("modes", ("scene", "4"), " takes a whole number as count, not str"),
    ("read_scene", (5,), f" takes a path, not int: {PATH}"),
    ("read_scene", ("scene",), " takes a path, not Scene"),
    ("read_state", ("solution",), f" takes a path, not Solution: {PATH}"),
    ("scene_of", (3,), " takes tables or a text, not int: give {'bodies': ...}, or TOML"),
    ("scene_of", ({}, 3), " takes a path as folder, not int"),
    ("sensitivities", ("solution", "rod.I"), TEXTS + "names, not str: write ['...', '...']"),
    ("sensitivities", ("solution", [1]), TEXTS + "names, not list of int"),
    ("sensitivities", ("model", ["rod.I"]), SOLUTION + f"Model: {SIMULATED}"),
    ("show", (b"engine",), SCENE + f"bytes: {READ}"),
    ("show", ("scene", 0.5), " takes places of drives as at, not float: write {'main': 0.5}"),
    ("simulate", (None,), MODEL + f"NoneType: {LOADED}"),
    ("simulate", ("model", 3), f" takes a function as progress, not int: {FUNCTION}"),
    ("simulate", ("model", None, "folder"), " takes a Solution or a State as after, not str: read_state(path) has one"),
    ("stability", (["scene"],), SCENE + f"list of str: {READ}"),
    ("stability", ("scene", "0:6000rpm"), " takes a list of numbers as speeds, not str: give them in SI"),
    ("stability", ("scene", None, print, ["1"]), " takes a list of numbers as orders, not list of str"),
    ("sweep", ("scene", "x"), " takes a study, not Scene: give the path of its file, or {'scene'"),
    ("sweep", ({}, 3), " takes a path as folder, not int"),
    ("sweep", ({}, "x", "dask"), " takes a function as solver, not str"),
    ("terms", (1,), SCENE + f"int: {READ}"),
    ("terms", ("scene", "1%"), " takes a number as tolerance, not str: give it in SI, without a unit"),
    ("trade", (1.0,), SCENE + f"float: {READ}"),
    ("trade", ("scene", 0.01, "60 s"), " takes a number as budget, not str"),
    ("trade", ("scene", 0.01, 60.0, "angle"), TEXTS + "sensors, not str"),
    ("with_settings", ({}, []), SCENE + f"dict: {READ}"),
    ("with_settings", ("scene", 3), " takes a list or a dict of settings as settings, not int: write {'rod.I'"),
    ("with_settings", ("scene", {1: "rod.I"}), "not dict"),
    ("with_settings", ("scene", [1]), "not list of int"),
    ("write_report", ("model", "x"), SOLUTION + f"Model: {SIMULATED}"),
    ("write_report", ("solution", 3), f" takes a path as folder, not int: {PATH}"),
]  # fmt: skip


@pytest.fixture(scope="module")
def real():
    solution = run("four-bar", "solve.steps=36", "solve.preset=rigid")
    return {"scene": solution.model.scene, "model": solution.model, "solution": solution}


@pytest.mark.parametrize(("name", "given", "words"), WRONG)
def test_a_wrong_kind_of_argument_is_named(name, given, words, real):
    arguments = [real.get(each, each) if isinstance(each, str) else each for each in given]
    with pytest.raises(TypeError) as caught:
        getattr(kaneflex, name)(*arguments)
    message = str(caught.value)
    assert message.startswith(f"{name} takes ") and words in message and ": " in message and "\n" not in message


def functions():
    return {name: getattr(kaneflex, name) for name in kaneflex.__all__ if inspect.isfunction(getattr(kaneflex, name))}


def test_every_public_function_is_in_the_table():
    assert {name for name, *_ in WRONG} == functions().keys() - {"shipped_scenes"}  # which takes nothing


@pytest.mark.parametrize("wrong", [object(), 3.5, None, b"bytes"], ids=lambda each: type(each).__name__)
def test_no_public_function_takes_just_anything(wrong):
    for name, function in functions().items():
        wanted = [each for each in inspect.signature(function).parameters.values() if each.default is each.empty]
        if wanted:
            with pytest.raises(TypeError, match=rf"^{name} takes "):
                function(*[wrong] * len(wanted))


def test_a_scene_is_taken_from_what_was_made_of_it_and_from_its_name(real):
    found = [kaneflex.with_settings(given, {"solve.steps": 36}) for given in (*real.values(), "four-bar")]
    assert all(scene.solve.steps == 36 and scene.name == "four-bar" for scene in found)
    assert [scene.solve.preset for scene in found] == ["rigid", "rigid", "rigid", "stiffened"]
    expected = kaneflex.modes(kaneflex.read_scene("four-bar"), 1).frequencies
    np.testing.assert_array_equal(kaneflex.modes("four-bar", 1).frequencies, expected)
    again = kaneflex.simulate(real["scene"])
    np.testing.assert_array_equal(again.times, kaneflex.simulate(real["solution"]).times)
    with pytest.raises(kaneflex.SceneError, match=r"scene = 'engin': no shipped scene .* 'engine'"):
        kaneflex.load("engin")


def test_what_fits_goes_through(real):
    assert kaneflex.checked(engine).PARAMETERS == engine.PARAMETERS
    assert kaneflex.show(real["scene"], at={}) is not None
    assert kaneflex.with_settings(real["scene"], (text for text in ["solve.steps=40"])).solve.steps == 40
    assert inspect.signature(kaneflex.load).parameters["like"].default is None
    with pytest.raises(kaneflex.SceneError, match=r"Write \['rod\.I=1'\]"):
        kaneflex.with_settings(real["scene"], "rod.I=1")


def test_only_a_stage_that_lasts_is_shown(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "_PATIENCE", 0.1)
    with terminal.Waiting() as waiting:
        waiting("brief")
        waiting("compiling, first time only")
        time.sleep(0.4)
        share = waiting.share_of("solving")
        share(0.5)
        share(1.0)
    time.sleep(0.2)
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("", "compiling, first time only ...\n")


def test_a_terminal_shows_a_line_with_the_share_and_takes_it_off(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "_PATIENCE", 0.05)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with terminal.Waiting() as waiting:
        share = waiting.share_of("solving")
        share(0.0)
        deadline = time.monotonic() + 10.0
        while not waiting._line and time.monotonic() < deadline:
            time.sleep(0.02)
        share(0.25)
        share(0.251)
        terminal.echo("a result")
        waiting("writing")
    shown = capsys.readouterr()
    assert shown.err == f"\rsolving ...\rsolving ... 25%\r{' ' * 15}\r"
    assert shown.out == "a result\n"


@pytest.mark.parametrize(
    ("scene", "settings"),
    [("spinning-top", ["solve.duration=0.1 s"]), ("double-pendulum", ["solve.preset=rigid"]),
     ("spatial-slider-crank-elastic", ["solve.preset=coupled", "solve.start=zero", "solve.duration=5 ms"])],
)  # fmt: skip
def test_motions_that_a_run_integrates_tell_their_share(scene, settings):
    told = []
    solve(kaneflex.load(kaneflex.with_settings(kaneflex.read_scene(scene), settings)), told.append)
    assert told == sorted(told) and 0.99 < told[-1] <= 1.0
