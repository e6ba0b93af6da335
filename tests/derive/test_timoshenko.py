"""Rayleigh and Timoshenko elements: interpolation, frequencies of deep beams, balance of rotary inertia."""

import re

import closed_forms as by_hand
import numpy as np
import pytest
from machines import machine, on_supports
from runs import derived_on_the_fly
from sympy import Matrix

from kaneflex.derive.elements.shapes import (
    E_I,
    beam_section,
    beam_shape,
    length,
    phi_s,
    without_beta,
    x,
)
from kaneflex.fem.element_terms import shape_functions
from kaneflex.multibody.model.building import reference_modes
from kaneflex.solve.modes import mesh_hint, modes
from kaneflex.solve.simulation import solve


@pytest.mark.parametrize("growth", [0.0, 0.4])
@pytest.mark.parametrize("phi", [0.0, 0.7, 30.0])
def test_the_runtime_interpolates_by_the_derived_shape_functions(phi, growth):
    section = beam_section(rotary=True, varying=True)
    shape = beam_shape(section, shear=True)
    rows = without_beta(Matrix.vstack(shape.displacement, shape.rotation, shape.slope))
    stiff = {symbol.name: symbol for symbol in rows.free_symbols}
    values = {length: 0.3, phi_s: phi, E_I: 2.0, stiff["E_I_rise"]: 2.0 * growth}
    derived = np.array(rows.subs(values | {x: 0.11}).tolist(), float)
    assert shape_functions(0.11, 0.3, phi, growth) == pytest.approx(derived, abs=1e-14)


# ---- whole scenes -----------------------------------------------------------------------------------------------

