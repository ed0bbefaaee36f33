"""Reports on cycles and branches, and the default job of a problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from hbbogie.branches.diagram import Diagram, bifurcation_diagram
from hbbogie.errors import ModelError
from hbbogie.model.problem import default_interval
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.progress import Progress, silent
from hbbogie.reports.cycle_tables import (
    backbone_table,
    branches_table,
    cycles_table,
    family_value,
    outputs_table,
    special_table,
)
from hbbogie.reports.figures import cycle_figures, diagram_figures, linear, moves_along
from hbbogie.reports.report import Report
from hbbogie.reports.summary import branches_sentences, cycles_sentences, whole_summary
from hbbogie.reports.table import Table
from hbbogie.results import Branch, Cycles, Equilibria, Orbit
from hbbogie.stability.hill_method import hill as hill_of
from hbbogie.stability.multipliers import floquet
from hbbogie.units import behind


def run_of(module: ModuleType, system: System, progress: Progress = silent, method: str | None = None) -> Report:
    """Do the job of a problem: its own where the module has a function ``study``, else the default one.

    Parameters
    ----------
    module : module
        As returned by `load_problem`; its ``study(system, progress)`` returns a `Report`.
    system : System
    progress : callable
        Called with (message, fraction done or None).
    method : str, optional
        By which the default job follows branches, as of `bifurcation_diagram`.

    Raises
    ------
    ModelError
        When the module's ``study`` is no function or does not return a report, or chooses the method itself.
    """
    own = getattr(module, "study", None)
    if own is None:
        return default_study(module, system, progress, method or "mhb")
    if method is not None:
        raise ModelError(
            f"--method {method}: the problem does its own job, which chooses the methods; leave the option out, or use "
            "hbbogie branch, cycles or critical with it."
        )
    where = f"problem {getattr(module, '__file__', None) or module.__name__!r}"
    if not callable(own):
        raise ModelError(f"{where}: study is of type {type(own).__name__}; it must be a function.")
    report = own(system, progress)
    if not isinstance(report, Report):
        kind = type(report).__name__
        raise ModelError(f"{where}: study() returned an object of type {kind}; it must return a Report.")
    return report if report.summary else replace(report, later=partial(branches_sentences, system, report.branches))


def figures_of_paper(module: ModuleType, system: System, progress: Progress = silent) -> Report:
    """Draw the figures of a problem's paper; raise `ModelError` when the problem has no function ``paper``."""
    return _own(module, "paper", "figures of its paper")(system, progress)


def identification(module: ModuleType, system: System, progress: Progress = silent, **options: Any) -> Report:
    """Identify parameters from a problem's published cycles, by its function ``identification``.

    Raises
    ------
    ModelError
        When the problem has none.
    """
    return _own(module, "identification", "published cycles to identify parameters from")(system, progress, **options)


def _own(module: ModuleType, name: str, what: str) -> Callable[..., Report]:
    found = getattr(module, name, None)
    if not callable(found):
        where = f"problem {getattr(module, '__file__', None) or module.__name__!r}"
        raise ModelError(f"{where} has no {what}; write a function {name}(system, progress) that returns a Report.")
    return found  # type: ignore[no-any-return]


# --- the default job --------------------------------------------------------------------------


def default_study(module: ModuleType, system: System, progress: Progress = silent, method: str = "mhb") -> Report:
    """Find the cycles at the system's parameter values and the curves of cycles over the problem's range.

    Parameters
    ----------
    module : module
        Its PARAMETER and RANGE say which curves.
    system : System
    progress : callable
        Called with (message, fraction done or None).
    method : str
        As of `bifurcation_diagram`.
    """
    parameter, interval = default_interval(module, system, None)
    found = bifurcation_diagram(system, parameter, interval, method=method, progress=progress)
    report = report_of_diagram(system, found)
    if not found.cycles:
        return report
    here = report_of_cycles(system, parameter, found.cycles)
    tables, figures = (*here.tables, *report.tables), {**report.figures, **here.figures}
    data = {**report.data, **here.data}
    return replace(report, tables=tables, figures=figures, data=data)


