"""Loads as they act over what is shown, with the gas pressure of tables (paper Figs. 5, 6), and over speeds; energy."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.plots.style import Panel, legend_beside, new_figure, readable
from kaneflex.plots.view import View, view
from kaneflex.response.motion import Motion
from kaneflex.scene.parts import Load
from kaneflex.scene.tables import abscissae, evaluate_block, read_table
from kaneflex.support.errors import Fault
from kaneflex.support.units import PRESSURE

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_PRESSURE = "p_abs_bar"
"""Column of a load's CSV file that holds the absolute gas pressure [bar]."""
_BAR = 1e5  # Pa
_QUANTITY = {"N": "Force", "N m": "Torque", "N/m": "Force per length"}
_EVEN = 1e-9
"""Share of a speed within which it does not vary."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``loads``: sizes of all of them, where one varies; ``characteristics``: of those that follow a joint's speed."""
    loads = solution.model.scene.loads
    if all(load.kind == "value" for load in loads.values()):
        return {}
    shown = view(solution)
    sizes = {name: shown.motion.scalars[name] for name in loads}
    found = {"loads": _over_run(shown, sizes)}
    speeds = {name: seen for name in loads if (seen := _followed(shown, name)) is not None}
    return found | ({"characteristics": _over_speeds(shown, sizes, speeds)} if speeds else {})


def _over_run(shown: View, sizes: dict[str, np.ndarray]) -> Figure:
    loads = shown.solution.model.scene.loads
    pressures = [(name, p) for name, load in loads.items() if (p := _pressure(load, shown)) is not None]
    panels = [Panel("Absolute gas pressure", "pressure", "bar", pressures)] if pressures else []
    for unit in dict.fromkeys(load.si_unit for load in loads.values()):
        group = [(name, size) for name, size in sizes.items() if loads[name].si_unit == unit]
        towards = {_where(loads[name]) for name, _ in group}
        quantity = _QUANTITY[unit]
        title = f"{quantity} {towards.pop()}" if len(towards) == 1 else quantity
        panels.append(Panel(title, quantity.lower(), unit, group))
    heading = "Gas pressure and loads" if pressures else "Loads"
    return shown.page(panels, heading, 6.6, 2.3, partial(_mark_peak, shown))


def _over_speeds(shown: View, sizes: dict[str, np.ndarray], speeds: dict[str, tuple[str, np.ndarray]]) -> Figure:
    """Torque over speed: the characteristic of a motor or brake."""
    scene = shown.solution.model.scene
    figure = new_figure(6.6, 0.8 + 2.6 * len(speeds), f"Loads over speeds{shown.note}")
    places = figure.subplots(len(speeds), 1, squeeze=False)[:, 0]
    for axes, (name, (joint, speed)) in zip(places, speeds.items(), strict=True):
        load = scene.loads[name]
        factor, unit = readable("m/s", speed) if scene.joints[joint].kind == "prismatic" else (30.0 / np.pi, "rpm")
        quantity = _QUANTITY[load.si_unit].lower()
        panel = Panel(f"{name}: {quantity} {_where(load)}", quantity, load.si_unit, [(name, sizes[name])])
        size, _ = panel.plot(axes, factor * speed)
        axes.plot(factor * speed[0], size * sizes[name][0], "o", color="black", markersize=5, markerfacecolor="white")
        axes.set_xlabel(f"speed of {joint}, starting at the ring [{unit}]")
        axes.margins(x=0.02)
    return figure


def _followed(shown: View, name: str) -> tuple[str, np.ndarray] | None:
    """The joint on whose speed a load depends, and that speed [rad/s or m/s]; None where there is none that varies."""
    scene = shown.solution.model.scene
    law = scene.argument(name)
    if law is None or scene.is_spatial:
        return None
    for joint in scene.joints:
        if law.uses(f"{joint}_speed"):
            speed = _speed(shown.motion, joint)
            return (joint, speed) if np.ptp(speed) > _EVEN * abs(speed).max() else None
    return None


def _speed(motion: Motion, joint: str) -> np.ndarray:
    """Speed of a joint of a planar mechanism [rad/s], or along its guide [m/s], as laws know it."""
    of = mechanism_of(motion.model.scene).joints[joint]
    (base, one), (rider, other) = (motion.scalars.section_frame(side) for side in of.sides)
    if not of.slides:
        return rider.omega - base.omega
    return np.array(of.direction) @ base.apart(one.at, rider, other.at)[1]


def _where(load: Load) -> str:
    if load.force_on is not None:
        return f"on {load.force_on.body}"
    return f"at {load.torque_at}" if load.torque_at is not None else f"along {load.spread_on}"


def _pressure(load: Load, shown: View) -> np.ndarray | None:
    """The pressure [bar] that a load's table has beside the force, between its rows as that; else None."""
    if load.table is None or load.against not in ("t", *shown.solution.model.scene.drives):
        return None
    try:
        table = read_table(load.table, _PRESSURE, "bar", abscissae(load.against), (PRESSURE,))
        table = table if load.period is None else table.over_period(load.period, load.closing)
    except Fault:
        return None  # the file has no such column
    curve = replace(table, y=table.y / _BAR).coefficients(load.period, load.interpolation)
    at = shown.times if load.against == "t" else shown.rigid[f"{load.against}.angle"]
    return evaluate_block(curve, at - load.offset)


def _mark_peak(shown: View, axes: Axes, panel: Panel) -> None:
    """Write the largest size of the first curve beside it, where it varies."""
    factor, name = readable(panel.unit, *(values for _, values in panel.curves))
    first = panel.curves[0][1]
    if np.ptp(first) == 0.0:
        return
    peak = int(np.argmax(abs(first)))
    x, value = shown.x[peak], factor * first[peak]
    x_unit = shown.x_label[shown.x_label.index("[") + 1 : -1]
    late = x > np.quantile(shown.x, 0.75)  # at the right edge, the text would be cut off
    axes.annotate(
        f"{value:.3g} {name} at {x:.4g} {x_unit}".replace("-", "\N{MINUS SIGN}"), (x, value),
        xytext=(-6 if late else 6, 4), ha="right" if late else "left", textcoords="offset points", fontsize=8,
    )  # fmt: skip
    axes.margins(y=0.1)
    axes.plot(x, value, "o", color="black", markersize=3)


def energy(solution: Solution) -> dict[str, Figure]:
    """``energy``: of runs whose energy was integrated with the motion, instant by instant: preset coupled."""
    found = solution.energy
    if found is None or len(found.kinetic) != len(solution.times) or not found.stored.any():
        return {}
    shown = view(solution)
    stored = {"kinetic": found.kinetic, "strain, springs": found.strain, "weight": found.weight}
    grown = found.stored - found.stored[0]
    balance = {"stored, increase": grown, "dissipated": found.dissipated, "supplied": found.supplied}
    titles = ("Stored energy", "Since the start: increase of the stored energy + dissipated = supplied energy")
    panels = [
        Panel(title, "energy", "J", [(name, each[shown.instants]) for name, each in curves.items() if each.any()])
        for title, curves in zip(titles, (stored, balance), strict=True)
    ]

    def mark(axes: Axes, panel: Panel) -> None:
        for line in axes.get_lines():
            if line.get_label() == "supplied":  # it lies on what is stored
                line.set_linestyle((0, (4, 5)))
        if panel.curves:
            legend_beside(axes)

    heading = f"Energy, drift {found.drift:.1e} of the energy that is exchanged"
    return {"energy": shown.page(panels, heading, 8.4, 1.9, mark)}
