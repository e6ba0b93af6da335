"""The moving mechanism for ParaView: a VTK file of each frame by meshio (extra ``vtk``), and a PVD file of times."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.plots.mechanism import used_points
from kaneflex.plots.outlines import ALONG_LINK
from kaneflex.plots.view import FRAMES, View, frames_of, view
from kaneflex.support.errors import installed, naming
from kaneflex.support.escaping import visible

if TYPE_CHECKING:
    from kaneflex.response.motion import Motion
    from kaneflex.scene import Scene
    from kaneflex.scene.quantities import Vector
    from kaneflex.solve.solution import Solution

INDEX = "motion.pvd"


def demand_meshio() -> None:
    """Raise SceneError where meshio is not installed."""
    with naming("--vtk", None), installed("meshio", "vtk", "meshio", instead="leave it out"):
        import meshio  # noqa: F401


def write_vtk(solution: Solution, folder: Path, frames: int | None = None) -> Path:
    """Write instants that the animation shows as ``motion_0000.vtu`` and on, and ``motion.pvd``, which has their times.

    Bodies are lines through their points, or points, with the cell data ``body``: their numbers from 0, in the scene's
    order. Elastic links are lines along their deformed axes. Point data are ``velocity`` [m/s] and ``acceleration``
    [m/s^2], global, and ``displacement`` [m] from the rigid mechanism, which is in the points already.

    Parameters
    ----------
    solution : Solution
    folder : Path
        Made where it does not exist.
    frames : int, optional
        How many instants of those that :func:`kaneflex.plots.view.view` shows; by default as many as animations have.

    Returns
    -------
    Path
        The PVD file: ParaView opens all of it.

    Raises
    ------
    SceneError
        Without meshio.
    """
    demand_meshio()
    import meshio

    shown = frames_of(view(solution), frames or FRAMES)
    scene, motion = solution.model.scene, shown.motion
    points = list[np.ndarray]()
    cells, of_body = list[tuple[int, ...]](), list[int]()
    for number, name in enumerate(scene.bodies):
        places, pairs = _lines(scene, name)
        first = len(points)
        points += [_moving(motion, name, at) for at in places]
        cells += [(first + a, first + b) for a, b in pairs] if pairs else [(first,)]
        of_body += [number] * max(1, len(pairs))
    moving = np.array(points).transpose(3, 1, 0, 2)  # instant, which of the four, point, component
    folder.mkdir(parents=True, exist_ok=True)
    width = max(4, len(str(len(moving) - 1)))
    names = [f"motion_{k:0{width}d}.vtu" for k in range(len(moving))]
    blocks, numbers = _blocks(cells, of_body)
    for name, (place, displacement, velocity, acceleration) in zip(names, moving, strict=True):
        data = {"displacement": displacement, "velocity": velocity, "acceleration": acceleration}
        meshio.Mesh(place, blocks, point_data=data, cell_data={"body": numbers}).write(folder / name)
    index = folder / INDEX
    text = "\n".join(_index(scene.bodies, shown, names)) + "\n"
    index.write_text(text, encoding="utf-8", newline="\n")
    return index


def _lines(scene: Scene, body: str) -> tuple[list[Vector], list[tuple[int, int]]]:
    """Points of a body in its axes, and which of them lines connect: as it is drawn."""
    if scene.bodies[body].elastic:
        end = scene.vector(scene.bodies[body].points_all["end"])
        shares = np.linspace(0.0, 1.0, ALONG_LINK).tolist()
        return [tuple(share * x for x in end) for share in shares], [(k, k + 1) for k in range(ALONG_LINK - 1)]
    points = used_points(scene, body)
    return points, [(0, k) for k in range(1, len(points))]


def _moving(motion: Motion, body: str, at: Vector) -> np.ndarray:
    """Place of a point, its displacement, velocity and acceleration, all global, (4, 3, n_times)."""
    dimensions = len(at)
    d = motion.rigid.frame(body).to_global(motion.displacement(body, at)[0][:dimensions])
    found = [motion.place(body, at), d, *(motion.rate(body, at, order)[0] for order in (1, 2))]
    return np.array([np.vstack([part, np.zeros((3 - dimensions, part.shape[1]))]) for part in found])


def _blocks(cells: list[tuple[int, ...]], of_body: list[int]) -> tuple[list[tuple[str, np.ndarray]], list[np.ndarray]]:
    """Lines and points apart, as meshio has them, and the body of each."""
    blocks, numbers = [], []
    for kind, size in (("line", 2), ("vertex", 1)):
        chosen = [k for k, cell in enumerate(cells) if len(cell) == size]
        if chosen:
            blocks.append((kind, np.array([cells[k] for k in chosen])))
            numbers.append(np.array([of_body[k] for k in chosen]))
    return blocks, numbers


def _index(bodies: Iterable[str], shown: View, files: list[str]) -> Iterator[str]:
    yield '<?xml version="1.0"?>'
    if shown.note:
        yield xml_comment(f"frames:{shown.note}")
    yield xml_comment(f"body: {', '.join(f'{number} {name}' for number, name in enumerate(bodies))}")
    yield '<VTKFile type="Collection" version="0.1">'
    yield "  <Collection>"
    for t, file in zip(shown.times.tolist(), files, strict=True):
        yield f'    <DataSet timestep="{t!r}" part="0" file="{file}"/>'
    yield "  </Collection>"
    yield "</VTKFile>"


def xml_comment(text: str) -> str:
    """XML comment, without adjacent hyphens (XML 1.0, production 15)."""
    return f"<!-- {re.sub('-(?=-)', '- ', visible(text))} -->"
