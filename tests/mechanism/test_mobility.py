"""What joints and drives leave open, hold twice or can't do with elastic links is named before anything is derived."""

import numpy as np
import pytest
from runs import solved

from kaneflex import SceneError, load, scene_of
from kaneflex.multibody.model import module_loading

THREE_CRANKS = """
schema = 1
ground = {b = ["200 mm", 0], c = ["400 mm", 0]}
bodies.crank = {length = "50 mm", mass = "0.1 kg"}
bodies.second = {length = "50 mm", mass = "0.1 kg"}
bodies.third = {length = "50 mm", mass = "0.1 kg"}
bodies.bar = {length = "400 mm", mass = "0.3 kg"}
joints.main = {revolute = ["ground", "crank.start"]}
joints.near_pin = {revolute = ["crank.end", "bar.start"]}
joints.middle_pin = {revolute = ["bar.mid", "second.end"]}
joints.middle = {revolute = ["ground.b", "second.start"]}
joints.far_pin = {revolute = ["bar.end", "third.end"]}
joints.far = {revolute = ["ground.c", "third.start"]}
drives.main = {speed = "60 rpm", cycle = "360 deg"}
"""
TWO_GUIDES = """
schema = 1
bodies.cart = {length = "400 mm", mass = "1 kg"}
joints.left = {prismatic = ["ground", "cart.start"], direction = [1, 0]}
joints.right = {prismatic = ["ground", "cart.end"], direction = [1, 0]}
drives.left = {speed = "1 m/s"}
solve.duration = "1 s"
"""
HANGING = """
schema = 1
bodies.crank = {length = "50 mm", mass = "0.1 kg"}
bodies.tail = {length = "50 mm", mass = "0.1 kg"}
joints.main = {revolute = ["ground", "crank.start"]}
joints.swing = {revolute = ["crank.end", "tail.start"]}
drives.main = {speed = "60 rpm", cycle = "360 deg"}
"""
CARRIED_RHOMBUS = """
schema = 1
bodies.arm = {length = "300 mm", beam = {material = "steel", A = "100 mm^2", I = "2000 mm^4"}}
bodies.a = {length = "200 mm", mass = "1 kg"}
bodies.b = {length = "200 mm", mass = "1 kg"}
bodies.c = {length = "200 mm", mass = "1 kg"}
bodies.d = {length = "200 mm", mass = "1 kg"}
joints.main = {revolute = ["ground", "arm.start"]}
joints.grip = {weld = ["arm.end", "a.start"]}
joints.ab = {revolute = ["a.end", "b.start"]}
joints.opening = {revolute = ["a.start", "d.start"]}
joints.dc = {revolute = ["d.end", "c.start"]}
joints.bc = {revolute = ["b.end", "c.end"]}
drives.main = {law = "0.6 + 0.1 * sin(2 * t)"}
drives.opening = {law = "1.0 + 0.1 * sin(2 * t)"}
solve.duration = "1 s"
"""


@pytest.fixture
def nothing_is_derived(monkeypatch):
    def derive(*_):
        raise AssertionError("derived")

    monkeypatch.setattr(module_loading, "generate_text", derive)


def refused(text: str) -> str:
    with pytest.raises(SceneError) as error:
        load(scene_of(text))
    return str(error.value)


@pytest.mark.parametrize(("scene", "drive", "said"), [
    ("four-bar", 'rocker = {speed = "10 rpm"}', "drives.rocker: a constraint too many (redundant"),
    ("engine", 'bore = {speed = "1 m/s"}', "drives.bore: a constraint too many (redundant"),
    ("engine", 'wrist = {law = "0.1 * sin(t)"}', "(redundant with other joints and drives): wrist by its drive;"),
])  # fmt: skip
def test_two_drives_on_one_freedom(nothing_is_derived, scene, drive, said):
    start = 'solve = {start = "zero", duration = "0.1 s"}'
    assert said in refused(f'schema = 1\nlike = "{scene}"\ndrives.{drive}\n{start}\n')


def test_redundant_joints(nothing_is_derived):
    """A third crank of equal length would let the bar move, but not hold it any better: by count it locks."""
    redundant = "(redundant with other joints and drives):"
    assert f"a constraint too many {redundant} far across y;" in refused(THREE_CRANKS)
    assert f"2 constraints too many {redundant} right across its guide and in rot" in refused(TWO_GUIDES)


def test_what_nothing_drives(nothing_is_derived):
    assert "nothing determines the motion of tail;" in refused(HANGING)


def test_rigid_bodies_that_elastic_ones_can_not_carry_name_the_preset_that_can(nothing_is_derived):
    said = refused(CARRIED_RHOMBUS)
    assert "connect it to rigid bodies that move apart as links deform" in said and "Use preset coupled" in said


