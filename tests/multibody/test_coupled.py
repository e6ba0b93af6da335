"""Preset coupled against published and independently computed motions, its energy, and what it refuses."""

import json

import numpy as np
import pytest
from machines import machine
from places import DATA
from runs import alike, solved

from kaneflex import SceneError, read_scene, scene_of


def run(name, *settings):
    return solved(read_scene(name), *settings)


def test_slider_crank_at_150_rad_s():
    """Peak and minimum within 0.5 % of the geometrically exact values, the end within 3 % (Euler-Bernoulli elements).

    What differs: the exact model bends and stretches without limit of order, ours shortens to the second order.
    """
    exact = json.loads((DATA / "slider_crank_150.json").read_text())["computed_own"]["GE_EulerBernoulli"]
    bow = run("slider-crank-150-coupled", "solve.modes=3").series["mid_transverse"].values / 0.3
    assert bow.max() == pytest.approx(exact["w_max"], rel=5e-3)
    assert bow.min() == pytest.approx(exact["w_min"], rel=5e-3)
    assert bow[-1] == pytest.approx(exact["w_at_end"], rel=3e-2)


def test_spin_up():
    """Tip displacements within 0.2 % of Kane, Ryan & Banerjee's linear stiffened equations in modal coordinates."""
    reference = json.loads((DATA / "spin_up.json").read_text())["cases"]["WuHaug"]["linear_stiffened"]
    series = run("spin-up", "solve.preset=coupled").series
    assert series["tip_transverse"].values.min() == pytest.approx(reference["u2_min"], rel=2e-3)
    assert series["tip_axial"].values.min() == pytest.approx(reference["u1_min"], rel=2e-3)


def test_spun_up_by_a_torque_it_gains_the_angular_momentum_of_that_torque():
    """int M dt = J omega for the straightened beam and hub: 4 rad/s but for what bending and stretch leave."""
    solution = run("spin-up-torque")
    assert solution.series["hub_speed"].values[-1] == pytest.approx(4.0, rel=1e-3)
    assert solution.series["tip_transverse"].values.min() < -0.5
    assert solution.trajectory.energy.drift < 1e-9


def test_the_reference_engine():
    """Against stiffened, and against the independent nonlinear code of errata.md: -0.1464 mm and 0.0293 mm."""
    settings = ("solve.preset=coupled",)
    coupled, one_way = run("engine", *settings).series, run("engine").series
    assert coupled["tip_axial"].values.min() == pytest.approx(-0.1464e-3, abs=1e-7)
    assert coupled["mid_transverse"].values.max() == pytest.approx(0.0293e-3, abs=1e-7)
    alike(coupled, one_way, {"tip_axial": 2e-3, "mid_transverse": 2e-3, "crank_torque": 3e-3, "mid_axial": 5e-3})
    alike(coupled, one_way, 5e-3, ("rod_force_piston", "rod_mid_force", "piston_side_force", "crank_pin_force_x"))


@pytest.mark.parametrize("start", ["periodic", "quasistatic"])
def test_a_mode_that_only_turns_the_nodes_counts_like_others(start):
    """The fourth mode between two pins has its nodes where four elements have theirs, where nothing is displaced."""
    found = run("engine", "solve.preset=coupled", "solve.modes=4", f"solve.start={start}", "solve.steps=360")
    assert found.message == "completed"
    shapes = found.model.coupled.shapes["rod"].basis
    turns, moves = shapes[2::3], shapes[1::3]
    only_turning = abs(moves).max(axis=0) < 1e-6 * abs(turns).max(axis=0)
    assert list(abs(turns[:, only_turning]).max(axis=0) * found.model.scene.bodies["rod"].length) == pytest.approx([1])


def test_joint_forces_balance_the_piston():
    """m a = gas + wrist force: multipliers against the accelerations and the gas table."""
    solution = run("engine", "solve.preset=coupled")
    motion = solution.motion.moving
    mass = solution.model.scene.bodies["piston"].mass
    a_x = motion.body("piston")[2][0]
    gap = mass * a_x + solution.rigid["gas"] - motion["wrist.force_x"]
    assert abs(gap).max() < 1e-6 * abs(mass * a_x).max()


def test_an_undamped_pendulum_keeps_its_energy():
    """A hundred swings and more, at a looser tolerance than the default."""
    settings = ["solve.duration=180 s", "solve.steps=18000", "solve.tolerance=1e-6"]
    solution = run("elastic-pendulum", *settings)
    crossings = np.diff(np.sign(solution.series["angle"].values + np.pi / 2)) != 0
    assert crossings.sum() >= 199
    assert solution.trajectory.energy.drift <= 1e-7


def test_the_balance_closes_with_damping_and_a_motor():
    energy = run("four-bar-motor").trajectory.energy
    assert energy.dissipated[-1] > 1e-5 * energy.supplied[-1] > 0
    assert energy.drift < 1e-6


def test_the_engine_turned_by_its_gas_and_motor():
    """Both ways against one way: the rods' inertia is in both, so the speeds differ by what the deformation stores."""
    both = run("engine-torque-elastic").series["crank_speed"].values
    one_way = run("engine-torque", "solve.duration=0.1 s", "solve.steps=2000").series["crank_speed"].values
    assert abs(both - one_way).max() < 2e-3 * one_way.max()
    assert abs(both - one_way).max() > 1e-6 * one_way.max()


