"""Contacts and their laws, for any kind of number: gap of two bodies, contact force and restitution.

A contact with approach speed v_0 and penetration d has the force F = K d^n (1 + chi d'/v_0); the laws differ in chi.
Without other forces v dv = -(F/m) dd gives the actual restitution e of each law, independent of m, K, n and v_0
(Hunt & Crossley 1975, J. Appl. Mech. 42, 440, for small chi; exact here):

    (1 + chi)/(1 - e chi) = exp(chi (1 + e))

Newton's law has no penetration: rigid sides separate at once with e times the speed of approach.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from kaneflex.mechanism.parts import CIRCLES
from kaneflex.mechanism.planar import Number, Vector, dot

KINDS = ("point-line", "circles", "angle")
"""Geometries, in the order of their numbers in kernels."""
LAWS = ("hertz", "kelvin-voigt", "hunt-crossley", "lankarani-nikravesh", "flores", "exact", "newton")
"""Laws, in the order of their numbers in kernels."""
NEWTON = LAWS.index("newton")
"""Law of rigid sides: speeds jump, without penetration."""
CHI: dict[str, Callable[[Number], Number]] = {
    "hunt-crossley": lambda e: 3 * (1 - e) / 2,
    "lankarani-nikravesh": lambda e: 3 * (1 - e**2) / 4,
    "flores": lambda e: 8 * (1 - e) / (5 * e),
}
"""Formulas of chi by the requested restitution e, for laws with a closed form.

Hunt & Crossley 1975, J. Appl. Mech. 42, 440; Lankarani & Nikravesh 1990, J. Mech. Des. 112, 369; Flores, Machado,
Silva & Martins 2011, Multibody Syst. Dyn. 25, 357."""


class Contact(NamedTuple):
    """Contact of two sides.

    Attributes
    ----------
    kind : str
        "point-line", "circle-circle" or "circle-in-circle" (the second side in the first), in space "point-plane" and
        "circle-in-circle" of spheres;
        "angle": two rotating flanks, with angles [rad] for lengths and torques [N m] for forces.
    direction : tuple
        Unit normal of a line or a plane, in the first body's axes, towards the second side; (0, 0) for circles; (1, 0)
        or (-1, 0) for flanks, the direction of the torque on the second body.
    reach : number
        Distance at first touch along the normal [m]; for circles the sum, or difference, of radii.
    radius : number
        Radius of the second side's circle [m]; 0 for a point, or if not used.
    stiffness, exponent : number
        K [N/m^n] and n of K d^n.
    damping : number
        c of Kelvin-Voigt [N s/m].
    restitution : number
        Requested restitution.
    law : str
        One of LAWS; only for numerical values.
    joint : str or None
        Joint with the clearance that it belongs to; only for numerical values.
    """

    name: str
    first: Any
    second: Any
    kind: str
    direction: Sequence[Number]
    reach: Number
    radius: Number
    stiffness: Number
    exponent: Number
    damping: Number
    restitution: Number
    law: str = ""
    joint: str | None = None

    @property
    def sides(self) -> tuple[Any, Any]:
        return self.first, self.second


def apart(kind: str, gap: Vector, length: Number, normal: Vector, reach: Number) -> tuple[Number, Vector]:
    """Gap of two sides, and the unit normal of the force on the second.

    Parameters
    ----------
    gap : tuple
        Global vector from the first point to the second, of ``length`` [m]. For flanks the angle of the second body
        relative to the first [rad], and 0.
    normal : tuple
        Normal of a line, global; for flanks 1 or -1 (direction of the torque on the second body), and 0; for
        ``circles`` the sign in CIRCLES.
    reach : number
        Sum or difference of the circles' radii, or distance of a line's face in front of the first point [m].
    """
    if kind in ("point-line", "angle"):
        return dot(normal, gap) - reach, normal
    way = CIRCLES.get(kind, normal[0])
    return way * (length - reach), (way * gap[0] / length, way * gap[1] / length)


def elastic(K: Number, n: Number, depth: Number) -> Number:
    """Elastic force K d^n [N]."""
    return K * depth**n


def push(law: str, K: Number, n: Number, chi: Number, v_0: Number, depth: Number, rate: Number) -> Number:
    """Contact force [N] at a ``depth`` [m] and its ``rate`` [m/s]; for Kelvin-Voigt chi is c [N s/m].

    The force of Kelvin and Voigt's parallel damper jumps at first touch, and would become tensile before the bodies
    separate: the contact ends where it is zero. The other laws give zero force at zero depth.
    """
    if law == "hertz":
        return elastic(K, n, depth)
    if law == "kelvin-voigt":
        return elastic(K, n, depth) + chi * rate
    return elastic(K, n, depth) * (1 + chi * rate / v_0)


def hysteresis(law: str, restitution: float) -> float:
    """Coefficient chi of a law for a restitution 0 < e <= 1; 0 for Hertz's law, which is lossless."""
    if law == "exact":
        return chi_for_restitution(restitution)
    return float(CHI[law](restitution)) if law in CHI else 0.0


def kind_of(contact: Contact) -> int:
    """Number of the contact's geometry; in space that of a plane in place of a line."""
    kind = "point-line" if contact.kind == "point-plane" else contact.kind
    return KINDS.index("circles" if kind in CIRCLES else kind)


def numbers_of(contact: Contact) -> tuple[float, ...]:
    """Numbers of a contact for the kernels of ``generated/contact.py``, in the order of its NUMBERS."""
    damped = contact.law == "kelvin-voigt"
    loss = contact.damping if damped else hysteresis(contact.law, contact.restitution)
    direction = (CIRCLES[contact.kind], 0.0) if contact.kind in CIRCLES else contact.direction[:2]
    return (
        *direction, contact.reach, contact.stiffness, contact.exponent, loss, contact.restitution,
        contact.radius,
    )  # fmt: skip


def _excess(e: float, chi: float) -> float:
    """Function (ln((1 + chi)/(1 - e chi)) - chi (1 + e)) / chi^2, without the root at chi = 0."""
    return (math.log1p(chi) - math.log1p(-e * chi) - chi * (1 + e)) / chi**2


def chi_for_restitution(e: float) -> float:
    """Coefficient chi with exactly the restitution 0 < e <= 1; about 1.5 (1 - e) near e = 1."""
    if e == 1:
        return 0.0
    most = (1 / e) * (1 - 1e-15)
    least = 0.5 * (1 - e)
    if _excess(e, most) <= 0:  # for such a small e chi = 1/e to the last digit
        return 1 / e
    if _excess(e, least) >= 0:  # for such a large e the first term of the series is exact
        return 1.5 * (1 - e)
    return _root(lambda chi: _excess(e, chi), least, most)


def restitution_of(chi: float) -> float:
    """Restitution of a contact with chi >= 0, from 1 at chi = 0 towards 0."""
    if chi == 0:
        return 1.0
    least, most = 0.0, min(1.0, (1 / chi) * (1 - 1e-15))
    if _excess(most, chi) <= 0:  # bracket that rounding does not distinguish from its limit
        return most
    return _root(lambda e: _excess(e, chi), least, most)


def _root(of: Callable[[float], float], least: float, most: float) -> float:
    """Root of a function that rises, to the last digit, by bisection: importing SciPy's takes 0.3 s."""
    while least < (middle := 0.5 * (least + most)) < most:
        least, most = (least, middle) if of(middle) > 0.0 else (middle, most)
    return least
