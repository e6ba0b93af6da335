"""Friction that sticks and slips, against closed forms: guides, pins and contacts."""

import math

import numpy as np
import pytest
from machines import WEIGHT, block, machine, pendulum, slider_crank
from runs import names_of

from kaneflex import SceneError, linearise, load, read_scene, scene_of, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.report.presentation import friction_line
from kaneflex.report.summary import summarise
from kaneflex.scene.contact_check import FRICTION_RESULTS
from kaneflex.solve.simulation import solve
from kaneflex.solve.touching import friction_summaries

G, SLOPE = 9.81, math.radians(30)
BLOCK = block(
    'mass = "2 kg"', "free = true, initial_speed = 0", gravity=[G * math.sin(SLOPE), -G * math.cos(SLOPE)],
    more={"slide": "friction = {mu = 0.3}"},
    sensors="""
x = {position = "slide"}
drag = {friction_force = "slide"}""",
    solve={"preset": "coupled", "duration": "1 s", "steps": 100},
)
"""A block on an incline, x down the slope."""
HINGE = pendulum(
    'mass = "1 kg", inertia = "0.02 kg m^2"', "free = true, initial_speed = 3", "wheel",
    more={"hinge": 'friction = {mu = 0.2, radius = "10 mm", preload = "0.005 N m"}'}, gravity=WEIGHT,
    sensors="""
angle = {position = "hinge", component = "angle"}
drag = {friction_torque = "hinge"}""",
    solve={"preset": "coupled", "duration": "4 s", "steps": 100},
)


def solved(text, *settings, outcome=Outcome.COMPLETED):
    found = solve(load(with_settings(scene_of(text), settings)))
    assert found.outcome is outcome, found.trajectory.message
    if outcome is Outcome.COMPLETED:
        energy = found.trajectory.energy
        parts = energy.kinetic, energy.strain, energy.weight, energy.dissipated, energy.supplied
        turned = np.ptp(parts, axis=1).max()
        assert abs(energy.gap).max() < 1e-6 * turned + 1e-11
    return found


def slid(t, start, speed, mu):
    """Place and speed of the block, which a start up the slope turns round, or stops."""
    up = -G * (math.sin(SLOPE) + mu * math.cos(SLOPE)) if speed > 0 else G * (math.sin(SLOPE) + mu * math.cos(SLOPE))
    stop = -speed / up if speed else 0.0
    down = G * (math.sin(SLOPE) - mu * math.cos(SLOPE))
    before, after = np.minimum(t, stop), np.maximum(t - stop, 0.0)
    falls = max(down, 0.0)
    return start + speed * before + up * before**2 / 2 + falls * after**2 / 2, stop


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
@pytest.mark.parametrize(("mu", "speed"), [(0.3, 0.0), (0.3, -1.0), (0.8, -1.0), (0.8, 0.0), (0.57, 0.0), (0.58, 0.0)])
def test_a_block_slides_down_stops_and_turns_round_as_in_textbooks(mu, speed, integrator):
    settings = [f"slide.friction.mu={mu}", f"drives.slide.initial_speed={speed}", f"solve.integrator={integrator}"]
    found = solved(BLOCK, *settings)
    place, stop = slid(found.times, 0.0, speed, mu)
    assert found.series["x"].values == pytest.approx(place, abs=1e-12)
    held = G * min(math.sin(SLOPE), mu * math.cos(SLOPE))
    after = found.times > stop + 1e-9
    assert found.series["drag"].values[after] == pytest.approx(-2 * held, rel=1e-12)
    stuck = found.trajectory.frictions.mode[:, 0] == 2
    assert (stuck[after] == (mu > math.tan(SLOPE))).all() and not stuck[found.times < stop].any()


LEVEL = BLOCK.replace(f"gravity = [{G * math.sin(SLOPE)}, {-G * math.cos(SLOPE)}]", f"gravity = [0, {-G}]")


