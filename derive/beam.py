"""Planar beam elements through Kane's method: the constant matrices of the affine form.

A differential particle of mass rho_A dx sits at r + N q in the link's floating frame with r = (x_0 + x, 0).
An unmodified ``KanesMethod`` gives its generalised inertia forces at x; they are polynomials in the elastic
coordinates, in the motion of the frame and in the shape functions, so the integral over the element is a
table of moments and the affine form

    sum_k s_k(t) M_k q'' + sum_k s_k(t) C_k q' + sum_k s_k(t) K_k q = sum_k s_k(t) F_k

is read off the coefficients, not typed in. The strain energy and the work of the axial tension add their
generalised active forces as further stiffness terms.

Sources: paper equations (28), (43), (44) with the single tilde of (41), (46), (49)-(55), (89), (90), (98);
Kane, Ryan and Banerjee (1987) for the geometric stiffness, which the paper leaves out.
"""

from dataclasses import dataclass
from functools import cache

from sympy import Expr, ImmutableMatrix, Poly, Rational, S, Symbol, diff, prod, symbols, zeros
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, dynamicsymbols

from kaneflex.contract import ELEMENT_PARAMETERS, LINK_SCALARS

rho_A, E_A, E_I, length, x_0 = symbols([name for name, *_ in ELEMENT_PARAMETERS], positive=True)
omega, epsilon, a_x, a_y, P_0 = symbols([name for name, *_ in LINK_SCALARS], real=True)
x = Symbol("x", real=True)

MOTION = (omega, epsilon, a_x, a_y)

# A term's name and group follow from where Kane's equations put it: (matrix, monomial of the motion).
KANE_TERMS = {
    ("M", S.One): ("mass", "inertia"),
    ("C", omega): ("gyroscopic", "gyroscopic"),
    ("K", omega**2): ("spin", "spin"),
    ("K", epsilon): ("euler", "euler"),
    # Only the frame's row of moments has these two: the load acts at the displaced point.
    ("K", a_x): ("displaced_load_x", "load"),
    ("K", a_y): ("displaced_load_y", "load"),
    ("F", omega**2): ("centrifugal_load", "load"),
    ("F", epsilon): ("euler_load", "load"),
    ("F", a_x): ("load_x", "load"),
    ("F", a_y): ("load_y", "load"),
}
TENSION_TERMS = {P_0: "tension_origin", a_x: "tension_acceleration", omega**2: "tension_spin"}

Quantity = tuple[str, Symbol, str, str]
Affine = dict[tuple[str, Expr], ImmutableMatrix]


@dataclass(frozen=True)
class ShapeFunctions:
    """The kinematics of one element type: rows over the element's coordinates, polynomials in x in 0..length.

    displacement: 2 x n, the displacement (u, v) = N q in link axes [m].
    slope: 1 x n, dv/dx, the rotation of the axis on which an axial tension does work [rad].
    strains: (name, row 1 x n, rigidity) of each generalised strain; its energy is 1/2 rigidity strain^2.
    """

    displacement: ImmutableMatrix
    slope: ImmutableMatrix
    strains: tuple[tuple[str, ImmutableMatrix, Expr], ...]


@dataclass(frozen=True)
class Term:
    """One scalar x constant matrix of the affine form.

    target: the matrix that it belongs to, "M", "C", "K" (n x n), "F" (n x 1, right-hand side); in the frame's
    rows "M_f", "C_f", "K_f" (3 x n), "F_f" (3 x 1). scalar: monomial of the motion's scalars, 1 if constant.
    """

    name: str
    group: str
    target: str
    scalar: Expr
    matrix: ImmutableMatrix


