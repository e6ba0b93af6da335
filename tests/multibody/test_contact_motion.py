"""Contacts as they move: impacts, flights and rests against closed forms, and everything from soft to hard."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from machines import machine
from runs import folded, solved
from test_contact_runs import BALL

from kaneflex import SceneError, scene_of
from kaneflex.integrate.system import Outcome
from kaneflex.mechanism.contacts import Contact
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import BodyPoint
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.module_loading import bind_parameters, find_laws_module
from kaneflex.multibody.time.error_bounds import Method
from kaneflex.multibody.time.run import Run, integrate
from kaneflex.plots import motion, sensors
from kaneflex.plots.style import styled
from kaneflex.report.checked import description
from kaneflex.report.summary import summarise

G = 9.81
GROUND, ZERO = BodyPoint("ground", "base", (0.0, 0.0)), (0.0, 0.0)
METHOD = Method("radau", 1e-8, 1.0)
POINTS = "points = {{left = [-10, 0], right = [10, 0]}}"
BODY = 'bodies.body_{k} = {{length = "1 m", mass = "1 kg", inertia = "0.1 kg m^2", centre = [0, 0], ' + POINTS + "}}\n"
JOINT = 'joints.hinge_{k} = {{revolute = ["ground.base", "body_{k}.end"]}}\n'
DRIVE = 'drives.hinge_{k} = {{free = true, angle = "150 deg"}}\n'


@pytest.fixture(scope="module")
def scenes():
    """One body, and two, hinged to the ground by their ends; their mass is at their start."""
    found = {}
    for count in (1, 2):
        text = 'schema = 1\ngravity = [0, "-9.81 m/s^2"]\nground.base = [0, 0]\n'
        text += 'solve = {preset = "coupled", duration = "1 s"}\n'
        found[count] = scene_of(text + "".join((BODY + JOINT + DRIVE).format(k=k) for k in range(count)))
    return found


def system_of(scene, *contacts, gravity=(0.0, -G), hinged=False):
    """The bodies of a scene with contacts; free, unless hinged."""
    module, _ = find_laws_module(scene, lambda stage: None)
    mechanism = replace(mechanism_of(scene), contacts={each.name: each for each in contacts}, gravity=gravity)
    if not hinged:
        mechanism = replace(mechanism, joints={}, drives={})
    return rigid_system(mechanism, module, bind_parameters(scene, module))


def body(k=0, point="start", at=ZERO):
    return BodyPoint(f"body_{k}", point, at)


def contact(name, first, second, kind="point-line", reach=0.0, K=1e8, n=1.5, e=0.7, law="exact", damping=0.0):
    direction = (0.0, 1.0) if kind == "point-line" else ZERO
    return Contact(name, first, second, kind, direction, reach, 0.0, K, n, damping, e, law)


def run(system, q, v, times, integrator="radau", tolerance=1e-8):
    start = folded(system, times[0], np.array(q, float), np.array(v, float))
    trajectory = integrate(system, start, times, Method(integrator, tolerance, 1.0))
    assert trajectory.outcome is Outcome.COMPLETED
    assert np.isfinite(trajectory.q).all()
    return trajectory


@pytest.mark.parametrize("n", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("e", [0.05, 0.5, 0.9, 0.99])
def test_an_impact_returns_the_restitution_that_was_asked_for(scenes, n, e):
    system = system_of(scenes[1], contact("floor", GROUND, body(), n=n, e=e), gravity=ZERO)
    found = run(system, [0, 1e-3, 0], [0, -1, 0], np.linspace(0, 0.5, 3))
    (impact,) = found.contacts.impacts
    assert impact.begin == pytest.approx(1e-3, rel=1e-12)
    assert impact.separation / impact.approach == pytest.approx(e, abs=1e-6)
    assert impact.impulse == pytest.approx(1 + e, rel=1e-6)
    assert impact.lost == pytest.approx((1 - e**2) / 2, abs=1e-6)
    assert found.energy.dissipated[-1] == impact.lost
    assert abs(found.energy.gap).max() < 1e-6 * 0.5


def test_two_corners_at_once_return_the_restitution_of_one(scenes):
    """By itself either would only turn the body, which resists that far less than it resists both."""
    ends = body(0, "left", (-10.0, 0.0)), body(0, "right", (10.0, 0.0))
    corners = [contact(f"on_the_{end.name}", GROUND, end, K=1e9, e=0.4) for end in ends]
    found = run(system_of(scenes[1], *corners, gravity=ZERO), [0, 1e-3, 0], [0, -1, 0], np.linspace(0, 0.5, 3))
    for impact in found.contacts.impacts:
        assert impact.separation / impact.approach == pytest.approx(0.4, abs=1e-6)
        assert impact.impulse == pytest.approx(0.7, rel=1e-6)
    assert len(found.contacts.impacts) == 2 and abs(found.v[-1, 2]) < 1e-9


@pytest.mark.parametrize(("law", "e", "returned"), [
    ("hertz", 0.3, 1.0), ("hunt-crossley", 0.5, 0.662962), ("lankarani-nikravesh", 0.1, 0.665265),
    ("flores", 0.3, 0.256208),
])  # fmt: skip
def test_other_laws_return_what_they_are_known_to(scenes, law, e, returned):
    system = system_of(scenes[1], contact("floor", GROUND, body(), e=e, law=law), gravity=ZERO)
    (impact,) = run(system, [0, 1e-3, 0], [0, -1, 0], np.linspace(0, 0.5, 3)).contacts.impacts
    assert impact.separation == pytest.approx(returned, abs=2e-6)


def test_a_damper_lets_go_before_its_spring_is_free(scenes):
    """m x'' + c x' + k x = 0 until its force is zero: the speed is exp(-zeta phi / sqrt(1 - zeta^2)) at phase phi."""
    K, zeta = 1e6, 0.2
    damping = 2 * zeta * math.sqrt(K)
    system = system_of(
        scenes[1], contact("floor", GROUND, body(), K=K, n=1.0, law="kelvin-voigt", damping=damping), gravity=ZERO
    )
    found = run(system, [0, 1e-3, 0], [0, -1, 0], np.linspace(0, 0.05, 3))
    (impact,) = found.contacts.impacts
    damped = math.sqrt(1 - zeta**2)
    phase = math.pi - math.atan2(2 * zeta * damped, 1 - 2 * zeta**2)  # of a force that is zero: k x + c x' = 0
    assert impact.separation == pytest.approx(math.exp(-zeta * phase / damped), rel=1e-7)
    assert impact.impulse == pytest.approx(1 + impact.separation, rel=1e-7)
    assert impact.lost == pytest.approx((1 - impact.separation**2) / 2, rel=1e-6)
    assert found.v[-1, 1] == pytest.approx(impact.separation, rel=1e-12)


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
def test_a_bouncing_ball_flies_by_its_closed_form_and_comes_to_rest(scenes, integrator):
    K, e = 1e9, 0.7
    system = system_of(scenes[1], contact("floor", GROUND, body(), K=K, e=e))
    found = run(system, [0, 1, 0], [0, 0, 0], np.linspace(0, 4, 81), integrator)
    *flown, last = found.contacts.impacts
    assert flown[0].begin == pytest.approx(math.sqrt(2 / G), rel=1e-12)
    assert flown[0].approach == pytest.approx(math.sqrt(2 * G), rel=1e-12)
    assert flown[0].separation / flown[0].approach == pytest.approx(e, abs=1e-3)  # its weight is in the impact, too
    for before, after in itertools.pairwise([*flown, last]):
        assert after.begin - before.end == pytest.approx(2 * before.separation / G, rel=1e-9)
        assert after.approach == pytest.approx(before.separation, rel=1e-9)
    assert len(flown) > 10 and last.lasts
    assert found.contacts.force[-1, 0] == pytest.approx(G, rel=1e-9)
    assert -found.contacts.gap[-1, 0] == pytest.approx((G / K) ** (1 / 1.5), rel=1e-9)
    assert found.energy.drift < 1e-6
    assert found.energy.dissipated[-1] == pytest.approx(G + 0.4 * G * (G / K) ** (1 / 1.5), rel=1e-6)


