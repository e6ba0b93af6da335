"""The moving mechanism with its deformation enlarged, as a small GIF or an MP4."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.plots.drawing import MM, Outline, draw_guides, draw_outline, draw_scenery, frame_axes
from kaneflex.plots.mechanism import grounded, outline, rigid_outline, scenery
from kaneflex.plots.stress_lines import StressLines
from kaneflex.plots.style import new_figure, round_down
from kaneflex.plots.view import FRAMES, View, angle_name, frames_of, view
from kaneflex.support.errors import installed, told

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kaneflex.solve.solution import Solution

PER_SECOND, DPI = 12, 80
_DRAWN = 0.1
"""Largest displacement as drawn, in sizes of the mechanism, before the factor is rounded down."""


def demand_ffmpeg() -> str:
    """The encoder's file. Raises SceneError where imageio-ffmpeg, which brings one, is not installed."""
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
    model, fixed = solution.model, scenery(solution.model)
    still = rigid_outline(model.scene, shown.rigid, fixed)
    factor = enlargement(shown)
    moved = outline(shown.motion, fixed, factor)
    figure = new_figure(6.0, 4.0, "")
    figure.suptitle(title(factor if model.links else None) + shown.note)
    axes = figure.subplots()
    width, height = frame_axes(axes, [still, moved], fixed)
    figure.set_size_inches(6.0, min(6.0, 5.2 * height / width + 1.1))
    draw_scenery(axes, fixed)
    draw_guides(axes, fixed, grounded(model.scene), still)
    ghost = draw_outline(axes, still, 0, ghost=True)
    solid = draw_outline(axes, moved, 0)
    caption = axes.set_title(caption_at(shown, 0))
    stressed = _coloured(axes, solution, moved, shown)
    moving = [*ghost, *solid, caption, *(lines.artist for lines in stressed)]
    with recording(axes, moving, files, len(shown.instants), seconds) as grab:
        for k in range(len(shown.instants)):
            ghost.move(still, k)
            solid.move(moved, k)
            for lines in stressed:
                lines.move(k)
            caption.set_text(caption_at(shown, k))
            grab()


def _coloured(axes: Axes, solution: Solution, moved: Outline, shown: View) -> list[StressLines]:
    """Links coloured by their stress, with the scale beside them; empty where no section has a shape."""
    lines = {name: MM * moved.links[name] for name in solution.stresses if name in moved.links}
    if not lines:
        return []
    stressed = StressLines(axes, solution, lines, shown.instants)
    bar = axes.get_figure(root=True).colorbar(stressed.artist, ax=axes, fraction=0.05)  # type: ignore[union-attr]
    bar.set_label(f"von Mises stress [{stressed.unit}]")
    return [stressed]


def enlargement(shown: View) -> float:
    """Factor that makes the largest elastic displacement a tenth of the mechanism, rounded down to 1, 2 or 5."""
    model, largest = shown.solution.model, 0.0
    size = spatial_mechanism_of(model.scene).size if model.scene.is_spatial else scenery(model).size
    for name, link in model.links.items():
        for x in link.nodes:
            at = model.scene.vector((float(x), 0.0))
            moved = shown.motion.displacement(name, at)[0][: len(at)]
            largest = max(largest, float(np.linalg.norm(moved, axis=0).max()))
    return round_down(_DRAWN * size / largest) if largest else 1.0


def title(factor: float | None) -> str:
    """States the enlargement; None for a rigid mechanism."""
    if factor is None:
        return "Rigid mechanism"
    power = math.floor(math.log10(factor) + 1e-9)
    plain = f"{factor:.0f}"
    number = plain if 0 <= power < 5 else f"{factor / 10.0**power:.0f} \u00d7 10$^{{{power}}}$"
    return f"Deformation enlarged {number} times"


def caption_at(shown: View, k: int) -> str:
    """Where the first drive stands, and the time."""
    drive = next(iter(shown.solution.model.scene.drives), None)
    time = f"t = {1e3 * shown.times[k]:.2f} ms" if shown.times[-1] < 0.5 else f"t = {shown.times[k]:.2f} s"
    if drive is None:
        return time
    scene, coordinate = shown.solution.model.scene, float(shown.rigid[f"{drive}.angle"][k])
    at = f"{1e3 * coordinate:.1f} mm" if scene.slides(drive) else f"{math.degrees(coordinate):.0f} deg"
    return f"{angle_name(shown.solution, drive)} {at}, {time}"
