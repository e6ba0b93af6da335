"""Preset coupled in space as a state space: blades, tops and loops in closed form, planar ones lifted and turned."""

import math

import numpy as np
import pytest
from lifting import lifted
from scipy.spatial.transform import Rotation

import kaneflex
from kaneflex import SceneError, modes, read_scene, scene_of, with_settings
from kaneflex.mechanism.spatial_frame import rotation_rates
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.time import linearisation
from kaneflex.multibody.time.linearisation import Equations, spin_of
from kaneflex.solve.coupled_linearisation import linear_about

SHORT = "\nsolve.preset = \"coupled\"\nsolve.duration = \"1 ms\"\nsolve.steps = 2\nsolve.modes = {}\n"


def _space(text, t=0.0):
    return kaneflex.linearise(kaneflex.load(scene_of(text)), t=t)


BLADE = """
schema = 1
gravity = [0, 0, 0]
bodies.blade.length = "1 m"
bodies.blade.beam = {{E = 70e9, nu = 0.33, rho = 2700, section = {{rectangle = ["1 mm", "1 mm"]}}, elements = 12}}
joints.shaft = {{revolute = ["ground", "blade.start"], axis = [0, 0, 1]}}
drives.shaft = {{speed = {speed}}}
"""


def test_a_blade_lags_and_flaps():
    """Of every pair of modes lag^2 = flap^2 - omega^2, and the first flap is the one of Wright et al. 1982 (eta = 2 to
    12, no hub): 4.1373, 7.3604 and 13.170 times sqrt(E I / (rho A L^4)). What lags stretches by Coriolis' force, which
    is 5e-7 of so slender a blade."""
    unit = math.sqrt(70e9 / 2700.0) * 1e-3 / math.sqrt(12.0)
    for eta, expected in ((2.0, 4.1373), (6.0, 7.3604), (12.0, 13.170)):
        omega = eta * unit
        poles = _space(BLADE.format(speed=omega) + SHORT.format(6)).poles
        lag, flap = poles[:6:2].imag, poles[1:6:2].imag
        assert flap[0] / unit == pytest.approx(expected, rel=5e-4), eta
        assert lag**2 == pytest.approx(flap**2 - omega**2, rel=1e-6, abs=5e-7 * flap[-1] ** 2), eta
        assert abs(poles[:6].real).max() < 1e-8 * omega


def test_flap_and_lag_are_near_those_of_the_stiffened_blade():
    """A strip on a hub, five turns a second: the one-way equations know its tension by K_g alone."""
    settings = ["damping=none", "push.value=1e-6", "solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    scene = with_settings(read_scene("rotating-blade"), settings)
    model = kaneflex.load(scene)
    stiff, damping, M = (model.K_s(0.0) + model.K_d(0.0) + model.K_g(0.0), model.C(0.0), model.M(0.0))
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, stiff), -np.linalg.solve(M, damping)]])
    expected = np.sort(np.linalg.eigvals(A).imag)[n : n + 4]
    coupled = kaneflex.linearise(kaneflex.load(with_settings(scene, ["solve.preset=coupled", "solve.modes=6"])))
    assert coupled.poles[:4].imag == pytest.approx(expected, rel=3e-4)


