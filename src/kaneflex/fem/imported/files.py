"""Reading of a body's finite elements from files of another program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import coo_array, csc_array, eye_array, kron

from kaneflex.fem.imported.elements import OPPOSITE, TURNS, ImportedMesh
from kaneflex.fem.imported.matrices import read_lines, read_matrix, read_table
from kaneflex.support.errors import Fault, counted
from kaneflex.support.units import plain_number

_NONE = 1e-9
"""Smallest total mass, as a share of the sum of absolute entries."""
_STILL = 1e-6
"""Largest stiffness of a rigid motion, as a share of the largest entry."""


def read_elements(
    mass: str, stiffness: str, nodes: str, points: Mapping[str, str], units: tuple[float, float] = (1.0, 1.0),
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0), spatial: bool = False,
    sections: Mapping[str, float] | None = None,
) -> ImportedMesh:  # fmt: skip
    """Finite elements of another program's files, in the axes of their link.

    Parameters
    ----------
    mass, stiffness : str
        Files that :mod:`kaneflex.fem.imported.matrices` reads; both matrices may be in one.
    nodes : str
        A text file with a line for each node: its number, then its coordinates; or an input of Abaqus or CalculiX
        (``.inp``).
    points : mapping of str
        Name of a point -> a text file of the numbers of its nodes; ``start`` and ``end`` are needed.
    units : pair of float
        The files' unit of length [m] and of mass [kg]; their unit of time is the second.
    normal : triple of float
        Normal of the plane of motion, in the axes of the files; in space approximate direction of Z.
    spatial : bool
        True if the body moves in space.
    sections : mapping of str
        Name of a further point on the mean line -> its distance from the start, in the files' unit of length. There
        always is `mid`, half-way.

    Raises
    ------
    Fault
        It names the file and what is wrong with it.
    """
    length, weight = units
    for name in (*points, *(sections or {})):
        check_name(name)
    numbers, at = _nodes(nodes)
    M = read_matrix(mass, numbers, "m", spatial) * weight
    _check_masses(M, mass, numbers)
    K = read_matrix(stiffness, numbers, "k", spatial) * weight
    chosen = {name: _chosen(path, numbers) for name, path in points.items()}
    _check_points(chosen, numbers)
    place, turn = _frame(length * at, chosen, np.array(normal, float), spatial)
    d = M.shape[0] // len(at)
    if spatial and d < 3:
        raise Fault(f"{mass} has two translations of each node", "Mesh the body in space, or leave --space out")
    if K.shape != M.shape:  # lumped masses needn't resist turns, nor all elements bend
        d, M, K = TURNS, _with_turns(M, len(at)), _with_turns(K, len(at))
    each = turn[:d, :d] if d < TURNS else block_diag(turn, length * turn)  # moments and turns beside forces and ways
    turned, place = csc_array(kron(eye_array(len(at)), each)), place[:, : min(d, 3)]
    M, K = (csc_array(turned @ each @ turned.T) for each in (M, K))
    link = ImportedMesh(M, K, place, chosen, spatial, turn)
    link = replace(link, sections=_sections(link, sections or {}, length))
    _check(link, mass, stiffness)
    return link


def _check_masses(M: csc_array, path: str, numbers: np.ndarray) -> None:
    """Raise Fault if a node has a negative mass."""
    if M.diagonal().min() < 0.0:
        node = numbers[M.diagonal().argmin() // (M.shape[0] // len(numbers))]
        raise Fault(f"{path} has a negative mass at node {node}", "Export it again")


def _check_points(points: Mapping[str, np.ndarray], numbers: np.ndarray) -> None:
    """Raise Fault if an end is missing, or two points have a node in common."""
    for name in ("start", "end"):
        if name not in points:
            raise Fault(f"no point {name}", f"Give the nodes of its {name}, like {name}=nodes.txt")
    for one, other in combinations(points, 2):
        if len(both := np.intersect1d(points[one], points[other])):
            raise Fault(f"{one} and {other} have node {numbers[both[0]]} in common", "Give every point separate nodes")


def check_name(name: str, where: str = "") -> None:
    """Raise Fault unless the name of a point is valid in scenes."""
    if not (name.isidentifier() and name.isascii()):
        raise Fault(f"{where}{name!r} is not a name", "Use letters, digits and underscores, a letter first")


def _with_turns(matrix: csc_array, nodes: int) -> csc_array:
    """Matrix of translations extended by zero rotations."""
    each = matrix.shape[0] // nodes
    if each == TURNS:
        return matrix
    of = coo_array(matrix)
    rows, columns = (TURNS * (at // each) + at % each for at in (of.row, of.col))
    return csc_array(coo_array((of.data, (rows, columns)), (TURNS * nodes,) * 2))


def _sections(link: ImportedMesh, given: Mapping[str, float], length: float) -> dict[str, float]:
    """Further points on the mean line, by their distance from the start [m], with `mid`. Raises Fault."""
    for name, x in given.items():
        if name in link.points:
            raise Fault(f"a point given by nodes has the name {name}, too", "Give the section another name")
        if name == "mid" and abs(length * x - link.length / 2) > OPPOSITE * link.length:
            raise Fault(f"section mid at {x:g} is not half-way", "Give it another name")
        if not 0.0 < length * x < link.length:
            reason = f"section {name} at {x:g} is not between the start and the end, at {link.length / length:g}"
            raise Fault(reason, "Give its distance from the start, in the unit of length of the files")
    found = {name: length * x for name, x in given.items()}
    return found if "mid" in link.points or "mid" in found else {"mid": link.length / 2} | found


def _nodes(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and coordinates (n_nodes, 3) of the nodes."""
    table = _input_nodes(path) if Path(path).suffix.lower() == ".inp" else read_table(path)
    if table.shape[1] not in (3, 4):
        reason = f"{path} has {counted(table.shape[1], 'column')}"
        raise Fault(reason, "Give a node's number, then its two or three coordinates")
    with np.errstate(invalid="ignore"):  # too large a number is not equal to its integer
        numbers = table[:, 0].astype(np.int64)
    if (wrong := numbers != table[:, 0]).any():
        number = f"{table[wrong][0, 0]:g}"
        raise Fault(f"{path}: {number} is not a node number", "Give whole numbers in the first column")
    each, count = np.unique(numbers, return_counts=True)
    if len(each) < len(numbers):
        cure = "Give each node a different number; write an Abaqus input without parts and assemblies"
        raise Fault(f"{path}: node {each[count > 1][0]} occurs twice", cure)
    return numbers, np.pad(table[:, 1:], ((0, 0), (0, 4 - table.shape[1])))


