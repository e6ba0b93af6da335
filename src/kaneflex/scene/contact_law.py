"""Laws of contact and friction in a scene file, and Hertzian stiffness of spheres and cylinders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from kaneflex.scene.beams import MATERIALS
from kaneflex.scene.quantities import (
    DriveSpeed,
    JointDamping,
    JointForce,
    JointStiffness,
    NonNegativeDamping,
    NonNegativeLength,
    NonNegativeRatio,
    PositiveForce,
    PositiveLength,
    PositiveModulus,
    PositiveRatio,
    PositiveWear,
    two,
    written,
)
from kaneflex.scene.table import SceneTable, the_one_given
from kaneflex.support import units
from kaneflex.support.errors import Fault, nearest, within
from kaneflex.support.units import NUMBER_WITH_UNIT, TORSIONAL_DAMPING, Dimension, to_si

_ABOVE_ZERO = ("flores", "exact")
"""Laws whose hysteresis becomes infinite as the restitution goes to zero."""
_SMALLEST_LOGARITHM = 3.0
"""Smallest logarithm of 4 pi E* w (R_1 +- R_2) / F: below it the contact is too wide for Hertz's half-planes."""


def _material(name: object) -> object:
    if not isinstance(name, str) or name not in MATERIALS:
        raise Fault(f"unknown material {name!r}", nearest(str(name), MATERIALS))
    return name


MaterialPair = two(
    str, _material, "not two materials", "Write one for each side, like ['steel', 'aluminium']", "two materials"
)
ContactStiffness = Annotated[float, written("K of K d^n, N/m^n; or a text with that unit")]


class ContactLaw(SceneTable):
    """Contact force F = K d^n (1 + chi d'/v_0) with penetration d and speed of approach v_0.

    K is a `stiffness` (N/m^n) with its `exponent` n, or Hertz's of two `materials` or of their contact `modulus` E*
    (1/E* = the sum of (1 - nu^2)/E): of spheres, or of cylinders linearised at a `load` (N). `law` selects chi for a
    `restitution` e: `exact` reproduces e; `hunt-crossley`, `lankarani-nikravesh` and `flores` give approximately e;
    `hertz` is lossless; `kelvin-voigt` has a `damping` c: K d^n + c d'. `newton` has rigid sides without K and d,
    which separate at once with `restitution` times the speed of approach.
    """

    law: Literal["exact", "hertz", "kelvin-voigt", "hunt-crossley", "lankarani-nikravesh", "flores", "newton"] = "exact"
    exponent: PositiveRatio = 1.5
    stiffness: ContactStiffness | None = None
    materials: MaterialPair | None = None
    modulus: PositiveModulus | None = None
    load: PositiveForce | None = None
    restitution: NonNegativeRatio | None = None
    damping: NonNegativeDamping | None = None

    @field_validator("stiffness", mode="before")
    @classmethod
    def _in_its_unit(cls, value: object, info: ValidationInfo) -> float:
        return _stiffness(value, info.data.get("exponent", 1.5), "N/m")

    @model_validator(mode="after")
    def _consistent(self) -> ContactLaw:
        if self.law == "newton":
            return self._rigid()
        given = the_one_given(self, ("stiffness", "materials", "modulus"))
        if self.exponent < 1:
            cure = "Write 1 for a spring, 1.5 for Hertz's spheres"
            raise Fault("below one the contact stiffness would be infinite at first touch", cure, below="exponent")
        self.refuse(("exponent",) if given != "stiffness" else ("load",), f"cannot be combined with {given}")
        needs, strange = ("damping", "restitution") if self.law == "kelvin-voigt" else ("restitution", "damping")
        if getattr(self, strange) is not None:
            raise Fault(f"law {self.law} does not use it", "Leave it out", below=strange)
        if self.law == "hertz":
            if self.restitution is not None:
                raise Fault("law hertz is lossless: its restitution is 1", "Leave it out", below="restitution")
        elif getattr(self, needs) is None:
            raise Fault(f"law {self.law} needs a {needs}", f"Give {needs}, or use law hertz, which is lossless")
        self._returns_less()
        if self.restitution == 0 and self.law in _ABOVE_ZERO:
            reason = f"law {self.law} would need an infinite force"
            raise Fault(reason, "Give a number above zero, like 0.01", below="restitution")
        return self

    def _rigid(self) -> ContactLaw:
        pressed = ("stiffness", "exponent", "materials", "modulus", "load", "damping")
        self.refuse(pressed, "law newton has rigid sides without penetration")
        if self.restitution is None:
            raise Fault("law newton needs a restitution", "Give restitution from 0 (no rebound) to 1")
        self._returns_less()
        return self

    def _returns_less(self) -> None:
        if self.restitution is not None and self.restitution > 1:
            raise Fault("the impact would gain energy", "Give a number up to 1", below="restitution")

    @property
    def contact_modulus(self) -> float | None:
        """Contact modulus E* [Pa], None if unknown."""
        if self.materials is None:
            return self.modulus
        return 1 / sum((1 - MATERIALS[name].nu ** 2) / MATERIALS[name].E for name in self.materials)


