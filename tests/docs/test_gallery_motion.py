"""The gallery's mechanisms whose motion and forces can be checked by energy, geometry or symmetry."""

import numpy as np
import pytest
from newton_euler import imbalance
from runs import model, run

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.scene import Scene

# ---- energy and power --------------------------------------------------------------------------------------------


def energy(scene: Scene, rigid: RigidMotion) -> np.ndarray:
    """Kinetic and potential energy of the rigid mechanism [J], (n_times,), lumped masses included."""
    total = np.zeros(len(rigid.times))
    fixed = [(name, body.mass, body.inertia, body.centre) for name, body in scene.bodies.items()]
    fixed += [(mass.at.body, mass.mass, mass.inertia, scene.point(mass.at)) for mass in scene.masses.values()]
    for body, mass, inertia, (x, y) in fixed:
        c, s, omega = (rigid[f"{body}.{name}"] for name in ("c", "s", "omega"))
        arm = c * x - s * y, s * x + c * y
        speed = rigid[f"{body}.v_x"] - omega * arm[1], rigid[f"{body}.v_y"] + omega * arm[0]
        height = -scene.gravity[0] * (rigid[f"{body}.x"] + arm[0]) - scene.gravity[1] * (rigid[f"{body}.y"] + arm[1])
        total += mass * (speed[0] ** 2 + speed[1] ** 2) / 2 + inertia * omega**2 / 2 + mass * height
    return total


def power_of_loads(scene: Scene, rigid: RigidMotion) -> np.ndarray:
    """What forces at fixed directions on starts of bodies do [W], (n_times,)."""
    total = np.zeros(len(rigid.times))
    for name, load in scene.forces.items():
        assert load.axes == "global" and scene.point(load.force_on) == (0.0, 0.0)
        body, (x, y) = load.force_on.body, load.direction
        total += rigid[name] * (x * rigid[f"{body}.v_x"] + y * rigid[f"{body}.v_y"])
    return total


def relative_speed(scene: Scene, rigid: RigidMotion, joint: str) -> np.ndarray:
    """Angular velocity of a joint's second body against the first [rad/s]."""
    first, second = (address.body for address in scene.joints[joint].addresses)
    return rigid[f"{second}.omega"] - (0.0 if first == "ground" else rigid[f"{first}.omega"])


@pytest.mark.parametrize(("name", "closure"), [("v-engine", 1e-6), ("quick-return", 1e-6), ("two-link-arm", 1e-8)])
def test_drives_do_the_work_that_energy_and_loads_take(name, closure):
    """Sum of drive torque times relative speed = d/dt energy - power of the loads, at every instant of a cycle."""
    found = model(name)
    scene, period = found.scene, found.scene.period
    steps = 7200
    rigid = found.motion.at(np.arange(steps) * period / steps)
    E, h = energy(scene, rigid), period / steps
    differences = (np.roll(E, -k) - np.roll(E, k) for k in (1, 2, 3))
    rate = sum(w * d for w, d in zip((45, -9, 1), differences, strict=True)) / (60 * h)
    spent = sum(rigid[f"{drive}.drive"] * relative_speed(scene, rigid, drive) for drive in scene.drives)
    assert np.abs(spent + power_of_loads(scene, rigid) - rate).max() < closure * np.abs(spent).max()


@pytest.mark.parametrize("name", [
    "v-engine", "quick-return", "four-bar", "engine", "engine-3", "engine-rig", "engine-elastic-crank",
])  # fmt: skip
def test_every_body_balances(name):
    found = model(name)
    (speed,) = {drive.speed for drive in found.scene.drives.values()}
    assert imbalance(found.scene, found.motion.at(np.radians(np.arange(720)) / speed)) < 1e-10


# ---- an engine whose speed follows its torques -------------------------------------------------------------------


def late_speed(*settings: str) -> float:
    """Mean speed [rad/s] of the three-cylinder engine over the last five cycles of a run."""
    solution = run("engine-torque", "solve.forward.tolerance=1e-7", *settings)
    angle, cycles = solution.rigid["main.angle"], 5 * 4 * np.pi
    return cycles / (solution.times[-1] - np.interp(angle[-1] - cycles, angle, solution.times))


def test_engine_settles_where_the_torques_balance():
    """M0 (1 - omega / omega0) and the gas torque cancel over a cycle: 10,880 rpm, from above and from below.

    The gas torque's mean comes from the engine at constant speed, where its drive must hold it.
    """
    gas = -model("engine-3").motion.at(np.linspace(0, 0.02, 1441))["main.drive"][:-1].mean()
    balance = 628.3 * (1 + gas / 170)
    assert balance * 30 / np.pi == pytest.approx(10880, rel=5e-3)
    run_for = ("solve.duration=1 s", "solve.steps=10000")
    below, above = (late_speed(f"main.initial_speed={start} rpm", *run_for) for start in (10820, 10940))
    assert below < balance < above
    assert (below, above) == pytest.approx((balance, balance), rel=1e-3)


