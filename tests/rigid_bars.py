"""An elastic strip as a chain of rigid bars, written without anything of the package."""

import numpy as np
from scipy.integrate import solve_ivp


def hanging_chain(bars, length, rho_A, E_I, angle, gravity, times):
    """A chain released straight and at rest at an angle from the horizontal, hinged at its start, under its weight.

    Lagrange's equations in the bars' angles: centres at C_i = sum_j A_ij e(theta_j), springs E I / h between
    neighbours, so that with e_i . e_j = cos(theta_i - theta_j)

        sum_j M_ij cos(theta_i - theta_j) theta_j'' + M_ij sin(theta_i - theta_j) theta_j'^2 = Q_i,   M = m A^T A + J

    Returns
    -------
    angles (bars, n_times) [rad], moments of the springs (bars - 1, n_times) [N m]
    """
    h = length / bars
    mass = rho_A * h
    A = np.tril(np.full((bars, bars), h), -1) + np.eye(bars) * h / 2
    coupled, inertia = mass * A.T @ A, mass * h * h / 12 * np.eye(bars)
    across = np.diff(np.eye(bars), axis=0)
    stiffness, weight = E_I / h * across.T @ across, mass * gravity * A.sum(axis=0)

    def slope(_, x):
        theta, omega = x[:bars], x[bars:]
        apart = theta[:, None] - theta
        push = -(coupled * np.sin(apart)) @ omega**2 - stiffness @ theta - weight * np.cos(theta)
        return np.concatenate([omega, np.linalg.solve(coupled * np.cos(apart) + inertia, push)])

    first = np.concatenate([np.full(bars, angle), np.zeros(bars)])
    angles = solve_ivp(slope, (times[0], times[-1]), first, "DOP853", times, rtol=1e-7, atol=1e-9).y[:bars]
    return angles, E_I / h * np.diff(angles, axis=0)
