"""Planar beam elements through Kane's method: the constant matrices of the affine form.

A differential particle of mass rho_A dx sits at r + N q in the link's floating frame with r = (x_0 + x, 0); with
rotary inertia it is a rigid slice that turns by theta against the frame. An unmodified ``KanesMethod`` gives its
generalised inertia forces at x; they are polynomials in the elastic coordinates, in the motion of the frame and in
the shape functions, so the integral over the element is a table of moments and the affine form

    sum_k s_k(t) M_k q'' + sum_k s_k(t) C_k q' + sum_k s_k(t) K_k q = sum_k s_k(t) F_k

is read off the coefficients, not typed in. The strain energy and the work of the axial tension add their
generalised active forces as further stiffness terms.

Sources: paper equations (28), (43), (44) with the single tilde of (41), (46), (49)-(55), (89), (90), (98);
Kane, Ryan and Banerjee (1987) for the geometric stiffness, which the paper leaves out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from sympy import Expr, ImmutableMatrix, Poly, S, Symbol, prod, symbols, zeros
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from kaneflex.derive.mass_correction import mass_correction
from kaneflex.derive.shapes import (
    PARAMETERS,
    Section,
    ShapeFunctions,
    antiderivative,
    beam_section,
    beam_shape,
    integral,
    length,
    rho_A,
    rho_I,
    without_beta,
    x,
    x_0,
)
from kaneflex.support.contract import LINK_SCALARS, element_parameters

omega, epsilon, a_x, a_y, P_0 = symbols([name for name, *_ in LINK_SCALARS], real=True)
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
    tension: of the tension P = sum_k c_k (x/l)^k along the element each c_k, what it is, and its matrix in K_g.
    """

    parameters: tuple[Quantity, ...]
    scalars: tuple[Quantity, ...]
    terms: tuple[Term, ...]
    frame_terms: tuple[Term, ...]
    shape: ImmutableMatrix
    tension: tuple[tuple[Symbol, Expr, ImmutableMatrix], ...]

    def has(self, parameter: str) -> bool:
        """True if the element has a parameter of this name."""
        return any(name == parameter for name, *_ in self.parameters)

    def matrix(self, target: str) -> ImmutableMatrix:
        """Sum of scalar x matrix over the terms of `target`, without "viscous" that mu multiplies at run time."""
        chosen = [t for t in self.terms + self.frame_terms if t.target == target and t.group != "damping"]
        return sum((t.scalar * t.matrix for t in chosen), ImmutableMatrix.zeros(*chosen[0].matrix.shape))


@dataclass(frozen=True)
class ParticleEquations:
    """Kane's equations of the differential particle at x, per unit length.

    rows: fr + fr*, first the frame's three (force x, y, moment), then the elastic ones; polynomials in x, in
    rho_A and rho_I there and in the symbols below. shape: (symbol, polynomial in x) of each shape function.
    q, q_d, q_dd: elastic coordinates and their derivatives.
    """

    rows: tuple[Expr, ...]
    shape: tuple[tuple[Symbol, Expr], ...]
    q: tuple[Symbol, ...]
    q_d: tuple[Symbol, ...]
    q_dd: tuple[Symbol, ...]


