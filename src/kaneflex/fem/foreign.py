"""A body's finite elements from another program: matrices, nodes, and what of them moves in the plane or in space.

The matrices are those of the whole link, nothing of it held: translations of the nodes, two or three at each, in the
order of the nodes. A link of the plane is its own mirror image in that plane and across its axis, as beams are: then
its motions part into axial ones, u even and v odd in Y, and transverse ones, u odd and v even, both with w odd in Z.
What matrices lack of that symmetry is averaged over, which is a Ritz approximation like the mesh itself.

In space nothing is asked of a body's form: all its motions are one kind.

Of a link whose stiffness only its modes know, displacements are those of the modes and of the link as a whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.sparse import coo_array, csc_array, eye_array, hstack, kron
from scipy.spatial import cKDTree

from kaneflex.fem.matrices import read_matrix, read_table
from kaneflex.fem.modal_files import Modes, has_modes, read_modes
from kaneflex.scene.modal_data import CROSS
from kaneflex.support.errors import Fault

_STILL = 1e-6
"""Share of the stiffness by which a rigid motion may be resisted."""
_OPPOSITE = 1e-6
"""Share of the link's length by which a node may miss its mirror image, and the ends the plane."""
_ALIKE = 1e-6
"""Share of the largest displacement that is another one's rounding."""
_PARITY = {"axial": ((1, 1), (-1, 1), (1, -1)), "transverse": ((-1, 1), (1, 1), (-1, -1))}
"""Signs of u, v, w under the mirrors Y -> -Y and Z -> -Z."""

Motion = Literal["axial", "transverse", "any"]
"""Kinds of motion that don't mix: two in the plane, one in space."""


@dataclass(frozen=True, eq=False)
class Projected:
    """The stiffness [N/m] of what a displacement has of some modes.

    ``onto`` (n_modes, n_nodes d): how much of each mode is in it, by the mass; ``stiffness`` (n_modes, n_modes).
    """

    onto: np.ndarray
    stiffness: np.ndarray

    def __matmul__(self, displacements):
        return self.onto.T @ (self.stiffness @ (self.onto @ displacements))


@dataclass(frozen=True, eq=False)
class Stresses:
    """Stresses at ``places`` [Pa] by displacements: ``matrix`` (6 n_places, n_nodes d), or 3 n_places where d is two.
    """

    places: tuple[str, ...]
    matrix: csc_array


