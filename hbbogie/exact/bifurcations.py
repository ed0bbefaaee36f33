"""Where multipliers cross the unit circle along a branch of exact cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from hbbogie.exact.multipliers import stabilities
from hbbogie.exact.points import Point, correct
from hbbogie.results import Stability
from hbbogie.stability.crossing import description, distances, logarithms, matched

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

TURNS = ("fold", "fold not located")
FLAT = 1e-12  # share of the parameter in the tangent that is none
HALVINGS = 8  # bisections between two points
REAL = 1e-6  # imaginary part, relative to the modulus, up to which a multiplier counts as real
VALUE = 1e-12  # relative error of the parameter at any point


@dataclass(frozen=True, eq=False)
class Crossing:
    """A point at which multipliers leave or enter the unit circle.

    Attributes
    ----------
    kind : {"pitchfork", "period doubling", "branch point", "Neimark-Sacker", "not located"}
    point : Point
    before : int
        Place of the preceding point of the branch.
    status : str
    interval : (float, float), unit of the parameter
        Values of the parameter between which the crossing lies.
    """

    kind: str
    point: Point
    before: int
    status: str
    interval: tuple[float, float]


def judged(point: Point) -> Stability:
    """Return the multipliers of a point and the verdict."""
    return stabilities(point.closing, point.y[None], point.at)[0]


def multiplier_crossings(points: Sequence[Point], verdicts: Sequence[Stability]) -> list[Crossing]:
    """Return where the number of unstable multipliers changes between points, folds left out.

    Parameters
    ----------
    points : sequence of Point
        In the order of the branch.
    verdicts : sequence of Stability
    """
    found = []
    known = [i for i, s in enumerate(verdicts) if s.verdict != "unknown"]
    for i, j in pairwise(known):
        change = verdicts[j].unstable - verdicts[i].unstable
        if not change or (abs(change) == 1 and any(map(_turns, points[i : j + 1]))):
            continue
        for k in range(i, j):  # multipliers are continuous where the sequence changes, so the last stretch is enough
            a, b = points[k], points[k + 1]
            if a.closing is b.closing and verdicts[k].unstable != verdicts[k + 1].unstable:
                found.append(_located(a, b, k, verdicts[k].unstable))
                break
        else:
            what = f"unstable multipliers go from {verdicts[i].unstable} to {verdicts[j].unstable} in this interval"
            found.append(_unlocated(points[i], points[j], i, what))
    return found


def _turns(point: Point) -> bool:
    """Tell whether the parameter is at an extremum, as where a branch begins at a family of linear cycles."""
    return point.kind in TURNS or abs(float(point.tangent[-1])) <= FLAT


def _unlocated(a: Point, b: Point, before: int, what: str) -> Crossing:
    low, high = sorted((a.value, b.value))
    return Crossing("not located", b, before, f"{what}; what happens there was not located", (low, high))


def _located(a: Point, b: Point, before: int, count: int) -> Crossing:
    """Return the crossing between two points of one sequence, by bisection and then as a zero of log |m|.

    ``count`` multipliers are unstable at the first point.
    """
    lost = _unlocated(a, b, before, "multipliers cross the unit circle")
    for _ in range(HALVINGS):
        middle = _between(a, b, 0.5)
        if middle is None:
            return lost
        a, b = (middle, b) if judged(middle).unstable == count else (a, middle)
    crossing = _crossing_multiplier(a, b)
    if crossing is None:
        return lost
    reference = logarithms(np.array([crossing]))
    found: dict[float, tuple[Point, complex]] = {}

    def size(share: float) -> float:
        point = a if share == 0 else b if share == 1 else _between(a, b, share)
        if point is None:
            raise ValueError("no point there")
        others = _nontrivial(point)
        found[share] = point, complex(others[np.argmin(distances(reference, logarithms(others)))])
        return float(np.log(abs(found[share][1])))

    try:
        root = float(brentq(size, 0.0, 1.0, xtol=1e-14, rtol=1e-14))
    except ValueError:
        return lost
    left = size(root)
    at, m = found[root]
    sizes = [np.log(abs(found[share][1])) for share in (0.0, 1.0)]
    reach = max(abs(left * (b.value - a.value) / (sizes[1] - sizes[0])), VALUE * abs(at.value))
    half = at.closing.sequence.sigma < 0
    kind = _kind(m, half)
    status = "another branch crosses; " * (kind == "branch point") + description(kind, m, half)
    return Crossing(kind, replace(at, kind=kind), before, status, (at.value - reach, at.value + reach))


def _kind(m: complex, half: bool) -> str:
    """Return the kind of bifurcation at which a multiplier, of half a period or a whole one, crosses."""
    if abs(m.imag) > REAL * abs(m):
        return "Neimark-Sacker"
    if m.real > 0:
        return "branch point"
    return "pitchfork" if half else "period doubling"


def _between(a: Point, b: Point, share: float) -> Point | None:
    """Return the point of the branch at a share of the way between two others."""
    chord = b.y - a.y
    point, _ = correct(a.closing, a.y + share * chord, chord / np.linalg.norm(chord))
    return point


def _crossing_multiplier(a: Point, b: Point) -> complex | None:
    """Return the multiplier at the first of two points that crosses the unit circle between them."""
    here, there = (_nontrivial(p) for p in (a, b))
    order = matched(logarithms(here), logarithms(there))
    crosses = np.flatnonzero((np.abs(here) > 1) != (np.abs(there[order]) > 1))
    return complex(here[crosses[0]]) if len(crosses) else None


def _nontrivial(point: Point) -> Complex:
    """Return the multipliers without the one nearest to 1; those of half a period if the cycle is odd."""
    s = judged(point)
    m = s.multipliers if s.half_multipliers is None else s.half_multipliers
    return np.delete(m, int(np.argmin(np.abs(m - 1))))
