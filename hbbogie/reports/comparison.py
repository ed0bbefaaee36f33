"""The comparison of methods as tables, sentences and a figure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie.branches.comparison import Comparison, check_methods, compare, default_methods
from hbbogie.model.problem import default_interval
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.progress import Progress, silent
from hbbogie.reports.report import Report
from hbbogie.reports.table import Table
from hbbogie.units import behind, label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 30  # columns of the errors that are shown
GOOD = 1.0  # %; a method is called good enough while its errors stay below


def table_of_errors(found: Comparison) -> Table:
    """Return the errors of every method at every cycle, in per cent of the converged values."""
    quantities = found.quantities()
    columns = [label(found.parameter, found.unit), "part", *(f"{q} {found.truth}" for q in quantities)]
    columns += [f"{q} error {m} [%]" for m in found.approximations for q in quantities]
    rows = []
    for row in found.rows:
        errors = [row.error(m, take) for m in found.approximations for take in quantities.values()]
        rows.append((row.value, row.part, *(take(row.truth) for take in quantities.values()), *errors))
    formats = (".6g", "d", *[".6g"] * len(quantities), *[".3f"] * (len(columns) - 2 - len(quantities)))
    note = "The part counts the folds between the Hopf point and the cycle."
    return Table("errors", "Errors by method", tuple(columns), tuple(rows), formats, (note,))


def table_of_methods(found: Comparison) -> Table:
    """Return, for every method, its fold with error, its largest errors, and what it takes."""
    exact = found.methods[found.truth].fold
    quantities = found.quantities()
    fold = label(f"fold {found.parameter}", found.unit)
    columns = ("method", fold, "error of fold [%]", *(f"largest error of {q} [%]" for q in quantities))
    columns += ("cycles missed", "build [ms]", "branch [ms]", "solve [ms]")
    body = []
    for name, method in found.methods.items():
        error = None if method.fold is None or not exact else 100 * (method.fold / exact - 1)
        worst: list[Any] = [None] * len(quantities)
        missed, solve = 0, None
        if name != found.truth:
            worst = [_largest([row.error(name, take) for row in found.rows]) for take in quantities.values()]
            missed = sum(row.orbits[name] is None for row in found.rows)
            times = [row.seconds[name] for row in found.rows if name in row.seconds]
            solve = 1e3 * float(np.median(times)) if times else None
        body.append((name, method.fold, error, *worst, missed, 1e3 * method.building, 1e3 * method.tracing, solve))
    formats = ("", ".4f", ".4f", *[".3f"] * len(quantities), "d", ".1f", ".1f", ".2f")
    return Table("methods", "Methods", columns, tuple(body), formats)


def _largest(errors: Sequence[float | None]) -> float | None:
    sizes = [abs(e) for e in errors if e is not None]
    return max(sizes, default=None)


def verdicts(found: Comparison) -> tuple[str, ...]:
    """Return a sentence on each method: where it is good enough and where not, from the numbers."""
    unit = behind(found.unit)
    exact = found.methods[found.truth].fold
    sentences = []
    for name in found.approximations:
        known = []
        for row in found.rows:
            errors = {what: row.error(name, take) for what, take in found.quantities().items()}
            sizes = {what: abs(error) for what, error in errors.items() if error is not None}
            if sizes:
                what = max(sizes, key=sizes.__getitem__)
                known.append((row.value, sizes[what], what))
        if not known:
            sentences.append(f"{name} finds none of the cycles compared.")
            continue
        good = [value for value, error, _ in known if error <= GOOD]
        place, size, what = max(known, key=lambda entry: entry[1])
        text = f"{name}: within {GOOD:g} % in frequency and amplitude at {len(good)} of {len(found.rows)} cycles"
        text += f" ({found.parameter} from {min(good):g} to {max(good):g}{unit})" if good else ""
        text += f"; its largest error, of the {what}, is {size:.2g} % at {found.parameter} = {place:.5g}{unit}"
        fold = found.methods[name].fold
        if exact and fold:
            text += f"; its critical value (fold) {fold:.5g}{unit} is off by {100 * (fold / exact - 1):+.2g} %"
        sentences.append(text + ".")
    return tuple(sentences)


def comparison_of(
    module: ModuleType,
    system: System,
    methods: Sequence[str] | None = None,
    values: Sequence[float] | None = None,
    progress: Progress = silent,
) -> Report:
    """Compare methods on a problem: by its own function ``comparison`` where it has one, else generally.

    Parameters
    ----------
    module : module
        As returned by `load_problem`; its ``comparison(system, methods, progress)`` returns a `Report`.
    system : System
    methods, values, progress
        As of `compare`. Values that are given are compared generally, also where the module has its own way.
    """
    chosen, left_out = (check_methods(methods), ()) if methods else default_methods(system)
    own = getattr(module, "comparison", None)
    if own is not None and values is None:
        report: Report = own(system, chosen, progress)
        return report
    parameter, interval = default_interval(module, system)
    found = compare(system, chosen, values, parameter=parameter, interval=interval, progress=progress)
    branches = {f"branch_{name}": method.branch for name, method in found.methods.items()}
    figures: dict[str, Callable[[], Figure]] = {"comparison": partial(_page, found)}
    errors, methods_table = table_of_errors(found), table_of_methods(found)
    many = len(errors.columns) > MOST  # too many to be read: the file has them all
    tables = (methods_table,) if many else (errors, methods_table)
    said = (*verdicts(found), *_quasi_linear(system, found), *_compared_branch(system, found))
    return Report(
        f"{system.name}: methods compared",
        tables,
        branches,
        figures,
        (*said, *left_out),
        long_tables=(errors,) if many else (),
        summary=said or left_out,
    )


def _quasi_linear(system: System, found: Comparison) -> tuple[str, ...]:
    """Return what the describing function does with forces that are no elements, such as creep forces."""
    rows = system.parts(contact=True).remainder_rows
    if "df1" not in found.methods or not rows:
        return ()
    names = ", ".join(system.coordinate_names[i] for i in rows)
    return (
        f"df1 is quasi-linear practice: in the equations of {names} the nonlinear forces that are no elements, such as "
        "creep forces, count with their first harmonic, all that they depend on being sinusoidal.",
    )


def _compared_branch(system: System, found: Comparison) -> tuple[str, ...]:
    """Return what moves along the branch that is compared on, where other branches belong to other groups of bodies."""
    branch = found.methods[found.truth].branch
    moves = ", ".join(m for m in dict.fromkeys(moving_groups(system, o) for o in branch.orbits) if m)
    if not moves:
        return ()
    return (
        f"Compared on the branch of the first Hopf point, along which there move: {moves}. Other branches may have "
        "lower folds: see hbbogie critical.",
    )


def _page(found: Comparison) -> Figure:
    """Draw the branches by every method, and the errors over the parameter."""
    from hbbogie import plot

    figure, axes = plot.panels(1, 2)
    branches = [method.branch for method in found.methods.values()]
    across = label(found.parameter, found.unit)
    names = list(found.methods)
    plot.branch(branches, y=found.coordinates[0], ax=axes[0, 0], labels=names, parameter_label=across)
    for name in found.approximations:
        pairs = [
            (row.value, abs(row.error(name, lambda o: o.amplitude(found.coordinates[0])) or 0.0)) for row in found.rows
        ]
        pairs = [(value, error) for value, error in pairs if error > 0]
        if pairs:
            axes[0, 1].semilogy(*zip(*pairs, strict=True), "o", ms=4, label=f"error, {name}")
    axes[0, 1].set_xlabel(across)
    axes[0, 1].set_ylabel(f"error of the peak of {found.coordinates[0]} [%]")
    return plot.one_legend(figure)
