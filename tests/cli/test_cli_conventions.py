"""Conventions of the command line: groups, one-line help, lists, ranges, earlier spellings, a template, JSON."""

import json
import re
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete
from command_line import cli

from kaneflex.cli.commands import GROUPS, main

HELP = {name: line for group in GROUPS.values() for name, (_, line) in group.items()}
COMMANDS = sorted(HELP)
WIDTH = 45
"""Characters of a line of `kaneflex --help` that a terminal of 80 always has room for."""


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_help_lists_every_command_once_by_its_group_on_one_line():
    shown = cli("--help").stdout
    assert [group for group in re.findall(r"^(\w+):$", shown, re.MULTILINE) if group != "Options"] == list(GROUPS)
    lines = shown[shown.index("Inspect:") :].splitlines()
    assert sorted(line.split()[0] for line in lines if line.startswith("  ")) == COMMANDS
    assert all(len(line) <= WIDTH for line in HELP.values())
    assert "..." not in "".join(lines)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_one_sentence_and_an_example(command):
    shown = cli(command, "--help").stdout
    sentence = shown.split("\n\n")[1]
    assert sentence.strip().endswith(".")
    assert f"    kaneflex {command} " in shown and "None" not in shown


@pytest.mark.parametrize("command", sorted(set(COMMANDS) - {"list", "new", "plot", "import"}))
def test_commands_of_a_scene_take_settings_and_a_preset(command):
    shown = cli(command, "--help").stdout
    assert "--set PATH=VALUE" in shown and "--preset" in shown


def test_lists_take_commas_or_are_repeated():
    arguments = ("linearise", "engine", "-o")
    for number, names in enumerate([
        ("--sensors", "mid_transverse,crank_torque"), ("--sensors", "mid_transverse", "--sensors", "crank_torque"),
    ]):  # fmt: skip
        found = cli(*arguments, f"{number}.npz", *names)
        assert found.exit_code == 0 and "2 outputs" in found.stdout and not found.stderr


def test_a_new_scene_without_a_model_is_the_commented_template():
    made = cli("new", "press")
    assert made.stdout == "Written to press.toml\n"
    checked = cli("check", "press.toml")
    assert checked.exit_code == 0 and "press: Slider-crank with an elastic rod" in checked.stdout
    assert "Warning" not in checked.stderr and "Note" not in checked.stderr
    ran = cli("run", "press.toml", "--no-plots", "--json")
    assert ran.exit_code == 0 and ran.stderr == "Written to press-results\n"
    rod = json.loads(ran.stdout)["sensors"]["rod_strain"]
    assert 1e-5 < rod["max"] < 1e-3


def test_a_sweep_takes_settings():
    with open("study.toml", "w", encoding="utf-8") as file:
        file.write('scene = "engine"\nsettings = ["solve.steps=36"]\n[parameters]\n"main.speed" = ["3000 rpm"]\n')
    found = cli("sweep", "study.toml", "--no-plots", "--set", "rod.length=30 mm", "--preset", "rigid")
    assert found.exit_code == 3 and "Point 0: joints.bore" in found.stderr


@pytest.mark.parametrize("command", ["compare", "sweep", "trade", "terms", "stability", "run"])
def test_pictures_are_drawn_unless_no_plots_is_given(command):
    shown = cli(command, "--help").stdout
    assert "--no-plots" in shown and shown.count("--plots") == shown.count("--plots KINDS") == (command == "run")


def test_stability_states_the_speeds_that_it_computed():
    arguments = ("stability", "mathieu", "--no-plots", "-o", "out")
    assert "At the scene's own speed; --vary" in cli(*arguments).stdout
    found = cli(*arguments, "--force", "--vary", "clock.speed=100:300rpm", "--points", "3")
    assert found.stdout.startswith("At the scene's own speed, and at 3 speeds of clock from 100 rpm to 300 rpm\n")


def test_derive_takes_presets():
    found = cli("derive", "four-bar", "--preset", "coupled", "-o", "new.py")
    assert found.exit_code == 0 and "Drives and loads of a mechanism" in Path("new.py").read_text(encoding="utf-8")


TABLES = {
    "list": ("scenes", "presets", "integrators"),
    "check engine": ("bodies", "degrees of freedom", "warnings", "notes"),
    "show engine": ("bodies", "degrees of freedom", "warnings", "notes"),
    "modes engine": ("frequencies_hz",),
    "stability mathieu --no-plots": ("findings",),
    "linearise engine -o engine.npz": ("poles", "states", "inputs", "outputs"),
    "compare engine --presets rigid,linear --no-plots": ("differences",),
    "trade engine --budget 0.1s --sensors tip_axial --no-plots": ("chosen", "models", "left_out"),
    "terms engine --budget 0.1s --sensors tip_axial --no-plots": ("full", "groups"),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("words", TABLES)
def test_a_table_is_also_json(words):
    found = cli(*words.split(), "--json")
    assert found.exit_code == 0
    assert set(TABLES[words]) <= set(json.loads(found.stdout))


@pytest.mark.parametrize(("words", "begun", "found"), [
    (["run"], "spin", ["spin-up", "spin-up-torque", "spinning-top"]),
    (["run", "engine", "--preset"], "st", ["stiffened"]),
    (["run", "engine", "--integrator"], "newm", ["newmark"]), (["run", "engine", "--set"], "rod.el", ["rod.elements="]),
    (["check", "engine", "--set"], "drives.main.s", ["drives.main.speed="]),
    (["check", "no-such-scene", "--set"], "solve.toler", ["solve.tolerance="]), ([], "equ", ["equations"]),
])  # fmt: skip
def test_the_shell_completes(words, begun, found):
    shell = ShellComplete(main, {}, "kaneflex", "_KANEFLEX_COMPLETE")
    assert [item.value for item in shell.get_completions(words, begun) if item.type == "plain"] == found
