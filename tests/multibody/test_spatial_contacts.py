"""Contacts and friction in space: planar scenes lifted and turned at random, closed forms, and what is refused."""

import math

import numpy as np
import pytest
from lifting import lifted
from machines import BALL_ON_PLANE, changed, machine
from parity import planar, random_turn
from runs import alike, changes, solved
from test_friction import ARM, BLOCK, CRANK, HINGE, SLOPE, G

from kaneflex import SceneError, load, read_scene, scene_of, with_settings

HERTZ = '{law = "hertz", stiffness = "2e6 N/m", exponent = 1}'
BACKLASH = machine(
    description="A flywheel between the flanks of a coupling", ground=dict(foot=[1, 0]),
    bodies=dict(shaft="mass = 1, inertia = 0.01", wheel="mass = 2, inertia = 0.02"),
    joints=dict(hub="revolute ground shaft",
                coupling='revolute shaft wheel, clearance = {angle = "0.5 deg", contact = CONTACT}'),
    drives=dict(hub='free = true, initial_speed = "-5 rad/s"', coupling='free = true, initial_speed = "10 rad/s"'),
    sensors=dict(angle="position coupling angle", on="contact_torque coupling_1", room="contact_angle coupling_2"),
    solve=dict(preset="coupled", duration="50 ms", steps=250, tolerance=1e-10),
)
PRESS = machine(
    description="An arm that its drive presses on a stop", gravity=[0, -9.81], ground=dict(foot=[0.2, 0]),
    bodies=dict(arm="mass = 2, inertia = 0.02, length = 0.2"), joints=dict(pin="revolute ground arm.start"),
    drives=dict(pin='law = "0.05*cos(20*t)"'),
    contacts=dict(floor='point_on_line = ["arm.end", "ground.foot"], normal = [0, 1], contact = CONTACT'),
    sensors=dict(push="contact_force floor", torque="drive_torque pin"),
    solve=dict(preset="coupled", duration="0.4 s", steps=100, errors="none"),
).replace("CONTACT", HERTZ)


LOOSE = machine(
    description="A slider-crank at 3000 rpm with clearance at its wrist, from the outer dead centre",
    bodies=dict(crank="length = 0.05, mass = 0.3, inertia = 1e-4", rod="length = 0.12, mass = 0.07, inertia = 9e-5",
                piston="mass = 0.14, inertia = 1e-5"),
    joints=dict(main="revolute ground crank", pin="revolute crank.end rod",
                bore="prismatic ground piston, direction = [1, 0]",
                wrist='revolute rod.end piston, '
                      'clearance = {radial = "0.2 mm", contact = {stiffness = "1e9 N/m^1.5", restitution = 0.9}}'),
    drives=dict(main='speed = "3000 rpm"', pin=f"free = true, initial_speed = {-100 * math.pi * (1 + 5 / 12)}",
                bore="free = true, position = 0.17"),
    sensors=dict(slide="position bore x", torque="drive_torque main", push="contact_force wrist"),
    solve=dict(preset="coupled", duration="4 ms", steps=400, tolerance=1e-10),
)


def in_space(flat, name):
    """The scene in space, turned by a rotation that belongs to the name."""
    return scene_of(lifted(flat, random_turn(name)) | {"solve": flat.raw["solve"]})


def both(flat, name):
    """Solutions in the plane and in space."""
    found = solved(flat), solved(in_space(flat, name))
    assert [each.outcome.name for each in found] == 2 * ["COMPLETED"]
    return found


def estimated(plane, space, sensor):
    """What both runs allow for a sensor."""
    return sum(each.errors[0][sensor].total for each in (plane, space))


@pytest.mark.parametrize("contact", [
    '{law = "hertz", stiffness = "2e5 N m/rad", exponent = 1}', '{stiffness = "1e6 N m/rad^1.5", restitution = 0.8}',
    '{law = "kelvin-voigt", stiffness = "2e5 N m/rad", exponent = 1, damping = "10 N m s/rad"}',
])  # fmt: skip
def test_flanks_meet_as_in_the_plane(contact):
    plane, space = both(scene_of(BACKLASH.replace("CONTACT", contact)), contact)
    assert [each.contact for each in space.impacts] == [each.contact for each in plane.impacts]
    assert len(space.impacts) > 5
    for sensor in ("angle", "on", "room"):
        assert abs(space[sensor].values - plane[sensor].values).max() <= estimated(plane, space, sensor)
    off = estimated(plane, space, "angle")
    for one, other in zip(space.impacts, plane.impacts, strict=True):
        assert one.begin == pytest.approx(other.begin, abs=off / other.approach)
        assert one.separation == pytest.approx(other.separation, rel=1e-6, nan_ok=True)
        assert one.lost == pytest.approx(other.lost, rel=1e-6, abs=1e-9)
    assert space.trajectory.energy.drift < 1e-8
    lost = space.trajectory.contacts.lost[-1]
    assert lost == pytest.approx(plane.trajectory.contacts.lost[-1], rel=1e-6, abs=1e-9)


