"""Laws of friction, over any kind of number: what resists two sides that slide along each other.

N is what presses them together: a contact's normal force [N], at a pin the reaction times the pin's radius [N m], at a
guide the sum of what its faces bear [N]. v is the speed of the second side past the first, and friction acts on the
second side against it. While nothing slides, dry friction is whatever keeps it so, up to ``limit``.
"""

from __future__ import annotations

from collections.abc import Callable

from kaneflex.mechanism.parts import Friction
from kaneflex.mechanism.planar import Number, Vector

LAWS = ("coulomb", "stribeck", "viscous", "lugre")
"""In the order of the numbers that kernels know them by."""


def limit(mu_static: Number, preload: Number, N: Number) -> Number:
    """Largest force [N or N m] that holds."""
    return mu_static * N + preload


def dry(mu: Number, mu_static: Number, preload: Number, N: Number, excess: Number) -> Number:
    """Force [N or N m] against sliding that doesn't change its sign with the speed alone.

    ``excess`` is the share of the static coefficient beyond the kinetic one that the speed has left.
    """
    return (mu + (mu_static - mu) * excess) * N + preload


def excess(speed: Number, v: Number, exponent: Number, exp: Callable[[Number], Number]) -> Number:
    """Stribeck's share of |v| = ``v``: exp(-(v/v_s)^delta) (Bo & Pavelescu 1982, Wear 82, 277)."""
    return exp(-((v / speed) ** exponent))


def bristle_rate(stiffness: Number, g: Number, v: Number, size: Number, z: Number) -> Number:
    """How fast bristles that are bent by z bend further [m/s or rad/s]: v - sigma_0 |v| z / g, |v| = ``size``.

    ``g`` is :func:`dry` at this speed (Canudas de Wit, Olsson, Astrom & Lischinsky 1995, IEEE Trans. Autom. Control 40,
    419, eq. 2).
    """
    return v - stiffness * size / g * z


def bristle_force(
    stiffness: Number, damping: Number, viscous: Number, rate: Number, v: Number, z: Number
) -> Number:  # fmt: skip
    """Force [N or N m] of bristles that are bent by z at that rate, against the motion: eq. 3 of the same."""
    return stiffness * z + damping * rate + viscous * v


def numbers_of_lent(inertia: float) -> tuple[float, ...]:
    """The numbers of a hold that takes back an inertia [kg m^2]: no law, the inertia as its arm."""
    return (*(0.0,) * 9, inertia, -1.0, -1.0, 0.0, 0.0)


def numbers_of(friction: Friction, direction: Vector, of: int) -> tuple[float, ...]:
    """The numbers of a friction as the kernels of ``generated/friction.py`` read them, by its NUMBERS.

    ``of`` is the act of its contact, or of its joint, which is a cut.
    """
    return (
        *(float(part) for part in direction), 0.0, friction.mu, friction.mu_static, friction.speed, friction.exponent,
        friction.viscous, friction.preload, friction.arm,
        float(LAWS.index(friction.law)), float(of), friction.stiffness, friction.damping,
    )  # fmt: skip