def report_of_cycles(system: System, parameter: str, cycles: list[Orbit], *, hill: bool = False) -> Report:
    """Return table, branches of one cycle each, figures and notes of the cycles at the system's values.

    Parameters
    ----------
    system : System
    parameter : str
    cycles : list of Orbit
    hill : bool
        Whether to put the multipliers by Hill's method beside the integrated ones.
    """
    at = quantity(system, parameter, system.values[parameter])
    moves = [moving_groups(system, o) for o in cycles]
    summaries = [
        {**o.summary(), "largest_multiplier": o.largest_multiplier, "moves": what}
        for o, what in zip(cycles, moves, strict=True)
    ]
    evidence = cycles.evidence if isinstance(cycles, Cycles) else ()
    complete = cycles.complete if isinstance(cycles, Cycles) else True
    data = {"parameters": dict(system.values), "cycles": summaries, "evidence": list(evidence), "complete": complete}
    notes = tuple(f"{_begun(sentence, system)}." for sentence in evidence)
    if not cycles and not complete:
        return Report(system.name, notes=(f"No cycle found at {at}, and not all was searched.", *notes), data=data)
    if not cycles:
        text = (
            f"No cycle found at {at}: no branch from a Hopf point passes there, and motions from states of "
            "several sizes do not settle on one."
        )
        return Report(system.name, notes=(text, *notes), data=data)
    table = cycles_table(cycles, f"{system.name}: cycles at {at}", moves=moves)
    saved = {f"cycle_{i + 1}": Branch((o,), parameter) for i, o in enumerate(cycles)}
    outputs = [outputs_table(cycles, f"{system.name}: outputs of the cycles")] if system.output_names else []
    tables = (table, *outputs, *([_by_hill(system, cycles)] if hill else []))
    return Report(
        f"{system.name}: cycles at {at}",
        tables,
        saved,
        cycle_figures(cycles, system),
        notes,
        data,
        summary=cycles_sentences(system, parameter, cycles),
        about=(f"All cycles at {at}, searched without a guess.",),
    )


def _by_hill(system: System, cycles: list[Orbit]) -> Table:
    """Return the multipliers of cycles by integration and by Hill's method, each beside the nearest of the other."""
    rows, notes = [], []
    for i, orbit in enumerate(cycles):
        judge, other = orbit.stability or floquet(system, orbit), hill_of(system, orbit)
        for mu in judge.multipliers:
            nearest = other.multipliers[np.argmin(np.abs(other.multipliers - mu))]
            pairs = (mu.real, mu.imag, nearest.real, nearest.imag)
            rows.append((i + 1, *map(float, pairs), float(abs(nearest - mu))))
        notes.append(
            f"Cycle {i + 1}: by integration {judge.verdict}, {judge.reason} By Hill {other.verdict}, {other.reason}"
        )
    parts = [f"{part}, {by}" for by in ("integrated", "Hill") for part in ("real part", "imaginary part")]
    columns = ("cycle", *(f"{part} [1]" for part in parts), "difference [1]")
    return Table(
        "hill",
        "Multipliers by integration and by Hill's method",
        columns,
        tuple(rows),
        ("d", *[".6g"] * 4, ".1e"),
        tuple(notes),
    )


def report_of_diagram(system: System, found: Diagram, rest: Equilibria | None = None) -> Report:
    """Return summary, tables, figures and notes of the curves of cycles over a parameter.

    Parameters
    ----------
    system : System
    found : Diagram
    rest : Equilibria, optional
        Over the same interval; found where left out.
    """
    parameter, q = found.parameter, system.coordinate_names[0]
    unit = system.parameter(parameter).unit
    along = {(s.kind, s.value): s for b in found.branches.values() for s in b.special}
    points = [*(s for s in found.hopf if (s.kind, s.value) not in along), *along.values()]
    where = f"between {parameter} = {found.interval[0]:g} and {quantity(system, parameter, found.interval[1])}"
    notes = list(found.notes)
    tables: list[Table] = []
    if points:
        tables.append(special_table(points, parameter, unit, q))
    if not found.hopf:
        notes.append(f"The equilibrium has no Hopf point {where}.")
    if found.branches:
        tables.append(branches_table(found.branches, unit, q, moves_along(system, found)))
    elif not found.families:
        notes.append(f"No branch of cycles was found {where}.")
    for name, family in found.families.items():
        there = f"At {quantity(system, parameter, family_value(family))} there are cycles of every amplitude"
        if linear(family):
            notes.append(f"{there} and of one frequency, {family.omega[0]:.7g} rad/s.")
            continue
        tables.append(backbone_table(name, family, q))
        notes.append(f"{there}, as in a conservative system: see the table {name} for their frequency.")
    data = {"parameters": dict(system.values), "parameter": parameter, "interval": found.interval}
    data["hopf_points"] = [{"value": s.value, "omega_rad_s": s.omega, "status": s.status} for s in found.hopf]
    saved = {**found.branches, **{k: b for k, b in found.families.items() if not linear(b)}}
    return Report(
        f"{system.name}: cycles over {parameter}",
        tuple(tables),
        saved,
        diagram_figures(system, found),
        tuple(notes),
        data,
        later=partial(whole_summary, system, found, rest),
        about=(f"Branches of cycles {where}.",),
    )


def quantity(system: System, parameter: str, value: float) -> str:
    """Return a parameter value as text, such as "V = 90 m/s"."""
    unit = system.parameter(parameter).unit
    return f"{parameter} = {value:.7g}{behind(unit)}"


def _begun(sentence: str, system: System) -> str:
    """Return a sentence with a capital letter, unless it begins with the name of a parameter."""
    named = sentence.partition(" ")[0] in system.parameter_names
    return sentence if named else sentence[0].upper() + sentence[1:]
