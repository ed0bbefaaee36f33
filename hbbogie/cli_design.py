"""The command that chooses parameters for a higher critical value."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

import typer

from hbbogie.commands import AsJson, Output, Overrides, command, do

DesignFile = Annotated[
    str, typer.Argument(metavar="NAME", help="Name of a shipped problem with a design, or path of a file (.py).")
]


@command(
    "hbbogie design yang1995_design",
    "hbbogie design problems/yang1995_design.py --starts 4",
    "hbbogie design yang1995_design --robust 2 --set lam=0.06 --json",
)
def design(
    name: DesignFile,
    starts: Annotated[int, typer.Option(min=1, help="Searches; all but the first begin at random designs.")] = 1,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    samples: Annotated[int, typer.Option(min=0, help="Random designs that check the moments, before and after.")] = 40,
    robust: Annotated[
        float | None,
        typer.Option(metavar="K", help="Raise the mean minus K standard deviations of the critical value."),
    ] = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Choose parameters for the highest critical value under limits, and check the optimum."""
    from hbbogie.design_report import design_of

    job = functools.partial(design_of, starts=starts, seed=seed, samples=samples, robust=robust)
    do(name, overrides, output, as_json, job)
