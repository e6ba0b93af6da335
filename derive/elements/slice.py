"""A slice of a link: the affine form that every beam element is made of.

A slice of the length dx has the mass rho_A dx and stands at (X + u, v, w) in the link's frame; its section, with the
rotary inertias rho_I_y, rho_I_z and their sum about x, is turned by theta_x, theta_y, theta_z. The frame moves with the
acceleration a of its origin less gravity, with omega and epsilon, all in link axes. Kane's equations of the particles
of a section (:func:`kaneflex.derive.bodies.kane.particle_equations`) are summed over it; at rest in the frame the
derivatives of fr + fr* by accelerations, speeds and coordinates are -M, -C, -K and its value is F, each a sum of
scalars of the motion x constant matrices. Coefficients are collected to find these scalars. In the plane a slice has
u, v and theta_z alone.

To first order in the equations the section's rotation counts to second order, so that in space the order of rotations
matters: here bending turns the axis's tangent the shortest way, then the section by theta_x about the tangent. That
prefers neither of the two planes of bending (Hodges and Dowell 1974, NASA TN D-7818, discuss the choice).
"""

from collections.abc import Mapping, Sequence
from functools import cache

from sympy import Expr, ImmutableMatrix, Matrix, Poly, S, Symbol, eye, symbols

from kaneflex.derive.bodies import kane
from kaneflex.derive.elements.parameters import spatial_element_parameters
from kaneflex.derive.elements.shapes import antiderivative, parameter_symbols, rho_A, x, x_0
from kaneflex.support.contract import SPATIAL_LINK_SCALARS, SPATIAL_NODE

SCALARS = symbols([name for name, *_ in SPATIAL_LINK_SCALARS], real=True)
MOTION, P_0 = tuple(SCALARS[:9]), SCALARS[9]

PARAMETERS = parameter_symbols(spatial_element_parameters(general=True))
"""Symbol of every element parameter in space."""

rho_I_y, rho_I_z = PARAMETERS["rho_I_y"], PARAMETERS["rho_I_z"]

X = Symbol("X", real=True)
"""The slice's distance from the link's origin."""

Affine = Mapping[tuple[str, Expr], ImmutableMatrix]
"""(matrix, monomial of the motion) -> constant n x n before q'', q', q, or n x 1."""


@cache
def slice_equations(kept: tuple[str, ...] = SPATIAL_NODE) -> Affine:
    """M q'' + C q' + K q = F of a slice with these coordinates, per unit of length: M, C, K, F by the monomials of
    MOTION.

    Entries are polynomials in rho_A, rho_I_y, rho_I_z and X. A few seconds in space, a tenth of that in the plane.
    """
    coordinates = list(zip(*map(kane.coordinates, range(len(kept))), strict=True))
    fibre, q = Matrix([0, *kane.PLACE[1:]]), dict(zip(kept, coordinates[0], strict=True))
    *moved, theta_x, theta_y, theta_z = (q.get(name, S.Zero) for name in SPATIAL_NODE)
    place = Matrix([X, 0, 0]) + Matrix(moved) + section_rotation(theta_x, theta_y, theta_z) * fibre
    known = dict(zip(kane.MOTION, (*SCALARS[:3], *SCALARS[6:9], *SCALARS[3:6]), strict=True)) | {kane.MASS: S.One}
    for name, *motion in zip(SPATIAL_NODE, (*kane.ACCEL, *kane.OMEGA), (*kane.ACCEL, *kane.EPSILON), strict=True):
        known |= dict.fromkeys(motion, S.Zero) if name not in kept else {}
    rows = kane.particle_equations(list(place), len(kept)).xreplace(known)[6:, :]
    at_rest = dict.fromkeys((symbol for of in coordinates for symbol in of), S.Zero)
    found = {"F": -rows.xreplace(at_rest)}
    for target, variables in zip("KCM", coordinates, strict=True):
        found[target] = rows.jacobian(variables).xreplace(at_rest)
    affine = {
        (target, monomial): matrix
        for target in "MCKF"
        for monomial, matrix in by_monomials(ImmutableMatrix(found[target]).applyfunc(_over_section)).items()
    }
    left = set().union(*(matrix.free_symbols for matrix in affine.values())) - {rho_A, rho_I_y, rho_I_z, X}
    assert not left, f"the equations depend on {sorted(map(str, left))} beside the acceleration a - g"
    return affine


def _over_section(entry: Expr) -> Expr:
    """Sum over the fibres of a section with principal axes: of a polynomial in their places."""
    sums = {(0, 0): rho_A, (2, 0): rho_I_z, (0, 2): rho_I_y}
    terms = Poly(entry, *kane.PLACE[1:]).terms()
    return sum((sums.get(powers, S.Zero) * coefficient for powers, coefficient in terms), S.Zero).expand()


def section_rotation(theta_x: Expr, theta_y: Expr, theta_z: Expr) -> Matrix:
    """Link axes from section axes, 3 x 3, to second order: bending the shortest way, then theta_x."""
    bending, torsion = (Matrix([x, y, z]).hat() for x, y, z in ((0, theta_y, theta_z), (theta_x, 0, 0)))
    return (eye(3) + bending + bending**2 / 2) * (eye(3) + torsion + torsion**2 / 2)


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
