"""Tables of a CSV file, units in its headings ("Speed (RPM)", "n / rpm"), and piecewise cubics for the kernels.

A table is passed to the kernels as one flat block of float64,

    [n, period, x_0 .. x_n, c0, c1, c2, c3 of interval 0, .. of interval n - 1]

with y = c0 + d (c1 + d (c2 + d c3)), d = x - x_i, and a period of 0 if the table does not repeat.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from kaneflex.support import units
from kaneflex.support.errors import Fault, counted, nearest, within
from kaneflex.support.files import read_text
from kaneflex.support.interpolation import Interpolation, cubics_through
from kaneflex.support.units import ANGLE, FORCE, LARGEST, TIME, Dimension, plain_number, scaled, unit_factor

_ASSUMED = {ANGLE: "deg", TIME: "s"}
"""Default units of abscissae without a unit in the heading."""
_OTHER_X = "Give the first column's quantity, like against = 'NAME_speed' for a joint's speed, or correct its heading"
_OTHER_Y = "Choose another column, give bore or area for a pressure, or correct the heading"
_FEWEST_ROWS = 2  # a line
_CLOSEST = 1e-12
"""Smallest distance of rows as a share of a table's span; below it slopes are rounding errors."""
_SPAN = 1e-6  # relative tolerance of the period that the table covers
_LEAST_GAP, _LARGEST_GAP = 0.5, 1.5
"""Range of the gap at a period's end, as shares of the shortest and the longest interval, taken as one missing row."""


@dataclass(frozen=True, eq=False)
class Table:
    """Ordinates y (SI) over increasing abscissae x (SI), both of shape (n + 1,), and their dimensions.

    ``closed``: the first row was added at the end, since the file does not repeat it.
    """

    x: np.ndarray
    y: np.ndarray
    x_dimension: Dimension = TIME
    dimension: Dimension = FORCE
    closed: bool = False

    def over_period(self, period: float, closing: float) -> Table:
        """Table over one `period`, with its first row repeated at the end.

        Raises Fault unless it covers the period, except for this row, and its ends agree to `closing` of max |y|.
        """
        span, rows = self.x[-1] - self.x[0], np.diff(self.x)
        if _LEAST_GAP * rows.min() < period - span < _LARGEST_GAP * rows.max():
            x, y = np.append(self.x, self.x[0] + period), np.append(self.y, self.y[0])
            return Table(x, y, self.x_dimension, self.dimension, closed=True)
        if abs(span - period) > _SPAN * period:
            reason = f"the table covers {span / period:.6g} of its period"
            raise Fault(reason, "Cover the period once, with or without its first row repeated at the end")
        largest = np.abs(self.y).max()
        gap = abs(self.y[-1] - self.y[0])
        if gap > closing * largest:
            reason = f"the table is not periodic: first and last value differ by {gap / largest:.2g} of the largest"
            raise Fault(reason, f"Correct the table, or raise closing from {closing:g}")
        return self

    def coefficients(self, period: float | None = None, interpolation: Interpolation = "spline") -> np.ndarray:
        """Block with a cubic for each interval between two rows; read only, computed once.

        With a period the curve closes smoothly through the mean of the first and the last ordinate. Without one an
        additional interval at each end keeps the end values outside.
        """
        if (period, interpolation) not in self._blocks:
            block = self._blocks[period, interpolation] = self._block(period, interpolation)
            block.flags.writeable = False
        return self._blocks[period, interpolation]

    @cached_property
    def _blocks(self) -> dict[tuple[float | None, Interpolation], np.ndarray]:
        """Blocks computed so far, since the points of a study read the same table."""
        return {}

    def _block(self, period: float | None, interpolation: Interpolation) -> np.ndarray:
        x, y = self.x, self.y.copy()
        if period:
            y[0] = y[-1] = (y[0] + y[-1]) / 2
            cubics = cubics_through(x, y, interpolation, periodic=True)
        else:
            inner = cubics_through(x, y, interpolation, periodic=False)
            cubics = np.vstack([[y[0], 0, 0, 0], inner, [y[-1], 0, 0, 0]])
            x = np.concatenate([[x[0] - 1], x, [x[-1] + 1]])
        return np.concatenate([[len(x) - 1, period or 0.0], x, cubics.ravel()])


