"""Critical values with their gradients as tables, a sentence and a tornado chart."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from hbbogie.critical.bistability import Coexistence, coexistence
from hbbogie.critical.folds import Critical
from hbbogie.critical.speeds import critical_speeds
from hbbogie.deadline import time_is_over
from hbbogie.model.problem import default_interval
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.progress import Progress, silent
from hbbogie.reports.figures import Figures, draw
from hbbogie.reports.report import Report
from hbbogie.reports.summary import influence_sentences
from hbbogie.reports.table import Table
from hbbogie.results import Criticals
from hbbogie.stability.multipliers import floquet
from hbbogie.units import label

SHOWN = 12  # bars of the tornado chart
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
    progress(f"critical values of {name}", None)
    searched = critical_speeds(system, name, span, method=method)
    found = [_rounded(c, ZERO * (span[1] - span[0])) for c in searched]
    missing = [f"Not searched to its end: {sentence}." for sentence in searched.undecided]
    unit = system.parameter(name).unit
    if not found:
        note = f"No Hopf point and no fold for {name} from {span[0]:g} to {span[1]:g} {unit}".rstrip() + "."
        return Report(system.name, notes=(note, *missing), data={"complete": searched.complete})
    first = found[0]
    notes = [f"The smallest critical value is {first.value:.5g} {unit}".rstrip() + f", a {_kind(first)}.", *missing]
    if doubtful := [f"{c.value:.6g}" for c in found if not c.resolved]:
        notes.append(f"Not resolved, and perhaps not there: the fold(s) at {', '.join(doubtful)} {unit}".rstrip() + ".")
    notes += [*_linear_analysis(found, unit), *_attractors(system, searched, unit)]
    if found[-1].extremum == "maximum":
        notes.append(f"The cycles found exist up to {found[-1].value:.6g} {unit}".rstrip() + ", the largest fold.")
    progress("where rest and cycles coexist", None)
    both = [] if time_is_over() else coexistence(system, found)
    for c in both:
        notes.append(
            f"Between {c.interval[0]:.5g} and {c.interval[1]:.5g} {unit}".rstrip()
            + " the equilibrium is stable and cycles exist: a disturbance larger than the unstable cycle starts them."
        )
    figures = _bars(found, system)
    data: dict[str, Any] = {"complete": searched.complete, "evidence": list(searched.evidence)}
    data["critical"] = [_data(system, c) for c in found]
    data["coexistence"] = [{"interval": c.interval} for c in both]
    tables = (_values(system, found, unit), *_disturbances(system, both, unit), _gradients(system, found, unit))
    return Report(
        f"{system.name}: critical values of {name}",
        tables,
        {},
        figures,
        tuple(notes),
        data,
        summary=(*notes, *influence_sentences(system, found)),
        about=(
            f"Critical values of {system.naming.plain(name)} from {span[0]:g} to {span[1]:g}{' ' * bool(unit)}{unit}.",
        ),
    )


def _attractors(system: System, found: Criticals, unit: str) -> list[str]:
    """Return the lowest fold of the cycles of each group of bodies, and what the search for them rests on."""
    lowest: dict[str, Critical] = {}
    for c in found:
        if c.kind == "fold" and c.extremum == "minimum":
            lowest.setdefault(moving_groups(system, c.orbit), c)
    if not system.groups or not lowest:
        return []
    each = ", ".join(f"{name} {c.value:.6g}" for name, c in lowest.items())
    evidence = (f"{sentence[0].upper()}{sentence[1:]}." for sentence in found.evidence)
    return [f"Lowest fold of the cycles in which these groups move: {each} {unit}".rstrip() + ".", *evidence]


def _linear_analysis(found: list[Critical], unit: str) -> list[str]:
    """Return how far the first Hopf point, where linear analysis ends, lies above the smallest critical value."""
    hopf, lowest = next((c.value for c in found if c.kind == "hopf"), None), found[0].value
    if hopf is None or not 0 < lowest < hopf:
        return []
    return [
        f"Linear analysis sees the Hopf point at {hopf:.5g} {unit}".rstrip()
        + f" only, which is {100 * (hopf / lowest - 1):.3g} % too high for a critical value."
    ]


def _data(system: System, c: Critical) -> dict[str, Any]:
    """Return a critical value for programs."""
    known = {"kind": c.kind, "value": c.value, "gradient": c.gradient}
    if np.isfinite(c.error):
        known["error"] = c.error
    return known | ({"moves": moving_groups(system, c.orbit)} if system.groups else {})


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
        rows = [(*row, moving_groups(system, c.orbit)) for row, c in zip(rows, found, strict=True)]
    return Table("critical", "Critical values", tuple(columns), tuple(rows), tuple(formats), tuple(notes))


def _beside_one(system: System, c: Critical) -> float | None:
    """Return how far the second multiplier of a fold is from +1: of half the period where the cycle is odd."""
    if c.kind != "fold":
        return None
    s = floquet(system, c.orbit)
    m = s.multipliers if s.half_multipliers is None else s.half_multipliers
    return float(np.sort(np.abs(m - 1))[1]) if len(m) > 1 and np.isfinite(m).all() else None


def _disturbances(system: System, both: list[Coexistence], unit: str) -> list[Table]:
    """Return the sizes of the unstable cycle where rest and cycles coexist."""
    shown = system.nonlinear_coordinates or system.coordinate_names[:1]
    tables = []
    for i, c in enumerate(both):
        units = [system.coordinates[system.index(q)].unit for q in shown]
        columns = [label(c.parameter, unit), *(f"peak {label(q, u)}" for q, u in zip(shown, units, strict=True))]
        rows = tuple((o.parameters[c.parameter], *(o.amplitude(q) for q in shown)) for o in c.thresholds)
        note = (
            "The smallest cycle, which is unstable: along its shape larger motions start cycles, smaller ones die out."
        )
        name = "disturbance" if len(both) == 1 else f"disturbance_{i + 1}"
        formats = (".7g", *[".5g"] * len(shown))
        tables.append(Table(name, "Disturbance that starts cycles", tuple(columns), rows, formats, (note,)))
    return tables


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


def _bars(found: list[Critical], system: System) -> Figures:
    """Return the figure of the elasticities of the most influential parameters; none where all are zero."""
    found = [c for c in found if c.gradient and c.value]
    names = [n for n in _ranked(found)[:SHOWN] if any(abs(c.elasticities[n]) > LEAST for c in found)]
    if not names:
        return {}
    parameter, plain = found[0].parameter, [system.naming.plain(n) for n in names]
    bars = {
        f"{_kind(c)} at {system.naming.value(parameter, c.value, 5)}": [c.elasticities[n] for n in names] for c in found
    }
    return {"tornado": partial(draw, "tornado", plain, bars, parameter=parameter, title=system.name)}
