"""Conversion of numbers and strings with units ("137 mm", "6000 rpm") to SI floats.

pint converts the units, except products of plain units with decimal prefixes: importing pint takes 0.7 s (a test
compares these with pint).
"""

from __future__ import annotations

import math
import re
from functools import cache
from tokenize import TokenError
from typing import NamedTuple

from kaneflex.support.errors import Fault

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
"""Pattern of a number: float() also accepts 1_000, digits of other scripts, nan and inf."""
NUMBER_WITH_UNIT = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*\Z")
LARGEST = 1e60
"""Largest magnitude; products of a few larger numbers, or of numbers below the reciprocal, leave double precision."""
_LONGEST = 200
"""Largest length of a number with its unit."""
_UNIT_TEXT = re.compile(r"[\w%°^*/().·\s-]+\Z")
_UNIT_NUMBER = re.compile(r"(?P<power>(?:\^|\*\*)\s*-?\s*)?(?<![\w.])(?P<digits>[0-9][\w.]*)")
"""Pattern of a number in a unit: an exponent, or the 1 of "1/s"."""
_POWER_OF_POWER = re.compile(r"(\^|\*\*)[\s0-9.-]*(\^|\*\*)")


class Dimension(NamedTuple):
    """Physical quantity: its name with article, its SI unit and an example for messages."""

    name: str
    unit: str
    example: str


LENGTH = Dimension("a length", "m", "137 mm")
MASS = Dimension("a mass", "kg", "0.153 kg")
INERTIA = Dimension("a moment of inertia", "kg m^2", "120 kg mm^2")
AREA = Dimension("an area", "m^2", "142.3 mm^2")
SECOND_MOMENT = Dimension("a second moment of area", "m^4", "7008 mm^4")
MODULUS = Dimension("a modulus", "Pa", "210 GPa")
DENSITY = Dimension("a density", "kg/m^3", "7850 kg/m^3")
ACCELERATION = Dimension("an acceleration", "m/s^2", "9.81 m/s^2")
ANGLE = Dimension("an angle", "rad", "720 deg")
ANGULAR_SPEED = Dimension("an angular speed", "rad/s", "6000 rpm")
SPEED = Dimension("a speed", "m/s", "0.5 m/s")
TIME = Dimension("a time", "s", "0.04 s")
FREQUENCY = Dimension("a frequency", "Hz", "3039 Hz")
FORCE = Dimension("a force", "N", "1.2 kN")
TORQUE = Dimension("a torque", "N m", "170 N m")
VISCOSITY = Dimension("a force per length and velocity", "N s/m^2", "12 N s/m^2")
STIFFNESS = Dimension("a stiffness", "N/m", "20 kN/m")
TORSIONAL_STIFFNESS = Dimension("a torsional stiffness", "N m/rad", "12 N m/rad")
DAMPING = Dimension("a damping", "N s/m", "5 N s/m")
TORSIONAL_DAMPING = Dimension("a torsional damping", "N m s/rad", "0.1 N m s/rad")
RATIO = Dimension("a ratio", "", "0.02")
PRESSURE = Dimension("a pressure", "Pa", "60 bar")
WEAR = Dimension("a wear coefficient", "m^2/N", "1e-6 mm^3/(N m)")
FORCE_PER_LENGTH = Dimension("a force per length", "N/m", "100 N/m")
SENSED = (
    LENGTH, SPEED, ACCELERATION, ANGLE, ANGULAR_SPEED, FORCE, TORQUE,
    Dimension("an angular acceleration", "rad/s^2", "5 rad/s^2"), Dimension("a strain", "1", "0.001"),
    Dimension("a stress", "Pa", "100 MPa"),
)  # fmt: skip
"""Quantities that sensors measure."""

_COMMON = (
    "m", "mm", "cm", "um", "kg", "g", "kg m^2", "kg mm^2", "m^2", "mm^2", "m^4", "mm^4", "Pa", "bar", "MPa", "GPa",
    "kg/m^3", "m/s^2", "m/s", "s", "ms", "Hz", "kHz", "rad", "deg", "rad/s", "rpm", "N", "kN", "N m", "N/m", "kN/m",
    "N s/m", "N s/m^2", "N m/rad", "N m s/rad", "%",
)  # fmt: skip
"""Units that messages propose."""
_UNITS = {  # powers of ten, m, kg, s and rad
    "m": (0, 1, 0, 0, 0), "g": (-3, 0, 1, 0, 0), "s": (0, 0, 0, 1, 0), "rad": (0, 0, 0, 0, 1), "N": (0, 1, 1, -2, 0),
    "Pa": (0, -1, 1, -2, 0), "bar": (5, -1, 1, -2, 0), "J": (0, 2, 1, -2, 0), "W": (0, 2, 1, -3, 0),
    "Hz": (0, 0, 0, -1, 0), "deg": (0, 0, 0, 0, 1), "rpm": (0, 0, 0, -1, 1), "%": (-2, 0, 0, 0, 0), "1": (0,) * 5,
}  # fmt: skip
_PREFIXES = {"": 0, "n": -9, "u": -6, "m": -3, "c": -2, "k": 3, "M": 6, "G": 9}
_TERM = re.compile(rf"([{''.join(_PREFIXES)}](?![%1])|)({'|'.join(_UNITS)})(?:\^([1-9]))?")


