"""Displacements within a beam element from those of its nodes."""

from __future__ import annotations

import numpy as np

Numbers = float | np.ndarray


def shape_functions(x: Numbers, length: Numbers, phi_s: Numbers = 0.0, growth: Numbers = 0.0) -> np.ndarray:
    """Rows u, v, theta, v' over (u1, v1, theta1, u2, v2, theta2), (..., 4, 6); x from the first node [m].

    Paper (49)-(55), where theta = v'; with phi_s = 12 E I/(kappa G A length^2) those of a Timoshenko beam under
    loads at its nodes (Przemieniecki 1968): v' - theta is the shear strain -phi_s length^2 d3v/dx3 / 12. Its theta
    bows where E I grows over the element, by `growth` of its mean. Arrays give the rows of as many places.
    """
    s, b = x / length, 1.0 / (1.0 + phi_s)
    c = 1.0 - b
    shear, bow = c * s * (1 - s) * length / 2, c * growth / 12
    hump, bend, mean = length * (3 * s**2 - 2 * s**3 - s) * bow, 6 * (s - s**2) * bow, c / length
    v = (b * (1 - 3 * s**2 + 2 * s**3) + c * (1 - s), b * x * (1 - s) ** 2 + shear - hump,
         b * (3 * s**2 - 2 * s**3) + c * s, b * x * (s**2 - s) - shear + hump)  # fmt: skip
    theta = (6 * b * (s**2 - s) / length, b * (1 - 4 * s + 3 * s**2) + c * (1 - s) - bend,
             6 * b * (s - s**2) / length, b * (3 * s**2 - 2 * s) + c * s + bend)  # fmt: skip
    strain = -mean, -c / 2 + bow, mean, -c / 2 - bow
    found = np.zeros((*np.shape(s), 4, 6))
    found[..., 0, 0], found[..., 0, 3] = 1 - s, s
    for k, j in enumerate((1, 2, 4, 5)):
        found[..., 1, j], found[..., 2, j], found[..., 3, j] = v[k], theta[k], theta[k] + strain[k]
    return found


def spatial_shape_functions(
    x: Numbers, length: Numbers, phi: tuple[Numbers, Numbers] = (0.0, 0.0),
    growth: tuple[Numbers, Numbers] = (0.0, 0.0), twist: Numbers = 0.0,
) -> np.ndarray:  # fmt: skip
    """Rows u, v, w, theta_x, theta_y, theta_z, v', w', twist theta_x' over u, v, w, theta_x, theta_y, theta_z of both
    nodes, (..., 9, 12).

    phi and growth: of the x-y plane, then of the x-z plane, where theta_y = -w' without shear.
    """
    found = np.zeros((*np.shape(x / length), 9, 12))
    first = shape_functions(x, length, phi[0], growth[0])
    second = shape_functions(x, length, phi[1], growth[1])[..., 1:, :] * _SIGNS
    found[..., _Y_PLANE[0], _Y_PLANE[1]] = first
    found[..., _Z_PLANE[0], _Z_PLANE[1]] = second
    found[..., 3, [3, 9]] = first[..., 0, [0, 3]]
    found[..., 8, 9] = twist / length
    found[..., 8, 3] = -found[..., 8, 9]
    return found


_Y_PLANE = np.ix_((0, 1, 5, 6), (0, 1, 5, 6, 7, 11))
_Z_PLANE = np.ix_((2, 4, 7), (0, 2, 4, 6, 8, 10))
"""Rows, and the planar element's coordinates u, v, theta, in each plane of bending."""
_SIGNS = np.array([[1, 1, -1, 1, 1, -1], [-1, -1, 1, -1, -1, 1], [1, 1, -1, 1, 1, -1]])
"""Signs of v, theta, v' by these in the x-z plane, where theta_y = -w'."""
