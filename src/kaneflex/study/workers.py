"""Distribution of points over processes of this machine, in chunks of about a second."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import replace

from kaneflex.study.plan import Plan, names_file
from kaneflex.study.records import FAILED, Record, solve_points
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
    """The process of a chunk died."""


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


def in_chunks(plan: Plan, todo: Sequence[int], start: Callable[[Plan], Processes]) -> Generator[Record, None, None]:
    """Solve points in the processes of a pool.

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


def _through(plan: Plan, todo: Sequence[int], pool: Processes) -> Generator[Record, None, None]:
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


class Processes:
    """Processes that solve chunks of a plan; the death of one ends all, and the next chunk starts them again."""

    def __init__(self, plan: Plan, workers: int) -> None:
        self.workers, self._plan = workers, replace(plan, points={}, files={})
        self._executor = self._start()

    def _start(self) -> ProcessPoolExecutor:
        # spawn: a fork of a process with threads can deadlock
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.workers, context, initializer=_prepare, initargs=(self._plan,))

    def submit(self, points: Points) -> Future[Answer]:
        """Begin a chunk."""
        with _one_thread():
            try:
                return self._executor.submit(_solve, points)
            except BrokenExecutor:
                self._executor.shutdown()
                self._executor = self._start()
                return self._executor.submit(_solve, points)

    def answer(self, future: Future[Answer]) -> Answer:
        """Result of a finished chunk. Raises Lost if its process died."""
        try:
            return future.result()
        except BrokenExecutor as error:
            raise Lost from error

    def close(self) -> None:
        """Stop all work."""
        self._executor.shutdown(cancel_futures=True)


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


_PLANS: list[Plan] = []
"""Plan of this process, without points; its models are reused from chunk to chunk."""


def _prepare(plan: Plan) -> None:
    """Begin a process: keep its plan, and end with its parent."""
    _PLANS.append(plan)
    # Ctrl-C goes to all processes of the terminal; only the main process, which keeps the journal, handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End a worker whose parent process was killed, which would wait for ever."""
    multiprocessing.parent_process().join()
    os._exit(1)


def _solve(points: Points) -> Answer:
    """Solve a chunk in this process."""
    started = time.perf_counter()
    return list(solve_points(_PLANS[0].with_points(points), list(points))), time.perf_counter() - started
