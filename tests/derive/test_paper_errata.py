"""The paper's printed equations that are wrong, each written as printed and shown to be an error.

Every test asserts both halves: the derived element equals the corrected form, and the printed form differs
from it by a stated amount. Whoever puts a printed form back into the derivation makes the first half fail.
Data: crank r = l1 = 40 mm, rod l2 = 137 mm, 0.153 kg, 6000 rpm (paper, section 3); the rod's section is the
reference engine's, since the paper gives none.
"""

import closed_forms as by_hand
import numpy as np
import pytest
from sympy import Matrix, Rational

from kaneflex.derive.elements import beam
from kaneflex.derive.elements.beam import a_x, a_y, epsilon, omega
from kaneflex.derive.elements.shapes import E_A, E_I, integral, length, rho_A, x, x_0

L_1, L_2 = 0.040, 0.137
ROD = {rho_A: 0.153 / L_2, E_A: 2.99e7, E_I: 1472.0, length: L_2, x_0: 0.0}
SPEED = 2 * np.pi * 100
CRANK_ANGLES = np.linspace(0, 2 * np.pi, 720, endpoint=False)
S = Matrix([[0, -1], [1, 0]])
W_TILDE, E_TILDE = omega * S, epsilon * S  # paper (64) in the plane


@pytest.fixture(scope="module")
def element():
    return beam.beam_element()


def derived(element, target, *groups):
    """Sum of scalar x matrix over the element's terms in `groups`."""
    terms = [t for t in element.terms if t.target == target and t.group in groups]
    return sum((t.scalar * t.matrix for t in terms), Matrix.zeros(*terms[0].matrix.shape))


def equal(left, right) -> bool:
    return (Matrix(left) - Matrix(right)).expand().is_zero_matrix


def weighted(element, middle):
    """int rho_A N^T middle dx over the element; middle is 2 x 2 or 2 x 1."""
    return (rho_A * element.shape.T * middle).applyfunc(integral)


def numbers(matrix, **motion):
    """The rod's numbers in a derived or printed matrix."""
    values = ROD | {symbol: motion.get(symbol.name, 0.0) for symbol in (omega, epsilon, a_x, a_y)}
    return np.array(matrix.xreplace(values).tolist(), dtype=float)


def test_44_damping_matrix(element):
    """Printed 2 int rho N^T (w~w~ + e~) N is twice K_d: a stiffness, not a damping, and not skew."""
    N = element.shape
    C_d = derived(element, "C", "gyroscopic")
    K_d = derived(element, "K", "spin", "euler")
    printed = weighted(element, 2 * (W_TILDE * W_TILDE + E_TILDE) * N)
    assert equal(C_d, weighted(element, 2 * W_TILDE * N))
    assert equal(C_d, -C_d.T)
    assert not equal(printed, C_d)
    assert equal(printed, 2 * K_d)
    assert equal((printed + printed.T) / 2, -2 * omega**2 * by_hand.mass(rho_A, length))
    # With the unit of time halved, a damping grows by 2 and the printed matrix, like a stiffness, by 4.
    faster = {omega: 2 * omega, epsilon: 4 * epsilon}
    assert equal(C_d.xreplace(faster), 2 * C_d)
    assert equal(printed.xreplace(faster), 4 * printed)


def test_46_dynamic_stiffness(element):
    """(98) is right; (46) prints epsilon without a tilde, which would make the Euler term symmetric."""
    N = element.shape
    K_d = derived(element, "K", "spin", "euler")
    assert equal(K_d, weighted(element, Matrix([[-(omega**2), -epsilon], [epsilon, -(omega**2)]]) * N))
    printed = weighted(element, (W_TILDE * W_TILDE + epsilon * Matrix.eye(2)) * N)
    assert equal(printed, printed.T)
    assert not equal(K_d, printed)


def test_55_first_shape_function(element):
    """Printed N_1 = (2 x^3 - 3 x^2 + l^3)/l^3 adds an area to a volume and does not vanish at x = l."""
    printed = (2 * x**3 - 3 * x**2 + length**3) / length**3
    N_1 = element.shape[1, 1]
    assert (N_1 - (2 * x**3 - 3 * length * x**2 + length**3) / length**3).expand() == 0
    assert N_1.subs(x, length).expand() == 0
    assert (printed.subs(x, length) - (3 - 3 / length)).expand() == 0