def test_engine_without_gas_runs_at_the_idle_speed_of_its_motor():
    none = [f"loads.gas_{k}=none" for k in (1, 2, 3)]
    settings = ("main.initial_speed=640 rad/s", "solve.duration=1 s", "solve.steps=10000")
    assert late_speed(*none, *settings) == pytest.approx(628.3, rel=5e-3)


# ---- V engine ----------------------------------------------------------------------------------------------------


def test_cylinders_of_the_v_do_the_same_270_degrees_apart():
    """Cylinder 2 is cylinder 1 turned by -90 degrees, its gas with it: gas, damping and elastic rods included."""
    solution = run("v-engine")
    later = 3 * (len(solution.times) - 1) // 8
    for name in ("tip_axial", "mid_transverse", "slide"):
        first, second = (solution.series[f"{name}_{k}"].values[:-1] for k in (1, 2))
        assert np.abs(np.roll(first, later) - second).max() < 1e-7 * np.abs(first).max(), name
        assert np.abs(np.roll(first, later + 1) - second).max() > 1e-4 * np.abs(first).max(), name


def test_stroke_of_the_v_is_twice_the_crank():
    for k in (1, 2):
        slide = run("v-engine", "solve.preset=rigid").series[f"slide_{k}"].values
        assert (slide.min(), slide.max()) == pytest.approx((0.137 - 0.040, 0.137 + 0.040), abs=1e-12)


def test_counterweight_of_the_v_balances_the_first_order():
    """What shakes the engine, gas taken off, has no first order: a 90 degree V can have that.

    The second order is left, m r omega^2 (lambda + lambda^3 / 4 + ...) cos 2 (theta -+ 45 deg) along each bore, so that
    the components along x cancel and those along y add up.
    """
    solution = run("v-engine", "solve.preset=rigid")
    speed, half = solution.model.scene.drives["main"].speed, len(solution.times) // 2
    order = {}
    for axis, side in (("x", 1.0), ("y", -1.0)):  # the second bore points to -y
        held = sum(solution.series[f"{name}_{axis}"].values for name in ("bearing", "wall_1", "wall_2"))
        held = held - 0.5**0.5 * (solution.rigid["gas_1"] + side * solution.rigid["gas_2"])
        order[axis] = 2 * np.abs(np.fft.rfft(held[:half])) / half
    reciprocating = (0.214 + 0.153 / 2) * 0.040 * speed**2
    assert order["x"][1] < 1e-10 * reciprocating and order["y"][1] < 1e-10 * reciprocating
    assert order["x"][2] < 1e-10 * reciprocating
    ratio = 0.040 / 0.137
    second = ratio + ratio**3 / 4 + 15 * ratio**5 / 128
    assert order["y"][2] == pytest.approx(2**0.5 * reciprocating * second, rel=1e-3)


# ---- crank shaper ------------------------------------------------------------------------------------------------


def test_way_back_of_the_shaper_takes_half_the_time():
    """r / d = 1 / 2: the lever swings by 30 degrees each way, the ram by L, and 240 degrees of crank cut."""
    found = model("quick-return")
    angle = np.radians(np.arange(36001) / 100)
    rigid = found.motion.at(angle / found.scene.drives["main"].speed)
    x = rigid["ram.x"]
    assert np.ptp(x) == pytest.approx(2 * 0.5 * 0.1 / 0.2, rel=1e-7)
    lever = np.degrees(np.arctan2(rigid["lever.s"], rigid["lever.c"]))
    assert (lever.min(), lever.max()) == pytest.approx((60, 120), abs=1e-5)
    cutting = (rigid["ram.v_x"] < 0).mean()
    assert cutting / (1 - cutting) == pytest.approx(2, rel=1e-3)
    assert np.degrees(angle[x.argmin()]) == pytest.approx(210, abs=0.02)
    assert np.degrees(angle[x.argmax()]) == pytest.approx(330, abs=0.02)


