"""Integrals over a body for the coupled kernels: its moments, and its shapes at points."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

import numpy as np

from kaneflex.fem.spatial_bodies import second_moments
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS, ModalData, spatial_modal_data, symmetrised


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
