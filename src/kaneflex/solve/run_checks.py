"""Checks before a run: of laws, tables and springs along the rigid motion, and of the memory that the run needs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.mechanism.closure import SWEEP
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.scene.options import Options
from kaneflex.scene.quantities import Vector
from kaneflex.scene.scene import Scene
from kaneflex.support.errors import SceneError
from kaneflex.support.machine import gib, installed

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model

_MEETING = 1e-3
"""Share of a spring's greatest length below which its direction is undefined."""
UNREPEATED = "{} is {:.6g} at an instant and {:.6g} a cycle later"
"""Reason why a motion or load is not periodic."""
INSTANTS = np.sort(np.arange(1, 17) * 0.5 * (math.sqrt(5.0) - 1.0) % 1.0)
"""Instants of a cycle, as shares of it, at which it is compared with the next one; unequal distances find more."""
_MOST = 20_000
"""Largest number of instants at which laws are checked before the computation."""
MAX_STORED = 40_000
"""Largest number of stored steps of one-way equations; longer runs store every second, third, ... step."""
_NUMBER = 8
"""Bytes of a number."""
_MONODROMY = 44
"""Matrices (n, n) for a periodic motion's stability: a step's equations, complex, and matrices that move (z, z')."""
_SHAPES = 8
"""Approximate number of shapes of a link under preset coupled by default."""
_ASSEMBLED = (10_000, 100_000)
"""Bytes of the assembled matrices per coordinate, in the plane and in space; measured with rods of 2000 and 8000
elements, and a crankshaft with 60 elements per journal."""


def check_laws(model: Model) -> None:
    """Raise SceneError, which names the entry and the time, unless springs have directions and laws are finite over a
    run; the model needs no equations."""
    if model.scene.springs:  # where free joints are known only after the run, just at the start
        known = 0.0 if _moves_freely(model) and model.coupled_in_space is None else model.options.duration
        rigid = model.motion.at(model.motion.begin + np.linspace(0.0, known, SWEEP + 1))
        check_directions(model.scene, rigid.times, lambda body, at: rigid.frame(body).place(at))
    _check_finite(model)


def _check_finite(model: Model) -> None:
    """Raise SceneError unless loads and prescribed motions are finite at every step."""
    scene, motion, options = model.scene, model.motion, model.options
    times = motion.begin + np.linspace(0.0, options.duration, min(options.steps, _MOST) + 1)
    free_bodies, rigid = _moves_freely(model), motion.at(times)
    known = [name for name in motion.column if not free_bodies or name in scene.loads or name.endswith(".angle")]
    laws = {name: scene.argument(name) for name in scene.loads} if scene.observed else {}
    elsewhere = {name for name, law in laws.items() if law is not None and law.uses_any(scene.observed)}
    elsewhere |= set(getattr(motion.module, "open_reactions", ()))  # statically indeterminate
    known = [name for name in known if name not in elsewhere]  # known only after the motion is computed
    whole = len(known) == len(motion.column)  # else positions are not needed
    if np.isfinite(rigid.values).all() if whole else all(np.isfinite(rigid[name]).all() for name in known):
        _check_poles(model, rigid, known)
        return
    from kaneflex.scene.law_check import FINITE

    for name in sorted(known, key=lambda name: name not in scene.loads):
        lost = ~np.isfinite(rigid[name])
        if not lost.any():
            continue
        t = times[int(np.argmax(lost))]
        if name in scene.loads:
            key, thing, given = f"loads.{name}", "it", scene.loads[name].law
        else:
            drive = min(scene.drives, key=lambda drive: scene.drives[drive].law is None)
            key, thing, given = f"drives.{drive}", "the motion or a derivative of it", scene.drives[drive].law
        raise SceneError(key, given, f"{thing} has no finite value at t = {t:.6g} s", FINITE)


def _check_poles(model: Model, rigid: RigidMotion, known: Sequence[str]) -> None:
    """Raise SceneError if a load's law has a pole between two samples; those of drives are checked with the scene."""
    loads = model.scene.loads
    for name in sorted(name for name in loads.keys() & set(known) if loads[name].law is not None):
        from kaneflex.scene.law_check import FINITE, pole

        def sizes(at: np.ndarray, of: str = name) -> np.ndarray:
            return rigid.motion.at(at)[of]

        if (t := pole(sizes, rigid.times)) is not None:
            law = loads[name].law
            raise SceneError(f"loads.{name}.law", law, f"it grows without bound at t = {t:.6g} s", FINITE)