def test_a_drive_supplies_what_friction_at_its_own_joint_takes():
    """Work of the prescribed drive, between stored instants by its power: mu m g times the distance, and m v^2 / 2."""
    driven = LEVEL.replace("slide = {free = true, initial_speed = 0}", 'slide = {law = "0.2 * t**2 + 0.1 * t"}')
    found = solved(driven, "solve.steps=10")
    t = np.linspace(0.0, 1.0, 21)
    work = 0.3 * 2 * G * (0.2 * t**2 + 0.1 * t) + (0.4 * t + 0.1) ** 2 - 0.1**2
    assert found.at(t).trajectory.energy.supplied == pytest.approx(work, rel=1e-9, abs=1e-12)


def test_a_block_on_an_incline_sticks_for_ever():
    """After 100,000 steps, pushed and shaken by less than what holds it, it has not moved by a rounding."""
    text = BLOCK + 'loads.shake = {force_on = "block", direction = [1, 0], law = "1.5 * sin(700 * t)"}\n'
    settings = ["slide.friction.mu=0.7", "drives.slide.position=0.37 m", "solve.duration=100 s", "solve.steps=100000"]
    found = solved(text, *settings)
    assert found.trajectory.steps >= 10**5
    assert abs(found.series["x"].values - 0.37).max() == 0.0
    assert (found.trajectory.frictions.mode == 2).all() and found.trajectory.frictions.lost[-1, 0] == 0.0


FEET = """
schema = 1
description = "A block on two feet is pulled ever harder"
gravity = [0, "-9.81 m/s^2"]
bodies.block.length = "100 mm"
bodies.block.mass = "1 kg"
bodies.block.inertia = "1e-3 kg m^2"
bodies.block.centre = ["50 mm", "20 mm"]
bodies.block.free = {at = [0, 0]}
contacts.back.point_on_line = ["block.start", "ground"]
contacts.back.normal = [0, 1]
contacts.back.contact = {CONTACT}
contacts.back.friction = {mu = 0.4, mu_static = STATIC}
contacts.front.point_on_line = ["block.end", "ground"]
contacts.front.normal = [0, 1]
contacts.front.contact = {CONTACT}
contacts.front.friction = {mu = 0.4, mu_static = STATIC}
loads.pull = {force_on = "block.end", direction = [1, 0], law = "20 * t"}
sensors.way = {position = "block"}
solve = {preset = "coupled", duration = "0.3 s", steps = 60}
"""


@pytest.mark.parametrize("static", [0.4, 0.5])
@pytest.mark.parametrize("contact", [
    'law = "newton", restitution = 0', "stiffness = 1e8, restitution = 0.5",
    'law = "kelvin-voigt", exponent = 1, stiffness = 1e6, damping = 600',
])  # fmt: skip
def test_two_feet_of_a_block_let_go_together(contact, static):
    """However its weight is on them: where both can bear no more than the pull P t it begins to slide, for good."""
    solution = solve(load(scene_of(FEET.replace("CONTACT", contact).replace("STATIC", str(static)))))
    weight, P = 9.81, 20.0
    begin = static * weight / P
    late = np.maximum(solution.times - begin, 0.0)
    way = P * late**3 / 6 + (static - 0.4) * weight * late**2 / 2
    assert solution.outcome is Outcome.COMPLETED
    assert solution.series["way"].values == pytest.approx(way, abs=5e-7)  # it settles on its feet as it slides already
    assert solution.trajectory.energy.drift < 1e-9


def test_what_holds_is_more_than_what_drags():
    """A force that grows breaks the block loose at mu_static N; then mu N resists."""
    text = BLOCK.replace(f"gravity = [{G * math.sin(SLOPE)}", "gravity = [0")
    text = text.replace("mu = 0.3", "mu = 0.2, mu_static = 0.5")
    found = solved(text + 'loads.pull = {force_on = "block", direction = [1, 0], law = "20 * t"}')
    N = 2 * G * math.cos(SLOPE)
    loose, t = 0.5 * N / 20, found.times
    s = np.maximum(t - loose, 0.0)
    assert found.series["x"].values == pytest.approx(0.3 * N / 2 * s**2 / 2 + 20 / 2 * s**3 / 6, abs=1e-10)
    assert found.series["drag"].values == pytest.approx(np.where(t < loose, -20 * t, -0.2 * N), rel=1e-9)


