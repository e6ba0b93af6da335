"""Distribution of points over the workers of an executor in chunks of about a second, and processes of this machine."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from kaneflex.scene import with_settings
from kaneflex.study.plan import Plan, file_places, names_file, setting
from kaneflex.study.records import FAILED, Record, solve_chunk, solve_points
from kaneflex.study.study import Point, number_and_unit
from kaneflex.support.arguments import takes
from kaneflex.support.module_cache import cache_folder, keep, sources_digest

SECONDS = 1.0
"""Target duration of a chunk: long compared with sending it, short compared with what an interruption loses."""
_TRIES = 3
"""Number of workers that may die on a point before it is given up."""
DIED = f"its worker process died {_TRIES} times: killed, or out of memory"

Points = dict[int, Point]
Answer = tuple[list[Record], float]
"""Records of a chunk, and the seconds that they took."""


class Lost(Exception):
    """The worker of a chunk died."""


@dataclass(frozen=True)
class Sent:
    """A plan without its points, as workers get it with every chunk: equal ones are unpacked once.

    ``maker``: version and sources of the kaneflex that sends it.
    """

    digest: str
    maker: str
    plan: Plan = field(compare=False)


class Pool:
    """Chunks of a plan in an executor, which is started again after a worker's death has broken it.

    ``workers``: how many chunks it solves at a time; ``died``: error of a chunk whose worker died.
    """

    workers: int = 1
    died: type[Exception] = BrokenExecutor

    def __init__(self, plan: Plan, files: Mapping[str, bytes], start: Callable[[], Executor]) -> None:
        self._sent = Sent(plan.digest, _maker(), replace(plan, points={}, files=files))
        self._start, self._executor = start, start()

    def submit(self, points: Points) -> Future[Answer]:
        """Begin a chunk."""
        try:
            return self._executor.submit(solve_sent, self._sent, points)
        except BrokenExecutor:
            self._executor.shutdown()
            self._executor = self._start()
            return self._executor.submit(solve_sent, self._sent, points)

    def answer(self, future: Future[Answer]) -> Answer:
        """Result of a finished chunk. Raises Lost if its worker died."""
        try:
            return future.result()
        except self.died as error:
            raise Lost from error

    def close(self) -> None:
        """Stop all work."""
        self._executor.shutdown(cancel_futures=True)


def first_of_each_kind(plan: Plan, todo: Sequence[int]) -> list[int]:
    """First point of each set with the same equations: the same texts, switches and zero numbers."""
    first: dict[tuple[object, ...], int] = {}
    for point in todo:
        first.setdefault(tuple(_kind(path, value) for path, value in plan.points[point].items()), point)
    return list(first.values())


def _kind(path: str, value: object) -> object:
    number = number_and_unit(value)
    if number is not None:
        return number[0] == 0.0
    return None if names_file(path) else value


def in_chunks(plan: Plan, todo: Sequence[int], start: Callable[[Plan], Pool]) -> Generator[Record, None, None]:
    """Solve points on the workers of a pool.

    Points that may need other equations are solved here first: each is derived and compiled once, before workers start.
    """
    here = first_of_each_kind(plan, todo)
    yield from solve_points(plan, here)
    left = set(todo) - set(here)
    if not left:
        return
    pool = start(plan)
    try:
        yield from _through(plan, [point for point in todo if point in left], pool)
    finally:
        pool.close()


def _through(plan: Plan, todo: Sequence[int], pool: Pool) -> Generator[Record, None, None]:
    queue = Queue(todo)
    waiting: dict[Future[Answer], tuple[int, ...]] = {}
    while queue or waiting:
        while queue.ready(len(waiting), 2 * pool.workers):
            chunk = queue.take(pool.workers)
            waiting[pool.submit({point: plan.points[point] for point in chunk})] = chunk
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            chunk = waiting.pop(future)
            try:
                records, seconds = pool.answer(future)
            except Lost:
                for point in queue.lost(chunk):
                    yield Record(point, FAILED, DIED)
                continue
            queue.lasted(len(chunk), seconds)
            yield from records


class Queue:
    """Waiting points, handed out in chunks of about SECONDS, estimated from the finished ones.

    Points of a dead worker are repeated one at a time with no other work in progress: a dying process can end its
    neighbours' work, so that only a point that runs alone is known to be the cause.
    """

    def __init__(self, todo: Sequence[int]) -> None:
        self._todo = deque(todo)
        self._again: deque[int] = deque()
        self._tries: Counter[int] = Counter()
        self._alone = False  # whether the last chunk taken is a repetition
        self._seconds: float | None = None  # per point

    def __bool__(self) -> bool:
        return bool(self._todo or self._again)

    def ready(self, waiting: int, most: int) -> bool:
        """True if a chunk may be taken while ``waiting`` chunks are in progress, ``most`` at a time."""
        return bool(self) and waiting < (1 if self._alone or self._again else most)

    def take(self, workers: int) -> tuple[int, ...]:
        """Next chunk: a single point until times are known, and at most a fair share of the rest."""
        self._alone = bool(self._again)
        if self._alone:
            return (self._again.popleft(),)
        size = 1 if self._seconds is None else int(SECONDS / max(self._seconds, 1e-6))
        size = max(1, min(size, len(self._todo) // (2 * workers)))
        return tuple(self._todo.popleft() for _ in range(size))

    def lasted(self, points: int, seconds: float) -> None:
        """Record the duration of a finished chunk."""
        self._seconds = seconds / points

    def lost(self, chunk: tuple[int, ...]) -> list[int]:
        """Queue the points of a dead worker's chunk again; returns those that are given up."""
        self._tries.update(chunk)
        given_up = [point for point in chunk if self._tries[point] >= _TRIES]
        self._again.extend(point for point in chunk if self._tries[point] < _TRIES)
        return given_up


ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Set to 1 for workers, unless set already: there is one process per core."""


@takes(workers="whole")
def in_processes(workers: int) -> Callable[[Plan, Sequence[int]], Generator[Record, None, None]]:
    """Solver that runs points in ``workers`` processes of this machine."""

    def solve(plan: Plan, todo: Sequence[int]) -> Generator[Record, None, None]:
        yield from in_chunks(plan, todo, lambda plan: Processes(plan, workers))

    return solve


class Processes(Pool):
    """A pool of processes; the death of one of them ends all."""

    def __init__(self, plan: Plan, workers: int) -> None:
        self.workers = workers
        # spawn: a fork of a process with threads can deadlock
        context = multiprocessing.get_context("spawn")
        super().__init__(plan, {}, lambda: ProcessPoolExecutor(workers, context, initializer=_prepare))

    def submit(self, points: Points) -> Future[Answer]:
        with _one_thread():
            return super().submit(points)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Set ONE_THREAD in the environment of processes started within, before they import numerical libraries."""
    ours = [name for name in ONE_THREAD if name not in os.environ]
    os.environ.update(dict.fromkeys(ours, "1"))
    try:
        yield
    finally:
        for name in ours:
            del os.environ[name]


