"""Branches of exact cycles: a predictor with tangent and curvature; grazings and folds are located on the way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.deadline import time_is_over
from hbbogie.errors import door, pair
from hbbogie.exact.changes import across, beyond, rotated, sound
from hbbogie.exact.closing import Closing
from hbbogie.exact.folding import fold_of
from hbbogie.exact.points import Point, correct, unit
from hbbogie.exact.touching import ALLOWED, Depths, consistent, depths
from hbbogie.results.ending import Ending

Array = NDArray[np.float64]

TOLERANCE = 1e-11  # largest scaled residual of a fold
PREDICTED = 1e-2  # distance of the predicted point from the branch for which the step remains unchanged
BEGUN = 0.05  # step from a grazing up to which it is not looked at how the parameter has changed
FLAT = 1e-10  # change of the scaled parameter over a step that is round-off
SHORTEST = 1e-5  # step at which the walk gives up
NEARER = 1e-3  # step below which a change of the sequence is passed without being located
SHORT = 1e-4  # scaled duration of a contact below which its vanishing would be mistaken for a fold
SMALLEST = 1e-6  # size of a motion, in units of that at which the branch began, at which it has shrunk to nothing
LARGEST = 1e3  # at which the walk ends
BEGAN = Ending("began", "the linear cycles of the Hopf point first touch a contact")
STUCK = Ending("stuck", f"no further point was found with steps down to {SHORTEST:g}")
SHRUNK = Ending("vanishes", "the motion shrinks to an equilibrium beyond the last point")
UNORDERED = Ending("stuck", "no order of contacts agrees with the motion beyond the last point")
LINEAR = Ending("contact", "the last contact is lost in a grazing; the motion beyond is linear")
BESIDE = 1e-3  # share of a step by which a fold may lie outside
BISECTIONS = 8  # bisections between two points in search of a fold


def predicted(before: Point | None, here: Point, s: float) -> Array:
    """Return the point at a distance s on the cubic through two points and their tangents, or on the tangent alone."""
    t = here.tangent
    if before is None or len(before.y) != len(here.y) or before.closing is not here.closing:
        return here.y + s * t
    d, t0 = t @ (here.y - before.y), before.tangent / (before.tangent @ t)
    e, f = (before.y - here.y + t * d) / d**2, (t - t0) / (2 * d)
    b = 2 * (e - f) / d
    return here.y + s * (t + s * (e + b * d + s * b))


@dataclass(frozen=True, eq=False)
class Walk:
    """The points of a branch, in order, and the reasons why it ends, and begins where it does."""

    points: list[Point]
    end: Ending
    beginning: Ending = BEGAN

    __repr__ = brief

    def marked(self, kind: str) -> list[Point]:
        """Return the points of a kind: grazing, fold, end; fold not located, not located (a change of the sequence)."""
        return [p for p in self.points if p.kind == kind]


@door(first=Point)
def follow(
    first: Point,
    window: tuple[float, float],
    *,
    step: float = 0.05,
    longest: float = 1.0,
    most: int = 400,
    coarse: bool = False,
) -> Walk:
    """Follow a branch from a point in the direction of its tangent.

    Parameters
    ----------
    first : Point
    window : (float, float), unit of the parameter
        The walk ends when the parameter leaves it.
    step, longest : float
        First and longest step in the norm of the scaled unknowns; where these are larger than 1, relative to them.
    most : int
        Largest number of points.
    coarse : bool
        Whether only folds and changes of the sequence are asked for: steps are then longer where the motion is large.
        Any step is shortened where the parameter or a depth may turn twice between two points.

    Raises
    ------
    ModelError
        When the window is no pair (low, high), or the point of another kind.
    """
    window = pair("follow: window", window)
    points, before, here, length, trail = [first], None, first, step, list[tuple[Point, Depths]]()
    while len(points) < most:
        if time_is_over():
            why = f"the time limit was reached at {here.value:g}"
            return Walk(points, Ending("limit", why, "raise limit to go on"))
        low, high = (v / here.closing.frame.parameter[0] for v in window)
        there, off = correct(here.closing, predicted(before, here, length), here.tangent)
        if there is None or there.tangent @ here.tangent < 0.5 or _size(there) < SMALLEST:
            length /= 3
            if length < SHORTEST:
                return Walk(points, SHRUNK if there and _size(there) < SMALLEST else STUCK)
            continue
        found = depths(there.closing, there.y[None], there.at)
        if not consistent(there.closing, there.y[None], there.at, found)[0]:
            changed = across(here, there, found) or (beyond(there, found) if length < NEARER else None)
            if changed is None or _size(changed) < SMALLEST:
                length /= 3
                if length < SHORTEST:
                    return Walk(points, SHRUNK if changed else UNORDERED)
                continue
            if changed.kind == "lost":
                return Walk([*points, replace(changed, kind="grazing")], LINEAR)
        elif length > NEARER and (_turns_twice(here, there) or _dips(trail, there, found)):
            length /= 3
            continue
        else:
            changed = there
        turns: list[Point] = []
        if changed.direction * here.direction < 0:
            turn = between(here, there, changed)
            if turn.kind != "fold" and length > NEARER:  # a grazing may follow closely
                length /= 3
                continue
            turns = [turn]
        if not low <= changed.y[-1] <= high:
            bound = low if changed.y[-1] < low else high
            landed = _landed(here, changed, bound)
            if not landed and length > SHORTEST:  # the order of contacts changes before the end
                length /= 3
                continue
            end = f"the end of the interval, {window[0] if bound == low else window[1]:g}"
            kind, what = ("interval", end) if landed else ("stuck", f"no cycle was found at {end}")
            return Walk([*points, *turns, *landed], Ending(kind, what))
        points += [*turns, changed]
        before, here = here if changed.closing is here.closing else None, changed
        trail = [*trail[-1:], (there, found)] if before else []
        size = max(1.0, float(np.abs(here.y[: here.closing.n]).max()))
        if size > LARGEST:
            return Walk(points, Ending("beyond", f"the motion is {LARGEST:g} times as large as where the branch began"))
        allowed = PREDICTED * size if coarse else PREDICTED
        factor = min(2.0, max(0.4, (allowed / max(off, 1e-12)) ** (0.25 if before else 0.5)))
        length = min(length * factor, longest * size)
        turned = rotated(here)
        before, here = before if turned is here else None, turned
    return Walk(points, Ending("points", f"the largest number of points, {most}, was reached"))


def _size(point: Point) -> float:
    """Return by how much the state changes in a phase at the rate at its beginning, at most."""
    sequence, at, n = point.closing.sequence, point.at, point.closing.n
    rate = at.A[0, sequence.of, :n] @ at.nodes[0, :-1, :, None]
    return float(np.abs(rate[..., 0] * point.y[n : n + sequence.S, None]).max())


def _turns_twice(here: Point, there: Point) -> bool:
    """Tell whether the parameter may turn and turn back over a step, as a cubic with its slopes at both ends does."""
    if here.direction * there.direction <= 0:
        return False
    step = there.y - here.y
    change, way = float(step[-1]), np.sign(there.direction)
    a, b = (float(t[-1] * (step @ step) / (t @ step)) for t in (here.tangent, there.tangent))
    if here.along is not None:  # at a grazing it changes like a power of the step, second to tenth
        short = np.linalg.norm(step) <= BEGUN
        return bool(way * change < -FLAT or not (short or 0.1 * abs(b) <= abs(change) <= 0.6 * abs(b)))
    bend, turn = 3 * change - 2 * a - b, a + b - 2 * change
    x = np.clip(-bend / (3 * turn), 0.0, 1.0) if turn else 0.0  # where the slope a + 2 bend x + 3 turn x^2 is least
    return bool(way * (a + x * (2 * bend + 3 * turn * x)) < -FLAT)


def _dips(trail: list[tuple[Point, Depths]], there: Point, found: Depths) -> bool:
    """Tell whether a surface may be reached between points, by parabolas through its depths at the last three."""
    if len(trail) < 2 or trail[0][0].closing is not there.closing:
        return False
    points, seen = [*(q for q, _ in trail), there], [*(d.least for _, d in trail), found.least]
    h, k = (float(np.linalg.norm(b.y - a.y)) for a, b in pairwise(points))
    first, second = (seen[1] - seen[0]) / h, (seen[2] - seen[1]) / k
    bend = (second - first) / (h + k)
    slope = first + h * bend  # at the point in the middle
    x = np.clip(-slope / np.where(bend > 0, 2 * bend, np.inf), 0.0, k)
    size = max(1.0, float(np.abs(there.y[: there.closing.n]).max()))
    return bool((seen[1] + x * (slope + x * bend) < -ALLOWED * size).any())


def _landed(here: Point, there: Point, bound: float) -> list[Point]:
    """Return the point between two others at a value of the scaled parameter."""
    if there.closing is not here.closing:
        here = there
    share = 1.0 if here is there else (bound - here.y[-1]) / (there.y[-1] - here.y[-1])
    y = here.y + share * (there.y - here.y)
    y[-1] = bound
    point, _ = correct(here.closing, y, unit(len(y), len(y) - 1))
    return [] if point is None else [replace(point, kind="end")]


def between(here: Point, there: Point, changed: Point) -> Point:
    """Return the fold between two points, in the sequence of either; the second point if none is found.

    ``there`` is the second point in the sequence of the first, and ``changed`` is the same point in its own sequence.
    """
    chord = there.y - here.y
    for closing, y in _guesses(here, there, changed):
        touching = [closing.n + i for i in closing.sequence.touching]
        if (y[touching] < SHORT).any():
            continue
        found = fold_of(closing, y[None])
        if not found.error[0] <= TOLERANCE or (found.y[0, touching] < SHORT).any():
            continue
        point = Point(closing, found.y[0], np.append(found.v[0], 0.0), found.at, "fold", 0.0)
        within = len(point.y) != len(chord) or -BESIDE <= (point.y - here.y) @ chord / (chord @ chord) <= 1 + BESIDE
        if within and np.linalg.norm(point.y - y) <= 2 * np.linalg.norm(chord) and sound(point):
            return point
    return replace(changed, kind="fold not located")


def _guesses(here: Point, there: Point, changed: Point) -> Iterator[tuple[Closing, Array]]:
    """Yield guesses of a fold between two points: on a straight line, at the points, then by bisection."""
    a, b = here.direction, there.direction
    share = a / (a - b) if a * b < 0 else 1.0
    yield here.closing, here.y + share * (there.y - here.y)
    yield there.closing, there.y
    yield changed.closing, changed.y
    low, high = here.y, there.y
    for _ in range(BISECTIONS if a * b < 0 else 0):
        secant = (high - low) / np.linalg.norm(high - low)
        point, _ = correct(here.closing, 0.5 * (low + high), secant)
        if point is None:
            return
        if a * point.tangent[-1] * (point.tangent @ secant) < 0:
            high = point.y
        else:
            low = point.y
        yield here.closing, point.y