def test_a_flywheel_runs_down_linearly():
    found = solved(HINGE)
    slower = (0.2 * 0.01 * G + 0.005) / 0.02
    t = np.minimum(found.times, 3 / slower)
    assert found.series["angle"].values == pytest.approx(3 * t - slower * t**2 / 2, abs=1e-12)
    assert found.trajectory.frictions.lost[-1, 0] == pytest.approx(0.09, rel=1e-12)


def test_a_pendulum_loses_twice_what_its_dry_torque_turns():
    """A preload alone: the energy falls by it times the angle swept, swing by swing, and it stops within its reach."""
    text = HINGE.replace('wheel = {mass = "1 kg",', 'wheel = {mass = "1 kg", centre = ["0.1 m", 0],')
    text = text.replace("mu = 0.2, radius = \"10 mm\", ", "").replace("0.005 N m", "0.05 N m")
    found = solved(text, "solve.duration=20 s", "solve.steps=4000", "drives.hinge.angle=-20 deg")
    angle = found.series["angle"].values
    swept = abs(np.diff(found.trajectory.frictions.lost[:, 0])) / 0.05
    assert swept.sum() >= abs(np.diff(angle)).sum() * (1 - 1e-9)
    turns = angle[1:-1][(np.diff(angle)[1:] * np.diff(angle)[:-1]) < 0]
    assert len(turns) > 4
    end = angle[-1]
    assert abs(G * 0.1 * math.cos(end)) <= 0.05 and found.trajectory.frictions.mode[-1, 0] == 2


def test_a_block_on_a_belt_sticks_and_slips_as_in_closed_form():
    """Rabinowicz 1958: carried to F_s/k, it slips about F_k/k and sticks where it is as fast as the belt again."""
    found = solve(load(read_scene("stick-slip")))
    v, held, slides, w = 0.1, 0.4 * G / 100, 0.3 * G / 100, 10.0
    excess = held - slides
    slip, stick = 2 / w * (math.pi - math.atan(excess * w / v)), 2 * excess / v
    loose = held / v
    since = np.mod(found.times - loose, slip + stick)
    place = slides + excess * np.cos(w * since) + v / w * np.sin(w * since)
    place = np.where(since > slip, slides - excess + v * (since - slip), place)
    place = np.where(found.times < loose, v * found.times, place)
    assert found.times[-1] > loose + 5 * (slip + stick)
    assert found.series["place"].values == pytest.approx(place, abs=1e-9)
    stuck = found.trajectory.frictions.mode[:, 0] == 2
    inside = (found.times > loose) & (abs(since - slip) > 1e-6) & (since > 1e-6) & (slip + stick - since > 1e-6)
    assert (stuck[inside] == (since > slip)[inside]).all()
    assert found.trajectory.energy.drift < 1e-9


ROD = machine(
    description="Painleve's rod: it slides on its end over a rough floor", gravity=[0, "-9.81 m/s^2"],
    bodies=dict(rod='length = "1 m", mass = "1 kg", inertia = "0.0833333 kg m^2", centre = [0.5, 0], '
                    'free = {at = [0, "1e-6 m"], angle = "60 deg", velocity = ["-2 m/s", 0]}'),
    contacts=dict(floor='point_on_line = ["rod", "ground"], normal = [0, 1], '
                        'contact = {stiffness = 1e7, restitution = 0.5}, friction = {mu = 1.0}'),
    sensors=dict(y="position rod y"), solve=dict(preset="coupled", duration="0.3 s", steps=3000),
)


@pytest.mark.parametrize("angle", [60, 120])
def test_painleves_rod_jams_by_its_floors_stiffness_and_not_otherwise(angle):
    """Pushed before its centre of mass a slender rod has no rigid solution above mu = 4/3: it presses the floor in."""
    peaks = []
    for mu in (0.0001, 0.3, 1.0, 1.5, 2.0):
        found = solved(ROD, f"floor.friction.mu={mu}", f"rod.free.angle={angle} deg")
        record = found.trajectory.frictions
        assert np.isfinite(found.trajectory.q).all()
        assert (abs(record.force) <= mu * record.pressed * (1 + 1e-9) + 1e-12).all()
        assert (record.force * record.speed <= 1e-9 * abs(record.force).max()).all()
        peaks.append(max(impact.peak for impact in found.impacts))
    assert (peaks[3] > 5 * peaks[2]) == (angle == 60)


