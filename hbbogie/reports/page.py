"""A report as one page for people: a summary, the main figure, what was computed, then the details.

The page is one HTML file with its figures inside. It needs no network, and follows the light or dark theme.
"""

from __future__ import annotations

import re
from base64 import b64encode
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from hbbogie.errors import ModelError, as_path
from hbbogie.model.system import System
from hbbogie.reports.captions import caption_of
from hbbogie.reports.report import Report, check_directory
from hbbogie.reports.table import Table
from hbbogie.studies.dataset import replacing
from hbbogie.units import behind, readable

ENOUGH = 5  # significant digits that a page shows
SIZES = {  # heads of columns in the unit that a column of that name gives
    *("value", "nominal", "before", "after", "from", "to", "at least", "at most", "lower bound", "upper bound"),
    *("estimate", "standard error", "default", "peak", "5 %", "95 %"),
}
LONGEST = 60  # rows of a table on a page
WIDEST, FEW = 9, 4  # a table of more columns and no more rows is turned
DOTS = 110  # per inch of a figure


@dataclass(frozen=True)
class Origin:
    """Where a report comes from.

    Attributes
    ----------
    system : System or None
        At the values for which it was made.
    own : dict of float
        The values that the problem itself has, so that the page can say what was changed.
    again : str
        Command or script that makes it again.
    """

    system: System | None = None
    own: dict[str, float] | None = None
    again: str = ""


def check_page(path: str | Path) -> Path:
    """Return the path of a page; raise `ModelError` unless it ends in .html and can be written."""
    target = as_path("--report", path)
    if target.suffix not in (".html", ".htm"):
        raise ModelError(f"--report {str(path)!r}: give a file name that ends in .html.")
    check_directory(target.parent)
    return target


def write_html(report: Report, path: str | Path, origin: Origin | None = None) -> Path:
    """Write a report as one HTML file that holds its figures and needs no network.

    Parameters
    ----------
    report : Report
    path : str or path
    origin : Origin, optional

    Raises
    ------
    ModelError
        When the path does not end in .html or cannot be written.
    """
    target = check_page(path)
    text = html_of(report, origin)
    with replacing(target) as part:
        part.write_text(text, "utf-8")
    return target


def html_of(report: Report, origin: Origin | None = None) -> str:
    """Return a report as the text of a page.

    Parameters
    ----------
    report : Report
    origin : Origin, optional
    """
    import jinja2

    from hbbogie import __version__

    loader = jinja2.PackageLoader("hbbogie.reports", "templates")
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    origin = origin or Origin()
    about, inputs = _inputs(report, origin)
    summary = (*report.summary, *report.later())
    return environment.get_template("report.html").render(
        title=report.title,
        date=f"{date.today().day} {date.today():%B %Y}",
        version=__version__,
        summary=_incomplete(report) + (summary or report.notes),
        about=about,
        inputs=inputs,
        tables=[_plain(t) for t in report.tables],
        figures=[_figure(report, name) for name in report.figures],
        details=[_plain(t) for t in _parameters(origin)],
        remarks=[n for n in report.notes if n not in summary] if summary else (),
        again=origin.again,
    )


def _incomplete(report: Report) -> tuple[str, ...]:
    """Return a sentence where not all was computed, so that the summary cannot be taken for the whole."""
    if report.data.get("complete", True):
        return ()
    return ("Incomplete: not all was searched to its end, and more may exist; the remarks below say what is missing.",)


def _inputs(report: Report, origin: Origin) -> tuple[list[str], list[dict[str, Any]]]:
    """Return sentences and tables on what was computed, and with which data."""
    about = list(report.about)
    system = origin.system
    if system is not None:
        what = f": {system.description}" if system.description else ""
        about.append(
            f"{system.name}{what}, {_count(system.n, 'coordinate')}, {_count(len(system.parameters), 'parameter')}."
        )
        changed = {n: v for n, v in system.values.items() if origin.own is not None and origin.own.get(n) != v}
        values = [_value(system, n, v) for n, v in changed.items()]
        if values:
            about.append(f"Changed from the problem's own values: {', '.join(values)}.")
        elif origin.own is not None:
            about.append("All parameters have the problem's own values.")
    return about, [_plain(t) for t in report.inputs]


