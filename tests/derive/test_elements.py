"""Kernels of every beam element in the plane and in space against quadrature by hand."""

import importlib
import os
import subprocess
import sys

import numpy as np
import pytest
import quadrature
import sympy as sm
from closed_forms import BENDING
from interpreted import every_kernel, interpreted
from quadrature import Y_PLANE
from sympy import Matrix, Symbol, integrate, srepr, symbols
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, dynamicsymbols

import kaneflex
from kaneflex.derive.elements import slice as beam_slice
from kaneflex.derive.elements.beam import a_x, a_y, beam_element, epsilon, omega
from kaneflex.derive.elements.shapes import beam_section, beam_shape, integral, length, rho_A, x, x_0
from kaneflex.support.contract import beam_module

SIZES = {
    "rho_A": 1.1, "rho_I_y": 4e-5, "rho_I_z": 9e-5, "E_I_y": 1.5e3, "E_I_z": 3e3, "E_A": 3e7, "G_J": 800.0,
    "I_p_A": 1.2e-4, "length": 0.3, "x_0": 0.6, "rho_A_rise": 0.3, "rho_I_y_rise": 1e-5, "rho_I_z_rise": 2e-5,
    "E_I_y_rise": 400.0, "E_I_z_rise": 700.0, "m_0": 0.4, "S_0": 0.1, "phi_y": 0.3, "phi_z": 0.7,
}  # fmt: skip


def module(name):
    return importlib.import_module(f"kaneflex.generated.{name}")


