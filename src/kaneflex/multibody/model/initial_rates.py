"""Initial rates of a planar mechanism, from some given rates, its joints and its drives.

Each is required in turn unless preceding ones determine it by the joints: given rates of shapes, zero ones of the
others, given rates of bodies, initial speeds of joints, then rates of the rigid mechanism from the ground outwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kaneflex.mechanism.closure import changed_speed
from kaneflex.multibody.model.determinacy import jacobian
from kaneflex.multibody.model.system import CoupledSystem
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

_RANK = 1e-9
"""Share of the largest singular value of the joints' rows below which a row is redundant."""
_OPEN = 1e-6
"""Share of a unit rate that must remain for it to be free."""
_MISSED = 1e-3
"""Largest change of a given rate by joints, as a share of the largest rate, measured in the mechanism's size or rad."""
_NOTHING = 1e-12
"""Rate [sizes of the mechanism or rad a second] that is written as zero."""
_CURE = "Give consistent rates of as many bodies as the mechanism has degrees of freedom, or leave one out"
_SHAPES = "Give rates of shapes consistent with the joints, for example those of solution.state()"


def closed(system: CoupledSystem, q: np.ndarray, v: np.ndarray) -> np.ndarray | None:
    """q with its loops closed at t = 0; None where they can't be."""
    system.compile()
    system.fold(q, v)
    system.engine.choose(0.0)
    return system.unfold(system.engine.row(0.0)[None]).q[0] if system.engine.move_on(0.0) else None


def check_kept(scene: Scene, system: CoupledSystem, q: np.ndarray, v: np.ndarray) -> None:
    """Check that free joints start with their given speeds, which locked loops may prevent."""
    speeds = _initial_speeds(scene)
    if not speeds or scene.contacts or closed(system, q, v) is None:  # sides that touch may change them at once
        return
    moving = system.unfold(system.engine.row(0.0)[None]).v[0]
    rates = jacobian(system, q, list(speeds))[len(system.constraints) :] @ moving
    for (name, speed), rate in zip(speeds.items(), rates.tolist(), strict=True):
        if not abs(rate - speed) <= _MISSED * abs(speed):
            raise changed_speed(f"drives.{name}.initial_speed", speed, rate)


def _initial_speeds(scene: Scene) -> dict[str, float]:
    """Initial speeds of free joints given by the scene."""
    return {name: drive.initial_speed for name, drive in scene.drives.items()
            if drive.kind == "free" and "initial_speed" in drive.model_fields_set}  # fmt: skip


def fitted(
    scene: Scene, system: CoupledSystem, q: np.ndarray, v: np.ndarray, given: Mapping[str, float | str]
) -> np.ndarray:
    """Rates v (size,) with the ``given`` ones, else those of the rigid mechanism, projected onto the joints at q.

    Raises
    ------
    SceneError
        If joints, drives and preceding given rates contradict a given rate.
    """
    measure, speeds = system.measure(system.mechanism.size or 1.0), _initial_speeds(scene)
    units = {name: f"{unit}/s" for name, unit in system.coordinates}
    frames = [f"{body}.{part}" for parts in (("phi",), ("x", "y")) for body in system.engine.layout.bodies
              for part in parts]  # fmt: skip
    shapes = [name for name in units if name not in frames]
    (rows, wanted), held = _rows(system, q, measure, list(speeds)), len(system.constraints)
    rates = _Rates.of(rows[:held], wanted[:held], dict(zip(units, measure, strict=True)))
    for name in (*sorted(shapes, key=lambda name: name not in given),
                 *sorted(set(given) & set(frames), key=lambda name: (not name.endswith(".phi"), [*given].index(name)))):
        k = rates.place[name]
        value = v[k] / measure[k]
        off = abs(rates.ask(np.eye(1, len(v), k)[0], value, name) - value)
        if name in given and not off <= _MISSED * max(abs(value), abs(rates.rate).max()):
            others = [f"{other} = {_said(rate * rates.measure[other])} {units[other]}"
                      for other, rate in rates.partners(k) if other in given]  # fmt: skip
            by = f"with {', '.join(others)} the joints make it" if others else "joints and drives make it"
            reason = f"{by} {_said(rates.rate[k] * measure[k])} {units[name]}"
            cure = _SHAPES if name in shapes else _CURE
            raise SceneError(f"solve.start.velocities.{name}", given[name], reason, cure)
    for row, value, speed in zip(rows[held:], wanted[held:], speeds.values(), strict=True):
        rates.ask(row, value + speed)
    for name in frames:
        rates.ask(np.eye(1, len(v), rates.place[name])[0], v[rates.place[name]] / rates.measure[name])
    found = rates.rate * measure
    return np.where(abs(found - v) <= _NOTHING * measure, v, found)


def _rows(
    system: CoupledSystem, q: np.ndarray, measure: np.ndarray, free: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of joints and prescribed drives by measured rates, then those of ``free`` drives; and their right-hand
    sides."""
    rows = jacobian(system, q, free) * measure
    driven = system.engine.layout.driven
    speeds = dict(zip(driven, system.engine.courses(np.zeros(1))[0, 1::3], strict=True))
    names = [*system.constraints, *(f"{name}.drive" for name in free)]
    wanted = np.array([speeds.get(name.rpartition(".")[0], 0.0) * name.endswith(".drive") for name in names])
    sizes = np.linalg.norm(rows[: len(system.constraints)], axis=1)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    rows[: len(sizes)] /= sizes[:, None]
    wanted[: len(sizes)] /= sizes
    return rows, wanted


def _said(rate: float) -> str:
    return f"{rate if abs(rate) > _NOTHING else 0.0:.6g}"


@dataclass
class _Rates:
    """Measured rates, with an orthonormal ``basis`` (n, ...) of the rows that determine them so far; ``measure``: unit
    of each by name."""

    rate: np.ndarray
    basis: np.ndarray
    joints: int
    measure: Mapping[str, float]
    asked: dict[str, tuple[np.ndarray, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: np.ndarray, wanted: np.ndarray, measure: Mapping[str, float]) -> _Rates:
        """Least rates that satisfy the joints' rows."""
        rate = np.linalg.lstsq(rows, wanted, rcond=_RANK)[0]
        _, sizes, shapes = np.linalg.svd(rows, full_matrices=False)
        basis = shapes[sizes > _RANK * sizes.max(initial=0.0)].T
        return cls(rate, basis, basis.shape[1], measure)

    @property
    def place(self) -> dict[str, int]:
        """Place of each rate by its name."""
        return {name: k for k, name in enumerate(self.measure)}

    def ask(self, row: np.ndarray, value: float, name: str = "") -> float:
        """Require a sum of the rates; returns the one that preceding requirements leave."""
        own = row - self.basis @ (self.basis.T @ row)
        own -= self.basis @ (self.basis.T @ own)
        size = float(np.linalg.norm(own))
        if size > _OPEN * np.linalg.norm(row):
            self.rate = self.rate + own * ((value - row @ self.rate) / size**2)
            self.basis = np.column_stack([self.basis, own / size])
            if name:
                self.asked[name] = row, value
        return float(row @ self.rate)

    def partners(self, k: int) -> list[tuple[str, float]]:
        """Named rates, with their values, on which the rate number k depends."""
        joints = self.basis[:, : self.joints]
        rows = np.array([np.eye(1, len(self.rate), k)[0], *(asked for asked, _ in self.asked.values())]).T
        rows = rows - joints @ (joints.T @ rows)
        shares = np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0]
        return [(name, value) for (name, (_, value)), share in zip(self.asked.items(), shares, strict=True)
                if abs(share) > _OPEN]  # fmt: skip
