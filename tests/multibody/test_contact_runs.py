"""Mechanisms whose bodies touch: closed forms, and the same laws integrated by themselves from impact to impact."""

import math
import re

import numpy as np
import pytest
from machines import changed, machine
from scipy.integrate import solve_ivp

from kaneflex import SceneError, linearise, load, scene_of, with_settings
from kaneflex.generated import contact
from kaneflex.mechanism.contacts import numbers_of
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.solve.simulation import solve
from kaneflex.solve.touching import off_their_lines
from kaneflex.study.sensitivity.report import check_differentiable
from kaneflex_peers.buildable import check_buildable

G = 9.81
BALL = machine(
    description="A ball that bounces on the floor", gravity=[0, "-9.81 m/s^2"], bodies=dict(ball='mass = "1 kg"'),
    joints=dict(fall="prismatic ground ball, direction = [0, 1]"), drives=dict(fall='free = true, position = "1 m"'),
    contacts=dict(floor='point_on_line = ["ball", "ground"], normal = [0, 1], '
                        'contact = {stiffness = 1e9, restitution = 0.7}'),
    sensors=dict(height="position fall x", push="contact_force floor", air="contact_gap floor"),
    solve=dict(preset="coupled", duration="2 s", steps=500),
)
CRANK, ROD, PISTON, INERTIA, MASS, SPEED = 0.05, 0.12, 0.14, 8.2e-5, 0.068, 314.0
LOOSE = machine(
    description="A slider-crank with room in its wrist pin",
    bodies=dict(crank=f"length = {CRANK}, mass = 0.3, inertia = 1e-4",
                rod=f"length = {ROD}, mass = {MASS}, inertia = {INERTIA}, centre = [{ROD / 2}, 0]",
                piston=f"mass = {PISTON}"),
    joints=dict(main="revolute ground crank", pin="revolute crank.end rod",
                bore="prismatic ground piston, direction = [1, 0]",
                wrist='revolute rod.end piston, '
                      'clearance = {radial = "0.2 mm", contact = {stiffness = 1e10, restitution = 0.6}}'),
    drives=dict(main=f"speed = {SPEED}", pin=f"free = true, initial_speed = {-SPEED * (1 + CRANK / ROD)}",
                bore=f"free = true, position = {CRANK + ROD}"),
    sensors=dict(slide="position bore x"), solve=dict(preset="coupled", duration="5.5 ms", steps=550),
)


def solved(text, *settings):
    found = solve(load(with_settings(scene_of(text), settings)))
    assert found.outcome.name == "COMPLETED", found.trajectory.message
    return found


@pytest.mark.parametrize("steps", [100, 1000])
def test_an_impact_pressed_to_three_times_its_speed_has_a_new_one_from_there(steps):
    """Hunt and Crossley's law integrated by itself between the instants at which its compression triples."""
    K, e, v_0, force, times = 1e6, 0.6, 0.02, 3000.0, np.linspace(0, 0.02, steps + 1)
    press = f'loads.press = {{force_on = "ball", direction = [0, -1], law = "{force} * step(t - 3e-4)"}}\n'
    text = changed(BALL, ('"-9.81 m/s^2"', "0"), ('"1 m"', f"0, initial_speed = {-v_0}"),
                   ("{stiffness = 1e9, restitution = 0.7}",
                    f'{{law = "hunt-crossley", stiffness = {K}, restitution = {e}}}'), ("", press))  # fmt: skip
    found = solved(text, "solve.duration=0.02", f"solve.steps={steps}")

    def rates(t, y):
        depth, rate = max(y[0], 0.0), y[1]
        return rate, force - K * depth**1.5 * (1 + 1.5 * (1 - e) * rate / v_0)

    def tripled(t, y):
        return y[1] - 3 * v_0

    tripled.terminal, tripled.direction = True, 1
    free = solve_ivp(lambda t, y: (y[1], rates(t, y)[1] - force), (0, 3e-4), (0.0, v_0), rtol=1e-12, atol=1e-15)
    t, y, depth = 3e-4, free.y[:, -1], np.zeros(steps + 1)
    while t < times[-1]:
        part = solve_ivp(rates, (t, times[-1]), y, "DOP853", rtol=1e-12, atol=1e-15, events=tripled, dense_output=True)
        inside = (times >= t) & (times <= part.t[-1])
        depth, t, y = np.where(inside, part.sol(times)[0], depth), part.t[-1], part.y[:, -1]
        v_0 = max(v_0, y[1]) if part.status == 1 else v_0
    assert v_0 > 0.5
    pressed = times > 3e-4
    assert -found["height"].values[pressed] == pytest.approx(depth[pressed], abs=1e-6 * depth.max())


