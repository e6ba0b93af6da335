"""Public functions that are called with the wrong kind of argument: each names itself, what it got, and the way out."""

import inspect

import numpy as np
import pytest
from runs import run

import kaneflex
from kaneflex.generated import engine

SCENE, MODEL, SOLUTION = (f" takes a {kind}, not " for kind in ("Scene", "Model", "Solution"))
READ, LOADED, SIMULATED = "read_scene(...) makes one", "load(scene) makes one", "simulate(model) makes one"
TEXTS, PATH = " takes a list of texts as ", "give a text or a pathlib.Path"
FUNCTION = "give one that takes what is told"
# function, arguments (scene, model, solution stand for real ones), what the message says
WRONG = [
    ("checked", ("engine",), " takes a generated module or a mechanism's kernels, not str: kaneflex.generated.engine"),
    ("checked", (np,), "not module"),
    ("compare", ("engine",), SCENE + f"str: {READ}"),
    ("compare", ("scene", "coupled"), TEXTS + "presets, not str: write ["),
    ("compare", ("scene", ["linear", 3]), TEXTS + "presets, not list of int and str"),
    ("compare", ("scene", None, 3), " takes a text as against, not int: write it in quotes"),
    ("draw_all", ("model", "x"), SOLUTION + f"Model: {SIMULATED}"),
    ("draw_all", ("solution", 3), f" takes a path as folder, not int: {PATH}"),
    ("draw_all", ("solution", "x", None, 2.5), " takes a whole number as frames, not float"),
    ("figures", ("model",), SOLUTION + f"Model: {SIMULATED}"),
    ("figures", ("scene",), SOLUTION + f"Scene: {SIMULATED}"),
    ("in_processes", ("2",), " takes a whole number, not str: give one like 4"),
    ("in_processes", (True,), " takes a whole number, not bool"),
    ("linearise", ("scene",), MODEL + f"Scene: {LOADED}"),
    ("linearise", ("solution",), MODEL + f"Solution: {LOADED}"),
    ("linearise", ("model", "0.1 s"), " takes a number as t, not str: give it in SI, without a unit"),
    ("linearise", ("model", 0.0, "angle"), TEXTS + "sensors, not str"),
    ("load", ("engine",), SCENE + f"str: {READ}"),
    ("load", (None,), SCENE + "NoneType"),
    ("load", ("scene", "loud"), f" takes a function as progress, not str: {FUNCTION}"),
    ("load", ("scene", print, "scene"), " takes a Model as like, not Scene"),
    ("modes", ("model",), SCENE + f"Model: {READ}"),
    ("modes", ("scene", "4"), " takes a whole number as count, not str"),
    ("on_cluster", (8786,), " takes a text, not int: write it in quotes"),
    ("read_scene", (5,), f" takes a path, not int: {PATH}"),
    ("read_scene", ("scene",), " takes a path, not Scene"),
    ("read_state", ("solution",), f" takes a path, not Solution: {PATH}"),
    ("scene_of", (3,), " takes tables or a text, not int: give {'bodies': ...}, or TOML"),
    ("scene_of", ({}, 3), " takes a path as folder, not int"),
    ("sensitivities", ("solution", "rod.I"), TEXTS + "names, not str: write ['...', '...']"),
    ("sensitivities", ("solution", [1]), TEXTS + "names, not list of int"),
    ("sensitivities", ("model", ["rod.I"]), SOLUTION + f"Model: {SIMULATED}"),
    ("show", ("engine",), SCENE + f"str: {READ}"),
    ("show", ("scene", 0.5), " takes places of drives as at, not float: write {'main': 0.5}"),
    ("simulate", ("scene",), MODEL + f"Scene: {LOADED}"),
    ("simulate", ("model", 3), f" takes a function as progress, not int: {FUNCTION}"),
    ("simulate", ("model", None, "folder"), " takes a Solution or a State as after, not str: read_state(path) has one"),
    ("stability", ("model",), SCENE + f"Model: {READ}"),
    ("stability", ("scene", "0:6000rpm"), " takes a list of numbers as speeds, not str: give them in SI"),
    ("stability", ("scene", None, print, ["1"]), " takes a list of numbers as orders, not list of str"),
    ("sweep", ("scene", "x"), " takes a study, not Scene: give the path of its file, or {'scene'"),
    ("sweep", ({}, 3), " takes a path as folder, not int"),
    ("sweep", ({}, "x", "dask"), " takes a function as solver, not str"),
    ("terms", ("model",), SCENE + f"Model: {READ}"),
    ("terms", ("scene", "1%"), " takes a number as tolerance, not str: give it in SI, without a unit"),
    ("trade", ("engine",), SCENE + f"str: {READ}"),
    ("trade", ("scene", 0.01, "60 s"), " takes a number as budget, not str"),
    ("trade", ("scene", 0.01, 60.0, "angle"), TEXTS + "sensors, not str"),
    ("with_settings", ("engine", []), SCENE + f"str: {READ}"),
    ("with_settings", ("scene", 3), " takes a list or a dict of settings as settings, not int: write {'rod.I'"),
    ("with_settings", ("scene", {1: "rod.I"}), "not dict"),
    ("with_settings", ("scene", [1]), "not list of int"),
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


def test_what_fits_goes_through(real):
    assert kaneflex.checked(engine).PARAMETERS == engine.PARAMETERS
    assert kaneflex.show(real["scene"], at={}) is not None
    assert kaneflex.with_settings(real["scene"], (text for text in ["solve.steps=40"])).solve.steps == 40
    assert inspect.signature(kaneflex.load).parameters["like"].default is None
    with pytest.raises(kaneflex.SceneError, match=r"Write \['rod\.I=1'\]"):
        kaneflex.with_settings(real["scene"], "rod.I=1")
