"""Command ``import``: a body's finite elements from another program as modal data."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import click

from kaneflex.cli.command import Count, Real, check_file, command, force_option, json_option, output_option, print_json
from kaneflex.fem.imported.import_mesh import UNITS
from kaneflex.support.errors import Fault, ValidityWarning, naming
from kaneflex.support.terminal import echo
from kaneflex.support.units import plain_number


def _named(option: str, given: tuple[str, ...], example: str) -> dict[str, str]:
    """Values by name of the texts NAME=VALUE; each name may occur once."""
    found: dict[str, str] = {}
    for text in given:
        name, equal, value = text.partition("=")
        if not equal or not value:
            raise Fault(f"{option} {text!r} is not of the form NAME=VALUE", f"Write it like {option} {example}")
        if name in found:
            raise Fault(f"{option} gives {name} twice", "Give each a different name")
        found[name] = value
    return found


def _number(section: str, text: str) -> float:
    number = plain_number(text)
    if number is None:
        cure = "Write a number, like --section waist=68.5, in the unit of length of the files"
        raise Fault(f"section {section} = {text!r} is not a distance from the start", cure)
    return number


@command(name="import")
@click.argument("mass", metavar="MASS")
@click.argument("stiffness", metavar="STIFFNESS")
@click.argument("nodes", metavar="NODES")
@click.option(
    "--point", "points", multiple=True, required=True, metavar="NAME=FILE",
    help="File with the nodes of a point: start=bore.txt. Give start and end; can be repeated.",
)  # fmt: skip
@click.option(
    "--section", "sections", multiple=True, metavar="NAME=DISTANCE",
    help="Point for sensors of section forces, with its distance from the start in the unit of the files. "
    "The point mid always exists. Can be repeated.",
)  # fmt: skip
@click.option(
    "--stress", nargs=2, metavar="MATRIX NAMES",
    help="Stress recovery: Matrix Market file with six rows for each place (xx, yy, zz, xy, yz, zx), and text file "
    "with the names of the places.",
)  # fmt: skip
@click.option("--modes", type=Count(1, 50), default=4, show_default=True,
              help="Number of modes with all points held (without --space: of bending modes).")  # fmt: skip
@click.option(
    "--coupling", type=click.Choice(["rigid", "averaged"]), default="rigid", show_default=True,
    help="rigid: the nodes of a point move as a rigid body; averaged: the point follows their mean.",
)  # fmt: skip
@click.option("--units", type=click.Choice(list(UNITS)), default="m-kg", show_default=True, help="Units of the files.")
@click.option(
    "--normal", nargs=3, type=Real(), default=(0.0, 0.0, 1.0), metavar="X Y Z",
    help="Normal of the plane of motion; with --space, direction of the body's z axis. [default: 0 0 1]",
)  # fmt: skip
@click.option("--space", is_flag=True, help="Import for scenes in space; the body needs no mirror plane.")
@click.option("--damping", type=Real(0.0, 1.0), default=0.0, help="Damping ratio of every mode of the free link.")
@output_option("FILE.npz", required=True)
@force_option
@json_option
def import_link(
    points: tuple[str, ...], sections: tuple[str, ...], output: Path, force: bool, as_json: bool, **asked: Any
) -> None:
    """Write modal data of a body from the finite elements of another program.

    MASS and STIFFNESS are matrices of the free body: two or three translations of each node, with --space also
    rotations. Formats are Matrix Market, Abaqus .mtx, CalculiX .mas and .sti, Nastran .op4 and .pch (pip install
    "kaneflex[nastran]"). NODES is a text file with the number and the coordinates of each node, or an input file of
    Abaqus or CalculiX (.inp). Use the written file as modal_data of a body under preset coupled.

    \b
      kaneflex import rod.mas rod.sti rod.inp --point start=bore.txt --point end=pin.txt -o rod.npz
    """
    from kaneflex.fem.imported.import_mesh import import_mesh
    from kaneflex.report.tables import imported_shapes, imported_table

    check_file(output, "a file of arrays", ".npz", force)
    with naming("import", None):
        asked["points"] = _named("--point", points, "start=bore.txt")
        cut = {name: _number(name, x) for name, x in _named("--section", sections, "waist=68.5").items()}
    with warnings.catch_warnings(record=True) as doubts:
        warnings.simplefilter("always", ValidityWarning)
        data = import_mesh(**asked, sections=cut)
    data.save(output)
    for doubt in doubts:
        echo(f"Warning: {doubt.message}", err=True)
    if as_json:
        mass, centre, inertia = data.rigid
        body = {"length": data.length, "mass": mass, "centre": centre, "inertia": inertia}
        print_json({**body, "frequencies_hz": imported_shapes(data)[1]})
    else:
        echo(imported_table(data))
    echo(f"Written to {output}", err=as_json)
