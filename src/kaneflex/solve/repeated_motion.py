"""Scenes whose one-way equations can be exported, and Fourier series of a periodic rigid motion's scalars for C in
space.

The loops of such mechanisms are closed by a compiled engine, which is not printed as C. The harmonics of a smooth
periodic motion decay faster than any power, so that the series are accurate almost to rounding.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from kaneflex.fem.freedom import elastic_coordinates
from kaneflex.fem.mobility import check_determined, check_free
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene import Scene, with_settings
from kaneflex.scene.options import resolve_options
from kaneflex.solve.one_way_run import not_repeated
from kaneflex.support.errors import SceneError

_FEWEST, _MOST = 32, 1024
"""Range of the instants of a cycle that are sampled."""
_NEAR, _ROUNDING = 1e-11, 1e-14
"""Accepted error: relative to a scalar's own peak, and to the largest in its unit."""
_NEGLIGIBLE = 1e-3
"""Share of that error below which the highest harmonics are left out."""
_PRESET = "stiffened"
_ONLY = "in space only periodic motions can be exported as C"


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Fourier series of some scalars over a cycle.

    Attributes
    ----------
    period : float
        Cycle [s].
    columns : ndarray (n,)
        Indices among the scalars of the motion.
    drifts : ndarray (n,)
        Increase of each over a cycle: turns of an angle.
    numbers : ndarray (1 + 2 harmonics, n)
        Means, then coefficients of cosine and sine of each harmonic.
    error : float
        Largest error between the sampled instants, relative to a scalar's peak.
    """

    period: float
    columns: np.ndarray
    drifts: np.ndarray
    numbers: np.ndarray
    error: float

    @property
    def count(self) -> int:
        """Number of harmonics."""
        return len(self.numbers) // 2


def check_cycle(scene: Scene, asked: str) -> None:
    """Raise SceneError unless a scene in space has a cycle; ``asked``: entry that needs one."""
    free = [name for name, drive in scene.drives.items() if drive.kind == "free"]
    free += [name for name, body in scene.bodies.items() if body.free is not None]
    if free:
        _refuse(asked, scene.name, f"{_ONLY}, and {', '.join(free)} is free")
    if scene.period is None:
        _refuse(asked, scene.name, f"{_ONLY}, and none of its drives has a cycle")


def one_way_cure(scene: Scene, asked: str, integrated: bool) -> str:
    """Advice which preset has exportable equations, or why none has and what to use instead.

    ``asked``: entry that needs them; ``integrated``: whether they must be integrated ones.
    """
    try:
        other = with_settings(scene, [f"solve.preset={_PRESET}"])
        dynamics = resolve_options(other).dynamics
        if scene.is_spatial:
            check_cycle(other, asked)
        elif dynamics != "rigid":
            check_determined(mechanism_of(other))
            check_free(mechanism_of(other))
            elastic_coordinates(other)
    except SceneError as refusal:
        if refusal.key.startswith("solve."):
            return f"Use --preset {_PRESET}, and change {refusal.key}: {refusal.cure}"
        key = "" if refusal.key == asked else f"{refusal.key}: "
        return f"No linear preset supports this scene: {key}{refusal.reason}. Use results.csv of a run instead"
    if integrated and dynamics == "rigid":
        return "Give a body a beam: rigid bodies have no elastic equations"
    return f"Use another preset, for example --preset {_PRESET}"


def harmonics_of(model: Model, columns: Iterable[int], asked: str, beyond: RigidKinematics | None = None) -> Harmonics:
    """Fourier series of the scalars in ``columns`` of a model's motion; ``asked``: entry that needs them.

    With a motion ``beyond`` which they are: of the differences.

    Raises
    ------
    SceneError
        If the motion is not periodic, or too sudden for a Fourier series.
    """
    reason, period = not_repeated(model), model.scene.period
    assert period is not None  # checked with the scene
    if reason is not None:
        _refuse(asked, model.scene.name, f"{_ONLY}: {reason}")
    own = np.array(sorted(columns), dtype=int)

    def sampled(shares: np.ndarray) -> np.ndarray:
        found = model.motion.table(period * shares)[:, own]
        return found if beyond is None else found - beyond.table(period * shares)[:, own]

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
            reason = f"{worst} changes too suddenly for a Fourier series of {instants // 2} harmonics"
            _refuse(asked, model.scene.name, reason)
        values = np.stack([values, between], axis=1).reshape(2 * instants, -1)
    found *= 2.0 / instants
    found[0] *= 0.5
    kept = np.flatnonzero((abs(found[1:-1]) > _NEGLIGIBLE * scale).any(axis=1))  # the sine of the last one is not known
    count = kept[-1] + 1 if len(kept) else 0
    parts = np.stack([found[1 : count + 1].real, -found[1 : count + 1].imag], axis=1)
    numbers = np.vstack([found[:1].real, parts.reshape(2 * count, len(own))])
    return Harmonics(period, own, drifts, numbers, float((apart / np.maximum(abs(values).max(axis=0), scale)).max()))


def _refuse(asked: str, name: str, reason: str) -> NoReturn:
    raise SceneError(asked, name, reason, "Use drives of constant speed and smooth loads, or a planar scene")