def test_a_prescribed_arm_presses_on_its_stop_as_in_the_plane():
    """Its drive prescribes everything: the contact only adds to the torque."""
    plane, space = both(scene_of(PRESS), "press")
    push = plane["push"].values
    assert push.max() == pytest.approx(2e6 * 0.2 * math.sin(0.05), rel=1e-3) and push.min() == 0.0
    alike(space, plane, 1e-9, ("push", "torque"))


@pytest.mark.exhaustive(share=7)
@pytest.mark.parametrize("turn", "abcdefghijklmnopqrst")
def test_a_ball_in_its_socket_hits_as_a_pin_in_its_bearing(turn):
    """A slider-crank whose other joints keep it in its plane."""
    plane, space = both(scene_of(LOOSE), turn)
    assert len(space.impacts) == len(plane.impacts) == 4
    for sensor in ("slide", "torque", "push"):
        assert abs(space[sensor].values - plane[sensor].values).max() <= estimated(plane, space, sensor)
    for one, other in zip(space.impacts, plane.impacts, strict=True):
        assert one.begin == pytest.approx(other.begin, abs=estimated(plane, space, "slide") / other.approach)
        assert (one.peak, one.lost) == (pytest.approx(other.peak, rel=1e-6), pytest.approx(other.lost, rel=1e-6))
        place = random_turn(turn) @ [other.x, other.y, 0.0]
        assert [one.x, one.y, one.z] == pytest.approx(place, abs=1e-9)
    flat = np.vstack([plane.motion.clearance("wrist")[:2], np.zeros(len(plane.times))])
    assert space.motion.clearance("wrist") == pytest.approx(random_turn(turn) @ flat, abs=1e-9)
    assert space.trajectory.energy.drift < 1e-9


BALL_CRANK = machine(
    description="A crank that turns about z and a slider along x in another plane, with a loose ball at the slider",
    gravity=[0, 0, -9.81], ground=dict(rail=[0, 0, 0.05]),
    bodies=dict(crank="mass = 0.3, inertia = [1e-5, 1e-4, 1e-4], length = 0.05",
                rod="mass = 0.07, inertia = [2e-6, 9e-5, 9e-5], length = 0.13, rotation.x = [12, 0, 5]",
                slider="mass = 0.14, inertia = [1e-5, 1e-5, 1e-5]"),
    joints=dict(main="revolute ground crank, axis = [0, 0, 1]",
                pin="universal crank.end rod, axes = [[0, 0, 1], [0, 1, 0]]",
                bore="prismatic ground.rail slider, direction = [1, 0, 0]",
                ball='spherical slider rod.end, clearance = {radial = "0.1 mm", radius = "6 mm", contact = CONTACT}'),
    drives=dict(main='speed = "600 rpm"', pin='free = true, initial_speeds = ["-850 rpm", 0]',
                bore="free = true, position = 0.17"),
    sensors=dict(slide="position bore x", room="contact_gap ball", push="contact_force ball", height="position ball z"),
    solve=dict(preset="coupled", duration="20 ms", steps=400, tolerance=1e-9),
)


def test_a_spatial_slider_crank_with_a_loose_ball():
    """It stays in its socket, pushes as the slider's inertia needs, and loses energy in the contact alone."""
    law = '{materials = ["steel", "steel"], restitution = 0.6, law = "lankarani-nikravesh"}'
    solution = solved(scene_of(BALL_CRANK.replace("CONTACT", law)))
    assert solution.outcome.name == "COMPLETED" and len(solution.impacts) > 3
    away = np.linalg.norm(solution.motion.clearance("ball"), axis=0)
    assert solution["room"].values == pytest.approx(1e-4 - away, abs=1e-12)
    assert solution["height"].values == pytest.approx(solution.motion.clearance("ball")[2], abs=1e-12)
    assert solution.trajectory.energy.drift < 1e-7
    assert solution.trajectory.contacts.lost[-1] == pytest.approx(sum(each.lost for each in solution.impacts), rel=1e-6)


