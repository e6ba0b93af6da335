"""Parts of a mechanism that act by forces, for any kind of number: springs, contacts and friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from kaneflex.mechanism.planar import Number


class Spring(NamedTuple):
    """Spring with a damper between two points [N/m, N s/m] or at a revolute joint [N m/rad, N m s/rad].

    ``free`` is the free length [m], or the free angle [rad] of the joint's second body relative to the first. Of a
    bushing in space stiffness and damping are six numbers each, along and about the axes of its first body.
    """

    name: str
    first: Any
    second: Any
    joint: str | None
    stiffness: Number
    damping: Number
    free: Number = 0.0

    @property
    def sides(self) -> tuple[Any, Any]:
        return self.first, self.second

    @property
    def ends(self) -> tuple[Any, ...]:
        """Points that the spring joins; none for a torsional spring."""
        return self.sides if self.joint is None else ()

    @property
    def is_bushing(self) -> bool:
        return isinstance(self.stiffness, tuple)

    @property
    def is_directed(self) -> bool:
        """True if the force needs the direction between the points, which coinciding points do not have.

        Without free length and damper the force is -k d.
        """
        return self.joint is None and not self.is_bushing and not (self.free == 0 and self.damping == 0)

    @property
    def scalars(self) -> tuple[tuple[str, str], ...]:
        """Names and units of its tabulated values; for a bushing the forces and moments in its first body's axes."""
        if self.is_bushing:
            return (*((f"force_{axis}", "N") for axis in "xyz"), *((f"moment_{axis}", "N m") for axis in "xyz"))
        return (("tension", "N") if self.joint is None else ("torque", "N m"),)


class Contact(NamedTuple):
    """Contact of two sides (:mod:`kaneflex.mechanism.contacts`).

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
        One of ``contacts.LAWS``; only for numerical values.
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


class Friction(NamedTuple):
    """Friction at a contact, in a pin or along a guide (:mod:`kaneflex.mechanism.friction`).

    Attributes
    ----------
    law : str
        One of ``friction.LAWS``.
    mu, mu_static : float
        Kinetic and static coefficient.
    speed, exponent : float
        Stribeck speed, at which the excess of the static coefficient has fallen to 1/e [m/s or rad/s]; exponent of the
        exponential.
    viscous : float
        Force [N s/m] or torque [N m s/rad] per speed.
    preload : float
        Dry friction without any normal force [N or N m].
    arm : float
        Radius of a pin [m]; for a guide 2 over the block's length [1/m], 0 if moments cause no normal force.
    stiffness, damping : float
        Stiffness and damping of bristles [N/m or N m/rad, N s/m or N m s/rad].
    """

    law: str
    mu: float
    mu_static: float
    speed: float = 0.0
    exponent: float = 2.0
    viscous: float = 0.0
    preload: float = 0.0
    arm: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
