"""Spatial slider-crank with a ball that is loose in its socket, rigid and with an elastic rod, against Exudyn.

Exudyn: rigid bodies with Euler parameters or geometrically exact beams with constant strains, joints by multipliers,
ObjectContactSphereSphere with a hollow sphere, generalised-alpha in fixed steps, which do not end where sides touch.
"""

import math

import numpy as np
import pytest
from runs import solved
from test_spatial_contacts import BALL_CRANK

from kaneflex import SceneError, compare, scene_of, with_settings
from kaneflex.solve.curves import Resolution
from kaneflex_peers.buildable import check_buildable

HERTZ = '{law = "hertz", stiffness = "1e9 N/m^1.5"}'
LOSSY = '{law = "hunt-crossley", restitution = 0.7, stiffness = "1e9 N/m^1.5"}'
SENSORS = (
    *(f"sensors.{axis}={{position='rod.end', component='{axis}'}}" for axis in "xyz"),
    "sensors.speed={velocity='slider', component='x'}", "sensors.push={joint_force='bore', component='z'}",
)  # fmt: skip

BOTH_ENDS = (
    "drives.pin=none", "joints.pin={spherical=['crank.end', 'rod.start'], universal='none', axes='none', "
    f"clearance={{radial='0.1 mm', radius='6 mm', contact={HERTZ}}}}}",
    f"bodies.rod.free={{at=[0.05, 0, 0], velocity=[0, {math.pi}, 0], angular_velocity=[0, 0, {-math.pi / 0.12}]}}",
)  # fmt: skip
"""Settings that release the rod's other end, too, whose speed is that of the crank's end; the slider rests."""


def loose(law, duration, *settings):
    """Slider-crank without the sensors of its contact, which are not read in Exudyn."""
    contact = (f"sensors.{name}=none" for name in ("room", "push", "height"))
    scene = with_settings(scene_of(BALL_CRANK.replace("CONTACT", law)), list(contact))
    return with_settings(scene, [*SENSORS, f"solve.duration={duration}", *settings])


def differences(scene, steps, elements=None):
    """Largest difference of each sensor from Exudyn, and the largest value there."""
    found = compare(scene, peer="exudyn", resolution=Resolution(elements, steps)).curves
    ours, theirs = found["coupled"], found["exudyn"]
    return {name: (abs(np.interp(theirs.times, ours.times, ours.values[name]) - values).max(), abs(values).max())
            for name, values in theirs.values.items()}  # fmt: skip


@pytest.mark.exhaustive(group="loose", share=2)
@pytest.mark.parametrize(("law", "settings", "impacts", "near"), [
    (HERTZ, (), 4, 2e-9), (LOSSY, (), 3, 1e-7), (HERTZ, BOTH_ENDS, 6, 1.5e-8),
], ids=["hertz", "lossy", "both ends"])  # fmt: skip
def test_a_loose_ball_in_space(peer, law, settings, impacts, near):
    """The clearance is 0.1 mm. What is left falls with Exudyn's step, by Hertz's law with its square; Hunt and
    Crossley's needs the approach speed, which Exudyn takes from the step before."""
    peer("exudyn")
    scene = loose(law, "5 ms", *settings)
    assert len(solved(scene).impacts) == impacts
    found = differences(scene, 10_000)
    assert set(found) == {"slide", "x", "y", "z", "speed", "push"}
    assert all(found[name][0] < near for name in ("slide", "x", "y", "z"))
    assert found["speed"][0] < 4e3 * near and found["push"][0] < 2e-3 * found["push"][1]


@pytest.mark.exhaustive(group="loose", share=2)
def test_a_loose_ball_of_an_elastic_rod_in_space(peer, exhaustive):
    """What is left falls with the square of the size of Exudyn's elements."""
    peer("exudyn")
    beam = "{material='steel', section={circle='6 mm'}, theory='timoshenko', elements=8}"
    elastic = ["bodies.rod.mass=none", "bodies.rod.inertia=none", f"bodies.rod.beam={beam}", "solve.modes=8"]
    scene = loose(HERTZ, "3 ms", *elastic)
    fine = differences(scene, 4000, 16)
    assert fine["slide"][0] < 1e-6 and fine["push"][0] < 0.02 * fine["push"][1]
    if exhaustive:
        coarse = differences(scene, 4000, 8)
        assert all(3 * fine[name][0] < coarse[name][0] for name in ("slide", "x", "y", "z", "speed", "push"))


@pytest.mark.parametrize(("law", "settings", "named"), [
    ('{law = "flores", restitution = 0.7, stiffness = "1e9 N/m^1.5"}', [], "joints.ball.clearance.contact.law"),
    (HERTZ, ["joints.ball.clearance.friction={mu=0.1}"], "joints.ball.clearance.friction"),
])  # fmt: skip
def test_contacts_without_a_counterpart(law, settings, named):
    with pytest.raises(SceneError) as refused:
        check_buildable(loose(law, "5 ms", *settings))
    assert [problem.key for problem in refused.value.problems] == [named]
