"""What bending shortens a line by that is known by its splines alone, against integrals in closed form and by SciPy."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BSpline

from kaneflex.fem.imported.modal_arrays import DEGREE, grown, shortening, splines

NODES = np.linspace(0.5, 2.0, 31)
PLACES, WEIGHTS = np.array([1.93, 0.5, 0.9, 2.0, 0.9]), np.array([0.4, 3.0, 1.5, -0.6, 2.0])


def line(*shapes):
    """Splines through shapes, which are functions of the place."""
    knots, at = splines(NODES)
    return BSpline(knots, np.linalg.lstsq(at.toarray(), np.stack([s(NODES) for s in shapes], axis=1))[0], DEGREE)


def test_of_polynomials_it_is_the_closed_form():
    """w = x^2 and x^5, of degree as high as splines have: 2 x and 5 x^4."""
    slope = line(lambda x: x**2, lambda x: x**5).derivative()
    powers, factors = np.array([[2, 5], [5, 8]]), np.array([[4, 10], [10, 25]])
    whole = [factors * (x ** (powers + 1) - 0.5 ** (powers + 1)) / (powers + 1) for x in PLACES]
    assert grown([slope], PLACES, WEIGHTS) == pytest.approx(np.einsum("i,ijk->jk", WEIGHTS, whole), rel=1e-12)


def test_lines_add_up_whose_pieces_are_no_one_polynomial():
    lines = [line(np.sin, np.exp).derivative(), line(np.cos, lambda x: np.sin(30 * x)).derivative()]
    expected = np.zeros((2, 2))
    for x, weight in zip(PLACES, WEIGHTS, strict=True):
        for j, k in np.ndindex(2, 2):
            for slope in lines:
                product = lambda s, slope=slope, j=j, k=k: slope(s)[j] * slope(s)[k]  # noqa: E731
                pieces = pairwise([*(knot for knot in np.unique(slope.t) if knot < x), x])
                expected[j, k] += weight * sum(quad(product, *piece)[0] for piece in pieces)
    assert grown(lines, PLACES, WEIGHTS) == pytest.approx(expected, rel=1e-10)


def test_the_mean_over_the_mass_is_left_out():
    mass = 1.0 + NODES
    slope = line(np.sin, np.exp).derivative()
    whole = np.stack([grown([slope], np.array([x]), np.ones(1)) for x in NODES])
    found = shortening(slope, NODES, mass, NODES)
    H = found["H"]
    assert H == pytest.approx(whole - np.einsum("i,ijk->jk", mass, whole) / mass.sum(), rel=1e-10, abs=1e-12)
    assert found["mass_X_H"] == pytest.approx(np.einsum("i,ijk->jk", mass * NODES, H), rel=1e-10)
