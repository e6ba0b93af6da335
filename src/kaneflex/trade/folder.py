"""A trade's folder: ``trade.csv``, ``trade.json`` and the picture."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from kaneflex.folders import whole_folder, writing
from kaneflex.scene import Scene
from kaneflex.terminal import Waiting
from kaneflex.trade.ranking import Ranked, Trade, trade

TRADE_FILE, TABLE_FILE = "trade.json", "trade.csv"


def trade_into(
    scene: Scene, folder: Path, tolerance: float, budget: float, sensors: Sequence[str] | None = None,
    settings: Sequence[str] = (), plots: bool = True, force: bool = False,
) -> Trade:  # fmt: skip
    """Rank a scene's models and write ``trade.json``, ``trade.csv`` and the picture into a new folder.

    Parameters
    ----------
    scene, tolerance, budget, sensors
        As :func:`kaneflex.trade.ranking.trade` takes them.
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
        As :func:`kaneflex.trade.ranking.trade`.
    """
    with whole_folder(folder, mark=TRADE_FILE, force=force) as partial, Waiting() as waiting:
        found = trade(scene, tolerance, budget, sensors, waiting.stage)
        with writing(folder):
            _write(found, settings, partial)
            if plots:
                from kaneflex.plots.trade import draw_trade

                waiting.stage("drawing the picture")
                draw_trade(found, partial)
    return found


def _write(found: Trade, settings: Sequence[str], folder: Path) -> None:
    text = json.dumps(as_data(found, settings), indent=2, ensure_ascii=False) + "\n"
    (folder / TRADE_FILE).write_text(text, encoding="utf-8", newline="\n")
    rows = [_row(found, entry) for entry in found.ranked]
    with (folder / TABLE_FILE).open("w", encoding="utf-8", newline="") as file:
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
            "settings": list(reference.settings),
            "refinement": dict(reference.refinement),
            "coupling": dict(reference.coupling),
            "note": reference.note,
        },
        "chosen": None if found.chosen is None else found.chosen.name,
        "front": [entry.name for entry in found.front],
        "models": [
            _row(found, entry)
            | {"settings": list(found.settings_of(entry)), "cost": asdict(entry.cost)}
            | {"sensors": {d.sensor: {"peak": d.peak_share, "rms": d.rms_share} for d in entry.differences}}
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
