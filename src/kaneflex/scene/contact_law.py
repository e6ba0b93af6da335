"""How two sides that touch push each other: the law, and Hertz's stiffness of spheres and cylinders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import ValidationInfo, WithJsonSchema, field_validator, model_validator

from kaneflex.scene.materials import MATERIALS
from kaneflex.scene.quantities import (
    NonNegativeDamping,
    NonNegativeRatio,
    PositiveForce,
    PositiveModulus,
    PositiveRatio,
    two,
)
from kaneflex.scene.table import SceneTable, the_one_given
from kaneflex.support.errors import Fault, nearest, within
from kaneflex.support.units import NUMBER_WITH_UNIT, TORSIONAL_DAMPING, Dimension, to_si

_ABOVE_ZERO = ("flores", "exact")
"""Laws whose hysteresis grows beyond all bounds as the restitution goes to zero."""
_SMALLEST_LOGARITHM = 3.0
"""Of 4 pi E* w (R_1 +- R_2) / F: below it the contact is so wide that Hertz's half-planes are no picture of it."""


def _material(name: object) -> object:
    if not isinstance(name, str) or name not in MATERIALS:
        raise Fault(f"unknown material {name!r}", nearest(str(name), MATERIALS))
    return name


MaterialPair = two(
    str, _material, "not two materials", "Write like ['steel', 'aluminium'], one for each side", "two materials"
)
ContactStiffness = Annotated[
    float, WithJsonSchema({"type": ["number", "string"], "description": "K of K d^n, N/m^n; or with that unit"})
]


class ContactLaw(SceneTable):
    """How two sides push each other: F = K d^n (1 + chi d'/v_0), d deep, v_0 the speed of approach.

    K is a `stiffness` (N/m^n) with its `exponent` n, or Hertz's of two `materials` or of their contact `modulus` E*
    (1/E* = the sum of (1 - nu^2)/E): of spheres, or of cylinders about a `load` (N). `law` says what chi is by the
    `restitution` e that is asked for: `exact` returns it, `hunt-crossley`, `lankarani-nikravesh` and `flores` return
    another one, `hertz` loses nothing, and `kelvin-voigt` has a `damping` c beside the spring, K d^n + c d'.
    `newton` has rigid sides, no K and no d: they part at once with `restitution` times the speed of approach.
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
            raise Fault("below one the force would rise at once without bounds to its slope", cure, below="exponent")
        self.refuse(("exponent",) if given != "stiffness" else ("load",), f"has no meaning beside {given}")
        needs, strange = ("damping", "restitution") if self.law == "kelvin-voigt" else ("restitution", "damping")
        if getattr(self, strange) is not None:
            raise Fault(f"law {self.law} has none", "Leave it out", below=strange)
        if self.law == "hertz":
            if self.restitution is not None:
                raise Fault("law hertz loses nothing: it returns 1", "Leave it out", below="restitution")
        elif getattr(self, needs) is None:
            raise Fault(f"law {self.law} needs a {needs}", f"Give {needs}, or take law hertz, which loses nothing")
        self._returns_less()
        if self.restitution == 0 and self.law in _ABOVE_ZERO:
            reason = f"law {self.law} would need a force without bounds"
            raise Fault(reason, "Give a number above zero, like 0.01", below="restitution")
        return self

    def _rigid(self) -> ContactLaw:
        pressed = ("stiffness", "exponent", "materials", "modulus", "load", "damping")
        self.refuse(pressed, "law newton has rigid sides, which nothing presses in")
        if self.restitution is None:
            raise Fault("law newton needs a restitution", "Give restitution, from 0, which sticks, to 1")
        self._returns_less()
        return self

    def _returns_less(self) -> None:
        if self.restitution is not None and self.restitution > 1:
            raise Fault("more would come back than went in", "Give a number up to 1", below="restitution")

    @property
    def contact_modulus(self) -> float | None:
        """E* [Pa], where it is known."""
        if self.materials is None:
            return self.modulus
        return 1 / sum((1 - MATERIALS[name].nu ** 2) / MATERIALS[name].E for name in self.materials)


def _stiffness(value: object, n: float, unit: str) -> float:
    """K of K d^n, where it may stand with its unit: this one, of n = 1, to the power of n below the line."""
    unit = unit if n == 1 else f"{unit}^{n:g}"
    match = NUMBER_WITH_UNIT.match(value) if isinstance(value, str) else None
    if match is not None and match[2].replace(" ", "") == unit.replace(" ", ""):
        value = float(match[1])
    number = to_si(value, Dimension("a contact stiffness", unit, f"1e9 {unit}"))
    if number <= 0:
        raise Fault("a contact stiffness must be above zero", f"Write one like '1e9 {unit}'")
    return number


def of_flanks(given: Mapping[str, object]) -> dict[str, object]:
    """A contact law as it is written between flanks that turn: its stiffness and damping as plain numbers.

    K is in N m/rad^n, c in N m s/rad. Raises Fault for another unit.
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
    """K = 4/3 E* sqrt(R) of K d^1.5 [N/m^1.5] (Hertz 1881; Johnson 1985, Contact Mechanics, eq. 4.23)."""
    return 4 / 3 * modulus / math.sqrt(curvature)


def cylinders(modulus: float, width: float, room: float, load: float | None) -> tuple[float, float]:
    """K and n with which K d^n has, at a load, the depth and the stiffness of two parallel cylinders.

    Johnson 1985, Contact Mechanics, sec. 4.2 and 5.6, by whose d = F/(pi E* w) (ln(4 pi E* w R/F) - 1), with the sum of
    the radii for R, or their difference where the one lies in the other, force and depth are no power of each other:
    so n = (l - 1)/(l - 2), l being the logarithm. Raises Fault: no load, or one at which the contact is too wide.
    """
    if load is None:
        reason = "the depth of cylinders is no power of their force: K d^n is fitted to it about one"
        raise Fault(reason, "Give contact.load, a force that is typical, like load = '1 kN'", below="contact")
    stiff = math.pi * modulus * width
    logarithm = math.log(4 * stiff * room / load)
    if logarithm < _SMALLEST_LOGARITHM:
        raise Fault(
            "at this force the cylinders touch over more of their round than Hertz's theory is true for",
            f"Give one up to {4 * stiff * room / math.exp(_SMALLEST_LOGARITHM):.3g} N, or contact.stiffness",
            below="contact.load",
        )
    n = (logarithm - 1) / (logarithm - 2)
    depth = load / stiff * (logarithm - 1)
    return load / depth**n, n
