"""Clearances of pins and guides in space: planar mechanisms turned at random, statics, impacts along the axis."""

import math
import re

import numpy as np
import pytest
from lifting import lifted
from parity import random_turn
from runs import solved
from scipy.integrate import solve_ivp
from test_spatial_contacts import LOOSE, estimated
from test_tangent_friction import RUBBED

from kaneflex import SceneError, load, scene_of, with_settings
from kaneflex.multibody.model.layout import STICKING
from kaneflex.plots.clearances import figures
from kaneflex.report.presentation import contact_line, parts
from kaneflex.response.dalembert import Balance
from kaneflex.response.section_forces import LinkForces
from kaneflex.solve.touching import eccentricity

FREE = """
schema = 1
description = "A shaft in its bearing, or a block in its guide"
gravity = GRAVITY
bodies.rider = {mass = 2, inertia = [1e-3, 4e-3, 5e-3], centre = CENTRE, ROTATION, free = {at = [0, 0, 0], MOVES}}
joints.seat = {KIND = ["ground", "rider"], AXIS, clearance = {CLEARANCE, contact = CONTACT}}
sensors.across = {position = "seat", component = "y"}
sensors.speed = {velocity = "rider", component = "x"}
solve = {preset = "coupled", duration = "TIME", steps = 400, tolerance = 1e-10}
"""
ROTOR = """
schema = 1
description = "An elastic shaft that turns in two bearings"
gravity = [0, 0, -9.81]
ground = {left = [0, 0, 0], right = [0.4, 0, 0]}
bodies.shaft = {length = 0.4, beam = {material = "steel", section = {circle = "16 mm"}, elements = 4}, free = {at = [0, 0, 0], angular_velocity = [100, 0, 0]}}
joints.left = {revolute = ["ground.left", "shaft.start"], axis = [1, 0, 0], clearance = {radial = "0.1 mm", length = "20 mm", axial = "0.2 mm", contact = CONTACT}}
joints.right = {cylindrical = ["ground.right", "shaft.end"], axis = [1, 0, 0], clearance = {radial = "0.1 mm", length = "20 mm", contact = CONTACT}}
sensors.height = {position = "left", component = "z"}
solve = {preset = "coupled", duration = "30 ms", steps = 300, modes = 2, tolerance = 1e-10}
""".replace("CONTACT", '{law = "kelvin-voigt", stiffness = "1e6 N/m", exponent = 1, damping = "500 N s/m"}')  # noqa: E501
STEEL = "materials=['steel', 'steel'], stiffness='none', exponent='none'"
GONE = "stiffness='none', exponent='none', damping='none'"
PIN = 'radial = "0.1 mm", radius = "10 mm", length = "60 mm"'
BLOCK = 'gap = "0.1 mm", length = "60 mm", height = "30 mm", breadth = "40 mm", normal = NORMAL'
DAMPED = '{law = "kelvin-voigt", stiffness = "2e6 N/m", exponent = 1, damping = "2000 N s/m"}'


def seated(turn, kind, clearance, contact, gravity=(0, 0, 0), moves=(0, 0, 0), spins=(0, 0, 0), centre=(0, 0, 0),
           time="0.2 s"):  # fmt: skip
    """Solution of a free rider whose seat has its axis along x, its vectors turned."""

    def turned(v):
        return (turn @ np.array(v, float)).tolist()

    text = FREE.replace("CLEARANCE", clearance).replace("CONTACT", contact).replace("TIME", time)
    given = {
        "GRAVITY": turned(gravity), "CENTRE": list(centre), "NORMAL": turned((0, 0, 1)),
        "ROTATION": f"rotation = {{x = {turned((1, 0, 0))}, y = {turned((0, 1, 0))}}}",
        "MOVES": f"velocity = {turned(moves)}, angular_velocity = {list(spins)}",
        "KIND": kind, "AXIS": f"{'direction' if kind == 'prismatic' else 'axis'} = {turned((1, 0, 0))}",
    }  # fmt: skip
    for key, value in given.items():
        text = text.replace(key, str(value))
    return solved(scene_of(text))


