"""Code shared by all commands: the application, options, loading a problem, running a job."""

from __future__ import annotations

import functools
import inspect
import os
import shlex
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from hbbogie.errors import ModelError

if TYPE_CHECKING:
    from hbbogie.model.system import System
    from hbbogie.reports.page import Origin
    from hbbogie.reports.report import Report

FIGURES = (".png", ".pdf", ".svg")

# of commands in the help, as one comes to use them
ORDER = (
    *("problems", "new", "run", "cycles", "branch", "simulate", "plot", "animate", "explore", "compare", "critical"),
    *("chart", "design", "identify", "basin", "ramp", "conicity", "study", "export"),
)


class InOrder(TyperGroup):
    """The commands in the order of their use."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands."""
        return sorted(super().list_commands(ctx), key=lambda name: (*ORDER, name).index(name))


app = typer.Typer(
    name="hbbogie",
    cls=InOrder,
    help="Limit cycles of self-excited mechanical systems: find them, follow them, judge their stability.",
    epilog="Begin with: hbbogie problems\n\nthen: hbbogie run yang1995 --output out",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _shipped(incomplete: str) -> list[str]:
    from hbbogie.model.problem import shipped_problems

    return [name for name in shipped_problems() if name.startswith(incomplete)]


Problem = Annotated[
    str,
    typer.Argument(
        metavar="NAME", help="Name of a shipped problem, or path of a file (.py) or folder.", autocompletion=_shipped
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help='Parameter value, in its own unit or with one, as in "V=324 km/h"; may be repeated.',
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document, and nothing else, on standard output.")]
Output = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Directory for the files.")]
MaybeOutput = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="DIR", help="Directory for files; by default none are written.")
]
Harmonics = Annotated[
    int | None, typer.Option(min=1, help="Highest harmonic; by default as high as the error estimate asks for.")
]
Method = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="exact, mhb (harmonic balance), collocation or auto, the one that fits."),
]
Limit = Annotated[
    float | None,
    typer.Option(
        "--limit",
        metavar="SECONDS",
        help="Time after which to end with what was found, and to say so. A step that has begun is done first.",
    ),
]
Workers = Annotated[int, typer.Option(min=1, metavar="N", help="Processes among which branches and curves are shared.")]
Interval = Annotated[
    tuple[float, float] | None,
    typer.Option("--range", metavar="LO HI", help="Range of the parameter; by default the problem's own."),
]
ParameterName = Annotated[
    str | None, typer.Option(metavar="NAME", help="Parameter to vary; by default the problem's own.")
]


class Strict(TyperCommand):
    """A command that refuses an option given twice where only the last would count."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments."""
        words_given.set((*ctx.command_path.split(), *args))
        given = [word.partition("=")[0] for word in args]
        for option in self.params:
            single = not getattr(option, "multiple", False) and not getattr(option, "is_flag", False)
            if single and (twice := [name for name in option.opts if name.startswith("-") and given.count(name) > 1]):
                raise ModelError(f"{twice[0]} is given twice; leave one out.")
        return super().parse_args(ctx, args)


class Form(StrEnum):
    """Of the figures."""

    png = "png"
    pdf = "pdf"
    svg = "svg"


# options of every command, with their defaults
LOUDNESS: dict[str, tuple[Any, Any]] = {
    "quiet": (Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")], False),
    "verbose": (Annotated[bool, typer.Option("--verbose", "-v", help="Log each step with its time.")], False),
}
# of those that take values of parameters
VALUES: dict[str, tuple[Any, Any]] = {
    "values_file": (
        Annotated[
            Path | None,
            typer.Option(
                "--values", metavar="FILE", help="Parameter values from a .toml, .json or .csv file; --set comes after."
            ),
        ],
        None,
    ),
}
# of those that write figures
SHARED: dict[str, tuple[Any, Any]] = {
    "form": (Annotated[Form, typer.Option("--format", help="Of the figures.")], Form.png),
    "no_figures": (Annotated[bool, typer.Option("--no-figures", help="Write tables and branches only.")], False),
    "page": (
        Annotated[
            Path | None,
            typer.Option("--report", metavar="FILE.html", help="Also write a page for people: summary, figures, data."),
        ],
        None,
    ),
}
figures_wanted: ContextVar[dict[str, Any]] = ContextVar("figures_wanted")  # by the command that runs
values_given: ContextVar[Path | None] = ContextVar("values_given", default=None)
page_wanted: ContextVar[Path | None] = ContextVar("page_wanted", default=None)
words_given: ContextVar[tuple[str, ...]] = ContextVar("words_given", default=())
loaded: ContextVar[tuple[ModuleType, System] | None] = ContextVar("loaded", default=None)  # what the command is about


def written(report: Report, folder: Path | None, progress: Any) -> list[Path]:
    """Write a report, with its figures and as a page, as the options of the command say."""
    files = [] if folder is None else report.write(folder, progress, **figures_wanted.get())
    if (page := page_wanted.get()) is not None:
        from hbbogie.reports.page import write_html

        progress("writing the page", None)
        files.append(write_html(report, page, _origin()))
    return files


def _origin() -> Origin:
    """Return where the report of the command comes from; paths are given by their last part."""
    from hbbogie.model.problem import system_of
    from hbbogie.reports.page import Origin

    words, kept = [w.rpartition(os.sep)[2] or w for w in words_given.get()], list[str]()
    while words:
        word = words.pop(0)
        if word in ("--report", "--output", "-o"):
            words.pop(0)
        elif word not in ("-q", "--quiet", "--json") and not word.startswith(("--report=", "--output=")):
            kept.append(word)
    about = loaded.get()
    if about is None:
        return Origin(again=shlex.join(kept))
    return Origin(about[1], dict(system_of(about[0]).values), shlex.join(kept))


def examples(*lines: str) -> str:
    """Return the text below the help of a command."""
    return "\n\n".join(["Examples:", *lines])


def command(*lines: str, group: typer.Typer = app) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a function a command with examples, whose errors are printed as sentences."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        writes = function.__annotations__.get("output") in ("Output", "MaybeOutput")

        @functools.wraps(function)
        def run(*args: Any, **kwargs: Any) -> None:
            from hbbogie.commandline.terminal import guarded, set_loudness

            options = {name: kwargs.pop(name) for name in (*SHARED, *VALUES, *LOUDNESS) if name in kwargs}
            set_loudness(bool(options.get("quiet")), bool(options.get("verbose")))
            values_given.set(options.get("values_file"))
            figures_wanted.set({"form": str(options.get("form", Form.png)), "figures": not options.get("no_figures")})
            loaded.set(None)
            guarded(_with_page(function, options.get("page")), args, kwargs)

        shared = LOUDNESS | (VALUES if "overrides" in function.__annotations__ else {}) | (SHARED if writes else {})
        kind, hints = inspect.Parameter.KEYWORD_ONLY, get_type_hints(function, include_extras=True)
        own = [p.replace(annotation=hints[n]) for n, p in inspect.signature(function).parameters.items()]
        own += [inspect.Parameter(n, kind, default=d, annotation=a) for n, (a, d) in shared.items()]
        run.__signature__ = inspect.Signature(own)  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in own}
        return group.command(epilog=examples(*lines), cls=Strict)(run)

    return register


