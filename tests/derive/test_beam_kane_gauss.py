"""Unmodified KanesMethod with the element's mass at four Gauss points reproduces the derived element.

Four points integrate polynomials up to degree 7 exactly, and no integrand has more than 6. The route shares
nothing with the derivation: angle and position of the frame are free coordinates in global axes, numbers go
in before Kane's method starts, the shape functions are typed again and the comparison is at random states.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from sympy import Matrix, lambdify
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, dynamicsymbols

from kaneflex.derive.elements.beam import beam_element

TOLERANCE = 1e-13
GRAVITY = 9.81
DATA = {"rho_A": 1.117, "E_A": 2.9e7, "E_I": 1472.0, "length": 0.034, "x_0": 0.103}


def shape_rows(x, l):
    """Values of N_u, N_v, N_u', N_v', N_v'' at x over the six coordinates; paper (54), (55) by s = x/l."""
    s = x / l
    value = [1 - 3 * s**2 + 2 * s**3, l * s * (1 - s) ** 2, s**2 * (3 - 2 * s), l * s**2 * (s - 1)]
    slope = [6 * s * (s - 1) / l, (1 - s) * (1 - 3 * s), 6 * s * (1 - s) / l, s * (3 * s - 2)]
    curvature = [(12 * s - 6) / l**2, (6 * s - 4) / l, (6 - 12 * s) / l**2, (6 * s - 2) / l]
    axial = [np.array([a, 0, 0, b, 0, 0]) for a, b in ((1 - s, s), (-1 / l, 1 / l))]
    transverse = [np.array([0, a, b, 0, c, d]) for a, b, c, d in (value, slope, curvature)]
    return axial[0], transverse[0], axial[1], transverse[1], transverse[2]


def gauss_points():
    """(x, weight) of the four-point rule on 0..length."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = DATA["length"] / 2
    return [(half * (1 + s), half * w) for s, w in zip(nodes, weights, strict=True)]


@pytest.fixture(scope="module")
def lumped_rows():
    """fr + fr* of the four particles as a function of (phi, omega, X'', Y'', epsilon, q, q', q'')."""
    X, Y, phi, *q = coordinates = dynamicsymbols("X Y phi q_1:7")
    V_x, V_y, w, *u = speeds = dynamicsymbols("V_x V_y w u_1:7")
    time = dynamicsymbols._t
    inertial = ReferenceFrame("inertial")
    link = inertial.orientnew("link", "Axis", (phi, inertial.z))
    link.set_ang_vel(inertial, w * inertial.z)
    ground, origin = Point("ground"), Point("origin")
    ground.set_vel(inertial, 0)
    origin.set_pos(ground, X * inertial.x + Y * inertial.y)
    origin.set_vel(inertial, V_x * inertial.x + V_y * inertial.y)
    bodies, loads = [], []
    for number, (x, weight) in enumerate(gauss_points()):
        N_u, N_v, *_ = shape_rows(x, DATA["length"])
        mass = DATA["rho_A"] * weight
        point = origin.locatenew(f"point_{number}", (DATA["x_0"] + x + N_u.dot(q)) * link.x + N_v.dot(q) * link.y)
        point.set_vel(link, N_u.dot(u) * link.x + N_v.dot(u) * link.y)
        point.v1pt_theory(origin, inertial, link)
        bodies.append(Particle(f"particle_{number}", point, mass))
        loads.append((point, -mass * GRAVITY * inertial.y))
    kinematics = [c.diff(time) - s for c, s in zip(coordinates, speeds, strict=True)]
    kane = KanesMethod(inertial, q_ind=coordinates, u_ind=speeds, kd_eqs=kinematics)
    fr, fr_star = kane.kanes_equations(bodies, loads)
    accelerations = list(Matrix(speeds).diff(time))
    return lambdify([phi, w, *accelerations[:3], q, u, accelerations[3:]], list(fr + fr_star))


@pytest.fixture(scope="module")
def derived():
    """Numbers for the derived terms: matrices[target] at given scalars."""
    element = beam_element()
    parameters = {symbol: DATA[name] for name, symbol, *_ in element.parameters}
    terms = element.terms + element.frame_terms
    constants = [(term, np.array(term.matrix.xreplace(parameters).tolist(), float)) for term in terms]

    def assembled(scalars, groups):
        values = {symbol: scalars.get(name, 0.0) for name, symbol, *_ in element.scalars}
        total = {}
        for term, constant in constants:
            if term.group in groups:
                scalar = float(term.scalar.xreplace(values))
                total[term.target] = total.get(term.target, 0.0) + scalar * constant
        return SimpleNamespace(**total)

    return assembled


