"""Modal coordinates of elastic links: Craig-Bampton shapes of a link's own finite elements in its floating frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from kaneflex.carried import prescribed_bodies
from kaneflex.errors import SceneError
from kaneflex.links import Link, mesh
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shapes of one link at its nodes, one a column, rows u, v, theta of each node in turn.

    Attributes
    ----------
    axial, transverse : ndarray (3 n_nodes, n)
        Orthogonal with respect to mass and stiffness; the largest displacement of each is one.
    frame : str
        What the frame's x axis does: "tangent" touches the link at its start, "chord" passes through its farthest
        joint, "mean" leaves the bending no moment of momentum about the start (Buckens).
    fixed : tuple of int
        Rows that the frame takes the motion of.
    """

    axial: np.ndarray
    transverse: np.ndarray
    frame: str
    fixed: tuple[int, ...]

    @property
    def all(self) -> np.ndarray:
        """Axial shapes, then transverse ones."""
        return np.hstack([self.axial, self.transverse])


def shape_counts(scene: Scene, name: str, modes: int) -> tuple[int, int]:
    """Numbers of axial and of transverse shapes of a link, from its joints, loads and masses alone."""
    rows = _rows(scene, name, mesh(scene, name, scene.bodies[name].beam.elements))
    limit = len(rows.free) - rows.turns
    if modes > limit:
        raise SceneError(
            "solve.modes", modes, f"{name} has {limit} transverse fixed-interface modes",
            "Ask for fewer modes, or give the link more elements",
        )  # fmt: skip
    axial = 0 if scene.bodies[name].beam.axially_rigid else len(rows.pulled) + 1
    return axial, rows.transverse(modes)


def link_shapes(scene: Scene, link: Link, modes: int) -> Shapes:
    """Static shapes of the points where forces enter, and ``modes`` fixed-interface modes (Craig & Bampton 1968).

    Axial shapes are the stretch by forces at those points and by the link's own centrifugal load.
    """
    rows = _rows(scene, link.name, link.nodes)
    stiffness, mass = (link.part.matrices[key].at({}).toarray() for key in ("K_s", "M"))
    u = 3 * np.arange(len(link.nodes))
    axial = np.zeros((len(mass), 0))
    if not scene.bodies[link.name].beam.axially_rigid:
        loose = np.setdiff1d(u[1:], rows.pulled)
        inertia = np.zeros((len(mass), 1))
        inertia[loose, 0] = np.linalg.solve(stiffness[np.ix_(loose, loose)], mass[np.ix_(loose, u)] @ link.nodes)
        axial = _orthogonal(np.hstack([_static(stiffness, rows.pulled, loose), inertia]), stiffness, mass)
    count = modes + rows.turns
    dynamic = np.zeros((len(mass), count))
    if count:
        square = np.ix_(rows.free, rows.free)
        dynamic[rows.free] = eigh(stiffness[square], mass[square], subset_by_index=(0, count - 1))[1]
    transverse = _orthogonal(np.hstack([_static(stiffness, rows.held, rows.free), dynamic]), stiffness, mass)
    # In the mean frame the lowest of them is the turn of the undeformed link, which the frame itself makes.
    return Shapes(axial, transverse[:, transverse.shape[1] - rows.transverse(modes) :], rows.frame, (0, *rows.fixed))


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

    def transverse(self, modes: int) -> int:
        return len(self.held) + modes - (self.frame == "mean" and bool(self.held))


def _rows(scene: Scene, name: str, nodes: np.ndarray) -> _Rows:
    points = _points(scene, name, nodes)
    frame, fixed = _frame(points)
    held = sorted({row for point in points for row in point.rows} - set(fixed))
    pulled = sorted({3 * point.node for point in points if point.node})
    free = np.setdiff1d(np.arange(3 * len(nodes)), [*range(0, 3 * len(nodes), 3), *fixed, *held])
    return _Rows(frame, fixed, pulled, held, free)


@dataclass
class _Point:
    """A node at which joints, loads or masses act: whether they turn its section, and whether they prescribe its turn."""

    node: int
    joined: bool = False
    turned: bool = False
    clamped: bool = False

    @property
    def rows(self) -> tuple[int, ...]:
        """Transverse rows that a reduction must keep."""
        return (3 * self.node + 1, 3 * self.node + 2) if self.turned else (3 * self.node + 1,)


def _points(scene: Scene, name: str, nodes: np.ndarray) -> list[_Point]:
    found: dict[int, _Point] = {}
    placed = prescribed_bodies(scene)

    def at(address: Address) -> _Point:
        node = int(np.argmin(abs(nodes - scene.point(address)[0])))
        return found.setdefault(node, _Point(node))

    torques = {load.torque_at for load in scene.torques.values()}
    for joint_name, joint in scene.joints.items():
        driven = joint_name in scene.drives and scene.drives[joint_name].kind != "free"
        stiff = joint.kind != "revolute" or driven
        for own, other in (joint.addresses, joint.addresses[::-1]):
            if own.body == name:
                point = at(own)
                point.joined = True
                point.turned |= stiff or joint_name in torques
                point.clamped |= stiff and other.body in placed
    for address in [load.force_on for load in scene.forces.values()] + [mass.at for mass in scene.masses.values()]:
        if address.body == name:
            at(address)
    for mass in scene.masses.values():
        if mass.at.body == name and mass.inertia:
            at(mass.at).turned = True
    return [found[node] for node in sorted(found)]


def _frame(points: list[_Point]) -> tuple[str, list[int]]:
    """How the floating frame hangs on the link, and the transverse rows that it takes the motion of.

    The frame of a link that turns freely must not be one that its shapes can turn on the spot: mass would be lost.
    """
    joined = [point for point in points if point.joined]
    if not joined or joined[0].node or joined[0].clamped:
        return "tangent", [1, 2]
    if len(joined) > 1:
        return "chord", [1, 3 * joined[-1].node + 1]
    return "mean", [1]


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
    shapes = basis @ mixed
    displacements = np.where((np.arange(len(shapes)) % 3 == 2)[:, None], 0.0, shapes)
    largest = displacements[abs(displacements).argmax(axis=0), np.arange(shapes.shape[1])]
    return shapes / largest
