"""A chart over two parameters as tables, sentences and a figure."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from hbbogie.critical.charts import chart
from hbbogie.model.problem import default_interval
from hbbogie.model.system import System
from hbbogie.progress import Progress, silent
from hbbogie.reports.report import Report
from hbbogie.reports.table import Table
from hbbogie.results import Chart
from hbbogie.units import behind, label

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def chart_of(
    module: ModuleType,
    system: System,
    progress: Progress = silent,
    *,
    over: str,
    interval: tuple[float, float],
    parameter: str | None = None,
    span: tuple[float, float] | None = None,
    method: str = "auto",
    harmonics: int | None = None,
    secondary: bool = False,
) -> Report:
    """Follow folds and Hopf points of a problem over a second parameter.

    Parameters
    ----------
    module : module
        As returned by `load_problem`; its PARAMETER holds where nothing is said.
    system : System
    progress : callable
        Called with (message, fraction done or None).
    over : str
        The second parameter.
    interval : (float, float), unit of the second parameter
    parameter : str, optional
        The parameter whose critical values are followed.
    span : (float, float), optional, unit of that parameter
        Where critical values are looked for; the problem's RANGE where nothing is said.
    method : str
        As of `chart`.
    harmonics : int, optional
        Highest harmonic of the cycles, as of `chart`.
    secondary : bool
        Whether to look for folds also on branches from Hopf points of an unstable equilibrium.
    """
    name, own = default_interval(module, system, parameter)
    options = {"span": span or own, "method": method, "harmonics": harmonics, "secondary": secondary}
    found = chart(system, name, over, interval, progress=progress, **options)  # type: ignore[arg-type]
    heads = label(name, system.parameter(name).unit), label(over, system.parameter(over).unit)
    tables = [_curves(found, heads)] + ([_special(found, heads)] if found.special else [])
    data = {"without_fold": found.without_fold, "without_hopf": found.without_hopf}
    title = f"{system.name}: critical values of {name} over {over}"
    figures: dict[str, Callable[[], Figure]] = {"chart": partial(_figure, found)}
    return Report(
        title,
        tuple(tables),
        {},
        figures,
        found.notes,
        data,
        (_points(found, heads),),
        summary=_sentences(found, system, name, over),
        about=(f"Folds and Hopf points over {system.naming.plain(over)} from {interval[0]:g} to {interval[1]:g}.",),
    )


def _sentences(found: Chart, system: System, name: str, over: str) -> tuple[str, ...]:
    """Return where the curves of critical values lie, and where rest and cycles coexist most widely."""
    units = {n: behind(system.parameter(n).unit) for n in (name, over)}
    said = []
    for c in found.curves:
        first, last = (int(i) for i in (np.argmin(c.over_values), np.argmax(c.over_values)))
        kind = "fold" if c.kind == "fold" else "Hopf point"
        said.append(
            f"The {kind} goes from {name} = {c.values[first]:.4g}{units[name]} at {over} = {c.over_values[first]:.4g} "
            f"to {c.values[last]:.4g}{units[name]} at {over} = {c.over_values[last]:.4g}{units[over]}."
        )
    return tuple(said)


def _curves(found: Chart, heads: tuple[str, str]) -> Table:
    columns = ("curve", "kind", "points", f"{heads[1]} from", "to", f"{heads[0]} from", "to")
    rows = []
    for i, c in enumerate(found.curves):
        kinds = ", ".join(k for k in dict.fromkeys(c.character) if k != "undecided" or len(set(c.character)) == 1)
        kind = "fold" if c.kind == "fold" else "Hopf point" if np.any(c.side != 0) else "Hopf point, unstable rest"
        low, high = c.extent
        extent = float(c.values.min()), float(c.values.max())
        rows.append((i + 1, f"{kind}, {kinds}", len(c), low, high, *extent))
    formats = ("", "", "", ".6g", ".6g", ".6g", ".6g")
    notes = tuple(f"Curve {i + 1}: {'; '.join(dict.fromkeys(map(str, c.ends)))}." for i, c in enumerate(found.curves))
    return Table("chart_curves", "Curves", columns, tuple(rows), formats, notes)


def _special(found: Chart, heads: tuple[str, str]) -> Table:
    columns = ("kind", "on the curve of", heads[1], heads[0], "omega [rad/s]")
    curve = {"fold": "folds", "hopf": "Hopf points"}
    notes = tuple(f"{s.kind.capitalize()}: {s.status}." for s in found.special)
    rows = tuple((s.kind, curve[s.curve], s.over_value, s.value, s.omega) for s in found.special)
    return Table("chart_points", "Special points", columns, rows, ("", "", ".8g", ".8g", ".7g"), notes)


def _points(found: Chart, heads: tuple[str, str]) -> Table:
    columns = ("curve", "kind", heads[1], heads[0], "omega [rad/s]", "slope", "character", "side", "residual [1]")
    rows = tuple(
        (i + 1, c.kind, over, value, omega, slope if np.isfinite(slope) else None, character, int(side), error)
        for i, c in enumerate(found.curves)
        for over, value, omega, slope, character, side, error in zip(
            c.over_values, c.values, c.omega, c.slope, c.character, c.side, c.residual, strict=True
        )
    )
    return Table("chart", "Points", columns, rows, ("", "", ".8g", ".8g", ".7g", ".5g", "", "", ".1e"))


def _figure(found: Chart) -> Figure:
    """Draw the chart, and below it the width of the region of coexistence where there is one."""
    from hbbogie import plot

    over = np.linspace(*found.interval, 200)
    if not any(np.any(high > low) for low, high in plot.coexistence(found, over)):
        return plot.figure_of(plot.chart(found))
    figure, ((top,), (bottom,)) = plot.panels(2, 1, (6.6, 6.6), found.system)
    plot.chart(found, top).set_xlabel("")
    plot.coexistence_width(found, bottom)
    return plot.one_legend(figure)
