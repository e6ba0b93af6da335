"""Friction at a joint or a contact: its law and its numbers, as a scene file gives them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from kaneflex.scene.quantities import (
    JointDamping,
    JointForce,
    JointSpeed,
    JointStiffness,
    NonNegativeLength,
    NonNegativeRatio,
    PositiveLength,
    PositiveRatio,
)
from kaneflex.scene.table import SceneTable
from kaneflex.support import units
from kaneflex.support.errors import Fault, within
from kaneflex.support.units import Dimension, to_si

_DIMENSIONS: dict[str, tuple[Dimension, Dimension]] = {
    "preload": (units.TORQUE, units.FORCE),
    "viscous": (units.TORSIONAL_DAMPING, units.DAMPING),
    "stribeck_speed": (units.ANGULAR_SPEED, units.SPEED),
    "bristle_stiffness": (units.TORSIONAL_STIFFNESS, units.STIFFNESS),
    "bristle_damping": (units.TORSIONAL_DAMPING, units.DAMPING),
}
"""Key -> what it is of a pin, and what of a guide or a contact."""
_ABOVE_ZERO = ("stribeck_speed", "bristle_stiffness")
_NEEDS = {"coulomb": (), "stribeck": ("stribeck_speed",), "viscous": (), "lugre": ("bristle_stiffness",)}
_DRY = ("mu", "mu_static", "preload", "viscous", "radius", "length")
_STRIBECK = (*_DRY, "stribeck_speed", "stribeck_exponent")
_KNOWS = {
    "coulomb": _DRY, "stribeck": _STRIBECK, "viscous": ("viscous",),
    "lugre": (*_STRIBECK, "bristle_stiffness", "bristle_damping"),
}  # fmt: skip


class Friction(SceneTable):
    """What resists sliding: mu N + `preload`, N what presses the sides together, and `viscous` times the speed.

    N is a contact's normal force; the reaction of a pin times its `radius`; the normal force of a guide, or with the
    `length` of its block the sum of what both ends bear. Nothing slides below `mu_static` N + `preload`. `law` is
    `coulomb`; `stribeck`, whose coefficient falls from `mu_static` to `mu` as exp(-(v/v_s)^delta) of the
    `stribeck_speed` and `stribeck_exponent`; `viscous`; or `lugre`, whose sides are held by bristles of a
    `bristle_stiffness` and `bristle_damping` that bend until they slip by Stribeck's law, or Coulomb's.
    """

    law: Literal["coulomb", "stribeck", "viscous", "lugre"] = "coulomb"
    mu: NonNegativeRatio = 0.0
    mu_static: NonNegativeRatio | None = Field(default=None, description="that of `mu`")
    preload: JointForce = 0.0
    viscous: JointDamping = 0.0
    radius: PositiveLength | None = None
    length: NonNegativeLength = 0.0
    stribeck_speed: JointSpeed | None = None
    stribeck_exponent: PositiveRatio = 2.0
    bristle_stiffness: JointStiffness | None = None
    bristle_damping: JointDamping = 0.0

    @model_validator(mode="after")
    def _consistent(self) -> Friction:
        self.refuse(self.model_fields_set - {"law", *_KNOWS[self.law]}, f"law {self.law} has none")
        for key in _NEEDS[self.law]:
            if getattr(self, key) is None:
                raise Fault(f"law {self.law} needs a {key}", "Give it, or take another law")
        for key in _DIMENSIONS:
            value = getattr(self, key)
            if value is not None and (value < 0 or (value == 0 and key in _ABOVE_ZERO)):
                least = "above zero" if key in _ABOVE_ZERO else "at least zero"
                raise Fault(f"not {least}", "Give its size: friction is against the motion by itself", below=key)
        if self.mu_static is not None and self.mu_static < self.mu:
            reason = f"below mu = {self.mu:g}: what slides would be held more firmly than what is stuck"
            raise Fault(reason, "Give a mu_static of at least mu", below="mu_static")
        if not (self.mu or self.mu_static or self.preload or self.viscous):
            raise Fault("nothing resists", "Give mu, preload or viscous, or leave friction out")
        if self.law == "lugre":
            self._check_bristles()
        return self

    def _check_bristles(self) -> None:
        if not (self.mu or self.mu_static or self.preload):
            reason = "law lugre without mu or preload: bristles that hold nothing"
            raise Fault(reason, "Give mu or preload, or take law viscous")
        if (self.mu_static or self.mu) > self.mu and self.stribeck_speed is None:
            reason = f"law lugre comes from mu_static = {self.mu_static:g} to mu = {self.mu:g} by a stribeck_speed"
            raise Fault(reason, "Give it, or leave mu_static out", below="mu_static")

    def check_at(self, kind: str) -> None:
        """Raise Fault where a key has no meaning at a "contact", or a "revolute" or "prismatic" joint."""
        if kind == "weld":
            raise Fault("a weld neither slides nor turns", "Leave it out")
        strange = (key for key, own in (("radius", "revolute"), ("length", "prismatic")) if kind != own)
        self.refuse(strange, f"has no meaning at a {kind}{' joint' * (kind != 'contact')}")
        if kind == "revolute" and (self.mu or self.mu_static) and self.radius is None:
            cure = "Give the pin's radius, or a preload in N m"
            raise Fault("mu N is a force, and its arm in a pin isn't known", cure)

    @property
    def arm(self) -> float:
        """The pin's radius, or 2 over the block's length, which makes forces at its ends of a moment."""
        if self.radius is not None:
            return self.radius
        return 2.0 / self.length if self.length else 0.0


def friction_in(value: Any, turning: bool) -> Any:
    """A table as it is written, with its quantities in SI: those of a pin, or of a guide or a contact."""
    if not isinstance(value, Mapping):
        return value
    found = dict(value)
    for key in found.keys() & _DIMENSIONS.keys():
        with within(key):
            found[key] = to_si(found[key], _DIMENSIONS[key][0 if turning else 1])
    return found