def particle_equations(shape: ShapeFunctions, rotary: bool = False) -> ParticleEquations:
    """Kane's equations of one particle of mass rho_A at r + N q under gravity, paper (17), (28).

    With `rotary` it is a rigid slice with the moment of inertia rho_I, angular velocity omega + theta'.
    Generalised speeds: the velocity of the frame's origin in link axes, omega, and the n elastic q'. The
    frame needs no coordinates, so no angle appears. The shape functions enter as symbols: time derivatives
    do not touch them, and their polynomials would only be expanded again and again.
    """
    n = shape.displacement.cols
    rows = ImmutableMatrix.vstack(shape.displacement, shape.rotation)
    N = ImmutableMatrix(3, n, lambda i, j: Symbol(f"N_{i}_{j}") if rows[i, j] != 0 else S.Zero)
    functions = tuple(pair for pair in zip(N, rows, strict=True) if pair[0] != 0)
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
    body = Particle("particle", point, rho_A)
    if rotary:
        section = ReferenceFrame("section")
        section.orient_axis(link, link.z, displaced[2])
        section.set_ang_vel(link, rate[2] * link.z)
        body = RigidBody("slice", point, section, rho_A, (inertia(section, 0, 0, rho_I), point))
    fr, fr_star = kane.kanes_equations([body], [(point, weight)])

    plain_q, plain_d, plain_dd = (symbols(f"{name}_1:{n + 1}") for name in ("q", "qd", "qdd"))
    plain_vx, plain_vy = symbols("v_x v_y")
    plain = dict(zip([*q, *u, *(u_i.diff(time) for u_i in u)], [*plain_q, *plain_d, *plain_dd], strict=True))
    # a = dv/dt + omega x v, and gravity acts as an acceleration -g of the frame: v and g must then drop out.
    plain |= {v_x: plain_vx, v_y: plain_vy, w: omega, w.diff(time): epsilon}
    plain |= {v_x.diff(time): a_x + g_x + omega * plain_vy, v_y.diff(time): a_y + g_y - omega * plain_vx}
    balance = tuple(row.xreplace(plain).expand() for row in fr + fr_star)
    left = set().union(*(row.free_symbols for row in balance)) & {g_x, g_y, plain_vx, plain_vy}
    assert not left, f"the equations depend on {sorted(map(str, left))} beside the acceleration a - g"
    return ParticleEquations(balance, functions, plain_q, plain_d, plain_dd)


