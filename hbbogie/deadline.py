"""Limits of time: work looks whether its time is over and ends with what it has found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from math import inf
from time import monotonic

from hbbogie.errors import positive

MOMENT = 1e-9  # s
_end: ContextVar[float] = ContextVar("end", default=inf)  # each thread has its own


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Let the work inside end after so many seconds; a limit around this one holds as well.

    Parameters
    ----------
    seconds : float or None, s
        No limit of its own where None.

    Raises
    ------
    ModelError
        Unless the limit is a finite number above 0.
    """
    end = inf if seconds is None else monotonic() + positive("limit", seconds, "s")
    token = _end.set(min(end, _end.get()))
    try:
        yield
    finally:
        _end.reset(token)


def time_is_over() -> bool:
    """Tell whether a limit of time around the caller is over."""
    return monotonic() > _end.get()


def time_left() -> float | None:
    """Return the time [s] to the limit around the caller, a moment where it is over; None without one."""
    return None if _end.get() == inf else max(_end.get() - monotonic(), MOMENT)