@pytest.mark.parametrize("friction", ["mu", "lugre"])
@pytest.mark.parametrize("angle", [50, 60, 70, 120])
def test_painleves_paradox_is_named_where_a_rod_is_in_it(angle, friction):
    """m A = 1 + 3 cos(a) (cos(a) - mu sin(a)), what a force on its end opens, is below zero (Painleve 1895)."""
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    least = (1 / (3 * c) + c) / s
    bristles = 'law = "lugre", bristle_stiffness = 1e7, ' if friction == "lugre" else ""
    for mu in ((0.98 * least, 1.02 * least) if c > 0 else (0.5, 2.0)):
        text = ROD.replace("friction = {mu = 1.0}", f"friction = {{{bristles}mu = {mu}}}")
        settings = f"rod.free.angle={angle} deg", "solve.duration=0.001 s", "solve.steps=100"
        found = solved(text, *settings)
        (jams,) = found.trajectory.frictions.jams
        said = [text for text in found.warnings if "Painleve" in text]
        assert len(said) == (mu > least > 0) and all("friction at floor" in text for text in said)
        assert summarise(found).frictions["floor"].jams_at_s == (jams if said else None)
        assert np.isfinite(jams) == bool(said)
        if said:
            assert 0 <= jams - found.impacts[0].begin < 2e-4


@pytest.mark.parametrize(
    ("drive", "count"), [("speed = 0", 101), ('law = "0.1 * step(t, 0, 0, 2, 1)"', 51), ("speed = 1", 0)]
)
def test_friction_of_a_joint_that_its_drive_holds_still_is_said_to_be_undetermined(drive, count):
    """It read 0 from a stand and mu r N after a motion, either without a word: both agree with Coulomb's law."""
    text = HINGE.replace("free = true, initial_speed = 3", drive).replace('"0.005 N m"', '"0.1 N m"')
    found = solve(load(scene_of(text)))
    said = [warning for warning in summarise(found).warnings if "friction at hinge" in warning]
    assert len(said) == (count > 0)
    if said:
        limit = 0.2 * 0.01 * G + 0.1
        assert f"statically indeterminate at {count} of 101 instants" in said[0]
        assert f"between -{limit:.4g} and {limit:.4g} N m is possible" in said[0]


CRANK = slider_crank(
    'length = "0.1 m", mass = "0.5 kg", inertia = "1e-3 kg m^2", centre = [0.05, 0]',
    'length = "0.3 m", mass = "0.5 kg", inertia = "4e-3 kg m^2", centre = [0.15, 0]',
    'mass = "0.6 kg"', 'free = true, angle = "20 deg", initial_speed = 20', gravity=WEIGHT,
    more={
        "main": 'friction = {mu = 0.1, radius = "10 mm"}', "pin": 'friction = {mu = 0.1, radius = "8 mm"}',
        "wrist": 'friction = {mu = 0.1, radius = "6 mm"}', "bore": 'friction = {mu = 0.15, length = "40 mm"}',
    },
    sensors='angle = {position = "main", component = "angle"}',
    solve={"preset": "coupled", "duration": "2 s", "steps": 200},
)  # fmt: skip


def test_a_mechanism_whose_joints_all_rub_comes_to_rest():
    """All four joints stand still at one instant, and what any of them holds the others hold, too."""
    found = solved(CRANK)
    record = found.trajectory.frictions
    assert abs(record.speed[-1]).max() < 1e-10 and (record.mode[-1] == 2).any()
    assert record.lost[-1].sum() == pytest.approx(found.trajectory.energy.dissipated[-1], rel=1e-12)
    sliding = abs(record.speed) > 1e-6
    assert (record.force * record.speed <= 0)[sliding].all()
    limit = record.pressed * np.array([0.1, 0.1, 0.1, 0.15])
    assert abs(record.force)[sliding] == pytest.approx(limit[sliding], rel=1e-9)
    assert (abs(record.force) <= limit * (1 + 1e-9)).all()


