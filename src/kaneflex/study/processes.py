"""Processes of this machine that solve chunks of a sweep."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace

from kaneflex.study.chunks import Answer, Lost, Points, in_chunks
from kaneflex.study.plan import Plan
from kaneflex.study.records import Record, solve_chunk

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Set to 1 for workers, unless they are set already: there is a process for each core."""
_own: Plan | None = None
"""In a worker: the plan without its points."""


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
    return solve_chunk(replace(_own, points=points))
