"""A pool of worker processes for basins and studies, which can be stopped, killed and built anew."""

# The pool is built on the standard library. With pebble 5.2.3, a call whose process dies as it begins may never end (2
# of 150 did not), which hangs a study. With loky 3.7.0, a second Ctrl-C leaves processes behind, and the death of a
# process fails all calls, as it does here.
from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from hbbogie.errors import ModelError
from hbbogie.parallel.processes import cores, one_thread_each, start_worker, starting

P = ParamSpec("P")
T = TypeVar("T")
FEW = 64  # processes that any machine may start
GUARD = 'if __name__ == "__main__":'


class Pool:
    """Worker processes for calls. When one of them dies, all running calls fail with `BrokenProcessPool`."""

    def __init__(self, count: int):
        context = multiprocessing.get_context("spawn")  # a fork would copy the threads of BLAS in an undefined state
        self.count, self._stop = count, context.Event()
        self._build = lambda: ProcessPoolExecutor(count, context, start_worker, (self._stop,))
        self._executor = self._build()

    def start(self) -> None:
        """Start all processes; raise `ModelError` if they end at once."""
        answers = [self.submit(os.getpid) for _ in range(self.count)]
        if isinstance(answers[0].exception(), BrokenProcessPool):
            raise ModelError(
                "the worker processes end as soon as they start; see their output above. In a script, put the call "
                f"below: {GUARD}"
            )

    def submit(self, function: Callable[P, T], /, *args: P.args, **keywords: P.kwargs) -> Future[T]:
        """Return the future of a call. If the pool has just broken, the future reports this.

        The data of a call are sent with it. Data sent at the start of a process would block this process if the new
        one ended before reading them.
        """
        try:
            with starting():
                return self._executor.submit(function, *args, **keywords)
        except BrokenProcessPool as error:
            future: Future[T] = Future()
            future.set_exception(error)
            return future

    def renew(self) -> None:
        """Replace the processes of a pool that broke; raise `ModelError` if the new ones end at once."""
        self._executor.shutdown(wait=False, cancel_futures=True)
        self._executor = self._build()
        self.start()

    def stop(self) -> None:
        """Tell the workers to stop (`told_to_stop`); a pool with cancelled futures would not survive `kill`."""
        self._stop.set()

    def kill(self) -> None:
        """End the processes at once."""
        for process in list((getattr(self._executor, "_processes", None) or {}).values()):
            process.kill()

    def close(self) -> None:
        """End the processes when they have done what they are doing."""
        self._executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def worker_pool(count: int) -> Iterator[Pool]:
    """Provide a pool of running processes, each with one thread for linear algebra, and close it at the end.

    Raises
    ------
    ModelError
        When the processes end as soon as they start, this process is still importing its script, or they are too many.
    """
    most = max(FEW, 4 * cores())
    if count > most:
        raise ModelError(
            f"workers: got {count}; give at most {most} processes on these {cores()} cores. For more, run a study on a "
            "cluster (scheduler=, --scheduler)."
        )
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise ModelError(f"put the call below: {GUARD} (worker processes import the script).")
    with one_thread_each():
        pool = Pool(count)
        try:
            pool.start()
            yield pool
        finally:
            pool.close()
