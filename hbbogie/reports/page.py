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

from hbbogie.errors import ModelError, as_path
from hbbogie.model.system import System
from hbbogie.reports.captions import caption_of
from hbbogie.reports.report import Report, check_directory
from hbbogie.reports.table import Table
from hbbogie.studies.dataset import replacing

ENOUGH = 5  # significant digits that a page shows
LONGEST = 60  # rows of a table on a page
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
    return environment.get_template("report.html").render(
        title=report.title,
        date=date.today().strftime("%-d %B %Y") if _unix() else str(date.today()),
        version=__version__,
        summary=report.summary or report.notes,
        about=about,
        inputs=inputs,
        tables=[_plain(t) for t in report.tables],
        figures=[_figure(report, name) for name in report.figures],
        details=[_plain(t) for t in _parameters(origin)],
        remarks=report.notes if report.summary else (),
        again=origin.again,
    )


def _unix() -> bool:
    import os

    return os.name == "posix"


def _inputs(report: Report, origin: Origin) -> tuple[list[str], list[dict[str, Any]]]:
    """Return sentences and tables on what was computed, and with which data."""
    about = list(report.about)
    system = origin.system
    if system is not None:
        what = f": {system.description}" if system.description else ""
        about.append(f"{system.name}{what}, {system.n} coordinates, {len(system.parameters)} parameters.")
        changed = {n: v for n, v in system.values.items() if origin.own is not None and origin.own.get(n) != v}
        values = [system.naming.value(n, v, ENOUGH) for n, v in changed.items()]
        if values:
            about.append(f"Changed from the problem's own values: {', '.join(values)}.")
        elif origin.own is not None:
            about.append("All parameters have the problem's own values.")
    return about, [_plain(t) for t in report.inputs]


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
    """Return a table as text with sensible digits; of a long one every so many rows."""
    formats = tuple(_fewer(form) for form in table.formats)
    rows, notes = table.rows, list(table.notes)
    if len(rows) > LONGEST:
        every = -(-len(rows) // LONGEST)
        notes.append(f"Every {every}th of {len(rows)} rows; all are in the file {table.name}.csv of the job's output.")
        rows = rows[::every]
    cells = Table(table.name, table.title, table.columns, rows, formats).cells()
    numeric = [any(isinstance(row[i], int | float) for row in rows) for i in range(len(table.columns))]
    return {
        "title": table.title,
        "columns": [c.removesuffix(" [1]") for c in table.columns],
        "rows": cells,
        "text": [not n for n in numeric],
        "notes": notes,
    }


def _fewer(form: str) -> str:
    """Return a format with no more digits than a page shows."""
    match = re.fullmatch(r"(.*)\.(\d+)g", form)
    return f"{match[1]}.{min(int(match[2]), ENOUGH)}g" if match else form
