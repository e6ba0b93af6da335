"""Runs of scenes that several tests look at, those of shipped scenes made once a process; and prescribed ones."""

import ast
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kaneflex import Model, Scene, Solution, load, read_scene, shipped_scenes, with_settings
from kaneflex.generated import shapes as kernels
from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.mechanism.affine import Affine
from kaneflex.mechanism.joints import Constraints, reactions
from kaneflex.mechanism.planar import BodyPoint
from kaneflex.mechanism.spatial import Side
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model import tree_layout as of
from kaneflex.multibody.model.body_parameters import link_data
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.model.tree_builder import side_of
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves
from kaneflex.solve.simulation import solve

STENCIL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""First derivative from nine equidistant values, error of the eighth order (Fornberg 1988)."""


class Peak(NamedTuple):
    """A sensor's extreme value (SI) and the first drive's angle there [deg]."""

    value: float
    degrees: float


@cache
def shipped() -> dict[str, Scene]:
    """Scenes that kaneflex brings, by their names: many files choose among them."""
    return {name: read_scene(name) for name in sorted(shipped_scenes())}


@lru_cache(maxsize=64)
def model(scene: str, *settings: str) -> Model:
    """A shipped scene, or the path of one, with settings of the form path=value."""
    return load(with_settings(read_scene(scene), list(settings)))


SHORT = {"engine-torque": ("solve.duration=0.25 s", "solve.steps=2500")}
"""A tenth of the run of what is integrated for seconds when it is loaded, for what may look at any part of it."""


def short(scene: str) -> Model:
    """A shipped scene, those of SHORT over the first part of their run."""
    return model(scene, *SHORT.get(scene, ()))


def counts_of(system: System) -> dict[str, tuple[int, ...]]:
    """Body -> numbers of its axial and transverse shapes."""
    shapes = system.layout.shapes
    return {name: shapes[name].counts if name in shapes else (0, 0) for name in system.mechanism.bodies}


def starts_of(system: System) -> dict[str, int]:
    """Body -> first place of its coordinates in the frames and shapes of a planar system."""
    counts = counts_of(system)
    return dict(zip(counts, np.cumsum([0, *(3 + sum(own) for own in counts.values())]).tolist(), strict=False))


def names_of(system: System) -> list[str]:
    """Frames x, y, phi and shapes of the bodies of a planar system, by name."""
    places = {body: system.engine.amplitudes(body)[0] for body in system.mechanism.bodies}
    shapes = {body: [system.layout.positions[k][0] for k in own] for body, own in places.items()}
    return [name for body, own in shapes.items() for name in (f"{body}.x", f"{body}.y", f"{body}.phi", *own)]


def shapes_of(system: System, body: str) -> slice:
    """Places of a body's modal coordinates in the frames and shapes of a planar system."""
    first = starts_of(system)[body] + 3
    return slice(first, first + sum(counts_of(system)[body]))


def folded(system: System, t: float, q: np.ndarray, v: np.ndarray) -> State:
    """State of a planar system at t [s] by frames and shapes of its bodies, (size,); loops are not closed. The tables
    have the sections by these frames."""
    engine, bodies = system.engine, system.engine.tables.bodies
    engine.part()
    layout = engine.layout
    for body, (first, count) in zip(layout.node_of, bodies[:, [at.MODAL, at.SHAPES]].tolist(), strict=True):
        for part, given in zip(engine.motion, (q, v), strict=False) if count else ():
            part[first : first + count] = given[shapes_of(system, body)]
    engine.openings(t)  # deforms the bodies
    places, rates, *_ = engine.motion
    for body, name, fields in zip(layout.node_of, layout.inboard, bodies, strict=True):
        moves = slice(fields[at.FIRST], fields[at.FIRST] + fields[at.DOF])
        if name is None:
            places[moves], rates[moves] = np.split(np.array(_section(system, Side(body, (0.0, 0.0, 0.0)), q, v)), 2)
            continue
        if name not in system.mechanism.joints:  # of a lumped mass
            continue
        (node,), sign = layout.tree[name]
        sides = system.mechanism.joints[name].sides[::sign]  # the outer one is the second
        up, own = (np.array(_section(system, side_of(side), q, v)) for side in sides)
        (_, _, angle), (along, across, _) = (engine.parts["numbers"][node, columns] for columns in (of.PLACE, of.AXIS))
        if engine.parts["nodes"][node, of.KIND] == of.TURN:
            places[moves], rates[moves] = sign * (own[2] - up[2] - angle), sign * (own[5] - up[5])
        elif engine.parts["nodes"][node, of.KIND] == of.SLIDE:
            guide = complex(along, across) * np.exp(1j * (up[2] + angle))
            apart, parting = (complex(*(own - up)[k : k + 2]) * guide.conjugate() for k in (0, 3))
            places[moves], rates[moves] = apart.real, parting.real + up[5] * apart.imag
    return engine.state(t, engine.choice)


