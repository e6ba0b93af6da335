"""First instant of a coupled run, with what its C needs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kaneflex.mechanism.spatial_frame import AXES
from kaneflex.multibody.compile.entries import EXPORTED
from kaneflex.multibody.compile.mechanisms import HANDED, typed
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.determinacy import COMPONENTS
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.run import Run
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.solve.coupled import beginning, method_of
from kaneflex.solve.simulation import simulate
from kaneflex.support.errors import SceneError

_PLACE = {3: ("x", "y", "phi"), 6: (*"xyz", *(f"axes_{name}" for name in AXES))}
_TWIST = {3: ("v_x", "v_y", "omega"), 6: tuple(f"{what}_{axis}" for what in ("v", "omega") for axis in "xyz")}
"""Coordinates and rates of a body's frame, by D."""
_LEAST = 1e-6
"""Share of the largest inertia of a speed below which virtual inertia is that one's."""


@dataclass(frozen=True, eq=False)
class Begun:
    """Engine at the first instant of a run, and what its C needs.

    Attributes
    ----------
    row : ndarray
        Row of the integration there.
    step : float
        First step [s].
    sloped : float
        Derivatives of loads in the first factors, see :func:`kaneflex.multibody.time.collocation.integrate`.
    names : mapping
        Names of the entries of arrays.
    undetermined : collection of str
        Names of statically indeterminate forces, which are NaN.
    entries : mapping
        Functions of the texts by their names there, with their signatures.
    tables : mapping
        Columns of the record; levels and virtual inertia of the coordinates.
    """

    engine: Engine
    row: np.ndarray
    step: float
    sloped: float
    integrator: str
    names: Mapping[str, Sequence[str]]
    undetermined: Collection[str]
    entries: Mapping[str, tuple[Any, Any]]
    tables: Mapping[str, np.ndarray]


def begun(model: Model) -> Begun:
    """First instant of the run of a coupled model. Raises SceneError if it has none."""
    start = beginning(model) if model.options.start != "periodic" else _periodic(model)
    times = model.step * np.arange(model.options.steps + 1)
    run = Run(model.coupled_system, start, times, method_of(model))
    if not run.projected:
        reason = "the mechanism is in a singular position at the start"
        raise SceneError("solve.start", model.options.start, reason, "Start from another position")
    engine, record = run.engine, model.coupled_system.record
    bodies, forces, undetermined = _reactions(model)
    tables = {f"columns_{key}": getattr(record, key) for key in ("q", "v", "a", "forces")}
    tables |= {"level": engine.levels, "virtual": _virtual_inertia(engine)}
    entries = {each.__name__: (each, of) for each, of in typed(EXPORTED, HANDED[engine.kind]).items()}
    names = _names(engine, bodies) | {"force": forces}
    return Begun(
        engine, run.here, run.step, run.sloped, run.method.integrator, names, undetermined, entries, tables
    )  # fmt: skip


def _periodic(model: Model) -> State:
    """Start of a periodic motion."""
    found = simulate(model).trajectory
    assert isinstance(found, CoupledTrajectory)
    if not len(found.times):
        raise SceneError("solve.start", "periodic", found.message, "Start from zero")
    start: State = found.curve.start
    return start


def _virtual_inertia(engine: Engine) -> np.ndarray:
    """Virtual inertia of the speeds without drives, of the size of their own; zero if all bodies have inertia."""
    found = np.zeros(engine.size)
    if engine.light:
        free, inertia = engine.open_speeds, engine.mass().diagonal()
        most = (inertia * engine.measure**2).max(initial=0.0) / engine.measure**2
        found[free] = np.where(inertia > _LEAST * most, inertia, most)[free]
    return found


def _reactions(model: Model) -> tuple[Iterable[str], Sequence[str], Collection[str]]:
    """Bodies, joint and drive forces in the order of the record, and forces that are statically indeterminate."""
    system, motion = model.coupled, model.coupled_in_space
    if system is not None:
        return system.start, system.constraints, system.undetermined
    assert motion is not None
    found = motion.module.system
    forces = [f"{joint}.{part}" for joint in found.mechanism.joints for part in COMPONENTS]
    return found.layout.node_of, [*forces, *(f"{name}.drive" for name in found.driven)], motion.module.open_reactions


def _names(engine: Engine, bodies: Iterable[str]) -> dict[str, Sequence[str]]:
    """Names of the entries of arrays: coordinates of these bodies, then of joints and shapes."""
    layout, coordinates, rates = engine.layout, list[str](), list[str]()
    for body in bodies:
        shapes = [layout.positions[k][0] for k in engine.amplitudes(body)[0]]
        coordinates += [f"{body}.{part}" for part in _PLACE[engine.kind.d]] + shapes
        rates += [f"{body}.{part}" for part in _TWIST[engine.kind.d]] + [f"{shape}_rate" for shape in shapes]
    positions = [name for name, _ in layout.positions]
    return {"coordinate": coordinates, "rate": rates, "position": positions, "speed": layout.speeds}
