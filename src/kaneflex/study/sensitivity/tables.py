"""Tables of derivatives in ``summary.json``."""

from __future__ import annotations

from pydantic import Field

from kaneflex.support.plain_table import PlainTable

_RELATIVE = "(p/y) dy/dp of the {}; null if that is zero"


class SensorDerivative(PlainTable):
    """Derivatives of a sensor's statistics with respect to a parameter p, in SI."""

    unit: str = Field(description="the sensor's SI unit over the parameter's")
    min: float = Field(description="derivative of the smallest value")
    max: float = Field(description="of the largest value")
    rms: float = Field(description="of the rms over time")
    mean: float = Field(description="of the mean over time")
    log_min: float | None = Field(description=_RELATIVE.format("smallest value"))
    log_max: float | None = Field(description=_RELATIVE.format("largest value"))
    log_rms: float | None = Field(description=_RELATIVE.format("rms"))
    log_mean: float | None = Field(description=_RELATIVE.format("mean"))


class ParameterSensitivity(PlainTable):
    """Derivatives of all sensors with respect to one number of the scene."""

    value: float = Field(description="the parameter's value, SI")
    unit: str = Field(description="its SI unit; 1 for a plain number")
    sensors: dict[str, SensorDerivative] = Field(description="by sensor")
