"""Displacements of joints and free ends, of mid-link and of links as surfaces; paper Figs. 18-26."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from kaneflex.plots.style import Panel, new_figure, readable
from kaneflex.plots.view import View, view
from kaneflex.response.time_statistics import envelope, thinned

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_STILL = 1e-3
"""Displacements below this share of the largest are not shown: of held points, of second order."""
Curves = list[tuple[str, np.ndarray]]


def figures(solution: Solution) -> dict[str, Figure]:
    """``nodal_displacements`` of all joints and free ends of elastic links, and ``mid_LINK`` of each."""
    if not solution.model.links:
        return {}
    shown = view(solution)
    pictures = {}
    panels = _nodal(shown)
    if panels:
        title = "Elastic displacements of the nodes at joints and ends, global axes"
        pictures["nodal_displacements"] = shown.page(panels, title, 7.0, 2.0)
    for name, length in shown.lengths.items():
        title = f"Displacements at half the length of {name}"
        pictures[f"mid_{name}"] = shown.page(_middle(shown, name, length), title, 7.0, 2.0)
    return pictures


def surfaces(solution: Solution) -> dict[str, Figure]:
    """``surfaces_LINK``: longitudinal, transverse, global X and Y displacement over the length of a link and time."""
    if not solution.model.links:
        return {}
    shown = view(solution)
    return {f"surfaces_{name}": _surfaces(shown, name, length) for name, length in shown.lengths.items()}


def _nodal(shown: View) -> list[Panel]:
    """Displacements and rotation of every joint and free end of elastic links, as far as it moves."""
    found = [*_nodes(shown)]
    largest = {"m": 0.0, "rad": 0.0}
    for _, unit, curves in found:
        largest[unit] = max(largest[unit], *(float(np.abs(values).max()) for _, values in curves))
    panels = []
    for title, unit, curves in found:
        moving = [(label, values) for label, values in curves if np.abs(values).max() > _STILL * largest[unit]]
        if moving:
            whose = f" of {moving[0][0]}" if len(moving) < len(curves) else ""
            panels.append(Panel(title + whose, "rotation" if unit == "rad" else "displacement", unit, moving))
    return panels


def _nodes(shown: View) -> Iterator[tuple[str, str, Curves]]:
    """Joints but guides with q numbered as in the paper, three for each in the scene's order; then free ends."""
    scene = shown.solution.model.scene
    points = {name: [(side.body, scene.point(side)[0]) for side in joint.addresses]
              for name, joint in scene.joints.items()}  # fmt: skip
    numbered = enumerate(name for name, joint in scene.joints.items() if joint.kind != "prismatic")
    nodes = [([f"$q_{{{3 * n + k}}}$: {name}" for k in (1, 2, 3)], name, points[name]) for n, name in numbered]
    ends = [(body, end, x) for body, length in shown.lengths.items() for end, x in (("start", 0.0), ("end", length))]
    jointed = {point for both in points.values() for point in both}
    nodes += [([f"{body}.{end}"] * 3, body, [(body, x)]) for body, end, x in ends if (body, x) not in jointed]
    for titles, label, both in nodes:
        q = [(body, _global(shown, body, x)) for body, x in both if body in shown.lengths]
        if q:
            for k, axis in enumerate("XY"):
                yield f"{titles[k]}, {axis}", "m", [(label, q[0][1][k])]
            yield f"{titles[2]}, rotation", "rad", _distinct([(body, d[2]) for body, d in q])


def _distinct(turns: Curves) -> Curves:
    """Rotations of the links at a joint; once where they share it."""
    gap = max(np.abs(values - turns[0][1]).max() for _, values in turns)
    return turns if gap > _STILL * np.abs(turns[0][1]).max() else turns[:1]


def _global(shown: View, link: str, x: float) -> np.ndarray:
    """Displacement X, Y in global axes and rotation of a point of a link, (3, n_times)."""
    d = shown.motion.displacement(link, (x, 0.0))[0]
    return np.vstack([shown.rigid.frame(link).to_global(d[:2]), d[2]])


