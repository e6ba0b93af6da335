"""Folder of a sweep: journal of finished points, which survives interruptions, and the final dataset."""

from __future__ import annotations

import json
import os
import sys
import zlib
from base64 import b64decode, b64encode
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from kaneflex.study.plan import Plan
from kaneflex.study.records import STATISTICS, Record
from kaneflex.study.study import Value, number_and_unit
from kaneflex.support.errors import Fault, OutputError
from kaneflex.support.files import check_file, read_text, write_text, writing
from kaneflex.support.labelled import Labelled
from kaneflex.support.terminal import log_warning

STUDY_FILE, JOURNAL_FILE, LOCK_FILE = "study.json", "journal.jsonl", ".lock"
BEGIN_ANEW = "Restore it from a copy, choose another folder, or start again with --force"
"""Fix for a damaged file; kaneflex does not change it."""
RESULT_FILE = "sweep.nc"


@dataclass(frozen=True, eq=False)
class Store:
    """Finished points of a sweep. Made by :func:`open_store`.

    A point is finished when its line is in the journal.

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
        # times under the empty name, which no sensor can have
        series = {} if record.times is None else {"": record.times, **record.series}
        coded = {name: b64encode(np.ascontiguousarray(own, "<f8")).decode() for name, own in series.items()}
        line = {"point": record.point, "outcome": record.outcome, "reason": record.reason,
                "statistics": dict(record.statistics), "labels": new, "series": coded}  # fmt: skip
        with writing(self.folder), (self.folder / JOURNAL_FILE).open("ab") as journal:
            begin = journal.tell()
            journal.write(_checked(json.dumps(line)))
        self.finished[record.point] = begin
        self.labels.update(new)

    def records(self, points: Iterable[int]) -> Iterator[Record]:
        """Finished points of these numbers, without labels."""
        points = list(points)
        if not points:
            return
        with (self.folder / JOURNAL_FILE).open("rb") as journal:
            for point in points:
                journal.seek(self.finished[point])
                entry = json.loads(journal.readline())
                statistics = {name: tuple(values) for name, values in entry["statistics"].items()}
                series = {name: np.frombuffer(b64decode(text), "<f8") for name, text in entry["series"].items()}
                times = series.pop("", None)
                yield Record(point, entry["outcome"], entry["reason"], statistics, times=times, series=series)

    def close(self) -> None:
        """Delete the journal after the dataset is written."""
        (self.folder / JOURNAL_FILE).unlink()


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
    """Store of the points in the journal; an incomplete last line is cut off, points of damaged ones are computed
    again."""
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
            else:
                store.finished[entry["point"]] = begin
                store.labels.update({name: tuple(each) for name, each in entry["labels"].items()})
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
        variables |= _series(store, records)
    coordinates = {"point": ("point", np.array(points)), "statistic": ("statistic", np.array(STATISTICS))}
    for path in plan.points[0]:
        values, about = column([point[path] for point in plan.points.values()])
        coordinates[path] = ("point", values[points], {"long_name": path} | about)
    about = {"source": f"kaneflex {kaneflex.__version__}", "scene": plan.scene.name, "study": plan.digest}
    return Labelled(variables, coordinates, about)


def _labels(store: Store) -> dict[str, dict[str, str]]:
    """Sensor -> attributes, sorted by name, so that the order in which points finished does not matter."""
    return {name: dict(zip(("units", "long_name"), store.labels[name], strict=True)) for name in sorted(store.labels)}


def _series(store: Store, records: Sequence[Record]) -> dict[str, tuple]:
    instants, variables = max(0 if each.times is None else len(each.times) for each in records), dict[str, tuple]()
    found = {"time": ({"units": "s", "long_name": "time"}, [each.times for each in records])}
    for name, about in _labels(store).items():
        found[f"{name}_series"] = about, [each.series.get(name) for each in records]
    for name, (about, rows) in found.items() if instants else ():  # netCDF can't hold a dimension without length
        block = np.full((len(rows), instants), np.nan)
        for row, values in zip(block, rows, strict=True):
            row[: 0 if values is None else len(values)] = values
        variables[name] = ("point", "instant"), block, about
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
