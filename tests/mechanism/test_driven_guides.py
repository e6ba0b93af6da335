"""Drives on guides against closed forms: forces of the drive, base excitation, a crank that follows its piston."""

import math

import numpy as np
import pytest
from machines import machine
from runs import solved

from kaneflex import SceneError, load, read_scene, scene_of
from kaneflex.cli.scene import configuration
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place

CART = """
schema = 1
name = "cart"
bodies.cart.mass = 2.0
joints.bore = {{prismatic = ["ground", "cart"], direction = [1, 0]}}
sensors.force = {{drive_force = "bore"}}
sensors.x = {{position = "cart"}}
solve = {{preset = "rigid", duration = 0.5, steps = 200}}
drives.bore = {{{drive}}}
"""


def cart(folder, drive: str, loads: str = ""):
    return scene_of(CART.format(drive=drive) + loads, folder)


def test_the_force_that_moves_a_cart_is_mass_times_acceleration(tmp_path):
    solution = solved(cart(tmp_path, 'law = "0.03 * sin(20 * t)"'))
    t = solution.times
    np.testing.assert_allclose(solution["x"], 0.03 * np.sin(20 * t), atol=1e-15)
    np.testing.assert_allclose(solution["force"], -2.0 * 0.03 * 400 * np.sin(20 * t), atol=1e-11)


def test_a_guide_at_constant_speed_and_one_that_spins_up(tmp_path):
    steady = solved(cart(tmp_path, 'speed = "0.5 m/s", position = "20 mm"'))
    np.testing.assert_allclose(steady["x"], 0.02 + 0.5 * steady.times, atol=1e-15)
    np.testing.assert_allclose(steady["force"], 0.0, atol=1e-12)
    started = solved(cart(tmp_path, 'speed = "0.5 m/s", spin_up = "0.4 s"'))
    t = np.minimum(started.times, 0.4)
    np.testing.assert_allclose(started["force"], 2.0 * 0.5 / 0.4 * (1 - np.cos(2 * np.pi * t / 0.4)), atol=1e-11)


def test_a_table_gives_the_position_in_its_unit(tmp_path):
    t = np.linspace(0.0, 0.5, 101)
    rows = [f"{time!r},{30 * math.sin(20 * time)!r}" for time in t.tolist()]
    (tmp_path / "s.csv").write_text("\n".join(["t,s", *rows]))
    solution = solved(cart(tmp_path, 'table = "s.csv", unit = "mm"'))
    # the natural spline ends straight, the sine does not
    np.testing.assert_allclose(solution["x"], 0.03 * np.sin(20 * solution.times), atol=1e-5)


def test_a_free_guide_follows_a_constant_force(tmp_path):
    push = 'loads.push = {force_on = "cart", direction = [1, 0], value = "3 N"}'
    solution = solved(cart(tmp_path, 'free = true, position = 0.1, initial_speed = "-0.4 m/s"', push))
    t = solution.times
    np.testing.assert_allclose(solution["x"], 0.1 - 0.4 * t + 0.75 * t**2, atol=1e-9)
    np.testing.assert_allclose(solution["force"], 0.0, atol=1e-8)


def test_a_motor_whose_force_falls_with_the_speed(tmp_path):
    """m v' = F (1 - v / v_0): x = v_0 (t - T (1 - exp(-t / T))), T = m v_0 / F."""
    motor = 'loads.motor = {force_on = "cart", direction = [1, 0], law = "3 * (1 - bore_speed / 0.6)"}'
    solution = solved(cart(tmp_path, "free = true", motor))
    t, lag = solution.times, 2.0 * 0.6 / 3.0
    np.testing.assert_allclose(solution["x"], 0.6 * (t - lag * (1 - np.exp(-t / lag))), atol=1e-8)


SHAKEN = machine(
    name="shaken cantilever",
    bodies=dict(cart="mass = 2.0",
                mast='length = 0.5, '
                     'beam = {E = "210 GPa", rho = 7850, section = {rectangle = ["4 mm", "10 mm"]}, elements = 8}'),
    joints=dict(bore="prismatic ground cart, direction = [1, 0]",
                foot='weld cart mast.start, relative_angle = "90 deg"'),
    drives=dict(bore='law = "0.001 * sin(40 * t)", period = "TURN s"'),
    sensors=dict(tip="displacement mast.end y", force="drive_force bore"),
    solve=dict(start="periodic", steps=800, preset="linear"),
)