def test_balls_at_rest_on_each_other_close_together_and_bear_their_weights(scenes):
    floor = contact("floor", GROUND, body(0), reach=0.1, K=1e6, e=0.5)
    pair = contact("pair", body(0), body(1), "circle-circle", reach=0.2, K=1e6, e=0.5)
    found = run(system_of(scenes[2], floor, pair), [0, 0.1, 0, 0, 0.3, 0], np.zeros(6), np.linspace(0, 6, 61))
    assert found.contacts.force[-1] == pytest.approx([2 * G, G], rel=1e-6)
    assert -found.contacts.gap[-1] == pytest.approx((np.array([2, 1]) * G / 1e6) ** (1 / 1.5), rel=1e-6)
    assert found.energy.drift < 1e-6


@pytest.mark.parametrize("miss", [-1e-6, -1e-9, 1e-12, 1e-6])
def test_a_grazing_contact_is_not_stepped_over(scenes, miss):
    """One step would lead past the pin; the impulse is that of an elastic impact across m v sin(beta)."""
    pin = contact("pin", GROUND, body(), "circle-circle", reach=0.1, K=1e9, n=1.0, law="hertz")
    found = run(system_of(scenes[1], pin, gravity=ZERO), [-1, 0.1 + miss, 0], [37, 0, 0], np.linspace(0, 0.1, 3))
    if miss > 0:
        assert found.contacts.impacts == ()
    else:
        (impact,) = found.contacts.impacts
        assert impact.approach == pytest.approx(37 * math.sqrt(-20 * miss), rel=1e-5)
        assert impact.separation == pytest.approx(impact.approach, rel=1e-3)


