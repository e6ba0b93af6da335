"""Initial states: given by a scene in the coordinates of a run, or taken from another run or its results."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.state import NONE, Choice, State
from kaneflex.scene.clearances import ClearanceContact
from kaneflex.scene.start import Start
from kaneflex.support.arguments import takes
from kaneflex.support.errors import Fault, SceneError, nearest
from kaneflex.support.labelled import read_labelled
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, LENGTH, SPEED, Dimension, to_si

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.multibody.model.system import System
    from kaneflex.scene.parts import Solve

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
_TABLE = "a table of a state"
_OF_STATE = ("state", "last_state", "last_rate")
CONTINUE = "Continue with the lengths and drives of that run"
OPEN = 1e-3
"""Change of a given state by closing the joints that is accepted: a share of the mechanism's size, or rad."""


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


def given_start(solve: Solve) -> Start:
    """Tables of the initial state that a scene gives."""
    start = solve.start
    assert isinstance(start, Start)
    return start


def with_values(table: str, start: Start, dimensions: Mapping[str, Dimension], base: np.ndarray) -> np.ndarray:
    """Copy of ``base`` (n,), in the order of the coordinates' ``dimensions``, with values of a table of a start.

    Raises
    ------
    SceneError
        For unknown coordinates and wrong dimensions; names every problem.
    """
    given: Mapping[str, float | str] = getattr(start, table)
    if table == STATE[1]:
        dimensions = {name: _RATES[dimension] for name, dimension in dimensions.items()}
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
        As :func:`with_values`.
    """
    none = np.zeros(len(model.coordinates))
    z, v = (with_values(table, given_start(model.scene.solve), start_dimensions(model), none) for table in STATE)
    basis = model.modal_basis
    if basis is None:
        return z, v
    weighted = basis.T @ model.M(0.0)
    return tuple(np.linalg.solve(weighted @ basis, weighted @ np.column_stack([z, v])).T)


def check_penetration(model: Model) -> None:
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
                contact.table_key(name), None, f"at the start its sides penetrate each other by {-1e3 * gap:.4g} mm",
                "Start them apart, for example by the start of free drives",
            )  # fmt: skip


def _gaps(model: Model, system: System) -> list[float]:
    """Gap of every contact at the start [m], for flanks [rad]."""
    if system.in_space:
        rigid = model.motion.at(0.0)
        return [float(rigid[f"{name}.gap"][0]) for name in model.scene.contacts]
    (start,), engine = cast(Any, model.motion).states(system, np.zeros(1)), system.engine
    engine.set(start)
    found = engine.instants(system.unfold(engine.row(start.t)[None])).touching[0, len(engine.frictions) :, 0]
    return list(found[: len(model.scene.contacts)].tolist())


# ---- states of other runs ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SavedState:
    """All coordinates of a coupled system at one time, for a ball in space the components of its unit quaternion.

    Attributes
    ----------
    source : str
        Origin, for messages.
    t : float
        Time [s].
    names : tuple of str
        Coordinates of joints and shapes; in space also the angles of joints that close loops, which only count turns.
    q, v : ndarray (n,)
        Coordinates [m or rad] and their rates.
    """

    source: str
    t: float
    names: tuple[str, ...]
    q: np.ndarray
    v: np.ndarray

    def ordered(self, wanted: Sequence[str], others: Collection[str] = ()) -> tuple[np.ndarray, np.ndarray]:
        """q and v of the wanted coordinates. Raises SceneError if one is missing, or there are more than ``others``."""
        strange = sorted(({*wanted} ^ {*self.names}) - {*others})
        if strange:
            owner = "state" if strange[0] in wanted else "scene"
            raise SceneError(
                "after", self.source, f"the {owner} has no coordinate {strange[0]}",
                "Continue with the scene and number of modes of that run",
            )  # fmt: skip
        order = [self.names.index(name) for name in wanted]
        return self.q[order], self.v[order]


def check_closed(gaps: Iterable[tuple[str, float, float]], key: str, source: str, cure: str) -> None:
    """Raise SceneError (of ``key``, ``source`` and ``cure``) if a state opens a joint."""
    for joint, gap, unit in gaps:
        if not abs(gap) <= OPEN * unit:
            raise SceneError(key, source, f"the state opens joint {joint} by {gap:.3g} (m or rad)", cure)


def written_state(given: Start, system: System, start: State) -> State:
    """Start with the coordinates and rates that a scene gives; loops are not closed.

    Raises SceneError as :func:`with_values`, and for a quaternion that is not of unit length.
    """
    dimensions, engine = state_dimensions(system), system.engine
    q = with_values(STATE[0], given, dimensions, start.q)
    _normalise(system, q, "solve.start", _TABLE)
    v = with_values(STATE[1], given, dimensions, engine.rates_of(q[None], start.u[None])[0])
    return replace(start, q=q, u=engine.speeds_of(q[None], v[None])[0])


def closed_state(tables: Start, system: System, given: State, choice: Choice) -> State:
    """State that a scene's tables give with closed loops, by the independent speeds of a choice.

    Raises SceneError if joints or drives change given coordinates or rates, or shapes.
    """
    dimensions, engine = state_dimensions(system), system.engine
    size = system.mechanism.size or 1.0
    measure = np.array([size if dimension is LENGTH else 1.0 for dimension in dimensions.values()])
    asked = np.array([name in tables.displacements for name in dimensions], bool)
    asked[engine.modal[0]] = True
    cure = "Give coordinates that keep the joints closed, for example those of solution.state()"
    try:
        found = system.project(given.t, given.q, given.u, choice)
    except ArithmeticError as error:
        raise SceneError("solve.start", _TABLE, f"in this state {error}", cure) from None
    changed = np.where(asked, abs(found.q - given.q) / measure, 0.0)
    if not changed.max(initial=0.0) <= OPEN:
        k = int(changed.argmax())
        name, unit = system.engine.layout.positions[k]
        made = f"joints and drives make it {found.q[k] + 0.0:.6g} {unit}"
        raise SceneError(f"solve.start.displacements.{name}", tables.displacements.get(name, 0.0), made, cure)
    wanted, rates = (engine.rates_of(found.q[None], each.u[None])[0] for each in (given, found))
    largest = abs(rates / measure).max(initial=0.0)
    for k, (name, dimension) in enumerate(dimensions.items()):
        if name in tables.velocities and abs(rates[k] - wanted[k]) > OPEN * measure[k] * largest:
            unit = {LENGTH: "m/s", ANGLE: "rad/s"}.get(dimension, "1/s")
            raise SceneError(
                f"solve.start.velocities.{name}", tables.velocities[name],
                f"joints and drives make it {rates[k] + 0.0:.6g} {unit}",
                "Give rates consistent with the joints, for example those of solution.state()",
            )  # fmt: skip
    return found


def state_after(
    system: System, after: SavedState, choose: Callable[[State], Choice]
) -> tuple[State, dict[str, float]]:
    """Initial state of a run that continues another one, and the angles of joints that close loops, with whole turns.

    Raises SceneError if the state has other coordinates, opens joints, or has a quaternion that is not of unit length.
    """
    names, joints = list(state_dimensions(system)), {f"{name}.angle": name for name in system.mechanism.joints}
    q, v = after.ordered(names, joints)
    _normalise(system, q, "after", after.source)
    u = system.engine.speeds_of(q[None], v[None])[0]
    given = State(after.t, q, u, 0.0 * u, system.engine.sizes.copy(), NONE)
    check_closed(system.engine.gaps(given), "after", after.source, CONTINUE)
    try:
        found = system.project(given.t, q, u, choose(given))
    except ArithmeticError as error:
        raise SceneError("after", after.source, f"in this state {error}", CONTINUE) from None
    known = zip(after.names, after.q.tolist(), strict=True)
    return found, {joints[name]: angle for name, angle in known if name in joints and name not in names}


def _normalise(system: System, q: np.ndarray, key: str, source: str) -> None:
    """Scale the quaternions of a state to unit length, which it may miss by rounding.

    Raises SceneError (of ``key`` and ``source``) if one misses it by more.
    """
    for k in system.engine.balls[:, 0].tolist():
        length = float(np.linalg.norm(q[k : k + 4]))
        if not abs(length - 1.0) <= OPEN:
            owner = system.engine.layout.positions[k][0].rpartition(".")[0]
            raise SceneError(
                key, source, f"the quaternion of {owner} has length {length:.6g}, which is not 1",
                f"Give {owner}.quaternion_w, _x, _y and _z with w^2 + x^2 + y^2 + z^2 = 1",
            )  # fmt: skip
        q[k : k + 4] /= length


def with_turns(
    names: tuple[str, ...], q: np.ndarray, v: np.ndarray, turned: Mapping[str, tuple[float, float]]
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, coordinates and rates of a state, with the angles of joints that close loops, and their rates."""
    angles, rates = np.array([*turned.values()]).reshape(-1, 2).T
    return (*names, *(f"{name}.angle" for name in turned)), np.append(q, angles), np.append(v, rates)


