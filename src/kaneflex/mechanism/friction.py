"""Friction laws, for any kind of number.

N is a contact's normal force [N], at a pin the reaction times the pin's radius [N m], at a guide the sum of the forces
on its faces [N]. v is the speed of the second side relative to the first; friction acts on the second side against v.
In sticking, friction is the force that prevents sliding, up to ``limit``.
"""

from __future__ import annotations

from collections.abc import Callable

from kaneflex.mechanism.force_parts import Friction
from kaneflex.mechanism.planar import Number, Vector

LAWS = ("coulomb", "stribeck", "viscous", "lugre")
"""Laws, in the order of their numbers in kernels."""


def limit(mu_static: Number, preload: Number, N: Number) -> Number:
    """Largest sticking force [N or N m]."""
    return mu_static * N + preload


def dry(mu: Number, mu_static: Number, preload: Number, N: Number, excess: Number) -> Number:
    """Magnitude of dry friction [N or N m] in sliding.

    ``excess`` is the remaining share, at this speed, of the static coefficient's excess over the kinetic one.
    """
    return (mu + (mu_static - mu) * excess) * N + preload


def excess(speed: Number, v: Number, exponent: Number, exp: Callable[[Number], Number]) -> Number:
    """Stribeck's share of |v| = ``v``: exp(-(v/v_s)^delta) (Bo & Pavelescu 1982, Wear 82, 277)."""
    return exp(-((v / speed) ** exponent))


def bristle_rate(stiffness: Number, g: Number, v: Number, size: Number, z: Number) -> Number:
    """Rate of the bristles' deflection z [m/s or rad/s]: v - sigma_0 |v| z / g, |v| = ``size``.

    ``g`` is :func:`dry` at this speed (Canudas de Wit, Olsson, Astrom & Lischinsky 1995, IEEE Trans. Autom. Control 40,
    419, eq. 2).
    """
    return v - stiffness * size / g * z


def bristle_force(
    stiffness: Number, damping: Number, viscous: Number, rate: Number, v: Number, z: Number
) -> Number:  # fmt: skip
    """Force [N or N m] of bristles with deflection z and its rate, against the motion: ibid., eq. 3."""
    return stiffness * z + damping * rate + viscous * v


def numbers_of(friction: Friction, direction: Vector, of: int, end: int = 0) -> tuple[float, ...]:
    """Numbers of a friction for the kernels of ``generated/friction.py``, in the order of its NUMBERS.

    ``of`` is the index of its contact, or of its cut joint, ``end`` the end of the joint's rows.
    """
    return (
        *(float(part) for part in direction), float(end), friction.mu, friction.mu_static, friction.speed,
        friction.exponent, friction.viscous, friction.preload, friction.arm,
        float(LAWS.index(friction.law)), float(of), friction.stiffness, friction.damping,
    )  # fmt: skip
