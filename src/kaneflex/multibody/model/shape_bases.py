"""Shapes of elastic links: static ones, fixed-interface modes, or functions of another family.

Shapes are found for each kind of motion of a link's finite elements: static ones of the points with joints or loads,
and modes with these points held (Craig & Bampton 1968).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from kaneflex.fem.links import Link, static_shapes
from kaneflex.fem.modes import lowest_modes
from kaneflex.mechanism.affine import Matrix, as_array, solve
from kaneflex.mechanism.floating_frames import IN_THE_MEAN, Frame, axial_modes, frame_of, stations
from kaneflex.mechanism.spatial import Side, spatial_mechanism_of
from kaneflex.multibody.model.damping import against_axes, axial_place, node_of
from kaneflex.multibody.model.shape_families import family
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.spatial_layout import Place
from kaneflex.scene import Scene
from kaneflex.support.spatial_contract import SPATIAL_NODE

_TURNS = 1e-6
"""Displacement of the nodes, as a share of the link's length times their rotation, below which a shape only rotates
them."""
_ALIKE = 1e-6  # share of the largest displacement within which the first one decides: symmetric shapes have two
_STILL = {"mean": 1, "free": 2}
"""Number of the lowest shapes without deformation, by the kind of frame, which has these motions itself: rotation,
translation."""
_KINDS = {("u",): 1, ("v", "theta_z"): 2, ("w", "theta_y"): 2, ("theta_x",): 1}
"""A node's coordinates of each kind, with the number of rigid-body motions of a free link."""
_NEAR = 0.99
"""Component of a joint's axis along one of the body's above which hardly any torque acts about that."""
_EQUAL = 1e-6  # relative distance of squared frequencies that are one's
_MORE = 4  # modes found beyond those requested, for those equal to the last one


def link_shapes(scene: Scene, link: Link, modes: int) -> Shapes:
    """Shapes of a planar link: static ones of the points where forces enter, and ``modes`` fixed-interface modes.

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
        loads = _axial_loads(link, rows.node, rows.frame.kind not in IN_THE_MEAN)
        inertial = _inertial(stiffness, mass, loads, loose, wanted)
        axial = np.hstack([static_shapes(stiffness, rows.pulled, loose), inertial])
        axial = _orthogonal(_mean_free(axial, mass, rows.frame), stiffness, mass, link)
    dynamic = np.zeros((mass.shape[0], count))
    if count and beam.shapes != "craig-bampton":
        dynamic = family(beam.shapes, link.nodes, [*rows.fixed, *rows.held], count)
    elif count:
        dynamic = _fixed_interface(stiffness, mass, rows.free, count, rows.frame.kind in _STILL)[1]
    transverse = np.hstack([static_shapes(stiffness, rows.held, rows.free), dynamic])
    transverse = _orthogonal(transverse, stiffness, mass, link)[:, _STILL.get(rows.frame.kind, 0) :]
    return _planar(scene, link, axial, transverse, rows.frame)


def _planar(scene: Scene, link: Link, axial: np.ndarray, transverse: np.ndarray, frame: Frame) -> Shapes:
    """Shapes of a link in the plane."""
    held = None if frame.kind in IN_THE_MEAN else frame.at
    return Shapes(scene, link, np.hstack([axial, transverse]), (axial.shape[1], transverse.shape[1]), held)


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


def _axial_loads(link: Link, node: int, swings: bool) -> np.ndarray:
    """A uniform acceleration, and a centrifugal one about a node; of a link that swings about it this one first."""
    found = np.zeros((link.dofs * len(link.nodes), 2))
    found[:: link.dofs, 0], found[:: link.dofs, 1] = 1.0, link.nodes - link.nodes[node]
    return found[:, ::-1] if swings else found


def _mean_free(axial: np.ndarray, mass: Matrix, frame: Frame) -> np.ndarray:
    """Axial shapes of a chord with zero mean displacement."""
    if frame.kind not in IN_THE_MEAN:
        return axial
    along = np.zeros(mass.shape[0])
    along[0::3] = 1.0
    weights = mass @ along
    return axial - np.outer(along, weights @ axial) / (weights @ along)


def spanned(scene: Scene, shapes: Shapes, link: Link) -> Shapes:
    """Shapes of a link of a scene that span the same space, orthogonal with respect to its mass and stiffness.

    The equations need orthogonal shapes; the motion depends on their space alone.
    """
    stiffness, mass = (link.part.matrices[key].value({}) for key in ("K_s", "M"))
    still, frame = np.zeros((mass.shape[0], 2)), frame_of(stations(scene, link.name))
    still[1::3] = np.column_stack([link.nodes - frame.at, np.ones(len(link.nodes))])
    still[2::3, 0] = 1.0
    still = still[:, : _STILL.get(frame.kind, 0)]
    transverse = _orthogonal(np.hstack([still, shapes.transverse]), stiffness, mass, link)
    axial = _orthogonal(_mean_free(shapes.axial, mass, frame), stiffness, mass, link)
    return _planar(scene, link, axial, transverse[:, still.shape[1] :], frame)


def alike(shapes: Shapes, others: Shapes) -> Shapes:
    """Shapes of a link with size and sign of others at their largest displacements."""
    return replace(shapes, basis=_scaled(shapes.basis, shapes.link, others.basis))


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
    first, last = (node_of(link, x) for x in (frame.at, frame.to))
    fixed = {
        "tangent": [3 * first + 1, 3 * first + 2], "mean": [3 * first + 1], "chord": [3 * first + 1, 3 * last + 1],
        "free": [],
    }[frame.kind]  # fmt: skip
    nodes = [(node_of(link, station.x), station) for station in found]
    kept = [3 * node + 1 for node, _ in nodes] + [3 * node + 2 for node, station in nodes if station.turned]
    held = sorted(set(kept) - set(fixed))
    pulled = [3 * node for node, _ in nodes if node != first]
    size = 3 * len(link.nodes)
    free = np.setdiff1d(np.arange(size), [*range(0, size, 3), *fixed, *held])
    return _Rows(frame, first, fixed, pulled, held, free)


def _fixed_interface(
    K: Matrix, M: Matrix, inner: np.ndarray, count: int, free: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Squared frequencies and shapes, zero but in the inner rows, of the lowest ``count`` modes; ``free``: some of them
    deform nothing."""
    own, found = [matrix[inner][:, inner] for matrix in (K, M)], np.zeros((K.shape[0], count))
    if free:  # with a singular stiffness
        squares, found[inner] = eigh(*map(as_array, own), subset_by_index=(0, count - 1))
    else:
        omega, found[inner] = lowest_modes(own[0], own[1], count)
        squares = omega**2
    return squares, found


