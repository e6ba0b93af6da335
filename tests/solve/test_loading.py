"""Loading binds a scene and integrates nothing; a run does, with progress, and can be interrupted."""

import numpy as np
import pytest
from command_line import cli
from runs import model

import kaneflex
from kaneflex import SceneError, load, read_scene, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.time.run import Run
from kaneflex.solve.simulation import solve

BLADE = ("swept-blade", "solve.preset=coupled", "solve.start=zero", "solve.duration=2 ms", "solve.steps=8")
SWINGS = ("elastic-pendulum", "solve.preset=stiffened", "solve.duration=0.1 s", "solve.steps=400")
FREE = ["double-pendulum", "engine-torque", "four-bar-motor", "bricard", "spatial-slider-crank", "spinning-top"]
TOP = ("spinning-top", "solve.duration=0.02 s")


@pytest.fixture
def started(monkeypatch):
    """Runs that were started."""
    found, go = [], Run.go
    monkeypatch.setattr(Run, "go", lambda run, *given: found.append(run) or go(run, *given))
    return found


@pytest.mark.parametrize("name", FREE)
def test_loading_a_scene_with_free_joints_integrates_nothing(name, started):
    load(read_scene(name))
    assert started == []


@pytest.mark.parametrize("scene", [BLADE, SWINGS, TOP], ids=lambda scene: scene[0])
def test_a_run_integrates_once(scene, started):
    given = load(with_settings(read_scene(scene[0]), scene[1:]))
    assert started == [] and given.energy is None
    first = solve(given)
    assert len(started) == 1 and first.energy is not None
    second = solve(given)
    for name, series in first.series.items():
        assert np.array_equal(series.values, second.series[name].values)


@pytest.mark.parametrize("command", ["check", "modes", "show"])
def test_commands_do_not_integrate_a_coupled_run_in_space(command, started, tmp_path):
    more = ["-o", str(tmp_path / "blade.png")] if command == "show" else []
    result = cli(command, "swept-blade", "--set", "solve.preset=coupled", *more)
    assert result.exit_code == 0, result.stderr
    assert started == []


@pytest.mark.parametrize("scene", [BLADE, SWINGS, TOP], ids=lambda scene: scene[0])
def test_a_run_can_be_interrupted(scene):
    def stop(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve(load(with_settings(read_scene(scene[0]), scene[1:])), stop)


@pytest.mark.parametrize("scene", [SWINGS, TOP], ids=lambda scene: scene[0])
def test_a_loaded_model_does_not_guess_the_motion_of_free_joints(scene):
    given, t = model(*scene), 0.01
    with pytest.raises(SceneError, match=r"t = 0\.01: a loaded model knows the motion of free joints at t = 0 only"):
        given.motion.at(t)
    moved = kaneflex.simulate(given).model
    assert np.isfinite(moved.motion.at(t).values).any()
    for name, *_ in given.module.SCALARS:
        start, same = (each.motion.at(0.0)[name] for each in (given, moved))
        assert start == pytest.approx(same, rel=1e-9, abs=1e-9, nan_ok=True), name


SCENES = [
    ("engine", ()),
    ("engine", ("solve.preset=coupled",)),
    ("spatial-slider-crank", ()),
    ("spatial-slider-crank-elastic", ()),
    ("spatial-slider-crank-elastic",
     ("solve.preset=coupled", "solve.start=zero", "solve.duration=1 ms", "solve.steps=2")),
]  # fmt: skip


@pytest.mark.parametrize(("scene", "settings"), SCENES)
def test_every_motion_has_a_table_without_rows(scene, settings):
    motion = model(scene, *settings).motion
    there, none = motion.at(np.zeros(1)), motion.at(np.zeros(0))
    assert none.values.shape == (0, there.values.shape[1])


def test_a_one_way_run_in_space_that_finds_no_cycle_says_so():
    """At 3,000 rad/s the stiffness by the axial forces is lost in each cycle: no periodic motion is found."""
    scene = with_settings(read_scene("spatial-slider-crank-elastic"), ["shaft.speed=3000 rad/s", "solve.steps=90"])
    found = solve(load(scene))
    assert found.outcome is not Outcome.COMPLETED and found.message and len(found.times) == 0
    assert all(len(each.values) == 0 for each in found.series.values())
    assert isinstance(found.warnings, tuple)
