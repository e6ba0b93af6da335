"""Common style of pictures: palette, common units, panels, and reproducible files."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from struct import pack
from textwrap import fill
from typing import NamedTuple
from zlib import compress, crc32

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.ticker import MultipleLocator

from kaneflex.support.escaping import picture_text

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Colours that the colour-blind tell apart (Okabe & Ito 2008), yellow left out: too pale for a line on white."""
GREY = "#9A9A9A"
TOUCHED = "#FBE3D3"
"""Behind curves while something touches."""
_LETTER, _HANDLE = 0.068, 0.45
"""Width of a legend's letter (8 points, DejaVu Sans) and of the line before a name [inches]."""
_TITLE_LETTER = 0.092
"""Width of a figure title's letter (11 points) [inches]."""
_PANEL_LETTER = 0.079
"""Width of a panel title's letter (9.5 points) [inches]."""
_ROW = 0.19
"""Height of a legend's row [inches]."""
_ONE_COLUMN = 4
"""Most panels that stand one above the other."""

_STYLE = {
    "axes.formatter.limits": (-5, 9),  # the text of a factor, as of an offset, would overlap the title
    "axes.formatter.useoffset": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.labelsize": 9,
    "axes.prop_cycle": matplotlib.cycler(color=PALETTE),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.titley": 1.0,  # else matplotlib looks for ticks above each panel, a tenth of the time to draw
    "figure.titlesize": 11,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "savefig.dpi": 150,
    "svg.fonttype": "path",
    "svg.hashsalt": "kaneflex",  # or the ids in the file are random
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
}

# SI unit -> what people read: label, factor, and the least largest value that it is used for.
_READ_AS = {
    "m": (("m", 1.0, 10.0), ("mm", 1e3, 1e-2), ("µm", 1e6, 1e-2), ("nm", 1e9, 0.0)),
    "rad": (("deg", 180 / math.pi, 0.1), ("mrad", 1e3, 1e-2), ("µrad", 1e6, 0.0)),
    "N": (("MN", 1e-6, 1.0), ("kN", 1e-3, 0.5), ("N", 1.0, 0.5), ("mN", 1e3, 0.0)),
    "N m": (("MN m", 1e-6, 1.0), ("kN m", 1e-3, 10.0), ("N m", 1.0, 0.5), ("mN m", 1e3, 0.1), ("µN m", 1e6, 0.0)),
    "N/m": (("kN/m", 1e-3, 0.5), ("N/m", 1.0, 0.0)),
    "J": (("MJ", 1e-6, 1.0), ("kJ", 1e-3, 1.0), ("J", 1.0, 0.5), ("mJ", 1e3, 0.5), ("µJ", 1e6, 0.0)),
    "m/s": (("m/s", 1.0, 0.05), ("mm/s", 1e3, 0.05), ("µm/s", 1e6, 0.0)),
    "m/s^2": (("km/s²", 1e-3, 1.0), ("m/s²", 1.0, 0.0)),
    "rad/s": (("rad/s", 1.0, 0.0),),
    "rad/s^2": (("krad/s²", 1e-3, 1.0), ("rad/s²", 1.0, 0.0)),
    "1": (("µm/m", 1e6, 0.5), ("nm/m", 1e9, 0.0)),
    "m^3": (("mm³", 1e9, 1e-2), ("µm³", 1e18, 0.0)),
    "Pa": (("MPa", 1e-6, 0.1), ("kPa", 1e-3, 0.1), ("Pa", 1.0, 0.0)),
    "bar": (("bar", 1.0, 0.0),),
    "s": (("s", 1.0, 0.5), ("ms", 1e3, 0.0)),
    "Hz": (("kHz", 1e-3, 1.0), ("Hz", 1.0, 0.0)),
}


