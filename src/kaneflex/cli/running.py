"""Commands ``run`` and ``plot``: solve a scene, and draw more pictures of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from kaneflex.cli.command import (
    Target,
    command,
    folder_options,
    json_option,
    moving_options,
    names_option,
    path_option,
    which_pictures,
)
from kaneflex.cli.scene import (
    STOPPED_EARLY,
    Choosing,
    SceneArguments,
    chosen_lines,
    demand_tolerance,
    gathered,
    refuse_with_tolerance,
    scene_options,
    tolerance_of,
    tolerance_options,
    uncollected,
)
from kaneflex.support.terminal import echo

if TYPE_CHECKING:
    from kaneflex.report.summary import Summary


@command()
@scene_options()
@path_option(
    "--after", metavar="RESULTS", help="Continue from the last state in the folder of another run (preset coupled)."
)
@names_option(
    "--sensitivities", "parameters", metavar="PATHS",
    help="Derivatives of every sensor with respect to these numbers of the scene: rod.E,rod.I,main.speed.",
)  # fmt: skip
@click.option(
    "--basis", type=click.Choice(["frozen", "recomputed"]), default="frozen", show_default=True,
    help="With --sensitivities: keep the modal bases, or compute them for each change.",
)  # fmt: skip
@tolerance_options
@click.option("--write-back", is_flag=True, help="With --tolerance: write the chosen model into the scene's file.")
@folder_options("results", which_pictures)
@click.option("--vtk", is_flag=True, help='Also write the motion for ParaView; needs pip install "kaneflex[vtk]".')
@moving_options
@json_option
@gathered(asked=SceneArguments, target=Target, choosing=Choosing)
def run(
    asked: SceneArguments, target: Target, choosing: Choosing, after: Path | None, parameters: tuple[str, ...],
    basis: str, as_json: bool,
) -> None:  # fmt: skip
    """Solve SCENE and write report.html, results.nc and .csv, summary.json and pictures into a folder.

    The folder appears when it is complete; a run that fails leaves none. A run that stops early keeps the results up to
    that instant, prints when and why, and ends with exit code 3. The choice of --tolerance is kept in the user's cache.

    \b
      kaneflex run engine --preset coupled --set rod.elements=4 -o results
    """
    with uncollected():
        from kaneflex.cli.workflow import Demand, run_into
        from kaneflex.report.tables import ending

    tolerance, sensors = choosing.tolerance, choosing.sensors
    refuse_with_tolerance(tolerance, {"--preset": asked.preset, "--integrator": asked.integrator, "--after": after})
    demand_tolerance(tolerance, {"--sensors": ",".join(sensors), "--write-back": choosing.write_back})
    if target.vtk:
        from kaneflex.plots.vtk import demand_meshio

        demand_meshio()
    if target.kinds is not None:
        from kaneflex.plots import kinds_of

        kinds_of(target.kinds)
    if choosing.write_back:
        from kaneflex.scene.write_back import file_to_write, write_settings

        file = file_to_write(asked.name, asked.changes)
    demand = None if tolerance is None else Demand(tolerance_of(tolerance), sensors or None, choosing.write_back)
    with uncollected():
        scene = asked.read()
    target = target.named(scene, "results")
    told = (lambda summary: echo(summary.model_dump_json(indent=2))) if as_json else _print_results
    summary = run_into(scene, target, asked.changes, after, list(parameters), basis == "frozen", demand, told)
    echo(f"Written to {target.folder}", err=as_json)
    for warning in summary.warnings:
        echo(f"Warning: {warning}", err=True)
    if summary.outcome != "completed":
        echo(ending(summary), err=True)
    if choosing.write_back:
        write_settings(file, summary.choice.settings)
        echo(f"The model is written into {file}", err=as_json)
    if summary.outcome != "completed":
        click.get_current_context().exit(STOPPED_EARLY)


def _print_results(summary: Summary) -> None:
    """Print the tables of a run, before anything is drawn."""
    from kaneflex.report.tables import more_tables, run_lines, summary_table

    if summary.sensors:
        echo(summary_table(summary))
    for _, table in more_tables(summary):
        echo(table)
    echo(run_lines(summary))
    if summary.choice is not None:
        echo(chosen_lines(summary.choice))


@command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("kinds", nargs=-1)
@moving_options
def plot(folder: Path, kinds: tuple[str, ...], **options: Any) -> None:
    """Draw more pictures of a finished run into its FOLDER.

    KINDS are mechanism, sensors, loads, motion, paths, modes, displacements, surfaces, stresses, clearances, spectra,
    energy and animation; svg adds SVG files; all is the default. The run is solved again from the folder's scene.toml
    and must give the values of its results.nc.

    \b
      kaneflex plot engine-results spectra surfaces
    """
    from kaneflex.cli.workflow import draw_again

    for path in draw_again(folder, Target(folder, kinds=",".join(kinds) or "all", **options)):
        echo(f"Written to {path}")
