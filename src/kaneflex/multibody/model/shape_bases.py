"""Shapes of elastic links: static ones, fixed-interface modes, or functions of another family.

Shapes are found for each kind of motion of a link's finite elements: static ones of the points with joints or loads,
and modes with these points held (Craig & Bampton 1968).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from kaneflex.fem.links import Link, static_shapes
from kaneflex.fem.modes import lowest_modes, symmetric_modes
from kaneflex.mechanism.affine import Matrix, as_array, solve
from kaneflex.mechanism.floating_frames import IN_THE_MEAN, Station, axial_modes, frame_of, stations
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.spatial import Side, SpatialMechanism
from kaneflex.multibody.model.damping import against_axes, axial_place, node_of
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.tree_layout import Place
from kaneflex.support.errors import SceneError

_TURNS = 1e-6
"""Displacement of the nodes, as a share of the link's length times their rotation, below which a shape only rotates
them."""
_ALIKE = 1e-6  # share of the largest displacement within which the first one decides: symmetric shapes have two
_KINDS = (((0,), 1), ((1, 5), 2), ((2, 4), 2), ((3,), 1))
"""Places of the coordinates of each kind among those of a node in space, with the number of rigid-body motions of a
free link; the first two kinds are those of the plane."""
_NEAR = 0.99
"""Component of a joint's axis along one of the body's above which hardly any torque acts about that."""
_EQUAL = 1e-6  # relative distance of squared frequencies that are one's
_SAME = 1e-9
"""Share of a link's length within which a point is its end."""
_MORE = 4  # modes found beyond those requested, for those equal to the last one


def link_shapes(link: Link, modes: int) -> Shapes:
    """Shapes of a planar link: static ones of the points where forces enter, and ``modes`` fixed-interface modes.

    The beam's ``shapes`` can put functions of another family in the place of these modes. Axial shapes are the stretch
    by forces at those points and by the link's own inertia.
    """
    found = stations(link.mechanism, link.name)
    frame = frame_of(found)
    points = {node_of(link, station.x): "z" * station.turned for station in found}
    first, freed = None if frame.kind == "free" else node_of(link, frame.at), "z" * (frame.kind != "tangent")
    return _shapes(link, modes, points, first, freed, frame.kind not in IN_THE_MEAN)


