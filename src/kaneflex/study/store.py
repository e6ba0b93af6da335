"""Folder of a sweep: journal of finished points, which survives interruptions, and the final dataset."""

from __future__ import annotations

import json
import os
import shutil
import sys
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from kaneflex.study.plan import Plan
from kaneflex.study.records import COMPLETED, STATISTICS, Record
from kaneflex.study.study import Value, number_and_unit
from kaneflex.support.errors import Fault, OutputError
from kaneflex.support.files import check_file, read_text, write_text, writing
from kaneflex.support.labelled import Labelled
from kaneflex.support.terminal import log_warning

STUDY_FILE, JOURNAL_FILE, SERIES_FOLDER, LOCK_FILE = "study.json", "journal.jsonl", "series", ".lock"
BEGIN_ANEW = "Restore it from a copy, choose another folder, or start again with --force"
"""Fix for a damaged file; kaneflex does not change it."""
RESULT_FILE = "sweep.nc"


@dataclass(frozen=True, eq=False)
class Store:
    """Finished points of a sweep. Made by :func:`open_store`.

    A point is finished when its line is in the journal; its series are written before.

    Attributes
    ----------
    folder : Path
    finished : dict of int to int
        Finished point -> offset of its line in the journal.
    labels : dict of str to tuple of str
        Sensor -> unit and meaning, from all finished points.
    """

    folder: Path
    finished: dict[int, int] = field(default_factory=dict)
    labels: dict[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def result(self) -> Path | None:
        """Path of the dataset if the sweep is complete."""
        file = self.folder / RESULT_FILE
        return file if os.path.lexists(file) else None

    def add(self, record: Record) -> None:
        """Store a finished point, unless it is stored already."""
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
                journal.write(_checked(json.dumps(line)))
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
        """Series of a completed point by sensor, times [s] under ""; empty if none were kept."""
        if not self._series_file(point).exists():
            return {}
        with np.load(self._series_file(point), allow_pickle=False) as found:
            return {name: found[name] for name in found}

    def keeps_series(self, point: int) -> bool:
        """True if the series of a completed point exist and can be read."""
        try:
            return bool(self.series(point))
        except Exception:  # a damaged archive raises various errors from several libraries
            return False

    def close(self) -> None:
        """Delete the journal and series after the dataset is written."""
        (self.folder / JOURNAL_FILE).unlink()
        shutil.rmtree(self.folder / SERIES_FOLDER, ignore_errors=True)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Make the folder if needed, and lock it against other sweeps.

    The system releases the lock when the process ends.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK_FILE, timeout=0)
        try:
            lock.acquire()
        except Timeout:
            reason, cure = "another sweep is writing into it", "Wait until it ends, or choose another folder"
            raise OutputError(str(folder), None, reason, cure) from None
    try:
        yield
    finally:
        lock.release()


def open_store(folder: Path, plan: Plan, force: bool = False) -> Store:
    """Begin a sweep in an empty folder, or continue the one in it.

    Raises
    ------
    OutputError
        If the folder holds other files, or another study without ``force``, or can't be written.
    """
    with writing(folder):
        entries = {entry.name for entry in folder.iterdir()} - {LOCK_FILE}
        if entries and STUDY_FILE not in entries:
            reason = f"the folder holds other files and no {STUDY_FILE}"
            raise OutputError(str(folder), None, reason, "Choose another folder")
        if entries and force:
            _empty(folder)
            entries = set()
        if entries:
            _demand_same(folder / STUDY_FILE, plan)
            return _begun(folder, plan)
    about = {"digest": plan.digest, "scene": plan.scene.name, "points": len(plan.points), "series": plan.series}
    write_text(folder / STUDY_FILE, json.dumps(about, indent=2, ensure_ascii=False) + "\n")
    return Store(folder)


def _empty(folder: Path) -> None:
    """Delete the files of an earlier sweep; the locked folder itself stays."""
    shutil.rmtree(folder / SERIES_FOLDER, ignore_errors=True)
    for name in (JOURNAL_FILE, RESULT_FILE, STUDY_FILE):
        (folder / name).unlink(missing_ok=True)


def _demand_same(file: Path, plan: Plan) -> None:
    try:
        found = json.loads(read_text(file))
    except (Fault, ValueError, RecursionError, FileNotFoundError) as error:
        reason = error.reason if isinstance(error, Fault) else f"it is damaged: {error}"
        raise OutputError(str(file), None, reason, BEGIN_ANEW) from None
    known = found.get("digest") if isinstance(found, dict) else None
    if not isinstance(known, str):
        raise OutputError(str(file), None, "it is damaged: the digest of its study is missing", BEGIN_ANEW)
    if known != plan.digest:
        raise OutputError(
            str(file.parent), None, "it was begun with another study, scene or version of kaneflex",
            "Choose another folder, or start again with --force",
        )  # fmt: skip


