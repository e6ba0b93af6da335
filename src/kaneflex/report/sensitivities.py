"""What the command line prints of derivatives."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kaneflex.report.presentation import table

if TYPE_CHECKING:
    from kaneflex.report.summary import Summary


def sensitivity_table(summary: Summary) -> str:
    """By how many per cent each sensor's largest magnitude grows with one per cent of each parameter."""
    rows = []
    for name, entry in summary.sensors.items():
        key = "log_max" if abs(entry.max) >= abs(entry.min) else "log_min"
        peaks = (getattr(by.sensors[name], key) for by in summary.sensitivities.values())
        rows.append((name, *("-" if value is None else f"{round(value, 4) + 0.0:+.4f}" for value in peaks)))
    return table(("% of the peak by 1 % of", *summary.sensitivities), rows)
