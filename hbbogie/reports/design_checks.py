"""Checks of an optimal design by other means: a search anew, one nonlinear program, integration in time."""

from __future__ import annotations

from typing import Any

from hbbogie.critical.speeds import critical_speeds
from hbbogie.design.criteria import Expression
from hbbogie.design.optimisation import Design
from hbbogie.design.point import DesignPoint, stable_cycle
from hbbogie.design.single_program import single_level
from hbbogie.motion.settling import settle
from hbbogie.progress import Progress
from hbbogie.reports.table import Table
from hbbogie.results.failure import ConvergenceError
from hbbogie.units import behind, label

OFF = 0.01  # share below and above the critical value at which motions are integrated
FASTER = 0.1  # share above it where the cycle lives from which these motions start
LEAST = 0.1  # of the range: the shares are of the critical value, but of no less than this


def check_table(design: Design, task: dict[str, Any], progress: Progress) -> Table:
    """Return the checks of the optimum: a search without a guess, one nonlinear program, integration in time."""
    point, unit = design.after, design.before.system.parameter(design.before.parameter).unit
    rows: list[tuple[str, str, float | None]] = []
    progress("searching for all critical values anew", None)
    found = critical_speeds(point.system, point.parameter, point.interval)
    first = found[0].value if found else point.interval[1]
    rows.append(("searched anew, without a guess", "; ".join(found.undecided) or "smallest Hopf point or fold", first))
    others = {a.name for a in design.active if a.kind == "limit"}
    mine = [limit for limit in task.get("subject_to", ()) if isinstance(limit.quantity, Expression)]
    same = design.before.names == design.after.names and "maximise" not in task and "minimise" not in task
    if same and others <= {limit.quantity.name for limit in mine}:
        progress("one nonlinear program", None)
        one = single_level(design.before, design.over, mine)
        rows.append(("one nonlinear program", one.status, one.value))
    for share in (-OFF, OFF):
        value = _aside(point, share)
        progress(f"integrating at {point.parameter} = {value:.5g}", None)
        text = f"motion {abs(value - point.value):.3g}{behind(unit)}" + (" above" if share > 0 else " below")
        rows.append((text, _settled(point, value), value))
    columns = ("check", "result", label(point.parameter, unit))
    title = f"Checks of the optimum, {point.parameter} = {point.value:.8g}{behind(unit)}"
    notes = (
        f"The motions start on the cycle at {_aside(point, FASTER):.5g}{behind(unit)}"
        + ". The nonlinear program knows the limits on "
        "parameters and the critical values of the first design only, and is left out where others hold the optimum.",
    )
    return Table("checks", title, columns, tuple(rows), ("", "", ".8g"), notes)


def _aside(point: DesignPoint, share: float) -> float:
    """Return the value a share beyond the smallest critical value, which may lie near 0."""
    low, high = point.interval
    return point.value + share * max(abs(point.value), LEAST * (high - low))


def _settled(point: DesignPoint, value: float) -> str:
    try:
        start = stable_cycle(point, "check", _aside(point, FASTER))
        if start is None:
            return "there is no cycle to start from"
        at: dict[str, Any] = {point.parameter: value}
        settled = settle(point.system, start, **at)
    except ConvergenceError as error:
        return f"not decided: {error}"
    if settled.kind != "cycle":
        return {"rest": "dies out", "undecided": "undecided"}[settled.kind]
    name = point.system.coordinate_names[0]
    return f"settles on a cycle, peak of {name} {settled.amplitudes[name]:.4g}, omega {settled.omega:.5g} rad/s"
