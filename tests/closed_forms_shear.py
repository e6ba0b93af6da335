"""Hand-written closed forms of the Timoshenko element, beside those of `closed_forms`.

Przemieniecki, Theory of Matrix Structural Analysis (1968), and Friedman and Kosmatka (1993), Computers and
Structures 47, 473-481, with phi = 12 E I/(kappa G A L^2). Notation and coordinates as in `closed_forms`; everything
is plain arithmetic on the arguments.
"""

import numpy as np
from closed_forms import on_bending


def _symmetric(a, b, c, d, e, f):
    """4 x 4 of an element that is the same from both ends, on (v1, th1, v2, th2)."""
    return np.array([[a, b, c, -d], [b, e, d, f], [c, d, a, -b], [-d, f, -b, e]])


def stiffness(EI, L, phi):
    """Bending and shear together."""
    factor = EI / ((1 + phi) * L**3)
    return factor * on_bending(_symmetric(12, 6 * L, -12, -6 * L, (4 + phi) * L**2, (2 - phi) * L**2))


def mass_across(rhoA, L, phi):
    """Translation across the beam."""
    factor = rhoA * L / (420 * (1 + phi) ** 2)
    block = _symmetric(
        156 + 294 * phi + 140 * phi**2, (44 + 77 * phi + 35 * phi**2) * L / 2, 54 + 126 * phi + 70 * phi**2,
        (26 + 63 * phi + 35 * phi**2) * L / 2, (8 + 14 * phi + 7 * phi**2) * L**2 / 2,
        -(6 + 14 * phi + 7 * phi**2) * L**2 / 2,
    )
    return factor * on_bending(block)


def mass_rotary(rhoI, L, phi):
    """Rotary inertia rhoI int theta^T theta dx."""
    factor = rhoI / (30 * (1 + phi) ** 2 * L)
    block = _symmetric(
        36, (3 - 15 * phi) * L, -36, -(3 - 15 * phi) * L, (4 + 5 * phi + 10 * phi**2) * L**2,
        -(1 + 5 * phi - 5 * phi**2) * L**2,
    )
    return factor * on_bending(block)


def geometric(L, phi):
    """int v'^T v' dx: K_g of a constant unit tension."""
    factor = 1 / (60 * (1 + phi) ** 2 * L)
    block = _symmetric(
        72 + 120 * phi + 60 * phi**2, 6 * L, -(72 + 120 * phi + 60 * phi**2), -6 * L,
        (8 + 10 * phi + 5 * phi**2) * L**2, -(2 + 10 * phi + 5 * phi**2) * L**2,
    )
    return factor * on_bending(block)


def gyration(rhoA, L, phi):
    """G = rhoA int N^T S N dx with linear u."""
    factor = rhoA * L / (120 * (1 + phi))
    long, short = (6 + 5 * phi) * L, (4 + 5 * phi) * L
    near = factor * np.array([42 + 40 * phi, long, 18 + 20 * phi, -short])
    far = factor * np.array([18 + 20 * phi, short, 42 + 40 * phi, -long])
    full = np.zeros((6, 6), dtype=object)
    for row, values in ((0, near), (3, far)):
        full[row, [1, 2, 4, 5]] = -values
        full[[1, 2, 4, 5], row] = values
    return full


def load_euler(rhoA, rhoI, L, x0, phi, e):
    """F of the frame's angular acceleration, -e rhoA int X N_v dx - e rhoI int theta dx."""
    offset = (x0 * L / 12) * np.array([0, 6, L, 0, 6, -L])
    local = np.array([0, 18 + 20 * phi, (4 + 5 * phi) * L, 0, 42 + 40 * phi, -(6 + 5 * phi) * L])
    local = local * L**2 / (120 * (1 + phi))
    turn = np.array([0, -2, phi * L, 0, 2, phi * L]) / (2 * (1 + phi))
    return -e * (rhoA * (offset + local) + rhoI * turn)


def mass_correction(rhoA, L, phi):
    """tau^2 K with tau^2 = rhoA L^2/(12 kappa G A) = rhoA phi L^4/(144 EI)."""
    return rhoA * phi * L**4 / 144 * stiffness(1, L, phi)