@dataclass(frozen=True)
class Element:
    """A beam element in the axes of its link; parameters and scalars are (name, symbol, unit, meaning).

    terms: ``M q'' + C q' + K q = F`` in the element's coordinates q = (u1, v1, theta1, u2, v2, theta2).
    frame_terms: ``M_f q'' + C_f q' + K_f q - F_f`` is the force (x, y; link axes) and the moment about the
    link's origin that the rest of the mechanism applies to the element, to first order in q.
    shape: N(x), 2 x 6, with x from the element's first node.
    """

    parameters: tuple[Quantity, ...]
    scalars: tuple[Quantity, ...]
    terms: tuple[Term, ...]
    frame_terms: tuple[Term, ...]
    shape: ImmutableMatrix

    def matrix(self, target: str) -> ImmutableMatrix:
        """The sum of scalar x matrix over the terms of `target`, less "viscous", which waits for its mu."""
        chosen = [t for t in self.terms + self.frame_terms if t.target == target and t.group != "damping"]
        return sum((t.scalar * t.matrix for t in chosen), ImmutableMatrix.zeros(*chosen[0].matrix.shape))


def hermite_shape() -> ShapeFunctions:
    """Euler-Bernoulli: axial linear and transverse cubic Hermite shape functions, paper (49)-(55).

    N1 is (2 x^3 - 3 l x^2 + l^3)/l^3 as in (61); the printed (55) lacks an l. The section follows the axis
    (theta = v'), so curvature is v'', paper (88) with the bending rigidity of (89).
    """
    s = x / length
    N_1x, N_2x = 1 - s, s
    N_1, N_2 = 1 - 3 * s**2 + 2 * s**3, length * (s - 2 * s**2 + s**3)
    N_3, N_4 = 3 * s**2 - 2 * s**3, length * (s**3 - s**2)
    displacement = ImmutableMatrix([[N_1x, 0, 0, N_2x, 0, 0], [0, N_1, N_2, 0, N_3, N_4]])
    u, v = displacement[0, :], displacement[1, :]
    return ShapeFunctions(
        displacement=displacement,
        slope=diff(v, x),
        strains=(("axial", diff(u, x), E_A), ("bending", diff(v, x, 2), E_I)),
    )


def integral(integrand: Expr) -> Expr:
    """Exact integral of a polynomial over x in 0..length, by the moments int x^k dx = length^(k+1)/(k+1)."""
    terms = Poly(integrand, x).terms()
    return sum((c * length ** (k + 1) * Rational(1, k + 1) for (k,), c in terms), S.Zero).expand()


@dataclass(frozen=True)
class ParticleEquations:
    """Kane's equations of the differential particle at x, per unit length.

    rows: fr + fr*, first the frame's three (force x, y, moment), then the elastic ones; polynomials in x and
    the symbols below. shape: (symbol, polynomial in x) of each shape function. q, q_d, q_dd: elastic
    coordinates and their derivatives.
    """

    rows: tuple[Expr, ...]
    shape: tuple[tuple[Symbol, Expr], ...]
    q: tuple[Symbol, ...]
    q_d: tuple[Symbol, ...]
    q_dd: tuple[Symbol, ...]


