"""Progress: how long computations report how far they have come."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float | None], None]


def silent(message: str, fraction: float | None) -> None:
    """Accept a progress message and show nothing."""
