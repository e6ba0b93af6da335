"""Laws of contacts, over any kind of number: how far apart two bodies are, what pushes them apart, what comes back.

A contact that closed at the approach speed v_0 and is d deep pushes with F = K d^n (1 + chi d'/v_0); what the laws
differ by is chi. Nothing else acting, v dv = -(F/m) dd gives the restitution e that every one of them really returns,
whatever m, K, n and v_0 (Hunt & Crossley 1975, J. Appl. Mech. 42, 440, for small chi; here it is not cut off):

    (1 + chi)/(1 - e chi) = exp(chi (1 + e))

Newton's law has no force of a depth: rigid sides meet, and at once part again with e times the speed of approach.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from kaneflex.mechanism.parts import Contact
from kaneflex.mechanism.planar import Number, Vector, dot, quarter_turn

KINDS = ("point-line", "circles", "angle")
"""Geometries, in the order of the numbers that kernels know them by."""
CIRCLES = {"circle-circle": 1.0, "circle-in-circle": -1.0}
"""Kinds of contacts of circles -> whether the second is pushed away from the first one's centre (1) or towards it."""
LAWS = ("hertz", "kelvin-voigt", "hunt-crossley", "lankarani-nikravesh", "flores", "exact", "newton")
"""Laws, in the order of the numbers that kernels know them by."""
NEWTON = LAWS.index("newton")
"""The law of rigid sides: speeds jump, nothing is pressed in."""
CHI: dict[str, Callable[[Number], Number]] = {
    "hunt-crossley": lambda e: 3 * (1 - e) / 2,
    "lankarani-nikravesh": lambda e: 3 * (1 - e**2) / 4,
    "flores": lambda e: 8 * (1 - e) / (5 * e),
}
"""chi of the laws that have it in closed form, by the restitution e that is asked for.

Hunt & Crossley 1975, J. Appl. Mech. 42, 440; Lankarani & Nikravesh 1990, J. Mech. Des. 112, 369; Flores, Machado,
Silva & Martins 2011, Multibody Syst. Dyn. 25, 357."""


def apart(kind: str, gap: Vector, length: Number, normal: Vector, reach: Number) -> tuple[Number, Vector]:
    """How far apart two sides are, and the unit normal in which the second is pushed.

    Parameters
    ----------
    gap : tuple
        From the first point to the second, ``length`` [m] long; global. Of flanks the angle of the second body against
        the first [rad], and 0.
    normal : tuple
        That of a line, global; of flanks 1 or -1, which way the second body is turned, and 0; of ``circles`` as CIRCLES
        has them; of no other kind.
    reach : number
        Sum of the circles' radii, their difference, or how far before the first point a line's face is [m].
    """
    if kind in ("point-line", "angle"):
        return dot(normal, gap) - reach, normal
    way = CIRCLES.get(kind, normal[0])
    return way * (length - reach), (way * gap[0] / length, way * gap[1] / length)


def touched(normal: Vector, radius: Number) -> Vector:
    """From the second point to where its circle is touched."""
    return -radius * normal[0], -radius * normal[1]


def sliding(normal: Vector, gap_rate: Vector, arms: tuple[Vector, Vector], omegas: tuple[Number, Number]) -> Number:
    """Speed of the second side's material past the first's at the touched place, along the normal turned by 90 deg.

    ``arms`` lead to that place from the two points.
    """
    along = quarter_turn(normal)
    turned = [omega * dot(along, quarter_turn(arm)) for omega, arm in zip(omegas, arms, strict=True)]
    return dot(along, gap_rate) + turned[1] - turned[0]


def elastic(K: Number, n: Number, depth: Number) -> Number:
    """K d^n [N]."""
    return K * depth**n


def push(law: str, K: Number, n: Number, chi: Number, v_0: Number, depth: Number, rate: Number) -> Number:
    """Force of a law [N] that is ``depth`` deep [m], which grows by ``rate`` [m/s]; of Kelvin-Voigt chi is c [N s/m].

    Kelvin and Voigt's damper is beside the spring, so its force is there at once, and turns to tension before the
    bodies are apart: the contact ends where it is zero. The others' is zero where the depth is.
    """
    if law == "hertz":
        return elastic(K, n, depth)
    if law == "kelvin-voigt":
        return elastic(K, n, depth) + chi * rate
    return elastic(K, n, depth) * (1 + chi * rate / v_0)


def hysteresis(law: str, restitution: float) -> float:
    """chi of a law that is asked for a restitution 0 < e <= 1; none of Hertz's, which loses nothing."""
    if law == "exact":
        return chi_that_returns(restitution)
    return float(CHI[law](restitution)) if law in CHI else 0.0


def kind_of(contact: Contact) -> int:
    """The number of its geometry."""
    return KINDS.index("circles" if contact.kind in CIRCLES else contact.kind)


def numbers_of(contact: Contact) -> tuple[float, ...]:
    """The numbers of a contact as the kernels of ``generated/contact.py`` read them, by its NUMBERS."""
    damped = contact.law == "kelvin-voigt"
    loss = contact.damping if damped else hysteresis(contact.law, contact.restitution)
    direction = (CIRCLES[contact.kind], 0.0) if contact.kind in CIRCLES else contact.direction
    return (
        *direction, contact.reach, contact.stiffness, contact.exponent, loss, contact.restitution,
        contact.radius,
    )  # fmt: skip


def _excess(e: float, chi: float) -> float:
    """By how much ln((1 + chi)/(1 - e chi)) exceeds chi (1 + e), over chi^2: it has no root at chi = 0."""
    return (math.log1p(chi) - math.log1p(-e * chi) - chi * (1 + e)) / chi**2


def chi_that_returns(e: float) -> float:
    """chi with which a contact returns exactly the restitution 0 < e <= 1; it is nearly 1.5 (1 - e) close to one."""
    if e == 1:
        return 0.0
    most = (1 / e) * (1 - 1e-15)
    least = 0.5 * (1 - e)
    if _excess(e, most) <= 0:  # as small an e leaves chi = 1/e to the last digit
        return 1 / e
    if _excess(e, least) >= 0:  # and one as large the first term of its series
        return 1.5 * (1 - e)
    return _root(lambda chi: _excess(e, chi), least, most)


def returned(chi: float) -> float:
    """The restitution that a contact with chi >= 0 returns, from 1 at chi = 0 towards 0."""
    if chi == 0:
        return 1.0
    least, most = 0.0, min(1.0, (1 / chi) * (1 - 1e-15))
    if _excess(most, chi) <= 0:  # where no rounding tells the end from its limit
        return most
    return _root(lambda e: _excess(e, chi), least, most)


def _root(of: Callable[[float], float], least: float, most: float) -> float:
    from scipy.optimize import brentq

    return brentq(of, least, most, xtol=1e-16, rtol=1e-15)
