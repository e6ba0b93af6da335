"""Contacts and clearances as scenes write them: what they mean to the equations, and what is refused by name."""

import math

import pytest
from scipy.optimize import brentq

from kaneflex import SceneError, scene_of, with_settings
from kaneflex.fem.freedom import count_freedom
from kaneflex.mechanism.contacts import numbers_of
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.report.presentation import parts, printed
from kaneflex.scene.contact_law import cylinders
from kaneflex.scene.options import resolve_options
from kaneflex.scene.structure import structure_hash

STEEL = 2.1e11 / (1 - 0.3**2) / 2
"""E* of steel on steel [Pa]."""
LOOSE = """
schema = 1
description = "A slider-crank with room in its wrist pin"
ground.floor = [0, "-2 m"]
bodies.crank = {length = "153 mm", mass = 0.038, inertia = 7.4e-5, centre = ["76.5 mm", 0]}
bodies.rod = {length = "306 mm", mass = 0.038, inertia = 5.9e-4, centre = ["153 mm", 0]}
bodies.piston = {mass = "76 g", inertia = 2.7e-6}
joints.main = {revolute = ["ground", "crank.start"]}
joints.pin = {revolute = ["crank.end", "rod.start"]}
joints.bore = {prismatic = ["ground", "piston"], direction = [1, 0]}
joints.wrist.revolute = ["rod.end", "piston"]
joints.wrist.clearance = {radial = "0.5 mm", contact = {stiffness = 1e9, restitution = 0.9}}
drives.main = {speed = "150 rad/s", cycle = "360 deg"}
drives.pin = {free = true}
drives.bore = {free = true, position = "459 mm"}
loads.push = {force_on = "piston", direction = [1, 0], value = 1}
springs.coil = {torsional_at = "pin", stiffness = 1}
contacts.stop.point_on_line = ["piston", "ground.floor"]
contacts.stop.normal = [0, 2]
contacts.stop.contact = {stiffness = "1e9 N/m^1.5", restitution = 0.5}
sensors.x = {position = "bore"}
sensors.force = {joint_force = "pin"}
solve.preset = "coupled"
"""
WRIST = "contact = {stiffness = 1e9, restitution = 0.9}"
STOP = 'contact = {stiffness = "1e9 N/m^1.5", restitution = 0.5}'
WRIST_JOINT = """joints.wrist.revolute = ["rod.end", "piston"]
joints.wrist.clearance = {radial = "0.5 mm", contact = {stiffness = 1e9, restitution = 0.9}}
"""
BORE = 'bore = {prismatic = ["ground", "piston"], direction = [1, 0]'
BLOCK = BORE + ', clearance = {gap = "80 um", length = "60 mm", height = "50 mm", ' + WRIST + "}"


def written(*changes):
    text = LOOSE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return scene_of(text)


def refused(*changes):
    with pytest.raises(SceneError) as caught:
        written(*changes)
    return str(caught.value).splitlines()


def test_a_joint_with_a_clearance_is_a_contact_and_no_constraint():
    scene = written()
    assert list(scene.joints) == ["main", "pin", "bore"] and list(scene.contacts) == ["stop", "wrist"]
    mechanism = mechanism_of(scene)
    assert (count_freedom(mechanism).mobility, count_freedom(mechanism).left) == (3, 0)
    wrist = mechanism.contacts["wrist"]
    assert (wrist.kind, wrist.law, wrist.joint, wrist.reach) == ("circle-in-circle", "exact", "wrist", 0.5e-3)
    assert [(side.body, side.at) for side in wrist.sides] == [("rod", (0.306, 0)), ("piston", (0, 0))]
    stop = mechanism.contacts["stop"]
    assert [side.body for side in stop.sides] == ["ground", "piston"] and stop.direction == (0.0, 1.0)
    assert numbers_of(stop)[:5] == (0.0, 1.0, 0.0, 1e9, 1.5)