def _checked(entry: str) -> bytes:
    """Journal line with a checksum of its content in front."""
    return f'{{"check": "{zlib.crc32(entry.encode()):08x}", {entry[1:]}\n'.encode()


def _entry(line: bytes) -> dict[str, Any] | None:
    """Content of a journal line; None if it is damaged."""
    text = line.decode("utf-8", "replace")
    entry = "{" + text[len('{"check": "00000000", ') :].rstrip("\n")
    return json.loads(entry) if _checked(entry) == line else None


def _begun(folder: Path, plan: Plan) -> Store:
    """Store of the points in the journal; an incomplete last line is cut off.

    Points whose line or series are damaged are computed again.
    """
    store, journal, damaged = Store(folder), folder / JOURNAL_FILE, 0
    if not os.path.lexists(journal):
        return store
    try:
        check_file(journal, sys.maxsize)
    except Fault as fault:
        raise OutputError(str(journal), None, fault.reason, BEGIN_ANEW) from None
    with journal.open("r+b") as file:
        begin = 0
        for line in file:
            if not line.endswith(b"\n"):
                file.truncate(begin)
                break
            entry = _entry(line)
            if entry is None:
                damaged += 1
            elif not (plan.series and entry["outcome"] == COMPLETED and not store.keeps_series(entry["point"])):
                store.finished[entry["point"]] = begin
            store.labels.update({} if entry is None else {name: tuple(each) for name, each in entry["labels"].items()})
            begin += len(line)
    lost = len(plan.points.keys() - store.finished)
    if damaged:
        log_warning(f"{journal}: {damaged} lines are damaged; {lost} points remain to be computed")
    return store


def labelled(plan: Plan, store: Store) -> Labelled:
    """Dataset of the finished points.

    Returns
    -------
    Labelled
        Dimensions ``point`` and ``statistic`` (min, max, rms, mean); along ``point`` a coordinate for each parameter,
        named by its path, in the study's unit. A variable for each sensor in SI, NaN where a point was not completed;
        ``outcome`` and ``reason`` describe how it ended. With series also ``NAME_series`` over ``point`` and
        ``instant``, at the times ``time`` [s], padded with NaN to the longest.
    """
    import kaneflex

    points = sorted(store.finished)
    records = list(store.records(points))
    variables: dict[str, tuple] = {
        "outcome": ("point", np.array([record.outcome for record in records])),
        "reason": ("point", np.array([record.reason for record in records])),
    }
    none = (np.nan,) * len(STATISTICS)
    for name, about in _labels(store).items():
        values = np.array([record.statistics.get(name, none) for record in records])
        variables[name] = (("point", "statistic"), values, about)
    if plan.series:
        variables |= _series(store, points)
    coordinates = {"point": ("point", np.array(points)), "statistic": ("statistic", np.array(STATISTICS))}
    for path in plan.points[0]:
        values, about = column([point[path] for point in plan.points.values()])
        coordinates[path] = ("point", values[points], {"long_name": path} | about)
    about = {"source": f"kaneflex {kaneflex.__version__}", "scene": plan.scene.name, "study": plan.digest}
    return Labelled(variables, coordinates, about)


def _labels(store: Store) -> dict[str, dict[str, str]]:
    """Sensor -> attributes, sorted by name, so that the order in which points finished does not matter."""
    return {name: dict(zip(("units", "long_name"), store.labels[name], strict=True)) for name in sorted(store.labels)}


def _series(store: Store, points: Sequence[int]) -> dict[str, tuple]:
    found, variables = [store.series(point) for point in points], dict[str, tuple]()
    instants = max(len(entry.get("", ())) for entry in found)
    if not instants:
        return variables  # netCDF can't hold a dimension without length
    for name, about in {"": {"units": "s", "long_name": "time"}, **_labels(store)}.items():
        block = np.full((len(found), instants), np.nan)
        for row, entry in zip(block, found, strict=True):
            values = entry.get(name, ())
            row[: len(values)] = values
        variables[f"{name}_series" if name else "time"] = ("point", "instant"), block, about
    return variables


def column(values: Sequence[Value]) -> tuple[np.ndarray, dict[str, str]]:
    """Values of a parameter as an array, with their common unit; as texts if the units differ."""
    parts = [number_and_unit(value) for value in values]
    units = {unit for _, unit in filter(None, parts)}
    if None in parts or len(units) > 1:
        same = len({type(value) for value in values}) == 1
        return np.array(values if same else [str(value) for value in values]), {}
    if all(isinstance(value, int) for value in values):
        return np.array(values), {}
    (unit,) = units or {""}
    return np.array([number for number, _ in parts]), {"units": unit} if unit else {}


def write_netcdf(plan: Plan, store: Store, path: Path) -> None:
    """Write :func:`labelled` of all points as one netCDF file."""
    partial = path.with_name(f".{path.name}.partial")
    labelled(plan, store).to_netcdf(partial)
    partial.replace(path)
