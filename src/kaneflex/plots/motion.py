"""Kinematics of guided and turning bodies of the rigid mechanism; laws and torques of the drives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import Panel, legend_above, new_figure
from kaneflex.plots.view import View, view

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_NOTHING = 1e-9
"""A mean below this share of the largest value is written as none."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``motion``: positions, velocities and accelerations, translation left and rotation right, drives below."""
    shown = view(solution)
    columns = [column for column in (_guided(shown), _turning(shown)) if any(panel.curves for panel in column)]
    drives = _drives(shown)
    rows = 3 * bool(columns)
    if not columns and not drives:
        return {}
    figure = new_figure(max(7.0, 4.9 * len(columns)), 0.7 + 1.9 * (rows + len(drives)), f"Rigid motion{shown.note}")
    grid = figure.add_gridspec(rows + len(drives), max(1, len(columns)))
    below = []
    for column, panels in enumerate(columns):
        first = None
        for row, panel in enumerate(panels):
            axes = figure.add_subplot(grid[row, column], sharex=first)
            panel.plot(axes, shown.x)
            axes.tick_params(labelbottom=row == len(panels) - 1)
            first = first or axes
        below.append(axes)
    for row, panel in enumerate(drives):
        axes = figure.add_subplot(grid[rows + row, :])
        factor, label = panel.plot(axes, shown.x)
        if panel.quantity in ("torque", "force"):
            _mark_means(axes, shown, panel.curves, factor, label)
        below.append(axes)
    for axes in below:
        shown.label_x(axes)
    return {"motion": figure}


def _guided(shown: View) -> list[Panel]:
    """Position along the guide from the guide's origin, velocity and acceleration, of bodies on fixed guides."""
    scene, rigid = shown.solution.model.scene, shown.rigid
    position, velocity, acceleration = [], [], []
    for joint in scene.joints.values():
        first, second = joint.addresses
        if joint.kind != "prismatic" or first.body != "ground":
            continue
        t_x, t_y = joint.direction
        name, origin = second.body, scene.point(first)
        x, v, a = (t_x * rigid[f"{name}.{key}x"] + t_y * rigid[f"{name}.{key}y"] for key in ("", "v_", "a_"))
        position.append((name, x - t_x * origin[0] - t_y * origin[1]))
        velocity.append((name, v))
        acceleration.append((name, a))
    whose = f" of {position[0][0]}" if len(position) == 1 else ""
    return [
        Panel(f"Position{whose} along its guide", "position", "m", position),
        Panel(f"Velocity{whose}", "velocity", "m/s", velocity),
        Panel(f"Acceleration{whose}", "acceleration", "m/s^2", acceleration),
    ]


def _turning(shown: View) -> list[Panel]:
    """Angle, angular velocity and acceleration of the bodies that turn without being driven."""
    scene, rigid = shown.solution.model.scene, shown.rigid
    driven = {side.body for name in {*scene.drives} - {*scene.free_joints} for side in scene.joints[name].addresses}
    names = [name for name in scene.bodies if name not in driven and np.ptp(rigid[f"{name}.s"]) > 1e-9]
    angles = [(name, shown.motion.turned(name)) for name in names]
    rates, accelerations = ([(name, rigid[f"{name}.{key}"]) for name in names] for key in ("omega", "epsilon"))
    whose = f" of {names[0]}" if len(names) == 1 else ""
    return [
        Panel(f"Angle{whose}", "angle", "rad", angles),
        Panel(f"Angular velocity{whose}", "ang. velocity", "rad/s", rates),
        Panel(f"Angular acceleration{whose}", "ang. acceleration", "rad/s^2", accelerations),
    ]


def _drives(shown: View) -> list[Panel]:
    """Coordinates of the drives that do not turn or slide evenly, by laws, tables or from rest; then their forces and
    torques, but where the rigid mechanism only follows the coupled run."""
    motion, scene, found = shown.motion, shown.solution.model.scene, []
    uneven = [name for name, drive in scene.drives.items() if drive.kind in ("law", "table") or drive.spin_up]
    kinds = [(uneven, shown.rigid, "angle", quantity) for quantity in (("angle", "rad"), ("position", "m"))]
    if motion.has_rigid_forces:
        forces, prescribed = motion.rigid_forces, [name for name, drive in scene.drives.items() if not drive.free]
        kinds += [(prescribed, forces, "drive", quantity) for quantity in (("torque", "N m"), ("force", "N"))]
    for names, values, key, (quantity, unit) in kinds:
        own = [name for name in names if scene.slides(name) == (quantity in ("position", "force"))]
        if own:
            whose = own[0] if key == "angle" and len(own) == 1 else "the drives"
            curves = [(name, values[f"{name}.{key}"]) for name in own]
            found.append(Panel(f"{quantity.capitalize()} of {whose}", quantity, unit, curves))
    return found


def _mark_means(axes: Axes, shown: View, curves: Sequence[tuple[str, np.ndarray]], factor: float, label: str) -> None:
    """The means of curves over what is shown, dashed, drawn in a unit that is ``factor`` of SI."""
    for (name, values), line in zip(curves, axes.get_lines(), strict=True):
        mean = factor * np.trapezoid(values, shown.times) / (np.ptp(shown.times) or 1.0)
        mean = 0.0 if abs(mean) < _NOTHING * factor * np.abs(values).max() else mean
        style = {"color": line.get_color(), "linestyle": "--", "linewidth": 1.0}
        axes.axhline(mean, label=f"{name}, mean {mean:.4g} {label}".replace("-", "\u2212"), **style)
    legend_above(axes)
