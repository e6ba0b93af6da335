"""Poincare sections: a motion read once a period of a drive, and which instants of a run these are."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from kaneflex.scene import Scene
from kaneflex.scene.quantities import WholeNumber
from kaneflex.scene.table import SceneTable
from kaneflex.support.errors import SceneError, nearest


class Poincare(SceneTable):
    """Every sensor read once a period of a drive: once a cycle, if it has one, else once a turn.

    A run takes `periods` of them, of which the first `discard` are left out, until what the start has left is gone.
    """

    drive: str = Field(description="whose period it is")
    periods: WholeNumber = Field(description="how many a run takes")
    discard: Annotated[int, Field(ge=0)] = Field(default=0, description="how many of them are left out")

    def settings(self, scene: Scene) -> list[str]:
        """What makes a run last that long, with `solve.steps` of the scene in each period.

        Raises
        ------
        SceneError
            For a drive without a period, or no steps.
        """
        if self.discard >= self.periods:
            reason = f"a run takes {self.periods} periods in all"
            raise SceneError("poincare.discard", self.discard, reason, "Leave out fewer, or give more periods")
        duration = self.periods * self.period(scene)
        return [f"solve.duration={duration!r}", f"solve.steps={self.periods * self.steps(scene)}"]

    def period(self, scene: Scene) -> float:
        """Of the drive in a scene [s]."""
        drive = scene.drives.get(self.drive)
        if drive is None:
            raise SceneError("poincare.drive", self.drive, "no drive of that name", nearest(self.drive, scene.drives))
        period = drive.period or (2 * math.pi / abs(drive.speed) if drive.speed else None)
        if period is None or (drive.period is None and scene.slides(self.drive)):
            cure = "Name one with a speed, or give its law a period"
            raise SceneError("poincare.drive", self.drive, "its motion has no period", cure)
        return period

    def steps(self, scene: Scene) -> int:
        """Stored instants of a period."""
        if scene.solve.steps is None:
            raise SceneError("poincare", None, "how many instants of a period are stored is not said",
                             'Give settings = ["solve.steps=200"]')  # fmt: skip
        return scene.solve.steps

    def instants(self, times: int) -> slice:
        """Which of so many stored instants of a run are in the section: the last one ends its last period."""
        each = (times - 1) // self.periods
        return slice((self.discard + 1) * each, None, each)