# NAFEMS FV5 (Selected Benchmarks for Natural Frequency Analysis, 1987): length 10 m, square 2 m, simply supported.
# Frequencies [Hz] of the Timoshenko beam with kappa = 5/6, with rotary inertia alone and without either, computed
# from the closed solution for a pinned beam; those of NAFEMS, 42.65, 148.15 and 283.47, are for kappa = 0.85.
DEEP = on_supports(
    'length = "10 m", beam = {E = "200 GPa", rho = 8000, nu = 0.3, kappa = 0.8333333333333334, '
    'section = {rectangle = ["2 m", "2 m"]}, theory = "timoshenko", elements = 16}',
    solve={"preset": "quasistatic", "duration": "0.1 s"},
)
DEEP_HZ = {
    "timoshenko": [42.60871725394184, 147.78601200406814, 282.36338463546076],
    "rayleigh": [44.617002783170534, 170.50761831130924, 358.47138721891895],
    "euler-bernoulli": [45.344984105855445, 181.37993642342178, 408.10485695269904],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("deep")


@pytest.mark.parametrize("theory", DEEP_HZ)
def test_deep_simply_supported_beam(folder, theory):
    """FV5: three flexural frequencies to 5e-4 with 16 elements, and the axial ones 125 and 375 Hz."""
    model = derived_on_the_fly(DEEP, folder, f"beam.theory={theory}")
    found = reference_modes(model, 6)[0] / (2 * np.pi)
    axial = [np.abs(found - exact).argmin() for exact in (125.0, 375.0)]
    assert found[axial] == pytest.approx([125.0, 375.0], rel=4e-3)
    assert np.delete(found, axial)[:3] == pytest.approx(DEEP_HZ[theory], rel=5e-4)


def test_a_mesh_too_coarse_for_a_mode_is_named(folder):
    """FV5 with the default of 4 elements: the third flexural frequency, after the axial one the fourth of all."""
    coarse = derived_on_the_fly(DEEP.replace(", elements = 16", ""), folder)
    found = modes(coarse.scene, 6)
    assert found.frequencies[3] / DEEP_HZ["timoshenko"][2] - 1 == pytest.approx(-0.018, abs=0.001)
    said = mesh_hint(found)
    assert re.fullmatch(r"mode 4 changes by 1\.\d% with beam\.elements = 8: use more elements", said)
    fine = derived_on_the_fly(DEEP, folder)
    assert mesh_hint(modes(fine.scene, 4)) == ""


def test_the_shapes_own_shear_coefficient_is_that_of_the_published_values(folder):
    """Cowper's kappa = 0.8497 at nu = 0.3, against NAFEMS' 42.65, 148.15 and 283.47 Hz."""
    model = derived_on_the_fly(DEEP, folder, "beam.kappa=none")
    found = reference_modes(model, 5)[0] / (2 * np.pi)
    assert found[[0, 2, 3]] == pytest.approx([42.65, 148.15, 283.47], rel=5e-4)


PARAMETERS = ("rho_A", "E_A", "E_I", "length", "x_0")


@pytest.mark.parametrize(
    ("theory", "module"),
    [("euler-bernoulli", "euler_bernoulli"), ("rayleigh", "timoshenko"), ("timoshenko", "timoshenko")],
)
def test_a_uniform_euler_bernoulli_beam_reads_no_more_than_it_needs(folder, theory, module):
    """All others have the general element, which has each number of theirs."""
    found = derived_on_the_fly(DEEP, folder, f"beam.theory={theory}").module
    names = [name for name, *_ in found.ELEMENT_PARAMETERS]
    assert tuple(names) == PARAMETERS or (theory != "euler-bernoulli" and {"rho_I", "phi_s", "m_0"} <= {*names})
    assert found.M.__module__ == f"kaneflex.generated.beam_{module}"


SWINGING = machine(
    gravity=[0, -9.81],
    bodies=dict(thick='length = "0.5 m", beam.material = "steel", beam.section = {rectangle = ["100 mm", "20 mm"]}, '
                      'beam.theory = "timoshenko", beam.elements = 3',
                thin='length = "0.8 m", '
                     'beam = {material = "aluminium", section = {tube = ["30 mm", "2 mm"]}, elements = 3}'),
    joints=dict(hub="revolute ground thick.start", elbow="weld thick.end thin.start"),
    drives=dict(hub='law = "1.2*sin(20*t)", period = "0.3141592653589793 s"'),
    sensors=dict(torque="drive_torque hub", elbow_x="joint_force elbow x", elbow_moment="joint_force elbow angle"),
    solve='preset = "quasistatic"',
)


@pytest.fixture(scope="module")
def swinging(tmp_path_factory):
    return derived_on_the_fly(SWINGING, tmp_path_factory.mktemp("swinging"))


def test_links_of_different_theory_share_a_module(swinging):
    """The thin link is the Euler-Bernoulli limit of the module's element."""
    thick, thin = (swinging.links[name].parameters for name in ("thick", "thin"))
    assert (thin["phi_s"] == 0).all() and (thin["rho_I"] == 0).all()
    assert (thick["phi_s"] > 0).all() and (thick["rho_I"] > 0).all()
    section = thin["rho_A"][0], thin["E_I"][0], thin["length"][0]
    found = np.zeros((6, 6))
    p = np.array([thin[name][0] for name, *_ in swinging.module.ELEMENT_PARAMETERS])
    swinging.module.M(p, found)
    assert found == pytest.approx(by_hand.mass(section[0], section[2]), rel=1e-12, abs=1e-15)
    found[:] = 0
    swinging.module.K_s(p, found)
    expected = by_hand.stiffness(thin["E_A"][0], section[1], section[2])
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-6)


def test_elastic_forces_balance_the_rigid_ones_with_rotary_inertia(swinging):
    """Both stages know rho_I: reactions from the elements' residuals differ by the deformation's small share only."""

    series = solve(swinging).series
    for name in ("torque", "elbow_x", "elbow_moment"):
        found, rigid = series[name].values, series[f"{name}_rigid"].values
        assert np.abs(found - rigid).max() < 0.01 * np.abs(rigid).max(), name
    body = swinging.scene.bodies["thick"]
    slender = body.mass * body.length**2 / 12
    assert body.inertia == pytest.approx(slender * (1 + (0.1 / 0.5) ** 2), rel=1e-12)
