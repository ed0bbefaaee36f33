"""Figures of single motions: phase portrait, waveform, time history, spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from hbbogie.errors import door, several
from hbbogie.plot.appearance import COLOURS, LINES, Array, axes, coordinate_of, legend, scale, styled
from hbbogie.results import Orbit, Trajectory
from hbbogie.units import per_second


@styled
def orbit(
    orbits: Orbit | Sequence[Orbit],
    x: str | None = None,
    y: str | None = None,
    ax: Axes | None = None,
    labels: Sequence[str] | None = None,
) -> Axes:
    """Draw phase portraits.

    Parameters
    ----------
    orbits : Orbit or sequence of Orbit
    x : str
        Coordinate of the horizontal axis; the first one where left out.
    y : str
        Coordinate of the vertical axis; the velocity of x where left out.
    ax : Axes
    labels : sequence of str
        One for each orbit.
    """
    many = _orbits(orbits)
    across, unit_x = coordinate_of(many[0], x)
    if y:
        up, unit_y = coordinate_of(many[0], y)
    else:
        up, unit_y = f"velocity of {across}", per_second(unit_x)
    curves = []
    for o in many:
        t = np.linspace(0.0, o.period, 1 + max(400, 32 * o.H)) if o.H else np.zeros(1)
        u, v = o.q(t), o.v(t)
        curves.append((u[:, o.index(across)], u[:, o.index(y)] if y else v[:, o.index(across)]))
    ax = axes(ax)
    fx, unit_x = scale(unit_x, [c[0] for c in curves], ax.get_xlabel())
    fy, unit_y = scale(unit_y, [c[1] for c in curves], ax.get_ylabel())
    for i, (o, (u, w)) in enumerate(zip(many, curves, strict=True)):
        kind = {"marker": "o", "ls": "none"} if len(u) == 1 else {"ls": _line(o)}
        ax.plot(fx * u, fy * w, color=COLOURS[i % len(COLOURS)], label=_name(o, many, labels), **kind)
    ax.set_xlabel(f"{across} [{unit_x}]")
    ax.set_ylabel(f"{up} [{unit_y}]")
    return legend(ax)


@styled
def waveform(
    orbits: Orbit | Sequence[Orbit],
    coordinates: str | Sequence[str] | None = None,
    ax: Axes | None = None,
    labels: Sequence[str] | None = None,
) -> Axes:
    """Draw coordinates over one period in s; those with the first one's unit where left out.

    Parameters
    ----------
    orbits : Orbit or sequence of Orbit
    coordinates : str or sequence of str
    ax : Axes
    labels : sequence of str
        One for each orbit.
    """
    many = _orbits(orbits)
    moves = []
    for o in many:
        t = np.linspace(0.0, o.period if o.H else 1.0, 1 + max(400, 32 * o.H))
        moves.append((_name(o, many, labels), t, o.q(t), _line(o)))
    return _over_time(many[0], moves, coordinates, ax, 1.8)


@styled
@door(trajectory=Trajectory)
def time_history(
    trajectory: Trajectory, coordinates: str | Sequence[str] | None = None, ax: Axes | None = None
) -> Axes:
    """Draw coordinates of a trajectory over time in s; those with the first one's unit where left out.

    Parameters
    ----------
    trajectory : Trajectory
    coordinates : str or sequence of str
    ax : Axes
    """
    return _over_time(trajectory, [("", trajectory.t, trajectory.q, "-")], coordinates, ax, 1.1)


@styled
def spectrum(
    orbits: Orbit | Sequence[Orbit],
    coordinate: str | None = None,
    ax: Axes | None = None,
    reference: bool = False,
    labels: Sequence[str] | None = None,
) -> Axes:
    """Draw the amplitudes of the harmonics on a logarithmic scale; those that vanish are left out.

    Parameters
    ----------
    orbits : Orbit or sequence of Orbit
    coordinate : str
        The first one where left out.
    ax : Axes
    reference : bool
        Whether a line proportional to h^-4, the decay behind a gap, is drawn above the first orbit's.
    labels : sequence of str
        One for each orbit.
    """
    many = _orbits(orbits)
    name, unit = coordinate_of(many[0], coordinate)
    ax = axes(ax)
    sizes = [o.spectrum(name) for o in many]
    factor, unit = scale(unit, sizes, ax.get_ylabel())
    for i, (o, size) in enumerate(zip(many, sizes, strict=True)):
        h = np.flatnonzero(size > 1e-15 * size.max(initial=0.0))
        marker, colour = "os^Dv"[i % 5], COLOURS[i % len(COLOURS)]
        ax.plot(h, factor * size[h], marker, ls="-", lw=0.8, ms=5, color=colour, label=_name(o, many, labels))
    if reference and many[0].H:
        h = np.arange(1, many[0].H + 1)
        top = factor * float((sizes[0][1:] * h**4).max())
        ax.plot(h, top * h**-4.0, ls="--", lw=1.0, color="#888888", label="$h^{-4}$", zorder=1)
    ax.set_yscale("log")
    ax.set_xlim(-0.5, max(o.H for o in many) + 0.5)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_xlabel("harmonic h [1]")
    ax.set_ylabel(f"amplitude of {name} [{unit}]")
    return legend(ax)


# --- what the figures share ---------------------------------------------------------------------


def _orbits(given: Orbit | Sequence[Orbit]) -> list[Orbit]:
    return several("nothing to draw", given, Orbit)


def _over_time(
    source: Orbit | Trajectory,
    moves: Sequence[tuple[str, Array, Array, Any]],
    coordinates: str | Sequence[str] | None,
    ax: Axes | None,
    width: float,
) -> Axes:
    """Draw coordinates of motions (label, t, q, line style); each unit is scaled for itself."""
    if coordinates is None:
        pairs = zip(source.coordinates, source.units, strict=True)
        coordinates = [c for c, u in pairs if u == source.units[0]]
    names = [coordinates] if isinstance(coordinates, str) else list(coordinates)
    ax = axes(ax)
    units = {}
    curve = 0
    for name in names:
        i, unit = source.index(name), coordinate_of(source, name)[1]
        alike = [source.index(c) for c in names if coordinate_of(source, c)[1] == unit]
        factor, units[name] = scale(unit, [q[:, alike] for _, _, q, _ in moves], ax.get_ylabel())
        for label, t, q, line in moves:
            parts = [name] * (len(names) > 1) + [label] * (label not in ("", "_"))
            colour = COLOURS[curve % len(COLOURS)]
            ax.plot(t, factor * q[:, i], ls=line, lw=width, color=colour, label=", ".join(parts) or "_")
            curve += 1
    groups = {u: ", ".join(n for n in names if units[n] == u) for u in units.values()}
    ax.set_xlabel("time t [s]")
    ax.set_ylabel("; ".join(f"{group} [{u}]" for u, group in groups.items()))
    ax.margins(x=0)
    return legend(ax)


def _line(o: Orbit) -> Any:
    return LINES[o.stability.verdict] if o.stability else "-"


def _name(o: Orbit, many: Sequence[Orbit], labels: Sequence[str] | None) -> str:
    """Return the label of an orbit among others: the parameters in which they differ, and the verdict."""
    if labels is not None:
        return labels[next(i for i, other in enumerate(many) if other is o)]
    verdict = [o.stability.verdict] if o.stability else []
    if len(many) == 1:
        return "_"
    differ = [p for p in o.parameters if len({other.parameters.get(p) for other in many}) > 1]
    orders = [f"H = {o.H}"] if len({other.H for other in many}) > 1 else []
    return ", ".join([*(f"{p} = {o.parameters[p]:.5g}" for p in differ), *orders, *verdict]) or "_"