def test_63_centrifugal_load(element):
    """Printed + rho A int r^T w~w~ N pulls inwards: it is exactly minus the load."""
    load = derived(element, "F", "load").xreplace({epsilon: 0, a_x: 0, a_y: 0, x_0: 0})
    r = Matrix([x, 0])
    printed = (rho_A * r.T * W_TILDE * W_TILDE * element.shape).applyfunc(integral).T
    outwards = rho_A * omega**2 * length**2 / 6 * Matrix([1, 0, 0, 2, 0, 0])
    assert equal(load, outwards)
    assert equal(printed, -outwards)


def test_73_distance_inside_the_integral(element):
    """Printed r_2 = [l_2, 0, 0] at every x doubles the resultant and splits it 1/2 : 1/2, not 1/3 : 2/3."""
    field = W_TILDE * W_TILDE + E_TILDE
    load = derived(element, "F", "load").xreplace({a_x: 0, a_y: 0, x_0: 0})
    corrected = -weighted(element, field * Matrix([x, 0]))
    printed = -weighted(element, field * Matrix([length, 0]))
    assert equal(load, corrected)
    pull = rho_A * omega**2 * length**2
    assert equal(load.extract([0, 3], [0]), pull * Matrix([Rational(1, 6), Rational(1, 3)]))
    assert equal(printed.extract([0, 3], [0]), pull * Matrix([Rational(1, 2), Rational(1, 2)]))
    for component in (0, 1):
        resultant = load[component] + load[component + 3]
        assert (printed[component] + printed[component + 3] - 2 * resultant).expand() == 0


def rod_loads_as_printed(phi, motion):
    """Resultant (axial, transverse) of (72) with (73)-(79), (83) as printed: p_2 = (x_C2, y_C2, phi_2)."""
    w_1, phi_2, w_2, e_2 = SPEED, motion["phi2"], motion["omega2"], motion["epsilon2"]
    s_1, c_1, s_2, c_2 = np.sin(phi), np.cos(phi), np.sin(phi_2), np.cos(phi_2)
    half = L_2 / 2
    p = np.array([L_1 * c_1 + half * c_2, L_1 * s_1 + half * s_2, phi_2])
    p_d = np.array([-L_1 * w_1 * s_1 + half * w_2 * s_2, L_1 * w_1 * c_1 + half * w_2 * c_2, w_2])
    p_dd = np.array(
        [-L_1 * w_1**2 * c_1 - half * (e_2 * s_2 + w_2**2 * c_2),
         -L_1 * w_1**2 * s_1 + half * (e_2 * c_2 - w_2**2 * s_2),
         e_2]
    )
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    field_1, field_2 = w_1**2 * turn @ turn, e_2 * turn + w_2**2 * turn @ turn
    c, s = np.cos(phi - phi_2), np.sin(phi - phi_2)
    A_12 = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    acceleration = field_2 @ [L_2, 0, 0] + A_12 @ (p_dd + 2 * w_1 * turn @ p_d + field_1 @ p)
    return -ROD[rho_A] * L_2 * acceleration[:2]


def rod_loads_derived(element, phi, motion):
    """The same resultant from the derived element; the rod's frame has its origin at the crank pin."""
    s_2, c_2 = np.sin(motion["phi2"]), np.cos(motion["phi2"])
    pin = -L_1 * SPEED**2 * np.array([np.cos(phi), np.sin(phi)])
    F = numbers(
        derived(element, "F", "load"), omega=motion["omega2"], epsilon=motion["epsilon2"],
        a_x=c_2 * pin[0] + s_2 * pin[1], a_y=-s_2 * pin[0] + c_2 * pin[1],
    )[:, 0]
    return np.array([F[0] + F[3], F[1] + F[4]])


def test_72_to_76_generalised_coordinates_of_the_rod(element):
    """Printed p_2 counts the rod's motion twice: 12.4 kN against 2.77 axial, 8.7 against 1.27 kN transverse.

    Corrected: p_2 = [l_1, 0, 0] in the crank's axes, p_2' = p_2'' = 0, and r_2 = [x, 0, 0].
    """
    printed, found, corrected = [], [], []
    for phi in CRANK_ANGLES:
        motion = by_hand.slider_crank(L_1, L_2, phi, SPEED)
        printed.append(rod_loads_as_printed(phi, motion))
        found.append(rod_loads_derived(element, phi, motion))
        delta, w_2, e_2 = phi - motion["phi2"], motion["omega2"], motion["epsilon2"]
        pin = -L_1 * SPEED**2 * np.array([np.cos(delta), np.sin(delta)])
        centre = L_2 / 2 * np.array([-(w_2**2), e_2])
        corrected.append(-ROD[rho_A] * L_2 * (pin + centre))
    printed, found, corrected = np.array(printed), np.array(found), np.array(corrected)
    assert found == pytest.approx(corrected, abs=1e-9)
    assert np.abs(found).max(axis=0) == pytest.approx([2768.8, 1273.1], rel=1e-4)
    assert np.abs(printed).max(axis=0) == pytest.approx([12444, 8733], rel=1e-4)
    rms_error = np.sqrt(((printed - found) ** 2).sum() / (found**2).sum())
    assert rms_error == pytest.approx(3.93, abs=0.01)


