"""Progress: how long computations report how far they have come."""

from __future__ import annotations

import logging
from collections.abc import Callable

Progress = Callable[[str, float | None], None]
_log = logging.getLogger("hbbogie")


def silent(message: str, fraction: float | None) -> None:
    """Show nothing of a progress message; it goes to the logger "hbbogie", at level DEBUG."""
    if fraction is None:
        _log.debug("%s", message)
    else:
        _log.debug("%s (%.0f %%)", message, 100 * fraction)


def part(progress: Progress, begin: float, end: float) -> Progress:
    """Return the progress of a part of the work, which is the given shares of all of it."""

    def say(message: str, fraction: float | None) -> None:
        progress(message, None if fraction is None else begin + (end - begin) * fraction)

    return say
