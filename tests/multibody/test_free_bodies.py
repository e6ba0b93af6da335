"""Bodies that no joint holds: flights against closed forms, beams that ring as they fly, what the scene may say."""

import math

import numpy as np
import pytest
from command_line import cli, refused
from machines import machine
from runs import solved, starts_of

import kaneflex
from kaneflex import SceneError, linearise, load, with_settings
from kaneflex.fem.freedom import count_freedom
from kaneflex.integrate.system import Outcome
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.plots import animation, displacements
from kaneflex.plots.style import styled

G = 9.81
THROWN = """
schema = 1
gravity = [0, "-9.81 m/s^2"]
bodies.bar.length = "1 m"
bodies.bar.mass = "2 kg"
bodies.bar.free = {at = [0, "1 m"], angle = "30 deg", velocity = [3, 4], angular_speed = "60 rpm"}
sensors.x = {position = "bar.mid", component = "x"}
sensors.y = {position = "bar.mid", component = "y"}
sensors.angle = {position = "bar", component = "angle"}
solve = {preset = "coupled", duration = "1 s", steps = 50}
"""
BEAM = machine(
    name="free",
    bodies=dict(beam='length = "1 m", '
                     'beam = {material = "steel", section = {rectangle = ["20 mm", "10 mm"]}, elements = 16}, '
                     'free = {velocity = [1, 0], angular_speed = "60 rpm"}'),
    loads=dict(blow='force_on = "beam.mid", direction = [0, 1], law = "1000 * exp(-((t - 0.005) / 0.001)**2)"'),
    sensors=dict(moment="bending_moment beam.mid"), solve=dict(preset="coupled", modes=6, duration="0.05 s", steps=500),
)
PAIR = machine(
    gravity=[0, "-9.81 m/s^2"],
    bodies=dict(one='length = "1 m", mass = "1 kg"',
                two='length = "0.5 m", mass = "3 kg", free = {at = [1, 0], velocity = [0, 5], angular_speed = 3}'),
    joints=dict(pin="revolute one.end two"), drives=dict(pin='free = true, angle = "40 deg", initial_speed = -7'),
    solve=dict(preset="coupled", duration="1 s", steps=50),
)


def scene_of(text, *settings):
    return with_settings(kaneflex.scene_of(text), settings)


def test_a_thrown_bar_flies_on_a_parabola_and_turns_evenly():
    found = solved(scene_of(THROWN))
    t, omega, angle = found.times, 2 * math.pi, math.radians(30)
    c, s = 0.5 * math.cos(angle), 0.5 * math.sin(angle)
    assert found.series["x"].values == pytest.approx(c + (3 - omega * s) * t, rel=1e-9)
    assert found.series["y"].values == pytest.approx(1 + s + (4 + omega * c) * t - 0.5 * G * t**2, rel=1e-9)
    assert found.series["angle"].values == pytest.approx(angle + omega * t, rel=1e-9)
    assert found.trajectory.energy.drift < 1e-9
    assert "3 degrees of freedom" in repr(found.model)


def test_a_beam_that_nothing_holds_has_the_frequencies_of_a_free_one():
    """(beta l)^2 sqrt(E I/(rho A l^4)) with cos(beta l) cosh(beta l) = 1 (Blevins 1979, table 8-1)."""
    scene = scene_of(BEAM, "bodies.beam.free.angular_speed=0", "beam.elements=32", "solve.modes=12")
    system = linearise(load(scene))
    omega = np.sort(abs(np.linalg.eigvals(system.A)))[::2]
    beam = scene.bodies["beam"]
    exact = np.array([4.730040745, 7.853204624, 10.995607838]) ** 2 * math.sqrt(beam.E_I / beam.rho_A)
    assert omega[:3] == pytest.approx(0.0, abs=1e-3 * exact[0])
    assert omega[3:5] == pytest.approx(exact[:2], rel=2e-5)
    assert omega[5] == pytest.approx(exact[2], rel=2e-4)  # of as many modes between held points


