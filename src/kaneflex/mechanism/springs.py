"""Springs with parallel dampers and their law, for any kind of number.

Between two points at a distance d its length is L = |d| with the rate L' = d . d' / L; at a joint it is the angle of
the second body relative to the first, and its rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from kaneflex.mechanism.planar import Number
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError


class Spring(NamedTuple):
    """Spring with a damper between two points [N/m, N s/m] or at a revolute joint [N m/rad, N m s/rad].

    ``free`` is the free length [m], or the free angle [rad] of the joint's second body relative to the first. For a
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


def rate_of_length(gap: Sequence[Number], gap_rate: Sequence[Number], length: Number) -> Number:
    """Rate of the length L' = d . d' / L, in the plane or in space."""
    return sum(part * rate for part, rate in zip(gap, gap_rate, strict=True)) / length


def drag(spring: Spring, rate: Number) -> Number:
    """Tension of the damper c L'."""
    return spring.damping * rate


def tension(spring: Spring, now: Number, rate: Number = 0) -> Number:
    """Tension k (L - L_0) + c L' [N]; at a joint the restoring torque k (phi - phi_0) + c phi' [N m]."""
    return spring.stiffness * (now - spring.free) + drag(spring, rate)


def potential(spring: Spring, now: Number) -> Number:
    """Energy 1/2 k (L - L_0)^2 [J]."""
    return spring.stiffness * (now - spring.free) ** 2 / 2


def force(spring: Spring, gap: Sequence[Number], pull: Number, length: Number) -> tuple[Number, ...]:
    """Global force on the second point by the tension T: -T d / L, or -k d if no direction is needed."""
    if not spring.is_directed:
        return tuple(-spring.stiffness * part for part in gap)
    return tuple(-pull * part / length for part in gap)


def points_meet(name: str, between: Sequence[Address], where: str = "") -> SceneError:
    """Error for a spring whose points coincide, so that its force has no direction."""
    return SceneError(
        f"springs.{name}.between", " and ".join(map(str, between)),
        f"its points coincide{where}, so forces by length or damping have no direction",
        "Move one of the points, or give only stiffness",
    )  # fmt: skip
