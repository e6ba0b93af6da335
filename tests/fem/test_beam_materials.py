"""Beams of several materials, and with linear A and I: sums, frequencies, deflections against independent solves."""

import math

import numpy as np
import pytest
from machines import cantilever
from runs import derived_on_the_fly
from scipy.optimize import brentq

from kaneflex import SceneError, scene_of
from kaneflex.multibody.model.building import reference_modes
from kaneflex.solve.simulation import solve


def loaded(beam, more=""):
    """A cantilever of this beam under a force at its tip."""
    return cantilever(
        f'length = "1 m", {more}beam = {{{beam}, elements = 24}}', "arm", "clamp",
        loads='tip = {force_on = "arm.end", direction = [0, 1], value = "10 N"}',
        sensors="""
tip = {displacement = "arm.end", component = "y"}
mid = {displacement = "arm.mid", component = "y"}""",
        solve={"preset": "quasistatic", "duration": "0.1 s"},
    )
STEP = 0.4
E, RHO = (2.1e11, 7.0e10), (7850.0, 2700.0)
A, I = 2e-4, 0.01 * 0.02**3 / 12
SHAFT = (
    'material = "steel", segments = {root = {to = 0.4, section = {rectangle = [0.02, 0.01]}}, '
    'tip = {material = "aluminium", section = {rectangle = [0.02, 0.01]}}}'
)


def arm(beam):
    return scene_of(loaded(beam)).bodies["arm"]


@pytest.fixture(scope="module")
def shaft(tmp_path_factory):
    return derived_on_the_fly(loaded(SHAFT), tmp_path_factory.mktemp("shaft"))


def test_mass_and_inertia_are_the_sums_of_both_materials(shaft):
    body = shaft.scene.bodies["arm"]
    moments = [A * (RHO[0] * STEP**k + RHO[1] * (1 - STEP**k)) / k for k in (1, 2, 3)]  # int rho A x^(k - 1) dx
    found = body.profile.inertia(1.0)
    assert (found.mass, found.first, found.second) == pytest.approx(moments, rel=1e-12)
    assert body.mass == pytest.approx(moments[0], rel=1e-12)
    assert body.profile.at(0.7).E_I_z == pytest.approx(E[1] * I, rel=1e-12)


def axial(omega: float) -> float:
    """Clamped, free: the axial force at the end of two uniform bars in line, by transfer matrices of (u, N)."""
    state = np.array([0.0, 1.0])
    for e, rho, length in zip(E, RHO, (STEP, 1 - STEP), strict=True):
        k = omega * math.sqrt(rho / e)
        c, s = math.cos(k * length), math.sin(k * length)
        state = np.array([[c, s / (e * A * k)], [-e * A * k * s, c]]) @ state
    return state[1]


def bending(omega: float) -> float:
    """Clamped, free: the determinant of moment and shear at the end, transfer matrices by Krylov's functions."""
    total = np.eye(4)  # of (v, v', M / E_1 I, Q / E_1 I)
    for e, rho, length in zip(E, RHO, (STEP, 1 - STEP), strict=True):
        k = (rho * A * omega**2 / (e * I)) ** 0.25
        slope = np.zeros((4, 4))  # the state's derivative; its fourth power is k^4
        slope[0, 1] = slope[2, 3] = 1.0
        slope[1, 2], slope[3, 0] = E[0] / e, k**4 * e / E[0]
        x = k * length
        weights = (
            (math.cosh(x) + math.cos(x)) / 2,
            (math.sinh(x) + math.sin(x)) / (2 * k),
            (math.cosh(x) - math.cos(x)) / (2 * k**2),
            (math.sinh(x) - math.sin(x)) / (2 * k**3),
        )
        total = sum(w * np.linalg.matrix_power(slope, n) for n, w in enumerate(weights)) @ total
    return np.linalg.det(total[2:, 2:])


def roots(function, low: float, high: float) -> np.ndarray:
    grid = np.linspace(low, high, 4000)
    values = np.array([function(omega) for omega in grid])
    signs = np.flatnonzero(values[:-1] * values[1:] < 0)
    return np.array([brentq(function, grid[k], grid[k + 1], xtol=1e-10) for k in signs])


def test_frequencies_of_a_shaft_of_steel_and_aluminium(shaft):
    """Three in bending to 1e-5, two along to the order of linear elements: (k h)^2 / 24."""
    found = reference_modes(shaft, 20)[0]
    across, along = roots(bending, 1.0, 3000.0)[:3], roots(axial, 1.0, 30000.0)[:2]
    assert len(across) == 3 and len(along) == 2
    for expected, tolerance in [*((w, 1e-5) for w in across), *((w, 2e-3) for w in along)]:
        assert np.abs(found / expected - 1).min() < tolerance, expected


CONSTANTS = {
    "all the beam's": ("", (2.1e11, 7850.0, 2.1e11 / 2.6)),
    "another material": ('material = "aluminium", ', (7.0e10, 2700.0, 7.0e10 / 2.66)),
    "its own modulus": ("E = 1e11, ", (1e11, 7850.0, 1e11 / 2.6)),
    "its own shear modulus": ("G = 5e10, rho = 1000, ", (2.1e11, 1000.0, 5e10)),
    "its own Poisson's ratio": ("nu = 0.2, ", (2.1e11, 7850.0, 2.1e11 / 2.4)),
    "a material but for the density": ('material = "aluminium", rho = 3000, ', (7.0e10, 3000.0, 7.0e10 / 2.66)),
}