def particle_equations(displacement: ImmutableMatrix) -> ParticleEquations:
    """Kane's equations of one particle of mass rho_A at r + N q under gravity, paper (17), (28).

    Generalised speeds: the velocity of the frame's origin in link axes, omega, and the n elastic q'. The
    frame needs no coordinates, so no angle appears. The shape functions enter as symbols: time derivatives
    do not touch them, and their polynomials would only be expanded again and again.
    """
    n = displacement.cols
    N = ImmutableMatrix(2, n, lambda i, j: Symbol(f"N_{i}_{j}") if displacement[i, j] != 0 else S.Zero)
    shape = tuple(pair for pair in zip(N, displacement, strict=True) if pair[0] != 0)
    q, u = dynamicsymbols(f"q_1:{n + 1}"), dynamicsymbols(f"u_1:{n + 1}")
    v_x, v_y, w = dynamicsymbols("v_x v_y w")
    g_x, g_y = symbols("g_x g_y")

    inertial, link = ReferenceFrame("inertial"), ReferenceFrame("link")
    link.set_ang_vel(inertial, w * link.z)
    origin, point = Point("origin"), Point("point")
    origin.set_vel(inertial, v_x * link.x + v_y * link.y)
    displaced, rate = N * ImmutableMatrix(q), N * ImmutableMatrix(u)
    point.set_pos(origin, (x_0 + x + displaced[0]) * link.x + displaced[1] * link.y)
    point.set_vel(link, rate[0] * link.x + rate[1] * link.y)
    point.v1pt_theory(origin, inertial, link)

    time = dynamicsymbols._t
    kinematics = [q_i.diff(time) - u_i for q_i, u_i in zip(q, u, strict=True)]
    kane = KanesMethod(inertial, q_ind=q, u_ind=[v_x, v_y, w, *u], kd_eqs=kinematics)
    weight = rho_A * (g_x * link.x + g_y * link.y)
    fr, fr_star = kane.kanes_equations([Particle("particle", point, rho_A)], [(point, weight)])

    plain_q, plain_d, plain_dd = (symbols(f"{name}_1:{n + 1}") for name in ("q", "qd", "qdd"))
    plain_vx, plain_vy = symbols("v_x v_y")
    plain = dict(zip([*q, *u, *(u_i.diff(time) for u_i in u)], [*plain_q, *plain_d, *plain_dd], strict=True))
    # a = dv/dt + omega x v, and gravity acts as an acceleration -g of the frame: v and g must then drop out.
    plain |= {v_x: plain_vx, v_y: plain_vy, w: omega, w.diff(time): epsilon}
    plain |= {v_x.diff(time): a_x + g_x + omega * plain_vy, v_y.diff(time): a_y + g_y - omega * plain_vx}
    rows = tuple(row.xreplace(plain).expand() for row in fr + fr_star)
    left = set().union(*(row.free_symbols for row in rows)) & {g_x, g_y, plain_vx, plain_vy}
    assert not left, f"the equations depend on {sorted(map(str, left))} beside the acceleration a - g"
    return ParticleEquations(rows, shape, plain_q, plain_d, plain_dd)


def affine_terms(equations: ParticleEquations, first: int, last: int) -> Affine:
    """Rows first..last-1 integrated over the element: {(matrix, monomial of the motion): constant matrix}.

    Found by collecting the coefficients of q'', q', q, 1 and, inside each, the motion's monomials. Products
    of elastic coordinates, which only the frame's rows have, are of second order and left out.
    """
    n, m = len(equations.q), len(MOTION)
    shapes = tuple(polynomial for _, polynomial in equations.shape)
    shape_symbols = tuple(symbol for symbol, _ in equations.shape)
    generators = (*equations.q_dd, *equations.q_d, *equations.q, *MOTION, x, *shape_symbols)

    @cache
    def moment(powers: tuple[int, ...]) -> Expr:
        return integral(prod(base**power for base, power in zip((x, *shapes), powers, strict=True)))

    matrices = {}
    for i, row in enumerate(equations.rows[first:last]):
        for powers, coefficient in Poly(row, *generators).terms():
            elastic, motion, local = powers[: 3 * n], powers[3 * n : 3 * n + m], powers[3 * n + m :]
            if sum(elastic) > 1:
                continue
            scalar = prod(symbol**power for symbol, power in zip(MOTION, motion, strict=True))
            # fr + fr* = 0 reads -(M q'' + C q' + K q) + F: only the right-hand side keeps Kane's sign.
            if 1 in elastic:
                kind, j = divmod(elastic.index(1), n)
                target, columns, sign = "MCK"[kind], n, -1
            else:
                target, columns, sign, j = "F", 1, 1, 0
            matrix = matrices.setdefault((target, scalar), zeros(last - first, columns))
            matrix[i, j] += sign * coefficient * moment(local)
    return {key: ImmutableMatrix(matrix).expand() for key, matrix in matrices.items()}


def inertia_terms(equations: ParticleEquations) -> tuple[tuple[Term, ...], tuple[Term, ...]]:
    """The inertia's terms in the elastic rows and in the frame's own three, in the order of KANE_TERMS."""
    elastic, frame = affine_terms(equations, 3, len(equations.rows)), affine_terms(equations, 0, 3)
    unknown = [key for key in (*elastic, *frame) if key not in KANE_TERMS]
    assert not unknown, f"Kane's equations hold terms without a name: {unknown}"
    of_element = [Term(*KANE_TERMS[key], *key, elastic[key]) for key in KANE_TERMS if key in elastic]
    of_frame = [
        Term("frame_" + name, group, target + "_f", scalar, frame[target, scalar])
        for (target, scalar), (name, group) in KANE_TERMS.items()
        if (target, scalar) in frame
    ]
    return tuple(of_element), tuple(of_frame)


