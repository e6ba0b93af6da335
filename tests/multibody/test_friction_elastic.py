"""Friction beside elastic links: a slider-crank all of whose joints rub, and a block at the tip of a beam."""

import numpy as np
import pytest
from machines import machine
from runs import names_of
from test_friction import CRANK, solved

STEEL = 'beam = {section = {circle = "10 mm"}, E = "210 GPa", rho = "7850 kg/m^3", elements = 4}'
MASS = 7850 * np.pi * 0.005**2 * 0.3
RIGID = f'rod = {{length = "0.3 m", mass = {MASS}, inertia = {MASS * 0.09 / 12}, centre = [0.15, 0]}}'
OLD = 'rod = {length = "0.3 m", mass = "0.5 kg", inertia = "4e-3 kg m^2", centre = [0.15, 0]}'
ELASTIC = CRANK.replace(OLD, f'rod = {{length = "0.3 m", {STEEL}}}').replace("initial_speed = 20", "initial_speed = 40")
DAMPED = ELASTIC + "damping.modal.ratio = 0.01\n"
SHORT = "solve.duration=0.5 s", "solve.steps=500"


def test_an_ever_stiffer_rod_comes_to_the_rigid_one_with_all_that_rubs():
    """As its deformation does, with 1/E: 10^4 times as stiff, the crank has run down as with a rigid one."""
    rigid = solved(ELASTIC.replace(f'rod = {{length = "0.3 m", {STEEL}}}', RIGID), *SHORT)
    missed = []
    for E in (2.1e5, 2.1e6):
        stiff = solved(DAMPED, f'rod.E="{E} GPa"', *SHORT)
        missed.append(abs(stiff.series["angle"].values - rigid.series["angle"].values).max())
        assert stiff.trajectory.frictions.lost[-1] == pytest.approx(rigid.trajectory.frictions.lost[-1], rel=100 / E)
    assert missed[0] < 4e-4 and missed[1] < 5e-6


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("integrator", ["gauss", "radau"])
def test_an_elastic_rod_without_damping_lets_its_joints_stick_and_slip(integrator):
    """It vibrates through every dead centre, where pins turn to and fro; forces keep to the law, energy to its sum."""
    shorter = "solve.duration=0.3 s", "solve.steps=300"
    found = solved(ELASTIC, *shorter, f"solve.integrator={integrator}", "solve.tolerance=1e-10")
    record = found.trajectory.frictions
    limit, sliding = record.pressed * np.array([0.1, 0.1, 0.1, 0.15]), abs(record.speed) > 1e-9
    assert abs(record.force)[sliding] == pytest.approx(limit[sliding], rel=1e-9)
    assert (record.force * record.speed <= 0)[sliding].all()
    crank = found.trajectory.v[:, names_of(found.model.coupled).index("crank.phi")]
    assert crank[0] == pytest.approx(40) and crank[-1] < 35
    assert record.lost[-1].sum() == pytest.approx(found.trajectory.energy.dissipated[-1], rel=1e-12)


def test_stiff_bristles_regularise_the_same_motion():
    """Another law and other equations, without events: the same run, next to what bristles bend."""
    short = "solve.duration=0.05 s", "solve.steps=100"
    dry, missed = solved(DAMPED, *short), []
    for size in (1e3, 1e5):
        text = DAMPED.replace("friction = {", f'friction = {{law = "lugre", bristle_stiffness = {size}, ')
        found = solved(text, "bore.friction.bristle_stiffness=1e8", "solve.tolerance=1e-11", *short)
        missed.append(abs(found.series["angle"].values - dry.series["angle"].values).max())
    assert 1e-5 < missed[0] < 1e-4 and missed[1] < 1e-5