@pytest.mark.exhaustive(share=7)
@pytest.mark.parametrize("turn", "abcdefghijklmnopqrst")
@pytest.mark.parametrize(("text", "near"), [(LOOSE, 1e-5), (RUBBED, 5e-3)])
def test_a_pin_with_two_ends_hits_as_a_pin_in_the_plane(text, near, turn):
    """Both ends touch at once, each with half the stiffness.

    Friction acts at the surface of the bearing, in the plane at that of the pin, which is 0.1 % of its radius deeper.
    """
    text = text.replace("restitution = 0.9", "law = 'hertz'").replace("1e9 N/m^1.5", "1e11 N/m^1.5")
    flat = scene_of(text)
    lift = lifted(flat, random_turn(turn)) | {"solve": flat.raw["solve"]}
    ball = lift["joints"]["wrist"]
    law = ball["clearance"]["contact"] | {"stiffness": "5e10 N/m^1.5"}
    clearance = ball["clearance"] | {"contact": law, "length": "30 mm", "axial": "0.1 mm"}
    lift["joints"]["wrist"] = {"revolute": ball["spherical"], "axis": [0, 0, 1], "clearance": clearance}
    lift["sensors"] |= {"push": {"contact_force": "wrist_2"}, "drag": {"contact_force": "wrist_3"}}
    plane, space = solved(flat), solved(scene_of(lift))
    assert [each.outcome.name for each in (plane, space)] == 2 * ["COMPLETED"]
    assert len(space.impacts) == 2 * len(plane.impacts) >= 6
    for one, other in zip(space.impacts[::2], plane.impacts, strict=True):
        assert one.begin == pytest.approx(other.begin, rel=near)
        assert one.peak == pytest.approx(other.peak / 2, rel=10.0 * near, abs=1e-6 * other.peak)
    for sensor, share in (("slide", 1.0), ("torque", 1.0), ("push", 0.5)):
        apart = abs(space[sensor].values - share * plane[sensor].values)
        if "friction" not in text:
            assert apart.max() <= 2.0 * estimated(plane, space, sensor)  # which are of the size of rounding
    assert space["drag"].values.max() == 0.0
    assert space.trajectory.energy.drift < 1e-8


@pytest.mark.parametrize("turn", "abc")
@pytest.mark.parametrize("kind", ["revolute", "cylindrical"])
def test_a_pin_tilts_under_an_offset_load_as_statics_says(kind, turn):
    """Its ends bear the weight by the lever; both lie deeper than the clearance by their forces over the stiffness."""
    axial = ', axial = "1 mm"' if kind == "revolute" else ""
    found = seated(random_turn(turn), kind, PIN + axial, DAMPED, (0, 0, -9.81), centre=(0.02, 0, 0))
    assert found.outcome.name == "COMPLETED"
    forces = [2 * 9.81 * (0.5 - 0.02 / 0.06), 2 * 9.81 * (0.5 + 0.02 / 0.06)]
    for key, force in zip(("seat_1", "seat_2"), forces, strict=True):
        gap, push = found.motion.contact(key)
        assert push[-1] == pytest.approx(force, rel=1e-6)
        assert gap[-1] == pytest.approx(-force / 2e6, rel=1e-6)
    low = [1e-4 + force / 2e6 for force in forces]
    middle = random_turn(turn).T @ found.motion.clearance("seat")[:, -1]
    assert middle[1:] == pytest.approx([0.0, -sum(low) / 2], abs=1e-9)
    front = random_turn(turn).T @ (found.motion.clearance("seat_2") - found.motion.clearance("seat"))[:, -1]
    tilt = math.asin((low[1] - low[0]) / 0.06)
    assert front == pytest.approx([0.03 * math.cos(tilt), 0.0, -0.03 * math.sin(tilt)], abs=1e-9)


def test_a_pin_that_meets_one_edge_after_the_other_keeps_its_energy():
    """It shifts, tilts and spins in its bearing; without loss in the contacts the energy stays."""
    law = '{law = "hertz", stiffness = "2e9 N/m^1.5", exponent = 1.5}'
    found = seated(random_turn("d"), "revolute", f'{PIN}, axial = "0.2 mm"', law, moves=(0.1, 0.3, -0.1),
                   spins=(5.0, 2.0, 3.0), centre=(0.004, 1e-3, 0), time="50 ms")  # fmt: skip
    assert found.outcome.name == "COMPLETED"
    hits = [each.contact for each in found.impacts]
    assert min(hits.count(f"seat_{k}") for k in (1, 2, 3, 4)) >= 2
    assert found.trajectory.energy.drift < 1e-6


