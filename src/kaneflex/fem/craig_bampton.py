"""Modal data of an imported link: Craig and Bampton's shapes in its floating frame, and their integrals over its mass.

Shapes are the constraint modes of the points and the modes with fixed points (Craig & Bampton 1968). In the plane
attachment modes of a moment on each point are added (Hintz 1975); without them a weld, which constrains a rotation, is
a quarter too stiff with any number of modes. Static responses to the link's inertia with fixed points are added, too:
otherwise forces and stresses converge slowly (Craig 1981, ch. 15). Transverse shapes have the ends on the chord, axial
shapes no mean displacement. The motion of a point is constrained, B x = (u or v of each point); static responses and
modes use one factorisation,

    [K B^T; B 0] [x; f] = [load; displacement].

Particles replace a beam's sections: the rotation psi of a section is the -u / Y of its fibres, so that the integrals
of X psi dJ become those of -Y u, and a shape's kinetic energy is that of all of its displacements.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import eigh, null_space
from scipy.sparse import bmat, csc_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

from kaneflex.fem.foreign import Foreign, Motion
from kaneflex.fem.recovery import with_recovery
from kaneflex.scene.modal_data import FORMAT, ModalData, checked_data, symmetrised
from kaneflex.support.errors import Fault

DEGREE, _PIECES = 5, 12
"""Degree of the spline of the mean line."""
_FEW = 100
"""Largest number of coordinates for which all modes are computed by a dense solver."""
_LOOSE = "the stiffness matrix is singular with all points fixed"
_LOOK = "Check for nodes without elements, and for parts that are hinged or not connected"
_NEGATIVE = (
    "the mass matrix is not positive definite",
    "Check for negative masses and nodes without mass",
)
_NOTHING = 1e-9
"""Share of the largest stiffness, or of a shape's mass, that counts as zero."""


@dataclass(frozen=True, eq=False)
class Reduced:
    """Shapes (n_nodes d, n) with their mass [kg] and stiffness [N/m], (n,) each."""

    shapes: np.ndarray
    mass: np.ndarray
    stiffness: np.ndarray


def reduced(link: Foreign, motion: Motion, modes: int, rigid: bool) -> Reduced:
    """Static shapes of a link's points and its inertia, and ``modes`` modes with the points held.

    Raises Fault if it has fewer.
    """
    T = link.basis(motion, rigid)
    K, M = (csc_array(T.T @ (A @ T)) for A in (link.K, link.M))
    B = np.vstack([link.held(name, motion) for name in link.points]) @ T
    count, held = K.shape[0], len(B)
    if modes > count - held - (count > _FEW):
        cure = "Ask for fewer, or give a finer mesh" if link.span is None else "Ask for fewer, or give more modes"
        kind = "" if motion == "any" else f"{motion} "
        raise Fault(f"{modes} {kind}modes of {count - held} held coordinates", cure)
    scale = abs(K).max()
    try:
        factors = splu(csc_array(bmat([[K, scale * csc_array(B).T], [scale * csc_array(B), None]])))
    except RuntimeError:
        raise Fault(_LOOSE, _LOOK) from None

    def solved(load: np.ndarray) -> np.ndarray:
        return factors.solve(np.concatenate([load, np.zeros(held)]))[:count]

    # Across, what the ends do by themselves is a motion of the whole link.
    moved = [k for k, name in enumerate(link.points) if name not in ("start", "end")]
    sides = scale * np.eye(count + held, held, -count)[:, moved if motion == "transverse" else slice(None)]
    loads = [T.T @ (link.M @ acceleration) for acceleration in link.accelerations(motion)]
    if motion == "transverse":  # a weld or a drive turns a point, a pin doesn't: attachment modes of moments
        loads += [T.T @ link.means(name)[2] for name in link.points]
    pushed = np.column_stack([solved(load) for load in loads])
    static = factors.solve(sides)[:count]
    if count <= _FEW:
        free = null_space(B)
        try:
            dynamic = free @ eigh(free.T @ K @ free, free.T @ M @ free)[1][:, :modes]
        except np.linalg.LinAlgError:
            raise Fault(*_NEGATIVE) from None
        return _orthogonal(link, motion, T @ np.hstack([static, _residual(pushed, dynamic, M), dynamic]))
    answer = LinearOperator((count, count), matvec=lambda load: solved(np.ravel(load)), dtype=float)
    first = np.random.default_rng(0).standard_normal(count)
    try:
        dynamic = eigsh(K, modes, M, sigma=0.0, OPinv=answer, v0=first)[1] if modes else np.zeros((count, 0))
    except ArpackError as error:
        raise Fault(f"the modes were not found: {error}", "Check the matrices, or ask for fewer") from None
    return _orthogonal(link, motion, T @ np.hstack([static, _residual(pushed, dynamic, M), dynamic]))


