"""What physics does not notice: machines turned, mirrored, in other units, with links' ends exchanged, run backwards.

Every sensor that a scene can have must read the same, with the signs and factors of `transformed`. What differs is
rounding, as the mechanism's equations amplify it, and where steps adapt themselves what their tolerance leaves.
"""

import math
from functools import cache

import numpy as np
import pytest
import transformed
from runs import solved
from transformed import Backwards, Isometry, Raw, Reordered, Scaled

from kaneflex.scene import read_scene

STEPS = 120
FINER = {"engine-elastic-crank": 720}  # a wider step excites what a stiff crank does within it
ROUNDING = 1e-7
"""Share of a reading. The smallest of them are differences of forces a thousand times as large, in equations whose
condition is 1e5 and more; a wrong sign or factor is of the order of one."""
FORWARD, COUPLED = 1e-5, 1e-6
"""The same where free joints are integrated first (relative tolerance 1e-9 of a step), and of coupled runs (1e-8)."""
FLOOR = 1e-2
"""Share of the largest reading in the same unit below which a reading is measured against that instead of itself."""

MIRRORED = [
    "double-pendulum", "elastic-double-pendulum", "engine-elastic-crank", "engine-rig", "four-bar", "free-frame",
    "six-bar", "slider-crank-150-coupled",
]  # fmt: skip
HALF_TURN = ["elastic-pendulum", "four-bar", "spin-up-torque", "v-engine"]
SCALED = [name for name in MIRRORED if name != "free-frame"] + ["rotating-cantilever"]  # a law of t has no known units
SAME_FORCES = ["pulsating-strut", "quick-return"]  # nor has a force by a law of an angle, unless it stays what it is
BACKWARDS = ["engine-3", "four-bar", "pulsating-strut", "quick-return"]
SHUFFLED = [
    "bouncing-bar", "engine-elastic-crank", "engine-rig-clearance", "engine-torque", "four-bar-motor",
    "pin-ended-cross", "quick-return", "six-bar", "stick-slip", "two-link-arm",
]  # fmt: skip
CASES = [
    *((name, "read in another order", None) for name in SHUFFLED), *((name, "mirrored", None) for name in MIRRORED),
    *((name, "turned by 180 degrees", None) for name in HALF_TURN),
    *((name, "in other units, forces kept", None) for name in SAME_FORCES),
    *((name, "in other units", None) for name in SCALED),
    *((name, "backwards", preset) for name in BACKWARDS for preset in ("rigid", "quasistatic")),
    *(("v-engine", "mirrored", preset) for preset in ("rigid", "quasistatic", "paper", "linear")),
]  # fmt: skip
"""Scene, transformation and preset (None: the scene's own) of modules that are shipped: nothing is derived for them.

Scenes in space have rotations of their own (test_spatial_rigid.py).
"""


def probed(name: str, preset: str | None = None) -> Raw:
    """A shipped scene's first steps, with all sensors."""
    scene = read_scene(name)
    raw = transformed.probed(scene)
    steps = FINER.get(name, STEPS)
    solve = raw["solve"] | {"steps": steps} | ({} if preset is None else {"preset": preset})
    if solve.get("start") == "periodic" and solve.get("preset", "stiffened") in ("linear", "stiffened"):
        solve["integrator"] = "radau"  # to rounding; the spectral solver leaves a share of the motion
    if scene.solve.duration:
        solve["duration"] = scene.solve.duration * steps / (scene.solve.steps or 2000)
    return raw | {"solve": solve}


