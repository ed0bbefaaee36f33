"""Branches of cycles: pseudo-arclength continuation in one parameter, and all cycles at one of its values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.bifurcations import special_points
from hbbogie.branches.closed_form import exact_trace
from hbbogie.branches.collocated import collocated_trace
from hbbogie.branches.criticality import onset
from hbbogie.branches.cycle_curve import CycleCurve
from hbbogie.branches.first_cycle import first_cycle
from hbbogie.branches.motions import STATES, cycle_after
from hbbogie.branches.switching import first_beyond
from hbbogie.collocation.method import CollocationEquations
from hbbogie.deadline import time_is_over, time_limit
from hbbogie.errors import ModelError, door
from hbbogie.exact.method import ExactEquations
from hbbogie.methods.equations import Equations
from hbbogie.methods.level import within_level
from hbbogie.model.ranges import check_interval, check_start
from hbbogie.results import Branch, Orbit, SpecialPoint, Trajectory
from hbbogie.results.ending import Ending
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.arclength import advance, point_at, walk
from hbbogie.solving.curve import Point
from hbbogie.solving.family import at_its_amplitude, check_members
from hbbogie.solving.solvers import solve

Array = NDArray[np.float64]
Progress = Callable[[float], None]
SHORTEST = 1e-7  # step at which the continuation gives up
CAREFUL = 0.05  # longest first step from a Hopf point, in units of the usual one


@door(equations=(Equations, ExactEquations, CollocationEquations), start=(Orbit, SpecialPoint, *STATES), parameter=str)
def trace(
    equations: Equations | ExactEquations | CollocationEquations,
    start: Orbit | SpecialPoint | Trajectory | Mapping[str, float] | Array,
    parameter: str,
    interval: tuple[float, float],
    *,
    step: float = 0.02,
    longest: float = 0.3,
    max_points: int = 500,
    families: bool = True,
    stability: bool = True,
    tolerance: float = 1e-10,
    limit: float | None = None,
    progress: Progress | None = None,
) -> Branch:
    """Follow a branch of cycles over a parameter, around folds, in both directions from the start.

    Parameters
    ----------
    equations : Equations, ExactEquations or CollocationEquations
        In closed form step lengths are chosen from the curvature, every cycle is judged, and of the branch that begins
        at a pitchfork or a period doubling one half is followed: the other is its mirror image, or the same cycles. By
        collocation the tolerance is that given there, and a family ends after a few cycles.
    start : Orbit, SpecialPoint, Trajectory, mapping from name to value or ndarray
        A cycle on or near the branch, or a state: the motion from it leads to the cycle. From a Hopf point the branch
        is followed towards growing amplitude, beginning where a gap first closes if the system is linear until then;
        from a branch point the branch that crosses; from a pitchfork both asymmetric branches, through the symmetric
        cycle (the equations must keep even harmonics: ``HarmonicBalance(H, odd=False)``); from a period doubling the
        cycles of twice the period (give twice the harmonics: their first is half the frequency). From any other point
        its own branch is followed. Where the start is one of a family, as of a conservative system, the cycles with
        its amplitude are followed.
    parameter : str
        Name of the continuation parameter.
    interval : (float, float), unit of the parameter
        Where to stop.
    step, longest : float
        First and longest step in scaled arclength: one unit is the amplitude scale of the equations, or a
        quarter of the interval. At amplitudes above ten times their scale the
        longest is longer.
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
    limit : float, optional, s
        Time after which the branch ends with what was found, and says so in ``ends``.
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
    start = start if isinstance(start, Orbit | SpecialPoint) else cycle_after(equations.system, start)
    if not isinstance(equations, Equations):
        steps = step, longest, max_points
        with time_limit(limit):
            return _beside_the_waist(equations, start, parameter, (lo, hi), steps, stability, progress)
    return balanced_trace(
        equations,
        start,
        parameter,
        (lo, hi),
        step=step,
        longest=longest,
        max_points=max_points,
        families=families,
        stability=stability,
        tolerance=tolerance,
        limit=limit,
        progress=progress,
    )


def balanced_trace(
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
    limit: float | None = None,
    progress: Progress | None = None,
    unresolved: float = np.inf,
    doubts: bool = True,
) -> Branch:
    """Follow a branch of harmonic balance as `trace` does, up to cycles that the harmonics do not resolve.

    Parameters
    ----------
    unresolved : float
        Share of the highest harmonics beyond which the branch ends.
    doubts : bool
        Whether the status of a fold says why it may be none; the rest as of `trace`.
    """
    if not (0 < step <= longest) or max_points < 2:
        raise ModelError(f"trace: {step=}, {longest=}, {max_points=}; need 0 < step <= longest, 2 points.")
    if equations.phase is None:
        raise ModelError("trace: the equations are those of equilibria (harmonics 0); ask for at least one harmonic.")
    special = start if isinstance(start, SpecialPoint) else None
    origin = start.orbit if isinstance(start, SpecialPoint) else start
    moving = origin  # what moves in harmonic 1 sets the phase
    if special is not None and special.kind == "period doubling" and special.onward is not None:
        moving = special.onward
    equations = within_level(equations.phased(moving), origin)
    from_hopf = special is not None and special.kind == "hopf"
    begins = special is not None and (from_hopf or special.onward is not None)
    p = equations.system.vector()
    place = equations.system.parameter_names.index(parameter)
    p[place] = origin.parameters.get(parameter, p[place])
    check_start(parameter, float(p[place]), interval)
    given = equations
    if not begins:
        equations = at_its_amplitude(equations, origin, place, tolerance)
    curve = CycleCurve(equations, parameter, interval, p, tolerance, families, unresolved)
    options: dict[str, Any] = {"step": step, "longest": longest, "shortest": SHORTEST, "most": max_points}
    with time_limit(limit):
        found = _traced(curve, start, begins, (stability, doubts), options, progress)
    if equations is not given:
        check_members(given, found.orbits)
    return found


