"""Curves over a parameter: smooth between the computed points, cut where the verdict changes, with special points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicHermiteSpline

from hbbogie.errors import ModelError, several
from hbbogie.plot.appearance import INK, LINES, Array
from hbbogie.results import Branch, LimitLine, Orbit, SpecialPoint
from hbbogie.units import behind

Height = Callable[[Orbit], float]
LIMIT = "#a02c2c"  # colour of limits
BESIDE = 0.01  # distance, in units of the curve's extent, up to which a point counts as the special point
SEEN = 0.02  # share of the axis from which a line between a Hopf point and its branch is drawn
ONSET = "linear cycles"
BETWEEN = 12  # points drawn for each interval of a curve
DRESS = {
    "fold": ("D", "fold"),
    "hopf": ("s", "Hopf point"),
    "grazing": ("o", "contact begins"),
    "pitchfork": ("^", "pitchfork"),
    "period doubling": ("v", "period doubling"),
    "branch point": ("X", "branch point"),
}


@dataclass(frozen=True)
class _Node:
    """A point of a curve: where it is, its verdict (None at a special point), and whether the curve may bend there."""

    at: tuple[float, float]
    verdict: str | None
    kink: bool = False


def pieces(branch: Branch, height: Height, extent: Array | None = None) -> list[tuple[str, Array]]:
    """Return a branch as smooth curves of one verdict each, points of shape (k, 2), which meet.

    Parameters
    ----------
    branch : Branch
    height : callable
        `Orbit` -> what is drawn over the parameter.
    extent : ndarray, shape (2,), optional
        Width and height of the figure, which count alike in the length of a curve; those of the branch if left out.
    """
    nodes = _nodes(branch, height)
    if len(nodes) == 1:
        return [(nodes[0].verdict or "unknown", np.array([nodes[0].at]))]
    points = np.array([n.at for n in nodes])
    size = np.array(np.ptp(points, axis=0) if extent is None else extent)
    size[size == 0] = 1.0
    t = np.r_[0.0, np.cumsum(np.maximum(np.linalg.norm(np.diff(points / size, axis=0), axis=1), 1e-12))]
    verdicts = _verdicts([n.verdict for n in nodes])
    dense, told = [points[0]], [verdicts[0][0]]
    for first, last in _stretches(nodes):
        curve = _smooth(t[first : last + 1], points[first : last + 1])
        for i in range(first, last):
            share = np.arange(1, BETWEEN + 1) / BETWEEN
            dense += list(curve(t[i] + share * (t[i + 1] - t[i])))
            told += [verdicts[i][int(s > 0.5)] for s in share]
    return _runs(np.array(dense), told)


def _nodes(branch: Branch, height: Height) -> list[_Node]:
    """Return the points of a branch with its special points among them."""
    points = [(float(v), height(o)) for v, o in zip(branch.values, branch, strict=True)]
    size = np.ptp(points, axis=0) + 1e-300
    own = [(s, points[branch.place(s)] if s.kind == "hopf" else (s.value, height(s.orbit))) for s in branch.special]
    judged = {*branch.verdicts} - {"unknown"}
    nodes = []
    for at, verdict in zip(points, branch.verdicts, strict=True):
        # at a special point itself the verdict is open, as it must be: it takes those of both sides
        beside = any(np.linalg.norm(np.subtract(at, special) / size) < BESIDE for _, special in own)
        nodes.append(_Node(at, None if judged and beside and verdict == "unknown" else verdict))
    for s, at in own:
        if s.kind != "hopf" and len(nodes) > 1:
            _insert(nodes, _Node(at, None, s.kind == "grazing"), size)
    return nodes


def _insert(nodes: list[_Node], node: _Node, size: Array) -> None:
    """Put a special point where it lies on the curve; one that is a point already takes its place."""
    points, at = np.array([n.at for n in nodes]) / size, np.array(node.at) / size
    away = np.linalg.norm(points - at, axis=1)
    nearest = int(np.argmin(away))
    if away[nearest] < 1e-9:
        nodes[nearest] = _Node(node.at, nodes[nearest].verdict, node.kink or nodes[nearest].kink)
        return
    detour = away[:-1] + away[1:] - np.linalg.norm(np.diff(points, axis=0), axis=1)
    where = int(np.argmin(detour))
    if detour[where] < 0.5 * (away[where] + away[where + 1]):
        nodes.insert(where + 1, node)


def _verdicts(given: Sequence[str | None]) -> list[tuple[str, str]]:
    """Return the verdicts of both halves of each interval; a special point takes those of its neighbours."""
    before, after = list(given), list(given)
    for i in range(1, len(given)):
        before[i] = given[i] or before[i - 1]
    for i in range(len(given) - 2, -1, -1):
        after[i] = given[i] or after[i + 1]
    pairs = []
    for i in range(len(given) - 1):
        left = before[i] if given[i] else after[i + 1] or before[i]
        right = after[i + 1] if given[i + 1] else before[i] or after[i + 1]
        if given[i] is None and given[i + 1] is None:
            left = right = before[i] or after[i + 1]
        pairs.append((left or "unknown", right or "unknown"))
    return pairs


def _stretches(nodes: Sequence[_Node]) -> list[tuple[int, int]]:
    """Return the first and the last node of each part without a kink inside."""
    cuts = [0, *(i for i in range(1, len(nodes) - 1) if nodes[i].kink), len(nodes) - 1]
    return list(pairwise(cuts))


def _smooth(t: Array, points: Array) -> Callable[[Array], Array]:
    """Return the cubic curve through points over the length of their chords, with the tangents of parabolas."""
    if len(t) < 3:
        return lambda at: points[0] + ((at - t[0]) / (t[-1] - t[0]))[:, None] * (points[-1] - points[0])
    h, slope = np.diff(t)[:, None], np.diff(points, axis=0) / np.diff(t)[:, None]
    inner = (h[1:] * slope[:-1] + h[:-1] * slope[1:]) / (h[:-1] + h[1:])
    tangents = np.vstack([2 * slope[0] - inner[0], inner, 2 * slope[-1] - inner[-1]])
    return CubicHermiteSpline(t, points, tangents, axis=0)


def _runs(dense: Array, told: Sequence[str]) -> list[tuple[str, Array]]:
    cuts = [i for i in range(2, len(told)) if told[i] != told[i - 1]]
    edges = list(zip([1, *cuts], [*cuts, len(told)], strict=True))
    return [(told[first], dense[first - 1 : last]) for first, last in edges]


# --- drawing ----------------------------------------------------------------------------------


def draw_pieces(ax: Axes, found: Sequence[tuple[str, Array]], shades: Mapping[str, str]) -> set[str]:
    """Draw curves by their verdicts; return the verdicts."""
    for verdict, points in found:
        dress = {"ls": LINES[verdict], "color": shades[verdict], "lw": 2.0 if verdict == "stable" else 1.7}
        ax.plot(*points.T, marker="o" if len(points) == 1 else "", ms=4, label="_", zorder=3, **dress)
    return {verdict for verdict, _ in found}


def draw_marks(ax: Axes, marks: Sequence[tuple[SpecialPoint, float]], labels: bool = True) -> None:
    """Mark special points (point, height); where they are stands in the legend, with the unit."""
    kinds = dict.fromkeys(s.kind for s, _ in marks)
    for kind in sorted(kinds, key=lambda k: k != "grazing"):  # open circles, below the others
        marker, text = DRESS.get(kind, ("P", kind))
        some = {(s.value, level): s for s, level in marks if s.kind == kind}
        named = next(iter(some.values()))
        zero = 1e-9 * float(ax.dataLim.width)  # what is zero to round-off
        places = list(dict.fromkeys(f"{0.0 if abs(value) < zero else value:.4g}" for value, _ in some))
        unit = named.orbit.naming.units.get(named.parameter, "")
        if len(places) <= 2 and kind != "grazing":
            text += f" ({named.parameter} = {', '.join(places)}{behind(unit)})"
        look: dict[str, Any] = {"ms": 5.5, "color": INK, "mec": "white", "mew": 0.8}
        if kind == "grazing":
            look = {"ms": 8.0, "mfc": "none", "mec": INK, "mew": 0.9}
        ax.plot(*zip(*some, strict=True), marker, label=text if labels else "_", zorder=5, ls="none", **look)


def draw_limits(ax: Axes, limits: Sequence[LimitLine], name: str, unit: str, factor: float, at: float) -> None:
    """Draw limits across; raise `ModelError` unless they have the unit of what is drawn.

    Parameters
    ----------
    ax : Axes
    limits : sequence of LimitLine
    name, unit : str
        Of what is drawn.
    factor : float
        By which its values are multiplied.
    at : float, unit of the horizontal axis
        A value on it.
    """
    for limit in several("branch: limits", limits, LimitLine) if limits else []:
        if (limit.unit or "1") != unit:
            raise ModelError(
                f"branch: the limit {limit.label!r} is in {limit.unit or '1'}, but {name!r} is in {unit}; give it in "
                "the same unit."
            )
        ax.axhline(factor * limit.value, color=LIMIT, lw=1.1, ls=(0, (8, 3)), zorder=1, label=limit.label)
        ax.update_datalim([(at, factor * limit.value)])


def level_of(s: SpecialPoint, height: Height, rest: Height | None) -> float:
    """Return the height of a special point; of a Hopf point, whose orbit shows the mode, that of the equilibrium."""
    if s.kind != "hopf" or rest is None:
        return height(s.orbit)
    # what is recorded at a Hopf point is of the equilibrium
    return rest(s.orbit.replace(coefficients=s.orbit.coefficients[:1], recorded=s.orbit.recorded))


def onset(ax: Axes, branch: Branch, s: SpecialPoint, level: float, height: Height) -> None:
    """Join a Hopf point to a branch above it: linear cycles of every amplitude, as up to a contact."""
    near = 1e-6 * max(float(np.ptp(branch.values)), abs(s.value))
    met = [branch[0], branch[-1], *(other.orbit for other in branch.special if other.kind == "branch point")]
    above = [height(o) for o in met if abs(o.parameters[branch.parameter] - s.value) <= near]
    if above and min(above) - level > SEEN * ax.dataLim.height:
        at, to = [s.value] * 2, [level, min(above)]
        label = "_" if ONSET in ax.get_legend_handles_labels()[1] else ONSET
        ax.plot(at, to, ls=LINES["unknown"], color="#777777", lw=1.2, zorder=2, label=label)


def gaps(branches: Sequence[Branch], coordinate: str) -> dict[str, float]:
    """Return the gaps that a coordinate just closes where a contact begins: their names, and their widths.

    A gap is a parameter whose value is the peak of the coordinate there.
    """
    found = {}
    for s in (s for b in branches for s in b.special if s.kind == "grazing"):
        peak = s.orbit.amplitude(coordinate)
        for name, value in s.orbit.parameters.items():
            if name != s.parameter and peak > 0 and abs(value - peak) <= 1e-5 * peak:
                found[name] = value
    return found
