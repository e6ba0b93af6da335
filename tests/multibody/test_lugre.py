"""LuGre's friction against its own equations by another integrator, and against the law that it comes to if stiff."""

import itertools
import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_friction import BLOCK, CRANK, FALLING, HINGE, ROD, G, solved
from test_rigid_friction import DISC

from kaneflex import SceneError
from kaneflex.generated import friction
from kaneflex.integrate.system import Outcome
from kaneflex.scene.contact_check import FRICTION_RESULTS

TABLE = """
schema = 1
description = "The block of Canudas de Wit et al. 1995 on its table"
gravity = [0, "-9.81 m/s^2"]
bodies.block = {mass = "1 kg"}
joints.slide.prismatic = ["ground", "block"]
joints.slide.direction = [1, 0]
drives.slide = {free = true}
loads.pull = {force_on = "block", direction = [1, 0], law = "LAW"}
sensors.x = {position = "slide"}
sensors.drag = {friction_force = "slide"}
solve = {preset = "coupled", duration = "5 s", steps = 500}
[joints.slide.friction]
law = "lugre"
preload = "1 N"
mu_static = 0.05
viscous = "0.4 N s/m"
stribeck_speed = "0.001 m/s"
bristle_stiffness = "1e5 N/m"
bristle_damping = "316.2 N s/m"
"""


@cache
def by_scipy(times, force, damping):
    """Way, speed, bend and loss of the block, by eqs. (2), (3) and (4) of the paper."""

    def rates(t, y):
        x, v, z, _ = y
        g = 1 + 0.05 * 9.81 * math.exp(-((v / 0.001) ** 2))
        bends = v - 1e5 * abs(v) / g * z
        drag = 1e5 * z + damping * bends + 0.4 * v
        return [v, force(t, x) - drag, bends, drag * v - 1e5 * z * bends]

    def derivatives(t, y):
        _, v, z, _ = y
        excess, way, tiny = 0.05 * 9.81 * math.exp(-((v / 0.001) ** 2)), np.sign(v), 1e-6
        g = 1 + excess
        by_v = 1 - 1e5 * way / g * z - 1e5 * abs(v) * z / g**2 * 2 * v / 1e-6 * excess
        by_z, pulls = -1e5 * abs(v) / g, (force(t, y[0] + tiny) - force(t, y[0] - tiny)) / (2 * tiny)
        bends = v + by_z * z
        drag, drag_v, drag_z = 1e5 * z + damping * bends + 0.4 * v, damping * by_v + 0.4, 1e5 + damping * by_z
        lost = [0, drag + v * drag_v - 1e5 * z * by_v, v * drag_z - 1e5 * (bends + z * by_z), 0]
        return np.array([[0, 1, 0, 0], [pulls, -drag_v, -drag_z, 0], [0, by_v, by_z, 0], lost])

    options = {"rtol": 1e-12, "atol": 1e-14, "max_step": 0.05, "jac": derivatives}
    found = solve_ivp(rates, (0, times[-1]), np.zeros(4), "LSODA", times, **options)
    assert found.success
    return found.y


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("law", "force", "damping", "close"), [
    ("0.7 * sin(3 * t)", lambda t, x: 0.7 * math.sin(3 * t), 316.2, 1e-10),  # before it slides at all
    ("0.7 * sin(3 * t)", lambda t, x: 0.7 * math.sin(3 * t), 0.0, 1e-8),
    ("3 * sin(3 * t)", lambda t, x: 3 * math.sin(3 * t), 316.2, 1e-6),  # to and fro
    ("4 * (0.1 * t - slide)", lambda t, x: 4 * (0.1 * t - x), 316.2, 1e-6),  # by a spring: it sticks and slips
], ids=["presliding", "undamped", "reversals", "stick-slip"])  # fmt: skip
@pytest.mark.parametrize("integrator", ["gauss", "radau"])
def test_a_block_creeps_slides_and_sticks_as_the_papers_equations_have_it(law, force, damping, close, integrator):
    settings = [f"slide.friction.bristle_damping={damping}", f"solve.integrator={integrator}"]
    settings.append("solve.tolerance=1e-11")
    if not damping:  # it rings all the time
        settings += ["solve.duration=1 s", "solve.steps=100"]
    found = solved(TABLE.replace("LAW", law), *settings)
    x, v, z, lost = by_scipy(tuple(found.times), force, damping)
    record = found.trajectory.frictions
    assert found.series["x"].values == pytest.approx(x, abs=close)
    assert record.speed[:, 0] == pytest.approx(v, abs=100 * close)
    assert record.bristles[:, 0] == pytest.approx(z, abs=min(close, 2e-8))
    assert record.lost[:, 0] == pytest.approx(lost, abs=close)
    assert found.dataset["friction_bristles"].values == pytest.approx(record.bristles)
    assert found.dataset["friction_bristles"].attrs["units"] == "m"


