"""Natural frequencies and mode shapes of a mechanism in a position, a check of its mesh, and the dependence of the
paper's frozen model on the position."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model, instant_of, reference_modes
from kaneflex.scene.read import SceneLike
from kaneflex.scene.sensors import DRIVE_KINDS
from kaneflex.solve.loading import load, uncoupled
from kaneflex.solve.run_result import MOST_FREQUENCIES
from kaneflex.solve.summary_tables import PeakSpread
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, counted

_LOOKED_AT, _TOO_FAR, _FEW = 6, 0.01, 32
"""Modes compared with a mesh of twice the elements, change that is reported, and elements of a link
above which nothing is compared."""
_RIGID = 1e-6
"""Share of the highest frequency, from the matrices' diagonals, below which a mode is a rigid-body mode: its squared
frequency is a difference of numbers rounded at 1e-16."""
ANGLES = 12
"""Crank angles, equally spaced over a turn, at which the model is frozen."""
_RIGID_KINDS = ("joint_force", *DRIVE_KINDS, "spring_force", "spring_torque")


@dataclass(frozen=True, eq=False)
class Modes:
    """Undamped modes, the lowest first.

    Attributes
    ----------
    model : Model
    coordinates : tuple of str
        Rows of ``shapes``: coordinates of the mechanism; under ``coupled``, amplitudes of shapes and free joints.
    frequencies : ndarray (n_modes,)
        Natural frequencies [Hz].
    shapes : ndarray (n, n_modes)
        Mass-normalised mode shapes in columns [m or rad].
    """

    model: Model
    coordinates: tuple[str, ...]
    frequencies: np.ndarray
    shapes: np.ndarray

    def __repr__(self) -> str:
        shown = ", ".join(f"{value:.6g}" for value in self.frequencies[:_LOOKED_AT])
        more = ", ..." if len(self.frequencies) > _LOOKED_AT else ""
        return f"Modes({self.model.in_short}: {shown}{more} Hz)"

    def as_data(self) -> dict[str, object]:
        """Plain numbers and texts, as printed by ``kaneflex modes --json``."""
        coordinates, slides = self.model.reference_coordinates, self.model.scene.slides
        lengths = {drive: value for drive, value in coordinates.items() if slides(drive)}
        angles = {drive: round(math.degrees(value), 12) for drive, value in coordinates.items() if not slides(drive)}
        return {
            "scene": self.model.scene.name,
            **({"at_m": lengths} if lengths else {}),
            **({"at_deg": angles} if angles or not lengths else {}),
            "coordinates": list(self.coordinates),
            "frequencies_hz": self.frequencies.tolist(),
            "mode_shapes": self.shapes.tolist(),
        }


@takes(scene="scene", count="whole", progress="function")
def modes(scene: SceneLike, count: int | None = None, progress: Callable[[str], None] | None = None) -> Modes:
    """Undamped natural frequencies and mode shapes at ``solve.mode_angle``, from K_s and M alone.

    Preset ``paper`` adds K_d, as the paper's eq. (99) does.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
    count : int, optional
        Number of modes; by default all, at most 50.
    progress : callable, optional
        Called with the name of each stage that can take longer than a moment.

    Raises
    ------
    SceneError
        If the scene can't be loaded, no body is elastic, or the mechanism has fewer than ``count`` modes.
    """
    model = uncoupled(load(scene, progress))
    if model.options.dynamics != "coupled":
        number = _count(model, model.equations.size, count)
        omega, shapes = reference_modes(model, number)
        return Modes(model, model.coordinates, omega / (2.0 * math.pi), shapes)
    from kaneflex.solve.coupled_linearisation import modes_at_rest

    names, omega, shapes = modes_at_rest(model)
    number = _count(model, len(names), count)
    return Modes(model, names, omega[:number] / (2.0 * math.pi), shapes[:, :number])


def _count(model: Model, size: int, count: int | None) -> int:
    if size == 0:
        cure = "Give a body a beam, or choose another preset"
        raise SceneError("solve.preset", model.options.preset, "no body is elastic: there are no modes", cure)
    if count is not None and count > size:
        reason = f"the mechanism has {counted(size, 'degree of freedom')}"
        raise SceneError("count", count, reason, f"Use at most {size}")
    return count or min(size, MOST_FREQUENCIES)


def mesh_hint(found: Modes) -> str:
    """Note on frequencies that change by 1 % or more with twice the elements; empty if there are none."""
    from kaneflex.solve.error_stages import with_half_elements

    model, finer = found.model, with_half_elements(found.model.scene)
    counts = {name: body.beam.elements for name, body in finer.bodies.items() if body.beam is not None}
    if model.options.dynamics == "coupled" or model.options.elements or not counts or max(counts.values()) > 2 * _FEW:
        return ""
    exact = modes(finer, min(_LOOKED_AT, len(found.frequencies))).frequencies
    t = model.reference_time
    highest = math.sqrt((model.K_s(t).diagonal() / model.M(t).diagonal()).max()) / (2.0 * math.pi)
    least = max(1e-6 * exact[-1], _RIGID * highest)
    change = abs(found.frequencies[: len(exact)].clip(min=least) / exact.clip(min=least) - 1.0)
    if (change < _TOO_FAR).all():
        return ""
    mode = int((change > _TOO_FAR).argmax())
    elements = " and ".join(f"{name}.elements = {count}" for name, count in counts.items())
    return f"mode {mode + 1} changes by {change[mode]:.1%} with {elements}: use more elements"


def mode_angle_spread(model: Model) -> dict[str, PeakSpread]:
    """Smallest and largest peak of each sensor over the mode angle.

    The decoupled equations (143) use the mass and stiffness at one crank angle, which the paper does not state; a
    single result of this model is of little use without its spread.

    Returns
    -------
    dict
        Sensor -> smallest and largest max |y| over the ANGLES mode angles that the first drive reaches, in the
        sensor's SI unit; empty if the equations are not frozen.
    """
    from kaneflex.solve.simulation import solve

    peaks: dict[str, list[float]] = {}
    if model.options.dynamics != "frozen":
        return {}
    for k in range(ANGLES):
        angle = 2 * np.pi * k / ANGLES
        if instant_of(model, angle) is None:  # a drive may not reach every angle
            continue
        options = model.options._replace(mode_angle=angle)
        solution = solve(build_model(model.scene, options, model.motion))
        for name, sensor in model.scene.sensors.items():
            if sensor.kind not in _RIGID_KINDS:
                peaks.setdefault(name, []).append(float(abs(solution.series[name].values).max()))
    return {name: PeakSpread(smallest=min(values), largest=max(values)) for name, values in peaks.items()}
