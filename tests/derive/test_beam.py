"""The derived element: its terms, what holds for any shape functions, and Kane's equations of masses and of bending.

Its matrices are compared with others by number, in test_spatial_element and test_beam_kane_gauss.
"""

import os
import subprocess
import sys

import closed_forms as by_hand
import pytest
from sympy import Matrix, Symbol, diff, integrate, srepr, symbols
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, dynamicsymbols

from kaneflex.derive.elements import beam
from kaneflex.derive.elements.beam import P_0, a_x, a_y, epsilon, omega
from kaneflex.derive.elements.shapes import E_A, E_I, beam_section, beam_shape, integral, length, rho_A, x, x_0

# Group, matrix and scalar of each term, by its name.
EXPECTED_TERMS = {
    "mass": ("inertia", "M", 1),
    "gyroscopic": ("gyroscopic", "C", omega),
    "spin": ("spin", "K", omega**2),
    "euler": ("euler", "K", epsilon),
    "centrifugal_load": ("load", "F", omega**2),
    "euler_load": ("load", "F", epsilon),
    "load_x": ("load", "F", a_x),
    "load_y": ("load", "F", a_y),
    "axial_stiffness": ("elastic", "K", 1),
    "bending_stiffness": ("elastic", "K", 1),
    "tension_origin": ("geometric", "K", P_0),
    "tension_acceleration": ("geometric", "K", a_x),
    "tension_spin": ("geometric", "K", omega**2),
    "viscous": ("damping", "C", 1),
}


@pytest.fixture(scope="module")
def element():
    return beam.beam_element()


@pytest.fixture(scope="module")
def matrices(element):
    """Constant matrices by term name."""
    return {term.name: term.matrix for term in element.terms + element.frame_terms}


def equal(derived, expected) -> bool:
    """Exact equality of two matrices; expected may be an array of numbers and SymPy expressions."""
    return (Matrix(derived) - Matrix(expected)).expand().is_zero_matrix


def test_terms_are_the_affine_form_and_nothing_else(element):
    assert {t.name: (t.group, t.target, t.scalar) for t in element.terms} == EXPECTED_TERMS
    assert [name for name, *_ in element.parameters] == ["rho_A", "E_A", "E_I", "length", "x_0"]
    assert [name for name, *_ in element.scalars] == ["omega", "epsilon", "a_x", "a_y", "P_0"]
    names = [term.name for term in element.terms + element.frame_terms]
    assert len(names) == len(set(names))


def test_matrices_hold_parameters_only_and_scalars_hold_the_motion_only(element):
    parameters = {symbol for _, symbol, *_ in element.parameters}
    scalars = {symbol for _, symbol, *_ in element.scalars}
    for term in element.terms + element.frame_terms:
        assert term.matrix.free_symbols <= parameters, term.name
        assert getattr(term.scalar, "free_symbols", set()) <= scalars, term.name


def test_shape_functions_interpolate_the_nodes(element):
    """N and v' at both ends give back q, which the printed (55) would not at x = l."""
    u, v = element.shape[0, :], element.shape[1, :]
    rows = Matrix.vstack(u, v, diff(v, x))
    assert equal(Matrix.vstack(rows.subs(x, 0), rows.subs(x, length)), Matrix.eye(6))


def test_symmetry_and_rigid_motion(matrices):
    """What must hold for any shape functions: symmetry, no force for rigid motion, Kane's reciprocity."""
    square = {name for name, (_, target, _) in EXPECTED_TERMS.items() if target in "MCK"}
    for name in square:
        sign = -1 if name in ("gyroscopic", "euler") else 1
        assert equal(matrices[name], sign * matrices[name].T), name
    shift_x, shift_y = Matrix([1, 0, 0, 1, 0, 0]), Matrix([0, 1, 0, 0, 1, 0])
    turn = Matrix([0, x_0, 1, 0, x_0 + length, 1])
    stiffness = matrices["axial_stiffness"] + matrices["bending_stiffness"]
    assert (stiffness * Matrix.hstack(shift_x, shift_y, turn)).expand().is_zero_matrix
    accelerations = ("load_x", "load_y", "euler_load")
    frame_inertia = -Matrix.hstack(*(matrices[f"frame_{name}"] for name in accelerations))
    assert equal(matrices["frame_mass"] * Matrix.hstack(shift_x, shift_y, turn), frame_inertia)
    loads = Matrix.hstack(*(matrices[name] for name in accelerations))
    assert equal(loads, -matrices["frame_mass"].T)


def test_section_and_length_scale_nothing_else(matrices):
    """Each stiffness holds its own rigidity, each inertia its own mass: nothing leaks into a neighbour."""
    for name, own in (("axial_stiffness", E_A), ("bending_stiffness", E_I)):
        assert matrices[name].free_symbols == {own, length}
    for name in ("mass", "gyroscopic", "spin", "euler"):
        assert matrices[name].free_symbols == {rho_A, length}


# --- Kane alone ---


def kane_rows(position, speeds, coordinates, mass, motion):
    """fr* of a point mass at `position` (link axes) in a frame whose motion is prescribed."""
    inertial, link = ReferenceFrame("inertial"), ReferenceFrame("link")
    origin, point = Point("origin"), Point("point")
    link.set_ang_vel(inertial, motion["w"] * link.z)
    origin.set_vel(inertial, motion["v_x"] * link.x + motion["v_y"] * link.y)
    time = dynamicsymbols._t
    kinematics = [q.diff(time) - u for q, u in zip(coordinates, speeds, strict=True)]
    rates = dict(zip([q.diff(time) for q in coordinates], speeds, strict=True))
    point.set_pos(origin, position[0] * link.x + position[1] * link.y)
    velocity = [part.diff(time).xreplace(rates) for part in position]
    point.set_vel(link, velocity[0] * link.x + velocity[1] * link.y)
    point.v1pt_theory(origin, inertial, link)
    kane = KanesMethod(inertial, q_ind=coordinates, u_ind=speeds, kd_eqs=kinematics)
    return kane.kanes_equations([Particle("particle", point, mass)])[1]


