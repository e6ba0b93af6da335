"""Commands around a mechanism: draw it, start a new one, take its state space, its equations and its module out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.cli.choosing import chosen_lines, demand_tolerance, refuse_with_tolerance, tolerance_of
from kaneflex.cli.command import command, json_option, names_option, print_json
from kaneflex.cli.folders import check_file, check_picture, force_option, output_option, path_option
from kaneflex.cli.scene import SceneArguments, at_option, configuration, gathered, read, scene_options, uncollected
from kaneflex.support.atomic_output import refuse_existing, write_bytes, write_text
from kaneflex.support.errors import OutputError, SceneError
from kaneflex.support.output_folders import file_stem, whole_folder
from kaneflex.support.terminal import Waiting, echo

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kaneflex.report.presentation import Blocks
    from kaneflex.scene import Scene
    from kaneflex.solve.statespace import StateSpace


@command()
@scene_options("preset", "settings")
@output_option("FILE.png", "Picture to write: .png, .svg or .pdf. [default: NAME.png]")
@click.option(
    "--at", "places", multiple=True, metavar="DRIVE=ANGLE",
    help="Place, like main=30deg or bore=20mm; plain numbers are SI. Can be repeated. [default: as the run starts]",
)  # fmt: skip
@force_option
@json_option
@gathered(asked=SceneArguments)
@uncollected()
def show(asked: SceneArguments, output: Path | None, places: tuple[str, ...], force: bool, as_json: bool) -> None:
    """Draw SCENE with its bodies, joints, drives, loads and sensors, and count its degrees of freedom.

    Nothing is derived or solved, so that a scene that cannot run yet can be drawn.

    \b
      kaneflex show press.toml --at main=30deg -o press.svg
    """
    from kaneflex.plots.style import picture
    from kaneflex.report.presentation import as_json as blocks_as_json
    from kaneflex.report.presentation import parts, printed

    scene = asked.read()
    path = output or Path(f"{file_stem(scene.name)}.png")
    check_picture(path, force, "mechanism.png")
    at = dict(configuration(scene, text) for text in places)
    blocks, notes = parts(scene), list[str]()
    try:
        drawn = _in_space(scene, at, blocks) if scene.is_spatial else _in_plane(scene, at, blocks, notes)
    except SceneError:
        echo(printed(scene, blocks), err=as_json)  # what is known says why it can't be placed
        raise
    write_bytes(path, picture(drawn, path.suffix[1:]))
    echo(blocks_as_json(scene, blocks, warnings=[], notes=notes) if as_json else printed(scene, blocks))
    for note in notes:
        echo(f"Note: {note}", err=True)
    echo(f"Written to {path}", err=as_json)


def _in_plane(scene: Scene, at: Mapping[str, float], blocks: Blocks, notes: list[str]) -> Callable[[], Figure]:
    """Picture of a mechanism in the plane; adds its freedoms and the range of its joints, and notes."""
    from kaneflex.fem.mobility import count_freedom, mobility_by_rank
    from kaneflex.mechanism.dead_centres import closings
    from kaneflex.mechanism.mechanism import mechanism_of
    from kaneflex.mechanism.position_analysis import place
    from kaneflex.mechanism.reach import followed, reach_lines
    from kaneflex.mechanism.tight_start import as_it_starts
    from kaneflex.plots.scheme import scheme
    from kaneflex.report.presentation import closing_lines, mobility

    elastic, count = _elastic_count(scene), count_freedom(mechanism_of(scene))
    blocks |= mobility(count, elastic)
    scene = as_it_starts(scene)
    placement = place(scene, at)
    here = {name: pose[:, None] for name, pose in placement.poses.items()}
    courses = here if at else followed(scene, placement)
    if not scene.is_frame:
        blocks |= mobility(count, elastic, mobility_by_rank(mechanism_of(scene), courses))
        several = len(next(iter(courses.values()))[0]) > 1
        found = closings(scene, courses)
        blocks["over the run" if several else "where it is shown"] = reach_lines(scene, courses) | closing_lines(found)
        notes += [each.note for each in found if each.note]
    return lambda: scheme(scene, placement)


def _elastic_count(scene: Scene) -> int | None:
    """Coordinates of the elastic stage; None where it can't be set up, with a warning where the preset needs it."""
    from kaneflex.fem.mobility import elastic_coordinates
    from kaneflex.mechanism.rigid_bodies import check_on_axes

    try:
        if scene.solve.preset == "coupled":  # its equations are of all bodies, and ask for no more than this
            check_on_axes(scene)
            with suppress(SceneError):
                return len(elastic_coordinates(scene))
            return None
        return len(elastic_coordinates(scene))
    except SceneError as error:
        echo(f"Warning: the elastic part can't be set up: {error}", err=True)
        return None


