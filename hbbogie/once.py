"""A store for things that are built once and shared by copies of a value. It is kept beside the value, not in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

T = TypeVar("T")


class Once:
    """A store that builds the entry for each key only once.

    Values that differ only in parameter values share one store. A pickled or deep copy begins with an empty store, and
    missing entries are built again.
    """

    def __init__(self) -> None:
        self._built: dict[Any, Any] = {}

    def __call__(self, key: Any, build: Callable[[], T]) -> T:
        """Return the entry for this key, made by ``build()`` if there is none yet."""
        if key not in self._built:
            self._built[key] = build()
        return cast("T", self._built[key])

    def __iter__(self) -> Iterator[Any]:
        return iter(self._built)

    def __reduce__(self) -> tuple[Any, ...]:
        return Once, ()

    def __copy__(self) -> Once:
        return self
