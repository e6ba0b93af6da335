"""The mass of a shear beam, corrected for the answer of each element to its own inertia.

Static shape functions are exact under loads at the nodes. Between them the inertia load p = rho_A omega^2 v of a
motion with omega deforms the element further: clamped at its nodes, p does the work p^2 l^3/(24 kappa G A) by shear,
of the order l^2 of the inertia's own, where its work by bending is of the order l^4. A consistent mass leaves this
out, so however exact the stiffness, the frequencies of a deep beam are wrong by the order l^2.

In terms of the nodes' motion the work is tau^2 omega^4/2 int rho_A v^2 dx with tau^2 = rho_A l^2/(12 kappa G A).
Where the inertia of translation prevails, omega^2 int rho_A v^2 dx is q^T K q, and the work is that of a further mass

    M_c = tau^2 K = rho_A phi_s l^4/(144 E I) K,    K of bending and shear.

It has no part in a rigid motion, so that the element's mass, centre and moment of inertia stay what they are, and
vanishes without shear. What rotary inertia and lumped masses add to omega^2 q^T M q stays behind: an error of the order
l^2 again, but smaller by a factor of 5 to 100. Corrections of this kind are surveyed as mass templates by Felippa, Guo
and Park (2015), Archives of Computational Methods in Engineering 22.
"""

from sympy import ImmutableMatrix

from kaneflex.derive.elements.shapes import E_I, ShapeFunctions, integral, length, phi_s, rho_A


def mass_correction(shape: ShapeFunctions) -> ImmutableMatrix:
    """M_c, n x n, by the mean section of an element with shear."""
    stiffness = (rigidity * B.T * B for name, B, rigidity in shape.strains if name != "axial")
    total = sum(stiffness, ImmutableMatrix.zeros(shape.displacement.cols))
    return (rho_A * phi_s * length**4 / (144 * E_I) * total).applyfunc(integral)
