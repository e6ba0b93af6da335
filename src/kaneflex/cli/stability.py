"""The command that judges the stability of a scene's periodic equations."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.cli.mechanism import preset_option, set_option
from kaneflex.cli.scene import all_settings, read
from kaneflex.support.errors import Fault, SceneError
from kaneflex.support.output_folders import file_stem

if TYPE_CHECKING:
    from kaneflex.scene import Scene
    from kaneflex.stability.report import Stability

STABILITY_FILE, CYCLE_FILE, SPEEDS_FILE = "stability.json", "cycle.csv", "speeds.csv"


@click.command()
@click.argument("name", metavar="SCENE")
@preset_option
@set_option
@click.option(
    "--speed", metavar="LOW:HIGH",
    help="Speeds of the first drive to go through, like 0:12000rpm; plain numbers are SI.",
)  # fmt: skip
@click.option("--points", type=click.IntRange(min=2), default=41, show_default=True, help="How many speeds.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder to make. [default: NAME-stability]"
)
@click.option("--plots/--no-plots", default=True, help="Draw the pictures, PNG and SVG.", show_default=True)
@click.option("--force", is_flag=True, help="Replace an earlier folder.")
def stability(
    name: str, preset: str | None, settings: tuple[str, ...], speed: str | None, points: int, output: Path | None,
    plots: bool, force: bool,
) -> None:  # fmt: skip
    """Judge the stability of SCENE's periodic motion and say a sentence on each finding.

    Floquet multipliers, frozen frequencies over the cycle, buckling, the largest stable step of each integrator,
    conditioning; with --speed also unstable bands and Campbell's diagram. The folder holds stability.json, cycle.csv,
    speeds.csv and a picture.
    """
    from kaneflex.report.presentation import block
    from kaneflex.stability.report import judge
    from kaneflex.stability.sweep import check_sweep, speeds_between
    from kaneflex.support.output_folders import whole_folder, writing
    from kaneflex.support.terminal import Waiting

    scene = read(name, all_settings(preset, settings))
    speeds = None
    if speed is not None:
        speeds = speeds_between(*speed_range(scene, check_sweep(scene), speed), points)
    folder = output or Path(f"{file_stem(scene.name)}-stability")
    with whole_folder(folder, mark=STABILITY_FILE, force=force) as partial, Waiting() as waiting:
        found = judge(scene, speeds, waiting.stage)
        waiting.stage("writing")
        with writing(folder):
            _write(found, partial)
            if plots:
                from kaneflex.plots.stability import draw_stability

                draw_stability(found, partial)
    click.echo(block("stability", found.findings))
    click.echo(f"Written to {folder}")


def speed_range(scene: Scene, drive: str, text: str) -> tuple[float, float]:
    """LOW and HIGH of "LOW:HIGH" in rad/s, or m/s of a guide; a unit at HIGH is LOW's, too, where that has none.

    Raises SceneError for anything else than two rising speeds from zero on.
    """
    from kaneflex.support.units import ANGULAR_SPEED, SPEED, to_si

    low, colon, high = (part.strip() for part in text.partition(":"))
    unit = re.search(r"[^\d.eE+\-\s].*$", high)
    if unit is not None and re.search(r"[^\d.eE+\-\s]", low) is None:
        low = f"{low} {unit[0]}"
    cure = "Write like 0:12000rpm"
    if not colon:
        raise SceneError("--speed", text, "not of the form LOW:HIGH", cure)
    dimension = SPEED if scene.slides(drive) else ANGULAR_SPEED
    try:
        ends = [to_si(_number(part), dimension) for part in (low, high)]
    except Fault as fault:
        raise SceneError("--speed", text, fault.reason, fault.cure) from None
    if not 0.0 <= ends[0] < ends[1]:
        raise SceneError("--speed", text, "not two rising speeds from zero on", cure)
    return ends[0], ends[1]


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _write(found: Stability, folder: Path) -> None:
    text = json.dumps(found.as_data(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    (folder / STABILITY_FILE).write_text(text, encoding="utf-8", newline="\n")
    frozen = found.frozen
    modes = range(1, frozen.frequencies.shape[1] + 1)
    factors = ["" for _ in frozen.times] if found.buckling is None else found.buckling.factors
    head = ["time", "coordinate", *(f"frequency_{k}" for k in modes), "growth", "buckling_factor"]
    columns = [frozen.times, frozen.coordinates, *frozen.frequencies.T, frozen.growth, factors]
    _write_csv(folder / CYCLE_FILE, head, columns)
    swept = found.sweep
    if swept is not None:
        modes = range(1, swept.mean.shape[1] + 1)
        head = ["speed", "spectral_radius", "growth_rate", "settled"]
        columns = [swept.speeds, swept.radii, swept.growth_rates, swept.converged.astype(int)]
        for key in ("lowest", "mean", "highest"):
            head += [f"{key}_{k}" for k in modes]
            columns += [*getattr(swept, key).T]
        _write_csv(folder / SPEEDS_FILE, head, columns)


def _write_csv(path: Path, head: Sequence[str], columns: Sequence[Sequence[object]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(zip(*columns, strict=True))
