"""`kaneflex run`: what it writes and prints, and that it leaves all or nothing."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import cli, refused, unrendered

from kaneflex import OutputError, read_scene
from kaneflex.report.summary import Summary
from kaneflex.scene.structure import structure_hash
from kaneflex.support.files import _locked, whole_folder

SMALL = ("--no-plots", "--set", "rod.elements=1", "--steps", "240")
SENSORS = (
    "tip_axial mid_axial mid_transverse mid_transverse_frame mid_global_x mid_global_y tip_transverse_frame "
    "rod_force_piston rod_force_piston_rigid rod_mid_force rod_mid_strain crank_pin_force_x crank_pin_force_y "
    "piston_side_force main_bearing_force_x main_bearing_force_y crank_torque piston_position piston_acceleration "
    "rod_mid_acceleration_x rod_mid_acceleration_y"
).split()


pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """What a run printed, and its folder."""
    folder = tmp_path_factory.mktemp("cli") / "deep" / "results"
    result = cli("run", "engine", *SMALL, "--preset", "quasistatic", "-o", folder)
    assert result.exit_code == 0, result.output
    return result, folder


def never(*arguments: object, **named: object) -> None:
    raise AssertionError("computed before the output was checked")


def test_run_writes_results_and_summary_and_nothing_else(finished):
    _, folder = finished
    assert {path.name for path in folder.iterdir()} == {"report.html", "results.csv", "results.nc", "scene.toml",
                                                         "summary.json"}  # fmt: skip
    assert [path.name for path in folder.parent.iterdir()] == ["results"]


def test_summary_file_holds_every_sensor_and_what_was_set(finished):
    _, folder = finished
    summary = Summary.model_validate_json((folder / "summary.json").read_text())
    assert set(SENSORS) <= set(summary.sensors)
    assert (summary.scene, summary.preset, summary.outcome) == ("engine", "quasistatic", "completed")
    assert summary.structure == structure_hash(read_scene("engine"))
    assert summary.settings == ["rod.elements=1", "solve.preset=quasistatic", "solve.steps=240"]
    assert summary.options["steps"] == summary.steps == 240 and summary.elements == {"rod": 1}
    assert summary.degrees_of_freedom == summary.modes_kept == len(summary.frequencies_hz) == 3
    assert summary.mode_angle_spread == {}
    assert summary.operations["M"].shared < summary.operations["M"].written_out


def test_run_prints_millimetres_kilonewtons_and_degrees(finished):
    result, folder = finished
    entry = Summary.model_validate_json((folder / "summary.json").read_text()).sensors["rod_force_piston"]
    line = next(line for line in result.stdout.splitlines() if line.startswith("rod_force_piston "))
    _, unit, lowest, at = line.split()[:4]
    assert unit == "kN"
    assert float(lowest) == pytest.approx(entry.min / 1e3, rel=1e-3)
    assert float(at) == pytest.approx(entry.at_min.drive_deg, abs=0.05)
    assert re.search(r"^tip_axial +mm ", result.stdout, re.MULTILINE)


def test_run_without_output_writes_beside():
    result = cli("run", "engine", *SMALL, "--set", "solve.preset=rigid")
    assert result.exit_code == 0, result.output
    summary = Summary.model_validate_json(Path("engine-results/summary.json").read_text())
    assert (summary.steps, summary.preset, summary.frequencies_hz) == (240, "rigid", [])


@pytest.mark.parametrize(("option", "setting"), [
    ("--preset = 'linear'", "solve.preset=rigid"), ("--steps = '240'", "solve.steps = 9"),
])  # fmt: skip
def test_an_entry_that_an_option_and_a_setting_give_is_refused(option, setting):
    """The setting was ignored in silence."""
    words = f"{option}: --set {setting} gives the same entry. Leave out one of the two"
    refused(cli("run", "engine", *SMALL, "--preset", "linear", "--set", setting), words)


def test_a_frozen_model_reports_how_its_peaks_depend_on_the_angle_at_which_it_is_frozen():
    """It also says which forces are those of the rigid mechanism: joint forces and torques, not a link's own forces."""
    result = cli("run", "engine-paper", "--no-plots", "-o", "r")
    summary = Summary.model_validate_json(Path("r/summary.json").read_text())
    labelled = [name for name, entry in summary.sensors.items() if entry.meaning.endswith("rigid mechanism")
                and not name.endswith("_rigid")]  # fmt: skip
    assert "crank_torque" in labelled and "rod_force_piston" not in labelled
    assert f"{', '.join(labelled)} are those of the rigid mechanism" in result.stdout
    for name in labelled:
        beside, own = summary.sensors[f"{name}_rigid"], summary.sensors[name]
        assert (beside.min, beside.max) == (own.min, own.max)
    spread, entry = summary.mode_angle_spread["mid_transverse"], summary.sensors["mid_transverse"]
    # mode_angle 0, the default, is one of the angles
    assert spread.smallest <= max(-entry.min, entry.max) * (1 + 1e-9)
    assert max(-entry.min, entry.max) <= spread.largest * (1 + 1e-9)
    assert spread.largest > 2 * spread.smallest
    shown = re.search(r"^mid_transverse +mm +(\S+) +(\S+)$", result.stdout, re.MULTILINE)
    assert [float(text) for text in shown.groups()] == pytest.approx(
        [1e3 * spread.smallest, 1e3 * spread.largest], rel=1e-3
    )