FALLING = machine(
    description="A block on a sliding carriage falls on a floor that rubs", gravity=[0, "-9.81 m/s^2"],
    bodies=dict(carriage='mass = "1 kg"', block='mass = "2 kg"'),
    joints=dict(way="prismatic ground carriage, direction = [1, 0]",
                fall="prismatic carriage block, direction = [0, 1]"),
    drives=dict(way="free = true, initial_speed = 3", fall='free = true, position = "50 mm"'),
    contacts=dict(floor='point_on_line = ["block", "ground"], normal = [0, 1], '
                        'contact = {stiffness = 1e8, restitution = 0.6}, friction = {mu = 0.2, mu_static = 0.3}'),
    sensors=dict(x="position way", drag="friction_force floor"),
    solve=dict(preset="coupled", duration="1 s", steps=400),
)


def test_a_block_that_bounces_rubs_by_the_impulses_of_its_floor():
    """While it slides friction has mu times the normal impulse, which is what weight and fall have; then it sticks."""
    found = solved(FALLING, "solve.duration=0.6 s")
    t, v, record = found.times, found.trajectory.v, found.trajectory.frictions
    names = names_of(found.model.coupled)
    x, y = (v[:, names.index(name)] for name in ("carriage.x", "block.y"))
    normal = 2 * (G * t + y)
    assert len(found.impacts) > 4
    assert 3 * (x - 3) == pytest.approx(-0.2 * normal, rel=1e-8, abs=1e-8)
    sliding = record.pressed[:, 0] > 0
    assert record.force[sliding, 0] == pytest.approx(0.2 * record.pressed[sliding, 0], rel=1e-12)  # to the left
    long = solved(FALLING, "solve.duration=3 s")
    assert long.trajectory.frictions.mode[-1, 0] == 2
    assert (long.series["x"].values[long.times > 2.5] == long.series["x"].values[-1]).all()
    assert long.trajectory.frictions.lost[-1, 0] == pytest.approx(13.5, rel=1e-7)


def test_a_block_wears_its_guide_by_its_normal_force_and_path():
    """Archard's law, V = k N s; a pin's torque N and angle s give the same."""
    block = BLOCK.replace("mu = 0.3", "mu = 0.3, wear = '2e-6 mm^3/(N m)'")
    slid = solved(block)
    assert friction_line(slid.model.scene.frictions["slide"]) == "coulomb, mu 0.3, wear 2e-15 m^2/N"
    path = slid.series["x"].values[-1] - slid.series["x"].values[0]
    assert friction_summaries(slid)["slide"].worn == pytest.approx(2e-15 * 2 * G * math.cos(SLOPE) * path, rel=1e-9)
    hinge = HINGE.replace('preload = "0.005 N m"', "wear = 1e-15").replace("mu = 0.2", "mu = 0.02")
    turned = solved(hinge)
    path = 0.01 * abs(np.diff(turned.series["angle"].values)).sum()
    assert friction_summaries(turned)["hinge"].worn == pytest.approx(1e-15 * G * path, rel=1e-9)
    assert friction_summaries(solved(BLOCK))["slide"].worn is None


def test_the_one_way_presets_name_what_has_friction():
    with pytest.raises(SceneError, match=r"joints\.slide\.friction: preset rigid does not support friction.*coupled"):
        solved(BLOCK, "solve.preset=rigid")
    with pytest.raises(SceneError, match=r"with joints\.slide\.friction the equations are nonlinear"):
        linearise(load(scene_of(BLOCK)))


