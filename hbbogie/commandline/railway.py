"""The command about wheel and rail."""

from __future__ import annotations

from typing import Annotated

import typer

from hbbogie.commandline.application import AsJson, MaybeOutput, command, written


@command(
    "hbbogie conicity s1002 uic60",
    "hbbogie conicity worn_wheel.txt uic60 --gauge 1433 --output out",
    "hbbogie conicity s1002 uic60 --inclination 0.05",
    "hbbogie conicity s1002 rail.csv --mirror-rail --amplitudes 1,3,5 --json",
    "hbbogie conicity right_wheel.txt uic60 --left-wheel left_wheel.txt --left-radius 459.6",
)
def conicity(
    wheel: Annotated[str, typer.Argument(metavar="WHEEL", help="s1002, or a text file of two columns, y and z in mm.")],
    rail: Annotated[str, typer.Argument(metavar="RAIL", help="uic60, or a text file of two columns, y and z in mm.")],
    amplitudes: Annotated[
        str | None, typer.Option(metavar="LIST", help="Amplitudes in mm, separated by commas; by default 1 to 7.")
    ] = None,
    largest: Annotated[float, typer.Option(help="Largest lateral shift in mm.")] = 8.0,
    step: Annotated[float, typer.Option(help="Step of the lateral shift in mm.")] = 0.1,
    gauge: Annotated[float, typer.Option(help="Track gauge in mm.")] = 1435.0,
    back_to_back: Annotated[float, typer.Option(help="Distance of the backs of the flanges in mm.")] = 1360.0,
    radius: Annotated[float, typer.Option(help="Wheel radius at the rolling circle in mm.")] = 460.0,
    left_wheel: Annotated[
        str | None, typer.Option(metavar="WHEEL", help="Profile of the left wheel, where it is another one.")
    ] = None,
    left_rail: Annotated[
        str | None, typer.Option(metavar="RAIL", help="Profile of the left rail, where it is another one.")
    ] = None,
    left_radius: Annotated[
        float | None, typer.Option(metavar="RADIUS", help="Radius of the left wheel in mm, where it is another one.")
    ] = None,
    mirror_rail: Annotated[
        bool, typer.Option("--mirror-rail", help="The gauge face is at y > 0 in the file of the rail.")
    ] = False,
    inclination: Annotated[
        float | None,
        typer.Option(
            metavar="SLOPE",
            help="Inclination of the rails, such as 0.05 for 1:20: of uic60 in place of 1:40, of a file how much its "
            "rail is turned inwards.",
        ),
    ] = None,
    output: MaybeOutput = None,
    as_json: AsJson = False,
) -> None:
    """Equivalent conicity by EN 15302, from the profiles of wheel and rail."""
    from hbbogie.commandline.terminal import deliver, listed, progress_shown
    from hbbogie.reports.conicity import AMPLITUDES, conicity_of
    from hbbogie.reports.report import check_directory

    if output is not None:
        check_directory(output)
    with progress_shown() as progress:
        progress("computing the contact geometry", None)
        found = conicity_of(
            wheel,
            rail,
            amplitudes=listed(amplitudes, "--amplitudes") if amplitudes else AMPLITUDES,
            largest=largest,
            step=step,
            gauge=gauge,
            back_to_back=back_to_back,
            radius=radius,
            mirrored=mirror_rail,
            inclination=inclination,
            left_wheel=left_wheel,
            left_rail=left_rail,
            left_radius=left_radius,
        )
        files = written(found, output, progress)
    deliver(found, files, as_json)
