"""The law of a spring with a damper beside it, over any kind of number.

Between two points d apart it is as long as L = |d|, which changes by L' = d . d' / L; at a joint their place is taken
by the angle of the second body against the first, and its rate.
"""

from __future__ import annotations

from collections.abc import Sequence

from kaneflex.mechanism.parts import Spring
from kaneflex.mechanism.planar import Number
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError


def is_directed(spring: Spring) -> bool:
    """Whether the force needs the direction of d, which points that meet don't have.

    Without free length and damper it is -k d.
    """
    return not (spring.free == 0 and spring.damping == 0)


def rate_of_length(gap: Sequence[Number], gap_rate: Sequence[Number], length: Number) -> Number:
    """L' = d . d' / L, in the plane or in space."""
    return sum(part * rate for part, rate in zip(gap, gap_rate, strict=True)) / length


def drag(spring: Spring, rate: Number) -> Number:
    """What the damper adds to the tension: c L'."""
    return spring.damping * rate


def tension(spring: Spring, now: Number, rate: Number = 0) -> Number:
    """k (L - L_0) + c L' [N]; at a joint k (phi - phi_0) + c phi' [N m], which turns the two bodies back."""
    return spring.stiffness * (now - spring.free) + drag(spring, rate)


def potential(spring: Spring, now: Number) -> Number:
    """1/2 k (L - L_0)^2 [J]."""
    return spring.stiffness * (now - spring.free) ** 2 / 2


def force(spring: Spring, gap: Sequence[Number], pull: Number, length: Number) -> tuple[Number, ...]:
    """Global force on the second point by the tension T: -T d / L, or -k d where that needs no direction."""
    if not is_directed(spring):
        return tuple(-spring.stiffness * part for part in gap)
    return tuple(-pull * part / length for part in gap)


def points_meet(name: str, between: Sequence[Address], where: str = "") -> SceneError:
    """What is said of a spring that needs a direction, and has none."""
    return SceneError(
        f"springs.{name}.between", " and ".join(map(str, between)),
        f"its points meet{where}, where length and damping have no direction",
        "Move one of the points, or give stiffness alone",
    )  # fmt: skip
