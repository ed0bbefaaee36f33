"""Short descriptions of values that fit on a screen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from textwrap import shorten, wrap
from typing import Any

LINES, WIDTH, MOST = 8, 100, 1150  # largest number of lines, their width, and the total number of characters


def lines(head: str, *rest: str) -> str:
    """Return a headline and indented lines below it, shortened to fit on a screen; empty lines are left out."""
    kept = [line for line in rest if line]
    if len(kept) >= LINES:
        kept = [*kept[: LINES - 2], f"... {len(kept) - LINES + 2} more"]
    room = min(2 * WIDTH, MOST // (1 + len(kept)) - 3)
    return "\n  ".join(shorten(line, max(room, WIDTH), placeholder=" ...") for line in (head, *kept))


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of text as lines with columns aligned to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(t.rjust(w) for t, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def brief(value: Any) -> str:
    """Return the representation of a dataclass: a few words for each field, sizes for arrays and lists."""
    parts = [f"{f.name}: {_short(getattr(value, f.name))}" for f in fields(value) if f.repr]
    return lines(type(value).__name__, *wrap("; ".join(parts), WIDTH, break_on_hyphens=False))


def _short(value: Any) -> str:
    """Return a value in a few words."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape not in ((), (1, 1)):
        return f"array {shape}"
    if isinstance(value, str):
        return repr(shorten(value, 60, placeholder=" ..."))
    if isinstance(value, bool | int | None):
        return repr(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return f"{len(value)} by name" if len(value) > 3 else ", ".join(f"{k} = {_short(v)}" for k, v in value.items())
    if isinstance(value, Sequence):
        few = len(value) <= 3 and all(isinstance(v, str | bool | int | float) for v in value)
        return f"({', '.join(map(_short, value))})" if few else f"{len(value)} in a list"
    if callable(value) and hasattr(value, "__name__"):
        return f"function {value.__name__}"
    return shorten(repr(value).partition("\n")[0], 60, placeholder=" ...")