@dataclass(frozen=True, eq=False)
class Foreign:
    """Finite elements in the axes of their link: X from its start to its end, Y across, Z along the normal that is
    given, out of the plane of motion.

    Attributes
    ----------
    M, K : csc_array (n_nodes d, n_nodes d)
        Mass [kg] and stiffness [N/m], d translations a node; the latter :class:`Projected` where only modes are known.
    nodes : ndarray (n_nodes, d)
        Places from the start [m].
    points : mapping of str
        Name of each point -> the nodes that belong to it; `start` and `end` are among them.
    spatial : bool
        Whether it moves in space.
    span : ndarray (n_nodes d, m) or None
        Displacements that all others are sums of, where modes are all there is.
    turn : ndarray (3, 3)
        The link's axes in those of the files, one a row.
    sections : mapping of str
        Name of each further point, which is on the mean line -> its distance from the start [m].
    stresses : Stresses or None
        Where the other program told them.
    """

    M: csc_array
    K: csc_array | Projected
    nodes: np.ndarray
    points: Mapping[str, np.ndarray]
    spatial: bool = False
    span: np.ndarray | None = None
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    sections: Mapping[str, float] = field(default_factory=dict)
    stresses: Stresses | None = None

    @property
    def axes(self) -> int:
        """Translations of a node: two or three."""
        return self.nodes.shape[1]

    def X(self, point: str) -> float:
        """Distance of a point from the start [m]."""
        return float(self.nodes[self.points[point], 0].mean())

    @property
    def length(self) -> float:
        """From start to end [m]."""
        return self.X("end")

    @property
    def whole(self) -> dict[str, np.ndarray]:
        """Motions of the whole link (n_nodes d,), by what they are called; turns by one over its length."""
        if not self.spatial:
            x, y = self.nodes[:, 0], self.nodes[:, 1]
            turn = self.field(-y, x) / self.length
            return {"along its axis": self.field(1.0, 0.0), "across": self.field(0.0, 1.0), "turning": turn}
        axes = dict(zip("xyz", np.eye(3), strict=True))
        found = {f"along {name}": np.broadcast_to(axis, self.nodes.shape) for name, axis in axes.items()}
        found |= {f"about {name}": np.cross(axis, self.nodes) / self.length for name, axis in axes.items()}
        return {name: motion.ravel() for name, motion in found.items()}

    def accelerations(self, motion: Motion) -> list[np.ndarray]:
        """Accelerations (n_nodes d,) that a link as a whole may have: along its axes, as much and growing from its
        start, and in space turning about its axis."""
        x, axes = self.nodes[:, :1], np.eye(self.axes)
        kept = {"axial": axes[:1], "transverse": axes[1:2], "any": axes}[motion]
        found = [growing * axis for axis in kept for growing in (np.ones_like(x), x)]
        found += [np.cross(axes[0], self.nodes)] if motion == "any" else []
        return [of.ravel() for of in found]

    def field(self, u: np.ndarray | float, v: np.ndarray | float) -> np.ndarray:
        """A displacement (n_nodes d,) with components u along and v across, (n_nodes,) each."""
        found = np.zeros(self.nodes.shape)
        found[:, 0], found[:, 1] = u, v
        return found.ravel()

    def means(self, point: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (n_nodes d,) that give how a point moves along and across, and how far it turns.

        Means over its nodes, and the turn that fits them best: those of an interface by weighted averages (RBE3).
        """
        at = self.points[point]
        place = self.nodes[at, :2] - self.nodes[at, :2].mean(axis=0)
        along, across, turn = np.zeros((3, *self.nodes.shape))
        along[at, 0] = across[at, 1] = 1.0 / len(at)
        size = (place**2).sum()
        if size > 0.0:
            turn[at, 0], turn[at, 1] = -place[:, 1] / size, place[:, 0] / size
        return along.ravel(), across.ravel(), turn.ravel()

    def held(self, point: str, motion: Motion) -> np.ndarray:
        """Rows (m, n_nodes d) of what a point is held by: u, v, or in space its displacement and its turn.

        Raises Fault where the nodes of a point lie on one line, which leaves a turn open.
        """
        if motion != "any":
            return self.means(point)[0 if motion == "axial" else 1][None]
        at = self.points[point]
        place = self.nodes[at] - self.nodes[at].mean(axis=0)
        found = np.zeros((6, *self.nodes.shape))
        found[[0, 1, 2], :, [0, 1, 2]] = np.isin(np.arange(len(self.nodes)), at) / len(at)
        if len(at) == 1:  # which has no turn of its own
            return found[:3].reshape(3, -1)
        inertia = (place**2).sum() * np.eye(3) - place.T @ place
        if np.linalg.eigvalsh(inertia)[0] < _ALIKE * (place**2).sum():
            raise Fault(f"the nodes of {point} lie on one line, about which its turn is open", "Give nodes around it")
        lever = np.einsum("cab,na->cnb", CROSS, place)
        found[3:, at] = np.linalg.solve(inertia, lever.reshape(3, -1)).reshape(lever.shape)
        return found.reshape(6, -1)

    def basis(self, motion: Motion, rigid: bool) -> csc_array:
        """Displacements of that symmetry, (n_nodes d, m), orthogonal; ``rigid``: a point's nodes move as one (RBE2)."""
        if self.span is not None:
            if rigid:
                raise Fault("modes know how the nodes of a point move, not that they move as one",
                            "Take --coupling averaged")  # fmt: skip
            return self._spanned(motion)
        found = csc_array(eye_array(self.nodes.size)) if motion == "any" else self._symmetric(motion)
        if not rigid:
            return found
        held = np.zeros(len(self.nodes), bool)
        own = []
        for at in self.points.values():
            held[at] = True
            for moved in _together(self.nodes[at] - self.nodes[at].mean(axis=0), motion):
                one = np.zeros(self.nodes.shape)
                one[at] = moved
                if (size := np.linalg.norm(one)) > 0.0:
                    own.append(one.ravel() / size)
        touched = np.asarray(abs(found)[np.repeat(held, self.axes)].sum(axis=0)).ravel() > 0.0
        loose = found[:, np.flatnonzero(~touched)]
        return csc_array(hstack([loose, coo_array(np.array(own).T)]))

    def _spanned(self, motion: Motion) -> csc_array:
        """The part of that symmetry of what the modes span."""
        assert self.span is not None  # or there is no need to ask
        whole = self.span.reshape(len(self.nodes), self.axes, -1)
        for mirror, own in ((1, 0), (2, 1))[: 0 if motion == "any" else self.axes - 1]:
            signs = np.array([of[own] for of in _PARITY[motion]])[: self.axes]
            whole = 0.5 * (whole + signs[:, None] * whole[self._mirrored(mirror)])
        found, sizes, _ = np.linalg.svd(whole.reshape(len(self.nodes) * self.axes, -1), full_matrices=False)
        return csc_array(found[:, sizes > _ALIKE * sizes[0]])

    def _symmetric(self, motion: Motion) -> csc_array:
        signs, count, d = _PARITY[motion], len(self.nodes), self.axes
        mirrors = [self._mirrored(1), self._mirrored(2) if d == 3 else np.arange(count)]
        least = np.minimum.reduce([np.arange(count), mirrors[0], mirrors[1], mirrors[0][mirrors[1]]])
        first = np.flatnonzero(least == np.arange(count))
        rows, columns, values = [], [], []
        for axis in range(d):
            in_y, in_z = signs[axis][0], signs[axis][1] if d == 3 else 1
            for image, sign in (
                (np.arange(count), 1), (mirrors[0], in_y), (mirrors[1], in_z), (mirrors[0][mirrors[1]], in_y * in_z)
            ):  # fmt: skip
                rows.append(d * image[first] + axis)
                columns.append(axis * len(first) + np.arange(len(first)))
                values.append(np.full(len(first), float(sign)))
        shape = (count * d, d * len(first))
        found = coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape).tocsc()
        sizes = np.sqrt(np.asarray(found.multiply(found).sum(axis=0)).ravel())
        kept = np.flatnonzero(sizes > 0.5)
        return csc_array(found[:, kept] / sizes[kept])

    def _mirrored(self, axis: int) -> np.ndarray:
        """Which node is the image of each. Raises Fault where there is none."""
        flip = np.ones(self.axes)
        flip[axis] = -1.0
        away, image = cKDTree(self.nodes).query(self.nodes * flip)
        worst = int(away.argmax())
        if away[worst] > _OPPOSITE * self.length:
            plane = "axis" if axis == 1 else "plane of motion"
            place = ", ".join(f"{1e3 * x:.6g}" for x in self.nodes[worst])
            raise Fault(
                f"the link is not its own mirror image in its {plane}: no node lies opposite the one at ({place}) mm",
                "Give points and a normal that are in its symmetry, and a mesh that has it",
            )
        return np.asarray(image)


