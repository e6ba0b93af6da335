"""Axes of bodies in space that follow their mean turn, on balls, universal joints and pins: runs with many shapes."""

import math

import numpy as np
import pytest
from machines import machine
from runs import alike, solved

import kaneflex
from kaneflex.fem.links import make_link
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.shape_bases import spatial_shapes
from kaneflex.scene import scene_of, shipped_scenes
from kaneflex.scene.beams import MATERIALS
from kaneflex.scene.shapes import torsion_constant

PIN = 'joints.hinge = {revolute = ["ground", "strip.start"], axis = [0, 0, 1]}'
TILTED = 'rotation = {x = [0.866025403784, -0.5, 0]}, '
ASKEW = 'rotation = {x = [0.96, 0, 0.28]}, '
ANGLE = 'sensors.angle = {position = "hinge", component = "angle"}\n'
SLID = 'sensors.slid = {position = "hinge", component = "x"}\n'
COIL = 'springs.coil = {torsional_at = "hinge", stiffness = 0.02, damping = 0.002}'
HELPED = 'loads.help = {torque_at = "hinge", law = "0.05 * sin(3 * hinge) - 0.01 * hinge_speed"}'


def rod(section: str, speed: float = 0.0) -> str:
    """A rod between two balls, the second one on a block on a guide along it."""
    return machine(
        gravity=[0, 0, 0], ground=dict(far=[0.8, 0, 0]),
        bodies=dict(rod=f'length = "0.8 m", beam = {{material = "steel", section = {{{section}}}, elements = 12}}',
                    block='mass = "1 kg"'),
        joints=dict(near="spherical ground rod.start", ball="spherical rod.end block",
                    guide="prismatic ground.far block, direction = [1, 0, 0]"),
        drives=dict(near=f"free = true, angular_velocity = [{speed}, 0, 0]"),
        solve=dict(preset="coupled", modes=8, duration="1 ms", steps=2),
    )  # fmt: skip


def frequencies(text: str) -> np.ndarray:
    """Circular frequencies [rad/s], ascending."""
    poles = kaneflex.linearise(kaneflex.load(scene_of(text)), t=0.0).A
    return np.sort(abs(np.linalg.eigvals(poles).imag))[::2]


def test_a_rod_between_two_balls_rings_as_a_pinned_one():
    """In both planes (n pi / L)^2 sqrt(E I / rho A), and in torsion, free at both ends, pi / L sqrt(G J / rho I_p)."""
    E, rho, nu = MATERIALS["steel"]
    found = frequencies(rod('rectangle = ["8 mm", "6 mm"]'))
    for side in (6e-3, 8e-3):
        for n in range(1, 5):
            expected = (n * math.pi / 0.8) ** 2 * math.sqrt(E / rho / 12.0) * side
            assert abs(found / expected - 1.0).min() < 1e-3, (side, n)
    torsion = torsion_constant(8e-3, 6e-3) / (8e-3 * 6e-3 * (8e-3**2 + 6e-3**2) / 12.0)
    expected = math.pi / 0.8 * math.sqrt(E / 2.0 / (1.0 + nu) / rho * torsion)
    assert abs(found / expected - 1.0).min() < 6e-3  # elements twist evenly
    assert found[0] < 1e-3 * found[1]  # it spins freely


def test_a_shaft_that_spins_between_two_balls_whirls():
    """Its bending vibrates at omega_n as if it stood still: in axes that turn by omega, at omega_n -+ omega."""
    E, rho, _ = MATERIALS["steel"]
    spin = 60.0
    found = frequencies(rod('circle = "8 mm"', spin))
    for n in range(1, 4):
        still = (n * math.pi / 0.8) ** 2 * math.sqrt(E / rho) * 2e-3
        for expected in (still - spin, still + spin):
            assert abs(found - expected).min() < 4e-4 * still, (n, expected)


def hanging(joint: str, turned: str, modes: int, more: str, gravity: list[float], start: str = "", stub: str = ""):
    text = machine(
        gravity=gravity, drives=dict(hinge=f"free = true{start}"),
        bodies=dict(strip=turned + 'length = "1 m", beam = {material = "steel", '
                                   'section = {rectangle = ["1.5 mm", "10 mm"]}}'),
        sensors=dict(height="position strip.end y", bend="displacement strip.end y"),
        solve=dict(preset="coupled", modes=modes, duration="0.1 s", steps=40),
    )  # fmt: skip
    return scene_of("\n".join((text, stub, joint, more)))


