"""A design as tables, figures and sentences, with the checks that the optimum must pass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.continuation import trace
from hbbogie.design.criteria import CriticalValue, Quantity
from hbbogie.design.optimisation import Design, optimise
from hbbogie.design.point import DesignPoint
from hbbogie.design.robust import Uncertainty
from hbbogie.design.samples import monte_carlo
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError
from hbbogie.model.problem import default_interval
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.progress import Progress, silent
from hbbogie.reports.design_checks import check_table
from hbbogie.reports.report import Report
from hbbogie.reports.robust_design import robust_quantity, robust_table, shares_of
from hbbogie.reports.table import Table
from hbbogie.results import Branch
from hbbogie.results.failure import ConvergenceError
from hbbogie.units import behind, label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
VALUES = "optimum.toml"  # as --values takes them
CAPTION = "Cycles before and after the change of the design, over the whole range and about the critical values."


def design_of(
    module: ModuleType,
    system: System,
    progress: Progress = silent,
    *,
    starts: int = 1,
    seed: int = 0,
    samples: int = 40,
    robust: float | None = None,
    quantile: float | None = None,
    designs: int | None = None,
    start: Mapping[str, float] | None = None,
) -> Report:
    """Optimise the design of a problem and check it.

    Parameters
    ----------
    module : module
        As returned by `load_problem`; its ``design(system)`` returns keywords of `optimise`, its PARAMETER and RANGE
        hold where these say nothing, UNCERTAIN (an `Uncertainty`) and SERVICE (a value of the parameter) are optional.
    system : System
    progress : callable
        Called with (message, fraction done or None).
    starts, seed : int
        As of `optimise`.
    samples : int
        Random designs before and after, for the check of the moments; none where 0.
    robust : float, optional
        Raise the mean minus so many standard deviations instead of the value of the design itself.
    quantile : float, optional
        Raise this quantile over random designs, such as 0.05, instead.
    designs : int, optional
        Their number, as of `SampledQuantile`.
    start : mapping from name to float, optional
        Where the first search begins, as of `optimise`. By default that for a robust design begins at the optimum
        without scatter.

    Raises
    ------
    ModelError
        When the module has no function ``design``, is to be robust without UNCERTAIN, or in both ways.
    """
    where = f"problem {getattr(module, '__file__', None) or module.__name__!r}"
    if not callable(getattr(module, "design", None)):
        raise ModelError(f"{where} has no design; write a function design(system) that returns keywords of optimise.")
    name, interval = default_interval(module, system)
    task: dict[str, Any] = {
        "raise_": name,
        "interval": interval,
        "starts": starts,
        "seed": seed,
        **module.design(system),
    }
    uncertain: Uncertainty | None = getattr(module, "UNCERTAIN", None)
    unit = system.parameter(task["raise_"]).unit
    asked = robust_quantity(where, uncertain, robust, quantile, designs, seed, unit)
    design, nominal = _searched(system, task, asked, start, progress)
    tables = [parameter_table(design), critical_table(design), limit_table(design), active_table(design)]
    branches: dict[str, Branch | None] = {}
    if not design.interrupted:
        branches = {k: _branch(p, progress, k) for k, p in _both(design)}
        tables.append(check_table(design, task, progress))
    notes = _sentences(design, unit)
    figures: dict[str, Callable[[], Figure]] = {}
    if branches:
        figures["bifurcation"] = partial(_bifurcation, branches, design)
    if design.active:
        figures["gains"] = partial(_gains, design)
    data = {"value_before": design.value_before, "value": design.value, "parameters": design.parameters}
    data |= {"residual": design.residual, "converged": design.converged, "weights": design.weights}
    if len(design.starts) > 1:
        tables.append(start_table(design))
    if uncertain is not None and samples and not design.interrupted:
        points = {"before": design.before, **({"nominal": nominal.after} if nominal else {}), "after": design.after}
        drawn = {k: monte_carlo(p, uncertain, samples, seed, progress) for k, p in points.items()}
        judged = points, uncertain, drawn, getattr(module, "SERVICE", None)
        tables.append(robust_table(*judged))
        figures["distribution"] = partial(shares_of, *judged, label(f"critical {name}", unit))
    saved = {k: b for k, b in branches.items() if b is not None}
    over = [(n, system.parameter(n).description, *ends, system.parameter(n).unit) for n, ends in design.over.items()]
    columns = ("parameter", "what it is", "at least", "at most", "unit")
    return Report(
        f"{system.name}: design for a higher critical {name}",
        tuple(tables),
        saved,
        figures,
        notes,
        data,
        summary=(notes[0], *_moved(design)),
        about=(f"The design with the highest critical {name} under the limits of the problem.",),
        captions={"bifurcation": CAPTION},
        texts={VALUES: "".join(f"{n} = {v!r}\n" for n, v in design.parameters.items())},
        inputs=(Table("over", "Parameters that may change", columns, tuple(over), ("", "", ".5g", ".5g", "")),),
    )


def _searched(
    system: System, task: dict[str, Any], asked: Quantity | None, start: Mapping[str, float] | None, progress: Progress
) -> tuple[Design, Design | None]:
    """Return the design, and that of the system without scatter, at which the search for a robust one began."""
    if asked is None:
        return optimise(system, progress=progress, start=start, **task), None
    nominal = None
    if start is None:  # from there a search with random designs needs few steps
        nominal = optimise(system, progress=progress, **task)
        if nominal.interrupted:
            return nominal, None
        start = nominal.parameters
    task["maximise"] = asked
    return optimise(system, progress=progress, start=start, **task), nominal


def _moved(design: Design) -> tuple[str, ...]:
    """Return how the parameters have changed, in one sentence."""
    old, naming = design.before.system.values, design.before.system.naming
    moved = [
        f"{naming.plain(n)} by {100 * (v / old[n] - 1):+.0f} %"
        for n, v in design.parameters.items()
        if n in design.over and old[n] and abs(v / old[n] - 1) > 1e-3
    ]
    kept = "All limits are kept." if design.feasible else "NOT all limits are kept."
    return (f"It changes {'; '.join(moved)}.".replace("-", "\N{MINUS SIGN}"), kept) if moved else (kept,)


def _both(design: Design) -> tuple[tuple[str, DesignPoint], ...]:
    return ("before", design.before), ("after", design.after)


def _sentences(design: Design, unit: str) -> tuple[str, ...]:
    before, after = design.before.value, design.after.value
    gain = f"The critical value of {design.before.parameter} goes from {before:.6g} to {after:.6g}{behind(unit)}"
    more = f"{100 * (after / before - 1):.3g} %" if min(before, after) > 0 else f"{after - before:.4g}{behind(unit)}"
    first = f"{gain}, by {more}."
    low = [f"{n} ({w:.3g})" for n, w in design.weights.items()]
    other = design.objective.name, design.objective.unit
    ends = f"{design.value_before:.6g} to {design.value:.6g}{behind(other[1])}"
    return (
        first,
        *([f"What was asked for, {other[0]}, goes from {ends}."] if other[0] != CriticalValue.name else []),
        f"The search {design.status}; largest entry of the scaled gradient of the Lagrangian {design.residual:.1e}; "
        f"{'all limits are kept' if design.feasible else 'NOT all limits are kept'}.",
        f"What is raised, with its weight in the optimum: {', '.join(low)}.",
    )


# --- tables -----------------------------------------------------------------------------------


def parameter_table(design: Design) -> Table:
    """Return the parameters before and after."""
    system, rows = design.before.system, []
    for name, (low, high) in design.over.items():
        old, new = system.values[name], design.parameters[name]
        at = "lower bound" if new <= low else "upper bound" if new >= high else ""
        what = system.parameter(name)
        rows.append(
            (name, what.description, what.unit, old, new, 100 * (new / old - 1) if old else None, low, high, at)
        )
    columns = ("parameter", "what it is", "unit", "before", "after", "change [%]", "lower bound", "upper bound", "at")
    formats = ("", "", "", ".5g", ".5g", "+.1f", ".5g", ".5g", "")
    return Table("design", "Parameters before and after", columns, tuple(rows), formats)


def critical_table(design: Design) -> Table:
    """Return the critical values before and after."""
    unit = design.before.system.parameter(design.before.parameter).unit
    rows: list[tuple[Any, ...]] = [
        (when, name, c.value, c.omega, c.orbit.frequency, moving_groups(point.system, c.orbit))
        for when, point in _both(design)
        for name, c in zip(point.names, point.critical, strict=True)
    ]
    columns = ("design", "name", label(design.before.parameter, unit), "omega [rad/s]", "frequency [Hz]", "moves")
    shown = 6 if design.before.system.groups else 5
    formats = ("", "", ".7g", ".6g", ".6g", "")
    rows = [row[:shown] for row in rows]
    return Table("critical", "Critical values before and after", columns[:shown], tuple(rows), formats[:shown])


def limit_table(design: Design) -> Table:
    """Return every limit with its values before and after."""

    def shown(x: float) -> float | None:
        return float(x) if np.isfinite(x) else None

    rows = [(name, unit or "1", *map(shown, rest)) for name, unit, *rest in design.limits]
    columns = ("limit", "unit", "at least", "at most", "before", "after")
    return Table("limits", "Limits", columns, tuple(rows), ("", "", ".5g", ".5g", ".5g", ".5g"))


def active_table(design: Design) -> Table:
    """Return what holds the optimum, and what each of it costs."""
    rows = [
        (a.name, f"{a.side} {a.kind}", a.limit, a.unit or "1", a.multiplier, a.per_percent)
        for a in sorted(design.active, key=lambda a: -a.per_percent)
    ]
    unit = design.objective.unit or "1"
    columns = ("what", "kind", "value", "unit", f"multiplier [{unit} per unit]", f"gain for 1 % [{unit}]")
    note = "Multiplier: what is gained per unit by which a limit is relaxed, at the optimum; all others cost nothing."
    return Table("active", "Active limits and bounds", columns, tuple(rows), ("", "", ".5g", "", ".4g", ".4f"), (note,))


def start_table(design: Design) -> Table:
    """Return the starts of the search and where each ended."""
    rows = [
        (k + 1, *s.parameters.values(), None if np.isnan(s.value) else s.value, "yes" if s.feasible else "no", s.status)
        for k, s in enumerate(design.starts)
    ]
    columns = ("start", *design.over, design.objective.name, "limits kept", "how it ended")
    formats = ("d", *[".4g"] * len(design.over), ".7g", "", "")
    return Table("starts", "Starts", columns, tuple(rows), formats)


def _branch(point: DesignPoint, progress: Progress, when: str) -> Branch | None:
    """Return the branch of the smallest fold, or else from the first Hopf point that leads to one; None without any."""
    progress(f"branch {when}", None)
    smallest = [c.orbit for c in point.critical[:1] if c.kind == "fold"]
    for start in (*smallest, *hopf_points(point.system, point.parameter, point.interval)):
        try:
            return trace(point.equations, start, point.parameter, point.interval, longest=0.15, families=False)
        except ConvergenceError:
            continue
    return None


# --- figures ----------------------------------------------------------------------------------


def _bifurcation(branches: dict[str, Branch | None], design: Design) -> Figure:
    """Draw the branches before and after, over the whole range and about their folds."""
    from hbbogie import plot

    shown = {k: b for k, b in branches.items() if b is not None}
    figure, ((whole, close),) = plot.panels(1, 2)
    parameter = design.before.system.parameter(design.before.parameter)
    across = label(f"{parameter.description} {parameter.name}".strip(), parameter.unit)
    for ax in (whole, close):
        plot.branch(list(shown.values()), ax=ax, labels=list(shown), parameter_label=across)
    low, high = (p.value for _, p in _both(design))
    margin = 0.06 * (design.before.interval[1] - design.before.interval[0])
    close.set_xlim(min(low, high) - margin, max(low, high) + margin)
    name = design.before.system.coordinate_names[0]
    peaks = [b.amplitude(name)[b.values <= max(low, high) + margin] for b in shown.values()]
    seen = np.concatenate([*peaks, np.empty(0)])
    if len(seen) and close.dataLim.y1 > 0:  # the axis may show the unit with a prefix
        unit = close.dataLim.y1 / max(b.amplitude(name).max() for b in shown.values())
        close.set_ylim(0.95 * unit * seen.min(), 1.03 * unit * seen.max())
    close.set_title("about the critical values", fontsize=11)
    whole.set_title("the whole range", fontsize=11)
    return plot.one_legend(figure)


def _gains(design: Design) -> Figure:
    from hbbogie import plot

    names = [f"{a.name}, {a.side} {a.kind}" for a in design.active]
    values = [a.per_percent for a in design.active]
    return plot.figure_of(plot.gains(names, values, unit=design.objective.unit))
