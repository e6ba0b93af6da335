"""Commands that inspect scenes without solving them: ``list``, ``check`` and ``modes``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.cli.command import Count, command, json_option, path_option, print_json
from kaneflex.cli.scene import SceneArguments, at_option, gathered, scene_options, uncollected
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import Waiting, echo, share_of

if TYPE_CHECKING:
    from kaneflex.scene import Scene


@command(name="list")
@json_option
@uncollected()
def list_(as_json: bool) -> None:
    """List the shipped scenes, the presets and the integrators.

    \b
      kaneflex list --json
    """
    from kaneflex.integrate.methods import METHODS
    from kaneflex.scene.parts import PRESETS
    from kaneflex.scene.read import descriptions
    from kaneflex.support.terminal import block

    methods = {name: method.description for name, method in METHODS.items()}
    if as_json:
        print_json({"scenes": descriptions(), "presets": PRESETS, "integrators": methods})
        return
    echo(block("scenes", descriptions()))
    echo(block("presets (--preset)", PRESETS))
    echo(block("integrators (--integrator)", methods))


def _print_schema(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        from kaneflex.scene import json_schema

        print_json(json_schema())
        ctx.exit()


@command()
@scene_options()
@click.option(
    "--json-schema", is_flag=True, is_eager=True, expose_value=False, callback=_print_schema,
    help="Print the JSON Schema of scene files, for editors, and stop.",
)  # fmt: skip
@json_option
@gathered(asked=SceneArguments)
@uncollected()
def check(asked: SceneArguments, as_json: bool) -> None:
    """Check every entry of SCENE and close its loops over the range of the drives, without solving it.

    It prints the range of each joint, how near each loop comes to a dead centre, and the degrees of freedom. It also
    prints the warnings that need no solution, such as steps that are too long for the loads.
    Deflections, energy, impacts and errors are known only after a run.

    \b
      kaneflex check press.toml --set main.speed="200 rpm"
    """
    from kaneflex.report.checked import description, notes, warnings
    from kaneflex.report.presentation import as_json as blocks_as_json
    from kaneflex.report.presentation import printed
    from kaneflex.solve.loading import load, uncoupled

    scene = asked.read()
    with Waiting() as waiting:
        model = uncoupled(load(scene, waiting), share_of(waiting, "forward dynamics of the rigid mechanism"))
    about, doubts, remarks = description(model), list(warnings(model)), list(notes(model))
    echo(blocks_as_json(scene, about, warnings=doubts, notes=remarks) if as_json else printed(scene, about))
    for warning in doubts:
        echo(f"Warning: {warning}", err=True)
    for note in remarks:
        echo(f"Note: {note}", err=True)


@command()
@scene_options()
@at_option
@click.option("--count", type=Count(min=1), help="Number of modes, lowest first. [default: all, 50 at most]")
@json_option
@path_option(
    "--export", metavar="FOLDER", help="Write modal data of each link for preset coupled instead: FOLDER/LINK.npz."
)
@click.option("--force", is_flag=True, help="Replace existing files of --export.")
@gathered(asked=SceneArguments)
@uncollected()
def modes(
    asked: SceneArguments, at: str | None, count: int | None, as_json: bool, export: Path | None, force: bool
) -> None:
    """Print undamped natural frequencies and mode shapes of SCENE at one configuration.

    Modes follow from the elastic stiffness and the mass matrix; preset paper adds the spin and Euler terms, as in the
    paper's eq. (99). Shapes are mass-normalised; with --json, mode_shapes has a column for each mode and a row for each
    coordinate (m or rad).

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
        print_json(found.as_data())
        return
    from kaneflex.report.tables import modes_table

    echo(modes_table(found))


def _export(scene: Scene, folder: Path, force: bool) -> None:
    from kaneflex.response.modal_data import export, links_data

    if not scene.is_elastic:
        raise SceneError("--export", str(folder), "no body has a beam: there are no mode shapes", "Give a body a beam")
    with Waiting() as waiting:
        written = export(links_data(scene, waiting), folder, force)
    for path in written:
        echo(f"Written to {path}")
