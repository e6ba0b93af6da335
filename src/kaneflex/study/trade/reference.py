"""Reference of a scene's models: the richest one whose error estimates are within a tolerance."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.scene import Scene
from kaneflex.scene.options import modes_of, resolve_options, tolerance_of
from kaneflex.solve.coupled_corrections import in_steps
from kaneflex.solve.curves import Curves
from kaneflex.solve.error_stages import values_of
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import ROUNDING, Difference, differences
from kaneflex.study.runs import Run, Runs
from kaneflex.study.trade.candidates import COUPLED, RIGID, STIFFENED, elements_of, elements_set, is_driven, with_stored
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.solve.summary_tables import Choice

_FINER, _LEVELS = 2, 3
"""Factor on elements and steps from one level to the next, and the number of finer levels."""
_CONVERGES = 0.5
"""Share of the error estimate of the level before at which a further level is tried."""
_GAIN, _MOST_GAIN = 8.0, 64.0
"""Factor by which it can reduce an error: forces converge at least with the square of the elements' length; and where
modes converge fast, which is tried before a tolerance is refused."""
_DENSEST = 8
"""Largest factor on the stored steps of a coupled model."""
_BETWEEN = 0.5
"""Largest deviation of straight lines between stored instants, as a share of the tolerance."""
_FARTHEST = 128
"""Instants of each sensor beside which the reference of one run is read between its stored ones at a time: where lines
are farthest, which decides on the error of the run itself."""
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
        At its stored instants and between them, where straight lines are not close; for one run of the compared sensors
        only.
    stored : int
        Number of steps between whose instants straight lines are close.
    doubts : mapping of str to float
        By sensor: error estimate, as a share of the peak.
    open : mapping of str to float
        The same of sensors whose estimate exceeds the tolerance; they are not compared.
    note : str
        Why ``coupled`` can't be run, and warnings of the model's run; empty if none.
    levels : tuple of Variant
        The plain model and finer ones, the finest last; the last coupled one has enough stored steps.
    """

    scene: Scene
    model: Variant
    curves: Curves
    stored: int
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
    a sensor within a share of the tolerance, and up to three times if else the tolerance would be refused: the only
    reason with impacts, which hardly converge. Preset ``rigid`` of rigid bodies that drives move.

    Parameters
    ----------
    runs : Runs
        Runs of a neutral scene: :func:`kaneflex.study.trade.candidates.neutral`.
    sensors : sequence of str
        Sensors to compare.
    tolerance, share : float
        ``share`` infinite: sensors that are not named cause no further run.
    named : bool
        Whether each sensor must be within the tolerance; else others are left open.

    Raises
    ------
    SceneError
        If no sensor, or not each named one, is within the tolerance, or the finest model does not resolve a load.
    """
    plain, note = RIGID if is_driven(runs.scene) else COUPLED, ""
    try:
        runs.run(plain)
    except SceneError as error:
        if runs.scene.solve.preset == "coupled" or plain is RIGID:
            raise
        plain, note = STIFFENED, f"preset coupled can't be run: {error}"
    levels, model, enough = _levels(runs.scene, plain), plain, share * tolerance
    doubts = {} if runs.run(plain).curves.undersampled else doubts_of(runs, sensors, plain)
    deciding, before = max if named else min, math.inf
    for finer in levels[1:]:
        hopeful = any(enough < doubt <= _GAIN * enough for doubt in doubts.values())
        hopeful = hopeful and model is plain and not runs.scene.contacts
        found = deciding(doubts.values(), default=math.inf)
        refused = tolerance < found <= min(_MOST_GAIN * tolerance, _CONVERGES * before)
        if doubts and not (hopeful or refused):
            break
        try:
            doubts, model, before = doubts_of(runs, sensors, finer), finer, found
        except SceneError:
            if not doubts:
                raise
            break
    run = runs.run(model)
    _check(runs.scene, model, run, doubts, tolerance, named)
    beyond = {sensor: doubt for sensor, doubt in doubts.items() if doubt > tolerance}
    known = {sensor: doubt for sensor, doubt in doubts.items() if sensor not in beyond}
    notes = "; ".join(filter(None, (note, *run.solution.warnings)))
    limits, many = _limits(run.curves, known, tolerance), math.isfinite(share)
    curves = denser(run, limits, doubts) if many else denser(run, limits, known, _FARTHEST)
    stored = _stored(runs.scene, curves, run.timing.steps, limits)
    levels = _up_to(levels, model, run.timing.steps, stored if named or many else run.timing.steps)
    return Reference(runs.scene, model, curves, stored, known, beyond, notes, levels)


def recalled(scene: Scene, known: Choice, curves: Curves) -> Reference:
    """Reference of an earlier choice for the same neutral scene."""
    plain = next(each for each in (COUPLED, STIFFENED, RIGID) if each.settings[0] in known.reference_settings)
    levels, steps = _levels(scene, plain), resolve_options(scene).steps
    model = next(each for each in levels if each.name == known.reference)
    beyond = {sensor: error for sensor, error in known.open.items() if sensor not in known.doubt}
    levels, limits = _up_to(levels, model, steps, steps), _limits(curves, known.doubt, known.tolerance)
    stored = _stored(scene, curves, steps, limits)
    return Reference(scene, model, curves, stored, known.doubt, beyond, known.reference_note, levels)


def kept_curves(curves: Curves) -> bytes | None:
    """Instants and values of the sensors as a file; None if it would be large."""
    table, file = np.array([curves.times, *curves.values.values()]), BytesIO()
    np.save(file, table)
    return file.getvalue() if table.size <= _MOST else None


def read_curves(path: Path, sensors: Sequence[str]) -> Curves | None:
    """Curves of a file that :func:`kept_curves` made; None if it does not exist or is damaged."""
    try:
        times, *values = np.load(path, allow_pickle=False)
        return Curves(times, dict(zip(sensors, values, strict=True)), {})
    except (OSError, ValueError, TypeError, EOFError):
        return None


def _levels(scene: Scene, plain: Variant) -> tuple[Variant, ...]:
    """The plain model of a preset and finer ones; the error estimate of each runs one as fine as the next."""
    return (plain,) if plain is RIGID else (plain, *(_finer(scene, plain, _FINER**k) for k in range(1, _LEVELS + 1)))


def _up_to(levels: tuple[Variant, ...], model: Variant, steps: int, stored: int) -> tuple[Variant, ...]:
    """Levels up to a model, and of the coupled one of so many steps that with enough stored ones; else at least two."""
    if levels[0] is STIFFENED:
        return levels[: max(2, levels.index(model) + 1)]
    denser = with_stored(model, steps, max(steps, stored))
    return tuple(dict.fromkeys((*levels[: levels.index(model) + 1], denser)))


def _finer(scene: Scene, plain: Variant, scale: int) -> Variant:
    """A finer model than the plain one of a preset, by a factor on its elements and steps."""
    steps, modes = scale * resolve_options(scene).steps, scale * (modes_of(scene.solve) + 1) - 1
    mesh = {name: scale * count for name, count in elements_of(scene.bodies).items()}
    if plain is COUPLED:
        tolerance = in_steps(1.0 / scale, tolerance_of(scene.solve))
        # a mesh with as many elements as modes has enough modes; a multiple keeps the nodes
        mesh = {name: count * max(1, -(-modes // count)) for name, count in mesh.items()}
        name = "coupled" + (f", {modes} modes a link" if mesh else "") + f", tolerance {tolerance:.2g}"
        finer = [f"solve.tolerance={tolerance!r}", f"solve.modes={modes}"]
    else:
        counts = ", ".join(map(str, dict.fromkeys(mesh.values())))
        name, finer = f"stiffened, {counts} elements, {steps} steps", ["solve.integrator=radau"]
    return Variant(name, (*plain.settings, *finer, *elements_set(mesh), f"solve.steps={steps}"))


def doubts_of(runs: Runs, sensors: Sequence[str], model: Variant) -> dict[str, float]:
    """Error estimate of each sensor above rounding error, as a share of its peak; 1 if there is none.

    With contacts of peak and rms. Rigid bodies that drives move have rounding errors only. Raises SceneError if the
    model can't be run, or has no estimates.
    """
    run = runs.run(model)
    found = differences(runs.scene, sensors, model.name, run.curves, run.curves)
    if not found:
        reason = "zero, or rounding errors only, in the whole run, so there is no error to compare"
        raise SceneError("sensors", ", ".join(sensors), reason, "Name others, or add a load or a start that moves them")
    if is_driven(runs.scene):
        return {each.sensor: ROUNDING for each in found}
    runs.progress(f"estimating the errors of {model.name}")
    estimates, reason = run.solution.estimated()
    if not estimates:
        cure = "Choose other sensors, or another start"
        raise SceneError("--tolerance", None, f"the error of the richest model ({model.name}) is {reason}", cure)
    sizes = {name: each.total if each.statistics is None else each.statistics for name, each in estimates.items()}
    return {each.sensor: sizes.get(each.sensor, each.reference_peak) / each.reference_peak for each in found}


def denser(run: Run, limits: Mapping[str, float], sensors: Collection[str], most: int | None = None) -> Curves:
    """Curves of sensors also between a run's instants, until straight lines deviate by no more than each one's limit;
    ``most``: beside so many instants of each sensor at a time, the farthest ones.

    Vibrations that the stored instants do not resolve are not shown; the run's warnings, in the note, tell of them.
    """
    curves, factor = replace(run.curves, values={name: run.curves.values[name] for name in sensors}), 1
    if run.scene.contacts:
        return curves
    bent = np.maximum(*(_bent(curves, curves.times[k::2], limits) for k in (0, 1)))  # over two intervals
    while len(ends := _beside(bent, most)) and factor <= _DENSEST:
        before, middles = curves.times, 0.5 * (curves.times[ends - 1] + curves.times[ends])
        between = values_of(run.solution.at(middles).motion, sensors)
        values = {name: np.insert(own, ends, between[name]) for name, own in curves.values.items()}
        curves = replace(curves, times=np.insert(before, ends, middles), values=values)
        bent, factor = _bent(curves, before, limits), 2 * factor
    return curves


def _beside(bent: np.ndarray, most: int | None) -> np.ndarray:
    """Ends of the intervals beside instants at which lines of a sensor deviate too far, ``most`` of each."""
    farthest = np.argsort(-bent, axis=1, kind="stable")[:, :most]
    found = np.unique(farthest[np.take_along_axis(bent, farthest, axis=1) > 1.0])
    ends = np.union1d(found, found + 1)
    return ends[(ends > 0) & (ends < bent.shape[1])]


def _stored(scene: Scene, curves: Curves, steps: int, limits: Mapping[str, float]) -> int:
    """Fewest steps between whose instants straight lines are within the limits: a quarter of a run's to eight times;
    those of the run if none of these are enough."""
    counts = (_DENSEST * steps >> k for k in (5, 4, 3, 2, 1, 0))
    grids = ((n, np.linspace(curves.times[0], curves.times[-1], n + 1)) for n in counts if n > 0)
    straight = (n for n, grid in grids if _bent(curves, grid, limits).max() <= 1.0)
    return steps if scene.contacts else next(straight, steps)


def _limits(curves: Curves, doubts: Mapping[str, float], tolerance: float) -> dict[str, float]:
    """Deviation of straight lines between stored instants that each sensor permits, in its unit."""
    peaks = {sensor: float(abs(curves.values[sensor]).max()) for sensor in doubts}
    return {name: min(_BETWEEN * tolerance, tolerance - doubt) * peaks[name] for name, doubt in doubts.items()}


def _bent(curves: Curves, instants: np.ndarray, limits: Mapping[str, float]) -> np.ndarray:
    """Deviation of straight lines between other instants, relative to each sensor's limit, (1 + n_sensors, n_times)."""
    found = np.zeros((1 + len(limits), len(curves.times)))
    for row, (name, limit) in zip(found[1:], limits.items(), strict=True):
        own = curves.values[name]
        gap = abs(np.interp(curves.times, instants, np.interp(instants, curves.times, own)) - own)
        np.fmax(row, gap / max(limit, 1e-300), out=row)  # a sensor may have no value at some instants
    return found


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
