"""What the folders of a trade and of a scene's terms hold: a table, and the whole as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from kaneflex.study.differences import Difference
from kaneflex.study.trade.ranking import Ranked, Trade
from kaneflex.study.trade.terms import Effect, Terms

Row = dict[str, object]
Data = tuple[dict[str, object], list[Row]]
"""The whole, and the rows of its table."""


def trade_data(found: Trade, settings: Sequence[str]) -> Data:
    """What ``trade.json`` and ``trade.csv`` hold: times in s, errors as shares of the reference's peaks."""
    reference = found.reference
    rows = [_row(found, entry) for entry in found.ranked]
    return {
        "scene": found.scene.name,
        "settings": list(settings),
        "tolerance": found.tolerance,
        "reference": {
            "name": reference.name,
            "settings": list(reference.model.settings),
            "refinement": dict(reference.refinement),
            "coupling": dict(reference.coupling),
            "note": reference.note,
        },
        "chosen": None if found.chosen is None else found.chosen.name,
        "front": [entry.name for entry in found.front],
        "models": [
            row
            | {"settings": list(found.settings_of(entry)), "cost": asdict(entry.cost)}
            | {"sensors": _shares(entry.differences)}
            for row, entry in zip(rows, found.ranked, strict=True)
        ],
        "left_out": dict(found.left_out),
    }, rows


def _row(found: Trade, entry: Ranked) -> Row:
    cost = entry.cost
    return {
        "model": entry.name,
        "error": entry.error,
        "worst_sensor": entry.worst.sensor,
        "rms": entry.rms,
        "good_enough": found.good_enough(entry),
        "on_front": entry in found.front,
        "set_up_s": cost.set_up,
        "ns_per_step": cost.ns_per_step,
        "steps": cost.steps,
        "read_s": cost.read,
        "total_s": cost.total,
        "spread": cost.spread,
        "repeats": cost.repeats,
        "first_s": cost.first,
    }


def terms_data(found: Terms, settings: Sequence[str]) -> Data:
    """What ``terms.json`` and ``terms.csv`` hold: times in s or ns, changes as shares of each sensor's peak."""
    rows = [_effect_row(effect) for effect in found.effects]
    return {
        "scene": found.scene.name,
        "settings": list(settings),
        "tolerance": found.tolerance,
        "full": asdict(found.full),
        "groups": [
            row | {"sensors": _shares(effect.differences)} for row, effect in zip(rows, found.effects, strict=True)
        ],
        "left_out": dict(found.left_out),
    }, rows


def _effect_row(effect: Effect) -> Row:
    most = effect.worst
    return {
        "group": effect.group.name,
        "meaning": effect.group.meaning,
        "change": None if most is None else most.peak_share,
        "worst_sensor": None if most is None else most.sensor,
        "rms": effect.rms,
        "needed": effect.needed,
        "operations": effect.operations,
        "ns_per_step": effect.ns_per_step,
        "noise_ns": effect.noise_ns,
        "reason": effect.reason,
    }


def _shares(found: Sequence[Difference]) -> dict[str, dict[str, float | None]]:
    return {each.sensor: {"peak": each.peak_share, "rms": each.rms_share} for each in found}
