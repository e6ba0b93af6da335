"""Friction and its laws, for any kind of number.

N is a contact's normal force [N], at a pin the reaction times the pin's radius [N m], at a guide the sum of the forces
on its faces [N]. v is the speed of the second side relative to the first; friction acts on the second side against v.
In sticking, friction is the force that prevents sliding, up to ``limit``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from kaneflex.mechanism.planar import Number, Vector

LAWS = ("coulomb", "stribeck", "viscous", "lugre")
"""Laws, in the order of their numbers in kernels."""


class Friction(NamedTuple):
    """Friction at a contact, in a pin or along a guide.

    Attributes
    ----------
    law : str
        One of LAWS.
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
