"""Richest model of a scene, and an error estimate for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from kaneflex.scene import Scene
from kaneflex.scene.options import modes_of, resolve_options, tolerance_of
from kaneflex.solve.curves import Curves
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, differences, of_statistics, worst
from kaneflex.study.runs import Runs
from kaneflex.study.trade.candidates import COUPLED, elements_of, elements_set, repeated_cycle
from kaneflex.study.trade.linear_prices import LinearPrices
from kaneflex.support.errors import SceneError

_FINER = (1, 2, 4)
"""Factors on the scene's elements and steps."""
_TIGHTER = 1.0 / 3.0
"""Factor on the tolerance of a step from level to level of preset coupled; the error is proportional to it."""
_FINE_ENOUGH, _KNOWN = 0.1, 0.25
"""Changes, as shares of the tolerance, at which refinement ends, and that are accepted at the finest model.

Preset coupled, whose runs take longer, is refined only to the second.
"""
_LEFT_BETWEEN = 0.5
"""Share of a change between a model's instants that counts for a model with twice as many."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference of the candidates' errors.

    Attributes
    ----------
    scene : Scene
        The neutral scene.
    model : Variant
        Variant of the neutral scene.
    curves : Curves
    refinement : mapping of str to float
        By sensor: largest change in the last refinement, as a share of the peak; see :func:`find_reference`.
    coupling : mapping of str to float
        By sensor: largest change from ``stiffened`` to ``coupled``; empty if ``coupled`` is the reference or can't be
        run.
    note : str
        Why ``coupled`` can't be run, and warnings of the plain model's run; empty if none.
    levels : tuple of Variant
        Models up to the reference, from coarse to fine.
    """

    scene: Scene
    model: Variant
    curves: Curves
    refinement: Mapping[str, float]
    coupling: Mapping[str, float]
    note: str = ""
    levels: tuple[Variant, ...] = ()

    @property
    def name(self) -> str:
        """Preset and fineness."""
        return self.model.name

    def doubt(self, sensor: str) -> float:
        """Error estimate of the reference itself, as a share of the sensor's peak."""
        return self.refinement.get(sensor, 0.0) + self.coupling.get(sensor, 0.0)

    def errors(self, sensors: Sequence[str], name: str, curves: Curves, between: bool = True) -> tuple[Difference, ...]:
        """Errors of a model's curves, see :func:`compared`."""
        return compared(self.scene, sensors, name, curves, self.curves, between)

    def within(self, found: Sequence[Difference], tolerance: float, undersampled: Sequence[str] = ()) -> bool:
        """True if every error, plus the reference's own, is within a tolerance; False without errors.

        Models whose steps do not resolve their loads are not within: their error is a matter of luck.
        """
        close = all(each.peak_share + self.doubt(each.sensor) <= tolerance for each in found)
        return bool(found) and close and not undersampled


def compared(
    scene: Scene, sensors: Sequence[str], name: str, curves: Curves, reference: Curves, between: bool = True
) -> tuple[Difference, ...]:
    """Differences of a model from a reference over a cycle or run; with contacts those of peaks and rms.

    Motions with impacts diverge, so that they can't be compared instant by instant.
    """
    if scene.contacts:
        return of_statistics(scene, sensors, name, curves, reference)
    return differences(scene, sensors, name, curves, reference, repeated_cycle(scene), between)


def find_reference(
    runs: Runs, sensors: Sequence[str], tolerance: float, priced: LinearPrices | None = None
) -> Reference:
    """Preset ``coupled``, refined until converged; ``stiffened`` if that is priced and the coupling is small, or if
    ``coupled`` can't be run.

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
    try:
        coupled, unknown = runs.run(COUPLED).curves, ""
    except SceneError as error:
        if scene.solve.preset == "coupled":
            raise
        coupled, unknown = None, f"preset coupled can't be run: {error}"
    if priced is not None or coupled is None:
        stiffened = _refined(runs, sensors, tolerance, _stiffened_levels(scene), _FINE_ENOUGH, priced)
        if coupled is None:
            return replace(stiffened, note="; ".join(filter(None, (unknown, stiffened.note))))
        gaps = compared(scene, sensors, "coupled", coupled, stiffened.curves, between=False)
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
    """Models of preset ``coupled``, from coarse to fine; motions with impacts hardly converge beyond the second."""
    steps, own = resolve_options(scene).steps, modes_of(scene)
    levels, tolerance = [COUPLED], tolerance_of(scene)
    for factor, modes in ((2, own + 2),) if scene.contacts else ((2, own + 2), (4, 4 * own + 3)):
        tolerance *= _TIGHTER
        # a mesh with as many elements as modes has enough modes
        mesh = elements_set({name: max(factor * count, modes) for name, count in elements_of(scene).items()})
        finer = (f"solve.tolerance={tolerance!r}", f"solve.modes={modes}", *mesh, f"solve.steps={factor * steps}")
        name = f"coupled, {modes} modes a link, tolerance {tolerance:.2g}"
        levels.append(Variant(name, (*COUPLED.settings, *finer)))
    return levels


def _refined(
    runs: Runs, sensors: Sequence[str], tolerance: float, levels: Sequence[Variant], enough: float,
    priced: LinearPrices | None = None,
) -> Reference:  # fmt: skip
    scene = runs.scene
    coarse: Curves | None = None
    for model in levels:
        found = None if priced is None else priced.curves(model, every=True)
        curves = runs.run(model).curves if found is None else found
        if coarse is not None:
            changes = _changes(scene, sensors, coarse, curves)
            if max(changes.values()) <= enough * tolerance:
                break
        coarse = curves
    _check(scene, model.name, curves, changes, tolerance)
    plain = runs.kept.get(levels[0])  # warnings of the finest model are the same, and take longer
    notes = curves.notes if plain is None else plain.solution.warnings
    tried = tuple(levels[: levels.index(model) + 1])
    return Reference(scene, model, curves, changes, {}, "; ".join(notes), tried)


def _changes(scene: Scene, sensors: Sequence[str], coarse: Curves, fine: Curves) -> dict[str, float]:
    """By sensor: largest change from a coarse model to a fine one, including half of that between its instants."""
    there, everywhere = (compared(scene, sensors, "coarse", coarse, fine, each) for each in (False, True))
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
