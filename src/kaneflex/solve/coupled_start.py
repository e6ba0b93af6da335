"""First instant of a coupled run, with what its C needs: in the plane and in space."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kaneflex.mechanism.spatial_frame import AXES
from kaneflex.multibody.compile.entries import EXPORTED, PLANE, SPACE
from kaneflex.multibody.compile.mechanisms import HANDED, typed
from kaneflex.multibody.dynamics import exported_entries
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.determinacy import COMPONENTS
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import CoupledSystem
from kaneflex.multibody.time import integration
from kaneflex.multibody.time.run import PATIENT
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.solve.coupled import beginning, method_of
from kaneflex.solve.simulation import simulate
from kaneflex.support.errors import SceneError

_XYZ = "xyz"


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
    free : ndarray
        Numbers of the independent coordinates; in space of the independent speeds.
    names : mapping
        Names of the entries of arrays.
    undetermined : collection of str
        Names of statically indeterminate forces, which are NaN.
    entries : mapping
        Functions of the texts by their names there, with their signatures.
    tables : mapping
        Numbers that these texts need.
    sizes, numbers : mapping
        Lengths of arrays that only one dimension has, and other numbers of its texts.
    """

    engine: Engine
    row: np.ndarray
    step: float
    sloped: float
    integrator: str
    free: np.ndarray
    names: Mapping[str, Sequence[str]]
    undetermined: Collection[str]
    entries: Mapping[str, tuple[Any, Any]]
    tables: Mapping[str, np.ndarray]
    sizes: Mapping[str, int]
    numbers: Mapping[str, float]


def begun(model: Model) -> Begun:
    """First instant of the run of a coupled model. Raises SceneError if it has none."""
    system, start = model.coupled, beginning(model) if model.options.start != "periodic" else _periodic(model)
    times = model.step * np.arange(model.options.steps + 1)
    run = integration.begun(model.coupled_system, start, times, method_of(model))
    if not run.projected:
        reason = "the mechanism is in a singular position at the start"
        raise SceneError("solve.start", model.options.start, reason, "Start from another position")
    ahead = run.engine, run.here, run.step, run.sloped, run.method.integrator, run.engine.choice.independent
    return Begun(*ahead, *(_in_space(model) if system is None else _in_plane(system)))


def _periodic(model: Model) -> State:
    """Start of a periodic motion."""
    found, system = simulate(model).trajectory, model.coupled_system
    assert isinstance(found, CoupledTrajectory)
    if not len(found.times):
        raise SceneError("solve.start", "periodic", found.message, "Start from zero")
    return found.curve.start if found.curve is not None else next(
        system.engine.states_of(found.rows[:1], system.engine.choice)
    )


def _in_plane(system: CoupledSystem) -> tuple:
    engine = system.engine
    names = {"coordinate": [name for name, _ in system.coordinates], "force": system.constraints, "free": engine.names}
    return (
        names, system.undetermined, _typed(engine, PLANE, ("project", "integrate", "unfold")),
        _recorded(system), {}, {"Y": at.Y, "RATE": at.RATE},
    )  # fmt: skip


def _in_space(model: Model) -> tuple:
    motion = model.coupled_in_space
    assert motion is not None
    system = motion.module.system
    entries = _typed(system.engine, SPACE, ("project", "integrate")) | _typed(system.engine, EXPORTED)
    names = _names(system)
    sizes = {"RATES": len(names["rate"]), "POSITIONS": len(names["position"]), "SPEEDS": system.engine.size}
    numbers = {
        "patience": PATIENT, "fixed": int(system.engine.light), "FIXED": exported_entries.FIXED,
        "CHANGED": exported_entries.CHANGED,
    }  # fmt: skip
    tables = {**_recorded(system), "level": system.engine.levels}
    return names, motion.module.open_reactions, entries, tables, sizes, numbers


def _typed(engine: Engine, entries: Mapping[str, str], only: Sequence[str] = ()) -> dict[str, tuple[Any, Any]]:
    """Compiled functions by name with their signatures as types."""
    found = typed(entries, HANDED[engine.kind])
    return {each.__name__: (each, of) for each, of in found.items() if not only or each.__name__ in only}


def _recorded(system: CoupledSystem | SpatialSystem) -> dict[str, np.ndarray]:
    """Columns of the record that exported C reads."""
    return {f"columns_{key}": getattr(system.record, key) for key in ("q", "v", "a", "forces")}


def _names(system: SpatialSystem) -> dict[str, Sequence[str]]:
    """Names of the entries of arrays in space: bodies in the order of the tree, joints in the order of the scene."""
    layout = system.layout
    coordinates, rates = list[str](), list[str]()
    for body in layout.node_of:
        shapes = [layout.positions[k][0] for k in system.engine.amplitudes(body)[0]]
        coordinates += [f"{body}.{axis}" for axis in _XYZ] + [f"{body}.axes_{name}" for name in AXES] + shapes
        rates += [f"{body}.{what}_{axis}" for what in ("v", "omega") for axis in _XYZ]
        rates += [f"{shape}_rate" for shape in shapes]
    forces = [f"{joint}.{part}" for joint in system.mechanism.joints for part in COMPONENTS]
    return {
        "coordinate": coordinates, "rate": rates, "force": [*forces, *(f"{name}.drive" for name in system.driven)],
        "position": [name for name, _ in layout.positions], "speed": layout.speeds,
    }  # fmt: skip
