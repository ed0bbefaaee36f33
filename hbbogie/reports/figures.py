"""The figures of a report: functions that draw when they are called, and import matplotlib only then."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie.branches.diagram import Diagram
from hbbogie.errors import ModelError, named
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.results import Branch, Orbit
from hbbogie.units import label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 9  # outputs that a page has room for
PANELS = 4  # cycles that a page has room for
Figures = dict[str, "Callable[[], Figure]"]


def linear(family: Branch) -> bool:
    """Tell whether all cycles of a family have one frequency."""
    return bool(np.ptp(family.omega) <= 1e-9 * family.omega.max())


def moves_along(system: System, found: Diagram) -> dict[str, str]:
    """Return what moves along each branch, in the order in which it begins to; empty where there are no groups."""
    if not system.groups:
        return {}
    told = {name: dict.fromkeys(moving_groups(system, o) for o in b.orbits) for name, b in found.branches.items()}
    return {name: ", ".join(t for t in texts if t) for name, texts in told.items()}


def by_mode(system: System, branches: Sequence[Branch]) -> tuple[list[Branch], list[str]]:
    """Return the stretches of branches along which the same groups of bodies move, and which these are.

    Neighbouring stretches share a cycle, so that they meet in a figure.

    Parameters
    ----------
    system : System
    branches : sequence of Branch
    """
    parts, names = list[Branch](), list[str]()
    for branch in branches:
        moves = [moving_groups(system, o) or "rest" for o in branch.orbits]
        cuts = [0, *(i for i in range(1, len(moves)) if moves[i] != moves[i - 1]), len(moves)]
        for first, last in pairwise(cuts):
            parts.append(branch[max(first - 1, 0) : last])
            names.append(moves[first])
    return parts, names


def diagram_figures(system: System, found: Diagram) -> Figures:
    """Return the figures of curves of cycles over a parameter, and of families."""
    parameter = system.parameter(found.parameter)
    across = label(f"{parameter.description} {parameter.name}".strip(), parameter.unit)
    many, q = list(found.branches.values()), system.coordinate_names[0]
    figures: Figures = {}
    if many:
        about: dict[str, Any] = {"parameter_label": across, "special": found.hopf}
        if system.groups:
            many, about["labels"] = by_mode(system, many)
        figures["amplitude"] = partial(draw, "branch", many, y=q, **about)
        figures["frequency"] = partial(draw, "frequency", many, **about)
        if system.output_names:
            figures["outputs"] = partial(_outputs, many, system.output_names[:MOST], **about)
    for name, b in found.branches.items():
        if any(o.stability for o in b.orbits):
            figures[f"{name}_multipliers"] = partial(draw, "multipliers_along", b, parameter_label=across)
    for name, family in found.families.items():
        if linear(family):
            continue
        figures[f"{name}_backbone"] = partial(draw_backbone, family, q)
        some = [family.orbits[i] for i in np.linspace(0, len(family) - 1, 6).round().astype(int)[1:]]
        peaks = [f"peak {o.amplitude(q):.3g}" for o in some]
        figures[f"{name}_phase_portrait"] = partial(draw, "orbit", some, labels=peaks)
    return figures


def cycle_figures(cycles: list[Orbit], system: System) -> Figures:
    """Return the figures of cycles at one value: phase portrait, waveform, spectrum, multipliers."""
    moves = [moving_groups(system, o) for o in cycles]
    labels = [f"{what}, {o.verdict}" for what, o in zip(moves, cycles, strict=True)] if any(moves) else None
    told = _told(cycles, moves)
    figures: Figures = {
        "phase_portrait": partial(draw, "orbit", cycles, labels=labels),
        "waveform": partial(_waveforms, told, dict(zip(system.coordinate_names, cycles[0].units, strict=True))),
        "spectrum": partial(draw, "spectrum", cycles, system.coordinate_names[0]),
    }
    if system.output_names:
        units = {name: system.naming.units.get(name, "1") for name in system.output_names}
        figures["output_waveform"] = partial(_waveforms, told, units)
    if any(o.stability is not None and len(o.stability.multipliers) for _, o in told):
        figures["multipliers"] = partial(_multipliers, told)
    return figures


def _told(cycles: Sequence[Orbit], moves: Sequence[str]) -> list[tuple[str, Orbit]]:
    """Return the cycles that a page has room for, the largest ones, each with what it is and what moves in it."""
    count, first = len(cycles), max(0, len(cycles) - PANELS)
    numbers = [f"cycle {i + 1} of {count}" * (count > 1) for i in range(count)]
    words = [", ".join(filter(None, (n, m, o.verdict))) for n, m, o in zip(numbers, moves, cycles, strict=True)]
    return list(zip(words, cycles, strict=True))[first:]


def _outputs(branches: Sequence[Branch], names: Sequence[str], **about: Any) -> Figure:
    """Draw the peak of each output over the parameter, a panel each."""
    from hbbogie import plot

    columns = min(3, len(names))
    figure, grid = plot.panels(
        -(-len(names) // columns), columns, title=plot.title_of(branches[0][0], branches[0].parameter)
    )
    places = [ax for row in grid for ax in row]
    for ax, name in zip(places, names, strict=False):
        plot.branch(branches, y=name, ax=ax, **about)
    for ax in places[len(names) :]:
        ax.set_axis_off()
    return plot.one_legend(figure)


def _waveforms(shown: Sequence[tuple[str, Orbit]], named_units: Mapping[str, str]) -> Figure:
    """Draw one period of what is named, each in its unit: a row for each cycle, a panel for each unit."""
    from hbbogie import plot

    units = list(dict.fromkeys(named_units.values()))
    figure, grid = plot.panels(len(shown), len(units), title=plot.title_of(shown[0][1]))
    for row, (words, o) in zip(grid, shown, strict=True):
        for ax, unit in zip(row, units, strict=True):
            plot.waveform(o, [name for name, u in named_units.items() if u == unit], ax=ax)
            ax.set_title(words, fontsize=10)
    return plot.one_legend(figure)


def _multipliers(told: Sequence[tuple[str, Orbit]]) -> Figure:
    """Draw the multipliers of each cycle in the complex plane."""
    from hbbogie import plot

    shown = [(w, o) for w, o in told if o.stability is not None and len(o.stability.multipliers)]
    figure, (row,) = plot.panels(1, len(shown), (4.4 * len(shown), 4.6), plot.title_of(shown[0][1]))
    for ax, (words, o) in zip(row, shown, strict=True):
        plot.multipliers(o, ax=ax).set_title(words, fontsize=10)
    return plot.one_legend(figure)


def draw_backbone(family: Branch, coordinate: str) -> Figure:
    """Draw the peak of a coordinate over the frequency of a family of cycles."""
    from hbbogie import plot

    dressed = [o.replace(parameters={**o.parameters, "omega": o.omega}) for o in family.orbits]
    curve = Branch(tuple(dressed), "omega", (), family.ends)
    ax = plot.branch(curve, y=coordinate, parameter_label="frequency omega [rad/s]")
    for line in ax.lines:  # neutral all along: there are no verdicts to tell apart
        line.set_linestyle("-")
    legend = ax.get_legend()
    if legend is not None:
        legend.remove()
    return ax.figure.figure


def load_saved(path: Path) -> Branch:
    """Return a branch from a file, or a saved cycle as a branch of one point.

    Raises
    ------
    ModelError
        When the file is not there or holds neither.
    """
    try:
        return Branch.load(path)
    except ModelError as no_branch:
        try:
            return Branch((Orbit.load(path),), "")
        except ModelError:
            raise no_branch from None


def plot_branch(saved: Branch, path: Path, coordinate: str | None = None, quantity: str = "peak") -> Path:
    """Draw a branch over its parameter, or a single cycle as a phase portrait, into a file.

    Parameters
    ----------
    saved : Branch
    path : Path
        Of the figure.
    coordinate : str, optional
        Or output; the first coordinate where left out.
    quantity : {"peak", "first harmonic", "half peak to peak", "mean", "rms"}
    """
    from hbbogie import plot

    named("plot", "quantity", quantity, plot.QUANTITIES)
    if len(saved) == 1:
        return plot.save(draw("orbit", saved.orbits[0], x=coordinate), path)
    return plot.save(draw("branch", saved, y=coordinate, quantity=quantity), path)


def draw(name: str, *args: Any, **kwargs: Any) -> Figure:
    """Return the figure drawn by a function of `hbbogie.plot`; matplotlib is imported only now."""
    from hbbogie import plot

    figure: Figure = getattr(plot, name)(*args, **kwargs).figure.figure
    return figure


def drawn_or_reason(draws: Callable[[], Figure]) -> Figure:
    """Return a figure; where it cannot be drawn, one that says so."""
    from hbbogie.plot.studies import unavailable

    try:
        figure = draws()
        figure.draw_without_rendering()  # where axes without a value show
        return figure
    except Exception as error:
        return unavailable(reason_of(error)).figure.figure


def reason_of(error: Exception) -> str:
    """Return why something could not be done, in one line."""
    text = str(error).strip().partition("\n")[0]
    return text if isinstance(error, ModelError) else f"{type(error).__name__}: {text}"
