"""Commands around a mechanism: draw it, start a new one, take its state space and its equations out."""

from __future__ import annotations

from pathlib import Path

import click

from kaneflex.cli_scene import all_settings, configuration, read
from kaneflex.errors import OutputError, SceneError

_PICTURES = (".png", ".svg", ".pdf")

force_option = click.option("--force", is_flag=True, help="Replace an existing file.")
preset_option = click.option("--preset", metavar="NAME", help="Named model, see `kaneflex list`.")
set_option = click.option(
    "--set", "settings", multiple=True, metavar="PATH=VALUE", help="Change an entry of the scene. Can be repeated."
)


@click.command()
@click.argument("name", metavar="SCENE")
@preset_option
@set_option
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="FILE.png",
    help="Picture to write: .png, .svg or .pdf. [default: NAME.png]",
)  # fmt: skip
@click.option(
    "--at", "places", multiple=True, metavar="DRIVE=ANGLE",
    help="Configuration, like main=30deg; a plain number is in rad. Can be repeated. [default: as the run starts]",
)  # fmt: skip
@force_option
def show(
    name: str, preset: str | None, settings: tuple[str, ...], output: Path | None, places: tuple[str, ...], force: bool
) -> None:
    """Draw SCENE with its bodies, joints, drives, loads and sensors, and count its degrees of freedom.

    Nothing is derived or solved for it: a scene that can't be run yet can be looked at.
    """
    from kaneflex.freedom import count_freedom, elastic_coordinates
    from kaneflex.placing import place
    from kaneflex.presentation import freedom, parts
    from kaneflex.writing import refuse_existing, write_bytes

    scene = read(name, all_settings(preset, settings))
    path = output or Path(f"{scene.name}.png")
    if path.suffix not in _PICTURES:
        raise OutputError(str(path), None, "not a kind of picture", f"End the name in {', '.join(_PICTURES)}")
    refuse_existing(path, force, "mechanism.png")
    at = dict(configuration(scene, text) for text in places)
    click.echo(parts(scene))
    try:
        elastic = len(elastic_coordinates(scene))
    except SceneError as error:
        click.echo(f"Warning: the elastic part can't be set up: {error}", err=True)
        elastic = None
    click.echo(freedom(count_freedom(scene), elastic))
    placement = place(scene, at)
    from kaneflex.plots.scheme import scheme_picture

    write_bytes(path, scheme_picture(scene, placement, path.suffix[1:]))
    click.echo(f"Written to {path}")


@click.command()
@click.argument("name", metavar="NAME")
@click.option("--like", required=True, metavar="SCENE", help="Shipped scene to start from, see `kaneflex list`.")
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="FILE.toml", help="[default: NAME.toml]")
@click.option("--force", is_flag=True, help="Replace existing files.")
def new(name: str, like: str, output: Path | None, force: bool) -> None:
    """Write a scene of your own to start from, with comments, and the tables that it reads beside it."""
    from kaneflex.starting import new_scene

    path = output or Path(f"{name}.toml")
    if path.suffix != ".toml":
        raise OutputError(str(path), None, "not the name of a scene file", "End it in .toml")
    for written in new_scene(name, like, path, force):
        click.echo(f"Written to {written}")
