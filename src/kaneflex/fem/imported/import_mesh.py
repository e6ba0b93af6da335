"""Modal data of a body from the finite elements of another program."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, TypedDict, Unpack

from kaneflex.support.arguments import takes
from kaneflex.support.errors import Fault, ValidityWarning, naming, nearest

if TYPE_CHECKING:
    from kaneflex.fem.imported.elements import ImportedMesh
    from kaneflex.scene.modal_data import ModalData

    Path = str | os.PathLike[str]

UNITS = {"m-kg": (1.0, 1.0), "mm-t": (1e-3, 1e3), "mm-kg": (1e-3, 1.0)}
"""Units of length [m] and mass [kg] of a file; that of stiffness is the mass unit over s^2, so N/mm with mm-t."""


class MeshOptions(TypedDict, total=False):
    """Options of :func:`import_mesh`.

    Attributes
    ----------
    sections : mapping of str to float
        Points on the mean line where section forces are known, by their distance from the start in the files' unit.
    stress : pair of path
        Matrix Market file of stresses by displacements, and a text file with the names of their places.
    units : {"m-kg", "mm-t", "mm-kg"}
        Units of length and mass of the files.
    normal : triple of float
        Normal of the plane of motion; in space the body's z axis.
    space : bool
        Whether the body moves in space.
    """

    sections: Mapping[str, float]
    stress: tuple[Path, Path] | None
    units: Literal["m-kg", "mm-t", "mm-kg"]
    normal: tuple[float, float, float]
    space: bool


@takes(mass="path", stiffness="path", nodes="path", points="points", modes="whole", coupling="text", damping="number")
def import_mesh(
    mass: Path, stiffness: Path, nodes: Path, points: Mapping[str, Path], modes: int = 4,
    coupling: Literal["rigid", "averaged"] = "rigid", damping: float = 0.0, **options: Unpack[MeshOptions],
) -> ModalData:  # fmt: skip
    """Modal data of a body from the finite elements of another program.

    Parameters
    ----------
    mass, stiffness, nodes : path
        Files of the free body, as `kaneflex import` reads them.
    points : mapping of str to path
        Text file with the nodes of each point; "start" and "end" are needed.
    modes : int
        Modes with the points held: bending modes in the plane, all modes in space.
    coupling : {"rigid", "averaged"}
        Whether the nodes of a point move as one rigid body, or the point moves as their mean.
    damping : float
        Damping ratio of every mode of the free link; a clamped one is damped less in its lowest modes.
    **options
        Fields of :class:`kaneflex.fem.imported.import_mesh.MeshOptions`.

    Returns
    -------
    ModalData
        Its ``save(path)`` writes the file that a body takes as ``modal_data``.

    Warns
    -----
    ValidityWarning
        Doubtful units.

    Raises
    ------
    SceneError
        It names the file and what is wrong with it.
    """
    from kaneflex.fem.imported.modal_arrays import imported_data

    with naming("import", None):
        if coupling not in ("rigid", "averaged"):
            raise Fault(f"{coupling!r} is not a coupling", "Choose 'rigid' or 'averaged'")
        link = _link((mass, stiffness, nodes), points, options)
        data = imported_data(link, modes, coupling == "rigid", damping)
    for doubt in link.doubts:  # stacklevel: beyond the check of arguments
        warnings.warn(f"{doubt}. Check the units of the files: --units gives them.", ValidityWarning, stacklevel=3)
    return data


def _link(files: Sequence[Path], points: Mapping[str, Path], options: MeshOptions) -> ImportedMesh:
    """Finite elements of the files. Raises Fault."""
    from kaneflex.fem.imported.files import read_elements
    from kaneflex.fem.imported.recovery import read_stresses

    asked, stress = options.get("units", "m-kg"), options.get("stress")
    if asked not in UNITS:
        raise Fault(f"{asked!r} are no units", nearest(asked, UNITS))
    units, named = UNITS[asked], {name: str(path) for name, path in points.items()}
    normal, space = options.get("normal", (0.0, 0.0, 1.0)), options.get("space", False)
    mass, stiffness, nodes = map(str, files)
    link = read_elements(mass, stiffness, nodes, named, units, normal, space, options.get("sections"))
    if stress is None:
        return link
    return replace(link, stresses=read_stresses(link, str(stress[0]), str(stress[1]), units))
