"""Matrices of a beam element with a linearly growing section, by Gauss's quadrature of integrands written by hand.

Nothing here is taken from `kaneflex`. Interpolation after Friedman and Kosmatka (1993), Computers and Structures 47,
473-481; loads by Newton's and Euler's equations of one slice of the beam. Coordinates (u, v, w, theta_x, theta_y,
theta_z) of two nodes with theta_y = -w'. Eight points are exact up to the power 15.
"""

import numpy as np

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
S, WEIGHTS = (_POINTS + 1) / 2, _WEIGHTS / 2
"""Places x/L of the points along the element, and their weights."""
Y_PLANE, Z_PLANE = np.zeros((2, 12, 6))
"""u, v, theta of the x-y plane, of both nodes; and the same of the x-z plane."""
Y_PLANE[[0, 1, 5, 6, 7, 11], range(6)] = 1.0
Z_PLANE[[0, 2, 4, 6, 8, 10], range(6)] = 1.0, 1.0, -1.0, 1.0, 1.0, -1.0


def cross(vector):
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def friedman_kosmatka(s, L, phi):
    """v, v', theta and theta' over (v1, theta1, v2, theta2), (points, 4) each, for a constant E I; their eq. (18)."""
    one = np.ones_like(s)
    v = [
        2 * s**3 - 3 * s**2 - phi * s + 1 + phi, L * (s**3 - (2 + phi / 2) * s**2 + (1 + phi / 2) * s),
        -(2 * s**3 - 3 * s**2 - phi * s), L * (s**3 - (1 - phi / 2) * s**2 - phi / 2 * s),
    ]  # fmt: skip
    slope = [
        (6 * s**2 - 6 * s - phi) / L, 3 * s**2 - (4 + phi) * s + 1 + phi / 2,
        -(6 * s**2 - 6 * s - phi) / L, 3 * s**2 - (2 - phi) * s - phi / 2,
    ]  # fmt: skip
    theta = [6 * (s**2 - s) / L, 3 * s**2 - (4 + phi) * s + 1 + phi, -6 * (s**2 - s) / L, 3 * s**2 - (2 - phi) * s]
    turn = [6 * (2 * s - 1) / L**2, (6 * s - 4 - phi) / L, -6 * (2 * s - 1) / L**2, (6 * s - 2 + phi) / L]
    return [np.stack([f * one for f in rows], axis=1) / (1 + phi) for rows in (v, slope, theta, turn)]


def bending(L, phi, EI, rise):
    """v, v', theta, theta' and the shear strain at the points over the four coordinates, (points, 4) each.

    Where E I grows, a further shape of constant shear takes the amplitude that makes the strain energy least.
    """
    rows = friedman_kosmatka(S, L, phi)
    rows.append(rows[1] - rows[2])
    if phi:
        s = S[:, None]
        further = [L * (3 * s**2 - 2 * s**3 - s), 6 * s - 6 * s**2 - 1, 6 * (s - s**2), 6 * (1 - 2 * s) / L, 0 * s - 1]
        along, across = WEIGHTS * (EI + rise * (S - 0.5)), WEIGHTS * 12 * EI / (phi * L**2)
        pull, hold = (along @ (further[3] * of) + across @ (further[4] * gamma) for of, gamma in (
            (rows[3], rows[4]), (further[3], further[4])
        ))  # fmt: skip
        rows = [row - shape * pull / hold for row, shape in zip(rows, further, strict=True)]
    return rows


def strain_energy(L, phi, EI, rise, rows):
    """Stiffness of bending and shear, 4 x 4."""
    *_, turn, gamma = rows
    K = L * turn.T @ ((WEIGHTS * (EI + rise * (S - 0.5)))[:, None] * turn)
    return K + 12 * EI / (phi * L) * gamma.T @ (WEIGHTS[:, None] * gamma) if phi else K


def slice_rows(rho_A, J, X, omega, epsilon, a):
    """M, C, K (6 x 6) and F (6) of a slice at X with the inertia J of its section, per length.

    Translation by Newton. Rotation by Euler's equations in the section's axes to the first order in theta = theta_x
    e_x + beta, where bending beta turns the tangent the shortest way and theta_x the section about it: there omega is
    omega - theta x omega, and theta' has the partial angular velocities e - beta x e/2 - theta_x e_x x e across and
    e_x along the axis.
    """
    tensor, unit = cross(epsilon) + cross(omega) @ cross(omega), np.eye(3)
    M, C, K = (np.zeros((6, 6)) for _ in range(3))
    M[:3, :3], C[:3, :3], K[:3, :3] = rho_A * unit, 2 * rho_A * cross(omega), rho_A * tensor
    at_rest = J @ epsilon + np.cross(omega, J @ omega)
    for k, e in enumerate(unit):
        turned = np.cross(omega, e)
        M[3:, 3 + k] = J @ e
        C[3:, 3 + k] = J @ turned + np.cross(e, J @ omega) + np.cross(omega, J @ e)
        K[3:, 3 + k] = J @ np.cross(epsilon, e) + np.cross(turned, J @ omega) + np.cross(omega, J @ turned)
        for i in (1, 2):
            partial = -np.cross(e, unit[i]) / (1 if k == 0 else 2)
            K[3 + i, 3 + k] += partial @ at_rest
    return M, C, K, -np.concatenate([rho_A * (a + tensor[:, 0] * X), at_rest])