def _section(system: System, side: Side, q: np.ndarray, v: np.ndarray) -> tuple[float, ...]:
    """Pose and twist of a section by its body's frame, (size,), as it is deformed; vectors are complex numbers."""
    layout, arrays, body, place = system.layout, system.engine.arrays, side.body, np.array(side.at)
    node = layout.node_of.get(body, -1)
    if node < 0:
        return *place, 0.0, 0.0, 0.0
    if body in layout.shapes:
        on = layout.shapes[body].carrier(side.at)
        node, place = layout.stations[body, on], place - on
    start, own, pose, twist = starts_of(system)[body], shapes_of(system, body), place.copy(), np.zeros(3)
    if own.stop > own.start:
        station = arrays["nodes"][node, of.KIND] == of.STATION
        row, numbers = (arrays[name][node if station else node + 1] for name in ("nodes", "numbers"))
        count = own.stop - own.start
        pose, phi = numbers[of.PLACE if station else of.SHIFT].copy(), np.zeros(3 * count)
        if row[of.AT] >= 0:
            pose += kernels.displace.py_func(arrays["block"], row[of.AT], count, q[own], 0, phi, 0)
            twist = v[own] @ phi.reshape(-1, 3)
    turn, omega, arm = np.exp(1j * q[start + 2]), v[start + 2], complex(*pose[:2])
    at_point = complex(*q[start : start + 2]) + turn * arm
    moving = complex(*v[start : start + 2]) + 1j * omega * turn * arm + turn * complex(*twist[:2])
    return at_point.real, at_point.imag, q[start + 2] + pose[2], moving.real, moving.imag, omega + twist[2]


def gaps(system: System, t: float, q: np.ndarray) -> dict[str, float]:
    """By how much frames and shapes q (size,) of a planar system violate every joint's rows and every prescribed drive
    [m or rad] at t [s]: by name."""
    folded(system, t, q, 0.0 * q)
    engine, joints, poses = system.engine, {}, {}
    for name, joint in system.mechanism.joints.items():
        ends = [BodyPoint(f"{name}.{side}", "", (0.0, 0.0)) for side in range(2)]
        joints[name] = replace(joint, first=ends[0], second=ends[1])
        for side, end in zip(joint.sides, ends, strict=True):
            poses[end.body] = np.array(_section(system, side_of(side), q, 0.0 * q)[:3])
    drives = dict(zip(engine.layout.driven, engine.courses(np.array([t]))[0, ::3].tolist(), strict=True))
    constraints = Constraints(replace(system.mechanism, joints=joints), drives)
    names = [row for joint in joints.values() for row, *_ in reactions(joint)]
    names += [f"{name}.drive" for name in joints if name in drives]
    return dict(zip(names, constraints.residuals(poses).tolist(), strict=True))


def closed(system: System, t: float, q: np.ndarray, v: np.ndarray) -> CoupledTrajectory:
    """The nearest state of a planar system with closed loops, with accelerations and reactions."""
    folded(system, t, q, v)
    row = system.engine.row(t)[None]
    return by_themselves(system, row, system.nearby(row))