_ELSEWHERE = ("NGEN", "NCOPY", "NFILL", "NMAP", "INCLUDE")
"""Keywords of Abaqus and CalculiX that generate nodes, or read them from another file."""


def _input_nodes(path: str) -> np.ndarray:
    """Numbers and coordinates (n_nodes, 4) below the `*NODE` lines of an input of Abaqus or CalculiX."""
    rows, keyword = list[list[float]](), ""
    for line in read_lines(path):
        if line.startswith("*"):
            if line.startswith("**"):
                continue
            keyword, *options = ("".join(word.split()).upper() for word in line[1:].split(","))
            other = keyword == "NODE" and [one for one in options if one.startswith(("INPUT=", "SYSTEM=C", "SYSTEM=S"))]
            if keyword in _ELSEWHERE or other:
                cure = "Give a text file with the number and the x, y and z of each node"
                raise Fault(f"{path}: nodes given by {line.strip()} are not read", cure)
        elif line.strip() and keyword == "INSTANCE":
            raise Fault(f"{path} moves an instance by {line.strip()}", "Write it without parts and assemblies")
        elif line.strip() and keyword == "NODE":
            words = [word.strip() or "0" for word in line.split(",")]
            row = [number for word in [*words, "0", "0", "0"][:4] if (number := plain_number(word)) is not None]
            if len(row) < 4:
                raise Fault(f"{path}: {line.strip()[:60]} is not a node", "Give its number, then its coordinates")
            rows.append(row)
    if not rows:
        raise Fault(f"{path} has no nodes below *NODE", "Give an input of Abaqus or CalculiX, or a text file of nodes")
    return np.array(rows)


def _chosen(path: str, numbers: np.ndarray) -> np.ndarray:
    """Indices of the nodes that a file lists."""
    wanted = read_table(path).ravel()
    order = np.argsort(numbers)
    at = np.minimum(np.searchsorted(numbers[order], wanted), len(numbers) - 1)
    unknown = wanted[numbers[order][at] != wanted]
    if len(unknown):
        raise Fault(f"{path}: there is no node {unknown[0]:g}", "Give numbers from the file of nodes")
    return np.unique(order[at])


def _frame(
    at: np.ndarray, points: Mapping[str, np.ndarray], normal: np.ndarray, spatial: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Places in the link's axes (n_nodes, 3), and the rotation into them."""
    start, end = (at[points[name]].mean(axis=0) for name in ("start", "end"))
    span, size = np.linalg.norm(end - start), np.linalg.norm(normal)
    if span == 0.0 or size == 0.0:
        raise Fault("start and end coincide" if size else "the normal is zero", "Give two ends, and a normal")
    x, z = (end - start) / span, normal / size
    if spatial:
        # If the normal is along the link, the axis nearest to being perpendicular to it replaces it.
        z = z if np.linalg.norm(np.cross(x, z)) > OPPOSITE else np.eye(3)[abs(x).argmin()]
        z = np.cross(x, np.cross(z, x))
        z /= np.linalg.norm(z)
    elif abs(x @ z) > OPPOSITE:
        lean = np.degrees(np.arcsin(min(1.0, abs(x @ z))))
        raise Fault(f"the line from start to end is off the plane of motion by {lean:.3g} deg", "Give another normal")
    turn = np.array([x, np.cross(z, x), z])
    return (at - start) @ turn.T, turn


def _check(found: ImportedMesh, mass: str, stiffness: str) -> None:
    """Raise Fault unless the link has mass, and no stiffness against rigid motions."""
    along = found.field(1.0, 0.0)
    total = along @ found.M @ along
    if not total > _NONE * abs(found.M).sum():  # a stiffness matrix has no forces in rigid motions
        raise Fault(f"{mass} adds up to a mass of {total:.3g} kg", "Give the mass first, then the stiffness")
    stretched = found.field(found.nodes[:, 0], 0.0)
    if not stretched @ (found.K @ stretched) > 0.0:
        raise Fault(f"{stiffness} does not resist a stretch of the link", "Give the stiffness with a positive sign")
    scale = abs(found.K).max()
    for name, motion in found.whole.items():
        left = abs(found.K @ motion).max()
        if left > _STILL * scale:
            raise Fault(
                f"{stiffness} resists a rigid motion {name} by {left / scale:.2g} of its largest entry",
                "Export the link free, without supports, in the order of the nodes",
            )
