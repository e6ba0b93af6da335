"""The coupled equations as a state space: beside the one-way equations where these are right, and beyond them."""

import json

import numpy as np
import pytest
from command_line import cli

import kaneflex
from kaneflex.scene import read_scene, with_settings


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