def largest_of_block(block: np.ndarray) -> float:
    """Largest absolute value of a block: at a knot, or where the slope of a cubic vanishes."""
    return float(abs(_extremes(block.tobytes())[1]).max())


class Overshoot(NamedTuple):
    """Largest overshoot of a block: x, value, and the values of the two rows of its interval."""

    x: float
    value: float
    rows: tuple[float, float]

    @property
    def size(self) -> float:
        return max(self.value - max(self.rows), min(self.rows) - self.value, 0.0)


def overshoot_of_block(block: np.ndarray) -> Overshoot:
    """Find the largest overshoot of a block beyond the rows on either side."""
    places, values = _extremes(block.tobytes())
    rows = np.sort(values[:2], axis=0)
    beyond = np.maximum(values - rows[1], rows[0] - values)
    worst = np.unravel_index(beyond.argmax(), beyond.shape)
    first, last = values[:2, worst[1]]
    return Overshoot(float(places[worst]), float(values[worst]), (float(first), float(last)))


@lru_cache(maxsize=64)
def _extremes(block: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Candidates for extrema of each interval's cubic, and its values there, (4, n) each; from a block's bytes.

    The two ends, then the zeros of the slope c1 + 2 c2 d + 3 c3 d^2, or an end again without zeros.
    """
    numbers = np.frombuffer(block)
    n = int(numbers[0])
    knots, cubics = numbers[2 : n + 3], numbers[n + 3 :].reshape(n, 4)
    c0, c1, c2, c3 = cubics.T
    width = np.diff(knots)
    with np.errstate(all="ignore"):
        root = np.sqrt(c2 * c2 - 3.0 * c1 * c3)
        share = -(c2 + np.copysign(root, c2))  # avoids cancellation
        places = np.stack((np.zeros_like(width), width, share / (3.0 * c3), c1 / share))
    d = np.clip(np.nan_to_num(places, posinf=0.0, neginf=0.0), 0.0, width)
    return knots[:-1] + d, c0 + d * (c1 + d * (c2 + d * c3))


def evaluate_block(block: np.ndarray, x: np.ndarray | float) -> np.ndarray:
    """Values of a block at x (any shape), computed as in the generated modules."""
    from kaneflex.support.array_kernels import place_in_table

    d, c = place_in_table(np.asarray(x, dtype=float), block, 0)
    return block[c] + d * (block[c + 1] + d * (block[c + 2] + d * block[c + 3]))


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
    found, sure = _unit_in(heading)
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


def _unit_in(heading: str) -> tuple[str | None, bool]:
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


def read_table(
    path: str | Path, column: str | None, unit: str | None, x_dimensions: Sequence[Dimension],
    dimensions: Sequence[Dimension], assumed: str | None = None,
) -> Table:  # fmt: skip
    """Read the first column and `column` (default: the second) of a CSV file, in SI.

    Units come from the columns' headings, for `column` also from `unit`; the defaults are degrees, seconds and
    `assumed`. Their dimensions are one of `x_dimensions` and one of `dimensions`. The first line is a header; lines
    that start with # are skipped. Raises Fault, with `below` naming the scene's key: file missing or empty, no header,
    column missing or ambiguous, a heading with another unit, cells that are not finite numbers or without a column,
    abscissae that do not increase. A file is read again only if it has changed.
    """
    try:
        found = Path(path).stat()
        version = (found.st_mtime_ns, found.st_size)
    except (OSError, ValueError):
        version = None  # reading it gives the reason
    return _read(Path(path), version, column, unit, tuple(x_dimensions), tuple(dimensions), assumed)


@lru_cache(maxsize=64)
def _read(
    path: Path, version: tuple[int, int] | None, column: str | None, unit: str | None,
    x_dimensions: tuple[Dimension, ...], dimensions: tuple[Dimension, ...], assumed: str | None,
) -> Table:  # fmt: skip
    with within("table"):
        rows = _rows(path)
    header = [cell.strip() for cell in rows[0][1]]
    at = _place(path.name, header, column)
    for line, row in rows[1:]:
        if any(cell.strip() for cell in row[len(header) :]):
            reason = f"{path.name}, line {line}: {len(row)} cells under {len(header)} columns"
            raise Fault(reason, "Separate cells by commas, and write decimals with a point", below="table")
    if len(rows) - 1 < _FEWEST_ROWS:
        reason = f"{path.name} has {counted(len(rows) - 1, 'row')} of numbers"
        raise Fault(reason, f"Give at least {_FEWEST_ROWS}", below="table")
    x_assumed = next((_ASSUMED[each] for each in x_dimensions if each in _ASSUMED), None)
    with within("table"):
        x_unit, x_dimension = unit_of_column(path.name, header[0], x_dimensions, None, x_assumed, _OTHER_X)
    with within("unit"):
        unit, dimension = unit_of_column(path.name, header[at], dimensions, unit, assumed, _OTHER_Y)
    cells = [(line, _cell(path, line, row, 0), _cell(path, line, row, at)) for line, row in rows[1:]]
    span = cells[-1][1] - cells[0][1]
    if abs(span) < 1.0 / LARGEST:
        raise Fault(f"{path.name} spans {span:g} {x_unit} only", "Correct its first column", below="table")
    for (_, before, _), (line, x, _) in pairwise(cells):
        if x - before <= _CLOSEST * span:
            reason = f"{path.name}, line {line}: {x:g} is not above {before:g}"
            raise Fault(reason, "Sort the rows by their first column, each value once", below="table")
    table = Table(
        np.array([scaled(x, x_unit, x_dimension) for _, x, _ in cells]),
        np.array([scaled(y, unit, dimension) for _, _, y in cells]),
        x_dimension, dimension,
    )  # fmt: skip
    for values in (table.x, table.y):
        values.flags.writeable = False  # all readers of the file share one table
    return table


def _place(file: str, header: list[str], column: str | None) -> int:
    """Index of the column of ordinates, by default the second one."""
    if plain_number(header[0]) is not None:
        raise Fault(f"{file} has no header line", "Name the columns in its first line", below="table")
    if len(header) < 2:
        raise Fault(f"{file} has one column", "Give two columns separated by commas", below="table")
    if column is None:
        return 1
    if column not in header:
        raise Fault(f"{file} does not have this column", nearest(column, header), below="column")
    if header.count(column) > 1:
        reason = f"{file} has {header.count(column)} columns of that name"
        raise Fault(reason, "Name each column once", below="column")
    return header.index(column)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Non-empty rows with their line numbers; at least the header."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        # paths of a scene file are absolute by now; those of settings are not
        start = "the scene's file" if path.is_absolute() else "the current folder, as a setting's is"
        raise Fault("no such file", f"Give the path of a CSV file, relative to {start}") from None
    lines = [(line, row) for line, row in enumerate(text.split("\n"), 1) if row.strip() and row[0] != "#"]
    if not lines:
        raise Fault(f"{path.name} is empty", "Give a header line and rows of numbers")
    rows: list[tuple[int, list[str]]] = []
    reader = csv.reader([row for _, row in lines])
    try:
        for cells in reader:
            line = lines[len(rows)][0]
            if reader.line_num > len(rows) + 1:
                raise Fault(f"{path.name}, line {line}: a quoted cell is not closed", "Add the closing quote")
            rows.append((line, cells))
    except csv.Error as error:
        reason = f"{path.name}, line {lines[len(rows)][0]}: {error}"
        raise Fault(reason, "Correct or remove that line") from None
    return rows


def _cell(path: Path, line: int, row: list[str], column: int) -> float:
    text = row[column].strip() if column < len(row) else ""
    number = plain_number(text)
    if number is None:
        reason = f"{path.name}, line {line}: {text[:40]!r} is not a finite number"
        raise Fault(reason, "Correct or remove that line", below="table")
    if abs(number) > LARGEST:
        reason = f"{path.name}, line {line}: {number:g} is beyond {LARGEST:g}"
        raise Fault(reason, "Correct or remove that line", below="table")
    return number
