"""Tables: plain rows with headers and formats, to be printed, saved or handed on as JSON."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hbbogie.brief import brief
from hbbogie.errors import ModelError


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes
    ----------
    name : str
        Stem of the file it is saved to.
    title : str
    columns : tuple of str
        Headers with unit, such as "V [m/s]".
    rows : tuple of tuple
        Numbers and strings; None where there is nothing to show.
    formats : tuple of str
        For each column a format specification such as ".2f", applied to its numbers when shown.
    notes : tuple of str
        Sentences to stand below the table.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    formats: tuple[str, ...]
    notes: tuple[str, ...] = ()

    __repr__ = brief

    def __post_init__(self) -> None:
        widths = {len(row) for row in self.rows} | {len(self.formats)}
        if widths != {len(self.columns)}:
            raise ModelError(
                f"table {self.name!r}: {len(self.columns)} columns, {len(self.formats)} formats, rows of "
                f"{sorted({len(row) for row in self.rows})}; give one format and one entry for each column."
            )

    def cells(self) -> list[list[str]]:
        """Return the rows as text in the formats of the columns, an empty string for None."""
        pairs = [zip(row, self.formats, strict=True) for row in self.rows]
        return [[_shown(value, form) for value, form in row] for row in pairs]

    def to_csv(self, path: str | Path) -> None:
        """Write headers and rows, numbers with all their digits, None as an empty field."""
        with open(path, "w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(self.columns)
            writer.writerows([_exact(value) for value in row] for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Return the table for JSON: name, title, columns, rows, notes."""
        return {
            "name": self.name,
            "title": self.title,
            "columns": list(self.columns),
            "rows": [plain(row) for row in self.rows],
            "notes": list(self.notes),
        }


def _shown(value: Any, form: str) -> str:
    if value is None:
        return ""
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return format(value, form) if number else str(value)


def _exact(value: Any) -> Any:
    return "" if value is None else repr(float(value)) if isinstance(value, float | np.floating) else value


def plain(value: Any) -> Any:
    """Return a value as JSON knows it; complex numbers as [real, imaginary], None for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(v) for key, v in value.items()}
    if isinstance(value, list | tuple | set | np.ndarray):
        return [plain(v) for v in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, complex | np.complexfloating):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return None if value is None else str(value)
