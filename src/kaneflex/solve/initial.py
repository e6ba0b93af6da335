"""Initial state given by a scene, converted to the integrated coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.scene.clearances import ClearanceContact
from kaneflex.scene.start import Start
from kaneflex.support.errors import Fault, SceneError, nearest
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, LENGTH, SPEED, Dimension, to_si

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.multibody.model.system import System
    from kaneflex.scene import Scene

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
    system = model.coupled_system
    for (name, contact), gap in zip(model.scene.contacts.items(), _gaps(model, system), strict=True):
        if isinstance(contact, ClearanceContact) and contact.clearance.angle is not None:
            away = contact.flank * (gap - contact.clearance.angle)
            if not system.in_space and contact.joint not in model.scene.drives:
                away -= float(whole_turns(away))  # its bodies may start with different whole turns
            if contact.flank * away < -contact.clearance.angle - _TOUCHING:
                beyond = f"{np.degrees(away):.6g} deg from the middle of the backlash, beyond a flank"
                raise SceneError(
                    f"joints.{contact.joint}.clearance", None, f"at the start its angle is {beyond}",
                    "Start between the flanks, for example by the start of free drives, or change the middle",
                )  # fmt: skip
        elif gap < -_TOUCHING * system.mechanism.size:
            raise SceneError(
                contact.stands(name), None, f"at the start its sides penetrate each other by {-1e3 * gap:.4g} mm",
                "Start them apart, for example by the start of free drives",
            )  # fmt: skip


def _gaps(model: Model, system: System) -> list[float]:
    """Gap of every contact at the start [m], of flanks [rad]."""
    if system.in_space:
        rigid = model.motion.at(0.0)
        return [float(rigid[f"{name}.gap"][0]) for name in model.scene.contacts]
    (start,), engine = cast(Any, model.motion).states(system, np.zeros(1)), system.engine
    engine.set(start)
    found = engine.instants(system.unfold(engine.row(start.t)[None])).touching[0, len(engine.holds) :, 0]
    return list(found[: len(model.scene.contacts)].tolist())
