"""Modal coordinates of elastic links: shapes of a link's own finite elements in its floating frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from kaneflex.fem.links import Link
from kaneflex.fem.modes import lowest_modes
from kaneflex.mechanism.affine import Matrix, as_array, solve
from kaneflex.mechanism.floating_frames import IN_THE_MEAN, Frame, axial_modes, frame_of, stations
from kaneflex.multibody.model.shape_families import family
from kaneflex.scene import Scene

_GAUSS = np.polynomial.legendre.leggauss(3)  # exact for w_j' w_k' of cubics
_TURNS = 1e-6
"""Displacement of the nodes, as a share of the link's length times their rotation, below which a shape only rotates
them."""
_STILL = {"mean": 1, "free": 2}
"""Number of the lowest shapes without deformation, by the kind of frame, which has these motions itself: rotation,
translation."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shapes of one link at its nodes, one a column, rows u, v, theta of each node in turn.

    Attributes
    ----------
    axial, transverse : ndarray (3 n_nodes, n)
        Zero where the link's frame is attached, those of a chord or a free link with no displacement along it in the
        mean over the link's mass, those across of a free link without momentum. Orthogonal with respect to mass and
        stiffness; the largest displacement of each is one.
    frame : Frame
    node : int
        The node at which the frame is attached; of a chord or a free link the first one.
    """

    axial: np.ndarray
    transverse: np.ndarray
    frame: Frame
    node: int

    @property
    def all(self) -> np.ndarray:
        """Axial shapes, then transverse ones."""
        return np.hstack([self.axial, self.transverse])

    def shortening(self, link: Link) -> np.ndarray:
        """H_jk = int w_j' w_k' dX [1/m] from where the frame is attached to every node, (n_nodes, n, n).

        Of a chord less its mean over the link's mass: neither of its ends stays more than the other one.
        """
        monomial, w = (f"{link.name}.link.P_0",), self.transverse
        blocks = next(blocks for _, name, blocks in link.element_terms if name == monomial)
        steps = [w[3 * e : 3 * e + 6].T @ block @ w[3 * e : 3 * e + 6] for e, block in enumerate(blocks)]
        found = np.concatenate([np.zeros((1, *steps[0].shape)), np.cumsum(steps, axis=0)])
        if self.frame.kind not in IN_THE_MEAN:
            return found - found[self.node]
        tension = (link.part.matrices["K_g"].terms[key] for key in (monomial, (f"{link.name}.link.a_x",)))
        whole, beyond = (w.T @ matrix @ w for matrix in tension)
        along = np.zeros(len(w))
        along[0::3] = 1.0
        return found - (whole - beyond / (along @ link.part.matrices["M"].value({}) @ along))

    def at(self, link: Link, x: float, H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows u, v, theta (3, n) and the shortening (n_w, n_w) at x [m] from the start, ``H`` that of the nodes."""
        node = link.node_at(x)
        if node is not None:
            return self.all[3 * node : 3 * node + 3], H[node]
        e, local = link.locate(x)
        rows = slice(3 * e, 3 * e + 6)
        slopes = np.array([link.shape(e, 0.5 * local * (1 + at))[3] for at in _GAUSS[0]]) @ self.transverse[rows]
        return link.shape(e, local)[:3] @ self.all[rows], H[e] + 0.5 * local * (slopes.T * _GAUSS[1]) @ slopes


def link_shapes(scene: Scene, link: Link, modes: int) -> Shapes:
    """Static shapes of the points where forces enter, and ``modes`` fixed-interface modes (Craig & Bampton 1968).

    The beam's ``shapes`` can put functions of another family in the place of these modes. Axial shapes are the stretch
    by forces at those points and by the link's own inertia.
    """
    rows = _rows(scene, link)
    count = modes + rows.turns
    stiffness, mass = (link.part.matrices[key].value({}) for key in ("K_s", "M"))
    beam = scene.bodies[link.name].beam
    axial = np.zeros((mass.shape[0], 0))
    if not beam.axially_rigid:
        loose = np.setdiff1d(3 * np.arange(len(link.nodes)), [3 * rows.node, *rows.pulled])
        wanted = axial_modes(modes, beam.elements, len(rows.pulled) + 1)
        inertial = _inertial(stiffness, mass, _axial_loads(link, rows), loose, wanted)
        axial = np.hstack([_static(stiffness, rows.pulled, loose), inertial])
        axial = _orthogonal(_mean_free(axial, mass, rows.frame), stiffness, mass, link.length)
    dynamic = np.zeros((mass.shape[0], count))
    if count and beam.shapes != "craig-bampton":
        dynamic = family(beam.shapes, link.nodes, [*rows.fixed, *rows.held], count)
    elif count:
        inner = [matrix[rows.free][:, rows.free] for matrix in (stiffness, mass)]
        if rows.frame.kind in _STILL:  # those that deform nothing have a singular stiffness
            inner = [as_array(matrix) for matrix in inner]
            dynamic[rows.free] = eigh(*inner, subset_by_index=(0, count - 1))[1]
        else:
            dynamic[rows.free] = lowest_modes(inner[0], inner[1], count)[1]
    transverse = np.hstack([_static(stiffness, rows.held, rows.free), dynamic])
    transverse = _orthogonal(transverse, stiffness, mass, link.length)
    return Shapes(axial, transverse[:, _STILL.get(rows.frame.kind, 0) :], rows.frame, rows.node)