@pytest.mark.parametrize(("scene", "written", "instead", "says"), [
    (BLOCK, "mu = 0.3", "mu = 0.3, radius = 0.1", "friction.radius.*does not apply to a prismatic joint"),
    (BLOCK, "mu = 0.3", "mu = 0.3, mu_static = 0.2", "mu_static.*below mu = 0.3"),
    (BLOCK, "mu = 0.3", "mu = -0.3", "must not be negative"),
    (BLOCK, "mu = 0.3", "preload = '3 N m'", "preload.*force"),
    (BLOCK, "mu = 0.3", "law = 'stribeck', mu = 0.3", "needs a stribeck_speed"),
    (BLOCK, "mu = 0.3", "law = 'viscous', mu = 0.3", "law viscous does not use it"),
    (BLOCK, "mu = 0.3", "", "there is no friction"),
    (BLOCK, "mu = 0.3", "mu = 0.3, wear = 0", "wear = 0: a wear coefficient must be above zero"),
    (BLOCK, "mu = 0.3", "mu = 0.3, wear = 1e-15, preload = 1", "wear.*must be mu N alone. Give mu, and leave preload"),
    (BLOCK, "mu = 0.3", "mu = 0.3, wear = '1 N'", "wear.*wear coefficient"),
    (HINGE, ', radius = "10 mm"', "", "friction torque of a pin needs its radius"),
    (HINGE, "0.005 N m", "5 N", "preload.*torque"),
    (HINGE, "friction_torque", "friction_force", "Write friction_torque"),
])  # fmt: skip
def test_what_a_friction_lacks_is_named(scene, written, instead, says):
    with pytest.raises(SceneError, match=says):
        solved(scene.replace(written, instead))


KLEIN = machine(
    ground=dict(high=[0, "0.8660254037844386 m"]),
    bodies=dict(low='mass = "1 kg"', high='mass = "1 kg"', rod='length = "1 m", mass = "1e-9 kg"'),
    joints=dict(floor="prismatic ground low, direction = [1, 0], friction = {mu = 1}",
                ceiling="prismatic ground.high high, direction = [1, 0]", foot="revolute low rod",
                head='revolute rod.end high, near = {rod = "60 deg"}'),
    drives=dict(floor='free = true, initial_speed = "1 m/s"'),
    loads=dict(push='force_on = "high", direction = [1, 0], law = "10"'),
    sensors=dict(x="position floor", rub="friction_force floor"),
    solve=dict(preset="coupled", duration="0.2 s", steps=100),
)


@pytest.mark.parametrize("mu", [0.05, 1.0])
def test_two_blocks_on_guides_with_a_rod_between_them_slide_to_rest(mu):
    """Painleve and Klein's (Klein 1909, Z. Math. Phys. 58, 186): m a = P - R cos(b), m a = R cos(b) - mu R sin(b)."""
    found = solve(load(with_settings(scene_of(KLEIN), [f"floor.friction.mu={mu}"])))
    c, s = 0.5, math.sqrt(0.75)
    R = 10 / (2 * c - mu * s)
    a, t = 10 - R * c, found.times
    stop = -1 / a if a < 0 else math.inf
    assert found.series["x"].values == pytest.approx(np.where(t < stop, t + a * t**2 / 2, -0.5 / a), abs=1e-7)
    assert abs(found.series["rub"].values[t < 0.9 * stop]) == pytest.approx(mu * R * s, rel=1e-7)


@pytest.mark.parametrize("law, reached", [("10", 0.0), ("400 * (t - 0.02)", 0.02)])
def test_friction_that_no_reaction_agrees_with_ends_the_run(law, reached):
    """mu tan(b) > 2: while they slide, a rod that is pushed against the rough guide has no force (Painleve 1895)."""
    settings = ["floor.friction.mu=2", f'push.law="{law}"', "floor.initial_speed=5 m/s"]
    found = solve(load(with_settings(scene_of(KLEIN), settings)))
    assert found.outcome in (Outcome.PARADOX, Outcome.SINGULAR)
    assert "no combination of sticking and slipping" in found.message
    assert found.times[-1] == pytest.approx(reached, abs=0.004)


ARM = machine(
    gravity=[0, "-9.81 m/s^2"],
    bodies=dict(arm='length = "1 m", mass = "2 kg"', block='mass = "0.5 kg", inertia = "0.001 kg m^2"'),
    joints=dict(hinge="revolute ground arm",
                slot='prismatic arm block, direction = [1, 0], friction = {preload = "100 N"}'),
    drives=dict(hinge='free = true, angle = "30 deg", initial_speed = "60 rpm"',
                slot='free = true, position = "0.6 m"'),
    sensors=dict(way="position slot", angle="position hinge angle"),
    solve=dict(preset="coupled", duration="10 s", steps=500),
)


