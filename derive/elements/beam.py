"""Planar beam elements through Kane's method: the constant matrices of the affine form.

A slice of mass rho_A dx sits at r + N q in the link's floating frame with r = (x_0 + x, 0) and turns by theta
against it. An unmodified ``KanesMethod`` gives its generalised inertia forces (``elements.slice``); integrated with the
shape functions over the element they are the affine form

    sum_k s_k(t) M_k q'' + sum_k s_k(t) C_k q' + sum_k s_k(t) K_k q = sum_k s_k(t) F_k

whose coefficients are read off, not typed in. The strain energy and the work of the axial tension add their
generalised active forces as further stiffness terms.

Sources: paper equations (28), (43), (44) with the single tilde of (41), (46), (49)-(55), (89), (90), (98);
Kane, Ryan and Banerjee (1987) for the geometric stiffness, which the paper leaves out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

from sympy import Expr, ImmutableMatrix, Poly, S, Symbol, prod, symbols

from kaneflex.derive.elements.parameters import ELEMENT_TERMS, LINK_SCALARS, element_parameters
from kaneflex.derive.elements.shapes import (
    E_I,
    PARAMETERS,
    Section,
    ShapeFunctions,
    beam_section,
    beam_shape,
    integral,
    length,
    phi_s,
    rho_A,
    without_beta,
    x,
    x_0,
)
from kaneflex.derive.elements.slice import SCALARS, X, by_monomials, link_tension, rho_I_z, slice_equations

_LINK = omega, epsilon, a_x, a_y, P_0 = symbols([name for name, *_ in LINK_SCALARS], real=True)
_NODE = ("u", "v", "theta_z")
_IN_PLANE = {SCALARS[2]: omega, SCALARS[5]: epsilon}
"""Motion about z of a slice with the coordinates _NODE."""
MOTION = (omega, epsilon, a_x, a_y)

TERMS = {
    (kernel, prod((Symbol(each, real=True) for each in factors), S.One)): (name, group)
    for name, group, kernel, factors in ELEMENT_TERMS
}
"""Kernel and monomial of the motion, where Kane's equations put a term -> its name and group."""

Quantity = tuple[str, Symbol, str, str]
Affine = dict[tuple[str, Expr], ImmutableMatrix]


@dataclass(frozen=True)
class Term:
    """One scalar x constant matrix of the affine form.

    target: the matrix that it belongs to, "M", "C", "K" (n x n), "F" (n x 1, right-hand side). scalar: monomial of the
    motion's scalars, 1 if constant.
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
    shape: N(x), 2 x 6, with x from the element's first node.
    tension: of the tension P = sum_k c_k (x/l)^k along the element each c_k, what it is, and its matrix in K_g.
    """

    parameters: tuple[Quantity, ...]
    scalars: tuple[Quantity, ...]
    terms: tuple[Term, ...]
    shape: ImmutableMatrix
    tension: tuple[tuple[Symbol, Expr, ImmutableMatrix], ...]

    def has(self, parameter: str) -> bool:
        """True if the element has a parameter of this name."""
        return any(name == parameter for name, *_ in self.parameters)


def inertia_terms(shape: ShapeFunctions, section: Section) -> tuple[Term, ...]:
    """The inertia's terms in the order of TERMS.

    Matrices S before a slice's coordinates R q, u, v and theta, are R^T S R before those of the element, integrated.
    """
    R = ImmutableMatrix.vstack(shape.displacement, shape.rotation).expand()
    here = {X: x_0 + x, rho_A: section.density, rho_I_z: section.rotary}
    found = {}
    for (target, monomial), matrix in slice_equations(_NODE).items():
        right = matrix.xreplace(here) * (R if matrix.cols > 1 else ImmutableMatrix([[1]]))
        whole = (R.T * right).applyfunc(integral).expand()
        if not whole.is_zero_matrix:
            found[target.replace("K", "K_d"), monomial.xreplace(_IN_PLANE)] = whole
    unknown = found.keys() - TERMS.keys()
    assert not unknown, f"Kane's equations hold terms without a name: {unknown}"
    return tuple(Term(*named, key[0][0], key[1], found[key]) for key, named in TERMS.items() if key in found)


def elastic_terms(shape: ShapeFunctions) -> tuple[Term, ...]:
    """K_s, one term for each generalised strain B q, paper (46), (88), (89), (96).

    The strain energy 1/2 rigidity (B q)^2 per length has the generalised active force -rigidity B^T B q.
    """
    return tuple(
        Term(f"{name}_stiffness", "elastic", "K", S.One, (rigidity * B.T * B).applyfunc(integral))
        for name, B, rigidity in shape.strains
    )


