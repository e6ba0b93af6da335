"""The summary of a run: what ``summary.json`` holds.

``python -m kaneflex.report.summary`` prints ``docs/data/summary.schema.json``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from kaneflex.scene.table import PlainTable, late
from kaneflex.solve.run_result import MOST_FREQUENCIES
from kaneflex.support.escaping import visible

if TYPE_CHECKING:
    from kaneflex.response.sensors import Series
    from kaneflex.response.time_statistics import Statistics
    from kaneflex.solve.error_estimates import ErrorEstimate
    from kaneflex.solve.solution import Solution
    from kaneflex.solve.summary_tables import (
        Choice,
        ContactSummary,
        EnergyBalance,
        FrictionSummary,
        ParameterSensitivity,
        PeakSpread,
        UnresolvedMode,
    )
else:
    Choice, ContactSummary, EnergyBalance, FrictionSummary, ParameterSensitivity, PeakSpread, UnresolvedMode = late(
        "kaneflex.solve.summary_tables", "Choice", "ContactSummary", "EnergyBalance", "FrictionSummary",
        "ParameterSensitivity", "PeakSpread", "UnresolvedMode",
    )  # fmt: skip

SCHEMA_VERSION = 1


class Instant(PlainTable):
    """An instant of the run."""

    time_s: float = Field(description="time, s")
    drive_deg: float | None = Field(
        description="angle of the drive within its cycle, degrees; null if other instants have the same angle"
    )


class SensorError(PlainTable):
    """Largest estimated error of a sensor over the run by cause, in SI."""

    total: float = Field(description="change when all refinements are made at once; not the sum of the parts")
    time: float | None = Field(description="error due to the discretisation in time")
    modes: float | None = Field(description="error due to modes left out")
    terms: float | None = Field(description="error due to terms left out")
    elements: float | None = Field(description="error due to the length of the elements")
    coupling: float | None = Field(default=None, description="error due to one-way coupling, if computed")
    statistics: float | None = Field(default=None, description="with contacts: error of peak and rms")


class SensorSummary(PlainTable):
    """A sensor over the stored times, in SI."""

    unit: str = Field(description="SI unit: m, m/s, m/s^2, rad, rad/s, rad/s^2, N, N m or 1")
    meaning: str = Field(description="quantity, place and axes")
    min: float = Field(description="smallest value")
    max: float = Field(description="largest value")
    at_min: Instant = Field(description="where the smallest value is first reached")
    at_max: Instant = Field(description="where the largest value is first reached")
    rms: float = Field(description="root mean square over time")
    mean: float = Field(description="mean over time")
    plus_minus: SensorError | None = Field(default=None, description="error estimate")


class StressSummary(PlainTable):
    """Largest von Mises stress in an elastic link: along its length, at the outline of its section, during the run."""

    largest: float = Field(description="largest stress, Pa; notches are not included")
    x_m: float = Field(description="distance from the link's start, m")
    at: Instant = Field(description="instant of the largest stress")
    utilisation: float | None = Field(description="largest stress as a share of the beam's yield_strength")


class Timing(PlainTable):
    """Wall time of the stages."""

    derive_s: float = Field(description="deriving the equations, s")
    compile_s: float = Field(description="compiling or loading kernels, s")
    set_up_s: float = Field(description="other work before the first step, s")
    integrate_s: float = Field(description="solving, including compilation of the integrator, s")
    ns_per_step: float = Field(description="one step in the compiled loop, ns")


class Operations(PlainTable):
    """Arithmetic operations of one kernel call."""

    written_out: int = Field(description="number of operations without shared subexpressions")
    shared: int = Field(description="number of operations with shared subexpressions, as generated")


class Summary(PlainTable):
    """Settings and results of a run."""

    schema_version: Literal[1] = Field(
        description="version of the format; it is raised when fields are removed or change"
    )
    kaneflex: str = Field(description="version of kaneflex")
    scene: str = Field(description="name of the scene")
    settings: list[str] = Field(description="changes made on the command line, as path=value")
    structure: str = Field(description="hash of topology and laws; equal hashes share generated code")
    preset: str = Field(description="preset of the run")
    options: dict[str, Any] = Field(description="all solver settings, with defaults, SI")
    elements: dict[str, int] = Field(description="number of elements of each elastic link")
    outcome: str = Field(description="completed, unstable, stuck, singular, no_periodic_state, cascade or paradox")
    message: str = Field(description="the outcome in words, with time and reason")
    solver: str = Field(description="solver, the reason for its choice, and its residual")
    errors: str = Field(description="reason if there are no error estimates")
    warnings: list[str] = Field(description="warnings")
    duration_s: float = Field(description="time from the first to the last stored instant, s")
    step_s: float = Field(description="time step, s")
    steps: int = Field(description="value of solve.steps, or its default")
    stored: int = Field(description="number of stored instants, over which statistics are computed")
    sensors: dict[str, SensorSummary] = Field(
        description="statistics of each sensor; NAME_rigid: of its value in the rigid mechanism"
    )
    mode_angle_spread: dict[str, PeakSpread] = Field(
        description="only preset paper: for each sensor, range of its peak over options.mode_angle"
    )
    frequencies_hz: list[float] = Field(
        description=f"the {MOST_FREQUENCIES} lowest natural frequencies at options.mode_angle (no drive: t = 0), Hz"
    )
    degrees_of_freedom: int = Field(
        description="elastic degrees of freedom before reduction, or shapes of modal data; "
        "preset rigid, or coupled in space: number of coordinates solved for"
    )
    modes_kept: int = Field(description="number of coordinates solved for")
    floquet_multiplier_max: float | None = Field(
        description="largest modulus of the Floquet multipliers; unstable above 1"
    )
    events: dict[str, list[float]] = Field(description="times of the scene's events, s")
    energy: EnergyBalance | None = Field(description="energy balance; only under preset coupled or with free joints")
    contacts: dict[str, ContactSummary] = Field(description="each contact")
    frictions: dict[str, FrictionSummary] = Field(description="friction of each joint or contact")
    stresses: dict[str, StressSummary] = Field(description="each elastic link with a section shape")
    unresolved_modes: list[UnresolvedMode] = Field(
        description="only preset coupled: modes with fewer than 3 steps per period"
    )
    choice: Choice | None = Field(description="the choice made by --tolerance")
    timing: Timing = Field(description="wall time of the stages")
    operations: dict[str, Operations] = Field(description="each kernel of the generated module")
    sensitivities: dict[str, ParameterSensitivity] = Field(description="derivatives with respect to each parameter")


def summarise(solution: Solution, settings: Sequence[str] = (), choice: Choice | None = None) -> Summary:
    """The summary of a solution; ``settings`` are those that were laid over the scene, ``choice`` what chose them.

    A run that stopped before its first step has no sensors.
    """
    import kaneflex

    model, trajectory = solution.model, solution.trajectory
    seconds, times = model.seconds, solution.times
    multipliers = solution.multipliers
    return Summary(
        schema_version=SCHEMA_VERSION,
        kaneflex=kaneflex.__version__,
        scene=model.scene.name,
        settings=list(map(visible, settings)),
        structure=model.motion.module.STRUCTURE,
        preset=model.options.preset,
        options=model.options.as_dict(),
        elements={name: model.options.elements or model.scene.bodies[name].beam.elements for name in model.links},
        outcome=trajectory.outcome.name.lower(),
        message=trajectory.message,
        solver=getattr(trajectory, "solver", ""),
        errors=solution.errors[1],
        warnings=list(solution.warnings),
        duration_s=float(times[-1] - times[0]) if len(times) else 0.0,
        step_s=model.step,
        steps=model.options.steps,
        stored=len(times),
        sensors=sensor_summaries(solution) if len(times) else {},
        frequencies_hz=list(solution.frequencies),
        degrees_of_freedom=model.degrees_of_freedom,
        modes_kept=model.solved_for,
        floquet_multiplier_max=None if multipliers is None else float(abs(multipliers).max(initial=0.0)),
        events={name: found.tolist() for name, found in solution.events.items()} if len(times) > 1 else {},
        energy=_energy(solution),
        stresses=_stresses(solution) if len(times) else {},
        choice=choice,
        timing=Timing(
            **{f"{key}_s": seconds[key] for key in ("derive", "compile", "set_up")}, integrate_s=solution.seconds,
            ns_per_step=trajectory.ns_per_step,
        ),
        operations={kernel: Operations(written_out=written_out, shared=shared)
                    for kernel, (written_out, shared) in model.module.OPERATIONS.items()},
        sensitivities={},
        **_of_its_preset(solution),
    )  # fmt: skip


def _of_its_preset(solution: Solution) -> dict[str, Any]:
    """Fields that are empty but under preset paper, or under coupled."""
    model = solution.model
    found: dict[str, Any] = {"mode_angle_spread": {}, "contacts": {}, "frictions": {}, "unresolved_modes": []}
    if model.options.dynamics == "frozen":
        from kaneflex.solve.modes import mode_angle_spread

        found["mode_angle_spread"] = mode_angle_spread(model)
    if model.options.dynamics == "coupled":
        from kaneflex.solve.coupled_linearisation import unresolved
        from kaneflex.solve.touching import contact_summaries, friction_summaries

        found["contacts"], found["frictions"] = contact_summaries(solution), friction_summaries(solution)
        found["unresolved_modes"] = unresolved(solution)
    return found


def sensor_summaries(solution: Solution) -> dict[str, SensorSummary]:
    """Every sensor over the stored times, of which there is at least one."""
    degrees, (errors, _), times = drive_degrees(solution), solution.errors, solution.times
    return {name: _sensor(series, solution.statistics(name), times, degrees, errors.get(name))
            for name, series in solution.series.items()}  # fmt: skip


def _stresses(solution: Solution) -> dict[str, StressSummary]:
    degrees, found = drive_degrees(solution), {}
    for name, stresses in solution.stresses.items():
        beam, (station, instant) = solution.model.scene.bodies[name].beam, stresses.largest
        assert beam is not None  # only such have sections
        largest = float(stresses.mises[station, instant])
        found[name] = StressSummary(
            largest=largest,
            x_m=stresses.x[station],
            at=_instant(solution.times, degrees, instant),
            utilisation=None if beam.yield_strength is None else largest / beam.yield_strength,
        )
    return found


def _instant(times: np.ndarray, degrees: np.ndarray | None, index: int) -> Instant:
    return Instant(time_s=times[index], drive_deg=None if degrees is None else degrees[index])


def _sensor(
    series: Series, found: Statistics, times: np.ndarray, degrees: np.ndarray | None, error: ErrorEstimate | None = None
) -> SensorSummary:
    own: dict[str, Any] = found._asdict()
    own |= {key: _instant(times, degrees, own[key]) for key in ("at_min", "at_max")}
    own["plus_minus"] = None if error is None else SensorError(**error._asdict())
    return SensorSummary(unit=series.unit, meaning=series.meaning, **own)


def drive_degrees(solution: Solution) -> np.ndarray | None:
    """Angle of the drive in degrees, within its cycle where it has one; None where it does not name one instant.

    It does where it is the only drive and turns in one direction, through one cycle at most.
    """
    scene = solution.model.scene
    name, drive = next(iter(scene.drives.items()), ("", None))
    if drive is None or len(scene.drives) > 1 or scene.slides(name):
        return None
    degrees = np.degrees(solution.drive_angles[name])
    steps = np.diff(degrees)
    if not ((steps > 0.0).all() or (steps < 0.0).all()):
        return None
    if drive.cycle is None:
        return degrees
    # rounded before it is folded, or the end of a cycle could read 719.9999999 or 0
    cycle = round(math.degrees(drive.cycle), 9)
    return np.mod(np.round(degrees, 9), cycle) if round(abs(steps.sum()), 6) <= cycle else None


def _energy(solution: Solution) -> EnergyBalance | None:
    energy = solution.energy
    if energy is None or not len(solution.times):
        return None
    from kaneflex.solve.summary_tables import EnergyBalance

    exchanged = {"dissipated": energy.dissipated[-1], "supplied": energy.supplied[-1]}
    stored = energy.stored[-1] - energy.stored[0]
    return EnergyBalance(stored=stored, **exchanged, gap=abs(energy.gap).max(), drift=energy.drift)


def json_schema() -> dict[str, Any]:
    """JSON Schema of ``summary.json``."""
    schema = Summary.model_json_schema(mode="serialization")
    return schema | {"$schema": "https://json-schema.org/draft/2020-12/schema"}


if __name__ == "__main__":
    import json

    print(json.dumps(json_schema(), indent=1, ensure_ascii=False))
