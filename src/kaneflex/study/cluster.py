"""Solve chunks of a sweep on the workers of a Dask cluster (extra ``cluster``)."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from typing import TYPE_CHECKING

from kaneflex.study.plan import Plan
from kaneflex.study.records import Record
from kaneflex.study.workers import Answer, Points, Pool, in_chunks
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, installed, naming

if TYPE_CHECKING:
    from distributed import Client

_RECOUNT = 2.0
"""Seconds between two counts of the workers."""
_CONNECTING = 10.0
"""Seconds to wait for the scheduler."""


@takes(address="text")
def on_cluster(address: str) -> Callable[[Plan, Sequence[int]], Generator[Record, None, None]]:
    """Solver that runs points on the workers of the Dask scheduler at this address.

    Raises
    ------
    SceneError
        If distributed is not installed, the scheduler doesn't answer, or a worker has another kaneflex.
    """
    client = _connected(address)

    def solve(plan: Plan, todo: Sequence[int]) -> Generator[Record, None, None]:
        with client:
            yield from in_chunks(plan, todo, lambda plan: Cluster(plan, client, address))

    return solve


def _connected(address: str) -> Client:
    with naming("--scheduler", address), installed("distributed", "cluster", "distributed", "dask"):
        from distributed import Client
    try:
        return Client(address, timeout=_CONNECTING, set_as_default=False)
    except (OSError, ValueError) as error:
        cure = "Give the address that `dask scheduler` prints, like tcp://host:8786"
        raise SceneError("--scheduler", address, f"no scheduler answers there ({error})", cure) from None


class Cluster(Pool):
    """A pool of Dask workers. Dask itself repeats the chunks of a lost worker elsewhere."""

    def __init__(self, plan: Plan, client: Client, address: str) -> None:
        from distributed import KilledWorker

        self._client, self._address, self.died = client, address, KilledWorker
        self._counted = -_RECOUNT
        super().__init__(plan, plan.files, lambda: client.get_executor(pure=False))

    def submit(self, points: Points) -> Future[Answer]:
        with _answering(self._address):
            now = time.monotonic()
            if now - self._counted >= _RECOUNT:  # their threads, of which there may be none yet
                self._counted, self.workers = now, max(1, sum(self._client.nthreads().values()))
            return super().submit(points)

    def answer(self, future: Future[Answer]) -> Answer:
        try:
            with _answering(self._address):
                return super().answer(future)
        except (RuntimeError, ImportError) as error:
            cure = "Install the same kaneflex, from the same sources, on every worker"
            reason = f"a worker has another installation: {error}"
            raise SceneError("--scheduler", self._address, reason, cure) from error

    def close(self) -> None:
        if self._client.status == "running":  # without a scheduler there is nothing to cancel
            self._executor.shutdown(wait=False)


@contextmanager
def _answering(address: str) -> Iterator[None]:
    """Turn the various errors that Dask raises when its scheduler is lost into one SceneError."""
    from distributed import CancelledError
    from distributed.client import ClosedClientError

    try:
        yield
    except (CancelledError, ClosedClientError, OSError) as error:
        cure = "Start a scheduler and repeat the command: finished points are kept"
        raise SceneError("--scheduler", address, "the connection to the scheduler is lost", cure) from error
