"""What a choice of a model was made on: the part of ``summary.json`` that says so."""

from __future__ import annotations

from pydantic import Field

from kaneflex.support.plain_table import PlainTable


class Attempt(PlainTable):
    """A model that was weighed, or why it was not."""

    model: str = Field(description="its name, as `kaneflex trade` names it")
    error: float | None = Field(description="largest error of a sensor as a share of its peak; null if it has none")
    worst_sensor: str | None = Field(description="the sensor with that error")
    within: bool = Field(description="whether every sensor is within the tolerance, with the reference's doubt on top")
    priced: bool = Field(description="whether by its price, a correction of another motion, not by a run")
    reason: str = Field(description="why it was not run to the end, or what it stepped over; empty if neither")


class Choice(PlainTable):
    """The cheapest model that keeps a tolerance, and the evidence for it."""

    tolerance: float = Field(description="error allowed of each sensor, as a share of its peak")
    sensors: list[str] = Field(description="those that count")
    model: str = Field(description="the chosen model, as `kaneflex trade` names it")
    settings: list[str] = Field(description="what makes the scene this model, as path=value")
    dropped: list[str] = Field(description="groups of terms that it leaves out beyond its preset")
    errors: dict[str, float] = Field(description="by sensor: largest error as a share of its peak")
    reference: str = Field(description="the finest model, which errors are measured against")
    reference_settings: list[str] = Field(description="what makes the scene the reference, as path=value")
    reference_note: str = Field(description="what is not known of the reference; empty if nothing")
    doubt: dict[str, float] = Field(description="by sensor: how far the reference itself may be off")
    indicators: dict[str, float | None] = Field(
        description="by group of terms: how much the quasi-static displacements change without it, to first order; "
        "dynamics is the answer's own inertia and damping; speed_ratio the fastest drive's speed over the lowest "
        "natural frequency, buckling_ratio the largest axial force over a pin-ended link's buckling load; null where "
        "it can't be said"
    )
    attempts: list[Attempt] = Field(description="models in the order in which they were tried")
    seconds: float = Field(description="wall time of choosing, s")
    remembered: bool = Field(description="whether the choice was read from the user's cache")
