"""Laws of loads that jump or have kinks, in the time, in drives and in other joints: against closed forms."""

import math

import numpy as np
import pytest
from lifting import lifted
from machines import machine, pendulum
from parity import compared, planar, random_turn
from runs import alike, changes, solved
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from kaneflex import SceneError, load, read_scene, scene_of, simulate, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.study.sensitivity.report import check_differentiable

J = 0.02
WHEEL = pendulum(
    'mass = "2 kg", inertia = "0.02 kg m^2"', 'free = true, initial_speed = "10 rad/s"', "wheel", "hub",
    loads='torque = {torque_at = "hub", law = "0"}', sensors='angle = {position = "hub", component = "angle"}',
    solve={"preset": "coupled", "duration": "1 s", "steps": 8},
)
WHEEL_IN_SPACE = machine(
    description="A wheel on its hub and a ball in flight; a beam beside them makes the mechanism elastic",
    ground=dict(side=[0, 1, 0]),
    bodies=dict(wheel='mass = "2 kg", inertia = [0.02, 0.02, 0.02]',
                ball='mass = "2 kg", inertia = [0.02, 0.02, 0.02], '
                     'free = {velocity = [0, 0, 1], angular_velocity = [3, 4, 12]}',
                beam='length = "200 mm", '
                     'beam = {E = 210e9, nu = 0.3, rho = 7850, A = 1e-4, I_y = 1e-9, I_z = 1e-9, J = 2e-9}'),
    joints=dict(hub="revolute ground wheel, axis = [1, 2, 2]", clamp="weld ground.side beam.start"),
    drives=dict(hub='free = true, initial_speed = "10 rad/s"'),
    loads=dict(torque='torque_at = "hub", law = "0"',
               push='force_on = "ball", direction = [1, 0, 0], law = "4*step(t - 0.3137)"'),
    sensors=dict(angle="position hub angle", speed="velocity hub angle", x='position ball x, axes = "global"',
                 angular='velocity ball angle_z, axes = "body"'),
    solve=dict(preset="coupled", duration="1 s", steps=8, modes=1),
)
METHODS = pytest.mark.parametrize("integrator", ["gauss", "radau"])


def moved(law, *settings, text=WHEEL):
    scene = with_settings(scene_of(text), [f"loads.torque.law={law}", *settings])
    return solved(scene)


def motion(solution):
    """Times, angles and speeds of the wheel."""
    assert solution.outcome is Outcome.COMPLETED, solution.message
    if "speed" in solution.series:
        return solution.times, *(solution[name].values for name in ("angle", "speed"))
    return solution.times, solution.trajectory.q[:, 2], solution.trajectory.v[:, 2]


def switched(solution):
    """Instants at which loads of a run switch [s]."""
    return [row[0] for row in changes(solution)[::2]]


@METHODS
def test_a_jump_in_time_is_located(integrator):
    """Steps as long as the stored instants allow, one of them over the jump and rejected: nothing of it is lost."""
    solution = moved("3*step(t - 0.3137)", f"solve.integrator={integrator}")
    t, angle, speed = motion(solution)
    assert (solution.trajectory.steps, solution.trajectory.rejected) == (9, 1)
    since = np.clip(t - 0.3137, 0, None)
    assert angle == pytest.approx(10 * t + 1.5 / J * since**2, abs=1e-12)
    assert speed == pytest.approx(10 + 3 / J * since, abs=1e-11)


@METHODS
@pytest.mark.parametrize("text", [WHEEL, WHEEL_IN_SPACE], ids=["plane", "space"])
def test_a_jump_at_a_place_is_located(integrator, text):
    """Torque from 1 rad on, where the wheel is at 0.1 s; in space with a ball that turns across jumps: none is lost."""
    solution = moved("3*step(hub - 1)", f"solve.integrator={integrator}", text=text)
    t, angle, speed = motion(solution)
    since = np.clip(t - 0.1, 0, None)
    assert angle == pytest.approx(10 * t + 1.5 / J * since**2, abs=1e-12)
    assert speed == pytest.approx(10 + 3 / J * since, abs=1e-11)
    if text == WHEEL_IN_SPACE:
        assert solution["x"].values == pytest.approx(np.clip(t - 0.3137, 0, None) ** 2, abs=1e-12)
        assert solution["angular"].values == pytest.approx(np.full(9, 12.0), abs=1e-12)
        assert switched(solution) == pytest.approx([0.1, 0.3137], abs=1e-14)


