"""The commands of studies: ``hbbogie study run | status | export | report``."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hbbogie.commandline.application import AsJson, app, command
from hbbogie.errors import ModelError

if TYPE_CHECKING:
    from hbbogie.reports.report import Report
    from hbbogie.studies.study import Look, Study

QUIET = 30.0  # s between two lines of progress where there is no terminal

study = typer.Typer(help="Studies: one job at many parameter points, which can be resumed.", no_args_is_help=True)
app.add_typer(study, name="study")

File = Annotated[
    str, typer.Argument(metavar="FILE", help="Study file (.toml), name of a shipped study, or a store (.db).")
]
StorePath = Annotated[
    Path | None, typer.Option("--store", metavar="PATH", help="Store of the study; by default STEM.db here.")
]
Count = Annotated[
    int | None, typer.Option("--points", min=1, metavar="N", help="About N points instead of the number in the file.")
]


@command(
    "hbbogie study run study.toml",
    "hbbogie study run study.toml --resume",
    "hbbogie study run conicity_yaw_stiffness --points 9 --workers 2",
    "hbbogie study run study.toml --scheduler tcp://head:8786",
    group=study,
)
def run(
    file: File,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the store; do only what is missing.")] = False,
    store: StorePath = None,
    workers: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="Worker processes; by default one for each core. 0 for none.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler to run on, such as tcp://host:8786.")
    ] = None,
    points: Count = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Compute failed points anew.")] = False,
    accept_changes: Annotated[
        bool, typer.Option("--accept-changes", help="Go on although problem, job or points have changed.")
    ] = False,
    limit: Annotated[float | None, typer.Option(metavar="SECONDS", help="Time after which a point has failed.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Directory for a report; by default none.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a study; Ctrl-C stops it, --resume goes on."""
    from hbbogie.commandline.terminal import INTERRUPTED, deliver, print_error, stdout_aside
    from hbbogie.reports.report import check_directory
    from hbbogie.studies.study import load_study
    from hbbogie.studies.sweeps import sweep

    with stdout_aside():
        wanted = load_study(file, points)
    path = store or _default_store(wanted.path, points)
    if output is not None:
        check_directory(output)
    said = _number_made(wanted, points)
    if said:
        print(said, file=sys.stderr, flush=True)
    keywords: dict[str, Any] = {"workers": workers, "scheduler": scheduler, "resume": resume}
    try:
        with _progress() as progress, stdout_aside():
            data = sweep(
                wanted.job,
                wanted.points,
                problem=wanted.problem,
                values=wanted.values,
                options=wanted.options,
                store=path,
                retry_failed=retry_failed,
                accept_changes=accept_changes,
                limit=limit,
                progress=progress,
                **keywords,
            )
    except KeyboardInterrupt:
        given: dict[str, Any] = {"points": points, "store": store, "workers": workers, "scheduler": scheduler}
        given |= {"limit": limit, "output": output}
        again = ["hbbogie", "study", "run", file]
        for name, value in given.items():
            again += [] if value is None else [f"--{name}", str(value)]
        message = f"stopped. {_state(path)} are in {path}; go on with: {shlex.join([*again, '--resume'])}"
        print_error(message, as_json, "Interrupted")
        raise typer.Exit(INTERRUPTED) from None
    found = _reported(data, wanted)
    found = replace(found, notes=(*([said] if said else []), *found.notes))
    files = [] if output is None else found.write(output)
    if output is not None:
        files.append(_html(found, output / f"{wanted.path.stem}.html"))
    deliver(found, [*files, path], as_json)


@command("hbbogie study status study.toml", "hbbogie study status results.db --json", group=study)
def status(file: File, store: StorePath = None, points: Count = None, as_json: AsJson = False) -> None:
    """Say how far a study is, also while it runs."""
    from hbbogie.commandline.terminal import deliver
    from hbbogie.reports.cycles import Table
    from hbbogie.reports.report import Report
    from hbbogie.studies.store import Store
    from hbbogie.studies.store_rows import listed

    path, _ = _found(file, store, points)
    with closing(Store.read(path)) as keep:
        p, about = keep.counts(), keep.about()
    rows = [
        ("store", str(path)),
        ("problem", about["problem"]),
        ("job", about["job"]),
        ("points", p.total),
        ("finished", p.done),
        ("without an answer", p.failed),
        ("missing", p.missing),
        ("time of the workers [s]", round(p.seconds, 3)),
    ]
    rows += [("damaged rows", listed(p.damaged))] if p.damaged else []
    table = Table("status", "Study", ("what", "value"), tuple(rows), ("", ""))
    data = {"total": p.total, "done": p.done, "failed": p.failed, "damaged": p.damaged}
    deliver(Report("status", (table,), data=data), [], as_json)