def own(solution, name):
    """Law's number and the numbers of a contact, as the kernels take them."""
    found = mechanism_of(solution.model.scene).contacts[name]
    return contact.LAWS.index(found.law), np.array(numbers_of(found))


def loose_slider_crank(law, p, times):
    """Slide of LOOSE and its number of impacts by its own two equations, from contact to contact."""

    def gap(t, y):
        crank, (theta, omega, x, v) = SPEED * t, y
        d = x - CRANK * math.cos(crank) - ROD * math.cos(theta), -CRANK * math.sin(crank) - ROD * math.sin(theta)
        rate = v + CRANK * SPEED * math.sin(crank) + ROD * omega * math.sin(theta), \
            -CRANK * SPEED * math.cos(crank) - ROD * omega * math.cos(theta)  # fmt: skip
        length = math.hypot(*d)
        n = (-d[0] / length, -d[1] / length) if length else (0.0, 0.0)
        return p[2] - length, n[0] * rate[0] + n[1] * rate[1], n

    def rhs(t, y, v_0):
        theta, omega, _, v = y
        g, rate, n = gap(t, y)
        force = contact.normal_force(law, p, 0, v_0, g, rate) if v_0 else 0.0
        a = -CRANK * SPEED**2 * math.cos(SPEED * t), -CRANK * SPEED**2 * math.sin(SPEED * t)
        c, s = math.cos(theta), math.sin(theta)
        turned = ROD * force * (s * n[0] - c * n[1]) - MASS * ROD / 2 * (c * a[1] - s * a[0])
        return omega, turned / (INERTIA + MASS * ROD**2 / 4), v, force * n[0] / PISTON

    def changes(t, y, v_0):
        return gap(t, y)[0] if t > began + 1e-9 else (-1.0 if v_0 else 1.0)

    changes.terminal = True
    y, began, v_0, impacts = np.array([0.0, -SPEED * CRANK / ROD, CRANK + ROD, 0.0]), 0.0, 0.0, 0
    slide = np.full(len(times), np.nan)
    while np.isnan(slide[-1]):
        part = solve_ivp(
            rhs, (began, times[-1]), y, "DOP853", args=(v_0,), events=changes, rtol=1e-11, atol=1e-13, max_step=2e-5,
            dense_output=True,
        )  # fmt: skip
        inside = (times >= began) & (times <= part.t[-1])
        slide[inside] = part.sol(times[inside])[2]
        began, y = part.t[-1], part.y[:, -1]
        impacts += not v_0 and part.status == 1
        v_0 = 0.0 if v_0 else -gap(began, y)[1]
    return slide, impacts


def test_a_slider_crank_knocks_as_its_own_two_equations_say():
    """Three impacts; the fourth is slower than its loads press, and taken for no impact."""
    solution = solved(LOOSE, "solve.tolerance=1e-10")
    slide, impacts = loose_slider_crank(*own(solution, "wrist"), solution.times)
    assert impacts == 3
    assert solution.series["slide"].values == pytest.approx(slide, abs=1e-11)