def test_a_shaken_cantilever_in_its_steady_state():
    """Euler-Bernoulli with a base of amplitude X: the total shape is that of a driven clamped end.

    W'''' = k^4 W, W(0) = X, W'(0) = W''(L) = W'''(L) = 0 and the base's shear force is E I W'''(0).
    """
    solution = solved(scene_of(SHAKEN.replace("TURN", repr(2 * math.pi / 40))))
    stiffness, per_length, length, amplitude, omega = 210e9 * 0.01 * 0.004**3 / 12, 7850 * 4e-5, 0.5, 1e-3, 40.0
    k = (per_length * omega**2 / stiffness) ** 0.25
    at_foot = [[1, 0, 1, 0], [0, 1, 0, 1]]
    c, s, ch, sh = (f(k * length) for f in (np.cos, np.sin, np.cosh, np.sinh))
    at_tip = [[-c, -s, ch, sh], [s, -c, sh, ch]]
    a, b, p, q = np.linalg.solve(np.array([*at_foot, *at_tip]), [amplitude, 0.0, 0.0, 0.0])
    beyond = a * c + b * s + p * ch + q * sh - amplitude
    t = solution.times
    np.testing.assert_allclose(solution["tip"], -beyond * np.sin(omega * t), atol=2e-3 * abs(beyond))
    shear = stiffness * k**3 * (q - b)
    force = -(2.0 * omega**2 * amplitude - shear) * np.sin(omega * t)
    np.testing.assert_allclose(solution["force"], force, atol=2e-3 * np.abs(force).max())


PISTON = """
schema = 1
name = "driven from the piston"
bodies.crank = {length = "40 mm", mass = 0.5, inertia = 1e-4}
bodies.rod = {length = "137 mm", mass = 0.3, inertia = 4e-4}
bodies.piston = {mass = 0.8}
joints.bore = {prismatic = ["ground", "piston"], direction = [1, 0]}
joints.wrist = {revolute = ["piston", "rod.end"]}
joints.pin = {revolute = ["rod.start", "crank.end"]}
joints.main = {revolute = ["ground", "crank.start"], branch = "+"}
drives.bore = {law = "0.13 + REACH * sin(10 * t)", period = "TURN s"}
sensors.force = {drive_force = "bore"}
solve = {preset = "rigid", steps = 200}
"""


def from_the_piston(reach: float):
    return scene_of(PISTON.replace("REACH", repr(reach)).replace("TURN", repr(math.pi / 5)))


def test_the_crank_follows_its_piston_and_powers_balance():
    scene = from_the_piston(0.03)
    model = load(scene)
    rigid = model.motion.at(np.linspace(0.0, 0.6, 61))
    for body, length in (("crank", 0.04), ("rod", 0.137)):
        ends = [rigid[f"{body}.{axis}"] + length * rigid[f"{body}.{f}"] for axis, f in (("x", "c"), ("y", "s"))]
        wanted = (0.13 + 0.03 * np.sin(10 * np.linspace(0.0, 0.6, 61)), 0.0)
        if body == "rod":
            np.testing.assert_allclose(ends[0], wanted[0], atol=1e-12)
            np.testing.assert_allclose(ends[1], wanted[1], atol=1e-12)
        else:
            np.testing.assert_allclose(ends[0], rigid["rod.x"], atol=1e-12)
    standing = place(mechanism_of(scene), {"bore": 0.13})
    assert standing["crank.s"][0] == pytest.approx(rigid["crank.s"][0], abs=1e-8)
    assert rigid["piston.x"][0] == pytest.approx(0.13)


def test_a_piston_beyond_its_dead_centre_is_named_in_millimetres():
    with pytest.raises(SceneError, match=r"joints\.main.*bore = 17\d\.?\d* mm"):
        load(from_the_piston(0.06))


@pytest.mark.parametrize(("drive", "said"), [
    ('speed = "10 rpm"', r"drives\.bore\.speed = '10 rpm'.*a guide slides.*'0\.5 m/s'"),
    ('speed = "1 m/s", angle = "10 deg"', r"drives\.bore\.angle = '10 deg'.*a guide slides.*Give position"),
    ('speed = "1 m/s", cycle = "720 deg"', r"drives\.bore\.cycle = '720 deg'.*has no cycle"),
    ('free = true, initial_speed = "1 rad/s"', r"drives\.bore\.initial_speed = '1 rad/s'.*a guide slides"),
    ('table = "s.csv"', r"drives\.bore\.unit.*a guide slides.*unit = 'mm'"),
])  # fmt: skip
def test_what_a_guide_cannot_take(tmp_path, drive, said):
    (tmp_path / "s.csv").write_text("t,s\n0,0\n1,1\n2,2\n3,3\n4,4\n")
    with pytest.raises(SceneError, match=said):
        cart(tmp_path, drive)


def test_a_revolute_drive_takes_no_speed_in_metres():
    scene = 'schema = 1\nlike = "slider-crank-150"\ndrives.main = {speed = "0.5 m/s"}\n'
    with pytest.raises(SceneError, match=r"drives\.main\.speed = '0\.5 m/s'.*a revolute joint turns.*'6000 rpm'"):
        scene_of(scene)


