"""Commands ``show``, ``new``, ``linearise``, ``equations``, ``derive`` and ``export``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.cli.command import (
    check_file,
    check_picture,
    command,
    force_option,
    json_option,
    names_option,
    output_option,
    path_option,
    print_json,
)
from kaneflex.cli.scene import (
    SceneArguments,
    at_option,
    chosen_lines,
    configuration,
    demand_tolerance,
    gathered,
    read,
    refuse_with_tolerance,
    scene_options,
    tolerance_of,
    uncollected,
    undocumented,
)
from kaneflex.support.errors import OutputError, SceneError, counted
from kaneflex.support.files import file_stem, refuse_existing, whole_folder, write_bytes, write_text
from kaneflex.support.terminal import Waiting, echo

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kaneflex.report.presentation import Blocks
    from kaneflex.scene import Scene


@command()
@scene_options("preset", "settings")
@output_option("FILE.png", "Picture to write: .png, .svg or .pdf. [default: NAME.png]")
@click.option(
    "--at", "places", multiple=True, metavar="DRIVE=ANGLE",
    help="Coordinate of a drive, like main=30deg or bore=20mm; plain numbers are SI. Can be repeated. "
    "[default: as at the start of the run]",
)  # fmt: skip
@click.option("--branches", is_flag=True, help="Draw all ways in which the loops close, with the entry for each.")
@force_option
@json_option
@gathered(asked=SceneArguments)
@uncollected()
def show(
    asked: SceneArguments, output: Path | None, places: tuple[str, ...], branches: bool, force: bool, as_json: bool
) -> None:
    """Draw SCENE with its bodies, joints, drives, loads and sensors, and count its degrees of freedom.

    Nothing is derived or solved, so incomplete scenes can be drawn, too.

    \b
      kaneflex show press.toml --at main=30deg -o press.svg
    """
    undocumented()
    from kaneflex.plots.style import picture
    from kaneflex.report.presentation import as_json as blocks_as_json
    from kaneflex.report.presentation import parts, printed

    scene = asked.read()
    path = output or Path(f"{file_stem(scene.name)}.png")
    check_picture(path, force, "mechanism.png")
    at = dict(configuration(scene, text) for text in places)
    blocks, notes = parts(scene), list[str]()
    if branches and scene.is_spatial:
        raise click.UsageError("--branches draws mechanisms in the plane. Leave it out for one in space.")
    try:
        drawn = _in_space(scene, at, blocks) if scene.is_spatial else _in_plane(scene, at, blocks, notes)
        drawn = _all_branches(scene, at) if branches else drawn
    except SceneError:
        echo(printed(scene, blocks), err=as_json)  # what is known says why it can't be placed
        raise
    write_bytes(path, picture(drawn, path.suffix[1:]))
    echo(blocks_as_json(scene, blocks, warnings=[], notes=notes) if as_json else printed(scene, blocks))
    for note in notes:
        echo(f"Note: {note}", err=True)
    echo(f"Written to {path}", err=as_json)


def _in_plane(scene: Scene, at: Mapping[str, float], blocks: Blocks, notes: list[str]) -> Callable[[], Figure]:
    """Draw a planar mechanism; add its degrees of freedom, the ranges of its joints and notes."""
    from kaneflex.fem.freedom import count_freedom, mobility_by_rank
    from kaneflex.mechanism.closure import reach_lines
    from kaneflex.mechanism.closure_continuation import followed
    from kaneflex.mechanism.dead_centres import closings
    from kaneflex.mechanism.mechanism import mechanism_of
    from kaneflex.mechanism.position_analysis import place
    from kaneflex.mechanism.tight_start import as_it_starts
    from kaneflex.plots.scheme import scheme
    from kaneflex.report.presentation import closing_lines, mobility

    elastic, count = _elastic_count(scene), count_freedom(mechanism_of(scene))
    blocks |= mobility(count, elastic)
    scene = as_it_starts(scene)
    mechanism = mechanism_of(scene)
    placement = place(mechanism, at)
    here = {name: pose[:, None] for name, pose in placement.poses.items()}
    courses = here if at else followed(mechanism, placement)
    if not scene.is_frame:
        blocks |= mobility(count, elastic, mobility_by_rank(mechanism, courses))
        several = len(next(iter(courses.values()))[0]) > 1
        found = closings(mechanism, courses)
        blocks["over the run" if several else "as shown"] = reach_lines(mechanism, courses) | closing_lines(found)
        notes += [each.note for each in found if each.note]
    return lambda: scheme(scene, placement)


def _all_branches(scene: Scene, at: Mapping[str, float]) -> Callable[[], Figure]:
    """Picture of all closures of the loops of a mechanism in the plane."""
    from kaneflex.mechanism.mechanism import mechanism_of
    from kaneflex.mechanism.position_analysis import closures
    from kaneflex.mechanism.tight_start import as_it_starts
    from kaneflex.plots.scheme import branches

    scene = as_it_starts(scene)
    ways = closures(mechanism_of(scene), at)
    return lambda: branches(scene, ways)


def _elastic_count(scene: Scene) -> int | None:
    """Number of elastic coordinates; None where they can't be set up, with a warning if the preset needs them."""
    from kaneflex.fem.freedom import elastic_coordinates
    from kaneflex.mechanism.rigid_bodies import check_on_axes

    try:
        if scene.solve.preset == "coupled":  # the coupled equations cover all bodies and need no elastic stage
            check_on_axes(scene)
            with suppress(SceneError):
                return len(elastic_coordinates(scene))
            return None
        return len(elastic_coordinates(scene))
    except SceneError as error:
        echo(f"Warning: the elastic equations can't be set up: {error}", err=True)
        return None


