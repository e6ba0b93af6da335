"""Motions at no instant at all, as runs have them that stop before their first one."""

import numpy as np
import pytest
from runs import model

from kaneflex import load, read_scene, with_settings
from kaneflex.integrate.outcome import Outcome
from kaneflex.solve.simulation import solve

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