def strip(joint: str = PIN, turned: str = "", modes: int = 6, more: str = ANGLE, gravity=(0, -9.81, 0), stub=""):
    """A run of a pendulum that bends by 4 % of its length."""
    start = ', angle = "-30 deg"' if "revolute" in joint else ""
    return solved(hanging(joint, turned, modes, more, list(gravity), start, stub))


def in_the_plane(more: str = ANGLE):
    return strip(PIN.replace(", axis = [0, 0, 1]", ""), gravity=(0, -9.81), more=more)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("joint", "of_bend"), [
    ('spherical = ["ground", "strip.start"]', 1e-4),
    ('universal = ["ground", "strip.start"], axes = [[0, 0, 1], [0.6, 0.8, 0]]', 4e-3),
    ('universal = ["ground", "strip.start"], axes = [[0.6, 0.8, 0], [0, 0, 1]]', 1e-4),
    ('universal = ["strip.start", "ground"], axes = [[1, 0, 0], [0, 0, 1]]', 4e-3),
], ids=["ball", "first axis", "second axis", "other way"])  # fmt: skip
def test_a_strip_on_whatever_turns_swings_as_in_the_plane(joint, of_bend):
    """However many its shapes, which would take the place of what the joint lets it turn. Where this may hold the
    section it has a shape more that turns that, and modes held there; the bend is measured from its turn."""
    flat, deep = in_the_plane(), strip(f"joints.hinge = {{{joint}}}", TILTED, more="")
    alike(deep, flat, {"height": 2e-5, "bend": of_bend})
    assert deep.energy.drift < 1e-6 and not deep.warnings


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("more", [ANGLE + COIL, ANGLE + HELPED], ids=["spring", "law"])
def test_springs_and_laws_know_how_the_section_at_a_pin_stands(more):
    """The strip's axes follow its mean turn there as well; with its tangent there six modes stopped the run."""
    flat, deep = in_the_plane(more), strip(more=more)
    alike(deep, flat, 1e-4, ("angle", "height"))
    assert deep.energy.drift < 2e-6


def test_a_spring_at_a_pin_stores_what_the_section_there_turns_it_by():
    """Energy is kept by a strip that bends far."""
    stiff = COIL.replace("stiffness = 0.02, damping = 0.002", "stiffness = 2, damping = 0")
    found = strip(modes=3, more=ANGLE + stiff, gravity=(0, -40, 0))
    assert abs(found.series["bend"].values).max() > 0.3 and found.energy.drift < 2e-6


@pytest.mark.exhaustive(group="axes", share=3)
def test_a_strip_on_a_pin_along_and_across_it_is_one_on_a_stub():
    """On a stub that next to nothing weighs, which turns with the section; both with as many shapes as one likes."""
    stub = f"bodies.stub = {{{ASKEW}mass = 1e-6, inertia = [1e-9, 1e-9, 1e-9]}}\n"
    on_stub = 'joints.hinge = {revolute = ["ground", "stub"], axis = [0, 0, 1]}\n' \
              'joints.root = {weld = ["stub", "strip.start"]}'
    few, many = strip(turned=ASKEW, modes=3), strip(turned=ASKEW)
    others = [strip(on_stub, ASKEW, modes, stub=stub) for modes in (3, 6)]
    for found in (few, many, others[1]):
        alike(found, others[0], 3e-3, ("angle", "height"))
    assert all(each.energy.drift < 1e-6 for each in (many, *others))


@pytest.mark.exhaustive(group="axes", share=3)
@pytest.mark.parametrize("more", [ANGLE + COIL, ANGLE + HELPED], ids=["spring", "law"])
def test_springs_and_laws_at_a_pin_along_and_across_a_strip_know_how_its_section_stands(more):
    """With as many modes as one likes: in axes held at that section six modes stopped the run."""
    few, many = (strip(turned=ASKEW, modes=modes, more=more) for modes in (6, 8))
    alike(few, many, 1e-3, ("angle", "height"))
    assert many.energy.drift < 1e-6 and not many.warnings


CROSS = "axes = [[0.48, 0.6, 0.64], [0.8, 0, -0.6]]"