def _stiffness(value: object, n: float, unit: str) -> float:
    """Contact stiffness K of K d^n [N/m^n]; a unit is that of n = 1 with the denominator to the power of n."""
    unit = unit if n == 1 else f"{unit}^{n:g}"
    match = NUMBER_WITH_UNIT.match(value) if isinstance(value, str) else None
    if match is not None and match[2].replace(" ", "") == unit.replace(" ", ""):
        value = float(match[1])
    number = to_si(value, Dimension("a contact stiffness", unit, f"1e9 {unit}"))
    if number <= 0:
        raise Fault("a contact stiffness must be above zero", f"Write one like '1e9 {unit}'")
    return number


def of_flanks(given: Mapping[str, object]) -> dict[str, object]:
    """Contact law of rotating flanks, with stiffness in N m/rad^n and damping in N m s/rad as plain numbers.

    Raises Fault for another unit.
    """
    found = dict(given)
    exponent = found.get("exponent", 1.5)
    units = {
        "stiffness": lambda value: _stiffness(value, exponent if isinstance(exponent, int | float) else 1.5, "N m/rad"),
        "damping": lambda value: to_si(value, TORSIONAL_DAMPING),
    }
    for field, convert in units.items():
        if field in found:
            with within(field):
                found[field] = convert(found[field])
    return found


def spheres(modulus: float, curvature: float) -> float:
    """Stiffness K = 4/3 E* sqrt(R) of K d^1.5 [N/m^1.5] (Hertz 1881; Johnson 1985, Contact Mechanics, eq. 4.23)."""
    return 4 / 3 * modulus / math.sqrt(curvature)


def cylinders(modulus: float, width: float, clearance: float, load: float | None) -> tuple[float, float]:
    """Fit K and n so that K d^n has, at a load, the depth and the stiffness of two parallel cylinders.

    Johnson 1985, Contact Mechanics, sec. 4.2 and 5.6: d = F/(pi E* w) (ln(4 pi E* w R/F) - 1), where R is the sum of
    the radii, or their difference for a cylinder inside the other. This is not a power law, so n = (l - 1)/(l - 2)
    with the logarithm l. Raises Fault without a load, or if the contact is too wide at this load.
    """
    if load is None:
        reason = "the stiffness of cylinders depends on the load at which K d^n is fitted, which is missing"
        raise Fault(reason, "Give contact.load, a typical force, like load = '1 kN'", below="contact")
    stiff = math.pi * modulus * width
    logarithm = math.log(4 * stiff * clearance / load)
    if logarithm < _SMALLEST_LOGARITHM:
        raise Fault(
            "at this force the contact of the cylinders is too wide for Hertz's theory",
            f"Give a load up to {4 * stiff * clearance / math.exp(_SMALLEST_LOGARITHM):.3g} N, or contact.stiffness",
            below="contact.load",
        )
    n = (logarithm - 1) / (logarithm - 2)
    depth = load / stiff * (logarithm - 1)
    return load / depth**n, n


