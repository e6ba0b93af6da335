"""The mass of a shear beam corrected for the answer of each element to its own inertia.

The static shape functions are exact under loads at the nodes. Between them the inertia loads p = rho_A omega^2 v and
m = rho_I omega^2 theta of a motion with omega deform the element further. Clamped at its nodes, it does the work
p^2 l^3/(24 kappa G A) by shear and m^2 l^3 (1 - beta)/(24 E I), with beta = 1/(1 + phi_s): of the order l^2 of the
inertia's own, and only p's work by bending is of the order l^4, as in an Euler-Bernoulli beam. So a consistent mass
leaves an error of the order l^2 in the frequencies of a Timoshenko beam, however exact its stiffness.

One p and one m are replaced by the equations of motion (kappa G A gamma)' = -p, (E I theta')' + kappa G A gamma = -m
and integrated by parts over the beam. The work is then omega^2/2 q^T M_c q with

    M_c = l^2/12 int rho_A (v'^T gamma + gamma^T v')/2 + (1 - beta) rho_I theta'^T theta' dx
          - beta int rho_I (theta^T gamma + gamma^T theta)/2 dx

which has no part in a rigid motion, so that the element's mass, centre and moment of inertia stay what they are. The
frequencies' error falls as l^4. Where lumped masses or forces between the ends make gamma jump, the terms at the
boundaries stay behind: l^2 again, with a smaller factor but for the lowest mode. Mass matrices of higher order by
other means: Felippa, Guo and Park (2015), Arch. Comput. Methods Eng. 22.
"""

from sympy import Expr, ImmutableMatrix, diff

from kaneflex.derive.shapes import ShapeFunctions, beta_s, integral, length, rho_A, rho_I, x


def mass_correction(shape: ShapeFunctions) -> ImmutableMatrix:
    """M_c, n x n, of the mean section of an element with shear."""
    gamma = (shape.slope - shape.rotation).applyfunc(Expr.expand)
    curvature = diff(shape.rotation, x)
    translation = rho_A * _symmetric(shape.slope, gamma) + (1 - beta_s) * rho_I * curvature.T * curvature
    density = length**2 / 12 * translation - beta_s * rho_I * _symmetric(shape.rotation, gamma)
    return density.applyfunc(integral)


def _symmetric(a: ImmutableMatrix, b: ImmutableMatrix) -> ImmutableMatrix:
    return (a.T * b + b.T * a) / 2
