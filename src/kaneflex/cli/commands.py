"""The command line. Every command imports what it needs when it runs, so that ``--help`` is quick."""

from __future__ import annotations

import errno
import json
import logging
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from kaneflex.cli.command import command, grouped, names_option
from kaneflex.cli.compare import compare
from kaneflex.cli.explore import explore
from kaneflex.cli.exporting import export
from kaneflex.cli.folders import Target, folder_options, moving_options, path_option, which_pictures
from kaneflex.cli.importing import import_link
from kaneflex.cli.mechanism import derive, equations, linearise, new, show
from kaneflex.cli.number_types import Count
from kaneflex.cli.scene import (
    INTERRUPTED,
    STOPPED_EARLY,
    USER_ERROR,
    SceneArguments,
    at_option,
    gathered,
    scene_options,
)
from kaneflex.cli.stability import stability
from kaneflex.cli.sweep import sweep
from kaneflex.cli.trade import chosen_lines, demand_tolerance, refuse_with_tolerance, terms, tolerance_of, trade
from kaneflex.support.errors import SceneError, UserError
from kaneflex.support.terminal import LOG, Waiting, echo

if TYPE_CHECKING:
    from kaneflex.report.summary import Summary
    from kaneflex.scene import Scene

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class _Refusal(click.ClickException):
    exit_code = USER_ERROR

    def show(self, file: object = None) -> None:
        for line in self.message.splitlines():
            echo(f"Error: {line}", err=True)


@contextmanager
def _ended_like_interrupted() -> Iterator[None]:
    """SIGTERM, as a batch system's or a shutdown's, cleans up as Ctrl-C does."""

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class _Commands(click.Group):
    """Turns what a user can cure, and Ctrl-C or the system's request to end, into a message and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        grouped(self.commands, formatter)

    def invoke(self, ctx: click.Context) -> object:
        try:
            with _ended_like_interrupted():
                return super().invoke(ctx)
        except UserError as error:
            raise _Refusal(str(error)) from error
        except OSError as error:
            if error.errno not in _FULL:
                raise
            raise _Refusal(_disk_full(error)) from error
        except KeyboardInterrupt:
            echo("Interrupted; nothing was left behind.", err=True)
            ctx.exit(INTERRUPTED)


def _disk_full(error: OSError) -> str:
    """What to say of a full disk, as under numba's cache of compiled kernels, which names no file."""
    file = f"{error.filename}: " if error.filename else ""
    caches = "set NUMBA_CACHE_DIR for compiled kernels, XDG_CACHE_HOME for derived equations"
    return f"{file}{error.strerror}. Free some space, or keep caches elsewhere: {caches}."


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="kaneflex")
def main() -> None:
    """Simulate mechanisms with flexible links: motion, deformation, stresses and joint forces.

    SCENE is the name of a shipped scene (see `kaneflex list`) or the path of a TOML file. Quantities take units:
    "137 mm", "6000 rpm", 90deg. Lists take commas: --sensors torque,strain. Ranges take a colon:
    main.speed=2000:6000rpm. --set PATH=VALUE changes an entry of the scene. Exit codes: 0 done, 2 input to correct,
    3 the run stopped early, 130 interrupted.

    \b
    First steps:
      kaneflex run engine                        results, summary and pictures in engine-results
      kaneflex run engine --set rod.elements=1   change one number
      kaneflex new press                         a commented scene of your own, press.toml
    """


@command("Inspect", "Scenes, presets and integrators", name="list")
def list_() -> None:
    """List the shipped scenes, the presets and the integrators."""
    from kaneflex.integrate.methods import METHODS
    from kaneflex.scene.parts import PRESETS
    from kaneflex.scene.read import descriptions
    from kaneflex.support.terminal import block

    echo(block("scenes", descriptions()))
    echo(block("presets (--preset)", PRESETS))
    echo(block("integrators (--integrator)", {name: method.description for name, method in METHODS.items()}))


