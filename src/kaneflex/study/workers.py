"""Distribution of points over workers in chunks of about a second, and worker processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from typing import Protocol

from kaneflex.study.plan import Plan, names_file
from kaneflex.study.records import FAILED, Record, solve_chunk, solve_points
from kaneflex.study.study import Point, number_and_unit
from kaneflex.support.arguments import takes

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


class Pool(Protocol):
    """Workers that solve chunks."""

    workers: int

    def submit(self, points: Points) -> Hashable:
        """Begin a chunk; returns its key."""

    def finished(self) -> Iterable[tuple[Hashable, Callable[[], Answer]]]:
        """Wait until a chunk is finished; pairs of its key and a function that returns the answer or raises Lost."""

    def close(self) -> None:
        """Stop all work."""


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
    waiting: dict[Hashable, Sequence[int]] = {}
    while queue or waiting:
        while queue.ready(len(waiting), 2 * pool.workers):
            chunk = queue.take(pool.workers)
            waiting[pool.submit({point: plan.points[point] for point in chunk})] = chunk
        for key, answer in pool.finished():
            chunk = waiting.pop(key)
            try:
                records, seconds = answer()
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
_own: Plan | None = None
"""In a worker: the plan without its points."""


@takes(workers="whole")
def in_processes(workers: int) -> Callable[[Plan, Sequence[int]], Generator[Record, None, None]]:
    """Solver that runs points in ``workers`` processes of this machine."""

    def solve(plan: Plan, todo: Sequence[int]) -> Generator[Record, None, None]:
        yield from in_chunks(plan, todo, lambda plan: Processes(plan, workers))

    return solve


class Processes:
    """A pool of processes, restarted when one of them dies, since the executor then ends all of them."""

    def __init__(self, plan: Plan, workers: int) -> None:
        self.workers = workers
        self._plan = replace(plan, points={}, files={})
        self._futures: set[Future[Answer]] = set()
        self._executor = self._started()

    def _started(self) -> ProcessPoolExecutor:
        # spawn: a fork of a process with threads can deadlock
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.workers, context, initializer=_prepare, initargs=(self._plan,))

    def submit(self, points: Points) -> Future[Answer]:
        with _one_thread():
            try:
                future = self._executor.submit(_solve, points)
            except BrokenProcessPool:
                self._executor.shutdown()
                self._executor = self._started()
                future = self._executor.submit(_solve, points)
        self._futures.add(future)
        return future

    def finished(self) -> Iterator[tuple[Future[Answer], Callable[[], Answer]]]:
        done, self._futures = wait(self._futures, return_when=FIRST_COMPLETED)
        for future in done:
            yield future, lambda future=future: _answer(future)

    def close(self) -> None:
        self._executor.shutdown(cancel_futures=True)


def _answer(future: Future[Answer]) -> Answer:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise Lost from error


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


def _prepare(plan: Plan) -> None:
    global _own
    # Ctrl-C goes to all processes of the terminal; only the main process, which keeps the journal, handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _own = plan


def _end_with_parent() -> None:
    """End a worker whose parent process was killed, which would wait for ever."""
    multiprocessing.parent_process().join()
    os._exit(1)


def _solve(points: Points) -> Answer:
    return solve_chunk(_own.with_points(points))