def test_a_planar_blade_lifted_and_turned_answers_as_it_does_in_the_plane():
    """Its poles are among those of space, and every sensor answers a force and the shaft's acceleration alike."""
    settings = ["solve.preset=coupled", "solve.modes=4", "solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    flat = with_settings(read_scene("rotating-cantilever"), settings)
    deep = scene_of(lifted(flat) | {"solve": flat.raw["solve"]})
    plane, space = (kaneflex.linearise(kaneflex.load(scene), t=0.7e-3) for scene in (flat, deep))
    for pole in plane.poles[:5]:
        assert abs(space.poles - pole).min() < 1e-6 * abs(pole)
    assert plane.inputs == space.inputs and plane.outputs == space.outputs
    for hertz in (0.0, 12.0):
        expected, found = (system.frequency_response([hertz])[0] for system in (plane, space))
        assert (abs(found - expected) <= 1e-5 * abs(expected).max(axis=1, keepdims=True)).all(), hertz


TOP = """
schema = 1
gravity = [0, 0, "-9.81 m/s^2"]
bodies.shaft.length = "{length} m"
bodies.shaft.rotation = {{x = [0, 0, 1]}}
bodies.shaft.beam = {{E = "1e15 Pa", nu = 0.3, rho = "100 kg/m^3", section = {{circle = "10 mm"}}, elements = 2}}
masses.disc = {{at = "shaft.end", mass = {mass}, inertia = [{polar}, {across}, {across}]}}
joints.tip = {{spherical = ["ground", "shaft.start"]}}
drives.tip = {{free = true, angular_velocity = [{speed}, 0, 0]}}
"""
WHEEL = {"length": 0.06, "mass": 0.5, "polar": 4e-4, "across": 2e-4}


@pytest.mark.parametrize("share", [0.999, 1.001, 3.0])
def test_a_sleeping_top_stands_up_to_its_limit(share):
    """Above J^2 omega^2 = 4 I m g l it precesses and nutates at the roots of I s^2 - J omega s + m g l = 0 (Goldstein,
    Classical Mechanics, 1980, sec. 5-7), in axes that turn with it by omega less; below, it falls over."""
    length, shaft = WHEEL["length"], 100.0 * math.pi * 0.005**2 * WHEEL["length"]
    J = WHEEL["polar"] + shaft * 0.005**2 / 2
    I = WHEEL["across"] + WHEEL["mass"] * length**2 + shaft * length**2 / 3
    tipping = (WHEEL["mass"] + shaft / 2) * 9.81 * length
    omega = share * math.sqrt(4.0 * I * tipping) / J
    found = _space(TOP.format(speed=omega, **WHEEL) + SHORT.format(1))
    assert found.states[:3] == ("tip.turn_x", "tip.turn_y", "tip.turn_z")
    roots = np.roots([I, -J * omega, tipping]) - omega
    slow = np.linalg.eigvals(found.A)
    slow = slow[abs(slow) < 2.0 * omega]
    for root in roots:
        assert abs(slow - 1j * root).min() < 2e-6 * omega
    assert (slow.real.max() > 1e-3 * omega) == (share < 1.0)


FREE = """
schema = 1
gravity = [0, 0, 0]
bodies.bar.length = "0.2 m"
bodies.bar.rotation = {{x = [{axis}]}}
bodies.bar.free = {{at = [0, 0, 0], angular_velocity = [0, 0, 9]}}
bodies.bar.beam = {{E = "1e15 Pa", nu = 0.3, rho = "100 kg/m^3", section = {{circle = "10 mm"}}, elements = 2}}
masses.plate = {{at = "bar.mid", mass = 2, inertia = [0.02, 0.05, 0.04]}}
"""


@pytest.mark.parametrize(("axis", "spun"), [("0, 0, 1", 0), ("1, 0, 0", 2)])
def test_a_free_body_keeps_turning_about_its_outer_axes_alone(axis, spun):
    """Euler's equations about a spin omega around axis 1: s^2 = (J_2 - J_1) (J_1 - J_3) / (J_2 J_3) omega^2, which is
    positive where J_1 lies between the others."""
    found = _space(FREE.format(axis=axis) + SHORT.format(1))
    bar = 100.0 * math.pi * 0.005**2 * 0.2
    own = np.array([0.005**2 / 2, 0.2**2 / 12, 0.2**2 / 12])
    J = np.roll([0.02, 0.05, 0.04] + bar * own, -spun)
    square = (J[1] - J[0]) * (J[0] - J[2]) / (J[1] * J[2]) * 81.0
    poles = np.linalg.eigvals(found.A)
    for root in (np.sqrt(complex(square)), -np.sqrt(complex(square)), 9j):
        assert abs(poles - root).min() < 1e-5 * 9.0
    assert (square > 0.0) == (spun == 2)
    assert found.states[:6] == ("bar.x", "bar.y", "bar.z", "bar.turn_x", "bar.turn_y", "bar.turn_z")


def test_linear_equations_take_the_forces_of_neighbours_and_not_their_accelerations(monkeypatch):
    """The step of the differences then leaves no error, though light shapes accelerate most; no mass matrix is
    solved."""
    model = kaneflex.load(scene_of(BLADE.format(speed=3.0) + SHORT.format(6)))
    expected = linear_about(model, 0.0).K
    monkeypatch.setattr(linearisation, "STEP", 1e-3)
    monkeypatch.delattr(SpatialSystem, "near")
    assert linear_about(model, 0.0).K == pytest.approx(expected, abs=1e-9 * abs(expected).max())


HELD = """
schema = 1
gravity = [0, 0, "-9.81 m/s^2"]
ground = {below = ["0.4 m", 0, "-0.5 m"], beside = ["0.7 m", "0.3 m", "0.1 m"]}
bodies.bar.length = "1 m"
bodies.bar.beam = {E = "1e17 Pa", nu = 0.3, rho = "3000 kg/m^3", section = {circle = "10 mm"}, elements = 2}
bodies.bar.free = {at = [0, 0, 0]}
springs.mount = {bushing = ["ground", "bar.start"], stiffness = ["2e4 N/m", "3e4 N/m", "5e4 N/m", 40, 150, 90]}
springs.strut = {between = ["ground.below", "bar.end"], stiffness = "700 N/m", length = "0.2 m", damping = "3 N s/m"}
springs.band = {between = ["ground.beside", "bar.end"], stiffness = "400 N/m"}
"""


def test_springs_hold_modes_at_rest_by_their_stiffness_alone():
    """A stiff bar on a bushing: six frequencies of its mass matrix about its start, with k along the strut and of the
    band in all directions; neither weight nor tension."""
    found = modes(scene_of(HELD + SHORT.format(1)), 6)
    area = math.pi * 0.005**2
    m, polar = 3000 * area, 3000 * math.pi * 0.005**4 / 2
    M = np.diag([m, m, m, polar, m / 3, m / 3])
    M[1, 5] = M[5, 1] = m / 2
    M[2, 4] = M[4, 2] = -m / 2
    end = np.hstack([np.eye(3), [[0, 0, 0], [0, 0, 1], [0, -1, 0]]])  # v + omega x (1, 0, 0)
    strut = np.array([1.0, 0.0, 0.0]) - [0.4, 0.0, -0.5]
    along = end.T @ strut / np.linalg.norm(strut)
    K = np.diag([2e4, 3e4, 5e4, 40, 150, 90]) + 700 * np.outer(along, along) + 400 * end.T @ end
    expected = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)) / (2.0 * math.pi)
    assert found.frequencies == pytest.approx(expected, rel=2e-5)
    assert found.coordinates[:6] == ("bar.x", "bar.y", "bar.z", "bar.turn_x", "bar.turn_y", "bar.turn_z")


