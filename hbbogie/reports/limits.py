"""Where branches meet a limit on an output, with gradients: tables, sentences and a figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from hbbogie.critical.limits import limit_points
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.reports.figures import Figures, draw
from hbbogie.reports.report import Report
from hbbogie.reports.table import Table
from hbbogie.results import Branch, LimitLine, LimitPoint, SpecialPoint
from hbbogie.results.failure import FAILURES
from hbbogie.stability.multipliers import floquet
from hbbogie.units import behind, label

MOST = 63  # harmonics with which the cycles at a limit are solved for
SHOWN = 5  # parameters in a sentence


def with_limit(report: Report, system: System, of: str, limit: float, quantity: str = "rms") -> Report:
    """Add to a report on branches where their cycles meet a limit, and how that place moves with every parameter.

    Parameters
    ----------
    report : Report
        With branches of cycles of the system.
    system : System
    of : str
        Name of a coordinate or output.
    limit : float, its unit
    quantity : {"rms", "peak", "first harmonic"}

    Raises
    ------
    ModelError
        As of `limit_points`.
    """
    points, notes = _met(system, report.branches, of, limit, quantity)
    unit = system.naming.units.get(of, "")
    told = f"the {quantity} of {of} meets {limit:g}{behind(unit)}"
    if not points:
        notes = [f"On no branch {told}.", *notes]
        return replace(report, notes=(*notes, *report.notes))
    names = list(report.branches)
    branches = [report.branches[name] for name in names]
    line = LimitLine(limit, "limit", unit)
    special = [
        SpecialPoint("limit met", c.parameter, c.value, (c.value, c.value), c.orbit, c.status) for _, c in points
    ]
    across = label(
        f"{system.parameter(branches[0].parameter).description} {branches[0].parameter}".strip(), branches[0].unit
    )
    options = {"y": of, "quantity": quantity, "limits": [line], "special": special, "parameter_label": across}
    figures: Figures = {**report.figures, "limit": partial(draw, "branch", branches, **options)}
    sentences = [f"{_begun(_where(system, c))} {told}: {_influence(c)}." for _, c in points]
    tables = (*report.tables, _places(system, points, told), _gradients(system, points))
    return replace(report, tables=tables, figures=figures, notes=(*sentences, *notes, *report.notes))


def _met(
    system: System, branches: Mapping[str, Branch], of: str, limit: float, quantity: str
) -> tuple[list[tuple[str, LimitPoint]], list[str]]:
    """Return the points with the names of their branches, and a sentence on each branch whose points were lost."""
    found, notes = list[tuple[str, LimitPoint]](), list[str]()
    for name, branch in branches.items():
        equations = HarmonicBalance(min(MOST, max(o.kept or MOST for o in branch.orbits))).equations(system)
        try:
            points = limit_points(equations, branch, of, limit, quantity)
        except FAILURES as error:
            notes.append(f"{name}: {error}")
            continue
        found += [(name, replace(c, orbit=c.orbit.replace(stability=floquet(system, c.orbit)))) for c in points]
    return sorted(found, key=lambda pair: pair[1].value), notes


def _where(system: System, c: LimitPoint) -> str:
    moves = moving_groups(system, c.orbit)
    return f"at {system.naming.value(c.parameter, c.value, 6)} ({', '.join(filter(None, (moves, c.orbit.verdict)))})"


def _begun(text: str) -> str:
    return text[0].upper() + text[1:]


def _influence(c: LimitPoint) -> str:
    """Return the most influential parameters in words."""
    order = sorted(c.gradient, key=lambda n: -abs(np.nan_to_num(c.elasticities[n])))[:SHOWN]
    return "per cent for one per cent " + ", ".join(f"{n} {c.elasticities[n]:+.3g}" for n in order)


def _places(system: System, points: list[tuple[str, LimitPoint]], told: str) -> Table:
    first = points[0][1]
    unit = system.parameter(first.parameter).unit
    columns = ["branch", label(first.parameter, unit), "omega [rad/s]", "frequency [Hz]", "stability"]
    columns += [f"derivative by the limit [{unit or '1'} per unit]", "residual [1]"]
    formats = ["", ".8g", ".7g", ".7g", "", ".5g", ".1e"]
    rows = [(name, c.value, c.omega, c.orbit.frequency, c.orbit.verdict, c.per_limit, c.residual) for name, c in points]
    if system.groups:
        columns, formats = [*columns, "moves"], [*formats, ""]
        rows = [(*row, moving_groups(system, c.orbit)) for row, (_, c) in zip(rows, points, strict=True)]  # type: ignore[misc]
    return Table("limits", f"Where {told}", tuple(columns), tuple(rows), tuple(formats))


def _gradients(system: System, points: list[tuple[str, LimitPoint]]) -> Table:
    """Return gradients and elasticities, the most influential parameter first."""
    found = [c for _, c in points]
    per = f"{system.parameter(found[0].parameter).unit or '1'} per unit"
    columns = ["parameter", "unit", "value"]
    for c in found:
        columns += [f"gradient, limit {c.value:.5g} [{per}]", f"elasticity, limit {c.value:.5g} [1]"]
    order = sorted(found[0].gradient, key=lambda n: -max(abs(np.nan_to_num(c.elasticities[n])) for c in found))
    rows = []
    for n in order:
        numbers = [x for c in found for x in (c.gradient[n] + 0.0, c.elasticities[n] + 0.0)]
        rows.append((n, system.parameter(n).unit or "1", system.values[n], *numbers))
    formats = ("", "", ".6g", *["z.5g", "z.5f"] * len(found))
    return Table("limit_gradients", "Gradients of where the limit is met", tuple(columns), tuple(rows), formats)
