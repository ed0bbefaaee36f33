"""Figures of many motions: basins of attraction, hysteresis, delays."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from hbbogie.errors import door
from hbbogie.plot.appearance import (
    COLOURS,
    INK,
    Array,
    axes,
    bracketed,
    engineering,
    finish,
    scale,
    styled,
)
from hbbogie.plot.branches import branch
from hbbogie.results import Basin, Branch, Hysteresis, SpecialPoint
from hbbogie.units import per_second

# pale, so that the branch stands out: the stable cycle's colour where motions settle on it
ENDS = {"rest": "#eef1f3", "cycle": "#bcd9ec", "undecided": "#f6dfa6"}
ATTRACTORS = ("#bcd9ec", "#cbe5bf", "#e2cbe8", "#f3c8b4", "#c9d2f0", "#d8d5b8")  # pale, by what moves on the cycle
HIGH = 0.6  # share of the largest amplitude at which the map may be cut so that it has no corner without motions
NAMES = {"rest": "comes to rest", "cycle": "settles on a cycle", "undecided": "undecided"}


@styled
@door(scan=Basin)
def basin(
    scan: Basin,
    branches: Sequence[Branch] = (),
    special: Sequence[SpecialPoint] = (),
    ax: Axes | None = None,
    parameter_label: str | None = None,
) -> Axes:
    """Draw how motions end over the parameter and the initial amplitude, with the branches of cycles.

    Where the coordinates belong to groups of bodies, the colour tells which of them move on the cycle that is reached.

    Parameters
    ----------
    scan : Basin
    branches : sequence of Branch
        Drawn over the map: stable solid, unstable dashed.
    special : sequence of SpecialPoint
        Points to mark besides those of the branches, such as Hopf points.
    ax : Axes
    parameter_label : str
        Label of the axis, with unit, such as "speed V [m/s]".
    """
    given, ax = ax, axes(ax, (7.2, 4.8))
    factor, unit = scale(scan.unit or "1", [scan.amplitudes], ax.get_ylabel())
    ax.set_ylabel(f"[{unit}]")  # the branch keeps the unit that stands on the axis
    if branches:
        _branch(ax, branches, scan.coordinate, special)
    kinds, ends = scan.kinds, scan.ends
    shades = dict(zip((k for k in kinds if k not in ENDS), cycle(ATTRACTORS), strict=False)) | ENDS
    codes = np.array([[kinds.index(str(end)) for end in row] for row in ends])
    x = np.repeat(_edges(scan.values[None]).T, codes.shape[1] + 1, axis=1)
    rows = factor * _edges(scan.amplitudes)
    y = np.vstack([rows[:1], 0.5 * (rows[:-1] + rows[1:]), rows[-1:]])
    colours, steps = ListedColormap([shades[kind] for kind in kinds]), np.arange(len(kinds) + 1) - 0.5
    mesh = ax.pcolormesh(x, y, codes, cmap=colours, norm=BoundaryNorm(steps, len(kinds)), zorder=0.5)
    mesh.set_edgecolor("face")  # no hairlines between cells
    for kind in kinds:
        if (ends == kind).any():
            dress: dict[str, Any] = {
                "marker": "s",
                "s": 70,
                "color": shades[kind],
                "edgecolors": "#999999",
                "linewidths": 0.6,
            }
            ax.scatter([], [], label=NAMES.get(kind, f"settles on a cycle: {kind}"), **dress)
    ax.set_axisbelow(False)
    ax.grid(False)
    ax.set_xlim(x.min(), x.max())
    top, widest = float(y[:, -1].min()), float(y[:, -1].max())
    ax.set_ylim(max(0.0, float(y.min())), top if top > HIGH * widest else widest)  # no corner without motions
    engineering(ax.xaxis, parameter_label or f"{scan.parameter} [{scan.parameter_unit or '1'}]")
    ax.set_ylabel(bracketed(f"initial amplitude of {scan.coordinate}", unit))
    return finish(ax, given, scan.system)


@styled
@door(runs=Hysteresis)
def hysteresis(
    runs: Hysteresis,
    branches: Sequence[Branch] = (),
    special: Sequence[SpecialPoint] = (),
    ax: Axes | None = None,
    parameter_label: str | None = None,
) -> Axes:
    """Draw the peaks while a parameter falls and rises over the branches of cycles.

    Parameters
    ----------
    runs : Hysteresis
    branches : sequence of Branch
    special : sequence of SpecialPoint
        Points to mark besides those of the branches, such as Hopf points.
    ax : Axes
    parameter_label : str
        Label of the axis, with unit.
    """
    given, ax = ax, axes(ax, (7.2, 4.8))
    passages = [*runs.falling, *runs.rising]
    factor, unit = scale(runs.unit or "1", [p.peaks for p in passages], ax.get_ylabel())
    ax.set_ylabel(f"[{unit}]")
    unit_of_rate = per_second(runs.parameter_unit)
    for some, name, shades in ((runs.falling, "falling", "Purples"), (runs.rising, "rising", "Greens")):
        tones = colormaps[shades](np.linspace(0.9, 0.45, len(some)))
        fast_to_slow = ", ".join(f"{abs(p.rate):g}" for p in some)
        for p, tone in zip(some, tones, strict=True):
            text = f"{name} by {fast_to_slow} {unit_of_rate} (dark to pale)" if p is some[0] else "_"
            ax.plot(p.values, factor * p.peaks, color=tone, lw=1.3, zorder=2.5, label=text)
            if np.isfinite(p.event):
                ax.plot(p.event, factor * runs.level, "o", ms=4.5, mfc="white", mec=tone, mew=1.3, zorder=6)
    if branches:
        _branch(ax, branches, runs.coordinate, special)
    ax.axhline(factor * runs.level, color=INK, lw=0.8, ls=":", zorder=1)
    highest = max((float(p.peaks.max(initial=0.0)) for p in passages), default=1.0)
    ax.set_xlim(*runs.interval)
    ax.set_ylim(0, 1.06 * factor * highest)
    engineering(ax.xaxis, parameter_label or f"{runs.parameter} [{runs.parameter_unit or '1'}]")
    ax.set_ylabel(bracketed(f"peak of {runs.coordinate}", unit))
    return finish(ax, given, runs.system)


@styled
@door(runs=Hysteresis)
def delays(runs: Hysteresis, ax: Axes | None = None) -> Axes:
    """Draw how late oscillation dies out and starts over the rate, with the laws of smooth systems.

    Parameters
    ----------
    runs : Hysteresis
    ax : Axes
    """
    given, ax = ax, axes(ax)
    laws = (
        (runs.late_falling, "dies out below the fold", "o", COLOURS[3], 2 / 3, "smooth fold: rate$^{2/3}$"),
        (runs.late_rising, "starts beyond the Hopf point", "s", COLOURS[2], 1 / 2, "linear growth: rate$^{1/2}$"),
    )
    for late, name, marker, colour, power, law in laws:
        known = late > 0
        if not known.any():
            continue
        ax.loglog(runs.rates[known], late[known], marker + "-", color=colour, label=name)
        anchor = np.flatnonzero(known)[-1]  # the slowest
        reference = late[anchor] * (runs.rates / runs.rates[anchor]) ** power
        ax.loglog(runs.rates, reference, ls="--", lw=1.0, color=colour, alpha=0.7, label=law)
    ax.set_xticks(runs.rates, [f"{rate:g}" for rate in runs.rates])
    ax.xaxis.minorticks_off()
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    ax.yaxis.set_major_formatter(plain)
    low, high = ax.get_ylim()
    if high < 300 * low:  # over few decades, powers of ten alone would number hardly a tick
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel(f"rate [{per_second(runs.parameter_unit)}]")
    ax.set_ylabel(bracketed(f"delay in {runs.parameter}", runs.parameter_unit))
    return finish(ax, given, runs.system)


# --- what the figures share ---------------------------------------------------------------------


def _branch(ax: Axes, branches: Sequence[Branch], coordinate: str, special: Sequence[SpecialPoint]) -> None:
    """Draw branches with their special points, and a line across at each of these."""
    branch(list(branches), y=coordinate, ax=ax, special=special)
    for point in [*(s for b in branches for s in b.special), *special]:
        ax.axvline(point.value, color=INK, lw=0.7, ls=":", zorder=1)


def _edges(grid: Array) -> Array:
    """Return the edges of cells about the middles in the rows of a grid, shape (k, m) -> (k, m + 1)."""
    if grid.shape[1] == 1:
        half = np.maximum(0.05 * np.abs(grid), 1e-9)
        return np.hstack([grid - half, grid + half])
    between = 0.5 * (grid[:, :-1] + grid[:, 1:])
    return np.hstack([2 * grid[:, :1] - between[:, :1], between, 2 * grid[:, -1:] - between[:, -1:]])
