"""Joints with a clearance: the path of a journal in its clearance circle, a block between the faces of its guide.

The path of a pin's middle as in Flores, Ambrosio, Claro & Lankarani 2008, *Kinematics and Dynamics of Multibody Systems
with Imperfect Joints*, ch. 3; a block's place and tilt have a rhombus as it has a circle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Polygon, Rectangle
from matplotlib.transforms import ScaledTranslation

from kaneflex.mechanism.spatial import across
from kaneflex.plots.outlines import aligned, view_of
from kaneflex.plots.style import GREY, PALETTE, TOUCHED, legend_beside, new_figure, readable
from kaneflex.plots.view import View, view
from kaneflex.solve.touching import eccentricity, record_of, worn_volume

if TYPE_CHECKING:
    from kaneflex.response.motion import Motion
    from kaneflex.scene.clearances import LooseJoint
    from kaneflex.solve.solution import Solution

_CORNERS = ("right, behind", "right, before", "left, behind", "left, before")
"""Names of a block's corners, seen along its guide, in the order of their contacts."""
_FACES = ("right", "left", "above", "below")
"""Names of a block's faces in space, each with four contacts."""
_ENDS = ("rear end", "front end", "rear face", "front face")
"""Names of a pin's ends and of the faces beside it in space, in the order of their contacts."""
_SECTORS = 72
"""Parts of a bearing's circumference in pictures of wear."""
_DASHES = ((0, ()), (0, (5, 2.5)), (0, ()), (0, (5, 2.5)))
"""Corners of a block: the two of a face often go together."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``clearance_JOINT`` for every joint with a clearance, if the run's equations contain it."""
    if record_of(solution) is None:
        return {}
    shown, found = view(solution), {}
    for name, loose in solution.model.scene.loose.items():
        found[f"clearance_{name}"] = _figure(shown, name, loose)
        rubs = loose.clearance.friction
        if _is_pin(loose, solution.model.scene.is_spatial) and rubs is not None and rubs.wear is not None:
            found[f"wear_{name}"] = _wear(shown, name, loose)
    return found


def _figure(shown: View, name: str, loose: LooseJoint) -> Figure:
    """Path of a pin's or ball's middle, in space of a pin's ends, or of a block, in the plane over its tilt; the
    eccentricity and the forces."""
    factor, unit = readable("m", np.array([loose.room]))
    room, bearing, tilts = factor * loose.room, loose.direction is None, _tilts(loose)
    kind = "in radius" if bearing else "to either face" if tilts else "to every face"
    figure = new_figure(12.6, 5.4, f"Clearance of {name}: {room:.4g} {unit} {kind}{shown.note}")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15))
    over, path = [figure.add_subplot(grid[0, 1])], figure.add_subplot(grid[:, 0])
    over.append(figure.add_subplot(grid[1, 1], sharex=over[0]))
    ends = dict(zip(_ENDS, loose.contacts, strict=False))
    body = ("pin" if _is_pin(loose, shown.solution.model.scene.is_spatial) else "ball") if bearing else "block"
    parts = {body if tilts else f"{body}'s middle": (name, loose.contacts)}
    if loose.axis:
        parts = {end: (key, (key,)) for end, key in [*ends.items()][:2]}
    turned, right, up, where = _picture(shown.motion, loose)
    called: dict[str, tuple[str, ...]] = {"force": loose.contacts}
    drawn = [(part, contacts, turned(shown.motion.clearance(key))) for part, (key, contacts) in parts.items()]
    if tilts:
        most = loose.room / (0.5 * loose.length)
        scale, degrees = readable("rad", np.array([most]))
        rhombus = [(most * scale, 0), (0, room), (-most * scale, 0), (0, -room)]
        path.add_patch(Polygon(rhombus, fill=False, label="limits of position and tilt"))
        path.set(xlabel=f"tilt [{degrees}]", ylabel=f"position across the guide [{unit}]")
        path.set_title("Position across the guide over the tilt")
        called = {corner: (key,) for key, corner in zip(loose.contacts, _CORNERS, strict=True)}
    else:
        scale, reach = factor, max(loose.room, *(float(np.abs(place).max()) for *_, place in drawn))
        limit = Rectangle((-room, -room), 2.0 * room, 2.0 * room, fill=False, label="limits of the position")
        path.add_patch(Circle((0, 0), room, fill=False, label="clearance circle") if bearing else limit)
        ends_of_axes = -1.06 * factor * reach, 1.06 * factor * reach
        path.set(xlim=ends_of_axes, ylim=ends_of_axes, aspect="equal")
        path.set(xlabel=f"{right} [{unit}]", ylabel=f"{up} [{unit}]")
        path.set_title(f"Path in the {'bearing' if bearing else 'guide'}, {where}")
        if not bearing:
            called = {face: loose.contacts[4 * k : 4 * k + 4] for k, face in enumerate(_FACES)}
        elif loose.axis:
            called = {end: (key,) for end, key in ends.items()}
    for (part, contacts, place), colour in zip(drawn, PALETTE[::2], strict=False):
        _path(path, shown, contacts, np.array([scale * place[0], factor * place[1]]), f"of the {part}", colour)
    ratio = eccentricity(shown.solution, name)[shown.instants]
    over[0].plot(shown.x, ratio, color=PALETTE[0], linewidth=0.9, label="eccentricity")
    over[0].axhline(1.0, color="black", linestyle="--", linewidth=0.8, label="the sides touch")
    over[0].set(title="Eccentricity over the clearance", ylabel="eccentricity [1]", xmargin=0)
    _forces(over[1], shown, called)
    _finish(over, shown, _touching(shown, loose.contacts))
    return figure