@pytest.mark.parametrize(("settings", "message"), [
    (("joints.ball.clearance.width=9 mm",), r"joints\.ball\.clearance\.width = '9 mm': a ball has no width"),
    (("joints.ball.clearance.friction={law='lugre', mu=0.1, bristle_stiffness='1e6 N/m'}",),
     r"joints\.ball\.clearance\.friction\.law = 'lugre': in space contacts .* so far"),
    (("joints.ball.friction={mu=0.1}",), r"joints\.ball\.friction: .*Give clearance\.friction"),
    (("joints.ball.clearance.radial=0",), r"joints\.ball\.clearance\.radial = 0: "),
    (("drives.bore.position=0.16",), r"joints\.ball\.clearance: at the start .* penetrate each other by 9\.9 mm"),
    (("sensors.height.component=angle",), r"sensors\.height\.component = 'angle'"),
])  # fmt: skip
def test_what_a_loose_ball_can_t_be_is_refused(settings, message):
    with pytest.raises(SceneError, match=message):
        load(with_settings(scene_of(BALL_CRANK.replace("CONTACT", HERTZ)), settings))


@pytest.mark.exhaustive(share=7)
@pytest.mark.parametrize("turn", "abcdefghijklmnopqrst")
def test_an_elastic_bar_hits_its_stop_as_in_the_plane(turn):
    """With the same shapes, in steps of the same number, whichever way it is turned."""
    flat = with_settings(planar("bouncing-bar", "coupled"), ["solve.duration=0.12 s", "solve.modes=2"])
    plane, space = both(flat, turn)
    assert len(space.impacts) == len(plane.impacts) > 3
    assert space.trajectory.steps == plane.trajectory.steps
    for one, other in zip(space.impacts, plane.impacts, strict=True):
        assert (one.begin, one.end) == (pytest.approx(other.begin, rel=1e-12), pytest.approx(other.end, rel=1e-12))
        assert (one.peak, one.lost) == (pytest.approx(other.peak, rel=1e-9), pytest.approx(other.lost, rel=1e-9))
        place = random_turn(turn) @ [other.x, other.y, 0.0]
        assert [one.x, one.y, one.z] == pytest.approx(place, abs=1e-12)
    alike(space, plane, 1e-9, ("angle", "root_force", "moment"))


def ball(contact, *settings):
    return with_settings(scene_of(BALL_ON_PLANE.replace("CONTACT", contact)), settings)


def test_a_ball_is_thrown_back_by_a_tilted_plane():
    """Along the normal a parabola, half an oscillation about the depth of rest, and a parabola again."""
    solution = solved(ball(HERTZ))
    n = np.array([1.0, 2.0, 5.0]) / math.sqrt(30.0)
    gap, speed, g = -n @ [0.2, 0.1, -0.4] - 0.05, n @ [0.3, -0.2, 0.5], 9.81 * n[2]
    met = (speed + math.sqrt(speed**2 + 2 * g * gap)) / g
    fast, omega = g * met - speed, math.sqrt(2e6 / 2)
    impact = solution.impacts[0]
    assert impact.begin == pytest.approx(met, rel=1e-9)
    assert (impact.approach, impact.separation) == (pytest.approx(fast, rel=1e-9), pytest.approx(fast, rel=1e-8))
    phase = math.atan2(g / omega, fast)
    assert impact.end - impact.begin == pytest.approx((math.pi + 2 * phase) / omega, rel=1e-6)
    assert impact.peak == pytest.approx(2 * g + 2e6 * math.hypot(g / omega**2, fast / omega), rel=1e-6)
    centre = np.array([0.3, -0.2, 0.5]) * met - [0, 0, 0.5 * 9.81 * met**2]
    assert [impact.x, impact.y, impact.z] == pytest.approx(centre - 0.05 * n, abs=1e-9)
    assert solution.trajectory.energy.drift < 1e-9
    assert solution.statistics("push").max == pytest.approx(impact.peak)


@pytest.mark.parametrize(("settings", "message"), [
    (("contacts.floor.friction={law='lugre', mu=0.1, bristle_stiffness='1e6 N/m'}",),
     r"contacts\.floor\.friction\.law = 'lugre': in space contacts don't have this law so far"),
    (("contacts.floor.point_on_plane=none", "contacts.floor.point_on_line=['ball', 'ground.foot']"),
     r"contacts\.floor\.point_on_line = \['ball', 'ground\.foot'\]: only planar .* Use point_on_plane"),
    (("ground.foot=[0.2, 0.1, 0.4]",), r"contacts\.floor: at the start its sides penetrate each other by 488.2 mm"),
    (("contacts.floor.normal=none",), r"the side of the plane is not given"),
    (("contacts.floor.width=10 mm",), r"width"),
    (("solve.preset=rigid",), r"contacts\.floor.*preset rigid does not support"),
])  # fmt: skip
def test_what_a_contact_in_space_can_t_be_is_refused(settings, message):
    with pytest.raises(SceneError, match=message):
        load(ball(HERTZ, *settings))


