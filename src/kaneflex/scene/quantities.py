"""Field types of a scene file as pydantic annotations: quantities, vectors, names and addresses.

Every validator raises `kaneflex.support.errors.Fault`; `scene/read.py` adds the key and the user's value.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, NamedTuple, TypeAlias

from pydantic import AfterValidator, BeforeValidator, WithJsonSchema

from kaneflex.scene.laws import FUNCTIONS
from kaneflex.support import units
from kaneflex.support.errors import Fault
from kaneflex.support.units import Dimension, to_si

RESULT_NAMES = {"time": "it names the time axis of the results"}
"""Reserved names of sensors with the reason: a sensor's name is that of a variable of the results."""
RESERVED_NAMES = RESULT_NAMES | {
    **dict.fromkeys(("t", "pi", "e", *FUNCTIONS), "laws use it"),
    **dict.fromkeys(("ground", "origin", "start", "end", "mid", "chord", "frame"), "addresses use it"),
    **dict.fromkeys(("global", "body", "x", "y", "angle", "all", "none", "true", "false"), "the scene file uses it"),
}
"""Reserved names of bodies, joints, drives, masses, loads and fixed points, with the reason."""

_SQUARE = 1e-6
"""Largest cosine between two axes at right angles."""
_ROUNDING = 1e-9
"""Relative tolerance for numbers rounded by the user."""
MOST = 1_000_000_000
"""Largest count; more would exceed most memories."""


Vector: TypeAlias = Any
"""Vector of two numbers in the plane, three in space; the scene decides which."""


def _encodable(text: str) -> str:
    """Raise Fault for a lone surrogate, which comes from a command line that is not UTF-8."""
    if any("\ud800" <= letter <= "\udfff" for letter in text):
        raise Fault("not valid text", "Write it in UTF-8")
    return text


Words = Annotated[str, AfterValidator(_encodable)]
"""Free text that can be encoded as UTF-8."""


def _in_text(value: object) -> object:
    """A law that is a single number, as text."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


LawText = Annotated[str, BeforeValidator(_in_text), WithJsonSchema({"type": ["string", "number"]})]
"""Law, or the number that it is."""


class Address(NamedTuple):
    """Point of a body ("rod.mid"); `body` is "ground" for fixed points."""

    body: str
    point: str

    def __str__(self) -> str:
        return f"{self.body}.{self.point}"


_WRITTEN = ["number", "string"]


def written(description: str, *more: str) -> WithJsonSchema:
    """Schema of a number, or a text with a unit; ``more`` are further types."""
    return WithJsonSchema({"type": [*_WRITTEN, *more], "description": description})


def not_negative(value: object, dimension: Dimension, lowest: float = 0.0, zero: bool = True) -> float:
    """Quantity in SI. Raises Fault below the lowest, and for zero unless that is allowed."""
    number = to_si(value, dimension)
    if number < lowest or (number == 0 and not zero):
        must = "must not be negative" if zero else "must be above zero"
        raise Fault(f"{dimension.name} {must}", f"Write one like '{dimension.example}'")
    return number


def _quantity(dimension: Dimension, lowest: float = -math.inf, zero: bool = True) -> Any:
    convert = partial(not_negative, dimension=dimension, lowest=lowest, zero=zero)
    about = f"{dimension.name}, {dimension.unit or 'a plain number'}; or a string with a unit"
    return Annotated[float, BeforeValidator(convert), written(about), dimension]


def _positive(dimension: Dimension) -> Any:
    return _quantity(dimension, lowest=0.0, zero=False)


def either(value: object, *dimensions: Dimension) -> float:
    """Quantity of one of some dimensions in SI. Raises Fault as the first of them does."""
    faults = []
    for dimension in dimensions:
        try:
            return to_si(value, dimension)
        except Fault as fault:
            faults.append(fault)
    raise faults[0]


def _turning_or_sliding(turning: Dimension, sliding: Dimension) -> Any:
    """Quantity of a rotating or sliding joint; the scene's check decides which."""

    def convert(value: object) -> float:
        return either(value, turning, sliding)

    about = f"{turning.name}, {turning.unit}; for a guide {sliding.name}, {sliding.unit}; or a string with a unit"
    return Annotated[float, BeforeValidator(convert), written(about), turning, sliding]


def components(
    value: object, dimension: Dimension, reason: str, cure: str, counts: tuple[int, ...] = (2, 3)
) -> tuple[float, ...]:
    """List of as many quantities in SI. Raises Fault for anything else."""
    if not isinstance(value, (list, tuple)) or len(value) not in counts:
        raise Fault(reason, cure)
    return tuple(to_si(component, dimension) for component in value)


def list_of(items: object, least: int, most: int, **more: str) -> dict[str, object]:
    """Schema of a list with so many items."""
    return {"type": "array", "items": items, "minItems": least, "maxItems": most, **more}


