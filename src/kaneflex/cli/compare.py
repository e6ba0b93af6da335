"""Command ``compare``: several models of a scene side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.cli.command import (
    Count,
    Target,
    command,
    folder_options,
    json_option,
    names_option,
    print_json,
    write_csv,
    write_into_folder,
    write_json,
)
from kaneflex.cli.scene import SceneArguments, gathered, scene_options
from kaneflex.support.terminal import echo

if TYPE_CHECKING:
    from kaneflex.study.comparison import Comparison
    from kaneflex.study.differences import Difference


COMPARISON_FILE, DIFFERENCES_FILE, CURVES_FILE = "comparison.json", "differences.csv", "curves.nc"


@command()
@scene_options("settings", "steps")
@names_option(
    "--presets", "--preset",
    help="Presets to run, like linear,stiffened,coupled. [default: these three; with --with: the scene's preset]",
)  # fmt: skip
@click.option("--with", "peer", metavar="PROGRAM", help="Build and run SCENE in another program, too: exudyn.")
@click.option("--peer-elements", type=Count(min=1), help="Elements per link in PROGRAM. [default: twice SCENE's]")
@click.option("--peer-steps", type=Count(min=1), help="Time steps in PROGRAM. [default: four times SCENE's]")
@click.option(
    "--against", metavar="NAME",
    help="Reference of the differences: a preset or the program. [default: the program, else the last preset]",
)  # fmt: skip
@folder_options("comparison")
@json_option
@gathered(asked=SceneArguments, target=Target)
def compare(
    asked: SceneArguments, target: Target, presets: tuple[str, ...], peer: str | None, peer_elements: int | None,
    peer_steps: int | None, against: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Run SCENE with several models and print the differences of every sensor.

    The folder contains differences.csv, comparison.json, curves.nc (every sensor of every model over time) and
    pictures of the curves. A preset that does not support SCENE is left out, with the reason. Exudyn needs
    pip install "kaneflex[peer]" and, in a copy of the sources, pip install ./tests/peers.

    \b
      kaneflex compare engine --presets linear,stiffened --against stiffened
    """
    from kaneflex.solve.curves import Resolution
    from kaneflex.study.comparison import compare as side_by_side

    scene = asked.read()
    resolution = Resolution(peer_elements, peer_steps)
    target = target.named(scene, "comparison")
    names = list(presets) or None
    comparison = write_into_folder(
        target, COMPARISON_FILE, lambda stage: side_by_side(scene, names, against, stage, peer, resolution),
        lambda found, folder: _write(found, asked.changes, folder), "overlay",
    )  # fmt: skip
    if as_json:
        print_json(comparison_data(comparison, asked.changes))
    else:
        echo(difference_table(comparison))
    echo(f"Written to {target.folder}", err=as_json)
    for model, curves in comparison.curves.items():
        for note in curves.notes:
            echo(f"{model}: {note}", err=True)
        for sensor, reason in curves.missing.items():
            echo(f"{model}: {sensor} is not compared: {reason}", err=True)
    for model, reason in comparison.left_out.items():
        echo(f"Left out: {model}: {reason}", err=True)


def comparison_data(comparison: Comparison, settings: Sequence[str]) -> dict[str, object]:
    """Content of comparison.json."""
    return {
        "scene": comparison.scene.name,
        "settings": list(settings),
        "against": comparison.against,
        "differences": [asdict(entry) for entry in comparison.differences],
        "notes": {model: list(curves.notes) for model, curves in comparison.curves.items()},
        "not_compared": {model: dict(curves.missing) for model, curves in comparison.curves.items()},
        "left_out": dict(comparison.left_out),
    }


def _write(comparison: Comparison, settings: Sequence[str], folder: Path) -> None:
    from kaneflex.study.differences import Difference

    write_json(folder / COMPARISON_FILE, comparison_data(comparison, settings))
    rows = [asdict(entry) for entry in comparison.differences]
    write_csv(folder / DIFFERENCES_FILE, [field.name for field in fields(Difference)], rows)
    comparison.labelled.to_netcdf(folder / CURVES_FILE)


def difference_table(comparison: Comparison) -> str:
    """Peaks and differences of every sensor; shares are of the reference's peak."""
    from kaneflex.report.tables import table

    head = ("sensor", "model", "unit", "peak", f"peak of {comparison.against}", "largest difference", "", "rms", "")
    return table(head, [_row(entry) for entry in comparison.differences], left=3)


def _row(entry: Difference) -> tuple[str, ...]:
    from kaneflex.report.tables import unit_shown

    unit, number = unit_shown(entry.unit, max(entry.peak, entry.reference_peak))

    def share(value: float) -> str:
        return "" if value == math.inf else f"{100 * value:.3g} %"

    return (
        entry.sensor, entry.model, unit, number(entry.peak), number(entry.reference_peak),
        number(entry.peak_difference), share(entry.error), number(entry.rms_difference), share(entry.rms_error),
    )  # fmt: skip
