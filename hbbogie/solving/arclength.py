"""Curves of solutions of n equations in n + 1 unknowns, by predictor and corrector in scaled arclength."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]
ITERATIONS = 8
FEW, MANY = 3, 6  # Newton iterations that lengthen and shorten the step
WIDEST_TURN = 0.95  # cosine of the largest angle between successive tangents
ASIDE = 1.1  # distance of a point found, in units of the step, beyond which it lies on another curve
SHORTEST = 1e-5  # step at which the walk gives up
RADIUS = 1.0  # farthest that Newton's method may go in one step


class Curve(Protocol):
    """A curve: implement ``evaluate`` and give the scales, and `walk` follows it.

    Attributes
    ----------
    scale : ndarray, shape (n + 1,)
        Typical size of each unknown.
    weights : ndarray, shape (n + 1,)
        1 for unknowns that count as distance, 0 for those that follow from them.
    window : dict of int to (float, float)
        Where the walk ends: limits of some of the unknowns.
    tolerance : float
        Largest scaled residual of a point.
    """

    scale: Array
    weights: Array
    window: dict[int, tuple[float, float]]
    tolerance: float

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the scaled residual, shape (n,), and its derivative in the scaled unknowns, shape (n, n + 1)."""

    def settle(self, u: Array) -> None:
        """Take note of a new point of the curve, such as for a normalisation that moves along."""

    def leaves(self, u: Array) -> str:
        """Return why the curve ends before these unknowns, or nothing."""

    def at(self, index: int, value: float) -> str:
        """Return the sentence for an end at a limit of an unknown."""


@dataclass(frozen=True)
class Point:
    """A point of a curve: unknowns u, unit tangent in scaled unknowns, largest scaled residual."""

    u: Array
    tangent: Array
    error: float


def correct(curve: Curve, u: Array, normal: Array) -> tuple[Point | None, int]:
    """Newton's method in the plane through u across ``normal``; also return the number of iterations."""
    base = u
    for iteration in range(ITERATIONS):
        G, J = curve.evaluate(u)
        error = float(np.abs(G).max())
        if not np.isfinite(error) or not np.isfinite(J).all():
            return None, iteration
        bordered = np.vstack([J, normal])
        try:
            if error <= curve.tolerance:
                tangent = np.linalg.solve(bordered, np.append(np.zeros(len(G)), 1.0))
                return Point(u, tangent / np.linalg.norm(tangent * curve.weights), error), iteration
            step = np.linalg.solve(bordered, -np.append(G, normal @ ((u - base) / curve.scale)))
        except np.linalg.LinAlgError:
            return None, iteration
        if np.abs(step * curve.weights).max() > RADIUS:  # left the neighbourhood
            return None, iteration
        u = u + curve.scale * step
    return None, ITERATIONS


def advance(curve: Curve, point: Point, length: float) -> tuple[Point | None, int]:
    """Return the point at a distance along the tangent, its tangent in the same direction."""
    return correct(curve, point.u + length * curve.scale * point.tangent, point.tangent * curve.weights)


def walk(
    curve: Curve, first: Point, *, step: float = 0.02, longest: float = 0.1, most: int = 400
) -> tuple[list[Point], str]:
    """Follow a curve from a point in the direction of its tangent; return the points and why it ends.

    Parameters
    ----------
    curve : Curve
    first : Point
    step, longest : float
        First and longest step in scaled arclength.
    most : int
        Largest number of points.
    """
    points, length = [first], step
    curve.settle(first.u)
    while len(points) < most:
        here = points[-1]
        there, iterations = advance(curve, here, length)
        if there is None or _turn(curve, here, there) < WIDEST_TURN or _distance(curve, here, there) > ASIDE * length:
            length /= 2
            if length < SHORTEST:
                return points, STUCK
            continue
        for index, (low, high) in curve.window.items():
            if not low <= there.u[index] <= high:
                bound = low if there.u[index] < low else high
                last = landing(curve, here, there, index, bound)
                return points + ([last] if last is not None else []), curve.at(index, bound)
        if reason := curve.leaves(there.u):
            if length <= step:
                return points, reason
            length = max(length / 2, 0.9 * step)
            continue
        if len(points) > 10 and _closes(curve, points, there):
            return [*points, first], CLOSED
        points.append(there)
        curve.settle(there.u)
        length = min(length * (1.5 if iterations <= FEW else 0.6 if iterations >= MANY else 1.0), longest)
    return points, f"the largest number of points, {most}, was reached"


CLOSED = "the curve closes on itself"
STUCK = f"no further point was found with steps down to {SHORTEST:g}"


def landing(curve: Curve, here: Point, there: Point, index: int, value: float) -> Point | None:
    """Return the point between two others at which an unknown has a value, or None where it is not found."""
    share = (value - here.u[index]) / (there.u[index] - here.u[index])
    u = here.u + share * (there.u - here.u)
    u[index] = value
    across = np.zeros(len(u))
    across[index] = 1.0
    found, _ = correct(curve, u, across)
    if found is None:
        return None
    along = np.sign((found.tangent * curve.weights) @ here.tangent) or 1.0
    return Point(found.u, along * found.tangent, found.error)


def located(curve: Curve, a: Point, b: Point, test: Callable[[Point], float]) -> Point | None:
    """Return the point between two others where a function of the point changes its sign, or None.

    Bracketing in the distance along the tangent at the first point, down to round-off.
    """
    distance = float((a.tangent * curve.weights) @ ((b.u - a.u) / curve.scale))
    found: dict[float, Point] = {0.0: a, distance: b}

    def value(length: float) -> float:
        if length not in found:
            point, _ = advance(curve, a, length)
            if point is None:
                raise ArithmeticError
            found[length] = point
        return test(found[length])

    curve.settle(a.u)
    try:
        root = float(brentq(value, 0.0, distance, xtol=1e-13, rtol=1e-12))
        value(root)
    except (ValueError, RuntimeError, ArithmeticError):
        return None
    return found[root]


def _turn(curve: Curve, a: Point, b: Point) -> float:
    """Return the cosine of the angle between two tangents."""
    return float((a.tangent * curve.weights) @ b.tangent)


def _distance(curve: Curve, a: Point, b: Point) -> float:
    return float(np.linalg.norm((b.u - a.u) / curve.scale * curve.weights))


def _closes(curve: Curve, points: list[Point], there: Point) -> bool:
    start, here = points[0], points[-1]
    nearer = _distance(curve, start, there) < _distance(curve, here, there)
    return nearer and _turn(curve, start, there) > 0.9
