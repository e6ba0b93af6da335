"""Commands ``sweep`` and ``explore``: one scene at many points of its parameters, or at those of sliders."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.cli.command import Count, check_picture, command, force_option, names_option, output_option
from kaneflex.cli.scene import (
    INTERRUPTED,
    STOPPED_EARLY,
    Choosing,
    SceneArguments,
    chosen_settings,
    demand_tolerance,
    gathered,
    preset_option,
    refuse_with_tolerance,
    scene_options,
    settings_option,
    tolerance_option,
    tolerance_options,
)
from kaneflex.support.files import write_bytes
from kaneflex.support.terminal import echo

if TYPE_CHECKING:
    from kaneflex.study.plan import Plan
    from kaneflex.study.sweep import Finished, Progress

_FAILURES_SHOWN = 5
_QUIET = 2.0
"""Time between two progress lines [s]."""


@command()
@click.argument("name", metavar="STUDY.toml")
@output_option("DIR", "Folder of the sweep. [default: STUDY-sweep]")
@click.option("--workers", type=Count(min=1), help="Number of processes on this machine.")
@settings_option
@preset_option
@tolerance_options
@click.option(
    "--no-plots", "plots", is_flag=True, flag_value=False, default=True,
    help="Draw no pictures; they need xarray, and are left out without it.",
)  # fmt: skip
@click.option("--force", is_flag=True, help="Start again and replace the results of an earlier sweep.")
@gathered(asked=SceneArguments, choosing=Choosing)
@click.pass_context
def sweep(
    ctx: click.Context, asked: SceneArguments, choosing: Choosing, output: Path | None, workers: int | None,
    plots: bool, force: bool,
) -> None:  # fmt: skip
    """Run one scene at many parameter values and write one labelled dataset.

    With --tolerance the points are solved by the fastest model that is within it at the first, the middle and the last
    point.

    STUDY.toml names the scene and the parameters: lists, ranges and samples. The folder contains sweep.nc with the
    smallest, largest, rms and mean value of every sensor at each point. After an interruption the same command
    continues. A failed point is recorded with its reason; if all points fail, the exit code is 3.

    \b
      kaneflex sweep speeds.toml --workers 4 --set rod.elements=4
    """
    from kaneflex.study.plan import make_plan
    from kaneflex.study.records import solve_points
    from kaneflex.study.sweep import sweep as go_through
    from kaneflex.study.workers import in_processes

    study, solver = Path(asked.name), solve_points if workers is None else in_processes(workers)
    plan = make_plan(study, asked.changes)
    refuse_with_tolerance(choosing.tolerance, {"--preset": asked.preset, "poincare": plan.poincare})
    demand_tolerance(choosing.tolerance, {"--sensors": ",".join(choosing.sensors)})
    plan = plan if choosing.tolerance is None else _with_chosen_model(plan, choosing)
    folder = output or Path(f"{study.stem}-sweep")
    try:
        finished = go_through(plan, folder, solver, _reporter(), force)
        _show(finished, plan, plots)
    except KeyboardInterrupt:
        echo(f"Interrupted; finished points are kept in {folder}. The same command continues.", err=True)
        ctx.exit(INTERRUPTED)
    if len(finished.failures) == finished.total:
        ctx.exit(STOPPED_EARLY)


def _show(finished: Finished, plan: Plan, plots: bool) -> None:
    """Print the failures and the file of a finished sweep, and draw its pictures if they are wanted."""
    for point, reason in list(finished.failures.items())[:_FAILURES_SHOWN]:
        echo(f"Point {point}: {reason}", err=True)
    if len(finished.failures) > _FAILURES_SHOWN:
        echo(f"... {len(finished.failures)} failed in all; the dataset's `reason` explains why", err=True)
    echo(f"{finished.total - len(finished.failures)} of {finished.total} points completed")
    echo(f"Written to {finished.path}")
    for path in _drawn(finished, plan) if plots else ():
        echo(f"Drawn: {path}")


def _with_chosen_model(plan: Plan, choosing: Choosing) -> Plan:
    """Plan with the fastest model within the tolerance at the first, the middle and the last point."""
    from kaneflex.scene import with_settings

    ends = sorted({0, len(plan.points) // 2, len(plan.points) - 1})
    where, scenes = f"points {', '.join(map(str, ends))}", [plan.at(point) for point in ends]
    settings = chosen_settings(choosing, scenes, "parameters", plan.points[0], where)
    return replace(plan, scene=with_settings(plan.scene, settings))


def _drawn(finished: Finished, plan: Plan) -> list[Path]:
    """Draw the pictures that a dataset's points allow, next to it."""
    from kaneflex.plots import draw

    drawn, found = [], finished.labelled
    for kind in ["sweep"] if plan.poincare is None else ["sweep", "bifurcation", "poincare"]:
        try:
            drawn += draw(kind, found, finished.path.parent)
        except ValueError as reason:
            echo(f"No picture {kind}: {reason}", err=True)
    return drawn


