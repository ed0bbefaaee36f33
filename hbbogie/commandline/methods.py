"""Commands that compare methods, identify parameters, find and chart critical values, and choose designs."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

import typer

from hbbogie.commandline.application import (
    AsJson,
    Harmonics,
    Interval,
    Limit,
    Method,
    Output,
    Overrides,
    ParameterName,
    Problem,
    Workers,
    command,
    do,
)


@command(
    "hbbogie compare yang1995",
    "hbbogie compare yang1995 --methods df1,df2,mhb3,mhb15,exact",
    "hbbogie compare bautin --methods df1,mhb3 --at -0.2,-0.1,0.1",
)
def compare(
    name: Problem,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="LIST", help="Methods, by commas: df1, df2, mhb and a harmonic, exact, collocation, auto."
        ),
    ] = None,
    at: Annotated[
        str | None, typer.Option(metavar="LIST", help="Parameter values to compare at, separated by commas.")
    ] = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Compare methods: describing functions, harmonic balance, closed form, and what the problem's paper used."""
    from hbbogie.commandline.terminal import listed
    from hbbogie.reports.comparison import comparison_of

    chosen = methods.split(",") if methods else None
    places = listed(at, "--at") if at else None
    do(name, overrides, output, as_json, lambda module, system, say: comparison_of(module, system, chosen, places, say))


@command(
    "hbbogie identify yang1995",
    "hbbogie identify yang1995 --theory kalker",
    "hbbogie identify yang1995 --free f11,f22,f23,f33 --robust",
)
def identify(
    name: Problem,
    free: Annotated[
        str | None, typer.Option(metavar="LIST", help="Parameters to identify, separated by commas.")
    ] = None,
    theory: Annotated[
        str | None, typer.Option(metavar="NAME", help="A theory with fewer parameters that the problem knows.")
    ] = None,
    robust: Annotated[bool, typer.Option("--robust", help="Give less weight to rows far from the others.")] = False,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Identify parameters of a problem from its published cycles, by least squares."""
    from hbbogie.reports.cycles import identification

    options = {"free": free.split(",") if free else None, "theory": theory, "robust": robust}
    do(
        name,
        overrides,
        output,
        as_json,
        lambda module, system, say: identification(module, system, say, **options),
    )


@command(
    "hbbogie critical yang1995",
    "hbbogie critical yang1995 --set lam=0.1 --json",
    "hbbogie critical bautin --parameter mu --range -0.5 0.5",
)
def critical(
    name: Problem,
    parameter: ParameterName = None,
    interval: Interval = None,
    method: Method = None,
    limit: Limit = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Find the critical values of a parameter, Hopf points and folds, with their gradients."""
    from hbbogie.reports.critical import critical_of

    job = functools.partial(critical_of, parameter=parameter, interval=interval, method=method or "auto")
    do(name, overrides, output, as_json, job, limit)


@command(
    "hbbogie chart yang1995 --over lam 0.02 0.3",
    "hbbogie chart yang1995 --over K1 1e6 6e6 --set lam=0.1 --json",
    "hbbogie chart bautin --parameter mu --over a 0.1 1",
    "hbbogie chart vehicle --over lam 0.05 0.4 --range 20 110 --workers 2",
)
def chart(
    name: Problem,
    over: Annotated[
        tuple[str, float, float],
        typer.Option("--over", metavar="NAME LO HI", help="Second parameter and its range."),
    ],
    parameter: ParameterName = None,
    interval: Interval = None,
    method: Method = None,
    harmonics: Harmonics = None,
    secondary: Annotated[
        bool,
        typer.Option("--secondary", help="Look for folds also beside an equilibrium that is unstable on both sides."),
    ] = False,
    workers: Workers = 1,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Follow folds and Hopf points over a second parameter, and draw them in the plane of both."""
    from hbbogie.reports.chart import chart_of

    second, low, high = over
    options = {"parameter": parameter, "span": interval, "harmonics": harmonics, "secondary": secondary}
    options["method"] = method or "auto"
    job = functools.partial(chart_of, over=second, interval=(low, high), **options)  # type: ignore[arg-type]
    do(name, overrides, output, as_json, job, workers=workers)


@command(
    "hbbogie export yang1995 --to auto",
    "hbbogie export van_der_pol --to auto --set mu=1 --range 0.1 5 --output auto",
)
def export(
    name: Problem,
    to: Annotated[str, typer.Option("--to", metavar="PROGRAM", help="auto, which is AUTO-07p.")] = "auto",
    parameter: ParameterName = None,
    interval: Interval = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Write the equations, with derivatives, and a cycle for another program, which follows its branch."""
    from hbbogie.reports.exchange import export_of

    job = functools.partial(export_of, program=to, parameter=parameter, interval=interval)
    do(name, overrides, output, as_json, job)


DesignFile = Annotated[
    str, typer.Argument(metavar="NAME", help="Shipped problem with a design, or path of a file (.py) or folder.")
]


@command(
    "hbbogie design yang1995_design",
    "hbbogie design vehicle_design --samples 0",
    "hbbogie design vehicle_design --quantile 0.05",
    "hbbogie design problems/yang1995_design.py --starts 4",
    "hbbogie design yang1995_design --robust 2 --set lam=0.06 --json",
)
def design(
    name: DesignFile,
    starts: Annotated[int, typer.Option(min=1, help="Searches; all but the first begin at random designs.")] = 1,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    samples: Annotated[int, typer.Option(min=0, help="Random designs that check the moments before and after.")] = 40,
    robust: Annotated[
        float | None,
        typer.Option(metavar="K", help="Raise the mean minus K standard deviations of the critical value."),
    ] = None,
    quantile: Annotated[
        float | None, typer.Option(metavar="Q", help="Raise the Q-quantile over random designs, such as 0.05.")
    ] = None,
    designs: Annotated[
        int | None, typer.Option(metavar="N", help="Random designs of --quantile; 10,000 in closed form, else 16.")
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where to begin, such as the optimum.toml of a search that was interrupted."),
    ] = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Choose parameters for the highest critical value under limits, and check the optimum.

    Ctrl-C ends the search and writes the best design so far.
    """
    from hbbogie.commandline.values import numbers_in
    from hbbogie.reports.design import design_of

    begin = None if start is None else numbers_in(start, "--start")
    job = functools.partial(
        design_of,
        starts=starts,
        seed=seed,
        samples=samples,
        robust=robust,
        quantile=quantile,
        designs=designs,
        start=begin,
    )
    do(name, overrides, output, as_json, job)
