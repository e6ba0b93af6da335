"""Cost of each group of terms in a scene's equations, and the error without it."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from kaneflex.scene import Scene
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.solve.loading import Progress
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, differences, worst
from kaneflex.study.runs import Cost, Runs, cost, operations
from kaneflex.study.trade.candidates import COUPLED, STIFFENED, elements_of, neutral, repeated_cycle, terms_of
from kaneflex.study.trade.linear_prices import LinearPrices, decided
from kaneflex.study.trade.ranking import check_request
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, StoppedEarly
from kaneflex.support.terminal import silent

_IN_WORDS = {
    "spin": "omega^2", "gyroscopic": "omega", "euler": "epsilon", "geometric": "axial force P",
    "damping": "of the material", "rotary": "inertia of the sections", "shear": "of the sections", "gravity": "weight",
}  # fmt: skip


@dataclass(frozen=True)
class Group:
    """A group of terms, as two models: with it, and the same without it.

    Attributes
    ----------
    name, meaning : str
    kept, dropped : Variant
    """

    name: str
    meaning: str
    kept: Variant
    dropped: Variant


@dataclass(frozen=True)
class Effect:
    """Effect and cost of a group of terms.

    Attributes
    ----------
    group : Group
    differences : tuple of Difference
        Differences of the model without it from the one with it, by sensor above rounding error; empty if the model
        without it fails.
    needed : bool
        Whether leaving it out changes a sensor by more than the tolerance, or stops the run.
    operations : int or None
        Additional multiply-adds of one evaluation of M, C, K and F.
    ns_per_step : float or None
        Additional time per step, from medians; not significant within ``noise_ns``.
    noise_ns : float or None
        Half the larger spread of the two, in ns per step; None for a single repeat.
    reason : str
        Why the run without it stopped early.
    priced : bool
        Whether the differences come from :mod:`kaneflex.study.trade.linear_prices`, without runs and times.
    """

    group: Group
    differences: tuple[Difference, ...]
    needed: bool
    operations: int | None
    ns_per_step: float | None
    noise_ns: float | None
    reason: str = ""
    priced: bool = False

    @property
    def worst(self) -> Difference | None:
        """Sensor with the largest change as a share of its peak."""
        return worst(self.differences) if self.differences else None

    @property
    def rms(self) -> float | None:
        """Largest rms change of a sensor as a share of its peak."""
        return max((found.rms_share for found in self.differences), default=None)


@dataclass(frozen=True, eq=False)
class Terms:
    """Effects of the groups of terms in a scene's equations. Made by :func:`terms`.

    Attributes
    ----------
    scene : Scene
    sensors : tuple of str
    tolerance : float
    effects : tuple of Effect
        Effects, the largest first.
    full : Cost
        Cost of preset ``stiffened`` with all groups.
    left_out : mapping of str to str
        Groups without result, with the reason.
    """

    scene: Scene
    sensors: tuple[str, ...]
    tolerance: float
    effects: tuple[Effect, ...]
    full: Cost
    left_out: Mapping[str, str]

    def __repr__(self) -> str:
        needed = [effect.group.name for effect in self.effects if effect.needed]
        return f"Terms({self.scene.name}, needed: {', '.join(needed) or 'none'})"


def groups(scene: Scene) -> tuple[Group, ...]:
    """Groups of a neutral scene: terms, axial deformation, loads, dynamics, two-way coupling."""

    def without(name: str, *settings: str) -> Variant:
        return Variant(f"without {name}", (*STIFFENED.settings, *settings))

    found = [Group(term, _IN_WORDS[term], STIFFENED, without(term, f"solve.terms.{term}=false"))
             for term in terms_of(scene, "dynamic")]  # fmt: skip
    stretching = [name for name in elements_of(scene) if not scene.bodies[name].beam.axially_rigid]
    if stretching and not scene.is_spatial:  # in space all beams stretch
        rigid = (f"bodies.{name}.beam.axially_rigid=true" for name in stretching)
        found.append(Group("axial", "axial deformation of the links", STIFFENED, without("axial", *rigid)))
    found += [Group(f"load {name}", "the whole load", STIFFENED, without(f"load {name}", f"loads.{name}=none"))
              for name in scene.loads]  # fmt: skip
    still = Variant("quasistatic", ("solve.preset=quasistatic",))
    found.append(Group("dynamics", "M z'' and C z', against quasi-statics", STIFFENED, still))
    found.append(Group("two-way coupling", "preset coupled, against stiffened", COUPLED, STIFFENED))
    return tuple(found)


@takes(scene="scene", tolerance="number", budget="number", sensors="texts", progress="function")
def terms(
    scene: SceneLike,
    tolerance: float = 0.01,
    budget: float = 60.0,
    sensors: Sequence[str] | None = None,
    progress: Progress | None = None,
    chosen: Sequence[Group] | None = None,
) -> Terms:
    """Drop each group of terms from preset ``stiffened``, one at a time, at the scene's own elements and steps.

    The effect of a group follows from one linear solution if the motion is periodic and linear, and if its error cannot
    change whether the group is needed; otherwise it follows from a run.

    Parameters
    ----------
    scene, tolerance, budget, sensors, progress
        As :func:`kaneflex.study.trade.ranking.trade` takes them.
    chosen : sequence of Group, optional
        Groups to drop; by default :func:`groups`.

    Raises
    ------
    SceneError
        For invalid requests, see :func:`kaneflex.study.trade.ranking.check_request`, or if ``stiffened`` can't be run.
    """
    scene = scene_from(scene)
    sensors = check_request(scene, tolerance, budget, sensors)
    basis = neutral(scene)
    chosen = groups(basis) if chosen is None else chosen
    runs, priced = Runs(basis, progress or silent), LinearPrices.of(basis, sensors)
    runs.run(STIFFENED)
    prices = {group: None if priced is None else _priced(basis, priced, tolerance, group) for group in chosen}
    effects = [effect for effect in prices.values() if effect is not None]
    to_run = [group for group, effect in prices.items() if effect is None]
    for model in (each for group in to_run for each in (group.kept, group.dropped)):
        with suppress(SceneError):  # Runs keeps the error
            runs.run(model)
    repeats = runs.repeats(list(runs.kept), time.perf_counter() + budget)
    costs = {model: cost(first.timing, repeats[model]) for model, first in runs.kept.items()}
    left_out = {}
    for group in to_run:
        stopped = runs.failed.get(group.dropped)
        if isinstance(stopped, StoppedEarly):
            effects.append(Effect(group, (), True, None, None, None, str(stopped)))
        elif group.kept in runs.failed or stopped is not None:
            left_out[group.name] = str(runs.failed.get(group.kept, stopped))
        else:
            effects.append(_effect(runs, sensors, tolerance, group, costs))
    effects.sort(key=lambda effect: -(effect.worst.peak_share if effect.worst else math.inf if effect.needed else -1.0))
    return Terms(scene, sensors, tolerance, tuple(effects), costs[STIFFENED], left_out)


def _priced(scene: Scene, prices: LinearPrices, tolerance: float, group: Group) -> Effect | None:
    """Effect of a group by its price; None if there is none, or it leaves open whether the group is needed."""
    try:
        whole, without = prices.curves(group.kept, every=True), prices.curves(group.dropped)
    except SceneError:  # the run reports the cause
        return None
    if whole is None or without is None:
        return None
    found = differences(scene, prices.sensors, group.dropped.name, without, whole, repeated_cycle(scene))
    if not decided(found, tolerance):
        return None
    kept, dropped = (operations(prices.model_of(model)) for model in (group.kept, group.dropped))
    return _judged(group, found, tolerance, kept, dropped, priced=True)


def _judged(
    group: Group, found: tuple[Difference, ...], tolerance: float, kept: int | None, dropped: int | None, **more: Any
) -> Effect:
    """Effect by the differences without a group, and the operations of both models."""
    needed = any((difference.peak_share or 0.0) > tolerance for difference in found)
    added = None if kept is None or dropped is None else kept - dropped
    return Effect(group, found, needed, added, **{"ns_per_step": None, "noise_ns": None} | more)


def _effect(
    runs: Runs, sensors: Sequence[str], tolerance: float, group: Group, costs: Mapping[Variant, Cost]
) -> Effect:
    kept, dropped = costs[group.kept], costs[group.dropped]
    without, whole = runs.run(group.dropped).curves, runs.run(group.kept).curves
    found = differences(runs.scene, sensors, group.dropped.name, without, whole, repeated_cycle(runs.scene))
    spreads = [each.spread * each.ns_per_step for each in (kept, dropped) if each.spread is not None]
    times = {"ns_per_step": kept.ns_per_step - dropped.ns_per_step, "noise_ns": 0.5 * max(spreads) if spreads else None}
    return _judged(group, found, tolerance, kept.operations, dropped.operations, **times)
