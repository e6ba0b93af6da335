"""The finest model of a scene, and how far it is itself from what it converges to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from kaneflex.scene import Scene
from kaneflex.scene.options import modes_of, resolve_options, tolerance_of
from kaneflex.solve.curves import Curves
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, differences, worst
from kaneflex.study.runs import Runs
from kaneflex.study.trade.candidates import COUPLED, elements_of, repeated_cycle
from kaneflex.study.trade.linear_prices import LinearPrices
from kaneflex.support.errors import SceneError

_FINER = (1, 2, 4)
"""Elements of each link and steps, times the scene's own."""
_COUPLED_LEVELS = ((1, 0, 1.0), (2, 2, 0.1), (4, 4, 0.1))
"""Preset coupled, ever finer: times the scene's elements, modes added to each link, times the tolerance of a step."""
_FINE_ENOUGH, _KNOWN = 0.1, 0.25
"""Shares of the tolerance: a change at which refining ends, and one that is still allowed at its end.

Preset coupled, which is derived for each number of modes, is refined no further than that.
"""
_PROBED = 180
"""Steps of a cycle at which coupled is compared, at least."""
_LEFT_BETWEEN = 0.5
"""Share of a change between a model's instants that is left between those of one with twice as many."""


@dataclass(frozen=True, eq=False)
class Reference:
    """What candidates are measured against.

    Attributes
    ----------
    model : Variant
        Of the neutral scene.
    curves : Curves
    period : float or None
        Cycle that it repeats [s].
    refinement : mapping of str to float
        By sensor: largest change by the last refinement, as a share of the peak; see :func:`find_reference`.
    coupling : mapping of str to float
        By sensor: the same of the step from ``stiffened`` to ``coupled``; empty where ``coupled`` is the reference
        or can't be run.
    note : str
        What is not known of it: why ``coupled`` can't be run, and what its own run warns of; empty if nothing.
    """

    model: Variant
    curves: Curves
    period: float | None
    refinement: Mapping[str, float]
    coupling: Mapping[str, float]
    note: str = ""

    @property
    def name(self) -> str:
        """Its preset and how fine it is."""
        return self.model.name

    def doubt(self, sensor: str) -> float:
        """How far the reference itself may be off, as a share of the sensor's peak."""
        return self.refinement.get(sensor, 0.0) + self.coupling.get(sensor, 0.0)

    def within(self, found: Sequence[Difference], tolerance: float, undersampled: Sequence[str] = ()) -> bool:
        """Whether every error, with the doubt about the reference on top, is within a tolerance; no errors are not.

        A model is not that steps over what its loads do: how much of it its instants meet is luck.
        """
        close = all(each.peak_share + self.doubt(each.sensor) <= tolerance for each in found)
        return bool(found) and close and not undersampled