def test_a_plane_is_for_space_alone():
    flat = planar("bouncing-bar", "coupled")
    stop = dict(flat.raw["contacts"]["stop"])
    stop["point_on_plane"] = stop.pop("point_on_line")
    given = dict(flat.raw) | {"contacts": {"stop": stop}}
    said = r"contacts\.stop\.point_on_plane = \['bar\.end', 'ground\.stop'\]: .*Use point_on_line"
    with pytest.raises(SceneError, match=said):
        load(scene_of(given))


@pytest.mark.parametrize("angle", ["2 deg", "-361 deg"])
def test_flanks_in_space_start_apart(angle):
    flat = scene_of(BACKLASH.replace("CONTACT", '{stiffness = "1e6 N m/rad^1.5", restitution = 0.8}'))
    with pytest.raises(SceneError, match=f"at the start its angle is {angle} from the middle of the backlash"):
        load(with_settings(in_space(flat, "a"), [f"drives.coupling.angle={angle}"]))


def rubs(flat, name, *, joints=None):
    """Solutions in the plane and in space, of which both have the same changes of modes, and what they rub."""
    raw = lifted(flat, random_turn(name)) | {"solve": flat.raw["solve"]}
    raw["joints"] |= joints or {}
    raw["sensors"] = {key: each for key, each in flat.raw["sensors"].items()
                      if each.keys() & {"friction_force", "friction_torque"} or each.get("position") in flat.drives}
    plane, space = solved(flat), solved(scene_of(raw))
    one, other = plane.trajectory.frictions, space.trajectory.frictions
    assert plane.outcome is space.outcome
    assert (one.mode == other.mode).all()
    instants = [[row[0] for row in changes(each)] for each in (plane, space)]
    assert instants[1] == pytest.approx(instants[0], rel=1e-5)
    assert space.trajectory.energy.drift < 1e-6
    return plane, space


RUBBING = {
    "down": (BLOCK, ()), "turns": (BLOCK, ("drives.slide.initial_speed=-1",)),
    "stops": (BLOCK, ("drives.slide.initial_speed=-1", "slide.friction.mu=0.8")),
    "stribeck": (BLOCK, ("slide.friction={law='stribeck', mu=0.1, mu_static=0.6, stribeck_speed='0.2 m/s'}",
                         "drives.slide.initial_speed=-1")),
    "bristles": (BLOCK, ("slide.friction={law='lugre', mu=0.8, bristle_stiffness=1e5, bristle_damping=300}",
                         "drives.slide.initial_speed=-1")),
    "bristles of a pin": (HINGE, ("hinge.friction={law='lugre', bristle_stiffness=20, bristle_damping=0.02}",
                                  "wheel.centre=['0.1 m', 0]")),
    "flywheel": (HINGE, ()), "viscous": (HINGE.replace('mu = 0.2, radius = "10 mm", preload = "0.005 N m"',
                              'law = "viscous", viscous = "0.01 N m s/rad"'), ()),
    "pendulum": (HINGE, ("wheel.centre=['0.1 m', 0]", "drives.hinge.angle=-20 deg", "solve.duration=6 s")),
    "slot": (ARM, ("solve.duration=2 s", "solve.steps=200")),
    "thrown": (ARM, ("slot.friction={mu=0.3, length='50 mm'}", "solve.duration=0.4 s", "solve.steps=100")),
}  # fmt: skip
"""Scenes with friction, and settings."""


@pytest.mark.parametrize("name", RUBBING)
def test_joints_rub_as_in_the_plane(name):
    text, settings = RUBBING[name]
    plane, space = rubs(with_settings(scene_of(text), [*settings, "solve.tolerance=1e-10"]), name)
    for key in ("gap", "speed", "force", "pressed", "lost", "bristles"):
        one, other = (getattr(each.trajectory.frictions, key) for each in (plane, space))
        assert other == pytest.approx(one, abs=1e-6 * abs(one).max() + 1e-9)
    for sensor in space:
        bound = max(estimated(plane, space, sensor), 1e-9 * abs(plane[sensor].values).max())
        assert abs(space[sensor].values - plane[sensor].values).max() <= bound


LOOP = changed(
    CRANK, (', friction = {mu = 0.1, radius = "8 mm"}', ""), (', friction = {mu = 0.1, radius = "6 mm"}', ""),
    ("solve.duration = \"2 s\"", "solve.duration = \"1 s\""),
)  # fmt: skip