def _vector(dimension: Dimension) -> Any:
    cure = "Write two components, [x, y], or three in space"
    convert = partial(components, dimension=dimension, reason="not a vector", cure=cure)
    schema = list_of({"type": _WRITTEN}, 2, 3, description=f"in {dimension.unit}; three components in space")
    return Annotated[Vector, BeforeValidator(convert), WithJsonSchema(schema)]


def _unit_vector(value: object) -> tuple[float, ...]:
    cure = "Write two components, like [1, 0], or three in space"
    given = components(value, units.RATIO, "not a direction", cure)
    length = math.hypot(*given)
    if length == 0:
        raise Fault("a direction must not be zero", cure)
    return tuple(component / length for component in given)


def _two_axes(value: object) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise Fault("a universal joint has two axes", "Write like [[0, 1, 0], [0, 0, 1]]")
    first, second = (_unit_vector(axis) for axis in value)
    along = sum(a * b for a, b in zip(first, second, strict=False))
    if abs(along) > _SQUARE:
        raise Fault("the two axes are not at right angles", "Write like [[0, 1, 0], [0, 0, 1]]")
    return first, _unit_vector([b - along * a for a, b in zip(first, second, strict=False)])


def _inertia(value: object) -> float | tuple[float, ...]:
    """Moment of inertia about the plane's axis; in space those about x, y, z, optionally with J_xy, J_yz, J_zx."""
    if not isinstance(value, (list, tuple)):
        return not_negative(value, units.INERTIA)
    reason, cure = "not the inertia of a body in space", "Write [J_x, J_y, J_z], or these and J_xy, J_yz, J_zx"
    found = components(value, units.INERTIA, reason, cure, (3, 6))
    _check_inertia(found)
    return found


def _fibre(value: object) -> float | tuple[float, ...]:
    """Position of a fibre: height above the axis; in space y and z of the section."""
    if not isinstance(value, (list, tuple)):
        return to_si(value, units.LENGTH)
    return components(value, units.LENGTH, "not a position in a section", "Write y and z, like ['10 mm', 0]", (2,))


def _check_inertia(found: tuple[float, ...]) -> None:
    """Raise Fault for impossible principal moments: negative, or one above the sum of the two others."""
    import numpy as np

    (x, y, z), (xy, yz, zx) = found[:3], found[3:] or (0.0, 0.0, 0.0)
    least, middle, most = np.linalg.eigvalsh([[x, xy, zx], [xy, y, yz], [zx, yz, z]])
    if least < -_ROUNDING * abs(most) or most > (1.0 + _ROUNDING) * (least + middle):
        reason = f"no body has the principal moments {least:.6g}, {middle:.6g} and {most:.6g} kg m^2"
        raise Fault(reason, "Give moments that are not negative, none above the sum of the two others")


def _address(value: object) -> Address:
    if isinstance(value, tuple) and len(value) == 2:
        return Address(*value)
    parts = value.split(".") if isinstance(value, str) else []
    if len(parts) == 1 and parts[0]:
        return Address(parts[0], "origin" if parts[0] == "ground" else "start")
    if len(parts) == 2 and all(parts):
        return Address(*parts)
    raise Fault("not an address", "Write 'body', 'body.point' or 'ground'; define other points in the body's points")