def test_a_bushing_that_is_turned_holds_by_the_rates_of_its_rotation_vector():
    phi, omega, h = np.array([0.7, -0.4, 1.1]), np.array([0.2, 0.5, -0.3]), 1e-6
    moved = [(Rotation.from_rotvec(s * h * omega) * Rotation.from_rotvec(phi)).as_rotvec() for s in (1.0, -1.0)]
    assert omega @ rotation_rates(phi) == pytest.approx((moved[0] - moved[1]) / (2.0 * h), abs=1e-9)


def test_a_cantilever_has_the_modes_of_its_beam():
    """Euler and Bernoulli's clamped-free roots in both planes: 1.8751, 4.6941, 7.8548."""
    text = BLADE.format(speed=0.0).replace('"1 mm", "1 mm"', '"10 mm", "6 mm"')
    text = text.replace("revolute", "weld").replace(", axis = [0, 0, 1]", "").partition("drives.")[0]
    found = modes(scene_of(text + SHORT.format(5)), 5).frequencies
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382]) ** 2
    units = math.sqrt(70e9 / 2700.0 / 12.0) * np.array([[6e-3], [10e-3]]) / (2.0 * math.pi)
    assert found == pytest.approx(np.sort((units * roots).ravel())[:5], rel=1e-3)