def _together(place: np.ndarray, motion: Motion) -> list[np.ndarray]:
    """Motions of nodes as one, (n, d) each, ``place`` (n, d) from their middle."""
    axes = np.eye(place.shape[1])
    if motion == "any":
        return [*(np.broadcast_to(axis, place.shape) for axis in axes), *(np.cross(axis, place) for axis in axes)]
    if motion == "axial":
        return [np.broadcast_to(axes[0], place.shape)]
    turn = np.zeros(place.shape)
    turn[:, 0], turn[:, 1] = -place[:, 1], place[:, 0]
    return [np.broadcast_to(axes[1], place.shape), turn]


def read_foreign(
    mass: str, stiffness: str, nodes: str, points: Mapping[str, str], units: tuple[float, float] = (1.0, 1.0),
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0), spatial: bool = False,
    sections: Mapping[str, float] | None = None,
) -> Foreign:  # fmt: skip
    """Finite elements of another program's files, in the axes of their link.

    Parameters
    ----------
    mass, stiffness : str
        Files that :mod:`kaneflex.fem.matrices` reads; both matrices may be in one. The latter may be one of modes, see
        :mod:`kaneflex.fem.modal_files`.
    nodes : str
        A text file with a line for each node: its number, then its coordinates; or one of modes.
    points : mapping of str
        Name of a point -> a text file of the numbers of its nodes; ``start`` and ``end`` are needed.
    units : pair of float
        The files' unit of length [m] and of mass [kg]; their unit of time is the second.
    normal : triple of float
        Of the plane of motion, in the axes of the files; in space the direction nearest to which Z is.
    spatial : bool
        Whether the body moves in space.
    sections : mapping of str
        Name of a further point on the mean line -> its distance from the start, in the files' unit of length. There
        always is `mid`, half-way.

    Raises
    ------
    Fault
        It names the file and what is wrong with it.
    """
    length, weight = units
    numbers, at = _nodes(nodes)
    M = read_matrix(mass, numbers, "m") * weight
    modes = read_modes(stiffness) if has_modes(stiffness) else None
    K = None if modes is not None else read_matrix(stiffness, numbers, "k") * weight
    chosen = {name: _chosen(path, numbers) for name, path in points.items()}
    for name in ("start", "end"):
        if name not in chosen:
            raise Fault(f"no point {name}", f"Give the nodes of its {name}, like {name}=nodes.txt")
    place, turn = _frame(length * at, chosen, np.array(normal, float), spatial)
    d = M.shape[0] // len(at)
    if spatial and d < 3:
        raise Fault(f"{mass} has two translations of each node", "Mesh the body in space, or leave --space out")
    turned = csc_array(kron(eye_array(len(at)), turn[:d, :d]))
    M, place = csc_array(turned @ M @ turned.T), place[:, :d]
    bare = Foreign(M, Projected(*np.zeros((2, 0, 0))), place, chosen, spatial, turn=turn)
    bare = replace(bare, sections=_sections(bare, sections or {}, length))
    if K is not None:
        found = replace(bare, K=csc_array(turned @ K @ turned.T))
    else:
        assert modes is not None
        found = _of_modes(bare, modes, stiffness, numbers, turned)
    _check(found, mass, stiffness)
    return found