@pytest.mark.parametrize(("integrator", "order"), [("radau", 5), ("gauss", 6)])
def test_flights_have_the_order_of_their_integrator(scenes, integrator, order):
    """A pendulum swings to a stop below its hinge in a quarter of its period."""
    from scipy.special import ellipk

    stop = contact("stop", GROUND, body(), K=1e9)._replace(direction=(1.0, 0.0))
    system = system_of(scenes[1], stop, hinged=True)
    start = math.radians(60)  # of the mass from below the hinge
    exact = ellipk(math.sin(start / 2) ** 2) / math.sqrt(G / 1.1)
    q = [math.sin(start), -math.cos(start), math.pi / 2 + start]
    errors = []
    for steps in (4, 8, 16):
        times = np.linspace(0, 0.75, steps + 1)
        found = run(system, q, [0, 0, 0], times, integrator, tolerance=1e-3)
        errors.append(abs(found.contacts.impacts[0].begin - exact))
    assert math.log2(errors[0] / errors[2]) / 2 > order - 0.5


def test_a_clearance_that_goes_to_zero_leaves_a_tight_joint(scenes):
    """By as much as the clearance, and as the pin is pressed into its bearing."""
    q = [math.cos(0.3), -math.sin(0.3), math.pi - 0.3]
    times = np.linspace(0, 1, 51)
    tight = run(system_of(scenes[1], hinged=True), q, [0, 0, 0], times).q[:, 2]
    apart = []
    for clearance in (1e-3, 1e-4, 1e-5):
        pin = contact("pin", GROUND, body(0, "end", (1.0, 0.0)), "circle-in-circle", reach=clearance, K=1e11, e=0.5)
        loose = run(system_of(scenes[1], pin), [q[0], q[1] - clearance, q[2]], [0, 0, 0], times)
        apart.append(abs(loose.q[:, 2] - tight).max())
        assert loose.energy.drift < 1e-6
    assert apart[0] < 2e-3 and apart[1] < 2e-4 and apart[2] < 3e-5


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
def test_extremes_of_stiffness_restitution_and_gap(scenes, integrator):
    """However hard, however elastic, however close: it lands, never falls through, and no energy is out of sight."""
    for K, n, e, gap in itertools.product((1e3, 1e13), (1.0, 1.5), (0.05, 0.99), (1e-9, 1e-2)):
        system = system_of(scenes[1], contact("floor", GROUND, body(), K=K, n=n, e=e))
        found = run(system, [0, gap, 0], [0, 0, 0], np.linspace(0, 0.3, 31), integrator)
        first = found.contacts.impacts[0]
        assert first.begin == pytest.approx(math.sqrt(2 * gap / G), rel=1e-9)
        deepest = ((n + 1) * G * gap / K) ** (1 / (n + 1)) + 2.5 * (G / K) ** (1 / n)
        assert -found.contacts.gap.min() < deepest
        assert abs(found.energy.gap).max() < 1e-6 * G * (gap + deepest) + 1e-12 * G  # and what places are rounded to