def test_lumped_mass_in_local_axes():
    """Kane's equations of a point mass at the second node equal the hand-written M, G and load."""
    time = dynamicsymbols._t
    q, u = dynamicsymbols("q_1:7"), dynamicsymbols("u_1:7")
    v_x, v_y, w = dynamicsymbols("v_x v_y w")
    m, X = symbols("m X")
    row = kane_rows((X + q[3], q[4]), u, q, m, {"v_x": v_x, "v_y": v_y, "w": w})
    a_origin = {v_x.diff(time): a_x + w * v_y, v_y.diff(time): a_y - w * v_x}
    inertia_force = row.xreplace(a_origin).xreplace({w.diff(time): epsilon, w: omega})
    M, G = Matrix(by_hand.lumped_mass(m)), Matrix(by_hand.lumped_gyration(m))
    q, u, a = Matrix(q), Matrix(u), Matrix(u).diff(time)
    F = Matrix(by_hand.lumped_load(m, X, omega, epsilon, a_x, a_y))
    assert equal(inertia_force, F - M * a - 2 * omega * G * u - (-(omega**2) * M + epsilon * G) * q)


def foreshortened_free_tip() -> Matrix:
    """K_g on (v1, th1, v2, th2) of a one-element link with a free tip, from Kane alone.

    The foreshortening -1/2 int_0^x v'^2 = -1/2 q^T H q stays in the position of the particle at x, and the
    equations are linearised only after the partial velocities are formed (Kane, Ryan and Banerjee 1987, J.
    Guidance 10, 139-151). What they then hold beside those of the straight position is K_g q.
    """
    time = dynamicsymbols._t
    q, u = Matrix(dynamicsymbols("q_1:5")), Matrix(dynamicsymbols("u_1:5"))
    v_x, v_y, w = dynamicsymbols("v_x v_y w")
    motion = {"v_x": v_x, "v_y": v_y, "w": w}
    N = Matrix(symbols("N_1:5")).T
    H = Matrix(4, 4, lambda i, j: Symbol(f"H_{min(i, j)}{max(i, j)}"))
    straight = kane_rows((x, (N * q)[0]), list(u), list(q), rho_A, motion)
    bent = kane_rows((x - (q.T * H * q)[0] / 2, (N * q)[0]), list(u), list(q), rho_A, motion)

    difference = (straight - bent).xreplace({v_x.diff(time): a_x + w * v_y, v_y.diff(time): a_y - w * v_x})
    difference = difference.xreplace({w.diff(time): epsilon, w: omega})
    at_rest = dict.fromkeys([*q, *u, *u.diff(time)], 0)
    assert difference.jacobian(u.col_join(u.diff(time))).xreplace(at_rest).is_zero_matrix
    slope = beam_shape(beam_section()).slope[:, by_hand.BENDING]
    shortening = (slope.T * slope).applyfunc(lambda entry: integrate(entry.expand(), (x, 0, x)))
    per_length = difference.jacobian(q).xreplace(at_rest).xreplace(dict(zip(H, shortening, strict=True)))
    return per_length.applyfunc(integral)


def test_foreshortening_in_kane_gives_the_geometric_stiffness(matrices):
    """The free tip: P_0 = -rho_A a_x l + rho_A omega^2 l^2/2, x_0 = 0."""
    P_0_free_tip = -rho_A * a_x * length + rho_A * omega**2 * length**2 / 2
    K_g = (
        P_0_free_tip * matrices["tension_origin"]
        + a_x * matrices["tension_acceleration"]
        + omega**2 * matrices["tension_spin"]
    )
    bending = by_hand.BENDING
    assert equal(foreshortened_free_tip(), K_g.extract(bending, bending).subs(x_0, 0))


def test_two_elements_carry_the_tension_of_one_link(matrices):
    """K_g does work int P v'^2 over the link: the second element's x_0 continues where the first one ends."""
    X = Symbol("X")
    P = P_0 + rho_A * a_x * X - rho_A * omega**2 * X**2 / 2
    K_g = (
        P_0 * matrices["tension_origin"]
        + a_x * matrices["tension_acceleration"]
        + omega**2 * matrices["tension_spin"]
    )
    slope = 1 + X - X**2  # of v = X + X^2/2 - X^3/3, which the Hermite shape functions hold exactly
    v = integrate(slope, X)
    work = 0
    for start in (0, length):
        end = start + length
        q = Matrix([0, v.subs(X, start), slope.subs(X, start), 0, v.subs(X, end), slope.subs(X, end)])
        work += (q.T * K_g.subs(x_0, start) * q)[0]
    assert (work - integrate((P * slope**2).expand(), (X, 0, 2 * length))).expand() == 0


def test_derivation_is_the_same_for_every_hash_seed(element):
    """For this process' seed, which is drawn, and for 0, by which none is."""
    code = (
        "from sympy import srepr; from kaneflex.derive.elements.beam import beam_element; e = beam_element();"
        "print([(t.name, srepr(t.scalar), srepr(t.matrix)) for t in e.terms + e.frame_terms])"
    )
    environment = os.environ | {"PYTHONHASHSEED": "0"}
    command = [sys.executable, "-c", code]
    other = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
    here = str([(t.name, srepr(t.scalar), srepr(t.matrix)) for t in element.terms + element.frame_terms])
    assert len(here) > 1000 and other == here + "\n"