@pytest.mark.parametrize("text", [WHEEL, WHEEL_IN_SPACE], ids=["plane", "space"])
def test_a_jump_at_the_start_is_passed_in_every_run_and_where_one_continues(text):
    """A torque of 3 N m for half a second of every second: runs of one model are alike, and the next second, where
    sin(2 pi) is -2e-16, begins with it, too."""
    scene = with_settings(scene_of(text), ["loads.torque.law=3*step(sin(2*pi*t))"])
    model = load(scene)
    for _ in range(50):
        found = simulate(model)
    for after in (found, simulate(load(scene), after=found)):
        t, angle, speed = motion(after)
        on = t // 1 * 0.5 + np.minimum(t % 1, 0.5)
        assert speed == pytest.approx(10 + 3 / J * on, abs=1e-9)
    assert angle[0] == pytest.approx(10 + 3 / J * (0.125 + 0.25), abs=1e-9)


@pytest.mark.parametrize("law", ["step(23*t)", "sign(sin(t)) + 1 - step(-t)", "step(sin(t))"])
def test_a_jump_at_the_start_is_passed_with_bristles(law):
    """Steps became so short there that LuGre's friction was no number: against its equations by scipy."""
    scene = scene_of(f"""
schema = 1
bodies.block = {{mass = "1 kg"}}
joints.slide.prismatic = ["ground", "block"]
joints.slide.direction = [1, 0]
joints.slide.friction = {{law = "lugre", preload = "0.5 N", bristle_stiffness = "1e3 N/m", bristle_damping = 30}}
drives.slide.free = true
loads.pull = {{force_on = "block", direction = [1, 0], law = "{law}"}}
sensors.x = {{position = "slide"}}
sensors.rate = {{acceleration = "block", axes = "global"}}
solve = {{preset = "coupled", duration = "0.5 s", steps = 10}}
""")
    pull = 2.0 if "sign" in law else 1.0

    def rates(t, y):
        bends = y[1] - 1e3 * abs(y[1]) * y[2] / 0.5
        return [y[1], pull - 1e3 * y[2] - 30.0 * bends, bends]

    found = solved(scene)
    expected = solve_ivp(rates, (0.0, 0.5), np.zeros(3), "Radau", found.times, rtol=1e-10, atol=1e-13).y[0]
    assert found.outcome is Outcome.COMPLETED, found.message
    assert found.series["x"].values == pytest.approx(expected, abs=1e-6)
    assert found.series["rate"].values[0] == pytest.approx(pull, rel=1e-9)


@pytest.mark.parametrize("speed", [20.0, -20.0])
def test_a_cycle_may_begin_at_a_jump(speed):
    """There rounding decides on which side a law is: a square wave of force on a mass, a spring and a damper."""
    scene = scene_of(f"""
schema = 1
bodies.block = {{mass = "2 kg"}}
bodies.crank = {{mass = "1 kg"}}
joints.main = {{revolute = ["ground", "crank"]}}
joints.slide = {{prismatic = ["ground", "block"], direction = [1, 0]}}
drives.main = {{speed = {speed}, angle = "180 deg", cycle = "360 deg"}}
drives.slide.free = true
loads.push = {{force_on = "block", direction = [1, 0], law = "50*step(sin(main)) - 800*slide - 4*slide_speed"}}
sensors.x = {{position = "slide"}}
solve = {{preset = "coupled", start = "periodic", steps = 40}}
""")
    A, half = np.array([[0.0, 1.0], [-400.0, -2.0]]), math.pi / 20.0
    over, rest = expm(half * A), np.array([1.0 / 16.0, 0.0])
    one, two = (rest, 0.0 * rest) if speed < 0.0 else (0.0 * rest, rest)  # in the halves of a cycle
    x = np.linalg.solve(np.eye(2) - over @ over, (over - over @ over) @ one + two - over @ two)
    found = solved(scene)
    expected = [(expm(t * A) @ (x - one) + one)[0] for t in found.times[:21]]
    assert found.series["x"].values[:21] == pytest.approx(np.array(expected), abs=1e-7)


