"""Errors that say what is wrong, what was got, what is allowed and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hbbogie.results import Orbit


class ModelError(ValueError):
    """The model, a parameter or an argument is not acceptable."""


class ConvergenceError(RuntimeError):
    """A solve did not converge.

    Attributes
    ----------
    orbit : Orbit or None
        The last iterate.
    statistics : dict
        What the solver counted: iterations, residual norm, return status, active bounds,
        worst equation.
    """

    def __init__(self, message: str, orbit: Orbit | None = None, statistics: Mapping[str, Any] | None = None):
        super().__init__(message)
        self.orbit = orbit
        self.statistics = dict(statistics or {})


def unknown_name(kind: str, got: str, allowed: Iterable[str]) -> str:
    """Return the sentence for an unknown name, with "did you mean" and the allowed names."""
    names = list(allowed)
    folded = {name.casefold(): name for name in names}
    close = get_close_matches(got, names, n=1, cutoff=0.5) or get_close_matches(got.casefold(), folded, n=1, cutoff=0.5)
    hint = f" Did you mean {folded.get(close[0].casefold(), close[0])!r}?" if close else ""
    return f"unknown {kind} {got!r}.{hint} Allowed: {', '.join(names) or '(none)'}."
