"""Displacements within a beam element from those of its nodes."""

from __future__ import annotations

import numpy as np


def shape_functions(x: float, length: float, phi_s: float = 0.0, growth: float = 0.0) -> np.ndarray:
    """Rows u, v, theta, v' over (u1, v1, theta1, u2, v2, theta2); x from the first node [m].

    Paper (49)-(55), where theta = v'; with phi_s = 12 E I/(kappa G A length^2) those of a Timoshenko beam under
    loads at its nodes (Przemieniecki 1968): v' - theta is the shear strain -phi_s length^2 d3v/dx3 / 12. Its theta
    bows where E I grows over the element, by `growth` of its mean.
    """
    x = float(x)  # numbers of NumPy are slow
    s, b = x / length, 1.0 / (1.0 + float(phi_s))
    c = 1.0 - b
    shear, bow = c * s * (1 - s) * length / 2, c * float(growth) / 12
    hump, bend, mean = length * (3 * s**2 - 2 * s**3 - s) * bow, 6 * (s - s**2) * bow, c / length
    v = (b * (1 - 3 * s**2 + 2 * s**3) + c * (1 - s), b * x * (1 - s) ** 2 + shear - hump,
         b * (3 * s**2 - 2 * s**3) + c * s, b * x * (s**2 - s) - shear + hump)  # fmt: skip
    theta = (6 * b * (s**2 - s) / length, b * (1 - 4 * s + 3 * s**2) + c * (1 - s) - bend,
             6 * b * (s - s**2) / length, b * (3 * s**2 - 2 * s) + c * s + bend)  # fmt: skip
    strain = -mean, -c / 2 + bow, mean, -c / 2 - bow
    return np.array([
        1 - s, 0, 0, s, 0, 0,
        0, v[0], v[1], 0, v[2], v[3],
        0, theta[0], theta[1], 0, theta[2], theta[3],
        0, theta[0] + strain[0], theta[1] + strain[1], 0, theta[2] + strain[2], theta[3] + strain[3],
    ]).reshape(4, 6)  # fmt: skip


def spatial_shape_functions(
    x: float, length: float, phi: tuple[float, float] = (0.0, 0.0), growth: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Rows u, v, w, theta_x, theta_y, theta_z, v', w' over u, v, w, theta_x, theta_y, theta_z of both nodes, (8, 12).

    phi and growth: of the x-y plane, then of the x-z plane, where theta_y = -w' without shear.
    """
    found = np.zeros((8, 12))
    u, v, theta, slope = shape_functions(x, length, phi[0], growth[0])
    _, w, minus_theta_y, slope_z = shape_functions(x, length, phi[1], growth[1])
    found[_Y_PLANE] = u, v, theta, slope
    found[_Z_PLANE] = w * _SIGNS, -minus_theta_y * _SIGNS, slope_z * _SIGNS
    found[3, [3, 9]] = u[[0, 3]]
    return found


_Y_PLANE = np.ix_((0, 1, 5, 6), (0, 1, 5, 6, 7, 11))
_Z_PLANE = np.ix_((2, 4, 7), (0, 2, 4, 6, 8, 10))
"""Rows, and the planar element's coordinates u, v, theta, in each plane of bending."""
_SIGNS = np.array([1, 1, -1, 1, 1, -1])
"""Signs of these in the x-z plane, where theta_y = -w'."""