def _reporter() -> Callable[[Progress], None]:
    """Progress lines on stderr."""
    last = time.perf_counter()

    def report(progress: Progress) -> None:
        nonlocal last
        if time.perf_counter() - last >= _QUIET:
            last = time.perf_counter()
            echo(str(progress), err=True)

    return report


@command()
@scene_options()
@click.option(
    "--vary", "open_", multiple=True, metavar="PATH=LOW:HIGH",
    help="A slider for this entry of the scene, like main.speed=2000:6000rpm or rod.elements=1:8; "
    "limits without a decimal point or a unit give whole numbers. Can be repeated.",
)  # fmt: skip
@names_option("--sensors", help="Sensors to show and choose by. [default: the first four groups of similar sensors]")
@tolerance_option
@output_option("FILE.png", "Write a picture (.png, .svg or .pdf) instead of opening a window.")
@force_option
@gathered(asked=SceneArguments)
def explore(
    asked: SceneArguments, open_: tuple[str, ...], sensors: tuple[str, ...], output: Path | None, force: bool,
    tolerance: str | None,
) -> None:  # fmt: skip
    """Open a window with sliders for some numbers of SCENE and the resulting curves of its sensors.

    Each curve is the result of `kaneflex run` for the sliders' values; the pale curve is the unchanged scene. If a run
    is not possible, the window shows the reason. When the window closes, the sliders' values are printed as a command.
    With --tolerance it is the fastest model that is within it at the start and at both ends of all sliders.

    \b
      kaneflex explore engine --vary main.speed=2000:9000rpm
    """
    from kaneflex.plots import explore as open_window
    from kaneflex.scene import with_settings
    from kaneflex.study.exploration import Exploration, varied

    scene, chosen = asked.read(), list[str]()
    refuse_with_tolerance(tolerance, {"--preset": asked.preset, "--integrator": asked.integrator})
    if tolerance is not None:
        exploration = Exploration(scene, tuple(varied(scene, text) for text in open_), sensors)
        ends = [[getattr(each, end) for each in exploration.open] for end in ("start", "low", "high")]
        scenes, paths = [exploration.at(values) for values in ends], [each.path for each in exploration.open]
        where = "the start and the ends of the sliders"
        chosen = chosen_settings(Choosing(tolerance, sensors), scenes, "--vary", paths, where)
        scene = with_settings(scene, chosen)
    if output is not None:
        check_picture(output, force, "explored.png")
        from kaneflex.plots.style import picture

        write_bytes(output, picture(lambda: open_window(scene, open_, sensors, window=False), output.suffix[1:]))
        echo(f"Written to {output}")
        return
    changes = [*asked.changes, *chosen, *open_window(scene, open_, sensors)]
    words = ["kaneflex", "run", asked.name, *(word for change in changes for word in ("--set", change))]
    echo(f"Slider values as a command: {shlex.join(words)}")
