"""The moving mechanism with its deformation enlarged, as a small GIF or an MP4."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
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
from kaneflex.support.errors import installed, told
from kaneflex.support.escaping import picture_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kaneflex.solve.solution import Solution

PER_SECOND, DPI = 12, 80


def demand_ffmpeg() -> str:
    """Path of the encoder. Raises SceneError if imageio-ffmpeg, which contains it, is not installed."""
    with told("--mp4", None), installed("imageio-ffmpeg", "mp4", "imageio_ffmpeg", instead="leave it out"):
        from imageio_ffmpeg import get_ffmpeg_exe
    return str(get_ffmpeg_exe())


@contextmanager
def recording(
    axes: Axes, moving: Sequence[Artist], files: Sequence[Path], frames: int, seconds: float | None
) -> Iterator[Callable[[], None]]:
    """Gives what takes the axes' figure as the next of so many frames, for each file: GIF, or MP4 by its ending.

    Only the ``moving`` artists of the axes are drawn anew for each. Frames last so many ``seconds``, or as long as
    PER_SECOND of them are shown in one.
    """
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
    rate = PER_SECOND if seconds is None else frames / seconds
    with ExitStack() as open_files:
        encoders = [_encoder(file, rate, canvas.get_width_height()) for file in files]
        for encoder in encoders:
            open_files.enter_context(closing(encoder))
            next(encoder)

        def grab() -> None:
            canvas.restore_region(behind)
            for artist in sorted(moving, key=Artist.get_zorder):
                axes.draw_artist(artist)
            image = np.array(np.asarray(canvas.buffer_rgba())[..., :3])
            for encoder in encoders:
                encoder.send(image)

        yield grab


def _encoder(file: Path, rate: float, size: tuple[int, int]) -> Generator[None, np.ndarray, None]:
    """Is sent the frames (height, width, 3) of a file, which is whole when it is closed."""
    if file.suffix == ".gif":
        return _gif(file, rate)
    demand_ffmpeg()
    from imageio_ffmpeg import write_frames

    even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"]  # as players want it
    return write_frames(file, size, fps=rate, codec="libx264", macro_block_size=1, output_params=even)


def _gif(file: Path, rate: float) -> Generator[None, np.ndarray, None]:
    taken = list[Image.Image]()
    try:
        while True:
            frame = yield
            taken.append(Image.fromarray(frame).quantize())
    except GeneratorExit:
        if not taken:  # what it was sent first failed
            return
        taken[0].save(file, save_all=True, append_images=taken[1:], duration=1e3 / rate, loop=0)


def animate(solution: Solution, files: Sequence[Path], frames: int = FRAMES, seconds: float | None = None) -> None:
    """Write the animation over what :func:`kaneflex.plots.view.view` shows, so many instants of it, into GIF or MP4.

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
    with recording(axes, moving, files, len(shown.instants), seconds) as grab:
        for k in range(len(shown.instants)):
            for ghost in ghosts:
                ghost.move(still, k)
            solid.move(moved, k)
            for each in colours:
                each.move(k)
            caption.set_text(caption_at(shown, k))
            grab()
