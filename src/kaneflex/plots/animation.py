"""The moving mechanism with its deformation enlarged, as a small GIF."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from kaneflex.plots.deformed import LinkColours, stress_field
from kaneflex.plots.drawing import draw_outline, draw_scenery, frame_axes
from kaneflex.plots.enlarged import caption_at, enlarged
from kaneflex.plots.style import new_figure, wrapped
from kaneflex.plots.view import FRAMES, frames_of, view
from kaneflex.support.escaping import picture_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kaneflex.solve.solution import Solution

PER_SECOND, DPI = 12, 80


def recorded(axes: Axes, moving: Sequence[Artist], show: Callable[[int], None], count: int) -> Iterator[Image.Image]:
    """Frames of the axes' figure: ``show`` moves the ``moving`` artists to each instant, and only they are redrawn."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(DPI)
    canvas.draw()
    figure.set_layout_engine("none")  # places are found
    for artist in moving:
        artist.set_animated(True)  # the canvas leaves it out
    canvas.draw()
    behind = canvas.copy_from_bbox(figure.bbox)
    for k in range(count):
        show(k)
        canvas.restore_region(behind)
        for artist in sorted(moving, key=Artist.get_zorder):
            axes.draw_artist(artist)
        yield Image.fromarray(np.array(np.asarray(canvas.buffer_rgba())[..., :3])).quantize()


def animate(solution: Solution, file: Path, frames: int = FRAMES, seconds: float | None = None) -> None:
    """Write a GIF with so many instants of what :func:`kaneflex.plots.view.view` shows.

    It lasts so many ``seconds``, or as long as PER_SECOND frames are shown in one.
    The title states the factor by which the deformation is enlarged, 1, 2 or 5 times a power of ten. Elastic links
    whose section has a shape are coloured by their stress.
    """
    shown = frames_of(view(solution), frames)
    found = enlarged(shown)
    fixed, still, moved = found.fixed, found.still, found.moved
    figure = new_figure(6.0, 4.0, "")
    figure.suptitle(wrapped(f"{picture_text(solution.model.scene.name)}: {found.title}{shown.note}", 6.0))
    axes = figure.subplots()
    width, height = frame_axes(axes, [still, moved], fixed)
    figure.set_size_inches(6.0, min(6.0, max(2.4, 5.2 * height / width + 1.1)))
    draw_scenery(axes, fixed, still)
    ghosts = [draw_outline(axes, still, 0, ghost=True)] if fixed.flat else []
    solid = draw_outline(axes, moved, 0)
    caption = axes.set_title(caption_at(shown, 0))
    field = stress_field(solution, shown.instants) if moved.links else None
    colours = []
    if field is not None:
        colours = [LinkColours(axes, moved, field)]
        figure.colorbar(colours[0].artist, ax=axes, fraction=0.05).set_label(field.label)
    moving = [*(artist for ghost in ghosts for artist in ghost), *solid, caption, *(each.artist for each in colours)]

    def show(k: int) -> None:
        for ghost in ghosts:
            ghost.move(still, k)
        solid.move(moved, k)
        for each in colours:
            each.move(k)
        caption.set_text(caption_at(shown, k))

    count = len(shown.instants)
    first, *others = recorded(axes, moving, show, count)
    duration = 1e3 * (1.0 / PER_SECOND if seconds is None else seconds / count)
    first.save(file, save_all=True, append_images=others, duration=duration, loop=0)