BAR = machine(
    description="A hinged elastic bar that falls on a stop below its end", gravity=[0, "-9.81 m/s^2"],
    ground=dict(stop=["0.5 m", "-10 mm"]),
    bodies=dict(bar='length = "0.5 m", '
                    'beam = {material = "steel", section = {rectangle = ["10 mm", "20 mm"]}, elements = 8}'),
    joints=dict(hinge="revolute ground bar"), drives=dict(hinge='free = true, angle = "2 deg"'),
    contacts=dict(stop='point_on_line = ["bar.end", "ground.stop"], normal = [0, 1], radius = "10 mm", '
                       'contact = {materials = ["steel", "steel"], restitution = 0.3}'),
    damping=dict(rayleigh=dict(ratio="5 %", at=["300 Hz", "3000 Hz"])),
    sensors=dict(angle="position hinge angle", moment="bending_moment bar.mid", shear="shear_force bar.end"),
    solve=dict(preset="coupled", duration="0.5 s", steps=1000),
)


def test_section_forces_know_what_touches_the_link():
    """At rest on hinge and stop: w l^2/8 in the middle, w l/2 at the end; before the impact the stop says nothing."""
    resting = solved(BAR)
    weight = 7850 * 2e-4 * G
    series = {name: found.values for name, found in resting.series.items()}
    assert series["moment"][-1] == pytest.approx(weight * 0.5**2 / 8, rel=1e-2)
    assert abs(series["shear"][-1]) == pytest.approx(weight * 0.5 / 2, rel=1e-2)
    assert resting.trajectory.contacts.force[-1, 0] == pytest.approx(weight * 0.5 / 2, rel=1e-2)
    falling = solved(BAR, "contacts.stop=none")
    touched = resting.trajectory.contacts.impacts[0].begin
    before = resting.times < touched - 1e-3
    assert 20 < before.sum() < len(before)
    # the stop asks for one more shape of the bar, which tells the moments apart a little
    assert series["angle"][before] == pytest.approx(falling.series["angle"].values[before], abs=1e-6)
    assert abs(series["moment"][before]).max() < 1.1 * abs(falling.series["moment"].values[before]).max()
    assert resting.trajectory.energy.drift < 1e-5


def test_sides_that_start_in_each_other_are_named():
    with pytest.raises(SceneError) as caught:
        solved(BALL, "drives.fall.position=-3 mm")
    assert str(caught.value) == (
        "contacts.floor: at the start its sides penetrate each other by 3 mm. "
        "Start them apart, for example by the start of free drives."
    )
    solved(BALL, "drives.fall.position=0 mm", "solve.duration=1 ms")


def test_no_start_from_an_equilibrium():
    for text, which in ((BALL, "contacts.floor"), (LOOSE, "joints.wrist.clearance")):
        with pytest.raises(SceneError, match=f"with {re.escape(which)} free bodies have no equilibrium"):
            solved(text, "solve.start=quasistatic")


def test_what_needs_a_smooth_motion_refuses_contacts():
    scene = scene_of(BALL)
    with pytest.raises(SceneError, match=r"with contacts\.floor the equations are nonlinear"):
        linearise(load(scene))
    with pytest.raises(SceneError, match=r"with contacts\.floor the instants of impacts depend"):
        check_differentiable(scene, continued=False)
    with pytest.raises(SceneError, match=r"contacts\.floor: a contact is not supported by the other program"):
        check_buildable(scene)


def test_between_stored_instants_a_ball_is_where_a_finer_run_has_it():
    """Impacts lie between the stored instants: the curve goes through the states where contacts close and open."""
    soft = ["floor.contact.stiffness=1e5", "solve.duration=1.2 s"]
    coarse, fine = (solve(load(with_settings(scene_of(BALL), [*soft, f"solve.steps={n}"]))) for n in (12, 1200))
    height = fine.series["height"].values
    between, flies = coarse.at(fine.times).series["height"].values, height > 0.0
    assert between[flies] == pytest.approx(height[flies], abs=1e-6)


def started(*settings):
    scene = load(with_settings(scene_of(LOOSE), [f"drives.{setting}" for setting in settings])).scene
    return [(scene.drives[name].start, scene.drives[name].initial_speed) for name in ("pin", "bore")]