def flung(body: str, joint: str, begun: str, **solve):
    return solved(scene_of(machine(
        gravity=[0, 0, -9.81],
        bodies=dict(post='length = "0.4 m", mass = "2 kg", rotation = {x = [0, 0, 1]}',
                    rod=f'length = "0.5 m", rotation = {{x = [0.6, 0, -0.8]}}, {body}'),
        joints=dict(turn="revolute ground post, axis = [0, 0, 1]", hinge=joint),
        drives=dict(turn='speed = "90 rpm"', hinge=f"free = true, {begun}"),
        sensors=dict(tip_x="position rod.end x", tip_z="position rod.end z", pull="joint_force hinge z",
                     tilting="joint_force hinge angle_x", twisting="joint_force hinge angle_z",
                     torque="drive_torque turn"),
        solve={"duration": "0.3 s", "steps": 30, **solve},
    )))  # fmt: skip


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("joint", "start"), [
    (f'universal = ["post.end", "rod.start"], {CROSS}', "initial_speeds = [3.0, -2.0]"),
    (f'universal = ["rod.start", "post.end"], {CROSS}', "initial_speeds = [3.0, -2.0]"),
    ('spherical = ["post.end", "rod.start"]', "angular_velocity = [1.0, 2.0, -3.0]"),
    ('revolute = ["post.end", "rod.start"], axis = [0.48, 0.6, 0.64]', 'angle = "20 deg", initial_speed = 2.0'),
    ('revolute = ["rod.start", "post.end"], axis = [0.48, 0.6, 0.64]', 'angle = "20 deg", initial_speed = 2.0'),
    ('cylindrical = ["post.end", "rod.start"], axis = [0.48, 0.6, 0.64]', "initial_speeds = [0.2, 2.0]"),
    ('cylindrical = ["rod.start", "post.end"], axis = [0.48, 0.6, 0.64]', "initial_speeds = [0.2, 2.0]"),
], ids=["universal", "universal back", "ball", "pin", "pin back", "cylinder", "cylinder back"])  # fmt: skip
def test_what_hardly_deforms_moves_and_is_held_as_what_is_rigid(joint, start):
    """From all its starting speeds, on a post that turns; forces and moments of the joint are the rigid rod's, too."""
    elastic = 'beam = {E = "1e17 Pa", nu = 0.3, rho = 2000, section = {circle = "20 mm"}, elements = 2}'
    mass, across = 2000.0 * math.pi * 0.01**2 * 0.5, 2000.0 * math.pi * 0.01**2 * 0.5**3 / 12.0
    rigid = f"mass = {mass!r}, inertia = [{mass * 0.01**2 / 2!r}, {across!r}, {across!r}]"
    hard = flung(rigid, joint, start, preset="rigid")
    stiff = flung(elastic, joint, start, preset="coupled", modes=1, tolerance=1e-9, start="quasistatic")
    for name, series in stiff.series.items():
        expected = hard.series[name].values
        assert abs(series.values - expected).max() < 1e-4 * max(0.1, abs(expected).max()), name
    beside, turned = (found.model.motion.at(stiff.times) for found in (stiff, hard))
    assert beside["hinge.angle"] == pytest.approx(turned["hinge.angle"], abs=1e-5)


@pytest.mark.exhaustive(group="axes", share=3)
def test_a_strip_slides_and_turns_alike_whichever_body_is_the_first():
    sides = ('["ground", "strip.start"], axis = [0, 0, 1]', '["strip.start", "ground"], axis = [0.28, 0, 0.96]')
    joints = (f"joints.hinge = {{cylindrical = {of}}}" for of in sides)
    one, back = (strip(joint, ASKEW, gravity=(0, -9.81, -3), more=SLID) for joint in joints)
    alike(one, back, 1e-5, ("height", "bend"))
    assert abs(one.series["slid"].values + back.series["slid"].values).max() < 1e-7


def test_the_rigid_mechanism_beside_a_motion_goes_as_its_sections_do():
    """On a ball, whose axes turn by less than these."""
    found = strip('joints.hinge = {spherical = ["ground", "strip.start"]}', TILTED, 3, more="")
    h, twin = 1e-5, found.model.motion.rigid
    before, here, after = (twin.at(0.07 + step) for step in (-h, 0.0, h))
    rate = (after["strip.axes_xx"] - before["strip.axes_xx"]) / (2.0 * h)
    assert rate == pytest.approx(-here["strip.omega_z"] * here["strip.axes_yx"], rel=1e-4)