@command(
    "hbbogie study export study.toml --output results.nc",
    "hbbogie study export results.db -o results.csv",
    "hbbogie study export results.db -o results.parquet",
    group=study,
)
def export(
    file: File,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Ends in .nc, .csv or .parquet.")],
    store: StorePath = None,
    points: Count = None,
    as_json: AsJson = False,
) -> None:
    """Write the finished points of a study as NetCDF, CSV or Parquet."""
    from hbbogie.commandline.terminal import deliver
    from hbbogie.reports.report import Report
    from hbbogie.reports.study import damage
    from hbbogie.studies.dataset import check_export
    from hbbogie.studies.dataset import export as write
    from hbbogie.studies.study import points_file

    path, study_file = _found(file, store, points)
    target = check_export(output).resolve()
    if study_file and target == points_file(study_file):
        raise ModelError(f"{str(output)!r} holds the study's points, which an export would replace; give another name.")
    data = _read(path)
    written = write(data, output)
    notes = (f"{data.sizes['point']} points exported.", *damage(data))
    deliver(Report("export", notes=notes), [written], as_json)


@command(
    "hbbogie study report study.toml --output html",
    "hbbogie study report results.db -o html",
    group=study,
)
def report(
    file: File,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.html", help="The report.")] = Path(
        "report.html"
    ),
    store: StorePath = None,
    points: Count = None,
    as_json: AsJson = False,
) -> None:
    """Write tables and figures of a study into one HTML file that needs no network."""
    from hbbogie.commandline.terminal import deliver
    from hbbogie.reports.report import check_directory
    from hbbogie.reports.study import report_of
    from hbbogie.studies.dataset import names_of
    from hbbogie.studies.study import read_look

    path, study_file = _found(file, store, points)
    if output.suffix != ".html":
        raise ModelError(f"--output {str(output)!r}: give a file name that ends in .html.")
    check_directory(output.parent)
    data = _read(path)
    if study_file is None:
        found = report_of(data, path.stem)
    else:
        found = _reported(data, read_look(study_file, names_of(data, "inputs"), data.attrs["sampling"]))
    deliver(found, [_html(found, output)], as_json)


def _number_made(wanted: Study, points: int | None) -> str:
    """Return a sentence where a study has another number of points than was asked for; empty where not."""
    made = len(wanted.points)
    if points is None or made == points:
        return ""
    why = "base points, with one for each parameter and one more" if wanted.points.kind == "saltelli" else "steps"
    return f"--points {points} makes {made} points: a sample of the kind {wanted.points.kind!r} comes in whole {why}."


def _default_store(path: Path, points: int | None) -> Path:
    return Path(f"{path.stem}-{points}.db" if points else f"{path.stem}.db")


def _found(file: str, store: Path | None, points: int | None) -> tuple[Path, Path | None]:
    """Return the store that is meant, and the study file where one was given; nothing of its problem or job runs."""
    from hbbogie.studies.store_file import is_store
    from hbbogie.studies.study import find_study

    if file.endswith(".db") or is_store(file):
        return Path(file), None
    study_file = find_study(file)
    return store or _store_here(study_file, points), study_file


def _store_here(study_file: Path, points: int | None) -> Path:
    """Return the default store, or the one with a number of points where that is the only one here."""
    path = _default_store(study_file, points)
    others = sorted(Path().glob(f"{study_file.stem}-*.db")) if points is None and not path.exists() else []
    if len(others) > 1:
        raise ModelError(
            f"{str(path)!r} is not here, but there are {', '.join(map(str, others))}: say which by --points N or "
            "--store PATH."
        )
    return others[0] if others else path


def _read(path: Path) -> Any:
    from hbbogie.studies.dataset import dataset_of
    from hbbogie.studies.store import Store

    with closing(Store.read(path)) as keep:
        return dataset_of(keep)


def _state(path: Path) -> str:
    from hbbogie.studies.store import Store

    with closing(Store.read(path)) as keep:
        p = keep.counts()
    return f"{p.done} of {p.total} points"


def _reported(data: Any, wanted: Look) -> Report:
    from hbbogie.reports.study import report_of

    return report_of(data, wanted.title, wanted.outputs, wanted.figures)


def _html(found: Report, path: Path) -> Path:
    from hbbogie.reports.page import write_html

    return write_html(found, path)


def _progress() -> Any:
    """Give the function that shows progress; where there is no terminal, a line every half minute."""
    from contextlib import nullcontext

    from hbbogie.commandline.terminal import console, progress_shown

    if console(stderr=True).is_terminal:
        return progress_shown()
    last = -QUIET

    def line(message: str, fraction: float | None) -> None:
        nonlocal last
        if time.monotonic() - last >= QUIET or fraction == 1.0:
            last = time.monotonic()
            print(message, file=sys.stderr, flush=True)

    show: Callable[[str, float | None], None] = line
    return nullcontext(show)