def test_settings_and_copies_know_the_clearance_as_it_is_written():
    scene = written()
    wider = with_settings(scene, ["wrist.clearance.radial=0.2 mm", "stop.contact.restitution=0.7"])
    assert wider.contacts["wrist"].reach == 0.2e-3 and wider.contacts["stop"].contact.restitution == 0.7
    assert structure_hash(wider) == structure_hash(scene)
    copied = scene.model_copy(update={"joints": dict(scene.joints), "contacts": {}})
    assert with_settings(copied, []).contacts.keys() == {"wrist"}
    law = with_settings(scene, ["stop.contact.law=flores"])
    assert mechanism_of(law).contacts["stop"].law == "flores" and structure_hash(law) == structure_hash(scene)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0), (0.6, 0.8)])
def test_a_block_touches_the_faces_of_its_guide_by_its_corners(direction):
    """Moved and turned so far that a corner touches, by the rectangle's own geometry."""
    scene = written(
        (BORE, BLOCK.replace("[1, 0]", str(list(direction)))), ('sensors.x = {position = "bore"}', ""),
        ('drives.bore = {free = true, position = "459 mm"}\n', ""),
    )  # fmt: skip
    contacts = [contact for contact in mechanism_of(scene).contacts.values() if contact.joint == "bore"]
    assert [contact.name for contact in contacts] == ["bore_1", "bore_2", "bore_3", "bore_4"]
    along, left = direction, (-direction[1], direction[0])
    expected = [(-30e-3, -25e-3), (30e-3, -25e-3), (-30e-3, 25e-3), (30e-3, 25e-3)]
    for contact, (x, y) in zip(contacts, expected, strict=True):
        at = contact.second.at
        assert at[0] * along[0] + at[1] * along[1] == pytest.approx(x, abs=1e-15)
        assert at[0] * left[0] + at[1] * left[1] == pytest.approx(y, abs=1e-15)
        gap = contact.direction[0] * at[0] + contact.direction[1] * at[1] - contact.reach
        assert gap == pytest.approx(80e-6, abs=1e-15)
        assert contact.direction == pytest.approx([-math.copysign(1, y) * part for part in left], abs=1e-15)


def test_hertz_of_spheres():
    """Johnson 1985, eq. 4.22 to 4.24: a = (3 F R/(4 E*))^(1/3), d = a^2/R."""
    steel = 'contact = {materials = ["steel", "steel"], restitution = 0.9}'
    for radii, R in ((["10 mm", "30 mm"], 7.5e-3), (["10 mm", 10.1e-3], 10e-3 * 10.1e-3 / 0.1e-3)):
        kind = "circle_on_circle" if R < 0.01 else "circle_in_circle"
        scene = written(("point_on_line", kind), ("normal = [0, 2]", f"radii = {radii}"), (STOP, steel))
        force = 300.0
        depth = (3 * force * R / (4 * STEEL)) ** (2 / 3) / R
        K, n = scene.contacts["stop"].pushing
        assert n == 1.5 and K * depth**n == pytest.approx(force, rel=1e-12)
    ball = written((STOP, 'radius = "10 mm"\ncontacts.stop.' + steel)).contacts["stop"]
    assert ball.pushing == (pytest.approx(4 / 3 * STEEL * 0.1, rel=1e-12), 1.5) and ball.reach == 10e-3


def test_cylinders_have_the_depth_and_the_stiffness_of_johnsons_law_at_the_load():
    """Two equal cylinders pressed together, Johnson 1985, sec. 5.6, and a pin in its bearing by its own depth."""
    width, load = 20e-3, 500.0
    for room in (0.5e-3, 20e-3):

        def force(depth, room=room):
            def missed(F):
                return F / (math.pi * STEEL * width) * (math.log(4 * math.pi * STEEL * width * room / F) - 1) - depth

            return brentq(missed, 1e-3 * load, 1e3 * load, xtol=1e-12, rtol=1e-15)

        K, n = cylinders(STEEL, width, room, load)
        depth = (load / K) ** (1 / n)
        assert force(depth) == pytest.approx(load, rel=1e-12)
        h = 1e-4 * depth
        assert n * load / depth == pytest.approx((force(depth + h) - force(depth - h)) / (2 * h), rel=1e-7)
    R, a = 10e-3, math.sqrt(4 * load * 5e-3 / (math.pi * STEEL * width))
    each = load / (2 * math.pi * STEEL * width) * (2 * math.log(4 * R / a) - 1)  # both have half of 1/E*
    K, n = cylinders(STEEL, width, 2 * R, load)
    assert (load / K) ** (1 / n) == pytest.approx(2 * each, rel=1e-12)


