"""Nodal displacements of the joints, paper Figs. 18-22, and displacements of mid-link, Figs. 25, 26."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from kaneflex.plots.style import new_figure, plot_curves
from kaneflex.plots.view import View, view

if TYPE_CHECKING:
    from kaneflex.deformation import Deformation
    from kaneflex.solution import Solution

_STILL = 1e-3
"""Displacements below this share of the largest are not shown: of held points, of second order."""
Panel = tuple[str, str, str, list[tuple[str, np.ndarray]]]


def figures(solution: Solution) -> dict[str, Figure]:
    """``nodal_displacements`` of all joints of elastic links, and ``mid_LINK`` of each link."""
    if solution.model.frame is None:
        return {}
    shown = view(solution)
    pictures = {}
    panels = _nodal(shown)
    if panels:
        columns = 2 if len(panels) <= 6 else 3
        title = f"Elastic displacements of the joints, global axes{shown.note}"
        pictures["nodal_displacements"] = _figure(shown, panels, columns, title)
    for name, deformation in shown.links.items():
        title = f"Displacements at half the length of {name}{shown.note}"
        pictures[f"mid_{name}"] = _figure(shown, _middle(shown, name, deformation), 1, title)
    return pictures


def _figure(shown: View, panels: list[Panel], columns: int, title: str) -> Figure:
    rows = -(-len(panels) // columns)
    figure = new_figure(7.0 if columns == 1 else 4.4 * columns, 0.7 + 2.0 * rows, title)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
    for axes, (heading, quantity, unit, curves) in zip(grid, panels, strict=False):
        plot_curves(axes, shown.x, curves, unit, heading, quantity)
    for axes in grid[len(panels) :]:
        axes.remove()
    for axes in grid[max(0, len(panels) - columns) : len(panels)]:
        axes.tick_params(labelbottom=True)
        shown.label_x(axes)
    return figure


def _nodal(shown: View) -> list[Panel]:
    """q of each joint with an elastic link, numbered as in the paper: three a revolute joint, in the scene's order."""
    scene = shown.solution.model.scene
    found: list[tuple[str, str, list[tuple[str, np.ndarray]]]] = []
    pins = [name for name, joint in scene.joints.items() if joint.kind != "prismatic"]
    for number, name in enumerate(pins):
        sides = [side for side in scene.joints[name].addresses if side.body in shown.links]
        if not sides:
            continue
        q = {side.body: _global(shown, side.body, scene.point(side)[0]) for side in sides}
        shift = next(iter(q.values()))
        found += [(f"$q_{{{3 * number + k + 1}}}$: {name}, {'XY'[k]}", "m", [(name, shift[k])]) for k in (0, 1)]
        turns = [(body, series[2]) for body, series in q.items()]
        found.append((f"$q_{{{3 * number + 3}}}$: {name}, rotation", "rad", _distinct(turns)))
    largest = {
        unit: max(np.abs(values).max() for _, of, curves in found if of == unit for _, values in curves)
        for unit in {unit for _, unit, _ in found}
    }
    panels = []
    for title, unit, curves in found:
        moving = [(label, values) for label, values in curves if np.abs(values).max() > _STILL * largest[unit]]
        if moving:
            whose = f" of {moving[0][0]}" if unit == "rad" and len(moving) == 1 and len(curves) > 1 else ""
            panels.append((title + whose, "rotation" if unit == "rad" else "displacement", unit, moving))
    return panels


def _distinct(turns: list[tuple[str, np.ndarray]]) -> list[tuple[str, np.ndarray]]:
    """Rotations of the links at a joint; once where they share it."""
    gap = max(np.abs(values - turns[0][1]).max() for _, values in turns)
    return turns if gap > _STILL * np.abs(turns[0][1]).max() else turns[:1]


def _global(shown: View, link: str, x: float) -> np.ndarray:
    """Displacement X, Y in global axes and rotation of a point of a link, (3, n_times)."""
    u, v, theta = shown.links[link].at(x)[0]
    c, s = shown.rigid[f"{link}.c"], shown.rigid[f"{link}.s"]
    return np.array([c * u - s * v, s * u + c * v, theta])


def _middle(shown: View, name: str, deformation: Deformation) -> list[Panel]:
    """Along and across the link, in its axes and in global ones."""
    length = deformation.link.length
    start, middle, end = (deformation.at(share * length)[0] for share in (0.0, 0.5, 1.0))
    u, v = middle[0], middle[1]
    along = [("rigid frame", u)]
    if np.abs(start[0]).max() > _STILL * np.abs(u).max():
        along.append(("start of the link", u - start[0]))
    across = [("rigid frame", v), ("chord", v - 0.5 * (start[1] + end[1]))]
    glob = _global(shown, name, 0.5 * length)
    relative = " relative to the rigid frame" if len(along) == 1 else " relative to"
    return [
        (f"Longitudinal, link axes,{relative}", "displacement", "m", along),
        ("Transverse, link axes, relative to", "displacement", "m", across),
        ("Global axes, relative to the rigid frame", "displacement", "m", [("X", glob[0]), ("Y", glob[1])]),
    ]
