"""The command that opens the explorer."""

from __future__ import annotations

from typing import Annotated

import typer

from hbbogie.commandline.application import Interval, Overrides, ParameterName, Problem, command, load


@command(
    "hbbogie explore yang1995",
    "hbbogie explore yang1995 --parameter K2 --range 5e6 20e6 --set V=95",
    "hbbogie explore my_bogie.py --port 9000 --no-browser",
)
def explore(
    name: Problem,
    parameter: ParameterName = None,
    interval: Interval = None,
    port: Annotated[int, typer.Option(help="Port on this machine; 0 for any free one.")] = 8765,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    overrides: Overrides = None,
) -> None:
    """Open a page with a slider for every parameter, and the bifurcation diagram that follows them."""
    from hbbogie.explorer import Session, opening, serve

    module, system = load(name, overrides)
    session = Session(name, module, system, opening(module, system, parameter, *(interval or ())))

    def ready(address: str) -> None:
        print(f"{system.name} at {address}  (this machine only; Ctrl-C ends it)", flush=True)

    serve(session, port, browser=browser, ready=ready)
    print("Ended.")
