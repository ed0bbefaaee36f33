"""The solution curve of the equations over a parameter, in scaled arclength: points, tangents, correction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.solving.newton import ROUND_OFF, Conditions, Problem

Array = NDArray[np.float64]
ASIDE = 1.1  # distance of a point found, in units of the step, beyond which it lies on another branch
FARTHEST = 2.0  # largest correction of an unknown, scaled: beyond lies another branch or nonsense


@dataclass(frozen=True, eq=False)
class Point:
    """A point of the curve.

    Attributes
    ----------
    y : ndarray, shape (m + 1,)
        Unknowns of the equations, then the parameter.
    tangent : ndarray, shape (m + 1,)
        Unit vector along the curve, scaled.
    residual : ndarray, shape (m,)
    """

    y: Array
    tangent: Array
    residual: Array

    def turned(self) -> Point:
        """Return the point with the curve followed the other way."""
        return Point(self.y, -self.tangent, self.residual)


class Curve:
    """The solution curve of equations in (z, parameter), scaled.

    Parameters
    ----------
    equations : Equations
    parameter : str
    width : float, unit of the parameter
        A quarter of it counts as much as one unit of amplitude.
    p : ndarray, shape (number of parameters,)
    tolerance : float
        Largest scaled residual of a point.
    """

    def __init__(self, equations: Equations, parameter: str, width: float, p: Array, tolerance: float):
        place = equations.system.parameter_names.index(parameter)
        self.problem = Problem(equations, Conditions((place,)), p)
        self.equations, self.parameter = equations, parameter
        # the interval ends the walk, not a distance from where it began
        self.problem.lower[-1], self.problem.upper[-1] = equations.system.parameters[place].bounds
        self.scale = np.append(equations.scale, width / 4)
        self.rows, self.tolerance = equations.residual_scale, tolerance

    def evaluate(self, y: Array) -> tuple[Array, Array]:
        """Return scaled residual, shape (m,), and Jacobian, shape (m, m + 1)."""
        F, J = self.problem.evaluate(y)
        return F / self.rows, J / self.rows[:, None] * self.scale

    def point(self, y: Array, along: Array, F: Array, J: Array) -> Point:
        """Return the point at y with its tangent turned towards ``along``."""
        t = np.linalg.solve(np.vstack([J, along]), np.append(np.zeros(len(J)), 1.0))
        return Point(y, t / np.linalg.norm(t), F * self.rows)

    def branching(self, point: Point) -> float:
        """Return a number that changes its sign where another branch crosses, never at a fold (eq-branching).

        The smallest singular value of the Jacobian bordered by the tangent, with the sign of the determinant.
        """
        bordered = np.vstack([self.evaluate(point.y)[1], point.tangent])
        sign = np.linalg.slogdet(bordered)[0]
        return float(sign * np.linalg.svd(bordered, compute_uv=False)[-1])

    def correct(self, y: Array, normal: Array) -> tuple[Point | None, int]:
        """Newton's method in the plane through y across ``normal``: the point, or None, and the iterations."""
        base, met = y, False
        for iteration in range(10):
            F, J = self.evaluate(y)
            plane = normal @ ((y - base) / self.scale)
            if not np.isfinite(F).all():
                return None, iteration
            try:
                if np.abs(F).max() <= self.tolerance and abs(plane) <= 1e-9:
                    if met or np.abs(F).max() <= ROUND_OFF * self.tolerance:
                        return self.point(y, normal, F, J), iteration
                    met = True  # one more step is cheap and leads to round-off
                step = np.linalg.solve(np.vstack([J, normal]), -np.append(F, plane))
            except np.linalg.LinAlgError:
                return None, iteration
            if np.abs(step).max() > FARTHEST:
                return None, iteration
            y = y + self.scale * step
        return None, 10

    def step(self, point: Point, length: float) -> tuple[Point | None, int]:
        """Return the point a length of arc further on, or None, and the iterations."""
        there, iterations = self.correct(point.y + length * self.scale * point.tangent, point.tangent)
        if there is not None and np.linalg.norm((there.y - point.y) / self.scale) > ASIDE * abs(length):
            return None, iterations
        return there, iterations

    def orbit(self, point: Point, status: str = "converged by pseudo-arclength continuation") -> Orbit:
        """Return the cycle of a point."""
        m = self.equations.size
        return self.equations.decode(point.y[:m], self.problem.parameters(point.y), status, point.residual)

    def distance(self, a: Point, b: Point) -> float:
        """Return how far b lies from a, along the tangent at a."""
        return float(a.tangent @ ((b.y - a.y) / self.scale))

    def locate(self, a: Point, b: Point, test: Callable[[Point], float]) -> tuple[Point, float] | None:
        """Find the point between two others at which a function of the point changes its sign.

        Returns
        -------
        point : Point
        error : float
            Length of arc by which the point may be off, by what is left of the function.

        Where the curve cannot be followed all the way, as next to a crossing branch, the nearest point found and the
        rest of the bracket. None where nothing is found at all.
        """
        distance = self.distance(a, b)
        found = {0.0: (a, test(a)), distance: (b, test(b))}

        def value(length: float) -> float:
            if length not in found:
                # close to a crossing branch Newton's method needs a start that is closer to this one than to that
                before = max(s for s in found if s < length)
                after = min(s for s in found if s > length)
                start = self._between(a, (before, found[before][0]), (after, found[after][0]), length)
                point, _ = self.correct(start, a.tangent)
                if point is None:
                    return float("nan")
                found[length] = point, test(point)
            return found[length][1]

        slope = (found[distance][1] - found[0.0][1]) / distance
        try:
            value(float(brentq(value, 0.0, distance, xtol=1e-13, rtol=1e-13, maxiter=60)))
        except (ValueError, RuntimeError):
            known = sorted((s, v) for s, (_, v) in found.items() if np.isfinite(v))
            brackets = [(b[0] - a_[0], a_, b) for a_, b in pairwise(known) if a_[1] * b[1] <= 0]
            if not brackets:
                return None
            width, *ends = min(brackets)
            return found[min(ends, key=lambda end: abs(end[1]))[0]][0], width
        point, left = found[min(found, key=lambda s: abs(found[s][1]) if np.isfinite(found[s][1]) else np.inf)]
        return point, abs(left / slope)

    def _between(self, a: Point, before: tuple[float, Point], after: tuple[float, Point], length: float) -> Array:
        """Return the cubic through two points and their tangents at a length along the tangent at a."""
        (s0, p0), (s1, p1) = before, after
        u, h = (length - s0) / (s1 - s0), s1 - s0
        rates = [self.scale * p.tangent / (a.tangent @ p.tangent) for p in (p0, p1)]
        ends = p0.y * (1 + 2 * u) * (1 - u) ** 2 + p1.y * u**2 * (3 - 2 * u)
        return np.asarray(ends + h * (rates[0] * u * (1 - u) ** 2 - rates[1] * u**2 * (1 - u)))