def test_lever_moves_as_the_block_tells_it():
    """tan of the lever's angle = (d + r sin theta) / (r cos theta), and its speed by hand."""
    found = model("quick-return")
    speed, r, d = found.scene.drives["main"].speed, 0.1, 0.2
    angle = np.radians(np.arange(360))
    rigid = found.motion.at(angle / speed)
    reach = r**2 + d**2 + 2 * r * d * np.sin(angle)
    assert rigid["lever.c"] == pytest.approx(r * np.cos(angle) / np.sqrt(reach), abs=1e-13)
    assert rigid["lever.omega"] == pytest.approx(speed * (r**2 + r * d * np.sin(angle)) / reach, abs=1e-11 * speed)


# ---- two-link arm ------------------------------------------------------------------------------------------------


def test_torques_of_the_arm_are_those_of_the_robotics_books():
    """Inverse dynamics of a planar two-link arm in joint angles (Craig 1986, chapter 6; with bars and a load)."""
    solution = run("two-link-arm", "solve.preset=rigid")
    scene, t = solution.model.scene, solution.times
    m, (l_1, l_2), M, g = scene.bodies["upper"].rho_A, (0.6, 0.5), 1.0, 9.81
    w = 2 * np.pi
    q = np.array([0.8 - 0.6 * np.cos(w * t), -0.9 + 0.7 * np.cos(w * t) + 0.2 * np.sin(2 * w * t)])
    v = w * np.array([0.6 * np.sin(w * t), -0.7 * np.sin(w * t) + 0.4 * np.cos(2 * w * t)])
    a = w**2 * np.array([0.6 * np.cos(w * t), -0.7 * np.cos(w * t) - 0.8 * np.sin(2 * w * t)])
    m_1, m_2 = m * l_1, m * l_2
    b = (m_2 / 2 + M) * l_1 * l_2 * np.cos(q[1])
    h = (m_2 / 2 + M) * l_1 * l_2 * np.sin(q[1])
    J_2 = (m_2 / 3 + M) * l_2**2
    J_1 = m_1 * l_1**2 / 3 + (m_2 + M) * l_1**2
    pull_2 = (m_2 / 2 + M) * g * l_2 * np.cos(q[0] + q[1])
    pull_1 = (m_1 / 2 + m_2 + M) * g * l_1 * np.cos(q[0])
    shoulder = (J_1 + J_2 + 2 * b) * a[0] + (J_2 + b) * a[1] - h * (2 * v[0] + v[1]) * v[1] + pull_1 + pull_2
    elbow = (J_2 + b) * a[0] + J_2 * a[1] + h * v[0] ** 2 + pull_2
    for name, torque in (("shoulder", shoulder), ("elbow", elbow)):
        found = solution.series[f"{name}_torque"].values
        assert np.abs(found - torque).max() < 1e-11 * np.abs(torque).max(), name


def test_moment_at_the_root_of_the_elastic_arm_is_the_torque_of_its_drive():
    """The drive's torque comes from the balance of the joint, the moment from the beam's curvature."""
    series = {name: found.values for name, found in run("two-link-arm").series.items()}
    assert series["root_moment"] == pytest.approx(-series["shoulder_torque"], abs=1e-6 * np.ptp(series["root_moment"]))
    difference = series["shoulder_torque"] - series["shoulder_torque_rigid"]
    assert 0.01 < np.ptp(difference) / np.ptp(series["shoulder_torque"]) < 0.2


# ---- contacts ----------------------------------------------------------------------------------------------------


def test_bar_comes_down_as_a_rod_does_and_ends_on_its_stop():
    """Rigid, it turns about its hinge with omega^2 = 3 g/l sin(10 deg) when it is level, where it touches."""
    found = run("bouncing-bar")
    assert found.impacts[0].approach == pytest.approx(np.sqrt(3 * 9.81 * 0.5 * np.sin(np.deg2rad(10))), rel=5e-4)
    assert found.trajectory.energy.drift < 1e-6
    assert found.impacts[-1].lasts and found.impacts[-1].begin < 0.5
    assert abs(found.series["tip"].values[-1]) < 1e-5  # at the height of the stop, but for its depth


def test_loose_pin_knocks_less_hard_on_an_elastic_rod():
    elastic = run("slider-crank-clearance")
    rigid = run("slider-crank-clearance", "rod.beam=none", "rod.mass=0.06782", "sensors.rod_moment=none")
    peaks = [max(impact.peak for impact in found.impacts) for found in (elastic, rigid)]
    assert peaks[0] < 0.6 * peaks[1]
    assert max(found.trajectory.energy.drift for found in (elastic, rigid)) < 1e-8
    turn = 3000 * 2 * np.pi / 60 * elastic.times
    tight = 0.05 * np.cos(turn) + np.sqrt(0.12**2 - (0.05 * np.sin(turn)) ** 2)
    assert abs(elastic.series["slide"].values - tight).max() < 3e-4