def test_a_block_that_is_stuck_in_a_slot_that_turns_stays_where_it_stuck(tmp_path):
    """Its steps are curved, and what is left of their errors doesn't grow; the arm swings as with a welded block."""
    found = solved(ARM)
    assert abs(found.series["way"].values - 0.6).max() < 3e-10
    assert (found.trajectory.frictions.mode == 2).all()
    welded = ARM.replace('prismatic = ["arm", "block"], direction = [1, 0], friction = {preload = "100 N"}',
                         'weld = ["arm.there", "block"]')  # fmt: skip
    for line in ('drives.slot = {free = true, position = "0.6 m"}\n', 'sensors.way = {position = "slot"}\n'):
        welded = welded.replace(line, "")
    welded = welded.replace('arm = {length = "1 m", ', 'arm = {length = "1 m", points = {there = ["0.6 m", 0]}, ')
    other = solve(load(with_settings(read_scene(write(tmp_path, welded)), [])))
    assert found.series["angle"].values == pytest.approx(other.series["angle"].values, abs=1e-6)


def write(tmp_path, text):
    path = tmp_path / "other.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("friction", "force"), [
    ('law = "viscous", viscous = "4 N s/m"', lambda v: 4 * v),
    ('law = "stribeck", mu = 0.1, mu_static = 0.4, stribeck_speed = "0.3 m/s", viscous = "1 N s/m"',
     lambda v: 2 * G * (0.1 + 0.3 * math.exp(-((v / 0.3) ** 2))) + v),
])  # fmt: skip
def test_viscous_friction_and_stribecks_slow_a_block_down_by_their_laws(friction, force):
    """Against scipy's integrator of m v' = -f(v), up to where it stops."""
    from scipy.integrate import solve_ivp

    level = LEVEL.replace("friction = {mu = 0.3}", f"friction = {{{friction}}}")
    found = solved(level, "drives.slide.initial_speed=1", "solve.duration=0.5 s")
    exact = solve_ivp(
        lambda t, y: [y[1], -force(y[1]) / 2 if y[1] > 0 else 0.0], (0, 0.5), [0.0, 1.0], "DOP853", found.times,
        rtol=1e-12, atol=1e-13,
    )  # fmt: skip
    moving = exact.y[1] > 1e-3
    assert moving.sum() > 20
    assert found.series["x"].values[moving] == pytest.approx(exact.y[0][moving], abs=1e-8)


@pytest.mark.parametrize("name", ["pin", "pin_torque", "friction_lost"])
def test_no_sensor_has_the_name_of_a_result_of_friction(name):
    with pytest.raises(SceneError, match=rf"sensors.{name}: friction has a result of this name"):
        solved(HINGE.replace("drag =", f"{name} ="))


def test_results_have_torques_of_pins_apart_from_forces():
    hinge = solved(HINGE)
    found = hinge.dataset
    assert "friction_force" not in found and found["pin"].values.tolist() == ["hinge"]
    others = {"time", "drive_angle_hinge", "state", "last_state", "last_rate"}
    assert set(found.variables) - set(hinge.series) - others == {each for each in FRICTION_RESULTS if "pin" in each}
    assert (found["pin_torque"].attrs["units"], found["pin_speed"].attrs["units"]) == ("N m", "rad/s")
    assert (found["pin_torque"].values[:, 0] == hinge.series["drag"].values).all()
    slide = solved(BLOCK)
    found = slide.dataset
    assert "pin_torque" not in found and found["friction_force"].attrs["units"] == "N"
    assert (found["friction_force"].values[:, 0] == slide.series["drag"].values).all()
    for solution, name, unit in ((hinge, "hinge", "torque"), (slide, "slide", "force")):
        summary = summarise(solution).frictions[name]
        largest = {"force": summary.largest_force, "torque": summary.largest_torque}
        assert largest.pop(unit) == abs(solution.series["drag"].values).max() and [*largest.values()] == [None]


def test_what_friction_holds_has_no_energy_to_balance():
    """What rounding turns over, of a guide that leans as a decimal says, is none."""
    leaning = ("gravity=[0, -9.81]", "joints.slide.direction=[0.9612617, -0.2756374]", "solve.steps=20")
    assert solved(BLOCK, *leaning).warnings == ()


