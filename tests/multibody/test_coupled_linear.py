"""Preset coupled as a state space, planar and in space: beside one-way equations, closed forms, and lifted."""

import json
import math

import numpy as np
import pytest
from command_line import cli
from lifting import lifted
from machines import cantilever, machine, pendulum, slider_crank
from scipy.spatial.transform import Rotation

import kaneflex
from kaneflex import SceneError, modes, read_scene, scene_of, with_settings
from kaneflex.mechanism.spatial_frame import rotation_rates
from kaneflex.multibody.model.initial_state import start_of
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time import linearisation
from kaneflex.multibody.time.linearisation import Equations, spin_of
from kaneflex.solve.coupled import undeformed
from kaneflex.solve.coupled_linearisation import linear_about, modes_at_rest


def system(name, *settings):
    return kaneflex.linearise(kaneflex.load(with_settings(read_scene(name), list(settings))))


def response(space, hertz):
    """Outputs by inputs of a harmonic excitation, (n_outputs, n_inputs)."""
    s = 2j * np.pi * hertz
    return space.C @ np.linalg.solve(s * np.eye(len(space.A)) - space.A, space.B) + space.D


def test_a_linkage_that_hardly_moves_answers_as_the_one_way_equations_say():
    """Every sensor to every input, statically and at 3 Hz; both with five modes a link, so that 1e-3 is left."""
    settings = ("solve.modes=5", "main.speed=0.001 rpm", "solve.mode_angle=40 deg")
    one_way, coupled = (system("four-bar", f"solve.preset={preset}", *settings) for preset in ("stiffened", "coupled"))
    assert coupled.inputs == one_way.inputs and coupled.outputs == one_way.outputs
    for hertz in (0.0, 3.0):
        there, here = response(one_way, hertz), response(coupled, hertz)
        assert (abs(here - there) <= 1e-3 * abs(there).max(axis=1, keepdims=True)).all(), hertz
    assert abs(coupled.poles[:2]) == pytest.approx(abs(one_way.poles[:2]), rel=1e-4)


def test_forces_and_moments_of_its_inputs_are_exact():
    """A tip force of 1 N: moment L at the root. An acceleration of 1 rad/s^2: torque rho A L^3 / 3."""
    found = system("rotating-cantilever", "solve.preset=coupled", "push.value=1e-6", "shaft.speed=1")
    still = found.D - found.C @ np.linalg.solve(found.A, found.B)
    read = {name: dict(zip(found.inputs, row, strict=True)) for name, row in zip(found.outputs, still, strict=True)}
    assert read["root_moment"]["push"] == pytest.approx(1.0, rel=1e-6)
    assert read["shaft_torque"]["push"] == pytest.approx(-1.0, rel=1e-6)
    assert read["shaft_torque"]["shaft.acceleration"] == pytest.approx(0.081, rel=1e-6)
    assert read["root_moment"]["shaft.acceleration"] == pytest.approx(-0.081, rel=1e-6)


def test_a_steady_motion_has_no_input_that_its_equations_lack():
    """The one-way module of a blade at constant speed has no terms in epsilon: no such column, rather than zeros."""
    assert system("rotating-cantilever").inputs == ("push",)
    assert "main.acceleration" in system("four-bar").inputs


def test_a_free_drive_adds_its_coordinate():
    """A torque on the crank first meets the inertia of crank and flywheel, and of the coupler's nearer share."""
    found = system("four-bar-motor")
    assert "motor" in found.inputs and "main.acceleration" not in found.inputs
    row = found.states.index("main.angle'")
    crank = 2e-3 + 0.0316 * 0.108**2 / 3
    coupler = 2714 * 40.645e-6 * 0.2794 * 0.108**2
    assert crank < 1 / found.B[row, 0] < crank + coupler
    speed = response(found, 200.0)[found.outputs.index("crank_speed"), 0]
    assert abs(speed) == pytest.approx(found.B[row, 0] / (2 * np.pi * 200), rel=0.2)


def test_modes_of_a_free_mechanism_begin_at_zero():
    found = cli("modes", "spin-up-torque", "--json")
    data = json.loads(found.stdout)
    assert found.exit_code == 0
    assert data["frequencies_hz"][0] == pytest.approx(0.0, abs=1e-6)
    assert data["frequencies_hz"][1] > 0.1
    assert len(data["coordinates"]) == len(data["mode_shapes"]) and "beam.transverse_0" in data["coordinates"]