def _residual(pushed: np.ndarray, modes: np.ndarray, M: csc_array) -> np.ndarray:
    """Static responses to loads without the share of modes of unit mass, scaled to largest entry 1 (Rubin 1975).

    However small, they contain the flexibility that the modes lack.
    """
    for least in (0.0, _NOTHING):  # the second pass removes rounding errors (Parlett 1998, 6-9)
        size = abs(pushed).max(axis=0)
        pushed = pushed[:, size > least] / size[size > least]
        pushed = pushed - modes @ (modes.T @ (M @ pushed))
    return pushed / abs(pushed).max(axis=0)


def _orthogonal(link: Foreign, motion: Motion, shapes: np.ndarray) -> Reduced:
    """Basis of the same space without rigid motions, orthogonal in mass and stiffness, scaled to largest entry 1."""
    if motion != "transverse":  # in the mean over the mass
        whole = np.column_stack([link.field(1.0, 0.0)] if motion == "axial" else list(link.whole.values()))
        carried = link.M @ whole
        inertia = whole.T @ carried
        if np.linalg.eigvalsh(inertia)[0] <= _NOTHING * inertia[0, 0]:
            reason = "the mass has no moment of inertia about the axis: it lies on one line"
            raise Fault(reason, "Give the mass of its sections, with their rotary inertia")
        shapes = shapes - whole @ np.linalg.solve(inertia, carried.T @ shapes)
    mass, stiffness = (shapes.T @ (A @ shapes) for A in (link.M, link.K))
    energies = np.diag(mass)
    if not -energies.min() < _NOTHING * energies.max():
        raise Fault(*_NEGATIVE)
    size = np.sqrt(np.maximum(energies, 0.0))
    kept = size > _NOTHING * size.max()
    mass, stiffness, shapes = mass[np.ix_(kept, kept)], stiffness[np.ix_(kept, kept)], shapes[:, kept] / size[kept]
    mass, stiffness = mass / np.outer(size[kept], size[kept]), stiffness / np.outer(size[kept], size[kept])
    share, turned = eigh(mass)
    if share[0] < -_NOTHING * share[-1]:
        raise Fault(*_NEGATIVE)
    span = turned[:, share > _NOTHING] / np.sqrt(share[share > _NOTHING])
    resisting, found = eigh(span.T @ stiffness @ span)
    if resisting[0] <= _NOTHING * resisting[-1]:
        raise Fault(_LOOSE, _LOOK)
    shapes = shapes @ span @ found
    largest = abs(shapes).max(axis=0)
    return Reduced(shapes / largest, 1.0 / largest**2, resisting / largest**2)


