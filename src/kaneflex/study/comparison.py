"""Comparison of several models of one scene: all sensors, and their differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.scene.parts import PRESETS
from kaneflex.scene.read import SceneLike, scene_from, with_settings
from kaneflex.solve.curves import FINE_ENOUGH, Curves, Resolution
from kaneflex.study.differences import Difference, check_sensors, difference
from kaneflex.support.arguments import takes
from kaneflex.support.errors import Problem, SceneError, failed, nearest
from kaneflex.support.labelled import Labelled
from kaneflex.support.terminal import silent

if TYPE_CHECKING:
    import xarray

    from kaneflex.scene import Scene
    from kaneflex.solve.loading import Progress

PRESETS_COMPARED = ("linear", "stiffened", "coupled")
"""From the simplest to the most complete; the last one is the reference."""
PEERS = "kaneflex.peers"
"""Entry points of other programs that run scenes: name -> module with ``check(scene)`` and ``solve(scene, resolution,
progress)``."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Results of several models of one scene at the same instants. Made by :func:`compare`.

    Attributes
    ----------
    scene : Scene
    against : str
        Name of the reference model.
    curves : mapping of str to Curves
        By model, all at the same instants.
    left_out : mapping of str to str
        Models that could not be run to the end, with the reason.
    """

    scene: Scene
    against: str
    curves: Mapping[str, Curves]
    left_out: Mapping[str, str]

    def __repr__(self) -> str:
        return f"Comparison({self.scene.name}: {', '.join(self.curves)} against {self.against})"

    @property
    def times(self) -> np.ndarray:
        """Instants of the reference [s], shape (n_times,)."""
        return self.curves[self.against].times

    @cached_property
    def differences(self) -> tuple[Difference, ...]:
        """Differences of every other model from the reference, by sensor, for sensors that both have."""
        references = self.curves[self.against].values
        return tuple(
            difference(name, model, sensor.unit, self.times, curves.values[name], reference, abs(reference).max())
            for name, sensor in self.scene.sensors.items() if (reference := references.get(name)) is not None
            for model, curves in self.curves.items() if model != self.against and name in curves.values
        )  # fmt: skip

    @cached_property
    def labelled(self) -> Labelled:
        """All curves: dimensions ``model`` and ``time`` [s], a variable for each sensor in SI.

        NaN where a model does not give a sensor.
        """
        none = np.full(len(self.times), np.nan)
        variables = {}
        for name, sensor in self.scene.sensors.items():
            values = np.array([curves.values.get(name, none) for curves in self.curves.values()])
            variables[name] = ("model", "time"), values, {"units": sensor.unit}
        coordinates = {
            "model": ("model", np.array(list(self.curves))),
            "time": ("time", self.times, {"units": "s", "long_name": "time"}),
        }
        return Labelled(variables, coordinates, {"scene": self.scene.name, "against": self.against})

    @cached_property
    def dataset(self) -> xarray.Dataset:
        """:attr:`labelled` as one labelled dataset."""
        return self.labelled.dataset()


@takes(scene="scene", presets="texts", against="text", progress="function", peer="text")
def compare(
    scene: SceneLike,
    presets: Sequence[str] | None = None,
    against: str | None = None,
    progress: Progress | None = None,
    peer: str | None = None,
    resolution: Resolution = FINE_ENOUGH,
) -> Comparison:
    """Run a scene under several presets, and in another program, and compare their sensors.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
        All settings but the preset are kept.
    presets : sequence of str, optional
        By default linear, stiffened and coupled; with ``peer``, the scene's own preset.
    against : str, optional
        Name of the reference model; by default the other program, else the last preset that ran.
    progress : callable, optional
        Called with the name of each stage that can take longer than a moment.
    peer : str, optional
        Another program that also runs the scene: "exudyn", or an entry point of group "kaneflex.peers".
    resolution : Resolution
        Mesh and steps of that program.

    Returns
    -------
    Comparison
        At the instants of the reference; the other curves are interpolated linearly. Presets that fail are in
        ``left_out`` with the reason.

    Raises
    ------
    SceneError
        If a preset does not exist, the scene has no sensors or the other program can't build it, the reference
        failed, or fewer than two models ran.
    """
    from kaneflex.study.runs import run

    scene, progress = scene_from(scene), progress or silent
    if presets is None:
        presets = PRESETS_COMPARED if peer is None else (scene.solve.preset,)
    peers = () if peer is None else (peer,)
    check_request(scene, presets, against, peers)
    programs = [entry_points(group=PEERS)[peer].load() for peer in peers]
    for program in programs:
        program.check(scene)
    found: dict[str, Curves] = {}
    left_out: dict[str, str] = {}
    for model in (*presets, *peers):
        try:
            if model == peer:
                found[model] = programs[0].solve(scene, resolution, progress)
            else:
                own = run(with_settings(scene, [f"solve.preset={model}"]), progress, model)
                found[model] = replace(own.curves, notes=own.solution.warnings)
        except SceneError as error:
            left_out[model] = str(error)
    return side_by_side(scene, found, left_out, against)


def check_request(scene: Scene, presets: Sequence[str], against: str | None, others: Sequence[str] = ()) -> None:
    """Check presets, reference and sensors before anything is computed, else raise SceneError; ``others`` are
    programs."""
    for preset in presets:
        if preset not in PRESETS:
            raise SceneError("--presets", preset, "unknown preset", nearest(preset, PRESETS))
    for other in others:
        programs = entry_points(group=PEERS).names
        if other not in programs:
            cure = nearest(other, programs) if programs else "In a copy of the sources, run: pip install ./tests/peers"
            raise SceneError("--with", other, "unknown program", cure)
    asked = [*presets, *others]
    if len(set(asked)) < max(2, len(asked)):
        cure = "Name each model once" if len(set(asked)) < len(asked) else "Name at least two"
        raise SceneError("--presets", ",".join(presets), "a comparison needs two or more different models", cure)
    if against is not None and against not in asked:
        raise SceneError("--against", against, "not one of the compared models", nearest(against, asked))
    check_sensors(scene.sensors)


def side_by_side(
    scene: Scene, found: Mapping[str, Curves], left_out: Mapping[str, str], against: str | None
) -> Comparison:
    """Interpolate the curves of several models to the instants of the reference.

    Raises
    ------
    SceneError
        If the reference failed, or fewer than two models ran.
    """
    if len(found) < 2 or (against is not None and against not in found):
        what = "fewer than two of them can be run" if len(found) < 2 else f"{against}, the reference, can't be run"
        problem = Problem("--presets", ",".join([*found, *left_out]), what, "Choose other presets")
        raise SceneError.gather([problem, *(failed(model, reason) for model, reason in left_out.items())])
    reference = against or list(found)[-1]
    last, shortest = min((curves.times[-1], model) for model, curves in found.items())
    times = found[reference].times
    times = times[times <= last * (1 + 1e-9)]
    common = {model: _at(curves, times) for model, curves in found.items()}
    for model, curves in found.items():
        if curves.times[-1] > last * (1 + 1e-9):
            note = f"peaks and differences cover the first {last:.4g} s only: the run of {shortest} ends there"
            common[model] = replace(common[model], notes=(*curves.notes, note))
    return Comparison(scene, reference, common, left_out)


def _at(curves: Curves, times: np.ndarray) -> Curves:
    values = {name: np.interp(times, curves.times, series) for name, series in curves.values.items()}
    return replace(curves, times=times, values=values)