def test_shapes_have_no_momentum_about_the_axis_of_the_only_joint():
    """About this axis alone the section there turns in the link's axes; the joint's point stays where it is."""
    scene = hanging(PIN, "", 3, ANGLE, [0, 0, 0])
    link = make_link(mechanism_of(scene), "strip", 4)
    basis, M = spatial_shapes(link, 3, (0.0, 0.0, 0.0), "z").basis, link.part.matrices["M"].value({})
    energies, x = np.einsum("aj,ab,bj->j", basis, M, basis), np.array([[node, 0.0, 0.0] for node in link.nodes])
    for axis, unit in zip("xyz", np.eye(3), strict=True):
        turn = np.hstack([np.cross(unit, x), np.tile(unit, (len(x), 1))]).ravel()
        momentum = abs(turn @ M @ basis).max() / np.sqrt((turn @ M @ turn) * energies.max())
        assert (momentum < 1e-10) == (axis == "z") == bool(abs(basis[3 + "xyz".index(axis)]).max())
    assert not basis[:3].any()


@pytest.mark.parametrize("between", [
    "", 'bodies.bob.mass = 1\njoints.middle = {spherical = ["rod.mid", "bob"]}',
], ids=["nothing", "a ball"])  # fmt: skip
def test_shapes_between_two_joints_follow_their_chord(between):
    """On whichever joint the link hangs: no displacement across it at either joint, along it none in the mean; nor does
    a joint between them matter."""
    scene = scene_of(rod('circle = "8 mm"') + between)
    link = make_link(mechanism_of(scene), "rod", 4)
    M = link.part.matrices["M"].value({})
    found = [spatial_shapes(link, 3, (x, 0.0, 0.0), "xyz") for x in (0.0, 0.8)]
    for shapes in found:
        scale = abs(shapes.basis).max()
        assert abs(shapes.basis[[1, 2, -5, -4]]).max() < 1e-12 * scale and abs(shapes.basis[4:6]).max() > 0.1
        assert abs(M[::6].sum(axis=0) @ shapes.basis).max() < 1e-12 * M.sum() * scale
    squares = [np.diag(each.stiffness) / np.diag(each.basis.T @ M @ each.basis) for each in found]
    assert squares[0] == pytest.approx(squares[1], rel=2e-9)


def misaligned(preset: str, modes: int, speed: str = "300 rpm", elements: int = 6):
    """The four-bar whose rocker's axis is a degree off, from rest: its coupler hangs on a universal joint."""
    text = shipped_scenes()["four-bar-misaligned"].read_text().partition("[solve]")[0]
    text = text.replace("300 rpm", speed).replace("elements = 6", f"elements = {elements}")
    text = "\n".join(line for line in text.splitlines() if "bending_moment" not in line)
    tail = f'\n[solve]\npreset = "{preset}"\nmodes = {modes}\nstart = "zero"\nduration = "20 ms"\nsteps = 20\n'
    return solved(scene_of(text + tail))


def apart(one, other, name: str) -> float:
    expected = other.series[name].values
    return float(abs(one.series[name].values - expected).max() / abs(expected).max())


@pytest.mark.exhaustive(group="axes", share=3)
def test_links_on_a_universal_joint_and_a_pin_askew_have_as_many_modes_as_one_likes():
    """Of the shapes that a tangent's axes need, three modes stopped this run after 8.5 ms.

    The third one is worth 0.27 % in the middle of a link: of a pinned beam under an even load, the static share of its
    third mode with held ends. What one-way presets leave out of modes their sensors add (Craig 1981, ch. 15).
    """
    two, three, five, six = (misaligned("coupled", modes) for modes in (2, 3, 5, 6))
    finer = misaligned("coupled", 5, elements=12)
    for name in ("coupler_mid", "follower_mid"):
        assert 1e-3 < apart(two, five, name) < 4e-3, name
        assert apart(three, five, name) < 6e-4 and apart(six, five, name) < 2e-4, name
        assert apart(finer, five, name) < 4e-4, name
    assert all(each.energy.drift < 1e-7 for each in (two, three, five, six))


def test_a_slow_misaligned_four_bar_is_the_stiffened_one():
    slow, one_way = (misaligned(preset, 5, "30 rpm") for preset in ("coupled", "stiffened"))
    alike(slow, one_way, 1e-3, ("coupler_mid", "follower_mid", "out_of_plane"))
