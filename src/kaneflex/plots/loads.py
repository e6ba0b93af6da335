"""Loads from tables: the force against the drive's angle, with the gas pressure it comes from; paper Figs. 5, 6."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import mark_angles, new_figure, plot_curves, readable
from kaneflex.plots.view import angle_name
from kaneflex.scene.parts import Load
from kaneflex.scene.tables import Table, evaluate_block

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_PRESSURE = "p_abs_bar"
"""Column of a load's CSV file that holds the absolute gas pressure [bar]."""
_POINTS = 1441


def figures(solution: Solution) -> dict[str, Figure]:
    """``loads``: what the tables of one unit against one drive, or against time, hold over their period."""
    tables = {name: load for name, load in solution.model.scene.loads.items() if load.table is not None}
    pictures = {}
    for against, unit in dict.fromkeys((load.against, load.si_unit) for load in tables.values()):
        group = {name: load for name, load in tables.items() if (load.against, load.si_unit) == (against, unit)}
        name = f"loads_{against}" if pictures else "loads"
        pictures[name if name not in pictures else f"{name}_{len(pictures) + 1}"] = _figure(solution, against, group)
    return pictures


def _figure(solution: Solution, against: str, loads: dict[str, Load]) -> Figure:
    x = _abscissa(solution, loads)
    factor, label = _axis(solution, against, x)
    pressures = {name: p for name, load in loads.items() if (p := _pressure(load, x)) is not None}
    rows = 1 + bool(pressures)
    figure = new_figure(6.6, 0.8 + 2.3 * rows, "Gas pressure and force" if pressures else "Loads")
    panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    if pressures:
        plot_curves(panels[0], factor * x, pressures.items(), "bar", "Absolute gas pressure", "pressure")
        _mark_peak(panels[0], factor * x, next(iter(pressures.values())), "bar", label)
        panels[0].set_ylim(bottom=0)
    forces = {name: _force(load, x) for name, load in loads.items()}
    unit = next(iter(loads.values())).si_unit
    quantity = {"N": "Force", "N m": "Torque", "N/m": "Force per length"}[unit]
    towards = {_where(load) for load in loads.values()}
    title = f"{quantity} {towards.pop()}" if len(towards) == 1 else quantity
    plot_curves(panels[-1], factor * x, forces.items(), unit, title, quantity.lower())
    _mark_peak(panels[-1], factor * x, next(iter(forces.values())), unit, label)
    panels[-1].set_xlabel(label)
    if against != "t":
        mark_angles(panels[-1], factor * float(np.ptp(x)))
    return figure


def _where(load: Load) -> str:
    if load.force_on is not None:
        return f"on {load.force_on.body}"
    return f"at {load.torque_at}" if load.torque_at is not None else f"along {load.spread_on}"


def _abscissa(solution: Solution, loads: dict[str, Load]) -> np.ndarray:
    """One period, or what the tables span where they do not repeat [rad or s]."""
    period = max((load.period or 0.0 for load in loads.values()), default=0.0)
    if period:
        return np.linspace(0.0, period, _POINTS)
    tables = [(load, load.read_table()) for load in loads.values()]
    first = min(table.x[0] + load.offset for load, table in tables)
    last = max(table.x[-1] + load.offset for load, table in tables)
    return np.linspace(first, last, _POINTS)


def _axis(solution: Solution, against: str, x: np.ndarray) -> tuple[float, str]:
    if against == "t":
        factor, unit = readable("s", x)
        return factor, f"time [{unit}]"
    return 180 / np.pi, f"{angle_name(solution, against)} [deg]"


def _force(load: Load, x: np.ndarray) -> np.ndarray:
    """Magnitude of the load in its SI unit, by the arithmetic of the kernels."""
    return evaluate_block(load.curve(), x - load.offset)


def _pressure(load: Load, x: np.ndarray) -> np.ndarray | None:
    """The file's pressure [bar] at x, where the file has it; between its rows as the force."""
    with open(load.table, encoding="utf-8-sig", newline="") as file:
        header, *rows = csv.reader(line for line in file if line.strip() and line[0] != "#")
    if _PRESSURE not in header:
        return None
    column = header.index(_PRESSURE)
    bar = np.array([float(row[column]) for row in rows])
    curve = Table(load.read_table().x, bar).coefficients(load.period, load.interpolation)
    return evaluate_block(curve, x - load.offset)


def _mark_peak(axes: Axes, x: np.ndarray, values: np.ndarray, unit: str, label: str) -> None:
    """Write the largest value of a curve beside it."""
    factor, name = readable(unit, values)
    peak = int(np.argmax(values))
    x_unit = label[label.index("[") + 1 : -1]
    axes.annotate(
        f"{factor * values[peak]:.3g} {name} at {x[peak]:.4g} {x_unit}",
        (x[peak], factor * values[peak]), xytext=(8, -3), textcoords="offset points", fontsize=8,
    )  # fmt: skip
    axes.margins(y=0.1)
    axes.plot(x[peak], factor * values[peak], "o", color="black", markersize=3)