def to_si(value: object, dimension: Dimension) -> float:
    """A number (taken as SI) or a string with a unit, as a finite float in the SI unit of `dimension`.

    Raises Fault: not a number, not finite, too large or small to be computed with, unknown unit, wrong dimension.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise Fault(f"{dimension.name} is required", _how_to_write(dimension))
    if isinstance(value, str):
        match = NUMBER_WITH_UNIT.match(value) if len(value) <= _LONGEST else None
        if match is None:
            raise Fault(f"not a number with a unit; {dimension.name} is required", _how_to_write(dimension))
        if math.isinf(float(match[1])):
            raise Fault("not a finite number", _how_to_write(dimension))
        number = scaled(float(match[1]), match[2], dimension)
    else:
        number = _as_float(value)
    if not math.isfinite(number):
        raise Fault("not a finite number", _how_to_write(dimension))
    if number and not 1 / LARGEST <= abs(number) <= LARGEST:
        reason = f"outside {1 / LARGEST:g} to {LARGEST:g}: products of such numbers exceed double precision"
        raise Fault(reason, _how_to_write(dimension))
    return number


def plain_number(text: str) -> float | None:
    """Finite number in a text without a unit; None for any other text."""
    number = float(text) if re.fullmatch(NUMBER, text.strip()) else math.inf
    return number if math.isfinite(number) else None


def _as_float(number: float) -> float:
    try:
        return float(number)
    except OverflowError:  # an integer beyond them
        return math.inf


def scaled(number: float, unit: str, dimension: Dimension) -> float:
    """Convert `number` in `unit` to SI; divides by a reciprocal factor, so that 137 mm is exactly 0.137 m."""
    factor = unit_factor(unit, dimension)
    inverse = round(1 / factor) if factor else 0
    return number / inverse if factor < 1 and math.isclose(inverse * factor, 1, rel_tol=1e-15) else number * factor


@cache
def unit_factor(unit: str, dimension: Dimension) -> float:
    """Factor from `unit` to the SI unit of `dimension`. Raises Fault: unknown unit, wrong dimension."""
    if not unit and dimension.unit:
        raise Fault(f"no unit; {dimension.name} is required", _how_to_write(dimension))
    factor, powers = _read(unit or "1")
    if powers is None:
        return _factor_by_pint(unit, dimension)
    if powers != _read(dimension.unit or "1")[1]:
        raise _wrong_dimension(unit, dimension)
    return factor


@cache
def _read(unit: str) -> tuple[float, list[int] | None]:
    """Factor to SI and powers of m, kg, s and rad of a unit like "kN m/rad"; None for powers if pint is needed."""
    factor, powers = 1.0, [0] * 5
    for place, part in enumerate(unit.split("/")):
        terms = part.split(" ")
        matches = [match for term in terms if (match := _TERM.fullmatch(term))]
        if len(matches) < len(terms) or (place and len(terms) > 1):  # pint reads "N/m s" as "N s/m"
            return factor, None
        for prefix, name, power in (match.groups() for match in matches):
            n = (-1 if place else 1) * int(power or 1)
            factor *= {"deg": math.pi / 180, "rpm": math.pi / 30}.get(name, 1.0) ** n
            ten, *rest = _UNITS[name]
            powers = [old + n * new for old, new in zip(powers, (ten + _PREFIXES[prefix], *rest), strict=True)]
    return factor * float(f"1e{powers[0]}"), powers[1:]


def _factor_by_pint(unit: str, dimension: Dimension) -> float:
    """Factor from `unit` to `dimension` by pint. Root units are compared, not dimensions: pint's radian has none, and
    1 Hz would silently become 1 rad/s."""
    from pint.errors import PintError

    registry = _registry()
    try:
        _check_unit_text(unit)
        factor, root = registry.get_root_units(registry.parse_units(unit))
    except (PintError, TokenError, AssertionError, AttributeError, SyntaxError, TypeError, ValueError):
        alike = _spelled_otherwise(unit, dimension)
        if alike is None:
            from kaneflex.support.mistakes import unit_advice

            raise Fault(f"unknown unit {unit!r}", unit_advice(unit, _COMMON)) from None
        if alike[0] in "mM" and unit[0] != alike[0]:  # milli or mega
            raise Fault(f"unknown unit {unit!r}", f"Write {alike!r}: capitals count") from None
        return unit_factor(alike, dimension)
    si_factor, si_root = registry.get_root_units(registry.parse_units(dimension.unit))
    if root != si_root:
        raise _wrong_dimension(unit, dimension)
    return float(factor / si_factor)


def _check_unit_text(unit: str) -> None:
    """Raise ValueError unless a unit is a product of powers of names: pint would work out "m**9**9**9" or "m/0"."""
    numbers = [(match["power"], match["digits"]) for match in _UNIT_NUMBER.finditer(unit)]
    powers = unit.replace("**", "^").count("^")
    wrong = any(len(digits) > 3 or (power is None and digits != "1") for power, digits in numbers)
    open_power = powers != sum(power is not None for power, _ in numbers) or _POWER_OF_POWER.search(unit)
    if not _UNIT_TEXT.match(unit) or wrong or open_power:
        raise ValueError(unit)


@cache
def _registry():
    from pint import UnitRegistry

    return UnitRegistry()


def _spelled_otherwise(unit: str, dimension: Dimension) -> str | None:
    """Common unit of `dimension` that differs from `unit` in capitals only, like rpm from RPM."""
    folded = unit.casefold()
    alike = [name for name in _COMMON if name.casefold() == folded and name != unit]
    return next((name for name in alike if _read(name)[1] == _read(dimension.unit or "1")[1]), None)


def _wrong_dimension(unit: str, dimension: Dimension) -> Fault:
    alike = _spelled_otherwise(unit, dimension)
    cure = _how_to_write(dimension) if alike is None else f"Write {alike!r}: capitals count"
    return Fault(f"{unit!r} is not a unit of {dimension.name.split(' ', 1)[1]}", cure)


def _how_to_write(dimension: Dimension) -> str:
    if not dimension.unit:
        return f"Write a number like {dimension.example}"
    return f"Write {dimension.name} like '{dimension.example}', or a plain number in {dimension.unit}"