DISCS = """
schema = 1
bodies.a = {{mass = {mass}, inertia = {inertia}, free = {{velocity = [0.2, 0.1], angular_speed = 1}}}}
bodies.b.mass = {mass}
bodies.b.inertia = {inertia}
bodies.b.free = {{at = [0.5, 0.35], velocity = [-2, -1.2], angular_speed = -1}}
contacts.k.circle_on_circle = ["a", "b"]
contacts.k.radii = [0.08, 0.06]
contacts.k.contact = {{stiffness = {stiffness}, restitution = 0.5}}
contacts.k.friction = {{mu = 0.3}}
sensors.turning = {{velocity = "b", component = "angle"}}
solve = {{preset = "coupled", duration = 0.6, steps = 60}}
"""


def test_what_sticks_until_the_sides_part_lets_go_whatever_the_unit_of_force():
    """Of forces below 1e-9 N, as of bodies of some 1e-11 kg, it never did: the run ended as a cascade."""
    found = [solve(load(scene_of(DISCS.format(mass=m, inertia=0.005 * m, stiffness=5e5 * m))))
             for m in (1.0, 1e-11, 1.3e-11, 1.7e-11, 1e-13)]  # fmt: skip
    assert found[0]["turning"].values[-1] > 1.0  # friction did act
    for each in found:
        assert each.outcome is Outcome.COMPLETED, each.message
        assert each["turning"].values[-1] == pytest.approx(found[0]["turning"].values[-1], rel=1e-6)


def nine_blocks(order) -> str:
    """Nine blocks, each of which slides on the one before against a dry force of its own; entries in this order."""
    parts = {
        "bodies": "b{k} = {{mass = {mass}}}", "drives": "j{k} = {{free = true}}",
        "joints": 'j{k} = {{prismatic = ["{on}", "b{k}"], direction = [1, 0], friction = {{preload = {held}}}}}',
        "loads": 'f{k} = {{force_on = "b{k}", direction = [1, 0], value = 1}}',
        "sensors": 'v{k} = {{velocity = "b{k}", component = "x"}}',
    }  # fmt: skip
    values = [{"k": k, "mass": 1 + 0.1 * k, "held": 1 + 0.37 * k, "on": f"b{k - 1}" if k else "ground"} for k in order]
    rows = [f"{name}.{row.format(**of)}" for name, row in parts.items() for of in values]
    solve = 'solve = {preset = "coupled", duration = "1 ms", steps = 1, errors = "none"}'
    return "\n".join(["schema = 1", *rows, solve])


def test_nine_blocks_at_rest_choose_who_slips_in_any_order_and_unit():
    """More than are tried one by one: what sticks bears no more than it can, what slips is dragged by all of that."""
    random, unit = np.random.default_rng(9), 1e-6
    scenes = [scene_of(nine_blocks(order)) for order in (range(9), random.permutation(9))]
    masses, held = 1 + 0.1 * np.arange(9), 1 + 0.37 * np.arange(9)
    for size in (1.0, unit):
        small = [f"b{k}.mass={masses[k] * size!r}" for k in range(9)]
        small += [f"j{k}.friction.preload={held[k] * size!r}" for k in range(9)]
        for forces in random.uniform(-6.0, 6.0, (4, 9)):
            settings = [*small, *(f"f{k}.value={float(forces[k]) * size!r}" for k in range(9))]
            settings = [text.replace("np.float64(", "").replace(")", "") for text in settings]
            runs = [solve(load(with_settings(scene, settings))) for scene in scenes]
            assert {run.outcome for run in runs} == {Outcome.COMPLETED}
            moved, other = (np.array([run.series[f"v{k}"].values[-1] for k in range(9)]) / 1e-3 for run in runs)
            np.testing.assert_allclose(moved, other, atol=1e-9)
            borne, slip = np.cumsum((masses * moved - forces)[::-1])[::-1], np.diff(moved, prepend=0.0)
            assert (abs(borne) <= held * (1 + 1e-6)).all()
            slips = abs(slip) > 1e-7
            np.testing.assert_allclose(borne[slips], (-held * np.sign(slip))[slips], rtol=1e-5)
