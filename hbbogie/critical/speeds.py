"""All critical values of a parameter over an interval, without a guess."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import extent
from hbbogie.branches.resolution import doubt_at_fold
from hbbogie.critical.folds import fold
from hbbogie.critical.hopf_gradients import hopf_gradient
from hbbogie.equilibria.census import Start
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door
from hbbogie.exact.critical import fold_near
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.results.branch import SpecialPoint
from hbbogie.results.critical import Critical, CriticalValues
from hbbogie.results.failure import FAILURES, ConvergenceError

BEYOND = 0.5  # share of the interval by which Hopf points are looked for beyond its ends
NEAR = 0.1  # relative distance in frequency up to which a fold in closed form is the same
SAME = 1e-7  # relative distance in value and frequency below which two points are one
COARSE = 15  # highest harmonic with which branches are traced in search of folds


@door(system=System, parameter=str)
def critical_speeds(
    system: System,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
    *,
    harmonics: int = 21,
    start: Start | None = None,
    **values: float,
) -> CriticalValues:
    """Find the critical values of a parameter, without a guess: Hopf points and the folds of their branches.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), optional, unit of the parameter
        Where to look; twice the parameter's value (at least 1) to either side, within its bounds, where left out.
    harmonics : int
        Highest harmonic of the folds; the branches that lead to them are traced with 15 at most.
    start : Orbit, Trajectory, mapping from name to value or sequence of float, optional
        A state: only Hopf points of the equilibrium near it, and their branches, are looked at.
    **values : float
        Parameter values, by name.

    Returns
    -------
    CriticalValues : list of Critical
        In increasing order of the value. The list carries ``evidence``: equilibria, the branches followed and why each
        ended. The error of a fold is its distance from the fold in closed form where the
        system is linear between switchings, else an estimate, if there are more than 15 harmonics; its status says
        which. Folds on branches that reach no Hopf point in the interval, or up to half
        of it beyond its ends, are not among them.

    Raises
    ------
    ModelError
        For wrong names or values.
    """
    system = system.with_parameters(**values)
    if harmonics == 0:
        raise ModelError("critical_speeds: harmonics=0; give a whole number from 1.")
    lo, hi = check_interval(system, parameter, interval)
    # the branch of a fold inside may begin at a Hopf point beyond the end
    around = lo - BEYOND * (hi - lo), hi + BEYOND * (hi - lo)
    span = check_interval(system, parameter, around)
    coarse, fine = (HarmonicBalance(H).equations(system) for H in (min(harmonics, COARSE), harmonics))
    found: list[Critical] = []
    located: list[SpecialPoint] = []
    points = hopf_points(system, parameter, span, start=start)
    evidence = list(points.evidence)
    for hopf in points:
        name = f"the branch from the Hopf point at {parameter} = {hopf.value:.9g}"
        if lo <= hopf.value <= hi:
            found.append(hopf_gradient(system, hopf))
        try:
            branch = trace(coarse, hopf, parameter, span, families=False, stability=False)
        except (ConvergenceError, ModelError) as error:  # no cycle of the kept harmonics begins here
            evidence.append(f"{name} was not followed: {error}")
            continue
        evidence.append(extent(name, branch))
        # a branch between two Hopf points is traced from both
        located += [new for new in branch.folds() if not any(coincide(new, other) for other in located)]
    for special in located:
        critical = _refined(system, _polished(fine, special), special, harmonics)
        if lo <= critical.value <= hi and not any(coincide(critical, other) for other in found):
            found.append(critical)
    return CriticalValues(sorted(found, key=lambda c: c.value), evidence)


def _polished(equations: Equations, special: SpecialPoint) -> Critical:
    """Return the fold of a branch with its gradient; without one where that does not converge."""
    try:
        return fold(equations, special, special.parameter)
    except ConvergenceError as error:
        status, orbit = f"located along the branch, {special.status}; no gradient: {error}", special.orbit
        value, extremum, omega, nan = special.value, special.extremum, special.omega, float("nan")
        return Critical(
            kind="fold",
            parameter=special.parameter,
            value=value,
            extremum=extremum,
            omega=omega,
            gradient={},
            orbit=orbit,
            residual=orbit.residual,
            curvature=nan,
            status=status,
        )


def _refined(system: System, critical: Critical, special: SpecialPoint, harmonics: int) -> Critical:
    """Return a fold with the error of harmonics left out, and with twice as many where its cycle is not resolved.

    The error is the distance from the fold in closed form, where there is one, else from one of fewer harmonics.
    """
    exact = _closed_form(system, critical)
    if exact is not None:
        return exact
    coarse = special.value if harmonics > COARSE else None
    before, doubt = COARSE, doubt_at_fold(system, critical.orbit)
    if doubt:
        H = 2 * harmonics + 1
        try:
            finer = fold(HarmonicBalance(H).equations(system), critical.orbit, critical.parameter, search=False)
        except FAILURES:
            return replace(critical, status=f"{critical.status}; {doubt}, there is no such fold near by with {H}")
        coarse, before, critical = critical.value, harmonics, finer
        critical = replace(critical, status=f"{critical.status}; with {H} harmonics")
        doubt = doubt_at_fold(system, critical.orbit)
    status = critical.status + (f"; {doubt}" if doubt else "")
    if coarse is None:
        return replace(critical, status=status)
    status += f"; error estimated from {before} harmonics, which is no bound"
    return replace(critical, error=abs(critical.value - coarse), status=status)


def _closed_form(system: System, critical: Critical) -> Critical | None:
    """Return a fold with its distance from the one in closed form; None where there is none."""
    if critical.extremum != "minimum":
        return None
    try:
        exact = fold_near(system, critical.orbit, critical.parameter)
    except (ConvergenceError, ModelError):  # not linear between switchings, or too far away
        return None
    if abs(exact.omega / critical.omega - 1) > NEAR:
        return None
    status = f"{critical.status}; the fold in closed form lies at {exact.value:.12g}"
    return replace(critical, error=abs(critical.value - exact.value), status=status)


def coincide(a: Critical | SpecialPoint, b: Critical | SpecialPoint) -> bool:
    """Tell whether two points are one: of one kind, and the same in value and frequency."""
    pairs: tuple[tuple[Any, Any], ...] = ((a.value, b.value), (a.omega, b.omega))
    return a.kind == b.kind and all(abs(x - y) <= SAME * max(abs(x), abs(y)) for x, y in pairs)