def _in_space(scene: Scene, at: Mapping[str, float], blocks: Blocks) -> Callable[[], Figure]:
    """Picture of a mechanism in space as it starts; adds its freedoms."""
    from kaneflex.plots.spatial import refuse_places, scheme
    from kaneflex.report.presentation import spatial_mobility
    from kaneflex.solve.spatial_loading import spatial_start

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
    """Write a commented scene of your own to start from, with the tables that it reads beside it.

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


@command(renamed={"--sensor": "--sensors"})
@scene_options("preset", "settings")
@at_option
@names_option("--sensors", help="Outputs. [default: all]")
@output_option("FILE", "File to write: .npz for NumPy, .mat for MATLAB or .mo for Modelica.", required=True)
@path_option("--bode", metavar="FILE.png", help="Draw magnitudes and phases over the frequency.")
@force_option
@json_option
@gathered(asked=SceneArguments)
def linearise(
    asked: SceneArguments, at: str | None, sensors: tuple[str, ...], output: Path, bode: Path | None, force: bool,
    as_json: bool,
) -> None:  # fmt: skip
    """Write the elastic equations of SCENE at one instant as a state space.

    The file holds M, C_damping, K and A, B, C, D with the names of states, inputs (loads, accelerations of drives) and
    outputs (sensors).

    \b
      kaneflex linearise engine --at main=90deg -o engine.mat --bode bode.png
    """
    from kaneflex.report.tables import poles_table
    from kaneflex.solve.loading import load
    from kaneflex.solve.statespace import available_sensors, check_file_kind
    from kaneflex.solve.statespace import linearise as state_space

    check_file_kind(output)
    refuse_existing(output, force, "engine.npz")
    if bode is not None:
        check_picture(bode, force, "engine-bode.png")
    scene = asked.read_at(at)
    with Waiting() as waiting:
        model = load(scene, waiting)
        system = state_space(model, sensors=sensors or None)
    drawn = None if bode is None else _bode(system, bode.suffix[1:])
    system.save(output)
    if bode is not None and drawn is not None:
        write_bytes(bode, drawn)
    if as_json:
        poles = [{"real": pole.real, "imag": pole.imag} for pole in system.poles.tolist()]
        names = {"states": system.states, "inputs": system.inputs, "outputs": system.outputs}
        print_json({"scene": scene.name, "poles": poles, **{key: list(value) for key, value in names.items()}})
    else:
        echo(poles_table(system))
        echo(f"{len(system.states)} states, {len(system.inputs)} inputs, {len(system.outputs)} outputs")
    left_out = [sensor for sensor in scene.sensors if sensor not in available_sensors(model)]
    if left_out and not sensors:
        echo(f"Warning: left out, as frozen matrices say nothing of them: {', '.join(left_out)}", err=True)
    echo(f"Written to {output}" + (f" and {bode}" if bode is not None else ""), err=as_json)


def _bode(system: StateSpace, kind: str) -> bytes:
    from kaneflex.plots.bode import figure
    from kaneflex.plots.style import picture

    return picture(lambda: figure(system), kind)


@command()
@scene_options("preset", "settings")
@click.option("--latex", is_flag=True, expose_value=False, hidden=True)  # the only form, once had to be said
@output_option("FILE.tex", "File to write. [default: printed]")
@force_option
@gathered(asked=SceneArguments)
def equations(asked: SceneArguments, output: Path | None, force: bool) -> None:
    """Print the equations of SCENE as a LaTeX document: the programs of its module and the element's matrices.

    `kaneflex derive` writes the same equations as Python or C.

    \b
      kaneflex equations engine -o engine.tex
    """
    from kaneflex.scene.spatial_check import refuse_in_space

    if output is not None:
        refuse_existing(output, force, "engine.tex")
    scene = asked.read()
    refuse_in_space(scene, "equations", "equations are printed of")
    with Waiting() as waiting:
        waiting.stage("importing SymPy")
        from kaneflex.derive.latex import latex
        from kaneflex.multibody.binding import derivable

        with derivable(scene):
            text = latex(scene, waiting)
    if output is None:
        echo(text, nl=False)
    else:
        write_text(output, text)
        echo(f"Written to {output}")


@dataclass(frozen=True)
class Form:
    """What ``derive`` writes of a scene."""

    language: str
    standalone: bool
    coupled: bool


@command(renamed={"--sensor": "--sensors"})
@click.argument("name", metavar="SCENE")
@output_option("FILE.py", "Module to write; the folder to make with --language c.", required=True)
@click.option(
    "--language", type=click.Choice(["python", "c"]), default="python", show_default=True,
    help="c: a folder of portable C11 without allocation, which makes the run without Python, too.",
)  # fmt: skip
@click.option(
    "--standalone", is_flag=True,
    help="The whole model in one readable file that runs with numpy and numba alone: matrices, modes, sensors.",
)  # fmt: skip
@click.option("--coupled", is_flag=True, help="The equations of preset coupled instead.")
@click.option(
    "--tolerance", metavar="SHARE", help="Only the terms of the model that `kaneflex run --tolerance` chooses, like 1%."
)
@names_option("--sensors", help="With --tolerance: only these count.")
@click.option(
    "--set", "changes", multiple=True, metavar="KEY=VALUE",
    help="With --language c or --standalone: change the scene, as run does. Can be repeated.",
)  # fmt: skip
@force_option
@gathered(form=Form)
def derive(
    name: str, output: Path, form: Form, tolerance: str | None, sensors: tuple[str, ...], changes: tuple[str, ...],
    force: bool,
) -> None:  # fmt: skip
    """Derive the equations of SCENE and write them as a numba module of its own, or as C.

    The module imports only math, numpy and numba; the same scene gives the same bytes everywhere.

    \b
      kaneflex derive engine -o engine.py
      kaneflex derive engine --language c -o engine-c
      kaneflex derive engine --standalone -o engine_model.py
    """
    others = {"--coupled": form.coupled, "--tolerance": tolerance, "--sensors": sensors}
    if form.language == "c":
        _derive_c(name, output, {"--standalone": form.standalone, **others}, changes, force)
        return
    if form.standalone:
        _derive_standalone(name, output, others, changes, force)
        return
    if changes:
        reason = "a plain Python module holds no numbers of the scene"
        raise click.UsageError(f"--set goes with --language c or --standalone: {reason}.")
    _derive_module(name, output, form.coupled, tolerance, sensors, force)


def _derive_module(
    name: str, output: Path, coupled: bool, tolerance: str | None, sensors: tuple[str, ...], force: bool
) -> None:
    """The module of a scene's structure, perhaps of the terms that a tolerance keeps."""
    from kaneflex.mechanism.floating_frames import shape_counts
    from kaneflex.scene import with_settings

    check_file(output, "a Python module", ".py", force, ", or take --language c")
    refuse_with_tolerance(tolerance, {"--coupled": coupled or None})
    demand_tolerance(tolerance, {"--sensors": ",".join(sensors)})
    scene, choice, whole = read(name, []), None, ""
    with Waiting() as waiting:
        if tolerance is not None:
            from kaneflex.study.trade.choice import remembered_choice

            choice = remembered_choice(scene, tolerance_of(tolerance), sensors or None, waiting)
        waiting.stage("importing SymPy")
        from kaneflex.multibody.binding import coupled_text, generate_text, operation_count, pruned_text

        if choice is not None:
            whole = generate_text(scene, waiting)
            text = pruned_text(with_settings(scene, choice.settings), waiting)
        else:
            text = coupled_text(scene, shape_counts(scene)) if coupled else generate_text(scene, waiting)
    write_text(output, text)
    if choice is not None:
        echo(chosen_lines(choice))
        echo(f"{operation_count(text)} operations, of {operation_count(whole)} with every term")
    echo(f"Written to {output}")


