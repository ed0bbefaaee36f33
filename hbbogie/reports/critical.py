"""Critical values with their gradients as tables, a sentence and a tornado chart."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from hbbogie.critical.bistability import Coexistence, coexistence
from hbbogie.critical.speeds import critical_speeds
from hbbogie.deadline import time_is_over
from hbbogie.model.problem import default_interval
from hbbogie.model.system import System
from hbbogie.motion.energy import energy_shares, moving_groups
from hbbogie.progress import Progress, silent
from hbbogie.reports.figures import Figures, draw
from hbbogie.reports.report import Report
from hbbogie.reports.summary import influence_sentences
from hbbogie.reports.table import Table
from hbbogie.results import Criticals
from hbbogie.results.critical import Critical
from hbbogie.stability.multipliers import floquet
from hbbogie.units import behind, label

SHOWN = 12  # bars of the tornado chart
MANY = 4  # critical values of which all have bars
LEAST = 1e-9  # elasticity that is shown
ZERO = 1e-12  # share of the range below which a critical value is 0 but for round-off


def critical_of(
    module: ModuleType,
    system: System,
    progress: Progress = silent,
    parameter: str | None = None,
    interval: tuple[float, float] | None = None,
    method: str = "auto",
) -> Report:
    """Find the critical values of a problem's parameter with their gradients.

    Parameters
    ----------
    module : module
        As returned by `load_problem`; its PARAMETER and RANGE hold where nothing is said.
    system : System
    progress : callable
        Called with (message, fraction done or None).
    parameter : str, optional
    interval : (float, float), optional, unit of the parameter
    method : str
        As of `critical_speeds`.
    """
    name, own = default_interval(module, system, parameter)
    span = interval or own
    searched = critical_speeds(system, name, span, method=method, progress=progress)
    rounded = (_rounded(c, ZERO * (span[1] - span[0])) for c in searched)
    found = Criticals(rounded, searched.evidence, searched.undecided, searched.branches)
    missing = [f"Not searched to its end: {sentence}." for sentence in searched.undecided]
    unit = system.parameter(name).unit
    if not found:
        note = f"No Hopf point and no fold for {name} from {span[0]:g} to {span[1]:g}{behind(unit)}."
        return Report(system.name, notes=(note, *missing), data={"complete": searched.complete})
    first = found[0]
    notes = [f"The smallest critical value is {first.value:.5g}{behind(unit)}, a {_kind(first)}.", *missing]
    if doubtful := [f"{c.value:.6g}" for c in found if not c.resolved]:
        notes.append(f"Not resolved, and perhaps not there: the fold(s) at {', '.join(doubtful)}{behind(unit)}.")
    notes += [*_linear_analysis(found, unit), *_attractors(found, unit)]
    if found[-1].extremum == "maximum":
        notes.append(f"The cycles found exist up to {found[-1].value:.6g}{behind(unit)}, the largest fold.")
    progress("where rest and cycles coexist", None)
    both = [] if time_is_over() else coexistence(system, found)
    notes += [*(_together(c, unit) for c in both), *_smallest(system, both, unit)]
    figures = _bars(found, system)
    data: dict[str, Any] = {"complete": searched.complete, "evidence": list(searched.evidence)}
    data["critical"] = [_data(c) for c in found]
    data["lowest"] = [_data(c) | {"energy": energy_shares(system, c.orbit)} for c in found.lowest.values() if c.moves]
    data["coexistence"] = [{"interval": c.interval} | ({"moves": c.fold.moves} if c.fold.moves else {}) for c in both]
    between = _lowest(system, found, unit), _disturbances(system, both, unit)
    tables = (_values(system, found, unit), *(t for t in between if t), _gradients(system, found, unit))
    return Report(
        f"{system.name}: critical values of {name}",
        tables,
        {},
        figures,
        tuple(notes),
        data,
        summary=(*notes, *influence_sentences(system, found)),
        about=(f"Critical values of {system.naming.plain(name)} from {span[0]:g} to {span[1]:g}{behind(unit)}.",),
    )


def _attractors(found: Criticals, unit: str) -> list[str]:
    """Return the lowest fold of the cycles of each set of groups of bodies, and what the search for them rests on."""
    if not any(found.lowest):
        return []
    each = ", ".join(f"{name} {c.value:.6g}" for name, c in found.lowest.items())
    evidence = (f"{sentence[0].upper()}{sentence[1:]}." for sentence in found.evidence)
    notes = [f"Lowest fold of the cycles in which these groups move: {each}{behind(unit)}.", *evidence]
    return [*notes, "So every branch that was met has been followed to its ends."] if found.complete else notes


def _together(c: Coexistence, unit: str) -> str:
    """Return where rest and cycles coexist, a sentence."""
    cycles = f"cycles exist ({c.fold.moves})" if c.fold.moves else "cycles exist"
    said = f"Between {c.interval[0]:.5g} and {c.interval[1]:.5g}{behind(unit)}"
    return f"{said} the equilibrium is stable and {cycles}: a disturbance larger than the unstable cycle starts them."


def _smallest(system: System, both: list[Coexistence], unit: str) -> list[str]:
    """Return how large the smallest cycle on a border is in the middle of the widest interval, a sentence."""
    borders = [o for c in both for o in c.thresholds if o.stability and o.stability.unstable == 1]
    if not borders or not system.groups:
        return []
    name, widest = both[0].parameter, max(both, key=lambda c: c.interval[1] - c.interval[0])
    middle = min((o.parameters[name] for o in borders), key=lambda v: abs(v - sum(widest.interval) / 2))
    least = min((o for o in borders if o.parameters[name] == middle), key=lambda o: np.abs(o.coefficients[1:]).max())
    who, shown = moving_groups(system, least), system.nonlinear_coordinates or system.coordinate_names
    most = max(shown, key=least.amplitude)
    return [
        f"At {middle:.5g}{behind(unit)} the smallest of these unstable cycles is one of {who}, with "
        f"{least.amplitude(most):.3g}{behind(system.coordinates[system.index(most)].unit)} of {most}."
    ]


def _linear_analysis(found: list[Critical], unit: str) -> list[str]:
    """Return how far the first Hopf point, where linear analysis ends, lies above the smallest critical value."""
    hopf, lowest = next((c.value for c in found if c.kind == "hopf"), None), found[0].value
    if hopf is None or not 0 < lowest < hopf:
        return []
    return [
        f"Linear analysis sees the Hopf point at {hopf:.5g}{behind(unit)}"
        + f" only, which is {100 * (hopf / lowest - 1):.3g} % too high for a critical value."
    ]


def _data(c: Critical) -> dict[str, Any]:
    """Return a critical value for programs."""
    known = {"kind": c.kind, "value": c.value, "gradient": c.gradient}
    if np.isfinite(c.error):
        known["error"] = c.error
    return known | ({"moves": c.moves} if c.moves else {})


def _rounded(c: Critical, size: float) -> Critical:
    """Return a critical value with 0 for what is zero to round-off."""
    return replace(c, value=0.0) if abs(c.value) <= size else c


def _kind(c: Critical) -> str:
    return "Hopf point" if c.kind == "hopf" else "fold"


def _values(system: System, found: list[Critical], unit: str) -> Table:
    """Return the critical values with what certifies them."""
    columns = ["kind", label(found[0].parameter, unit), label("error, at most", unit)]
    columns += [
        "extremum",
        "omega [rad/s]",
        "frequency [Hz]",
        "residual [1]",
        "curvature",
        "distance of a multiplier from +1 [1]",
    ]
    notes = [f"{_kind(c).capitalize()} at {c.value:.6g}: {c.status}." for c in found]
    if any(c.kind == "fold" for c in found):
        notes.append(
            "At a fold a second multiplier meets the trivial one at +1, with the root of the distance from the exact "
            "fold: here what harmonics or a mesh leave out shows."
        )
    rows: list[tuple[Any, ...]] = []
    for c in found:
        shape = c.curvature if c.kind == "fold" and c.gradient else None
        error = getattr(c, "error", float("nan"))
        beside = shape, _beside_one(system, c)
        left_out = error if np.isfinite(error) else None
        rows.append((_kind(c), c.value, left_out, c.extremum, c.omega, c.orbit.frequency, c.residual, *beside))
    formats = ["", ".8g", ".1e", "", ".7g", ".7g", ".1e", ".3g", ".1e"]
    if system.groups:
        columns, formats = [*columns, "moves"], [*formats, ""]
        rows = [(*row, c.moves) for row, c in zip(rows, found, strict=True)]
    return Table("critical", "Critical values", tuple(columns), tuple(rows), tuple(formats), tuple(notes))


def _beside_one(system: System, c: Critical) -> float | None:
    """Return how far the second multiplier of a fold is from +1: of half the period where the cycle is odd."""
    if c.kind != "fold":
        return None
    if np.isfinite(c.apart):
        return c.apart
    s = floquet(system, c.orbit)
    m = s.multipliers if s.half_multipliers is None else s.half_multipliers
    return float(np.sort(np.abs(m - 1))[1]) if len(m) > 1 and np.isfinite(m).all() else None


def _lowest(system: System, found: Criticals, unit: str) -> Table | None:
    """Return the lowest fold of the cycles of each set of groups; None without groups."""
    if not any(found.lowest):
        return None
    shares = {name: energy_shares(system, c.orbit) for name, c in found.lowest.items()}
    columns = ["moves", label(found[0].parameter, unit), label("error, at most", unit), "frequency [Hz]"]
    columns += [f"kinetic energy, {group} [1]" for group in system.groups]
    rows = tuple(
        (name, c.value, c.error if np.isfinite(c.error) else None, c.orbit.frequency, *shares[name].values())
        for name, c in found.lowest.items()
    )
    note = (
        "Cycles exist from the lowest fold of each upwards. A group moves that has at least a tenth of the kinetic "
        "energy of the group with most; the shares are those of one period at the fold."
    )
    formats = ("", ".8g", ".1e", ".5g", *[".3f"] * len(system.groups))
    return Table("lowest", "Lowest fold by the groups that move", tuple(columns), rows, formats, (note,))


def _disturbances(system: System, both: list[Coexistence], unit: str) -> Table | None:
    """Return the sizes of the smallest cycles where rest and cycles coexist; None where they do not."""
    rows = [(c, o) for c in both for o in c.thresholds]
    if not rows:
        return None
    name, shown = both[0].parameter, system.nonlinear_coordinates or system.coordinate_names[:1]
    units = [system.coordinates[system.index(q)].unit for q in shown]
    peaks = {id(o): [o.amplitude(q) for q in shown] for _, o in rows}
    rows.sort(key=lambda row: (row[1].parameters[name], max(peaks[id(row[1])])))
    ends = [label("of the fold at", unit)] * (len(both) > 1) + ["moves"] * bool(system.groups)
    columns = [label(name, unit), *ends, *(f"peak {label(q, u)}" for q, u in zip(shown, units, strict=True))]
    columns += ["multipliers outside"]
    cells = []
    for c, o in rows:
        which = [c.fold.value] * (len(both) > 1) + [moving_groups(system, o)] * bool(system.groups)
        outside = o.stability.unstable if o.stability and o.stability.verdict != "unknown" else None
        cells.append((o.parameters[name], *which, *peaks[id(o)], outside))
    formats = [".7g", *[".5g"] * (len(both) > 1), *[""] * bool(system.groups), *[".5g"] * len(shown), ""]
    note = (
        "The smallest cycle of each branch, where that is unstable. With one multiplier outside the unit circle it "
        "lies on a border: along its shape larger motions grow, smaller ones shrink. With more it lies on none."
    )
    return Table("disturbance", "Disturbance that starts cycles", tuple(columns), tuple(cells), tuple(formats), (note,))


def _elasticity(c: Critical, name: str) -> float | None:
    """Return an elasticity; None where it is not defined, as that of a critical value of 0."""
    slope = c.elasticities[name] if c.value else float("nan")
    return slope + 0.0 if np.isfinite(slope) else None


def _ranked(found: list[Critical]) -> list[str]:
    """Return the parameters, the most influential one first: by elasticity, else by the gradient times the value."""

    def influence(c: Critical, name: str) -> float:
        return abs(c.elasticities[name] if c.value else c.gradient[name] * c.orbit.parameters[name])

    measured = [c for c in found if c.value] or found
    return sorted(found[0].gradient, key=lambda n: -max(influence(c, n) for c in measured)) if found else []


def _gradients(system: System, found: list[Critical], unit: str) -> Table:
    """Return gradients and elasticities, the most influential parameter first."""
    found = [c for c in found if c.gradient]
    per = f"{unit or '1'} per unit"
    columns = ["parameter", "unit", "value"]
    for c in found:
        at = f"{_kind(c)} {c.value:.5g}"
        columns += [f"gradient, {at} [{per}]", f"elasticity, {at} [1]"]
    rows = []
    for n in _ranked(found):
        numbers = [x for c in found for x in (c.gradient[n] + 0.0, _elasticity(c, n))]  # no -0
        rows.append((n, system.parameter(n).unit or "1", system.values[n], *numbers))
    notes = ["Elasticity: relative change of the critical value per relative change of the parameter."]
    if any(not c.value for c in found):
        notes.append("A critical value of 0 has no elasticity.")
    formats = ("", "", ".6g", *["z.5g", "z.5f"] * len(found))
    return Table("gradients", "Gradients and elasticities", tuple(columns), tuple(rows), formats, tuple(notes))


def _bars(searched: Criticals, system: System) -> Figures:
    """Return the figure of the elasticities of the most influential parameters; none where all are zero.

    Of many critical values it shows the lowest fold of each set of groups that move, and the first Hopf point.
    """
    first_hopf = next((c for c in searched if c.kind == "hopf"), None)
    kept = [*searched.lowest.values(), *([first_hopf] if first_hopf else [])] if len(searched) > MANY else searched
    found = [c for c in kept if c.gradient and c.value]
    names = [n for n in _ranked(found)[:SHOWN] if any(abs(c.elasticities[n]) > LEAST for c in found)]
    if not names:
        return {}
    parameter, plain = found[0].parameter, [system.naming.plain(n) for n in names]
    bars = {
        f"{_kind(c)} at {system.naming.value(parameter, c.value, 5)}{f' ({c.moves})' if c.moves else ''}": [
            c.elasticities[n] for n in names
        ]
        for c in found
    }
    return {"tornado": partial(draw, "tornado", plain, bars, parameter=parameter, title=system.name)}
