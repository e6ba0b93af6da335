"""The folder of a sweep: a journal of finished points, which survives an interruption, and the dataset at the end."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout

from kaneflex.study.plan import Plan
from kaneflex.study.records import Record
from kaneflex.support.atomic_output import write_text
from kaneflex.support.errors import OutputError
from kaneflex.support.output_folders import writing

STUDY_FILE, JOURNAL_FILE, SERIES_FOLDER, LOCK_FILE = "study.json", "journal.jsonl", "series", ".lock"
RESULT_FILES = {"netcdf": "sweep.nc", "zarr": "sweep.zarr"}


@dataclass(frozen=True, eq=False)
class Store:
    """What is finished of a sweep. Made by :func:`open_store`.

    A point is finished when its line stands in the journal; its series have been renamed into place before.

    Attributes
    ----------
    folder : Path
    finished : dict of int to int
        Finished point -> where its line begins in the journal.
    labels : dict of str to tuple of str
        Sensor -> unit and meaning, of all finished points.
    """

    folder: Path
    finished: dict[int, int] = field(default_factory=dict)
    labels: dict[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def result(self) -> Path | None:
        """The dataset, where the sweep is complete."""
        return next((self.folder / name for name in RESULT_FILES.values() if (self.folder / name).exists()), None)

    def add(self, record: Record) -> None:
        """Keep a finished point; of one that is kept already nothing is written."""
        if record.point in self.finished:
            return
        new = {name: words for name, words in record.labels.items() if name not in self.labels}
        line = {"point": record.point, "outcome": record.outcome, "reason": record.reason,
                "statistics": dict(record.statistics), "labels": new}  # fmt: skip
        with writing(self.folder):
            if record.times is not None:
                self._write_series(record)
            with (self.folder / JOURNAL_FILE).open("ab") as journal:
                begin = journal.tell()
                journal.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
        self.finished[record.point] = begin
        self.labels.update(new)

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

    def records(self, points: Iterable[int]) -> Iterator[Record]:
        """Finished points of these numbers, without their series."""
        points = list(points)
        if not points:
            return
        with (self.folder / JOURNAL_FILE).open("rb") as journal:
            for point in points:
                journal.seek(self.finished[point])
                entry = json.loads(journal.readline())
                statistics = {name: tuple(values) for name, values in entry["statistics"].items()}
                yield Record(point, entry["outcome"], entry["reason"], statistics)

    def series(self, point: int) -> dict[str, np.ndarray]:
        """The series of a completed point by sensor, times [s] under ""; none where none were kept."""
        if not self._series_file(point).exists():
            return {}
        with np.load(self._series_file(point)) as found:
            return {name: found[name] for name in found}

    def instants(self, point: int) -> int:
        """How many instants the series of a point have; 0 where none were kept."""
        if not self._series_file(point).exists():
            return 0
        with np.load(self._series_file(point)) as found:
            return len(found[""])

    def close(self) -> None:
        """The dataset is written: what it was made from goes."""
        (self.folder / JOURNAL_FILE).unlink()
        shutil.rmtree(self.folder / SERIES_FOLDER, ignore_errors=True)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Make the folder if need be, and keep every other sweep out of it as long as this one lasts.

    The system lifts the lock when the process ends, however it does.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK_FILE, timeout=0)
        try:
            lock.acquire()
        except Timeout:
            reason, cure = "another sweep is writing into it", "Wait for its end, or choose another name"
            raise OutputError(str(folder), None, reason, cure) from None
    try:
        yield
    finally:
        lock.release()


def open_store(folder: Path, plan: Plan, force: bool = False) -> Store:
    """Begin a sweep in an empty folder, or go on with the one that was begun there.

    Raises
    ------
    OutputError
        If the folder holds something else, or another study and ``force`` is not given; or can't be written.
    """
    with writing(folder):
        entries = {entry.name for entry in folder.iterdir()} - {LOCK_FILE}
        if entries and STUDY_FILE not in entries:
            reason = f"the folder holds other things and no {STUDY_FILE}: nothing is written into it"
            raise OutputError(str(folder), None, reason, "Choose another name")
        if entries and force:
            _empty(folder)
            entries = set()
        if entries:
            _demand_same(folder, plan)
            return _begun(folder)
    about = {"digest": plan.digest, "scene": plan.scene.name, "points": len(plan.points), "series": plan.series}
    write_text(folder / STUDY_FILE, json.dumps(about, indent=2, ensure_ascii=False) + "\n")
    return Store(folder)


def _empty(folder: Path) -> None:
    """Take away what an earlier sweep left; the folder itself stays, since it is locked."""
    shutil.rmtree(folder / SERIES_FOLDER, ignore_errors=True)
    shutil.rmtree(folder / RESULT_FILES["zarr"], ignore_errors=True)
    for name in (JOURNAL_FILE, RESULT_FILES["netcdf"], STUDY_FILE):
        (folder / name).unlink(missing_ok=True)


def _demand_same(folder: Path, plan: Plan) -> None:
    known = json.loads((folder / STUDY_FILE).read_text(encoding="utf-8")).get("digest")
    if known != plan.digest:
        raise OutputError(
            str(folder), None, "it was begun with another study, scene or version of kaneflex",
            "Choose another name, or begin anew with --force",
        )  # fmt: skip


def _begun(folder: Path) -> Store:
    """What the journal holds; a last line that was cut off is taken away."""
    store, journal = Store(folder), folder / JOURNAL_FILE
    if not journal.exists():
        return store
    with journal.open("r+b") as file:
        begin = 0
        for line in file:
            if not line.endswith(b"\n"):
                file.truncate(begin)
                break
            entry = json.loads(line)
            store.finished[entry["point"]] = begin
            store.labels.update({name: tuple(words) for name, words in entry["labels"].items()})
            begin += len(line)
    return store
