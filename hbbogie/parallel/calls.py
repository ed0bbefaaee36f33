"""Independent parts of one computation, done by several processes where that is asked for."""

from __future__ import annotations

import functools
import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from typing import Any

from hbbogie.deadline import time_left, time_limit
from hbbogie.errors import ModelError, whole
from hbbogie.parallel.pool import Pool, worker_pool
from hbbogie.parallel.processes import LOOK, interruptions
from hbbogie.progress import Progress, silent


class _Processes:
    """The processes asked for, which start when the first work comes."""

    def __init__(self, count: int, stack: ExitStack):
        self.count, self._stack = count, stack

    @functools.cached_property
    def pool(self) -> Pool:
        return self._stack.enter_context(worker_pool(self.count))


_asked: ContextVar[_Processes | None] = ContextVar("processes", default=None)


@contextmanager
def in_processes(workers: int) -> Iterator[None]:
    """Let several processes do the independent parts of the work inside; what is asked for around this holds for 1.

    Parameters
    ----------
    workers : int
        Number of processes, or 1 for this one alone.

    Raises
    ------
    ModelError
        Unless the number is a whole one from 1, and when as many processes cannot be started.
    """
    if whole("workers (1 for this process alone)", workers) == 1:
        yield
        return
    with ExitStack() as stack:
        token = _asked.set(_Processes(workers, stack))
        try:
            yield
        finally:
            _asked.reset(token)


def processes_asked() -> int:
    """Return how many processes do independent parts here; 1 for this one alone."""
    asked = _asked.get()
    return 1 if asked is None else asked.count


def each(
    function: Callable[..., Any],
    common: Any,
    tasks: Sequence[tuple[Any, ...]],
    progress: Progress = silent,
    message: str = "",
) -> list[Any]:
    """Return ``function(common, *task, progress)`` of each task, in their order, by the processes asked for.

    Parameters
    ----------
    function : callable
        Of a module, so that it can be pickled, as must be what it takes and returns.
    common : object
        What all tasks take; it is sent once.
    tasks : sequence of tuple
    progress : callable
        Called with (message, share of the tasks done). In this process it is what the function gets.
    message : str
        Nothing is said where it is empty.

    Raises
    ------
    ModelError
        When a process was ended from outside.
    """
    asked = _asked.get()
    if asked is None or len(tasks) < 2:
        found = []
        for k, task in enumerate(tasks):
            if message:
                progress(message, k / len(tasks))
            found.append(function(common, *task, progress))
        return found
    owner = sys.modules[function.__module__.partition(".")[0]]
    payload = pickle.dumps(owner if hasattr(owner, "__source_hash__") else None), pickle.dumps((function, common))
    with interruptions() as pressed:
        pool = asked.pool
        futures = [pool.submit(_call, payload, time_left(), task) for task in tasks]
        waiting = set(futures)
        say = progress if message else silent
        say(message, 0.0)
        try:
            while waiting and not pressed():
                finished, waiting = wait(waiting, LOOK, FIRST_COMPLETED)
                if finished:
                    say(message, 1 - len(waiting) / len(futures))
        finally:
            if waiting:
                pool.kill()
        if pressed():
            raise KeyboardInterrupt
    try:
        return [future.result() for future in futures]
    except BrokenProcessPool:
        raise ModelError("a worker process was ended, perhaps for want of memory; take fewer workers.") from None


@functools.lru_cache(maxsize=2)
def _unpacked(payload: tuple[bytes, bytes]) -> tuple[Callable[..., Any], Any]:
    owner, job = payload
    pickle.loads(owner)  # loads the problem that the function is part of
    unpacked: tuple[Callable[..., Any], Any] = pickle.loads(job)
    return unpacked


def _call(payload: tuple[bytes, bytes], left: float | None, task: tuple[Any, ...]) -> Any:
    function, common = _unpacked(payload)
    with time_limit(left):
        return function(common, *task, silent)