@pytest.mark.parametrize("turn", "ab")
def test_a_pin_bounces_between_the_faces_beside_its_bearing(turn):
    """Each impact takes the share e of its speed: it crosses the play of 1 mm in times that grow by 1/e."""
    law = '{law = "exact", stiffness = "1e8 N/m^1.5", restitution = 0.8}'
    found = seated(random_turn(turn), "revolute", f'{PIN}, axial = "0.5 mm"', law, moves=(0.5, 0, 0), time="40 ms")
    assert [each.contact for each in found.impacts][:4] == ["seat_4", "seat_3", "seat_4", "seat_3"]
    for k, each in enumerate(found.impacts[:4]):
        assert each.approach == pytest.approx(0.5 * 0.8**k, rel=1e-6)
        assert each.separation == pytest.approx(0.5 * 0.8 ** (k + 1), rel=1e-6)
        assert each.begin - (found.impacts[k - 1].end if k else 0.0) == pytest.approx(
            (1e-3 if k else 0.5e-3) / (0.5 * 0.8**k), rel=1e-5
        )


@pytest.mark.parametrize("turn", "abc")
def test_a_pin_slides_to_rest_in_its_bearing_and_stays(turn):
    """Both ends stick then, whichever way the bearing is turned. The pin has fallen through its clearance at first."""
    clearance = f"{PIN}, friction = {{mu = 0.2}}"
    found = seated(random_turn(turn), "cylindrical", clearance, DAMPED, (0, 0, -9.81), moves=(0.3, 0, 0))
    assert found.outcome.name == "COMPLETED" and (found.trajectory.frictions.mode[-1] == STICKING).all()
    along = (random_turn(turn).T @ found.motion.clearance("seat"))[0]
    assert along[-1] == pytest.approx(0.3**2 / (2 * 0.2 * 9.81), rel=2e-3)
    assert found["speed"].values[-40:] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.exhaustive(share=4)
@pytest.mark.parametrize("turn", "abcdefghij")
@pytest.mark.parametrize(("spins", "push"), [((3, 2, 1), 1.0), ((-2, 3, 1), -3.0)])
def test_a_block_that_rubs_on_two_faces_of_its_guide_comes_to_rest(spins, push, turn):
    """Where it sticks on the lower face, it can hardly move along the edge between both, wherever it rocks; a corner at
    its limit slips only if the other ones can't bear more."""
    clearance = f"{BLOCK}, friction = {{mu = 0.1}}".replace("0.1 mm", "0.2 mm")
    law = '{law = "hunt-crossley", stiffness = 1e7, exponent = 1.5, restitution = 0.3}'
    given = (0, push, -9.81), (0.1, 0, 0), spins, (0.01, 0.002, 0)
    found = seated(random_turn(turn), "prismatic", clearance, law, *given, time="0.15 s")
    assert found.outcome.name == "COMPLETED" and found.trajectory.energy.drift < 1e-7
    faces = found.trajectory.contacts.force[-1]
    assert (faces[12:] > 0.0).all() and found.trajectory.steps < 5000
    assert abs(found["speed"].values[-20:]).max() < 1e-6


BOX = """
schema = 1
description = "A box on feet that slides, turns and comes to rest"
gravity = GRAVITY
bodies.box = {mass = 2, inertia = [0.002, 0.004, 0.004], ROTATION, points = FEET, free = {at = START, MOVES}}
sensors.speed = {velocity = "box", component = "x"}
solve = {preset = "coupled", duration = "0.3 s", steps = 300, tolerance = 1e-8}
"""