def _prepare() -> None:
    # Ctrl-C goes to all processes of the terminal; only the main process, which keeps the journal, handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End a worker whose parent process was killed, which would wait for ever."""
    multiprocessing.parent_process().join()
    os._exit(1)


def solve_sent(sent: Sent, points: Points) -> Answer:
    """In a worker: solve a chunk. Raises RuntimeError if the worker has another kaneflex."""
    plan, places = _unpacked(sent)
    return solve_chunk(plan.with_points({
        number: {path: places.get(value, value) if names_file(path) else value for path, value in point.items()}
        for number, point in points.items()
    }))  # fmt: skip


@lru_cache(1)
def _unpacked(sent: Sent) -> tuple[Plan, dict[str, str]]:
    """The plan with its files in the worker's cache folder, and their places there."""
    if _maker() != sent.maker:
        raise RuntimeError(f"it has kaneflex {_maker()}, not {sent.maker}")
    plan, places = sent.plan, dict[str, str]()
    for name, data in plan.files.items():
        place = cache_folder() / "files" / hashlib.sha256(data).hexdigest()[:16] / Path(name).name
        if not place.exists() or place.read_bytes() != data:
            keep(place, data)
        places[name] = str(place)
    own = [setting(key, places[file]) for key, file in file_places(plan.scene.raw).items() if file in places]
    return replace(plan, scene=with_settings(plan.scene, own), files={}) if own else plan, places


def _maker() -> str:
    """Version of kaneflex and digest of its sources."""
    import kaneflex

    return f"{kaneflex.__version__} {sources_digest()}"