def affine_terms(equations: ParticleEquations, section: Section, first: int, last: int) -> Affine:
    """Rows first..last-1 integrated over an element of this section: {(matrix, monomial of the motion): matrix}.

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

    inertia_here = {rho_A: section.density, rho_I: section.rotary}
    matrices = {}
    for i, row in enumerate(equations.rows[first:last]):
        for powers, coefficient in Poly(row.xreplace(inertia_here), *generators).terms():
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


def inertia_terms(
    equations: ParticleEquations, section: Section, with_frame: bool
) -> tuple[tuple[Term, ...], tuple[Term, ...]]:
    """The inertia's terms in the elastic rows and, if asked for, the frame's own three, in the order of KANE_TERMS."""
    elastic = affine_terms(equations, section, 3, len(equations.rows))
    frame = affine_terms(equations, section, 0, 3) if with_frame else {}
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


def axial_tension(equations: ParticleEquations, section: Section) -> Expr:
    """The tension P(x_0 + x) of the rigid link, from its motion and the force P_0 at its origin.

    A slice of the link is in equilibrium under dP and the inertia in Kane's row of the frame's axial speed at
    q = 0: dP/dX = -(fr + fr*) = rho_A (a_x - omega^2 X) in the LINK's X. So P = P_0 + a_x m - omega^2 S with the
    mass m of the link before x and its first moment S; P_0 + rho_A a_x X - rho_A omega^2 X^2/2 if it is uniform.
    """
    X = Symbol("X")
    at_rest = dict.fromkeys((*equations.q, *equations.q_d, *equations.q_dd), S.Zero)
    growth = -equations.rows[0].xreplace(at_rest).xreplace({x: X - x_0})
    per_mass = Poly((growth / rho_A).expand(), X).terms()
    return P_0 + sum(
        coefficient * (section.before[k] + antiderivative(section.density * (x_0 + x) ** k))
        for (k,), coefficient in per_mass
    )


def slope_moments(shape: ShapeFunctions, tension: Expr) -> list[ImmutableMatrix]:
    """int (x/l)^k H'^T H' dx for every power of x in the tension."""
    slope = shape.slope.applyfunc(Expr.expand)
    square, degree = slope.T * slope, Poly(tension, x).degree()
    return [((x / length) ** k * square).applyfunc(integral).expand() for k in range(degree + 1)]


def geometric_terms(tension: Expr, moments: Sequence[ImmutableMatrix]) -> tuple[Term, ...]:
    """K_g = int P H'^T H' dx by the scalars of P: the term that paper (46) leaves out.

    The axial force P works on the foreshortening -1/2 v'^2 dx of each slice (Kane, Ryan, Banerjee 1987), so
    its generalised active force is -P H'^T H' q per length; ``moments`` are those of :func:`slope_moments`.
    """

    def weighted(part: Expr) -> ImmutableMatrix:
        zero = ImmutableMatrix.zeros(*moments[0].shape)
        return sum((c * length**k * moments[k] for (k,), c in Poly(part, x).terms()), zero).expand()

    parts = {
        P_0 ** powers[0] * prod(s**p for s, p in zip(MOTION, powers[1:], strict=True)): coefficient
        for powers, coefficient in Poly(tension, P_0, *MOTION).terms()
    }
    assert set(parts) == set(TENSION_TERMS), f"the tension's terms are not the named ones: {list(parts)}"
    return tuple(
        Term(name, "geometric", "K", scalar, weighted(parts[scalar]))
        for scalar, name in TENSION_TERMS.items()
    )


def with_symbols(entries: tuple[tuple[str, str, str], ...], found: Mapping[str, Symbol]) -> tuple[Quantity, ...]:
    """(name, unit, meaning) of the contract as (name, symbol, unit, meaning)."""
    return tuple((name, found[name], unit, meaning) for name, unit, meaning in entries)


@cache
def beam_element(rotary: bool = False, shear: bool = False, varying: bool = False, with_frame: bool = True) -> Element:
    """The planar beam element: inertia by Kane's method, elastic, geometric and viscous terms.

    Its terms make up M q'' + (C_s + 2 omega G) q' + (K_s - omega^2 M_t + epsilon G + K_g) q = F; M_t is the mass
    matrix M without rotary inertia. The "viscous" matrix is int N^T N dx, to be multiplied by mu [N s/m^2] at run
    time, paper (39), (44).

    rotary: with the rotary inertia of the sections (Rayleigh). shear: sections don't stay normal to the axis
    (Timoshenko). varying: the section grows linearly over the element, and need not be that of the link before
    it. What is False leaves no parameter; of an element with everything, Euler-Bernoulli is rho_I = phi_s = 0. With
    nothing it is the uniform element of paper (49)-(55), without rotary inertia. Each takes about one second, once.
    with_frame: with the terms of the frame's own rows, which a module has no use for.
    """
    section = beam_section(rotary, varying)
    shape = beam_shape(section, shear)
    equations = particle_equations(shape, rotary)
    of_element, of_frame = inertia_terms(equations, section, with_frame)
    N = shape.displacement
    viscous = Term("viscous", "damping", "C", S.One, (N.T * N).applyfunc(integral))
    tension = axial_tension(equations, section)
    moments = slope_moments(shape, tension)
    geometric = geometric_terms(tension, moments)
    stiffness = elastic_terms(shape) + geometric
    powers = [(c * length**k).expand() for (k,), c in reversed(Poly(tension, x).terms())]
    by_tension = sum((c * of for c, of in zip(powers, moments, strict=True)), zeros(*moments[0].shape))
    by_motion = sum((term.scalar * term.matrix for term in geometric), zeros(*moments[0].shape))
    assert (by_tension - by_motion).expand().is_zero_matrix, "K_g by the tension is not K_g by the motion"
    if shear:
        of_element += (Term("mass_correction", "inertia", "M", S.One, mass_correction(shape)),)
    return Element(
        parameters=with_symbols(element_parameters(rotary, shear, varying), PARAMETERS),
        scalars=with_symbols(LINK_SCALARS, {symbol.name: symbol for symbol in (omega, epsilon, a_x, a_y, P_0)}),
        terms=tuple(_in_parameters(term) for term in (*of_element, *stiffness, viscous)),
        frame_terms=tuple(_in_parameters(term) for term in of_frame),
        shape=without_beta(N),
        tension=tuple((Symbol(f"P_{k + 1}"), powers[k], without_beta(of)) for k, of in enumerate(moments)),
    )


def _in_parameters(term: Term) -> Term:
    return replace(term, matrix=without_beta(term.matrix))
