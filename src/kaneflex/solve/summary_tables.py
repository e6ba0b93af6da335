"""Tables of ``summary.json`` that few runs have; those of every run are in report."""

from __future__ import annotations

from pydantic import Field

from kaneflex.scene.table import PlainTable

_RELATIVE = "of the {}, relative"


class EnergyBalance(PlainTable):
    """Energies exchanged during the run, J; unless the preset is coupled, those of the rigid mechanism."""

    stored: float = Field(description="increase of kinetic, strain and potential energy")
    dissipated: float = Field(description="energy dissipated by damping, in contacts and by friction")
    supplied: float = Field(description="energy supplied by loads and prescribed drives")
    gap: float = Field(description="largest absolute value of stored + dissipated - supplied")
    drift: float = Field(description="gap relative to the largest exchanged energy")


class PeakSpread(PlainTable):
    """Range of a sensor's peak, in SI, if matrices are frozen at other drive angles."""

    smallest: float = Field(description="smallest peak")
    largest: float = Field(description="largest peak")


class UnresolvedMode(PlainTable):
    """Mode of the reference configuration that the steps of a coupled run do not resolve.

    Error-controlled steps skip only vibrations below the tolerance; such a mode carries its static share of forces.
    """

    frequency_hz: float = Field(description="natural frequency, Hz")
    shape: str = Field(description="main motion: stretch or bending of a link")
    steps_per_period: float = Field(description="mean steps per period, below 3")


class FrictionSummary(PlainTable):
    """Friction forces and losses of a joint or contact over the run."""

    lost: float = Field(description="energy lost, J")
    largest_force: float | None = Field(description="largest stored friction force, N")
    largest_torque: float | None = Field(description="in a pin: largest stored friction torque, N m")
    stuck: float = Field(description="share of the stored instants at which the part sticks")
    jams_at_s: float | None = Field(description="time at which a contact first jams (Painlevé's paradox), s")
    worn: float | None = Field(description="volume worn off, m³")


class ContactSummary(PlainTable):
    """Impacts and forces of a contact over the run."""

    impacts: int = Field(description="number of impacts")
    fastest_m_s: float | None = Field(description="largest approach speed, m/s")
    largest_force: float | None = Field(description="largest normal force, N")
    fastest_rad_s: float | None = Field(description="backlash: largest approach speed, rad/s")
    largest_torque: float | None = Field(description="backlash: largest torque, N m")
    lost: float = Field(description="energy lost, J")
    rests_since_s: float | None = Field(description="time from which the contact stays closed until the end, s")


class Attempt(PlainTable):
    """A model that was tried."""

    model: str = Field(description="name of the model, as in `kaneflex trade`")
    error: float | None = Field(description="largest error of a sensor as a share of its peak")
    worst_sensor: str | None = Field(description="sensor with the largest error")
    within: bool = Field(description="whether error plus doubt are within the tolerance")
    reason: str = Field(description="reason why the model was not run, or loads that its steps do not resolve")


class Choice(PlainTable):
    """Fastest model within a tolerance, with its errors and the reference."""

    tolerance: float = Field(description="allowed error of each sensor, as a share of its peak")
    sensors: list[str] = Field(description="sensors considered")
    model: str = Field(description="name of the chosen model, as in `kaneflex trade`")
    settings: list[str] = Field(description="settings of the chosen model, as path=value")
    dropped: list[str] = Field(description="groups of terms that the preset contains but the choice leaves out")
    errors: dict[str, float] = Field(description="largest error of each sensor, as a share of its peak")
    open: dict[str, float] = Field(description="errors of sensors that no model brings within the tolerance")
    reference: str = Field(description="reference to which the errors refer: the finest model")
    reference_settings: list[str] = Field(description="settings of the reference, as path=value")
    reference_note: str = Field(description="limits of the reference")
    doubt: dict[str, float] = Field(description="uncertainty of the reference for each sensor, as a share of its peak")
    attempts: list[Attempt] = Field(description="tried models, in the order of the trials")
    run_s: float = Field(description="processor time of the chosen model's first run, s")
    richest_s: float = Field(description="processor time of the first run of the richest model, s")
    compared: bool = Field(description="whether cheaper models than the richest were tried")
    seconds: float = Field(description="processor time of the choice, s")
    remembered: bool = Field(description="whether the choice was read from the cache")


class SensorDerivative(PlainTable):
    """Derivatives dy/dp of a sensor's statistics y by a parameter p; relative (p/y) dy/dp, null if y is rounding."""

    unit: str = Field(description="SI unit of the sensor divided by that of the parameter")
    min: float = Field(description="derivative of the smallest value")
    max: float = Field(description="derivative of the largest value")
    rms: float = Field(description="derivative of the rms over time")
    mean: float = Field(description="derivative of the mean over time")
    log_min: float | None = Field(description=_RELATIVE.format("smallest value"))
    log_max: float | None = Field(description=_RELATIVE.format("largest value"))
    log_rms: float | None = Field(description=_RELATIVE.format("rms"))
    log_mean: float | None = Field(description=_RELATIVE.format("mean"))


class ParameterSensitivity(PlainTable):
    """Derivatives of all sensors with respect to one number of the scene."""

    value: float = Field(description="value of the parameter, SI")
    unit: str = Field(description="SI unit of the parameter; 1 for a plain number")
    sensors: dict[str, SensorDerivative] = Field(description="derivatives of each sensor")
