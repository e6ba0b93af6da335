"""The coupled equations as a state space: beside the one-way equations where these are right, and beyond them."""

import json

import numpy as np
import pytest
from command_line import cli
from machines import pendulum, slider_crank

import kaneflex
from kaneflex.scene import read_scene, scene_of, with_settings
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


def test_a_turning_blade_is_stiff_by_its_own_tension():
    """Kane's equations give it without any K_g: poles as stiffened has them, up to modes beyond the sixth."""
    settings = ("push.value=1e-6", "solve.modes=6")
    one_way, coupled = (
        system("rotating-cantilever", f"solve.preset={preset}", *settings) for preset in ("stiffened", "coupled")
    )
    assert coupled.poles[:3].imag == pytest.approx(one_way.poles[:3].imag, rel=3e-4)


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