def _wear(shown: View, name: str, loose: LooseJoint) -> Figure:
    """Volume that a pin wears off its bearing, over the circumference and over time."""
    motion, first = shown.solution.motion, loose.sides[0].body
    around, sectors = np.zeros(_SECTORS), np.linspace(0.0, 2.0 * np.pi, _SECTORS + 1)
    ends = dict(zip(_ENDS[:2] if loose.axis else ("pin",), loose.contacts, strict=False))
    volumes = {end: worn_volume(shown.solution, key) for end, key in ends.items()}
    for end, key in ends.items():
        if loose.axis:
            x, y = _picture(motion, loose)[0](motion.clearance(key))
        else:
            x, y = motion.seen_from(first, motion.clearance(name)[:2])
        grown = np.diff(volumes[end], prepend=0.0)
        around += np.histogram(np.arctan2(y, x) % sectors[-1], sectors, weights=grown)[0]
    factor, unit = readable("m^3", around)
    figure = new_figure(12.6, 5.4, f"Wear of the bearing of {name}: {factor * around.sum():.4g} {unit}{shown.note}")
    grid = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.15))
    rose, over = figure.add_subplot(grid[0, 0], projection="polar"), figure.add_subplot(grid[0, 1])
    rose.bar(sectors[:-1], factor * around, width=sectors[1], align="edge", color=PALETTE[1])
    seen = "seen along its axis" if loose.axis else f"in the axes of {first}"
    rose.set_title(f"Volume worn off every {360 // _SECTORS} deg [{unit}], {seen}", pad=28)
    for (end, volume), colour in zip(volumes.items(), PALETTE[::2], strict=False):
        over.plot(shown.x, factor * volume[shown.instants], color=colour, label=end)
    over.set(title="Worn volume", ylabel=f"volume [{unit}]", xmargin=0)
    if len(ends) > 1:
        legend_beside(over)
    shown.label_x(over)
    return figure


def _tilts(loose: LooseJoint) -> bool:
    """True for a block on a guide in the plane."""
    return loose.direction is not None and len(loose.direction) == 2


def _is_pin(loose: LooseJoint, in_space: bool) -> bool:
    """True for a pin in the plane or in space."""
    return loose.direction is None and bool(loose.axis or not in_space)