def mass_correction(shape: ShapeFunctions) -> ImmutableMatrix:
    """Mass of a shear beam that corrects for the answer of each element to its own inertia, n x n, by its mean section.

    Static shape functions are exact under loads at the nodes. Between them the inertia load p = rho_A omega^2 v of a
    motion with omega deforms the element further: clamped at its nodes, p does the work p^2 l^3/(24 kappa G A) by
    shear, of the order l^2 of the inertia's own, where its work by bending is of the order l^4. A consistent mass
    leaves this out, so however exact the stiffness, the frequencies of a deep beam are wrong by the order l^2.

    In terms of the nodes' motion the work is tau^2 omega^4/2 int rho_A v^2 dx with tau^2 = rho_A l^2/(12 kappa G A).
    Where the inertia of translation prevails, omega^2 int rho_A v^2 dx is q^T K q, and the work is that of a further
    mass

        M_c = tau^2 K = rho_A phi_s l^4/(144 E I) K,    K of bending and shear.

    It has no part in a rigid motion, so that the element's mass, centre and moment of inertia stay what they are, and
    vanishes without shear. What rotary inertia and lumped masses add to omega^2 q^T M q stays behind: an error of the
    order l^2 again, but smaller by a factor of 5 to 100. Corrections of this kind are surveyed as mass templates by
    Felippa, Guo and Park (2015), Archives of Computational Methods in Engineering 22.
    """
    bending_and_shear = sum((rigidity * B.T * B for _, B, rigidity in shape.strains[1:]), ImmutableMatrix.zeros(6))
    return (rho_A * phi_s * length**4 / (144 * E_I) * bending_and_shear).applyfunc(integral)


def slope_moments(shape: ShapeFunctions, tension: Expr) -> list[ImmutableMatrix]:
    """int (x/l)^k H'^T H' dx for every power of x in the tension."""
    slope = shape.slope.applyfunc(Expr.expand)
    square, degree = slope.T * slope, Poly(tension, x).degree()
    return [((x / length) ** k * square).applyfunc(integral).expand() for k in range(degree + 1)]


def geometric_terms(powers: Sequence[Expr], moments: Sequence[ImmutableMatrix]) -> tuple[Term, ...]:
    """K_g = int P H'^T H' dx by the scalars of P: the term that paper (46) leaves out.

    The axial force P works on the foreshortening -1/2 v'^2 dx of each slice (Kane, Ryan, Banerjee 1987), so
    its generalised active force is -P H'^T H' q per length; ``powers`` are P's coefficients of (x/l)^k, ``moments``
    those of :func:`slope_moments`.
    """
    whole = sum((c * of for c, of in zip(powers, moments, strict=True)), ImmutableMatrix.zeros(*moments[0].shape))
    found = by_monomials(whole.expand(), (P_0, *MOTION))
    named = {scalar: of for (kernel, scalar), of in TERMS.items() if kernel == "K_g"}
    assert found.keys() == named.keys(), f"the tension's terms are not the named ones: {list(found)}"
    return tuple(Term(*of, "K", scalar, found[scalar].expand()) for scalar, of in named.items())


@cache
def beam_element(rotary: bool = False, shear: bool = False, varying: bool = False) -> Element:
    """The planar beam element: inertia by Kane's method, elastic, geometric and viscous terms.

    Its terms make up M q'' + (C_s + 2 omega G) q' + (K_s - omega^2 M_t + epsilon G + K_g) q = F; M_t is the mass
    matrix M without rotary inertia. The "viscous" matrix is int N^T N dx, to be multiplied by mu [N s/m^2] at run
    time, paper (39), (44).

    rotary: with the rotary inertia of the sections (Rayleigh). shear: sections don't stay normal to the axis
    (Timoshenko). varying: the section grows linearly over the element, and need not be that of the link before
    it. What is False leaves no parameter; of an element with everything, Euler-Bernoulli is rho_I = phi_s = 0. With
    nothing it is the uniform element of paper (49)-(55), without rotary inertia. Each takes about one second, once.
    """
    section = beam_section(rotary, varying)
    shape = beam_shape(section, shear)
    of_element = inertia_terms(shape, section)
    N = shape.displacement
    viscous = Term("viscous", "damping", "C", S.One, (N.T * N).applyfunc(integral))
    tension = P_0 + link_tension(section.before, section.density, _NODE).xreplace(_IN_PLANE)
    moments = slope_moments(shape, tension)
    powers = [(c * length**k).expand() for (k,), c in reversed(Poly(tension, x).terms())]
    stiffness = elastic_terms(shape) + geometric_terms(powers, moments)
    if shear:
        of_element += (Term("mass_correction", "inertia", "M", S.One, mass_correction(shape)),)
    return Element(
        parameters=tuple((row[0], PARAMETERS[row[0]], *row[1:]) for row in element_parameters(rotary, shear, varying)),
        scalars=tuple((row[0], symbol, *row[1:]) for symbol, row in zip(_LINK, LINK_SCALARS, strict=True)),
        terms=tuple(replace(term, matrix=without_beta(term.matrix)) for term in (*of_element, *stiffness, viscous)),
        shape=without_beta(N),
        tension=tuple((Symbol(f"P_{k + 1}"), powers[k], without_beta(of)) for k, of in enumerate(moments)),
    )
