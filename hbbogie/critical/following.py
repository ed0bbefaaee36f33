"""Following a curve of critical values: its pieces, the places where something changes, and the points it passes."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.results.chart import CriticalCurve
from hbbogie.results.ending import Ending
from hbbogie.solving.arclength import distance, landing, located, walk
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
Test = Callable[[Any, Point], float]
Mark = tuple[str, Point, Any, Any]
JUDGED = 15  # folds along a curve whose cycles are judged
SAME = 1e-6  # distance up to which two points are one, of the frequency and of the chart's height
VANISHED = 1e-6  # what may be left of a function where it changes its sign, in units of its values before and after


@dataclass(frozen=True, eq=False)
class Followed:
    """A curve that was followed, or a piece of it: points, what is known about them, and where something changes.

    Attributes
    ----------
    curves : list of FoldCurve, ExactFoldCurve or HopfCurve
        One for each point, the same for points of one piece.
    points : list of Point
    states : list of FoldState or of HopfState
        One for each point.
    marks : list of (str, Point, state, curve)
        Where a test changes its sign, with the name of the test.
    ends : (Ending, Ending)
        Why it ends where it begins and where it ends; the first is empty for a piece followed one way.
    """

    curves: list[Any]
    points: list[Point]
    states: list[Any]
    marks: list[Mark]
    ends: tuple[Ending, Ending]

    def planes(self) -> Array:
        """Return omega and both parameters, shape (points, 3)."""
        return np.array([plane(curve, point) for curve, point in zip(self.curves, self.points, strict=True)])


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
    all_points, all_states, marks = points[:1], states[:1], list[Mark]()
    for (a, b), (s, t) in zip(pairwise(points), pairwise(states), strict=True):
        between: list[Mark] = []
        for kind, test in tests.items():
            before, after = test(s, a), test(t, b)
            if not before * after < 0:
                continue
            if (found := located(curve, a, b, partial(_tested, curve, test))) is None:
                continue
            point, state = found[0], curve.state(found[0])
            if kind in jumps or abs(test(state, point)) <= VANISHED * max(abs(before), abs(after)):
                between.append((kind, point, state, curve))
        between.sort(key=partial(_ahead, curve, a))
        marks += between
        all_points += [*(point for _, point, _, _ in between), b]
        all_states += [*(state for _, _, state, _ in between), t]
    return Followed([curve] * len(all_points), all_points, all_states, marks, (Ending(), end))


def _ahead(curve: Any, start: Point, mark: Mark) -> float:
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
    curves, points, states = (
        [x for piece in backward for x in getattr(piece, of)][:0:-1]
        + [x for piece in forward for x in getattr(piece, of)]
        for of in ("curves", "points", "states")
    )
    marks = [m for piece in (*backward, *forward) for m in piece.marks]
    ends = (forward if closed else backward)[-1].ends[1], forward[-1].ends[1]
    return Followed(curves, points, states, marks, ends)


def passes(found: Followed, special: Any, value: float) -> bool:
    """Tell whether a curve passes through a point, of a value and a frequency, at a value of the second parameter."""
    curve, goal = found.curves[0], np.array([special.omega, special.value])
    first = next(iter(curve.window))
    size = np.array([special.omega, np.ptp(curve.window[first])])
    planes = found.planes()
    here = np.append(goal, value)
    if (np.abs(planes - here) <= SAME * np.append(size, np.ptp(curve.window[first + 1]))).all(axis=1).any():
        return True
    for i, (a, b) in enumerate(pairwise(found.points)):
        if (planes[i, 2] - value) * (planes[i + 1, 2] - value) > 0 or planes[i, 2] == planes[i + 1, 2]:
            continue
        curve = found.curves[i]
        if found.curves[i + 1] is not curve:  # between two pieces
            continue
        last = next(iter(curve.window)) + 1
        curve.settle(a.u)
        point = landing(curve, a, b, last, value)
        if point is not None and (np.abs(plane(curve, point)[:2] - goal) <= SAME * size).all():
            return True
    return False


def unresolved(found: Followed, name: str) -> str:
    """Return a sentence about the folds of a curve that are not resolved, of some along it; empty where all are."""
    some = np.unique(np.linspace(0, len(found.points) - 1, JUDGED).round().astype(int))
    over = [plane(found.curves[i], found.points[i])[2] for i in some if found.curves[i].doubt(found.points[i])]
    if not over:
        return ""
    return (
        f"On a curve of folds {len(over)} of {len(some)} that were judged are not resolved and perhaps not there, for "
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