def _value(system: System, name: str, value: float) -> str:
    factor, unit = readable(system.parameter(name).unit, abs(value))
    return f"{name} = {factor * value:.{ENOUGH}g}{behind(unit)}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _parameters(origin: Origin) -> list[Table]:
    """Return the table of all parameters."""
    system, own = origin.system, origin.own or {}
    if system is None or not system.parameters:
        return []
    rows = []
    for p in system.parameters:
        value = system.values[p.name]
        rows.append((p.name, p.description, value, p.unit or "1", "changed" if own.get(p.name, value) != value else ""))
    columns = ("parameter", "what it is", "value", "unit", "")
    return [Table("parameters", "All parameters", columns, tuple(rows), ("", "", ".6g", "", ""))]


def _figure(report: Report, name: str) -> dict[str, str]:
    from hbbogie import plot

    image = b64encode(plot.drawing(report.figures[name](), DOTS)).decode()
    return {"image": image, "caption": report.captions.get(name) or caption_of(name)}


def _plain(table: Table) -> dict[str, Any]:
    """Return a table as text with sensible digits and units; one of few rows and many columns is turned."""
    rows, notes = _in_readable_units(table), list(table.notes)
    if len(rows) > LONGEST:
        every = -(-len(rows) // LONGEST)
        notes.append(f"Every {every}th of {len(rows)} rows; all are in the file {table.name}.csv of the job's output.")
        rows = rows[::every]
    columns = [list(column) for column in zip(*rows, strict=True)] or [[] for _ in table.columns]
    heads, cells, text = [], [], []
    for head, form, column in zip(table.columns, table.formats, columns, strict=True):
        head, column = _readable(head, form, column)
        one = Table("", "", (head,), tuple((v,) for v in column), (_fewer(form),))
        heads.append(head.removesuffix(" [1]"))
        cells.append([row[0] for row in one.cells()])
        text.append(not any(isinstance(v, int | float) for v in column))
    lines = [list(row) for row in zip(*cells, strict=True)]
    if len(heads) > WIDEST and 0 < len(lines) <= FEW:
        heads, *lines = [list(row) for row in zip(heads, *lines, strict=True)]
        text = [True, *[False] * (len(heads) - 1)]
    return {"title": table.title, "columns": heads, "rows": lines, "text": text, "notes": notes}


def _in_readable_units(table: Table) -> tuple[tuple[Any, ...], ...]:
    """Return the rows; in a table that gives a unit in each row, sizes are in one in which they are read easily."""
    if "unit" not in table.columns:
        return table.rows
    place, rows = table.columns.index("unit"), []
    sizes = [i for i, head in enumerate(table.columns) if head in SIZES and table.formats[i].endswith("g")]
    for row in table.rows:
        known = [abs(row[i]) for i in sizes if isinstance(row[i], int | float) and np.isfinite(row[i])]
        factor, unit = readable(str(row[place]), max(known, default=0.0))
        new = [factor * v if i in sizes and isinstance(v, int | float) else v for i, v in enumerate(row)]
        rows.append((*new[:place], unit, *new[place + 1 :]))
    return tuple(rows)


def _readable(head: str, form: str, column: list[Any]) -> tuple[str, list[Any]]:
    """Return the head and the numbers of a column in the prefix in which they are read easily."""
    match = re.fullmatch(r"(.*) \[(.+)\]", head)
    numbers = [abs(v) for v in column if isinstance(v, float) and np.isfinite(v)]
    if match is None or not form.endswith("g") or not numbers:
        return head, column
    factor, unit = readable(match[2], max(numbers))
    return f"{match[1]} [{unit}]", [factor * v if isinstance(v, float) else v for v in column]


def _fewer(form: str) -> str:
    """Return a format with no more digits than a page shows."""
    match = re.fullmatch(r"(.*)\.(\d+)g", form)
    return f"{match[1]}.{min(int(match[2]), ENOUGH)}g" if match else form