CRANK, ROD, SLIDER = 0.1, 0.31, 0.45
"""Lengths of a crank of 0.2 kg and a rod of 0.3 kg [m], and a slider's mass [kg]."""
RIGID = f'E = "1e15 Pa", rho = "3000 kg/m^3", A = "{0.3 / 3000 / ROD!r} m^2"'
RODS = {
    False: f'beam = {{{RIGID}, I = "1e4 mm^4", elements = 4}}',
    True: f'rotation = {{x = [0.97, -0.25, 0]}}, beam = {{{RIGID}, nu = 0.3, I_y = "1e4 mm^4", I_z = "1e4 mm^4", '
    'J = "2e4 mm^4", theory = "euler-bernoulli", elements = 2}',
}


def turned_engine(deep):
    """A slider-crank as good as rigid, from 50 deg at 20 rad/s under T = 3 - 0.05 phi', in the plane or in space."""
    return slider_crank(
        f'length = "{CRANK} m", mass = "0.2 kg"', f'length = "{ROD} m", {RODS[deep]}',
        f'mass = "{SLIDER} kg"' + ", inertia = [1e-4, 1e-4, 1e-4]" * deep,
        'free = true, angle = "50 deg", initial_speed = "20 rad/s"', "slider", "guide",
        wrist="spherical" if deep else "revolute", deep=deep, gravity=[0.0] * (3 if deep else 2),
        loads='motor = {torque_at = "main", law = "3 - 0.05*main_speed"}',
        sensors="""
place = {position = "slider.start", component = "x"}
speed = {velocity = "slider.start", component = "x"}""",
        solve={"preset": "coupled", "duration": "1 ms", "steps": 2, "modes": 1},
    )  # fmt: skip


def inertia(angle):
    """Of all bodies at the crank, angle = 0 where it points along the guide; of a complex angle, too."""
    s = CRANK / ROD * np.sin(angle)
    turn = -CRANK / ROD * np.cos(angle) / np.sqrt(1 - s * s)  # of the rod, whose inclination has the sine -s
    slider = -CRANK * np.sin(angle) + ROD * s * turn
    x, y = -CRANK * np.sin(angle) + ROD / 2 * s * turn, CRANK * np.cos(angle) / 2
    return 0.2 * CRANK**2 / 3 + 0.3 * (x * x + y * y + ROD**2 / 12 * turn * turn) + SLIDER * slider * slider


@pytest.mark.parametrize(("deep", "rel", "still"), [(False, 1e-8, 1e-12), (True, 1e-7, 1e-10)], ids=["plane", "space"])
def test_a_loop_turns_its_inertia(deep, rel, still):
    """J(phi) phi'' + J' phi'^2 / 2 = T: M, C and K are its derivatives at the acceleration that the torque leaves,
    outputs those of the slider; ``still``: what may be left of a derivative that is none."""
    found = kaneflex.linearise(kaneflex.load(scene_of(turned_engine(deep))), t=0.0)
    angle, omega, step = np.radians(50), 20.0, 1e-4
    J, first = inertia(angle), inertia(angle + 1e-30j).imag / 1e-30
    second = (inertia(angle + step + 1e-30j) - inertia(angle - step + 1e-30j)).imag / 1e-30 / (2 * step)
    acceleration = (3.0 - 0.05 * omega - first * omega**2 / 2) / J
    assert found.states[0] == "main.angle" and found.inputs == ("motor",)
    assert found.M[0, 0] == pytest.approx(J, rel=rel)
    assert found.C_damping[0, 0] == pytest.approx(first * omega + 0.05, rel=rel)
    assert found.K[0, 0] == pytest.approx(first * acceleration + second * omega**2 / 2, rel=100 * rel)
    gear = dict(zip(found.outputs, found.C, strict=True))
    n, s = len(found.M), CRANK / ROD * np.sin(angle)
    rate = -CRANK * np.sin(angle) - ROD * s * CRANK / ROD * np.cos(angle) / np.sqrt(1 - s * s)
    assert gear["place"][0] == pytest.approx(rate, rel=0.1 * rel)
    assert gear["place"][n:] == pytest.approx(0.0, abs=still)
    assert gear["speed"][n] == pytest.approx(rate, rel=0.1 * rel)


