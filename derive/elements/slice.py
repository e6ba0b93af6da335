"""A slice of a link through Kane's method: the affine form that every beam element is made of.

A slice of the length dx has the mass rho_A dx and stands at (X + u, v, w) in the link's frame; its section, with the
rotary inertias rho_I_y, rho_I_z and their sum about x, is turned by theta_x, theta_y, theta_z. The frame moves with the
acceleration a of its origin less gravity, with omega and epsilon, all in link axes. An unmodified ``KanesMethod`` gives
fr + fr*; at rest in the frame its derivatives by the accelerations, speeds and coordinates are -M, -C, -K and its value
is F, each a sum of scalars of the motion x constant matrices. Which scalars there are is found by collecting
coefficients. In the plane a slice has u, v and theta_z alone.

To first order in the equations the section's rotation counts to second order, so that in space the order of rotations
matters: here bending turns the axis's tangent the shortest way, then the section by theta_x about the tangent. That
prefers neither of the two planes of bending (Hodges and Dowell 1974, NASA TN D-7818, discuss the choice).
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache

from sympy import Expr, ImmutableMatrix, Matrix, Poly, S, Symbol, eye, symbols
from sympy.physics.mechanics import KanesMethod, Point, ReferenceFrame, RigidBody, Vector, dynamicsymbols, inertia

from kaneflex.derive.elements.shapes import antiderivative, rho_A, x, x_0
from kaneflex.support.spatial_contract import SPATIAL_LINK_SCALARS, SPATIAL_NODE, spatial_element_parameters

SCALARS = symbols([name for name, *_ in SPATIAL_LINK_SCALARS], real=True)
omega, epsilon, a, P_0 = SCALARS[:3], SCALARS[3:6], SCALARS[6:9], SCALARS[9]
MOTION = tuple(SCALARS[:9])

PARAMETERS = {
    name: Symbol(name, real=True) if name.endswith("_rise") or name in ("m_0", "S_0") else Symbol(name, positive=True)
    for name, *_ in spatial_element_parameters(shear=True, varying=True)
}
"""Every element parameter's symbol."""

rho_I_y, rho_I_z = PARAMETERS["rho_I_y"], PARAMETERS["rho_I_z"]

X = Symbol("X", real=True)
"""The slice's distance from the link's origin."""

Affine = Mapping[tuple[str, Expr], ImmutableMatrix]
"""(matrix, monomial of the motion) -> constant n x n before q'', q', q, or n x 1."""


@cache
def slice_equations(kept: tuple[str, ...] = SPATIAL_NODE, frame: bool = False) -> Affine:
    """M q'' + C q' + K q = F of a slice with these coordinates, per unit of length: M, C, K, F by the monomials of
    MOTION.

    Entries are polynomials in rho_A, rho_I_y, rho_I_z and X. ``frame``: of the force and the moment about the link's
    origin that move the frame, in place of the slice's own rows. A few seconds in space, a tenth of that in the plane.
    """
    rows, q, q_d, q_dd = _kane(kept, frame)
    at_rest = dict.fromkeys((*q, *q_d, *q_dd), S.Zero)
    found = {"F": rows.xreplace(at_rest)}
    for target, variables in (("M", q_dd), ("C", q_d), ("K", q)):
        found[target] = -rows.jacobian(variables).xreplace(at_rest)
    affine = {
        (target, monomial): matrix
        for target in "MCKF"
        for monomial, matrix in by_monomials(ImmutableMatrix(found[target]).expand()).items()
    }
    left = set().union(*(matrix.free_symbols for matrix in affine.values())) - {rho_A, rho_I_y, rho_I_z, X}
    assert not left, f"the equations depend on {sorted(map(str, left))} beside the acceleration a - g"
    return affine


def by_monomials(matrix: ImmutableMatrix, motion: Sequence[Symbol] = MOTION) -> dict[Expr, ImmutableMatrix]:
    """Monomial of the motion -> the constant matrix before it."""
    found: dict[Expr, Matrix] = {}
    for i in range(matrix.rows):
        for j in range(matrix.cols):
            for powers, coefficient in Poly(matrix[i, j], *motion).terms():
                monomial = S.One
                for symbol, power in zip(motion, powers, strict=True):
                    monomial *= symbol**power
                if coefficient != 0:
                    found.setdefault(monomial, Matrix.zeros(*matrix.shape))[i, j] = coefficient
    return {monomial: ImmutableMatrix(matrix) for monomial, matrix in found.items()}


