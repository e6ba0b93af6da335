"""Hand-written closed forms: the other side of every "derived equals closed form" test.

Nothing here is computed from shape functions or taken from `kaneflex`. Each function does plain arithmetic on
its arguments: floats give float arrays, SymPy symbols give exact object arrays.

Notation: L length, rhoA mass per length, x0 place of the first node in the link, (w, e) angular velocity and
acceleration of the link's frame, (ax, ay) acceleration of its origin in link axes;
q = (u1, v1, th1, u2, v2, th2); M q'' + C q' + K q = F. Each function cites its equation of the paper or
Przemieniecki, Theory of Matrix Structural Analysis (1968); the rest are elementary integrals and statics.
"""

import numpy as np

BENDING = [1, 2, 4, 5]
S_HAT = np.zeros((6, 6), dtype=int)  # diag(S, 0, S, 0): a quarter turn of each node's displacement
S_HAT[0, 1] = S_HAT[3, 4] = -1
S_HAT[1, 0] = S_HAT[4, 3] = 1


def on_bending(block):
    """A 4x4 block on (v1, th1, v2, th2) as a 6x6 matrix."""
    full = np.zeros((6, 6), dtype=np.asarray(block).dtype)
    full[np.ix_(BENDING, BENDING)] = block
    return full


def mass(rhoA, L):
    """Consistent mass matrix, paper (101), (102) with one length; Przemieniecki (1968)."""
    return (rhoA * L / 420) * np.array(
        [[140, 0, 0, 70, 0, 0],
         [0, 156, 22 * L, 0, 54, -13 * L],
         [0, 22 * L, 4 * L**2, 0, 13 * L, -3 * L**2],
         [70, 0, 0, 140, 0, 0],
         [0, 54, 13 * L, 0, 156, -22 * L],
         [0, -13 * L, -3 * L**2, 0, -22 * L, 4 * L**2]]
    )


def gyration(rhoA, L):
    """G = int rhoA N^T S N dx of paper (44) with the single tilde of (41), and of (98)."""
    return (rhoA * L / 60) * np.array(
        [[0, -21, -3 * L, 0, -9, 2 * L],
         [21, 0, 0, 9, 0, 0],
         [3 * L, 0, 0, 2 * L, 0, 0],
         [0, -9, -2 * L, 0, -21, 3 * L],
         [9, 0, 0, 21, 0, 0],
         [-2 * L, 0, 0, -3 * L, 0, 0]]
    )


def gyroscopic(rhoA, L, w):
    """C_d = 2 w G, paper (44) corrected."""
    return 2 * w * gyration(rhoA, L)


def dynamic_stiffness(rhoA, L, w, e):
    """K_d = -w^2 M + e G, paper (46) with e as a tilde matrix, (98)."""
    return -(w**2) * mass(rhoA, L) + e * gyration(rhoA, L)


def axial_stiffness(EA, L):
    """Paper (90), (96)."""
    full = np.zeros((6, 6), dtype=object if hasattr(EA, "free_symbols") else float)
    full[np.ix_([0, 3], [0, 3])] = (EA / L) * np.array([[1, -1], [-1, 1]])
    return full


def bending_stiffness(EI, L):
    """Paper (89), and (95) with its own length."""
    return (EI / L**3) * on_bending(
        np.array(
            [[12, 6 * L, -12, 6 * L],
             [6 * L, 4 * L**2, -6 * L, 2 * L**2],
             [-12, -6 * L, 12, -6 * L],
             [6 * L, 2 * L**2, -6 * L, 4 * L**2]]
        )
    )


def stiffness(EA, EI, L):
    """K_s, paper (89), (90), (97) with one length."""
    return axial_stiffness(EA, L) + bending_stiffness(EI, L)


def load_acceleration(rhoA, L, ax, ay):
    """F of the acceleration of the link's origin."""
    return (-rhoA * L / 12) * np.array([6 * ax, 6 * ay, ay * L, 6 * ax, 6 * ay, -ay * L])


def load_centrifugal(rhoA, L, x0, w):
    """F of the centrifugal field: outwards, split 1/3 : 2/3 at x0 = 0; paper (63) with its sign corrected."""
    near, far = x0 * L / 2 + L**2 / 6, x0 * L / 2 + L**2 / 3
    return rhoA * w**2 * np.array([near, 0, 0, far, 0, 0])


def load_euler(rhoA, L, x0, e):
    """F of the frame's angular acceleration."""
    offset = (x0 * L / 12) * np.array([0, 6, L, 0, 6, -L])
    local = (L**2 / 60) * np.array([0, 9, 2 * L, 0, 21, -3 * L])
    return -rhoA * e * (offset + local)


