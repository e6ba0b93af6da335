"""Tables of a CSV file, and the piecewise cubic that the kernels read them as.

A table travels to the kernels as one flat block of float64,

    [n, period, x_0 .. x_n, c0, c1, c2, c3 of interval 0, .. of interval n - 1]

with y = c0 + d (c1 + d (c2 + d c3)), d = x - x_i, and a period of 0 where the table does not repeat.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kaneflex.errors import Fault, nearest
from kaneflex.scene.units import ANGLE, FORCE, TIME, scaled

_FEWEST_ROWS = 4  # below, a not-a-knot cubic is not defined
_SPAN = 1e-6  # relative; the table covers its period this exactly


@dataclass(frozen=True, eq=False)
class Table:
    """Ordinates y (SI) over rising abscissae x (rad or s), both of shape (n + 1,)."""

    x: np.ndarray
    y: np.ndarray

    def check_period(self, period: float, closing: float) -> None:
        """Raise Fault unless the table covers `period` once and its ends agree within `closing` of its largest |y|."""
        span = self.x[-1] - self.x[0]
        if abs(span - period) > _SPAN * period:
            reason = f"the table covers {span / period:.6g} of its period"
            raise Fault(reason, "Cover the period once, its first and last row both included")
        largest = np.abs(self.y).max()
        gap = abs(self.y[-1] - self.y[0])
        if gap > closing * largest:
            reason = f"the table does not close: first and last value differ by {gap / largest:.2g} of the largest"
            raise Fault(reason, f"Correct the table, or raise closing from {closing:g}")

    def coefficients(self, period: float | None = None) -> np.ndarray:
        """The block of this table's interpolating cubic spline, twice continuously differentiable.

        With a period it closes smoothly through the mean of the first and the last ordinate. Without one it is
        not-a-knot, and keeps its end values outside: one interval more at each end says so.
        """
        from scipy.interpolate import CubicSpline

        x, y = self.x, self.y.copy()
        if period:
            y[0] = y[-1] = (y[0] + y[-1]) / 2
            cubics = CubicSpline(x, y, bc_type="periodic").c[::-1].T
        else:
            inner = CubicSpline(x, y, bc_type="not-a-knot").c[::-1].T
            cubics = np.vstack([[y[0], 0, 0, 0], inner, [y[-1], 0, 0, 0]])
            x = np.concatenate([[x[0] - 1], x, [x[-1] + 1]])
        return np.concatenate([[len(x) - 1, period or 0.0], x, cubics.ravel()])


def evaluate_block(block: np.ndarray, x: np.ndarray | float) -> np.ndarray:
    """Values of a block at x (any shape), by the arithmetic of the generated modules."""
    n, period = int(block[0]), block[1]
    knots = block[2 : n + 3]
    cubics = block[n + 3 :].reshape(n, 4)
    x = np.asarray(x, dtype=float)
    if period > 0:
        x = knots[0] + (x - knots[0]) % period
    interval = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, n - 1)
    d = x - knots[interval]
    c = np.moveaxis(cubics[interval], -1, 0)
    return c[0] + d * (c[1] + d * (c[2] + d * c[3]))


def read_table(path: str | Path, column: str | None, unit: str, x_unit: str) -> Table:
    """The first column (in `x_unit`, deg or s) and `column` (in `unit`, a force; default: the second) of a CSV file.

    The first line is a header; lines that start with # are skipped. Raises Fault, with `below` naming the scene's key:
    file missing or empty, no header, no such column, cells that are no finite numbers, abscissae that do not rise.
    """
    rows = _rows(Path(path))
    header = [cell.strip() for cell in rows[0][1]]
    if _number(header[0]) is not None:
        raise Fault(f"{Path(path).name} has no header line", "Name the columns in its first line", below="table")
    if len(header) < 2:
        raise Fault(f"{Path(path).name} has one column", "Give two columns separated by commas", below="table")
    if column is not None and column not in header:
        raise Fault(f"{Path(path).name} has no such column", nearest(column, header), below="column")
    at = 1 if column is None else header.index(column)
    if len(rows) - 1 < _FEWEST_ROWS:
        reason = f"{Path(path).name} has {len(rows) - 1} rows of numbers"
        raise Fault(reason, f"Give at least {_FEWEST_ROWS}", below="table")
    x_dimension = TIME if x_unit == "s" else ANGLE
    try:
        scaled(1.0, unit, FORCE)
    except Fault as fault:
        raise Fault(fault.reason, fault.cure, below="unit") from None
    cells = [(line, _cell(path, line, row, 0), _cell(path, line, row, at)) for line, row in rows[1:]]
    for (_, before, _), (line, x, _) in zip(cells, cells[1:], strict=False):
        if x <= before:
            reason = f"{Path(path).name}, line {line}: {x:g} does not rise above {before:g}"
            raise Fault(reason, "Sort the rows by their first column, each value once", below="table")
    x = np.array([scaled(x, x_unit, x_dimension) for _, x, _ in cells])
    return Table(x, np.array([scaled(y, unit, FORCE) for _, _, y in cells]))


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Every row that holds something, with its line number; at least the header."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [(line, text) for line, text in enumerate(file, 1) if text.strip() and text[0] != "#"]
    except FileNotFoundError:
        raise Fault("no such file", "Give the path of a CSV file, relative to the scene", below="table") from None
    except (OSError, UnicodeDecodeError) as error:
        raise Fault(f"cannot be read: {error}", "Give a readable UTF-8 file", below="table") from None
    if not lines:
        raise Fault(f"{path.name} is empty", "Give a header line and rows of numbers", below="table")
    cells = csv.reader([text for _, text in lines])
    return [(line, row) for (line, _), row in zip(lines, cells, strict=True)]


def _cell(path: str | Path, line: int, row: list[str], column: int) -> float:
    text = row[column].strip() if column < len(row) else ""
    number = _number(text)
    if number is None or not math.isfinite(number):
        reason = f"{Path(path).name}, line {line}: {text!r} is not a finite number"
        raise Fault(reason, "Correct or remove that line", below="table")
    return number


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
