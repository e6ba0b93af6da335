"""Backlash: a pin whose bodies turn freely within its play, between flanks: against closed forms; units."""

import math

import numpy as np
import pytest
from machines import machine
from runs import alike

from kaneflex import SceneError, load, scene_of, with_settings
from kaneflex.report.presentation import contact_line
from kaneflex.report.summary import summarise
from kaneflex.scene.contact_check import CONTACT_RESULTS
from kaneflex.solve.simulation import solve

PLAY, SHAFT, WHEEL, SPEED = math.radians(0.5), 0.01, 0.02, 10.0
SCENE = machine(
    description="A flywheel between the flanks of a coupling",
    bodies=dict(shaft='mass = "1 kg", inertia = "0.01 kg m^2"', wheel='mass = "2 kg", inertia = "0.02 kg m^2"'),
    joints=dict(hub="revolute ground shaft",
                coupling='revolute shaft wheel, clearance = {angle = "0.5 deg", contact = CONTACT}'),
    drives=dict(hub="speed = 0", coupling='free = true, initial_speed = "10 rad/s"'),
    sensors=dict(angle="position coupling angle", on="contact_torque coupling_1", room="contact_angle coupling_2"),
    solve=dict(preset="coupled", duration="0.1 s", steps=500),
)
ELASTIC = '{law = "hertz", stiffness = "2e5 N m/rad", exponent = 1}'
EXACT = '{stiffness = "1e6 N m/rad^1.5", restitution = 0.8}'
FREE = ("drives.hub={speed='none', free=true, initial_speed='-5 rad/s'}", "solve.tolerance=1e-10")


def read(contact, *settings):
    return with_settings(scene_of(SCENE.replace("CONTACT", contact)), settings)


def solved(contact, *settings):
    solution = solve(load(read(contact, *settings)))
    assert solution.outcome.name == "COMPLETED", solution.trajectory.message
    return solution


def swing(t, inertia, speed=SPEED, K=2e5):
    """Angle of a wheel that turns freely over the play and swings half a period in each flank."""
    omega = math.sqrt(K / inertia)
    flight, deep = 2 * PLAY / speed, math.pi / omega
    count, phase = np.divmod(t + PLAY / speed, flight + deep)
    flying = -PLAY + speed * phase
    return (1 - 2 * (count % 2)) * np.where(
        phase < flight, flying, PLAY + speed / omega * np.sin(omega * (phase - flight))
    )


@pytest.mark.parametrize("integrator", ["gauss", "radau"])
def test_a_wheel_between_elastic_flanks_comes_back_with_its_period(integrator):
    solution = solved(ELASTIC, f"solve.integrator={integrator}", "solve.tolerance=1e-10")
    angle = solution.trajectory.q[:, 5]
    assert angle == pytest.approx(swing(solution.times, WHEEL), abs=1e-6 * PLAY)
    assert len(solution.impacts) > 20
    assert solution.trajectory.energy.drift < 1e-8


def test_two_bodies_between_flanks_swing_by_their_reduced_inertia():
    """Both turn free: the play is crossed at the speed of the one against the other, what they have together stays."""
    solution = solved(ELASTIC, *FREE)
    angle, speed = solution.trajectory.q, solution.trajectory.v
    reduced = SHAFT * WHEEL / (SHAFT + WHEEL)
    assert angle[:, 5] - angle[:, 2] == pytest.approx(swing(solution.times, reduced), abs=1e-6 * PLAY)
    spin = SHAFT * speed[:, 2] + WHEEL * speed[:, 5]
    assert spin == pytest.approx(np.full(len(spin), -5 * SHAFT + 5 * WHEEL), abs=1e-12)