def test_before_it_slides_its_way_is_a_hysteresis_loop():
    """Force over way: returns along another branch, loses the loop's area every cycle, and ends as stiff as begun."""
    found = solved(TABLE.replace("LAW", "0.9 * sin(3 * t)"), "solve.steps=4000")
    x, drag, lost = found.series["x"].values, -found.series["drag"].values, found.trajectory.frictions.lost[:, 0]
    cycle = np.searchsorted(found.times, 2 * math.pi / 3 * np.arange(1, 3))
    loops = [np.trapezoid(drag[a : b + 1], x[a : b + 1]) for a, b in itertools.pairwise(cycle)]
    assert min(loops) > 0.2 * 0.9 * np.ptp(x)
    assert np.diff(lost[cycle]) == pytest.approx(loops, rel=2e-2)
    assert (np.diff(lost) > -1e-12).all()
    first = (found.times > 0.02) & (found.times < 0.1)
    assert drag[first] == pytest.approx(1e5 * x[first], rel=0.25)


def lugre(text, stiffness, damping=0.0):
    bristles = f'friction = {{law = "lugre", bristle_stiffness = {stiffness}, bristle_damping = {damping}, '
    return text.replace("friction = {", bristles)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("text", "settings", "sensor", "stiff", "close"), [
    (BLOCK, ["drives.slide.initial_speed=-1", "slide.friction.mu=0.8"], "x", 1e6, 3e-3),
    (HINGE, [], "angle", 1e4, 2e-3),
    (CRANK, ["solve.duration=1 s"], "angle", 1e4, 1e-2),
    (FALLING.replace(", mu_static = 0.3", ""), [], "x", 1e7, 1e-3),
    (ROD, ["floor.friction.mu=2"], "y", 1e6, 3e-3),
], ids=["guide", "pin", "loop", "contact", "Painleve's rod"])  # fmt: skip
def test_bristles_that_are_stiffer_come_closer_to_coulombs_law(text, settings, sensor, stiff, close):
    """What is missed is about the way that bristles bend, N mu over their stiffness, every time things turn round."""
    dry = solved(text, *settings).series[sensor].values
    missed = [
        abs(solved(lugre(text, size), *settings).series[sensor].values - dry).max()
        for size in (stiff, 30 * stiff)
    ]
    assert missed[0] < close and missed[1] < 0.2 * missed[0]


@pytest.mark.parametrize(("integrator", "speed", "tolerance"), [
    ("radau", 0, 1e-11), ("gauss", 0, 1e-11), ("gauss", 3, 1e-11), ("gauss", 5, 1e-11),
    ("radau", 3, 1e-8), ("gauss", 3, 1e-8), ("radau", 5, 1e-8), ("gauss", 5, 1e-8),
])  # fmt: skip
def test_a_pin_turns_by_its_equations_with_the_reaction_that_presses_it(integrator, speed, tolerance):
    """A pendulum: m r^2 phi'' = m g r cos(phi) - M, and the pin's reaction, by which its friction is, from phi' too."""
    text = HINGE.replace('wheel = {mass = "1 kg", inertia = "0.02 kg m^2"}',
                         'wheel = {mass = "1 kg", centre = ["0.1 m", 0], inertia = "0.02 kg m^2"}')  # fmt: skip
    text = lugre(text.replace(', preload = "0.005 N m"', ""), "20", "0.02")
    settings = [f"drives.hinge.initial_speed={speed}", "solve.duration=3 s", f"solve.integrator={integrator}"]
    found = solved(text, *settings, f"solve.tolerance={tolerance}")

    def reaction(phi, omega, alpha):
        a_x = -0.1 * (alpha * math.sin(phi) + omega**2 * math.cos(phi))
        a_y = 0.1 * (alpha * math.cos(phi) - omega**2 * math.sin(phi)) + G
        return math.hypot(a_x, a_y)

    def rates(t, y):
        phi, omega, z = y
        alpha = -G * 0.1 * math.cos(phi) / 0.03
        for _ in range(60):
            bends = omega - 20 * abs(omega) / (0.002 * reaction(phi, omega, alpha)) * z
            alpha = (-G * 0.1 * math.cos(phi) - 20 * z - 0.02 * bends) / 0.03
        return [omega, alpha, bends]

    exact = solve_ivp(rates, (0, 3), [0, speed, 0], "LSODA", found.times, rtol=1e-11, atol=1e-13)
    assert found.series["angle"].values == pytest.approx(exact.y[0], abs=1e-8)
    assert found.trajectory.frictions.bristles[:, 0] == pytest.approx(exact.y[2], abs=max(1e-9, 2 * tolerance))
    pressed = [0.01 * reaction(*y[:2], rates(0, y)[1]) for y in exact.y.T]
    assert found.trajectory.frictions.pressed[:, 0] == pytest.approx(pressed, rel=1e-5)
    names = {name for name in FRICTION_RESULTS if "pin" in name}
    assert names <= set(found.dataset.variables) and found.dataset["pin_bristles"].attrs["units"] == "rad"