def _sections(link: Foreign, given: Mapping[str, float], length: float) -> dict[str, float]:
    """Further points on the mean line, by their distance from the start [m], with `mid`. Raises Fault."""
    for name, x in given.items():
        if name in link.points:
            raise Fault(f"section {name} is a point by its nodes, too", "Give it another name")
        if not 0.0 < length * x < link.length:
            told = f"section {name} at {x:g} is not between the start and the end, at {link.length / length:g}"
            raise Fault(told, "Give its distance from the start, in the unit of length of the files")
    found = {name: length * x for name, x in given.items()}
    return found if "mid" in link.points or "mid" in found else {"mid": link.length / 2} | found


def _of_modes(link: Foreign, modes: Modes, path: str, numbers: np.ndarray, turned: csc_array) -> Foreign:
    """A link with the stiffness of its modes, which are in the axes and the order of their file."""
    rows = {int(number): row for row, number in enumerate(modes.numbers)}
    absent = [number for number in numbers.tolist() if number not in rows]
    if absent:
        raise Fault(f"{path} does not say how node {absent[0]} moves", "Give the modes of all nodes")
    order = [rows[number] for number in numbers.tolist()]
    own = replace(modes, numbers=numbers, shapes=modes.shapes[order])
    stiffness = own.stiffness_by(turned.T @ link.M @ turned)
    whole = list(link.whole.values())
    span = np.column_stack([*whole, turned @ own.translations(link.axes)])
    onto = np.linalg.pinv(span.T @ link.M @ span, rcond=_ALIKE**2, hermitian=True) @ (link.M @ span).T
    return replace(link, K=Projected(onto[len(whole) :], stiffness), span=span)