def elastic_terms(shape: ShapeFunctions) -> tuple[Term, ...]:
    """K_s, one term for each generalised strain B q, paper (46), (88), (89), (96).

    The strain energy 1/2 rigidity (B q)^2 per length has the generalised active force -rigidity B^T B q.
    """
    return tuple(
        Term(f"{name}_stiffness", "elastic", "K", S.One, (rigidity * B.T * B).applyfunc(integral))
        for name, B, rigidity in shape.strains
    )


def axial_tension(equations: ParticleEquations) -> Expr:
    """The tension P(x_0 + x) of the rigid, uniform link, from its motion and the force P_0 at its origin.

    A slice of the link is in equilibrium under dP and the inertia in Kane's row of the frame's axial speed at
    q = 0: dP/dX = -(fr + fr*), so that P = P_0 + rho_A a_x X - rho_A omega^2 X^2/2 in the LINK's X.
    """
    X = Symbol("X")
    at_rest = dict.fromkeys((*equations.q, *equations.q_d, *equations.q_dd), S.Zero)
    growth = -equations.rows[0].xreplace(at_rest).xreplace({x: X - x_0})
    P_of_X = sum((c * X ** (k + 1) / (k + 1) for (k,), c in Poly(growth, X).terms()), P_0)
    return P_of_X.xreplace({X: x_0 + x})


def geometric_terms(shape: ShapeFunctions, tension: Expr) -> tuple[Term, ...]:
    """K_g = int P H'^T H' dx by the scalars of P: the term that paper (46) leaves out.

    The axial force P works on the foreshortening -1/2 v'^2 dx of each slice (Kane, Ryan, Banerjee 1987), so
    its generalised active force is -P H'^T H' q per length.
    """
    slopes = shape.slope.T * shape.slope
    parts = {
        P_0 ** powers[0] * prod(s**p for s, p in zip(MOTION, powers[1:], strict=True)): coefficient
        for powers, coefficient in Poly(tension, P_0, *MOTION).terms()
    }
    assert set(parts) == set(TENSION_TERMS), f"the tension's terms are not the named ones: {list(parts)}"
    return tuple(
        Term(name, "geometric", "K", scalar, (parts[scalar] * slopes).applyfunc(integral))
        for scalar, name in TENSION_TERMS.items()
    )


def with_symbols(entries: tuple[tuple[str, str, str], ...], found: tuple[Symbol, ...]) -> tuple[Quantity, ...]:
    """(name, unit, meaning) of the contract as (name, symbol, unit, meaning)."""
    return tuple((name, symbol, unit, meaning) for (name, unit, meaning), symbol in zip(entries, found, strict=True))


def beam_element(shape: ShapeFunctions) -> Element:
    """The element of any shape functions: inertia by Kane's method, elastic, geometric and viscous terms.

    The "viscous" matrix is int N^T N dx, to be multiplied by mu [N s/m^2] at run time, paper (39), (44).
    """
    equations = particle_equations(shape.displacement)
    of_element, of_frame = inertia_terms(equations)
    N = shape.displacement
    viscous = Term("viscous", "damping", "C", S.One, (N.T * N).applyfunc(integral))
    stiffness = elastic_terms(shape) + geometric_terms(shape, axial_tension(equations))
    return Element(
        parameters=with_symbols(ELEMENT_PARAMETERS, (rho_A, E_A, E_I, length, x_0)),
        scalars=with_symbols(LINK_SCALARS, (omega, epsilon, a_x, a_y, P_0)),
        terms=(*of_element, *stiffness, viscous),
        frame_terms=of_frame,
        shape=N,
    )


def euler_bernoulli() -> Element:
    """The planar Euler-Bernoulli element of paper (49)-(55), without rotary inertia; takes about one second.

    Its terms make up M q'' + (C_s + 2 omega G) q' + (K_s - omega^2 M + epsilon G + K_g) q = F.
    """
    return beam_element(hermite_shape())
