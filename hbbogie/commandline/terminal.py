"""Output and input of the command line: tables, progress, errors and exit codes, JSON, NAME=VALUE."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from hbbogie.commandline.values import quantity
from hbbogie.errors import ModelError
from hbbogie.progress import silent

if TYPE_CHECKING:
    from rich.console import Console

    from hbbogie.reports.report import Report
    from hbbogie.reports.table import Table

WRONG_INPUT, NUMERICAL_FAILURE, INTERRUPTED = 2, 1, 130  # exit codes
quiet: ContextVar[bool] = ContextVar("quiet", default=False)  # whether progress is kept to itself
verbose: ContextVar[bool] = ContextVar("verbose", default=False)  # whether each step is logged
WIDTH = 100  # of the output where it does not go to a terminal
KEYWORDS = {  # of functions, as messages name them, and the options that give them
    "raise max_points to go on": "go on with a larger --max-points of hbbogie branch",
    "resume=True": "--resume",
    "retry_failed=True": "--retry-failed",
    "accept_changes=True": "--accept-changes",
    "harmonics=...": "--harmonics",
    "look where cycles exist with find_cycles or trace": "look where cycles exist with hbbogie cycles or branch",
    "approach it in smaller steps with trace, start from find_cycles, or take fewer harmonics first": "try values near "
    "by, or fewer harmonics with --harmonics",
    "workers=0": "--workers 0",
    "take order=1 or HarmonicBalance(harmonics)": "take df1 or mhb15",
}
FEW_ROWS = 6  # a table too wide for the terminal is turned where it has no more rows than this


def console(stderr: bool = False) -> Console:
    """Return the console of standard output, or of standard error."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    return Console(file=stream, highlight=False, width=None if stream.isatty() else WIDTH)


def assignments(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    """Return the names and values of NAME=VALUE texts.

    Raises
    ------
    ModelError
        For a text that is not of that form, or a name given twice.
    """
    found: dict[str, str] = {}
    for text in texts or ():
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value):
            raise ModelError(f"{option} {text!r}: write NAME=VALUE, such as {option} V=90.")
        if name in found:
            raise ModelError(f"{option}: {name!r} is given twice, as {found[name]} and as {value}; leave one out.")
        found[name] = value
    return found


def numbers(texts: Sequence[str] | None, option: str) -> dict[str, float]:
    """Return the names and numbers of NAME=NUMBER texts; "true" and "false" count as switches.

    Raises
    ------
    ModelError
        As of `quantities`, and for a unit.
    """
    found: dict[str, float] = {}
    for name, (value, unit) in quantities(texts, option).items():
        if unit:
            raise ModelError(f"{option} {name}={value:g} {unit}: give a number without a unit here.")
        found[name] = value
    return found


def quantities(texts: Sequence[str] | None, option: str) -> dict[str, tuple[float, str]]:
    """Return the names, numbers and units of texts such as "V=324 km/h"; the unit is empty where none is given.

    Parameters
    ----------
    texts : sequence of str, or None
    option : str
        That gives them, for messages.

    Raises
    ------
    ModelError
        As of `assignments`, and for a value that is no number.
    """
    return {name: quantity(f"{option} {name}", text) for name, text in assignments(texts, option).items()}


def listed(text: str, option: str) -> list[float]:
    """Return the numbers of a list separated by commas; raise `ModelError` for anything else."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ModelError(
            f"{option} {text!r}: write numbers separated by commas, such as {option} 90,100,120."
        ) from None


def set_loudness(no_progress: bool, every_step: bool) -> None:
    """Say how much the command tells while it works; every step goes to the logger "hbbogie", on standard error."""
    if no_progress and every_step:
        raise ModelError("--quiet and --verbose are both given; leave one out.")
    quiet.set(no_progress)
    verbose.set(every_step)
    if every_step:
        import logging

        logging.basicConfig(format="%(asctime)s %(name)s %(message)s", stream=sys.stderr, force=True)
        logging.getLogger("hbbogie").setLevel(logging.DEBUG)


@contextmanager
def progress_shown() -> Iterator[Callable[[str, float | None], None]]:
    """Give a function (message, fraction) that shows progress on standard error."""
    out = console(stderr=True)
    if quiet.get():
        yield lambda message, fraction: None
        return
    if verbose.get():
        yield silent
        return
    if not out.is_terminal:
        last = ""

        def line(message: str, fraction: float | None) -> None:
            nonlocal last
            stage = message.split(":")[0]
            if stage != last:  # one line for each stage, no matter how many steps it takes
                print(stage, file=sys.stderr, flush=True)
                last = stage

        yield line
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=out, transient=True) as bar:
        task, measured = bar.add_task("", total=None), False

        def show(message: str, fraction: float | None) -> None:
            nonlocal task, measured
            if measured != (fraction is not None):  # a task cannot go back to an unknown total
                measured = fraction is not None
                bar.remove_task(task)
                task = bar.add_task(message, total=1.0 if measured else None)
            percent = "" if fraction is None else f", {100 * fraction:.0f} %"
            bar.update(task, description=f"{message}{percent}", completed=fraction)

        yield show


@contextmanager
def stdout_aside() -> Iterator[None]:
    """Send to standard error what is printed meanwhile, also by native code and by processes that are started."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def print_table(table: Table, out: Console) -> None:
    """Print a table; one that is too wide is turned where it has few rows, else printed in parts by subject."""
    from rich.text import Text

    header, cells = list(table.columns), table.cells()
    numeric = [any(isinstance(row[i], int | float) for row in table.rows) for i in range(len(header))]
    widest = [max(len(text) for text in column) for column in zip(header, *cells, strict=True)]
    if sum(widest) + 3 * len(widest) > out.width and len(cells) <= FEW_ROWS:
        header, *cells = [list(column) for column in zip(header, *cells, strict=True)]
        numeric = [False, *[True] * (len(header) - 1)]
    out.print(Text(table.title, style="bold"))
    for part in _parts(header, cells, numeric, out.width):
        _print_grid([[row[i] for i in part] for row in (header, *cells)], [numeric[i] for i in part], out)
    for note in table.notes:
        out.print(Text(in_options(note), style="dim"), soft_wrap=False)


