"""Shape functions and sections of planar beam elements, as polynomials in x from the element's first node.

One family: with phi_s = 0 the Timoshenko shape functions are the cubic Hermite ones, and the growth of a section over
the element is zero where the link is uniform. Parameters that a scene does not need are left out here, so that no
kernel reads them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

from sympy import Expr, ImmutableMatrix, Poly, Rational, S, Symbol, diff

from kaneflex.derive.elements.parameters import element_parameters


def parameter_symbols(rows: Iterable[tuple[str, str, str]]) -> dict[str, Symbol]:
    """Symbols of an element's parameters by name; growths and sums over the link before it may be negative."""
    signed = {name: name.endswith("_rise") or name in ("m_0", "S_0") for name, *_ in rows}
    return {name: Symbol(name, real=True) if of else Symbol(name, positive=True) for name, of in signed.items()}


PARAMETERS = parameter_symbols(element_parameters(rotary=True, shear=True, varying=True))
"""Symbol of every element parameter by its name in the contract."""
rho_A, E_A, E_I, length, x_0, rho_A_rise, E_A_rise, E_I_rise, m_0, S_0, rho_I, rho_I_rise, phi_s = PARAMETERS.values()

x = Symbol("x", real=True)

beta_s = Symbol("beta_s", positive=True)
"""1/(1 + phi_s) while the derivation lasts, so that everything stays a polynomial."""


@dataclass(frozen=True)
class Section:
    """Section of an element at x, and the part of the link before it.

    density [kg/m], rotary [kg m], axial [N], bending [N m^2]: polynomials in x. before: mass [kg] and its first moment
    about the link's origin [kg m], of the link from there to the element's first node.
    """

    density: Expr
    rotary: Expr
    axial: Expr
    bending: Expr
    before: tuple[Expr, Expr]


@dataclass(frozen=True)
class ShapeFunctions:
    """The kinematics of one element type: rows over the element's coordinates, polynomials in x in 0..length.

    displacement: 2 x n, the displacement (u, v) = N q in link axes [m].
    rotation: 1 x n, the rotation of the section [rad].
    slope: 1 x n, dv/dx, the rotation of the axis on which an axial tension does work [rad].
    strains: (name, row 1 x n, rigidity) of each generalised strain; its energy is 1/2 rigidity strain^2.
    """

    displacement: ImmutableMatrix
    rotation: ImmutableMatrix
    slope: ImmutableMatrix
    strains: tuple[tuple[str, ImmutableMatrix, Expr], ...]


def beam_section(rotary: bool = False, varying: bool = False) -> Section:
    """A uniform section, or one that grows linearly over the element about the mean at its middle.

    A uniform link has the mass rho_A x_0 before the element, with the first moment rho_A x_0^2/2.
    """
    middle = x / length - Rational(1, 2)
    rho_I_here = rho_I if rotary else S.Zero
    if not varying:
        return Section(rho_A, rho_I_here, E_A, E_I, (rho_A * x_0, rho_A * x_0**2 / 2))
    return Section(
        density=rho_A + rho_A_rise * middle,
        rotary=rho_I_here + rho_I_rise * middle if rotary else S.Zero,
        axial=E_A + E_A_rise * middle,
        bending=E_I + E_I_rise * middle,
        before=(m_0, S_0),
    )


def beam_shape(section: Section, shear: bool = False) -> ShapeFunctions:
    """Axial linear and transverse cubic shape functions, exact for a uniform beam loaded at its nodes.

    Without shear the cubic Hermite polynomials of paper (49)-(55): N1 is (2 x^3 - 3 l x^2 + l^3)/l^3 as in (61),
    the printed (55) lacks an l; the section follows the axis, theta = v'. With shear those of Przemieniecki
    (1968) and of Friedman and Kosmatka (1993), as a blend of bending by beta = 1/(1 + phi_s) and shear by the
    rest: the shear strain gamma = v' - theta = -phi_s l^2/12 v''' is what the equilibrium E I theta'' =
    -kappa G A gamma asks for, whatever the slenderness, so that nothing locks. Where E I grows over the element,
    theta bows besides by (1 - beta) (E_I_rise/E_I)/2 (theta2 - theta1) s (1 - s), which has the least strain energy.
    """
    s = x / length
    beta = beta_s if shear else S.One
    N_1x, N_2x = 1 - s, s
    N_1 = beta * (1 - 3 * s**2 + 2 * s**3) + (1 - beta) * (1 - s)
    N_2 = length * (beta * (s - 2 * s**2 + s**3) + (1 - beta) * (s - s**2) / 2)
    N_3 = beta * (3 * s**2 - 2 * s**3) + (1 - beta) * s
    N_4 = length * (beta * (s**3 - s**2) - (1 - beta) * (s - s**2) / 2)
    displacement = ImmutableMatrix([[N_1x, 0, 0, N_2x, 0, 0], [0, N_1, N_2, 0, N_3, N_4]])
    u, v = displacement[0, :], displacement[1, :]
    axial = ("axial", diff(u, x), section.axial)
    if not shear:
        slope = diff(v, x)
        return ShapeFunctions(displacement, slope, slope, (axial, ("bending", diff(v, x, 2), section.bending)))
    # gamma = (1 - beta) unit, for v has one beta in its third derivative and phi_s = (1 - beta)/beta.
    unit = -(length**2) * diff(v, x, 3) / (12 * beta)
    share = diff(section.bending, x) * length / (12 * E_I)
    if share != 0:
        bow = share * ImmutableMatrix([[0, 0, -1, 0, 0, 1]])
        displacement += ImmutableMatrix([[0], [1]]) * (1 - beta) * length * (3 * s**2 - 2 * s**3 - s) * bow
        unit -= bow
    slope = diff(displacement[1, :], x)
    rotation = slope - (1 - beta) * unit
    # kappa G A gamma^2 = 12 E I (1 - beta) beta unit^2 / l^2
    rigidity = 12 * E_I * beta * (1 - beta) / length**2
    strains = (axial, ("bending", diff(rotation, x), section.bending), ("shear", unit, rigidity))
    return ShapeFunctions(displacement, rotation, slope, strains)


def without_beta(matrix: ImmutableMatrix) -> ImmutableMatrix:
    """The matrix in the element's parameters alone."""
    return matrix.xreplace({beta_s: 1 / (1 + phi_s)})


def antiderivative(integrand: Expr) -> Expr:
    """int_0^x of a polynomial in x, by the monomials' own."""
    return sum((c * x ** (k + 1) * Rational(1, k + 1) for (k,), c in Poly(integrand, x).terms()), S.Zero)


@cache  # of a symmetric matrix most entries are met twice
def integral(integrand: Expr) -> Expr:
    """Exact integral of a polynomial over x in 0..length, by the moments int x^k dx = length^(k+1)/(k+1)."""
    return antiderivative(integrand).xreplace({x: length}).expand()