def _in_space(scene: Scene, at: Mapping[str, float], blocks: Blocks) -> Callable[[], Figure]:
    """Picture of a mechanism in space as it starts; adds its freedoms."""
    from kaneflex.plots.scheme import refuse_places, scheme
    from kaneflex.report.presentation import spatial_mobility
    from kaneflex.solve.engine_loading import spatial_start

    refuse_places(at)
    system, start, motion = spatial_start(scene)
    blocks |= spatial_mobility(system, start.choice)
    return lambda: scheme(scene, motion)


@command()
@click.argument("name", metavar="NAME")
@click.option("--like", metavar="SCENE", help="Shipped scene to start from, see `kaneflex list`. [default: a template]")
@output_option("FILE.toml", "[default: NAME.toml]")
@click.option("--force", is_flag=True, help="Replace existing files.")
def new(name: str, like: str | None, output: Path | None, force: bool) -> None:
    """Write a commented scene to start from, and the CSV tables that it reads.

    \b
      kaneflex new press
      kaneflex new press --like four-bar
    """
    from kaneflex.scene.template import new_scene

    path = output or Path(f"{name}.toml")
    if path.suffix != ".toml":
        raise OutputError(str(path), None, "not the name of a scene file", "End it in .toml")
    for written in new_scene(name, like, path, force):
        echo(f"Written to {written}")


@command()
@scene_options("preset", "settings")
@at_option
@names_option("--sensors", help="Sensors as outputs. [default: all]")
@output_option("FILE", "File to write: .npz for NumPy, .mat for MATLAB or .mo for Modelica.", required=True)
@path_option("--bode", metavar="FILE.png", help="Draw the Bode plot (magnitude and phase) into this file.")
@force_option
@json_option
@gathered(asked=SceneArguments)
def linearise(
    asked: SceneArguments, at: str | None, sensors: tuple[str, ...], output: Path, bode: Path | None, force: bool,
    as_json: bool,
) -> None:  # fmt: skip
    """Write the elastic equations of SCENE at one instant as a state space.

    The file contains M, C_damping, K and A, B, C, D with the names of states, inputs (loads, accelerations of drives)
    and outputs (sensors).

    \b
      kaneflex linearise engine --at main=90deg -o engine.mat --bode bode.png
    """
    from kaneflex.report.tables import poles_table
    from kaneflex.solve.linearisation import available_sensors
    from kaneflex.solve.linearisation import linearise as state_space
    from kaneflex.solve.loading import load
    from kaneflex.solve.statespace import check_file_kind

    check_file_kind(output)
    refuse_existing(output, force, "engine.npz")
    if bode is not None:
        check_picture(bode, force, "engine-bode.png")
    scene = asked.read_at(at)
    with Waiting() as waiting:
        model = load(scene, waiting)
        system = state_space(model, sensors=sensors or None)
    drawn = None
    if bode is not None:
        from kaneflex.plots.bode import figure
        from kaneflex.plots.style import picture
        from kaneflex.support.escaping import picture_text

        at = model.reference_position
        title = f"{picture_text(scene.name)}: frequency response{' at ' if at else ''}{at}"
        drawn = picture(lambda: figure(system, title), bode.suffix[1:])
    system.save(output)
    if bode is not None and drawn is not None:
        write_bytes(bode, drawn)
    names = {"states": system.states, "inputs": system.inputs, "outputs": system.outputs}
    if as_json:
        poles = [{"real": pole.real, "imag": pole.imag} for pole in system.poles.tolist()]
        print_json({"scene": scene.name, "poles": poles, **{key: list(value) for key, value in names.items()}})
    else:
        echo(poles_table(system))
        echo(", ".join(counted(len(found), kind[:-1]) for kind, found in names.items()))
    left_out = [sensor for sensor in scene.sensors if sensor not in available_sensors(model)]
    if left_out and not sensors:
        echo(f"Warning: sensors left out, since frozen matrices do not define them: {', '.join(left_out)}", err=True)
    echo(f"Written to {output}" + (f" and {bode}" if bode is not None else ""), err=as_json)