ARM = machine(
    name="slider on an arm", bodies=dict(arm="inertia = 0.02", slider="mass = 0.7"),
    joints=dict(hub="revolute ground arm.start", rail="prismatic arm.start slider, direction = [1, 0]"),
    drives=dict(rail='law = "0.2 + 0.05 * sin(9 * t)"', hub='speed = "12 rad/s"'),
    sensors=dict(along="drive_force rail", turning="drive_torque hub"),
    solve=dict(preset="rigid", duration=1.0, steps=300),
)


def test_a_slider_driven_along_a_turning_arm():
    """Polar coordinates: the rail's drive applies m (r'' - r omega^2), the hub's 2 m r r' omega."""
    solution = solved(scene_of(ARM))
    t = solution.times
    r, dr, ddr = 0.2 + 0.05 * np.sin(9 * t), 0.45 * np.cos(9 * t), -4.05 * np.sin(9 * t)
    np.testing.assert_allclose(solution["along"], 0.7 * (ddr - 144 * r), atol=1e-11)
    np.testing.assert_allclose(solution["turning"], 2 * 0.7 * r * dr * 12, atol=1e-11)


def test_results_hold_a_guide_s_position_in_metres(tmp_path):
    dataset = solved(cart(tmp_path, 'speed = "0.5 m/s"')).dataset
    assert dataset["drive_position_bore"].attrs["units"] == "m"
    assert float(dataset["drive_position_bore"][-1]) == pytest.approx(0.25)


def test_the_command_line_reads_a_guide_s_place_as_a_length():
    scene = from_the_piston(0.03)
    assert configuration(scene, "bore=20mm") == ("bore", pytest.approx(0.02))
    with pytest.raises(SceneError, match=r"--at = 'bore=20deg'.*not a unit of length"):
        configuration(scene, "bore=20deg")


@pytest.mark.parametrize(("text", "said"), [
    (("{drive_force", "{drive_torque"), r"sensors\.force\.drive_torque = 'bore'.*slides.*Write drive_force"),
    (("duration = 0.5", 'duration = 0.5, mode_angle = "20 deg"'), r"solve\.mode_angle = '20 deg'.*a guide slides"),
    (("solve", 'loads.p = {force_on = "cart", direction = [1, 0], table = "s.csv", against = "bore"}\nsolve'),
     r"loads\.p\.table = .*a guide slides; the first column of s\.csv is an angle.*like 'bore \(m\)'"),
])  # fmt: skip
def test_what_the_rest_of_a_scene_cannot_ask_of_a_guide(tmp_path, text, said):
    written = CART.format(drive='speed = "0.5 m/s"').replace(*text)
    (tmp_path / "cart.toml").write_text(written)
    (tmp_path / "s.csv").write_text("t,s\n0,0\n1,1\n2,2\n3,3\n4,4\n")
    with pytest.raises(SceneError, match=said):
        read_scene(tmp_path / "cart.toml")


def test_a_cylinder_between_two_bodies_that_turn():
    """A driven guide whose two bodies hang on others: a triangle with a known side, by the rule of cosines."""
    scene = machine(
        name="cylinder", ground=dict(high=[0.5, 0.0]),
        bodies=dict(barrel="mass = 1.0", stem="mass = 1.0", lever="length = 0.4, mass = 1.0"),
        joints=dict(foot="revolute ground barrel", bore="prismatic barrel stem, direction = [1, 0]",
                    eye="revolute stem lever.end",
                    pivot='revolute ground.high lever.start, near = {lever = "120 deg"}'),
        drives=dict(bore='law = "0.4 + 0.05 * sin(t)"'), solve=dict(preset="rigid", duration=1.0),
    )
    rigid = load(scene_of(scene)).motion.at(np.linspace(0.0, 1.0, 50))
    u = rigid["bore.angle"]
    assert np.arctan2(rigid["barrel.s"], rigid["barrel.c"]) == pytest.approx(np.arccos((u**2 + 0.09) / u), abs=1e-12)
    angle = np.pi - np.arccos((0.41 - u**2) / 0.4)
    assert np.arctan2(rigid["lever.s"], rigid["lever.c"]) == pytest.approx(angle, abs=1e-12)


def test_modes_are_said_to_be_where_the_guide_stands(tmp_path):
    """Without a place to take them at the modes are those of t = 0, and the page says so in millimetres."""
    path = tmp_path / "shaken.toml"
    law = SHAKEN.replace("TURN", repr(2 * math.pi / 40)).replace("0.001 * sin", "0.05 + 0.001 * sin")
    path.write_text(law)
    assert load(read_scene(path)).reference_position == "bore = 50 mm"
    path.write_text(law.replace("steps = 800", 'steps = 800, mode_angle = "50.5 mm"'))
    model = load(read_scene(path))
    assert model.reference_position == "bore = 50.5 mm"
    assert math.sin(40 * model.reference_time) == pytest.approx(0.5, abs=1e-3)
