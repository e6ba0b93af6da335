"""Shapes of an elastic link in its floating frame, and their integrals over its length and mass.

A link's finite elements have uncoupled kinds of motion: axial and transverse ones, in space also bending in the second
plane and twist. A planar link is one of space whose shapes are u, v and theta_z alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement, permutations

import numpy as np
from numpy.polynomial import legendre

from kaneflex.fem.links import GAUSS, Link
from kaneflex.generated import shapes as planar
from kaneflex.generated import spatial_shapes as spatial
from kaneflex.generated.spatial_shapes import CUBIC, MOMENTS
from kaneflex.multibody.model.damping import against_axes, shape_damping
from kaneflex.multibody.model.tree_layout import Place
from kaneflex.support.contract import AXES

_AT = legendre.legvander(GAUSS[0], 4)
_RATES = np.column_stack([legendre.legval(GAUSS[0], legendre.legder(one)) for one in np.eye(5)]) @ np.linalg.inv(_AT)
"""Derivatives at Gauss's points on -1..1 of a polynomial by its values there."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shapes of a link at its nodes, one a column, rows of each node's coordinates in turn.

    Attributes
    ----------
    link : Link
    basis : ndarray (dofs n_nodes, count)
        Orthogonal with respect to mass and stiffness; the largest displacement of each is one, of twist the rotation.
        Zero where the link's axes are held, but for turns about freed ones. With free axes the shapes have no momentum.
    counts : tuple of int
        Shapes of each kind, which follow each other in ``basis``: axial and transverse; in space of stretch, of bending
        in either plane, and of twist.
    held : float or None
        Distance from the start of the section that has no displacement along the axes [m]; None: the link has none in
        the mean over its mass.
    most : int
        Modes of bending that the elements of a link in space have in either plane, beside the static shapes.
    pinned : bool
        True if the axes of a link in space follow the section at ``held`` about some axes, the mean about others.
    """

    link: Link
    basis: np.ndarray
    counts: tuple[int, ...]
    held: float | None
    most: int = 0
    pinned: bool = False

    @property
    def count(self) -> int:
        return self.basis.shape[1]

    @property
    def axial(self) -> np.ndarray:
        return self.basis[:, : self.counts[0]]

    @property
    def transverse(self) -> np.ndarray:
        """Shapes other than axial ones."""
        return self.basis[:, self.counts[0] :]

    @property
    def twisting(self) -> np.ndarray:
        """True for shapes of twist, (count,): their coordinates are angles [rad]."""
        return np.repeat(np.arange(len(self.counts)) == 3, self.counts)

    def carrier(self, at: Place) -> Place:
        """Place on the axis whose section carries a point."""
        return float(at[0]), 0.0, 0.0

    def at(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the shapes at a place, (dofs, count): displacements, rotations; and G (3, count, count) [1/m]."""
        e, local = self.link.locate(place[0])
        d = self.link.dofs
        rows = self.link.shape(e, local)[:d] @ self.basis[d * e : d * (e + 2)]
        return rows, _along(self._start - self._shortening(place[0]))

    def spread(self, first: float, last: float) -> tuple[float, float, np.ndarray, np.ndarray]:
        """Integrals of a function that changes linearly from ``first`` at the start to ``last`` at the end: of itself,
        times x, times the rows, and times G of :meth:`at`."""
        x, lengths, _, rows, H = self._slices
        weight = lengths * (first + (last - first) * x / self.link.length)
        apart = np.einsum("g,gjk->jk", weight, self._start - H)
        return float(weight.sum()), float(weight @ x), np.einsum("g,gaj->aj", weight, rows), _along(apart)

    @property
    def shortened(self) -> np.ndarray:
        """True for every two shapes whose amplitudes together shorten the axis, (count, count)."""
        return (self._squares != 0.0).any(axis=(0, 1))

    @cached_property
    def turn(self) -> np.ndarray:
        """Rotation of the axes of the planar model about the body's x, y, z by each shape, (3, count) [rad/m]."""
        M = self.link.part.matrices["M"].value({})
        return (self.basis - against_axes(self.link, self.basis, M))[3:6]

    def numbers(self) -> np.ndarray:
        """Parameters of :mod:`kaneflex.generated.spatial_shapes`."""
        return self.moments.numbers(self.counts, self.stiffness, self.damping, self.cubic)

    @cached_property
    def moments(self) -> ShapeMoments:
        """Integrals over the sections with their fibres at y and z.

        A section that bends the shortest way by theta_y and theta_z and then turns by theta_x about itself moves these
        to the second order by

            y (theta_x theta_y, -(theta_x^2 + theta_z^2) / 2, theta_y theta_z / 2)
            z (theta_x theta_z, theta_y theta_z / 2, -(theta_x^2 + theta_y^2) / 2)
        """
        x, _, (dm, *inertias), rows, H = self._slices
        moved = np.zeros((len(x), 6, self.count))
        moved[:, list(self.link.motions)] = rows
        N, psi = moved[:, :3], moved[:, 3:]
        if not self.link.body.profile.rotary:
            psi[:, 1:] = 0.0  # then a section does not turn against its axes by bending
        turned, still = psi.transpose(1, 0, 2), np.zeros_like(psi[:, 0])
        first = [np.stack(of, axis=1) for of in ((-turned[2], still, turned[0]), (turned[1], -turned[0], still))]
        xx, yy, zz, xy, xz, yz = (
            np.einsum("gj,gl->gjl", turned[a], turned[b]) for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        )
        second = [np.stack([0.5 * (of + of.transpose(0, 2, 1)) for of in (a, b, c)], axis=1)
                  for a, b, c in ((2.0 * xy, -(xx + zz), yz), (2.0 * xz, yz, -(xx + yy)))]  # fmt: skip
        apart = self._start - H
        N_N = np.einsum("g,gaj,gbl->abjl", dm, N, N)
        r_N, r_G = np.zeros((3, 3, self.count)), np.zeros((3, 3, self.count, self.count))
        r_N[0], r_G[0] = np.einsum("g,gaj->aj", dm * x, N), _along(np.einsum("g,gjl->jl", dm * x, apart))
        for k, (w, of, of_pairs) in enumerate(zip(inertias, first, second, strict=False), 1):
            N_N += np.einsum("g,gaj,gbl->abjl", w, of, of)
            r_N[k], r_G[k] = np.einsum("g,gaj->aj", w, of), np.einsum("g,gajl->ajl", w, of_pairs)
        G = _along(np.einsum("g,gjl->jl", dm, apart))
        at = self.held if self.held is not None else float(dm @ x / dm.sum())
        line = (at, float(dm @ (x - at) ** 2)) if self.pinned else None
        return ShapeMoments(np.einsum("g,gaj->aj", dm, N), r_N, N_N, G, r_G, line)

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Stiffness of the modal coordinates [N/m], diagonal."""
        K = self.link.part.matrices["K_s"].value({})
        return np.diag(np.diag(self.basis.T @ K @ self.basis))

    @cached_property
    def damping(self) -> np.ndarray:
        """Damping of the modal coordinates [N s/m]."""
        found = shape_damping(self.link, self.basis)
        return (found + found.T) / 2

    @cached_property
    def cubic(self) -> np.ndarray:
        """Third derivatives of the strain energy by the modal coordinates, halved [N/m^2], (count, count, count).

        Of a section that bends by theta_y, theta_z the shortest way and then turns by theta_x, the curvatures are

            theta_x' - (theta_y theta_z' - theta_z theta_y') / 2
            theta_y' + theta_x theta_z'
            theta_z' - theta_x theta_y'

        to second order (Hodges & Dowell 1974, NASA TN D-7818): bending in one plane twists what bends in the other one.
        """
        of, (_, weights, _) = self.link.parameters, self.link.gauss
        turned = self._rows[:, :, 3:6]
        rates = np.einsum("gh,ehaj->egaj", _RATES, turned) * (2.0 / of["length"])[:, None, None, None]
        x, y, z, x_s, y_s, z_s = np.concatenate([turned, rates], axis=2).reshape(-1, 6, self.count).swapaxes(0, 1)
        bending = weights * (self.link.at_points("E_I_z") - self.link.at_points("E_I_y"))
        twist = 0.5 * weights * of["G_J"][:, None]
        found = np.zeros((self.count,) * 3)
        for factor, a, b, c in ((-twist, x_s, y, z_s), (twist, x_s, z, y_s), (-bending, x, y_s, z_s)):
            found += np.einsum("gi,gj,gk->ijk", factor.reshape(-1, 1) * a, b, c, optimize=True)
        return np.sum([np.transpose(found, order) for order in permutations(range(3))], axis=0) / 2.0

    @cached_property
    def _rows(self) -> np.ndarray:
        """Rows of the link's shape functions at Gauss's points of each element by the shapes, (elements, 5, rows,
        count)."""
        of_nodes = self.basis.reshape(-1, self.link.dofs, self.count)
        return self.link.gauss[2] @ np.concatenate([of_nodes[:-1], of_nodes[1:]], axis=1)[:, None]

    @cached_property
    def _slices(self) -> tuple[np.ndarray, ...]:
        """Places [m] and lengths [m] of the slices, their masses and rotary inertias, rows (n, dofs, count), and the
        shortening from the start to each, (n, count, count)."""
        (x, weights, _), squares = self.link.gauss, self._squares
        inner = np.einsum("gh,ehjk->egjk", _up_to(GAUSS[0]), squares)
        H = self._before[:-1, None] + 0.5 * self.link.parameters["length"][:, None, None, None] * inner
        inertias = np.array([weights * self.link.at_points(name) for name in self.link.densities])
        rows = self._rows[:, :, : self.link.dofs].reshape(-1, self.link.dofs, self.count)
        return x.ravel(), weights.ravel(), inertias.reshape(len(inertias), -1), rows, H.reshape(-1, *H.shape[2:])

    @cached_property
    def _squares(self) -> np.ndarray:
        """Shortening per length v_j' v_k' + w_j' w_k' + I_p / A theta_x,j' theta_x,k' at the points of ``_rows``."""
        slopes = self._rows[:, :, self.link.shortening]
        return slopes.swapaxes(2, 3) @ slopes

    @cached_property
    def _before(self) -> np.ndarray:
        """Shortening from the start to every node, (n_nodes, count, count)."""
        over = np.einsum("eg,egjk->ejk", self.link.gauss[1], self._squares)
        return np.concatenate([np.zeros((1, *over.shape[1:])), np.cumsum(over, axis=0)])

    def _shortening(self, x: float) -> np.ndarray:
        """Shortening from the start to x [m]."""
        e, local = self.link.locate(x)
        length = self.link.length_of(e)
        return self._before[e] + 0.5 * length * np.tensordot(_up_to(2.0 * local / length - 1.0), self._squares[e], 1)

    @cached_property
    def _start(self) -> np.ndarray:
        """Reference of the shortening: at the point that holds the axes, else its mean over the mass."""
        if self.held is not None:
            return self._shortening(self.held)
        _, _, (dm, *_), _, H = self._slices
        return np.einsum("g,gjl->jl", dm / dm.sum(), H)


def _up_to(t: float | np.ndarray) -> np.ndarray:
    """Weights (..., 5) of values at Gauss's points in the integral from -1 to t, exact up to the fourth degree: by the
    expansion in Legendre's polynomials, int P_k = (P_k+1 - P_k-1) / (2 k + 1)."""
    P = legendre.legvander(t, 5).reshape(*np.shape(t), 6)
    return 0.5 * GAUSS[1] * (1.0 + P[..., 1:2] + (P[..., 2:] - P[..., :-2]) @ _AT[:, 1:].T)