def _inertial(stiffness: Matrix, mass: Matrix, loads: np.ndarray, loose: np.ndarray, count: int) -> np.ndarray:
    """Stretch by the inertia of axial motions ``loads``, then by that of the stretch itself, and so on.

    Load-dependent Ritz vectors (Wilson, Yuan & Dickens 1982) with the rows held that are not ``loose``. They converge
    faster than modes, and need no more than the solution of a static problem each.
    """
    found, inner, first = np.zeros((mass.shape[0], count)), stiffness[loose][:, loose], loads.shape[1]
    for k in range(count):
        moving = loads[:, k] if k < first else found[:, k - first]
        found[loose, k] = solve(inner, mass[loose] @ moving)
        for _ in range(2):  # twice is enough against rounding (Parlett 1998, 6-9)
            found[:, k] -= found[:, :k] @ (found[:, :k].T @ mass @ found[:, k])
        found[:, k] /= np.sqrt(found[:, k] @ mass @ found[:, k])
    return found


def _axial_loads(link: Link, rows: _Rows) -> np.ndarray:
    """A centrifugal acceleration about the point that holds the frame, and a uniform one; of a chord this one first."""
    found = np.zeros((3 * len(link.nodes), 2))
    found[0::3, 0], found[0::3, 1] = link.nodes - link.nodes[rows.node], 1.0
    return found[:, ::-1] if rows.frame.kind in IN_THE_MEAN else found


def _mean_free(axial: np.ndarray, mass: Matrix, frame: Frame) -> np.ndarray:
    """Axial shapes of a chord with zero mean displacement."""
    if frame.kind not in IN_THE_MEAN:
        return axial
    along = np.zeros(mass.shape[0])
    along[0::3] = 1.0
    weights = mass @ along
    return axial - np.outer(along, weights @ axial) / (weights @ along)


def spanned(shapes: Shapes, link: Link) -> Shapes:
    """Shapes that span the same space, orthogonal with respect to mass and stiffness.

    The equations need orthogonal shapes; the motion depends on their space alone.
    """
    stiffness, mass = (link.part.matrices[key].value({}) for key in ("K_s", "M"))
    still = np.zeros((mass.shape[0], 2))
    still[1::3] = np.column_stack([link.nodes - link.nodes[shapes.node], np.ones(len(link.nodes))])
    still[2::3, 0] = 1.0
    still = still[:, : _STILL.get(shapes.frame.kind, 0)]
    transverse = _orthogonal(np.hstack([still, shapes.transverse]), stiffness, mass, link.length)
    axial = _orthogonal(_mean_free(shapes.axial, mass, shapes.frame), stiffness, mass, link.length)
    return replace(shapes, axial=axial, transverse=transverse[:, still.shape[1] :])


def alike(shapes: Shapes, others: Shapes, length: float) -> Shapes:
    """Shapes of a link of a length [m], with size and sign of others at their largest displacements."""
    axial, transverse = (
        _scaled(own, length, other)
        for own, other in ((shapes.axial, others.axial), (shapes.transverse, others.transverse))
    )
    return replace(shapes, axial=axial, transverse=transverse)


@dataclass(frozen=True)
class _Rows:
    """Rows of a link's nodes: u that something can pull at, transverse ones that a reduction keeps, the other ones.

    ``fixed`` are those that hold the frame, at the node ``node`` first.
    """

    frame: Frame
    node: int
    fixed: list[int]
    pulled: list[int]
    held: list[int]
    free: np.ndarray

    @property
    def turns(self) -> bool:
        """True if one of the fixed-interface modes is a rotation of the undeformed link."""
        return self.frame.kind == "mean" and not self.held


def _rows(scene: Scene, link: Link) -> _Rows:
    found = stations(scene, link.name)
    frame = frame_of(found)
    first, last = (link.node_at(x) for x in (frame.at, frame.to))
    fixed = {
        "tangent": [3 * first + 1, 3 * first + 2], "mean": [3 * first + 1], "chord": [3 * first + 1, 3 * last + 1],
        "free": [],
    }[frame.kind]  # fmt: skip
    nodes = [(link.node_at(station.x), station) for station in found]
    kept = [3 * node + 1 for node, _ in nodes] + [3 * node + 2 for node, station in nodes if station.turned]
    held = sorted(set(kept) - set(fixed))
    pulled = [3 * node for node, _ in nodes if node != first]
    size = 3 * len(link.nodes)
    free = np.setdiff1d(np.arange(size), [*range(0, size, 3), *fixed, *held])
    return _Rows(frame, first, fixed, pulled, held, free)


def _static(stiffness: Matrix, held: list[int], free: np.ndarray) -> np.ndarray:
    """Shapes of unit displacements of the held rows, one at a time."""
    shapes = np.zeros((stiffness.shape[0], len(held)))
    shapes[held, np.arange(len(held))] = 1.0
    if held and len(free):
        shapes[free] = -solve(stiffness[free][:, free], as_array(stiffness[free][:, held]))
    return shapes


def _orthogonal(basis: np.ndarray, stiffness: Matrix, mass: Matrix, length: float) -> np.ndarray:
    """The same space by the modes within it, largest displacement +1."""
    if not basis.shape[1]:
        return basis
    _, mixed = eigh(basis.T @ stiffness @ basis, basis.T @ mass @ basis)
    return _scaled(basis @ mixed, length)


def _scaled(shapes: np.ndarray, length: float, others: np.ndarray | None = None) -> np.ndarray:
    """Shapes scaled to +1 at the largest displacement, of their own or of the others.

    One that only turns the nodes, as the fourth mode of four elements, has the displacement 1 where its rotation times
    the link's length [m] is.
    """
    looked_at, turns = shapes if others is None else others, (np.arange(len(shapes)) % 3 == 2)[:, None]
    displacements = np.where(turns, _TURNS * length * looked_at, looked_at)
    largest = abs(displacements).argmax(axis=0) if shapes.shape[1] else []
    return shapes / np.where(turns, length * shapes, shapes)[largest, np.arange(shapes.shape[1])]