BOUNCING = BALL.replace('"2 s", steps = 500', '"4 s", steps = 200')


def test_impacts_are_on_the_solution_in_its_summary_and_its_results():
    solution = solved(scene_of(BOUNCING))
    last = solution.impacts[-1]
    summary = summarise(solution).contacts["floor"]
    assert (summary.impacts, summary.rests_since_s) == (len(solution.impacts), last.begin)
    assert summary.fastest_m_s == pytest.approx(math.sqrt(2 * G), rel=1e-12)
    assert summary.largest_force == max(impact.peak for impact in solution.impacts)
    assert summary.lost == pytest.approx(sum(impact.lost for impact in solution.impacts), rel=1e-12)
    found = solution.dataset
    assert found["impact_begin"].values.tolist() == [impact.begin for impact in solution.impacts]
    assert found["impact_y"].values == pytest.approx(0.0, abs=1e-12) and (found["impact_x"].values == 0.0).all()
    assert found["impact_contact"].values.tolist() == [0] * len(solution.impacts)
    assert found["contact"].values.tolist() == ["floor"]
    for sensor, name in (("push", "contact_force"), ("air", "contact_gap")):
        assert (solution.series[sensor].values == found[name].values[:, 0]).all()
    assert solution.series["push"].values[-1] == pytest.approx(G, rel=1e-9)
    assert solution.series["air"].values == pytest.approx(solution.series["height"].values, abs=1e-15)
    half = solution.at(solution.times[::2])
    assert half.series["air"].values == pytest.approx(solution.series["air"].values[::2], abs=1e-12)


def test_the_picture_of_a_contact_marks_the_peak_of_every_impact():
    solution = solved(scene_of(BOUNCING))
    with styled():
        figure, followed = sensors.figures(solution)["sensors"], motion.figures(solution)["motion"]
        labelled = {line.get_label(): line for axes in figure.axes for line in axes.lines}
    marks = labelled["push: peaks of impacts"]
    ends = [impact.end for impact in solution.impacts]
    assert (marks.get_xdata() >= [impact.begin for impact in solution.impacts]).all() and len(ends) > 3
    assert (np.fmin(marks.get_xdata(), ends) == marks.get_xdata()).all()
    peaks = np.array([impact.peak for impact in solution.impacts])
    assert marks.get_ydata() / marks.get_ydata()[0] == pytest.approx(peaks / peaks[0], rel=1e-9)
    assert [axes.get_title(loc="left") for axes in followed.axes] == [
        "Position of ball along its guide", "Velocity of ball", "Acceleration of ball",
    ]  # fmt: skip
    assert description(solution.model)["options"]["shapes"] == "none: all bodies are rigid"