def changes(solution: Solution) -> list[np.ndarray]:
    """Rows before and after every change of contacts, frictions and loads' sides of a coupled run, in turn."""
    rows = np.concatenate([rows for rows, _ in solution.trajectory.curve.pieces])
    return [row for before, after in pairwise(rows) if before[0] == after[0] and (before != after).any()
            for row in (before, after)]  # fmt: skip


def derived_on_the_fly(text: str, folder: Path, *settings: str) -> Model:
    """The model of a scene, given by its text and written into `folder`, that no shipped module serves."""
    file = folder / "scene.toml"
    file.write_text(text)
    found = load(with_settings(read_scene(str(file)), list(settings)))
    assert not found.module.__name__.startswith("kaneflex.generated.")
    return found


def tables(module: ast.Module) -> dict[str, Any]:
    """Tables of a module's text, of which nothing else is run."""
    found: dict[str, Any] = {}
    wanted = [node for node in module.body if isinstance(node, (ast.Assign, ast.ImportFrom))]
    exec(compile(ast.Module(wanted, type_ignores=[]), "tables", "exec"), found)
    return found


def at_instant(found: Model, affine: Affine, t: float) -> np.ndarray:
    """A sum of monomial x matrix at time t [s] by its definition, not by the compiled kernels."""
    rigid = found.motion.at(t)
    return affine.value({name: float(rigid[name][0]) for monomial in affine.terms for name in monomial})


def moments(found: Model, body: str) -> dict[str, np.ndarray]:
    """ARRAYS of a body under preset coupled."""
    system = found.coupled
    return (link_data(system.shapes[body]) if body in system.shapes else found.scene.bodies[body].modal).arrays


def solved(scene: Scene, *settings: str) -> Solution:
    """A run of its own. Unlike `simulate`, here and in `run`, what it warns of is computed where it is asked for."""
    return solve(load(with_settings(scene, settings) if settings else scene))


@cache
def run(scene: str, *settings: str) -> Solution:
    solution = solve(model(scene, *settings))
    assert solution.outcome.name == "COMPLETED", solution.trajectory.message
    return solution


def alike(
    found: Any, wanted: Any, within: float | Mapping[str, float], sensors: Iterable[str] | None = None, after: int = 0
) -> None:
    """Assert that sensors of two solutions, or of their series, differ by less than a share of the wanted one's largest
    value: those named, or all; from the stored instant ``after`` on."""
    if not isinstance(within, Mapping):
        within = dict.fromkeys(getattr(wanted, "series", wanted) if sensors is None else sensors, within)
    for name, share in within.items():
        expected = wanted[name].values
        assert abs(found[name].values - expected)[after:].max() < share * abs(expected).max(), name


def degrees(solution: Solution) -> np.ndarray:
    """Angle of the first drive at the stored times."""
    return np.degrees(next(iter(solution.drive_angles.values())))


def peaks(solution: Solution, sensor: str) -> tuple[Peak, Peak]:
    """Smallest and largest value; of a cycle's two ends, which are the same instant, the first."""
    values = solution.series[sensor].values[:-1]
    return tuple(Peak(values[k], degrees(solution)[k]) for k in (values.argmin(), values.argmax()))


def waving(model: Model, times: np.ndarray, time: float) -> Solution:
    """Every coordinate of the deformation swings by a hundredth [m or rad], each at its own frequency and phase."""
    n = len(model.coordinates)
    rates, phases = np.linspace(1.0, 2.0, n) / time, 2.4 * np.arange(n)
    angle = rates * times[:, None] + phases
    z, v, a = 0.01 * np.sin(angle), 0.01 * rates * np.cos(angle), -0.01 * rates**2 * np.sin(angle)
    return Solution(model, Trajectory(times, z, v, a, Outcome.COMPLETED, "", None, 0.0), 0.0)
