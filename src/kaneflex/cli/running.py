"""Commands ``run`` and ``plot``: solve a scene, and draw more pictures of a run."""

from __future__ import annotations

from collections.abc import Sequence
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
    undocumented,
)
from kaneflex.support.errors import Fault, OutputError
from kaneflex.support.files import whole_folder, writing
from kaneflex.support.terminal import Waiting, echo, share_of

if TYPE_CHECKING:
    from kaneflex.report.summary import Summary
    from kaneflex.scene import Scene
    from kaneflex.solve.solution import Solution
    from kaneflex.solve.summary_tables import Choice
    from kaneflex.study.sensitivity.report import Sensitivities

SUMMARY_FILE, RESULTS_FILE, SENSITIVITIES_FILE = "summary.json", "results.nc", "sensitivities.nc"
SCENE_FILE = "scene.toml"
TABLE_FILE, VTK_FOLDER = "results.csv", "vtk"
_SAME = 1e-6
"""Permitted difference between two runs of one scene, as a share of a sensor's peak: rounding on another machine."""


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
    with uncollected():
        scene = asked.read()
    target = target.named(scene, "results")
    summary = _run_into(scene, target, asked.changes, after, parameters, basis == "frozen", choosing, as_json)
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


def _run_into(
    scene: Scene, target: Target, settings: Sequence[str], after: Path | None, parameters: Sequence[str], frozen: bool,
    choosing: Choosing, as_json: bool,
) -> Summary:  # fmt: skip
    """Solve a scene, print its results and write them into a new folder, which appears when it is complete.

    Also scene.toml, the scene with all settings, from which `kaneflex plot` draws more. A run that stopped early is not
    drawn.
    """
    folder, choice, solution = target.folder, None, None
    share = None if choosing.tolerance is None else tolerance_of(choosing.tolerance)
    with whole_folder(folder, mark=SUMMARY_FILE, force=target.force) as partial, Waiting() as waiting:
        if share is not None:
            from kaneflex.scene import with_settings
            from kaneflex.study.trade.choice import remembered_choice

            sensors = choosing.sensors or None
            choice, solution = remembered_choice(
                scene, share, sensors, waiting, "model" if choosing.write_back else "run"
            )
            scene, settings = with_settings(scene, choice.settings), [*settings, *choice.settings]
        with uncollected():
            solution = solution or _solve(scene, waiting, after, parameters)
            summary = _summary(solution, settings, choice, waiting)
            found = _differentiated(solution, parameters, frozen, waiting)
            if found is not None:
                summary = summary.model_copy(update={"sensitivities": found.summary()})
            with writing(folder):
                _write(solution, summary, partial)
                if found is not None:
                    found.labelled.to_netcdf(partial / SENSITIVITIES_FILE)
        echo(summary.model_dump_json(indent=2)) if as_json else _print_results(summary)
        with writing(folder):
            from kaneflex.report.page import write_report

            whole = summary.outcome == "completed" or summary.stored > summary.steps  # else what stopped it early
            pictures = _show(solution, found, partial, target, waiting) if whole else []
            write_report(solution, partial, pictures, summary)
    return summary


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


def _solve(scene: Scene, waiting: Waiting, after: Path | None, parameters: Sequence[str]) -> Solution:
    from kaneflex.solve.loading import load
    from kaneflex.solve.simulation import solve

    state = None
    if after is not None:
        from kaneflex.solve.initial import read_state

        state = read_state(after)
    if parameters:  # what can't be differentiated is known before anything is derived
        from kaneflex.study.sensitivity.parameters import find_parameters
        from kaneflex.study.sensitivity.report import check_differentiable

        check_differentiable(scene, continued=after is not None)
        find_parameters(scene, parameters)
    model = load(scene, waiting)
    waiting("solving" if model.options.integrator == "spectral" else "compiling the integrator, first time only")
    return solve(model, waiting.share_of("solving"), state)


def _summary(solution: Solution, settings: Sequence[str], choice: Choice | None, waiting: Waiting) -> Summary:
    from kaneflex.report.summary import summarise

    if choice is not None and not solution.model.scene.contacts:  # else of peaks and rms
        solution.judge({name: error + choice.doubt[name] for name, error in choice.errors.items()} | choice.open)
    solution.estimated(share_of(waiting, "estimating the errors"))
    waiting("writing the results")
    return summarise(solution, settings, choice)