TIP = """
schema = 1
description = "A block in a slot at the tip of a cantilever, which is let go and swings down"
gravity = [0, "-9.81 m/s^2"]
bodies.beam = {length = "1 m", beam = {section = {rectangle = ["20 mm", "10 mm"]}, material = "steel", elements = 4}}
bodies.shoe = {mass = "0.2 kg", inertia = "1e-4 kg m^2"}
bodies.block = {mass = "1 kg", inertia = "1e-3 kg m^2"}
joints.root = {weld = ["ground", "beam"]}
joints.tip = {weld = ["beam.end", "shoe"]}
joints.slot = {prismatic = ["shoe", "block"], direction = [1, 0], friction = {FRICTION}}
drives.slot = {free = true}
sensors.way = {position = "slot"}
sensors.drop = {position = "beam.end", component = "y"}
sensors.drag = {friction_force = "slot"}
solve = {preset = "coupled", duration = "0.3 s", steps = 300, start = "zero"}
"""


def test_a_block_that_is_stuck_at_the_tip_of_a_beam_vibrates_with_it_as_if_it_were_welded():
    found = solved(TIP.replace("FRICTION", 'preload = "20 N"'))
    welded = TIP.replace('{prismatic = ["shoe", "block"], direction = [1, 0], friction = {FRICTION}}',
                         '{weld = ["shoe", "block"]}').replace("drives.slot = {free = true}\n", "")  # fmt: skip
    for line in ('sensors.way = {position = "slot"}\n', 'sensors.drag = {friction_force = "slot"}\n'):
        welded = welded.replace(line, "")
    other = solved(welded)
    drop = other.series["drop"].values
    assert np.ptp(drop) > 0.005 and abs(found.series["drop"].values - drop).max() < 1e-8
    assert abs(found.series["way"].values).max() < 1e-12
    record = found.trajectory.frictions
    assert (record.mode == 2).all() and record.lost[-1, 0] == 0.0


def test_a_block_on_a_beam_slides_where_it_is_too_steep_for_it():
    """The tip's slope comes to 0.012: a coefficient of 0.1 holds all but its first shocks, 0.001 next to nothing."""
    ways = []
    for mu in (0.1, 0.001):
        found = solved(TIP.replace("FRICTION", f"mu = {mu}"))
        record = found.trajectory.frictions
        sliding = record.mode[:, 0] != 2
        assert abs(record.force)[sliding] == pytest.approx(mu * record.pressed[sliding], rel=1e-9)
        assert (abs(record.force) <= mu * record.pressed * (1 + 1e-9)).all()
        ways.append(abs(found.series["way"].values).max())
    assert ways[0] < 1e-6 and ways[1] > 1e-3


WIPER = machine(
    gravity=[0, "-9.81 m/s^2"], ground=dict(pivot=["250 mm", "30 mm"]),
    bodies=dict(crank='length = "45 mm", mass = "0.15 kg"', rocker='length = "70 mm", mass = "0.2 kg"',
                arm='length = "500 mm", beam = {material = "steel", section = {rectangle = ["16 mm", "4 mm"]}}',
                coupler='length = "240 mm", beam = {material = "steel", section = {tube = ["12 mm", "1.5 mm"]}}, '
                        'points = {quarter = ["60 mm", 0]}'),
    joints=dict(motor="revolute ground crank.start", pin="revolute crank.end coupler.start",
                pivot='revolute ground.pivot rocker.start, friction = {preload = "2.5 N m"}',
                ball='revolute coupler.end rocker.end, branch = "+"',
                spindle='weld rocker.start arm.start, relative_angle = "90 deg"'),
    masses=dict(blade='at = "arm.end", mass = "0.35 kg"'), drives=dict(motor='speed = "45 rpm", cycle = "360 deg"'),
    damping=dict(rayleigh=dict(ratio="2 %", at=["5 Hz", "200 Hz"])), sensors=dict(shear="shear_force coupler.quarter"),
    solve=dict(preset="coupled", start="periodic"),
)


def test_a_rocker_that_sticks_while_the_crank_turns_does_not_bend_the_coupler():
    """The coupler is compressed meanwhile, by a few micrometres; its shear comes from its inertia alone."""
    found = solved(WIPER)
    stuck = found.trajectory.frictions.mode[:, 0] == 2
    shear = abs(found.series["shear"].values)
    assert stuck.any() and not stuck.all()
    assert shear[stuck].max() < 1.5 * shear[~stuck].max()
