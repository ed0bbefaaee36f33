"""Branches of cycles: pseudo-arclength continuation in one parameter, and all cycles at a value of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from hbbogie.equations import Equations
from hbbogie.errors import ConvergenceError, ModelError
from hbbogie.guesses import check_interval, first_cycle
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.solvers import Conditions, Problem, solve

Array = NDArray[np.float64]
Progress = Callable[[float], None]
FEW, MANY = 3, 6  # Newton iterations that lengthen and shorten the step
WIDEST_TURN = 0.97  # cosine of the largest angle between successive tangents
SHORTEST = 1e-7  # step at which the continuation gives up
VERTICAL = 1e-9  # share of the parameter in the tangent below which it counts as constant


@dataclass(frozen=True)
class _Point:
    """A point of the curve: unknowns y, unit tangent and residual, in scaled arclength."""

    y: Array
    tangent: Array
    residual: Array


class _Curve:
    """The solution curve of the equations in (z, parameter), scaled."""

    def __init__(self, equations: Equations, parameter: str, width: float, p: Array, tolerance: float):
        place = equations.system.parameter_names.index(parameter)
        self.problem = Problem(equations, Conditions((place,)), p)
        # a quarter of the interval counts as much as one unit of amplitude
        self.scale = np.append(equations.scale, width / 4)
        self.rows, self.tolerance = equations.residual_scale, tolerance

    def evaluate(self, y: Array) -> tuple[Array, Array]:
        F, J = self.problem.evaluate(y)
        return F / self.rows, J / self.rows[:, None] * self.scale

    def tangent(self, J: Array, along: Array) -> Array:
        bordered = np.vstack([J, along])
        t = np.linalg.solve(bordered, np.append(np.zeros(len(J)), 1.0))
        return np.asarray(t / np.linalg.norm(t))

    def first_tangent(self, J: Array) -> Array:
        """Return the null vector of J (the one of the smallest singular value)."""
        return np.asarray(np.linalg.svd(J)[2][-1])

    def correct(self, y: Array, normal: Array) -> tuple[_Point | None, int]:
        """Newton's method in the plane through y across ``normal``."""
        base = y
        for iteration in range(10):
            F, J = self.evaluate(y)
            plane = normal @ ((y - base) / self.scale)
            if not np.isfinite(F).all():
                return None, iteration
            if np.abs(F).max() <= self.tolerance and abs(plane) <= 1e-9:
                return _Point(y, self.tangent(J, normal), F * self.rows), iteration
            try:
                step = np.linalg.solve(np.vstack([J, normal]), -np.append(F, plane))
            except np.linalg.LinAlgError:
                return None, iteration
            if np.abs(step).max() > 2.0:  # left the neighbourhood: another branch or nonsense
                return None, iteration
            y = y + self.scale * step
        return None, 10

    def step(self, point: _Point, length: float) -> tuple[_Point | None, int]:
        return self.correct(point.y + length * self.scale * point.tangent, point.tangent)


PATIENCE = 20  # points at one parameter value after which a branch counts as a family