def test_a_sensor_names_a_contact():
    with pytest.raises(SceneError, match=r"sensors.air.contact_gap = 'flor': no contact of that name.*'floor'"):
        scene_of(BOUNCING.replace('contact_gap = "floor"', 'contact_gap = "flor"'))


def test_a_cascade_without_time_between_stops_with_its_name(scenes):
    """As if a thousand changes had been at the instant of the first one."""
    system = system_of(scenes[1], contact("floor", GROUND, body()))
    start = folded(system, 0.0, np.array([0, 0.1, 0]), np.zeros(3))
    started = Run(system, start, np.linspace(0, 1, 11), METHOD, np.zeros(0))
    system.engine.numbers(at.TOUCH, at.SHARED)[[at.IN_A_ROW, at.LAST_CHANGE]] = 1000, 1.0
    outcome, message = started.go(None, None)
    assert outcome is Outcome.CASCADE and "after t = 0.1 s" in message
    again = run(system, [0, 0.1, 0], [0, 0, 0], np.linspace(0, 1, 11))
    assert again.contacts.impacts[0].begin == pytest.approx(math.sqrt(0.2 / G), rel=1e-12)


SLIDING = machine(
    gravity=[0, "-9.81 m/s^2"],
    bodies=dict(crank="length = 0.153, mass = 0.038, inertia = 7.4e-5, centre = [0.0765, 0]",
                rod="length = 0.306, mass = 0.038, inertia = 5.9e-4, centre = [0.153, 0]",
                slider="mass = 0.076, inertia = 2.7e-6"),
    joints=dict(main="revolute ground crank", pin="revolute crank.end rod", wrist="revolute rod.end slider",
                bore='prismatic ground slider, direction = [1, 0], clearance.gap = "1 mm", '
                     'clearance.length = "100 mm", clearance.height = "50 mm", '
                     'clearance.contact = {stiffness = 1e13, restitution = 0.4}'),
    drives=dict(main="free = true, initial_speed = 150", pin="free = true, initial_speed = -225",
                wrist="free = true, initial_speed = 75"),
    sensors=dict(y="position slider y"), solve=dict(preset="coupled", duration="18 ms", steps=90),
)


def test_a_slider_in_a_wide_guide_does_what_nonsmooth_dynamics_says():
    """Flores, Leine & Glocker 2010, Multibody Syst. Dyn. 23, 165: the slider's height over its clearance, as the
    package Siconos has published it, by steps of 0.1 ms and with a friction of 0.01; and its touches of the upper face.
    """
    solution = solved(scene_of(SLIDING))
    height = dict(zip(np.round(1e3 * solution.times, 6), solution.series["y"].values / 1e-3, strict=True))
    for t, there in ((2.0, 0.4871), (4.0, 0.7758), (8.0, 0.9525), (12.0, 0.9993), (15.0, 0.9993), (18.0, 0.9686)):
        assert height[t] == pytest.approx(there, abs=0.05)
    assert solution.impacts[0].begin == pytest.approx(2.75e-3, abs=1e-4)
    assert {impact.contact for impact in solution.impacts} == {"bore_3", "bore_4"}
    rests = [impact.begin for impact in solution.impacts if impact.end - impact.begin > 1e-3]
    assert len(rests) == 2 and rests == pytest.approx([8.9e-3, 8.9e-3], abs=3e-4)
    assert solution.trajectory.energy.drift < 1e-6


def test_a_run_stops_where_a_contacts_force_passes_a_value():
    """Between stored instants the contact stands as beside them."""
    event = 'events.landed = {sensor = "push", value = 5, direction = "up", stop = true}\n'
    solution = solved(scene_of(BOUNCING + event))
    assert "the event landed ended the run" in solution.message
    assert solution.series["push"].values[-1] == pytest.approx(5, rel=1e-6)