@pytest.mark.parametrize(("old", "new", "message"), [
    ("drives.pin", "drives.wrist = {free = true}\ndrives.pin",
     "drives.wrist: wrist has a clearance: it cannot be driven. Leave out the clearance or this entry."),
    ('force = {joint_force = "pin"', 'eccentricity = {joint_force = "pin"',
     "sensors.eccentricity: contacts have a result of this name. Choose another name."),
    ('joint_force = "pin"', 'joint_force = "wrist"',
     "sensors.force.joint_force = 'wrist': wrist has a clearance: it has no reaction, but contacts with a "
     "contact_force. Leave out the clearance or this entry."),
    ('push = {force_on = "piston", direction = [1, 0]', 'push = {torque_at = "wrist"',
     "loads.push.torque_at = 'wrist': wrist has a clearance: a torque needs a joint without "
     "clearance. Leave out the clearance or this entry."),
    ('torsional_at = "pin"', 'torsional_at = "wrist"',
     "springs.coil.torsional_at = 'wrist': wrist has a clearance: it has no angle. Leave out "
     "the clearance or this entry."),
    ("contacts.stop", "contacts.wrist",
     "contacts.wrist: a contact of the clearance of joint wrist has this name. Choose another name."),
    ("contacts.stop", "contacts.rod", "contacts.rod: bodies has an entry of this name. Choose another name."),
    ('"ground.floor"', '"ground.flor"',
     "contacts.stop.point_on_line = 'ground.flor': no such fixed point. The nearest known one is 'floor'."),
    ('"rod.end", "piston"', '"rod.enf", "piston"',
     "joints.wrist.revolute = 'rod.enf': rod has no point 'enf'. The nearest known one is 'end'."),
    ('["piston", "ground.floor"]', '["piston", "piston.start"]',
     "contacts.stop.point_on_line = ['piston', 'piston.start']: both sides are on the same body. Name "
     "points of two bodies."),
    ("contacts.stop.normal = [0, 2]\n", "",
     "contacts.stop: the side of the line is not given. Give normal, like normal = [0, 1]."),
    (STOP, STOP.replace('0.5', '0'),
     "contacts.stop.contact.restitution = 0: law exact would need an infinite force. Give a number "
     "above zero, like 0.01."),
    (STOP, STOP.replace('0.5', '1.5'),
     "contacts.stop.contact.restitution = 1.5: the impact would gain energy. Give a number up to 1."),
    (STOP, STOP.replace('^1.5', ''),
     "contacts.stop.contact.stiffness = '1e9 N/m': 'N/m' is not a unit of contact stiffness. Write a "
     "contact stiffness like '1e9 N/m^1.5', or a plain number in N/m^1.5."),
    (STOP, "contact = {stiffness = 1e9}",
     "contacts.stop.contact: law exact needs a restitution. Give restitution, or use law hertz, which is lossless."),
    (STOP, 'contact = {law = "kelvin-voigt", stiffness = 1e9, restitution = 0.5}',
     "contacts.stop.contact.restitution = 0.5: law kelvin-voigt does not use it. Leave it out."),
    (STOP, 'contact = {materials = ["steel", "steal"], restitution = 0.5}',
     "contacts.stop.contact.materials = ['steel', 'steal']: unknown material 'steal'. The nearest known "
     "one is 'steel'."),
    (STOP, 'contact = {materials = ["steel", "steel"], restitution = 0.5}',
     "contacts.stop.contact: Hertz's theory needs a radius, a point has none. Give its radius, or contact.stiffness."),
    (WRIST, 'width = "20 mm", contact = {modulus = "115 GPa", restitution = 0.5}',
     "joints.wrist.clearance.contact: the stiffness of cylinders depends on the load at which K d^n is "
     "fitted, which is missing. Give contact.load, a typical force, like load = '1 kN'."),
    (WRIST, 'width = "20 mm", contact = {modulus = "115 GPa", load = 1e6, restitution = 0.5}',
     "joints.wrist.clearance.contact.load = 1000000.0: at this force the contact of the cylinders is "
     "too wide for Hertz's theory. Give a load up to 7.19e+05 N, or contact.stiffness."),
    ('radial = "0.5 mm"', 'gap = "0.5 mm", length = 1',
     "joints.wrist.clearance: a revolute joint has no such clearance. Give radial or angle."),
    ('["rod.end", "piston"]', '["rod.end", "piston"]\njoints.wrist.branch = "-"',
     "joints.wrist.branch = '-': a joint with a clearance does not couple rotations. Leave it out."),
])  # fmt: skip
def test_what_is_wrong_is_named_with_its_cure(old, new, message):
    assert message in refused((old, new))


