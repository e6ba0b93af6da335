"""Sensors against what they mean: rates are derivatives of places, and sections carry what hangs on them.

The deformation is prescribed where only the kinematics of the sensors is asked for, so that no integrator has a part in
it; the section forces and the moments of joints follow from closed forms.
"""

import numpy as np
import pytest
import transformed
from machines import machine, pendulum
from runs import STENCIL, derived_on_the_fly, waving

from kaneflex import Model, load, read_scene
from kaneflex.solve.simulation import solve

MOVING = {  # scene -> a time in which it moves by about a radian [s]
    "engine": 1.6e-3, "engine-elastic-crank": 1.6e-3, "engine-rig": 0.22, "four-bar": 0.032, "quick-return": 0.08,
    "rotating-cantilever": 0.028, "six-bar": 0.032, "two-link-arm": 0.25,
}  # fmt: skip


@pytest.mark.parametrize("name", MOVING)
def test_velocities_and_accelerations_are_the_derivatives_of_places(name):
    """Coriolis terms, the rates of foreshortening and the turning of axes, at points beside the axes of all bodies."""
    raw, sensors, pairs = transformed.probed(read_scene(name)), {}, []
    for body, data in raw["bodies"].items():
        data["points"]["probe"] = (data["points"]["probe"][0], 0.07 * data.get("length", 0.1))
        for component in ("x", "y", "angle"):
            kinds = [f"{body}_{component}_{kind}" for kind in ("position", "velocity", "acceleration")]
            for key, kind in zip(kinds, ("position", "velocity", "acceleration"), strict=True):
                sensors[key] = {kind: (body, "probe"), "axes": "global", "component": component}
            pairs += [(kinds[0], kinds[1]), (kinds[1], kinds[2])]
    raw |= {"sensors": sensors}
    raw["solve"] |= {"preset": "stiffened"}
    model, time = load(transformed.validated(raw)), MOVING[name]
    h = 0.01 * time
    for instant in (0.3 * time, 2.9 * time):
        series = waving(model, instant + h * np.arange(-4, 5), time).series
        largest = {kind: max(abs(series[key].values).max() for key in series if kind in key and "angle" not in key)
                   for kind in ("velocity", "acceleration")}  # fmt: skip
        for place, rate in pairs:
            found, kind = series[rate].values[4], rate.rpartition("_")[2]
            scale = largest[kind] / (0.1 if "angle" in rate else 1.0)
            assert STENCIL @ series[place].values / h == pytest.approx(found, abs=1e-9 * scale), rate


THICK_ARM = pendulum(
    'length = "1 m", points = {near_tip = ["0.9 m", 0]}, beam = {E = "2e13 Pa", rho = 7850, '
    'section = {rectangle = ["200 mm", "50 mm"]}, theory = "rayleigh", elements = 10}', 'law = "5 * t**2"', "arm",
    "hub",
    sensors="""
root = {bending_moment = "arm.start"}
middle = {bending_moment = "arm.mid"}
near_tip = {bending_moment = "arm.near_tip"}
strain = {strain = "arm.mid", fibre = "100 mm"}""",
    solve={"preset": "rigid", "duration": "0.5 s", "steps": 4},
)


@pytest.mark.parametrize("preset", ["rigid", "quasistatic"])
def test_an_arm_that_is_turned_faster_bends_by_its_sections_rotary_inertia_too(tmp_path, preset):
    """M(x) = -epsilon (rho A int_x^L X (X - x) dX + rho I (L - x)): near the tip the second part is most of it."""
    solution = solve(derived_on_the_fly(THICK_ARM, tmp_path, f"solve.preset={preset}"))
    epsilon, rho, A, I = 10.0, 7850.0, 0.2 * 0.05, 0.05 * 0.2**3 / 12
    for name, x in (("root", 0.0), ("middle", 0.5), ("near_tip", 0.9)):
        moment = -epsilon * rho * (A * ((1 - x**3) / 3 - x * (1 - x**2) / 2) + I * (1 - x))
        assert solution.series[name].values == pytest.approx(moment, rel=1e-4 if preset == "quasistatic" else 1e-12)
    # In the middle the tension of the turning comes on top: the arm lags, so the upper side is pulled.
    t, M = solution.times, -epsilon * rho * (A * 5 / 48 + I / 2)
    N = rho * A * (10 * t) ** 2 * (1 - 0.25) / 2
    expected = N / (2e13 * A) - 0.1 * M / (2e13 * I)
    assert solution.series["strain"].values == pytest.approx(expected, rel=1e-4)


