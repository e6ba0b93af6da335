"""Positions of a mechanism's points when its links bend, including the effect of each link's shortening on the others.

A link that bends by v(x) is shortened by s(x) = 1/2 int_0^x v'^2 between its start and x. The joined links must follow:
to second order in the deformation, the mechanism responds to the shortening as to an initial strain, with the least
elastic energy. With L z the displacement of the joints and s the shortening there, w = L z + s strains the link, hence

    min 1/2 sum w^T K w  =>  S z = -sum L^T K s,  S = sum L^T K L

with the link's stiffness K condensed to its joints. In a mechanism the links then move as rigid bodies, without strain.
Drives are fixed. Undetermined motions (bodies that hang freely) are minimal. S and L turn with the bodies:

    S z' = g' - S' z,   S z'' = g'' - 2 S' z' - S'' z   with g = -sum L^T K s.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from kaneflex.fem.coordinate_map import Frame
from kaneflex.fem.links import Link, static_shapes
from kaneflex.mechanism.affine import Affine, as_array
from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.deformation import Deformation, follow
from kaneflex.response.reactions import Solver
from kaneflex.support.weak_cache import WeakCache

_LEAST = 1e-11
"""Stiffness, as a share of each coordinate's own, that keeps undetermined motions small."""
_CHUNK = 2_000_000
"""Numbers in one batch of matrices: 16 MB."""


class Displaced(NamedTuple):
    """Deformations of all links and the coordinates of carried rigid bodies, foreshortening included.

    ``coordinates``: z, z', z'', each (n, n_times), for :func:`kaneflex.response.deformation.follow`.
    """

    links: Mapping[str, Deformation]
    coordinates: Rates


def displaced(
    model: Model, rigid: RigidMotion, coordinates: Rates, links: Mapping[str, Deformation], solver: Solver | None = None
) -> Displaced:
    """Deformed links, moved by foreshortening if the model includes it.

    ``solver`` solves the linear equations, by default NumPy's.
    """
    if not (links and model.options.foreshortening):
        return Displaced(links, coordinates)
    joined = _JOINED.of(model.frame, lambda: _joined(model))
    s = {name: _shortening(model, found) for name, found in links.items()}
    moved = _closing(model, rigid, joined, s, solver or _direct)
    shortened = {}
    for name, found in links.items():
        end = joined.ends[name]
        strained = (part + own for part, own in zip(follow(model, rigid, moved, end.L), s[name], strict=True))
        own = tuple(found.link.at_nodes(end.shapes @ part) for part in strained)
        shortened[name] = found.closed_by(own)
    return Displaced(shortened, tuple(z + more for z, more in zip(coordinates, moved, strict=True)))


class _End(NamedTuple):
    """A link as seen from its joints.

    Attributes
    ----------
    L : Affine (rows, n)
        Matrix of the joints' coordinates.
    shapes : ndarray (size, rows)
        Static shapes of unit displacements of the joints.
    pushes : tuple of Affine (n_used, rows)
        Matrix -dg/ds, L^T times K condensed to the joints, and its first and second rates.
    """

    L: Affine
    shapes: np.ndarray
    pushes: tuple[Affine, Affine, Affine]


class _Joined(NamedTuple):
    """All links as seen from their joints, independent of the motion: models with the same equations share it.

    Attributes
    ----------
    ends : mapping of str to _End
    used : ndarray (n_used,)
        Coordinates of the mechanism that move a joint.
    S : tuple of Affine (n_used, n_used)
        Matrix S and its first and second rates.
    """

    ends: Mapping[str, _End]
    used: np.ndarray
    S: tuple[Affine, Affine, Affine]


_JOINED: WeakCache[Frame, _Joined] = WeakCache()