def _nodes(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and coordinates (n_nodes, 3) of the nodes."""
    if has_modes(path):
        modes = read_modes(path)
        return modes.numbers, modes.nodes
    table = read_table(path)
    if table.shape[1] not in (3, 4):
        raise Fault(f"{path} has {table.shape[1]} columns", "Give a node's number, then its two or three coordinates")
    numbers = table[:, 0].astype(np.int64)
    if len(np.unique(numbers)) < len(numbers) or (numbers != table[:, 0]).any():
        raise Fault(f"{path}: nodes without a whole number of their own", "Number each node once, in the first column")
    return numbers, np.pad(table[:, 1:], ((0, 0), (0, 4 - table.shape[1])))


def _chosen(path: str, numbers: np.ndarray) -> np.ndarray:
    """Where the nodes that a file lists are among all."""
    wanted = read_table(path).ravel()
    order = np.argsort(numbers)
    at = np.minimum(np.searchsorted(numbers[order], wanted), len(numbers) - 1)
    unknown = wanted[numbers[order][at] != wanted]
    if len(unknown):
        raise Fault(f"{path}: there is no node {unknown[0]:g}", "Give numbers that the file of nodes has")
    return np.unique(order[at])


def _frame(
    at: np.ndarray, points: Mapping[str, np.ndarray], normal: np.ndarray, spatial: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Places in the link's axes (n_nodes, 3), and the rotation into them."""
    start, end = (at[points[name]].mean(axis=0) for name in ("start", "end"))
    span, size = np.linalg.norm(end - start), np.linalg.norm(normal)
    if span == 0.0 or size == 0.0:
        raise Fault("start and end are in one place" if size else "the normal is zero", "Give two ends, and a normal")
    x, z = (end - start) / span, normal / size
    if spatial:
        # Where the normal is along the link, the axis nearest to being across it serves as well.
        z = z if np.linalg.norm(np.cross(x, z)) > _OPPOSITE else np.eye(3)[abs(x).argmin()]
        z = np.cross(x, np.cross(z, x))
        z /= np.linalg.norm(z)
    elif abs(x @ z) > _OPPOSITE:
        lean = np.degrees(np.arcsin(min(1.0, abs(x @ z))))
        raise Fault(f"start and end lean out of the plane of motion by {lean:.3g} deg", "Give the plane's own normal")
    turn = np.array([x, np.cross(z, x), z])
    return (at - start) @ turn.T, turn


def _check(found: Foreign, mass: str, stiffness: str) -> None:
    """Raise Fault unless the link has mass, and nothing resists its rigid motions."""
    along = found.field(1.0, 0.0)
    total = along @ found.M @ along
    if not total > 0.0:
        raise Fault(f"{mass} adds up to a mass of {total:.3g} kg", "Give one that is above zero")
    if isinstance(found.K, Projected):  # which motions of the whole link are no part of
        return
    scale = abs(found.K).max()
    for name, motion in found.whole.items():
        left = abs(found.K @ motion).max()
        if left > _STILL * scale:
            raise Fault(
                f"{stiffness} resists a motion of the whole link {name} by {left / scale:.2g} of its largest entry",
                "Export the link free, without supports, in the order of the nodes",
            )