def _print_schema(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        from kaneflex.scene import json_schema

        echo(json.dumps(json_schema(), indent=2))
        ctx.exit()


@command("Inspect", "Check a scene without solving it")
@scene_options()
@click.option(
    "--json-schema", is_flag=True, is_eager=True, expose_value=False, callback=_print_schema,
    help="Print the JSON Schema of scene files, for editors, and stop.",
)  # fmt: skip
@gathered(asked=SceneArguments)
def check(asked: SceneArguments) -> None:
    """Check every entry of SCENE and close its loops over the range of the drives; nothing is solved.

    Printed are the range of each joint, the distance of the loops to dead centres, and the degrees of freedom by count
    and by rank. Warnings are those of a run that need no solution, such as steps too long for the loads. Deflections,
    energy, impacts and errors are known only after a run.

    \b
      kaneflex check press.toml --set main.speed="200 rpm"
    """
    from kaneflex.report.checked import description, notes, warnings
    from kaneflex.solve.loading import load

    scene = asked.read()
    with Waiting() as waiting:
        model = load(scene, waiting)
    echo(description(model))
    for warning in warnings(model):
        echo(f"Warning: {warning}", err=True)
    for note in notes(model):
        echo(f"Note: {note}", err=True)


@command("Run", "Solve a scene", renamed={"--sensor": "--sensors"})
@scene_options()
@path_option(
    "--after", metavar="RESULTS", help="Continue from the last state of another run's folder (preset coupled)."
)
@names_option(
    "--sensitivities", "parameters", metavar="PATHS",
    help="Differentiate every sensor by these numbers of the scene: rod.E,rod.I,main.speed.",
)  # fmt: skip
@click.option(
    "--basis", type=click.Choice(["frozen", "recomputed"]), default="frozen", show_default=True,
    help="Whether modal bases keep their shapes in --sensitivities.",
)  # fmt: skip
@click.option(
    "--tolerance", metavar="SHARE",
    help="Choose the cheapest model that keeps each sensor within a share of its peak, like 1%.",
)
@names_option("--sensors", help="With --tolerance: only these count.")
@click.option("--write-back", is_flag=True, help="With --tolerance: write the chosen model into the scene's file.")
@folder_options("results", which_pictures)
@click.option("--vtk", is_flag=True, help='Also write the motion for ParaView; pip install "kaneflex[vtk]" brings it.')
@moving_options
@gathered(asked=SceneArguments, target=Target)
def run(
    asked: SceneArguments, target: Target, after: Path | None, parameters: tuple[str, ...], basis: str,
    tolerance: str | None, sensors: tuple[str, ...], write_back: bool,
) -> None:  # fmt: skip
    """Solve SCENE and write report.html, results.nc and .csv, summary.json and pictures into a folder.

    The folder appears when it is complete; a run that fails leaves none. A run that stops early keeps the results up to
    that instant, says when and why, and ends with exit code 3. The choice of --tolerance is kept in the user's cache.

    \b
      kaneflex run engine --preset coupled --set rod.elements=4 -o results
    """
    from kaneflex.cli.workflow import Demand, run_into, uncollected
    from kaneflex.report.tables import ending
    from kaneflex.scene.write_back import file_to_write, write_settings

    refuse_with_tolerance(tolerance, {"--preset": asked.preset, "--integrator": asked.integrator, "--after": after})
    demand_tolerance(tolerance, {"--sensors": ",".join(sensors), "--write-back": write_back})
    if target.vtk:
        from kaneflex.plots.vtk import demand_meshio

        demand_meshio()
    if target.mp4:
        from kaneflex.plots.animation import demand_ffmpeg

        if not target.plots:
            raise SceneError("--mp4", None, "--no-plots draws no animation", "Leave out one of the two")
        demand_ffmpeg()
    if target.kinds is not None:
        from kaneflex.plots import kinds_of

        kinds_of(target.kinds)
    file = file_to_write(asked.name, asked.changes) if write_back else None
    demand = None if tolerance is None else Demand(tolerance_of(tolerance), sensors or None)
    with uncollected():
        scene = asked.read()
    target = target.named(scene, "results")
    summary = run_into(scene, target, asked.changes, after, list(parameters), basis == "frozen", demand, _print_results)
    echo(f"Written to {target.folder}")
    for warning in summary.warnings:
        echo(f"Warning: {warning}", err=True)
    if summary.outcome != "completed":
        echo(ending(summary), err=True)
    if file is not None:
        write_settings(file, summary.choice.settings)
        echo(f"The model is written into {file}")
    if summary.outcome != "completed":
        click.get_current_context().exit(STOPPED_EARLY)


def _print_results(summary: Summary) -> None:
    """The tables of a run, printed before anything is drawn."""
    from kaneflex.report.tables import more_tables, run_lines, summary_table

    if summary.sensors:
        echo(summary_table(summary))
    for _, table in more_tables(summary):
        echo(table)
    echo(run_lines(summary))
    if summary.choice is not None:
        echo(chosen_lines(summary.choice))


@command("Run", "Draw more pictures of a finished run")
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


@command("Inspect", "Natural frequencies and mode shapes")
@scene_options()
@at_option
@click.option("--count", type=Count(min=1), help="How many of the lowest modes. [default: all, 50 at most]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON: frequencies_hz, mode_shapes, coordinates.")
@path_option(
    "--export", metavar="FOLDER", help="Instead, write each link's modal data under preset coupled to FOLDER/LINK.npz."
)
@click.option("--force", is_flag=True, help="Replace existing files of --export.")
@gathered(asked=SceneArguments)
def modes(
    asked: SceneArguments, at: str | None, count: int | None, as_json: bool, export: Path | None, force: bool
) -> None:
    """Print undamped natural frequencies and mode shapes of SCENE at one configuration, from K_s and M.

    Shapes are mass-normalised; mode_shapes has a column for each mode and a row for each coordinate (m or rad). Preset
    paper adds K_d, as in the paper's eq. (99).

    \b
      kaneflex modes engine --at main=90deg --count 6
    """
    from kaneflex.solve.modes import mesh_hint
    from kaneflex.solve.modes import modes as found_modes

    if export is not None:
        _export(asked.read(), export, force)
        return
    scene = asked.read_at(at)
    with Waiting() as waiting:
        found = found_modes(scene, count, waiting)
        too_few = mesh_hint(found)
    if too_few:
        echo(f"Warning: {too_few}", err=True)
    if as_json:
        echo(json.dumps(found.as_data(), indent=2))
        return
    from kaneflex.report.tables import modes_table

    echo(modes_table(found))


def _export(scene: Scene, folder: Path, force: bool) -> None:
    from kaneflex.response.modal_data import export, links_data

    if not any(body.elastic for body in scene.bodies.values()):
        raise SceneError("--export", str(folder), "no body has a beam: there are no shapes", "Give a body a beam")
    with Waiting() as waiting:
        written = export(links_data(scene, waiting), folder, force)
    for path in written:
        echo(f"Written to {path}")


def _tell(ctx: click.Context, level: int) -> None:
    """Log from that level on, as long as the command lasts."""
    ctx.call_on_close(partial(LOG.setLevel, LOG.level))
    LOG.setLevel(level)


def _say_less(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        nowhere = ctx.with_resource(open(os.devnull, "w", encoding="utf-8"))
        ctx.with_resource(redirect_stdout(nowhere))
        _tell(ctx, logging.WARNING)


def _say_more(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        logging.basicConfig(format="%(message)s")
        _tell(ctx, logging.INFO)


_LOUDNESS = (
    click.Option(
        ["-q", "--quiet"], is_flag=True, is_eager=True, expose_value=False, callback=_say_less,
        help="Print only what is wrong: errors and warnings.",
    ),
    click.Option(
        ["-v", "--verbose"], is_flag=True, is_eager=True, expose_value=False, callback=_say_more,
        help="Say on stderr what each stage was and how long it took.",
    ),
)  # fmt: skip

for each in (
    list_, new, check, show, modes, equations, run, plot, compare, sweep, explore, stability, trade, terms, derive,
    export, linearise, import_link,
):  # fmt: skip
    main.add_command(each)
    each.params += _LOUDNESS