def test_integrator_is_taken():
    assert cli("run", "engine", *SMALL, "--integrator", "newmark", "-o", "r").exit_code == 0
    assert json.loads(Path("r/summary.json").read_text())["options"]["integrator"] == "newmark"


def test_pictures_are_drawn_into_the_folder_unless_declined(monkeypatch):
    drawn = []

    def draw_all(solution, folder, progress, frames, seconds, kinds):
        (folder / "picture.png").write_bytes(b"")
        progress(1.0)
        drawn.append(solution.model.scene.name)
        return [folder / "picture.png"]

    monkeypatch.setattr("kaneflex.plots.draw_all", draw_all)
    assert cli("run", "engine", "--preset", "rigid", "--steps", "90", "-o", "r").exit_code == 0
    assert drawn == ["engine"] and Path("r/picture.png").is_file()
    assert cli("run", "engine", "--preset", "rigid", "--steps", "90", "-o", "s", "--no-plots").exit_code == 0
    assert drawn == ["engine"]


def test_pictures_are_drawn_by_name_also_later_from_the_finished_folder(monkeypatch):
    unrendered(monkeypatch)
    short = ("--preset", "rigid", "--steps", "90", "-o", "r")
    refused(cli("run", "engine", *short, "--plots", "motoin"), "plots = 'motoin'", "'motion'")
    assert cli("run", "engine", *short, "--plots", "motion,svg").exit_code == 0
    assert {path.name for path in Path("r").glob("*.*g")} == {"motion.png", "motion.svg"}
    assert cli("plot", "r", "loads", "paths").exit_code == 0
    assert {path.name for path in Path("r").glob("*.*g")} == {"motion.png", "motion.svg", "loads.png", "paths.png"}
    nothing = cli("plot", "r", "stresses")
    said = "Nothing drawn: the run has nothing to show in stresses; docs/results.md says what each needs.\n"
    assert (nothing.exit_code, nothing.stderr) == (0, said)
    refused(cli("plot", "r", "motoin"), "plots = 'motoin'", "'motion'")
    refused(cli("plot", "."), "the folder has no scene.toml")
    scene = Path("r/scene.toml")
    scene.write_text(scene.read_text().replace('mass = "0.214 kg"', 'mass = "0.215 kg"'))
    refused(cli("plot", "r", "loads"), "results.nc", "differs from a new solution of scene.toml")


