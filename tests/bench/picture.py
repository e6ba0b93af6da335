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
    panels = {
        key: (panel, sections[name])
        for key, (name, panel) in PANELS.items()
        if any(row.time for row in sections.get(name, ()))
    }
    with styled():
        lines = -(-len(panels) // 2)
        figure = new_figure(11.0, 4.2 * max(lines, 1), "kaneflex compared with other solvers")
        for k, (panel, rows) in enumerate(panels.values()):
            panel(figure.add_subplot(lines, min(2, len(panels)), k + 1), rows)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)


def kernels(axes: Axes, rows: Rows) -> None:
    chosen = [row for row in rows if row.time and row.task.endswith(", in a loop") and " alone" not in row.task]
    values = [(f"{row.task.partition(',')[0]}: {row.candidate}", row.ratio or 1.0, row.candidate) for row in chosen]
    bars(axes, values, "Kernels in a loop", "time, relative to hand-written C")


def whole_runs(title: str) -> Callable[[Axes, Rows], None]:
    def panel(axes: Axes, rows: Rows) -> None:
        compared = {row.task for row in rows if row.ratio is not None}
        chosen = [row for row in rows if row.time and row.task in compared]
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


def precision(task: str) -> Callable[[Axes, Rows], None]:
    """Time over error, the largest error first."""

    def panel(axes: Axes, rows: Rows) -> None:
        chosen = [row for row in rows if row.time and row.error and row.task == task]
        for name in dict.fromkeys(row.candidate for row in chosen):
            points = [(row.error, 1e3 * row.time.median) for row in chosen if row.candidate == name]
            axes.loglog(*zip(*points, strict=True), marker="o", markersize=3, label=name)
        axes.invert_xaxis()
        axes.set_title(f"{task}:\ntime over error")
        axes.set_xlabel("error / largest deflection")
        axes.set_ylabel("time [ms]")
        axes.legend()

    return panel


def latency(axes: Axes, rows: Rows) -> None:
    chosen = [row for row in rows if row.time and not row.unit and row.task.startswith(("cold", "warm"))]
    values = [(f"{row.task}: {row.candidate}", row.time.median, "kaneflex" if row.target else "") for row in chosen]
    bars(axes, values, "Whole processes", "processor time [s]", logarithmic=False)


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


PANELS: dict[str, tuple[str, Callable[[Axes, Rows], None]]] = {
    "kernels": ("kernels", kernels),
    "exudyn": ("exudyn", whole_runs("Against Exudyn at equal error")),
    "engine": ("precision", precision("engine, coupled")),
    "slider-crank": ("precision", precision("slider-crank-150-coupled")),
    "ivp": ("ivp", whole_runs("Against solve_ivp at equal error")),
    "scaling": ("scaling", scaling),
    "latency": ("latency", latency),
}
"""Name of a panel -> the section that it shows, and what draws it."""
