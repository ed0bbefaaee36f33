"""Branches of cycles: pseudo-arclength continuation in one parameter, and all cycles at a value of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.bifurcations import VERTICAL, special_points
from hbbogie.branches.criticality import onset
from hbbogie.branches.first_cycle import first_cycle
from hbbogie.branches.solution_curve import Curve, Point
from hbbogie.branches.switching import first_beyond
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.model.ranges import check_interval
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.solvers import solve

Array = NDArray[np.float64]
Progress = Callable[[float], None]
FEW, MANY = 3, 6  # Newton iterations that lengthen and shorten the step
WIDEST_TURN = 0.97  # cosine of the largest angle between successive tangents
SHORTEST = 1e-7  # step at which the continuation gives up
CAREFUL = 0.05  # first step from a Hopf point, in units of the usual one
SHRINKING = 1e-3  # longest step that may lead beyond a bound: longer ones may have jumped over what lies before it


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
    stability: bool = True,
    tolerance: float = 1e-10,
    progress: Progress | None = None,
) -> Branch:
    """Follow a branch of cycles over a parameter, around folds, in both directions from the start.

    Parameters
    ----------
    equations : Equations
    start : Orbit or SpecialPoint
        A cycle on or near the branch. From a Hopf point the branch is followed towards growing amplitude, beginning
        where a gap first closes if the system is linear until then; from a branch point the branch that crosses;
        from a pitchfork both asymmetric branches, through the symmetric cycle (the equations must keep even harmonics:
        ``HarmonicBalance(H, odd=False)``); from a period doubling the cycles of twice the period (give twice
        the harmonics: their first is half the frequency). From any other point its own branch is followed.
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
    stability : bool
        Whether to judge every cycle by its Floquet multipliers and locate what they and the contacts show; without,
        and in a family along which the parameter does not vary, only folds are located.
    tolerance : float
        Largest scaled residual of a point.
    progress : callable, optional
        Called with the parameter's value after each point.

    Returns
    -------
    Branch
        With the special points located, marked in ``special`` and put among the orbits, and the reason for each end
        in ``ends``.

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
    special = start if isinstance(start, SpecialPoint) else None
    origin = start.orbit if isinstance(start, SpecialPoint) else start
    equations = equations.phased(origin)
    from_hopf = special is not None and special.kind == "hopf"
    begins = special is not None and (from_hopf or special.onward is not None)
    p = equations.system.vector()
    place = equations.system.parameter_names.index(parameter)
    p[place] = origin.parameters.get(parameter, p[place])
    if not lo <= p[place] <= hi:
        raise ModelError(
            f"trace: the start has {parameter} = {p[place]:g}, outside the interval ({lo:g}, {hi:g}); widen it."
        )
    curve = Curve(equations, parameter, hi - lo, p, tolerance)
    if special is not None and special.onward is not None:
        first, both = first_beyond(curve, special)
    elif special is not None and from_hopf:
        first, both = _first_point(curve, first_cycle(equations, special), equations, growing=True), False
    else:
        first, both = _first_point(curve, origin, equations, growing=False), True
    # a fold may follow closely where a gap first closes
    begin = step * CAREFUL if from_hopf else step
    walker = _Walker(curve, (lo, hi), (begin, longest), max_points, families, progress)
    forward, end = walker.walk(first)
    backward, beginning = [first], "" if both else f"began here, at the {_name(start)}"
    if both and end != CLOSED:
        backward, beginning = walker.walk(first.turned())
    elif end == CLOSED:
        beginning = CLOSED
    points, place = [b.turned() for b in backward[:0:-1]] + forward, len(backward) - 1
    if end == CLOSED:  # begin one point later, so that the start lies between two others, should it be special
        points = [*points[1:-1], points[1]]
    if special is not None and not begins and 0 < place < len(points) - 1:
        del points[place]  # its neighbours enclose it, and it is located anew
    judge = stability and any(abs(point.tangent[-1]) >= VERTICAL for point in points)
    if special is not None and from_hopf and judge:
        special = onset(special, equations.system.with_parameters(**{parameter: special.value}), points)
    known = {place: special} if special is not None and begins and judge else {}
    orbits, met = special_points(curve, points, judge=judge, known=known)
    return Branch(tuple(orbits), parameter, met, (beginning, end))