def _middle(shown: View, name: str, length: float) -> list[Panel]:
    """Along and across the link, in its axes and in global ones."""
    start, middle, end = (shown.motion.displacement(name, (share * length, 0.0))[0] for share in (0.0, 0.5, 1.0))
    u, v = middle[0], middle[1]
    along = [("rigid frame", u)]
    if np.abs(start[0]).max() > _STILL * np.abs(u).max():
        along.append(("start of the link", u - start[0]))
    across = [("rigid frame", v), ("chord", v - 0.5 * (start[1] + end[1]))]
    glob = _global(shown, name, 0.5 * length)
    relative = " relative to the rigid frame" if len(along) == 1 else " relative to"
    return [
        Panel(f"Longitudinal, link axes,{relative}", "displacement", "m", along),
        Panel("Transverse, link axes, relative to", "displacement", "m", across),
        Panel("Global axes, relative to the rigid frame", "displacement", "m", [("X", glob[0]), ("Y", glob[1])]),
    ]


_ALONG, _INSTANTS = 33, 181
_PALE = 0.35
"""Opacity of an upper envelope."""


def _surfaces(shown: View, name: str, length: float) -> Figure:
    title = f"Elastic displacement of {name} relative to its rigid frame{shown.note}"
    figure = new_figure(9.6, 6.6, title, layout="none")  # the constrained one leaves axes in space a wide margin
    figure.subplots_adjust(left=0.0, right=0.95, bottom=0.05, top=0.92, wspace=0.08, hspace=0.16)
    x = np.linspace(0.0, length, _ALONG)
    local, frame = shown.displaced(name, x), shown.rigid.frame(name)
    titles = "Longitudinal, link axes", "Transverse, link axes", "X, global axes", "Y, global axes"
    fields = np.hstack([local, [frame.to_global(each) for each in local]]).swapaxes(0, 1)
    for k, (title, field) in enumerate(zip(titles, fields, strict=True)):
        axes = figure.add_subplot(2, 2, k + 1, projection="3d")
        note = _surface(axes, shown, x, field)
        axes.set_title(title + note, loc="center", y=0.97)
    return figure


def _surface(axes: Axes, shown: View, x: np.ndarray, field: np.ndarray) -> str:
    """Draw one displacement (n_points, n_times) [m]; where it is too fast for a surface, its envelopes.

    Returns what the title has to add.
    """
    factor, label = readable("m", field)
    at, parts = thinned(np.array([field.min(axis=0), field.max(axis=0)]), _INSTANTS)
    surfaces = [field[:, at]]
    if parts:
        at, *surfaces = envelope(field, _INSTANTS // 2)
    along, instants = np.meshgrid(1e3 * x, shown.x[at], indexing="ij")
    style = {"cmap": "viridis", "rcount": _ALONG, "ccount": len(at), "linewidth": 0.0, "antialiased": False,
             "vmin": factor * field.min(), "vmax": factor * field.max()}  # fmt: skip
    for values, alpha in zip(surfaces, (1.0, _PALE), strict=False):
        surface = axes.plot_surface(instants, along, factor * values, alpha=alpha, **style)
        surface.set_rasterized(True)  # thousands of facets: pixels inside the SVG
    axes.set_xlabel(shown.x_label, labelpad=4)
    axes.set_ylabel("x [mm]", labelpad=2)
    axes.set_zlabel(f"displacement [{label}]", labelpad=2)
    axes.tick_params(pad=0)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.zaxis.set_major_locator(MaxNLocator(5))
    if shown.drive:
        axes.set_xticks(np.arange(np.ceil(shown.x[0] / 180) * 180, shown.x[-1] + 1, 180))
    axes.view_init(elev=28, azim=-58)
    axes.set_box_aspect((1.5, 0.9, 0.75), zoom=1.12)
    return f"\nlower and upper envelope, {len(at)} intervals" if parts else ""
