"""Hand-written closed forms of the spatial element, put together from those of the plane in `closed_forms`.

Coordinates (u, v, w, theta_x, theta_y, theta_z) of two nodes. The x-y plane's block stands at (u, v, theta_z), the x-z
plane's at (u, w, -theta_y), for theta_y = -w' (Przemieniecki 1968, table 11.1). Plain arithmetic on the arguments.
"""

import closed_forms as plane
import numpy as np

Y_PLANE = np.zeros((12, 6))
"""u, v, theta of the x-y plane, of both nodes."""
Y_PLANE[[0, 1, 5, 6, 7, 11], range(6)] = 1.0
Z_PLANE = np.zeros((12, 6))
"""The same of the x-z plane."""
Z_PLANE[[0, 2, 4, 6, 8, 10], range(6)] = 1.0, 1.0, -1.0, 1.0, 1.0, -1.0
U, V, W, THETA_X = (np.zeros((12, 12)) for _ in range(4))
"""Projectors on the coordinates of u, of v in the x-y plane, of w in the x-z plane, of theta_x."""
for projector, rows in ((U, (0, 6)), (V, (1, 5, 7, 11)), (W, (2, 4, 8, 10)), (THETA_X, (3, 9))):
    projector[rows, rows] = 1.0


def linear(L):
    """int N^T N dx of what is linear between the nodes, on theta_x."""
    block = np.zeros((12, 12))
    block[np.ix_([3, 9], [3, 9])] = L / 6 * np.array([[2, 1], [1, 2]])
    return block


def gradient(L):
    """The same of its derivative."""
    block = np.zeros((12, 12))
    block[np.ix_([3, 9], [3, 9])] = np.array([[1, -1], [-1, 1]]) / L
    return block


def products(L):
    """int N_i^T N_j dx for i, j in x, y, z of the displacement (u, v, w), 12 x 12 each."""
    mass, gyration = plane.mass(1.0, L), plane.gyration(1.0, L)
    in_y, in_z = Y_PLANE @ mass @ Y_PLANE.T, Z_PLANE @ mass @ Z_PLANE.T
    found = [[None] * 3 for _ in range(3)]
    found[0][0], found[1][1], found[2][2] = U @ in_y @ U, V @ in_y @ V, W @ in_z @ W
    # G = int N_v^T N_u - N_u^T N_v dx in each plane
    found[0][1], found[0][2] = -U @ Y_PLANE @ gyration @ Y_PLANE.T @ V, -U @ Z_PLANE @ gyration @ Z_PLANE.T @ W
    found[1][2] = V @ Y_PLANE @ mass @ Z_PLANE.T @ W
    for i, j in ((0, 1), (0, 2), (1, 2)):
        found[j][i] = found[i][j].T
    return found


def cross(vector):
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def weighted(L, tensor):
    """int N^T A N dx of a 3 x 3 matrix A."""
    return sum(tensor[i, j] * block for i, row in enumerate(products(L)) for j, block in enumerate(row))


def mass(rhoA, rhoIp, L):
    return rhoA * weighted(L, np.eye(3)) + rhoIp * linear(L)


def gyroscopic(rhoA, L, omega):
    """2 int rhoA N^T (omega x) N dx."""
    return 2 * rhoA * weighted(L, cross(omega))


def dynamic_stiffness(rhoA, rhoIy, rhoIz, L, omega, epsilon):
    """int rhoA N^T (epsilon x + omega x omega x) N dx, and the propeller moment.

    A section that is turned by theta has the moment -(rhoIz - rhoIy) (omega_z^2 - omega_y^2) theta about x (Bramwell,
    Helicopter Dynamics, on blade feathering).
    """
    tensor = cross(epsilon) + cross(omega) @ cross(omega)
    return rhoA * weighted(L, tensor) + (rhoIz - rhoIy) * (omega[2] ** 2 - omega[1] ** 2) * linear(L)


def stiffness(EA, EIy, EIz, GJ, L):
    in_y = Y_PLANE @ plane.stiffness(EA, EIz, L) @ Y_PLANE.T
    return in_y + Z_PLANE @ plane.stiffness(0.0, EIy, L) @ Z_PLANE.T + GJ * gradient(L)


def geometric(c0, c1, c2, Ip_A, L):
    """K_g of the tension c0 + c1 x + c2 x^2, with Wagner's term Ip/A int P theta_x'^2 dx."""
    block = plane.geometric(c0, c1, c2, L)
    total = c0 + c1 * L / 2 + c2 * L**2 / 3
    return Y_PLANE @ block @ Y_PLANE.T + Z_PLANE @ block @ Z_PLANE.T + Ip_A * total * gradient(L)


def load(rhoA, rhoIy, rhoIz, L, x0, omega, epsilon, a):
    """-int rhoA N^T (a + (epsilon x + omega x omega x) (X, 0, 0)) dx, and Euler's equation of the sections about x."""
    u, v, x_u, x_v = plane.shape_integrals(L)
    tensor = cross(epsilon) + cross(omega) @ cross(omega)
    at_ends = Y_PLANE @ u, Y_PLANE @ v, Z_PLANE @ v
    by_x = Y_PLANE @ x_u, Y_PLANE @ x_v, Z_PLANE @ x_v
    total = sum(-rhoA * (a[i] + tensor[i, 0] * x0) * at_ends[i] - rhoA * tensor[i, 0] * by_x[i] for i in range(3))
    moment = -(rhoIy + rhoIz) * epsilon[0] - (rhoIz - rhoIy) * omega[1] * omega[2]
    total[[3, 9]] += moment * L / 2
    return total