def test_a_block_is_refused_where_it_can_not_be():
    assert refused((BORE, BLOCK)) == [
        "drives.bore: bore has a clearance: it cannot be driven. Leave out the clearance or this entry.",
    ]
    tight_wrist = WRIST_JOINT, WRIST_JOINT.split("joints.wrist.clearance")[0]
    free_wrist = 'bore = {free = true, position = "459 mm"}', "wrist = {free = true}"
    assert refused((BORE, BLOCK), tight_wrist, free_wrist, (", inertia = 2.7e-6", "")) == [
        "bodies.piston.inertia = 0: it can rotate in the clearance of bore but has no moment of inertia. "
        "Give its inertia."
    ]
    materials = BLOCK.replace(WRIST, 'contact = {materials = ["steel", "steel"], restitution = 0.9}')
    assert refused((BORE, materials)) == [
        "joints.bore.clearance.contact: Hertz's theory needs a radius, a corner has none. Give contact.stiffness."
    ]
    beam = 'piston = {length = 1, beam = {material = "steel", section = {rectangle = [0.01, 0.01]}}}'
    assert "joints.bore.prismatic = 'piston.start': piston is elastic: a guide cannot hold a deforming body. " \
        "Put a rigid body into the guide." in refused(
        (BORE, BLOCK), ('piston = {mass = "76 g", inertia = 2.7e-6}', beam)
    )  # fmt: skip


@pytest.mark.parametrize("preset", ["rigid", "quasistatic", "paper", "linear", "stiffened"])
def test_one_way_presets_refuse_contacts_and_say_which_one_takes_them(preset):
    scene = written(('preset = "coupled"', f'preset = "{preset}"'))
    with pytest.raises(SceneError) as caught:
        resolve_options(scene)
    assert str(caught.value) == f"contacts.stop: preset {preset} does not support a contact. Use preset coupled."
    with pytest.raises(SceneError) as caught:
        resolve_options(with_settings(scene, ["contacts.stop=none"]))
    expected = f"joints.wrist.clearance: preset {preset} does not support a joint with a clearance. "
    assert str(caught.value) == f"{expected}Use preset coupled."


def test_a_scene_is_told_with_the_restitution_that_its_laws_return():
    """Lankarani and Nikravesh's law, asked for 0.1, returns 0.665."""
    law = STOP.replace("restitution = 0.5", 'restitution = 0.1, law = "lankarani-nikravesh"')
    scene = written((STOP, law))
    lines = printed(scene, parts(scene)).splitlines()
    assert "  stop   piston.start in front of the line through ground.floor, 1e+09 N/m^1.5, " \
        "law lankarani-nikravesh, restitution 0.665, requested 0.1" in lines  # fmt: skip
    assert "  wrist  circle about piston.start in the circle about rod.end, clearance 0.5 mm, 1e+09 N/m^1.5, " \
        "law exact, restitution 0.9" in lines  # fmt: skip