def _orthogonal(basis: np.ndarray, K: Matrix, M: Matrix, link: Link) -> np.ndarray:
    """The same space by the modes within it, of ascending frequency, largest displacement +1."""
    if not basis.shape[1]:
        return basis
    return _scaled(basis @ eigh(basis.T @ K @ basis, basis.T @ M @ basis)[1], link)


def _scaled(shapes: np.ndarray, link: Link, others: np.ndarray | None = None) -> np.ndarray:
    """Shapes scaled to +1 at the largest displacement, of their own or of the others.

    One that only turns the nodes, as the fourth mode of four elements, has the displacement 1 where its rotation times
    the link's length is; twist has the rotation 1.
    """
    looked_at, place = shapes if others is None else others, np.array(link.motions)[np.arange(len(shapes)) % link.dofs]
    displacements = abs(np.where((place > 2)[:, None], _TURNS * link.length * looked_at, looked_at))
    largest = (displacements > (1 - _ALIKE) * displacements.max(axis=0)).argmax(axis=0) if shapes.shape[1] else []
    return shapes / np.where((place > 3)[:, None], link.length * shapes, shapes)[largest, np.arange(shapes.shape[1])]


def spatial_shapes(scene: Scene, link: Link, modes: int, held: Place | None, freed: str = "") -> Shapes:
    """Static shapes of the points with joints and loads, and ``modes`` modes of bending in either plane, fewer of
    stretch and twist, with these points held.

    ``held``: the place of the joint of the tree. ``freed``: axes, like "z" or "xyz", about which this joint leaves the
    rotation free, so that the section there turns relative to the link's axes (:func:`against_axes`). If shapes had
    angular momentum about such an axis, its rotation would have almost no inertia of its own (Buckens 1972).
    """
    x = None if held is None else held[0]
    first = None if x is None else node_of(link, x)
    joints, pushed = points_of(scene, link.name)
    kept = {node_of(link, at) for at in (*joints, *pushed)} - {first}
    about = {node_of(link, at): _twisted(scene, link.name, at) if first is not None else "xyz" for at in joints}
    if held is None and not about:
        about, kept = {0: "xyz"}, kept | {0}  # the remaining motions don't deform it
    twisted = {node: [SPATIAL_NODE.index(f"theta_{axis}") for axis in axes] for node, axes in about.items()}
    turning = [SPATIAL_NODE.index(f"theta_{axis}") for axis in freed]
    K, M = (link.part.matrices[name].value({}) for name in ("K_s", "M"))
    found, most = [], 6 * len(link.nodes)
    for kind, rigid in _KINDS.items():
        places = [SPATIAL_NODE.index(name) for name in kind]
        loose = [k for k in places if k in turning]
        rows = np.array([6 * n + k for n in range(len(link.nodes)) for k in places if n != first or k in loose])
        static = [6 * node + k for node in sorted(kept) for k in places if k < 3 or k in twisted.get(node, ())]
        static += [6 * first + k for k in loose if first is not None and k in twisted.get(first, ())]
        wanted = modes if len(places) == 2 else axial_modes(modes, len(link.nodes) - 1, len(kept) + 1)
        still = rigid if held is None else len(loose)
        if len(places) == 2:
            most = min(most, len(rows) - len(static))
        loads = _axial_loads(link, first or 0, len({*joints}) == 1) if kind == ("u",) else None
        own = _of_kind(link, rows, static, wanted + (len(loose) if not static else 0), loads)
        found.append(_orthogonal(against_axes(scene, link, own[:, still:], M, x), K, M, link))
    counts = tuple(own.shape[1] for own in found)
    return Shapes(scene, link, np.hstack(found), counts, axial_place(scene, link, x), most, bool(freed))