@pytest.mark.parametrize("turn", "abc")
@pytest.mark.parametrize("places", [
    [(0.1, 0.0), (-0.1, 0.06), (-0.1, -0.06)], [(x, y) for x in (-0.1, 0.1) for y in (-0.05, 0.05)],
    [(0.1 * math.cos(a), 0.1 * math.sin(a)) for a in np.arange(5) * 0.4 * math.pi],
])  # fmt: skip
@pytest.mark.parametrize("moves", [(0.5, 0.0, 0.0), (0.5, 0.2, 1.0)])
def test_a_box_on_feet_slides_to_rest_and_all_feet_stick(moves, places, turn):
    """However many feet bear it, and however little each of them moves while the box still rocks."""
    turned, text = random_turn(turn), BOX
    law = '{law = "hunt-crossley", stiffness = 1e6, exponent = 1.5, restitution = 0.3}'
    for k in range(len(places)):
        text += f'contacts.f{k} = {{point_on_plane = ["box.f{k}", "ground"], normal = {(turned[:, 2]).tolist()}, '
        text += f"friction = {{mu = 0.3}}, contact = {law}}}\n"
    given = {
        "GRAVITY": (turned @ [0, 0, -9.81]).tolist(), "START": (turned @ [0, 0, 0.05]).tolist(),
        "FEET": "{" + ", ".join(f"f{k} = [{x}, {y}, -0.05]" for k, (x, y) in enumerate(places)) + "}",
        "ROTATION": f"rotation = {{x = {turned[:, 0].tolist()}, y = {turned[:, 1].tolist()}}}",
        "MOVES": f"velocity = {(turned @ [*moves[:2], 0]).tolist()}, "
        f"angular_velocity = {(turned @ [0, 0, moves[2]]).tolist()}",
    }  # fmt: skip
    for key, value in given.items():
        text = text.replace(key, str(value))
    found = solved(scene_of(text))
    assert found.outcome.name == "COMPLETED" and found.trajectory.energy.drift < 1e-7
    assert (found.trajectory.frictions.mode[-1] == STICKING).all()
    lost = found.trajectory.frictions.lost[-1].sum() + found.trajectory.contacts.lost[-1].sum()
    sunk = 2 * 9.81 * (2 * 9.81 / 1e6 / len(places)) ** (2 / 3)  # the feet's depth is a little uneven
    assert lost == pytest.approx(moves[0] ** 2 + moves[1] ** 2 + 0.002 * moves[2] ** 2 + 0.6 * sunk, rel=2e-3)


@pytest.mark.parametrize("turn", "abc")
def test_a_block_rests_on_four_corners_as_statics_says(turn):
    found = seated(random_turn(turn), "prismatic", BLOCK, DAMPED, (0, 0, -9.81), centre=(0.01, 0.004, 0))
    assert found.outcome.name == "COMPLETED"
    forces = {key: found.motion.contact(key)[1][-1] for key in found.trajectory.contacts.names}
    below = [forces.pop(f"seat_{k}") for k in (13, 14, 15, 16)]  # left rear, left front, right rear, right front
    assert max(forces.values()) == 0.0 and sum(below) == pytest.approx(2 * 9.81, rel=1e-6)
    left, front = below[0] + below[1], below[1] + below[3]
    assert left == pytest.approx(2 * 9.81 * (0.5 + 0.004 / 0.04), rel=1e-4)  # its centre is above the faces
    assert front == pytest.approx(2 * 9.81 * (0.5 + 0.01 / 0.06), rel=1e-4)


BALLS = """
schema = 1
description = "Balls that touch each other and a pipe"
gravity = GRAVITY
ground.pipe = [0, 0, 0]
bodies.a = {mass = 0.5, inertia = [J, J, J], free = {at = A, velocity = V}}
bodies.b = {mass = 0.5, inertia = [J, J, J], free = {at = B}}
contacts.hit = {circle_on_circle = ["a", "b"], radii = ["20 mm", "30 mm"], contact = LAW}
[contacts.pipe]
circle_in_circle = ["b", "ground.pipe"]
radii = ["20 mm", "120 mm"]
axis = AXIS
contact = LAW
FRICTION
[sensors]
a_x = {velocity = "a", component = "x", axes = "global"}
a_y = {velocity = "a", component = "y", axes = "global"}
a_z = {velocity = "a", component = "z", axes = "global"}
[solve]
preset = "coupled"
duration = "TIME"
steps = 1000
tolerance = 1e-10
"""


def balls(turn, law, friction="", time="20 ms", **vectors):
    """Scene of two balls, their vectors turned."""
    text = BALLS.replace("FRICTION", friction).replace("LAW", law).replace("TIME", time).replace("J", "8e-5")
    given = {"gravity": (0, 0, 0), "a": (0, 0, 0.5), "v": (0, 0, 0), "b": (0, 0, 0), "axis": (1, 0, 0)} | vectors
    for key, value in given.items():
        text = re.sub(rf"= {key.upper()}\b", f"= {(turn @ np.array(value, float)).tolist()}", text)
    return scene_of(text)