def geometric_0(L):
    """int H'^T H' ds: K_g of a constant unit tension; Przemieniecki (1968)."""
    return on_bending(
        np.array(
            [[36, 3 * L, -36, 3 * L],
             [3 * L, 4 * L**2, -3 * L, -(L**2)],
             [-36, -3 * L, 36, -3 * L],
             [3 * L, -(L**2), -3 * L, 4 * L**2]]
        )
    ) / (30 * L)


def geometric_1(L):
    """int s H'^T H' ds: K_g of a tension growing as s from the element's first node."""
    return (L / 60) * on_bending(
        np.array([[36 / L, 6, -36 / L, 0], [6, 2 * L, -6, -L], [-36 / L, -6, 36 / L, 0], [0, -L, 0, 6 * L]])
    )


def geometric_2(L):
    """int s^2 H'^T H' ds: K_g of a tension growing as s^2 from the element's first node."""
    return (L / 210) * on_bending(
        np.array(
            [[72, 15 * L, -72, -6 * L],
             [15 * L, 4 * L**2, -15 * L, -3 * L**2],
             [-72, -15 * L, 72, 6 * L],
             [-6 * L, -3 * L**2, 6 * L, 18 * L**2]]
        )
    )


def geometric(c0, c1, c2, L):
    """K_g of the tension N(s) = c0 + c1 s + c2 s^2, s from the element's first node."""
    return c0 * geometric_0(L) + c1 * geometric_1(L) + c2 * geometric_2(L)


def viscous(mu, L):
    """C_s of the paper's distributed damping mu, paper (39), (44): int mu N^T N dx."""
    return mass(mu, L)


def rotation_to_local(c, s):
    """T of q = T Q for the frame's angle with cosine c and sine s, paper (66)."""
    block = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return np.block([[block, np.zeros((3, 3), dtype=int)], [np.zeros((3, 3), dtype=int), block]])


def slider_crank(r, L, phi, w, e=0.0):
    """Rigid slider-crank, slider on the crank's X axis, crank angle phi from top dead centre (rod along +X).

    For numbers or arrays; angle, speed and acceleration of the rod and of the piston, by differentiating
    L sin phi2 = -r sin phi and x = r cos phi + L cos phi2 by hand; paper (77) at the piston.
    """
    s1, c1 = np.sin(phi), np.cos(phi)
    s2 = -r / L * s1
    c2 = np.sqrt(1 - s2**2)
    w2 = -r * w * c1 / (L * c2)
    e2 = (r * w**2 * s1 - r * e * c1 + L * w2**2 * s2) / (L * c2)
    return {
        "phi2": np.arcsin(s2),
        "omega2": w2,
        "epsilon2": e2,
        "piston_position": r * c1 + L * c2,
        "piston_velocity": -r * w * s1 - L * w2 * s2,
        "piston_acceleration": -r * (e * s1 + w**2 * c1) - L * (e2 * s2 + w2**2 * c2),
    }


def slider_crank_forces(r, L, crank, rod, m_piston, phi, w, F_gas, e=0.0):
    """Newton-Euler by hand, from the piston to the shaft; gas force F_gas along -X on the piston, no gravity.

    crank, rod: (mass, distance of its centre from the first joint, inertia about its centre). The forces are
    those of the crank on the rod (crank_pin_*), of the ground on the crank (main_bearing_*), of the guide on
    the piston (piston_side_force), the rod's tension at the piston pin and the drive's torque.
    """
    (m1, d1, J1), (m2, d2, J2) = crank, rod
    motion = slider_crank(r, L, phi, w, e)
    w2, e2 = motion["omega2"], motion["epsilon2"]
    s1, c1, s2, c2 = np.sin(phi), np.cos(phi), np.sin(motion["phi2"]), np.cos(motion["phi2"])
    pin_ax, pin_ay = -r * (e * s1 + w**2 * c1), r * (e * c1 - w**2 * s1)
    rod_ax, rod_ay = pin_ax - d2 * (e2 * s2 + w2**2 * c2), pin_ay + d2 * (e2 * c2 - w2**2 * s2)
    # (B_x, B_y): force of the rod on the piston; (A_x, A_y): force of the crank on the rod.
    B_x = m_piston * motion["piston_acceleration"] + F_gas
    A_x = m2 * rod_ax + B_x
    # Moments about the rod's centre, with A_y = m2 rod_ay + B_y: one equation for B_y.
    B_y = (-J2 * e2 - d2 * c2 * m2 * rod_ay + d2 * s2 * A_x + (L - d2) * s2 * B_x) / (L * c2)
    A_y = m2 * rod_ay + B_y
    return {
        "crank_pin_force_x": A_x,
        "crank_pin_force_y": A_y,
        "piston_side_force": -B_y,
        "rod_force_piston": -(B_x * c2 + B_y * s2),
        "main_bearing_force_x": A_x + m1 * pin_ax * d1 / r,
        "main_bearing_force_y": A_y + m1 * pin_ay * d1 / r,
        "crank_torque": (J1 + m1 * d1**2) * e + r * (c1 * A_y - s1 * A_x),
    }