TWO_AT_A_POINT = """
schema = 1
bodies.arm = {length = "300 mm", beam = {material = "steel", section = {circle = "10 mm"}}}
bodies.a = {length = "200 mm", mass = "1 kg"}
bodies.b = {length = "200 mm", mass = "1 kg"}
joints.main = {revolute = ["ground", "arm.start"]}
joints.first = {revolute = ["arm.end", "a.start"]}
joints.second = {revolute = ["arm.end", "b.start"]}
drives.main = {law = "0.6 + 0.1 * sin(2 * t)"}
drives.first = {law = "0"}
drives.second = {law = "1"}
solve = {duration = "1 s", steps = 20}
"""


def test_two_rigid_bodies_at_one_point_of_a_link():
    """Joined to the link, or the second one to the first at the same point: the motion is the same."""
    apart = scene_of(TWO_AT_A_POINT)
    joined = scene_of(TWO_AT_A_POINT.replace('["arm.end", "b.start"]', '["a.start", "b.start"]'))
    one, other = solved(apart), solved(joined)
    for at in ((0.0, 0.0), (0.2, 0.0)):
        moved = one.motion.displacement("a", at)[0]
        assert abs(moved).max() > 1e-6
        assert other.motion.displacement("a", at)[0] == pytest.approx(moved, abs=1e-9 * abs(moved).max())


HUB = """
schema = 1
gravity = [0, -9.81]
bodies.arm = {length = 1, beam = {material = "steel", A = 1e-4, I = 1e-9, elements = 2}}
bodies.hub = {mass = 1, inertia = 0.01}
joints.pivot = {revolute = ["ground", "arm.start"]}
joints.fix = {weld = ["arm.start", "hub"]}
drives.pivot = {speed = "10 rad/s", cycle = "360 deg"}
sensors.base = {displacement = "arm.start", component = "y"}
solve = {preset = "linear", start = "zero", duration = 0.1, steps = 10}
"""


def test_a_rigid_body_on_a_pivoted_end_of_a_link_stays_there():
    found = solved(scene_of(HUB))
    assert not [name for name in found.model.coordinates if name.startswith("hub")]
    assert not found["base"].values.any()


def test_a_free_drive_beside_another_one_in_a_larger_loop(nothing_is_derived):
    said = refused("""
schema = 1
like = "six-bar"
bodies.tail = {length = "50 mm", mass = "0.1 kg"}
joints.hook = {revolute = ["ground", "tail.start"]}
drives.hook = {free = true}
solve = {start = "zero", duration = "0.05 s"}
""")
    assert "drives.hook" in said and "a free drive must be the only drive" in said and "of more than two bodies" in said


BOOM = """
schema = 1
gravity = [0, "-9.81 m/s^2"]
ground = {foot = ["400 mm", 0]}
bodies.boom = {length = "1 m", points = {lug = ["500 mm", 0]}}
bodies.tube = {}
bodies.stem = {}
bodies.jib = {length = "1 m", beam = {E = "2e14 Pa", rho = 7850, A = "400 mm^2", I = "13333 mm^4"}}
joints.heel = {revolute = ["ground", "boom.start"]}
joints.eye = {revolute = ["ground.foot", "tube"]}
joints.stroke = {prismatic = ["tube", "stem"], direction = [1, 0]}
joints.lug = {revolute = ["stem", "boom.lug"], near = {boom = "35 deg"}}
joints.root = {weld = ["boom.end", "jib.start"]}
drives.stroke = {speed = 0, position = "300 mm"}
sensors.push = {drive_force = "stroke"}
sensors.root_moment = {joint_force = "root", component = "angle"}
sensors.heel_x = {joint_force = "heel", component = "x"}
solve = {preset = "quasistatic", duration = "1 s", steps = 2}
"""


def test_a_cylinder_raises_a_boom_with_an_elastic_jib():
    """Three rigid bodies that one drive places: a triangle of 400, 500 and 300 mm, and the jib's weight on the boom.

    cos phi = 0.8 at the heel, a right angle at the eye: the cylinder stands upright below the lug, with the weight
    m g at 1.5 m along the boom and its own lever of 0.4 m.
    """
    series = solved(scene_of(BOOM)).series
    weight = 7850 * 400e-6 * 9.81
    assert series["push"].values == pytest.approx(np.full(3, weight * 1.5 * 0.8 / 0.4), rel=1e-5)
    assert abs(series["root_moment"].values) == pytest.approx(np.full(3, weight * 0.5 * 0.8), rel=1e-5)
    assert abs(series["heel_x"].values).max() < 1e-5 * weight

