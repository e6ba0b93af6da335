"""Units in the headings of a CSV file's columns: "Speed (RPM)", "p [bar]", "n / rpm", "theta_deg"."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from kaneflex.support import units
from kaneflex.support.errors import Fault
from kaneflex.support.units import Dimension, unit_factor

_BRACKETED = re.compile(r".*[(\[]\s*([^()\[\]]+?)\s*[)\]]\s*\Z")
_LAST_WORDS = re.compile(r"(?:.*[\s_,])?(\S+)\Z"), re.compile(r".*/(\S+)\Z")
_SPELLED = {
    "Nm": "N m", "kNm": "kN m", "Nmm": "N mm", "°": "deg", "degree": "deg", "degrees": "deg", "°CA": "deg",
    "deg CA": "deg", "degCA": "deg", "CAD": "deg", "sec": "s", "RPM": "rpm", "U/min": "rpm", "1/min": "rpm",
    "min-1": "rpm", "min^-1": "rpm", "r/min": "rpm", "rev/min": "rpm",
}  # fmt: skip
"""Units spelled in headings -> in scenes. CA is the crank angle."""
_PLAIN_WORDS = {
    *_SPELLED, "deg", "rad", "rpm", "ms", "kN", "MN", "bar", "mbar", "Pa", "hPa", "kPa", "MPa", "mm", "cm", "mm/s",
    "m/s", "rad/s", "deg/s", "N/mm", "N/m",
}  # fmt: skip
"""Units that a heading may end with without brackets; s, m and N count only if they fit."""
COORDINATES, SPEEDS = (units.ANGLE, units.LENGTH), (units.ANGULAR_SPEED, units.SPEED)
"""Dimensions of a joint's coordinate: rotating, sliding."""
_HEADED = (*COORDINATES, *SPEEDS, units.TIME, units.FORCE, units.TORQUE, units.FORCE_PER_LENGTH, units.PRESSURE)
"""Dimensions of a table's columns."""


def abscissae(against: str | None) -> tuple[Dimension, ...]:
    """Dimensions of a load table's abscissa; for a joint the first if it rotates, the second if it slides."""
    if against == "t":
        return (units.TIME,)
    return SPEEDS if against is not None and against.endswith("_speed") else COORDINATES


def unit_of_column(
    file: str, heading: str, dimensions: Sequence[Dimension], given: str | None, assumed: str | None, cure: str
) -> tuple[str, Dimension]:
    """Unit of a column and its dimension, one of `dimensions`: by its heading, by `given`, else as `assumed`.

    `given` is the scene's entry `unit`; `cure` is the advice for a column of another dimension. Raises Fault for that,
    for a heading that contradicts the given unit, and without any unit.
    """
    found, sure = _said(heading)
    wanted = " or ".join(dimension.name for dimension in dimensions)
    own = None if given is None else _which(given, dimensions)
    fits = found is not None and any(_fits(found, dimension) for dimension in dimensions)
    if found is not None and fits:
        dimension = _which(found, dimensions)
        if given is None:
            return found, dimension
        factors = (unit_factor(unit, dimension) for unit in (found, given))
        if dimension is own and math.isclose(*factors, rel_tol=1e-9):
            return given, dimension
        reason = f"{file}: its column {heading!r} is in {found}"
        raise Fault(reason, f"Leave unit out, or correct the heading of {file}")
    if found is not None and sure and (given is None or any(_fits(found, dimension) for dimension in _HEADED)):
        reason = f"{file}: its column {heading!r} is in {found!r}, not a unit of {wanted}"
        raise Fault(reason, cure)
    if given is not None and own is not None:
        return given, own
    if assumed is None:
        reason = f"{file}: the heading {heading!r} has no unit of {wanted}"
        raise Fault(reason, f"Write it in the heading, like '{heading} ({dimensions[0].unit})'")
    return assumed, _which(assumed, dimensions)


def _said(heading: str) -> tuple[str | None, bool]:
    """Unit in a heading, if any, and whether it is unambiguous."""
    if bracketed := _BRACKETED.match(heading):
        return _SPELLED.get(bracketed[1], bracketed[1]), True
    words = [found[1] for pattern in _LAST_WORDS if (found := pattern.match(heading))]
    for word in words:
        if word in _PLAIN_WORDS:
            return _SPELLED.get(word, word), True
    single = (word for word in words if word in ("s", "m", "N") and word != heading)
    return next(single, None), False


def _fits(unit: str, dimension: Dimension) -> bool:
    try:
        unit_factor(unit, dimension)
    except Fault:
        return False
    return True


def _which(unit: str, dimensions: Sequence[Dimension]) -> Dimension:
    """First of some dimensions that a unit fits. Raises Fault for none, as the first one does."""
    for dimension in dimensions:
        if _fits(unit, dimension):
            return dimension
    unit_factor(unit, dimensions[0])
    raise AssertionError(unit)
