"""Forces of springs and dampers on bodies that deform."""

from __future__ import annotations

import numpy as np

from kaneflex.fem.springs import place_spring
from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import Model


def spring_force(model: Model, rigid: RigidMotion, coordinates: Rates, name: str) -> np.ndarray:
    """Force on a spring's second point, global (2, n_times), or torque on the second body (1, n_times)."""
    scene, options = model.scene, model.options
    spring = scene.springs[name]
    torsional = spring.torsional_at is not None
    if model.frame is None:
        return _rigid_force(rigid, name, torsional)
    part, L = place_spring(scene, model.links, model.parts, model.frame, name)
    if not L.terms:
        return _rigid_force(rigid, name, torsional)
    z, z_rate, _ = coordinates
    q, matrices = rigid.apply(L, z), part.matrices
    force = rigid.column_of(matrices["F"]) - rigid.apply(matrices["K_s"], q)
    if options.geometric:
        force -= rigid.apply(matrices["K_g"], q)
    if options.damping:
        q_rate = rigid.apply(L, z_rate) + (rigid.apply(L.rate(), z) if options.convective else 0.0)
        force -= rigid.apply(matrices["C_s"], q_rate)
    if torsional or not (spring.length or spring.damping):
        return force
    return rigid.frame(name).to_global(force)


def _rigid_force(rigid: RigidMotion, name: str, torsional: bool) -> np.ndarray:
    if torsional:
        return -rigid[f"{name}.torque"][None]
    return np.array([rigid[f"{name}.force_x"], rigid[f"{name}.force_y"]])


def spring_tension(model: Model, rigid: RigidMotion, coordinates: Rates, name: str) -> np.ndarray:
    """Tension of a spring with its damper [N], or what a torsional one opposes to the turning of its joint [N m]."""
    spring = model.scene.springs[name]
    if spring.torsional_at is not None:
        return -spring_force(model, rigid, coordinates, name)[0]
    if model.frame is None:
        return rigid[f"{name}.tension"]
    force = spring_force(model, rigid, coordinates, name)
    if spring.length or spring.damping:
        return -rigid.frame(name).to_body(force)[0]
    return np.hypot(*force)