HELD = pendulum(
    'length = "1 m", beam = {E = "1e15 Pa", rho = "3000 kg/m^3", A = "100 mm^2", I = "1e4 mm^4", elements = 4}',
    'free = true, angle = "20 deg"',
    ground={"below": ["0.4 m", "-0.5 m"], "beside": ["0.7 m", "0.3 m"]},
    springs="""
strut = {between = ["ground.below", "bar.end"], stiffness = "700 N/m", length = "0.2 m", damping = "3 N s/m"}
band = {between = ["ground.beside", "bar.end"], stiffness = "400 N/m"}
coil = {torsional_at = "hinge", stiffness = "90 N m/rad", angle = "1 rad"}""",
    solve={"preset": "coupled", "modes": 1, "duration": "0.1 s", "steps": 100},
)


def test_springs_hold_modes_at_rest_by_their_stiffness_alone():
    """k along the strut, k L^2 of the band, which pulls by its vector, and the coil's; no tension, which all have."""
    names, omega, _ = modes_at_rest(kaneflex.load(scene_of(HELD)))
    end = np.array([np.cos(np.radians(20)), np.sin(np.radians(20))])
    strut, across = end - [0.4, -0.5], np.array([-end[1], end[0]])
    stiffness = 700.0 * (strut @ across) ** 2 / (strut @ strut) + 400.0 + 90.0
    assert names[0] == "hinge.angle"
    assert omega[0] == pytest.approx(np.sqrt(stiffness / (0.3 / 3)), rel=1e-6)


def test_a_steady_deformation_is_a_motion_that_the_equations_allow():
    """Shapes at rest are not accelerated there, by another way through the equations than the balance was found."""
    model = kaneflex.load(read_scene("slider-crank-150-coupled"))
    found, engine = linear_about(model, 7e-3), model.coupled.engine
    still, free = found.instant, found.instant.choice.independent
    a = model.coupled.project(7e-3, still.q, still.u, still.choice).du
    assert engine.shapes[free].all() and not still.u[free].any()
    assert abs(a[engine.shapes]).max() < 1e-9 * abs(np.linalg.solve(found.M, found.K @ still.q[free])).max()


def test_displacements_do_not_depend_on_rates():
    """Not even on those of the drive, which the undeformed mechanism beside them follows."""
    found = kaneflex.linearise(kaneflex.load(read_scene("slider-crank-150-coupled")), t=7e-3)
    n, rows = len(found.M), [k for k, unit in enumerate(found.output_units) if unit == "m"]
    assert rows and (abs(found.C[rows, n:]) <= 1e-12 * abs(found.C[rows]).max(axis=1, keepdims=True)).all()


SHORT = "\nsolve.preset = \"coupled\"\nsolve.duration = \"1 ms\"\nsolve.steps = 2\nsolve.modes = {}\n"


def _space(text, t=0.0):
    return kaneflex.linearise(kaneflex.load(scene_of(text)), t=t)


SLENDER = 'beam = {E = 70e9, nu = 0.33, rho = 2700, section = {rectangle = ["1 mm", "1 mm"]}, elements = 12}'


def blade(speed):
    inside = f'length = "1 m", {SLENDER}'
    return pendulum(inside, f"speed = {speed}", "blade", "shaft", deep=True, gravity=[0, 0, 0])


def test_a_blade_lags_and_flaps():
    """Of every pair of modes lag^2 = flap^2 - omega^2, and the first flap is the one of Wright et al. 1982 (eta = 2 to
    12, no hub): 4.1373, 7.3604 and 13.170 times sqrt(E I / (rho A L^4)). What lags stretches by Coriolis' force, which
    is 5e-7 of so slender a blade."""
    unit = math.sqrt(70e9 / 2700.0) * 1e-3 / math.sqrt(12.0)
    for eta, expected in ((2.0, 4.1373), (6.0, 7.3604), (12.0, 13.170)):
        omega = eta * unit
        poles = _space(blade(omega) + SHORT.format(6)).poles
        lag, flap = poles[:6:2].imag, poles[1:6:2].imag
        assert flap[0] / unit == pytest.approx(expected, rel=5e-4), eta
        assert lag**2 == pytest.approx(flap**2 - omega**2, rel=1e-6, abs=5e-7 * flap[-1] ** 2), eta
        assert abs(poles[:6].real).max() < 1e-8 * omega


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