def element(p, omega, epsilon, a, P_0, turning):
    """Every kernel of the element, 12 x 12 and 12; p by name as in the generated modules.

    turning: which of theta_x, theta_y, theta_z have a rotary inertia."""
    L, middle = p["length"], S - 0.5
    planes = [(Y_PLANE, p["phi_y"], p["E_I_z"], p["E_I_z_rise"]), (Z_PLANE, p["phi_z"], p["E_I_y"], p["E_I_y_rise"])]
    rows = [bending(L, *numbers) for _, *numbers in planes]
    (in_y, in_z), along = ([row @ of[:, [1, 2, 4, 5]].T for row in plane] for plane, (of, *_) in zip(
        rows, planes, strict=True
    )), np.zeros((2, len(S), 12))  # fmt: skip
    for k in range(2):
        along[k][:, [3 * k, 3 * k + 6]] = np.stack([1 - S, S], axis=1)
    turns = [along[1], -in_z[2], in_y[2]]
    N = np.stack([along[0], in_y[0], in_z[0], *(has * row for has, row in zip(turning, turns, strict=True))], axis=1)
    grown = {name: p[name] + p[f"{name}_rise"] * middle for name in ("rho_A", "rho_I_y", "rho_I_z")}
    found = {name: np.zeros((12, 12)) for name in ("M", "C", "K_d", "K_g", "K_s")} | {"F": np.zeros(12)}
    mass = L * (p["rho_A"] * S + p["rho_A_rise"] * (S**2 - S) / 2)
    moment = L**2 * (p["rho_A"] * S**2 / 2 + p["rho_A_rise"] * (S**3 / 3 - S**2 / 4)) + p["x_0"] * mass
    P = P_0 + a[0] * (p["m_0"] + mass) - (omega[1] ** 2 + omega[2] ** 2) * (p["S_0"] + moment)
    gradient = np.zeros(12)
    gradient[[3, 9]] = -1 / L, 1 / L
    for k, w in enumerate(WEIGHTS * L):
        J = np.diag([grown["rho_I_y"][k] + grown["rho_I_z"][k], grown["rho_I_y"][k], grown["rho_I_z"][k]])
        *matrices, load = slice_rows(grown["rho_A"][k], J, p["x_0"] + L * S[k], omega, epsilon, a)
        for name, matrix in zip(("M", "C", "K_d"), matrices, strict=True):
            found[name] += w * N[k].T @ matrix @ N[k]
        found["F"] += w * N[k].T @ load
        for slope, share in ((in_y[1][k], 1.0), (in_z[1][k], 1.0), (gradient, p["I_p_A"])):
            found["K_g"] += w * P[k] * share * np.outer(slope, slope)
    for (of, *numbers), plane in zip(planes, rows, strict=True):
        K = of[:, [1, 2, 4, 5]] @ strain_energy(L, *numbers, plane) @ of[:, [1, 2, 4, 5]].T
        phi, EI, _ = numbers
        found["K_s"] += K
        # the element's answer to its own inertia: tau^2 K with tau^2 = rho A L^2/(12 kappa G A)
        found["M"] += p["rho_A"] * phi * L**4 / (144 * EI) * K
    stretch = np.zeros(12)
    stretch[[0, 6]] = -1 / L, 1 / L
    found["K_s"] += L * (p["E_A"] * np.outer(stretch, stretch) + p["G_J"] * np.outer(gradient, gradient))
    return found


def uniform(rho_A, rho_I_p, E_A, E_I_y, E_I_z, G_J, length):
    """M and K_s of a uniform element of Euler and Bernoulli, whose twist alone has a rotary inertia."""
    rises = dict.fromkeys(("rho_A_rise", "rho_I_y_rise", "rho_I_z_rise", "E_I_y_rise", "E_I_z_rise"), 0.0)
    free = dict.fromkeys(("rho_I_y", "phi_y", "phi_z", "x_0", "m_0", "S_0", "I_p_A"), 0.0)
    given = {"rho_A": rho_A, "rho_I_z": rho_I_p, "E_A": E_A, "E_I_y": E_I_y, "E_I_z": E_I_z, "G_J": G_J}
    found = element(rises | free | given | {"length": length}, *np.zeros((3, 3)), 0.0, turning=(True, False, False))
    return found["M"], found["K_s"]