def test_free_joints_beside_a_clearance_start_as_the_tight_mechanism():
    """Left out they were zero: the pin 170 mm from its bearing, and at rest. Closed forms of a slider-crank."""
    left = ("pin.initial_speed=none", "bore.position=none", "main.angle=30 deg")
    (turn, turning), (way, sliding) = started(*left)
    a, b = math.radians(30), math.asin(CRANK / ROD / 2)
    turning_b = SPEED * CRANK * math.cos(a) / (ROD * math.cos(b))
    assert (turn, way) == (pytest.approx(-a - b, rel=1e-12), pytest.approx(CRANK * math.cos(a) + ROD * math.cos(b)))
    assert turning == pytest.approx(-SPEED - turning_b, rel=1e-12)
    assert sliding == pytest.approx(-CRANK * SPEED * math.sin(a) - ROD * turning_b * math.sin(b), rel=1e-12)
    law = "main.speed=none", f"main.law={SPEED}*t + {math.radians(30)}"
    assert np.ravel(started(*left[:2], *law)) == pytest.approx([turn, turning, way, sliding], rel=1e-9)
    assert started("bore.position=0.1701")[1] == (0.1701, 0.0)  # what a scene says it means
    (behind, _), _ = started(*left[:2], "main.angle=200 deg")  # within half a turn
    assert behind == pytest.approx(math.radians(160) + math.asin(CRANK / ROD * math.sin(math.radians(20))), rel=1e-12)


LOOSE_FOUR_BAR = machine(
    description="A four-bar whose coupler is loose at both ends", ground=dict(left=[0, 0], right=["254 mm", 0]),
    bodies=dict(crank='length = "108 mm", mass = "31.6 g"', coupler='length = "279.4 mm", mass = "30 g", free = {}',
                follower='length = "270.5 mm", mass = "29.8 g"'),
    joints=dict(main="revolute ground.left crank.start", rocker="revolute ground.right follower.start",
                first='revolute crank.end coupler.start, '
                      'clearance = {radial = "0.1 mm", contact = {stiffness = 1e9, restitution = 0.8}}',
                second='revolute coupler.end follower.end, '
                       'clearance = {radial = "0.1 mm", contact = {stiffness = 1e9, restitution = 0.8}}'),
    drives=dict(main='speed = "200 rpm", angle = "60 deg"', rocker="free = true"),
    sensors=dict(rocker="position rocker angle", turning="velocity coupler angle",
                 v_x='velocity coupler.start x, axes = "global"', v_y='velocity coupler.start y, axes = "global"',
                 a_x='acceleration coupler.mid x, axes = "global"', a_y='acceleration coupler.mid y, axes = "global"',
                 first_x="position first x", first_y="position first y", first_force="contact_force first",
                 second_x="position second x", second_y="position second y", second_force="contact_force second"),
    solve=dict(preset="coupled", duration="0.1 s", steps=5000),
)


