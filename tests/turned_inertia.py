"""A slider-crank that turns its own inertia, J(phi) phi'' + J' phi'^2 / 2 = T: what its linear equations must be.

In the plane and in space, by a crank of 0.2 kg and a rod of 0.3 kg that are as good as rigid, from 50 deg at 20 rad/s
under T = 3 - 0.05 phi'.
"""

import numpy as np
import pytest

CRANK, ROD, SLIDER = 0.1, 0.31, 0.45
"""Lengths [m], and a mass [kg]."""


def inertia(angle):
    """Of all bodies at the crank, angle = 0 where it points along the guide; of a complex angle, too."""
    s = CRANK / ROD * np.sin(angle)
    turn = -CRANK / ROD * np.cos(angle) / np.sqrt(1 - s * s)  # of the rod, whose inclination has the sine -s
    slider = -CRANK * np.sin(angle) + ROD * s * turn
    x, y = -CRANK * np.sin(angle) + ROD / 2 * s * turn, CRANK * np.cos(angle) / 2
    return 0.2 * CRANK**2 / 3 + 0.3 * (x * x + y * y + ROD**2 / 12 * turn * turn) + SLIDER * slider * slider


def check_turned_inertia(found, rel, still):
    """M, C and K of a state space are the derivatives at the acceleration that the torque leaves, to ``rel``, outputs
    those of the slider; ``still``: what may be left of a derivative that is none."""
    angle, omega, step = np.radians(50), 20.0, 1e-4
    J, first = inertia(angle), inertia(angle + 1e-30j).imag / 1e-30
    second = (inertia(angle + step + 1e-30j) - inertia(angle - step + 1e-30j)).imag / 1e-30 / (2 * step)
    acceleration = (3.0 - 0.05 * omega - first * omega**2 / 2) / J
    assert found.states[0] == "main.angle" and found.inputs == ("motor",)
    assert found.M[0, 0] == pytest.approx(J, rel=rel)
    assert found.C_damping[0, 0] == pytest.approx(first * omega + 0.05, rel=rel)
    assert found.K[0, 0] == pytest.approx(first * acceleration + second * omega**2 / 2, rel=100 * rel)
    gear = dict(zip(found.outputs, found.C, strict=True))
    n, s = len(found.M), CRANK / ROD * np.sin(angle)
    rate = -CRANK * np.sin(angle) - ROD * s * CRANK / ROD * np.cos(angle) / np.sqrt(1 - s * s)
    assert gear["place"][0] == pytest.approx(rate, rel=0.1 * rel)
    assert gear["place"][n:] == pytest.approx(0.0, abs=still)
    assert gear["speed"][n] == pytest.approx(rate, rel=0.1 * rel)
