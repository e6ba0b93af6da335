"""Kernels of every beam element, in the plane and in space, against quadrature of integrands written by hand."""

import closed_forms_spatial as by_hand
import numpy as np
import pytest
import quadrature
from test_spatial_element import PLANAR, TURNING, components, computed, numbers, uniform

from kaneflex.support.contract import beam_module
from kaneflex.support.spatial_contract import SPATIAL_BEAMS


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
@pytest.mark.parametrize(
    ("name", "varying"),
    [(name, of) for name, options in SPATIAL_BEAMS.items() for of in {False, options["varying"]}],
)
def test_spatial_elements_by_quadrature(name, varying, seed):
    """Every entry of M, K_s, K_d, K_g, C and F under a motion about all axes."""
    shear = SPATIAL_BEAMS[name]["shear"]
    p, s = parameters_of(seed, shear, varying)
    motion = (*(components(s, letter) for letter in ("omega", "epsilon", "a")), s["P_0"])
    expected = quadrature.element(p, *motion, turning=(True, shear, shear))
    assert_same(computed(name, p, s), expected)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize(("rotary", "shear"), [(False, False), (True, False), (True, True)])
def test_planar_elements_by_quadrature(rotary, shear, varying, seed):
    """The rows u, v, theta_z of the same integrals under a motion in the plane."""
    p, s = parameters_of(seed, shear, varying)
    s |= dict.fromkeys(("omega_x", "omega_y", "epsilon_x", "epsilon_y", "a_z"), 0.0)
    motion = (*(components(s, letter) for letter in ("omega", "epsilon", "a")), s["P_0"])
    whole, rows = quadrature.element(p, *motion, turning=(False, False, rotary)), by_hand.Y_PLANE.T
    expected = {kernel: rows @ of if kernel == "F" else rows @ of @ rows.T for kernel, of in whole.items()}
    of_plane = {name: p[of] for name, of in PLANAR.items() if rotary or name not in TURNING}
    of_plane |= {"E_A_rise": p["E_A"] / 3 * varying}
    scalars = {"omega": s["omega_z"], "epsilon": s["epsilon_z"], "a_x": s["a_x"], "a_y": s["a_y"], "P_0": s["P_0"]}
    assert_same(computed(beam_module(rotary, shear, varying), of_plane, scalars), expected)


@pytest.mark.parametrize("wrong", ["E_I_z_rise", "rho_A_rise", "rho_I_y_rise", "m_0", "S_0", "phi_z", "I_p_A"])
def test_a_number_off_by_a_millionth_is_seen(wrong):
    name = "spatial_beam_timoshenko"
    p, s = parameters_of(0, shear=True, varying=True)
    motion = (*(components(s, letter) for letter in ("omega", "epsilon", "a")), s["P_0"])
    expected = quadrature.element(p | {wrong: p[wrong] * (1 + 1e-6)}, *motion, turning=(True, True, True))
    with pytest.raises(AssertionError):
        assert_same(computed(name, p, s), expected)