def test_a_steady_deformation_is_a_motion_that_the_equations_allow():
    settings = ["solve.preset=coupled", "solve.modes=3", "solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    model = kaneflex.load(with_settings(read_scene("rotating-blade"), settings))
    state = linear_about(model, 5e-4).instant
    shapes = model.motion.module.system.engine.modal[1]
    unbalanced = model.motion.undeformed(5e-4).du[shapes]
    assert not state.u[shapes].any() and abs(state.du[shapes]).max() < 1e-8 * abs(unbalanced).max()


def test_where_free_joints_go_is_not_known_beyond_the_run():
    with pytest.raises(SceneError, match=r"t = 0.1: the motion of tip is computed from 0 to 0\.001 s"):
        _space(TOP.format(speed=1, **WHEEL) + SHORT.format(1), t=0.1)


def test_one_way_equations_in_space_are_not_linearised():
    settings = ["solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    with pytest.raises(SceneError, match="in space only preset coupled can be linearised"):
        kaneflex.linearise(kaneflex.load(with_settings(read_scene("rotating-blade"), settings)))


ARM_ON_A_GUIDE = """
schema = 1
gravity = [0, 0, -9.81]
ground = {rail = [0.6, 0, -1.5]}
joints.shoulder = {spherical = ["ground", "upper.start"]}
joints.elbow = {revolute = ["upper.end", "lower.start"], axis = [0, 0.6, 0.8]}
joints.hand = {spherical = ["lower.end", "block"]}
joints.guide = {prismatic = ["ground.rail", "block"], direction = [0, 1, 0.2]}
drives.shoulder.free = true
drives.elbow.free = true
solve = {preset = "coupled", duration = "1 ms", steps = 2}
[bodies]
upper = {length = "1 m", mass = "2 kg", inertia = [0.01, 0.17, 0.17], rotation = {axis = [0, 1, 0], angle = "80 deg"}}
lower = {length = "0.9 m", mass = "1 kg", inertia = [0.01, 0.07, 0.07], rotation = {axis = [0, 1, 0], angle = "50 deg"}}
block = {mass = "0.5 kg", inertia = [0.01, 0.01, 0.01]}
"""


def test_the_speeds_of_a_closed_loop_change_with_its_place():
    """W' = omega' x N + omega x N' of a mechanism some of whose ball's speeds depend on others; N' is the change of N
    from a little before to a little after."""
    system = kaneflex.load(scene_of(ARM_ON_A_GUIDE)).motion.module.system
    start = start_of(system)
    which = start.choice.independent
    u = start.u.copy()
    u[which] = np.linspace(1.5, -1.0, len(which))
    base, equations, h = system.project(0.0, start.q, u, start.choice), Equations(system, start.choice), 1e-4
    found = equations.turning(base, equations.derivatives(base, range(len(which)))[1][len(which) :])
    N = equations.spinning(base)[1]
    places = system.engine.advanced(base.q, np.array([h, -h])[:, None] * base.u)
    near = [system.engine.basis(system.project(0.0, q, base.u, base.choice).choice).copy() for q in places]
    growth = (near[0] - near[1]).T / (2 * h)
    expected = (spin_of(system.engine, base.du) @ N.T + spin_of(system.engine, base.u) @ growth)[which]
    assert 0 < sum(name.startswith("shoulder.") for name in equations.names) < 3
    assert abs(spin_of(system.engine, base.u) @ growth)[which].max() > 0.1
    np.testing.assert_allclose(found, expected, atol=1e-5 * abs(expected).max())
