"""Recovery from another program's finite elements: section forces, and stresses by a matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import coo_array, csc_array, eye_array, kron

from kaneflex.fem.imported.elements import TURNS, ImportedMesh, Stresses
from kaneflex.fem.imported.files import check_name
from kaneflex.fem.imported.matrices import read_market
from kaneflex.scene.modal_data import ModalData
from kaneflex.scene.recovery import STRESSES, Recovery
from kaneflex.support.errors import Fault
from kaneflex.support.files import check_file

_STILL = 1e-6
"""Largest stress in rigid motions, as a share of the sum of its entries."""
_LAYER = 1e-6
"""Distance within which a node is in a section, as a share of the link's length."""
IN_PLANE = (0, 1, 5)
"""N, V, M among the six in space; u, v, theta of a node, too."""
_AT = {name: ("xyz".index(name[0]), "xyz".index(name[1])) for name in STRESSES[6]}


def with_recovery(link: ImportedMesh, shapes: np.ndarray, data: ModalData) -> ModalData:
    """Data of a link with section forces and stresses, for the shapes (n_nodes d, n) of the data."""
    stresses = link.stresses
    if stresses is not None:
        rows = (stresses.matrix @ shapes).reshape(len(stresses.places), -1, shapes.shape[1])
        data = replace(data, stresses=Recovery(stresses.places, rows))
    if not link.sections:
        return data
    pushed = (link.K @ shapes).reshape(len(link.nodes), link.motions, -1)
    nodes, forces = padded(link.nodes, range(link.axes), 3), padded(pushed, range(link.motions), max(3, link.motions))
    rows = np.array([section_forces(nodes, forces, x, _reach(link, x)) for x in link.sections.values()])
    kept = slice(None) if link.spatial else list(IN_PLANE)
    return replace(data, sections=Recovery(tuple(link.sections), rows[:, kept]))


def section_forces(nodes: np.ndarray, forces: np.ndarray, x: float, over: float = 0.0) -> np.ndarray:
    """N, V_y, V_z, T, M_y, M_z of each shape at x [m] from the start, (6, n).

    Nodal forces are K times the shape. Forces between elements before the section cancel, so the sum over the nodes
    before it is the force of elements across it. Nodes in the section count half, at the start fully, at the end not.
    Element loads are in its nodes: the mean of the sections ``over`` its length [m] removes this error. ``nodes``
    (n_nodes, 3), ``forces`` (n_nodes, 3, n), with moments 6.
    """
    along, first, last = nodes[:, 0], nodes[:, 0].min(), nodes[:, 0].max()
    near = _LAYER * (last - first)
    over = min(over, 2.0 * (x - first), 2.0 * (last - x))
    if over > near:
        low = np.maximum(along, x - over / 2)  # from where on a section of the mean has the node before it
        weights, about = np.clip((x + over / 2 - low) / over, 0.0, 1.0), (low + x + over / 2) / 2
    else:
        share = 0.5 if first + near < x < last - near else float(x <= first + near)
        weights, about = (along < x - near) + share * (abs(along - x) <= near), np.full(len(along), x)
    before = np.flatnonzero(weights)
    pushed = weights[before, None, None] * forces[before]
    arm = nodes[before].copy()
    arm[:, 0] -= about[before]
    moment = np.cross(arm[:, :, None], pushed[:, :3], axis=1).sum(axis=0)
    if forces.shape[1] == 6:
        moment = moment + pushed[:, 3:].sum(axis=0)
    return -np.vstack([pushed[:, :3].sum(axis=0), moment])


def _reach(link: ImportedMesh, x: float) -> float:
    """Length along the link of the longest element that touches a section [m]."""
    of = coo_array(link.K)
    one, other = (link.nodes[at // link.motions, 0] for at in (of.row, of.col))
    touching = (one <= x) & (x <= other)
    return float((other - one)[touching].max(initial=0.0))


def padded(array: np.ndarray, columns: Sequence[int], count: int) -> np.ndarray:
    """Array (n_nodes, ...) whose second axis is expanded to ``count`` columns, the others zero."""
    found = np.zeros((len(array), count, *array.shape[2:]))
    found[:, list(columns)] = array
    return found


def read_stresses(link: ImportedMesh, path: str, names: str, units: tuple[float, float] = (1.0, 1.0)) -> Stresses:
    """Stresses for unit displacements from another program's matrix, in the axes of its files.

    Parameters
    ----------
    link : ImportedMesh
        Link whose displacements are the columns, in the order of the nodes.
    path : str
        Matrix Market file: xx, yy, zz, xy, yz, zx of one place after the other; for links whose nodes have two
        translations xx, yy, xy.
    names : str
        Text file with the name of one place per line.
    units : pair of float
        As of :func:`kaneflex.fem.imported.files.read_elements`; a stress is in mass / (length s^2).

    Raises
    ------
    Fault
        It names the file and what is wrong with it.
    """
    places = _names(names)
    try:
        found = read_market(path)
    except OSError as error:
        raise Fault(f"{path} cannot be read: {error.strerror or error}", "Give a file of a matrix") from None
    count = 6 if link.axes == 3 else 3
    if found.shape != (shape := (count * len(places), len(link.nodes) * link.motions)):
        reason = f"{path} has the shape {found.shape}, with {len(places)} names in {names} not {shape}"
        raise Fault(reason, f"Give rows {', '.join(STRESSES[count])} for every place, and the columns of the stiffness")
    if found.dtype.kind not in "fiu" or not np.isfinite(found.data).all():
        raise Fault(f"{path} contains numbers that are not finite", "Export it again")
    length, mass = units
    into = link.turn[: link.axes, : link.axes]
    if link.motions == TURNS:
        into = block_diag(link.turn, length * link.turn)
    rotated = kron(eye_array(len(places)), _rotation(link.turn, STRESSES[count]))
    S = csc_array(rotated @ found @ kron(eye_array(len(link.nodes)), into.T) * (mass / length**2))
    for name, motion in link.whole.items():
        left, size = abs(S @ motion), abs(S) @ abs(motion)
        if (left > _STILL * size.max()).any():
            place = places[int(left.argmax()) // count]
            reason = f"{path}: a rigid motion {name} gives a stress at {place}"
            raise Fault(reason, "Give its columns in the order of the nodes, in the units and axes of the other files")
    return Stresses(places, S)


def _names(path: str) -> tuple[str, ...]:
    try:
        check_file(Path(path))
        found = tuple(Path(path).read_text(encoding="utf-8-sig").split())
    except OSError as error:
        raise Fault(f"{path} cannot be read: {error.strerror or error}", "Give a text file of names") from None
    except UnicodeDecodeError:
        raise Fault(f"{path} is not a text file", "Give a text file of names, one per line") from None
    if not found:
        raise Fault(f"{path} is empty", "Give the name of each place, one per line")
    for name in found:
        check_name(name, f"{path}: ")
        if found.count(name) > 1:
            raise Fault(f"{path}: {name} occurs twice", "Give each place a different name, like fillet")
    return found


def _rotation(turn: np.ndarray, components: Sequence[str]) -> np.ndarray:
    """Matrix from components in the file's axes to components in the link's axes."""
    found = np.zeros((len(components),) * 2)
    for k, name in enumerate(components):
        a, b = _AT[name]
        one = np.zeros((3, 3))
        one[a, b] = one[b, a] = 1.0
        turned = turn @ one @ turn.T
        found[:, k] = [turned[_AT[other]] for other in components]
    return found
