"""Kernels of a body in space that deforms: the printed loops are Kane's equations, whose energy has an integral."""

from pathlib import Path

import numpy as np
import pytest
import sympy as sm

from kaneflex.derive.body_proof import NotKane
from kaneflex.derive.spatial_shape_proof import comparisons, prove
from kaneflex.derive.spatial_shapes import ACCEL, EPSILON, OMEGA, coordinates, shaped_equations
from kaneflex.generated import spatial_shapes

TEXT = Path(spatial_shapes.__file__).read_text(encoding="utf-8")
PRINTED = "@njit" + TEXT.partition("@njit")[2].rpartition("\n\n@njit")[0]


def test_every_kernel_is_compared():
    assert {name for name, *_ in comparisons(PRINTED, 1)} == {"shaped_demand", "shaped_inertia"}


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("x1 = 2.0 * v_j", "x1 = v_j"),
        ("p[jl + 21] * q_l", "p[jl + 22] * q_l"),
        ("23 * (count * j + l)", "23 * (count * l + j)"),
        ("c1 = epsilon_z - omega_x * omega_y", "c1 = epsilon_z + omega_x * omega_y"),
    ],
)
def test_a_wrong_kernel_is_not_proved(right, wrong):
    assert right in PRINTED
    with pytest.raises(NotKane):
        prove(PRINTED.replace(right, wrong))


def test_what_forces_do_is_the_change_of_kinetic_energy():
    """u.(-fr*) = d/dt (u.M u / 2) along any motion: what the truncation keeps is a mechanical system."""
    equations = shaped_equations(2)
    q, rates, accelerations = zip(*map(coordinates, range(2)), strict=True)
    v = sm.symbols("v_x v_y v_z")
    M, u = equations.jacobian([*ACCEL, *EPSILON, *accelerations]), sm.Matrix([*v, *OMEGA, *rates])
    energy = (u.T * M * u)[0] / 2
    of_v = sm.Matrix(ACCEL) - sm.Matrix(OMEGA).cross(sm.Matrix(v))
    motion = zip([*v, *OMEGA, *rates, *q], [*of_v, *EPSILON, *accelerations, *rates], strict=True)
    change = sum(energy.diff(x) * rate for x, rate in motion)
    assert sm.expand((u.T * equations)[0] - change) == 0
    assert (M - M.T).expand() == sm.zeros(8, 8)


def test_a_section_turns_as_its_axes_say():
    """R is a rotation, R' R^T the cross product with T theta', and T' theta' its rate but for T theta''."""
    theta, rate, h = np.array([0.3, -0.7, 0.5]), np.array([0.9, 0.4, -1.1]), 1e-6
    found = np.zeros((3, 21))
    for k, at in enumerate((theta - h * rate, theta, theta + h * rate)):
        spatial_shapes.section(np.concatenate([at, rate]), 0, found[k], 0)
    R, T, gamma = found[1, :9].reshape(3, 3), found[:, 9:18].reshape(3, 3, 3), found[1, 18:]
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-15) and np.linalg.det(R) > 0.0
    spin = (found[2, :9] - found[0, :9]).reshape(3, 3) / (2 * h) @ R.T
    omega = T[1] @ rate
    assert np.allclose([spin[2, 1], spin[0, 2], spin[1, 0]], omega, atol=1e-8)
    assert np.allclose((T[2] - T[0]) @ rate / (2 * h), gamma, atol=1e-8)
    slope = R[:, 0]  # bending turns the axis by the shortest way, whatever the twist
    spatial_shapes.section(np.concatenate([[0.0], theta[1:], rate]), 0, found[0], 0)
    assert np.allclose(found[0, [0, 3, 6]], slope, atol=1e-15)
