"""Command ``stability``: stability of a scene's periodic equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.cli.command import (
    Count,
    Target,
    command,
    folder_options,
    json_option,
    print_json,
    write_csv,
    write_into_folder,
    write_json,
)
from kaneflex.cli.scene import SceneArguments, gathered, quantity, say_plain, scene_options
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import echo

if TYPE_CHECKING:
    import numpy as np

    from kaneflex.scene import Scene
    from kaneflex.study.stability.report import Stability

LARGEST_ORDER = 1e4
_POINTS = 41
STABILITY_FILE, CYCLE_FILE, SPEEDS_FILE = "stability.json", "cycle.csv", "speeds.csv"


@command()
@scene_options("preset", "settings")
@click.option(
    "--vary", metavar="DRIVE.speed=LOW:HIGH",
    help="Speeds of the first drive, like main.speed=0:12000rpm; plain numbers are SI.",
)  # fmt: skip
@click.option("--points", type=Count(min=2), help="With --vary: number of speeds. [default: 41]")
@click.option(
    "--orders", metavar="LIST", default="1,2,3,4,5,6", show_default=True,
    help="Orders of the drive in the Campbell diagram, like 0.5,1,1.5.",
)  # fmt: skip
@folder_options("stability")
@json_option
@gathered(asked=SceneArguments, target=Target)
def stability(
    asked: SceneArguments, target: Target, vary: str | None, points: int | None, orders: str, as_json: bool,
) -> None:  # fmt: skip
    """Compute the stability of SCENE's periodic motion and print one sentence for each finding.

    Findings are Floquet multipliers, frozen frequencies over the cycle, buckling, the largest stable step of each
    integrator and conditioning; with --vary also unstable bands and the Campbell diagram. The folder contains
    stability.json, cycle.csv, speeds.csv and a picture.

    \b
      kaneflex stability engine --vary main.speed=1000:12000rpm --points 9
    """
    from kaneflex.report.presentation import block
    from kaneflex.study.stability.report import stability as judged
    from kaneflex.study.stability.sweep import check_sweep, speeds_between

    multiples, scene, speeds = orders_of(orders), asked.read(), None
    if vary is not None:
        speeds = speeds_between(*speed_range(scene, check_sweep(scene.drives), vary), points or _POINTS)
    elif points is not None:
        raise SceneError("--points", points, "requires --vary", "Add --vary DRIVE.speed=LOW:HIGH, or leave it out")
    target = target.named(scene, "stability")
    found = write_into_folder(
        target, STABILITY_FILE, lambda stage: judged(scene, speeds, stage, multiples), _write, "stability"
    )
    if as_json:
        print_json(found.as_data())
        return
    if speeds is not None:
        drive = next(iter(scene.drives))
        low, high = (scene.written_speed(drive, ends) for ends in speeds[[0, -1]])
        echo(f"At the scene's own speed, and at {len(speeds)} speeds of {drive} from {low} to {high}")
    else:
        echo(f"At the scene's own speed; --vary {next(iter(scene.drives), 'DRIVE')}.speed=LOW:HIGH computes a range")
    echo(block("stability", found.findings))
    echo(f"Written to {target.folder}")


def orders_of(text: str) -> tuple[float, ...]:
    """Comma-separated positive numbers, sorted, each once. Raises SceneError for anything else."""
    from kaneflex.support.units import plain_number

    found = sorted({plain_number(part) or 0.0 for part in text.split(",")})
    if not all(0.0 < order < LARGEST_ORDER for order in found):
        raise SceneError("--orders", text, "orders must be positive numbers", "Write them like 0.5,1,2")
    return tuple(found)


def speed_range(scene: Scene, drive: str, text: str) -> tuple[float, float]:
    """Bounds of "DRIVE.speed=LOW:HIGH" in rad/s, or m/s for a guide; LOW without a unit takes that of HIGH.

    Raises SceneError for any other entry of the scene, and unless 0 <= LOW < HIGH.
    """
    from kaneflex.study.exploration import ends_of
    from kaneflex.support.units import ANGULAR_SPEED, SPEED

    given = ends_of(text, f"{drive}.speed=0:12000rpm")
    path, low, high, unit = given.path, given.low, given.high, given.unit
    if path not in (f"{drive}.speed", f"drives.{drive}.speed"):
        cure = f"Write {drive}.speed=LOW:HIGH, like {drive}.speed=0:12000rpm"
        raise SceneError("--vary", text, "stability is computed over the speeds of the first drive", cure)
    if low < 0.0:
        raise SceneError("--vary", text, "speeds are not negative", "The drive keeps its direction: give amounts")
    dimension, end = SPEED if scene.slides(drive) else ANGULAR_SPEED, f"{high!r} {unit}".strip()
    ends = [quantity("--vary", part, dimension, text) for part in (f"{low!r} {unit}".strip(), end)]
    say_plain("--vary", text, end, dimension.unit, scene.written_speed(drive, ends[1]))
    return ends[0], ends[1]


def _write(found: Stability, folder: Path) -> None:
    write_json(folder / STABILITY_FILE, found.as_data())
    frozen = found.frozen
    factors = ["" for _ in frozen.times] if found.buckling is None else found.buckling.factors
    columns = {"time": frozen.times, "coordinate": frozen.coordinates, **_by_mode("frequency", frozen.frequencies)}
    _write_columns(folder / CYCLE_FILE, {**columns, "growth": frozen.growth, "buckling_factor": factors})
    swept = found.sweep
    if swept is not None:
        columns = {"speed": swept.speeds, "spectral_radius": swept.radii, "growth_rate": swept.growth_rates}
        columns["settled"] = swept.converged.astype(int)
        for key in ("lowest", "mean", "highest"):
            columns |= _by_mode(key, getattr(swept, key))
        _write_columns(folder / SPEEDS_FILE, columns)


def _by_mode(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{name}_{k}": column for k, column in enumerate(values.T, start=1)}


def _write_columns(path: Path, columns: Mapping[str, Sequence[object] | np.ndarray]) -> None:
    rows = zip(*columns.values(), strict=True)
    write_csv(path, list(columns), [dict(zip(columns, row, strict=True)) for row in rows])
