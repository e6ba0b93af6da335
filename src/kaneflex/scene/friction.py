"""Friction at a joint or a contact: law and parameters in a scene file."""

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
"""Key -> its dimension for a pin, and for a guide or a contact."""
_ABOVE_ZERO = ("stribeck_speed", "bristle_stiffness")
_NEEDS = {"coulomb": (), "stribeck": ("stribeck_speed",), "viscous": (), "lugre": ("bristle_stiffness",)}
_DRY = ("mu", "mu_static", "preload", "viscous", "radius", "length")
_STRIBECK = (*_DRY, "stribeck_speed", "stribeck_exponent")
_KNOWS = {
    "coulomb": _DRY, "stribeck": _STRIBECK, "viscous": ("viscous",),
    "lugre": (*_STRIBECK, "bristle_stiffness", "bristle_damping"),
}  # fmt: skip


class Friction(SceneTable):
    """Friction force: mu N + `preload`, with the normal force N, plus `viscous` times the speed.

    N is a contact's normal force; a pin's reaction times its `radius`; a guide's normal force, or with the `length` of
    its block the sum of the forces at both ends. Sticking holds up to `mu_static` N + `preload`. `law` is `coulomb`;
    `stribeck`, whose coefficient falls from `mu_static` to `mu` as exp(-(v/v_s)^delta) with the `stribeck_speed` and
    `stribeck_exponent`; `viscous`; or `lugre`, with bristles of a `bristle_stiffness` and `bristle_damping` that
    deflect until they slip by Stribeck's law, or Coulomb's.
    """

    law: Literal["coulomb", "stribeck", "viscous", "lugre"] = "coulomb"
    mu: NonNegativeRatio = 0.0
    mu_static: NonNegativeRatio | None = Field(default=None, description="equal to `mu`")
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
        self.refuse(self.model_fields_set - {"law", *_KNOWS[self.law]}, f"law {self.law} does not use it")
        for key in _NEEDS[self.law]:
            if getattr(self, key) is None:
                raise Fault(f"law {self.law} needs a {key}", "Give it, or use another law")
        for key in _DIMENSIONS:
            value = getattr(self, key)
            if value is not None and (value < 0 or (value == 0 and key in _ABOVE_ZERO)):
                least = "above zero" if key in _ABOVE_ZERO else "at least zero"
                raise Fault(f"not {least}", "Give its magnitude: friction opposes the motion", below=key)
        if self.mu_static is not None and self.mu_static < self.mu:
            reason = f"below mu = {self.mu:g}: static friction cannot be smaller than sliding friction"
            raise Fault(reason, "Give a mu_static of at least mu", below="mu_static")
        if not (self.mu or self.mu_static or self.preload or self.viscous):
            raise Fault("there is no friction", "Give mu, preload or viscous, or leave friction out")
        if self.law == "lugre":
            self._check_bristles()
        return self

    def _check_bristles(self) -> None:
        if not (self.mu or self.mu_static or self.preload):
            reason = "law lugre without mu or preload has no friction force"
            raise Fault(reason, "Give mu or preload, or use law viscous")
        if (self.mu_static or self.mu) > self.mu and self.stribeck_speed is None:
            reason = f"law lugre needs stribeck_speed if mu_static = {self.mu_static:g} is above mu = {self.mu:g}"
            raise Fault(reason, "Give stribeck_speed, or leave mu_static out", below="mu_static")

    def check_at(self, kind: str) -> None:
        """Raise Fault for a key that does not apply to a "contact", or a "revolute" or "prismatic" joint."""
        if kind == "weld":
            raise Fault("a weld does not move", "Leave it out")
        strange = (key for key, own in (("radius", "revolute"), ("length", "prismatic")) if kind != own)
        self.refuse(strange, f"does not apply to a {kind}{' joint' * (kind != 'contact')}")
        if kind == "revolute" and (self.mu or self.mu_static) and self.radius is None:
            cure = "Give the pin's radius, or a preload in N m"
            raise Fault("the friction torque of a pin needs its radius", cure)

    @property
    def arm(self) -> float:
        """Radius of the pin, or 2 over the block's length, which converts a moment into forces at its ends."""
        if self.radius is not None:
            return self.radius
        return 2.0 / self.length if self.length else 0.0


def friction_in(value: Any, turning: bool) -> Any:
    """Table with its quantities in SI, as for a pin, or for a guide or a contact."""
    if not isinstance(value, Mapping):
        return value
    found = dict(value)
    for key in found.keys() & _DIMENSIONS.keys():
        with within(key):
            found[key] = to_si(found[key], _DIMENSIONS[key][0 if turning else 1])
    return found
