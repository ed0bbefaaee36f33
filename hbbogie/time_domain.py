"""The jobs of a basin of attraction and of slowly changing parameters, as reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import ModuleType

import numpy as np

from hbbogie.basin import HARMONICS, check, find_basin
from hbbogie.curves import Curves, Progress, curves, default_interval, silent
from hbbogie.errors import ModelError
from hbbogie.figures import Figures, draw
from hbbogie.guesses import check_interval
from hbbogie.hysteresis import find_hysteresis
from hbbogie.report import Report
from hbbogie.results import Basin, Hysteresis, Passage
from hbbogie.system import System
from hbbogie.tables import Table, label

BEYOND_CYCLE = 1.65  # largest factor of the unstable cycle's shape
BEYOND_PEAK = 4.0  # largest amplitude along a direction, in units of the largest stable peak
ABOUT = (0.8, 0.8)  # how far a scan reaches below the fold and beyond the Hopf point, in units of their distance
RAMP = (1.5, 7.0)  # the same of a ramp
LEAST = 0.01  # their distance counts at least so much, relative to the value
RATES = 0.2  # fastest ramp, in distances of fold and Hopf point per period
HALVINGS = 4  # rates, each half the one before


def basin_of(
    module: ModuleType,
    system: System,
    progress: Progress = silent,
    *,
    parameter: str | None = None,
    interval: tuple[float, float] | None = None,
    speeds: int = 25,
    amplitudes: int = 40,
    along: Mapping[str, float] | None = None,
    largest: float | None = None,
    duration: float | None = None,
    workers: int = 1,
) -> tuple[Report, Basin]:
    """Scan how motions end over a parameter and the initial amplitude.

    Parameters
    ----------
    module : module
        Its PARAMETER and RANGE say where cycles are looked for.
    system : System
    progress : callable
        Called with (message, fraction done or None).
    parameter : str, optional
    interval : (float, float), unit of the parameter, optional
        Of the scan; about fold and Hopf point where left out.
    speeds, amplitudes : int
        Number of parameter values and of factors.
    along, duration, workers
        As of `find_basin`.
    largest : float, optional
        Largest factor: 1.65 along the unstable cycle (rounded so that 1 lies between two factors); along a direction
        four times the largest stable peak.

    Raises
    ------
    ModelError
        For wrong input, or where there is no unstable cycle to take a direction from.
    """
    for name, count in (("number of parameter values", speeds), ("number of amplitudes", amplitudes)):
        if count < 1:
            raise ModelError(f"{name}: got {count}; give a whole number, 1 or more.")
    check(system, along, duration, workers)  # before the cycles are traced
    parameter, found, (lo, hi) = _about(module, system, parameter, interval, ABOUT, progress)
    if largest is None:
        largest = BEYOND_CYCLE
        if along:
            name = next((n for n in along if n in system.coordinate_names), system.coordinate_names[0])
            inside = [o for b in found.branches.values() for o in b.orbits if lo <= o.parameters[parameter] <= hi]
            largest = (
                BEYOND_PEAK * max((o.amplitude(name) for o in inside), default=1.0) / (abs(along.get(name, 0.0)) or 1.0)
            )
    if not (np.isfinite(largest) and largest > 0):
        raise ModelError(f"largest amplitude: got {largest:g}; give a finite number above 0.")
    width = largest / amplitudes
    if not along:
        width = 1 / max(1, round(1 / width))  # the unstable cycle lies on an edge between cells
    factors = width * (np.arange(amplitudes) + 0.5)  # the middles of cells
    values = np.linspace(lo, hi, speeds) if speeds > 1 else np.array([0.5 * (lo + hi)])
    branches = list(found.branches.values())
    scan = find_basin(
        system,
        parameter,
        values,
        factors,
        along=along,
        duration=duration,
        branches=branches,
        workers=workers,
        progress=progress,
    )
    across = label(f"{system.parameter(parameter).description} {parameter}".strip(), scan.parameter_unit)
    figures: Figures = {"basin": partial(draw, "basin", scan, branches, found.hopf, parameter_label=across)}
    counts = {kind: int(scan.count(kind).sum()) for kind in ("rest", "cycle", "undecided")}
    why, often = np.unique(scan.reason[scan.outcome == "undecided"], return_counts=True)
    notes = (
        f"{system.name}: {scan.outcome.size} motion{'s' * (scan.outcome.size != 1)}; {counts['rest']} at rest in the "
        f"end, {counts['cycle']} on a cycle, {counts['undecided']} undecided. Factors multiply: {scan.direction}.",
        *(f"Undecided ({times}): {reason}." for reason, times in zip(why, often, strict=True)),
        *found.notes,
        *scan.notes,
    )
    data = {"parameters": scan.parameters, "parameter": parameter, "direction": scan.direction, "counts": counts}
    report = Report(system.name, (basin_table(scan),), {}, figures, notes, data, (motions_table(scan),))
    return report, scan


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
    if rates is None:
        hopf = min(found.hopf, key=lambda s: s.value, default=None)
        period = 2 * np.pi / hopf.omega if hopf else 1.0
        fastest = RATES * (hi - lo) / (1 + sum(RAMP)) / period
        rates = [float(f"{fastest:.0e}") / 2**k for k in range(HALVINGS)]
    runs = find_hysteresis(
        system,
        parameter,
        (lo, hi),
        rates,
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
    unit = f" {runs.unit}" if runs.unit not in ("", "1") else ""
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
    return Report(system.name, (ramp_table(runs),), {}, figures, notes, summary, (peaks_table(runs),))


def _about(
    module: ModuleType,
    system: System,
    parameter: str | None,
    interval: tuple[float, float] | None,
    reach: tuple[float, float],
    progress: Progress,
) -> tuple[str, Curves, tuple[float, float]]:
    """Return the parameter, the curves of cycles over it, and the range: as given, else about fold and Hopf point."""
    parameter, own = default_interval(module, system, parameter)
    if interval is not None:
        lo, hi = check_interval(system, parameter, interval)
        own = min(own[0], lo), max(own[1], hi)
    found = curves(system, parameter, own, harmonics=HARMONICS, progress=progress)
    if interval is not None:
        return parameter, found, (lo, hi)
    lo, hi = own
    folds = [s.value for b in found.branches.values() for s in b.folds()]
    hopf = [s.value for s in found.hopf]
    for at in sorted(hopf):  # the first Hopf point with a fold below it, and the nearest fold
        below = [fold for fold in folds if fold < at]
        if below:
            width = max(at - max(below), LEAST * abs(at))
            return parameter, found, (max(lo, max(below) - reach[0] * width), min(hi, at + reach[1] * width))
    return parameter, found, (lo, hi)


# --- tables -----------------------------------------------------------------------------------


def basin_table(scan: Basin) -> Table:
    """Return for each parameter value the cycles' peaks, and between which initial amplitudes the outcome changes."""
    name = scan.coordinate
    columns = (
        label(scan.parameter, scan.parameter_unit),
        label(f"peak {name}, unstable cycle", scan.unit),
        label(f"peak {name}, stable cycle", scan.unit),
        label("largest at rest", scan.unit),
        label("smallest on a cycle", scan.unit),
        "at rest",
        "on a cycle",
        "undecided",
    )
    rows = []
    for i, value in enumerate(scan.values):
        rest, cycle = (scan.amplitudes[i][scan.outcome[i] == kind] for kind in ("rest", "cycle"))
        ends = (float(rest.max()) if len(rest) else None, float(cycle.min()) if len(cycle) else None)
        known = [float(v) if np.isfinite(v) else None for v in (scan.unstable[i], scan.stable[i])]
        counts = (int(scan.count(kind)[i]) for kind in ("rest", "cycle", "undecided"))
        rows.append((float(value), *known, *ends, *counts))
    return Table(
        "basin",
        f"{scan.system}: how motions end, by initial amplitude of {name}",
        columns,
        tuple(rows),
        (".6g", ".5g", ".5g", ".5g", ".5g", "d", "d", "d"),
    )


def motions_table(scan: Basin) -> Table:
    """Return all motions: parameter value, factor, initial amplitude, outcome, time, peak in the end, reason."""
    columns = (
        label(scan.parameter, scan.parameter_unit),
        "factor",
        label(f"initial amplitude {scan.coordinate}", scan.unit),
        "outcome",
        "time [s]",
        label(f"peak {scan.coordinate} in the end", scan.unit),
        "reason",
    )
    rows = []
    for i, j in np.ndindex(*scan.outcome.shape):
        peak = float(scan.reached[i, j])
        numbers = (float(scan.values[i]), float(scan.factors[j]), float(scan.amplitudes[i, j]))
        end = (str(scan.outcome[i, j]), float(scan.time[i, j]), peak if np.isfinite(peak) else None)
        rows.append((*numbers, *end, str(scan.reason[i, j])))
    return Table("basin_motions", "All motions", columns, tuple(rows), (".6g", ".6g", ".6g", "", ".4g", ".5g", ""))


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
        f"{name} {value:.6g} {unit}".strip()
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
