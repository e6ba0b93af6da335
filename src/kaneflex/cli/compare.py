"""The command that puts several models of a scene side by side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.cli.scene import SceneArguments, Target, gathered
from kaneflex.support.output_folders import file_stem

if TYPE_CHECKING:
    from kaneflex.study.comparison import Comparison
    from kaneflex.study.differences import Difference


@click.command()
@click.argument("name", metavar="SCENE")
@click.option(
    "--presets", metavar="NAMES",
    help="Presets to run, like linear,stiffened,coupled. [default: these three; with --with the scene's own]",
)  # fmt: skip
@click.option("--with", "peer", metavar="PROGRAM", help="Build and run SCENE in another program, too: exudyn.")
@click.option("--peer-elements", type=click.IntRange(min=1), help="Its elements of each link. [default: twice SCENE's]")
@click.option("--peer-steps", type=click.IntRange(min=1), help="Its steps. [default: four times SCENE's]")
@click.option(
    "--against", metavar="NAME",
    help="The one that the others are measured against. [default: the other program, else the last]",
)  # fmt: skip
@click.option(
    "--set", "settings", multiple=True, metavar="PATH=VALUE", help="Change an entry of the scene. Can be repeated."
)
@click.option("--steps", metavar="N", help="Steps per cycle, or per run where there is no cycle.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder to make. [default: NAME-comparison]"
)
@click.option("--plots/--no-plots", default=True, help="Draw the curves, PNG and SVG.", show_default=True)
@click.option("--force", is_flag=True, help="Replace an earlier comparison's folder.")
@gathered(asked=SceneArguments, target=Target)
def compare(
    asked: SceneArguments, target: Target, presets: str | None, peer: str | None, peer_elements: int | None,
    peer_steps: int | None, against: str | None,
) -> None:  # fmt: skip
    """Run SCENE by several models and say how far apart every sensor is.

    The folder holds differences.csv, comparison.json, curves.nc (every sensor of every model over time) and pictures
    in which the curves lie over each other. A preset that SCENE can't be run with is left out, with the reason.
    Exudyn comes with pip install "kaneflex[peer]".
    """
    from kaneflex.cli.workflow import compare_into
    from kaneflex.solve.curves import Resolution

    scene = asked.read()
    names = None if presets is None else [part.strip() for part in presets.split(",")]
    target = replace(target, default=f"{file_stem(scene.name)}-comparison")
    resolution = Resolution(peer_elements, peer_steps)
    comparison = compare_into(scene, target, names, against, asked.changes, peer, resolution)
    click.echo(difference_table(comparison))
    click.echo(f"Written to {target.folder}")
    for model, curves in comparison.curves.items():
        for note in curves.notes:
            click.echo(f"{model}: {note}", err=True)
        for sensor, reason in curves.missing.items():
            click.echo(f"{model}: {sensor} is not compared: {reason}", err=True)
    for model, reason in comparison.left_out.items():
        click.echo(f"Left out: {model}: {reason}", err=True)


def difference_table(comparison: Comparison) -> str:
    """Peaks and differences of every sensor; shares are of the reference's peak."""
    from kaneflex.report.presentation import table

    head = ("sensor", "model", "unit", "peak", f"{comparison.against}'s", "largest difference", "", "rms", "")
    return table(head, [_row(entry) for entry in comparison.differences], left=3)


def _row(entry: Difference) -> tuple[str, ...]:
    from kaneflex.report.presentation import unit_shown

    unit, number = unit_shown(entry.unit, max(entry.peak, entry.reference_peak))

    def share(value: float | None) -> str:
        return "" if value is None else f"{100 * value:.3g} %"

    return (
        entry.sensor, entry.model, unit, number(entry.peak), number(entry.reference_peak),
        number(entry.peak_difference), share(entry.peak_share), number(entry.rms_difference), share(entry.rms_share),
    )  # fmt: skip