def refuse_unrepeated(reason: str | None) -> None:
    """Raise SceneError with the reason, if any, for which a periodic start is impossible."""
    if reason is not None:
        raise SceneError(
            "solve.start", "periodic", reason,
            "Make every drive, law, table and spring periodic with the cycle, or start from zero or quasistatic",
        )  # fmt: skip


def _moves_freely(model: Model) -> bool:
    """True under preset coupled with free joints or bodies: the motion in the plane is known only after the run."""
    return model.options.dynamics == "coupled" and bool(model.scene.floating or model.scene.free_joints)


def check_directions(
    scene: Scene, times: np.ndarray, place: Callable[[str, Vector], np.ndarray], damped: bool = True
) -> None:
    """Raise SceneError if the ends of a spring with free length or, if ``damped``, damper meet: its direction is
    undefined there.

    ``place``: function that gives the positions of a body's point at ``times`` [s], (D, n_times).
    """
    from kaneflex.mechanism.springs import points_meet

    directed = {name: s for name, s in scene.springs.items() if s.between and (s.length or (damped and s.damping))}
    for name, spring in directed.items():
        start, end = (place(address.body, scene.point(address)) for address in spring.between)
        d = end - start
        step = np.diff(d)
        # the closest approach may lie between two samples, on the straight line between them
        share = np.clip(-(d[:, :-1] * step).sum(0) / np.maximum((step**2).sum(0), 1e-300), 0.0, 1.0)
        nearest = np.linalg.norm(d[:, :-1] + share * step, axis=0)
        if (nearest > _MEETING * np.linalg.norm(d, axis=0).max()).all():
            continue
        raise points_meet(name, spring.between, f" at t = {times[np.argmin(nearest)]:.6g} s")


def check_memory(mechanism: Any, options: Options, scalars: int) -> None:
    """Raise SceneError if a run's tables and dense matrices exceed the machine's memory.

    ``scalars``: numbers of the rigid motion at an instant. Counted are the tables of the stored instants; that of the
    motion over a cycle, if repeated; the states of a cycle from all unit states, for a periodic start; the assembled
    matrices; and full matrices of planar links in mean axes, whose stiffness is singular.

    Raises
    ------
    SceneError
        Names the memory needed, the memory available, and a fix.
    """
    there = installed()
    if there is None:
        return
    d = mechanism.d
    elastic = {name: body.beam for name, body in mechanism.deforming.items() if body.elastic}
    links = {name: d * (options.elements or beam.elements) for name, beam in elastic.items()}
    size, coupled = sum(links.values()), options.dynamics == "coupled"
    count = options.modes if isinstance(options.modes, int) else _SHAPES if coupled else size
    kept = size if options.reduction == "none" and not coupled else min(size, (count + 6) * len(links))
    whole = options.dynamics in ("rigid", "quasistatic") or coupled
    rows = options.steps + 1 if whole else min(options.steps, MAX_STORED) + 1
    row = _NUMBER * (scalars + (0 if options.dynamics == "rigid" else 3 * kept))
    instants = rows * row
    if not whole and options.cycles:
        nodes = 1
        if options.integrator != "spectral":
            from kaneflex.integrate.methods import method_named

            nodes = len(method_named(options.integrator).nodes)
        row = _NUMBER * 2 * scalars * nodes  # and their products
        instants += options.steps * row
    matrices = 0
    if options.dynamics == "dynamic" and options.start == "periodic":
        matrices = _NUMBER * _MONODROMY * kept**2
    if coupled and d == 3:
        from kaneflex.mechanism.floating_frames import frame_of, stations

        floating = [links[name] for name in links if frame_of(stations(mechanism, name)).kind in ("mean", "free")]
        matrices = max(matrices, _NUMBER * 4 * max(floating, default=0) ** 2)
    matrices += size * _ASSEMBLED[d == 6]
    if instants + matrices <= there:
        return
    needs = f"the run needs {gib(instants + matrices)}, and this machine has {gib(there)}"
    if matrices > instants:
        largest = max(links, key=links.__getitem__)
        cure = "Use fewer elements" + (", reduce them to modes, or start from zero" if not coupled else "")
        raise SceneError(f"bodies.{largest}.beam.elements", links[largest] // d, needs, cure)
    raise SceneError("solve.steps", options.steps, needs, f"Use at most {there // (2 * row):,}")
