"""Figures of a design: what each limit costs, and how a critical value scatters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from hbbogie.errors import ModelError
from hbbogie.plot.appearance import INK, NEUTRAL, axes, bracketed, engineering, finish, legend, styled


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
    ax.barh(range(len(names)), heights[order], 0.6, color=NEUTRAL[0])
    ax.set_yticks(range(len(names)), [names[i] for i in order])
    ax.set_ylim(-0.6, len(names) - 0.4)
    ax.grid(False, axis="y")
    ax.set_xlim(0, 1.08 * max(heights.max(), 1e-300))
    ax.set_xlabel(bracketed("gain where the limit is relaxed by 1 %", unit))
    return ax


@styled
def tornado(
    names: Sequence[str],
    columns: Mapping[str, ArrayLike],
    ax: Axes | None = None,
    parameter: str = "it",
    title: str = "",
) -> Axes:
    """Draw elasticities as bars, the most influential parameter on top.

    Parameters
    ----------
    names : sequence of str
        Of the parameters, the most influential first.
    columns : mapping from label to array_like, shape (k,), dimensionless
        Elasticities of each critical value.
    ax : Axes
    parameter : str
        Of which they are the critical values.
    title : str

    Raises
    ------
    ModelError
        When there is nothing to draw.
    """
    if not len(names) or not columns:
        raise ModelError("nothing to draw: got no parameter, or no elasticities.")
    given, ax = ax, axes(ax, (7.0, 1.3 + 0.36 * len(names)))
    height = 0.8 / len(columns)
    for k, (label, values) in enumerate(columns.items()):
        places = [i + (k - (len(columns) - 1) / 2) * height for i in range(len(names))]
        ax.barh(places, np.asarray(values, dtype=float), height, color=NEUTRAL[k % len(NEUTRAL)], label=label)
    ax.set_yticks(range(len(names)), list(names))
    ax.invert_yaxis()  # from the top, in the order of the legend
    ax.grid(False, axis="y")
    ax.axvline(0.0, color=INK, lw=1.0)
    ax.set_xlabel(f"change of {parameter} in % where the parameter grows by 1 %")
    return finish(ax, given, title)


@styled
def shares(
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
        ax.step(values, share, where="post", color=NEUTRAL[i % len(NEUTRAL)], label=label)
        if predictions and label in predictions:
            levels = np.linspace(0.001, 0.999, 400)
            ax.plot(
                np.quantile(np.asarray(predictions[label], dtype=float), levels),
                levels,
                "--",
                lw=1.1,
                color=NEUTRAL[i % len(NEUTRAL)],
                label=f"{label}, second order",
            )
    if service is not None:
        ax.axvline(service, color=INK, lw=1.0, ls=(0, (1, 1.6)), label=f"service {service:g}")
    ax.set_ylim(0, 1)
    engineering(ax.xaxis, parameter_label)
    ax.set_ylabel("share of the designs below")
    return legend(ax)
