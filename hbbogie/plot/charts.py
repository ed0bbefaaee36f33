"""Figures of charts over two parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from hbbogie.errors import door
from hbbogie.plot.appearance import COLOURS, INK, axes, engineering, finish, styled
from hbbogie.results import Chart, ChartPoint, CriticalCurve
from hbbogie.units import behind, readable

Array = NDArray[np.float64]
BOTH = "#f7d9c4"  # where a stable equilibrium and cycles exist side by side
FOLD, HOPF, OTHER = COLOURS[1], COLOURS[0], "#9aa5ad"
DRESS: dict[str, dict[str, Any]] = {
    "supercritical": {"color": HOPF, "ls": "-", "lw": 2.0, "label": "Hopf, supercritical"},
    "subcritical": {"color": HOPF, "ls": (0, (4, 1.8)), "lw": 2.0, "label": "Hopf, subcritical"},
    "undecided": {"color": HOPF, "ls": (0, (1, 1.6)), "lw": 2.0, "label": "Hopf, direction undecided"},
    "unstable": {"color": OTHER, "ls": "-", "lw": 1.1, "label": "Hopf, unstable on both sides"},
}
MARKERS = {
    "cusp": ("^", "cusp of folds"),
    "Bautin point": ("o", "Bautin point"),
    "onset changes": ("o", "onset changes"),
}
COLUMNS = 800  # at which regions are compared


@styled
@door(found=Chart)
def chart(found: Chart, ax: Axes | None = None) -> Axes:
    """Draw curves of folds and of Hopf points in the plane of two parameters.

    The region in which a stable equilibrium and cycles exist side by side is shaded; ranges in which no fold or no
    Hopf point was found are hatched at the foot.

    Parameters
    ----------
    found : Chart
    ax : Axes
    """
    given, ax = ax, axes(ax, (6.6, 4.6))
    over = np.linspace(*found.interval, COLUMNS)
    text = "stable rest beside cycles"
    for low, high in coexistence(found, over):
        if (where := low < high).any():
            ax.fill_between(over, low, high, where=where.tolist(), color=BOTH, lw=0, zorder=1, label=text)
            text = "_"
    height = _height(found)
    pieces = [(key, part) for c in found.hopf for key, part in _pieces(c) if part[1].min() <= height[1]]
    for key, dress in DRESS.items():
        for i, part in enumerate(part for name, part in pieces if name == key):
            ax.plot(*part, zorder=3 if key == "unstable" else 4, **(dress | {"label": "_"} if i else dress))
    for i, c in enumerate(found.folds):
        ax.plot(c.over_values, c.values, color=FOLD, lw=2.0, zorder=5, label="_" if i else "fold of cycles")
    _mark(ax, found, height)
    _empty_ranges(ax, found)
    ax.set_xlim(*found.interval)
    ax.set_ylim(*height)
    engineering(ax.xaxis, found.labels[1])
    engineering(ax.yaxis, found.labels[0])
    return finish(ax, given, found.system)


@styled
@door(found=Chart)
def coexistence_width(found: Chart, ax: Axes | None = None) -> Axes:
    """Draw the width of the region in which a stable equilibrium and cycles exist side by side.

    Parameters
    ----------
    found : Chart
    ax : Axes
    """
    ax = axes(ax, (6.6, 2.6))
    over = np.linspace(*found.interval, COLUMNS)
    both = [high - low for low, high in coexistence(found, over)]
    width = np.fmax(*(np.where(w > 0, w, np.nan) for w in both))
    ax.plot(over, width, color=FOLD, lw=2.0)
    ax.set_xlim(*found.interval)
    ax.set_ylim(bottom=0.0)
    engineering(ax.xaxis, found.labels[1])
    unit = found.labels[0].rpartition(" ")[2]
    engineering(ax.yaxis, f"width of the region {unit}")
    return ax


def coexistence(found: Chart, over: Array) -> list[tuple[Array, Array]]:
    """Return where a stable equilibrium and cycles exist side by side, as (lower, upper) limits, NaN where nowhere.

    First with the equilibrium stable below the lowest Hopf point and cycles above the lowest fold, then mirrored.

    Parameters
    ----------
    found : Chart
    over : ndarray, unit of the second parameter
    """
    above = _extreme(found.folds, over, 1, np.fmin), _extreme(found.hopf, over, -1, np.fmin)
    below = _extreme(found.hopf, over, 1, np.fmax), _extreme(found.folds, over, -1, np.fmax)
    return [above, below]


def _extreme(curves: Sequence[CriticalCurve], over: Array, side: int, choose: np.ufunc) -> Array:
    """Return the smallest or largest critical value with a side, at each value of the second parameter."""
    best = np.full(len(over), np.nan)
    for c in curves:
        for i in range(len(c) - 1):
            inside = (over >= c.over_values[i : i + 2].min()) & (over <= c.over_values[i : i + 2].max())
            if c.side[i] == c.side[i + 1] == side and inside.any():
                best[inside] = choose(best[inside], _between(c, i, over[inside]))
    return best


def _between(c: CriticalCurve, i: int, over: Array) -> Array:
    """Return the critical values between two points of a curve by a cubic with its slopes, where these are finite."""
    x, y, slope = (a[i : i + 2] for a in (c.over_values, c.values, c.slope))
    width = float(x[1] - x[0])
    if width == 0:
        return np.full(len(over), y[0])
    t, chord = (over - x[0]) / width, float(y[1] - y[0])
    ends = (slope * width - chord) if np.isfinite(slope).all() else np.zeros(2)
    return np.asarray(y[0] + chord * t + t * (1 - t) * ((1 - t) * ends[0] - t * ends[1]))


def _pieces(c: CriticalCurve) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Cut a curve of Hopf points where the onset or the stability beside it changes; the pieces meet."""
    keys = []
    for i in range(len(c) - 1):
        onset = c.character[i] if c.character[i] != "undecided" else c.character[i + 1]
        keys.append("unstable" if 0 in c.side[i : i + 2] else onset)
    cuts = [0, *(i for i in range(1, len(keys)) if keys[i] != keys[i - 1]), len(keys)]
    for start, stop in pairwise(cuts):
        if stop > start:
            yield keys[start], (c.over_values[start : stop + 1], c.values[start : stop + 1])


