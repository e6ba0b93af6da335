"""Free joints that can't start or go on: the error names joint, place and cure, and comes at once."""

import math
import re

import pytest
from runs import model

from kaneflex import load, scene_of
from kaneflex.solve.loading import integrated
from kaneflex.support.errors import SceneError

RIGID = ("four-bar-motor", "solve.preset=rigid", "coupler.length=100 mm")
GROUND, CRANK, COUPLER, ROCKER = 0.254, 0.108, 0.100, 0.2705
LIMIT = 360 - math.degrees(math.acos((GROUND**2 + CRANK**2 - (ROCKER - COUPLER) ** 2) / (2 * GROUND * CRANK)))
"""Where coupler and rocker fold onto each other (law of cosines), on the way round [deg]."""


@pytest.fixture(autouse=True)
def few_evaluations(monkeypatch):
    """All of this is known long before the budget of evaluations is spent."""
    monkeypatch.setattr("kaneflex.multibody.time.run._MOST", 100_000)


@pytest.mark.parametrize("preset", ["rigid", "stiffened", "coupled"])
def test_a_free_crank_that_does_not_close_where_it_starts(preset):
    with pytest.raises(SceneError) as error:
        model("four-bar-motor", f"solve.preset={preset}", "coupler.length=100 mm", "main.angle=10 deg")
    said = (
        "the loop cannot close: at main = 10 deg ground and follower do not meet. Change the lengths, or let main "
        "start elsewhere."
    )
    if preset == "coupled":
        said = (
            "the loop cannot close at main = 10 deg: coupler, follower. "
            "Change the lengths, or the positions of its drives."
        )
    assert str(error.value) == f"joints.rocker.branch = '+': {said}"


@pytest.mark.parametrize(("settings", "said"), [
    (["rod.length=110 mm"], "joints.guide.branch = '+': the loop cannot close at main = "),
    (["rod.length=150 mm"], "joints"),
])  # fmt: skip
def test_a_driven_crank_that_does_not_come_around(settings, said):
    """By the engine's own loops: where it stops, and a change point, at which it can't tell how it goes on."""
    with pytest.raises(SceneError, match=re.escape(said)):
        model("slider-crank-150-coupled", *settings)


@pytest.mark.exhaustive
@pytest.mark.parametrize("branch", "+-")
def test_a_linkage_that_swings_into_its_limit(branch):
    """Both branches fold at the same crank angle."""
    settings = ("main.angle=60 deg", "solve.duration=0.6 s", f"rocker.branch={branch}", "solve.forward.tolerance=1e-7")
    with pytest.raises(SceneError) as error:
        integrated(model(*RIGID, *settings))
    text = str(error.value)
    assert text.startswith("joints.rocker: the linkage reaches a dead centre at t = 0.2")
    assert float(re.search(r"main = ([\d.]+) deg", text).group(1)) == pytest.approx(LIMIT, abs=0.05)
    assert "ground and follower do not meet" in text and "preset coupled" in text
    assert "rod" not in text and "guide" not in text


def test_a_link_without_mass_is_named():
    with pytest.raises(SceneError) as error:
        model("double-pendulum", "lower.mass=none")
    assert str(error.value) == (
        "drives.elbow: the mass matrix is singular: elbow.angle carries no inertia. Give the bodies that move with it "
        "a mass and an inertia, however small, or prescribe it."
    )


@pytest.mark.parametrize("angle", ["30 deg", "-75 deg", "30.123 deg"])  # the last between two samples
def test_a_parallelogram_that_passes_its_change_point_is_singular_there(angle):
    """It closes there, but for rounding, also where no sample is."""
    lengths = {"crank": "50 mm", "coupler": "150 mm", "rocker": "50 mm"}
    scene = scene_of({
        "schema": 1, "ground": {"far": ["150 mm", 0]},
        "bodies": {name: {"length": length, "mass": "0.1 kg"} for name, length in lengths.items()},
        "joints": {
            "main": {"revolute": ["ground", "crank"]}, "p": {"revolute": ["crank.end", "coupler"]},
            "q": {"revolute": ["coupler.end", "rocker.end"]}, "r": {"revolute": ["ground.far", "rocker"]},
        },
        "drives": {"main": {"speed": "300 rpm", "angle": angle}},
        "sensors": {"torque": {"drive_torque": "main"}},
        "solve": {"preset": "rigid", "duration": "0.2 s", "steps": 720},
    })  # fmt: skip
    with pytest.raises(SceneError, match="singular position"):
        load(scene)