def _along(x: np.ndarray) -> np.ndarray:
    """Numbers of every two shapes (count, count) as the x of vectors, (3, count, count)."""
    return np.stack([x, np.zeros_like(x), np.zeros_like(x)])


@dataclass(frozen=True, eq=False)
class ShapeMoments:
    """Integrals over the mass dm, of particles at r = (x, y, z) that shapes move by N q + 1/2 G q q in the body's axes.

    Attributes
    ----------
    N : ndarray (3, count)
        Of N dm [kg].
    r_N : ndarray (3, 3, count)
        Of r N dm [kg m], the components of r first.
    N_N : ndarray (3, 3, count, count)
        Of N_j N_k dm [kg], components first.
    G : ndarray (3, count, count)
        Of G dm [kg/m].
    r_G : ndarray (3, 3, count, count)
        Of r G dm [kg].
    line : tuple or None
        For a straight beam along x that is pinned: place of the pin [m], and integral of its squared distance [kg m^2];
        None for other bodies.
    """

    N: np.ndarray
    r_N: np.ndarray
    N_N: np.ndarray
    G: np.ndarray
    r_G: np.ndarray
    line: tuple[float, float] | None = None

    def numbers(
        self, counts: Sequence[int], stiffness: np.ndarray, damping: np.ndarray, cubic: np.ndarray | None = None
    ) -> np.ndarray:
        """Parameters of :mod:`kaneflex.generated.spatial_shapes`; without ``cubic`` those in the plane.

        ``counts``: shapes of each kind but the last one. With the stiffness [N/m] and the damping [N s/m] of the modal
        coordinates, (count, count), and ``cubic`` (count, count, count), half of the third derivatives of the strain
        energy.
        """
        count, laws = self.N.shape[1], planar if cubic is None else spatial
        ends = np.cumsum([0, *counts, count - sum(counts)])
        of_kind = {kind: np.arange(*ends[k : k + 2]) for k, kind in enumerate(laws.KINDS)}
        Q, scale = self._shortening
        single, pair = self._sums | {"Q": Q, "K": np.diag(stiffness)}, self._growth | {"scale": scale, "C": damping}
        sums = {kind: [single[name] for name in names] for kind, names in laws.SINGLE.items()}
        sums |= {kinds: [pair[name] for name in names] for kinds, names in laws.PAIR.items()}
        found = [np.array(counts, float), *in_reading_order(of_kind, sums)]
        if cubic is None:
            return np.concatenate(found)
        found.append(2.0 * cubic[np.ix_(*(of_kind[kind] for kind in CUBIC))].ravel())
        orders = {3: 2.0, 2: 1.0, 1: 1 / 3}  # by how many of the three shapes differ
        products = [(*of, orders[len({*of})] * cubic[of]) for of in combinations_with_replacement(of_kind["g"], 3)
                    if cubic[of]]  # fmt: skip
        return np.concatenate([*found, [len(products)], np.ravel(products)])

    @property
    def _sums(self) -> dict[str, np.ndarray]:
        """Sums of every shape by their names, (count,)."""
        return _named("P", self.N) | _named("H", _cross(self.r_N)) | _named("J", _inertia(self.r_N))

    @property
    def _shortening(self) -> tuple[np.ndarray, np.ndarray]:
        """Integrals of a pinned beam's shapes times the distance xi from the pin, (count,), and factors of xi that
        fit G_x best, (count, count)."""
        if self.line is None:
            return np.zeros(self.N.shape[1]), np.zeros(self.G.shape[1:])
        at, square = self.line
        return (self.r_N[0] - at * self.N).sum(axis=0), (self.r_G[0, 0] - at * self.G[0]) / square

    @property
    def _growth(self) -> dict[str, np.ndarray]:
        """Sums of every two shapes by their names, (count, count)."""
        X = -_cross(self.N_N)  # of N_k x N_j
        found = _named("P", self.G) | _named("H", _cross(self.r_G) + X) | _named("X", X)
        return found | _named("J", _inertia(self.N_N + self.r_G)) | {"M": np.einsum("aajk->jk", self.N_N)}


