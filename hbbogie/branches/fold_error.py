"""How far the harmonics left out may move a fold, and whether it is there at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.collocated import collocated_fold
from hbbogie.branches.cycle_curve import CycleCurve
from hbbogie.branches.resolution import meeting
from hbbogie.collocation.method import Collocation, CollocationEquations
from hbbogie.deadline import time_is_over
from hbbogie.exact.critical import fold_near
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.critical import Critical
from hbbogie.results.failure import FAILURES
from hbbogie.results.orbit import NOT_RESOLVED
from hbbogie.solving.arclength import advance, correct

Array = NDArray[np.float64]
FIRST_STRIDE, LONGEST_STRIDE = 1e-3, 0.1  # along the curve, scaled
STRIDES = 15
MET = 1e-11  # largest scaled residual of a point of the curve
CLOSE = 1e-10  # change of the parameter up to which a fold is met, relative to its value

NEAR = 0.1  # relative distance in frequency up to which another fold is the same
SLACK = 1e-3  # share of a distance from the exact fold by which its bound is larger
REST = 2.0  # bound in units of what more harmonics change: right where they leave no more than half of the error
COARSE = 9  # harmonics, at most, from which on the changes of the value are compared
SETTLED = 400.0  # ratio of successive changes beyond which the last one may be small by chance
ROUND_OFF = 1e-10  # share of the value that no comparison can tell
FINE = 1e-6  # share of the highest harmonics up to which others change nothing
NONE = float("inf"), f"{NOT_RESOLVED}: neither more harmonics nor another method lead to this fold"


def with_error(system: System, critical: Critical, harmonics: int) -> Critical:
    """Return a fold with a bound of the error that the harmonics left out make in its value.

    Where the system is linear between switchings that is the distance from the fold in closed form. Elsewhere the
    fold is located with twice the harmonics, and the bound is twice the change, see `bound_by_harmonics`; where that
    leads to no such fold, by collocation. A fold that neither of them has is not resolved.

    Parameters
    ----------
    system : System
    critical : Critical
        A fold.
    harmonics : int
        With which it was found.
    """
    if time_is_over():
        return replace(critical, error=float("inf"), status=f"{critical.status}; its error was not bounded in time")
    error, said = (
        _from_exact(system, critical)
        or bound_by_harmonics(system, critical, harmonics)
        or bound_from(Collocation().equations(system), critical, 1 + SLACK, "collocation leads")
        or NONE
    )
    error += ROUND_OFF * abs(critical.value)
    return replace(critical, error=error, status=f"{critical.status}; {said}")


def doubt_on_branch(system: System, special: SpecialPoint) -> str:
    """Return why a fold along a branch of harmonic balance may be none, the end of a sentence; empty where it is one.

    Where its multipliers do not tell, and the highest harmonics are of some size, twice the harmonics must lead to it.
    """
    doubt, sure = meeting(system, special.orbit)
    if doubt or sure or special.orbit.tail <= FINE or time_is_over():
        return doubt
    finer = 2 * special.orbit.H + 1
    if bound_from(HarmonicBalance(finer).equations(system), special, REST, ""):
        return ""
    return f"{NOT_RESOLVED}: {finer} harmonics do not lead to this fold; take more harmonics"


def _from_exact(system: System, critical: Critical) -> tuple[float, str] | None:
    """Return the bound by the fold in closed form and what it is, None where there is none near by."""
    if critical.extremum != "minimum":
        return None
    try:
        exact = fold_near(system, critical.orbit, critical.parameter)
    except FAILURES:  # not linear between switchings, or too far away
        return None
    if abs(exact.omega / critical.omega - 1) > NEAR:
        return None
    return (1 + SLACK) * abs(critical.value - exact.value), f"the fold in closed form lies at {exact.value:.12g}"


def bound_by_harmonics(system: System, critical: Critical, harmonics: int) -> tuple[float, str] | None:
    """Return twice what twice the harmonics change in a fold and what leads to it, None where they have no such fold.

    Where that is very little beside the change from half of the harmonics, or these have no such fold, two errors may
    be alike by chance: then the larger of the changes by twice and by three times the harmonics counts.

    Parameters
    ----------
    system : System
    critical : Critical
        A fold.
    harmonics : int
        With which it was found.
    """

    def change(H: int, share: float = REST) -> tuple[float, str] | None:
        return bound_from(HarmonicBalance(H).equations(system), critical, share, f"{H} harmonics lead")

    found = change(2 * harmonics + 1)
    if found is None:
        return None
    coarse = change(min(COARSE, (harmonics + 1) // 2), 1.0)
    if coarse is not None and found[0] >= coarse[0] / SETTLED:
        return found
    return max(found, change(3 * harmonics + 2) or found)


def bound_from(
    equations: Equations | CollocationEquations, critical: Critical | SpecialPoint, share: float, what: str
) -> tuple[float, str] | None:
    """Return a share of the distance from the fold of other equations and what leads to it, None where nothing does."""
    if time_is_over():
        return None
    try:
        finer = None
        if isinstance(equations, Equations):
            finer = fold_value(equations, critical.orbit, critical.parameter)
        value, omega, extremum = finer or _fold_of(equations, critical)
    except FAILURES:
        return None
    if extremum != critical.extremum or abs(omega / critical.omega - 1) > NEAR:
        return None
    return share * abs(critical.value - value), f"{what} to {value:.12g}"


def _fold_on_mesh(equations: CollocationEquations, critical: Critical | SpecialPoint) -> tuple[float, float, str]:
    found = collocated_fold(equations, critical.orbit, critical.parameter)
    return found.value, found.omega, found.extremum


def fold_value(equations: Equations, orbit: Orbit, parameter: str) -> tuple[float, float, str] | None:
    """Return value, frequency and kind of extremum of the fold near a cycle, without second derivatives.

    Along the curve of cycles the slope of the parameter is brought to zero by the secant method. The value is at its
    extremum there, so that its error goes with the square of what is left.

    Parameters
    ----------
    equations : Equations
        Of harmonic balance.
    orbit : Orbit
    parameter : str

    Returns
    -------
    tuple of float [unit of the parameter], float [rad/s] and {"minimum", "maximum"}, or None
        None where the iteration leads to no fold.
    """
    equations, value = equations.phased(orbit), orbit.parameters[parameter]
    size, p = abs(value) or 1.0, equations.system.vector(**{parameter: value})
    curve = CycleCurve(equations, parameter, (value - 2 * size, value + 2 * size), p, MET)
    u = np.append(equations.encode(orbit), value)
    point, _ = correct(curve, u, np.linalg.svd(curve.evaluate(u)[1])[2][-1])
    stride, before = FIRST_STRIDE, None
    for _ in range(STRIDES):
        if point is None:
            return None
        slope = float(point.tangent[-1])
        if before is not None:
            growth = (slope - before) / stride  # of the slope along the curve
            if growth == 0:
                return None
            stride = -slope / growth
            rest = slope * stride * curve.scale[-1]
            if abs(rest) <= CLOSE * abs(point.u[-1]):
                omega = float(equations.frequency(point.u[:-1]))
                return float(point.u[-1] + 0.5 * rest), omega, "minimum" if growth > 0 else "maximum"
            stride = float(np.clip(stride, -LONGEST_STRIDE, LONGEST_STRIDE))
        before = slope
        point, _ = advance(curve, point, stride)
    return None