def points_of(scene: Scene, body: str) -> tuple[list[float], list[float]]:
    """Distances from a body's start [m] at which joints, and at which loads act."""
    mechanism = spatial_mechanism_of(scene)
    sides: Sequence[Side] = [side for joint in mechanism.joints.values() for side in joint.sides]
    loads = [load.at for load in mechanism.loads.values() if load.at is not None]
    return ([float(side.at[0]) for side in sides if side.body == body],
            [float(side.at[0]) for side in loads if side.body == body])  # fmt: skip


def _twisted(scene: Scene, body: str, x: float | None) -> str:
    """Axes of the body about which a torque can act on the section at x [m]: joints there act about all but their axes
    that are fixed in the body, balls and point masses about none; a drive, a torque or a spring at a joint there, a
    weld or a guide about any."""
    mechanism, found = spatial_mechanism_of(scene), set[str]()
    here = {name: (joint, joint.sides.index(side)) for name, joint in mechanism.joints.items()
            for side in joint.sides if side.body == body and side.at[0] == x
            if name not in scene.masses or mechanism.bodies[name].inertia.any() or mechanism.bodies[name].centre.any()
            }  # fmt: skip
    turned = {load.joint for load in mechanism.loads.values()} | {each.joint for each in mechanism.springs.values()}
    firm = any(joint.kind in ("weld", "prismatic") for joint, _ in here.values())
    if firm or here.keys() & (turned | mechanism.prescribed):
        return "xyz"
    for joint, number in here.values():
        if joint.axes:
            carried = joint.axes[number if len(joint.axes) > 1 else 0]
            own = mechanism.stands(body).T @ mechanism.stands(joint.sides[0].body) @ carried
            found |= {axis for axis, along in zip("xyz", own, strict=True) if abs(along) < _NEAR}
    return "".join(sorted(found))


def _of_kind(
    link: Link, rows: np.ndarray, static: list[int], modes: int, loads: np.ndarray | None = None
) -> np.ndarray:
    """Shapes over all rows, by ascending frequency of the link held at its axes.

    ``loads``: motions whose inertia gives shapes in the place of modes.
    """
    K, M = (link.part.matrices[name].value({}) for name in ("K_s", "M"))
    inner = np.setdiff1d(rows, static)
    modal = np.zeros((K.shape[0], 0))
    if loads is not None:
        modal = _inertial(K, M, loads, inner, modes)
    elif modes and len(inner):
        squares, modal = _fixed_interface(K, M, inner, min(modes + _MORE, len(inner)), not static)
        modal = modal[:, : _whole(squares, modes)]
    return _orthogonal(np.hstack([static_shapes(K, static, inner), modal]), K, M, link)


def _whole(squares: np.ndarray, count: int) -> int:
    """Number of modes: the first ``count`` of ascending squared frequencies, and those equal to the last of them.

    Any mixture of modes with equal frequencies, as of two spans of equal length, is a mode: only all of them together
    are independent of which end of the link is called its start.
    """
    last = min(count, len(squares)) - 1
    return int(np.searchsorted(squares, squares[last] + _EQUAL * abs(squares[last]), side="right"))
