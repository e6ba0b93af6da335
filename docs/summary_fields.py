"""Fields of ``summary.json`` with their descriptions, for the page about it."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args, get_origin

from kaneflex.report.summary import Instant, Operations, SensorError, SensorSummary, StressSummary, Summary, Timing
from kaneflex.solve.summary_tables import (
    Attempt,
    Choice,
    ContactSummary,
    EnergyBalance,
    FrictionSummary,
    ParameterSensitivity,
    PeakSpread,
    SensorDerivative,
    UnresolvedMode,
)


def documentation() -> str:
    """Sections of ``docs/summary.md``: every field of every table."""
    parts = []
    for table in _TABLES:
        about = (table.__doc__ or "").splitlines()[0]
        parts.append(f"## {table.__name__}\n\n{about}\n\n")
        parts += [
            f"- `{name}`, {_type_name(field.annotation)}: {field.description}\n".replace(", number: ", ": ")
            for name, field in table.model_fields.items()
        ] + ["\n"]
    return "".join(parts)


_TABLES = (
    Summary, SensorSummary, SensorError, Instant, StressSummary, PeakSpread, EnergyBalance, ContactSummary,
    FrictionSummary, UnresolvedMode, Choice, Attempt, Timing, Operations, ParameterSensitivity, SensorDerivative,
)  # fmt: skip


def _type_name(kind: Any) -> str:
    if get_origin(kind) is dict:
        return f"table of {_type_name(get_args(kind)[1])}"
    if get_origin(kind) is list:
        return f"list of {_type_name(get_args(kind)[0])}"
    if get_origin(kind) is Literal:
        return str(get_args(kind)[0])
    if get_origin(kind) is Annotated:
        return _type_name(kind.__metadata__[0].table)
    if get_args(kind):
        return " or ".join(_type_name(option) for option in get_args(kind))
    names = {float: "number", int: "integer", bool: "true or false", str: "text", type(None): "null", Any: "any"}
    return names[kind] if kind in names else f"[{kind.__name__}](#{kind.__name__.lower()})"
