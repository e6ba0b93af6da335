"""Command ``explore``: a window with sliders for a scene's numbers."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from kaneflex.cli.command import check_picture, command, force_option, names_option, output_option
from kaneflex.cli.scene import (
    Choosing,
    SceneArguments,
    chosen_settings,
    gathered,
    refuse_with_tolerance,
    scene_options,
    tolerance_option,
)
from kaneflex.support.files import write_bytes
from kaneflex.support.terminal import echo


@command()
@scene_options()
@click.option(
    "--vary", "open_", multiple=True, metavar="PATH=LOW:HIGH",
    help="A slider for this entry of the scene, like main.speed=2000:6000rpm or rod.elements=1:8; "
    "limits without a decimal point or a unit give whole numbers. Can be repeated.",
)  # fmt: skip
@names_option("--sensors", help="Sensors to show and choose by. [default: the first four groups of similar sensors]")
@tolerance_option
@output_option("FILE.png", "Write a picture (.png, .svg or .pdf) instead of opening a window.")
@force_option
@gathered(asked=SceneArguments)
def explore(
    asked: SceneArguments, open_: tuple[str, ...], sensors: tuple[str, ...], output: Path | None, force: bool,
    tolerance: str | None,
) -> None:  # fmt: skip
    """Open a window with sliders for some numbers of SCENE and the resulting curves of its sensors.

    Each curve is the result of `kaneflex run` for the sliders' values; the pale curve is the unchanged scene. If a run
    is not possible, the window shows the reason. When the window closes, the sliders' values are printed as a command.
    With --tolerance it is the fastest model that is within it at the start and at both ends of all sliders.

    \b
      kaneflex explore engine --vary main.speed=2000:9000rpm
    """
    from kaneflex.plots import explore as open_window
    from kaneflex.scene import with_settings
    from kaneflex.study.exploration import Exploration, varied

    scene, chosen = asked.read(), list[str]()
    refuse_with_tolerance(tolerance, {"--preset": asked.preset, "--integrator": asked.integrator})
    if tolerance is not None:
        exploration = Exploration(scene, tuple(varied(scene, text) for text in open_), sensors)
        ends = [[getattr(each, end) for each in exploration.open] for end in ("start", "low", "high")]
        scenes, paths = [exploration.at(values) for values in ends], [each.path for each in exploration.open]
        where = "the start and the ends of the sliders"
        chosen = chosen_settings(Choosing(tolerance, sensors), scenes, "--vary", paths, where)
        scene = with_settings(scene, chosen)
    if output is not None:
        check_picture(output, force, "explored.png")
        from kaneflex.plots.style import picture

        write_bytes(output, picture(lambda: open_window(scene, open_, sensors, window=False), output.suffix[1:]))
        echo(f"Written to {output}")
        return
    changes = [*asked.changes, *chosen, *open_window(scene, open_, sensors)]
    words = ["kaneflex", "run", asked.name, *(word for change in changes for word in ("--set", change))]
    echo(f"Slider values as a command: {shlex.join(words)}")
