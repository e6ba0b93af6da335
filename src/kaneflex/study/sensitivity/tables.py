"""What ``summary.json`` says of derivatives."""

from __future__ import annotations

from pydantic import Field

from kaneflex.support.plain_table import PlainTable

_BY_PER_CENT = "p dy/dp / y of the {}: per cent by which it grows with one per cent of p; null where it is zero"


class SensorDerivative(PlainTable):
    """Derivatives of a sensor's statistics with respect to a parameter p, in SI."""

    unit: str = Field(description="the sensor's SI unit over the parameter's")
    min: float = Field(description="of the smallest value")
    max: float = Field(description="of the largest value")
    rms: float = Field(description="of the root of the mean square over time")
    mean: float = Field(description="of the mean over time")
    log_min: float | None = Field(description=_BY_PER_CENT.format("smallest value"))
    log_max: float | None = Field(description=_BY_PER_CENT.format("largest value"))
    log_rms: float | None = Field(description=_BY_PER_CENT.format("root of the mean square"))
    log_mean: float | None = Field(description=_BY_PER_CENT.format("mean"))


class ParameterSensitivity(PlainTable):
    """How the sensors answer to a small change of one number of the scene."""

    value: float = Field(description="the parameter's value, SI")
    unit: str = Field(description="its SI unit; 1 for a plain number")
    sensors: dict[str, SensorDerivative] = Field(description="by sensor")