def _kane(
    kept: tuple[str, ...], frame: bool
) -> tuple[Matrix, tuple[Symbol, ...], tuple[Symbol, ...], tuple[Symbol, ...]]:
    """The slice's own rows of fr + fr* in plain symbols, or those of the frame, with those of q, q', q''.

    Generalised speeds: velocity of the frame's origin and angular velocity in link axes, and the rates. The frame
    needs no coordinates, so that no angle of it appears; it moves as the coordinates of the slice do.
    """

    def still(of: Iterable[Expr]) -> list[Expr]:
        """Six symbols, zero in place of what is not kept."""
        return [symbol if name in kept else S.Zero for name, symbol in zip(SPATIAL_NODE, of, strict=True)]

    q, u, vw = (still(dynamicsymbols(f"{name}_1:7")) for name in ("q", "u", "vw"))
    v, w, g = vw[:3], vw[3:], still((*symbols("g_x g_y g_z"), *[S.Zero] * 3))[:3]
    inertial, link, section = ReferenceFrame("inertial"), ReferenceFrame("link"), ReferenceFrame("section")
    origin, point = Point("origin"), Point("point")

    def in_link(components) -> Vector:
        return sum((c * axis for c, axis in zip(components, link, strict=True)), Vector(0))

    link.set_ang_vel(inertial, in_link(w))
    origin.set_vel(inertial, in_link(v))
    point.set_pos(origin, in_link((X + q[0], q[1], q[2])))
    point.set_vel(link, in_link(u[:3]))
    point.v1pt_theory(origin, inertial, link)
    section.orient_explicit(link, section_rotation(*q[3:]))
    section.set_ang_vel(link, in_link(section_angular_velocity(q[3:], u[3:])))
    body = RigidBody("slice", point, section, rho_A, (inertia(section, rho_I_y + rho_I_z, rho_I_y, rho_I_z), point))

    time = dynamicsymbols._t
    kinematics = [q_i.diff(time) - u_i for q_i, u_i in zip(q, u, strict=True) if u_i != 0]
    speeds = [u_i for u_i in (*vw, *u) if u_i != 0]
    kane = KanesMethod(inertial, q_ind=[q_i for q_i in q if q_i != 0], u_ind=speeds, kd_eqs=kinematics)
    rows = sum(kane.kanes_equations([body], [(point, rho_A * in_link(g))]), Matrix.zeros(len(speeds), 1))

    plain_q, plain_d, plain_dd = (still(symbols(f"{name}_1:7")) for name in ("q", "qd", "qdd"))
    moved = still((*symbols("v_x v_y v_z"), *omega))
    # a = dv/dt + omega x v, and gravity acts as an acceleration -g of the frame: v and g must then drop out.
    carried = Matrix(moved[3:]).cross(Matrix(moved[:3]))
    rates = still((*(a[i] + g[i] - carried[i] for i in range(3)), *epsilon))
    symbol_of = zip([*q, *u, *vw, *(each.diff(time) for each in (*u, *vw))],
                    [*plain_q, *plain_d, *moved, *plain_dd, *rates], strict=True)  # fmt: skip
    rows = rows[: len(kept), :] if frame else rows[len(kept) :, :]
    of = (tuple(symbol for symbol in each if symbol != 0) for each in (plain_q, plain_d, plain_dd))
    return rows.xreplace({old: new for old, new in symbol_of if old != 0}), *of


def section_rotation(theta_x: Expr, theta_y: Expr, theta_z: Expr) -> Matrix:
    """Link axes from section axes, 3 x 3, to second order: bending the shortest way, then theta_x."""
    bending, torsion = _skew(S.Zero, theta_y, theta_z), _skew(theta_x, S.Zero, S.Zero)
    return (eye(3) + bending + bending**2 / 2) * (eye(3) + torsion + torsion**2 / 2)


def section_angular_velocity(theta: tuple[Expr, ...], rate: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Angular velocity of a section's rotation, in link axes, to second order: beta' + 1/2 beta x beta' by bending,
    theta_x' at the tangent."""
    _, y, z = theta
    x_rate, y_rate, z_rate = rate
    return x_rate + (y * z_rate - z * y_rate) / 2, y_rate + z * x_rate, z_rate - y * x_rate


def _skew(x: Expr, y: Expr, z: Expr) -> Matrix:
    return Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def link_tension(before: tuple[Expr, Expr], density: Expr, kept: tuple[str, ...] = SPATIAL_NODE) -> Expr:
    """Axial force of the rigid link at x_0 + x less that at its origin, from the mass and the first moment of the link
    ``before`` an element, and the element's density by x.

    A slice is in equilibrium under dP and the inertia in Kane's row of u: dP/dX = -F_u = rho_A (a_x - (omega_y^2 +
    omega_z^2) X).
    """
    found = S.Zero
    for (target, monomial), matrix in slice_equations(kept).items():
        if target == "F" and matrix[0, 0] != 0:
            for (k,), number in Poly(-matrix[0, 0] / rho_A, X).terms():
                found += monomial * number * (before[k] + antiderivative((density * (x_0 + x) ** k).expand()))
    return found