HAND = machine(
    bodies=dict(bar='length = "1 m", beam = {E = "200 GPa", rho = 7850, A = "100 mm^2", I = "800 mm^4", elements = 16}',
                hand='length = "300 mm", mass = "1 kg"'),
    joints=dict(wall="weld ground bar.start", grip="weld bar.end hand.start"),
    loads=dict(pull='force_on = "hand.end", direction = [1, 0], value = "400 N"',
               push='force_on = "hand.end", direction = [0, -1], value = "20 N"'),
    sensors=dict(tip="displacement bar.end y", turn="displacement bar.end angle", grip_moment="joint_force grip angle",
                 wall_moment="joint_force wall angle", top='strain bar.start, fibre = "5 mm"'),
    solve=dict(preset="quasistatic", duration="1 s", steps=2),
)


SPRING = """
ground.far = [1e6, 0]
springs.pull = {between = ["hand.end", "ground.far"], stiffness = 4e-4}
"""


@pytest.mark.parametrize("pulled", ["by a force", "by a spring from afar"])
def test_forces_keep_their_direction_on_a_rigid_body_that_turns_with_the_deformation(tmp_path, pulled):
    """A beam under tension P with a rigid body b at its tip, pushed down by F: E I v'' = -F (L + b - x) - P (v_T - v).

    The pull has an arm about the grip as the body turns: the grip holds F b + P b theta, theta < 0, a third less than
    F b. At the wall the upper fibre is pulled by both forces.
    """
    force = 'loads.pull = {force_on = "hand.end", direction = [1, 0], value = "400 N"}\n'
    assert force in HAND
    text = HAND if pulled == "by a force" else HAND.replace(force, SPRING.lstrip())
    solution = solve(derived_on_the_fly(text, tmp_path))
    P, F, L, b, EI, EA = 400.0, 20.0, 1.0, 0.3, 200e9 * 800e-12, 200e9 * 100e-6
    k = np.sqrt(P / EI)
    ch, sh, B = np.cosh(k * L), np.sinh(k * L), F / (k * P)
    A = -B * (sh + b * k * ch) / (ch + b * k * sh)
    theta = k * A * sh + k * B * ch - F / P
    tip = A * (ch - 1.0) + B * sh - F * L / P
    wall = F * (L + b) + P * (tip + b * theta)
    assert P * theta / F < -0.3
    expected = {"tip": tip, "turn": theta, "grip_moment": b * (F + P * theta), "wall_moment": wall,
                "top": P / EA + 0.005 * wall / EI}  # fmt: skip
    for name, value in expected.items():
        assert solution.series[name].values == pytest.approx(value, rel=1e-5), name


LADEN = pendulum(
    'length = "1 m", points = {spot = ["250 mm", 0], cut = ["630 mm", 0]}, beam = {E = "2e15 Pa", rho = 7850, '
    'A = "900 mm^2", A_end = "300 mm^2", I = "13333 mm^4", axially_rigid = true}', 'law = "5 * t**2"', "arm", "hub",
    masses="""
tip = {at = "arm.end", mass = "2 kg"}
spot = {at = "arm.spot", mass = "3 kg", inertia = "0.7 kg m^2"}""",
    loads="""
wind = {spread_on = "arm", direction = [0, 1], axes = "body", value = "40 N/m", profile = [1, 3]}
push = {force_on = "arm.spot", direction = [0, 1], axes = "body", value = "7 N"}
twist = {torque_at = "hub", value = "5 N m"}""",
    sensors="""
N = {axial_force = "arm.cut"}
V = {shear_force = "arm.cut"}
M = {bending_moment = "arm.cut"}
N_tip = {axial_force = "arm.end"}
felt = {acceleration = "arm.end", component = "x"}""",
    solve={"preset": "rigid", "duration": "0.5 s", "steps": 4},
)


@pytest.fixture(scope="module")
def laden(tmp_path_factory) -> dict[str, Model]:
    folder = tmp_path_factory.mktemp("laden")
    ways = ("rigid", "quasistatic", "linear")
    return {way: derived_on_the_fly(LADEN, folder, f"solve.preset={way}") for way in ways}


