"""How far a fold of one method lies from that of another, and whether it is there at all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.collocated import collocated_fold
from hbbogie.branches.cycle_curve import CycleCurve
from hbbogie.branches.resolution import meeting
from hbbogie.collocation.method import CollocationEquations
from hbbogie.deadline import time_is_over
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.critical import Critical
from hbbogie.results.failure import FAILURES
from hbbogie.results.orbit import NOT_RESOLVED
from hbbogie.solving.arclength import advance, correct

Array = NDArray[np.float64]
Fold = tuple[float, float, str]  # value, frequency [rad/s] and extremum
FIRST_STRIDE, LONGEST_STRIDE = 1e-3, 0.1  # along the curve, scaled
STRIDES = 15
MET = 1e-11  # largest scaled residual of a point of the curve
CLOSE = 1e-10  # change of the parameter up to which a fold is met, relative to its value

NEAR = 0.1  # relative distance in frequency up to which another fold is the same
REST = 2.0  # bound in units of what more harmonics change: right where they leave no more than half of the error
FINE = 1e-6  # share of the highest harmonics up to which others change nothing


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


def bound_from(
    equations: Equations | CollocationEquations,
    critical: Critical | SpecialPoint,
    share: float,
    what: str,
    otherwise: Callable[[Equations], Fold] | None = None,
) -> tuple[float, str] | None:
    """Return a share of the distance from the fold of other equations and what leads to it, None where nothing does.

    Parameters
    ----------
    equations : Equations or CollocationEquations
    critical : Critical or SpecialPoint
        The fold.
    share : float
    what : str
        Of the equations, with a verb.
    otherwise : callable, optional
        Gives the fold of harmonic balance where the secant method leads to none.
    """
    if time_is_over():
        return None
    found: Fold | None
    try:
        if isinstance(equations, CollocationEquations):
            found = _fold_on_mesh(equations, critical)
        elif (found := fold_value(equations, critical.orbit, critical.parameter)) is None and otherwise is not None:
            found = otherwise(equations)
    except FAILURES:
        return None
    if found is None:
        return None
    value, omega, extremum = found
    if extremum != critical.extremum or abs(omega / critical.omega - 1) > NEAR:
        return None
    return share * abs(critical.value - value), f"{what} to {value:.12g}"


def _fold_on_mesh(equations: CollocationEquations, critical: Critical | SpecialPoint) -> Fold:
    found = collocated_fold(equations, critical.orbit, critical.parameter)
    return found.value, found.omega, found.extremum


def fold_value(equations: Equations, orbit: Orbit, parameter: str) -> Fold | None:
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