def test_a_blow_moves_the_centre_of_a_ringing_beam_by_its_impulse():
    """A free frame stands in the mean over the mass: half a length ahead of it is the centre, however it bends."""
    found = solved(scene_of(BEAM))
    q, v = found.trajectory.q, found.trajectory.v
    mass = found.model.scene.bodies["beam"].mass
    c, s = 0.5 * np.cos(q[:, 2]), 0.5 * np.sin(q[:, 2])
    assert v[:, 0] - v[:, 2] * s == pytest.approx(1.0, abs=1e-8)
    across = v[:, 1] + v[:, 2] * c
    erf = np.array([math.erf((t - 0.005) / 0.001) for t in found.times])
    given = 2 * math.pi * 0.5 + 1000 * 0.001 * math.sqrt(math.pi) / 2 * (erf + math.erf(5)) / mass
    assert across == pytest.approx(given, rel=1e-6)
    assert abs(found.series["moment"].values).max() > 30
    assert found.trajectory.energy.drift < 1e-7


def test_the_animation_of_a_ringing_beam_says_how_far_it_is_enlarged(tmp_path, monkeypatch):
    made, new_figure = [], animation.new_figure
    monkeypatch.setattr(animation, "new_figure", lambda *size: made.append(new_figure(*size)) or made[-1])
    with styled():
        found = solved(scene_of(BEAM, "solve.steps=20"))
        animation.animate(found, tmp_path / "beam.gif", 2)
        assert set(displacements.figures(found)) == {"nodal_displacements", "mid_beam"}
        assert set(displacements.surfaces(found)) == {"surfaces_beam"}
    assert made[0].get_suptitle().startswith("free: deformation enlarged")


def test_two_bodies_with_a_pin_keep_the_motion_of_their_centre_and_their_spin():
    found = solved(scene_of(PAIR))
    system, trajectory = found.model.coupled, found.trajectory
    mass, length = np.array([1.0, 3.0]), np.array([1.0, 0.5])
    rows = [starts_of(system)["one"], starts_of(system)["two"]]
    q, v = (np.stack([part[:, k : k + 3] for k in rows], 1) for part in (trajectory.q, trajectory.v))
    arm = 0.5 * length[:, None] * np.stack([np.cos(q[..., 2]), np.sin(q[..., 2])], -1)
    place = q[..., :2] + arm
    speed = v[..., :2] + v[..., 2:] * np.stack([-arm[..., 1], arm[..., 0]], -1)
    centre = (mass[:, None] * place).sum(1) / 4
    t = found.times[:, None]
    first = (mass[:, None] * speed).sum(1)[0] / 4
    assert centre == pytest.approx(centre[0] + first * t - 0.5 * np.array([0, G]) * t**2, abs=1e-7)
    off, rate = place - centre[:, None], speed - (first - np.array([0, G]) * t)[:, None]
    spin = (mass * (off[..., 0] * rate[..., 1] - off[..., 1] * rate[..., 0])).sum(1)
    spin += (mass * length**2 / 12 * v[..., 2]).sum(1)
    assert spin == pytest.approx(spin[0], rel=1e-7)
    assert trajectory.energy.drift < 1e-7
    assert q[0, 1] == pytest.approx([1, 0, 0]) and v[0, 1] == pytest.approx([0, 5, 3])
    assert v[0, 0, 2] - v[0, 1, 2] == pytest.approx(7)
    count = count_freedom(mechanism_of(found.model.scene))
    assert (count.floating, count.left) == (("two",), 0)


