"""Following a curve of critical values: its pieces, the places where something changes, and the points it passes."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.results import SpecialPoint
from hbbogie.results.chart import CriticalCurve
from hbbogie.results.ending import Ending
from hbbogie.solving.arclength import distance, landing, located, walk
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
Test = Callable[[Any, Point], float]
SAME = 1e-6  # distance up to which two points are one, of the frequency and of the chart's height
VANISHED = 1e-6  # what may be left of a function where it changes its sign, in units of its values before and after


@dataclass(frozen=True, eq=False)
class Followed:
    """A curve that was followed, or a piece of it: points, what is known about them, and where something changes.

    Attributes
    ----------
    curve : FoldCurve or HopfCurve
    points : list of Point
    states : list of FoldState or of HopfState
        One for each point.
    marks : list of (str, Point, state)
        Where a test changes its sign, with the name of the test.
    ends : (Ending, Ending)
        Why it ends where it begins and where it ends; the first is empty for a piece followed one way.
    """

    curve: Any
    points: list[Point]
    states: list[Any]
    marks: list[tuple[str, Point, Any]]
    ends: tuple[Ending, Ending]

    def planes(self) -> Array:
        """Return omega and both parameters, shape (points, 3)."""
        return np.array([plane(self.curve, point) for point in self.points])


def follow(curve: Any, start: Point, tests: Mapping[str, Test], jumps: Container[str], longest: float) -> Followed:
    """Follow a curve from a point in the direction of its tangent, and locate where something changes.

    Parameters
    ----------
    curve : FoldCurve or HopfCurve
    start : Point
    tests : mapping of str to functions of (state, point)
        What is looked for where the function changes its sign.
    jumps : container of str
        Tests that may change their sign by a jump.
    longest : float
        Longest step in scaled arclength.
    """
    points, end = walk(curve, start, longest=longest)
    states = [curve.state(point) for point in points]
    all_points, all_states, marks = points[:1], states[:1], []
    for (a, b), (s, t) in zip(pairwise(points), pairwise(states), strict=True):
        between: list[tuple[str, Point, Any]] = []
        for kind, test in tests.items():
            before, after = test(s, a), test(t, b)
            if not before * after < 0:
                continue
            if (found := located(curve, a, b, partial(_tested, curve, test))) is None:
                continue
            point, state = found[0], curve.state(found[0])
            if kind in jumps or abs(test(state, point)) <= VANISHED * max(abs(before), abs(after)):
                between.append((kind, point, state))
        between.sort(key=partial(_ahead, curve, a))
        marks += between
        all_points += [*(point for _, point, _ in between), b]
        all_states += [*(state for _, _, state in between), t]
    return Followed(curve, all_points, all_states, marks, (Ending(), end))


def _ahead(curve: Any, start: Point, mark: tuple[str, Point, Any]) -> float:
    return distance(curve, start, mark[1])


def _tested(curve: Any, test: Test, point: Point) -> float:
    return test(curve.state(point), point)


def plane(curve: Any, point: Point) -> Array:
    """Return omega and both parameters at a point; they stand side by side among the unknowns of either curve."""
    first = next(iter(curve.window))
    return point.u[first - 1 : first + 2]


def both_ways(first: Point, follow: Callable[[Point], list[Followed]]) -> Followed:
    """Follow a curve from a point in both directions; return its pieces as one."""
    forward = follow(first)
    closed = forward[-1].ends[1].kind == "closed"
    backward = [] if closed else follow(first.turned())
    points = [p for piece in backward for p in piece.points][:0:-1] + [p for piece in forward for p in piece.points]
    states = [s for piece in backward for s in piece.states][:0:-1] + [s for piece in forward for s in piece.states]
    marks = [m for piece in (*backward, *forward) for m in piece.marks]
    ends = (forward if closed else backward)[-1].ends[1], forward[-1].ends[1]
    return Followed(forward[0].curve, points, states, marks, ends)


def passes(found: Followed, special: SpecialPoint, value: float) -> bool:
    """Tell whether a curve passes through a special point at a value of the second parameter."""
    curve, goal = found.curve, np.array([special.omega, special.value])
    first = next(iter(curve.window))
    last, size = first + 1, np.array([special.omega, np.ptp(curve.window[first])])
    planes = found.planes()
    here = np.append(goal, value)
    if (np.abs(planes - here) <= SAME * np.append(size, np.ptp(curve.window[last]))).all(axis=1).any():
        return True
    for i, (a, b) in enumerate(pairwise(found.points)):
        if (planes[i, 2] - value) * (planes[i + 1, 2] - value) > 0 or planes[i, 2] == planes[i + 1, 2]:
            continue
        curve.settle(a.u)
        point = landing(curve, a, b, last, value)
        if point is not None and (np.abs(plane(curve, point)[:2] - goal) <= SAME * size).all():
            return True
    return False


def unresolved(found: Followed, name: str) -> str:
    """Return a sentence about the folds of a curve that are not resolved; empty where all are."""
    over = [plane(found.curve, point)[2] for point in found.points if found.curve.doubt(point)]
    if not over:
        return ""
    return (
        f"On a curve of folds {len(over)} of {len(found.points)} are not resolved and perhaps not there, for "
        f"{name} from {min(over):.6g} to {max(over):.6g}; take more harmonics."
    )


def not_covered(curves: Sequence[CriticalCurve], interval: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """Return the parts of an interval that no curve covers."""
    low, high = interval
    slack, reached, gaps = 1e-6 * (high - low), low, []
    for a, b in sorted(curve.extent for curve in curves):
        if a > reached + slack:
            gaps.append((reached, a))
        reached = max(reached, b)
    if high > reached + slack:
        gaps.append((reached, high))
    return tuple(gaps)
