"""Initial state given by a scene, converted to the integrated coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.scene.contacts import ClearanceContact, Contact
from kaneflex.scene.start import Start
from kaneflex.support.errors import Fault, SceneError, nearest
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, LENGTH, SPEED, Dimension, to_si

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.multibody.model.system import System
    from kaneflex.scene import Scene
    from kaneflex.scene.drives import Drive

_AMPLITUDE = Dimension("an amplitude of a mass-normalised shape", "", "1e-4")
_QUATERNION = Dimension("a component of a unit quaternion", "", "0.5")
_OF_UNIT = {"m": LENGTH, "rad": ANGLE, "1": _QUATERNION}
_RATES = {LENGTH: SPEED, ANGLE: ANGULAR_SPEED, _AMPLITUDE: _AMPLITUDE, _QUATERNION: _QUATERNION}
_TURNING = ("theta", "turn")
STATE = ("displacements", "velocities")
"""Tables of a state."""
_TOUCHING = 1e-9
"""Penetration at the start, as a share of the mechanism's size, that counts as contact."""
_LISTED = 40
"""Largest number of coordinates in a message."""


def start_coordinates(model: Model) -> tuple[str, ...]:
    """Names to which ``solve.start`` can give a displacement and a velocity: the integrated coordinates, before a
    modal reduction of the whole mechanism."""
    return tuple(start_dimensions(model))


def start_dimensions(model: Model) -> dict[str, Dimension]:
    """Dimension of each of these coordinates."""
    if model.options.dynamics == "coupled":
        return state_dimensions(model.coupled_system)
    last = {name: name.rpartition(".")[2] for name in model.coordinates}
    return {
        name: _AMPLITUDE if what.startswith("mode_") else ANGLE if what in _TURNING else LENGTH
        for name, what in last.items()
    }


def state_dimensions(system: System) -> dict[str, Dimension]:
    """Dimension of each coordinate of a coupled system, in its order."""
    return {name: _OF_UNIT[unit] for name, unit in system.engine.layout.positions}


def given_start(scene: Scene) -> Start:
    """Tables of the initial state that a scene gives."""
    start = scene.solve.start
    assert isinstance(start, Start)
    return start


def laid_over(
    start: Start, dimensions: Mapping[str, Dimension], z: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Copies of z and v, (n,) in the order of ``dimensions``, with the values of ``solve.start``.

    Raises
    ------
    SceneError
        For unknown coordinates and wrong dimensions; names every problem.
    """
    rates = {name: _RATES[dimension] for name, dimension in dimensions.items()}
    return (
        _filled(STATE[0], start.displacements, dimensions, z),
        _filled(STATE[1], start.velocities, rates, v),
    )


def _filled(
    table: str, given: Mapping[str, float | str], dimensions: Mapping[str, Dimension], base: np.ndarray
) -> np.ndarray:
    row, values, problems = {name: k for k, name in enumerate(dimensions)}, base.copy(), []
    for name, value in given.items():
        key = f"solve.start.{table}.{name}"
        if name not in row:
            reason = "the run has no such coordinate"
            problems.append(SceneError(key, value, reason, _known(name, tuple(dimensions))))
            continue
        try:
            values[row[name]] = to_si(value, dimensions[name])
        except Fault as fault:
            problems.append(SceneError(key, value, fault.reason, fault.cure))
    if problems:
        raise SceneError.gather(problem for error in problems for problem in error.problems)
    return values


def _known(name: str, names: tuple[str, ...]) -> str:
    """The nearest coordinate and the list of them, up to a limit."""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    known = f"Known: {', '.join(names[:_LISTED])}{more}"
    close = nearest(name, names)
    return known if close.startswith("Known") else f"{close}. {known}"


def given_state(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Initial z and v of a one-way model's integrated coordinates, (n,).

    With modes of the whole mechanism B it is the state nearest by mass: B^T M B y = B^T M z.

    Raises
    ------
    SceneError
        As :func:`laid_over`.
    """
    none = np.zeros(len(model.coordinates))
    z, v = laid_over(given_start(model.scene), start_dimensions(model), none, none)
    basis = model.modal_basis
    if basis is None:
        return z, v
    weighted = basis.T @ model.M(0.0)
    return tuple(np.linalg.solve(weighted @ basis, weighted @ np.column_stack([z, v])).T)


def check_apart(model: Model) -> None:
    """Raise SceneError if the sides of a contact penetrate each other at the start, beyond rounding."""
    from kaneflex.mechanism.contacts import apart
    from kaneflex.mechanism.wrenches import parts_of

    mechanism, rigid = parts_of(model.scene), model.motion.at(0.0)
    for name, contact in mechanism.contacts.items():
        given = model.scene.contacts[name]
        if model.scene.is_spatial:
            _check_gap(name, given, float(rigid[f"{name}.gap"][0]), mechanism.size)
            continue
        first, second = (rigid.frame(side.body) for side in contact.sides)
        if contact.kind == "angle":
            _check_flank(given, model.scene.drives, first.to_body(second.to_global((1.0, 0.0))))
            continue
        x, y = second.place(contact.second.at) - first.place(contact.first.at)
        normal = first.to_global(contact.direction)
        gap = apart(contact.kind, (x, y), np.hypot(x, y) + 1e-300, normal, contact.reach)[0].item()
        _check_gap(name, given, gap, mechanism.size)


def _check_gap(name: str, contact: Contact, gap: float, size: float) -> None:
    """Raise SceneError if the sides of a contact penetrate each other; ``size``: that of the mechanism [m]."""
    if isinstance(contact, ClearanceContact) and contact.clearance.angle is not None:
        if gap < -_TOUCHING:
            raise _beyond(contact, contact.flank * (gap - contact.clearance.angle))
    elif gap < -_TOUCHING * size:
        raise SceneError(
            contact.stands(name), None, f"at the start its sides penetrate each other by {-1e3 * gap:.4g} mm",
            "Start them apart, for example by the start of free drives",
        )  # fmt: skip


def _beyond(contact: ClearanceContact, away: float) -> SceneError:
    """Error for an angle ``away`` [rad] from the middle of a backlash."""
    return SceneError(
        f"joints.{contact.joint}.clearance", None,
        f"at the start its angle is {np.degrees(away):.6g} deg from the middle of the backlash, beyond a flank",
        "Start between the flanks, for example by the start of free drives, or change the middle",
    )  # fmt: skip


def _check_flank(contact: Contact, drives: Mapping[str, Drive], along: np.ndarray) -> None:
    """Raise SceneError if flanks penetrate; ``along`` (2, 1): x axis of the second body in the axes of the first."""
    assert isinstance(contact, ClearanceContact) and contact.clearance.angle is not None
    away = float(np.arctan2(along[1], along[0]).item()) - contact.clearance.middle
    away -= float(whole_turns(away))
    if contact.joint in drives:
        away = drives[contact.joint].start - contact.clearance.middle
    if abs(away) > contact.clearance.angle + _TOUCHING:
        raise _beyond(contact, away)
