"""Modal coordinates of elastic links: shapes of a link's own finite elements in its floating frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from kaneflex.coupled.families import family
from kaneflex.links import Link
from kaneflex.scene import Scene
from kaneflex.scene.floating import frame_of, stations


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shapes of one link at its nodes, one a column, rows u, v, theta of each node in turn.

    Attributes
    ----------
    axial, transverse : ndarray (3 n_nodes, n)
        Orthogonal with respect to mass and stiffness; the largest displacement of each is one.
    frame : str
        What the frame's x axis does, see :func:`kaneflex.scene.floating.frame_of`.
    fixed : tuple of int
        Rows without which the link can't move as a whole.
    """

    axial: np.ndarray
    transverse: np.ndarray
    frame: str
    fixed: tuple[int, ...]

    @property
    def all(self) -> np.ndarray:
        """Axial shapes, then transverse ones."""
        return np.hstack([self.axial, self.transverse])


def link_shapes(scene: Scene, link: Link, modes: int) -> Shapes:
    """Static shapes of the points where forces enter, and ``modes`` fixed-interface modes (Craig & Bampton 1968).

    The beam's ``shapes`` can put functions of another family in the place of these modes. Axial shapes are the stretch
    by forces at those points and by the link's own centrifugal load.
    """
    rows = _rows(scene, link)
    count = modes + rows.turns
    stiffness, mass = (link.part.matrices[key].at({}).toarray() for key in ("K_s", "M"))
    u = 3 * np.arange(len(link.nodes))
    beam = scene.bodies[link.name].beam
    axial = np.zeros((len(mass), 0))
    if not beam.axially_rigid:
        loose = np.setdiff1d(u[1:], rows.pulled)
        inertia = np.zeros((len(mass), 1))
        inertia[loose, 0] = np.linalg.solve(stiffness[np.ix_(loose, loose)], mass[np.ix_(loose, u)] @ link.nodes)
        axial = _orthogonal(np.hstack([_static(stiffness, rows.pulled, loose), inertia]), stiffness, mass)
    dynamic = np.zeros((len(mass), count))
    if count and beam.shapes != "craig-bampton":
        dynamic = family(beam.shapes, link.nodes, [*rows.fixed, *rows.held], count)
    elif count:
        square = np.ix_(rows.free, rows.free)
        dynamic[rows.free] = eigh(stiffness[square], mass[square], subset_by_index=(0, count - 1))[1]
    transverse = _orthogonal(np.hstack([_static(stiffness, rows.held, rows.free), dynamic]), stiffness, mass)
    # In the mean frame the lowest of them is the turn of the undeformed link, which the frame itself makes.
    turns = rows.frame == "mean"
    fixed = (*rows.fixed, len(mass) - 2) if turns else rows.fixed
    return Shapes(axial, transverse[:, turns:], rows.frame, (0, *fixed))


def spanned(shapes: Shapes, link: Link) -> Shapes:
    """The space that some shapes span, by the modes of a link within it.

    The equations take shapes that are orthogonal; the motion knows their space alone.
    """
    stiffness, mass = (link.part.matrices[key].at({}).toarray() for key in ("K_s", "M"))
    turn = np.zeros((len(mass), 1 if shapes.frame == "mean" else 0))
    turn[1::3], turn[2::3] = link.nodes[:, None], 1.0
    transverse = _orthogonal(np.hstack([turn, shapes.transverse]), stiffness, mass)[:, turn.shape[1] :]
    return replace(shapes, axial=_orthogonal(shapes.axial, stiffness, mass), transverse=transverse)


def alike(shapes: Shapes, others: Shapes) -> Shapes:
    """The shapes with the size and sign of others where those are largest."""
    return replace(
        shapes, axial=_scaled(shapes.axial, others.axial), transverse=_scaled(shapes.transverse, others.transverse)
    )


@dataclass(frozen=True)
class _Rows:
    """Rows of a link's nodes: u that something can pull at, transverse ones that a reduction keeps, the other ones."""

    frame: str
    fixed: list[int]
    pulled: list[int]
    held: list[int]
    free: np.ndarray

    @property
    def turns(self) -> bool:
        """Whether one of the fixed-interface modes is a turn of the undeformed link."""
        return self.frame == "mean" and not self.held


def _rows(scene: Scene, link: Link) -> _Rows:
    found = stations(scene, link.name)
    frame = frame_of(found)
    nodes = [(link.node_at(station.x), station) for station in found]
    fixed = {"tangent": [1, 2], "mean": [1]}.get(frame) or [1, 3 * max(n for n, station in nodes if station.joined) + 1]
    kept = [3 * node + 1 for node, _ in nodes] + [3 * node + 2 for node, station in nodes if station.turned]
    held = sorted(set(kept) - set(fixed))
    pulled = [3 * node for node, _ in nodes if node]
    size = 3 * len(link.nodes)
    free = np.setdiff1d(np.arange(size), [*range(0, size, 3), *fixed, *held])
    return _Rows(frame, fixed, pulled, held, free)


def _static(stiffness: np.ndarray, held: list[int], free: np.ndarray) -> np.ndarray:
    """Shapes of unit displacements of the held rows, one at a time."""
    shapes = np.zeros((len(stiffness), len(held)))
    shapes[held, np.arange(len(held))] = 1.0
    if held and len(free):
        shapes[free] = -np.linalg.solve(stiffness[np.ix_(free, free)], stiffness[np.ix_(free, held)])
    return shapes


def _orthogonal(basis: np.ndarray, stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """The same space by the modes within it, largest displacement +1."""
    if not basis.shape[1]:
        return basis
    _, mixed = eigh(basis.T @ stiffness @ basis, basis.T @ mass @ basis)
    return _scaled(basis @ mixed)


def _scaled(shapes: np.ndarray, others: np.ndarray | None = None) -> np.ndarray:
    """Each with +1 where its displacement, or that of the other one, is largest."""
    looked_at = shapes if others is None else others
    displacements = np.where((np.arange(len(shapes)) % 3 == 2)[:, None], 0.0, looked_at)
    largest = abs(displacements).argmax(axis=0) if shapes.shape[1] else []
    return shapes / shapes[largest, np.arange(shapes.shape[1])]
