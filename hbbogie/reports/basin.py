"""The jobs of a basin of attraction and of slowly changing parameters, as reports."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from types import ModuleType

import numpy as np

from hbbogie.attraction.basin import check, find_basin
from hbbogie.attraction.endings import OVER
from hbbogie.branches.diagram import Diagram
from hbbogie.errors import ModelError
from hbbogie.model.system import System
from hbbogie.progress import Progress, silent
from hbbogie.reports.around import _about
from hbbogie.reports.figures import Figures, draw
from hbbogie.reports.report import Report
from hbbogie.reports.table import Table
from hbbogie.results import Basin
from hbbogie.units import behind, label

LONGER = "; a longer duration may decide them"
BEYOND_CYCLE = 1.65  # largest factor of the unstable cycle's shape
BEYOND_PEAK = 4.0  # largest amplitude along a direction, in units of the largest stable peak
ABOUT = (0.8, 0.8)  # how far a scan reaches below the fold and beyond the Hopf point, in units of their distance


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
    return _reported(scan, system, found), scan


def _reported(scan: Basin, system: System, found: Diagram) -> Report:
    """Return a scan as a report."""
    parameter, branches, values = scan.parameter, list(found.branches.values()), scan.values
    across = label(f"{system.parameter(parameter).description} {parameter}".strip(), scan.parameter_unit)
    figures: Figures = {"basin": partial(draw, "basin", scan, branches, found.hopf, parameter_label=across)}
    counts = {kind: int(scan.count(kind).sum()) for kind in ("rest", "cycle", "undecided")}
    why, often = np.unique(scan.reason[scan.outcome == "undecided"], return_counts=True)
    notes = (
        f"{system.name}: {scan.outcome.size} motion{'s' * (scan.outcome.size != 1)}; {counts['rest']} at rest in the "
        f"end, {counts['cycle']} on a cycle, {counts['undecided']} undecided. Factors multiply: {scan.direction}.",
        *(
            f"Undecided ({times}): {reason}{LONGER * (reason == OVER)}."
            for reason, times in zip(why, often, strict=True)
        ),
        *found.notes,
        *scan.notes,
    )
    data = {"parameters": scan.parameters, "parameter": parameter, "direction": scan.direction, "counts": counts}
    return Report(
        f"{system.name}: how motions end",
        (basin_table(scan),),
        {},
        figures,
        notes,
        data,
        (motions_table(scan),),
        summary=_sentences(scan, system, counts),
        about=(f"Motions over {parameter} from {values[0]:.5g} to {values[-1]:.5g}; {scan.direction}.",),
    )


def _sentences(scan: Basin, system: System, counts: dict[str, int]) -> tuple[str, ...]:
    """Return how many motions end how, and where a disturbance decides."""
    undecided = f", {counts['undecided']} are undecided" if counts["undecided"] else ""
    said = [
        f"Of {scan.outcome.size} motions {counts['rest']} come to rest and {counts['cycle']} end on a cycle{undecided}."
    ]
    attractors = [k for k in scan.kinds if k not in ("rest", "cycle", "undecided")]
    if attractors:
        each = ", ".join(f"{k} {int((scan.ends == k).sum())}" for k in attractors)
        said.append(f"Of those that end on a cycle there move: {each}.")
    both = [float(v) for i, v in enumerate(scan.values) if {"rest", "cycle"} <= set(map(str, scan.outcome[i]))]
    unit = behind(scan.parameter_unit)
    if both:
        said.append(
            f"Between {scan.parameter} = {min(both):.4g} and {max(both):.4g}{unit} the disturbance decides: "
            f"small ones come to rest, large ones start oscillation of {system.naming.plain(scan.coordinate)}."
        )
    return tuple(said)


# --- tables -----------------------------------------------------------------------------------


def basin_table(scan: Basin) -> Table:
    """Return for each parameter value the cycles' peaks, and between which initial amplitudes the outcome changes."""
    name, ends = scan.coordinate, scan.ends
    names = {"rest": "at rest", "cycle": "on a cycle", "undecided": "undecided"}
    counted = {k: names.get(k, f"on a cycle: {k}") for k in scan.kinds if k != "cycle" or (ends == k).any()}
    if scan.attractor is None:
        counted = names
    columns = (
        label(scan.parameter, scan.parameter_unit),
        label(f"peak {name}, unstable cycle", scan.unit),
        label(f"peak {name}, stable cycle", scan.unit),
        label("largest at rest", scan.unit),
        label("smallest on a cycle", scan.unit),
        *counted.values(),
    )
    rows = []
    for i, value in enumerate(scan.values):
        rest, cycle = (scan.amplitudes[i][scan.outcome[i] == kind] for kind in ("rest", "cycle"))
        changes = (float(rest.max()) if len(rest) else None, float(cycle.min()) if len(cycle) else None)
        known = [float(v) if np.isfinite(v) else None for v in (scan.unstable[i], scan.stable[i])]
        counts = (int((ends[i] == kind).sum()) for kind in counted)
        rows.append((float(value), *known, *changes, *counts))
    return Table(
        "basin",
        f"{scan.system}: how motions end, by initial amplitude of {name}",
        columns,
        tuple(rows),
        (".6g", ".5g", ".5g", ".5g", ".5g", *["d"] * len(counted)),
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
        end = (str(scan.ends[i, j]), float(scan.time[i, j]), peak if np.isfinite(peak) else None)
        rows.append((*numbers, *end, str(scan.reason[i, j])))
    return Table("basin_motions", "All motions", columns, tuple(rows), (".6g", ".6g", ".6g", "", ".4g", ".5g", ""))
