"""Finest model of a scene, and an error estimate for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from kaneflex.scene import Scene
from kaneflex.scene.options import modes_of, resolve_options, tolerance_of
from kaneflex.solve.curves import Curves
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, differences, worst
from kaneflex.study.runs import Runs
from kaneflex.study.trade.candidates import COUPLED, elements_of, elements_set, repeated_cycle
from kaneflex.study.trade.linear_prices import LinearPrices
from kaneflex.support.errors import SceneError

_FINER = (1, 2, 4)
"""Factors on the scene's elements and steps."""
_COUPLED_LEVELS = ((1, 0, 1.0), (2, 2, 0.1), (4, 4, 0.1))
"""Refinements of preset coupled: factor on the elements, modes added to each link, factor on the tolerance."""
_FINE_ENOUGH, _KNOWN = 0.1, 0.25
"""Changes, as shares of the tolerance, at which refinement ends, and that are accepted at the finest model.

Preset coupled, which is derived for each number of modes, is refined only to the second.
"""
_PROBED = 180
"""Least steps of a cycle at which coupled is compared."""
_LEFT_BETWEEN = 0.5
"""Share of a change between a model's instants that counts for a model with twice as many."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference of the candidates' errors.

    Attributes
    ----------
    model : Variant
        Variant of the neutral scene.
    curves : Curves
    period : float or None
        Cycle that the curves repeat [s].
    refinement : mapping of str to float
        By sensor: largest change in the last refinement, as a share of the peak; see :func:`find_reference`.
    coupling : mapping of str to float
        By sensor: largest change from ``stiffened`` to ``coupled``; empty if ``coupled`` is the reference or can't be
        run.
    note : str
        Why ``coupled`` can't be run, and warnings of the reference's run; empty if none.
    """

    model: Variant
    curves: Curves
    period: float | None
    refinement: Mapping[str, float]
    coupling: Mapping[str, float]
    note: str = ""

    @property
    def name(self) -> str:
        """Preset and fineness."""
        return self.model.name

    def doubt(self, sensor: str) -> float:
        """Error estimate of the reference itself, as a share of the sensor's peak."""
        return self.refinement.get(sensor, 0.0) + self.coupling.get(sensor, 0.0)

    def within(self, found: Sequence[Difference], tolerance: float, undersampled: Sequence[str] = ()) -> bool:
        """True if every error, plus the reference's own, is within a tolerance; False without errors.

        Models whose steps do not resolve their loads are not within: their error is a matter of luck.
        """
        close = all(each.peak_share + self.doubt(each.sensor) <= tolerance for each in found)
        return bool(found) and close and not undersampled


def find_reference(
    runs: Runs, sensors: Sequence[str], tolerance: float, priced: LinearPrices | None = None
) -> Reference:
    """Preset ``stiffened``, refined until converged; ``coupled`` if that changes a sensor too much.

    Changes are measured at the coarser model's instants. Between them half the change counts if the finer one has twice
    as many: interpolation leaves half at a corner, a quarter on a smooth curve.

    Parameters
    ----------
    runs : Runs
        Runs of a neutral scene: :func:`kaneflex.study.trade.candidates.neutral`.
    sensors : sequence of str
        Compared sensors.
    tolerance : float
        Allowed error of candidates, as a share of each sensor's peak. ``coupled`` is the reference if it changes a
        sensor by more than a quarter of it.
    priced : LinearPrices, optional
        Gives the curves of preset ``stiffened`` without runs.

    Raises
    ------
    SceneError
        If the finest model is not converged to a quarter of the tolerance, or does not resolve a load.
    """
    scene = runs.scene
    stiffened = _refined(runs, sensors, tolerance, _stiffened_levels(scene), _FINE_ENOUGH, priced)
    probe = COUPLED
    if priced is not None:  # a few hundred instants are enough, since it is compared at its own
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
    """Models of preset ``stiffened``, from coarse to fine."""
    steps = resolve_options(scene).steps
    levels = []
    for factor in _FINER:
        elements = {name: factor * count for name, count in elements_of(scene).items()}
        counts = ", ".join(map(str, dict.fromkeys(elements.values())))
        finer = ("solve.integrator=radau", *elements_set(elements), f"solve.steps={factor * steps}")
        name = f"stiffened, {counts} elements, {factor * steps} steps"
        levels.append(Variant(name, ("solve.preset=stiffened", *finer)))
    return levels


def _coupled_levels(scene: Scene) -> list[Variant]:
    levels = []
    for factor, added, tighter in _COUPLED_LEVELS:
        modes, tolerance = modes_of(scene) + added, tighter * tolerance_of(scene)
        settings = ["solve.preset=coupled", f"solve.tolerance={tolerance!r}"]
        if added:  # an explicit number may exceed a coarse link's modes, the default never does
            settings.append(f"solve.modes={modes}")
        if factor > 1:  # a mesh with as many elements as modes has enough modes
            settings += elements_set({name: max(factor * count, modes) for name, count in elements_of(scene).items()})
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
    """By sensor: largest change from a coarse model to a fine one, including half of that between its instants."""
    there, everywhere = (differences(scene, sensors, "coarse", coarse, fine, period, each) for each in (False, True))
    if not there:
        raise SceneError("sensors", ", ".join(sensors), "they are zero or rounding errors only", "Choose other sensors")
    pairs = zip(there, everywhere, strict=True)
    return {own.sensor: max(own.peak_share, _LEFT_BETWEEN * between.peak_share) for own, between in pairs}


def _check(scene: Scene, name: str, curves: Curves, changes: Mapping[str, float], tolerance: float) -> None:
    if curves.undersampled:
        raise SceneError(
            "--tolerance", f"{100 * tolerance:.3g}%",
            f"in the finest model ({name}) {curves.undersampled[0]}, so it can't be a reference",
            "Increase solve.steps, or use a smoother load",
        )  # fmt: skip
    sensor = max(changes, key=changes.__getitem__)
    if changes[sensor] > _KNOWN * tolerance:
        enough = changes[sensor] / _KNOWN
        looser = f"Use {100 * enough:.2g}% or more, increase" if enough < 1 else "Increase"
        raise SceneError(
            "--tolerance", f"{100 * tolerance:.3g}%",
            f"the finest model ({name}) is not converged: refinement still changes {sensor} by "
            f"{100 * changes[sensor]:.2g} %",
            f"{looser} the scene's solve.steps and elements, choose other sensors, or add damping"
            + (", or solve.start = periodic" if scene.period and scene.solve.start != "periodic" else ""),
        )  # fmt: skip
