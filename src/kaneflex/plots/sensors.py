"""All sensors of a scene on one page, by kind; the rigid mechanism's values dashed beside the elastic ones.

Where accelerations are read over a horizon that is not one cycle, as on a test bench, reversals of axial and guide
forces are marked, and the zones shaded in which contacts knock. Curves of friction are wide where it sticks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import PALETTE, TOUCHED, legend_beside, pages, readable, shade
from kaneflex.plots.view import View, view
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import FRICTION_KINDS
from kaneflex.solve.touching import sticks

if TYPE_CHECKING:
    from kaneflex.scene import Scene
    from kaneflex.scene.parts import Joint
    from kaneflex.scene.sensors import Sensor
    from kaneflex.solve.solution import Solution

_ALIKE = 0.1
"""Share of a panel's largest span below which a curve gets another axis."""
_ROUNDING = 1e-6
"""Share of a sensor's largest value below which its span is rounding."""
_SEEN = 1e-2
"""Share of what a panel's curves span from which an error of them is wider than their line."""
_PAUSE = 0.1
"""Share of a turn, or of a run without turning drive, without an impact that ends a zone of them."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``sensors``: one panel for each kind, unit and direction."""
    shown, sensors = view(solution), solution.model.scene.sensors
    groups = grouped(solution.model.scene, sensors, {name: _reach(shown, name) for name in sensors})
    if not groups:
        return {}
    figure, panels = pages(len(groups), f"Sensors{shown.note}", 7.2, 1.7)
    for axes, (title, names) in zip(panels, groups.items(), strict=True):
        _panel(axes, shown, title, names)
    shown.finish(panels)
    return {"sensors": figure}


def grouped(scene: Scene, names: Iterable[str], reach: Mapping[str, float] | None = None) -> dict[str, list[str]]:
    """Title of each panel -> names of the sensors that it shows, at most as many as there are colours.

    ``reach``: span of each sensor's values; one of less than a tenth of its panel's largest gets another panel.
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        sensor = scene.sensors[name]
        title = _title(sensor)
        if isinstance(sensor.position, Address) and sensor.position.body in scene.loose:
            title = "Angle in a clearance" if sensor.component == "angle" else "Position in a clearance"
        groups.setdefault(title, []).append(name)
    most, panels = len(PALETTE), dict[str, list[str]]()
    for title, all_names in groups.items():
        parts = [part[first : first + most] for part in _alike(all_names, reach or {})
                 for first in range(0, len(part), most)]  # fmt: skip
        panels |= {f"{title} ({k})" if len(parts) > 1 else title: part for k, part in enumerate(parts, 1)}
    return panels


def _alike(names: list[str], reach: Mapping[str, float]) -> list[list[str]]:
    """Names whose curves are seen on one axis, the largest first; those that keep one value go with the largest."""
    largest: list[float] = []
    for span in sorted({reach.get(name, 0.0) for name in names} - {0.0}, reverse=True):
        if not largest or span < _ALIKE * largest[-1]:
            largest.append(span)
    found: list[list[str]] = [[] for _ in largest or [0.0]]
    for name in names:
        own = reach.get(name, 0.0)
        found[max((k for k, span in enumerate(largest) if 0.0 < own <= span), default=0)].append(name)
    return found


def _reach(shown: View, name: str) -> float:
    """Span of a sensor's values over what is shown; 0 where they keep one value but for rounding."""
    values = shown.solution.series[name].values[shown.instants]
    span = float(np.ptp(values)) if values.size and np.isfinite(values).all() else 0.0
    return span if span > _ROUNDING * float(abs(values).max(initial=0.0)) else 0.0


def quantity_of(sensor: Sensor) -> str:
    """Name of the quantity on a sensor's axis."""
    if sensor.kind == "displacement" and sensor.component.startswith("angle"):
        return "rotation"
    return "gap" if sensor.kind == "contact_angle" else sensor.quantity


def _title(sensor: Sensor) -> str:
    what = sensor.kind.replace("_", " ").capitalize()
    if sensor.component.startswith("angle"):
        return f"{what}, rotation"
    if sensor.kind not in ("displacement", "velocity", "acceleration"):
        return what + (", tension positive" if sensor.kind == "axial_force" else "")
    reads = sensor.kind == "acceleration" and sensor.reading == "accelerometer"
    reading = ", as an accelerometer reads" if reads else ""
    if sensor.axes == "global":
        return f"{what}, global axes{reading}"
    if sensor.kind == "acceleration":
        return f"{what}, body axes{reading}"
    return f"{what}, {'along' if sensor.component == 'x' else 'across'} the body"


def accelerations(solution: Solution) -> list[str]:
    """Sensors that read accelerations of points; none for a run of one cycle."""
    sensors = solution.model.scene.sensors.items() if not solution.model.options.cycles else ()
    return [name for name, each in sensors if each.kind == "acceleration" and not each.component.startswith("angle")]


