"""Reference of a scene's models: the richest one whose error estimates are within a tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.scene import Scene
from kaneflex.scene.options import modes_of, resolve_options, tolerance_of
from kaneflex.solve.curves import Curves
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference, differences
from kaneflex.study.runs import Run, Runs
from kaneflex.study.trade.candidates import COUPLED, STIFFENED, elements_of, elements_set
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.solve.summary_tables import Choice

_FINER = 2
"""Factor on the scene's elements and steps for the finer model."""
_TIGHTER, _LEAST = 1.0 / 8.0, 1e-13
"""Factor on the tolerance of a step of preset coupled for it, and the least tolerance."""
_GAIN = 8.0
"""Factor by which it can reduce an error: forces converge at least with the square of the elements' length."""
_MOST = 2**23
"""Numbers of a reference that are kept for later commands, 64 MB."""
KNOWN = 0.25
"""Error estimate, as a share of the tolerance, up to which a reference is refined to compare many models with it."""


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
        At twice as many instants as its run has.
    doubts : mapping of str to float
        By sensor: error estimate, as a share of the peak.
    open : mapping of str to float
        The same of sensors whose estimate exceeds the tolerance; they are not compared.
    note : str
        Why ``coupled`` can't be run, and warnings of the model's run; empty if none.
    levels : tuple of Variant
        The plain model and the finer one.
    """

    scene: Scene
    model: Variant
    curves: Curves
    doubts: Mapping[str, float]
    open: Mapping[str, float]
    note: str
    levels: tuple[Variant, ...]

    @property
    def name(self) -> str:
        """Preset and fineness."""
        return self.model.name

    @property
    def sensors(self) -> tuple[str, ...]:
        """Compared sensors."""
        return tuple(self.doubts)

    def errors(self, name: str, curves: Curves, between: bool = True) -> tuple[Difference, ...]:
        """Errors of a model's curves, see :func:`kaneflex.study.differences.differences`."""
        return differences(self.scene, self.sensors, name, curves, self.curves, between)

    def within(self, found: Sequence[Difference], tolerance: float) -> bool:
        """True if every error, plus the reference's own, is within a tolerance; False without errors."""
        return bool(found) and all(each.error + self.doubts[each.sensor] <= tolerance for each in found)


def find_reference(runs: Runs, sensors: Sequence[str], tolerance: float, share: float, named: bool) -> Reference:
    """Preset ``coupled``, or ``stiffened`` if that can't be run, refined once if that can bring the error estimate of
    a sensor within a share of the tolerance; motions with impacts hardly converge.

    Parameters
    ----------
    runs : Runs
        Runs of a neutral scene: :func:`kaneflex.study.trade.candidates.neutral`.
    sensors : sequence of str
        Sensors to compare.
    tolerance, share : float
    named : bool
        Whether each sensor must be within the tolerance; else others are left open.

    Raises
    ------
    SceneError
        If no sensor, or not each named one, is within the tolerance, or the finest model does not resolve a load.
    """
    plain, note = COUPLED, ""
    try:
        runs.run(plain)
    except SceneError as error:
        if runs.scene.solve.preset == "coupled":
            raise
        plain, note = STIFFENED, f"preset coupled can't be run: {error}"
    levels, model, enough = (plain, _finer(runs.scene, plain)), plain, share * tolerance
    doubts = {} if runs.run(plain).curves.undersampled else doubts_of(runs, sensors, plain)
    hopeful = any(enough < doubt <= _GAIN * enough for doubt in doubts.values())
    if not doubts or (hopeful and not runs.scene.contacts):
        try:
            doubts, model = doubts_of(runs, sensors, levels[1]), levels[1]
        except SceneError:
            if not doubts:
                raise
    run = runs.run(model)
    _check(runs.scene, model, run, doubts, tolerance, named)
    beyond = {sensor: doubt for sensor, doubt in doubts.items() if doubt > tolerance}
    known = {sensor: doubt for sensor, doubt in doubts.items() if sensor not in beyond}
    notes = "; ".join(filter(None, (note, *run.solution.warnings)))
    return Reference(runs.scene, model, _denser(run), known, beyond, notes, levels)


def recalled(scene: Scene, known: Choice, curves: Curves) -> Reference:
    """Reference of an earlier choice for the same neutral scene."""
    plain = COUPLED if COUPLED.settings[0] in known.reference_settings else STIFFENED
    levels = plain, _finer(scene, plain)
    model = next(each for each in levels if each.name == known.reference)
    beyond = {sensor: error for sensor, error in known.open.items() if sensor not in known.doubt}
    return Reference(scene, model, curves, known.doubt, beyond, known.reference_note, levels)


