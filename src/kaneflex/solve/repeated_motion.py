"""A rigid motion that repeats itself as Fourier series of its scalars: what moves a mechanism in space in C.

The loops of such a mechanism are closed by an engine that numba compiles, of which no kernel is printed. But scalars of
a smooth periodic motion have harmonics that fall off faster than any power: as many are taken as give the motion back,
between the instants that they were found of, nearly to rounding.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from kaneflex.multibody.model import Model
from kaneflex.scene import Scene
from kaneflex.solve.simulation import not_repeated
from kaneflex.support.errors import SceneError

_FEWEST, _MOST = 32, 1024
"""Instants of a cycle that harmonics are found of."""
_NEAR, _ROUNDING = 1e-11, 1e-14
"""Error that counts as none: of a scalar's own peak, and of the largest in its unit."""
_NEGLIGIBLE = 1e-3
"""Share of that error below which the highest harmonics are left out."""
_ONLY = "of mechanisms in space C has only motions that repeat themselves"


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Fourier series of some scalars over a cycle.

    Attributes
    ----------
    period : float
        [s]
    columns : ndarray (n,)
        Their places among the scalars of the motion.
    drifts : ndarray (n,)
        By what each is larger after a cycle: turns of an angle.
    numbers : ndarray (1 + 2 harmonics, n)
        Means, then of each harmonic what is before its cosine and before its sine.
    error : float
        Largest error between the instants that the harmonics were found of, of a scalar's peak.
    """

    period: float
    columns: np.ndarray
    drifts: np.ndarray
    numbers: np.ndarray
    error: float

    @property
    def count(self) -> int:
        """How many harmonics there are."""
        return len(self.numbers) // 2


def check_cycle(scene: Scene, asked: str) -> None:
    """Raise SceneError where nothing in a scene in space has a cycle; ``asked``: what wants one."""
    free = [name for name, drive in scene.drives.items() if drive.kind == "free"]
    free += [name for name, body in scene.bodies.items() if body.free is not None]
    if free:
        _refuse(asked, scene, f"{_ONLY}, not where {', '.join(free)} is left to the forces")
    if scene.period is None:
        _refuse(asked, scene, f"{_ONLY}, and none of its drives has a cycle")


def harmonics_of(model: Model, columns: Iterable[int], asked: str) -> Harmonics:
    """Series of the scalars in some columns of a model's motion; ``asked``: what wants them.

    Raises
    ------
    SceneError
        Of a motion that does not repeat itself, and of one too sudden for any harmonics.
    """
    reason, period = not_repeated(model), model.scene.period
    assert period is not None  # checked with the scene
    if reason is not None:
        _refuse(asked, model.scene, f"{_ONLY}: {reason}")
    own = np.array(sorted(columns), dtype=int)

    def sampled(shares: np.ndarray) -> np.ndarray:
        return model.motion.table(period * shares)[:, own]

    start, end = sampled(np.array([0.0, 1.0]))
    first = np.arange(_FEWEST) / _FEWEST
    values = sampled(first)
    units = [model.module.SCALARS[k][1] for k in own]
    largest = model.motion.at(period * first).magnitudes(period)
    scale = np.maximum(_NEAR * abs(values).max(axis=0), _ROUNDING * np.array([largest[unit] for unit in units]))
    scale += np.finfo(float).tiny
    drifts = np.where(abs(end - start) > scale, end - start, 0.0)
    values -= drifts * first[:, None]
    while True:
        instants = len(values)
        middles = (np.arange(instants) + 0.5) / instants
        between = sampled(middles) - drifts * middles[:, None]
        found = np.fft.rfft(values, axis=0)
        ahead = np.exp(1j * np.pi * np.arange(len(found)) / instants)[:, None]
        apart = abs(np.fft.irfft(found * ahead, instants, axis=0) - between).max(axis=0)
        if (apart <= scale).all():
            break
        if instants >= _MOST:
            names = list(model.motion.column)
            worst = names[own[np.argmax(apart / scale)]]
            reason = f"{worst} changes too suddenly for {instants // 2} harmonics, by which C has motions in space"
            _refuse(asked, model.scene, reason)
        values = np.stack([values, between], axis=1).reshape(2 * instants, -1)
    found *= 2.0 / instants
    found[0] *= 0.5
    kept = np.flatnonzero((abs(found[1:-1]) > _NEGLIGIBLE * scale).any(axis=1))  # the last one's sine is not known
    count = kept[-1] + 1 if len(kept) else 0
    parts = np.stack([found[1 : count + 1].real, -found[1 : count + 1].imag], axis=1)
    numbers = np.vstack([found[:1].real, parts.reshape(2 * count, -1)])
    return Harmonics(period, own, drifts, numbers, float((apart / np.maximum(abs(values).max(axis=0), scale)).max()))


def _refuse(asked: str, scene: Scene, reason: str) -> NoReturn:
    raise SceneError(asked, scene.name, reason, "Take drives of constant speed and smooth loads, or a planar scene")