@contextmanager
def styled() -> Iterator[None]:
    """The context in which pictures are made and written; the caller's own settings come back after it.

    Letters that the font lacks, as those of a Chinese name, are boxes; matplotlib would warn of each, with its line.
    """
    with matplotlib.rc_context(_STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from")
        yield


class Picture(Figure):
    """Figure that notebooks display, as they do those of pyplot."""

    def _repr_png_(self) -> bytes:
        return picture(lambda: self, "png")


def new_figure(width: float, height: float, title: str, layout: str = "constrained") -> Figure:
    """An empty figure [inches] with a canvas of its own, outside pyplot's global state."""
    figure = Picture(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    figure.suptitle(wrapped(picture_text(title), width), y=None if layout == "constrained" else 1.0 - 0.15 / height)
    return figure


def wrapped(title: str, width: float) -> str:
    """A figure's title in lines that its width [inches] holds."""
    return fill(title, max(20, int(width / _TITLE_LETTER)))


def cells(
    figure: Figure, rows: int, columns: int, count: int, by_column: bool = False, sharex: bool = False,
    sharey: bool = False,
) -> list[Axes]:  # fmt: skip
    """So many panels of a grid, row by row or column by column."""
    grid = figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False)
    panels = (grid.T if by_column else grid).ravel()
    for axes in panels[count:]:
        axes.remove()
    return list(panels[:count])


def pages(
    count: int, title: str, width: float = 7.6, height: float = 2.2, room: float = 0.8
) -> tuple[Figure, list[Axes]]:
    """So many panels of that size over one abscissa, in two columns where they are many; ``room`` besides [inches]."""
    rows, columns = grid_of(count)
    page = new_figure(width * columns, room + height * rows, title, layout="none")
    return page, cells(page, rows, columns, count, by_column=True, sharex=True)


def finish(panels: list[Axes], label: str) -> list[Axes]:
    """Name the abscissa below each column of such panels, and give them their margins; the lowest ones."""
    rows, columns = grid_of(len(panels))
    lowest = [panels[last - 1] for last in sorted({min(rows, len(panels)), len(panels)})]
    for axes in lowest:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel(label)
    place(panels, rows, columns)
    return lowest


def place(panels: Sequence[Axes], rows: int, columns: int = 1) -> None:
    """Give a figure's grid of panels fixed margins, with room for legends at the right of panels and of the figure;
    long titles of panels are wrapped.

    A layout engine would take a third of the time to draw.
    """
    figure = panels[0].get_figure(root=True)
    assert figure is not None
    width, height = figure.get_size_inches()
    ticks = [text.get_text() for axes in panels for text in axes.get_yticklabels()]
    longest = max((len(text) for text in ticks if "$" not in text), default=0)
    left, bottom = max(0.85, 0.4 + _LETTER * longest), 0.5  # inches, of axis labels
    right = max([0.2, *(_breadth(legend) for axes in panels if (legend := axes.get_legend()) is not None
                        and legend.get_bbox_to_anchor().x0 >= axes.bbox.x1)])  # fmt: skip
    wide, outer = max(1.5, width / columns - left - right), sum(map(_breadth, figure.legends))
    figure.set_figwidth(width := columns * (left + wide + right) + outer)
    side = matplotlib.rcParams["axes.titlelocation"]  # the centre where a caller makes a figure outside of styled()
    for axes in panels:
        axes.set_title(fill(axes.get_title(side), int((wide + right) / _PANEL_LETTER)))
    more = 0.16 * max(axes.get_title(side).count("\n") for axes in panels)
    top, between = 0.62 + more, 0.4 + more  # inches, of titles
    high = (height - bottom - top - (rows - 1) * between) / rows
    figure.subplots_adjust(
        left=left / width, right=1.0 - (right + outer) / width, bottom=bottom / height, top=1.0 - top / height,
        wspace=(left + right) / wide, hspace=between / high,
    )  # fmt: skip


def _breadth(legend: Legend) -> float:
    """Width of a legend [inches]."""
    return legend._ncols * max(_LETTER * len(text.get_text()) + _HANDLE for text in legend.get_texts())


def legend_of_page(panels: Sequence[Axes]) -> None:
    """One legend at the right of a figure whose panels show the same curves."""
    figure = panels[0].get_figure(root=True)
    assert figure is not None
    handles, labels = panels[0].get_legend_handles_labels()
    columns = math.ceil(len(labels) * _ROW / (figure.get_figheight() - 0.8))
    figure.legend(handles, labels, loc="upper right", bbox_to_anchor=(1.0, 1.0 - 0.5 / figure.get_figheight()),
                  handlelength=1.6, ncols=columns)  # fmt: skip


def grid_of(count: int) -> tuple[int, int]:
    """Rows and columns of so many panels over one abscissa."""
    columns = 1 if count <= _ONE_COLUMN else 2
    return -(-count // columns), columns


def save(figure: Figure, stem: Path, svg: bool = True) -> list[Path]:
    """Write STEM.png and, if requested, STEM.svg."""
    files = [stem.with_name(f"{stem.name}.{ending}") for ending in ("png", *["svg"] * svg)]
    for file in files:
        _write(figure, file, file.suffix[1:])
    return files


def picture(make: Callable[[], Figure], kind: str) -> bytes:
    """A figure as it is made, as a "png", "svg" or "pdf" file: the same figure, the same bytes."""
    file = io.BytesIO()
    with styled():
        _write(make(), file, kind)
    return file.getvalue()


def _write(figure: Figure, file: Path | io.BytesIO, kind: str) -> None:
    """Write a figure without a date in the file.

    PNG (W3C 2003, chapters 5 and 11) without matplotlib's savefig, which would draw everything twice, and without
    transparency and filters: with the lowest compression they take a third of the time and give the same size.
    """
    if kind != "png":
        figure.savefig(file, format=kind, metadata={"pdf": {"CreationDate": None}, "svg": {"Date": None}}[kind])
        return
    figure.set_dpi(matplotlib.rcParams["savefig.dpi"])
    canvas = FigureCanvasAgg(figure)
    with matplotlib.rc_context({"text.hinting": "none"}):  # letters as in an SVG, in half of the time
        canvas.draw()
    figure.set_layout_engine("none")  # places are found: an SVG takes half of the time to draw
    pixels = np.asarray(canvas.buffer_rgba())[:, :, :3]
    lines = np.pad(pixels.reshape(len(pixels), -1), ((0, 0), (1, 0)))  # each begins with 0: no filter
    size, per_metre = pack(">IIBBBBB", *pixels.shape[1::-1], 8, 2, 0, 0, 0), round(figure.dpi / 0.0254)
    chunks = {b"IHDR": size, b"pHYs": pack(">IIB", per_metre, per_metre, 1), b"IDAT": compress(lines.tobytes(), 1)}
    parts = [pack(">I", len(data)) + kind + data + pack(">I", crc32(kind + data))
             for kind, data in (chunks | {b"IEND": b""}).items()]  # fmt: skip
    png = b"".join([b"\x89PNG\r\n\x1a\n", *parts])
    file.write(png) if isinstance(file, io.BytesIO) else file.write_bytes(png)


def readable(unit: str, *values: np.ndarray) -> tuple[float, str]:
    """Factor from the SI ``unit``, and label, of a unit in which ``values`` (without NaN) have few digits.

    Zeros have that of one SI unit.
    """
    largest = max((float(np.fmax.reduce(np.abs(part), axis=None, initial=0.0)) for part in values), default=0.0) or 1.0
    choices = _READ_AS.get(unit, ((unit, 1.0, 0.0),))  # others, as of derivatives, in SI
    return next((factor, label) for label, factor, least in choices if largest * factor >= least)


def shade(colour: str, towards: float) -> tuple[float, float, float]:
    """A colour mixed with black (towards < 0) or white (> 0) by that share."""
    mixed = 0.0 if towards < 0 else 1.0
    return tuple((1 - abs(towards)) * part + abs(towards) * mixed for part in to_rgb(colour))


class Panel(NamedTuple):
    """Curves (name, values in their SI unit) of one quantity."""

    title: str
    quantity: str
    unit: str
    curves: Sequence[tuple[str, np.ndarray]]

    def plot(self, axes: Axes, x: np.ndarray) -> tuple[float, str]:
        """Plot the curves with axis label, title and legend; return factor and label of the unit that is drawn."""
        factor, label = readable(self.unit, *(values for _, values in self.curves))
        for name, values in self.curves:
            axes.plot(x, factor * values, label=name)
        axes.set(title=self.title, ylabel=f"{self.quantity} [{label}]", xmargin=0)
        if len(self.curves) > 1:
            legend_above(axes)
        return factor, label


def legend_above(axes: Axes) -> None:
    """A legend in one row at the right end of the title's line, where it hides no curve."""
    count = len(axes.get_legend_handles_labels()[0])
    axes.legend(
        loc="lower right", bbox_to_anchor=(0.999, 0.985), borderaxespad=0.0, ncols=count,
        columnspacing=1.2, handlelength=1.6, handletextpad=0.5, borderpad=0.2,
    )  # fmt: skip


def legend_beside(axes: Axes, *entries: list) -> None:
    """A legend to the right of the panel, for names that are long or many; ``entries``: other handles and names."""
    axes.legend(*entries, loc="upper left", bbox_to_anchor=(1.0, 1.05), borderaxespad=0.2, handlelength=1.6)


def mark_angles(axes: Axes, span: float) -> None:
    """Ticks at round angles of an abscissa in degrees."""
    steps = (5, 15, 30, 45, 90, 180, 360, 720, 1440)
    axes.xaxis.set_major_locator(MultipleLocator(next((step for step in steps if span / step <= 9), span / 8)))


def round_down(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most ``value``; 1 for a value that is not positive."""
    if not (value > 0 and math.isfinite(value)):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= value * (1 + 1e-12))
