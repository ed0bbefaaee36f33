"""Worker processes: their number, one thread for linear algebra in each, Ctrl-C, and time limits."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
INSIST = 1.0  # s after which a KeyboardInterrupt that was lost is raised again
LOOK = 0.2  # s between two checks for Ctrl-C while waiting for other processes


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Limit processes started in this context to one thread for linear algebra each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@contextmanager
def starting() -> Iterator[None]:
    """Block Ctrl-C in processes started in this context, since it would kill them during their imports.

    The new processes inherit the blocked signal and call `start_worker` when they are ready. In this process, Ctrl-C is
    delivered at the end of the context.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # starting later would unblock the signal
    held: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    heard = before is not signal.SIG_IGN and threading.current_thread() is threading.main_thread()
    if heard:  # another thread may receive the signal, and an exception here would leave the executor's locks held
        signal.signal(signal.SIGINT, lambda number, frame: held.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if heard:
            signal.signal(signal.SIGINT, before)
        for number in held:
            signal.raise_signal(number)


_stops: list[Any] = []  # in a worker process: the event at which it is to stop


def start_worker(stop: Any) -> None:
    """Prepare a worker process: it ends with its parent, and leaves Ctrl-C to the parent, which sets ``stop``."""
    import multiprocessing

    _stops.append(stop)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()  # immediately if the parent has ended before this worker began
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def told_to_stop() -> bool:
    """Tell whether this is a worker process whose parent has set the event given to `start_worker`."""
    return any(stop.is_set() for stop in _stops)


def _again(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _insist() -> None:
    """Raise `KeyboardInterrupt` again each second, in case it is lost. A running time limit does this anyway."""
    if hasattr(signal, "setitimer") and not signal.getitimer(signal.ITIMER_REAL)[0]:
        signal.signal(signal.SIGALRM, _again)
        signal.setitimer(signal.ITIMER_REAL, INSIST, INSIST)


def _desist() -> None:
    if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGALRM) is _again:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)


class _Presses:
    """Handler that counts how often Ctrl-C is pressed and, on request, also raises `KeyboardInterrupt`."""

    def __init__(self, pressed: list[int], raising: bool):
        self.pressed, self.raising = pressed, raising

    def __call__(self, number: int, frame: object) -> None:
        self.pressed.append(number)
        if self.raising:
            _insist()
            raise KeyboardInterrupt


@contextmanager
def interruptions(raising: bool = False) -> Iterator[Callable[[], int]]:
    """Count how often Ctrl-C is pressed, instead of raising `KeyboardInterrupt` at any moment, or in addition to it.

    If that exception is raised inside the machinery of an executor, or just before the block that cleans up, it leaves
    locks held and processes running. Inside CasADi it may be lost or turn into another exception. For this reason
    presses are counted, starting from the count of an enclosing block, and the exception is raised again each second
    until this block ends. The count remains zero outside the main thread, where no signal arrives, and where Ctrl-C is
    ignored.

    Parameters
    ----------
    raising : bool
        Whether to raise `KeyboardInterrupt` as well.
    """
    before = signal.getsignal(signal.SIGINT)
    pressed = before.pressed if isinstance(before, _Presses) else []
    try:
        if before is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, _Presses(pressed, raising))
    except ValueError:  # not in the main thread
        yield lambda: 0
        return
    try:
        yield lambda: len(pressed)
    finally:
        if raising:
            _desist()
        signal.signal(signal.SIGINT, before)


class TimeLimit(BaseException):
    """A time limit has passed. Not an `Exception`, so that no code in between mistakes it for a failure of its own."""


@contextmanager
def limited(seconds: float | None) -> Iterator[Callable[[], bool]]:
    """Raise `TimeLimit` in a block that takes longer; yield a function that tells whether this has happened.

    It is raised where Python code runs or CasADi checks for interruptions, and again each second if the code continues.
    It has no effect on Windows and outside the main thread of a process.
    """
    here = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
    if seconds is None or not here:
        yield lambda: False
        return
    over: list[int] = []

    def late(number: int, frame: object) -> None:
        over.append(number)
        raise TimeLimit

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield lambda: bool(over)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