def _with_page(function: Callable[..., None], page: Path | None) -> Callable[..., None]:
    """Return the function of a command so that it begins by trying whether the page can be written."""

    def begin(*args: Any, **kwargs: Any) -> None:
        if page is not None:
            from hbbogie.reports.page import check_page

            check_page(page)
        page_wanted.set(page)
        function(*args, **kwargs)

    return begin


def _show_version(wanted: bool) -> None:
    if wanted:
        from hbbogie import __version__

        print(f"hbbogie {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    # figures are written to files only: a display is not needed
    os.environ.setdefault("MPLBACKEND", "Agg")


def _texts(module: ModuleType) -> set[str]:
    """Return the options of a problem's builder that are texts, such as creep="linear"."""
    builder = getattr(module, "SYSTEM", None)
    options = inspect.signature(builder).parameters if callable(builder) else {}
    return {name for name, option in options.items() if isinstance(option.default, str)}


def load(name: str, overrides: list[str] | None) -> tuple[ModuleType, System]:
    """Return the module of a problem and its system with parameter values replaced."""
    from hbbogie.commandline.terminal import assignments, quantities
    from hbbogie.commandline.values import in_own_units, values_in
    from hbbogie.model.problem import load_problem, system_of

    file, module = values_given.get(), load_problem(name)
    texts = _texts(module)
    chosen = {n: text for n, text in assignments(overrides, "--set").items() if n in texts}
    numeric = [text for text in overrides or () if text.partition("=")[0].strip() not in texts]
    given = ({} if file is None else values_in(file)) | quantities(numeric, "--set")
    with_units = any(unit for _, unit in given.values())
    units = {p.name: p.unit for p in system_of(module, **chosen).parameters} if with_units else {}
    system = system_of(module, **in_own_units(given, units), **chosen)
    loaded.set((module, system))
    return module, system


def do(
    name: str,
    overrides: list[str] | None,
    output: Path,
    as_json: bool,
    job: Callable[..., Report],
    limit: float | None = None,
    workers: int = 1,
) -> None:
    """Load a problem, do a job (module, system, progress) -> Report in a time, write its files and show it."""
    from hbbogie.commandline.terminal import deliver, progress_shown
    from hbbogie.parallel import in_processes
    from hbbogie.reports.report import check_directory

    module, system = load(name, overrides)
    check_directory(output)
    with progress_shown() as progress, in_processes(workers):
        found = in_time(limit, lambda: job(module, system, progress))
        files = written(found, output, progress)
    deliver(found, files, as_json)


def in_time(limit: float | None, job: Callable[[], Report]) -> Report:
    """Return the report of a job that is to end after some seconds; it says so where it was ended."""
    from hbbogie.deadline import time_is_over, time_limit
    from hbbogie.reports.figures import Figures, drawn_or_reason

    with time_limit(limit):
        found = job()
        if page_wanted.get() is not None:  # what it says belongs to the time
            found = replace(found, summary=(*found.summary, *found.later()), later=tuple)
        over = time_is_over()
    if not over:
        return found
    said = (
        f"Incomplete: the time limit of {limit:g} s was reached. What was found by then is shown; none means none yet."
    )
    figures: Figures = {name: functools.partial(drawn_or_reason, draw) for name, draw in found.figures.items()}
    data = {**found.data, "complete": False}
    return replace(found, notes=(said, *found.notes), data=data, figures=figures)