@takes(path="path")
def read_state(path: Path | str) -> SavedState:
    """Last state of a run, from its folder or its ``results.nc``.

    Raises
    ------
    SceneError
        If there are no results, or not of a coupled run.
    """
    path = Path(path)
    cure = "Give the folder of a run of preset coupled, or its results.nc"
    try:
        found = read_labelled(path / "results.nc" if path.is_dir() else path, ("time", *_OF_STATE))
    except Fault as fault:
        raise SceneError("after", str(path), f"its results can't be read: {fault.reason}", cure) from fault
    if not any(name in found.variables for name in _OF_STATE):
        raise no_state(str(path))
    each = (found.variables[name][1] if name in found.variables else np.zeros(0) for name in (*_OF_STATE, "time"))
    names, q, v, times = each
    numbers = all(each.dtype.kind == "f" for each in (q, v, times)) and names.shape == q.shape == v.shape and times.size
    if not numbers or not np.isfinite([times[-1], *q, *v]).all():
        raise SceneError("after", str(path), "its last state is incomplete or damaged", cure)
    return SavedState(str(path), float(times[-1]), tuple(map(str, names)), q, v)


def no_state(source: str) -> SceneError:
    """Error for a run that can't be continued."""
    cure = "Continue from a run of preset coupled"
    return SceneError("after", source, "it has no state: only coupled runs can be continued", cure)
