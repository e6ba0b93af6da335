"""The memory that a run needs at least, known before it starts."""

from __future__ import annotations

from kaneflex.integrate.methods import method_named
from kaneflex.mechanism.floating_frames import frame_of, stations
from kaneflex.scene import Scene
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError
from kaneflex.support.machine import gib, installed

MAX_STORED = 40_000
"""Steps stored at most of equations that are integrated one way; longer runs keep every second, third, ... step."""
_NUMBER = 8
"""Bytes."""
_MONODROMY = 44
"""Matrices (n, n) that the periodic motion's stability takes: 8 lanes, the product of them and two factors, of states
(z, z') each."""
_SHAPES = 8
"""Shapes of a link that preset coupled takes unless told otherwise, about."""
_ASSEMBLED = (10_000, 100_000)
"""Bytes of the assembled matrices for each coordinate, in the plane and in space, where more scalars are before them:
measured with rods of 2000 and 8000 elements, and a crankshaft of 60 a journal."""


def check_memory(scene: Scene, options: Options, scalars: int) -> None:
    """Refuse a run whose tables and dense matrices are larger than the machine's memory.

    ``scalars`` is how many numbers the rigid motion has at an instant. Counted is what can't be done without: the
    tables of the stored instants; that of the motion over a whole cycle, where each cycle reads it again; the states of
    a cycle from every unit state, with which a periodic start is found; the assembled matrices, and full ones of a
    planar link whose axes go along in the mean, as its stiffness is singular.

    Raises
    ------
    SceneError
        It names what is needed, what there is, and what to ask for instead.
    """
    there = installed()
    if there is None:
        return
    dofs = 6 if scene.is_spatial else 3
    elastic = {name: body.beam for name, body in scene.bodies.items() if body.elastic}
    links = {name: dofs * (options.elements or beam.elements) for name, beam in elastic.items()}
    size, coupled = sum(links.values()), options.dynamics == "coupled"
    few = coupled and not isinstance(options.modes, int)  # coupled's own choice of shapes
    count = _SHAPES if few else _count(options.modes, size)
    kept = size if options.reduction == "none" and not coupled else min(size, (count + 6) * len(links))
    whole = options.dynamics in ("rigid", "quasistatic") or coupled
    rows = options.steps + 1 if whole else min(options.steps, MAX_STORED) + 1
    row = _NUMBER * (scalars + (0 if options.dynamics == "rigid" else 3 * kept))
    instants = rows * row
    if not whole and options.cycles:
        row = _NUMBER * 2 * scalars * len(method_named(options.integrator).nodes)  # and as many products of them
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
        cure = "Take fewer elements" + (", keep some modes of them, or start from zero" if not coupled else "")
        raise SceneError(f"bodies.{largest}.beam.elements", links[largest] // dofs, needs, cure)
    raise SceneError("solve.steps", options.steps, needs, f"Ask for {there // (2 * row):,} at most")


def _count(modes: int | str, size: int) -> int:
    return modes if isinstance(modes, int) else size