def _mark(ax: Axes, found: Chart, height: tuple[float, float]) -> None:
    """Mark special points of the folds and of the limit of stability, with their coordinates beside the curve."""
    for kind, (marker, text) in MARKERS.items():
        for s in (s for s in found.special if s.kind == kind and height[0] <= s.value <= height[1]):
            c, i = _nearest(found, s)
            if c.kind == "hopf" and c.side[i] == 0:
                continue
            ax.plot(s.over_value, s.value, marker, label=text, zorder=6, ms=7, color=INK, mec="white", mew=1, ls="none")
            place = (8, -14) if c.slope[i] > 0 else (8, 7)
            words = ", ".join(_told(v, t) for v, t in ((s.over_value, found.labels[1]), (s.value, found.labels[0])))
            dress: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8.5, "color": INK, "zorder": 7}
            ax.annotate(words, (s.over_value, s.value), place, **dress)
            text = "_"


def _told(value: float, label: str) -> str:
    """Return a value with the unit of a label."""
    unit = label.rpartition("[")[2].rstrip("]") if label.endswith("]") else ""
    factor, shown = readable(unit, abs(value))
    return f"{factor * value:.4g}{behind(shown)}"


def _nearest(found: Chart, s: ChartPoint) -> tuple[CriticalCurve, int]:
    """Return the point of the curves of its kind that is nearest to a special point."""
    size = np.ptp(found.interval), np.ptp(found.span)
    curves = found.folds if s.curve == "fold" else found.hopf
    away = [np.hypot((c.over_values - s.over_value) / size[0], (c.values - s.value) / size[1]) for c in curves]
    best = int(np.argmin([a.min() for a in away]))
    return curves[best], int(np.argmin(away[best]))


def _height(found: Chart) -> tuple[float, float]:
    """Return the range of the first parameter that shows the folds and the limits of stability."""
    main = [*found.folds, *([c for c in found.hopf if np.any(c.side != 0)] or found.hopf)]
    values = np.concatenate([c.values for c in main] or [np.array(found.span)])
    low, high = float(values.min()), float(values.max())
    room = (high - low or 0.1 * (found.span[1] - found.span[0])) * 0.12
    return low - 1.6 * room, high + room


def _empty_ranges(ax: Axes, found: Chart) -> None:
    """Hatch the ranges in which none was found, at the foot of the axes."""
    across = ax.get_xaxis_transform()
    for level, (ranges, what) in enumerate(
        ((found.without_fold, "no fold found"), (found.without_hopf, "no Hopf point found"))
    ):
        foot = 0.012 + 0.058 * level
        for low, high in ranges:
            ax.axvspan(low, high, foot, foot + 0.045, fc="white", ec="#8a8a8a", hatch="////", lw=0.6, zorder=3)
            if high - low > 0.12 * (found.interval[1] - found.interval[0]):
                box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none"}
                place = (low + high) / 2, foot + 0.0225
                dress: dict[str, Any] = {"fontsize": 8, "color": INK, "bbox": box, "zorder": 7}
                ax.text(*place, what, transform=across, ha="center", va="center", **dress)
