"""The kernels of contact forces: laws by what they return of an approach."""

import math

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from kaneflex.generated import contact
from kaneflex.mechanism.contacts import CHI, chi_for_restitution, hysteresis, restitution_of

ASKED = (0.9, 0.7, 0.5, 0.3, 0.1)
RETURNED = {
    "lankarani-nikravesh": (0.913177, 0.795973, 0.725241, 0.684225, 0.665265),
    "hunt-crossley": (0.909016, 0.768000, 0.662962, 0.581288, 0.515833),
    "flores": (0.893921, 0.683184, 0.470445, 0.256208, 0.069444),
}
OWN = (0.6, -0.8, 0.35, 7e4, 1.5, 0.4, 0.8, 0.21)
BEFORE = 3
"""Numbers before a contact's own ones."""


def numbers(**given):
    """p, with a contact's numbers from BEFORE on."""
    own = dict(zip(contact.NUMBERS, OWN, strict=True)) | given
    return np.array([np.nan] * BEFORE + list(own.values()))


def test_slopes_are_the_derivatives_of_the_force_and_the_energy_is_its_work():
    for n in (1.0, 10 / 9, 1.5, 2.0):
        p = numbers(n=n, chi=0.7)
        for law in range(len(contact.LAWS)):
            for g in (-3e-4, -1e-6, 2e-4):
                step = 1e-5 * abs(g)
                by_g, by_rate = contact.normal_slopes(law, p, BEFORE, 0.3, g, 0.05)
                forces = [contact.normal_force(law, p, BEFORE, 0.3, g + k * step, 0.05) for k in (1, -1)]
                rounding = 1e-15 * abs(forces[0]) / step
                assert by_g == pytest.approx((forces[0] - forces[1]) / (2 * step), rel=1e-8, abs=rounding)
                forces = [contact.normal_force(law, p, BEFORE, 0.3, g, 0.05 + k) for k in (1, -1)]
                assert by_rate == pytest.approx((forces[0] - forces[1]) / 2, rel=1e-9, abs=1e-9)
        depths = np.linspace(0, 3e-4, 2001)
        work = np.trapezoid([contact.normal_force(0, p, BEFORE, 1.0, -d, 0.0) for d in depths], depths)
        assert contact.stored(p, BEFORE, -3e-4) == pytest.approx(work, rel=1e-5)
        assert contact.stored(p, BEFORE, 0.0) == 0.0


@njit
def pushed(law, p, c, v_0, d, rate, mass):
    return -contact.normal_force(law, p, c, v_0, -d, -rate) / mass


def comes_back(law, p, v_0=0.7, mass=1.3):
    """Speed of separation over that of approach, by d'' = -F/m from first touch to last, in units of the deepest."""
    K, n = p[BEFORE + 3], p[BEFORE + 4]
    deep = ((n + 1) * mass * v_0**2 / (2 * K)) ** (1 / (n + 1))
    code = contact.LAWS.index(law)

    def rhs(t, y):
        return y[1], pushed(code, p, BEFORE, v_0, y[0] * deep, y[1] * v_0, mass) * deep / v_0**2

    def apart(t, y):
        return y[0] if t > 1e-3 else 1.0

    apart.terminal = True
    apart.direction = -1
    found = solve_ivp(rhs, (0, 1e5), (0.0, 1.0), "DOP853", events=apart, rtol=1e-12, atol=1e-13)
    assert found.status == 1
    return -found.y_events[0][0, 1]


@pytest.mark.parametrize("law", RETURNED)
def test_restitution_that_a_law_returns_is_not_what_it_is_asked_for(law):
    """F = K d^1.5 (1 + chi d'/v_0) integrated: what the textbook's chi really gives, and the closed form beside it."""
    for asked, expected in zip(ASKED, RETURNED[law], strict=True):
        chi = hysteresis(law, asked)
        assert comes_back(law, numbers(chi=chi)) == pytest.approx(expected, abs=1e-6)
        assert restitution_of(chi) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("n", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("asked", [0.05, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
def test_exact_law_returns_what_is_asked_for(asked, n):
    for v_0, mass in ((0.7, 1.3), (11.0, 0.02)):
        p = numbers(n=n, chi=hysteresis("exact", asked), K=1e9)
        assert comes_back("exact", p, v_0, mass) == pytest.approx(asked, abs=1e-7)


def test_exact_chi_at_its_ends_and_between():
    """Near one it is Hunt and Crossley's, which is its first term; near zero 1/e."""
    assert chi_for_restitution(1.0) == 0.0 == hysteresis("hertz", 0.3)
    assert chi_for_restitution(1 - 1e-12) == pytest.approx(CHI["hunt-crossley"](1 - 1e-12), rel=1e-3)
    for e in (1e-6, 1e-3, 0.02, 0.03, *np.linspace(0.05, 0.99, 48), 1 - 1e-6):
        chi = chi_for_restitution(e)
        assert restitution_of(chi) == pytest.approx(e, abs=1e-9)
        if 0.05 <= e <= 0.99:
            assert (1 + chi) / (1 - e * chi) == pytest.approx(math.exp(chi * (1 + e)), rel=1e-6)
    assert chi_for_restitution(1e-6) == pytest.approx(1e6)
    assert restitution_of(1e6) == pytest.approx(1e-6)


def test_kelvin_voigt_returns_what_its_damping_ratio_says():
    """A linear spring and damper to zero depth, its tension at the end left on."""
    K, mass, zeta = 7e4, 1.3, 0.2
    p = numbers(n=1.0, K=K, chi=2 * zeta * math.sqrt(K * mass))
    expected = math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))
    assert comes_back("kelvin-voigt", p) == pytest.approx(expected, abs=1e-9)
