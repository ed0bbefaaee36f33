"""Branches of exact cycles as plain data, and the cycles at which they cross a value of the parameter."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing
from hbbogie.exact.folding import fold_of
from hbbogie.exact.points import Point
from hbbogie.exact.starting import at_grazing, orbit_of, settled
from hbbogie.exact.walk import Walk, follow
from hbbogie.model.system import System
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.ending import Ending
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.orbit import Orbit

Array = NDArray[np.float64]

SAME = 1e-12  # relative distance of two values that are one
TURNS = ("fold", "fold not located")


def exact_walk(system: System, hopf: SpecialPoint, interval: tuple[float, float]) -> Walk:
    """Follow the exact cycles of a Hopf point's branch from where they first touch a contact.

    Raises
    ------
    ModelError
        When the system is not linear between switchings.
    ConvergenceError
        When the linear cycles of the Hopf point touch nothing.
    """
    return follow(at_grazing(system, hopf), interval)


def exact_branch(walk: Walk, hopf: SpecialPoint) -> Branch:
    """Return the points of a walk as orbits, with their multipliers, and the special ones among them."""
    orbits = tuple(map(orbit_of, walk.points))
    special = [hopf]
    for i, (point, orbit) in enumerate(zip(walk.points, orbits, strict=True)):
        if status := _said(walk, i):
            kind = point.kind if point.kind in ("fold", "grazing") else "not located"
            special.append(SpecialPoint(kind, hopf.parameter, point.value, (point.value, point.value), orbit, status))
    start = f"the cycles of the Hopf point at {hopf.parameter} = {hopf.value:.6g} first touch a contact"
    return Branch(orbits, hopf.parameter, tuple(special), (Ending("began", start), walk.end))


def _said(walk: Walk, i: int) -> str:
    """Return what happens at a point of a walk, nothing where it is an ordinary one."""
    point = walk.points[i]
    if point.kind == "fold":
        return f"{'smallest' if walk.points[i - 1].direction < 0 else 'largest'} value of the parameter, solved for"
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
