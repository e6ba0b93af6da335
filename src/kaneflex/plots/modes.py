"""The lowest mode shapes drawn on the mechanism at the reference angle; paper Figs. 11-16."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from kaneflex.multibody.model.building import has_modes, reference_modes
from kaneflex.plots.drawing import draw_outline, draw_scenery, frame_axes, small_drawings
from kaneflex.plots.mechanism import deformed_lines, outline, rigid_outline, rigid_scenery, scenery
from kaneflex.plots.outlines import Outline, Scenery
from kaneflex.plots.style import GREY, PALETTE, shade, wrapped
from kaneflex.response.elastic_motion import ElasticMotion

if TYPE_CHECKING:
    from kaneflex.mechanism.rigid_motion import RigidMotion
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.solve.solution import Solution

MOST = 6
DRAWN = 0.09
"""Largest displacement of a drawn mode, in sizes of the mechanism."""
SMALL = 1e-9
"""Largest displacement at which shapes are evaluated, in sizes: the foreshortening, of second order, vanishes."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``modes``: up to six, each at the largest positive and negative deflection, frequency in the title."""
    model = solution.model
    if model.frame is None or not has_modes(model):
        return {}
    count = min(MOST, model.equations.size)
    omega, shapes = reference_modes(model, count)
    rigid = model.motion.at(np.full(count, model.reference_time))
    fixed = scenery(solution) if len(solution.times) else rigid_scenery(model.scene, rigid)
    still = rigid_outline(model.scene, rigid, fixed)
    positive = _deflected(model, rigid, fixed, shapes, still)
    negative = still.combined(lambda at, moved: 2.0 * at - moved, positive)
    figure, panels = small_drawings(count, [still, positive, negative], fixed)
    figure.suptitle(_title(solution, figure.get_figwidth()))
    for k, axes in enumerate(panels):
        frame_axes(axes, [still, positive, negative], fixed, swept=False)
        draw_scenery(axes, fixed, still)
        draw_outline(axes, still, k, ghost=True)
        draw_outline(axes, negative, k, shade(PALETTE[5], 0.3), links_only=True)
        draw_outline(axes, positive, k)
        axes.set_title(f"Mode {k + 1}: {hertz(omega[k])}")
        if fixed.flat:
            axes.label_outer()
    figure.legend(handles=_handles(), loc="outside lower center", ncols=3)
    return {"modes": figure}


def _deflected(model: Model, rigid: RigidMotion, fixed: Scenery, shapes: np.ndarray, still: Outline) -> Outline:
    """One mode at each instant, enlarged to the same largest displacement.

    Links of a few modes bend by their loads, too; this stays as large however small the shapes are, and is left out.
    """
    none = np.zeros_like(shapes)
    small = shapes * (SMALL * fixed.size / np.abs(shapes).max(axis=0))
    moved, loaded = (ElasticMotion(model, rigid, (each, none, none)) for each in (small, none))
    drawn, bent = (outline(each, fixed, 1.0 / SMALL) for each in (moved, loaded))
    lines, others = (deformed_lines(each, 1.0 / SMALL) for each in (moved, loaded))
    largest = [np.linalg.norm(lines[name] - others[name], axis=1).max(axis=0) for name in lines]
    away = DRAWN * fixed.size / np.max(largest, axis=0)

    def shifted(at: np.ndarray, mode: np.ndarray, load: np.ndarray) -> np.ndarray:
        return at + away.reshape((-1,) + (1,) * (at.ndim - 1)) * (mode - load)

    return still.combined(shifted, drawn, bent)


def _title(solution: Solution, width: float) -> str:
    """Title with the configuration of the modes, in lines that a figure of that width [inches] holds."""
    at = solution.model.reference_position
    return wrapped(f"Mode shapes{' at ' if at else ''}{at}, undamped", width)


def hertz(omega: float) -> str:
    """A frequency to five digits."""
    value = omega / (2 * math.pi)
    return f"{value:.{max(0, 4 - math.floor(math.log10(value)))}f} Hz" if value > 1e-3 else "0 Hz"


def _handles() -> list[Line2D]:
    return [
        Line2D([], [], color=PALETTE[0], linewidth=2.4, label="mode shape"),
        Line2D([], [], color=shade(PALETTE[5], 0.3), linewidth=1.4, label="half a period later"),
        Line2D([], [], color=GREY, linewidth=0.9, label="undeformed"),
    ]
