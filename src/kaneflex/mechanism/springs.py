"""Law of a spring with a parallel damper, for any kind of number.

Between two points at a distance d its length is L = |d| with the rate L' = d . d' / L; at a joint it is the angle of
the second body relative to the first, and its rate.
"""

from __future__ import annotations

from collections.abc import Sequence

from kaneflex.mechanism.force_parts import Spring
from kaneflex.mechanism.planar import Number
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError


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