@pytest.fixture(scope="module", params=[1, 2, 3])
def state(request):
    """A random motion of the frame and the element; the deformation may be large, for the model is linear."""
    random = np.random.default_rng(request.param)
    phi, omega, epsilon = random.uniform(-3, 3), random.uniform(-200, 200), random.uniform(-4e4, 4e4)
    acceleration = random.uniform(-1e4, 1e4, 2)
    elastic = random.uniform(-1, 1, (3, 6)) * np.array([[0.01], [1.0], [2e4]])
    return SimpleNamespace(phi=phi, omega=omega, epsilon=epsilon, acceleration=acceleration, elastic=elastic)


@pytest.fixture
def rows_at(lumped_rows, state):
    """fr + fr* with the elastic part times `factor`: the frame's rows in link axes, the elastic rows."""
    c, s = np.cos(state.phi), np.sin(state.phi)

    def evaluate(factor):
        elastic = factor * state.elastic
        motion = (state.phi, state.omega, *state.acceleration, state.epsilon)
        rows = np.array(lumped_rows(*motion, *elastic))
        rows[:2] = c * rows[0] + s * rows[1], -s * rows[0] + c * rows[1]
        return rows[:3], rows[3:]

    return evaluate


@pytest.fixture
def derived_here(derived, state):
    """The derived inertia at the state: a - g in link axes, gravity along -Y."""
    c, s = np.cos(state.phi), np.sin(state.phi)
    x, y = state.acceleration + np.array([0, GRAVITY])
    scalars = {"omega": state.omega, "epsilon": state.epsilon, "a_x": c * x + s * y, "a_y": -s * x + c * y}
    return derived(scalars, {"inertia", "gyroscopic", "spin", "euler", "load"})


def close(found, expected, *parts):
    """Equal to 1e-13 of the largest number that was summed."""
    scale = max(np.abs(part).max() for part in (expected, *parts))
    assert np.abs(found - expected).max() <= TOLERANCE * scale


def test_elastic_rows(rows_at, derived_here, state):
    q, q_d, q_dd = state.elastic
    parts = derived_here.F[:, 0], -derived_here.M @ q_dd, -derived_here.C @ q_d, -derived_here.K @ q
    close(rows_at(1.0)[1], sum(parts), *parts)
    close(rows_at(0.0)[1], parts[0])


def test_frame_rows_to_first_order(rows_at, derived_here, state):
    """The rows are quadratic in the deformation: their odd part is the part of first order."""
    q, q_d, q_dd = state.elastic
    parts = -derived_here.M_f @ q_dd, -derived_here.C_f @ q_d, -derived_here.K_f @ q
    rigid = rows_at(0.0)[0]
    close(rigid, derived_here.F_f[:, 0])
    close((rows_at(1.0)[0] - rows_at(-1.0)[0]) / 2, sum(parts), *parts, rigid)


def test_stiffness_and_damping(derived, state):
    """K_s, K_g and the viscous matrix from values of the shape functions at the Gauss points."""
    P_0, a_x = -3.3e4, state.acceleration[0]
    scalars = {"omega": state.omega, "a_x": a_x, "P_0": P_0}
    elastic, geometric, damping = (np.zeros((6, 6)) for _ in range(3))
    for x, weight in gauss_points():
        N_u, N_v, strain, slope, curvature = shape_rows(x, DATA["length"])
        X = DATA["x_0"] + x
        tension = P_0 + DATA["rho_A"] * (a_x * X - state.omega**2 * X**2 / 2)
        elastic += weight * DATA["E_A"] * np.outer(strain, strain)
        elastic += weight * DATA["E_I"] * np.outer(curvature, curvature)
        geometric += weight * tension * np.outer(slope, slope)
        damping += weight * (np.outer(N_u, N_u) + np.outer(N_v, N_v))
    close(derived(scalars, {"elastic"}).K, elastic)
    close(derived(scalars, {"geometric"}).K, geometric)
    close(derived(scalars, {"damping"}).C, damping)
