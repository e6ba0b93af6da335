"""A straight rod that is bent as far as it likes by a force of constant direction at its tip, written by hand.

S. S. Antman (2005), Nonlinear Problems of Elasticity, ch. 8: r' = R (e_x + C_n^-1 R^T F), R' = R [C_m^-1 R^T m]_x and
m' = -r' x F, with the moment m zero at the tip, as a boundary-value problem for SciPy.
"""

import numpy as np
from scipy.integrate import solve_bvp


def tip_of_rod(length, stretching, turning, force, nodes=21):
    """Displacement of the tip [m], shape (3,); the rod lies along x, clamped at the origin.

    stretching: E A and the two shear stiffnesses [N]; turning: G J and E I about y and z [N m^2]; force [N].
    """
    s = np.linspace(0.0, length, nodes)
    y = np.zeros((10, nodes))
    y[0], y[3] = s, 1.0
    clamped = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    for share in (0.2, 0.5, 1.0):
        push = share * np.asarray(force, float)

        def slope(_, y, push=push):
            a, v, m = y[3], y[4:7], y[7:]
            R = _rotations(a, v)
            strain = np.einsum("jin,j->in", R, push) / np.asarray(stretching)[:, None]
            strain[0] += 1.0
            curvature = np.einsum("jin,jn->in", R, m) / np.asarray(turning)[:, None]
            tangent = np.einsum("ijn,jn->in", R, strain)
            spin = 0.5 * (a * curvature + np.cross(v, curvature, axis=0))
            return np.vstack([tangent, -0.5 * (v * curvature).sum(axis=0), spin, -np.cross(tangent, push, axis=0)])

        found = solve_bvp(slope, lambda a, b: np.r_[a[:7] - clamped, b[7:]], s, y, tol=1e-8, max_nodes=5000)
        assert found.success, found.message
        s, y = found.x, found.y
    return y[:3, -1] - (length, 0.0, 0.0)


def _rotations(a, v):
    """Rotation matrices of quaternions, shape (3, 3, n)."""
    x, y, z = v
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - a * z), 2 * (x * z + a * y)],
        [2 * (x * y + a * z), 1 - 2 * (x * x + z * z), 2 * (y * z - a * x)],
        [2 * (x * z - a * y), 2 * (y * z + a * x), 1 - 2 * (x * x + y * y)],
    ])
