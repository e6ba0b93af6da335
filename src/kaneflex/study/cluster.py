"""Solve chunks of a sweep on the workers of a Dask cluster (extra ``cluster``)."""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from kaneflex.scene import with_settings
from kaneflex.study.plan import Plan, file_places, names_file, setting
from kaneflex.study.records import Record, solve_chunk
from kaneflex.study.workers import Answer, Lost, Points, in_chunks
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, installed, told
from kaneflex.support.module_cache import cache_folder, is_module, keep, sources_digest

if TYPE_CHECKING:
    from distributed import Client, Future, WorkerPlugin

_RECOUNT = 2.0
"""Seconds between two counts of the workers."""
_CONNECTING = 10.0
"""Seconds to wait for the scheduler."""
_shipments: dict[str, Shipment] = {}
"""In a worker: received shipments, by the plan's digest."""


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
    with told("--scheduler", address), installed("distributed", "cluster", "distributed", "dask"):
        from distributed import Client
    try:
        return Client(address, timeout=_CONNECTING, set_as_default=False)
    except (OSError, ValueError) as error:
        cure = "Give the address that `dask scheduler` prints, like tcp://host:8786"
        raise SceneError("--scheduler", address, f"no scheduler answers there ({error})", cure) from None


class Shipment:
    """A plan without its points, with the modules and files that it needs."""

    def __init__(self, plan: Plan) -> None:
        self.digest = plan.digest
        self.plan = replace(plan, points={})
        self.maker = _maker()
        folder = cache_folder()
        self.modules = {
            path.name: path.read_bytes()
            for name, module in list(sys.modules.items())
            if name.startswith("kaneflex_") and (path := Path(module.__file__)).parent == folder
        }
        self.digests = {name: hashlib.sha256(data).hexdigest() for name, data in plan.files.items()}
        self.moved: dict[str, str] = {}

    def unpack(self) -> None:
        """In a worker: store the modules and files, after checking them against their digests."""
        if _maker() != self.maker:
            raise RuntimeError(f"it has kaneflex {' '.join(_maker())}, not {' '.join(self.maker)}")
        for name, data in self.modules.items():
            if not is_module(name, data):
                raise RuntimeError(f"the module {name} was changed in transfer")
            _keep(cache_folder() / name, data)
        for name, data in self.plan.files.items():
            digest = hashlib.sha256(data).hexdigest()
            if digest != self.digests[name]:
                raise RuntimeError(f"the file {name} was changed in transfer")
            place = cache_folder() / "files" / digest[:16] / Path(name).name
            _keep(place, data)
            self.moved[name] = str(place)
        places = {key: self.moved[file] for key, file in file_places(self.plan.scene.raw).items() if file in self.moved}
        scene = with_settings(self.plan.scene, [setting(key, file) for key, file in places.items()])
        self.plan = replace(self.plan, scene=scene, files={})
        _shipments[self.digest] = self

    def plan_of(self, points: Points) -> Plan:
        """The plan with these points; paths of files point to the worker's copies."""
        return self.plan.with_points({
            number: {path: self.moved.get(value, value) if names_file(path) else value for path, value in point.items()}
            for number, point in points.items()
        })  # fmt: skip


def _maker() -> tuple[str, str]:
    """Version of kaneflex and digest of its sources."""
    import kaneflex

    return kaneflex.__version__, sources_digest()


def _keep(path: Path, data: bytes) -> None:
    """Write a file if it is missing or differs."""
    if not path.exists() or path.read_bytes() != data:
        keep(path, data)


class Cluster:
    """A pool of Dask workers. Dask itself repeats the chunks of a lost worker elsewhere."""

    def __init__(self, plan: Plan, client: Client, address: str) -> None:
        self._client, self._address = client, address
        self._futures: set[Future] = set()
        self._counted, self._workers = -_RECOUNT, 1
        self._shipment = Shipment(plan)
        self._name = f"kaneflex-{plan.digest}"
        try:
            client.register_plugin(_delivery(self._shipment), name=self._name)
        except (RuntimeError, ImportError) as error:
            client.unregister_worker_plugin(self._name)
            cure = "Install the same kaneflex, from the same sources, on every worker"
            raise SceneError("--scheduler", address, f"a worker has another installation: {error}", cure) from error

    @property
    def workers(self) -> int:
        """Number of chunks that the cluster solves at a time: its workers' threads, at least one."""
        now = time.monotonic()
        if now - self._counted >= _RECOUNT:
            with _answering(self._address):
                self._counted, self._workers = now, max(1, sum(self._client.nthreads().values()))
        return self._workers

    def submit(self, points: Points) -> Future:
        with _answering(self._address):
            future = self._client.submit(_solve, self._shipment.digest, points, pure=False)
        self._futures.add(future)
        return future

    def finished(self) -> Iterator[tuple[Future, Callable[[], Answer]]]:
        from distributed import wait

        with _answering(self._address), self._client.as_current():
            done = wait(self._futures, return_when="FIRST_COMPLETED").done
        self._futures -= done
        for future in done:
            yield future, lambda future=future: _answer(future, self._address)

    def close(self) -> None:
        if self._client.status != "running":
            return  # without a scheduler there is nothing to cancel
        with suppress(SceneError), _answering(self._address):
            self._client.cancel(list(self._futures))
            self._client.unregister_worker_plugin(self._name)


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


def _delivery(shipment: Shipment) -> WorkerPlugin:
    """Dask plugin that unpacks a shipment on every worker before its first chunk, including workers that join later."""
    from distributed import WorkerPlugin

    class Delivery(WorkerPlugin):
        def setup(self, worker: object) -> None:
            shipment.unpack()

        def teardown(self, worker: object) -> None:
            _shipments.pop(shipment.digest, None)

    return Delivery()


def _answer(future: Future, address: str) -> Answer:
    from distributed import KilledWorker

    try:
        with _answering(address):
            return future.result()
    except KilledWorker as error:
        raise Lost from error


def _solve(digest: str, points: Points) -> Answer:
    return solve_chunk(_shipments[digest].plan_of(points))