def read(raw: Raw) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The values of every sensor and its unit."""
    solution = solved(transformed.validated(raw))
    assert solution.outcome.name == "COMPLETED", solution.trajectory.message
    series = solution.series
    return {name: one.values for name, one in series.items()}, {name: one.unit for name, one in series.items()}


@cache
def original(name: str, preset: str | None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    return read(probed(name, preset))


def check(raw: Raw, before: tuple[dict, dict], transformation) -> None:
    """Read a transformed scene and compare it with what is expected of it."""
    scene = transformed.validated(raw)
    free = any(drive.free for drive in scene.drives.values())
    tolerance = COUPLED if scene.solve.preset == "coupled" else FORWARD if free else ROUNDING
    (readings, units), (found, _) = before, read(transformation(raw))
    expected = transformation.readings(raw, readings)
    assert set(found) == set(expected)
    largest = {unit: max(abs(expected[name]).max() for name in units if units[name] == unit) for unit in units.values()}
    if "N m" in largest:  # a moment is a force on an arm, small where many of them cancel
        size = max(body.length or 0.0 for body in transformed.validated(transformation(raw)).bodies.values())
        largest["N m"] = max(largest["N m"], size * largest.get("N", 0.0))
    wrong = {}
    for name, values in expected.items():
        apart = found[name] - values
        if units[name] == "rad":
            apart = apart - math.tau * np.round(apart[0] / math.tau)
        allowed = tolerance * (abs(values).max() + FLOOR * largest[units[name]])
        if not abs(apart).max() <= allowed:
            wrong[name] = f"{abs(apart).max() / (abs(values).max() or 1.0):.1e}"
    assert not wrong


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """For tables."""
    return tmp_path_factory.mktemp("transformed")


def transformation(how: str, folder):
    return {
        "read in another order": lambda: Reordered(folder, seed=3, tables=("ground", "sensors")),
        "mirrored": lambda: Isometry(folder, mirrored=True),
        "turned by 180 degrees": lambda: Isometry(folder, angle=math.pi),
        "in other units": lambda: Scaled(folder, length=3.0, mass=6.3, time=2.1),
        "in other units, forces kept": lambda: Scaled(folder, length=2.0, mass=2.0, time=2.0),
        "backwards": lambda: Backwards(folder),
    }[how]()


@pytest.mark.exhaustive(share=6)
@pytest.mark.parametrize(("name", "how", "preset"), CASES, ids=lambda part: part or "own")
def test_every_sensor_reads_the_same(name, how, preset, folder):
    check(probed(name, preset), original(name, preset), transformation(how, folder))


# ---- with equations of their own: turned by 25 degrees, mirrored, and every link with its ends exchanged ----------

AT_ONCE = {"four-bar": "stiffened", "quick-return": "stiffened", "two-link-arm": "stiffened",
           "pin-ended-cross": "linear", "double-pendulum": "rigid", "engine": "stiffened"}  # fmt: skip
"""Scene -> preset."""


def at_once(name: str, folder) -> Isometry:
    scene = read_scene(name)
    joints = scene.joints.values()
    guided = {address.body for joint in joints if joint.kind == "prismatic" for address in joint.addresses}
    links = frozenset(link for link, body in scene.bodies.items() if body.length and link not in guided)
    return Isometry(folder, math.radians(25.0), mirrored=True, reversed=links)


@pytest.mark.exhaustive(share=6)
@pytest.mark.parametrize(("name", "preset"), AT_ONCE.items(), ids=AT_ONCE)
def test_turned_mirrored_and_with_exchanged_ends_at_once(name, preset, folder):
    check(probed(name, preset), original(name, preset), at_once(name, folder))


@pytest.mark.parametrize("name", ["elastic-pendulum", "four-bar-motor"])
def test_a_coupled_run_with_exchanged_ends(name, folder):
    """Both ways round find 6e-8 of a reading apart: the tolerance of steps that are chosen by other coordinates."""
    scene = read_scene(name)
    links = frozenset(link for link, body in scene.bodies.items() if body.elastic)
    check(probed(name), original(name, None), Isometry(folder, reversed=links))


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "preset"), [
    ("double-pendulum", "rigid"), ("six-bar", "rigid"), ("four-bar", "linear"), ("engine", "linear"),
])  # fmt: skip
def test_reordered(name, preset, folder):
    """Equations are derived in the order of the tables."""
    check(probed(name, preset), original(name, preset), Reordered(folder, seed=3))