def _shapes(
    link: Link, modes: int, points: Mapping[int, str], first: int | None, freed: str, swings: bool,
    hung: float | None = None,
) -> Shapes:  # fmt: skip
    """Shapes of a link by kinds of motion.

    Parameters
    ----------
    points : mapping
        Node with joints or loads -> axes about which moments act on its section.
    first : int or None
        Node that holds the axes, but for turns about ``freed``; None: the axes have no momentum.
    swings : bool
        True if the link swings about that node.
    hung : float or None
        See :func:`against_axes`.
    """
    d, beam, found = link.dofs, link.body.beam, list[np.ndarray]()
    K, M = (link.part.matrices[name].value({}) for name in ("K_s", "M"))
    assert beam is not None
    most, turning = K.shape[0], [3 + "xyz".index(axis) for axis in freed]
    for kind, rigid in _KINDS[: 2 * d // 3]:
        if kind == (0,) and beam.axially_rigid:
            found.append(np.zeros((K.shape[0], 0)))
            continue
        bends, loose = len(kind) == 2, [motion for motion in kind if motion in turning]
        places = {motion: link.motions.index(motion) for motion in kind}
        rows = [d * n + k for n in range(len(link.nodes)) for k in places.values()]
        held = [] if first is None else [d * first + places[motion] for motion in kind if motion not in turning]
        static = [d * node + k for node, axes in sorted(points.items()) for motion, k in places.items()
                  if motion < 3 or "xyz"[motion - 3] in axes]  # fmt: skip
        static = [row for row in static if row not in held]
        inner = np.setdiff1d(rows, [*held, *static])
        if bends:
            most, count = min(most, len(rows) - len(held) - len(static)), modes
        else:
            count = axial_modes(modes, beam.elements, len({*points, first} - {None}))
        count += len(loose) if not static else 0
        if kind == (0,):
            modal = _inertial(K, M, _axial_loads(link, first or 0, swings), inner, count)
        elif beam.shapes != "craig-bampton" and count:
            modal = family(beam.shapes, link.nodes, [*held, *static], count)
        else:
            modal = _fixed_interface(K, M, inner, count, not static, d == 6)
        own = _orthogonal(np.hstack([static_shapes(K, static, inner), modal]), K, M, link)
        own = own[:, rigid if first is None else len(loose) :]
        found.append(_orthogonal(against_axes(link, own, M, hung), K, M, link))
    counts = tuple(own.shape[1] for own in found)
    return Shapes(link, np.hstack(found), counts, axial_place(link, hung), most, bool(freed))


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
    """A uniform acceleration, and a centrifugal one about a node; for a link that swings about it this one first."""
    found = np.zeros((link.dofs * len(link.nodes), 2))
    found[:: link.dofs, 0], found[:: link.dofs, 1] = 1.0, link.nodes - link.nodes[node]
    return found[:, ::-1] if swings else found


def spanned(shapes: Shapes, link: Link, hung: float | None = None) -> Shapes:
    """Shapes of another link that span the same space, orthogonal with respect to its mass and stiffness.

    The equations need orthogonal shapes; the motion depends on their space alone. ``hung``: see :func:`against_axes`.
    """
    K, M = (link.part.matrices[key].value({}) for key in ("K_s", "M"))
    kinds = np.split(shapes.basis, np.cumsum(shapes.counts)[:-1], axis=1)
    found = [_orthogonal(against_axes(link, own, M, hung), K, M, link) for own in kinds]
    return replace(shapes, link=link, basis=np.hstack(found), held=axial_place(link, hung))


def alike(shapes: Shapes, others: Shapes) -> Shapes:
    """Shapes of a link with size and sign of others at their largest displacements."""
    return replace(shapes, basis=_scaled(shapes.basis, shapes.link, others.basis))


def _fixed_interface(K: Matrix, M: Matrix, inner: np.ndarray, count: int, free: bool, alike: bool) -> np.ndarray:
    """Shapes, zero but in the inner rows, of the lowest ``count`` modes.

    ``free``: some of them deform nothing; ``alike``: with those of the same frequency as the last. Any mixture of modes
    with equal frequencies, as of two spans of equal length, is a mode: only all of them together are independent of
    which end of the link is called its start.
    """
    most = min(count + _MORE * alike, len(inner))
    own, found = [matrix[inner][:, inner] for matrix in (K, M)], np.zeros((K.shape[0], most * (count > 0)))
    if not found.shape[1]:
        return found
    if free:  # with a singular stiffness
        squares, found[inner] = symmetric_modes(as_array(own[0]), as_array(own[1]), most)
    else:
        omega, found[inner] = lowest_modes(own[0], own[1], most)
        squares = omega**2
    last = min(count, most) - 1
    return found[:, : int(np.searchsorted(squares, squares[last] + _EQUAL * abs(squares[last]), side="right"))]


def _orthogonal(basis: np.ndarray, K: Matrix, M: Matrix, link: Link) -> np.ndarray:
    """The same space by the modes within it, of ascending frequency, largest displacement +1."""
    if not basis.shape[1]:
        return basis
    K, M = (basis.T @ matrix @ basis for matrix in (K, M))
    return _scaled(basis @ symmetric_modes(K, M, len(K))[1], link)


def _scaled(shapes: np.ndarray, link: Link, others: np.ndarray | None = None) -> np.ndarray:
    """Shapes scaled to +1 at the largest displacement, of their own or of the others.

    One that only turns the nodes, as the fourth mode of four elements, has the displacement 1 where its rotation times
    the link's length is; twist has the rotation 1.
    """
    looked_at, place = shapes if others is None else others, np.array(link.motions)[np.arange(len(shapes)) % link.dofs]
    displacements = abs(np.where((place > 2)[:, None], _TURNS * link.length * looked_at, looked_at))
    largest = (displacements > (1 - _ALIKE) * displacements.max(axis=0)).argmax(axis=0) if shapes.shape[1] else []
    return shapes / np.where((place > 3)[:, None], link.length * shapes, shapes)[largest, np.arange(shapes.shape[1])]


def spatial_shapes(link: Link, modes: int, held: Place | None, freed: str = "") -> Shapes:
    """Static shapes of the points with joints and loads, and ``modes`` modes of bending in either plane, fewer of
    stretch and twist, with these points held.

    ``held``: the place of the joint of the tree. ``freed``: axes, like "z" or "xyz", about which this joint leaves the
    rotation free, so that the section there turns relative to the link's axes (:func:`against_axes`). If shapes had
    angular momentum about such an axis, its rotation would have almost no inertia of its own (Buckens 1972).
    """
    x = None if held is None else held[0]
    first = None if x is None else node_of(link, x)
    mechanism = link.mechanism
    joints, pushed = points_of(mechanism, link.name)
    points = dict.fromkeys([node_of(link, at) for at in pushed], "")
    points |= {node_of(link, at): _twisted(mechanism, link.name, at) if first is not None else "xyz" for at in joints}
    if held is None and not joints:
        points[0] = "xyz"  # the remaining motions don't deform it
    return _shapes(link, modes, points, first, freed, len({*joints}) == 1, x)


def points_of(mechanism: SpatialMechanism, body: str) -> tuple[list[float], list[float]]:
    """Distances from a body's start [m] at which joints, and at which loads and contacts act."""
    sides: Sequence[Side] = [side for joint in mechanism.joints.values() for side in joint.sides]
    loads = [load.point for load in mechanism.loads.values() if load.point is not None]
    loads += [side for contact in mechanism.contacts.values() for side in contact.sides]
    return ([float(side.at[0]) for side in sides if side.body == body],
            [float(side.at[0]) for side in loads if side.body == body])  # fmt: skip


def _twisted(mechanism: SpatialMechanism, body: str, x: float | None) -> str:
    """Axes of the body about which a torque can act on the section at x [m]: joints there act about all but their axes
    that are fixed in the body, balls and point masses about none; a drive, a torque or a spring at a joint there, a
    weld or a guide about any."""
    found = set[str]()
    points = {name for name in mechanism.lumped
              if not (mechanism.bodies[name].inertia.any() or mechanism.bodies[name].centre.any())}  # fmt: skip
    here = {name: (joint, joint.sides.index(side)) for name, joint in mechanism.joints.items() if name not in points
            for side in joint.sides if side.body == body and side.at[0] == x}  # fmt: skip
    turned = {load.joint for load in mechanism.loads.values()} | {each.joint for each in mechanism.springs.values()}
    turned |= {contact.joint for contact in mechanism.contacts.values()}
    firm = any(joint.kind in ("weld", "prismatic") for joint, _ in here.values())
    if firm or here.keys() & {*turned, *mechanism.prescribed}:
        return "xyz"
    for joint, number in here.values():
        if joint.axes:
            carried = joint.axes[number if len(joint.axes) > 1 else 0]
            own = mechanism.rest_axes(body).T @ mechanism.rest_axes(joint.sides[0].body) @ carried
            found |= {axis for axis, along in zip("xyz", own, strict=True) if abs(along) < _NEAR}
    return "".join(sorted(found))


def check_family(mechanism: NumericMechanism, name: str, elements: int, modes: int) -> None:
    """Check that a link's family of shapes suits its theory and joints, and is resolved by its ``elements``.

    Raises
    ------
    SceneError
        It names the link's ``beam.shapes``.
    """
    beam, length = mechanism.deforming[name].beam, mechanism.deforming[name].length
    if beam.shapes == "craig-bampton":
        return
    if beam.theory == "timoshenko":
        reason, cure = "these functions have no shear, unlike a Timoshenko beam", "Use craig-bampton, or another theory"
    elif beam.shapes == "sine" and not _between_ends(stations(mechanism, name), length):
        reason = "sines vanish at both ends of the link, and one of them is not pinned"
        cure = "Use craig-bampton or polynomial"
    elif beam.shapes == "clamped-free" and not _held_at_an_end(stations(mechanism, name), length):
        reason, cure = "these shapes are clamped at one end, but this link is pinned", "Use craig-bampton or polynomial"
    elif modes > elements:
        reason = f"{modes} of them need at least {modes} elements, the link has {elements}"
        cure = f"Give bodies.{name}.beam.elements, or use fewer modes"
    else:
        return
    raise SceneError(f"bodies.{name}.beam.shapes", beam.shapes, reason, cure)


def _between_ends(found: list[Station], length: float) -> bool:
    """True if a link has joints at both ends."""
    frame = frame_of(found)
    return frame.kind in IN_THE_MEAN and frame.at < _SAME * length and frame.to > (1 - _SAME) * length


def _held_at_an_end(found: list[Station], length: float) -> bool:
    """True if a link touches its frame's axis at its start or its end."""
    frame = frame_of(found)
    return frame.kind == "tangent" and not _SAME * length < frame.at < (1 - _SAME) * length


def family(word: str, X: np.ndarray, constrained: list[int], count: int) -> np.ndarray:
    """The lowest ``count`` functions of a family at a link's nodes.

    Parameters
    ----------
    word : str
        "sine", "clamped-free" or "polynomial".
    X : ndarray (n_nodes,)
        Distances of the nodes from the start [m].
    constrained : list of int
        Rows that are to stay at zero: all of polynomials, which have no ends of their own; where the first of them is
        of the last node, that is the clamped end.

    Returns
    -------
    ndarray (3 n_nodes, count)
        Rows u = 0, v, theta = dv/dX of each node in turn: the elements' cubic between them interpolates the function.
    """
    length = X[-1]
    x = X / length
    found = np.zeros((3 * len(X), count))
    if word == "sine":
        k = np.pi * np.arange(1, count + 1)
        found[1::3], found[2::3] = np.sin(np.outer(x, k)), k * np.cos(np.outer(x, k)) / length
        return found
    if word == "clamped-free":
        sign, x = (-1.0, 1.0 - x) if constrained[0] == len(found) - 2 else (1.0, x)
        for k in range(count):
            found[1::3, k], slope = clamped_free(k, x)
            found[2::3, k] = sign * slope / length
        return found
    return _polynomials(x, length, constrained, count)


def clamped_free(k: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenfunction k = 0, 1, ... of a uniform clamped-free beam at x = X / L, with its slope (Blevins 1979, ch. 8).

    cosh bx - cos bx - sigma (sinh bx - sin bx), its growing part written with (1 - sigma) e^b, which does not cancel.
    """
    from scipy.optimize import brentq  # 0.3 s: only where these shapes are used

    b = brentq(lambda z: np.cos(z) + 1 / np.cosh(z), k * np.pi, (k + 1) * np.pi, xtol=1e-14)
    decay = np.exp(-b)
    sigma = (1 - decay**2 - 2 * decay * np.sin(b)) / (1 + decay**2 + 2 * decay * np.cos(b))
    grown = 2 * (decay + np.cos(b) + np.sin(b)) / (1 + decay**2 + 2 * decay * np.cos(b))  # (1 - sigma) e^b
    growing, falling = grown * np.exp(b * (x - 1)) / 2, (1 + sigma) * np.exp(-b * x) / 2
    c, s = np.cos(b * x), np.sin(b * x)
    return growing + falling - c + sigma * s, b * (growing - falling + s + sigma * c)


def _polynomials(x: np.ndarray, length: float, constrained: list[int], count: int) -> np.ndarray:
    """Polynomials of the lowest degrees that vanish in the constrained rows, out of Legendre's."""
    several = np.polynomial.legendre.Legendre.basis
    basis = np.zeros((3 * len(x), count + len(constrained)))
    for k in range(basis.shape[1]):
        function = several(k, domain=[0.0, 1.0])
        basis[1::3, k], basis[2::3, k] = function(x), function.deriv()(x) / length
    rows = basis[constrained] * np.where(np.array(constrained) % 3 == 2, length, 1.0)[:, None]
    return basis @ np.linalg.svd(rows)[2][len(constrained) :].T
