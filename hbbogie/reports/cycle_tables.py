"""Tables of results: plain rows with headers and formats, to be printed, saved or handed on as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbbogie.errors import ModelError
from hbbogie.reports.table import Table
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.results.orbit import NOT_RESOLVED
from hbbogie.results.signal import BAND, NUMBERS
from hbbogie.units import label


def cycles_table(
    orbits: Sequence[Orbit], title: str = "Cycles", name: str = "cycles", moves: Sequence[str] = ()
) -> Table:
    """Return the table of cycles: stability, frequency, period, peak and first harmonic of every coordinate.

    Parameters
    ----------
    orbits : sequence of Orbit
        Of one system, at least one.
    title, name : str
    moves : sequence of str
        What moves in each, see `hbbogie.motion.moving_groups`; without a column for it where left out.
    """
    if not orbits:
        raise ModelError("no cycles: a table of cycles needs at least one orbit.")
    named = list(zip(orbits[0].coordinates, orbits[0].units, strict=True))
    before = ["stability", "largest multiplier [1]", "omega [rad/s]", "frequency [Hz]", "period [s]"]
    sizes = [f"peak {label(c, u)}" for c, u in named] + [f"first harmonic {label(c, u)}" for c, u in named]
    shown = ["moves"] * any(moves)
    rows = []
    for i, o in enumerate(orbits):
        amplitudes = [*(o.amplitude(c) for c, _ in named), *(o.first_harmonic(c) for c, _ in named)]
        verdict = o.stability.verdict if o.stability else None
        error = o.errors["waveform"] if o.errors else None
        judged = (*([moves[i]] if shown else []), verdict, o.largest_multiplier)
        rows.append((i + 1, *judged, o.omega, o.frequency, o.period, *amplitudes, o.kept, error))
    reasons = [
        f"Cycle {i + 1}: {o.stability.reason}"
        for i, o in enumerate(orbits)
        if o.stability and o.stability.verdict == "unknown"
    ]
    columns = ("cycle", *shown, *before, *sizes, "highest harmonic", "waveform error [1]")
    formats = ("d", *[""] * len(shown), "", ".6g", *[".7g"] * (3 + len(sizes)), "d", ".1e")
    first = [_stable_ones(orbits, moves)] if len(orbits) > 1 and any(o.stability for o in orbits) else []
    return Table(name, title, columns, tuple(rows), formats, (*first, *reasons))


def _stable_ones(orbits: Sequence[Orbit], moves: Sequence[str]) -> str:
    """Return which of several cycles are stable, and what moves in them."""
    stable = [i for i, o in enumerate(orbits) if o.verdict == "stable"]
    if not stable:
        return f"Of the {len(orbits)} cycles none is known to be stable."
    named = ", ".join(f"{i + 1} ({moves[i]})" if any(moves) else f"{i + 1}" for i in stable)
    return f"Of the {len(orbits)} cycles {len(stable)} {'is' if len(stable) == 1 else 'are'} stable: {named}."


def outputs_table(orbits: Sequence[Orbit], title: str = "Outputs", name: str = "outputs") -> Table:
    """Return the table of the outputs of cycles: their numbers over the period, a row for each cycle and output.

    Parameters
    ----------
    orbits : sequence of Orbit
        Of one system that names outputs.
    title, name : str
    """
    rows, notes = [], {}
    for i, o in enumerate(orbits):
        for own in o.outputs.values():
            numbers = [own.number(quantity) for quantity in NUMBERS]
            about = [own.rms_about()] if o.frequency > BAND / own.highest else []
            kept = [0.0 if abs(x) < 1e-9 * own.peak else x for x in (*numbers, *about)]  # not zero to round-off
            rows.append((own.name, own.unit or "1", i + 1, *kept, *([] if about else [None])))
            if own.description:
                notes[own.name] = f"{own.name}: {own.description}."
    columns = ("output", "unit", "cycle", *NUMBERS, f"rms within {BAND:g} Hz of the frequency")
    return Table(name, title, columns, tuple(rows), ("", "", "d", *[".6g"] * 6), tuple(notes.values()))


def special_table(
    points: Sequence[SpecialPoint], parameter: str, unit: str, coordinate: str, title: str = "Special points"
) -> Table:
    """Return the table of special points: kind, place, frequency, peak of a coordinate (not at Hopf points).

    Parameters
    ----------
    points : sequence of SpecialPoint
    parameter, unit : str
        Name and unit of the parameter in which they were found.
    coordinate : str
    title : str
    """
    units = {c: u for s in points for c, u in zip(s.orbit.coordinates, s.orbit.units, strict=True)}
    peak_header = f"peak {label(coordinate, units.get(coordinate, ''))}"
    columns = ("kind", label(parameter, unit), "omega [rad/s]", "frequency [Hz]", peak_header)
    rows, notes = [], []
    for s in points:
        # the orbit kept at a Hopf point shows the mode, not an amplitude
        peak = None if s.kind == "hopf" else s.orbit.amplitude(coordinate)
        kind = s.kind if s.resolved else f"{s.kind}, {NOT_RESOLVED}"
        rows.append((kind, s.value, s.omega, s.orbit.frequency, peak))
        notes.append(f"{s.kind} at {parameter} = {s.value:.8g}: {s.status}.")
    return Table("special_points", title, columns, tuple(rows), ("", ".8g", *[".7g"] * 3), tuple(notes))


def branches_table(
    branches: Mapping[str, Branch], unit: str, coordinate: str, moves: Mapping[str, str] | None = None
) -> Table:
    """Return the table of branches: points, range of the parameter, largest peak, folds, verdicts.

    Parameters
    ----------
    branches : mapping from name to Branch
        All over one parameter, at least one.
    unit : str
        Unit of the parameter.
    coordinate : str
    moves : mapping from name to str, optional
        What moves along each branch.
    """
    if not branches:
        raise ModelError("no branches: a table of branches needs at least one.")
    first = next(iter(branches.values()))
    p, q = first.parameter, label(coordinate, first.orbits[0].units[first.orbits[0].index(coordinate)])
    verdicts = ("stable", "unstable", "unknown")
    ends = f"smallest {label(p, unit)}", f"largest {label(p, unit)}"
    columns = ("branch", "points", *ends, f"largest peak {q}", "folds", *verdicts)
    rows: list[tuple[Any, ...]] = []
    notes = []
    for name, b in branches.items():
        counts = [b.verdicts.count(verdict) for verdict in verdicts]
        low, high, peak = (float(x) for x in (b.values.min(), b.values.max(), b.amplitude(coordinate).max()))
        rows.append((name, len(b), low, high, peak, len(b.folds()), *counts))
        notes += [f"{name}: first point: {b.ends[0]}; last point: {b.ends[1]}."]
    formats = ("", "d", ".6g", ".6g", ".6g", *["d"] * 4)
    shown = [moves[name] for name in branches] if moves else []
    if shown:
        rows = [(*row, what) for row, what in zip(rows, shown, strict=True)]
    more = ("moves",) if shown else ()
    return Table("branches", "Branches", (*columns, *more), tuple(rows), (*formats, *("" for _ in more)), tuple(notes))


def family_value(family: Branch) -> float:
    """Return the parameter value of a family of cycles, free of round-off about zero."""
    value = float(np.median(family.values))
    return 0.0 if abs(value) < 1e-12 else value


def backbone_table(name: str, family: Branch, coordinate: str, count: int = 20) -> Table:
    """Return the table of a family of cycles of every amplitude: frequency over amplitude.

    Parameters
    ----------
    name : str
    family : Branch
    coordinate : str
    count : int
        Largest number of rows.
    """
    places = np.unique(np.linspace(0, len(family) - 1, count).round().astype(int))
    some = [family.orbits[i] for i in places]
    q = label(coordinate, some[0].units[some[0].index(coordinate)])
    columns = (f"peak {q}", f"first harmonic {q}", "omega [rad/s]", "frequency [Hz]", "period [s]")
    rows = [(o.amplitude(coordinate), o.first_harmonic(coordinate), o.omega, o.frequency, o.period) for o in some]
    title = f"Family of cycles at {family.parameter} = {family_value(family):.6g}: frequency over amplitude"
    note = f"First: {family.ends[0]}; last: {family.ends[1]}."
    return Table(name, title, columns, tuple(rows), (".6g",) * 5, (note,))
