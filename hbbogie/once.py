"""What is built once for a value and shared by its copies: a store beside the value, never a part of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

T = TypeVar("T")


class Once:
    """What was built for each key, so that it is built once.

    Values that differ in parameter values only share one of these. A pickled or deep copy begins with an empty one:
    whatever is missing is built again.
    """

    def __init__(self) -> None:
        self._built: dict[Any, Any] = {}

    def __call__(self, key: Any, build: Callable[[], T]) -> T:
        """Return what ``build()`` made for this key."""
        if key not in self._built:
            self._built[key] = build()
        return cast("T", self._built[key])

    def __iter__(self) -> Iterator[Any]:
        return iter(self._built)

    def __reduce__(self) -> tuple[Any, ...]:
        return Once, ()

    def __copy__(self) -> Once:
        return self
