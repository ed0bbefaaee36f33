"""Commands that compare methods, identify parameters and find critical values."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

import typer

from hbbogie.commands import AsJson, Interval, Output, Overrides, ParameterName, Problem, command, do


@command(
    "hbbogie compare yang1995",
    "hbbogie compare yang1995 --methods df1,df2,mhb3,mhb15",
    "hbbogie compare bautin --methods df1,mhb3 --values -0.2,-0.1,0.1",
)
def compare(
    name: Problem,
    methods: Annotated[
        str | None, typer.Option(metavar="LIST", help="Methods, separated by commas: df1, df2, mhb and a harmonic.")
    ] = None,
    values: Annotated[
        str | None, typer.Option(metavar="LIST", help="Parameter values to compare at, separated by commas.")
    ] = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Compare methods: describing functions, multi-harmonic balance, and what the problem's paper used."""
    from hbbogie.comparison_report import comparison_of
    from hbbogie.terminal import listed

    chosen = methods.split(",") if methods else None
    at = listed(values, "--values") if values else None
    do(name, overrides, output, as_json, lambda module, system, say: comparison_of(module, system, chosen, at, say))


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
    robust: Annotated[bool, typer.Option("--robust", help="Take weight from rows far from the others.")] = False,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Identify parameters of a problem from its published cycles, by least squares."""
    from hbbogie import report

    options = {"free": free.split(",") if free else None, "theory": theory, "robust": robust}
    do(
        name,
        overrides,
        output,
        as_json,
        lambda module, system, say: report.identification(module, system, say, **options),
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
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Find the critical values of a parameter, Hopf points and folds, with their gradients."""
    from hbbogie.critical_report import critical_of

    do(name, overrides, output, as_json, functools.partial(critical_of, parameter=parameter, interval=interval))
