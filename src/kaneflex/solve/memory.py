"""Memory that a run needs at least, estimated before it starts."""

from __future__ import annotations

from kaneflex.integrate.methods import method_named
from kaneflex.mechanism.floating_frames import frame_of, stations
from kaneflex.scene import Scene
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError
from kaneflex.support.machine import gib, installed

MAX_STORED = 40_000
"""Largest number of stored steps of one-way equations; longer runs store every second, third, ... step."""
_NUMBER = 8
"""Bytes of a number."""
_MONODROMY = 44
"""Matrices (n, n) for a periodic motion's stability: 8 lanes, their product and two factors, for states (z, z')."""
_SHAPES = 8
"""Approximate number of shapes of a link under preset coupled by default."""
_ASSEMBLED = (10_000, 100_000)
"""Bytes of the assembled matrices per coordinate, in the plane and in space; measured with rods of 2000 and 8000
elements, and a crankshaft with 60 elements per journal."""


def check_memory(scene: Scene, options: Options, scalars: int) -> None:
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
    dofs = 6 if scene.is_spatial else 3
    elastic = {name: body.beam for name, body in scene.bodies.items() if body.elastic}
    links = {name: dofs * (options.elements or beam.elements) for name, beam in elastic.items()}
    size, coupled = sum(links.values()), options.dynamics == "coupled"
    few = coupled and not isinstance(options.modes, int)  # default shapes of preset coupled
    count = _SHAPES if few else _count(options.modes, size)
    kept = size if options.reduction == "none" and not coupled else min(size, (count + 6) * len(links))
    whole = options.dynamics in ("rigid", "quasistatic") or coupled
    rows = options.steps + 1 if whole else min(options.steps, MAX_STORED) + 1
    row = _NUMBER * (scalars + (0 if options.dynamics == "rigid" else 3 * kept))
    instants = rows * row
    if not whole and options.cycles:
        row = _NUMBER * 2 * scalars * len(method_named(options.integrator).nodes)  # and their products
        instants += options.steps * row
    matrices = 0
    if options.dynamics == "dynamic" and options.start == "periodic":
        matrices = _NUMBER * _MONODROMY * kept**2
    if coupled and not scene.is_spatial:
        floating = (size for name, size in links.items() if frame_of(stations(scene, name)).kind in ("mean", "free"))
        matrices = max(matrices, _NUMBER * 4 * max(floating, default=0) ** 2)
    matrices += size * _ASSEMBLED[scene.is_spatial]
    if instants + matrices <= there:
        return
    needs = f"the run needs {gib(instants + matrices)}, and this machine has {gib(there)}"
    if matrices > instants:
        largest = max(links, key=links.__getitem__)
        cure = "Use fewer elements" + (", reduce them to modes, or start from zero" if not coupled else "")
        raise SceneError(f"bodies.{largest}.beam.elements", links[largest] // dofs, needs, cure)
    raise SceneError("solve.steps", options.steps, needs, f"Use at most {there // (2 * row):,}")


def _count(modes: int | str, size: int) -> int:
    return modes if isinstance(modes, int) else size