@command()
@scene_options("preset", "settings")
@output_option("FILE.tex", "File to write. [default: printed]")
@force_option
@gathered(asked=SceneArguments)
def equations(asked: SceneArguments, output: Path | None, force: bool) -> None:
    """Print the equations of SCENE as a LaTeX document: the rigid motion and the matrices of an element.

    `kaneflex derive` writes the same equations as Python or C.

    \b
      kaneflex equations engine -o engine.tex
    """
    from kaneflex.export.code import equations as latex

    if output is not None:
        refuse_existing(output, force, "engine.tex")
    with Waiting() as waiting:
        text = latex(asked.read(), waiting)
    if output is None:
        echo(text, nl=False)
    else:
        write_text(output, text)
        echo(f"Written to {output}")


@command()
@scene_options("preset", "settings")
@output_option("FILE.py", "Module to write; with --language c the folder to make.", required=True)
@click.option(
    "--language", type=click.Choice(["python", "c"]), default="python", show_default=True,
    help="c: a folder of portable C11 without allocation, which can also run the scene without Python.",
)  # fmt: skip
@click.option(
    "--standalone", is_flag=True,
    help="Write the whole model (matrices, modes, sensors) into one file that needs only numpy.",
)  # fmt: skip
@click.option(
    "--tolerance", metavar="SHARE", help="Write only the terms that `kaneflex run --tolerance` keeps, like 1%."
)
@names_option("--sensors", help="With --tolerance: sensors that must meet it. [default: all]")
@force_option
@gathered(asked=SceneArguments)
def derive(
    asked: SceneArguments, output: Path, language: str, standalone: bool, tolerance: str | None,
    sensors: tuple[str, ...], force: bool,
) -> None:  # fmt: skip
    """Derive the equations of SCENE and write them as a numba module or as C code.

    The module imports only math, numpy and numba; the same scene gives the same bytes everywhere. It contains no
    numbers of the scene, so settings matter only if they change the equations, such as joints or the preset.

    \b
      kaneflex derive engine -o engine.py
      kaneflex derive engine --preset coupled -o engine_coupled.py
      kaneflex derive engine --language c -o engine-c
      kaneflex derive engine --standalone -o engine_model.py
    """
    from kaneflex.export.code import derive_code
    from kaneflex.scene.structure import structure_hash

    _refuse_others("--language c", {"--standalone": standalone} if language == "c" else {})
    if language == "c" or standalone:
        form = "--language c" if language == "c" else "--standalone"
        _refuse_others(form, {"--tolerance": tolerance, "--sensors": sensors})
    if language == "c":
        if output.suffix in (".c", ".h"):
            raise OutputError(str(output), None, "C code is several files", "Give the name of a folder")
        with whole_folder(output, mark="CMakeLists.txt", force=force) as partial, Waiting() as waiting:
            for file, content in derive_code(asked.read(), "c", waiting).items():
                (partial / file).write_text(content, encoding="utf-8", newline="\n")
        echo(f"Written to {output}")
        return
    check_file(output, "a Python module", ".py", force, "" if standalone else ", or use --language c")
    refuse_with_tolerance(tolerance, {"--preset": asked.preset})
    demand_tolerance(tolerance, {"--sensors": ",".join(sensors)})
    if tolerance is not None:
        _derive_chosen(asked, output, tolerance_of(tolerance), sensors)
        return
    scene = asked.read()
    with Waiting() as waiting:
        text = derive_code(scene, "standalone" if standalone else "module", waiting)
    write_text(output, text)
    plain = not standalone and scene.solve.preset != "coupled"
    if asked.settings and plain and structure_hash(scene) == structure_hash(read(asked.name, [])):
        echo("Note: the module contains no numbers of the scene, so --set has no effect", err=True)
    echo(f"{counted(text.count(chr(10)), 'line')} written to {output}" if standalone else f"Written to {output}")


def _refuse_others(asked: str, others: Mapping[str, object]) -> None:
    """Raise UsageError for options that the requested form excludes."""
    given = [option for option, value in others.items() if value]
    if given:
        raise click.UsageError(f"{given[0]} cannot be combined with {asked}.")


def _derive_chosen(asked: SceneArguments, output: Path, tolerance: float, sensors: tuple[str, ...]) -> None:
    """Module with only the terms of the model that a tolerance chooses."""
    from kaneflex.export.code import derive_code
    from kaneflex.multibody.model.module_loading import operation_count
    from kaneflex.scene import with_settings
    from kaneflex.study.trade.choice import remembered_choice

    scene = asked.read()
    with Waiting() as waiting:
        choice, _ = remembered_choice(scene, tolerance, sensors or None, waiting, "code")
        whole = derive_code(scene, "module", waiting)
        text = derive_code(with_settings(scene, choice.settings), "pruned", waiting)
    write_text(output, text)
    echo(chosen_lines(choice))
    counts = f"{operation_count(text)} operations, {operation_count(whole)} with every term"
    echo(f"Kernels of the motion and one element: {counts}")
    echo(f"Written to {output}")


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