@pytest.mark.parametrize("e", [0.05, 0.5, 0.99])
@pytest.mark.parametrize(("n", "K"), [(1, "2e5 N m/rad"), (1.5, "1e6 N m/rad^1.5"), (2, "1e8 N m/rad^2")])
def test_a_flank_returns_the_restitution_that_was_asked_for(n, K, e):
    contact = f'{{stiffness = "{K}", exponent = {n}, restitution = {e}}}'
    solution = solved(contact, "solve.duration=8 ms", "solve.steps=10", "solve.tolerance=1e-9")
    first = solution.impacts[0]
    assert (first.contact, first.approach) == ("coupling_2", pytest.approx(SPEED, rel=1e-12))
    assert first.begin == pytest.approx(PLAY / SPEED, rel=1e-12)
    assert first.separation == pytest.approx(e * SPEED, rel=1e-6)
    assert first.impulse == pytest.approx(WHEEL * SPEED * (1 + e), rel=1e-6)
    assert first.lost == pytest.approx(0.5 * WHEEL * SPEED**2 * (1 - e**2), rel=1e-6)


def test_rigid_flanks_are_met_at_instants_in_closed_form():
    """By Newton's law: over the play at 10 e^k rad/s, k = 0, 1, ..."""
    solution = solved('{law = "newton", restitution = 0.8}', "solve.duration=50 ms")
    instants = PLAY / SPEED * (1 + 2 * np.cumsum([0.0, *0.8 ** -np.arange(1.0, 9.0)]))
    assert [impact.begin for impact in solution.impacts] == pytest.approx(instants, rel=1e-10)
    speeds = SPEED * 0.8 ** np.arange(1.0, 10.0)
    assert [impact.separation for impact in solution.impacts] == pytest.approx(speeds, rel=1e-10)
    told = contact_line(solution.model.scene.contacts["coupling_1"])
    assert "0.5 deg from the middle, rigid, law newton, restitution 0.8" in told


def test_flanks_of_an_elastic_arm_are_those_of_a_hub_that_is_welded_to_it():
    """A hub next to nothing: both arms turn with the same section, and feel the same torque, modes and all."""
    beam = 'beam = {material = "steel", section = {rectangle = ["10 mm", "8 mm"]}, elements = 6}'
    arm = f'arm = {{length = "0.4 m", {beam}}}'
    wheel = 'wheel = {mass = "2 kg", inertia = "0.02 kg m^2"}'
    text = SCENE.replace("CONTACT", '{stiffness = "1e5 N m/rad^1.5", restitution = 0.8}') + """
sensors.moment = {bending_moment = "arm.mid"}
sensors.root = {bending_moment = "arm.start"}
sensors.tip = {displacement = "arm.end", component = "y"}
"""
    own = text.replace(wheel, arm).replace('"wheel"', '"arm"')
    hub = text.replace(wheel, f'wheel = {{mass = "1e-6 kg", inertia = "1e-9 kg m^2"}}\nbodies.{arm}')
    hub += 'joints.fast.weld = ["wheel", "arm"]'
    found = []
    for scene in (own, hub):
        settings = "solve.duration=14 ms", "solve.steps=280", "solve.modes=1"
        found.append(solve(load(with_settings(scene_of(scene), settings))))
    one, other = found
    assert len(one.impacts) == len(other.impacts) > 1
    for impact, welded in zip(one.impacts, other.impacts, strict=True):
        assert impact.begin == pytest.approx(welded.begin, rel=1e-3)
    alike(other, one, 5e-3, ("angle", "on", "tip", "moment", "root"))
    assert one.trajectory.energy.drift < 1e-6


def test_a_law_may_jump_beside_contacts():
    """A torque from 0.5 ms on: where and how fast it then meets the flank, and what of its speed comes back."""
    jump = "loads={push={torque_at='coupling', law='2*step(t - 0.0005)'}}"
    first = solved('{law = "newton", restitution = 0.8}', jump, "solve.duration=2 ms").impacts[0]
    speed = math.sqrt(SPEED**2 + 2 * (2 / WHEEL) * (PLAY - 0.0005 * SPEED))
    assert first.begin == pytest.approx(0.0005 + (speed - SPEED) / (2 / WHEEL), rel=1e-12)
    assert (first.approach, first.separation) == pytest.approx((speed, 0.8 * speed), rel=1e-10)