def trace(
    equations: Equations,
    start: Orbit | SpecialPoint,
    parameter: str,
    interval: tuple[float, float],
    *,
    step: float = 0.02,
    longest: float = 0.3,
    max_points: int = 500,
    families: bool = True,
    tolerance: float = 1e-10,
    progress: Progress | None = None,
) -> Branch:
    """Follow a branch of cycles over a parameter, around folds, in both directions from the start.

    Parameters
    ----------
    equations : Equations
    start : Orbit or SpecialPoint
        A cycle on or near the branch; from a Hopf point the branch is followed towards growing amplitude,
        beginning where a gap first closes if the system is linear until then.
    parameter : str
        Name of the continuation parameter.
    interval : (float, float), unit of the parameter
        Where to stop.
    step, longest : float
        First and longest step in scaled arclength: one unit is the amplitude scale of the equations, or a
        quarter of the interval.
    max_points : int
        Largest number of points.
    families : bool
        Whether to go on where the parameter does not vary along the branch, as for the cycles of a
        conservative system.
    tolerance : float
        Largest scaled residual of a point.
    progress : callable, optional
        Called with the parameter's value after each point.

    Returns
    -------
    Branch
        With folds located and marked in ``special`` and the reason for each end in ``ends``.

    Raises
    ------
    ConvergenceError
        When the start does not lead to a cycle.
    ModelError
        For an unknown parameter, an empty interval, or a start outside it.

    References
    ----------
    H. B. Keller, in Applications of Bifurcation Theory, Academic Press 1977, 359-384 (eq-arclength).
    """
    lo, hi = check_interval(equations.system, parameter, interval)
    if not (0 < step <= longest) or max_points < 2:
        raise ModelError(
            f"trace: step={step}, longest={longest}, max_points={max_points}; need 0 < step <= longest, 2 points."
        )
    if equations.phase is None:
        raise ModelError("trace: the equations are those of equilibria (harmonics 0); ask for at least one harmonic.")
    from_hopf, orbit = False, start.orbit if isinstance(start, SpecialPoint) else start
    if isinstance(start, SpecialPoint) and start.kind == "hopf":
        from_hopf, orbit = True, first_cycle(equations, start)
    p = equations.system.vector()
    place = equations.system.parameter_names.index(parameter)
    p[place] = orbit.parameters.get(parameter, p[place])
    if not lo <= p[place] <= hi:
        raise ModelError(
            f"trace: the start has {parameter} = {p[place]:g}, outside the interval ({lo:g}, {hi:g}); widen it."
        )
    curve = _Curve(equations, parameter, hi - lo, p, tolerance)
    first = _first_point(curve, orbit, equations, growing=from_hopf)
    walker = _Walker(curve, (lo, hi), (step, longest), max_points, families, progress)
    forward, end = walker.walk(first)
    backward, beginning = [first], "began here, at the Hopf point"
    if not from_hopf and end != CLOSED:
        backward, beginning = walker.walk(_Point(first.y, -first.tangent, first.residual))
    elif end == CLOSED:
        beginning = CLOSED
    points = [_Point(b.y, -b.tangent, b.residual) for b in backward[:0:-1]] + forward
    points, special = _with_folds(curve, parameter, points)
    return Branch(tuple(_decode(curve, point) for point in points), parameter, special, (beginning, end))


def _with_folds(curve: _Curve, parameter: str, points: list[_Point]) -> tuple[list[_Point], tuple[SpecialPoint, ...]]:
    """Return the points with the folds between them put in, and the folds."""
    complete, special = points[:1], []
    for a, b in pairwise(points):
        if a.tangent[-1] * b.tangent[-1] < 0 and (located := _fold(curve, a, b)) is not None:
            point, error = located
            value, kind = float(point.y[-1]), "smallest" if b.tangent[-1] > 0 else "largest"
            status = f"{kind} value of {parameter} along the branch; slope {point.tangent[-1]:.1e} where located"
            special.append(
                SpecialPoint("fold", parameter, value, (value - error, value + error), _decode(curve, point), status)
            )
            complete.append(point)
        complete.append(b)
    return complete, tuple(special)


def _decode(curve: _Curve, point: _Point) -> Orbit:
    problem = curve.problem
    m = problem.equations.size
    return problem.equations.decode(
        point.y[:m], problem.parameters(point.y), "converged by pseudo-arclength continuation", point.residual
    )


def _first_point(curve: _Curve, orbit: Orbit, equations: Equations, growing: bool) -> _Point:
    """Put the start on the curve: at its parameter value, or at its amplitude where that fails or is asked for."""
    place = curve.problem.free[0]
    name = equations.system.parameter_names[place]
    coordinate = equations.system.coordinate_names[equations.phase or 0]
    by_amplitude: dict[str, Any] = {
        "amplitude": {coordinate: orbit.first_harmonic(coordinate)},
        "free": name,
    }
    fixed: dict[str, Any] = {name: curve.problem.p[place]}
    values = {k: v for k, v in equations.system.values.items() if k != name}
    attempts = [by_amplitude, fixed] if growing else [fixed, by_amplitude]
    for attempt in attempts:
        try:
            found = solve(equations, orbit, tolerance=curve.tolerance, **attempt)
            break
        except ConvergenceError as error:
            last = error
    else:
        raise last
    p = equations.system.vector(**values, **{name: found.parameters[name]})
    y = np.append(equations.encode(found), p[place])
    F, J = curve.evaluate(y)
    tangent = curve.first_tangent(J)
    amplitude_place = int(np.argmax(np.abs(y[: equations.size - 1] / curve.scale[: equations.size - 1])))
    grows = tangent[amplitude_place] * np.sign(y[amplitude_place]) if growing else tangent[-1]
    return _Point(y, tangent if grows >= 0 else -tangent, F * curve.rows)


CLOSED = "the branch closes on itself"