def foreign_data(link: Foreign, modes: int, rigid: bool = True, damping: float = 0.0) -> ModalData:
    """Modal data of a link, with its points, its sections and their forces.

    Parameters
    ----------
    modes : int
        Number of transverse modes with fixed points; the number of axial modes is half of it.
    rigid : bool
        True: the nodes of a point move as one body; False: the point moves as their mean.
    damping : float
        Damping ratio of every shape.

    Raises
    ------
    Fault
        If the mesh isn't symmetric, or has fewer modes.
    """
    along = reduced(link, "axial", (modes + 1) // 2, rigid)
    across = reduced(link, "transverse", modes, rigid)
    s, w, d, M = along.shapes, across.shapes, link.axes, link.M
    x, y = link.nodes[:, 0], link.nodes[:, 1]
    X, Y, X_across, Y_along = link.field(x, 0.0), link.field(0.0, y), link.field(0.0, x), link.field(y, 0.0)
    on_u, on_v = link.field(1.0, 0.0), link.field(0.0, 1.0)
    lifted = on_v[:, None] * w  # transverse part of the shapes
    across_alone = symmetrised(lifted.T @ M @ lifted, "ww")
    turned = np.zeros_like(s)
    turned[0::d], turned[1::d] = -s[1::d], s[0::d]
    carried = (M @ on_u)[0::d]
    line = MeanLine.of(link, s, lifted, carried)
    stiffness, mass = np.concatenate([along.stiffness, across.stiffness]), np.concatenate([along.mass, across.mass])
    data = checked_data({
        "format": np.array(FORMAT), "length": np.array(link.length), "mass": carried.sum(),
        "mass_X": on_u @ M @ X, "mass_X_X": X @ M @ X, "inertia": Y @ M @ Y,
        "mass_s": np.zeros(s.shape[1]), "mass_w": on_v @ M @ w,
        "mass_X_s": (X + Y) @ M @ s, "mass_X_w": X_across @ M @ w,
        "mass_s_s": np.diag(along.mass), "mass_w_w": across_alone, "mass_s_w": turned.T @ M @ w,
        "mass_H": np.zeros((w.shape[1],) * 2), "mass_X_H": line.shortened(x, carried * x),
        "inertia_psi": -(Y_along @ M @ w), "inertia_psi_psi": np.diag(across.mass) - across_alone,
        "stiffness": stiffness, "damping": np.diag(2.0 * damping * np.sqrt(stiffness * mass)),
    } | _points(link, s, w, line))  # fmt: skip
    return with_recovery(link, np.hstack([s, w]), data)


def _points(link: Foreign, s: np.ndarray, w: np.ndarray, line: MeanLine) -> dict[str, np.ndarray]:
    """Arrays of the link's points, and of its sections on the mean line, by the names of POINT_ARRAYS."""
    names, X = list(link.points), np.array([link.X(name) for name in link.points])
    means = [link.means(name) for name in link.points]
    rows = zip(*means, strict=True)
    moved = [np.array(part) @ shapes for part, shapes in zip(rows, (s, w, w), strict=True)]
    for k, name in enumerate(link.points):
        if len(link.points[name]) == 1:  # a single node has the rotation of the mean line
            moved[2][k] = line.slope(X[k])
    if link.sections:
        places = np.array(list(link.sections.values()))
        names, X = [*names, *link.sections], np.concatenate([X, places])
        on_line = (part(places) for part in (line.along, line.across, line.slope))
        moved = [np.concatenate(parts) for parts in zip(moved, on_line, strict=True)]
    found = dict(zip(("s", "w", "psi"), moved, strict=True))
    return found | {"points": np.array(names), "X": X, "H": line.shortening(X)}


def splines(x: np.ndarray) -> tuple[np.ndarray, csc_array]:
    """Knots along a link, and the splines' values (n_nodes, n_splines) at the distances x [m] of nodes."""
    first, last = x.min(), x.max()
    knots = np.concatenate([[first] * DEGREE, np.linspace(first, last, _PIECES + 1), [last] * DEGREE])
    return knots, BSpline.design_matrix(np.clip(x, first, last), knots, DEGREE).tocsc()


@dataclass(frozen=True, eq=False)
class MeanLine:
    """Mean displacements of a link's sections, splines over X by least squares over its mass.

    along, across, slope: of each shape, (n_places, n); carried: places [m] and masses [kg] of the nodes.
    """

    along: BSpline
    across: BSpline
    slope: BSpline
    carried: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, link: Foreign, s: np.ndarray, lifted: np.ndarray, carried: np.ndarray) -> MeanLine:
        """Mean displacements of the shapes (n_nodes d, n); ``carried`` (n_nodes,) is the mass [kg] at each node."""
        x, d = link.nodes[:, 0], link.axes
        knots, at_nodes = splines(x)

        def fitted(shapes: np.ndarray, axis: int) -> BSpline:
            square = at_nodes.T @ link.M[axis::d, axis::d] @ at_nodes
            side = at_nodes.T @ link.M[axis::d, axis::d] @ shapes[axis::d]
            return BSpline(knots, np.linalg.lstsq(square.toarray(), side, rcond=1e-12)[0], DEGREE)

        across = fitted(lifted, 1)
        return cls(fitted(s, 0), across, across.derivative(), (x, carried))

    def shortening(self, x: np.ndarray) -> np.ndarray:
        """Matrices H (n_places, n, n) [1/m]: integral of w_j' w_k' up to each place, minus its mean over the mass."""
        return np.stack([self.shortened(x[k : k + 1], np.ones(1)) for k in range(len(x))])

    def shortened(self, x: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Matrix H (n, n), summed over places with weights (n_places,)."""
        return grown((self.slope,), x, weights) - weights.sum() * self._mean

    @cached_property
    def _mean(self) -> np.ndarray:
        x, carried = self.carried
        return grown((self.slope,), x, carried) / carried.sum()


def grown(slopes: Iterable[BSpline], x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Integral of s_j s_k from a link's first section up to each place x [m], summed with weights (n_places,): (n, n)
    [1/m], summed over the slopes s of lines of DEGREE.

    Gauss's rule of DEGREE points is exact between neighbours among knots and places.
    """
    at, shares = np.polynomial.legendre.leggauss(DEGREE)
    each = []
    for slope in slopes:
        first, last = slope.t[0], slope.t[-1]
        bounds, up_to = np.unique(np.clip(np.concatenate([x, slope.t]), first, last), return_inverse=True)
        half = np.diff(bounds) / 2
        fine = (bounds[:-1] + half)[:, None] + half[:, None] * at
        ends_at = np.bincount(up_to[: len(x)], weights, len(bounds))
        beyond = ends_at[::-1].cumsum()[::-1][1:]  # of the places that a piece lies before
        found = slope(fine.ravel())
        each.append((found * ((beyond * half)[:, None] * shares).reshape(-1, 1)).T @ found)
    return np.sum(each, axis=0)
