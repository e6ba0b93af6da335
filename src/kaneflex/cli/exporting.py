"""Command ``export``: a scene as a Functional Mock-up Unit."""

from __future__ import annotations

from pathlib import Path

from kaneflex.cli.command import check_file, command, force_option, output_option
from kaneflex.cli.scene import SceneArguments, gathered, scene_options
from kaneflex.support.errors import counted
from kaneflex.support.terminal import Waiting, echo


@command()
@scene_options("preset", "settings")
@output_option("FILE.fmu", required=True)
@force_option
@gathered(asked=SceneArguments)
def export(asked: SceneArguments, output: Path, force: bool) -> None:
    """Write the linear equations of SCENE as an FMU for model exchange and co-simulation.

    Outputs are the sensors, inputs the values of constant loads, parameters the speeds and angles of drives. The FMU
    contains its C sources; a C compiler (environment variable CC selects it) builds the library for this machine.

    \b
      kaneflex export engine -o engine.fmu
    """
    from kaneflex.export.fmu import export_fmu

    check_file(output, "an FMU", ".fmu", force)
    scene = asked.read()
    with Waiting() as waiting:
        made = export_fmu(scene, waiting)
    made.save(output)
    echo(f"FMI 2.0, {counted(len(made.outputs), 'output')}; can be set: {', '.join(made.inputs) or 'nothing'}")
    for warning in made.warnings:
        echo(f"Warning: {warning}", err=True)
    echo(f"Written to {output}")
