"""Part of a solution that is drawn: instants and abscissa."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.plots.style import Panel, finish, mark_angles, pages, readable
from kaneflex.response.motion import Motion
from kaneflex.response.time_statistics import MISSED, frames, missed
from kaneflex.solve.run_result import peak_at

if TYPE_CHECKING:
    from kaneflex.multibody.unilateral.results import Impact
    from kaneflex.solve.solution import Solution

FRAMES = 60
"""Instants of an animation."""
_MOST_TURNS = 8
"""Longer runs are drawn by their last ``_TURNS_SHOWN`` turns."""
_TURNS_SHOWN = 3


@dataclass(frozen=True, eq=False)
class View:
    """Some instants of a solution.

    Attributes
    ----------
    solution : Solution
    instants : ndarray of int
        Indices into ``solution.times``.
    turns : float or None
        Turns of the drive that are shown, where that is not the whole run.
    thinned : str
        What the chosen instants leave out.
    """

    solution: Solution
    instants: np.ndarray
    turns: float | None = None
    thinned: str = ""

    @cached_property
    def times(self) -> np.ndarray:
        """Instants [s], (n_times,)."""
        return self.solution.times[self.instants]

    @cached_property
    def motion(self) -> Motion:
        """The motion at the instants."""
        return self.solution.motion.taken(self.instants)

    @property
    def rigid(self) -> RigidMotion:
        """The rigid motion at the instants."""
        return self.motion.rigid

    @property
    def lengths(self) -> dict[str, float]:
        """Length of every elastic link [m]."""
        return {name: link.length for name, link in self.solution.model.links.items()}

    def displaced(self, link: str, places: Iterable[float]) -> np.ndarray:
        """Displacements of points of a link's axis at distances [m] from its start, in its axes, (n_places, 2 or 3,
        n_times)."""
        points = [self.solution.model.scene.vector((float(x), 0.0)) for x in places]
        return np.array([self.motion.displacement(link, at)[0][: len(at)] for at in points])

    @cached_property
    def x(self) -> np.ndarray:
        """Abscissa: the angle [deg] of the drive with the cycle, else the time in ``time_unit``."""
        return np.degrees(self.rigid[f"{self.drive}.angle"]) if self.drive else self._time[0] * self.times

    @property
    def x_label(self) -> str:
        return f"angle of {self.drive} [deg]" if self.drive else f"time [{self._time[1]}]"

    @cached_property
    def drive(self) -> str | None:
        """The drive whose angle is the abscissa: the one with the cycle that the run covers, where it turns one way."""
        scene = self.solution.model.scene
        if not self.solution.model.options.cycles:
            return None
        return next((name for name, drive in scene.drives.items()
                     if drive.period and not scene.slides(name) and self._turns_one_way(name)), None)  # fmt: skip

    def _turns_one_way(self, drive: str) -> bool:
        steps = np.diff(self.rigid[f"{drive}.angle"])
        return bool((steps > 0.0).all() or (steps < 0.0).all())

    @cached_property
    def _time(self) -> tuple[float, str]:
        return readable("s", self.times)

    @property
    def note(self) -> str:
        """Addition to the title where the picture does not show the whole run."""
        last = "" if self.turns is None else f"last {self.turns:g} turns"
        parts = [part for part in (last, self.thinned) if part]
        return f" ({'; '.join(parts)})" if parts else ""

    def impacts(self, contact: str) -> list[Impact]:
        """Impacts of a contact that begin in the time that is shown."""
        first, last = self.times[0], self.times[-1]
        return [each for each in self.solution.impacts if each.contact == contact and first <= each.begin <= last]

    def peaks(self, contact: str) -> tuple[np.ndarray, np.ndarray]:
        """Abscissae of the largest stored forces of the impacts of a contact, and their peaks [N], or torques [N m]."""
        own, force = self.impacts(contact), self.motion.contact(contact)[1]
        at = [np.fmin(max(each.begin, self.times[peak_at(each, self.times, force)]), each.end) for each in own]
        return np.interp(at, self.times, self.x), np.array([each.peak for each in own])

    def page(
        self, panels: Sequence[Panel], heading: str, width: float, height: float,
        mark: Callable[[Axes, Panel], None] | None = None,
    ) -> Figure:  # fmt: skip
        """Panels of that size [inches] over one abscissa; ``mark`` adds to each after its curves."""
        figure, grid = pages(len(panels), f"{heading}{self.note}", width, height)
        for axes, panel in zip(grid, panels, strict=True):
            panel.plot(axes, self.x)
            if mark is not None:
                mark(axes, panel)
        self.finish(grid)
        return figure

    def finish(self, panels: list[Axes]) -> None:
        """Name the abscissa of a page's panels and give them their margins."""
        for axes in finish(panels, self.x_label):
            self.label_x(axes)

    def label_x(self, axes: Axes) -> None:
        """Name the abscissa and put its ticks at round angles."""
        axes.set_xlabel(self.x_label)
        if self.drive:
            mark_angles(axes, float(np.ptp(self.x)))


def view(solution: Solution) -> View:
    """The instants to draw: all, or the last turns of a long run.

    Writing a picture merges points of a line that are closer than a ninth of a pixel (matplotlib's ``path.simplify``).
    """
    instants = np.arange(len(solution.times))
    speed = max((abs(drive.speed or 0.0) for drive in solution.model.scene.drives.values()), default=0.0)
    turns = speed * float(np.ptp(solution.times)) / (2 * math.pi)
    shown = None
    if turns > _MOST_TURNS and not solution.model.options.cycles:
        shown = float(_TURNS_SHOWN)
        first = solution.times[instants[-1]] - _TURNS_SHOWN * 2 * math.pi / speed
        instants = instants[solution.times[instants] >= first]
    return View(solution, instants, shown)


def frames_of(shown: View, count: int) -> View:
    """Evenly spaced instants of a film, as many or all; ``note`` says where something moves too fast for these."""
    scene, cycles = shown.solution.model.scene, shown.solution.model.options.cycles
    still = scene.vector((0.0, 0.0))
    points = {name: {still, *map(scene.vector, body.points_all.values())} for name, body in scene.bodies.items()}
    places = [_widest([shown.rigid.frame(name).place(at) for at in own]) for name, own in points.items()]
    moved = [_widest(shown.displaced(name, link.nodes)) for name, link in shown.solution.model.links.items()]
    picked = frames(np.array(moved or places), count, cycles)
    hasty = missed(np.array(moved + places), picked).max() > MISSED
    note = f"{len(picked)} of {len(shown.instants)} instants, some motion is too fast for them" if hasty else ""
    return replace(shown, instants=shown.instants[picked], thinned=note)


def _widest(vectors: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """The component that varies most of some vectors over time, each (components, n_times)."""
    components = np.vstack(vectors)
    return components[np.ptp(components, axis=1).argmax()]