@pytest.mark.parametrize("turn", "abcd")
def test_a_ball_is_deflected_by_another_one_as_a_point_by_a_central_force(turn):
    """Independent integration of the vector between their centres, whose reduced mass is half that of a ball; the
    centre of both goes on."""
    stiffness, speed = 1e7, np.array([0.0, 0.0, -2.0])
    start = 0.05 * np.array([math.sin(0.5), 0.0, math.cos(0.5)])  # where they touch first, from the second one's centre

    def rates(_, y):
        length = np.hypot(*y[:2])
        return [*y[2:], *(stiffness * max(0.05 - length, 0.0) ** 1.5 / 0.25 / length * y[:2])]

    apart = solve_ivp(rates, (0.0, 0.01), [*start[::2], *speed[::2]], "DOP853", rtol=1e-13, atol=1e-13).y[2:, -1]
    law = f'{{law = "hertz", stiffness = {stiffness}, exponent = 1.5}}'
    found = solved(balls(random_turn(turn), law, a=start - 2e-3 * speed, v=speed))
    assert [each.contact for each in found.impacts] == ["hit"]
    after = random_turn(turn).T @ [found[f"a_{axis}"].values[-1] for axis in "xyz"]
    assert after == pytest.approx(0.5 * (speed + np.array([apart[0], 0.0, apart[1]])), abs=1e-8)


@pytest.mark.parametrize("turn", "abc")
def test_a_ball_rolls_in_a_pipe_with_the_period_of_a_solid_sphere(turn):
    """T = 2 pi sqrt(7 (R - r)/(5 g)) (1 + a^2/16) for a swing of a small angle a; J is 2/5 m r^2."""
    law = '{law = "kelvin-voigt", stiffness = 1e7, exponent = 1, damping = "1000 N s/m"}'
    start = 0.1 * np.array([0.0, math.sin(0.05), -math.cos(0.05)])
    moving = {"gravity": (0, 0, -9.81), "a": (3, 0, 20), "b": start}
    found = solved(balls(random_turn(turn), law, "friction = {mu = 0.5}", "1.5 s", **moving))
    place = random_turn(turn).T @ found.motion.clearance("pipe")
    rises = np.flatnonzero((place[1, :-1] < 0.0) & (place[1, 1:] >= 0.0))
    zeros = [np.interp(0.0, place[1, k : k + 2], found.times[k : k + 2]) for k in rises]
    period = 2 * math.pi * math.sqrt(7 * 0.1 / (5 * 9.81)) * (1 + 0.05**2 / 16)
    assert zeros[1] - zeros[0] == pytest.approx(period, rel=2e-4)
    assert np.degrees(np.arctan2(place[1], -place[2])).max() == pytest.approx(np.degrees(0.05), rel=1e-3)


