"""Poincare sections: sensors sampled once per period of a drive."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from kaneflex.scene import Scene
from kaneflex.scene.quantities import WholeNumber
from kaneflex.scene.table import SceneTable
from kaneflex.support.errors import SceneError, nearest


class Poincare(SceneTable):
    """Sensors sampled once per period of a drive: its law's period, else one turn.

    A run lasts `periods` periods; the first `discard` are left out as transient.
    """

    drive: str = Field(description="drive whose period is used")
    periods: WholeNumber = Field(description="periods of a run")
    discard: Annotated[int, Field(ge=0)] = Field(default=0, description="periods left out at the start")

    def settings(self, scene: Scene) -> list[str]:
        """Settings of the run's duration and of its steps, `solve.steps` of the scene per period.

        Raises
        ------
        SceneError
            If the drive has no period, or steps are not given.
        """
        if self.discard >= self.periods:
            reason = f"a run has only {self.periods} periods"
            raise SceneError("poincare.discard", self.discard, reason, "Discard fewer, or increase periods")
        duration = self.periods * self.period(scene)
        return [f"solve.duration={duration!r}", f"solve.steps={self.periods * self.steps(scene)}"]

    def period(self, scene: Scene) -> float:
        """Period of the drive [s]."""
        drive = scene.drives.get(self.drive)
        if drive is None:
            raise SceneError("poincare.drive", self.drive, "no drive of that name", nearest(self.drive, scene.drives))
        period = drive.period or (2 * math.pi / abs(drive.speed) if drive.speed else None)
        if period is None or (drive.period is None and scene.slides(self.drive)):
            cure = "Choose a drive with a speed, or give its law a period"
            raise SceneError("poincare.drive", self.drive, "its motion has no period", cure)
        return period

    def steps(self, scene: Scene) -> int:
        """Stored instants per period."""
        if scene.solve.steps is None:
            raise SceneError("poincare", None, "the number of stored instants per period is not given",
                             'Give settings = ["solve.steps=200"]')  # fmt: skip
        return scene.solve.steps

    def instants(self, times: int) -> slice:
        """Slice of a run's ``times`` stored instants that form the section; each ends a period."""
        each = (times - 1) // self.periods
        return slice((self.discard + 1) * each, None, each)