def _name(start: Orbit | SpecialPoint) -> str:
    kind = start.kind if isinstance(start, SpecialPoint) else "start"
    return "Hopf point" if kind == "hopf" else kind


def _first_point(curve: Curve, orbit: Orbit, equations: Equations, growing: bool) -> Point:
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
    tangent = np.linalg.svd(J)[2][-1]
    size = equations.unknowns.index(f"{coordinate}, cosine of harmonic 1")
    grows = tangent[size] if growing else tangent[-1]
    return Point(y, tangent if grows >= 0 else -tangent, F * curve.rows)


CLOSED = "the branch closes on itself"


class _Walker:
    """Walks along the curve from a point, in the direction of its tangent."""

    def __init__(
        self,
        curve: Curve,
        interval: tuple[float, float],
        steps: tuple[float, float],
        max_points: int,
        families: bool,
        progress: Progress | None,
    ):
        self.curve, (self.lo, self.hi), (self.first_step, self.longest) = curve, interval, steps
        self.max_points, self.families, self.progress = max_points, families, progress

    def walk(self, first: Point) -> tuple[list[Point], str]:
        """Return the points and the reason for stopping."""
        points, length = [first], self.first_step
        while len(points) < self.max_points:
            here = points[-1]
            there, iterations = self.curve.step(here, length)
            beyond = there is not None and length > SHRINKING and bool(self.curve.problem.violated(there.y))
            if there is None or beyond or here.tangent @ there.tangent < WIDEST_TURN:
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

    def _stuck(self, here: Point) -> str:
        return (
            f"no further point found beyond {self._at(here)} with steps down to {SHORTEST:g}; more harmonics or a "
            "smaller tolerance on the way there may help"
        )

    def _at(self, point: Point) -> str:
        problem = self.curve.problem
        return f"{problem.equations.system.parameter_names[problem.free[0]]} = {point.y[-1]:.6g}"

    def _end(self, points: list[Point], there: Point) -> str:
        """Return why the walk ends before ``there`` (a last point on the interval's end is added), or nothing."""
        here, value = points[-1], there.y[-1]
        if not self.lo <= value <= self.hi:
            bound = self.lo if value < self.lo else self.hi
            share = (bound - here.y[-1]) / (value - here.y[-1])
            across = np.append(np.zeros(len(here.y) - 1), 1.0)
            last, _ = self.curve.correct(np.append((here.y + share * (there.y - here.y))[:-1], bound), across)
            if last is not None and share > 1e-9:
                along = np.sign(last.tangent @ here.tangent)
                points.append(Point(last.y, along * last.tangent, last.residual))
            return f"the end of the interval was reached, {self._at(points[-1])}"
        still = [abs(p.tangent[-1]) < VERTICAL for p in points[-PATIENCE:]]
        if not self.families and len(points) > PATIENCE and all(still):
            return f"{self._at(here)} does not vary along the branch: a family of cycles, as of a conservative system"
        beyond = self.curve.problem.violated(there.y)
        if any("cosine of harmonic 1 at its lower" in b for b in beyond):
            return f"the first harmonic vanishes at {self._at(here)}: an equilibrium, or a cycle of half the period"
        if beyond:
            return f"a bound was reached at {self._at(here)}: {', '.join(beyond)}"
        if len(points) > 10:
            start, gap = points[0], (there.y - points[0].y) / self.curve.scale
            stride = np.linalg.norm((there.y - here.y) / self.curve.scale)
            if np.linalg.norm(gap) < stride and start.tangent @ there.tangent > 0.9:
                points.append(start)
                return CLOSED
        return ""
