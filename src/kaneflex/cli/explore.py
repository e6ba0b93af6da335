"""Command ``explore``: a window with sliders for a scene's numbers."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from kaneflex.cli.command import check_picture, command, force_option, names_option, output_option
from kaneflex.cli.scene import SceneArguments, gathered, scene_options
from kaneflex.support.atomic_output import write_bytes
from kaneflex.support.terminal import echo


@command()
@scene_options()
@click.option(
    "--vary", "open_", multiple=True, metavar="PATH=LOW:HIGH",
    help="A slider for this entry of the scene, like main.speed=2000:6000rpm or rod.elements=1:8; "
    "limits without a decimal point or a unit give whole numbers. Can be repeated.",
)  # fmt: skip
@names_option("--sensors", help="Sensors to show. [default: the first four groups of similar sensors]")
@output_option("FILE.png", "Write a picture (.png, .svg or .pdf) instead of opening a window.")
@force_option
@gathered(asked=SceneArguments)
def explore(
    asked: SceneArguments, open_: tuple[str, ...], sensors: tuple[str, ...], output: Path | None, force: bool
) -> None:
    """Open a window with sliders for some numbers of SCENE and the resulting curves of its sensors.

    Each curve is the result of `kaneflex run` for the sliders' values; the pale curve is the unchanged scene. If a run
    is not possible, the window shows the reason. When the window closes, the sliders' values are printed as a command.

    \b
      kaneflex explore engine --vary main.speed=2000:9000rpm
    """
    from kaneflex.plots import explore as open_window

    scene = asked.read()
    if output is not None:
        check_picture(output, force, "explored.png")
        from kaneflex.plots.style import picture

        write_bytes(output, picture(lambda: open_window(scene, open_, sensors, window=False), output.suffix[1:]))
        echo(f"Written to {output}")
        return
    changes = [*asked.changes, *open_window(scene, open_, sensors)]
    words = ["kaneflex", "run", asked.name, *(word for change in changes for word in ("--set", change))]
    echo(f"Slider values as a command: {shlex.join(words)}")
