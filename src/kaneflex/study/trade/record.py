"""Record of a choice of a model, in ``summary.json``."""

from __future__ import annotations

from pydantic import Field

from kaneflex.support.plain_table import PlainTable


class Attempt(PlainTable):
    """A model that was tried."""

    model: str = Field(description="name, as in `kaneflex trade`")
    error: float | None = Field(description="largest error of a sensor as a share of its peak")
    worst_sensor: str | None = Field(description="sensor with that error")
    within: bool = Field(description="whether error plus uncertainty of the reference are within the tolerance")
    priced: bool = Field(description="whether the error was computed as a price, without a run")
    reason: str = Field(description="why it was not run, or which loads its steps do not resolve")


class Choice(PlainTable):
    """Cheapest model within a tolerance, with errors and reference."""

    tolerance: float = Field(description="error allowed of each sensor, as a share of its peak")
    sensors: list[str] = Field(description="sensors considered")
    model: str = Field(description="chosen model, as in `kaneflex trade`")
    settings: list[str] = Field(description="settings of the chosen model, as path=value")
    dropped: list[str] = Field(description="groups of terms left out beyond the preset")
    errors: dict[str, float] = Field(description="by sensor: largest error as a share of its peak")
    reference: str = Field(description="finest model, to which errors refer")
    reference_settings: list[str] = Field(description="its settings, as path=value")
    reference_note: str = Field(description="limits of the reference")
    doubt: dict[str, float] = Field(description="by sensor: uncertainty of the reference")
    indicators: dict[str, float | None] = Field(
        description="by group of terms: change of the quasi-static displacements without it, to first order; "
        "speed_ratio: fastest drive speed over lowest natural frequency; buckling_ratio: largest axial "
        "force over buckling load; null if unknown"
    )
    attempts: list[Attempt] = Field(description="models in the order of trial")
    seconds: float = Field(description="wall time of the choice, s")
    remembered: bool = Field(description="whether the choice was cached")