_DIMENSIONS: dict[str, tuple[Dimension, Dimension]] = {
    "preload": (units.TORQUE, units.FORCE),
    "viscous": (units.TORSIONAL_DAMPING, units.DAMPING),
    "stribeck_speed": (units.ANGULAR_SPEED, units.SPEED),
    "bristle_stiffness": (units.TORSIONAL_STIFFNESS, units.STIFFNESS),
    "bristle_damping": (units.TORSIONAL_DAMPING, units.DAMPING),
}
"""Key -> its dimension for a pin, and for a guide or a contact."""
_POSITIVE = ("stribeck_speed", "bristle_stiffness")
_NEEDS = {"coulomb": (), "stribeck": ("stribeck_speed",), "viscous": (), "lugre": ("bristle_stiffness",)}
_DRY = ("mu", "mu_static", "preload", "viscous", "radius", "length")
_STRIBECK = (*_DRY, "stribeck_speed", "stribeck_exponent")
_KNOWS = {
    "coulomb": (*_DRY, "wear"), "stribeck": _STRIBECK, "viscous": ("viscous",),
    "lugre": (*_STRIBECK, "bristle_stiffness", "bristle_damping"),
}  # fmt: skip


class Friction(SceneTable):
    """Friction force: mu N + `preload`, with the normal force N, plus `viscous` times the speed.

    N is a contact's normal force; a pin's reaction times its `radius`; a guide's normal force, or with the `length` of
    its block the sum of the forces at both ends. Sticking holds up to `mu_static` N + `preload`. `law` is `coulomb`;
    `stribeck`, whose coefficient falls from `mu_static` to `mu` as exp(-(v/v_s)^delta) with the `stribeck_speed` and
    `stribeck_exponent`; `viscous`; or `lugre`, with bristles of a `bristle_stiffness` and `bristle_damping` that
    deflect until they slip by Stribeck's law, or Coulomb's. `wear` is the volume that is worn off per normal force and
    sliding distance (Archard 1953, J. Appl. Phys. 24, 981).
    """

    law: Literal["coulomb", "stribeck", "viscous", "lugre"] = "coulomb"
    mu: NonNegativeRatio = 0.0
    mu_static: NonNegativeRatio | None = Field(default=None, description="equal to `mu`")
    preload: JointForce = 0.0
    viscous: JointDamping = 0.0
    radius: PositiveLength | None = None
    length: NonNegativeLength = 0.0
    stribeck_speed: DriveSpeed | None = None
    stribeck_exponent: PositiveRatio = 2.0
    bristle_stiffness: JointStiffness | None = None
    bristle_damping: JointDamping = 0.0
    wear: PositiveWear | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Friction:
        self.refuse(self.model_fields_set - {"law", *_KNOWS[self.law]}, f"law {self.law} does not use it")
        for key in _NEEDS[self.law]:
            if getattr(self, key) is None:
                raise Fault(f"law {self.law} needs a {key}", "Give it, or use another law")
        for key in _DIMENSIONS:
            value = getattr(self, key)
            if value is not None and (value < 0 or (value == 0 and key in _POSITIVE)):
                least = "above zero" if key in _POSITIVE else "at least zero"
                raise Fault(f"not {least}", "Give its magnitude: friction opposes the motion", below=key)
        if self.mu_static is not None and self.mu_static < self.mu:
            reason = f"below mu = {self.mu:g}: static friction cannot be smaller than sliding friction"
            raise Fault(reason, "Give a mu_static of at least mu", below="mu_static")
        if not (self.mu or self.mu_static or self.preload or self.viscous):
            raise Fault("there is no friction", "Give mu, preload or viscous, or leave friction out")
        if self.law == "lugre":
            self._check_bristles()
        if self.wear is not None and (not self.mu or self.preload or self.viscous):
            reason = "the worn volume is computed from the work of friction, which must be mu N alone"
            raise Fault(reason, "Give mu, and leave preload and viscous out", below="wear")
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
