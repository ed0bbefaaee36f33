"""Where the points of a study run: on a user's executor, a Dask cluster, a local pool, or in this process."""

from __future__ import annotations

import concurrent.futures as cf
import os
import sys
import threading
import time
import uuid
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from hbbogie.errors import ModelError
from hbbogie.parallel.pool import Pool, worker_pool
from hbbogie.parallel.processes import cores
from hbbogie.studies.optional import required
from hbbogie.studies.tasks import Item, Outcome, Task, run_points, stop_study

EVERY_CLUSTER = 2.0  # s between two looks at the workers of a cluster
AHEAD = 16  # points in flight on a cluster, at least
Promise = cf.Future[list[Outcome]]  # of the outcomes of points that were submitted together


class Runner:
    """Submits points to an executor that its user owns.

    Attributes
    ----------
    here : bool
        Whether points are done in the thread that submits them.
    """

    here = False

    def __init__(self, payload: bytes | Task, executor: cf.Executor | Pool, window: int):
        self.payload, self.executor, self.window = payload, executor, window

    def room(self) -> int:
        """Return how many points, or groups of points done together, may be in flight."""
        return self.window

    def submit(self, items: Sequence[Item]) -> Promise:
        """Submit some points; raise `ModelError` where the executor takes none any more."""
        try:
            return self._submit(items)
        except RuntimeError as error:  # also that it is broken
            raise lost_executor() from error

    def _submit(self, items: Sequence[Item]) -> Promise:
        return self.executor.submit(run_points, self.payload, items)

    def renew(self, error: cf.BrokenExecutor) -> None:
        """Go on after an executor has lost a process, or raise `ModelError`."""
        raise ModelError("the executor given is broken: one of its processes died; resume with a new one.") from error

    def cancel(self, flying: Iterable[Promise]) -> None:
        """Begin no further point."""
        for future in flying:
            future.cancel()

    def kill(self) -> None:
        """Drop what is in flight, as far as that can be done."""


class _Cluster(Runner):
    """Submits points to the workers of a Dask scheduler, which come and go."""

    def __init__(self, payload: bytes | Task, client: Any):
        self.client, self.looked, self.study = client, 0.0, uuid.uuid4().hex
        super().__init__(payload, client.get_executor(), AHEAD)

    def _submit(self, items: Sequence[Item]) -> Promise:
        return self.executor.submit(run_points, self.payload, items, self.study)

    def cancel(self, flying: Iterable[Promise]) -> None:
        """Begin no further point; the workers are told, as Dask gives up also running points that are cancelled."""

        def tell() -> None:
            with suppress(Exception):  # also of a client that has been closed meanwhile
                self.client.run(stop_study, self.study, on_error="ignore")

        threading.Thread(target=tell, daemon=True).start()  # answered when the worker's interpreter is free

    def room(self) -> int:
        """Return how many points may be in flight: several for each thread of the workers there are now."""
        if time.monotonic() - self.looked > EVERY_CLUSTER:
            self.window = max(4 * sum(self.client.nthreads().values()), AHEAD)
            self.looked = time.monotonic()
        return self.window


class _Local(Runner):
    """Submits points to a pool of local processes, which is built anew when it breaks."""

    def __init__(self, payload: bytes | Task, pool: Pool):
        self.pool = pool
        super().__init__(payload, pool, 2 * pool.count)

    def renew(self, error: cf.BrokenExecutor) -> None:
        """Take other processes for those that broke."""
        self.pool.renew()

    def cancel(self, flying: Iterable[Promise]) -> None:
        """Begin no further point."""
        self.pool.stop()

    def kill(self) -> None:
        """End the processes at once."""
        self.pool.kill()


class _Here(Runner):
    """Does each point when it is submitted, in this process."""

    here = True

    def __init__(self, task: Task):
        super().__init__(task, cf.Executor(), 1)

    def submit(self, items: Sequence[Item]) -> Promise:
        """Do some points."""
        future: Promise = cf.Future()
        future.set_result(run_points(self.payload, items))
        return future


@contextmanager
def runner_of(task: Task, executor: cf.Executor | None, workers: int | None, scheduler: str | None) -> Iterator[Runner]:
    """Give the runner of an executor, of a Dask scheduler or of a local pool, and clean up behind it."""
    if scheduler is not None:
        distributed = required("distributed")
        try:
            client = distributed.Client(scheduler, timeout=5, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ModelError(
                f"no Dask scheduler answers at {scheduler!r} ({error}); start one with: dask scheduler."
            ) from error
        with client:
            if not client.nthreads():
                text = (
                    f"no worker has joined the scheduler yet, waiting for one; start some with: dask worker {scheduler}"
                )
                print(text, file=sys.stderr, flush=True)
            yield _Cluster(task.packed(by_value=True), client)
        return
    if executor is not None:
        window = 4 * int(getattr(executor, "_max_workers", 0) or os.cpu_count() or 1)
        yield Runner(task.packed(by_value=True), executor, window)
        return
    if workers == 0:
        yield _Here(task)
        return
    with worker_pool(workers or cores()) as pool:
        yield _Local(task.packed(), pool)


def lost_executor() -> ModelError:
    """Return the error of an executor that does nothing any more."""
    return ModelError("the executor was shut down or lost its workers; what is finished is stored, resume.")
