"""Commands that confirm the picture by motions in time: basins of attraction, slowly changing parameters."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

import typer

from hbbogie.commandline.application import (
    AsJson,
    Interval,
    Output,
    Overrides,
    ParameterName,
    Problem,
    command,
    do,
    load,
    written,
)


@command(
    "hbbogie basin yang1995",
    "hbbogie basin yang1995 --along q1=1,q3=1 --range 88 92",
    "hbbogie basin bautin --points 10 --amplitudes 20 --workers 1",
)
def basin(
    name: Problem,
    parameter: ParameterName = None,
    interval: Interval = None,
    points: Annotated[int, typer.Option(help="Number of parameter values.")] = 25,
    amplitudes: Annotated[int, typer.Option(help="Number of initial amplitudes at each.")] = 40,
    along: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=VALUE,...", help="Direction of the initial states; by default that of the unstable cycle."
        ),
    ] = None,
    largest: Annotated[
        float | None, typer.Option(help="Largest factor of the unstable cycle's shape, or of the direction.")
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Longest motion in s; by default 130 periods.")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; by default one for each core.")] = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Map which motions die out and which settle on a cycle, over a parameter and the initial amplitude."""
    from hbbogie.commandline.terminal import deliver, numbers, progress_shown
    from hbbogie.parallel.processes import cores
    from hbbogie.reports.basin import basin_of
    from hbbogie.reports.report import check_directory

    module, system = load(name, overrides)
    direction = numbers(along.split(","), "--along") if along is not None else None
    folder = check_directory(output)
    with progress_shown() as progress:
        found, scan = basin_of(
            module,
            system,
            progress,
            parameter=parameter,
            interval=interval,
            speeds=points,
            amplitudes=amplitudes,
            along=direction,
            largest=largest,
            duration=duration,
            workers=cores() if workers is None else workers,
        )
        files = written(found, folder, progress)
        scan.save(folder / "basin.nc")
    deliver(found, [*files, folder / "basin.nc"], as_json)


@command(
    "hbbogie animate yang1995 --set V=100",
    "hbbogie animate yang1995 --set V=80 --output falling.gif",
    "hbbogie animate van_der_pol --set mu=3",
)
def animate(
    name: Problem,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="A .gif or .mp4; by default NAME.gif here.")
    ] = None,
    coordinate: Annotated[str | None, typer.Option(metavar="NAME", help="By default the first one.")] = None,
    cycle: Annotated[
        int | None, typer.Option(help="Which cycle, from 1, by growing amplitude; by default the largest stable one.")
    ] = None,
    frames: Annotated[int, typer.Option(help="Number of pictures.")] = 50,
    overrides: Overrides = None,
) -> None:
    """Show how a system moves on its cycle, or how it comes to rest, as a moving picture."""
    from hbbogie import plot
    from hbbogie.commandline.terminal import progress_shown
    from hbbogie.reports.animation import motion_to_show

    module, system = load(name, overrides)
    target = plot.check_target(output or Path(f"{Path(name).stem}.gif"))
    with progress_shown() as progress:
        motion, said = motion_to_show(module, system, progress, cycle=cycle)
        progress("drawing", None)
        plot.animate(motion, target, getattr(module, "sketch", None), coordinate, frames=frames)
    print(f"{target}: {said}")


@command(
    "hbbogie ramp yang1995",
    "hbbogie ramp yang1995 --rates 2,1,0.5,0.25 --range 85 110",
    "hbbogie ramp yang1995 --start q1=1e-4 --rise-from 89",
    "hbbogie ramp bautin --json",
)
def ramp(
    name: Problem,
    parameter: ParameterName = None,
    interval: Interval = None,
    rates: Annotated[
        str | None, typer.Option(metavar="LIST", help="Rates per second, separated by commas; each is run down and up.")
    ] = None,
    start: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Disturbance at which the rise begins; may be repeated."),
    ] = None,
    rise_from: Annotated[
        float | None, typer.Option(help="Parameter value where the rise begins; by default the Hopf point.")
    ] = None,
    level: Annotated[
        float | None, typer.Option(help="Peak below which oscillation has died out; by default the gap of a contact.")
    ] = None,
    output: Output = Path("out"),
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Simulate with a slowly falling and rising parameter: where oscillation dies out, and where it starts."""
    from hbbogie.commandline.terminal import listed, numbers
    from hbbogie.reports.ramp import ramp_of

    options = {
        "parameter": parameter,
        "interval": interval,
        "rates": listed(rates, "--rates") if rates else None,
        "start": numbers(start, "--start") or None,
        "rise_from": rise_from,
        "level": level,
    }
    do(name, overrides, output, as_json, functools.partial(ramp_of, **options))  # type: ignore[arg-type]
