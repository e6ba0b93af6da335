"""Cost of each group of terms in a scene's equations, of loads, clearances and friction, and the error without it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from kaneflex.scene import Scene
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.solve.loading import Progress, load
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Compared, Difference, differences
from kaneflex.study.runs import Runs, clock
from kaneflex.study.trade.candidates import COUPLED, STIFFENED, check_request, elements_of, neutral, terms_of
from kaneflex.study.trade.parts import parts
from kaneflex.study.trade.reference import doubts_of
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
class Effect(Compared):
    """Effect and cost of a group of terms.

    Attributes
    ----------
    group : Group
    differences : tuple of Difference
        Differences of the model without it from the one with it, by sensor above rounding error; empty if the model
        without it fails.
    needed : bool
        Whether leaving it out changes a sensor by more than the tolerance, or stops the run; for chaotic impacts by
        more than the tolerance and the error estimate.
    operations : int or None
        Additional multiply-adds of one evaluation of M, C, K and F.
    reason : str
        Why the run without it stopped early.
    """

    group: Group
    differences: tuple[Difference, ...]
    needed: bool
    operations: int | None
    reason: str = ""


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
    operations : int or None
        Multiply-adds of one evaluation of M, C, K and F with all groups; None under preset ``coupled``.
    left_out : mapping of str to str
        Groups without result, with the reason.
    """

    scene: Scene
    sensors: tuple[str, ...]
    tolerance: float
    effects: tuple[Effect, ...]
    operations: int | None
    left_out: Mapping[str, str]

    def __repr__(self) -> str:
        needed = [effect.group.name for effect in self.effects if effect.needed]
        return f"Terms({self.scene.name}, needed: {', '.join(needed) or 'none'})"


def groups(scene: Scene) -> tuple[Group, ...]:
    """Groups of a neutral scene: terms, axial deformation, loads, dynamics, two-way coupling; for rigid bodies gravity
    and loads, for a scene that only preset ``coupled`` supports axial deformation and loads.
    :mod:`kaneflex.study.trade.parts` has its clearances and friction.
    """
    whole = _whole(scene.solve.preset)
    one_way = whole is STIFFENED
    found = [_without(whole, term, _IN_WORDS[term], f"solve.terms.{term}=false")
             for term in (terms_of(scene, "dynamic") if one_way else ())]  # fmt: skip
    stretching = [name for name in elements_of(scene.bodies) if not scene.bodies[name].beam.axially_rigid]
    if stretching and not scene.is_spatial:  # in space all beams stretch
        rigid = (f"bodies.{name}.beam.axially_rigid=true" for name in stretching)
        found.append(_without(whole, "axial", "axial deformation of the links", *rigid))
    found += [_without(whole, f"load {name}", "the whole load", f"loads.{name}=none") for name in scene.loads]
    if one_way and scene.is_elastic:
        still = Variant("quasistatic", ("solve.preset=quasistatic",))
        found.append(Group("dynamics", "M z'' and C z', against quasi-statics", whole, still))
        found.append(Group("two-way coupling", "preset coupled, against stiffened", COUPLED, whole))
    return tuple(found)


def _whole(preset: str) -> Variant:
    """Model of a neutral scene with all its groups."""
    return COUPLED if preset == "coupled" else STIFFENED


def _without(whole: Variant, name: str, meaning: str, *settings: str) -> Group:
    return Group(name, meaning, whole, Variant(f"without {name}", (*whole.settings, *settings)))


@takes(scene="scene", tolerance="number", budget="number", sensors="texts", progress="function")
def terms(
    scene: SceneLike,
    tolerance: float = 0.01,
    budget: float = 60.0,
    sensors: Sequence[str] | None = None,
    progress: Progress | None = None,
    chosen: Sequence[Group] | None = None,
) -> Terms:
    """Drop each group of terms from preset ``stiffened``, one at a time, at the scene's own elements and steps; each
    load, clearance and friction from preset ``coupled`` where only that supports the scene.

    Parameters
    ----------
    scene, tolerance, budget, sensors, progress
        As :func:`kaneflex.study.trade.trials.trade` takes them.
    chosen : sequence of Group, optional
        Groups to drop; by default :func:`groups`, and clearances and friction.

    Raises
    ------
    SceneError
        As :func:`kaneflex.study.trade.candidates.check_request`, if neither ``stiffened`` nor ``coupled``
        supports the scene, or if it has no groups.
    """
    scene = scene_from(scene)
    sensors = check_request(scene, tolerance, budget, sensors)
    basis = neutral(scene, load)
    runs, whole = Runs(basis, progress or silent), _whole(basis.solve.preset)
    effects, left_out = list[Effect](), dict[str, str]()
    if chosen is None:
        removed, left_out = parts(basis)
        own = (_without(whole, part, "against none", *settings) for part, settings in removed.items())
        chosen = (*own, *groups(basis))
    if not chosen:
        reason = "no group of terms can be left out: it has no elastic link, load, clearance or friction"
        raise SceneError("scene", scene.name, reason, "Use trade, which compares whole models")
    runs.run(whole)
    doubts: Mapping[str, float] = {}
    with suppress(SceneError):  # the uncertainty is then unknown
        doubts = doubts_of(runs, sensors, whole) if basis.contacts else {}
    deadline = clock() + budget
    for group in chosen:
        if effects and clock() > deadline:
            left_out[group.name] = "no time left within the budget"
            continue
        try:
            effects.append(_effect(runs, sensors, tolerance, group, doubts))
        except SceneError as error:
            if isinstance(error, StoppedEarly) and group.dropped in runs.failed:
                effects.append(Effect(group, (), True, None, str(error)))
            else:
                # without advice, which concerns a setting that only this model has
                left_out[group.name] = "; ".join(f"{each.reason} ({each.key})" for each in error.problems)
    effects.sort(key=lambda effect: -(effect.error if effect.differences or effect.needed else -1.0))
    return Terms(scene, sensors, tolerance, tuple(effects), runs.run(whole).timing.operations, left_out)


def _effect(
    runs: Runs, sensors: Sequence[str], tolerance: float, group: Group, doubts: Mapping[str, float]
) -> Effect:
    """Effect of a group. Raises SceneError if one of its models can't be run, or has none of the sensors."""
    kept, dropped = runs.run(group.kept), runs.run(group.dropped)
    there = [name for name in sensors if name in dropped.curves.values]
    if not there:
        raise SceneError("sensors", None, "no requested sensor exists without it", "Choose others")
    found = differences(runs.scene, there, group.dropped.name, dropped.curves, kept.curves)
    needed = any(each.error - doubts.get(each.sensor, 0.0) > tolerance for each in found)
    whole, less = kept.timing.operations, dropped.timing.operations
    return Effect(group, found, needed, None if whole is None or less is None else whole - less)
