"""Reports on files for other programs."""

from __future__ import annotations

from types import ModuleType

from hbbogie.branches.cycles import find_cycles
from hbbogie.errors import ModelError, named
from hbbogie.exchange import to_auto
from hbbogie.model.problem import default_interval
from hbbogie.model.system import System
from hbbogie.progress import Progress, silent
from hbbogie.reports.cycles import report_of_cycles
from hbbogie.reports.report import Report

PROGRAMS = ("auto",)


def export_of(
    module: ModuleType,
    system: System,
    progress: Progress = silent,
    *,
    program: str = "auto",
    parameter: str | None = None,
    interval: tuple[float, float] | None = None,
) -> Report:
    """Write a system and one of its cycles for another program.

    Parameters
    ----------
    module : module
        Its PARAMETER and RANGE say which branch, unless parameter and interval are given.
    system : System
        The cycle is one at its parameter values: a stable one where there is one.
    progress : callable
        Called with (message, fraction done or None).
    program : {"auto"}
        AUTO-07p.
    parameter : str, optional
    interval : tuple of float, optional

    Raises
    ------
    ModelError
        When no cycle is found to start from.
    """
    named("export", "program", program, PROGRAMS)
    parameter, reach = default_interval(module, system, parameter)
    interval = interval or reach
    at = f"{parameter} = {system.values[parameter]:g}"
    progress(f"finding a cycle at {at}", None)
    cycles = find_cycles(system, parameter=parameter, interval=interval)
    if not cycles:
        raise ModelError(f"{system.name}: {cycles.evidence[0]}. Give other values to start from a cycle.")
    start = min(cycles, key=lambda c: (c.verdict != "stable", c.period))
    texts = to_auto(system, start, parameter, interval)
    script = next(name for name in texts if name.endswith(".auto"))
    note = f"AUTO-07p follows the branch of the {start.verdict} cycle at {at} both ways: run `auto {script}` there."
    found = report_of_cycles(system, parameter, [start])
    return Report(f"{system.name}: files for AUTO-07p", found.tables[:1], notes=(note,), texts=texts)