@METHODS
@pytest.mark.parametrize(("text", "steps"), [(WHEEL, 7), (WHEEL_IN_SPACE, 8)], ids=["plane", "space"])
def test_a_brake_stops_a_wheel_that_nothing_else_moves(integrator, text, steps):
    """Torque T stops it after J w/T = 0.4 s and J w^2/(2 T) = 2 rad, and there it stays."""
    settings = (f"solve.integrator={integrator}", f"solve.steps={steps}")
    solution = moved("-0.5*sign(hub_speed)", *settings, text=text)
    t, angle, speed = motion(solution)
    left = np.clip(0.4 - t, 0, None)
    assert angle == pytest.approx(2 - 0.25 / J * left**2, abs=1e-12)
    assert speed == pytest.approx(0.5 / J * left, abs=1e-11)
    if text == WHEEL_IN_SPACE:
        found = solution.model.motion.at(np.array([0.2, 0.39, 0.41, 0.9]))
        assert found["torque"] == pytest.approx([-0.5, -0.5, 0.0, 0.0])


@pytest.mark.parametrize("settings", [(), ("drives.hub.initial_speed=0",)])
def test_a_brake_that_would_have_to_hold_is_named(settings):
    """Against a smaller torque its sign would have to be a number between -1 and 1: that is friction, no law."""
    solution = moved("0.2 - 0.5*sign(hub_speed)", *settings)
    assert solution.outcome is Outcome.CASCADE
    assert "the law of loads.torque switches back and forth" in solution.trajectory.message
    assert solution.times[-1] <= (10 * J / 0.3 if not settings else 0.0)


def test_between_stored_instants_a_law_stands_on_its_side():
    """Dense output across the stop of a brake: angles and torques as they are on either side, and at rest."""
    solution = moved("-0.5*sign(hub_speed)")
    found = solution.at([0.2, 0.3, 0.37, 0.6, 0.9])
    left = np.clip(0.4 - found.times, 0, None)
    assert found.trajectory.v[:, 2] == pytest.approx(0.5 / J * left, abs=1e-6)
    assert found.trajectory.a[:, 2] == pytest.approx(np.where(left > 0, -0.5 / J, 0), abs=1e-6)


