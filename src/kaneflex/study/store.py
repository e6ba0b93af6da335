"""The folder of a sweep: a journal of finished points, which survives an interruption, and the dataset at the end."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kaneflex.errors import OutputError
from kaneflex.folders import writing
from kaneflex.study.plan import Plan
from kaneflex.study.run import Record
from kaneflex.writing import write_text

STUDY_FILE, JOURNAL_FILE, SERIES_FOLDER = "study.json", "journal.jsonl", "series"
RESULT_FILES = {"netcdf": "sweep.nc", "zarr": "sweep.zarr"}


@dataclass(frozen=True, eq=False)
class Store:
    """What is finished of a sweep, in `folder`. Made by :func:`open_store`.

    A point is finished when its line stands in the journal; its series have been renamed into place before.
    """

    folder: Path
    finished: set[int]

    @property
    def result(self) -> Path | None:
        """The dataset, where the sweep is complete."""
        return next((self.folder / name for name in RESULT_FILES.values() if (self.folder / name).exists()), None)

    def add(self, record: Record) -> None:
        """Keep a finished point; of one that is kept already nothing is written."""
        if record.point in self.finished:
            return
        with writing(self.folder):
            if record.times is not None:
                self._write_series(record)
            line = {
                "point": record.point, "outcome": record.outcome, "reason": record.reason,
                "statistics": dict(record.statistics), "labels": dict(record.labels),
            }  # fmt: skip
            with (self.folder / JOURNAL_FILE).open("a", encoding="utf-8", newline="\n") as journal:
                journal.write(json.dumps(line, ensure_ascii=False) + "\n")
        self.finished.add(record.point)

    def _write_series(self, record: Record) -> None:
        path = self._series_file(record.point)
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        with partial.open("wb") as file:
            # times under the empty name, which no sensor can have
            np.savez(file, **{"": record.times}, **record.series)
        os.replace(partial, path)

    def _series_file(self, point: int) -> Path:
        return self.folder / SERIES_FOLDER / f"{point // 1000}" / f"{point}.npz"

    def records(self) -> Iterator[Record]:
        """Every finished point in the order in which they ended, without its series."""
        if not self.finished:
            return
        with (self.folder / JOURNAL_FILE).open(encoding="utf-8") as journal:
            for line in journal:
                entry = json.loads(line)
                statistics = {name: tuple(values) for name, values in entry["statistics"].items()}
                labels = {name: tuple(words) for name, words in entry["labels"].items()}
                yield Record(entry["point"], entry["outcome"], entry["reason"], statistics, labels)

    def series(self, point: int) -> dict[str, np.ndarray]:
        """The series of a completed point by sensor, times [s] under ""."""
        with np.load(self._series_file(point)) as found:
            return {name: found[name] for name in found}

    def close(self) -> None:
        """The dataset is written: what it was made from goes."""
        (self.folder / JOURNAL_FILE).unlink()
        shutil.rmtree(self.folder / SERIES_FOLDER, ignore_errors=True)


def open_store(folder: Path, plan: Plan, force: bool = False) -> Store:
    """Begin a sweep in a new folder, or go on with the one that was begun there.

    Raises
    ------
    OutputError
        If the folder holds something else, or another study and ``force`` is not given; or can't be written.
    """
    with writing(folder):
        entries = {entry.name for entry in folder.iterdir()} if folder.exists() else set()
        if entries and STUDY_FILE not in entries:
            reason = f"the folder holds other things and no {STUDY_FILE}: nothing is written into it"
            raise OutputError(str(folder), None, reason, "Choose another name")
        if entries and force:
            shutil.rmtree(folder)
            entries = set()
        if entries:
            _demand_same(folder, plan)
            return Store(folder, _whole_lines(folder / JOURNAL_FILE))
        folder.mkdir(parents=True, exist_ok=True)
    about = {"digest": plan.digest, "scene": plan.scene.name, "points": len(plan.points), "series": plan.series}
    write_text(folder / STUDY_FILE, json.dumps(about, indent=2, ensure_ascii=False) + "\n")
    return Store(folder, set())


def _demand_same(folder: Path, plan: Plan) -> None:
    known = json.loads((folder / STUDY_FILE).read_text(encoding="utf-8")).get("digest")
    if known != plan.digest:
        raise OutputError(
            str(folder), None, "it was begun with another study, scene or version of kaneflex",
            "Choose another name, or begin anew with --force",
        )  # fmt: skip


def _whole_lines(journal: Path) -> set[int]:
    """The points of the journal, of which a last line that was cut off is taken away."""
    if not journal.exists():
        return set()
    content = journal.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        with journal.open("r+b") as file:
            file.truncate(whole)
    return {json.loads(line)["point"] for line in content[:whole].splitlines()}
