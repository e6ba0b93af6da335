"""Numbers of bodies and their sections, in the plane for the kernels of ``kaneflex.generated.body``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any, ClassVar

import numpy as np

from kaneflex.fem.spatial_bodies import second_moments
from kaneflex.generated.body import BODY, POINT
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.spatial import SpatialMechanism
from kaneflex.multibody.model.shapes import Shapes, in_reading_order
from kaneflex.multibody.model.tree_layout import Deformable, Flexible, Names
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS, ModalData, spatial_modal_data, symmetrised

Arrays = Mapping[str, Any]
_LIGHT = 1e-9
"""Ratio of principal moments of inertia below which the smaller one counts as none."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Numbers of a mechanism's bodies in the plane and their sections.

    Attributes
    ----------
    flexible : mapping
        Shapes of the deforming bodies: of links, or of modal data from a file.
    """

    d: ClassVar[int] = 3
    mechanism: NumericMechanism
    flexible: Flexible

    def body(self, name: str, shapes: Deformable | None = None) -> np.ndarray:
        """Numbers of a body."""
        given = self.mechanism.deforming.get(name)
        data = link_data(shapes) if isinstance(shapes, Shapes) else given and given.modal
        return body_block(body_moments(self.mechanism, name, data), *_counts(shapes))

    def is_light(self, numbers: np.ndarray | None) -> bool:
        """True if a body with these numbers has no mass, or no inertia about some axis."""
        if numbers is None or numbers[0] <= 0.0:
            return True
        mass, x, y, second = numbers[:4]
        return bool(second - (x * x + y * y) / mass <= _LIGHT * second)

    def station(self, shapes: Deformable, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Numbers of a section by the rows u, v, theta of its body's shapes (3, count), and G (3, count, count)."""
        axial, transverse = _counts(shapes)
        s, w = slice(axial), slice(axial, None)
        return point_block({"s": rows[0, s], "w": rows[1, w], "psi": rows[2, w], "H": -G[0, w, w]}, axial, transverse)

    def names(self, body: str, shapes: Deformable) -> tuple[Names, Names]:
        """Speeds and coordinates of the shapes of a body."""
        kinds = zip(("axial", "transverse"), _counts(shapes), strict=True)
        names = [(f"{body}.{kind}_{k}", "m") for kind, count in kinds for k in range(count)]
        return names, names


