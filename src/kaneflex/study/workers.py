"""Many points on many workers: chunks that last about a second, and processes of this machine that solve them."""

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
"""What a chunk is to last: long against sending it, short against what an interruption loses."""
_TRIES = 3
"""Workers that may die over a point before it is given up."""
DIED = f"the process that solved it died, {_TRIES} times: killed, or out of memory"

Points = dict[int, Point]
Answer = tuple[list[Record], float]
"""Records of a chunk and the seconds that they took."""


class Lost(Exception):
    """The worker of a chunk died."""


class Pool(Protocol):
    """Workers that solve chunks."""

    workers: int

    def submit(self, points: Points) -> Hashable:
        """Begin a chunk; what stands for it until it is finished."""

    def finished(self) -> Iterable[tuple[Hashable, Callable[[], Answer]]]:
        """Wait until something is finished: each with what gives its answer or raises Lost."""

    def close(self) -> None:
        """End, whatever is under way."""


def first_of_each_kind(plan: Plan, todo: Sequence[int]) -> list[int]:
    """Points that may differ in the equations: by texts, by switches, and by which numbers are zero."""
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

    Those that may need equations of their own come first and are solved here: they are derived and compiled once,
    before a worker starts.
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
    """Points that wait, handed out in chunks that last about SECONDS by what the finished ones took.

    Those whose worker died come again one by one and with nothing beside them: the death of one process can take
    what others compute along, so that only a point that is alone is known to be the cause.
    """

    def __init__(self, todo: Sequence[int]) -> None:
        self._todo = deque(todo)
        self._again: deque[int] = deque()
        self._tries: Counter[int] = Counter()
        self._alone = False  # whether what was taken last came again
        self._seconds: float | None = None  # of a point

    def __bool__(self) -> bool:
        return bool(self._todo or self._again)

    def ready(self, waiting: int, most: int) -> bool:
        """Whether a chunk may be taken while so many are under way, of `most` at a time."""
        return bool(self) and waiting < (1 if self._alone or self._again else most)

    def take(self, workers: int) -> tuple[int, ...]:
        """The next chunk: one point as long as nothing is known, and no more than a fair share of the rest."""
        self._alone = bool(self._again)
        if self._alone:
            return (self._again.popleft(),)
        size = 1 if self._seconds is None else int(SECONDS / max(self._seconds, 1e-6))
        size = max(1, min(size, len(self._todo) // (2 * workers)))
        return tuple(self._todo.popleft() for _ in range(size))

    def lasted(self, points: int, seconds: float) -> None:
        """A chunk of so many points is finished."""
        self._seconds = seconds / points

    def lost(self, chunk: tuple[int, ...]) -> list[int]:
        """A chunk whose worker died: its points come again; returned are those that are given up."""
        self._tries.update(chunk)
        given_up = [point for point in chunk if self._tries[point] >= _TRIES]
        self._again.extend(point for point in chunk if self._tries[point] < _TRIES)
        return given_up


ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Set to 1 for workers, unless they are set already: there is a process for each core."""
_own: Plan | None = None
"""In a worker: the plan without its points."""


@takes(workers="whole")
def in_processes(workers: int) -> Callable[[Plan, Sequence[int]], Generator[Record, None, None]]:
    """Solves points in so many processes of this machine."""

    def solve(plan: Plan, todo: Sequence[int]) -> Generator[Record, None, None]:
        yield from in_chunks(plan, todo, lambda plan: Processes(plan, workers))

    return solve


class Processes:
    """A pool of processes, started anew when one of them dies: the executor then gives all of them up."""

    def __init__(self, plan: Plan, workers: int) -> None:
        self.workers = workers
        self._plan = replace(plan, points={}, files={})
        self._futures: set[Future[Answer]] = set()
        self._executor = self._started()

    def _started(self) -> ProcessPoolExecutor:
        # spawn: a forked copy of a process that has threads can lock itself
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
    """Processes started within find ONE_THREAD in their environment, before they import what reads it."""
    ours = [name for name in ONE_THREAD if name not in os.environ]
    os.environ.update(dict.fromkeys(ours, "1"))
    try:
        yield
    finally:
        for name in ours:
            del os.environ[name]


def _prepare(plan: Plan) -> None:
    global _own
    # Ctrl-C goes to every process of the terminal; only the one that keeps the journal is to act on it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _own = plan


def _end_with_parent() -> None:
    """A worker of a sweep that was killed would wait for its next chunk for ever."""
    multiprocessing.parent_process().join()
    os._exit(1)


def _solve(points: Points) -> Answer:
    return solve_chunk(_own.with_points(points))