def test_results_are_printed_before_anything_is_drawn(monkeypatch):
    def draw_all(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("kaneflex.plots.draw_all", draw_all)
    result = cli("run", "engine", "--preset", "rigid", "--steps", "90", "-o", "r")
    assert result.exit_code == 130 and "crank_torque" in result.stdout and not Path("r").exists()


def test_an_existing_result_folder_is_refused_before_anything_is_computed(monkeypatch):
    Path("r").mkdir()
    Path("r/summary.json").write_text("old")
    monkeypatch.setattr("kaneflex.solve.loading.load", never)
    refused(cli("run", "engine", *SMALL, "-o", "r"), "r: the folder exists", "--force")
    assert Path("r/summary.json").read_text() == "old"


def test_force_replaces_a_result_folder():
    Path("r").mkdir()
    for name in ("summary.json", "stale.png"):
        Path("r", name).write_text("old")
    assert cli("run", "engine", "--preset", "rigid", *SMALL[:1], "-o", "r", "--force").exit_code == 0
    assert {path.name for path in Path("r").iterdir()} == {"report.html", "results.csv", "results.nc", "scene.toml",
                                                         "summary.json"}  # fmt: skip
    assert [path.name for path in Path().iterdir()] == ["r"]


def test_force_does_not_replace_a_folder_of_other_things(monkeypatch):
    Path("r").mkdir()
    Path("r/thesis.txt").write_text("dear")
    monkeypatch.setattr("kaneflex.solve.loading.load", never)
    refused(cli("run", "engine", *SMALL, "-o", "r", "--force"), "no summary.json")
    assert Path("r/thesis.txt").read_text() == "dear"


@pytest.mark.parametrize("place", ["file/below", "file"])
def test_a_place_that_cannot_be_written_is_refused_before_anything_is_computed(monkeypatch, place):
    Path("file").write_text("")
    monkeypatch.setattr("kaneflex.solve.loading.load", never)
    refused(cli("run", "engine", *SMALL, "-o", place), f"{place}: can't be written (Not a directory)")
    assert [path.name for path in Path().iterdir()] == ["file"]


@pytest.mark.parametrize("failure", [KeyboardInterrupt, RuntimeError])
def test_a_run_that_fails_while_writing_leaves_the_old_folder_and_nothing_else(monkeypatch, failure):
    Path("r").mkdir()
    Path("r/summary.json").write_text("old")

    def to_netcdf(self, path):
        path.write_bytes(b"half")
        raise failure

    monkeypatch.setattr("kaneflex.support.labelled.Labelled.to_netcdf", to_netcdf)
    arguments = ("run", "engine", "--preset", "rigid", "--no-plots", "--force", "-o")
    if failure is KeyboardInterrupt:
        for folder in ("r", "new/deep"):
            result = cli(*arguments, folder)
            assert (result.exit_code, result.stderr) == (130, "Interrupted; nothing was left behind.\n")
    else:
        with pytest.raises(RuntimeError):
            cli(*arguments, "r")
    assert [path.name for path in Path().rglob("*")] == ["r", "summary.json"]
    assert Path("r/summary.json").read_text() == "old"


def test_a_folder_that_cannot_be_put_in_place_leaves_the_old_one(monkeypatch):
    Path("r").mkdir()
    Path("r/summary.json").write_text("old")
    rename, moved = Path.rename, []

    def second_fails(path, target):
        moved.append(path)
        if len(moved) == 2:
            raise PermissionError(13, "Permission denied")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", second_fails)
    refused(cli("run", "engine", "--preset", "rigid", "--no-plots", "--force", "-o", "r"), "Permission denied")
    assert [path.name for path in Path().rglob("*")] == ["r", "summary.json"]
    assert Path("r/summary.json").read_text() == "old"


def test_what_a_killed_process_left_goes_with_the_next_run_and_what_another_writes_stays():
    killed, other, alike = Path(".r.0123abcd"), Path(".r.89ab0123"), Path(".r.txt")
    beginning = Path(".r.99ab0123")  # of a run that has made its folder and not yet locked it
    for folder in (killed, other, alike, beginning):
        folder.mkdir()
        (folder / "results.nc").write_text("half")
    writing = _locked(other)  # as a run does that is not finished
    for folder in (killed, other, alike):
        os.utime(folder, (0, 0))
    with whole_folder(Path("r"), "summary.json") as folder:
        (folder / "summary.json").write_text("new")
    assert sorted(path.name for path in Path().iterdir()) == [other.name, beginning.name, alike.name, "r"]
    os.close(writing)


def test_an_old_folder_that_a_killed_process_did_not_put_back_returns():
    for folder in (Path(".r.0123abcd.old"), Path(".r.0123abcd")):
        folder.mkdir()
        (folder / "summary.json").write_text(folder.name)
        os.utime(folder, (0, 0))
    with pytest.raises(OutputError, match="the folder exists"), whole_folder(Path("r"), "summary.json"):
        pass
    assert Path("r/summary.json").read_text() == ".r.0123abcd.old"


@pytest.mark.parametrize(
    ("name", "stem"),
    [("../x", "_x"), ("", "scene"), ("a/b\\c", "a_b_c"), ("..", "scene"), (".hidden", "hidden"), ("Rod 5", "Rod 5")],
)
def test_results_stay_in_this_folder_whatever_the_scene_is_called(name, stem):
    Path("in").mkdir()
    Path("in/mine.toml").write_text(f"schema = 1\nlike = 'engine'\nname = '{name}'\n[solve]\npreset = 'rigid'\n")
    with contextlib.chdir("in"):
        assert cli("run", "mine.toml", "--no-plots").exit_code == 0
    assert sorted(path.name for path in Path("in").iterdir()) == sorted([f"{stem}-results", "mine.toml"])
    assert [path.name for path in Path().iterdir()] == ["in"]


def test_a_full_disk_is_an_error_with_the_folder_and_the_reason(monkeypatch):
    def to_netcdf(self, path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("kaneflex.support.labelled.Labelled.to_netcdf", to_netcdf)
    result = cli("run", "engine", "--preset", "rigid", "--no-plots", "-o", "r")
    refused(result, "r: can't be written (No space left on device)")
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupting_a_process_leaves_nothing(tmp_path, number):
    command = [sys.executable, "-m", "kaneflex", "run", "engine-transient", "--steps", "20000000", "-o", "r"]
    process = subprocess.Popen(
        command, cwd=tmp_path, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # ignored below a job with `&`
    )  # fmt: skip
    try:
        for line in process.stderr:
            if line.startswith("solving"):
                break
        process.send_signal(number)
        _, stderr = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130
    assert stderr.splitlines()[-1] == "Interrupted; nothing was left behind."
    assert list(tmp_path.iterdir()) == []


def test_interrupting_a_process_that_starts_is_no_traceback():
    """While it imports what a command line needs."""
    program = """
import sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "kaneflex.cli.scene":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
from kaneflex.cli import main
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "Interrupted; nothing was left behind.\n")


@pytest.mark.parametrize("command", [
    ("explore", "engine", "--vary", "rod.elements=1:8", "-o", "x.png"), ("trade", "engine", "-o", "t"),
    ("terms", "engine", "-o", "t"), ("compare", "engine", "-o", "c"), ("stability", "engine", "-o", "s"),
    ("modes", "engine"), ("export", "engine", "-o", "x.fmu"), ("run", "engine", "-o", "r"),
    ("derive", "engine", "-o", "x.py"), ("linearise", "engine", "-o", "x.npz"), ("check", "engine"),
], ids=lambda command: command[0])  # fmt: skip
def test_interrupted_commands_say_so_and_leave_nothing(command, monkeypatch):
    """While they compute; a sweep leaves what it goes on from."""

    def interrupt(*arguments, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr("kaneflex.solve.loading.resolve_options", interrupt)
    monkeypatch.setattr("kaneflex.multibody.model.module_loading.generate_text", interrupt)
    done = cli(*command)
    assert (done.exit_code, done.stderr.splitlines()[-1]) == (130, "Interrupted; nothing was left behind.")
    assert list(Path().iterdir()) == []


def test_a_motion_that_repeats_is_drawn_also_if_disturbances_of_it_grow(monkeypatch):
    """A strut that is pulsated at twice its own frequency."""
    unrendered(monkeypatch)
    result = cli("run", "pulsating-strut", "--set", "clock.speed=2517 rpm", "--set", "solve.modes=1", "--frames", 2,
                 "-o", "out")
    assert result.exit_code == 3 and "the result is the unstable periodic motion" in result.stderr, result.output
    assert Path("out/mechanism.png").exists() and "mechanism" in Path("out/report.html").read_text(encoding="utf-8")


def test_a_run_that_becomes_unstable_keeps_what_came_before_and_exits_with_3():
    """A rod of rubber: spin softening exceeds its stiffness."""
    result = cli("run", "engine-transient", "--no-plots", "--set", "rod.E=1e7", "-o", "r")
    assert result.exit_code == 3
    summary = Summary.model_validate_json(Path("r/summary.json").read_text())
    assert summary.outcome == "unstable" and 0 < summary.stored < summary.steps
    assert f"Stopped early: {summary.message}" in result.stderr and "at t = " in summary.message
    assert Path("r/results.nc").is_file()
    assert summary.warnings and "ValidityWarning" not in result.stderr
    assert all(result.stderr.count(f"Warning: {warning}\n") == 1 for warning in summary.warnings)


def test_a_run_without_a_periodic_state_has_a_summary_without_sensors():
    result = cli("run", "engine", "--no-plots", "--set", "rod.E=1e7", "-o", "r")
    assert result.exit_code == 3
    summary = Summary.model_validate_json(Path("r/summary.json").read_text())
    assert (summary.stored, summary.sensors) == (0, {}) and summary.floquet_multiplier_max > 1
    assert "1440 steps requested, none of them taken" in result.stdout and "over 0 s" not in result.stdout
    assert {path.name for path in Path("r").iterdir()} == {"report.html", "scene.toml", "summary.json"}
