"""Folds between a Hopf point and the return of the branch to its value: cycles by growing amplitude.

Where the branch turns back in the parameter, the parameter is still a function V(a) of the amplitude. Near a fold that
the closing of a gap makes, a branch turns so sharply that a continuation by arclength takes many short steps, and V(a)
few.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.first_cycle import first_cycle
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.solving.newton import Conditions, Problem

Array = NDArray[np.float64]
FIRST, WIDEST, SHORTEST = 3e-3, 0.2, 1e-5  # steps of the amplitude, relative to itself
MOST = 100  # cycles after which the search ends
TOLERANCE = 1e-3  # scaled residual from which one more step of Newton's method is enough here
ITERATIONS = 8


@dataclass(frozen=True, eq=False)
class Ladder:
    """What was found along the amplitude.

    Attributes
    ----------
    folds : tuple of Orbit
        A cycle next to each fold.
    lowest : float, unit of the parameter
        Smallest value met.
    end : str
        Why the search ended.
    complete : bool
        Whether it went on until the parameter was back at the value of the Hopf point or left the interval.
    """

    folds: tuple[Orbit, ...]
    lowest: float
    end: str
    complete: bool


@dataclass(frozen=True)
class _Rung:
    """A cycle of an amplitude a: unknowns y and their derivative in a, whose last entry is V'(a)."""

    a: float
    y: Array
    slope: Array


def climb(equations: Equations, hopf: SpecialPoint, low: float, below: float = np.inf, narrow: float = 1e-5) -> Ladder:
    """Compute cycles of growing amplitude from a Hopf point until the parameter is back at its value there.

    Parameters
    ----------
    equations : Equations
    hopf : SpecialPoint
    low : float, unit of the parameter
        Value below which nothing is looked for.
    below : float, unit of the parameter
        Value above which folds are not located.
    narrow : float, dimensionless
        Width of the amplitude, relative, to which a fold is bracketed.
    """
    equations = equations.phased(hopf.orbit)
    start = first_cycle(equations, hopf)
    place = equations.system.parameter_names.index(hopf.parameter)
    p = equations.system.vector(**hopf.orbit.parameters)
    phase = equations.phase or 0
    smallest = start.first_harmonic(equations.system.coordinate_names[phase])
    problem = Problem(equations, Conditions((place,), phase), p, smallest)
    rungs = [_Rung(smallest, np.append(equations.encode(start), p[place]), np.zeros(len(problem.scale)))]
    folds: list[Orbit] = []
    step, end, complete = FIRST, "", False
    while not end:
        here = rungs[-1]
        there = _rung(problem, here, here.a * (1 + step))
        if there is None:
            step /= 3
            if step < SHORTEST:
                end = f"no cycle found beyond amplitude {here.a:.6g}"
            continue
        if len(rungs) > 1 and here.slope[-1] * there.slope[-1] < 0:
            reach = abs(here.slope[-1]) * (there.a - here.a)  # how far beyond both ends the fold may lie
            if min(here.y[-1], there.y[-1]) - reach < below:
                folds.append(_fold(problem, here, there, narrow))
        rungs.append(there)
        value = there.y[-1]
        if value >= hopf.value and there.slope[-1] >= 0:
            end, complete = f"the branch is back at {hopf.parameter} = {hopf.value:.6g}", True
        elif value < low:
            end, complete = f"the branch leaves the interval at {hopf.parameter} = {low:.6g}", True
        elif beyond := problem.violated(there.y):
            end = f"a bound was reached: {', '.join(map(str, beyond))}"
        elif len(rungs) > MOST:
            end = f"the branch is not back at the value of the Hopf point after {MOST} cycles"
        step = min(1.6 * step, WIDEST)
    return Ladder(tuple(folds), min(float(r.y[-1]) for r in rungs), end, complete)


def _rung(problem: Problem, near: _Rung, a: float) -> _Rung | None:
    """Return the cycle of an amplitude by Newton's method from a smaller one, None where that fails."""
    rows = np.append(problem.equations.residual_scale, a)
    problem.target = a
    grown = np.zeros(len(rows))
    grown[-1] = 1 / a
    y = near.y + (a - near.a) * near.slope
    for _ in range(ITERATIONS):
        F, J = problem.evaluate(y)
        if not np.isfinite(F).all():
            return None
        try:
            steps = np.linalg.solve(J / rows[:, None] * problem.scale, np.stack([F / rows, grown], axis=1))
        except np.linalg.LinAlgError:
            return None
        y = y - problem.scale * steps[:, 0]
        if np.abs(F / rows).max() <= TOLERANCE:
            return _Rung(a, y, problem.scale * steps[:, 1])
    return None


def _fold(problem: Problem, a: _Rung, b: _Rung, narrow: float) -> Orbit:
    """Return a cycle next to the fold between two rungs, by bisection: the slope may jump there."""
    while b.a - a.a > narrow * a.a:
        middle = _rung(problem, a, (a.a + b.a) / 2)
        if middle is None:
            break
        a, b = (middle, b) if middle.slope[-1] * a.slope[-1] > 0 else (a, middle)
    near = a if abs(a.slope[-1]) < abs(b.slope[-1]) else b
    return problem.orbit(near.y, "next to a fold")
