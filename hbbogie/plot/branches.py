"""Figures over a parameter: amplitude, frequency, multipliers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from hbbogie.errors import ModelError, door, named, several
from hbbogie.plot.appearance import (
    COLOURS,
    INK,
    LINES,
    SHADES,
    Array,
    axes,
    coordinate_of,
    figure_of,
    legend,
    scale,
    styled,
)
from hbbogie.results import Branch, Orbit, SpecialPoint

QUANTITIES = {"peak": Branch.amplitude, "first harmonic": Branch.first_harmonic}
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
) -> Axes:
    """Draw the amplitude over the parameter: stable solid, unstable dashed, unknown dotted.

    Parameters
    ----------
    branches : Branch or sequence of Branch
    y : str
        Coordinate; the first one where left out.
    ax : Axes
    quantity : {"peak", "first harmonic"}
    published : iterable of (label, x, y, marker)
        Points drawn on top: parameter values, shape (k,), and amplitudes, shape (k,), in the units of
        the parameter and of the coordinate; marker as in matplotlib.
    labels : sequence of str
        One for each branch.
    parameter_label : str
        Label of the axis, with unit, such as "speed V [m/s]"; the parameter's name where left out.
    special : sequence of SpecialPoint
        Points to mark besides those of the branches, such as Hopf points.
    """
    many = _branches(branches)
    name, unit = coordinate_of(many[0].orbits[0], y)
    value = QUANTITIES[named("branch", "quantity", quantity, QUANTITIES)]
    points = [(label, np.atleast_1d(u), np.atleast_1d(w), marker) for label, u, w, marker in published]
    ax = axes(ax)
    sizes = [*(value(b, name) for b in many), *(w for _, _, w, _ in points)]
    factor, unit = scale(unit, sizes, ax.get_ylabel())

    def height(b: Branch) -> Array:
        return factor * value(b, name)

    _over_parameter(ax, many, height, labels, special, hopf_at_zero=True)
    _draw_points(ax, [(label, u, factor * w, marker) for label, u, w, marker in points], len(many))
    ax.set_xlabel(parameter_label or many[0].label)
    ax.set_ylabel(f"{quantity} of {name} [{unit}]")
    if ax.dataLim.y0 > 0:
        ax.set_ylim(0, 1.04 * ax.dataLim.y1)
    return legend(ax)


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
    ax = axes(ax)
    _over_parameter(ax, many, lambda b: b.omega, labels, special)
    _draw_points(ax, published, len(many))
    hertz = partial(np.multiply, 1 / (2 * np.pi)), partial(np.multiply, 2 * np.pi)
    right = ax.secondary_yaxis("right", functions=hertz)
    right.set_ylabel("frequency [Hz]")
    right.tick_params(colors=INK, labelsize=9, length=3)
    ax.set_xlabel(parameter_label or many[0].label)
    ax.set_ylabel("frequency omega [rad/s]")
    return legend(ax)


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
    ax = axes(ax, (5.2, 4.6))
    turn = np.linspace(0, 2 * np.pi, 361)
    ax.fill(np.cos(turn), np.sin(turn), color="#f3f6f9", zorder=0)
    ax.plot(np.cos(turn), np.sin(turn), color="#888888", lw=1.0, zorder=1)
    if isinstance(cycles, Orbit):
        mu = _judged([cycles])[0][1]
        trivial = _trivial(cycles, mu)
        for keep, colour, label in (
            (~trivial & (np.abs(mu) <= 1), COLOURS[0], "inside"),
            (~trivial & (np.abs(mu) > 1), COLOURS[1], "outside"),
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
    ax.set_xlabel("real part [1]")
    ax.set_ylabel("imaginary part [1]")
    return legend(ax)


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
    size = np.full((len(judged), count), np.nan)
    for i, (o, mu) in enumerate(judged):
        largest = np.sort(np.abs(mu[~_trivial(o, mu)]))[::-1][:count]
        size[i, : len(largest)] = largest
    ax = axes(ax)
    values = [o.parameters[cycles.parameter] for o, _ in judged]
    ax.axhline(1.0, color=INK, lw=1.0, zorder=1, label="limit of stability")
    for k in range(count):
        if not np.isnan(size[:, k]).all():
            label = ("largest", "second", "third")[k] if k < 3 else f"{k + 1}th"
            ax.plot(values, size[:, k], "o-", ms=3, lw=1.4, color=COLOURS[k % len(COLOURS)], label=label)
    # about the unit line a linear scale shows the crossing best
    if np.nanmax(size, initial=0.0) > 10:
        ax.set_yscale("log")
    else:
        ax.set_ylim(bottom=0)
    ax.set_xlabel(parameter_label or cycles.label)
    ax.set_ylabel("modulus of the multipliers [1]")
    return legend(ax)


# --- what the figures share ---------------------------------------------------------------------


def _branches(given: Branch | Sequence[Branch]) -> list[Branch]:
    many = several("nothing to draw", given, Branch)
    if not all(len(b) for b in many):
        raise ModelError("nothing to draw: got no branch, or one without orbits; give at least one orbit.")
    return many


def _draw_points(ax: Axes, points: Published, curves: int) -> None:
    """Draw points (label, x, y, marker) over everything, in colours that the curves leave free."""
    for i, (label, u, w, marker) in enumerate(points):
        edge = COLOURS[(max(curves, 2) + i) % len(COLOURS)]
        ax.plot(u, w, marker, label=label, mfc="white", mec=edge, mew=1.4, ms=6, ls="none", zorder=6)


def _over_parameter(
    ax: Axes,
    many: Sequence[Branch],
    height: Callable[[Branch], Array],
    labels: Sequence[str] | None,
    special: Sequence[SpecialPoint],
    hopf_at_zero: bool = False,
) -> None:
    """Draw branches and special points over the parameter at their heights."""
    marks: list[tuple[str, float, float]] = []
    for s in [*(s for b in many for s in b.special), *special]:
        # the orbit kept at a Hopf point shows the mode, not an amplitude
        at_zero = hopf_at_zero and s.kind == "hopf"
        level = 0.0 if at_zero else float(height(Branch((s.orbit,), s.parameter))[0])
        marks.append((s.kind, s.value, level))
    joints = [np.array(m[1:]) for m in marks if m[0] != "hopf"]
    # one branch: colour and line tell the verdict; several: the colour tells the branch
    several, met = len(many) > 1 or labels is not None, set[str]()
    for i, b in enumerate(many):
        shades = dict.fromkeys(LINES, COLOURS[i % len(COLOURS)]) if several else SHADES
        met |= _verdict_lines(ax, np.column_stack([b.values, height(b)]), b.verdicts, shades, joints)
        if several:
            ax.plot([], [], color=shades["stable"], label=labels[i] if labels else f"branch {i + 1}")
    for verdict in (v for v in LINES if v in met - {*ax.get_legend_handles_labels()[1]}):
        shade = "#777777" if several else SHADES[verdict]
        ax.plot([], [], ls=LINES[verdict], color=shade, lw=1.7, label=verdict)
    _mark(ax, list(dict.fromkeys(marks)), many[0].parameter)


def _verdict_lines(
    ax: Axes, points: Array, verdicts: Sequence[str], shades: Mapping[str, str], special: Sequence[Array]
) -> set[str]:
    """Draw a curve, points of shape (k, 2), in pieces of one verdict that meet in joints; return the verdicts."""
    # at a special point itself the verdict is open, as it must be: the point is the joint of its neighbours
    closed = [verdicts[i] != "unknown" or not any(np.array_equal(p, s) for s in special) for i, p in enumerate(points)]
    if sum(closed) > 1:
        points, verdicts = points[closed], [v for v, keep in zip(verdicts, closed, strict=True) if keep]
    cuts = [i for i in range(1, len(points)) if verdicts[i] != verdicts[i - 1]]
    joints = {i: [_joint(points[i - 1], points[i], special)] for i in cuts}
    for start, stop in zip([0, *cuts], [*cuts, len(points)], strict=True):
        piece = np.vstack([*joints.get(start, []), points[start:stop], *joints.get(stop, [])])
        verdict = verdicts[start]
        dress = {"ls": LINES[verdict], "color": shades[verdict], "lw": 2.0 if verdict == "stable" else 1.7}
        ax.plot(*piece.T, marker="o" if len(points) == 1 else "", label="_", zorder=3, **dress)
    return set(verdicts)


def _joint(a: Array, b: Array, special: Sequence[Array]) -> Array:
    """Return the special point that lies between two neighbouring points of a curve, or the middle of them."""
    for point in special:
        size = np.maximum(np.abs([a, b, point]).max(axis=0), 1e-300)
        way, detour = np.linalg.norm((b - a) / size), np.linalg.norm(([a, b] - point) / size, axis=1)
        if detour.sum() < 1.5 * way:
            return point
    return (a + b) / 2


def _mark(ax: Axes, marks: Sequence[tuple[str, float, float]], parameter: str) -> None:
    """Mark special points (kind, value, height); the values stand in the legend."""
    dress = {"fold": ("D", "fold"), "hopf": ("s", "Hopf point"), "grazing": ("o", "grazing")}
    dress |= {
        "pitchfork": ("^", "pitchfork"),
        "period doubling": ("v", "period doubling"),
        "branch point": ("X", "branch point"),
    }
    for kind in dict.fromkeys(m[0] for m in marks):
        marker, text = dress.get(kind, ("P", kind))
        some = [m[1:] for m in marks if m[0] == kind]
        places = list(dict.fromkeys(f"{value:.4g}" for value, _ in some))
        if len(places) <= 2:
            text += f" ({parameter} = {', '.join(places)})"
        u, w = zip(*some, strict=True)
        look: dict[str, Any] = {"ms": 6.5, "color": INK, "mec": "white", "mew": 1.0}
        if kind == "grazing":  # often next to a fold, which it must not hide
            look = {"ms": 9.0, "mfc": "none", "mec": INK, "mew": 0.9}
        ax.plot(u, w, marker, label=text, zorder=5, ls="none", **look)


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