def numbers(seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters by name, and scalars of a motion about all axes."""
    rng = np.random.default_rng(seed)
    parameters = {name: size * rng.uniform(0.5, 1.5) for name, size in SIZES.items()} | {"rotary": 1.0}
    sizes = 3 * [60.0] + 3 * [2e3] + 3 * [300.0] + [4e3]
    scalars = [name for name, *_ in module("spatial_beam_timoshenko").LINK_SCALARS]
    return parameters, {name: size * rng.uniform(-1, 1) for name, size in zip(scalars, sizes, strict=True)}


def uniform(p: dict[str, float]) -> dict[str, float]:
    """The same without growth of the section, and of the link before the element as well."""
    p = p | {key: 0.0 for key in p if key.endswith("_rise")}
    return p | {"m_0": p["rho_A"] * p["x_0"], "S_0": p["rho_A"] * p["x_0"] ** 2 / 2}


def computed(name: str, parameters: dict[str, float], scalars: dict[str, float]) -> dict[str, np.ndarray]:
    """Every kernel of a module."""
    found = interpreted(module(name))
    p = np.array([parameters.get(key, 0.0) for key, *_ in found.ELEMENT_PARAMETERS])
    return every_kernel(found, p, np.array([scalars.get(key, 0.0) for key, *_ in found.LINK_SCALARS]))


def assert_equal(found, expected, tolerance=1e-13):
    scale = abs(np.asarray(expected)).max()
    assert scale > 0
    assert abs(found - expected).max() <= tolerance * scale


def components(scalars, letter):
    return np.array([scalars[f"{letter}_{axis}"] for axis in "xyz"])


# ---- the slice --------------------------------------------------------------------------------------------------


def test_section_rotation_is_a_rotation_to_second_order():
    theta, small = sm.symbols("theta_x theta_y theta_z"), sm.Symbol("small")

    def second_order(matrix):
        powers = matrix.xreplace({angle: small * angle for angle in theta}).expand()
        return powers.applyfunc(lambda entry: sum(entry.coeff(small, k) for k in range(3)))

    R = beam_slice.section_rotation(*theta)
    assert (second_order(R * R.T) - sm.eye(3)).is_zero_matrix
    # the tangent of the axis stays (1, v', w') with theta_z = v', theta_y = -w', however the section is twisted
    tangent = second_order(R[:, 0])
    assert tangent[1] == theta[2] and tangent[2] == -theta[1]


# ---- kernels ----------------------------------------------------------------------------------------------------


PLANAR = {
    "rho_A": "rho_A", "E_A": "E_A", "E_I": "E_I_z", "length": "length", "x_0": "x_0", "rho_I": "rho_I_z",
    "phi_s": "phi_y", "rho_A_rise": "rho_A_rise", "E_I_rise": "E_I_z_rise", "rho_I_rise": "rho_I_z_rise",
    "m_0": "m_0", "S_0": "S_0",
}  # fmt: skip
TURNING = ("rho_I", "rho_I_rise", "phi_s")
"""What a planar Euler-Bernoulli element has not."""


def test_checked_kernels_want_twelve_coordinates():
    found = module("spatial_beam_euler_bernoulli")
    p, out = np.ones(len(found.ELEMENT_PARAMETERS)), np.zeros((12, 12))
    safe = kaneflex.checked(found)
    safe.M(p, out)
    found.M(p, expected := np.zeros((12, 12)))
    assert_equal(out, expected)
    with pytest.raises(ValueError, match=r"M: out has shape \(6, 6\), \(12, 12\) is required"):
        safe.M(p, np.zeros((6, 6)))


def parameters_of(seed, shear, varying):
    """Numbers of an element, of a section that grows only if `varying`, flexible in shear only if `shear`."""
    p, s = numbers(seed)
    p = p if varying else uniform(p)
    if not shear:
        p |= {"phi_y": 0.0, "phi_z": 0.0}
    return p, s


def assert_same(found, expected):
    """Every entry to 1e-12 of itself; 1e-15 of the largest one is rounding."""
    assert found.keys() == expected.keys()
    for kernel, matrix in expected.items():
        assert abs(matrix).max() > 0
        np.testing.assert_allclose(found[kernel], matrix, rtol=1e-12, atol=1e-15 * abs(matrix).max(), err_msg=kernel)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize(("rotary", "shear"), [(False, False), (True, False), (False, True), (True, True)])
def test_spatial_elements_by_quadrature(rotary, shear, varying, seed):
    """Every entry of M, K_s, K_d, K_g, C and F under a motion about all axes."""
    p, s = parameters_of(seed, shear, varying)
    p["rotary"] = float(rotary)
    motion = (*(components(s, letter) for letter in ("omega", "epsilon", "a")), s["P_0"])
    expected = quadrature.element(p, *motion, turning=(True, rotary, rotary))
    assert_same(computed(f"spatial_{beam_module(rotary, shear, varying)}", p, s), expected)
    if not (rotary or shear or varying):  # the general element has the uniform one as its limit
        assert_same(computed("spatial_beam_timoshenko", p, s), expected)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize(("rotary", "shear"), [(False, False), (True, False), (True, True)])
def test_planar_elements_by_quadrature(rotary, shear, varying, seed):
    """The rows u, v, theta_z of the same integrals under a motion in the plane."""
    p, s = parameters_of(seed, shear, varying)
    s |= dict.fromkeys(("omega_x", "omega_y", "epsilon_x", "epsilon_y", "a_z"), 0.0)
    motion = (*(components(s, letter) for letter in ("omega", "epsilon", "a")), s["P_0"])
    whole, rows = quadrature.element(p, *motion, turning=(False, False, rotary)), Y_PLANE.T
    expected = {kernel: rows @ of if kernel == "F" else rows @ of @ rows.T for kernel, of in whole.items()}
    of_plane = {name: p[of] for name, of in PLANAR.items() if rotary or name not in TURNING}
    of_plane |= {"E_A_rise": p["E_A"] / 3 * varying}
    scalars = {"omega": s["omega_z"], "epsilon": s["epsilon_z"], "a_x": s["a_x"], "a_y": s["a_y"], "P_0": s["P_0"]}
    assert_same(computed(beam_module(rotary, shear, varying), of_plane, scalars), expected)


def test_damping_by_length_is_the_mass_of_translation():
    terms = {term.name: term.matrix for term in beam_element().terms}
    assert (terms["viscous"] * rho_A + terms["spin"]).expand().is_zero_matrix


# ---- the tension's stiffness by Kane's method alone -------------------------------------------------------------


def kane_rows(position, speeds, coordinates, mass, motion):
    """fr* of a point mass at `position` (link axes) in a frame whose motion is prescribed."""
    inertial, link = ReferenceFrame("inertial"), ReferenceFrame("link")
    origin, point = Point("origin"), Point("point")
    link.set_ang_vel(inertial, motion["w"] * link.z)
    origin.set_vel(inertial, motion["v_x"] * link.x + motion["v_y"] * link.y)
    time = dynamicsymbols._t
    kinematics = [q.diff(time) - u for q, u in zip(coordinates, speeds, strict=True)]
    rates = dict(zip([q.diff(time) for q in coordinates], speeds, strict=True))
    point.set_pos(origin, position[0] * link.x + position[1] * link.y)
    velocity = [part.diff(time).xreplace(rates) for part in position]
    point.set_vel(link, velocity[0] * link.x + velocity[1] * link.y)
    point.v1pt_theory(origin, inertial, link)
    kane = KanesMethod(inertial, q_ind=coordinates, u_ind=speeds, kd_eqs=kinematics)
    return kane.kanes_equations([Particle("particle", point, mass)])[1]


def foreshortened_free_tip() -> Matrix:
    """K_g on (v1, th1, v2, th2) of a one-element link with a free tip, from Kane alone.

    The foreshortening -1/2 int_0^x v'^2 = -1/2 q^T H q stays in the position of the particle at x, and the
    equations are linearised only after the partial velocities are formed (Kane, Ryan and Banerjee 1987, J.
    Guidance 10, 139-151). What they then hold beside those of the straight position is K_g q.
    """
    time = dynamicsymbols._t
    q, u = Matrix(dynamicsymbols("q_1:5")), Matrix(dynamicsymbols("u_1:5"))
    v_x, v_y, w = dynamicsymbols("v_x v_y w")
    motion = {"v_x": v_x, "v_y": v_y, "w": w}
    N = Matrix(symbols("N_1:5")).T
    H = Matrix(4, 4, lambda i, j: Symbol(f"H_{min(i, j)}{max(i, j)}"))
    straight = kane_rows((x, (N * q)[0]), list(u), list(q), rho_A, motion)
    bent = kane_rows((x - (q.T * H * q)[0] / 2, (N * q)[0]), list(u), list(q), rho_A, motion)

    difference = (straight - bent).xreplace({v_x.diff(time): a_x + w * v_y, v_y.diff(time): a_y - w * v_x})
    difference = difference.xreplace({w.diff(time): epsilon, w: omega})
    at_rest = dict.fromkeys([*q, *u, *u.diff(time)], 0)
    assert difference.jacobian(u.col_join(u.diff(time))).xreplace(at_rest).is_zero_matrix
    slope = beam_shape(beam_section()).slope[:, BENDING]
    shortening = (slope.T * slope).applyfunc(lambda entry: integrate(entry.expand(), (x, 0, x)))
    per_length = difference.jacobian(q).xreplace(at_rest).xreplace(dict(zip(H, shortening, strict=True)))
    return per_length.applyfunc(integral)


def test_foreshortening_in_kane_gives_the_geometric_stiffness():
    """The free tip: P_0 = -rho_A a_x l + rho_A omega^2 l^2/2, x_0 = 0."""
    matrices = {term.name: term.matrix for term in beam_element().terms}
    P_0_free_tip = -rho_A * a_x * length + rho_A * omega**2 * length**2 / 2
    K_g = (
        P_0_free_tip * matrices["tension_origin"]
        + a_x * matrices["tension_acceleration"]
        + omega**2 * matrices["tension_spin"]
    )
    expected = K_g.extract(BENDING, BENDING).subs(x_0, 0)
    assert (foreshortened_free_tip() - expected).expand().is_zero_matrix


def test_derivation_is_the_same_for_every_hash_seed():
    """For this process' seed, which is drawn, and for 0, by which none is."""
    code = (
        "from sympy import srepr; from kaneflex.derive.elements.beam import beam_element; e = beam_element();"
        "print([(t.name, srepr(t.scalar), srepr(t.matrix)) for t in e.terms])"
    )
    environment = os.environ | {"PYTHONHASHSEED": "0"}
    command = [sys.executable, "-c", code]
    other = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
    here = str([(t.name, srepr(t.scalar), srepr(t.matrix)) for t in beam_element().terms])
    assert len(here) > 1000 and other == here + "\n"
