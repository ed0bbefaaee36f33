"""Figures of a design: what each limit costs, and how a critical value scatters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from hbbogie.errors import ModelError
from hbbogie.plot.appearance import COLOURS, INK, axes, styled


@styled
def gains(names: Sequence[str], values: ArrayLike, ax: Axes | None = None, unit: str = "") -> Axes:
    """Draw as bars what the objective gains when each limit is relaxed by one per cent.

    Parameters
    ----------
    names : sequence of str
        Of the limits and bounds.
    values : array_like, shape (k,), unit of the objective
    ax : Axes
    unit : str
        Unit of the objective.

    Raises
    ------
    ModelError
        When there is nothing to draw.
    """
    heights = np.atleast_1d(np.asarray(values, dtype=float))
    if not len(names) or len(heights) != len(names):
        raise ModelError(
            f"nothing to draw: {len(names)} names and {len(heights)} values; give one value for each name."
        )
    ax = axes(ax, (6.6, 1.2 + 0.42 * len(names)))
    order = np.argsort(heights)
    ax.barh(range(len(names)), heights[order], 0.6, color=COLOURS[0])
    ax.set_yticks(range(len(names)), [names[i] for i in order])
    ax.set_ylim(-0.6, len(names) - 0.4)
    ax.grid(False, axis="y")
    ax.set_xlim(0, 1.08 * max(heights.max(), 1e-300))
    ax.set_xlabel(f"gain where the limit is relaxed by 1 % [{unit or '1'}]")
    return ax


@styled
def scatter(
    samples: Mapping[str, ArrayLike],
    ax: Axes | None = None,
    predictions: Mapping[str, ArrayLike] | None = None,
    service: float | None = None,
    parameter_label: str = "critical value",
) -> Axes:
    """Draw the share of random designs below each value: the distribution functions of critical values.

    Parameters
    ----------
    samples : mapping from label to array_like, shape (count,), unit of the parameter
        NaN are left out.
    ax : Axes
    predictions : mapping from label to array_like, shape (any,), unit of the parameter
        Many predicted values, drawn dashed.
    service : float, unit of the parameter
        A value to mark, such as a service speed.
    parameter_label : str
        Label of the axis, with unit.

    Raises
    ------
    ModelError
        When there is nothing to draw.
    """
    known = {label: np.sort(np.asarray(v, dtype=float)[np.isfinite(v)]) for label, v in samples.items()}
    if not known or not all(len(v) for v in known.values()):
        raise ModelError("nothing to draw: got no sample, or one without values.")
    ax = axes(ax)
    for i, (label, values) in enumerate(known.items()):
        share = np.arange(1, len(values) + 1) / len(values)
        ax.step(values, share, where="post", color=COLOURS[i % len(COLOURS)], label=label)
        if predictions and label in predictions:
            levels = np.linspace(0.001, 0.999, 400)
            ax.plot(
                np.quantile(np.asarray(predictions[label], dtype=float), levels),
                levels,
                "--",
                lw=1.1,
                color=INK,
                label="second order",
            )
    if service is not None:
        ax.axvline(service, color=INK, lw=1.0, ls=(0, (1, 1.6)), label=f"service {service:g}")
    ax.set_ylim(0, 1)
    ax.set_xlabel(parameter_label)
    ax.set_ylabel("share of the designs below [1]")
    handles = dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True))  # each label once
    ax.legend(handles.values(), handles.keys(), loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    return ax
