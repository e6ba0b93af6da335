"""Craig and Bampton's shapes of an imported link in its floating frame.

Shapes are the constraint modes of the points and the modes with fixed points (Craig & Bampton 1968). In the plane
attachment modes of a moment on each point are added (Hintz 1975); without them a weld, which constrains a rotation, is
a quarter too stiff with any number of modes. Static responses to the link's inertia with fixed points are added, too:
otherwise forces and stresses converge slowly (Craig 1981, ch. 15). Transverse shapes have the ends on the chord, axial
shapes no mean displacement, those in space no momentum of the whole body (Buckens). The motion of a point is
constrained, B x = (u or v of each point); static responses and modes use one factorisation,

    [K B^T; B 0] [x; f] = [load; displacement].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space
from scipy.sparse import bmat, csc_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

from kaneflex.fem.imported.elements import ImportedMesh, Motion
from kaneflex.support.errors import Fault

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


def reduced(link: ImportedMesh, motion: Motion, modes: int, rigid: bool) -> Reduced:
    """Static shapes of a link's points and its inertia, and ``modes`` modes with the points held.

    Raises Fault if it has fewer.
    """
    T = link.basis(motion, rigid)
    K, M = (csc_array(T.T @ (A @ T)) for A in (link.K, link.M))
    B = np.vstack([link.held(name, motion) for name in link.points]) @ T
    count, held = K.shape[0], len(B)
    if modes > count - held - (count > _FEW):
        kind = "" if motion == "any" else f"{motion} "
        raise Fault(f"{modes} {kind}modes of {count - held} held coordinates", "Ask for fewer, or give a finer mesh")
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


def _orthogonal(link: ImportedMesh, motion: Motion, shapes: np.ndarray) -> Reduced:
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
    if resisting[0] < -_NOTHING * resisting[-1]:
        raise Fault("the stiffness matrix is not positive definite", "Export the stiffness of the unloaded link")
    if resisting[0] <= _NOTHING * resisting[-1]:
        raise Fault(_LOOSE, _LOOK)
    shapes = shapes @ span @ found
    largest = abs(shapes).max(axis=0)
    return Reduced(shapes / largest, 1.0 / largest**2, resisting / largest**2)
