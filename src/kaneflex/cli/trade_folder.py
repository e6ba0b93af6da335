"""Folders of a trade and of a scene's terms: a table, the whole as JSON, and the picture."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from kaneflex.scene import Scene
from kaneflex.study.differences import Difference
from kaneflex.study.trade.ranking import Ranked, Trade, trade
from kaneflex.study.trade.terms import Effect, Terms, terms
from kaneflex.support.output_folders import whole_folder, writing
from kaneflex.support.terminal import Waiting

TRADE_FILE, TERMS_FILE = "trade.json", "terms.json"


def trade_into(
    scene: Scene, folder: Path, tolerance: float, budget: float, sensors: Sequence[str] | None = None,
    settings: Sequence[str] = (), plots: bool = True, force: bool = False,
) -> Trade:  # fmt: skip
    """Rank a scene's models and write ``trade.json``, ``trade.csv`` and the picture into a new folder.

    Parameters
    ----------
    scene, tolerance, budget, sensors
        As :func:`kaneflex.study.trade.ranking.trade` takes them.
    folder : Path
        Appears when it is complete.
    settings : sequence of str
        The settings of the scene, for the file.
    plots, force : bool
        Whether to draw; whether an earlier trade may be replaced.

    Raises
    ------
    OutputError
        If the folder exists or can't be written, before anything is computed where that can be known.
    SceneError
        As :func:`kaneflex.study.trade.ranking.trade`.
    """
    with whole_folder(folder, mark=TRADE_FILE, force=force) as partial, Waiting() as waiting:
        found = trade(scene, tolerance, budget, sensors, waiting.stage)
        with writing(folder):
            rows = [_row(found, entry) for entry in found.ranked]
            _write(partial / TRADE_FILE, as_data(found, settings), rows)
            if plots:
                from kaneflex.plots.trade import draw_trade

                waiting.stage("drawing the picture")
                draw_trade(found, partial)
    return found


def terms_into(
    scene: Scene, folder: Path, tolerance: float, budget: float, sensors: Sequence[str] | None = None,
    settings: Sequence[str] = (), plots: bool = True, force: bool = False,
) -> Terms:  # fmt: skip
    """Leave each group of terms out and write ``terms.json``, ``terms.csv`` and the picture into a new folder.

    Parameters and errors are those of :func:`trade_into` and :func:`kaneflex.study.trade.terms.terms`.
    """
    with whole_folder(folder, mark=TERMS_FILE, force=force) as partial, Waiting() as waiting:
        found = terms(scene, tolerance, budget, sensors, waiting.stage)
        with writing(folder):
            rows = [_effect_row(effect) for effect in found.effects]
            _write(partial / TERMS_FILE, terms_as_data(found, settings), rows)
            if plots:
                from kaneflex.plots.terms import draw_terms

                waiting.stage("drawing the picture")
                draw_terms(found, partial)
    return found


def _write(path: Path, about: Mapping[str, object], rows: Sequence[Mapping[str, object]]) -> None:
    """The whole as JSON, and its rows as a CSV file of the same name."""
    text = json.dumps(about, indent=2, ensure_ascii=False) + "\n"
    path.write_text(text, encoding="utf-8", newline="\n")
    with path.with_suffix(".csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def as_data(found: Trade, settings: Sequence[str]) -> dict[str, object]:
    """What ``trade.json`` holds: times in s, errors as shares of the reference's peaks."""
    reference = found.reference
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
            _row(found, entry)
            | {"settings": list(found.settings_of(entry)), "cost": asdict(entry.cost)}
            | {"sensors": _shares(entry.differences)}
            for entry in found.ranked
        ],
        "left_out": dict(found.left_out),
    }


def _row(found: Trade, entry: Ranked) -> dict[str, object]:
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


def terms_as_data(found: Terms, settings: Sequence[str]) -> dict[str, object]:
    """What ``terms.json`` holds: times in s or ns, changes as shares of each sensor's peak."""
    return {
        "scene": found.scene.name,
        "settings": list(settings),
        "tolerance": found.tolerance,
        "full": asdict(found.full),
        "groups": [_effect_row(effect) | {"sensors": _shares(effect.differences)} for effect in found.effects],
        "left_out": dict(found.left_out),
    }


def _effect_row(effect: Effect) -> dict[str, object]:
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
