"""Newton's law of impact: bounces, rows of balls, falling rods and what comes to rest, against closed forms."""

import math

import numpy as np
import pytest
from machines import WEIGHT, machine, pendulum
from test_contact_motion import GROUND, SLIDING, ZERO, G, body, contact, run, scenes, system_of

from kaneflex import SceneError, load, scene_of, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.report.presentation import parts, printed
from kaneflex.report.summary import summarise
from kaneflex.solve.simulation import solve

__all__ = ["scenes"]
INERTIA = 0.1
"""Of a rod of mass 1 about its middle."""


def floor(name="floor", second=None, e=0.7, **given):
    return contact(name, GROUND, second or body(), law="newton", e=e, **given)


def beside(first, second, e=1.0):
    return contact(f"pair_{first}", body(first), body(second), "circle-circle", reach=0.2, law="newton", e=e)


@pytest.fixture(scope="module")
def rod():
    """A free rod whose points at these places of it don't sink into the floor: its equations by their places."""

    def made(e, *places, gravity=(0.0, -G)):
        points = {f"point_{k}": (x, 0.0) for k, x in enumerate(places)}
        listed = ", ".join(f"{name} = [{x}, 0]" for name, (x, _) in points.items())
        scene = scene_of(f"""
schema = 1
ground = {{base = [0, 0]}}
bodies = {{body_0 = {{mass = 1, inertia = {INERTIA}, centre = [0, 0], points = {{{listed}}}}}}}
joints = {{slide = {{prismatic = ["ground.base", "body_0"], direction = [1, 0]}}}}
drives = {{slide = {{free = true}}}}
solve = {{preset = "coupled", duration = "1 s"}}
""")
        floors = [floor(name, body(0, name, at), e) for name, at in points.items()]
        return system_of(scene, *floors, gravity=gravity)

    return made


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
@pytest.mark.parametrize("e", [0.2, 0.7, 0.95])
def test_a_ball_bounces_at_the_instants_of_the_closed_form_until_rounding_and_then_rests(scenes, integrator, e):
    """Flights of 2 e^k v/g and heights e^2k h: they add up to (1 + e)/(1 - e) times the fall, Zeno's instant."""
    fall, v = math.sqrt(2 / G), math.sqrt(2 * G)
    zeno = fall * (1 + e) / (1 - e)
    found = run(system_of(scenes[1], floor(e=e)), [0, 1, 0], [0, 0, 0], np.linspace(0, 1.1 * zeno, 101), integrator)
    *flown, last = found.contacts.impacts
    k = np.arange(len(flown))
    begun = [impact.begin for impact in flown]
    instants = fall * (1 + np.concatenate([[0.0], 2 * np.cumsum(e ** k[1:])]))
    assert begun == pytest.approx(instants, abs=1e-9)
    assert [impact.approach for impact in flown] == pytest.approx(v * e**k, rel=1e-6)
    assert [impact.separation for impact in flown] == pytest.approx(v * e ** (k + 1), rel=1e-6)
    assert [impact.impulse for impact in flown] == pytest.approx((1 + e) * v * e**k, rel=1e-6)
    assert [impact.lost for impact in flown] == pytest.approx((1 - e**2) * G * e ** (2 * k), rel=1e-6)
    assert all(impact.begin == impact.end and impact.peak == 0.0 for impact in flown)
    assert last.lasts and last.begin == pytest.approx(zeno, abs=2e-5) and last.begin < zeno
    resting = found.times > last.begin
    assert 5 < resting.sum() < 15
    assert abs(found.contacts.gap[resting]).max() == 0.0 and abs(found.v[resting]).max() == 0.0
    assert found.contacts.force[resting] == pytest.approx(G, rel=1e-14)
    tops = found.q[:, 1] + found.v[:, 1] ** 2 / (2 * G)
    flight = np.searchsorted(begun, found.times, side="right")
    assert tops[~resting] == pytest.approx(np.array(e) ** (2.0 * flight[~resting]), abs=1e-9)
    assert abs(found.energy.gap).max() < 1e-12 * G


