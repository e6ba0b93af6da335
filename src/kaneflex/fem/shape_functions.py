"""Displacements within a beam element from those of its nodes."""

from __future__ import annotations

import numpy as np


def shape_functions(x: float, length: float, phi_s: float = 0.0, growth: float = 0.0) -> np.ndarray:
    """Rows u, v, theta, v' over (u1, v1, theta1, u2, v2, theta2); x from the first node [m].

    Paper (49)-(55), where theta = v'; with phi_s = 12 E I/(kappa G A length^2) those of a Timoshenko beam under
    loads at its nodes (Przemieniecki 1968): v' - theta is the shear strain -phi_s length^2 d3v/dx3 / 12. Its theta
    bows where E I grows over the element, by `growth` of its mean.
    """
    s = x / length
    b = 1.0 / (1.0 + phi_s)
    c = 1.0 - b
    shear = c * s * (1 - s) * length / 2
    shape = np.array([
        [1 - s, 0, 0, s, 0, 0],
        [0, b * (1 - 3 * s**2 + 2 * s**3) + c * (1 - s), b * x * (1 - s) ** 2 + shear,
         0, b * (3 * s**2 - 2 * s**3) + c * s, b * x * (s**2 - s) - shear],
        [0, 6 * b * (s**2 - s) / length, b * (1 - 4 * s + 3 * s**2) + c * (1 - s),
         0, 6 * b * (s - s**2) / length, b * (3 * s**2 - 2 * s) + c * s],
    ])  # fmt: skip
    bow = c * growth / 12 * np.array([0, 0, -1, 0, 0, 1])
    shape[1] += length * (3 * s**2 - 2 * s**3 - s) * bow
    shape[2] += 6 * (s - s**2) * bow
    strain = c * np.array([0, -1 / length, -1 / 2, 0, 1 / length, -1 / 2]) - bow
    return np.vstack([shape, shape[2] + strain])


def spatial_shape_functions(
    x: float, length: float, phi: tuple[float, float] = (0.0, 0.0), growth: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Rows u, v, w, theta_x, theta_y, theta_z, v', w' over u, v, w, theta_x, theta_y, theta_z of both nodes, (8, 12).

    phi and growth: of the x-y plane, then of the x-z plane, where theta_y = -w' without shear.
    """
    found = np.zeros((8, 12))
    u, v, theta, slope = shape_functions(x, length, phi[0], growth[0])
    _, w, minus_theta_y, slope_z = shape_functions(x, length, phi[1], growth[1])
    signs = np.array([1, 1, -1, 1, 1, -1])
    found[np.ix_((0, 1, 5, 6), _Y_PLANE)] = u, v, theta, slope
    found[np.ix_((2, 4, 7), _Z_PLANE)] = w * signs, -minus_theta_y * signs, slope_z * signs
    found[3, [3, 9]] = u[[0, 3]]
    return found


_Y_PLANE, _Z_PLANE = (0, 1, 5, 6, 7, 11), (0, 2, 4, 6, 8, 10)
"""The planar element's coordinates u, v, theta in each plane of bending."""