def test_what_balls_in_space_can_t_be_is_refused():
    scene = balls(np.eye(3), "{law = 'hertz', stiffness = 1e7, exponent = 1.5}")
    assert parts(scene)["contacts"]["hit"].startswith("spheres about ")
    for settings, message in (
        (f"contacts.hit={{width='2 mm', contact={{{STEEL}, load=1}}}}",
         r"contacts\.hit\.width = '2 mm': only planar cylinders have a width"),
        ("contacts.hit.axis=[1, 0]", r"two components, where "),
        (f"contacts.pipe.contact={{{STEEL}}}",
         r"contacts\.pipe\.contact: Hertz's theory of spheres does not apply to cylinders\. Give contact\.stiffness"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=message):
            load(with_settings(scene, (settings,)))


def test_results_name_what_touches_and_the_picture_shows_both_ends(tmp_path):
    """The eccentricity is that of the end that is farther away from the axis."""
    found = seated(np.eye(3), "revolute", f'{PIN}, axial = "1 mm"', DAMPED, (0, 0, -9.81), centre=(0.02, 0, 0))
    deepest = max(found.motion.contact(f"seat_{k}")[0][-1] * -1 for k in (1, 2))
    assert eccentricity(found, "seat")[-1] == pytest.approx(1.0 + deepest / 1e-4)
    data = found.dataset
    assert data["clearance_z"].values[-1, 0] == pytest.approx(found.motion.clearance("seat")[2, -1])
    lines = [contact_line(contact) for contact in found.model.scene.contacts.values()]
    assert "end of rider.start in the bearing ground.origin, clearance 0.1 mm" in lines[0]
    assert "rider.start at a face beside ground.origin, clearance 1 mm" in lines[3]
    (figure,) = figures(found).values()
    path = next(axes for axes in figure.axes if axes.get_title().startswith("Path"))
    labels = [line.get_label() for line in path.lines]
    assert labels.count("in contact") == 2 and {"path of the rear end", "path of the front end"} <= {*labels}
    ends = {line.get_label(): line.get_ydata() for line in path.lines}
    assert ends["path of the front end"][-1] == pytest.approx(-0.1 - 1e3 * deepest, abs=1e-9)


@pytest.mark.parametrize("friction", ["", ', radius = "8 mm", friction = {mu = 0.2}'])
def test_a_rotor_of_an_elastic_shaft_runs_in_two_bearings(friction):
    """A pin's ends move with the section of its joint. All forces of contacts and friction, at the arms of the pins'
    ends and surfaces, balance the shaft's inertia."""
    found = solved(scene_of(ROTOR.replace('length = "20 mm"', f'length = "20 mm"{friction}')))
    assert found.outcome.name == "COMPLETED"
    assert {each.contact for each in found.impacts} >= {"left_1", "left_2", "right_1", "right_2"}
    assert found.trajectory.energy.drift < 1e-7
    moving = found.motion.moving
    forces = list(LinkForces(moving.mechanism, moving).wrenches("shaft"))
    left_over = Balance(moving, "shaft", lambda: forces)._gap  # of its equilibrium, of third order in the deflection
    assert abs(forces[-1].about_start).max() > 1.0
    assert abs(left_over[:3]).max() < 5e-8 and abs(left_over[3]).max() < 2e-6 and abs(left_over[4:]).max() < 1e-4


@pytest.mark.parametrize(("settings", "message"), [
    ("length=none", r"clearance\.length: a pin in space needs it\. Give it, like length = '20 mm'"),
    ("axial=none", r"clearance\.axial: a pin in space needs it\. "),
    ("axial=0", r"clearance\.axial = 0: "),
    ("breadth=4 mm", r"clearance\.breadth = '4 mm': does not apply to a radial clearance"),
    ("width=4 mm", r"clearance\.width = '4 mm': a pin in space has no width"),
    (f"contact={{law='hertz', materials=['steel', 'steel'], {GONE}}}",
     r"clearance\.contact: Hertz's theory does not apply to ends and corners\. Give contact\.stiffness"),
])  # fmt: skip
def test_what_a_loose_pin_in_space_can_t_be_is_refused(settings, message):
    with pytest.raises(SceneError, match=rf"joints\.left\.{message}"):
        load(with_settings(scene_of(ROTOR), (f"joints.left.clearance.{settings}",)))


@pytest.mark.parametrize(("settings", "message"), [
    ("normal=none", r"clearance\.normal: the block of a guide in space needs it\. Give it, like normal = \[0, 1, 0\]"),
    ("height=0", r"clearance\.height = 0: the block of a guide in space needs it"),
    ("normal=[1, 0, 1]", r"clearance\.normal = .*: not perpendicular to the guide"),
    ("axial=1 mm", r"clearance\.axial = '1 mm': does not apply to a gap clearance"),
])  # fmt: skip
def test_what_a_loose_block_in_space_can_t_be_is_refused(settings, message):
    clearance = f"{{{BLOCK}, contact = {DAMPED}}}".replace("NORMAL", "[0, 0, 1]")
    joint = f'{{prismatic = ["ground.rail", "block"], direction = [1, 0, 0], clearance = {clearance}}}'
    block = 'bodies.block = {mass = 1, inertia = [1e-3, 1e-3, 1e-3], free = {at = [1, 0, 0]}}'
    text = ROTOR.replace("right = [0.4, 0, 0]}", "right = [0.4, 0, 0], rail = [1, 0, 0]}")
    scene = scene_of(text.replace("joints.left", f"{block}\njoints.guide = {joint}\njoints.left"))
    with pytest.raises(SceneError, match=rf"joints\.guide\.{message}"):
        load(with_settings(scene, (f"joints.guide.clearance.{settings}",)))


def test_pins_have_no_length_in_the_plane():
    with pytest.raises(SceneError, match=r"wrist\.clearance\.length = '9 mm': a pin in the plane has none"):
        with_settings(scene_of(LOOSE), ("joints.wrist.clearance.length=9 mm",))
