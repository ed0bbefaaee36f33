"""The job of a slowly changing parameter, as a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import ModuleType

import numpy as np

from hbbogie.attraction.hysteresis import find_hysteresis
from hbbogie.branches.diagram import Diagram
from hbbogie.model.system import System
from hbbogie.progress import Progress, silent
from hbbogie.reports.around import _about
from hbbogie.reports.figures import Figures, draw
from hbbogie.reports.report import Report
from hbbogie.reports.table import Table
from hbbogie.results.hysteresis import Hysteresis, Passage
from hbbogie.units import behind, label

RAMP = (1.5, 7.0)  # the same of a ramp
RATES = 0.2  # fastest ramp, in distances of fold and Hopf point per period
HALVINGS = 4  # rates, each half the one before


def ramp_of(
    module: ModuleType,
    system: System,
    progress: Progress = silent,
    *,
    parameter: str | None = None,
    interval: tuple[float, float] | None = None,
    rates: Sequence[float] | None = None,
    start: Mapping[str, float] | None = None,
    rise_from: float | None = None,
    level: float | None = None,
) -> Report:
    """Let a parameter fall and rise slowly, and find where oscillation dies out and starts.

    Parameters
    ----------
    module : module
        Its PARAMETER and RANGE say where cycles are looked for.
    system : System
    progress : callable
        Called with (message, fraction done or None).
    parameter : str, optional
    interval : (float, float), unit of the parameter, optional
        About fold and Hopf point where left out.
    rates : sequence of float, unit of the parameter per second, optional
        Four, each half the one before, where left out.
    start, rise_from, level
        As of `find_hysteresis`.

    Raises
    ------
    ModelError
        For wrong input, or where there is no stable cycle at the upper end.
    """
    parameter, found, (lo, hi) = _about(module, system, parameter, interval, RAMP, progress)
    branches = list(found.branches.values())
    runs = find_hysteresis(
        system,
        parameter,
        (lo, hi),
        _rates(found, hi - lo) if rates is None else rates,
        level=level,
        start=start,
        rise_from=rise_from,
        branches=branches,
        progress=progress,
    )
    across = label(f"{system.parameter(parameter).description} {parameter}".strip(), runs.parameter_unit)
    figures: Figures = {"ramp": partial(draw, "hysteresis", runs, branches, found.hopf, parameter_label=across)}
    if (runs.late_falling > 0).any() or (runs.late_rising > 0).any():
        figures["ramp_delays"] = partial(draw, "delays", runs)
    unit = behind(runs.unit)
    notes = (
        f"Oscillation has died out where the peaks of {runs.coordinate} fall below {runs.level:.6g}{unit} for good, "
        f"and has started where they first reach it ({runs.meaning}).",
        *(
            f"{'Falling' if p.rate < 0 else 'Rising'} by {abs(p.rate):g}: {p.status}."
            for p in (*runs.falling, *runs.rising)
            if np.isnan(p.event)
        ),
        *found.notes,
    )
    summary = {
        "parameters": runs.parameters,
        "parameter": parameter,
        "level": runs.level,
        "fold": runs.fold,
        "hopf": runs.hopf,
        "exponents_falling": runs.exponents(runs.late_falling),
        "exponents_rising": runs.exponents(runs.late_rising),
        "status": [p.status for p in (*runs.falling, *runs.rising)],
    }
    return Report(
        f"{system.name}: {parameter} slowly falling and rising",
        (ramp_table(runs),),
        {},
        figures,
        notes,
        summary,
        (peaks_table(runs),),
        summary=_sentences(runs),
        about=(f"Motions while {parameter} falls and rises between {lo:.5g} and {hi:.5g}.",),
    )


def _rates(found: Diagram, width: float) -> list[float]:
    """Return rates that suit the first Hopf point and the width of the interval, each half the one before."""
    hopf = min(found.hopf, key=lambda s: s.value, default=None)
    period = 2 * np.pi / hopf.omega if hopf else 1.0
    fastest = RATES * width / (1 + sum(RAMP)) / period
    return [float(f"{fastest:.0e}") / 2**k for k in range(HALVINGS)]


def _sentences(runs: Hysteresis) -> tuple[str, ...]:
    """Return where oscillation dies out and starts at the slowest rate."""
    unit, said = behind(runs.parameter_unit), []
    k = int(np.argmin(np.abs(runs.rates)))
    rate = f"at {abs(float(runs.rates[k])):g}{unit} per second, the slowest rate,"
    for passage, what, beside, name in (
        (runs.falling[k], "dies out", runs.fold, "fold"),
        (runs.rising[k], "starts", runs.hopf, "Hopf point"),
    ):
        if np.isfinite(passage.event):
            near = f"; the {name} is at {beside:.4g}{unit}" if np.isfinite(beside) else ""
            said.append(f"Oscillation {what} {rate} at {runs.parameter} = {passage.event:.4g}{unit}{near}.")
    return tuple(said)


def ramp_table(runs: Hysteresis) -> Table:
    """Return for each rate where oscillation dies out and starts, how late that is, and the exponents between rates."""
    unit = runs.parameter_unit
    columns = (
        label("rate", f"{unit or '1'} per s"),
        label(f"{runs.parameter} where it dies out", unit),
        label("below the fold", unit),
        "exponent",
        label(f"{runs.parameter} where it starts", unit),
        label("beyond the Hopf point", unit),
        "exponent ",
        label("by linear growth", unit),
    )
    falling, rising = (np.r_[np.nan, runs.exponents(late)] for late in (runs.late_falling, runs.late_rising))
    rows = []
    for k, rate in enumerate(runs.rates):
        fall, rise = runs.falling[k], runs.rising[k]
        numbers = (
            fall.event,
            runs.late_falling[k],
            falling[k],
            rise.event,
            runs.late_rising[k],
            rising[k],
            rise.predicted,
        )
        rows.append((float(rate), *(float(x) if np.isfinite(x) else None for x in numbers)))
    critical = [
        f"{name} {value:.6g}{behind(unit)}"
        for name, value in (("fold", runs.fold), ("Hopf point", runs.hopf))
        if np.isfinite(value)
    ]
    return Table(
        "ramp",
        f"{runs.system}: {runs.parameter} falling and rising ({', '.join(critical)})",
        columns,
        tuple(rows),
        (".6g", ".6g", ".4g", ".3f", ".6g", ".4g", ".3f", ".6g"),
        ("The exponent is that of the delay in the rate, between a rate and the one above it.",),
    )


def peaks_table(runs: Hysteresis) -> Table:
    """Return the peaks of all passages."""
    columns = (
        label("rate", f"{runs.parameter_unit or '1'} per s"),
        label(runs.parameter, runs.parameter_unit),
        label(f"peak {runs.coordinate}", runs.unit),
    )
    passages: tuple[Passage, ...] = (*runs.falling, *runs.rising)
    rows = [(p.rate, float(v), float(y)) for p in passages for v, y in zip(p.values, p.peaks, strict=True)]
    return Table("ramp_peaks", "Peaks", columns, tuple(rows), (".6g", ".7g", ".6g"))