def in_reading_order(of_kind: Mapping[str, np.ndarray], sums: Mapping[str, list[np.ndarray]]) -> list[np.ndarray]:
    """Numbers of every shape in turn, then of all pairs with it, as kernels read them.

    ``of_kind``: shapes of each kind; ``sums``: numbers (count,) by kinds, and (count, count) by pairs of kinds.
    """
    found = list[np.ndarray]()
    for kind, shapes in of_kind.items():
        pairs = [(others, sums.get(kind + other, [])) for other, others in of_kind.items()]
        for j in shapes:
            found.append(np.array([each[j] for each in sums[kind]]))
            found += [np.array([each[j, others] for each in pair]).T.ravel() for others, pair in pairs]
    return found


def _cross(of: np.ndarray) -> np.ndarray:
    """Sums of a x b from those of a b^T, components first."""
    return np.stack([of[1, 2] - of[2, 1], of[2, 0] - of[0, 2], of[0, 1] - of[1, 0]])


def _inertia(of: np.ndarray) -> np.ndarray:
    """Sums of (a.b) 1 - sym(a b^T) from those of a b^T, components MOMENTS first."""
    trace = of[0, 0] + of[1, 1] + of[2, 2]
    return np.stack([trace * (i == j) - (of[i, j] + of[j, i]) / 2 for i, j in map(_place, MOMENTS)])


def _place(axes: str) -> tuple[int, int]:
    return AXES.index(axes[0]), AXES.index(axes[1])


def _named(letter: str, of: np.ndarray) -> dict[str, np.ndarray]:
    """Components by their names."""
    return {f"{letter}_{axes}": each for axes, each in zip(AXES if len(of) == 3 else MOMENTS, of, strict=True)}
