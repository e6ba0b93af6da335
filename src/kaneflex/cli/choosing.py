"""``--tolerance``: a model chosen by the error that it may have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from kaneflex.cli.scene import quantity
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.study.trade.record import Choice

UNKNOWN = "What is not known of it"


@dataclass(frozen=True)
class Choosing:
    """A model to be chosen: the error allowed, the sensors that count, and whether the scene's file takes it."""

    tolerance: str | None
    sensors: tuple[str, ...]
    write_back: bool


def tolerance_of(text: str) -> float:
    """The share that "1%" or 0.01 means."""
    from kaneflex.support.units import RATIO

    percent = text.strip().endswith("%")
    return quantity("--tolerance", text.strip().removesuffix("%"), RATIO, text) * (0.01 if percent else 1.0)


def chosen_lines(choice: Choice) -> str:
    """What --tolerance chose, its worst sensor, and what that was measured against."""
    sensor = max(choice.errors, key=choice.errors.__getitem__)
    again = ", as found before" if choice.remembered else f", found in {choice.seconds:.1f} s"
    settings = " ".join(f"--set {setting}" for setting in choice.settings)
    note = f"\n  {UNKNOWN}: {choice.reference_note}" if choice.reference_note else ""
    judged = [each.priced for each in choice.attempts if each.error is not None]
    by = ", by its price" if any(each.priced and each.model == choice.model for each in choice.attempts) else ""
    return (
        f"Chosen within {percent(choice.tolerance)}: {choice.model}{again}\n  {settings}\n"
        f"  {sensor} is {percent(choice.errors[sensor])} off {choice.reference}{by}, "
        f"which itself is known to {percent(max(choice.doubt.values()))}{note}\n"
        f"  Of {len(judged)} models that were tried {sum(judged)} were priced, {len(judged) - sum(judged)} run"
    )


def refuse_with_tolerance(tolerance: str | None, others: Mapping[str, object]) -> None:
    """Raise SceneError for an option that says what --tolerance finds."""
    for option, value in others.items():
        if tolerance is not None and value is not None:
            raise SceneError(option, str(value), "the model is what --tolerance chooses", "Leave one of the two out")


def demand_tolerance(tolerance: str | None, others: Mapping[str, object]) -> None:
    """Raise SceneError for an option that only --tolerance gives a meaning."""
    for option, value in others.items():
        if tolerance is None and value:
            raise SceneError(option, None, "belongs to --tolerance", "Add --tolerance 1%, or leave it out")


def percent(share: float) -> str:
    return f"{100 * share:.2g} %" if abs(share) < 1 else f"{100 * share:.0f} %"
