"""Everything about the stability of a scene, with a sentence for each finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kaneflex.multibody.model import Model
from kaneflex.response.buckling import Buckling, buckling
from kaneflex.response.campbell import INSTANTS, Frozen, freeze
from kaneflex.scene import Scene
from kaneflex.solve.loading import load
from kaneflex.stability.findings import findings
from kaneflex.stability.floquet import Multipliers, floquet_multipliers
from kaneflex.stability.steps import StepLimit, recommended, step_limits
from kaneflex.stability.sweep import Sweep, check_sweep, sweep

FREQUENCIES = 6
"""Lowest frequencies that are followed."""


@dataclass(frozen=True, eq=False)
class Stability:
    """What :func:`judge` found; SI.

    Attributes
    ----------
    model : Model
    multipliers : Multipliers
    frozen : Frozen
    buckling : Buckling or None
        None where something is held by nothing.
    limits : tuple of StepLimit
    recommended : StepLimit or None
    sweep : Sweep or None
        Where speeds were asked for.
    """

    model: Model
    multipliers: Multipliers
    frozen: Frozen
    buckling: Buckling | None
    limits: tuple[StepLimit, ...]
    recommended: StepLimit | None
    sweep: Sweep | None

    @property
    def findings(self) -> dict[str, str]:
        """A sentence on each subject."""
        return findings(self)

    def as_data(self) -> dict[str, object]:
        """All of it as plain data, numbers that are not finite as None."""
        m, frozen, limit = self.multipliers, self.frozen, self.recommended
        data: dict[str, object] = {
            "scene": self.model.scene.name,
            "preset": self.model.options.preset,
            "findings": self.findings,
            "period": m.period,
            "spectral_radius": m.radius,
            "unstable": m.unstable,
            "multipliers": [[value.real, value.imag] for value in m.values.tolist()],
            "steps_of_multipliers": m.steps,
            "settled": m.converged,
            "frozen_growth": frozen.growth.max(),
            "condition_M": frozen.condition_M.max(),
            "condition_K": frozen.condition_K.max(),
            "buckling_margin": None if self.buckling is None else self.buckling.margin,
            "step_limits": [vars(each) for each in self.limits],
            "recommended": None if limit is None else vars(limit),
        }
        if self.sweep is not None:
            data["drive"], data["unstable_bands"] = self.sweep.drive, [list(band) for band in self.sweep.bands]
            data["widest_gap"] = self.sweep.widest_gap
            data["crossings"] = [crossing._asdict() for crossing in self.sweep.crossings()]
        return _plain(data)


def judge(
    scene: Scene, speeds: np.ndarray | None = None, stage: Callable[[str], None] = lambda name: None
) -> Stability:
    """Judge the stability of a scene's periodic equations.

    Parameters
    ----------
    scene : Scene
    speeds : ndarray, optional
        Of the first drive, rising, to be gone through as well [rad/s, or m/s of a guide].
    stage : callable
        Called with the name of each stage.

    Raises
    ------
    SceneError
        If the model has no periodic elastic equations, or its first drive no constant speed to be varied.
    """
    if speeds is not None:
        check_sweep(scene)
    model = load(scene, stage)
    stage("multipliers")
    multipliers = floquet_multipliers(model)
    frozen = freeze(model, FREQUENCIES, INSTANTS)
    stage("stable steps")
    limits = step_limits(model, multipliers)
    swept = None
    if speeds is not None:
        stage("speeds")
        swept = sweep(scene, speeds, FREQUENCIES)
    highest = frozen.frequencies.max(axis=0)
    lowest = float(highest[highest > 0.0].min(initial=np.inf)) if highest.any() else 0.0
    best = recommended(limits, lowest)
    return Stability(model, multipliers, frozen, buckling(model, frozen.times), limits, best, swept)


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