STIFF = 'beam = {E = "1e15 Pa", nu = 0.3, rho = "100 kg/m^3", section = {circle = "10 mm"}, elements = 2}'
TOP = machine(
    gravity=[0, 0, "-9.81 m/s^2"], bodies=dict(shaft=f"length = 0.06, rotation = {{x = [0, 0, 1]}}, {STIFF}"),
    masses=dict(disc='at = "shaft.end", mass = 0.5, inertia = [4e-4, 2e-4, 2e-4]'),
    joints=dict(tip="spherical ground shaft"), drives=dict(tip="free = true, angular_velocity = [SPEED, 0, 0]"),
)
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
    found = _space(TOP.replace("SPEED", str(omega)) + SHORT.format(1))
    assert found.states[:3] == ("tip.turn_x", "tip.turn_y", "tip.turn_z")
    roots = np.roots([I, -J * omega, tipping]) - omega
    slow = np.linalg.eigvals(found.A)
    slow = slow[abs(slow) < 2.0 * omega]
    for root in roots:
        assert abs(slow - 1j * root).min() < 2e-6 * omega
    assert (slow.real.max() > 1e-3 * omega) == (share < 1.0)


def test_the_stiffness_of_a_pendulum_at_an_angle_is_that_of_its_weight():
    """d(m g s cos(phi))/dphi = -m g s sin(phi): to the rounding of the differences, not to the square of their step."""
    bar = 'mass = "2 kg", inertia = "0.05 kg m^2", centre = [0.3, 0]'
    solve = {"preset": "coupled", "duration": "1 s"}
    text = pendulum(bar, 'free = true, angle = "40 deg"', gravity=[0, -9.81], solve=solve)
    K = linear_about(kaneflex.load(scene_of(text)), 0.0).K
    assert K.item() == pytest.approx(-2 * 9.81 * 0.3 * math.sin(math.radians(40)), rel=1e-10)


def test_linear_equations_take_the_forces_of_neighbours_and_not_their_accelerations(monkeypatch):
    """The step of the differences then leaves no error, though light shapes accelerate most; no mass matrix is
    solved."""
    model = kaneflex.load(scene_of(blade(3.0) + SHORT.format(6)))
    expected = linear_about(model, 0.0).K
    monkeypatch.setattr(linearisation, "STEP", 1e-3)
    monkeypatch.delattr(System, "unfold")
    assert linear_about(model, 0.0).K == pytest.approx(expected, abs=1e-9 * abs(expected).max())


MOUNTED = """
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


def test_springs_hold_modes_at_rest_by_their_stiffness_alone_in_space():
    """A stiff bar on a bushing: six frequencies of its mass matrix about its start, with k along the strut and of the
    band in all directions; neither weight nor tension."""
    found = modes(scene_of(MOUNTED + SHORT.format(1)), 6)
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
    beam = SLENDER.replace('"1 mm", "1 mm"', '"10 mm", "6 mm"')
    text = cantilever(f'length = "1 m", {beam}', "blade", "shaft", gravity=[0, 0, 0])
    found = modes(scene_of(text + SHORT.format(5)), 5).frequencies
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382]) ** 2
    units = math.sqrt(70e9 / 2700.0 / 12.0) * np.array([[6e-3], [10e-3]]) / (2.0 * math.pi)
    assert found == pytest.approx(np.sort((units * roots).ravel())[:5], rel=1e-3)


def test_a_steady_deformation_in_space_is_a_motion_that_the_equations_allow():
    settings = ["solve.preset=coupled", "solve.modes=3", "solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    model = kaneflex.load(with_settings(read_scene("rotating-blade"), settings))
    state = linear_about(model, 5e-4).instant
    shapes = model.motion.module.system.engine.modal[1]
    unbalanced = undeformed(model, np.array([5e-4]))[0].du[shapes]
    assert not state.u[shapes].any() and abs(state.du[shapes]).max() < 1e-8 * abs(unbalanced).max()


def test_where_free_joints_go_is_not_known_beyond_the_run():
    with pytest.raises(SceneError, match=r"t = 0.1: the motion of tip is computed from 0 to 0\.001 s"):
        _space(TOP.replace("SPEED", "1") + SHORT.format(1), t=0.1)


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
