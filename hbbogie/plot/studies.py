"""Figures of studies: maps, distributions, scatter and parallel coordinates, sensitivities, predictions."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from textwrap import fill
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from hbbogie.errors import ModelError
from hbbogie.plot.appearance import INK, NEUTRAL, PALE, Array, axes, bracketed, figure_of, legend, styled
from hbbogie.units import readable

if TYPE_CHECKING:
    import xarray as xr

LEVELS = 14
MAP = "viridis"
MOST = 300  # lines of parallel coordinates, spread evenly over the output


def column(data: xr.Dataset, name: str) -> tuple[Array, str]:
    """Return the values of an input or output, shape (N,), and their label, in a unit that is read easily."""
    values, text, unit = _own(data, name)
    factor, unit = readable(unit, float(np.nanmax(np.abs(values), initial=0.0)))
    return factor * values, fill(bracketed(text, unit), 48)


def _own(data: xr.Dataset, name: str) -> tuple[Array, str, str]:
    """Return the values of an input or output, shape (N,), as they are, what they are, and their unit."""
    of = data[name].attrs
    text, unit = f"{of.get('long_name', '')} {name}".strip(), of.get("units") or "1"
    return np.asarray(data[name].values, dtype=float), text, unit


@styled
def parameter_map(data: xr.Dataset, x: str, y: str, output: str, ax: Axes | None = None) -> Axes:
    """Draw an output over two inputs as filled contours; where it has no value the map is white.

    Parameters
    ----------
    data : xarray.Dataset
        Result of a study; points on a grid, or scattered.
    x, y : str
        Inputs.
    output : str
    ax : Axes
    """
    ax = axes(ax, (6.6, 4.6))
    (u, across_label), (v, up_label), (w, height_label) = (column(data, n) for n in (x, y, output))
    known = np.isfinite(w)
    if np.count_nonzero(known) < 3:
        raise ModelError(f"map of {output!r}: fewer than three points have a value.")
    across, up = np.unique(u), np.unique(v)
    levels: Any = LEVELS if np.ptp(w[known]) > 0 else [w[known][0] - 0.5, w[known][0] + 0.5]
    counts = bool((w[known] == np.round(w[known])).all()) and 0 < np.ptp(w[known]) < LEVELS
    if counts:  # a level for each number
        levels = np.arange(w[known].min() - 0.5, w[known].max() + 1)
    if len(across) * len(up) == len(w) and len(across) > 1 and len(up) > 1:
        field = np.full((len(up), len(across)), np.nan)
        field[np.searchsorted(up, v), np.searchsorted(across, u)] = w
        filled: Any = ax.contourf(across, up, np.ma.masked_invalid(field), levels, cmap=MAP)
        lines = ax.contour(across, up, np.ma.masked_invalid(field), levels, colors="white", linewidths=0.5)
        ax.clabel(lines, list(lines.levels)[::2], fontsize=7, fmt="%.4g")
    else:
        filled = ax.tricontourf(u[known], v[known], w[known], levels, cmap=MAP)
    ax.plot(u, v, ".", color="white", ms=1.5, alpha=0.6)
    if (~known).any():
        ax.plot(u[~known], v[~known], "x", color=INK, ms=4, mew=0.8, label=f"no {output}")
        legend(ax)
    ax.grid(False)
    bar = figure_of(ax).colorbar(filled, ax=ax, label=height_label)
    if counts:
        bar.set_ticks(list(np.unique(np.round(w[known]))))
    ax.set_xlabel(across_label)
    ax.set_ylabel(up_label)
    return ax


@styled
def distribution(
    data: xr.Dataset, output: str, thresholds: Sequence[tuple[float, str]] = (), ax: Axes | None = None
) -> Axes:
    """Draw the distribution of an output: a histogram, and the empirical distribution function on the right.

    Parameters
    ----------
    data : xarray.Dataset
    output : str
    thresholds : sequence of (value, text)
        Marked by lines; the text says what their probability is.
    ax : Axes
    """
    ax = axes(ax)
    w, text, unit = _own(data, output)  # the unit the thresholds are in
    w = np.sort(w[np.isfinite(w)])
    ax.hist(
        w, bins=min(40, max(5, int(np.sqrt(len(w))))), color=NEUTRAL[0], alpha=0.55, edgecolor="white", linewidth=0.6
    )
    ax.set_xlabel(bracketed(text, unit))
    ax.set_ylabel("samples")
    ax.yaxis.set_major_locator(MaxNLocator(integer=True))
    right = ax.twinx()
    right.grid(False)
    right.spines["right"].set_visible(True)
    right.step(w, np.arange(1, len(w) + 1) / len(w), where="post", color=INK, lw=1.3)
    right.set_ylim(0, 1.02)
    right.set_ylabel("share of the samples below")
    for k, (value, meaning) in enumerate(thresholds):
        ax.axvline(value, color=NEUTRAL[(1 + k) % len(NEUTRAL)], ls="--", lw=1.4, label=meaning)
    if thresholds:
        legend(ax)
    return ax


@styled
def sample_scatter(data: xr.Dataset, x: str, y: str, colour: str | None = None, ax: Axes | None = None) -> Axes:
    """Draw one column of a study over another, coloured by a third where one is named.

    Parameters
    ----------
    data : xarray.Dataset
    x, y : str
        Inputs or outputs.
    colour : str, optional
    ax : Axes
    """
    ax = axes(ax)
    (u, across_label), (v, up_label) = column(data, x), column(data, y)
    hue: Any = NEUTRAL[0] if colour is None else column(data, colour)[0]
    dots = ax.scatter(u, v, c=hue, s=14, cmap=MAP if colour else None, alpha=0.8, linewidths=0)
    if colour is not None:
        figure_of(ax).colorbar(dots, ax=ax, label=column(data, colour)[1])
    ax.set_xlabel(across_label)
    ax.set_ylabel(up_label)
    return ax


@styled
def parallel_coordinates(data: xr.Dataset, inputs: Sequence[str], output: str, ax: Axes | None = None) -> Axes:
    """Draw each point as a line over its inputs, each from its smallest to its largest value, coloured by an output.

    Parameters
    ----------
    data : xarray.Dataset
    inputs : sequence of str
    output : str
    ax : Axes
    """
    ax = axes(ax, (max(6.6, 1.0 * len(inputs) + 2), 4.2))
    w = np.asarray(data[output].values, dtype=float)
    known = np.isfinite(w)
    columns = [np.asarray(data[n].values, dtype=float) for n in (*inputs, output)]
    ranges = [(float(np.nanmin(c)), float(np.nanmax(c))) for c in columns]
    heights = np.array([(c - lo) / ((hi - lo) or 1.0) for c, (lo, hi) in zip(columns, ranges, strict=True)])
    order = np.argsort(w[known], kind="stable")
    order = order[np.unique(np.linspace(0, len(order) - 1, MOST).round().astype(int))]
    places = np.arange(len(columns))
    lines = LineCollection(
        [np.column_stack([places, h]) for h in heights.T[known][order]], cmap=MAP, linewidths=0.9, alpha=0.6
    )
    lines.set_array(w[known][order])
    ax.add_collection(lines)
    ax.set_xlim(-0.2, len(columns) - 0.8)
    ax.set_ylim(-0.05, 1.05)
    texts = [f"{n}\n{lo:.3g}\nto {hi:.3g}" for n, (lo, hi) in zip((*inputs, output), ranges, strict=True)]
    ax.set_xticks(places, texts, fontsize=8)
    ax.set_yticks([0, 1], ["smallest", "largest"])
    ax.grid(False)
    for place in places:
        ax.axvline(float(place), color=PALE, lw=1, zorder=0)
    figure_of(ax).colorbar(lines, ax=ax, label=column(data, output)[1])
    return ax


@styled
def sensitivity(
    names: Sequence[str],
    first: ArrayLike,
    total: ArrayLike,
    first_error: ArrayLike,
    total_error: ArrayLike,
    ax: Axes | None = None,
) -> Axes:
    """Draw Sobol indices as bars with their confidence intervals, the most influential input on top.

    Parameters
    ----------
    names : sequence of str
    first, total, first_error, total_error : array_like, shape (k,), dimensionless
    ax : Axes
    """
    ax = axes(ax, (6.6, 1.4 + 0.42 * len(names)))
    order = np.argsort(np.asarray(total))
    places = np.arange(len(order))
    for values, errors, shift, colour, text in (
        (first, first_error, -0.19, NEUTRAL[0], "first order"),
        (total, total_error, 0.19, NEUTRAL[1], "total"),
    ):
        v, e = np.asarray(values)[order], np.asarray(errors)[order]
        ax.barh(places + shift, v, 0.36, xerr=e, color=colour, ecolor=INK, error_kw={"lw": 1}, label=text)
    ax.set_yticks(places, [names[i] for i in order])
    ax.set_xlabel("share of the variance")
    ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
    return legend(ax)


@styled
def prediction(sampled: ArrayLike, predicted: ArrayLike, label: str, ax: Axes | None = None) -> Axes:
    """Draw what a gradient predicts over what was sampled; on the line both agree.

    Parameters
    ----------
    sampled, predicted : array_like, shape (N,)
    label : str
        Name and unit of the output.
    ax : Axes
    """
    ax = axes(ax, (5.2, 4.8))
    u, v = np.asarray(sampled), np.asarray(predicted)
    ends = [min(u.min(), v.min()), max(u.max(), v.max())]
    ax.plot(ends, ends, color=INK, lw=1, ls="--", label="prediction = sample")
    ax.plot(u, v, "o", ms=3.5, color=NEUTRAL[0], alpha=0.6, mew=0)
    ax.set_xlabel(f"sampled {label}")
    ax.set_ylabel(f"predicted {label}")
    return legend(ax)


@styled
def unavailable(reason: str, ax: Axes | None = None) -> Axes:
    """Say in the place of a figure why it cannot be drawn.

    Parameters
    ----------
    reason : str
    ax : Axes
    """
    ax = axes(ax, (6.6, 1.6))
    ax.set_axis_off()
    text = fill(f"This figure cannot be drawn: {reason}", 70)
    figure_of(ax).text(0.5, 0.5, text, ha="center", va="center", color=INK)
    return ax


def drawing(figure: Figure, dots: int = 110) -> bytes:
    """Return a figure as a PNG with so many dots per inch, and free its memory."""
    memory = BytesIO()
    figure.savefig(memory, format="png", dpi=dots, bbox_inches="tight", facecolor="white")
    plt.close(figure)
    return memory.getvalue()
