"""Figures of single motions: phase portrait, waveform, time history, spectrum."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from hbbogie.errors import ModelError, door, several
from hbbogie.plot.appearance import (
    LINES,
    NEUTRAL,
    SHADES,
    Array,
    axes,
    bracketed,
    coordinate_of,
    finish,
    scale,
    styled,
    title_of,
)
from hbbogie.results import Orbit, Trajectory
from hbbogie.units import per_second

MOST = 6000  # samples that a figure of a motion shows


@styled
def orbit(
    orbits: Orbit | Sequence[Orbit],
    x: str | None = None,
    y: str | None = None,
    ax: Axes | None = None,
    labels: Sequence[str] | None = None,
) -> Axes:
    """Draw phase portraits; coordinates that run on are drawn over one turn.

    Parameters
    ----------
    orbits : Orbit or sequence of Orbit
    x : str
        Coordinate or output of the horizontal axis; the first coordinate where left out.
    y : str
        Coordinate or output of the vertical axis; the velocity of x where left out.
    ax : Axes
    labels : sequence of str
        One for each orbit.
    """
    many = _orbits(orbits)
    across, unit_x = coordinate_of(many[0], x)
    if y is None and many[0].naming.is_output(across):
        raise ModelError(
            f"orbit: {across!r} is an output, whose rate is not known; give y=, such as y={many[0].coordinates[0]!r}."
        )
    plain = many[0].naming.plain
    up, unit_y = coordinate_of(many[0], y) if y else (f"velocity of {across}", per_second(unit_x))
    curves = []
    for o in many:
        t = o.times()
        curves.append(
            on_cylinder(many, across, _values(o, across, t), _values(o, y, t) if y else o.v(t)[:, o.index(across)])
        )
        if y:
            curves[-1] = on_cylinder(many, y, *curves[-1][::-1])[::-1]
    given, ax = ax, axes(ax)
    fx, shown = scale(unit_x, [c[0] for c in curves], ax.get_xlabel())
    prefix = shown.removesuffix(unit_x)
    if y:
        fy, unit_y = scale(unit_y, [c[1] for c in curves], ax.get_ylabel())
    else:  # both axes in one prefix
        fy, unit_y = fx, prefix + unit_y
    for o, (u, w), dress in zip(many, curves, dresses(many), strict=True):
        kind = {**dress, "marker": "o", "ls": "none"} if len(u) == 1 else dress
        ax.plot(fx * u, fy * w, label=_name(o, many, labels), **kind)
    ax.set_xlabel(bracketed(plain(across), shown))
    ax.set_ylabel(bracketed(plain(up) if y else up, unit_y))
    return finish(ax, given, _title(many))


@styled
def waveform(
    orbits: Orbit | Sequence[Orbit],
    coordinates: str | Sequence[str] | None = None,
    ax: Axes | None = None,
    labels: Sequence[str] | None = None,
) -> Axes:
    """Draw coordinates or outputs over one period in s; coordinates with the first one's unit where left out.

    Parameters
    ----------
    orbits : Orbit or sequence of Orbit
    coordinates : str or sequence of str
        Names of coordinates and outputs.
    ax : Axes
    labels : sequence of str
        One for each orbit.
    """
    many = _orbits(orbits)
    moves = []
    for o in many:
        t = o.times() if o.H else np.linspace(0.0, 1.0, 2)
        moves.append((_name(o, many, labels), t, partial(_values, o, t=t)))
    given, ax = ax, axes(ax)
    _over_time(many[0], moves, coordinates, ax, dresses(many))
    return finish(ax, given, _title(many))


@styled
@door(trajectory=Trajectory)
def time_history(
    trajectory: Trajectory, coordinates: str | Sequence[str] | None = None, ax: Axes | None = None
) -> Axes:
    """Draw coordinates of a trajectory over time in s; those with the first one's unit where left out.

    Of more samples than a page can show, the smallest and the largest of each short stretch are drawn.

    Parameters
    ----------
    trajectory : Trajectory
    coordinates : str or sequence of str
    ax : Axes
    """
    given, ax = ax, axes(ax)
    t, q = decimated(trajectory.t, trajectory.q)
    dress = [{"lw": 0.9, "color": NEUTRAL[2]}]
    _over_time(trajectory, [("", t, lambda name: q[:, trajectory.index(name)])], coordinates, ax, dress)
    return finish(ax, given, title_of(trajectory))


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
        Coordinate or output; the first coordinate where left out.
    ax : Axes
    reference : bool
        Whether a line proportional to h^-4, the decay behind a gap, is drawn above the first orbit's.
    labels : sequence of str
        One for each orbit.
    """
    many = _orbits(orbits)
    name, unit = coordinate_of(many[0], coordinate)
    given, ax = ax, axes(ax)
    sizes = [o.spectrum(name) for o in many]
    factor, unit = scale(unit, sizes, ax.get_ylabel())
    seen = set[int]()
    for i, (o, size, dress) in enumerate(zip(many, sizes, dresses(many), strict=True)):
        h = np.flatnonzero(size > 1e-15 * size.max(initial=0.0))
        seen |= set(h.tolist())
        look: dict[str, Any] = {**dress, "marker": "os^Dv"[i % 5], "lw": 0.8, "ms": 5, "mfc": "none" if i else None}
        ax.plot(h, factor * size[h], label=_name(o, many, labels), **look)
    if reference and many[0].H:
        h = np.arange(1, many[0].H + 1)
        top = factor * float((sizes[0][1:] * h**4).max())
        along = np.linspace(1.0, many[0].H, 8 * many[0].H)
        ax.plot(along, top * along**-4.0, ls="--", lw=1.0, color="#888888", label="$h^{-4}$", zorder=1)
    ax.set_yscale("log")
    ax.set_xlim(-0.5, max(o.H for o in many) + 0.5)
    odd = all(h % 2 for h in seen)
    ticks = [h for h in range(max(o.H for o in many) + 1) if not odd or h % 2]
    ax.set_xticks(ticks[:: 1 + len(ticks) // 17])
    ax.set_xlabel("harmonic")
    ax.set_ylabel(bracketed(f"amplitude of {many[0].naming.plain(name)}", unit))
    return finish(ax, given, _title(many))


# --- what the figures share ---------------------------------------------------------------------


def _values(o: Orbit, name: str, t: Array) -> Array:
    """Return a coordinate or an output at times t, shape (len(t),)."""
    return o.output(name).at(t) if o.naming.is_output(name) else o.q(t)[:, o.index(name)]


def _orbits(given: Orbit | Sequence[Orbit]) -> list[Orbit]:
    return several("nothing to draw", given, Orbit)


def _over_time(
    source: Orbit | Trajectory,
    moves: Sequence[tuple[str, Array, Callable[[str], Array]]],
    coordinates: str | Sequence[str] | None,
    ax: Axes,
    dress: Sequence[dict[str, Any]],
) -> None:
    """Draw motions (label, t, values by name), each dressed in its way; each unit is scaled for itself.

    With several coordinates the colour tells the coordinate, and the line the motion.
    """
    if coordinates is None:
        pairs = zip(source.coordinates, source.units, strict=True)
        coordinates = [c for c, u in pairs if u == source.units[0]]
    names = [coordinates] if isinstance(coordinates, str) else list(coordinates)
    units = {}
    for k, name in enumerate(names):
        unit = coordinate_of(source, name)[1]
        alike = [c for c in names if coordinate_of(source, c)[1] == unit]
        factor, units[name] = scale(unit, [of(c) for _, _, of in moves for c in alike], ax.get_ylabel())
        for (label, t, of), look in zip(moves, dress, strict=True):
            parts = [source.naming.plain(name)] * (len(names) > 1) + [label] * (label not in ("", "_"))
            own = {**look, "color": NEUTRAL[k % len(NEUTRAL)]} if len(names) > 1 else look
            ax.plot(t, factor * of(name), label=", ".join(parts) or "_", **own)
    groups = {u: ", ".join(n for n in names if units[n] == u) for u in units.values()}
    plain = source.naming.plain(names[0]) if len(names) == 1 else ""
    ax.set_xlabel("time t [s]")
    ax.set_ylabel("; ".join(bracketed(plain or group, u) for u, group in groups.items()))
    ax.margins(x=0)


def decimated(t: Array, q: Array, most: int = MOST) -> tuple[Array, Array]:
    """Return samples that draw alike: of many, the smallest and largest of each stretch, in the order of time.

    Parameters
    ----------
    t : ndarray, shape (N,)
    q : ndarray, shape (N, n)
    most : int
        Samples up to which all are kept.
    """
    if len(t) <= most:
        return t, q
    length = -(-len(t) // (most // 2))
    edges = np.arange(0, len(t), length)
    low, high = np.minimum.reduceat(q, edges), np.maximum.reduceat(q, edges)
    first = np.arange(len(edges)) % 2 == 0  # up and down in turn
    pairs = np.stack([np.where(first[:, None], low, high), np.where(first[:, None], high, low)], axis=1)
    times = np.stack([t[edges], t[np.minimum(edges + length // 2, len(t) - 1)]], axis=1)
    return times.ravel(), pairs.reshape(-1, q.shape[1])


def dresses(many: Sequence[Orbit]) -> list[dict[str, Any]]:
    """Return how to draw orbits: by their verdicts, those of one in tones of its colour; neutral if not judged."""
    found: list[dict[str, Any]] = []
    for o in many:
        if o.stability is None:
            colour = NEUTRAL[sum(other.stability is None for other in many[: len(found)]) % len(NEUTRAL)]
            found.append({"color": colour, "ls": "-"})
            continue
        verdict = o.stability.verdict
        alike = [other for other in many if other.stability and other.stability.verdict == verdict]
        pale = 0.55 * next(i for i, other in enumerate(alike) if other is o) / max(len(alike) - 1, 1)
        tone = (1 - pale) * np.array(to_rgb(SHADES[verdict])) + pale
        found.append({"color": tuple(tone), "ls": LINES[verdict]})
    return found


def turns_at(many: Sequence[Orbit], name: str, u: Array) -> Array:
    """Return the whole turns to be taken off values of a coordinate to draw them over one turn; an array of its unit.

    Parameters
    ----------
    many : sequence of Orbit
        What is drawn; nothing is taken off where the coordinate runs on in none of them.
    name : str
    u : ndarray, shape (N,)
        The coordinate along one of them.
    """
    turns = [abs(o.advance[o.index(name)]) for o in many if o.advance and o.advance[o.index(name)]]
    turn = min(turns, default=np.inf)
    whole = np.ptp(u) >= 0.99 * turn
    return np.asarray((turn if turns else 0.0) * np.round((u if whole else np.full_like(u, u.mean())) / turn))


def on_cylinder(many: Sequence[Orbit], name: str, u: Array, w: Array) -> tuple[Array, Array]:
    """Return a curve over a coordinate, cut where that has made a turn if it runs on in one of the orbits.

    Parameters
    ----------
    many : sequence of Orbit
    name : str
    u, w : ndarray, shape (N,)
        The coordinate and what is drawn over it.

    Returns
    -------
    ndarray, shape (N + cuts,)
        With not-a-number where the curve is cut.
    """
    off = turns_at(many, name, u)
    cuts = 1 + np.flatnonzero(np.diff(off))
    return np.insert(u - off, cuts, np.nan), np.insert(w, cuts, np.nan)


def _title(many: Sequence[Orbit]) -> str:
    """Return the title of a figure of orbits: what they have in common."""
    o = many[0]
    common = {n: v for n, v in o.parameters.items() if all(m.parameters.get(n) == v for m in many)}
    verdict = f", {o.stability.verdict}" if len(many) == 1 and o.stability else ""
    return title_of(o.replace(parameters=common)) + verdict


def _name(o: Orbit, many: Sequence[Orbit], labels: Sequence[str] | None) -> str:
    """Return the label of an orbit among others: the parameters in which they differ, and the verdict."""
    if labels is not None:
        return labels[next(i for i, other in enumerate(many) if other is o)]
    verdict = [o.stability.verdict] if o.stability else []
    if len(many) == 1:
        return "_"
    differ = [p for p in o.parameters if len({other.parameters.get(p) for other in many}) > 1]
    orders = [f"H = {o.kept}"] if o.kept is not None and len({other.kept for other in many}) > 1 else []
    return ", ".join([*(o.naming.value(p, o.parameters[p], 5) for p in differ), *orders, *verdict]) or "_"