def _least(header: str, entries: Sequence[str], numeric: bool) -> int:
    """Return the least width of a column: headers and sentences are broken between words, numbers never."""
    words = [*header.split(), *(entries if numeric else " ".join(entries).split())]
    return max(map(len, words), default=0)


def _parts(header: list[str], cells: list[list[str]], numeric: list[bool], width: int) -> list[list[int]]:
    """Divide the columns into parts that fit a width, each with the first column, and subjects together where they fit.

    The subject of a column is the first word of its header.
    """
    needed = [3 + _least(h, [row[i] for row in cells], n) for i, (h, n) in enumerate(zip(header, numeric, strict=True))]
    room = width - 2 - needed[0]
    subjects = [list(run) for _, run in groupby(range(1, len(header)), key=lambda i: header[i].split()[:1])]
    fits = all(sum(needed[i] for i in subject) <= room for subject in subjects)
    blocks = subjects if fits else [[i] for i in range(1, len(header))]
    parts: list[list[int]] = [[]]
    for block in blocks:
        if parts[-1] and sum(needed[i] for i in (*parts[-1], *block)) > room:
            parts.append([])
        parts[-1] += block
    return [[0, *part] for part in parts]


def _print_grid(rows: list[list[str]], numeric: list[bool], out: Console) -> None:
    from rich import box
    from rich.table import Table as Grid
    from rich.text import Text

    header, *cells = rows
    grid, needed = Grid(box=box.SIMPLE_HEAD), 2 + 3 * len(header)
    for i, (text, right) in enumerate(zip(header, numeric, strict=True)):
        least = _least(text, [row[i] for row in cells], right)
        needed += least
        grid.add_column(Text(text), justify="right" if right else "left", min_width=least)
    for row in cells:
        grid.add_row(*map(Text, row))
    out.print(grid, width=max(needed, out.width), crop=False, overflow="ignore", no_wrap=needed > out.width)


def in_options(text: str) -> str:
    """Return a sentence with options of the command line for the keywords of the functions behind it.

    Parameters
    ----------
    text : str
    """
    text = re.sub(r"\b\w+=(?:\{[^}]*\}|\S+) \((--[^)]+)\)", r"\1", text)  # that names both
    for keyword, option in KEYWORDS.items():
        text = text.replace(keyword, option)
    return text


def deliver(report: Report, files: Sequence[Path], as_json: bool, extra: Mapping[str, Any] | None = None) -> None:
    """Print a report and the files written, as text or as one JSON document."""
    if as_json:
        document = report.as_dict() | dict(extra or {}) | {"files": [str(f) for f in files]}
        print(json.dumps(document, indent=2, allow_nan=False))
        return
    from rich.text import Text

    out = console()
    for table in report.tables:
        print_table(table, out)
    for note in report.notes:
        out.print(Text(in_options(note)))
    if files:
        folders = sorted({str(f.parent) for f in files})
        out.print(Text(f"\nWritten to {', '.join(folders)}: {', '.join(f.name for f in files)}"))


def print_error(message: str, as_json: bool, kind: str) -> None:
    """Print an error on standard error, and as a JSON object on standard output where that is asked for."""
    from rich.text import Text

    message = in_options(message)
    if as_json:
        print(json.dumps({"error": message, "kind": kind}))
    text = Text.assemble(("Error: ", "bold red"), (message, "red"))
    console(stderr=True).print(text, soft_wrap=True)


# --- errors and interruption --------------------------------------------------------------------


def guarded(function: Callable[..., None], args: tuple[Any, ...], kwargs: dict[str, Any]) -> None:
    """Call a command; turn what it raises into a sentence and an exit code."""
    from hbbogie.parallel.processes import interruptions

    as_json = bool(kwargs.get("as_json"))
    with interruptions(raising=True) as pressed:  # CasADi loses the exception, or makes others of it
        try:
            function(*args, **kwargs)
            if not pressed():
                return
            message, kind, code = "interrupted; what was written may lack what was cut off.", "Interrupted", INTERRUPTED
            as_json = False  # there is a document already
        except typer.Exit:
            raise
        except (KeyboardInterrupt, Exception) as error:
            if isinstance(error, KeyboardInterrupt) or pressed():
                message, kind = "interrupted; nothing further was computed or written.", "Interrupted"
                code = INTERRUPTED
            else:
                code = _exit_code(error)
                message, kind = str(error), type(error).__name__
    print_error(message, as_json, kind)
    raise typer.Exit(code)


def _exit_code(error: Exception) -> int:
    """Return the exit code of an error of wrong input or of a numerical failure; raise any other again."""
    import numpy as np

    if isinstance(error, ModelError | OSError | MemoryError):
        return WRONG_INPUT
    # casadi raises plain RuntimeErrors; other classes derived from it, but for ours, are programming errors
    if isinstance(error, np.linalg.LinAlgError | FloatingPointError):
        return NUMERICAL_FAILURE
    if isinstance(error, RuntimeError) and type(error).__name__ in ("RuntimeError", "ConvergenceError"):
        return NUMERICAL_FAILURE
    raise error
