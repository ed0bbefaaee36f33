"""The values of a system's parameters, read-only."""

from __future__ import annotations

from typing import Any, NoReturn


class Values(dict[str, float]):
    """Values by name; a dict that cannot be changed, so that a system keeps its values. Its copies are plain dicts."""

    def _refuse(self, *args: Any, **kwargs: Any) -> NoReturn:
        raise TypeError(
            "the values of a system cannot be changed; make another with system.with_parameters(name=value)."
        )

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        return Values, (dict(self),)

    def __copy__(self) -> dict[str, float]:
        return dict(self)

    def __deepcopy__(self, memo: Any) -> dict[str, float]:
        return dict(self)