def planar(body, x):
    here = body.profile.at(x)
    return here.rho_A, here.E_A, here.E_I_z, here.rho_I_z, here.G_A_y


@pytest.mark.parametrize("case", CONSTANTS)
def test_a_segment_takes_from_the_beam_what_it_does_not_say(case):
    own, (E_1, rho, G) = CONSTANTS[case]
    section = "section = {rectangle = [0.02, 0.01]}, kappa = 0.8"
    segments = f"segments = {{a = {{to = 0.4, {section}}}, b = {{{own}{section}}}}}"
    body = arm(f'material = "steel", theory = "timoshenko", {segments}')
    assert planar(body, 0.2)[:3] == pytest.approx((7850 * A, 2.1e11 * A, 2.1e11 * I), rel=1e-12)
    expected = (rho * A, E_1 * A, E_1 * I, rho * I, 0.8 * G * A)
    assert planar(body, 0.7) == pytest.approx(expected, rel=1e-12)


def test_the_shear_coefficient_of_a_shape_takes_the_segments_own_ratio():
    """kappa G A of a rectangle, Cowper (1966): 10 (1 + nu)/(12 + 11 nu)."""
    section = "section = {rectangle = [0.02, 0.01]}"
    segments = f"segments = {{a = {{to = 0.4, {section}}}, b = {{nu = 0.2, {section}}}}}"
    body = arm(f'material = "steel", theory = "timoshenko", {segments}')
    assert body.profile.at(0.7).G_A_y == pytest.approx(12 / 14.2 * 2.1e11 / 2.4 * A, rel=1e-12)


def test_a_given_mass_keeps_the_ratio_of_the_densities():
    mass = A * (RHO[0] * STEP + RHO[1] * (1 - STEP))
    profile = scene_of(loaded(SHAFT, f"mass = {mass * (1 + 5e-7)!r}, ")).bodies["arm"].profile
    assert profile.inertia(1.0).mass == pytest.approx(mass * (1 + 5e-7), rel=1e-14)
    assert profile.at(0.1).rho_A / profile.at(0.9).rho_A == pytest.approx(RHO[0] / RHO[1], rel=1e-12)


# ---- A and I that change linearly ---------------------------------------------------------------------------------


def test_linear_section_numbers():
    body = arm('material = "steel", theory = "rayleigh", A = 4e-4, I = 9e-9, A_end = 1e-4')
    assert planar(body, 0.5) == pytest.approx((7850 * 2.5e-4, 2.1e11 * 2.5e-4, 2.1e11 * 9e-9, 7850 * 9e-9, math.inf))
    assert body.mass == pytest.approx(7850 * 2.5e-4, rel=1e-12)
    moments = (7850 * (4e-4 / k - 3e-4 / (k + 1)) for k in (1, 2, 3))
    assert body.profile.inertia(1.0)[:3] == pytest.approx(tuple(moments), rel=1e-12)
    assert body.beam.structure() == {"theory": "rayleigh", "varying": True}


def test_deflection_of_a_cantilever_with_linear_stiffness(tmp_path):
    """E I v'' = F (L - x), I = I_0 (1 - c x/L): v(L) = F L^3/(E I_0) int_0^1 (1 - s)^2/(1 - c s) ds, with
    the integral = (c (3 c - 2) / 2 - (1 - c)^2 ln(1 - c)) / c^3."""
    beam = 'material = "steel", A = "200 mm^2", I = "6000 mm^4", I_end = "1500 mm^4"'
    series = solve(derived_on_the_fly(loaded(beam), tmp_path)).series
    c = 0.75
    integral = (c * (3 * c - 2) / 2 - (1 - c) ** 2 * math.log(1 - c)) / c**3
    assert series["tip"].values == pytest.approx(10 / (2.1e11 * 6e-9) * integral, rel=2e-6)


BAD = {
    "an end without a start": ('material = "steel", I = 1e-9, I_end = 1e-9, A_end = 1e-4',
        "bodies.arm.beam.A_end = 0.0001: A is missing. Give A, too."),
    "an end of a shape": ('material = "steel", section = {circle = 0.01}, I_end = 1e-9',
        "bodies.arm.beam.I_end = 1e-09: the section's shape gives it already. Leave I_end out."),
    "an end beside segments": (
        'material = "steel", A = 1e-4, A_end = 1e-5, segments = {a = {section = {circle = 0.01}}}',
        "bodies.arm.beam.A = 0.0001: every segment gives its own. Leave A out, or the segments.",
    ),
    "a segment of nothing": (
        'segments = {a = {to = 0.5, material = "steel", section = {circle = 0.01}}, b = {section = {circle = 0.01}}}',
        "bodies.arm.beam.segments.b: neither a material nor both E and rho. "
        "Give material, one of steel, aluminium, titanium.",
    ),
    "a segment of an unknown material": (
        'material = "steel", segments = {a = {material = "stel", section = {circle = 0.01}}}',
        "bodies.arm.beam.segments.a.material = 'stel': unknown material. The nearest known one is 'steel'.",
    ),
    "a segment without shear modulus": (
        'theory = "timoshenko", segments = {a = {E = 1e11, rho = 1000, section = {circle = 0.01}}}',
        "bodies.arm.beam.theory = 'timoshenko': a Timoshenko beam needs a shear modulus. Give nu or G.",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_beams(case):
    beam, message = BAD[case]
    with pytest.raises(SceneError) as caught:
        arm(beam)
    assert str(caught.value).splitlines()[0] == message
