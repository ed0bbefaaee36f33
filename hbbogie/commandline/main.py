"""The command line: parse, call, show, save. Numerics and figures are imported only inside the commands."""

from __future__ import annotations

import functools
import sys
from pathlib import Path
from typing import Annotated

import typer

from hbbogie.commandline import explore, methods, motion, railway, study  # noqa: F401  # each adds its commands
from hbbogie.commandline.application import (
    FIGURES,
    AsJson,
    Harmonics,
    Interval,
    Limit,
    MaybeOutput,
    Method,
    Output,
    Overrides,
    ParameterName,
    Problem,
    Workers,
    app,
    command,
    do,
    in_time,
    load,
    written,
)
from hbbogie.errors import ModelError

# --- commands ---------------------------------------------------------------------------------


@command(
    "hbbogie run yang1995 --output out",
    "hbbogie run yang1995 --figures paper",
    "hbbogie run van_der_pol --set mu=2 --json",
    "hbbogie run my_problem.py",
)
def run(
    name: Problem,
    output: Output = Path("out"),
    figures: Annotated[
        str | None, typer.Option(metavar="paper", help="Draw the figures of the problem's paper instead.")
    ] = None,
    method: Method = None,
    limit: Limit = None,
    workers: Workers = 1,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Do the whole job of a problem: cycles, branches, stability, tables and figures."""
    from hbbogie.reports.cycles import figures_of_paper, run_of

    if figures not in (None, "paper"):
        raise ModelError(f"--figures {figures!r}: the one choice is paper; leave the option out for the whole job.")
    if figures and method:
        raise ModelError(
            "--method does not go with --figures paper, which takes the methods of the paper; leave one out."
        )
    job = figures_of_paper if figures else functools.partial(run_of, method=method)
    do(name, overrides, output, as_json, job, limit, workers)


@command(
    "hbbogie branch yang1995",
    "hbbogie branch yang1995 --range 80 120 --harmonics 31",
    "hbbogie branch yang1995 --parameter K1 --range 1e6 6e6 --set V=100",
    "hbbogie branch yang1995 --method exact",
    'hbbogie branch yang1995 --meets "frame acceleration, front" 4',
)
def branch(
    name: Problem,
    parameter: ParameterName = None,
    interval: Interval = None,
    method: Method = None,
    harmonics: Harmonics = None,
    max_points: Annotated[int, typer.Option(min=2, metavar="N", help="Points at which a branch ends.")] = 600,
    stability: Annotated[
        bool,
        typer.Option("--stability/--no-stability", help="Judge every cycle, locate bifurcations and follow them."),
    ] = True,
    meets: Annotated[
        tuple[str, float] | None,
        typer.Option(
            "--meets",
            metavar="NAME LIMIT",
            help="Also where a coordinate or output meets a limit, with the gradients of that place.",
        ),
    ] = None,
    quantity: Annotated[str, typer.Option(help="Of --meets: rms, peak or first harmonic.")] = "rms",
    limit: Limit = None,
    workers: Workers = 1,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Follow the branches of cycles from all Hopf points over a range of a parameter."""
    from hbbogie.branches.diagram import bifurcation_diagram
    from hbbogie.commandline.terminal import deliver, progress_shown
    from hbbogie.critical.limits import check_limit
    from hbbogie.model.problem import default_interval
    from hbbogie.model.ranges import check_interval
    from hbbogie.reports.cycles import report_of_diagram
    from hbbogie.reports.limits import with_limit
    from hbbogie.reports.report import check_directory

    module, system = load(name, overrides)
    if meets is not None:
        check_limit(system, *meets, quantity)
    parameter, own = default_interval(module, system, parameter)
    limits = check_interval(system, parameter, interval or own)
    check_directory(output)
    with progress_shown() as progress:
        diagram = functools.partial(
            bifurcation_diagram,
            system,
            parameter,
            limits,
            method=method or "mhb",
            harmonics=harmonics or "auto",
            stability=stability,
            max_points=max_points,
            workers=workers,
            progress=progress,
        )
        found = in_time(limit, lambda: report_of_diagram(system, diagram()))
        if meets is not None:
            progress(f"where the limit of {meets[0]} is met", None)
            found = with_limit(found, system, *meets, quantity)
        files = written(found, output, progress)
    deliver(found, files, as_json)


@command(
    "hbbogie cycles yang1995 --set V=90",
    "hbbogie cycles van_der_pol --set mu=5 --harmonics 51 --json",
    "hbbogie cycles yang1995 --hill",
    "hbbogie cycles van_der_pol --set mu=100 --method collocation",
)
def cycles(
    name: Problem,
    overrides: Overrides = None,
    parameter: ParameterName = None,
    method: Method = None,
    harmonics: Harmonics = None,
    hill: Annotated[
        bool, typer.Option("--hill", help="Put the multipliers by Hill's method beside the integrated ones.")
    ] = False,
    limit: Limit = None,
    output: MaybeOutput = None,
    as_json: AsJson = False,
) -> None:
    """Find all cycles at the given parameter values, without a guess."""
    from hbbogie.branches.cycles import find_cycles
    from hbbogie.commandline.terminal import deliver, progress_shown
    from hbbogie.model.problem import default_interval
    from hbbogie.reports.cycles import report_of_cycles
    from hbbogie.reports.report import check_directory

    module, system = load(name, overrides)
    parameter, own = default_interval(module, system, parameter)
    interval = own if own[0] <= system.values[parameter] <= own[1] else None
    if output is not None:
        check_directory(output)
    with progress_shown() as progress:
        progress("looking for cycles", None)
        cycles = find_cycles(
            system,
            parameter=parameter,
            interval=interval,
            method=method or "auto",
            harmonics=harmonics or "auto",
            limit=limit,
        )
        found = report_of_cycles(system, parameter, cycles, hill=hill)
        files = written(found, output, progress)
    deliver(found, files, as_json)


@command(
    "hbbogie simulate yang1995 --set V=100 --start q1=0.03 --duration 20",
    'hbbogie simulate van_der_pol --start x=0.1 --start "x\'=0.5" --method cvodes --step 0.01',
)
def simulate(
    name: Problem,
    start: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Initial value of a coordinate, or with a prime of its velocity."),
    ] = None,
    duration: Annotated[float, typer.Option(help="Duration in s.")] = 20.0,
    method: Annotated[str, typer.Option(help="Integration method: rk4 or cvodes.")] = "rk4",
    step: Annotated[
        float | None,
        typer.Option(help="Time between samples in s, and the step of rk4; by default at most 1 ms."),
    ] = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Integrate the motion from a start, and say what it settles on."""
    from hbbogie.commandline.terminal import deliver, numbers, progress_shown
    from hbbogie.reports.motion import default_start, simulated
    from hbbogie.reports.report import check_directory

    _, system = load(name, overrides)
    initial = numbers(start, "--start") or default_start(system)
    check_directory(output)
    with progress_shown() as progress:
        found = simulated(system, initial, duration, method=method, step=step, progress=progress)
        files = written(found, output, progress)
    deliver(found, files, as_json)


@command(
    "hbbogie plot out/branch.nc",
    'hbbogie plot out/branch.nc --coordinate q3 --quantity "first harmonic" --output q3.pdf',
    'hbbogie plot out/branch.nc --coordinate "frame lateral acceleration" --quantity rms',
)
def plot(
    file: Annotated[Path, typer.Argument(metavar="FILE.nc", help="A branch or cycle saved by this program.")],
    coordinate: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of a coordinate or an output; by default the first coordinate.")
    ] = None,
    quantity: Annotated[str, typer.Option(help="peak, first harmonic, half peak to peak, mean or rms.")] = "peak",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Figure (.png, .pdf, .svg); FILE.png if left out."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Draw a saved branch, or the phase portrait of a saved cycle."""
    from hbbogie.commandline.terminal import deliver
    from hbbogie.errors import ModelError
    from hbbogie.reports.figures import load_saved, plot_branch
    from hbbogie.reports.report import Report, check_directory

    saved = load_saved(file)
    target = output or file.with_suffix(".png")
    if target.suffix not in FIGURES:
        raise ModelError(f"--output {str(target)!r}: give a file name that ends in {', '.join(FIGURES)}.")
    check_directory(target.parent)
    path = plot_branch(saved, target, coordinate, quantity)
    what = f"{saved.orbits[0].system}: {len(saved)} cycle{'s' * (len(saved) != 1)} drawn"
    deliver(Report(what, notes=(f"{what}.",)), [path], as_json)


@command("hbbogie new my_bogie.py", "then: hbbogie run my_bogie.py")
def new(
    file: Annotated[Path, typer.Argument(metavar="FILE.py", help="The problem file to write; it must not exist yet.")],
) -> None:
    """Write a problem file to begin with: a mass on a moving belt, with every part explained."""
    from hbbogie.commandline.template import write_problem

    print(f"Written: {write_problem(file)}. Try: hbbogie run {file}")


@command("hbbogie problems", "hbbogie problems --json")
def problems(as_json: AsJson = False) -> None:
    """List the problems that come with the package."""
    from hbbogie.commandline.terminal import deliver
    from hbbogie.model.problem import load_problem, shipped_problems
    from hbbogie.reports.cycles import Table
    from hbbogie.reports.report import Report

    names = shipped_problems()
    firsts = [(load_problem(n).__doc__ or "").strip().partition("\n")[0] for n in names]
    table = Table("problems", "Problems", ("name", "what it is"), tuple(zip(names, firsts, strict=True)), ("", ""))
    deliver(Report("problems", (table,)), [], as_json)


def main() -> None:
    """Run the command line; errors of usage are also printed as a sentence, or with --json as a JSON object."""
    from hbbogie.commandline.terminal import INTERRUPTED, WRONG_INPUT, print_error

    try:
        code = app(sys.argv[1:] or ["--help"], prog_name="hbbogie", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):  # while a command is imported; later it says so itself
        print_error("interrupted before anything was computed.", "--json" in sys.argv, "Interrupted")
        sys.exit(INTERRUPTED)
    except ModelError as error:
        print_error(str(error), "--json" in sys.argv, "UsageError")
        sys.exit(WRONG_INPUT)
    except Exception as error:
        if not hasattr(error, "format_message"):  # not one of wrong usage
            raise
        context = getattr(error, "ctx", None)
        where = context.command_path if context is not None else "hbbogie"
        print_error(f"{error.format_message().rstrip('.')}. See {where} --help.", "--json" in sys.argv, "UsageError")
        sys.exit(WRONG_INPUT)
    sys.exit(code or 0)
