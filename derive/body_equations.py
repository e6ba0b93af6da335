"""Kane's equations of a body with one axial and one transverse shape, in its own axes: its loops in short."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import sympy as sm

from kaneflex.derive.flexible import flexible_body
from kaneflex.derive.loops import COORDINATES

B, A = COORDINATES["s"], COORDINATES["w"]
MOTION = ALONG, ACROSS, EPSILON, OMEGA = sm.symbols("along across epsilon omega")


@dataclass(frozen=True)
class BodyEquations:
    """Equations of a body with one shape of each kind, in its own axes; the symbols are those of ``loops.COORDINATES``.

    Attributes
    ----------
    forces : Matrix
        M u' - f, stiffness and damping included: along, across, moment about the start, then the rows of b and a.
        ``along``, ``across``: acceleration of the start less gravity.
    mass : Matrix
        M, d forces / d(along, across, epsilon, b2, a2).
    kinetic, strain, lost : Expr
        Energies [J] and dissipated power [W]; ``along``, ``across`` are there the speed of the start.
    """

    forces: sm.Matrix
    mass: sm.Matrix
    kinetic: sm.Expr
    strain: sm.Expr
    lost: sm.Expr


@cache
def body_equations() -> BodyEquations:
    """Kane's equations with one shape of each kind, turned into the body's axes."""
    forces = _in_axes(1, 1)
    lifted = _in_axes(0, 0)  # a body without shapes has mass beside its axis
    beside = lifted - lifted.xreplace({s: sm.S.Zero for s in lifted.free_symbols if "_Y" in s.name})
    forces += sm.Matrix([*beside, 0, 0])
    K_b, K_a, C_bb, C_ba, C_aa = sm.symbols("stiffness_0 stiffness_1 damping_0_0 damping_0_1 damping_1_1")
    modal, rates = sm.Matrix([B[0], A[0]]), sm.Matrix([B[1], A[1]])
    K, C = sm.diag(K_b, K_a), sm.Matrix([[C_bb, C_ba], [C_ba, C_aa]])
    forces += sm.Matrix([0, 0, 0, *(K * modal + C * rates)])
    mass = forces.jacobian([ALONG, ACROSS, EPSILON, B[2], A[2]])
    u = sm.Matrix([ALONG, ACROSS, OMEGA, *rates])
    kinetic, strain, lost = (u.T * mass * u)[0] / 2, (modal.T * K * modal)[0] / 2, (rates.T * C * rates)[0]
    return BodyEquations(forces.expand(), mass, *(x.expand() for x in (kinetic, strain, lost)))


def _in_axes(axial: int, transverse: int) -> sm.Matrix:
    """M u' - f of a free body in its axes, in the symbols of a motion."""
    body = flexible_body(axial, transverse, True)
    c, s = sm.symbols("c s")
    modal, rates, accelerations = ([*B[k : k + 1] * axial, *A[k : k + 1] * transverse] for k in range(3))
    start = [c * ALONG - s * ACROSS, s * ALONG + c * ACROSS]  # less gravity, which only the two together feel
    own = dict(zip(body.q[3:], modal, strict=True)) | dict(zip(body.v[2:], [OMEGA, *rates], strict=True))
    own |= dict.fromkeys(body.gravity, sm.S.Zero) | {sm.cos(body.q[2]): c, sm.sin(body.q[2]): s}
    forces = (body.mass * sm.Matrix([*start, EPSILON, *accelerations]) - body.forcing).xreplace(own)
    turned = sm.Matrix([c * forces[0] + s * forces[1], c * forces[1] - s * forces[0], *forces[2:]])
    return turned.expand().xreplace({s**2: 1 - c**2}).expand()
