"""Branches of collocated cycles as plain data, and their folds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hbbogie.branches.criticality import onset
from hbbogie.branches.first_cycle import first_cycle
from hbbogie.collocation.cycle import cycle_again
from hbbogie.collocation.method import CollocationEquations
from hbbogie.collocation.rates import Rates
from hbbogie.collocation.special import Special, fold_near, judged
from hbbogie.collocation.starting import from_orbit
from hbbogie.collocation.switching import onward
from hbbogie.collocation.walk import Followed, follow
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.parts import is_odd
from hbbogie.model.ranges import check_interval, check_start
from hbbogie.model.system import System
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.critical import Critical
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.orbit import Orbit
from hbbogie.results.piecewise import PiecewisePolynomial
from hbbogie.stability.variation import check_orbit

BEGINNING = ("branch point", "pitchfork", "period doubling")  # special points at which another branch begins
NEARLY_ODD = 1e-5  # even harmonics, relative to the largest, of a symmetric cycle
SMALLEST = 1e-3  # amplitude of the first cycle from a Hopf point, relative to the mean of each coordinate
NEAR = (0.002, 0.05)  # shares of a fold's value, or of 1, over which it is looked for, in turn


def followed_from(
    equations: CollocationEquations,
    start: Orbit | SpecialPoint,
    parameter: str,
    interval: tuple[float, float],
    *,
    step: float = 0.05,
    longest: float = 0.5,
    max_points: int = 400,
    progress: Callable[[float], None] | None = None,
    before: Orbit | None = None,
    work: float = np.inf,
) -> Followed:
    """Follow the branch of cycles from an orbit or a special point; parameters and errors as of `trace`.

    Where an orbit ``before`` the start is given, the branch is followed away from it only; ``work`` limits the number
    of intervals of all points.
    """
    system = equations.system
    span = check_interval(system, parameter, interval)
    special = start if isinstance(start, SpecialPoint) else None
    from_hopf = special is not None and special.kind == "hopf"
    if special is not None and from_hopf:
        origin = _visible(first_cycle(HarmonicBalance(1).equations(system), special))
    else:
        origin = (start.onward or start.orbit) if isinstance(start, SpecialPoint) else start
    value = origin.parameters.get(parameter, system.values[parameter])
    check_start(parameter, value, span)
    guess = from_orbit(system, origin.replace(parameters={**system.values, parameter: value}))
    chosen = equations.collocation
    options = {"step": step, "longest": longest, "most": max_points, "progress": progress}
    return follow(
        guess,
        Rates(system, parameter),
        span,
        grows=from_hopf,
        before=None if before is None else from_orbit(system, before),
        work=work,
        degree=chosen.degree,
        tolerance=chosen.tolerance,
        **options,  # type: ignore[arg-type]
    )


def collocated_trace(
    equations: CollocationEquations,
    start: Orbit | SpecialPoint,
    parameter: str,
    interval: tuple[float, float],
    steps: tuple[float, float, int],
    stability: bool,
    progress: Callable[[float], None] | None,
) -> Branch:
    """Follow a branch and return it as plain data; ``steps`` are the first, the longest, and their largest number."""
    step, longest, most = steps
    followed = followed_from(
        equations, start, parameter, interval, step=step, longest=longest, max_points=most, progress=progress
    )
    return branch_of(followed, equations.system, start, stability=stability)


def _visible(small: Orbit) -> Orbit:
    """Return a small cycle about a mean in a size that is told from round-off."""
    c = small.coefficients.copy()
    size, mean = np.hypot(c[1], c[2]), np.abs(c[0])
    moving = size > 1e-6 * size.max()
    c[1:] *= max(1.0, float((SMALLEST * mean[moving] / size[moving]).max()))
    return small.replace(coefficients=c)


def branch_of(followed: Followed, system: System, start: Orbit | SpecialPoint, *, stability: bool = True) -> Branch:
    """Return a branch as orbits, the special points among them.

    Parameters
    ----------
    followed : Followed
    system : System
    start : Orbit or SpecialPoint
        Where it began; a Hopf point is the first of the special points.
    stability : bool
        Whether the orbits have their multipliers, and special points other than folds are looked for.
    """
    points = list(followed.points())
    parameter = points[0][0].parameter
    orbits = [judged(curve, point).orbit() for curve, point in points]
    if not stability:
        orbits = [orbit.replace(stability=None) for orbit in orbits]
    found = followed.special() if stability else followed.special(("fold",))
    met = [_special(s, system, parameter) for s in found]
    for s, special in reversed(list(zip(found, met, strict=True))):
        orbits.insert(s.place + 1, special.orbit)
    if isinstance(start, SpecialPoint) and start.kind == "hopf":
        at = system.with_parameters(**{parameter: start.value})
        met.insert(0, onset(start, at, followed.values.tolist()) if stability else start)
    return Branch(tuple(orbits), parameter, tuple(met), followed.ends)


def _special(found: Special, system: System, parameter: str) -> SpecialPoint:
    orbit, kind, status = found.cycle.orbit(), found.kind, found.status
    odd = system.odd or is_odd(system.dynamics, system.vector(**orbit.parameters))
    if kind == "branch point" and odd and orbit.is_odd(NEARLY_ODD):
        kind, status = "pitchfork", status.replace("another branch crosses", "the symmetry breaks")
    interval = found.value - found.error, found.value + found.error
    ahead = onward(found) if kind in BEGINNING else None
    guess = None if ahead is None else ahead.orbit().replace(method=f"collocation, next to a {kind}")
    return SpecialPoint(kind, parameter, found.value, interval, orbit, status, guess, extremum=found.extremum)


def collocated_forks(followed: Followed, system: System) -> list[SpecialPoint]:
    """Return the special points of a branch at which other branches begin or cross."""
    parameter = next(followed.points())[0].parameter
    return [_special(s, system, parameter) for s in followed.special(("branch point", "period doubling"))]


def collocated_fold(equations: CollocationEquations, guess: Orbit | SpecialPoint, parameter: str) -> Critical:
    """Return the fold nearest to a guess, with its gradient by the adjoint; parameters and errors as of `fold`."""
    system = equations.system
    orbit = guess.orbit if isinstance(guess, SpecialPoint) else guess
    value = orbit.parameters.get(parameter, system.values[parameter])
    check_orbit(system, orbit)
    here = orbit.replace(parameters={**system.values, parameter: value})
    low, high = system.parameter(parameter).bounds
    for share in NEAR:
        reach = share * max(abs(value), 1.0)
        span = max(value - reach, low), min(value + reach, high)
        near = cycle_again(system, here) if isinstance(here.motion, PiecewisePolynomial) else from_orbit(system, here)
        chosen = equations.collocation
        fold = fold_near(near, Rates(system, parameter), span, degree=chosen.degree, tolerance=chosen.tolerance)
        if fold is not None and span[0] <= fold.value <= span[1]:
            return collocated_critical(fold)
        followed = followed_from(equations, orbit, parameter, span)
        if folds := followed.special(("fold",)):
            return collocated_critical(min(folds, key=lambda s: abs(s.value - value)))
    raise ConvergenceError(
        f"no fold found within {reach:g} of {parameter} = {value:g} ({equations.method}); locate it first with "
        "trace, and start from branch.folds().",
        orbit,
    )


def collocated_critical(found: Special) -> Critical:
    """Return a fold located on a branch, with its gradient."""
    cycle, parameter = found.cycle, found.curve.parameter
    return Critical(
        kind="fold",
        parameter=parameter,
        value=found.value,
        extremum=found.extremum,
        omega=cycle.omega,
        gradient=found.gradient,
        orbit=cycle.orbit(),
        residual=cycle.residual,
        curvature=found.curvature,
        status=f"{found.extremum} of {parameter} over the cycles near by, {found.status}; {cycle.status}".rstrip("."),
        error=found.error + 2 * found.discretisation,
    )