def _is_axial(sensor: Sensor, joints: Mapping[str, Joint]) -> bool:
    """True for axial forces of links and forces on guides."""
    on_guide = sensor.joint_force is not None and joints[sensor.joint_force].kind == "prismatic"
    return sensor.unit == "N" and (sensor.kind == "axial_force" or on_guide)


def impact_zones(solution: Solution) -> list[tuple[float, float]]:
    """Begin and end [s] of every zone of impacts, from the first of them to where the last closes for good or opens.

    A pause of a tenth of a turn of the fastest drive, or of the run where none turns, parts two of them.
    """
    times, speeds = solution.times, [abs(drive.speed or 0.0) for drive in solution.model.scene.drives.values()]
    turn = 2 * math.pi / max(speeds) if any(speeds) else float(np.ptp(times))
    zones: list[tuple[float, float]] = []
    for impact in sorted(solution.impacts, key=lambda impact: impact.begin):
        short = impact.end - impact.begin < _PAUSE * turn
        end = impact.end if short else impact.begin
        if zones and impact.begin - zones[-1][1] < _PAUSE * turn:
            zones[-1] = zones[-1][0], max(end, zones[-1][1])
        else:
            zones.append((impact.begin, end))
    return zones


def reversals(times: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Times [s] at which a force changes its sign, linear between samples; a zero that is only touched is none.

    Parameters
    ----------
    times, force : ndarray (n,)

    Returns
    -------
    ndarray (n_reversals,)
    """
    signs = np.sign(force)
    known = np.flatnonzero(signs)
    before = known[:-1][signs[known[:-1]] != signs[known[1:]]]
    after = known[1:][signs[known[:-1]] != signs[known[1:]]]
    # From the last sample of one sign to the first of the other; zeros between them lie on the line.
    share = force[before] / (force[before] - force[after])
    return times[before] + share * (times[after] - times[before])


def _mark_zones(axes: Axes, shown: View) -> None:
    """Shade every zone of impacts and count them in the legend; none under permanent impacts."""
    zones = [zone for zone in impact_zones(shown.solution) if zone[1] >= shown.times[0] and zone[0] <= shown.times[-1]]
    if sum(end - begin for begin, end in zones) > 0.5 * np.ptp(shown.times):
        return
    for k, zone in enumerate(zones):
        first, last = np.interp(zone, shown.times, shown.x)
        label = f"impact zones ({len(zones)})" if k == 0 else None
        axes.axvspan(first, last, facecolor=TOUCHED, edgecolor=TOUCHED, linewidth=1.0, zorder=0, label=label)


def _panel(axes: Axes, shown: View, title: str, names: list[str]) -> None:
    series, scene, on_bench = shown.solution.series, shown.solution.model.scene, bool(accelerations(shown.solution))
    values = {name: series[name].values[shown.instants] for name in names}
    sensor = scene.sensors[names[0]]
    pushed = names if sensor.kind in ("contact_force", "contact_torque") else []
    peaks = {name: shown.peaks(str(scene.sensors[name].target)) for name in pushed}
    factor, label = readable(sensor.unit, *values.values(), *(force for _, force in peaks.values()))
    reach, errors = max(np.ptp(each) for each in values.values()), shown.solution.errors[0]
    for name, colour in zip(names, PALETTE, strict=False):
        axes.plot(shown.x, factor * values[name], color=colour, label=name)
        if name in errors and errors[name].total > _SEEN * reach:
            low, high = (factor * (values[name] + sign * errors[name].total) for sign in (-1, 1))
            axes.fill_between(shown.x, low, high, color=colour, alpha=0.25, linewidth=0)
        if name in peaks:
            at, force = peaks[name]
            axes.plot(at, factor * force, "v", color=colour, markersize=4, label=f"{name}: peaks of impacts")
        if sensor.kind in FRICTION_KINDS:
            stuck = sticks(shown.solution, str(scene.sensors[name].target))[shown.instants]
            if stuck.any():
                still = np.where(stuck, factor * values[name], np.nan)
                axes.plot(shown.x, still, color=colour, linewidth=3.5, alpha=0.4, label=f"{name}: sticks")
        if f"{name}_rigid" in series:
            rigid = factor * series[f"{name}_rigid"].values[shown.instants]
            axes.plot(shown.x, rigid, "--", color=shade(colour, -0.45), linewidth=0.9)
        if on_bench and _is_axial(scene.sensors[name], scene.joints):
            at = np.interp(reversals(shown.times, values[name]), shown.times, shown.x)
            axes.plot(
                at, np.zeros(len(at)), "v", color=colour, markersize=5, markerfacecolor="white",
                label=f"{name}: reversals ({len(at)})",
            )  # fmt: skip
    if axes.collections:
        axes.fill_between([], [], [], color="grey", alpha=0.25, linewidth=0, label="band: estimated error")
    if f"{names[0]}_rigid" in series:
        axes.plot([], [], "--", color="black", linewidth=0.9, label="dashed: rigid mechanism")
    if on_bench:
        _mark_zones(axes, shown)
    axes.set(title=title, ylabel=f"{quantity_of(sensor)} [{label}]", xmargin=0)
    legend_beside(axes)