def test_a_crank_and_a_slider_of_a_loop_rub_as_in_the_plane():
    """A ball and a universal joint leave no constraint redundant; the guide also bears the moment on its block."""
    joints = {"pin": {"spherical": ["crank.end", "rod.start"]},
              "wrist": {"universal": ["rod.end", "piston.start"], "axes": [[0, 0, 1], [0, 1, 0]]}}  # fmt: skip
    plane, space = rubs(with_settings(scene_of(LOOP), ["solve.tolerance=1e-9"]), "loop", joints=joints)
    one, other = (each.trajectory.frictions for each in (plane, space))
    assert other.lost == pytest.approx(one.lost, abs=1e-5 * one.lost.max())
    assert other.pressed == pytest.approx(one.pressed, abs=1e-4 * one.pressed.max())
    limit = other.pressed * np.array([0.1, 0.15])
    assert abs(other.force) == pytest.approx(limit, rel=1e-9)


def test_friction_is_part_of_a_joint_s_force_in_space():
    """On the level: what stops the block, and its weight."""
    flat = scene_of(BLOCK.replace(f"gravity = [{G * math.sin(SLOPE)}, {-G * math.cos(SLOPE)}]", f"gravity = [0, {-G}]"))
    raw = lifted(flat, np.eye(3)) | {"solve": flat.raw["solve"]}
    raw["drives"]["slide"] = {"free": True, "initial_speed": 2}
    raw["sensors"] = {axis: {"joint_force": "slide", "component": axis} for axis in "xyz"}
    found = solved(scene_of(raw))
    moving = found.times < 2 / (0.3 * G)
    assert found["x"].values[moving] == pytest.approx(-2 * 0.3 * G, rel=1e-9)
    assert found["x"].values[~moving] == pytest.approx(0.0, abs=1e-9)
    assert found["y"].values == pytest.approx(2 * G, rel=1e-9)


def test_other_joints_don_t_have_the_friction_of_one():
    """The belt's guide bears the friction on the belt, but the belt's drive balances it."""
    flat = read_scene("stick-slip")
    raw = lifted(flat, np.eye(3)) | {"solve": flat.raw["solve"]}
    raw["sensors"] = {"force": {"joint_force": "way", "component": "y"}, "along": {"joint_force": "way"},
                      "drag": {"friction_force": "rub"}}  # fmt: skip
    found = solved(scene_of(raw))
    assert found["force"].values == pytest.approx(2 * G, rel=1e-9)
    assert found["along"].values == pytest.approx(found["drag"].values, abs=1e-9)


@pytest.mark.parametrize(("text", "changes", "message"), [
    (LOOP, {}, r"joints\.bore\.friction: redundant constraints leave .* statically indeterminate"),
    (HINGE, {"drives.hinge": {"speed": 3}}, r"joints\.hinge\.friction: .*Make the drive free"),
    (HINGE, {"springs": {"coil": {"torsional_at": "hinge", "stiffness": "1 N m/rad"}}},
     r"joints\.hinge\.friction: in space a joint with a torsional spring"),
    (HINGE, {"loads": {"push": {"torque_at": "hinge", "law": "-hinge"}}}, r"loads\.push\.law.*joint with friction"),
    (HINGE, {"solve.preset": "rigid"}, r"joints\.hinge\.friction: preset rigid does not support friction"),
])  # fmt: skip
def test_friction_that_space_does_not_have_is_refused(text, changes, message):
    flat = scene_of(text)
    raw = lifted(flat, random_turn("a")) | {"solve": dict(flat.raw["solve"]), "sensors": {}}
    for key, value in changes.items():
        *path, last = key.split(".")
        table = raw
        for part in path:
            table = table[part]
        table[last] = value
    with pytest.raises(SceneError, match=message):
        load(scene_of(raw))


def test_a_ball_and_its_plane_are_drawn():
    """A circle about the ball, and a square of the plane below it."""
    from kaneflex.plots.mechanism import rigid_outline, scenery

    solution = solved(ball(HERTZ))
    fixed = scenery(solution)
    drawn = rigid_outline(solution.model.scene, solution.rigid, fixed).bars
    centre = solution.motion.place("ball", (0.0, 0.0, 0.0)).T @ fixed.view.T
    away = np.linalg.norm(drawn["floor ball"] - centre[:, None], axis=-1)
    assert away == pytest.approx(0.05)
    assert drawn["floor plane"].shape == (len(solution.times), 5, 2)
    assert np.ptp(drawn["floor plane"], axis=0) == pytest.approx(0.0, abs=1e-15)