def find_reference(
    runs: Runs, sensors: Sequence[str], tolerance: float, priced: LinearPrices | None = None
) -> Reference:
    """Preset ``stiffened``, refined until it stands; ``coupled`` where that changes a sensor by too much.

    The change by a refinement is taken at the coarser model's instants. Between them, where the finer one has twice as
    many, half of it counts: so much is left between the finer one's at a corner; where a curve is smooth, a quarter.

    Parameters
    ----------
    runs : Runs
        Of a neutral scene: :func:`kaneflex.study.trade.candidates.neutral`.
    sensors : sequence of str
        Those that count.
    tolerance : float
        Error that candidates may have, as a share of each sensor's peak. Coupled is needed where it changes a sensor
        by a quarter of it.
    priced : LinearPrices, optional
        What gives the curves of preset ``stiffened`` without runs.

    Raises
    ------
    SceneError
        Where refining still changes a sensor by more than a quarter of the tolerance, or a load comes and goes between
        two steps of the finest model: nothing can be ranked against that.
    """
    scene = runs.scene
    stiffened = _refined(runs, sensors, tolerance, _stiffened_levels(scene), _FINE_ENOUGH, priced)
    probe = COUPLED
    if priced is not None:  # compared at its own instants, of which a few hundred do
        steps = max(_PROBED, resolve_options(scene).steps // 4)
        probe = Variant(f"coupled, {steps} steps", (*COUPLED.settings, f"solve.steps={steps}"))
    try:
        coupled = runs.run(probe).curves
    except SceneError as error:
        unknown = f"preset coupled can't be run: {error}"
        return replace(stiffened, note="; ".join(filter(None, (unknown, stiffened.note))))
    gaps = differences(scene, sensors, "coupled", coupled, stiffened.curves, stiffened.period, between=False)
    if worst(gaps).peak_share <= _KNOWN * tolerance:
        return replace(stiffened, coupling={each.sensor: each.peak_share for each in gaps})
    return _refined(runs, sensors, tolerance, _coupled_levels(scene), _KNOWN)


def _stiffened_levels(scene: Scene) -> list[Variant]:
    """Ever finer models."""
    steps = resolve_options(scene).steps
    levels = []
    for factor in _FINER:
        elements = {name: factor * count for name, count in elements_of(scene).items()}
        settings = (f"bodies.{name}.beam.elements={count}" for name, count in elements.items())
        counts = ", ".join(map(str, dict.fromkeys(elements.values())))
        name = f"stiffened, {counts} elements, {factor * steps} steps"
        by_steps = ("solve.preset=stiffened", "solve.integrator=radau", *settings, f"solve.steps={factor * steps}")
        levels.append(Variant(name, by_steps))
    return levels


def _coupled_levels(scene: Scene) -> list[Variant]:
    levels = []
    for factor, added, tighter in _COUPLED_LEVELS:
        modes, tolerance = modes_of(scene) + added, tighter * tolerance_of(scene)
        settings = ["solve.preset=coupled", f"solve.tolerance={tolerance!r}"]
        if added:  # the scene's own number may be more than a coarse link has, which its default allows for
            settings.append(f"solve.modes={modes}")
        if factor > 1:  # the modes are those of the mesh; one of as many elements as modes has them in any case
            finer = {name: max(factor * count, modes) for name, count in elements_of(scene).items()}
            settings += [f"bodies.{name}.beam.elements={count}" for name, count in finer.items()]
        levels.append(Variant(f"coupled, {modes} modes a link, tolerance {tolerance:.3g}", tuple(settings)))
    return levels


def _refined(
    runs: Runs, sensors: Sequence[str], tolerance: float, levels: Sequence[Variant], enough: float,
    priced: LinearPrices | None = None,
) -> Reference:  # fmt: skip
    scene, period = runs.scene, repeated_cycle(runs.scene)
    coarse: Curves | None = None
    for model in levels:
        found = None if priced is None else priced.curves(model, every=True)
        curves = runs.run(model, judged=True).curves if found is None else found
        if coarse is not None:
            changes = _changes(scene, sensors, coarse, curves, period)
            if max(changes.values()) <= enough * tolerance:
                break
        coarse = curves
    _check(scene, model.name, curves, changes, tolerance)
    return Reference(model, curves, period, changes, {}, "; ".join(curves.notes))


def _changes(
    scene: Scene, sensors: Sequence[str], coarse: Curves, fine: Curves, period: float | None
) -> dict[str, float]:
    """By sensor: largest change from a coarse model to a fine one, and what of it is left between its instants."""
    there, everywhere = (
        differences(scene, sensors, "coarse", coarse, fine, period, between) for between in (False, True)
    )
    if not there:
        raise SceneError("sensors", ", ".join(sensors), "they show nothing, or only rounding", "Name others")
    pairs = zip(there, everywhere, strict=True)
    return {own.sensor: max(own.peak_share, _LEFT_BETWEEN * between.peak_share) for own, between in pairs}


def _check(scene: Scene, name: str, curves: Curves, changes: Mapping[str, float], tolerance: float) -> None:
    if curves.undersampled:
        raise SceneError(
            "--tolerance", f"{100 * tolerance:.3g}%",
            f"in the finest model ({name}) {curves.undersampled[0]}; nothing can be ranked against it",
            "Give the scene more solve.steps, or a load that changes more slowly",
        )  # fmt: skip
    sensor = max(changes, key=changes.__getitem__)
    if changes[sensor] > _KNOWN * tolerance:
        enough = changes[sensor] / _KNOWN
        looser = f"Ask for {100 * enough:.2g}% or more, refine" if enough < 1 else "Refine"
        raise SceneError(
            "--tolerance", f"{100 * tolerance:.3g}%",
            f"the finest model ({name}) still changes {sensor} by {100 * changes[sensor]:.2g} % when it is "
            "refined, so nothing can be ranked against it",
            f"{looser} the scene's solve.steps and elements, choose other sensors, or give the scene damping"
            + (", or solve.start = periodic" if scene.period and scene.solve.start != "periodic" else ""),
        )  # fmt: skip
