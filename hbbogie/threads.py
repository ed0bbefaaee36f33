"""One thread for linear algebra: the matrices here are too small for more, which only wait for each other.

On a machine whose cores are busy, waiting threads make work take many times longer.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock, get_ident
from typing import Any


class _Owner:
    """The thread whose blocks set the number, which is one for the whole process; those of others leave it alone."""

    def __init__(self) -> None:
        self.lock, self.thread, self.depth = Lock(), 0, 0
        self.before: Any = None

    def begin(self) -> None:
        with self.lock:
            if not self.depth:
                self.thread, self.before = get_ident(), _libraries().limit(limits=1, user_api="blas")
            if self.thread == get_ident():
                self.depth += 1

    def end(self) -> None:
        with self.lock:
            if self.depth and self.thread == get_ident():
                self.depth -= 1
                if not self.depth:
                    self.before.restore_original_limits()


_owner = _Owner()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let linear algebra use one thread inside, and as many as before after; also a decorator.

    The number holds for the whole process. The thread that begins first sets it and restores it.
    """
    _owner.begin()
    try:
        yield
    finally:
        _owner.end()


@cache
def _libraries() -> Any:
    """Return the libraries of linear algebra that NumPy and SciPy use, each with its own threads."""
    import scipy.linalg  # noqa: F401  # its library is among those found only when loaded
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
