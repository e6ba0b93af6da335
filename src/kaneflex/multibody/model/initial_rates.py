"""Initial rates of a planar mechanism, from some given rates, its joints and its drives.

Rates of shapes are as given, else zero. Given rates of bodies come next, the others follow by the joints; remaining
freedoms move as in the rigid mechanism, joints with an initial speed first, then bodies from the ground outwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kaneflex.multibody.model.determinacy import jacobian
from kaneflex.multibody.model.system import BODY, CoupledSystem
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
_CURE = "Give consistent rates of as many bodies as the mechanism has freedoms, or leave one out"


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
            raise SceneError(
                f"drives.{name}.initial_speed", speed,
                f"at the start its loops allow a speed of {rate:.6g} only: one of them locks it, or is in a "
                "singular position", "Start near this position, or give the speed of another joint",
            )  # fmt: skip


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
    names = [name for name, _ in system.coordinates]
    measure, frames = system.measure(system.mechanism.size or 1.0), np.zeros(system.size, bool)
    for k in system.start.values():
        frames[k : k + BODY] = True
    speeds = _initial_speeds(scene)
    rows, wanted = _rows(system, q, measure, list(speeds))
    held, rate = len(system.constraints), v / measure
    words = _Words(given, {name: (measure[k], f"{unit}/s") for k, (name, unit) in enumerate(system.coordinates)})
    _fit_shapes(rows[:held], wanted[:held], rate, frames, words)
    rest = wanted - rows[:, ~frames] @ rate[~frames]
    free = _Free.of(rows[:held, frames], rest[:held])
    place = {name: k for k, name in enumerate(np.array(names)[frames])}
    for turn in (True, False):
        for name in given:
            if name in place and name.endswith(".phi") is turn:
                _give(free, place[name], rate[names.index(name)], name, words)
    for row, value, speed in zip(rows[held:, frames], rest[held:], speeds.values(), strict=True):
        free.ask(row, value + speed)
    for parts in (("phi",), ("x", "y")):
        for name in (f"{body}.{part}" for body in system.engine.layout.bodies for part in parts):
            free.ask(np.eye(1, len(place), place[name])[0], rate[names.index(name)])
    rate[frames] = free.rate
    return rate * measure


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


@dataclass(frozen=True)
class _Words:
    """Rates that are ``given``, as in the scene, and the unit of every coordinate."""

    given: Mapping[str, float | str]
    units: Mapping[str, tuple[float, str]]

    def said(self, name: str, rate: float) -> str:
        measure, unit = self.units[name]
        return f"{rate * measure if abs(rate) > _NOTHING else 0.0:.6g} {unit}"

    def refused(self, name: str, reason: str, cure: str) -> SceneError:
        return SceneError(f"solve.start.velocities.{name}", self.given[name], reason, cure)


def _fit_shapes(
    rows: np.ndarray, wanted: np.ndarray, rate: np.ndarray, frames: np.ndarray, words: _Words
) -> None:
    """Change shapes' rates where the frames alone can't satisfy the joints: first those not given, then given ones."""
    sums, sizes, _ = np.linalg.svd(rows[:, frames])
    rank = int((sizes > _RANK * sizes.max(initial=0.0)).sum())
    left = sums[:, rank:].T
    A, shapes, names = left @ rows, np.flatnonzero(~frames), list(words.units)
    least = _RANK * max(1.0, abs(A[:, shapes]).max(initial=0.0))  # what shapes don't bear is rounding
    for own in (False, True):
        columns = [k for k in shapes if (names[k] in words.given) is own]
        size = np.linalg.norm(A[:, columns], 2) if columns and len(left) else 0.0
        if size <= least:
            continue
        missing = left @ wanted - A[:, shapes] @ rate[shapes]
        off = np.linalg.pinv(A[:, columns], rcond=least / size) @ missing
        if own and abs(off).max() > _MISSED * max(abs(rate[shapes])):
            most = int(abs(off).argmax())
            name, found = names[columns[most]], rate[columns[most]] + off[most]
            cure = "Give rates of shapes consistent with the joints, for example those of solution.state()"
            raise words.refused(name, f"joints and drives make it {words.said(name, found)}", cure)
        rate[columns] += off


def _give(free: _Free, k: int, value: float, name: str, words: _Words) -> None:
    """Set the rate number k of the bodies' frames."""
    row = np.eye(1, len(free.rate), k)[0]
    if free.ask(row, value, name):
        return
    off = abs(free.rate[k] - value)
    if off <= _MISSED * max(abs(value), abs(free.rate).max()):
        return
    others = [f"{other} = {words.said(other, rate)}" for other, rate in free.partners(row)]
    by = f"with {', '.join(others)} the joints make it" if others else "joints and drives make it"
    raise words.refused(name, f"{by} {words.said(name, float(free.rate[k]))}", _CURE)


@dataclass
class _Free:
    """Rates of the frames, with an orthonormal ``basis`` (n, ...) of the rows that determine them so far."""

    rate: np.ndarray
    basis: np.ndarray
    joints: int
    asked: dict[str, tuple[np.ndarray, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: np.ndarray, wanted: np.ndarray) -> _Free:
        """Least rates that satisfy the joints' rows."""
        rate = np.linalg.lstsq(rows, wanted, rcond=_RANK)[0]
        _, sizes, shapes = np.linalg.svd(rows, full_matrices=False)
        basis = shapes[sizes > _RANK * sizes.max(initial=0.0)].T
        return cls(rate, basis, basis.shape[1])

    def ask(self, row: np.ndarray, value: float, name: str = "") -> bool:
        """Require a sum of the rates; False if preceding requirements determine it."""
        own = row - self.basis @ (self.basis.T @ row)
        own -= self.basis @ (self.basis.T @ own)
        size = float(np.linalg.norm(own))
        if size <= _OPEN * np.linalg.norm(row):
            return False
        self.rate = self.rate + own * ((value - row @ self.rate) / size**2)
        self.basis = np.column_stack([self.basis, own / size])
        if name:
            self.asked[name] = row, value
        return True

    def partners(self, row: np.ndarray) -> list[tuple[str, float]]:
        """Named rates, with their values, on which a sum of rates depends."""
        if not self.asked:
            return []
        joints = self.basis[:, : self.joints]
        rows = np.array([row, *(asked for asked, _ in self.asked.values())]).T
        rows = rows - joints @ (joints.T @ rows)
        shares = np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0]
        return [(name, value) for (name, (_, value)), share in zip(self.asked.items(), shares, strict=True)
                if abs(share) > _OPEN]  # fmt: skip