def test_95_bending_stiffness_of_the_rod(element):
    """Printed EI/l_1^3 in front of the rod's own matrix is (l_2/l_1)^3 = 40.2 times too stiff."""
    term = next(term for term in element.terms if term.name == "bending_stiffness")
    K_bending = numbers(term.matrix)
    printed = ROD[E_I] / L_1**3 * by_hand.bending_stiffness(1.0, L_2) * L_2**3
    assert pytest.approx(by_hand.bending_stiffness(ROD[E_I], L_2)) == K_bending
    assert np.linalg.norm(printed) / np.linalg.norm(K_bending) == pytest.approx(40.2, abs=0.05)


def test_97_axial_stiffness_of_the_rod(element):
    """Printed AE/l_1 in K_11, K_14, AE/l_2 in K_41, K_44: not symmetric, and the forces do not balance."""
    term = next(term for term in element.terms if term.name == "axial_stiffness")
    K_axial = numbers(term.matrix)
    printed = by_hand.axial_stiffness(ROD[E_A], L_2)
    printed[0] *= L_2 / L_1
    shift = np.array([1.0, 0, 0, 1, 0, 0])
    assert pytest.approx(by_hand.axial_stiffness(ROD[E_A], L_2)) == K_axial
    assert pytest.approx(K_axial.T) == K_axial and np.abs(K_axial @ shift).max() == 0
    assert printed[0, 0] / K_axial[0, 0] == pytest.approx(3.425)
    assert printed[0, 3] != pytest.approx(printed[3, 0], rel=0.5)
    assert np.abs(shift @ printed).max() > 0.5 * K_axial.max()


def test_106_transformation(element):
    """Printed Q = T q means K = T k T^T; with T of (66), q = T Q and K = T^T k T: 53 % apart at 0.2 rad."""
    phi = 0.2
    T = by_hand.rotation_to_local(np.cos(phi), np.sin(phi)).astype(float)
    k = numbers(derived(element, "K", "elastic"))
    corrected, printed = T.T @ k @ T, T @ k @ T.T
    stretch = np.array([0, 0, 0, np.cos(phi), np.sin(phi), 0])  # of the far end along the rod, global components
    assert corrected @ stretch == pytest.approx(ROD[E_A] / L_2 * (stretch - np.roll(stretch, 3)), abs=1e-3)
    assert printed @ stretch != pytest.approx(ROD[E_A] / L_2 * (stretch - np.roll(stretch, 3)), rel=0.1)
    assert np.linalg.norm(printed - corrected) / np.linalg.norm(corrected) == pytest.approx(0.53, abs=0.005)


def test_109_constraint_of_the_slider(element):
    """Q_8 = 0, the slider on X; (119) and Fig. 21 remove Q_7, which leaves the frame free to turn about O."""
    stiffness = derived(element, "K", "elastic")
    crank = stiffness.xreplace({length: L_1, E_A: 6.37e8, E_I: 1.61e5})
    rod = stiffness.xreplace({length: L_2, E_A: ROD[E_A], E_I: ROD[E_I]})
    phi = 1.0
    angles = phi, by_hand.slider_crank(L_1, L_2, phi, SPEED)["phi2"]
    K = np.zeros((9, 9))
    for part, angle, first in ((crank, angles[0], 0), (rod, angles[1], 3)):
        T = by_hand.rotation_to_local(np.cos(angle), np.sin(angle)).astype(float)
        K[first : first + 6, first : first + 6] += T.T @ np.array(part.tolist(), dtype=float) @ T
    for removed, singular in ((7, False), (6, True)):
        free = [i for i in range(2, 9) if i != removed]
        # Metres and radians made comparable by the crank's length.
        scale = np.array([L_1 if i % 3 == 2 else 1.0 for i in free])
        eigenvalues = np.linalg.eigvalsh(K[np.ix_(free, free)] / np.outer(scale, scale))
        assert bool(eigenvalues[0] < 1e-12 * eigenvalues[-1]) is singular
