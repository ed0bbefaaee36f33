"""Reports: the results of a job as tables, branches and figures."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hbbogie.brief import brief
from hbbogie.errors import ModelError, named
from hbbogie.progress import Progress, silent
from hbbogie.reports.figures import Figures
from hbbogie.reports.table import Table, plain
from hbbogie.results.branch import Branch

FORMS = ("png", "pdf", "svg")  # of figures


@dataclass(frozen=True, eq=False)
class Report:
    """What a job found.

    Attributes
    ----------
    title : str
    tables : tuple of Table
    branches : dict of Branch
        By the stem of the file each is saved to.
    figures : dict of functions without arguments that draw and return a matplotlib figure
        By the stem of the file each is saved to.
    notes : tuple of str
        Sentences.
    data : dict
        Anything else for the JSON document.
    long_tables : tuple of Table
        Written like the others, but not shown.
    texts : dict of str
        Text files, by name.
    summary : tuple of str
        What was found, in sentences made from the numbers; a page begins with them, or with the notes where there are
        none.
    later : callable
        () -> more sentences of the summary, which take computations of their own: called for a page only.
    about : tuple of str
        What was computed, sentences of a page.
    inputs : tuple of Table
        With which data, on a page.
    captions : dict of str
        What one sees in a figure, by its name, where that is not the usual one.
    """

    title: str
    tables: tuple[Table, ...] = ()
    branches: dict[str, Branch] = field(default_factory=dict)
    figures: Figures = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    data: dict[str, Any] = field(default_factory=dict)
    long_tables: tuple[Table, ...] = ()
    texts: dict[str, str] = field(default_factory=dict)
    summary: tuple[str, ...] = ()
    later: Callable[[], tuple[str, ...]] = tuple
    about: tuple[str, ...] = ()
    inputs: tuple[Table, ...] = ()
    captions: dict[str, str] = field(default_factory=dict)

    __repr__ = brief

    def write(
        self, directory: str | Path, progress: Progress = silent, *, form: str = "png", figures: bool = True
    ) -> list[Path]:
        """Write branches as NetCDF, tables as CSV, texts and figures; return the files written.

        Parameters
        ----------
        directory : str or path
            Made where it does not exist.
        progress : callable
            Called with (message, fraction done).
        form : {"png", "pdf", "svg"}
            Of the figures.
        figures : bool
            Whether figures are drawn.

        Raises
        ------
        ModelError
            When the directory cannot be made or written.
        """
        named("report", "form of figures", form, FORMS)
        folder, files = check_directory(directory), []
        for name, branch in self.branches.items():
            files.append(folder / f"{name}.nc")
            branch.save(files[-1])
        for table in (*self.tables, *self.long_tables):
            files.append(folder / f"{table.name}.csv")
            table.to_csv(files[-1])
        for name, text in self.texts.items():
            files.append(folder / name)
            files[-1].write_text(text, encoding="utf-8")
        for i, (name, draw) in enumerate(self.figures.items() if figures else ()):
            from hbbogie import plot

            progress(f"drawing {name}", i / len(self.figures))
            files.append(plot.save(draw(), folder / f"{name}.{form}"))
        return files

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the figures for JSON."""
        return {
            "title": self.title,
            "notes": list(self.notes),
            "tables": [table.as_dict() for table in self.tables],
            "branches": {name: _branch_dict(branch) for name, branch in self.branches.items()},
            "data": plain(self.data),
        }


def _branch_dict(b: Branch) -> dict[str, Any]:
    keep = ("kind", "parameter", "value", "interval", "omega", "criticality", "status")
    special = [{name: getattr(s, name) for name in keep} for s in b.special]
    peaks = {c: b.amplitude(c) for c in (*b.orbits[0].coordinates, *b.orbits[0].outputs)}
    content = {"parameter": b.parameter, "values": b.values, "omega_rad_s": b.omega, "amplitude": peaks}
    return plain({**content, "stability": b.verdicts, "special": special, "ends": b.ends})  # type: ignore[no-any-return]


def check_directory(path: str | Path) -> Path:
    """Make a directory where it does not exist, and try whether files can be written there.

    Raises
    ------
    ModelError
        When it cannot be made or written.
    """
    folder = Path(path).expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = error.strerror or str(error)
        raise ModelError(
            f"cannot write to the directory {os.fspath(path)!r}: {reason}; "
            "give a directory that can be made or written."
        ) from error
    return folder