def test_a_coupling_that_turns_fast_knocks_as_one_that_doesn_t():
    """At 3000 rpm, after some turns: the play is small beside the angle of either body."""
    fast = "drives.hub={speed='3000 rpm'}", "drives.coupling.initial_speed=10 rad/s"
    still, turning = (solved(EXACT, "solve.tolerance=1e-9", *settings) for settings in ((), fast))
    assert len(still.impacts) == len(turning.impacts) > 8
    for one, other in zip(still.impacts[:8], turning.impacts[:8], strict=True):
        assert other.begin == pytest.approx(one.begin, rel=1e-6)
        assert other.separation == pytest.approx(one.separation, rel=1e-6)


def test_units_are_those_of_angles_and_torques():
    solution = solved(EXACT)
    data = solution.dataset
    units = {"flank_gap": "rad", "flank_torque": "N m", "flank_impact_approach": "rad/s", "flank_impact_peak": "N m",
             "flank_impact_impulse": "N m s", "on": "N m", "room": "rad"}  # fmt: skip
    assert {name: data[name].attrs["units"] for name in units} == units
    assert "contact_gap" not in data
    assert set(data.data_vars) - set(solution.series) < set(CONTACT_RESULTS)
    peaks = [impact.peak for impact in solution.impacts if impact.contact == "coupling_1"]
    assert solution.statistics("on").max == max(peaks) > solution.series["on"].values.max()
    assert data.flank_gap.values[:, 1] == pytest.approx(PLAY - solution.trajectory.q[:, 5], abs=1e-15)
    flank = summarise(solution).contacts["coupling_2"]
    assert (flank.fastest_m_s, flank.largest_force) == (None, None)
    assert flank.fastest_rad_s == pytest.approx(10) and flank.largest_torque > 100
    told = contact_line(solution.model.scene.contacts["coupling_1"])
    assert "flank of shaft.start that turns wheel.start forwards, 0.5 deg from the middle, 1e+06 N m/rad^1.5, " \
        "law exact, restitution 0.8" in told  # fmt: skip


@pytest.mark.parametrize(("contact", "settings", "message"), [
    ('{stiffness = "1e6 N/m^1.5", restitution = 1}', (), "joints.coupling.clearance.contact.stiffness = .*N m/rad"),
    ('{materials = ["steel", "steel"], restitution = 1}', (), "Hertz's theory does not apply to flanks"),
    (EXACT, ("drives.coupling={law='t', free='none', initial_speed='none'}",),
     "coupling has backlash, and its drive prescribes the same angle"),
    (EXACT, ("drives.coupling.angle=2 deg",), "at the start its angle is 2 deg from the middle of the backlash"),
    (EXACT, ("drives.coupling.angle=-719.9 deg",), "is -719.9 deg from the middle"),
    (EXACT, ("drives.coupling.angle=361 deg",), "at the start its angle is 361 deg from the middle"),
    (EXACT, ("sensors.on={contact_force='coupling_1', contact_torque='none'}",),
     "a flank has a torque and an angle. Write contact_torque"),
    (EXACT, ("solve.preset=rigid",), "preset rigid does not support a joint with a clearance"),
    (EXACT, ("joints.coupling.clearance.radius=1 mm",), "does not apply to"),
])  # fmt: skip
def test_what_backlash_can_t_be_is_refused(contact, settings, message):
    with pytest.raises(SceneError, match=message):
        load(read(contact, *settings))


def test_play_may_lie_about_any_angle():
    middle = "joints.coupling.clearance.middle=30 deg", "drives.coupling.angle=30 deg"
    plain, turned = (solved(EXACT, *settings) for settings in ((), middle))
    assert turned.trajectory.q[:, 5] - math.pi / 6 == pytest.approx(plain.trajectory.q[:, 5], abs=1e-6 * PLAY)


def test_bodies_whole_turns_apart_are_named():
    """Both have bearings of their own, the coupling no drive: only their angles say by how much they are turned."""
    text = SCENE.replace("CONTACT", EXACT).replace("coupling = {free", "bearing = {free")
    good = scene_of(text + 'joints.bearing.revolute = ["ground", "wheel"]')
    assert solve(load(good)).impacts
    with pytest.raises(SceneError, match="at the start its angle is 1 full turns from the middle of the backlash"):
        solve(load(with_settings(good, ["drives.bearing.angle=360 deg"])))
