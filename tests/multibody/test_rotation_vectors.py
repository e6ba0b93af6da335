"""Rates of rotation vectors in steps and in the curves between them, against differences of SciPy's rotations."""

from collections import namedtuple

import numpy as np
import pytest
from numba import njit
from scipy.spatial.transform import Rotation

from kaneflex.multibody.dynamics.rotation_vectors import spin
from kaneflex.multibody.time.trajectory import rates_of_turns

Record = namedtuple("Record", "y u du")
STENCIL, STEP = np.array([1, -8, 0, 8, -1]) / 12.0, 2e-3
"""First derivative from five values (Fornberg 1988), and their distance."""


@njit
def spun(y, u, du):
    return spin(Record(y, u, du), 0)


@pytest.fixture(params=range(6))
def motion(request):
    """Rotation vector with two rates, of up to 2 rad, and what these say of angular velocities in its axes."""
    random = np.random.default_rng(request.param)
    theta, rate, faster = (size * random.uniform(-1.0, 1.0, 3) for size in (1.15, 3.0, 5.0))

    def omega(t):
        at = Rotation.from_rotvec([theta + s * rate + 0.5 * s**2 * faster for s in t + STEP * np.arange(-2, 3)])
        turned = (at[2].inv() * at).as_rotvec()
        return STENCIL @ turned / STEP

    alpha = STENCIL @ [omega(STEP * k) for k in range(-2, 3)] / STEP
    return (theta, rate, faster), omega(0.0), alpha


def test_angular_velocities_and_accelerations_follow_from_rates(motion):
    given, omega, alpha = motion
    found = spun(*given)
    np.testing.assert_allclose(found[0], omega, atol=1e-7)
    np.testing.assert_allclose(found[1], alpha, atol=1e-5)


def test_rates_follow_from_angular_velocities_and_accelerations(motion):
    (theta, rate, faster), *_ = motion
    omega, alpha = (np.array(each)[None] for each in spun(theta, rate, faster))
    found = rates_of_turns(theta[None], omega, alpha)
    np.testing.assert_allclose(found[0][0], rate, atol=1e-13)
    np.testing.assert_allclose(found[1][0], faster, atol=1e-12)