@METHODS
def test_a_torque_of_one_size_swings_with_its_period(integrator):
    """J x'' = -T sign(x) from speed v at 0: half a swing lasts 2 J v/T."""
    settings = f"solve.integrator={integrator}", "solve.duration=4 s", "solve.steps=50"
    t, angle, _ = motion(moved("-2*sign(hub)", *settings))
    half = 2 * J * 10 / 2
    phase, side = t % half, 1 - 2 * (t // half % 2)
    assert angle == pytest.approx(side * (10 * phase - phase**2 / J), abs=1e-10)


def test_a_spring_with_two_stiffnesses_swings_with_half_a_period_of_each():
    """A kink at rest: -k x for x > 0, -4 k x below."""
    k = 0.5
    law = f"-{k}*max(hub, 0) - 4*{k}*min(0, hub)"
    t, angle, _ = motion(moved(law, "solve.duration=5 s", "solve.steps=40", "solve.tolerance=1e-10"))
    omega = math.sqrt(k / J)
    cycle = 1.5 * math.pi / omega
    phase = t % cycle
    up, down = 10 / omega * np.sin(omega * phase), -5 / omega * np.sin(2 * (omega * phase - math.pi))
    assert angle == pytest.approx(np.where(omega * phase < math.pi, up, down), abs=1e-7)


def test_pulses_that_are_shorter_than_any_step_are_not_stepped_over():
    """1 N m wherever the sine is above 0.999: 5 pulses of a share of their period, none where an instant is stored."""
    t, _, speed = motion(moved("step(sin(2*pi*5*t) - 0.999)", "solve.steps=5", "drives.hub.initial_speed=0"))
    width = (math.pi - 2 * math.asin(0.999)) / (10 * math.pi)
    assert speed == pytest.approx(5 * t * width / J, rel=1e-9, abs=1e-15)


def test_an_angle_has_a_jump_where_it_is_cut():
    """A torque against the angle within half a turn of zero: over whole turns it takes nothing from the wheel."""
    solution = moved("-0.05*atan2(sin(hub), cos(hub))", "solve.tolerance=1e-10", "solve.duration=3 s")
    _, angle, speed = motion(solution)
    within = np.arctan2(np.sin(angle), np.cos(angle))
    assert angle[-1] > 4 * math.pi
    assert J * speed**2 + 0.05 * within**2 == pytest.approx(np.full(len(angle), 100 * J), rel=1e-8)


@pytest.mark.parametrize("law", ["atan2(0*t, 0*hub)", "abs(0*t)", "max(hub, hub)", "sign(min(0*hub, abs(t)))"])
def test_what_stays_at_a_jump_has_its_value_there(law):
    t, angle, _ = motion(moved(law.replace("max(hub, hub)", "max(hub, hub) - hub")))
    assert angle == pytest.approx(10 * t, abs=1e-12)


def test_a_smooth_step_rises_between_its_places():
    """The work of a torque that rises from 0 at 0.2 s to 2 at 0.6 s: half of it by then, as the step is odd."""
    t, _, speed = motion(moved("step(t, 0.2, 0, 0.6, 2)", "solve.steps=10"))
    assert speed[t >= 0.6] == pytest.approx(10 + (0.4 + 2 * (t[t >= 0.6] - 0.6)) / J, rel=1e-9)


def test_jumps_without_an_error_control_are_refused():
    with pytest.raises(SceneError, match="jumps, and preset rigid would step over the jump as it integrates hub"):
        moved("-0.5*sign(hub_speed)", "solve.preset=rigid")
    assert moved("min(hub, 3)", "solve.preset=rigid", "solve.steps=100").outcome is Outcome.COMPLETED


def test_an_angle_of_time_jumps_only_where_it_is_cut():
    """That of a point on a circle about (1, 0) stays on its branch; about the origin it jumps at half a turn."""
    smooth = "0.1*atan2(0.5*sin(2*t), 1 - 0.5*cos(2*t))"
    settings = ("solve.preset=rigid", "solve.steps=100")
    assert moved(smooth, *settings).outcome is Outcome.COMPLETED
    for cut in ("0.1*atan2(sin(9*t), cos(9*t))", "0.1*atan2(sin(hub), 2 + cos(hub))"):
        with pytest.raises(SceneError, match=r"atan2.* jumps, and preset rigid would step over"):
            moved(cut, *settings)


def test_a_law_that_turns_is_not_differentiated():
    scene = with_settings(scene_of(WHEEL), ["loads.torque.law=max(0, hub)"])
    with pytest.raises(SceneError, match=r"the instants at which max\(0, hub\) has a kink depend on the parameter"):
        check_differentiable(scene, False)


def test_a_joint_with_no_drive_is_refused_where_only_drives_are_known():
    base = read_scene("four-bar-motor")
    with pytest.raises(SceneError, match="laws and tables can use joints with a drive only: second has none"):
        load(with_settings(base, ["loads.motor.law=1 - second", "solve.preset=linear"]))
    with pytest.raises(SceneError, match="unknown name 'third'"):
        with_settings(base, ["loads.motor.law=1 - third"])


def test_an_elastic_belt_rings_between_its_pulleys():
    """k (r_1 a - r_2 b) pulls both: a = A cos(w t), w^2 = k (r_1^2/J_1 + r_2^2/J_2), beside what turns on."""
    stretch = "2e4*(0.05*hub - 0.12*mill)"
    text = WHEEL + f"""
bodies.big = {{mass = 9, inertia = 0.2}}
joints.mill = {{revolute = ["ground", "big"]}}
drives.mill.free = true
loads.mill = {{torque_at = "mill", law = "0.12*{stretch}"}}
"""
    solution = moved(f"-0.05*{stretch}", "solve.tolerance=1e-10", text=text)
    k_1, k_2, v = 2e4 * 0.05**2 / J, 2e4 * 0.12**2 / 0.2, 10.0
    omega = math.sqrt(k_1 + k_2)
    assert motion(solution)[1] == pytest.approx(
        v * k_2 / omega**2 * solution.times + v * k_1 / omega**3 * np.sin(omega * solution.times), abs=1e-8
    )


FOUR_BAR = ("solve.preset=coupled", "solve.duration=0.3 s", "solve.steps=60", "solve.tolerance=1e-10")


@pytest.mark.parametrize(("joint", "settings"), [("second", ()), ("rocker", ("bodies.coupler.beam=none",))])
def test_laws_know_joints_without_a_drive(joint, settings):
    """A torque by law in a joint's angle and speed is a torsional spring with its damper."""
    base = with_settings(read_scene("four-bar-motor"), [*FOUR_BAR])
    kept = {name: f"loads.{name}=none" for name in base.loads}
    spring = f"springs={{twist={{torsional_at='{joint}', stiffness=3, damping=0.02, angle=0.4}}}}"
    law = f"loads={{twist={{torque_at='{joint}', law='-3*({joint} - 0.4) - 0.02*{joint}_speed'}}}}"
    found = [solved(base, *kept.values(), given) for given in (spring, law)]
    assert [each.outcome for each in found] == [Outcome.COMPLETED] * 2
    alike(*found, 1e-6, [name for name in base.sensors if not name.endswith("_rigid")])


@pytest.mark.parametrize(("name", "settings"), [
    ("four-bar-motor", ("loads.motor.law=1.5*step(main_speed - 2) + 0.6*(1 - main_speed/31.4)",)),
    ("elastic-pendulum", ("loads={brake={torque_at='hinge', law='-0.02*step(hinge + 0.3) - 0.2*abs(hinge + 0.4)'}}",
                          "drives.hinge.initial_speed=2 rad/s", "solve.duration=0.4 s")),
])  # fmt: skip
def test_in_space_loads_switch_when_they_do_in_the_plane(name, settings):
    """At the same instants, with the same sensors, within both runs' errors."""
    flat, turn = with_settings(planar(name, "coupled"), [*settings]), random_turn(name)
    plane, space = solved(flat), solved(scene_of(lifted(flat, turn) | {"solve": flat.raw["solve"]}))
    assert switched(plane) and switched(space) == pytest.approx(switched(plane), abs=1e-6)
    assert [each for each in compared(flat, turn).sensors if not each.agrees] == []


def test_in_space_a_kink_of_a_load_reaches_the_drive():
    """A rigid arm turned from -1 to 1 rad by its drive against |angle|."""
    text = WHEEL_IN_SPACE.partition("bodies.ball")[0] + """
joints.hub = {revolute = ["ground", "wheel"], axis = [1, 2, 2]}
drives.hub = {law = "2*t - 1"}
loads.torque = {torque_at = "hub", law = "0"}
sensors.torque = {drive_torque = "hub"}
solve = {preset = "rigid", duration = "1 s", steps = 10}
"""
    solution = moved("abs(hub) + step(t - 0.42)", text=text)
    t = solution.times
    assert solution["torque"].values == pytest.approx(-abs(2 * t - 1) - (t > 0.42), abs=1e-12)
    angle = 'angle = {position = "hub", component = "angle"}'
    free = text.replace('law = "2*t - 1"', "free = true").replace('torque = {drive_torque = "hub"}', angle)
    with pytest.raises(SceneError, match="jumps, and preset rigid would step over the jump as it integrates"):
        moved("sign(hub_speed)", "solve.preset=rigid", text=free)
    found = moved("3*step(t - 0.42)", "solve.preset=coupled", text=free)["angle"].values
    assert found == pytest.approx(1.5 / J * np.clip(t - 0.42, 0, None) ** 2, abs=1e-12)


def test_in_space_a_cycle_is_judged_with_the_jumps_that_it_passes():
    """Floquet multipliers of J x'' + c x' + k x = T sin(w t) - F sign(x): between jumps by the matrix exponential, at
    each of them the speed's deviation grows by the jump of the acceleration over the speed (Leine & Nijmeijer 2004)."""
    text = WHEEL_IN_SPACE.partition("bodies.ball")[0] + "bodies.beam" + WHEEL_IN_SPACE.partition("bodies.beam")[2]
    text = text.replace('loads.push = {force_on = "ball", direction = [1, 0, 0], law = "4*step(t - 0.3137)"}\n', "")
    text = text.partition("sensors.x = {position")[0] + """
bodies.rotor = {mass = 1, inertia = [0.01, 0.01, 0.01]}
joints.shaft = {revolute = ["ground.side", "rotor"], axis = [0, 0, 1]}
drives.shaft = {speed = "20 rad/s", cycle = "360 deg"}
damping.rayleigh = {ratio = 0.05, at = ["50 Hz", "500 Hz"]}
solve = {preset = "coupled", start = "periodic", steps = 40, modes = 1, tolerance = 1e-9}
"""
    c, k, force, w = 0.08, 8.0, 0.2, 20.0
    solution = moved(f"-{k}*hub - {c}*hub_speed - {force}*sign(hub) + 1.5*sin({w}*t)", text=text)
    run, A = solution.model.motion.curve, np.array([[0.0, 1.0], [-k / J, -c / J]])
    found, last = np.eye(2), 0.0
    for t in switched(solution):
        speed = run(t).u[solution.model.motion.module.system.speeds_of("hub")[0]]
        found = np.array([[1.0, 0.0], [-2.0 * force / J / abs(speed), 1.0]]) @ expm((t - last) * A) @ found
        last = t
    found = expm((2.0 * math.pi / w - last) * A) @ found
    assert len(switched(solution)) == 2
    wanted = np.linalg.eigvals(found)
    floquet = solution.multipliers
    assert all(abs(floquet - each).min() < 1e-4 for each in wanted), (floquet, wanted)
