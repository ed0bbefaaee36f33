"""The command that draws critical values over two parameters."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

import typer

from hbbogie.commands import AsJson, Harmonics, Interval, Output, Overrides, ParameterName, Problem, command, do


@command(
    "hbbogie chart yang1995 --over lam 0.02 0.3",
    "hbbogie chart yang1995 --over K1 1e6 6e6 --set lam=0.1 --json",
    "hbbogie chart bautin --parameter mu --over a 0.1 1",
)
def chart(
    name: Problem,
    over: Annotated[
        tuple[str, float, float],
        typer.Option("--over", metavar="NAME LO HI", help="Second parameter and its range."),
    ],
    parameter: ParameterName = None,
    interval: Interval = None,
    harmonics: Harmonics = 15,
    secondary: Annotated[
        bool,
        typer.Option("--secondary", help="Look for folds also beside an equilibrium that is unstable on both sides."),
    ] = False,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Follow folds and Hopf points over a second parameter, and draw them in the plane of both."""
    from hbbogie.chart_report import chart_of

    second, low, high = over
    options = {"parameter": parameter, "span": interval, "harmonics": harmonics, "secondary": secondary}
    job = functools.partial(chart_of, over=second, interval=(low, high), **options)  # type: ignore[arg-type]
    do(name, overrides, output, as_json, job)
