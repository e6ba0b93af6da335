"""Planar scenes run in the plane and lifted into space: every sensor of both, how far apart and how slow.

`python tests/parity.py [SCENE ...]` prints the table.
"""

from __future__ import annotations

import sys
import time
from typing import NamedTuple

import numpy as np
from lifting import global_components, in_plane, lifted
from runs import shipped

from kaneflex import Scene, SceneError, Solution, load, read_scene, scene_of, with_settings
from kaneflex.scene.poses import about
from kaneflex.solve.simulation import solve

ONE_WAY = ("rigid", "quasistatic", "linear", "stiffened")
PRESETS = (*ONE_WAY, "coupled")
SHORT = {
    "double-pendulum": ("solve.duration=1 s", "solve.steps=100"),
    "elastic-double-pendulum": ("solve.duration=0.2 s", "solve.steps=50"),
    "elastic-pendulum": ("solve.duration=0.2 s", "solve.steps=50"),
    "engine-3": ("solve.steps=144",),
    "engine-rig": ("solve.duration=0.05 s", "solve.steps=100"),
    "engine-torque": ("solve.duration=0.05 s", "solve.steps=500"),
    "engine-torque-elastic": ("solve.duration=0.02 s", "solve.steps=200"),
    "engine-transient": ("solve.duration=5 ms", "solve.steps=360"),
    "four-bar": ("solve.steps=90",),
    "four-bar-motor": ("solve.duration=0.1 s", "solve.steps=50"),
    "pulsating-strut": ("solve.steps=90",),
    "quick-return": ("solve.steps=360",),
    "slider-crank-150": ("solve.duration=10 ms", "solve.steps=750"),
    "slider-crank-150-coupled": ("solve.duration=10 ms", "solve.steps=750"),
    "spin-up": ("solve.duration=2 s", "solve.steps=200"),
    "spin-up-torque": ("solve.duration=2 s", "solve.steps=200"),
    "two-link-arm": ("solve.steps=180",),
}
"""Settings of scenes that run for long, by which both runs are shorter."""
ROUNDING = 1e-7
"""Share of a sensor's peak that is always allowed: a hundred times the tolerance of free rigid motions, whose error is
not estimated."""


class RejectedInPlane(Exception):
    """A scene is rejected in the plane already; the argument is the error."""


class Sensor(NamedTuple):
    """Largest difference of a sensor between space and plane, what both runs allow, and its peak; all in SI."""

    name: str
    apart: float
    bound: float
    peak: float

    @property
    def agrees(self) -> bool:
        return self.apart <= self.bound


class Parity(NamedTuple):
    """Sensors of a scene under a preset, those that are rejected in space, and the CPU seconds of both runs, loading
    included."""

    sensors: list[Sensor]
    rejected: tuple[str, ...]
    plane: float
    space: float

    @property
    def worst(self) -> Sensor:
        return max(self.sensors, key=lambda each: each.apart / (each.bound or 1.0))


def random_turn(name: str) -> np.ndarray:
    """A rotation, always the same one of a scene."""
    axis = np.random.default_rng(list(name.encode())).normal(size=4)
    return about(axis[:3] / np.linalg.norm(axis[:3]), float(axis[3]))


def planar_scenes() -> list[str]:
    """Shipped planar scenes that move and have sensors."""
    return [name for name, scene in shipped().items() if not scene.is_spatial and scene.sensors]


def planar(name: str, preset: str) -> Scene:
    """A shipped scene with a preset, perhaps shorter, its joint forces in body axes: in space redundant constraints
    leave open what acts across the plane, which components in global axes would contain."""
    scene = read_scene(name)
    forces = [f"sensors.{each}.axes=body" for each, sensor in scene.sensors.items()
              if sensor.kind == "joint_force" and sensor.component != "angle"]  # fmt: skip
    # in space a reduction keeps modes of both planes of bending
    modes = ["solve.modes=all"] if preset in ONE_WAY else []
    return with_settings(scene, [f"solve.preset={preset}", *forces, *modes, *SHORT.get(name, ())])


def compared(flat: Scene, turn: np.ndarray) -> Parity:
    """Run a planar scene, and lifted into space.

    Raises
    ------
    RejectedInPlane, SceneError
        If the planar one is rejected, or the other one alone.
    """
    try:
        plane, planar_seconds = _timed(flat)
    except SceneError as error:
        raise RejectedInPlane(error) from None
    given = lifted(flat, turn) | {"solve": flat.raw["solve"]}
    names, rejected = global_components(flat, given), []
    while True:
        try:
            space, spatial_seconds = _timed(scene_of(given))
            break
        except SceneError as error:
            heads = error.key.split(".")
            if heads[0] != "sensors":
                raise
            rejected.append(heads[1])
            del given["sensors"][heads[1]]
    assert plane.outcome is space.outcome, (plane.message, space.message)
    found, coarse, deep = [], {} if plane.errors[0] else _by_finer_steps(plane), {}
    if space.model.module.FREE and not space.errors[0]:
        deep = _by_finer_steps(space)
    for name, sensor in flat.sensors.items():
        own = names.get(name, [name])
        if not set(own) <= set(given["sensors"]):
            continue
        wanted, values = plane[name].values, np.array([space[each].values for each in own])
        values = in_plane(values, sensor.component, turn) if name in names else values[0]
        peak = float(abs(wanted).max())
        own_bound = coarse.get(name) or _estimated(plane, [name])
        own_deep = float(np.linalg.norm([deep.get(each, 0.0) for each in own])) or _estimated(space, own)
        bound = own_bound + (own_deep or own_bound) + ROUNDING * peak
        found.append(Sensor(name, float(abs(values - wanted).max()), bound, peak))
    return Parity(found, tuple(rejected), planar_seconds, spatial_seconds)


def _estimated(solution: Solution, names: list[str]) -> float:
    """Estimated error of a sensor, of a vector that of its components together; zero where it is not known."""
    errors, _ = solution.errors
    return float(np.linalg.norm([errors[name].total for name in names if name in errors]))


def _by_finer_steps(solution: Solution) -> dict[str, float]:
    """Change of every sensor by steps half as long, and a tenth of the tolerance of free joints."""
    options = solution.model.options
    settings = [f"solve.steps={2 * options.steps}", f"solve.forward.tolerance={0.1 * options.forward_tolerance!r}"]
    finer = solve(load(with_settings(solution.model.given, settings)))
    return {name: float(np.nanmax(abs(finer[name].values[::2] - solution[name].values))) for name in solution}


def _timed(scene: Scene) -> tuple[Solution, float]:
    begun = time.process_time()
    solution = solve(load(scene))
    solution.series  # noqa: B018 -- reading a coupled motion is part of its cost
    return solution, time.process_time() - begun


def _table(names: list[str]) -> None:
    print("scene | preset | worst sensor | apart / peak | bound / peak | CPU s plane | space | ratio")
    for name in names or planar_scenes():
        for preset in PRESETS:
            try:
                found = compared(planar(name, preset), random_turn(name))
            except Exception as error:
                print(f"{name} | {preset} | {error}".replace("\n", " "), flush=True)
                continue
            worst = found.worst
            apart, bound = (each / (worst.peak or 1.0) for each in (worst.apart, worst.bound))
            seconds = f"{found.plane:.2f} | {found.space:.2f} | {found.space / found.plane:.1f}"
            cells = (name, preset, worst.name, f"{apart:.2g}", f"{bound:.2g}", seconds, *found.rejected)
            print(" | ".join(cells), flush=True)


if __name__ == "__main__":
    _table(sys.argv[1:])