def _traced(
    curve: CycleCurve,
    start: Orbit | SpecialPoint,
    begins: bool,
    looks: tuple[bool, bool],
    options: dict[str, Any],
    progress: Progress | None,
) -> Branch:
    """Follow the curve from its start, and locate the special points; ``begins`` where nothing lies before.

    ``looks`` tells whether cycles are judged, and whether folds are looked at more closely.
    """
    equations, parameter, (stability, doubts) = curve.equations, curve.parameter, looks
    special = start if isinstance(start, SpecialPoint) else None
    from_hopf = special is not None and special.kind == "hopf"
    first, both = _begin(curve, start)
    if from_hopf:
        options["step"] = _careful(curve, first, CAREFUL * options["step"])

    def say(point: Point) -> None:
        if progress:
            progress(float(point.u[-1]))

    forward, end = walk(curve, first, stretch=curve.stretch, progress=say, **options)
    backward, beginning = [first], end
    if both and end.kind != "closed":
        backward, beginning = walk(curve, first.turned(), stretch=curve.stretch, progress=say, **options)
    elif not both:
        beginning = Ending("began", f"began here, at the {_name(start)}")
    points, place = [b.turned() for b in backward[:0:-1]] + forward, len(backward) - 1
    if end.kind == "closed":  # begin one point later, so that the start lies between two others, should it be special
        points = [*points[1:-1], points[1]]
    if special is not None and not begins and 0 < place < len(points) - 1:
        del points[place]  # its neighbours enclose it, and it is located anew
    judge = stability and not curve.vertical(points)
    if special is not None and from_hopf and judge:
        values = [float(point.u[-1]) for point in points[:2]]
        special = onset(special, equations.system.with_parameters(**{parameter: special.value}), values)
    known = {place: special} if special is not None and begins and judge else {}
    orbits, met = special_points(curve, points, judge=judge, known=known, doubts=doubts)
    if judge and time_is_over() and end.kind != "limit":
        end = Ending("limit", f"{end.what}, and not all cycles were judged before the time limit", "raise limit")
    return Branch(tuple(orbits), parameter, met, (_said(beginning), _said(end)))


def _beside_the_waist(
    equations: ExactEquations | CollocationEquations,
    start: Orbit | SpecialPoint,
    parameter: str,
    interval: tuple[float, float],
    steps: tuple[float, float, int],
    stability: bool,
    progress: Progress | None,
) -> Branch:
    """Follow a branch of equations that have a walk of their own."""
    if isinstance(equations, ExactEquations):
        return exact_trace(equations, start, parameter, interval, steps[-1])
    return collocated_trace(equations, start, parameter, interval, steps, stability, progress)


def _begin(curve: CycleCurve, start: Orbit | SpecialPoint) -> tuple[Point, bool]:
    """Return the first point, and whether the branch goes on to both sides of it."""
    if isinstance(start, Orbit):
        return _first_point(curve, start, curve.equations, growing=False), True
    if start.onward is not None:
        return first_beyond(curve, start)
    if start.kind == "hopf":
        return _first_point(curve, first_cycle(curve.equations, start), curve.equations, growing=True), False
    return _first_point(curve, start.orbit, curve.equations, growing=False), True


def _careful(curve: CycleCurve, first: Point, step: float) -> float:
    """Return a first step from a Hopf point over which the parameter does not turn.

    Where a gap first closes, a fold may follow as closely as the next gap.
    """
    onset, _ = advance(curve, first, SHORTEST)
    while onset is not None and step > 4 * SHORTEST:
        there, _ = advance(curve, first, step)
        if there is not None and onset.tangent[-1] * there.tangent[-1] > 0:
            break
        step /= 4
    return step


def _said(end: Ending) -> Ending:
    """Return an ending in the words of branches of cycles, with what to try."""
    if end.kind == "closed":
        return replace(end, what="the branch closes on itself")
    if end.kind == "points":
        return replace(end, advice="raise max_points to go on")
    if end.kind == "stuck":
        return replace(end, advice="more harmonics, or a start from a cycle beyond it, may help")
    return end


def _name(start: Orbit | SpecialPoint) -> str:
    kind = start.kind if isinstance(start, SpecialPoint) else "start"
    return "Hopf point" if kind == "hopf" else kind


def _first_point(curve: CycleCurve, orbit: Orbit, equations: Equations, growing: bool) -> Point:
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
    first = point_at(curve, y, curve.linearise(y).across())
    grows = first.tangent[equations.leading if growing and not equations.advance else -1]
    if growing and equations.advance:  # both waves of the first harmonic are unknowns
        pair = slice(i := equations.cosines[equations.phase or 0], i + 2)
        grows = y[pair] @ first.tangent[pair]
    return first if grows >= 0 else first.turned()