def kept_curves(curves: Curves, scene: Scene) -> bytes | None:
    """Instants and values of all sensors as a file; None if it would be large."""
    table, file = np.array([curves.times, *(curves.values[name] for name in scene.sensors)]), BytesIO()
    np.save(file, table)
    return file.getvalue() if table.size <= _MOST else None


def read_curves(path: Path, scene: Scene) -> Curves | None:
    """Curves of a file that :func:`kept_curves` made; None if it does not exist or is damaged."""
    try:
        times, *values = np.load(path, allow_pickle=False)
        return Curves(times, dict(zip(scene.sensors, values, strict=True)), {})
    except (OSError, ValueError, TypeError, EOFError):
        return None


def _finer(scene: Scene, plain: Variant) -> Variant:
    """A finer model than the plain one of a preset, whose error estimate runs one that is twice as fine again."""
    steps, modes, tolerance = _FINER * resolve_options(scene).steps, 2 * modes_of(scene) + 1, tolerance_of(scene)
    mesh = {name: _FINER * count for name, count in elements_of(scene).items()}
    if plain is COUPLED:
        tolerance = max(_LEAST, _TIGHTER * tolerance)
        # a mesh with as many elements as modes has enough modes; a multiple keeps the nodes
        mesh = {name: count * max(1, -(-modes // count)) for name, count in mesh.items()}
        name = f"coupled, {modes} modes a link, tolerance {tolerance:.2g}"
        finer = [f"solve.tolerance={tolerance!r}", f"solve.modes={modes}"]
    else:
        counts = ", ".join(map(str, dict.fromkeys(mesh.values())))
        name, finer = f"stiffened, {counts} elements, {steps} steps", ["solve.integrator=radau"]
    return Variant(name, (*plain.settings, *finer, *elements_set(mesh), f"solve.steps={steps}"))


def doubts_of(runs: Runs, sensors: Sequence[str], model: Variant) -> dict[str, float]:
    """Error estimate of each sensor above rounding error, as a share of its peak; 1 if there is none.

    With contacts of peak and rms. Raises SceneError if the model can't be run, or has no estimates.
    """
    run = runs.run(model)
    found = differences(runs.scene, sensors, model.name, run.curves, run.curves)
    if not found:
        raise SceneError("sensors", ", ".join(sensors), "they are zero or rounding errors only", "Choose other sensors")
    runs.progress(f"estimating the errors of {model.name}")
    estimates, reason = run.solution.estimated()
    if not estimates:
        cure = "Choose other sensors, or another start"
        raise SceneError("--tolerance", None, f"the error of the richest model ({model.name}) is {reason}", cure)
    sizes = {name: each.total if each.statistics is None else each.statistics for name, each in estimates.items()}
    return {each.sensor: sizes.get(each.sensor, each.reference_peak) / each.reference_peak for each in found}


def _denser(run: Run) -> Curves:
    """Curves of a run at twice as many instants, which show what straight lines between the stored ones miss.

    Vibrations that the stored instants do not resolve are not shown; the run's warnings, in the note, tell of them.
    """
    solution, curves = run.solution, run.curves
    if solution.model.scene.contacts:
        return curves
    times = curves.times
    between = solution.at(middles := times[:-1] + 0.5 * np.diff(times)).series
    values = {name: np.insert(own, range(1, len(own)), between[name].values) for name, own in curves.values.items()}
    return replace(curves, times=np.insert(times, range(1, len(times)), middles), values=values)


def _check(
    scene: Scene, model: Variant, run: Run, doubts: Mapping[str, float], tolerance: float, named: bool
) -> None:
    if run.curves.undersampled:
        raise SceneError(
            "--tolerance", f"{100 * tolerance:.3g}%",
            f"in the finest model ({model.name}) {run.curves.undersampled[0]}, so it can't be a reference",
            "Increase solve.steps, or use a smoother load",
        )  # fmt: skip
    sensor = (max if named else min)(doubts, key=doubts.__getitem__)
    if doubts[sensor] > tolerance:
        enough = 1.1 * doubts[sensor]
        looser = f"Use {100 * enough:.2g}% or more, " if enough < 1 else ""
        finer, impacts = "increase the scene's solve.steps and elements", ""
        if scene.contacts:
            finer, impacts = "run longer", "peaks or rms of chaotic impacts: "
        raise SceneError(
            "--tolerance", f"{100 * tolerance:.3g}%",
            f"the richest model ({model.name}) is not converged: {impacts}the error estimate of {sensor} is "
            f"{100 * doubts[sensor]:.2g} %",
            f"{looser}{finer}, choose other sensors, or add damping".capitalize()
            + (", or solve.start = periodic" if scene.period and scene.solve.start != "periodic" else ""),
        )  # fmt: skip