LOOSE = machine(
    bodies=dict(crank='length = "50 mm", mass = "0.3 kg"', piston='mass = "0.14 kg"',
                rod='length = "120 mm", mass = "0.07 kg", '
                    'free = {at = ["50 mm", 0], velocity = [0, "15.70796326794897 m/s"], angular_speed = "-1250 rpm"}'),
    joints=dict(main="revolute ground crank", bore="prismatic ground piston, direction = [1, 0]",
                big='revolute crank.end rod, '
                    'clearance = {radial = "0.01 mm", contact = {stiffness = 1e11, restitution = 0.3}}',
                wrist='revolute rod.end piston, '
                      'clearance = {radial = "0.01 mm", contact = {stiffness = 1e11, restitution = 0.3}}'),
    drives=dict(main='speed = "3000 rpm"', bore='free = true, position = "170 mm"'),
    sensors=dict(slide="position bore", push="contact_force big"),
    solve=dict(preset="coupled", duration="20 ms", steps=200),
)


def test_a_rod_with_room_at_both_ends_follows_the_tight_mechanism():
    """By the clearances along it; the tight one is r cos(a) + sqrt(l^2 - r^2 sin(a)^2)."""
    found = solved(scene_of(LOOSE))
    a = 100 * math.pi * found.times
    tight = 0.05 * np.cos(a) + np.sqrt(0.12**2 - (0.05 * np.sin(a)) ** 2)
    apart = abs(found.series["slide"].values - tight).max()
    assert 1e-5 < apart < 4e-5
    assert found.trajectory.energy.drift < 1e-5
    assert {impact.contact for impact in found.impacts} == {"big", "wrist"}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("e", [0, 0.5])
def test_an_elastic_rod_loose_at_both_ends_parts_as_slowly_as_the_other_end_makes_it(e):
    """By Newton's law: a resting end that another impact lifts hardly at all rests on, and nothing cascades."""
    text = LOOSE.replace("stiffness = 1e11, restitution = 0.3", f'law = "newton", restitution = {e}')
    beam = 'beam = {material = "steel", section = {rectangle = ["6 mm", "12 mm"]}, elements = 6}'
    found = solved(scene_of(text.replace('mass = "0.07 kg"', beam).replace("0.01 mm", "0.1 mm")))
    a = 100 * math.pi * found.times
    tight = 0.05 * np.cos(a) + np.sqrt(0.12**2 - (0.05 * np.sin(a)) ** 2)
    assert found.outcome is Outcome.COMPLETED
    assert 1e-4 < abs(found.series["slide"].values - tight).max() < 4e-4
    assert found.trajectory.energy.drift < 1e-5


@pytest.mark.parametrize(("settings", "said"), [
    (["solve.preset=rigid"], r"bodies\.bar\.free: preset rigid does not support a free body.*Use preset coupled"),
    (["solve.preset=stiffened"], r"bodies\.bar\.free: preset stiffened does not support a free body"),
    (["solve.start=quasistatic"], r"solve\.start = 'quasistatic': bodies\.bar is free, so there is no equilibrium"),
    (["bodies.bar.pose.angle=0"], r"bodies\.bar\.free: bodies with poses don't move"),
    (["bodies.bar.free=none"], r"drives: the position of bar is not determined.*or let one be free"),
    (["bodies.bar.free.velocity=3"], r"bodies\.bar\.free\.velocity = 3: not a vector"),
])  # fmt: skip
def test_what_is_free_is_said_once_and_moves_by_preset_coupled(settings, said):
    with pytest.raises(SceneError, match=said):
        load(scene_of(THROWN, *settings))


def test_a_body_that_joints_hold_is_not_free():
    pinned = THROWN + 'joints.pin = {revolute = ["ground", "bar"]}'
    with pytest.raises(SceneError, match=r"bodies\.bar\.free: joints and drives determine .*Leave free out"):
        load(scene_of(pinned))


def test_free_bodies_are_counted_and_not_built_in_the_peer(tmp_path):
    path = tmp_path / "thrown.toml"
    path.write_text(THROWN)
    shown = cli("show", path, "-o", tmp_path / "thrown.png")
    assert "free bodies    -3  bar" in shown.output
    assert "left            0  forces drive the free joints" in shown.output
    command = ("compare", path, "--with", "exudyn", "-o", tmp_path / "out")
    refused(cli(*command), "bodies.bar.free", "a free body is not supported by the other program")
