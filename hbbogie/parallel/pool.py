"""One pool of worker processes for basins and studies: it can be told to stop, killed, and built anew."""

# On the standard library: with pebble 5.2.3 a call whose process dies as it begins may never end (2 of 150 did not),
# which hangs a study; with loky 3.7.0 a second Ctrl-C leaves processes behind, and a death fails all calls as here.
from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from hbbogie.errors import ModelError
from hbbogie.parallel.processes import one_thread_each, start_worker, starting

P = ParamSpec("P")
T = TypeVar("T")
GUARD = 'if __name__ == "__main__":'


class Pool:
    """Worker processes that do calls; when one of them dies, all calls in flight fail with `BrokenProcessPool`."""

    def __init__(self, count: int):
        context = multiprocessing.get_context("spawn")  # a fork would copy the threads of BLAS in whatever state
        self.count, self._stop = count, context.Event()
        self._build = lambda: ProcessPoolExecutor(count, context, start_worker, (self._stop,))
        self._executor = self._build()

    def start(self) -> None:
        """Start all processes; raise `ModelError` where they end at once."""
        answers = [self.submit(os.getpid) for _ in range(self.count)]
        if isinstance(answers[0].exception(), BrokenProcessPool):
            raise ModelError(
                "the worker processes end as soon as they start; see what they print above. In a script the call "
                f"stands below: {GUARD}"
            )

    def submit(self, function: Callable[P, T], /, *args: P.args, **keywords: P.kwargs) -> Future[T]:
        """Return the future of a call; that of a pool that has just broken says so.

        What a call needs goes with it: what is handed over at the start of a process blocks this one where that ends
        before it has read.
        """
        try:
            with starting():
                return self._executor.submit(function, *args, **keywords)
        except BrokenProcessPool as error:
            future: Future[T] = Future()
            future.set_exception(error)
            return future

    def renew(self) -> None:
        """Start other processes for those of a pool that broke; raise `ModelError` where they end at once."""
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
    """Give a pool of processes that have started, each with one thread for linear algebra, and close it.

    Raises
    ------
    ModelError
        Where the processes end as soon as they start, or this one is still importing its script.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise ModelError(f"put the call below: {GUARD} (worker processes import the script).")
    with one_thread_each():
        pool = Pool(count)
        try:
            pool.start()
            yield pool
        finally:
            pool.close()
