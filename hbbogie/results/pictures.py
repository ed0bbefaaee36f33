"""Figures of results drawn by their methods, and what a notebook shows: the one door from results to figures."""

from __future__ import annotations

import html
from base64 import b64encode
from collections.abc import Sequence
from typing import Any

DOTS = 55  # per inch, of a thumbnail


def draw(name: str, *args: Any, **kwargs: Any) -> Any:
    """Return the axes drawn by a function of `hbbogie.plot`; matplotlib is imported only now."""
    from hbbogie import plot

    return getattr(plot, name)(*args, **kwargs)


def page(text: str, rows: Sequence[Sequence[str]] = (), picture: str = "", *args: Any, **kwargs: Any) -> str:
    """Return a result as HTML: its lines, a small table with a head, and a thumbnail.

    Parameters
    ----------
    text : str
        Its representation; the first line becomes the head.
    rows : sequence of rows of text
        The first is the head of the table.
    picture : str
        Function of `hbbogie.plot`; none where empty.
    *args, **kwargs
        Of that function.
    """
    head, *rest = (html.escape(line.strip()) for line in text.splitlines())
    said = [f"<b>{head}</b>", *(f"<div>{line}</div>" for line in rest)]
    kinds = ["th", *["td"] * (len(rows) - 1)]
    cells = ["".join(f"<{k}>{html.escape(c)}</{k}>" for c in row) for k, row in zip(kinds, rows, strict=False)]
    table = f"<table>{''.join(f'<tr>{c}</tr>' for c in cells)}</table>" if rows else ""
    return f"<div>{''.join(said)}{table}{_thumbnail(picture, args, kwargs) if picture else ''}</div>"


def _thumbnail(name: str, args: tuple[Any, ...], kwargs: dict[str, Any]) -> str:
    from hbbogie import plot

    try:
        image = plot.drawing(plot.figure_of(draw(name, *args, **kwargs)), DOTS)
    except ValueError:  # a result that cannot be drawn is shown without
        return ""
    return f'<img alt="" src="data:image/png;base64,{b64encode(image).decode()}">'