def _differentiated(
    solution: Solution, parameters: Sequence[str], frozen: bool, waiting: Waiting
) -> Sensitivities | None:
    """Derivatives of a run by its parameters; None without parameters or after an early stop."""
    if not parameters:
        return None
    from kaneflex.integrate.system import Outcome
    from kaneflex.study.sensitivity.report import sensitivities

    if solution.outcome is not Outcome.COMPLETED:
        return None
    return sensitivities(solution, parameters, frozen, share_of(waiting, "differentiating"))


def _write(solution: Solution, summary: Summary, folder: Path) -> None:
    from kaneflex.scene.read import whole_text

    text = summary.model_dump_json(indent=2) + "\n"
    (folder / SUMMARY_FILE).write_text(text, encoding="utf-8", newline="\n")
    (folder / SCENE_FILE).write_text(whole_text(solution.model.given or solution.model.scene), "utf-8", newline="\n")
    if summary.sensors:
        found = solution.labelled
        found.to_netcdf(folder / RESULTS_FILE)
        found.to_csv(folder / TABLE_FILE, along="time")


def _show(
    solution: Solution, found: Sensitivities | None, folder: Path, target: Target, waiting: Waiting
) -> list[Path]:
    """Draw the pictures, write the motion for ParaView; return the pictures."""
    drawn: list[Path] = []
    if target.plots:
        from kaneflex.plots import draw

        drawn = _draw_all(solution, folder, target, waiting)
        drawn += [] if found is None else draw("sensitivities", found, folder)
    if target.vtk:
        from kaneflex.plots.vtk import write_vtk

        waiting("writing the motion for ParaView")
        write_vtk(solution, folder / VTK_FOLDER, target.frames)
    return drawn


def _draw_all(solution: Solution, folder: Path, target: Target, waiting: Waiting) -> list[Path]:
    from kaneflex.plots import draw_all
    from kaneflex.solve.solution import PLOTS

    share = share_of(waiting, "drawing the pictures")
    with uncollected():
        undocumented()
    return draw_all(solution, folder, share, target.frames, target.seconds, target.kinds or PLOTS)


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
    from kaneflex.plots import kinds_of
    from kaneflex.scene import read_scene
    from kaneflex.solve.loading import load
    from kaneflex.solve.simulation import solve

    target = Target(folder, kinds=",".join(kinds) or "all", **options)
    kinds_of(target.kinds or "")
    for name in (SCENE_FILE, RESULTS_FILE):
        if not (folder / name).is_file():
            raise OutputError(str(folder), None, f"the folder has no {name}", "Give a folder that `kaneflex run` made")
    with Waiting() as waiting, writing(folder):
        with uncollected():
            model = load(read_scene(folder / SCENE_FILE), waiting)
            solution = solve(model, waiting.share_of("solving"))
        _demand_same(solution, folder)
        drawn = _draw_all(solution, folder, target, waiting)
    for path in drawn:
        echo(f"Written to {path}")
    if not drawn:
        which = " ".join(kinds_of(target.kinds or ""))
        echo(f"Nothing drawn: the run has nothing to show in {which}; docs/results.md says what each needs.", err=True)


def _demand_same(solution: Solution, folder: Path) -> None:
    """Raise OutputError unless the sensors of a solution are those in the folder's results, to rounding."""
    import numpy as np

    from kaneflex.support.labelled import read_labelled

    try:
        read = read_labelled(folder / RESULTS_FILE)
    except Fault as fault:
        raise OutputError(str(folder / RESULTS_FILE), None, fault.reason, "Run the scene again with --plots") from fault
    before = {name: entry[1] for name, entry in read.variables.items() if entry[1].dtype.kind == "f"}
    for name, series in solution.series.items():
        found = before.get(name, np.zeros(0))
        if found.shape != series.values.shape or not np.allclose(
            found, series.values, rtol=0.0, atol=_SAME * abs(series.values).max(initial=0.0), equal_nan=True
        ):
            raise OutputError(
                str(folder / RESULTS_FILE), None, f"{name} differs from a new solution of {SCENE_FILE}: kaneflex "
                "or a file of the scene has changed, or the run continued another run",
                "Run the scene again with --plots",
            )  # fmt: skip
