"""Figures over a parameter: amplitude, frequency, multipliers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from hbbogie.errors import ModelError, door, named, several
from hbbogie.plot.appearance import (
    INK,
    LINES,
    NEUTRAL,
    SHADES,
    axes,
    bracketed,
    coordinate_of,
    engineering,
    figure_of,
    finish,
    scale,
    styled,
    title_of,
)
from hbbogie.plot.curves import Height, draw_limits, draw_marks, draw_pieces, gaps, level_of, onset, pieces
from hbbogie.results import Branch, LimitLine, Orbit, SpecialPoint
from hbbogie.units import per_second

QUANTITIES: dict[str, Callable[[Orbit, str], float]] = {
    "peak": Orbit.amplitude,
    "first harmonic": Orbit.first_harmonic,
    "half peak to peak": Orbit.half_peak_to_peak,
    "mean": Orbit.mean,
    "rms": Orbit.rms,
    "mean speed": Orbit.mean_speed,
}
CRUSHED = 0.12  # share of the axis below which special points are shown once more, enlarged
Published = Iterable[tuple[str, ArrayLike, ArrayLike, str]]


@styled
def branch(
    branches: Branch | Sequence[Branch],
    y: str | None = None,
    ax: Axes | None = None,
    quantity: str = "peak",
    published: Published = (),
    labels: Sequence[str] | None = None,
    parameter_label: str | None = None,
    special: Sequence[SpecialPoint] = (),
    limits: Sequence[LimitLine] = (),
) -> Axes:
    """Draw the amplitude over the parameter: stable solid, unstable dashed, unknown dotted.

    Parameters
    ----------
    branches : Branch or sequence of Branch
    y : str
        Coordinate or output; the first coordinate where left out.
    ax : Axes
    quantity : {"peak", "first harmonic", "half peak to peak", "mean", "rms", "mean speed"}
        The peak of a coordinate that runs on is that of its periodic part; its mean speed is 0 where it does not.
    published : iterable of (label, x, y, marker)
        Points drawn on top: parameter values, shape (k,), and amplitudes, shape (k,), in the units of
        the parameter and of the coordinate; marker as in matplotlib.
    labels : sequence of str
        One for each branch; branches of one label have one colour.
    parameter_label : str
        Label of the axis, with unit, such as "speed V [m/s]"; the parameter's name where left out.
    special : sequence of SpecialPoint
        Points to mark besides those of the branches, such as Hopf points.
    limits : sequence of LimitLine
        Drawn across, in the unit of y.
    """
    many = _branches(branches)
    name, unit = coordinate_of(many[0][0], y)
    value = QUANTITIES[named("branch", "quantity", quantity, QUANTITIES)]
    unit = per_second(unit) if quantity == "mean speed" else unit
    running = any(o.advance and o.advance[o.index(name)] for b in many for o in b) and quantity != "mean speed"
    points = [(label, np.atleast_1d(u), np.atleast_1d(w), marker) for label, u, w, marker in published]
    given, ax = ax, axes(ax)
    sizes = [np.array([value(o, name) for o in b]) for b in many] + [w for _, _, w, _ in points]
    own_unit, (factor, unit) = unit, scale(unit, sizes, ax.get_ylabel())

    def height(o: Orbit) -> float:
        return factor * value(o, name)

    _over_parameter(ax, many, height, labels, special, rest=height)
    _draw_points(ax, [(label, u, factor * w, marker) for label, u, w, marker in points], many, labels)
    closed = gaps(many, name) if quantity == "peak" else {}
    for gap, width in closed.items():
        text = many[0][0].naming.plain(gap)
        ax.axhline(factor * width, color=INK, lw=0.8, ls=(0, (6, 2, 1, 2)), zorder=1, label=text)
    draw_limits(ax, limits, name, own_unit, factor, float(many[0].values[0]))
    part = " the periodic part of" * running
    ax.set_ylabel(bracketed(f"{quantity} of{part} {many[0][0].naming.plain(name)}", unit))
    if ax.dataLim.y0 >= 0 and ax.dataLim.y1 > 0:
        ax.set_ylim(-0.025 * ax.dataLim.y1, 1.04 * ax.dataLim.y1)  # room for a marker at zero
    if given is None and not points:
        _inset(ax, many, height, special, labels)
    engineering(ax.xaxis, parameter_label or many[0].label)
    return finish(ax, given, title_of(many[0][0], many[0].parameter))


@styled
def frequency(
    branches: Branch | Sequence[Branch],
    ax: Axes | None = None,
    published: Published = (),
    labels: Sequence[str] | None = None,
    parameter_label: str | None = None,
    special: Sequence[SpecialPoint] = (),
) -> Axes:
    """Draw the frequency over the parameter: rad/s on the left axis, Hz on the right one.

    Parameters
    ----------
    branches : Branch or sequence of Branch
    ax : Axes
    published, labels, parameter_label, special
        As of `branch`; the published values are frequencies in rad/s.
    """
    many = _branches(branches)
    given, ax = ax, axes(ax)
    _over_parameter(ax, many, lambda o: o.omega, labels, special)
    _draw_points(ax, published, many, labels)
    hertz = partial(np.multiply, 1 / (2 * np.pi)), partial(np.multiply, 2 * np.pi)
    right = ax.secondary_yaxis("right", functions=hertz)
    right.set_ylabel("frequency [Hz]")
    right.tick_params(colors=INK, labelsize=9, length=3)
    ax.set_ylabel("frequency omega [rad/s]")
    engineering(ax.xaxis, parameter_label or many[0].label)
    return finish(ax, given, title_of(many[0][0], many[0].parameter))


@styled
@door(cycles=(Branch, Orbit))
def multipliers(cycles: Branch | Orbit, ax: Axes | None = None, parameter_label: str | None = None) -> Axes:
    """Draw the Floquet multipliers in the complex plane with the unit circle.

    Parameters
    ----------
    cycles : Branch or Orbit
        With stability; the points of a branch are coloured by its parameter.
    ax : Axes
    parameter_label : str
        Label of the colour bar, with unit.
    """
    given, ax = ax, axes(ax, (5.2, 4.6))
    turn = np.linspace(0, 2 * np.pi, 361)
    ax.fill(np.cos(turn), np.sin(turn), color="#f3f6f9", zorder=0)
    ax.plot(np.cos(turn), np.sin(turn), color="#888888", lw=1.0, zorder=1)
    if isinstance(cycles, Orbit):
        mu = _judged([cycles])[0][1]
        trivial = _trivial(cycles, mu)
        for keep, colour, label in (
            (~trivial & (np.abs(mu) <= 1), SHADES["stable"], "inside"),
            (~trivial & (np.abs(mu) > 1), SHADES["unstable"], "outside"),
        ):
            if keep.any():
                ax.plot(mu.real[keep], mu.imag[keep], "o", ms=6, color=colour, label=label, zorder=4)
        ax.plot(mu.real[trivial], mu.imag[trivial], "o", ms=8, mfc="none", mec=INK, label="trivial", zorder=5)
    else:
        pairs = [(o.parameters[cycles.parameter], mu) for o, mu in _judged(cycles.orbits)]
        z = np.concatenate([mu for _, mu in pairs])
        p = np.concatenate([np.full(len(mu), v) for v, mu in pairs])
        shown = ax.scatter(z.real, z.imag, c=p, s=18, cmap="viridis", ec="#00000060", lw=0.3, zorder=4)
        bar = figure_of(ax).colorbar(shown, ax=ax, label=parameter_label or cycles.label, shrink=0.8)
        bar.ax.tick_params(colors=INK, labelsize=9, length=3)
        bar.outline.set_visible(False)  # type: ignore[operator]
    ax.set_aspect("equal", adjustable="datalim")
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.yaxis.set_major_locator(MaxNLocator(5))
    ax.set_xlabel("real part of the multipliers")
    ax.set_ylabel("imaginary part")
    of = cycles if isinstance(cycles, Orbit) else cycles[0]
    return finish(ax, given, title_of(of, "" if isinstance(cycles, Orbit) else cycles.parameter))


@styled
@door(cycles=Branch)
def multipliers_along(
    cycles: Branch, ax: Axes | None = None, count: int = 3, parameter_label: str | None = None
) -> Axes:
    """Draw the modulus of the largest nontrivial multipliers over the parameter, with the unit line.

    Parameters
    ----------
    cycles : Branch
        With stability.
    ax : Axes
    count : int
        How many multipliers.
    parameter_label : str
        Label of the axis, with unit.
    """
    judged = _judged(cycles.orbits)
    size = np.abs(followed([np.delete(mu, np.flatnonzero(_trivial(o, mu))) for o, mu in judged]))
    largest: list[int] = []
    for c in np.argsort(-np.nan_to_num(np.nanmax(size, axis=0, initial=0.0)), kind="stable"):
        # both of a complex pair are one curve
        if not any(np.allclose(size[:, c], size[:, k], rtol=1e-6, equal_nan=True) for k in largest):
            largest.append(int(c))
    largest = largest[:count]
    given, ax = ax, axes(ax)
    values = [o.parameters[cycles.parameter] for o, _ in judged]
    ax.axhline(1.0, color=INK, lw=1.0, zorder=1, label="limit of stability")
    for k, column in enumerate(c for c in largest if np.isfinite(size[:, c]).any()):
        label = ("largest", "second", "third")[k] if k < 3 else f"{k + 1}th"
        ax.plot(values, size[:, column], "o-", ms=2.5, lw=1.4, color=NEUTRAL[k % len(NEUTRAL)], label=label)
    # about the unit line a linear scale shows the crossing best
    if np.nanmax(size, initial=0.0) > 10:
        ax.set_yscale("log")
    else:
        ax.set_ylim(bottom=0)
    ax.set_ylabel("modulus of the multipliers")
    engineering(ax.xaxis, parameter_label or cycles.label)
    return finish(ax, given, title_of(cycles[0], cycles.parameter))


def followed(rows: Sequence[NDArray[np.complex128]]) -> NDArray[np.complex128]:
    """Return multipliers along a branch in columns that each go on continuously, shape (points, most of them).

    Parameters
    ----------
    rows : sequence of ndarray of complex, shape (any,)
        Those of each point, in any order.
    """
    width = max(map(len, rows), default=0)
    found = np.full((len(rows), width), complex(np.nan, np.nan))
    before = np.zeros(width, dtype=complex)
    for i, row in enumerate(rows):
        if not len(row) or not np.isfinite(row).all():
            continue
        if i == 0:
            row = row[np.argsort(-np.abs(row), kind="stable")]
        costs = np.abs(row[:, None] - before) if i else 1 - np.eye(len(row), width)
        takers, places = linear_sum_assignment(costs)
        found[i, places] = row[takers]
        before = np.where(np.isnan(found[i]), before, found[i])
    return found


# --- what the figures share ---------------------------------------------------------------------


def _branches(given: Branch | Sequence[Branch]) -> list[Branch]:
    many = several("nothing to draw", given, Branch)
    if not all(len(b) for b in many):
        raise ModelError("nothing to draw: got no branch, or one without orbits; give at least one orbit.")
    return many


def _draw_points(ax: Axes, points: Published, many: Sequence[Branch], labels: Sequence[str] | None) -> None:
    """Draw points (label, x, y, marker), open and below the curves, in colours that the curves leave free."""
    taken = len(many) if labels is not None else 0
    for i, (label, u, w, marker) in enumerate(points):
        edge = NEUTRAL[(taken + i) % len(NEUTRAL)]
        ax.plot(u, w, marker, label=label, mfc="none", mec=edge, mew=1.2, ms=5.5, ls="none", zorder=6)


def _over_parameter(
    ax: Axes,
    many: Sequence[Branch],
    height: Height,
    labels: Sequence[str] | None,
    special: Sequence[SpecialPoint],
    rest: Height | None = None,
    named_in_legend: bool = True,
) -> None:
    """Draw branches and special points over the parameter at their heights."""
    met, named = set[str](), list(dict.fromkeys(labels or ()))
    extent = np.ptp([(o.parameters[b.parameter], height(o)) for b in many for o in b.orbits], axis=0)
    for i, b in enumerate(many):
        # the colour tells the verdict, or the branch where branches are named: the line tells the verdict always
        place = 0 if labels is None else named.index(labels[i])
        shades = SHADES if labels is None else dict.fromkeys(LINES, NEUTRAL[place % len(NEUTRAL)])
        found = pieces(b, height, extent)
        if labels is not None and set(b.verdicts) == {"unknown"}:  # no verdicts to tell: wide below narrow ones
            for _, points in found:
                ax.plot(*points.T, color=shades["stable"], lw=1.3 + 1.1 * (len(many) - 1 - i), zorder=3, label="_")
        else:
            met |= draw_pieces(ax, found, shades)
        if labels is not None and named_in_legend and labels[i] not in labels[:i]:
            ax.plot([], [], color=shades["stable"], label=labels[i])
    if named_in_legend:
        for verdict in (v for v in LINES if v in met - {*ax.get_legend_handles_labels()[1]}):
            shade = "#777777" if labels is not None else SHADES[verdict]
            ax.plot([], [], ls=LINES[verdict], color=shade, lw=1.7, label=verdict)
    along = {(s.kind, s.value): s for s in (*special, *(s for b in many for s in b.special))}
    marks = [(s, level_of(s, height, rest)) for s in along.values()]
    if rest is not None:
        for s, level in marks:
            for b in many if s.kind == "hopf" else ():
                onset(ax, b, s, level, height)
    draw_marks(ax, marks, named_in_legend)


def _inset(
    ax: Axes, many: Sequence[Branch], height: Height, special: Sequence[SpecialPoint], labels: Sequence[str] | None
) -> None:
    """Show the surroundings of a fold once more, enlarged, where they take a small part of the axis."""
    points = [s for b in many for s in b.special]
    if not any(s.kind == "fold" for s in points):
        return
    values = np.array([s.value for s in (*points, *special)])
    low, high = float(values.min()), float(values.max())
    left, right = ax.dataLim.x0, ax.dataLim.x1
    if not 0 < high - low < CRUSHED * (right - left):
        return
    low, high = low - 0.4 * (high - low), high + 0.4 * (high - low)
    curves = np.vstack([p for b in many for _, p in pieces(b, height)])
    near = curves[(curves[:, 0] >= low) & (curves[:, 0] <= high), 1]
    across = (curves[:, 0] - left) / (right - left)
    up = (curves[:, 1] - ax.get_ylim()[0]) / np.ptp(ax.get_ylim())
    corners = [(0.5, 0.1), (0.14, 0.56), (0.5, 0.56)]
    crowd = [np.mean((across > x - 0.1) & (across < x + 0.44) & (up > y - 0.08) & (up < y + 0.42)) for x, y in corners]
    if min(crowd) > 0.02:
        return
    inner = ax.inset_axes((*corners[int(np.argmin(crowd))], 0.42, 0.36))
    _over_parameter(inner, many, height, labels, special, named_in_legend=False)
    margin = 0.15 * float(np.ptp(near)) or 1.0
    inner.set(xlim=(low, high), ylim=(near.min() - margin, near.max() + margin), facecolor="white")
    inner.tick_params(labelsize=7.5, length=2)
    inner.spines[["top", "right"]].set_visible(True)
    ax.indicate_inset_zoom(inner, edgecolor="#777777", lw=0.8)


def _judged(orbits: Sequence[Orbit]) -> list[tuple[Orbit, NDArray[np.complex128]]]:
    """Return the orbits that have multipliers, with them."""
    found = [(o, np.asarray(o.stability.multipliers)) for o in orbits if o.stability is not None]
    if not any(len(mu) for _, mu in found):
        raise ModelError("nothing to draw: no orbit has multipliers; compute them by floquet(system, orbit).")
    return found


def _trivial(o: Orbit, mu: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Return a mask, shape of mu: the multiplier of the shift in time (an equilibrium has none)."""
    mask = np.zeros(len(mu), dtype=bool)
    if o.H and len(mu):
        mask[np.argmin(np.abs(mu - 1))] = True
    return mask
