"""Branches of exact cycles as plain data, and the cycles at which they cross a value of the parameter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.branches.criticality import onset
from hbbogie.exact.bifurcations import TURNS, Crossing, judged, multiplier_crossings
from hbbogie.exact.changes import sound
from hbbogie.exact.closing import Closing
from hbbogie.exact.folding import fold_of, gradients
from hbbogie.exact.method import ExactEquations
from hbbogie.exact.points import Point
from hbbogie.exact.starting import at_grazing, cycle_of, exact_cycle, orbit_of, settled
from hbbogie.exact.switching import onward
from hbbogie.exact.walk import TOLERANCE, Walk, follow
from hbbogie.model.ranges import check_start
from hbbogie.model.system import System
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.critical import Critical
from hbbogie.results.ending import Ending
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.orbit import Orbit

Array = NDArray[np.float64]

SAME = 1e-12  # relative distance of two values that are one
BEGINNING = ("pitchfork", "period doubling")  # special points at which another branch begins
MOST = 400  # points of a branch
REPEATS = 1e-6  # distance, relative to the largest value, up to which two halves of a period are one
ROUND_OFF = 1e-11  # relative error of an exact fold


def exact_walk(system: System, hopf: SpecialPoint, interval: tuple[float, float], most: int = MOST) -> Walk:
    """Follow the exact cycles of a Hopf point's branch from where they first touch a contact.

    Raises
    ------
    ModelError
        When the system is not linear between switchings.
    ConvergenceError
        When the linear cycles of the Hopf point touch nothing.
    """
    return follow(at_grazing(system, hopf), interval, most=most)


def exact_walk_through(
    system: System, orbit: Orbit, parameter: str, interval: tuple[float, float], most: int = MOST
) -> Walk:
    """Follow the exact cycles over a parameter in both directions from one of them, which an orbit is near.

    Raises
    ------
    ModelError
        When the system is not linear between switchings.
    ConvergenceError
        When the orbit leads to no exact cycle.
    """
    try:
        point = exact_cycle(system, orbit, parameter)
    except ConvergenceError:  # next to a fold
        point = exact_cycle(system, orbit, parameter, free=True)
    forward, backward = (follow(p, interval, most=most) for p in (point, point.turned()))
    return Walk([*(p.turned() for p in backward.points[:0:-1]), *forward.points], forward.end, backward.end)


def exact_trace(
    equations: ExactEquations, start: Orbit | SpecialPoint, parameter: str, interval: tuple[float, float], most: int
) -> Branch:
    """Follow a branch of exact cycles from a Hopf point, or in both directions from a cycle; see `trace`."""
    special = start if isinstance(start, SpecialPoint) else None
    first = start if special is None else special.onward or special.orbit
    origin = equations.at(first, parameter)  # type: ignore[arg-type]
    check_start(parameter, origin.parameters[parameter], interval)
    if special is not None and special.kind == "hopf":
        special = replace(special, orbit=origin)
        walk = exact_walk(equations.system, special, interval, most)
        there = equations.system.with_parameters(**{parameter: special.value})
        return exact_branch(walk, onset(special, there, [point.value for point in walk.points[:2]]))
    if special is not None and special.onward is not None:
        walk = exact_walk_beyond(equations.system, replace(special, onward=origin), interval, most)
    else:
        walk = exact_walk_through(equations.system, origin, parameter, interval, most)
    return _branch(walk.points, parameter, (), (walk.beginning, walk.end))


def exact_walk_beyond(system: System, special: SpecialPoint, interval: tuple[float, float], most: int = MOST) -> Walk:
    """Follow the exact cycles of the branch that begins at a special point away from it.

    Raises
    ------
    ConvergenceError
        When the first guess beyond the point leads to no cycle of that branch.
    """
    assert special.onward is not None  # asked for by the caller
    point = exact_cycle(system, special.onward, special.parameter)
    _check_left(point, special)
    away = point if point.direction * (point.value - special.value) > 0 else point.turned()
    began = f"began at the {special.kind} at {special.parameter} = {special.value:.9g}"
    began += "; its mirror image is another branch" if special.kind == "pitchfork" else ""
    return replace(follow(away, interval, most=most), beginning=Ending("began", began))


def _check_left(point: Point, special: SpecialPoint) -> None:
    """Raise `ConvergenceError` where a cycle lies on the branch of a special point, and not on that which begins there.

    A cycle of that branch goes on after half its period as before, at a pitchfork with the opposite sign.
    """
    sign = -1 if special.kind == "pitchfork" else 1
    first, second = np.split(cycle_of(point).at(fourier.phases(512)), 2)
    if np.abs(first - sign * second).max() <= REPEATS * np.abs(first).max():
        raise ConvergenceError(
            f"system {special.orbit.system!r}: from the {special.kind} at {special.parameter} = {special.value:.9g} "
            "the exact method comes back to the branch on which it lies; locate it with Exact().equations(system)."
        )


def exact_fold(equations: ExactEquations, guess: Orbit, parameter: str) -> Critical:
    """Return the fold near a cycle, solved for in closed form, with its gradient; see `fold`.

    Raises
    ------
    ConvergenceError
        When there is no fold near by.
    """
    return exact_critical(exact_cycle(equations.system, equations.at(guess, parameter), parameter, free=True))


def exact_critical(point: Point) -> Critical:
    """Return the fold near a point of a branch, with its gradient.

    Raises
    ------
    ConvergenceError
        When there is no fold near by.
    """
    system = point.closing.model.system
    parameter = system.parameter_names[point.closing.place]
    try:
        found = fold_of(point.closing, point.y[None])
    except np.linalg.LinAlgError:
        raise ConvergenceError(
            f"system {system.name!r}: the conditions of a fold are singular: the cycles do not depend on {parameter}; "
            "give another parameter."
        ) from None
    at = Point(found.closing, found.y[0], np.append(found.v[0], 0.0), found.at, "fold", 0.0)
    if not found.error[0] <= TOLERANCE or not sound(at):
        raise ConvergenceError(
            f"system {system.name!r}: no exact fold was found from the cycle at {parameter} = {point.value:g}; follow "
            "its branch with trace, and start from branch.folds()."
        )
    slopes = dict(zip(system.parameter_names, map(float, gradients(found)[0]), strict=True))
    slopes.pop(parameter)
    curvature = float(found.curvature[0])
    extremum = "minimum" if curvature > 0 else "maximum"
    return Critical(
        kind="fold",
        parameter=parameter,
        value=at.value,
        extremum=extremum,
        omega=at.omega,
        gradient=slopes,
        orbit=orbit_of(at),
        residual=float(found.error[0]),
        curvature=curvature,
        status=f"{extremum} of {parameter} over the cycles near by, solved for in closed form",
        error=ROUND_OFF * abs(at.value),
    )


def exact_branch(walk: Walk, hopf: SpecialPoint) -> Branch:
    """Return the points of a walk as orbits, with their multipliers, and the special ones among them."""
    start = f"the cycles of the Hopf point at {hopf.parameter} = {hopf.value:.6g} first touch a contact"
    return _branch(walk.points, hopf.parameter, (hopf,), (Ending("began", start), walk.end))


def _branch(
    points: list[Point], parameter: str, special: tuple[SpecialPoint, ...], ends: tuple[Ending, Ending]
) -> Branch:
    orbits = [orbit_of(point) for point in points]
    rows: list[tuple[float, Orbit, SpecialPoint | None]] = []
    for i, (point, orbit) in enumerate(zip(points, orbits, strict=True)):
        found = None
        if status := _said(points, i):
            kind = point.kind if point.kind in ("fold", "grazing") else "not located"
            extremum = ("minimum" if _turns_up(points, i) else "maximum") if kind == "fold" else ""
            ends_of = point.value, point.value
            found = SpecialPoint(kind, parameter, point.value, ends_of, orbit, status, extremum=extremum)
        rows.append((float(i), orbit, found))
    verdicts = [o.stability for o in orbits if o.stability is not None]
    for crossing in multiplier_crossings(points, verdicts):
        found = _special(crossing, parameter)
        rows.append((crossing.before + 0.5, found.orbit, found))
    rows.sort(key=lambda row: row[0])
    met = tuple(found for _, _, found in rows if found is not None)
    return Branch(tuple(orbit for _, orbit, _ in rows), parameter, (*special, *met), ends)


def _special(crossing: Crossing, parameter: str) -> SpecialPoint:
    """Return where multipliers cross the unit circle, with a first cycle of the branch that begins there."""
    ahead = onward(crossing.point) if crossing.kind in BEGINNING else None
    guess = None if ahead is None else orbit_of(ahead).replace(method=f"exact, next to a {crossing.kind}")
    value, orbit = crossing.point.value, orbit_of(crossing.point)
    return SpecialPoint(crossing.kind, parameter, value, crossing.interval, orbit, crossing.status, guess)


def exact_forks(walk: Walk, parameter: str) -> list[SpecialPoint]:
    """Return the special points of a walk at which other branches begin or cross."""
    met = multiplier_crossings(walk.points, [judged(point) for point in walk.points])
    return [_special(crossing, parameter) for crossing in met if crossing.kind in (*BEGINNING, "branch point")]


def _turns_up(points: list[Point], i: int) -> bool:
    """Tell whether the parameter is smallest at a fold."""
    beside = points[i - 1] if i else points[i + 1]
    return beside.value > points[i].value


def _said(points: list[Point], i: int) -> str:
    """Return what happens at a point of a branch, nothing where it is an ordinary one."""
    point = points[i]
    if point.kind == "fold":
        return f"{'smallest' if _turns_up(points, i) else 'largest'} value of the parameter, solved for"
    said = {
        "grazing": "a contact begins or ceases to close, solved for",
        "fold not located": "the branch turns here; its extremum was not found",
        "not located": "the order of the contacts changes near this point",
    }
    return said.get(point.kind, "")


def exact_crossings(walk: Walk, value: float) -> Iterator[tuple[int, Orbit]]:
    """Yield the cycles at a value of the parameter, each with the number of folds between it and the Hopf point."""
    part, points = 0, walk.points
    for here, there in pairwise(points):
        part += here.kind in TURNS
        if (here.value < value) != (there.value < value):
            yield part, orbit_of(_between(here, there, value))
        elif there is points[-1] and abs(there.value - value) <= SAME * abs(value):
            yield part, orbit_of(there)


def _between(here: Point, there: Point, value: float) -> Point:
    """Return the cycle between two points of a branch."""
    folds = [(point, other) for point, other in ((here, there), (there, here)) if point.kind == "fold"]
    for closing, y in _guesses(here, there, value):
        y[-1] = value / closing.frame.parameter[0]
        try:
            found = settled(closing, y)
        except ConvergenceError:
            continue
        # the two cycles beside a fold differ in frequency
        if all((found.omega - fold.omega) * (other.omega - fold.omega) > 0 for fold, other in folds):
            return found
    raise ConvergenceError(
        f"system {here.closing.model.system.name!r}: no exact cycle was found at {value:g} between those at "
        f"{here.value:g} and {there.value:g}; take another value, or harmonic balance."
    )


def _guesses(here: Point, there: Point, value: float) -> Iterator[tuple[Closing, Array]]:
    """Yield guesses of a cycle between two points: on the parabola about a fold, on a straight line, the points."""
    for point in (here, there):
        if point.kind == "fold":
            curvature = fold_of(point.closing, point.y[None]).curvature[0]
            rise = value / point.closing.frame.parameter[0] - point.y[-1]
            step = np.sqrt(max(2 * rise / curvature, 0.0)) * point.tangent
            yield from ((point.closing, point.y + sign * step) for sign in (1, -1))
    share = (value - here.value) / (there.value - here.value)
    if here.closing is there.closing:
        yield here.closing, here.y + share * (there.y - here.y)
    for point in (here, there) if share < 0.5 else (there, here):
        yield point.closing, point.y.copy()