class _Walker:
    """Walks along the curve from a point, in the direction of its tangent."""

    def __init__(
        self,
        curve: _Curve,
        interval: tuple[float, float],
        steps: tuple[float, float],
        max_points: int,
        families: bool,
        progress: Progress | None,
    ):
        self.curve, (self.lo, self.hi), (self.first_step, self.longest) = curve, interval, steps
        self.max_points, self.families, self.progress = max_points, families, progress

    def walk(self, first: _Point) -> tuple[list[_Point], str]:
        """Return the points and the reason for stopping."""
        points, length = [first], self.first_step
        while len(points) < self.max_points:
            here = points[-1]
            there, iterations = self.curve.step(here, length)
            if there is None or here.tangent @ there.tangent < WIDEST_TURN:
                length /= 2
                if length < SHORTEST:
                    return points, self._stuck(here)
                continue
            if self.progress:
                self.progress(float(there.y[-1]))
            reason = self._end(points, there)
            if reason:
                return points, reason
            points.append(there)
            length = min(length * (1.5 if iterations <= FEW else 0.6 if iterations >= MANY else 1.0), self.longest)
        return (
            points,
            f"the largest number of points, {self.max_points}, was reached; raise max_points to go on",
        )

    def _stuck(self, here: _Point) -> str:
        return (
            f"no further point found beyond {self._at(here)} with steps down to {SHORTEST:g}; more harmonics or a "
            "smaller tolerance on the way there may help"
        )

    def _at(self, point: _Point) -> str:
        problem = self.curve.problem
        return f"{problem.equations.system.parameter_names[problem.free[0]]} = {point.y[-1]:.6g}"

    def _end(self, points: list[_Point], there: _Point) -> str:
        """Return why the walk ends before ``there`` (a last point on the interval's end is added), or nothing."""
        here, value = points[-1], there.y[-1]
        if not self.lo <= value <= self.hi:
            bound = self.lo if value < self.lo else self.hi
            share = (bound - here.y[-1]) / (value - here.y[-1])
            across = np.append(np.zeros(len(here.y) - 1), 1.0)
            last, _ = self.curve.correct(np.append((here.y + share * (there.y - here.y))[:-1], bound), across)
            if last is not None and share > 1e-9:
                along = np.sign(last.tangent @ here.tangent)
                points.append(_Point(last.y, along * last.tangent, last.residual))
            return f"the end of the interval was reached, {self._at(points[-1])}"
        still = [abs(p.tangent[-1]) < VERTICAL for p in points[-PATIENCE:]]
        if not self.families and len(points) > PATIENCE and all(still):
            return f"{self._at(here)} does not vary along the branch: a family of cycles, as of a conservative system"
        beyond = self.curve.problem.violated(there.y)
        if any("cosine of harmonic 1 at its lower" in b for b in beyond):
            return f"the cycle shrinks to the equilibrium at {self._at(here)}"
        if beyond:
            return f"a bound was reached at {self._at(here)}: {', '.join(beyond)}"
        if len(points) > 10:
            start, gap = points[0], (there.y - points[0].y) / self.curve.scale
            stride = np.linalg.norm((there.y - here.y) / self.curve.scale)
            if np.linalg.norm(gap) < stride and start.tangent @ there.tangent > 0.9:
                points.append(start)
                return CLOSED
        return ""


def _fold(curve: _Curve, a: _Point, b: _Point) -> tuple[_Point, float] | None:
    """Locate the fold between two points, where the tangent has no component along the parameter.

    Returns the point and the error of the parameter's value, or None where there is no fold to locate.
    """
    if min(abs(a.tangent[-1]), abs(b.tangent[-1])) < VERTICAL:
        return None  # the parameter does not vary on one side: cycles of a linear or conservative system
    distance = float(a.tangent @ ((b.y - a.y) / curve.scale))
    found: dict[float, _Point] = {0.0: a, distance: b}

    def slope(length: float) -> float:
        if length not in found:
            point, _ = curve.step(a, length)
            if point is None:
                return float("nan")
            found[length] = point
        return float(found[length].tangent[-1])

    try:
        slope(float(brentq(slope, 0.0, distance, xtol=1e-12, rtol=1e-12)))
    except (ValueError, RuntimeError):
        return None
    point = found[min(found, key=lambda s: abs(found[s].tangent[-1]))]
    error = abs(float(point.tangent[-1])) * distance * float(curve.scale[-1])
    return point, max(error, 1e-12 * abs(float(point.y[-1])))