def _joined(model: Model) -> _Joined:
    size = model.equations.size
    statics = {name: _statics(model, link) for name, link in model.links.items()}
    used = np.flatnonzero(sum(as_array(L.pattern()).sum(axis=0) for L, _, _ in statics.values()))
    pick = np.eye(size)[:, used]
    ends, S = {}, Affine.zero(len(used), len(used))
    for name, (L, shapes, stiffness) in statics.items():
        push = L.T @ Affine.constant(stiffness)
        S += (push @ L).congruent(pick)
        ends[name] = _End(L, shapes, _with_rates(push.projected(pick)))
    return _Joined(ends, used, _with_rates(S))


def _with_rates(affine: Affine) -> tuple[Affine, Affine, Affine]:
    return affine, affine.rate, affine.rate.rate


def _statics(model: Model, link: Link) -> tuple[Affine, np.ndarray, np.ndarray]:
    """L, shapes, and stiffness condensed to the joints (rows, rows) of a link."""
    part, held = link.part, sorted(model.interfaces.held_rows(link.part))
    assembled = model.parts[link.name].coordinates
    pick = np.zeros((len(held), len(assembled)))
    pick[np.arange(len(held)), [assembled.index(part.coordinates[row]) for row in held]] = 1.0
    free = np.delete(np.arange(part.size), held)
    stiffness = part.matrices["K_s"].value({})
    shapes = static_shapes(stiffness, held, free, turns=len(held) < 3)  # on a single pin it turns as a rigid body
    return Affine.constant(pick) @ model.frame.maps[link.name], shapes, shapes.T @ (stiffness @ shapes)


def _shortening(model: Model, found: Deformation) -> Rates:
    """Shortening between the link's start and each joint, in the rows along the link; (rows, n_times)."""
    link, held = found.link, sorted(model.interfaces.held_rows(found.link.part))
    s = np.zeros((3, len(held), found.q.shape[1]), found.q.dtype)
    for name, node in model.interfaces.displaced:
        if name == link.name:
            s[:, held.index(link.part.place[node][0])] = found.foreshortening(float(link.nodes[node]))
    return s[0], s[1], s[2]


def _direct(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.solve(matrix, right[..., None])[..., 0]


def _closing(
    model: Model, rigid: RigidMotion, joined: _Joined, shortening: Mapping[str, Rates], solver: Solver
) -> Rates:
    """Coordinates z due to shortening, and rates; (n, n_times)."""
    used = joined.used
    found = np.zeros((3, model.equations.size, len(rigid.times)), rigid.values.dtype)
    if not len(used):
        return tuple(found)
    g = np.zeros((3, len(used), len(rigid.times)), rigid.values.dtype)
    for name, (s, s_rate, s_accel) in shortening.items():
        push, first, second = joined.ends[name].pushes
        g[0] -= rigid.apply(push, s)
        g[1] -= rigid.apply(first, s) + rigid.apply(push, s_rate)
        g[2] -= rigid.apply(second, s) + 2 * rigid.apply(first, s_rate) + rigid.apply(push, s_accel)
    batch = max(1, _CHUNK // len(used) ** 2)
    for start in range(0, len(rigid.times), batch):
        rows = slice(start, start + batch)
        batch_motion = RigidMotion(rigid.motion, rigid.times[rows], rigid.values[rows])
        stiff, rate, accel = map(batch_motion.matrices, joined.S)
        for part in (stiff, rate, accel):  # all alike, so that z' and z'' are the rates of z
            np.einsum("tii->ti", part)[...] *= 1.0 + _LEAST
        diagonal = np.einsum("tii->ti", stiff)
        diagonal[~diagonal.astype(bool)] = _LEAST
        push, push_rate, push_accel = (part[:, rows].T for part in g)
        z = solver(stiff, push)
        z_rate = solver(stiff, push_rate - (rate @ z[..., None])[..., 0])
        z_accel = solver(stiff, push_accel - (2 * rate @ z_rate[..., None] + accel @ z[..., None])[..., 0])
        for order, part in enumerate((z, z_rate, z_accel)):
            found[order][used, rows] = part.T
    return tuple(found)
