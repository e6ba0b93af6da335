"""Option ``--tolerance``: choose a model by its permitted error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from kaneflex.cli.scene import quantity
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.solve.summary_tables import Choice

UNKNOWN = "Not verified"


@dataclass(frozen=True)
class Choosing:
    """Request for a model: the permitted error, the sensors, and whether to write the model into the scene's file."""

    tolerance: str | None
    sensors: tuple[str, ...]
    write_back: bool


def tolerance_of(text: str) -> float:
    """Share given as "1%" or 0.01."""
    from kaneflex.support.units import RATIO

    percent = text.strip().endswith("%")
    return quantity("--tolerance", text.strip().removesuffix("%"), RATIO, text) * (0.01 if percent else 1.0)


def chosen_lines(choice: Choice) -> str:
    """Report of the chosen model, its worst sensor and the reference."""
    sensor = max(choice.errors, key=choice.errors.__getitem__)
    again = ", as found before" if choice.remembered else f", found in {choice.seconds:.1f} s"
    settings = " ".join(f"--set {setting}" for setting in choice.settings)
    note = f"\n  {UNKNOWN}: {choice.reference_note}" if choice.reference_note else ""
    judged = [each.priced for each in choice.attempts if each.error is not None]
    by = " (priced)" if any(each.priced and each.model == choice.model for each in choice.attempts) else ""
    return (
        f"Chosen within {percent(choice.tolerance)}: {choice.model}{again}\n  {settings}\n"
        f"  {sensor} differs by {percent(choice.errors[sensor])} from {choice.reference}{by}; "
        f"error estimate of the reference: {percent(max(choice.doubt.values()))}{note}\n"
        f"  Models tried: {len(judged)} ({sum(judged)} priced, {len(judged) - sum(judged)} run)"
    )


def refuse_with_tolerance(tolerance: str | None, others: Mapping[str, object]) -> None:
    """Raise SceneError for an option that contradicts --tolerance."""
    for option, value in others.items():
        if tolerance is not None and value is not None:
            raise SceneError(option, str(value), "--tolerance chooses the model", "Leave out one of the two")


def demand_tolerance(tolerance: str | None, others: Mapping[str, object]) -> None:
    """Raise SceneError for an option that requires --tolerance."""
    for option, value in others.items():
        if tolerance is None and value:
            raise SceneError(option, None, "requires --tolerance", "Add --tolerance 1%, or leave it out")


def percent(share: float) -> str:
    return f"{100 * share:.2g} %" if abs(share) < 1 else f"{100 * share:.0f} %"