CART = machine(
    description="A cart with a mast, pushed along its rail",
    bodies=dict(cart='mass = "2 kg"',
                mast='length = "0.5 m", '
                     'beam = {material = "steel", section = {rectangle = ["2 mm", "20 mm"]}, elements = 6}'),
    joints=dict(rail="prismatic ground cart, direction = [1, 0]",
                foot='weld cart mast.start, relative_angle = "90 deg"'),
    drives=dict(rail="free = true"), loads=dict(push='force_on = "cart", direction = [1, 0], law = "3 * sin(20 * t)"'),
    sensors=dict(slide="position rail", tip="displacement mast.end y"),
    solve=dict(preset="coupled", duration="0.5 s", steps=1000),
)


def test_a_pushed_cart_and_its_mast_take_up_the_impulse():
    """Momentum of cart and mast against the integral of the force; the mast's from its nodes by Simpson's rule."""
    solution = solved(scene_of(CART))
    motion, mast = solution.motion.moving, solution.model.links["mast"]
    v_x = np.array([motion.moving_place("mast", (node, 0.0))[1][0] for node in mast.nodes])
    weights = np.array([1, 4, 2, 4, 2, 4, 1]) / 18
    momentum = 2.0 * motion.body("cart")[1][0] + 7850.0 * 40e-6 * 0.5 * weights @ v_x
    impulse = 3 / 20 * (1 - np.cos(20 * solution.times))
    assert len(mast.nodes) == 7
    assert abs(momentum - impulse).max() < 1e-4 * impulse.max()
    assert solution.trajectory.energy.drift < 1e-7
    assert abs(solution.series["tip"].values).max() > 1e-4
    assert solution.series["slide"].values == pytest.approx(motion.body("cart")[0][0], abs=1e-12)


def test_the_order_of_bodies_does_not_matter():
    scene = read_scene("four-bar-motor")
    turned = scene.model_copy(update={"bodies": dict(reversed(scene.bodies.items()))})
    settings = ["solve.duration=0.1 s", "solve.steps=400"]
    first, second = (solved(s, *settings) for s in (scene, turned))
    alike(second, first, 1e-9)


def test_starts():
    """From equilibrium there is less to ring than from the undeformed state; the periodic state repeats."""
    bow = {}
    for start in ("zero", "quasistatic", "periodic"):
        bow[start] = run("four-bar", "solve.preset=coupled", f"solve.start={start}").series["follower_mid"].values
    assert bow["zero"][0] == pytest.approx(0.0, abs=1e-9)
    assert abs(bow["periodic"][-1] - bow["periodic"][0]) < 1e-3 * abs(bow["periodic"]).max()
    ringing = {start: abs(bow[start] - bow["periodic"]).max() for start in ("zero", "quasistatic")}
    assert ringing["quasistatic"] < ringing["zero"]


SPRINGS = """
springs.back = {between = ["ground.wall", "cart"], stiffness = "2 kN/m", length = "1 m", damping = "4 N s/m"}
ground.wall = ["-1 m", 0]
"""


def test_a_spring_and_its_damper_hold_the_cart():
    """Tension k (L - L_0) + c L' of the cart's own slide, the cart's balance of forces, and that of the energy."""
    solution = solved(scene_of(CART + 'sensors.pull = {spring_force = "back"}' + SPRINGS))
    motion = solution.motion.moving
    slide, speed, accel = (part[0] for part in motion.body("cart"))
    pull = solution.series["pull"].values
    assert pull == pytest.approx(2000 * slide + 4 * speed, abs=1e-9)
    foot = motion["foot.force_x"]
    assert 2.0 * accel == pytest.approx(3 * np.sin(20 * solution.times) - pull - foot, abs=1e-7)
    energy = solution.energy
    assert energy.dissipated[-1] > 1e-3 * energy.strain.max() > 0
    assert energy.drift < 1e-6


@pytest.mark.parametrize(("name", "settings", "message"), [
    ("engine", ["solve.terms.spin=false"],
     "solve.terms.spin = False: preset coupled cannot leave terms out. Use preset stiffened."),
    ("engine", ["solve.integrator=newmark"],
     "solve.integrator = 'newmark': this integrator is for equations that are linear in the displacements. "
     "Use radau or gauss under preset coupled."),
    ("engine", ["solve.modes=90"],
     "solve.modes = 90: the coupled equations take up to 8 fixed-interface modes of rod. Use fewer modes, or "
     "more elements."),
    ("free-frame", [],
     "solve.preset = 'coupled': preset coupled supports poses only if all joints are welds. "
     "Use preset stiffened, or leave the poses out and hold every body by joints and drives."),
    ("engine-paper", [],
     "joints.pin.rotation = 'shared': only one-way presets have this choice. "
     "Leave rotation out, or use preset stiffened."),
    ("elastic-pendulum", ["solve.start=quasistatic"],
     "solve.start = 'quasistatic': hinge is free and has no equilibrium. Start from zero."),
])  # fmt: skip
def test_what_it_refuses(name, settings, message):
    with pytest.raises(SceneError) as error:
        run(name, "solve.preset=coupled", *settings)
    assert str(error.value) == message