def _whole_number(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise Fault("not a whole number", "Write a whole number of one or more")
    if value < 1:
        raise Fault("too few", "Write a whole number of one or more")
    if value > MOST:
        raise Fault(f"more than {MOST:,}", "Write a smaller number")
    return value


def _ratios(value: object) -> tuple[float, ...] | str:
    if value == "adams":
        return value
    values = value if isinstance(value, (list, tuple)) else [value]
    ratios = tuple(to_si(item, units.RATIO) for item in values)
    if not ratios or min(ratios) < 0:
        raise Fault("a damping ratio must not be negative", "Write one ratio like 0.02, or one for each mode")
    return ratios


def two(
    kind: type, read: Callable[[object], object], reason: str, cure: str,
    of: str, types: list[str] | str = "string", wrong: Callable[[Any, Any], str] = lambda first, second: "",
) -> Any:  # fmt: skip
    """List of two values of a kind, each read as ``types``; ``wrong`` describes the error of both together."""

    def convert(value: object) -> tuple[object, object]:
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise Fault(reason, cure)
        first, second = map(read, value)
        if found := wrong(first, second):
            raise Fault(found, cure)
        return first, second

    schema = list_of({"type": types}, 2, 2, description=of)
    return Annotated[tuple[kind, kind], BeforeValidator(convert), WithJsonSchema(schema)]


_DIRECTION_SCHEMA = list_of({"type": "number"}, 2, 3)

PositiveLength = _positive(units.LENGTH)
Length = _quantity(units.LENGTH)
NonNegativeLength = _quantity(units.LENGTH, lowest=0.0)
PositiveMass = _positive(units.MASS)
NonNegativeMass = _quantity(units.MASS, lowest=0.0)
PositiveArea = _positive(units.AREA)
PositiveSecondMoment = _positive(units.SECOND_MOMENT)
PositiveModulus = _positive(units.MODULUS)
PositiveDensity = _positive(units.DENSITY)
Angle = _quantity(units.ANGLE)
PositiveAngle = _positive(units.ANGLE)
AngularSpeed = _quantity(units.ANGULAR_SPEED)
AngularVelocity = _vector(units.ANGULAR_SPEED)
DriveCoordinate = _turning_or_sliding(units.ANGLE, units.LENGTH)
DriveSpeed = _turning_or_sliding(units.ANGULAR_SPEED, units.SPEED)
DriveSpeeds = two(
    float, lambda item: either(item, units.ANGULAR_SPEED, units.SPEED), "not two speeds",
    "Write them like ['0.1 m/s', '20 rad/s']", "two speeds, rotating or sliding", _WRITTEN,
)  # fmt: skip
JointForce = _turning_or_sliding(units.TORQUE, units.FORCE)
JointStiffness = _turning_or_sliding(units.TORSIONAL_STIFFNESS, units.STIFFNESS)
JointDamping = _turning_or_sliding(units.TORSIONAL_DAMPING, units.DAMPING)
PositiveForce = _positive(units.FORCE)
NonNegativeDamping = _quantity(units.DAMPING, lowest=0.0)
PositiveTime = _positive(units.TIME)
NonNegativeViscosity = _quantity(units.VISCOSITY, lowest=0.0)
NonNegativeRatio = _quantity(units.RATIO, lowest=0.0)
PositiveWear = _positive(units.WEAR)
PositiveRatio = _positive(units.RATIO)
Abscissa = Annotated[float, written("of the table's abscissa")]
Point = _vector(units.LENGTH)
Velocity = _vector(units.SPEED)
Acceleration = _vector(units.ACCELERATION)
ForceOrTorque = Annotated[float, written("a force, a torque, or a force per length")]
Direction = Annotated[
    Vector,
    BeforeValidator(_unit_vector),
    WithJsonSchema(_DIRECTION_SCHEMA | {"description": "a direction, any length; three components in space"}),
]
Axes = Annotated[tuple[Vector, Vector], BeforeValidator(_two_axes), WithJsonSchema(list_of(_DIRECTION_SCHEMA, 2, 2))]
BodyInertia = Annotated[
    Any,  # a number in the plane, in space a tuple
    BeforeValidator(_inertia),
    written("kg m^2; in space [J_x, J_y, J_z, J_xy, J_yz, J_zx]", "array"),
]
Fibre = Annotated[
    Any,  # a number in the plane, in space two
    BeforeValidator(_fibre),
    written("a length, m; in space [y, z]", "array"),
    units.LENGTH,
]
AddressField = Annotated[
    Address, BeforeValidator(_address),
    WithJsonSchema({"type": "string", "description": "'body', 'body.point' or 'ground'"}),
]  # fmt: skip
AddressPair = two(
    Address, _address, "a joint has two sides", "Write two addresses, like ['crank.end', 'rod.start']",
    "two addresses, 'body.point'",
)  # fmt: skip
WholeNumber = Annotated[int, BeforeValidator(_whole_number), WithJsonSchema({"type": "integer", "minimum": 1})]
CountOrAll = Annotated[
    int | str,
    BeforeValidator(lambda value: value if value == "all" else _whole_number(value)),
    WithJsonSchema({"anyOf": [{"type": "integer", "minimum": 1}, {"const": "all"}]}),
]
Ratios = Annotated[
    tuple[float, ...] | str,
    BeforeValidator(_ratios),
    WithJsonSchema({"anyOf": [{"type": ["number", "array"]}, {"const": "adams"}]}),
]
Radii = two(
    float, partial(to_si, dimension=units.LENGTH), "not two radii", "Write ['10 mm', '10.05 mm']", "two radii, m",
    _WRITTEN, lambda first, second: "a radius must not be negative" if min(first, second) < 0 else "",
)  # fmt: skip
NumberPair = two(
    float, partial(to_si, dimension=units.RATIO), "not two numbers", "Write them like [1, 0]", "two numbers", "number"
)
FrequencyPair = two(
    float, partial(to_si, dimension=units.FREQUENCY), "Rayleigh damping is fixed at two frequencies",
    "Write them like at = ['3039 Hz', '4549 Hz']", "two frequencies", _WRITTEN,
    lambda low, high: "" if 0 < low < high else "the frequencies must be positive and increasing",
)  # fmt: skip