def _derive_standalone(
    name: str, output: Path, others: Mapping[str, object], changes: tuple[str, ...], force: bool
) -> None:
    """The model of a scene in one file."""
    from kaneflex.solve.standalone import standalone

    _refuse_others("--standalone", others)
    check_file(output, "a Python module", ".py", force)
    with Waiting() as waiting:
        text = standalone(read(name, list(changes)), waiting)
    write_text(output, text)
    echo(f"{text.count(chr(10))} lines written to {output}")


def _refuse_others(asked: str, others: Mapping[str, object]) -> None:
    """Options that don't go with the form that is asked for."""
    given = [option for option, value in others.items() if value]
    if given:
        raise click.UsageError(f"{given[0]} does not go with {asked}.")


def _derive_c(
    name: str, output: Path, others: Mapping[str, object], changes: tuple[str, ...], force: bool
) -> None:
    """A folder of C, whole or not at all."""
    from kaneflex.scene.options import resolve_options
    from kaneflex.solve.c_model import c_model
    from kaneflex.solve.coupled_in_c import coupled_in_c

    _refuse_others("--language c", others)
    scene = read(name, list(changes))
    with whole_folder(output, mark="CMakeLists.txt", force=force) as partial, Waiting() as waiting:
        coupled = resolve_options(scene).dynamics == "coupled"
        texts = coupled_in_c(scene, waiting) if coupled else c_model(scene, waiting).texts
        for file, text in texts.items():
            (partial / file).write_text(text, encoding="utf-8", newline="\n")
    echo(f"Written to {output}")