def test_damping_that_outweighs_what_presses_is_named_where_a_loop_has_no_force_for_it():
    found = solved(lugre(CRANK, 1e4, 0.01), outcome=Outcome.STUCK)
    assert "bristle_damping times the speed" in found.message and "Give a smaller bristle_damping" in found.message


@pytest.mark.parametrize(("written", "instead", "says"), [
    ('bristle_stiffness = "1e5 N/m"', "", "lugre needs a bristle_stiffness"),
    ('bristle_stiffness = "1e5 N/m"', "bristle_stiffness = 0", "bristle_stiffness.*not above zero"),
    ('bristle_stiffness = "1e5 N/m"', 'bristle_stiffness = "3 N m/rad"', "bristle_stiffness"),
    ('preload = "1 N"\nmu_static = 0.05', "", "lugre without mu or preload"),
    ('stribeck_speed = "0.001 m/s"', "", "needs stribeck_speed if mu_static = 0.05 is above mu = 0"),
    ('law = "lugre"', 'law = "stribeck"', "law stribeck does not use it"),
])  # fmt: skip
def test_what_bristles_lack_is_named(written, instead, says):
    with pytest.raises(SceneError, match=says):
        solved(TABLE.replace("LAW", "1").replace(written, instead))


@pytest.mark.parametrize("e", [0.3, 0.7])
@pytest.mark.parametrize("damping", [100, 1000])
def test_a_disc_that_slides_as_it_bounces_on_bristles_is_slowed_by_coulombs_impulse(damping, e):
    """Where its sides part nothing presses any more, and how bristles stand there is no matter of accuracy."""
    lugre = f'law = "lugre", mu = 0.1, bristle_stiffness = 1e6, bristle_damping = {damping}'
    text = DISC.replace('law = "newton"', "stiffness = 1e6").replace("{mu = 0.1}", f"{{{lugre}}}")
    text = text.replace("velocity = [2, 0]", "velocity = [20, 0]")
    found = solved(text, f"floor.contact.restitution={e}", "solve.duration=0.45 s")
    (bounce,) = found.impacts
    assert found.times[-1] > bounce.end
    assert found.trajectory.v[-1][0] == pytest.approx(20 - 0.1 * bounce.impulse / 2, abs=3e-5)


@pytest.mark.parametrize("v", [0.013, -0.02])
def test_the_slopes_that_newtons_method_reads_are_those_of_the_rate(v):
    """By the speed, on which g depends by Stribeck's law, and by g itself; by differences."""
    given = {"mu": 0.2, "mu_static": 0.5, "v_s": 0.01, "delta": 1.5, "preload": 3.0, "sigma_0": 1e4, "sigma_1": 20.0}
    p, N, z, h = np.array([given.get(name, 0.0) for name in friction.NUMBERS]), 40.0, 1e-4, 1e-7
    g, slope = friction.dry.py_func(p, 0, N, v), friction.dry_slope.py_func(p, 0, N, v)

    def rate(v, more=0.0):
        return friction.bristle_rate.py_func(p, 0, friction.dry.py_func(p, 0, N, v) + more, v, z)

    by_speed = friction.bristle_by_speed.py_func(p, 0, g, slope, v, math.copysign(1.0, v), z)
    assert by_speed == pytest.approx((rate(v + h) - rate(v - h)) / (2 * h), rel=1e-5)
    by_dry = (rate(v, h) - rate(v, -h)) / (2 * h)
    assert friction.bristle_by_dry.py_func(p, 0, g, v, z) == pytest.approx(by_dry, rel=1e-5)
