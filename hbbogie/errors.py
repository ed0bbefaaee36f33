"""Errors, and the wording of their messages: what is wrong, what was given, what is allowed and what to do."""

from __future__ import annotations

import math
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any


class ModelError(ValueError):
    """The model, a parameter or an argument is not acceptable."""


def unknown_name(kind: str, got: str, allowed: Iterable[str]) -> str:
    """Return the sentence for an unknown name, with "did you mean" and the allowed names."""
    names = list(allowed)
    folded = {name.casefold(): name for name in names}
    close = get_close_matches(got, names, n=1, cutoff=0.5) or get_close_matches(got.casefold(), folded, n=1, cutoff=0.5)
    hint = f" Did you mean {folded.get(close[0].casefold(), close[0])!r}?" if close else ""
    return f"unknown {kind} {got!r}.{hint} Allowed: {', '.join(names) or '(none)'}."


def as_number(value: Any) -> float:
    """Return a number as a float, and NaN for anything else (a text, a truth value, an expression, an array)."""
    kind = getattr(getattr(value, "dtype", None), "kind", "")  # NumPy values have one
    if isinstance(value, str | bytes | bool) or kind in ("b", "S", "U") or getattr(value, "ndim", 0) != 0:
        return float("nan")
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # CasADi raises RuntimeErrors
        return float("nan")


def positive(name: str, value: float, unit: str) -> float:
    """Return the value as a number; raise `ModelError` unless it is finite and above 0."""
    number = as_number(value)
    if not (math.isfinite(number) and number > 0):
        raise ModelError(
            f"{name}: got {value!r}; give a finite number above 0" + (f" in {unit}." if unit != "1" else ".")
        )
    return number
