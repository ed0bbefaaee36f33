"""Curves of solutions of n equations in n + 1 unknowns, by predictor and corrector in scaled arclength.

`hbbogie.solving.curve` describes what a curve has to provide.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from hbbogie.deadline import time_is_over
from hbbogie.results.ending import Ending
from hbbogie.solving.curve import Curve, Linearised, Point
from hbbogie.solving.newton import ROUND_OFF
from hbbogie.threads import one_blas_thread

Array = NDArray[np.float64]
ITERATIONS = 10
FEW, MANY = 3, 6  # numbers of Newton iterations that lengthen and shorten the step
WIDEST_TURN = 0.97  # cosine of the largest angle between successive tangents
ASIDE = 1.1  # distance of a new point, in units of the step, beyond which it lies on another curve
CAREFUL = 1e-3  # longest step that may lead to an end, since a longer one may have jumped over other points
CROSSING = 1e-4  # longest step across a branch point, since a longer one may have jumped to another curve
CONTRACTION = 1.0  # largest ratio of successive corrections in a longer step; growing ones lead to another curve
FARTHEST = 2.0  # largest scaled correction of an unknown; a larger one leads to another curve or diverges
ALIKE = 0.9  # smallest cosine of the angle between the tangents where a curve closes


def product(curve: Curve, a: Array, b: Array) -> float:
    """Return the inner product of two vectors of scaled unknowns."""
    return float((curve.weights * a) @ b)


def distance(curve: Curve, a: Point, b: Point) -> float:
    """Return how far b lies from a, along the tangent at a."""
    return product(curve, a.tangent, (b.u - a.u) / curve.scale)


def gap(curve: Curve, a: Point, b: Point) -> float:
    """Return how far b lies from a, in a straight line."""
    chord = (b.u - a.u) / curve.scale
    return product(curve, chord, chord) ** 0.5


def point_at(curve: Curve, u: Array, plane: Array) -> Point:
    """Return the point at unknowns that solve the equations, with its tangent on the positive side of a plane.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the plane contains the tangent, or there is more than one tangent.
    """
    return _point(curve, u, plane, curve.linearise(u))


def _point(curve: Curve, u: Array, plane: Array, line: Linearised) -> Point:
    t, sign = line.solve(plane, np.append(np.zeros(len(u) - 1), 1.0))
    # as the last row, the tangent gives the same sign as the plane, since it is on its positive side
    return Point(u, t / product(curve, t, t) ** 0.5, line.residual, sign)


def correct(curve: Curve, u: Array, plane: Array, contraction: float = np.inf) -> tuple[Point | None, int]:
    """Newton's method in the plane through u that is normal to a vector.

    Parameters
    ----------
    curve : Curve
    u : ndarray, shape (n + 1,)
        The starting point.
    plane : ndarray, shape (n + 1,)
        The normal vector, in scaled unknowns.
    contraction : float
        Largest ratio of a correction to the previous one.

    Returns
    -------
    point : Point or None
        With its tangent on the positive side of the plane; None if none is found.
    iterations : int
    """
    base, met, last = u, False, np.inf
    for iteration in range(ITERATIONS):
        line = curve.linearise(u)
        error, off = float(np.abs(line.residual).max()), plane @ ((u - base) / curve.scale)
        if not np.isfinite(error):
            return None, iteration
        near = error <= curve.tolerance and bool(abs(off) <= 1e-9)
        try:
            if near and (met or error <= ROUND_OFF * curve.tolerance):
                return _point(curve, u, plane, line), iteration
            met = near  # one more step is cheap and reaches round-off
            step, _ = line.solve(plane, -np.append(line.residual, off))
        except np.linalg.LinAlgError:
            return None, iteration
        size = float(np.abs(curve.weights * step).max())
        if not size <= FARTHEST or (size > contraction * last and not met):
            return None, iteration
        u, last = u + curve.scale * step, size
    return None, ITERATIONS


def advance(curve: Curve, point: Point, length: float) -> tuple[Point | None, int]:
    """Return the point at a distance along the tangent, with the same direction, and the number of iterations."""
    start = point.u + length * curve.scale * point.tangent
    # a short step cannot lead to another curve, even if Newton's method converges slowly, as next to a kink
    return correct(curve, start, curve.weights * point.tangent, CONTRACTION if length > CAREFUL else np.inf)


@one_blas_thread()
def walk(
    curve: Curve,
    first: Point,
    *,
    step: float = 0.02,
    longest: float = 0.1,
    shortest: float = 1e-5,
    most: int = 400,
    stretch: Callable[[Array], float] | None = None,
    progress: Callable[[Point], None] | None = None,
) -> tuple[list[Point], Ending]:
    """Follow a curve from a point in the direction of its tangent.

    The sign of det [J; tangent] distinguishes the curve from others nearby, since it changes only at branch points. A
    step over which it changes is halved until it is so short that only a branch point can be the cause.

    Parameters
    ----------
    curve : Curve
    first : Point
    step, longest : float
        First and longest step in scaled arclength. The first is lengthened if no shorter one succeeds, as from a
        special point that is not exactly where branches cross.
    stretch : callable, optional
        Gives how many times longer than ``longest`` a step may be at some unknowns.
    shortest : float
        Step at which the walk gives up.
    most : int
        Largest number of points.
    progress : callable, optional
        Called with each new point.

    Returns
    -------
    points : list of Point
    ending : Ending
        Why the walk ends: an ending of the curve, or "closed", "stuck", "points" or "limit".
    """
    points, length, least, before = [first], step, shortest, 0.0
    curve.settle(first.u)
    while len(points) < most:
        here = points[-1]
        if time_is_over():
            return points, Ending(
                "limit", f"the time limit was reached at {curve.where(here.u)}", "raise limit to go on"
            )
        there, iterations = advance(curve, here, length)
        if there is None or (refusal := _refusal(curve, here, there, length)):
            length /= 2
            if length >= least:
                continue
            if len(points) > 1 or 2 * step > longest:
                why = refusal if there else "Newton's method finds no solution there"
                place = f"beyond {curve.where(here.u)} with steps down to {shortest:g}"
                return points, Ending("stuck", f"no further point was found {place}: {why}")
            step = length = least = 2 * step
            continue
        flips = here.orientation * there.orientation < 0
        if flips and length > CROSSING:
            before = max(before, length)
            length /= 2
            continue
        if end := curve.leaves(points, there):
            if length <= CAREFUL:
                return points, end
            length /= 2
            continue
        for index, (low, high) in curve.window.items():
            if not low <= there.u[index] <= high:
                bound = low if there.u[index] < low else high
                last = landing(curve, here, there, index, bound)
                return [*points, *([last] if last else [])], curve.at(index, bound)
        if progress:
            progress(there)
        if len(points) > 10 and _closes(curve, points, there):
            return [*points, first], Ending("closed", "the curve closes on itself")
        points.append(there)
        curve.settle(there.u)
        length = before if flips else length * (1.5 if iterations <= FEW else 0.6 if iterations >= MANY else 1.0)
        length = min(length, longest * (stretch(there.u) if stretch else 1.0))
        least, before = shortest, 0.0 if flips else before
    return points, Ending("points", f"the largest number of points, {most}, was reached")


def _refusal(curve: Curve, here: Point, there: Point, length: float) -> str:
    """Return why a point is not accepted as the next one, or an empty text."""
    if product(curve, here.tangent, there.tangent) < WIDEST_TURN:
        return "the curve turns sharply there"
    return "the point found there lies on another curve" if gap(curve, here, there) > ASIDE * length else ""


def _closes(curve: Curve, points: Sequence[Point], there: Point) -> bool:
    start, here = points[0], points[-1]
    nearer = gap(curve, start, there) < gap(curve, here, there)
    return nearer and product(curve, start.tangent, there.tangent) > ALIKE


def landing(curve: Curve, here: Point, there: Point, index: int, value: float) -> Point | None:
    """Return the point between two others at which an unknown has a value.

    None if it is not found, or is the first of the two.
    """
    share = (value - here.u[index]) / (there.u[index] - here.u[index])
    if not share > 1e-9:
        return None
    u = here.u + share * (there.u - here.u)
    u[index] = value
    across = np.zeros(len(u))
    across[index] = 1.0
    found, _ = correct(curve, u, across)
    return found and towards(curve, found, here.tangent)


def towards(curve: Curve, point: Point, direction: Array) -> Point:
    """Return a point with its tangent turned towards a direction."""
    return point if product(curve, point.tangent, direction) >= 0 else point.turned()


def located(curve: Curve, a: Point, b: Point, test: Callable[[Point], float]) -> tuple[Point, float] | None:
    """Return the point between two others at which a function of the point changes its sign.

    Returns
    -------
    point : Point
    error : float
        Possible error of the point in arclength, from the remaining value of the function.

    If the curve cannot be followed all the way, as next to a crossing branch, the result is the nearest point found and
    the rest of the bracket. None if nothing is found at all.
    """
    curve.settle(a.u)
    whole = distance(curve, a, b)
    found = {0.0: (a, test(a)), whole: (b, test(b))}

    def value(length: float) -> float:
        if length not in found:
            # close to a crossing branch Newton's method needs a start that is closer to this one than to that
            before = max(s for s in found if s < length)
            after = min(s for s in found if s > length)
            start = _between(curve, a, (before, found[before][0]), (after, found[after][0]), length)
            point, _ = correct(curve, start, curve.weights * a.tangent)
            if point is None:
                return float("nan")
            found[length] = point, test(point)
        return found[length][1]

    slope = (found[whole][1] - found[0.0][1]) / whole
    try:
        value(float(brentq(value, 0.0, whole, xtol=1e-13, rtol=1e-13, maxiter=60)))
    except (ValueError, RuntimeError):
        known = sorted((s, v) for s, (_, v) in found.items() if np.isfinite(v))
        brackets = [(q[0] - p[0], p, q) for p, q in pairwise(known) if p[1] * q[1] <= 0]
        if not brackets:
            return None
        width, *ends = min(brackets)
        return found[min(ends, key=lambda end: abs(end[1]))[0]][0], width
    point, left = found[min(found, key=lambda s: abs(found[s][1]) if np.isfinite(found[s][1]) else np.inf)]
    return point, abs(left / slope)


def _between(curve: Curve, a: Point, before: tuple[float, Point], after: tuple[float, Point], length: float) -> Array:
    """Return the cubic through two points and their tangents at a length along the tangent at a."""
    (s0, p0), (s1, p1) = before, after
    x, h = (length - s0) / (s1 - s0), s1 - s0
    rates = [curve.scale * p.tangent / product(curve, a.tangent, p.tangent) for p in (p0, p1)]
    between = p0.u * (1 + 2 * x) * (1 - x) ** 2 + p1.u * x**2 * (3 - 2 * x)
    return np.asarray(between + h * (rates[0] * x * (1 - x) ** 2 - rates[1] * x**2 * (1 - x)))