def test_a_cut_through_a_tapered_arm_with_lumps_and_a_load_carries_what_lies_beyond(laden):
    """The part beyond the cut at x is in balance, with rho A(X), p(X) linear and a mass m at its tip:

    N = omega^2 (int rho A X + m L), V = int p - epsilon (int rho A X + m L), M = int p (X - x) - epsilon (int rho A X
    (X - x) + m L (L - x)). What acts before the cut, the other lump and its inertia, the push and the torques at the
    hub, has no part in it.
    """
    poly, x, L, m, epsilon = np.polynomial.Polynomial, 0.63, 1.0, 2.0, 10.0
    X, density, load = poly([0.0, 1.0]), 7850 * poly([900e-6, -600e-6]), 40 * poly([1.0, 2.0])

    def beyond(density: np.polynomial.Polynomial) -> float:
        whole = density.integ()
        return float(whole(L) - whole(x))

    first, second = beyond(density * X) + m * L, beyond(density * X * (X - x)) + m * L * (L - x)
    for preset in ("rigid", "quasistatic"):
        solution = solve(laden[preset])
        expected = {"N": (10 * solution.times) ** 2 * first, "V": beyond(load) - epsilon * first,
                    "M": beyond(load * (X - x)) - epsilon * second}  # fmt: skip
        for name, value in expected.items():
            scale = abs(np.asarray(value)).max()
            bound = 1e-9 if preset == "rigid" else 1e-4  # almost stiff
            assert abs(solution.series[name].values - value).max() <= bound * scale, (preset, name)


def test_an_axially_rigid_beam_is_pulled_by_what_the_mass_at_its_end_feels(laden):
    """N = -m (a - g) along the bent beam's axis, of any deformation: Coriolis and Euler terms, too."""
    series = waving(laden["linear"], np.linspace(0.1, 0.5, 9), 0.1).series
    felt = series["felt"].values
    assert np.ptp(felt) > 10.0
    assert series["N_tip"].values == pytest.approx(-2.0 * felt, rel=1e-9, abs=1e-6)


HOLDING = machine(
    bodies=dict(arm='length = "1 m", '
                    'beam = {E = "2e15 Pa", rho = 7850, A = "900 mm^2", I = "67500 mm^4", elements = 4}',
                hand='length = "300 mm", mass = "2 kg", inertia = "0.05 kg m^2", centre = ["200 mm", "100 mm"], '
                     'points = {knob = ["100 mm", "-250 mm"]}'),
    joints=dict(hub="revolute ground arm.start", grip="weld arm.end hand.start"),
    masses=dict(ball='at = "hand.knob", mass = "1 kg"'), drives=dict(hub='law = "5 * t**2"'),
    sensors=dict(N="axial_force arm.end", V="shear_force arm.end", M="bending_moment arm.end",
                 grip_x='joint_force grip x, axes = "body"', grip_y='joint_force grip y, axes = "body"',
                 grip_moment="joint_force grip angle"),
    solve=dict(preset="quasistatic", duration="0.5 s", steps=4),
)


def test_a_hand_whose_masses_lie_beside_the_axis_pulls_sideways_as_the_arm_turns_faster(tmp_path):
    """m a = m (-omega^2 X - epsilon Y, epsilon X - omega^2 Y) of its own mass and of the ball that it holds."""
    solution = solve(derived_on_the_fly(HOLDING, tmp_path))
    epsilon, omega = 10.0, 10.0 * solution.times
    pull_x, pull_y, moment = 0.0, 0.0, 0.05 * epsilon
    for m, x, y in ((2.0, 0.2, 0.1), (1.0, 0.1, -0.25)):
        a_x, a_y = -(omega**2) * (1 + x) - epsilon * y, epsilon * (1 + x) - omega**2 * y
        pull_x, pull_y, moment = pull_x + m * a_x, pull_y + m * a_y, moment + m * (x * a_y - y * a_x)
    expected = {"N": -pull_x, "V": -pull_y, "M": -moment, "grip_x": pull_x, "grip_y": pull_y, "grip_moment": moment}
    for name, value in expected.items():
        assert abs(solution.series[name].values - value).max() < 1e-4 * abs(value).max(), name
