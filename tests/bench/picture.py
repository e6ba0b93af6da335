"""The picture of the benchmarks: a panel for each section that has one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes

from bench.rows import Row
from kaneflex.plots.style import GREY, PALETTE, new_figure, styled

Rows = Sequence[Row]


def draw(sections: Mapping[str, Rows], path: Path) -> None:
    """Write the picture of those sections in which anything was timed."""
    panels = {name: panel for name, panel in PANELS.items() if any(row.time for row in sections.get(name, ()))}
    with styled():
        lines = -(-len(panels) // 2)
        figure = new_figure(11.0, 4.2 * max(lines, 1), "kaneflex beside other ways to the same numbers")
        for k, (name, panel) in enumerate(panels.items()):
            panel(figure.add_subplot(lines, min(2, len(panels)), k + 1), sections[name])
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)


def kernels(axes: Axes, rows: Rows) -> None:
    chosen = [row for row in rows if row.time and row.task.endswith(", in a loop") and " alone" not in row.task]
    values = [(f"{row.task.partition(',')[0]}: {row.candidate}", row.ratio or 1.0, row.candidate) for row in chosen]
    bars(axes, values, "Kernels in a loop", "time, relative to hand-written C")


def whole_runs(title: str) -> Callable[[Axes, Rows], None]:
    def panel(axes: Axes, rows: Rows) -> None:
        chosen = [row for row in rows if row.time and not row.of_time]
        several = len({row.task for row in chosen}) > 1
        values = [(f"{row.task}: " * several + row.candidate, row.ratio or 1.0, row.candidate) for row in chosen]
        bars(axes, values, title, "time, relative to kaneflex")

    return panel


def scaling(axes: Axes, rows: Rows) -> None:
    """Time of a step over the number of elements."""
    chosen = [row for row in rows if row.task.startswith("elements: ")]
    for name in dict.fromkeys(row.candidate for row in chosen):
        points = [(int(row.task.split()[1]), 1e6 * row.time.median) for row in chosen if row.candidate == name]
        axes.loglog(*zip(*points, strict=True), marker="o", markersize=3, label=name)
    axes.set_title("A step of the engine, not reduced")
    axes.set_xlabel("elements")
    axes.set_ylabel("time [us]")
    axes.legend()


def latency(axes: Axes, rows: Rows) -> None:
    values = [(f"{row.task}: {row.candidate}", row.time.median, row.task.partition(" ")[0]) for row in rows if row.time]
    bars(axes, values, "Whole processes", "time [s]", logarithmic=False)


def bars(
    axes: Axes, values: Sequence[tuple[str, float, str]], title: str, quantity: str, logarithmic: bool = True
) -> None:
    """Horizontal bars with their numbers; kaneflex's own in colour."""
    names = [name for name, *_ in values]
    lengths = [value for _, value, _ in values]
    colours = [PALETTE[0] if mark.startswith(("kaneflex", "engine")) else GREY for *_, mark in values]
    found = axes.barh(range(len(values)), lengths, color=colours)
    axes.bar_label(found, labels=[f"{value:.3g}" for value in lengths], padding=3, fontsize=8)
    axes.set_yticks(range(len(values)), names)
    axes.invert_yaxis()
    axes.set_title(title)
    axes.set_xlabel(quantity)
    axes.margins(x=0.15)
    if logarithmic:
        axes.set_xscale("log")


PANELS: dict[str, Callable[[Axes, Rows], None]] = {
    "kernels": kernels,
    "exudyn": whole_runs("Against Exudyn at equal error"),
    "ivp": whole_runs("Against solve_ivp at equal error"),
    "scaling": scaling,
    "latency": latency,
}