@dataclass(frozen=True, eq=False)
class SpatialBlocks:
    """Numbers of the bodies in space and their sections, by the names of :class:`Blocks`."""

    d: ClassVar[int] = 6
    mechanism: SpatialMechanism
    flexible: Flexible

    def body(self, name: str, shapes: Deformable | None) -> np.ndarray | None:
        """Numbers of a body; None if it has neither mass nor inertia."""
        body = self.mechanism.bodies[name]
        if not (body.mass or np.any(body.inertia)):
            return None
        own = np.zeros(0) if shapes is None else shapes.numbers()
        return np.concatenate([[body.mass], body.centre, body.inertia, own])

    def is_light(self, numbers: np.ndarray | None) -> bool:
        return numbers is None or bool(numbers[0] <= 0.0 or min(numbers[4:7]) <= _LIGHT * max(numbers[4:7]))

    def station(self, shapes: Deformable, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Rows of the shapes, and the columns of G that are not zero."""
        i, j = np.nonzero(np.tril(G.any(axis=0)))
        return np.concatenate([np.ravel(rows), [len(i)], np.column_stack([i, j, G[:, i, j].T]).ravel()])

    def names(self, body: str, shapes: Deformable) -> tuple[Names, Names]:
        units = ["rad" if twists else "m" for twists in shapes.twisting]
        return ([(f"{body}.shapes.{k}", unit) for k, unit in enumerate(units)],
                [(f"{body}.shape_{k}", unit) for k, unit in enumerate(units)])  # fmt: skip


def _counts(shapes: Deformable | None) -> tuple[int, int]:
    """Numbers of axial and transverse shapes of a body."""
    axial, transverse = (0, 0) if shapes is None else shapes.counts
    return axial, transverse


def body_block(moments: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Numbers of a body from :func:`body_moments`, for these numbers of shapes."""
    return _in_reading_order(BODY, {"mass_Y": 0.0, "mass_Y_Y": 0.0, **moments}, axial, transverse)


def point_block(shapes: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Numbers of a point from its POINT_ARRAYS, without rotation psi if it has none; rigid bodies have none."""
    return _in_reading_order(POINT, {"psi": 0.0, **shapes}, axial, transverse)


def _in_reading_order(table: Mapping[str, Any], arrays: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Numbers in the order in which the kernels read them, by BODY or POINT."""
    count = axial + transverse
    of_kind = {"u": np.arange(axial), "v": np.arange(axial, count)}
    places = {"s": of_kind["u"], "w": of_kind["v"], "a": np.arange(count)}

    def among_all(name: str) -> np.ndarray:
        """Array of all shapes, zero for those of another kind."""
        axes = _AXES.get(name, "")
        found = np.zeros((count,) * len(axes))
        found[np.ix_(*(places[axis] for axis in axes))] = arrays[name]
        return found + found.T if axes == "sw" else found

    sums = {kinds: [sum(sign * among_all(name) for name, sign in terms.items()) for terms in of]
            for kinds, of in table.items() if all(len(of_kind[kind]) for kind in kinds)}  # fmt: skip
    counts = np.array([axial, count], float)
    return np.concatenate([np.array(sums.get("", []), float), counts, *in_reading_order(of_kind, sums)])


_AXES = {name: axes for name, (axes, *_) in (ARRAYS | POINT_ARRAYS).items()}


def body_moments(mechanism: NumericMechanism, name: str, data: ModalData | None) -> dict[str, np.ndarray]:
    """Inertia moments ARRAYS of a body with its lumped masses.

    A rigid body has mass [kg], first [kg m] and second moments [kg m^2] and inertia only; it may have mass off the
    axis: mass_Y, mass_X_Y, mass_Y_Y.
    """
    body = mechanism.bodies[name]
    lumped = [mass for mass in mechanism.masses.values() if mass.point.body == name]
    if data is not None:
        found = {key: data.arrays[key] for key in ARRAYS}
        slices = [(mass.mass, mass.inertia, data.at_point(mass.point.name)) for mass in lumped]
    else:
        found = dict.fromkeys(_RIGID, np.zeros(()))
        slices = [(mass.mass, mass.inertia, mass.point.at) for mass in lumped]
        slices = [(body.mass, body.inertia, body.centre), *slices]
        slices = [(mass, inertia, dict(zip("XY", at, strict=True))) for mass, inertia, at in slices]
    for key in found:
        of, *factors = key.split("_")
        for mass, inertia, at in slices:
            amount = {"mass": mass, "inertia": inertia}.get(of)
            if amount is not None:
                found[key] = found[key] + reduce(np.multiply.outer, [at[factor] for factor in factors], amount)
    return found


_RIGID = ("mass", "mass_X", "mass_Y", "mass_X_X", "mass_X_Y", "mass_Y_Y", "inertia")


def link_data(shapes: Shapes) -> ModalData:
    """Modal data of a link's finite elements without lumped masses, in its axes, with the points on its axis."""
    link = shapes.link
    places = {name: at for name, at in link.mechanism.points[link.name].items() if not any(at[1:])}
    of_points = [shapes.at(at) for at in places.values()]
    r, N, G = (np.array(each) for each in (list(places.values()), *zip(*of_points, strict=True)))
    if link.dofs == 6:
        return _spatial_data(shapes, tuple(places), {"r": r, "N": N[:, :3], "psi": N[:, 3:], "G": G})
    s, w = slice(shapes.counts[0]), slice(shapes.counts[0], None)
    arrays = _planar_moments(shapes, s, w) | {
        "X": r[:, 0], "s": N[:, 0, s], "w": N[:, 1, w], "psi": N[:, 2, w], "H": -G[:, 0, w, w],
    }  # fmt: skip
    both = ARRAYS | POINT_ARRAYS
    symmetric = {name: symmetrised(np.asarray(arrays[name], dtype=float), axes) for name, (axes, *_) in both.items()}
    return ModalData(link.length, tuple(places), symmetric)


def _planar_moments(shapes: Shapes, s: slice, w: slice) -> dict[str, np.ndarray]:
    """Inertia moments ARRAYS of a planar link's shapes along and across.

    Rotary energy includes the mass matrix's correction for an element's answer to its own inertia.
    """
    m, profile, length = shapes.moments, shapes.link.body.profile, shapes.link.length
    total = profile.inertia(length)
    across, M = m.N_N[1, 1, w, w], shapes.link.part.matrices["M"].value({})
    return {
        "mass": total.mass, "mass_X": total.first, "mass_X_X": total.second, "inertia": profile.rotary_inertia(length),
        "mass_s": m.N[0, s], "mass_w": m.N[1, w], "mass_X_s": m.r_N[0, 0, s], "mass_X_w": m.r_N[0, 1, w],
        "mass_s_s": m.N_N[0, 0, s, s], "mass_w_w": across, "mass_s_w": m.N_N[0, 1, s, w],
        "mass_H": -m.G[0, w, w], "mass_X_H": -m.r_G[0, 0, w, w], "inertia_psi": -m.r_N[1, 0, w],
        "inertia_psi_psi": shapes.transverse.T @ M @ shapes.transverse - across,
        "stiffness": np.diag(shapes.stiffness), "damping": shapes.damping,
    }  # fmt: skip


def _spatial_data(shapes: Shapes, points: tuple[str, ...], of_points: Mapping[str, np.ndarray]) -> ModalData:
    """Modal data in space from SPATIAL_POINT_ARRAYS."""
    m, body = shapes.moments, shapes.link.mechanism.bodies[shapes.link.name]
    return spatial_modal_data(shapes.link.length, points, {
        "mass": np.array(body.mass), "mass_r": body.mass * body.centre,
        "mass_r_r": second_moments(body) + body.mass * np.outer(body.centre, body.centre),
        "mass_N": m.N, "mass_r_N": m.r_N, "mass_N_N": m.N_N, "mass_G": m.G, "mass_r_G": m.r_G,
        "stiffness": np.diag(shapes.stiffness), "damping": shapes.damping, "cubic": shapes.cubic, **of_points,
    })  # fmt: skip