def test_a_four_bar_with_two_loose_pins():
    """It starts as the tight one, whose rocker it follows (closed form) as far as its clearances let it; the forces in
    the pins, along their eccentricities, accelerate the coupler."""
    radial, found = 1e-4, solved(LOOSE_FOUR_BAR)
    first, second, v, a = (np.array([found[f"{name}_{x}"] for x in "xy"]) for name in ("first", "second", "v", "a"))
    forces = [found[f"{pin}_force"].values for pin in ("first", "second")]

    crank = math.pi / 3 + 200 * math.tau / 60 * found.times
    pin = 0.108 * np.array([np.cos(crank), np.sin(crank)]) - np.array([[0.254], [0.0]])
    reach = np.hypot(*pin)
    apart = np.arccos((reach**2 + 0.2705**2 - 0.2794**2) / (2 * reach * 0.2705))
    between = np.arccos((0.2794**2 + 0.2705**2 - reach**2) / (2 * 0.2794 * 0.2705))
    tight = np.unwrap(np.arctan2(pin[1], pin[0])) - apart
    off = found["rocker"].values - tight
    assert abs(first[:, 0]).max() < 1e-12 and abs(second[:, 0]).max() < 1e-12
    assert abs(off[0]) < 1e-12
    turn = 0.108 * 200 * math.tau / 60 * np.array([-np.sin(crank[0]), np.cos(crank[0])])
    assert v[:, 0] == pytest.approx(turn, rel=1e-12)
    speed = found["turning"].values[0]
    assert speed == pytest.approx(math.pi * 0.108 / 0.2794 * 20 / 3 * np.sin((crank - tight)[0]) / np.sin(between[0]))
    assert (abs(off) < 1.1 * 2 * radial / (0.2705 * np.sin(between))).all()

    for own, force in zip((first, second), forces, strict=True):  # indented as far as F = K d^1.5 at its peak
        assert 0.0 < np.hypot(*own).max() - radial < 1.02 * (force.max() / 1e9) ** (2 / 3)
    assert all((force > 0).sum() > 100 and force.max() > 5.0 for force in forces)
    toward = [own / np.maximum(np.hypot(*own), 1e-300) for own in (first, second)]
    wanted = forces[1] * toward[1] - forces[0] * toward[0]
    np.testing.assert_allclose(0.03 * a, wanted, rtol=0, atol=1e-8 * max(force.max() for force in forces))
    assert found.trajectory.energy.drift < 1e-8
    with pytest.raises(SceneError, match=r"penetrate each other by 107\.9 mm"):  # a start that is given stays
        load(with_settings(scene_of(LOOSE_FOUR_BAR), ["bodies.coupler.free.angle=0"]))


BRIDGE = machine(
    description="A ball at rest on the far support of an elastic bridge, whose end does not move", gravity=[0, -9.81],
    ground=dict(far=[4, 0]),
    bodies=dict(bridge='length = 4, beam = {material = "steel", section = {rectangle = ["50 mm", "50 mm"]}}',
                roller='mass = "1 g"', ball='mass = "20 kg"'),
    joints=dict(left="revolute ground bridge.start", right="revolute bridge.end roller",
                bed="prismatic ground roller, direction = [1, 0]", up="prismatic ground.far ball, direction = [0, 1]"),
    drives=dict(up="free = true"),
    contacts=dict(wheel='point_on_line = ["ball", "bridge"], normal = [0, 1], '
                        'contact = {law = "kelvin-voigt", stiffness = 1e7, exponent = 1, damping = 2e3}'),
    damping=dict(modal=dict(ratio=0.5)), sensors=dict(ball_y="position ball y", mid="displacement bridge.mid y"),
    solve=dict(preset="coupled", duration="3 s", steps=300),
)


def test_a_line_on_an_elastic_link_is_where_it_is_named_and_refused_far_from_there():
    """The line was the tangent at the left support: the ball sank by 50.5 mm, mid-span by 13.0 mm, without a word."""
    said = r"contacts\.wheel\.point_on_line = 'bridge\.start': bridge is elastic.*ball touches it 4000 mm away"
    with pytest.raises(SceneError, match=said):
        load(scene_of(BRIDGE))
    found = solve(load(scene_of(BRIDGE.replace('"bridge"]', '"bridge.end"]'))))
    assert not list(off_their_lines(found))
    sag = 5 * 7850 * 0.05**2 * G * 4**4 / (384 * 210e9 * 0.05**4 / 12)
    assert found.series["mid"].values[-1] == pytest.approx(-sag, rel=5e-3)  # what is left swings
    # the end comes 20 um closer to the other one, and its tangent rises there by 5e-3 of that
    assert found.series["ball_y"].values[-1] == pytest.approx(-20 * G / 1e7, abs=1.2e-7)


def test_a_run_says_where_a_line_was_not_the_axis_of_its_elastic_link():
    """A ball that falls on the line far from its address: seen from there the end of a tangent goes down by th L."""
    (said,) = off_their_lines(solve(load(scene_of(BRIDGE.replace("free = true", 'free = true, position = "10 mm"')))))
    assert said.startswith("the line of contacts.wheel is the tangent of bridge at bridge.start; at t = ")
    assert re.search(r"ball touches it 400\d mm from there, where the bent axis is \d\d(\.\d)? mm off", said)