def test_what_does_not_bounce_sticks_at_once_and_what_loses_nothing_bounces_for_ever(scenes):
    found = run(system_of(scenes[1], floor(e=0.0)), [0, 1, 0], [0, 0, 0], np.linspace(0, 1, 11))
    (impact,) = found.contacts.impacts
    assert impact.lasts and impact.begin == pytest.approx(math.sqrt(2 / G), rel=1e-14)
    assert impact.lost == pytest.approx(G, rel=1e-14)
    assert impact.peak == pytest.approx(G, rel=1e-14)  # of the force at rest
    assert impact.impulse == pytest.approx(math.sqrt(2 * G) + G * (1 - impact.begin), rel=1e-12)
    found = run(system_of(scenes[1], floor(e=1.0)), [0, 1, 0], [0, 0, 0], np.linspace(0, 100, 11))
    begun = np.array([impact.begin for impact in found.contacts.impacts])
    assert begun == pytest.approx(math.sqrt(2 / G) * (1 + 2 * np.arange(111)), rel=1e-12)
    assert found.energy.dissipated[-1] == 0.0 and found.energy.drift < 1e-12


@pytest.fixture(scope="module")
def row_of_balls():
    """Three bodies of mass 1 that slide along one line."""
    lines = [
        'schema = 1\nsolve = {preset = "coupled", duration = "1 s"}\nground.base = [0, 0]',
        *(f'bodies.body_{k} = {{mass = "1 kg"}}' for k in range(3)),
        *(f'joints.slide_{k} = {{prismatic = ["ground.base", "body_{k}"], direction = [1, 0]}}' for k in range(3)),
        *(f"drives.slide_{k} = {{free = true, position = {k}}}" for k in range(3)),
    ]  # fmt: skip
    return scene_of("\n".join(lines))


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_balls_in_touch_are_hit_together_and_balls_apart_one_by_one(row_of_balls, e):
    """In touch: Moreau's impact law leaves -1/3, 2/3, 2/3 of a speed for e = 1, the mean for e = 0, and between them
    what lies between (Glocker 2004, Comput. Methods Appl. Mech. Eng. 193, 3953); apart, by 1 um, it is passed on.
    """
    together = np.array([1, 1, 1]) / 3 + e * np.array([-2, 1, 1]) / 3
    passed = np.array([(1 - e) / 2, (1 + e) / 2 * (1 - e) / 2, ((1 + e) / 2) ** 2])
    for gap, speeds in ((0.0, together), (1e-6, passed)):
        system = system_of(row_of_balls, beside(0, 1, e), beside(1, 2, e), gravity=ZERO, hinged=True)
        q = np.zeros(9)
        q[::3] = -0.3, 0.0, 0.2 + gap
        found = run(system, q, [1, 0, 0, 0, 0, 0, 0, 0, 0], np.linspace(0, 0.11, 3))
        if gap == 0.0 or e == 1.0:
            assert found.v[-1, ::3] == pytest.approx(speeds, abs=1e-12)
        assert found.v[-1, ::3].sum() == pytest.approx(1, abs=1e-12)
        lost = sum(impact.lost for impact in found.contacts.impacts)
        assert abs(found.energy.gap).max() < 1e-13
        assert found.energy.dissipated[-1] == pytest.approx(lost, abs=1e-15)
        if gap == 0.0:
            begun = [impact.begin for impact in found.contacts.impacts]
            assert len(begun) == 2 and begun == pytest.approx([0.1, 0.1], rel=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
def test_a_rod_that_falls_flat_does_not_turn_and_one_on_its_end_turns(rod, e):
    """Flat: m v (1 + e)/2 at either end. On one end, of arm a: p = (1 + e) v/(1/m + a^2/I), and it turns by a p/I."""
    v, a = 2.0, 0.5
    system = rod(e, -a, a, gravity=ZERO)
    flat = run(system, [0, 1e-3, 0], [0, -v, 0], np.linspace(0, 1e-2, 3))
    impacts = flat.contacts.impacts
    assert [impact.impulse for impact in impacts] == pytest.approx([v * (1 + e) / 2] * 2, rel=1e-12)
    assert flat.v[-1] == pytest.approx([0, e * v, 0], abs=1e-12)
    tilted = run(system, [0, 1e-3 + a * math.sin(0.1), 0.1], [0, -v, 0], np.linspace(0, 6e-4, 3))
    impact, arm = tilted.contacts.impacts[0], a * math.cos(0.1)
    push = (1 + e) * v / (1 + arm**2 / INERTIA)
    assert impact.contact == "point_0" and impact.approach == pytest.approx(v, rel=1e-12)
    if e:
        assert impact.impulse == pytest.approx(push, rel=1e-10)
    assert tilted.v[-1] == pytest.approx([0, push - v, -arm * push / INERTIA], rel=1e-10)


@pytest.mark.parametrize("arm", [0.2, 0.5])
def test_a_rocking_rod_lifts_its_other_end_or_stops(rod, arm):
    """It turns about one end, which rests, until the other one lands and sticks: by itself that impulse moves the first
    end by 1/m - a^2/I. Up where I > m a^2: the end leaves; else both are hit and nothing moves any more.
    """
    system = rod(0.0, -arm, arm)
    tilt, omega = 1e-3, 0.5
    q = [0, arm * math.sin(tilt), tilt]
    found = run(system, q, [0, -omega * arm * math.cos(tilt), -omega], np.linspace(0, 5e-3, 51))
    landed = next(impact for impact in found.contacts.impacts if impact.contact == "point_1")
    assert found.contacts.impacts[0].contact == "point_0"
    k = np.searchsorted(found.times, landed.begin)
    falling, ratio = landed.approach, (1 - arm**2 / INERTIA) / (1 + arm**2 / INERTIA)
    up = max(ratio, 0.0) * falling
    assert falling == pytest.approx(2 * arm * omega, rel=0.2)
    left_end = found.v[k, 1] - arm * found.v[k, 2] * np.cos(found.q[k, 2])
    slower = (found.times[k] - landed.begin) * 2 * G / (1 + arm**2 / INERTIA) * (up > 0)
    assert left_end == pytest.approx(up - slower, abs=4e-3 * falling)
    assert landed.lasts and abs(found.energy.gap).max() < 1e-9
    if up == 0.0:
        assert abs(found.v[-1]).max() < 1e-12 and found.contacts.force[-1] == pytest.approx([G / 2, G / 2], rel=1e-9)


def test_more_contacts_than_a_body_needs_share_its_weight_somehow(rod):
    """A rod flat on four points: two would do. The forces add up, it stays, and none is not a number."""
    found = run(rod(0.5, -0.3, -0.1, 0.2, 0.4), [0, 1e-2, 0], [0, 0, 0], np.linspace(0, 1, 11))
    assert all(impact.lasts for impact in found.contacts.impacts[-4:])
    assert found.contacts.force[-1].sum() == pytest.approx(G, rel=1e-12)
    assert found.contacts.force[-1].min() >= 0.0
    assert abs(found.contacts.gap[-1]).max() < 1e-15 and abs(found.v[-1]).max() < 1e-12


def test_balls_on_each_other_come_to_rest_and_bear_their_weights(scenes):
    pair = contact("pair", body(0), body(1), "circle-circle", reach=0.2, law="newton", e=0.5)
    system = system_of(scenes[2], floor("floor", reach=0.1, e=0.5), pair)
    found = run(system, [0, 0.2, 0, 0, 0.5, 0], np.zeros(6), np.linspace(0, 3, 31))
    assert found.contacts.force[-1] == pytest.approx([2 * G, G], rel=1e-12)
    assert abs(found.contacts.gap[-1]).max() < 1e-15
    assert all(impact.lasts for impact in found.contacts.impacts[-2:])
    assert abs(found.energy.gap).max() < 1e-11 * G


BALL = machine(
    gravity=[0, "-9.81 m/s^2"], bodies=dict(ball='mass = "1 kg"', table='mass = "2 kg"'),
    joints=dict(fall="prismatic ground ball, direction = [0, 1]", lift="prismatic ground table, direction = [0, 1]"),
    drives=dict(fall='free = true, position = "0 mm"',
                lift='law = "0.01 * (1 - cos(50 * t))", period = "125.6637061435917 ms"'),
    contacts=dict(floor='point_on_line = ["ball", "table"], normal = [0, 1], '
                        'contact = {law = "newton", restitution = 0.5}'),
    sensors=dict(push="contact_force floor", air="contact_gap floor", height="position fall"),
    solve=dict(preset="coupled", duration="2 s", steps=400),
)


def solved(text, *settings):
    return solve(load(with_settings(scene_of(text), settings)))


def test_a_ball_leaves_a_shaken_table_where_its_force_would_pull():
    """Resting on A (1 - cos w t) it leaves at -A w^2 cos(w t) = g; the drive's work at the impacts is in the books."""
    solution = solved(BALL, "solve.duration=0.3 s")
    first = solution.impacts[0]
    assert (first.begin, first.approach) == (0.0, 0.0)
    assert first.end == pytest.approx(math.acos(-G / 25) / 50, rel=1e-10)
    assert first.separation == pytest.approx(0.0, abs=1e-12)
    t = solution.times[solution.times < first.end]
    assert solution.series["push"].values[: len(t)] == pytest.approx(G + 25 * np.cos(50 * t), abs=1e-9)
    assert first.peak == pytest.approx(G + 25, rel=1e-3) and abs(solution.series["air"].values[: len(t)]).max() < 1e-15
    flown = solution.times[(solution.times > first.end) & (solution.times < solution.impacts[1].begin)]
    left, speed = 0.01 * (1 - math.cos(50 * first.end)), 0.5 * math.sin(50 * first.end)
    heights = left + speed * (flown - first.end) - G / 2 * (flown - first.end) ** 2
    assert solution.series["height"].values[np.isin(solution.times, flown)] == pytest.approx(heights, abs=1e-9)
    long = solved(BALL).trajectory.energy
    assert abs(long.gap).max() < 1e-6 * abs(long.supplied).max() and long.dissipated[-1] > 1.0


def test_what_a_scene_says_of_newtons_law_is_in_its_check_summary_and_results():
    law = BALL[BALL.index("lift = {law") : BALL.index("contacts.")]
    text = BALL.replace(law, "lift = {speed = 0}\n")
    solution = solved(text, "fall.position=1 m", "floor.contact.restitution=0.2")
    summary, last = summarise(solution).contacts["floor"], solution.impacts[-1]
    assert summary.impacts == len(solution.impacts) and summary.rests_since_s == last.begin
    assert (summary.largest_force, summary.lost) == (pytest.approx(G, rel=1e-12), pytest.approx(G, rel=1e-9))
    assert solution.dataset["impact_peak"].values[:-1].tolist() == [0.0] * (len(solution.impacts) - 1)
    assert "rigid, law newton, restitution 0.2" in printed(solution.model.scene, parts(solution.model.scene))


def test_newtons_law_refuses_what_has_no_meaning_for_rigid_sides():
    for key, value in (
        ("stiffness", "1e9"), ("exponent", "1.5"), ("materials", '["steel", "steel"]'), ("modulus", '"100 GPa"'),
        ("load", '"1 N"'), ("damping", "3"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=rf"floor\.contact\.{key}.*law newton has rigid sides"):
            solved(BALL.replace('law = "newton"', f'law = "newton", {key} = {value}'))
    with pytest.raises(SceneError, match="law newton needs a restitution"):
        solved(BALL.replace(", restitution = 0.5", ""))
    with pytest.raises(SceneError, match=r"floor\.contact\.restitution = 1.5: the impact would gain energy"):
        solved(BALL, "floor.contact.restitution=1.5")


def test_a_slider_in_a_wide_guide_rests_between_its_knocks():
    """Both corners touch together; the energy that is lost is what the impacts list."""
    solution = solved(SLIDING.replace("stiffness = 1e13", 'law = "newton"'))
    assert solution.outcome is Outcome.COMPLETED
    for impact, same in zip(solution.impacts[::2], solution.impacts[1::2], strict=True):
        assert (impact.begin, impact.impulse) == (same.begin, pytest.approx(same.impulse, rel=1e-6))
    energy = solution.trajectory.energy
    assert energy.dissipated[-1] == pytest.approx(sum(impact.lost for impact in solution.impacts), rel=1e-12)
    assert energy.drift < 1e-7
    rest = [impact for impact in solution.impacts if impact.end - impact.begin > 1e-3]
    assert {impact.contact for impact in rest} == {"bore_3", "bore_4"}


PLAY = machine(
    bodies=dict(wheel="inertia = 0.02, mass = 1", arm="inertia = 0.01, mass = 1"),
    joints=dict(axle="revolute ground wheel",
                hub='revolute wheel arm, clearance = {angle = "2 deg", contact = {law = "newton", restitution = 0.5}}'),
    drives=dict(axle="free = true", hub="free = true, initial_speed = 3"),
    solve=dict(preset="coupled", duration="0.2 s", steps=50),
)


BAR = pendulum(
    'length = "0.5 m", beam = {material = "steel", section = {rectangle = ["10 mm", "20 mm"]}, elements = 8}',
    'free = true, angle = "2 deg"', gravity=WEIGHT, ground={"stop": ["0.5 m", "-10 mm"]},
    contacts="""
stop.point_on_line = ["bar.end", "ground.stop"]
stop.normal = [0, 1]
stop.radius = "10 mm"
stop.contact = {law = "newton", restitution = 0.3}""",
    damping='rayleigh = {ratio = "5 %", at = ["300 Hz", "3000 Hz"]}',
    sensors='tip = {position = "bar.end", component = "y"}',
    solve={"preset": "coupled", "duration": "1 s", "steps": 1000},
)


def test_an_elastic_bar_jumps_in_all_its_shapes_and_comes_to_rest():
    """At rest on hinge and stop it bears w l/2; the books are closed over all impacts, in which shapes take part."""
    solution = solved(BAR)
    assert solution.outcome is Outcome.COMPLETED
    impacts, energy = solution.impacts, solution.trajectory.energy
    assert len(impacts) > 3 and impacts[-1].lasts
    assert solution.trajectory.contacts.force[-1, 0] == pytest.approx(7850 * 2e-4 * G * 0.5 / 2, rel=1e-2)
    assert solution.trajectory.contacts.gap.min() > -1e-12
    assert sum(impact.lost for impact in impacts) == pytest.approx(solution.trajectory.contacts.lost[-1, 0], rel=1e-9)
    assert energy.drift < 1e-5
    between = solution.at(solution.times[-3:] - 0.3e-3)
    assert abs(between.trajectory.contacts.gap).max() < 1e-12
    assert between.trajectory.contacts.force == pytest.approx(solution.trajectory.contacts.force[-3:], rel=1e-3)


LIFTED = """
schema = 1
gravity = [0, -9.81]
bodies.block = {mass = 1, inertia = 0.1, free = {at = [0, 0]}}
contacts.floor = {point_on_line = ["block", "ground"], normal = [0, 1], contact = {law = "newton", restitution = 0}}
loads.pull = {force_on = "block", direction = [0, 1], law = "20 * t"}
solve = {preset = "coupled", duration = "1 s", steps = 10}
"""


def test_rigid_sides_do_not_pull_between_stored_instants():
    solution = solved(LIFTED)
    found = solution.at(np.linspace(0.4, 0.5, 21)).trajectory
    assert found.contacts.force.min() == 0.0
    assert found.contacts.force[0] == pytest.approx(9.81 - 8.0)


def test_backlash_with_rigid_flanks_rattles_by_its_closed_form():
    """The angle between two free wheels goes to and fro between flanks 2 a apart, at every impact e times as fast."""
    solution = solved(PLAY)
    half, rate, begun = math.radians(2), 3.0, [math.radians(2) / 3]
    for _ in range(2):
        rate *= 0.5
        begun.append(begun[-1] + 2 * half / rate)
    assert [impact.begin for impact in solution.impacts] == pytest.approx(begun, rel=1e-9)
    assert [impact.approach for impact in solution.impacts] == pytest.approx([3, 1.5, 0.75], rel=1e-9)
    resisting = 1 / (1 / 0.02 + 1 / 0.01)
    assert [impact.impulse for impact in solution.impacts] == pytest.approx(
        [resisting * 1.5 * rate for rate in (3, 1.5, 0.75)], rel=1e-9
    )
    assert solution.trajectory.energy.drift < 1e-9
    told = printed(solution.model.scene, parts(solution.model.scene))
    assert "2 deg from the middle, rigid, law newton, restitution 0.5" in told


def test_what_lies_on_its_base_but_for_rounding_presses_on_it_from_the_start():
    solution = solved(machine(
        gravity=WEIGHT, bodies=dict(block="length = 5, mass = 2"),
        joints=dict(up="prismatic ground block, direction = [0, 1]"),
        drives=dict(up="free = true, position = 1e-16"),
        contacts=dict(floor='point_on_line = ["block", "ground"], normal = [0, 1], '
                            'contact = {law = "newton", restitution = 0}'),
        sensors=dict(push="contact_force floor"), solve=dict(preset="coupled", duration="1 ms", steps=2),
    ))  # fmt: skip
    assert solution.series["push"].values == pytest.approx(2 * 9.81)


def test_a_run_that_an_event_ends_has_no_later_impacts():
    """A block falls by 0.5 m and stops the run on its way up again, before it bounces six more times."""
    solution = solved(machine(
        gravity=WEIGHT, bodies=dict(block="length = 5, mass = 2"),
        joints=dict(up="prismatic ground block, direction = [0, 1]"),
        drives=dict(up="free = true, position = 0.5"),
        contacts=dict(floor='point_on_line = ["block", "ground"], normal = [0, 1], '
                            'contact = {law = "newton", restitution = 0.5}'),
        sensors=dict(height="position block y"),
        events=dict(back='sensor = "height", value = 0.1, direction = "up", stop = true'),
        solve=dict(preset="coupled", duration="1 s", steps=20),
    ))  # fmt: skip
    fall, up = math.sqrt(1 / 9.81), 0.5 * math.sqrt(9.81)
    assert solution.times[-1] == pytest.approx(fall + (up - math.sqrt(up**2 - 2 * 9.81 * 0.1)) / 9.81, rel=1e-9)
    assert [impact.begin for impact in solution.impacts] == pytest.approx([fall], rel=1e-9)