def _picture(motion: Motion, loose: LooseJoint) -> tuple[Callable[[np.ndarray], np.ndarray], str, str, str]:
    """Projection of global vectors, (2 or 3, n_times), on a picture, and names of its axes and of their directions."""
    view, axis = view_of(motion.model.scene.is_spatial), loose.axis or loose.direction
    if _tilts(loose):  # its place and tilt, see Motion.clearance
        return lambda way: way[[2, 1]], "", "", ""
    if axis is None:
        names = ("x", "y", "global axes") if aligned(view) else ("to the right", "upwards", "seen as the mechanism")
        return lambda way: view @ way[: view.shape[1]], *names
    up = np.array(loose.clearance.normal or across(np.array(axis))[0])
    turned, first = np.array([np.cross(axis, up), up]), loose.sides[0].body
    return lambda way: turned @ motion.seen_from(first, way), "to the right", "upwards", "seen along its axis"


def _path(
    axes: Axes, shown: View, contacts: tuple[str, ...], path: np.ndarray, of: str, colour: str = PALETTE[0]
) -> None:
    """Free and in contact, and where impacts begin; two rows of coordinates."""
    axes.plot(*path, color=GREY, linewidth=0.7, label=f"path {of}")
    axes.plot(*np.where(_touching(shown, contacts), path, np.nan), color=colour, linewidth=1.4, label="in contact")
    begins = [each.begin for key in contacts for each in shown.impacts(key)]
    where = [np.interp(begins, shown.times, row) for row in path]
    axes.plot(*where, "v", color=PALETTE[1], markersize=4, label=f"impacts ({len(begins)})")
    below = axes.transAxes + ScaledTranslation(0, -0.5, axes.figure.dpi_scale_trans)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0), bbox_transform=below, ncols=2)


def _forces(axes: Axes, shown: View, parts: Mapping[str, tuple[str, ...]]) -> None:
    """Forces of contacts, summed over those of a part, by what it is called; with the peaks of the impacts."""
    forces = {part: np.sum([shown.motion.contact(key)[1] for key in own], axis=0) for part, own in parts.items()}
    peaks = {part: np.hstack([shown.peaks(key) for key in own]) for part, own in parts.items()}
    factor, unit = readable("N", *forces.values(), *(force for _, force in peaks.values()))
    for part, colour, dashes in zip(parts, PALETTE, _DASHES, strict=False):
        axes.plot(shown.x, factor * forces[part], color=colour, linestyle=dashes, linewidth=0.9, label=part)
        at, force = peaks[part]
        axes.plot(at, factor * force, "v", color=colour, markersize=3.5)
    axes.plot([], [], "v", color="black", markersize=3.5, label="peaks of impacts")
    axes.set(title="Contact forces", ylabel=f"force [{unit}]", xmargin=0)


def _finish(over: list[Axes], shown: View, touching: np.ndarray) -> None:
    """Legends, and shading of the times of contact."""
    for axes in over:
        axes.fill_between(
            shown.x, 0, 1, where=touching, transform=axes.get_xaxis_transform(), color=TOUCHED, linewidth=0, zorder=0
        )
        handles, labels = axes.get_legend_handles_labels()
        if axes is over[0]:
            handles, labels = [*handles, Patch(color=TOUCHED)], [*labels, "in contact"]
        if labels:
            legend_beside(axes, handles, labels)
        axes.tick_params(labelbottom=axes is over[-1])
    shown.label_x(over[-1])


def _touching(shown: View, contacts: tuple[str, ...]) -> np.ndarray:
    """Instants at which any of these contacts is closed, (n_times,) of bool."""
    from kaneflex.multibody.model.layout import CLOSED

    record = record_of(shown.solution)
    assert record is not None
    columns = [record.names.index(key) for key in contacts]
    return (record.mode[shown.instants][:, columns] == CLOSED).any(axis=1)
