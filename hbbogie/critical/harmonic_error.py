"""How far the harmonics left out may move a fold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.method import Collocation, CollocationEquations
from hbbogie.critical.folds import fold
from hbbogie.deadline import time_is_over
from hbbogie.exact.critical import fold_near
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.critical import Critical
from hbbogie.results.failure import FAILURES
from hbbogie.results.orbit import NOT_RESOLVED
from hbbogie.solving.newton import Conditions, Problem

Array = NDArray[np.float64]
FIRST_STRIDE, LONGEST_STRIDE = 1e-3, 0.1  # along the curve, scaled
STRIDES, CORRECTIONS = 15, 12
MET = 1e-11  # largest scaled residual of a point of the curve
CLOSE = 1e-10  # change of the parameter up to which a fold is met, relative to its value

NEAR = 0.1  # relative distance in frequency up to which another fold is the same
SLACK = 1e-3  # share of a distance from the exact fold by which its bound is larger
REST = 2.0  # bound in units of what twice the harmonics change: right where they leave no more than half of the error
ROUND_OFF = 1e-10  # share of the value that no comparison can tell
NONE = float("inf"), f"{NOT_RESOLVED}: neither more harmonics nor another method lead to this fold"


def with_error(system: System, critical: Critical, harmonics: int) -> Critical:
    """Return a fold with a bound of the error that the harmonics left out make in its value.

    Where the system is linear between switchings that is the distance from the fold in closed form. Elsewhere the
    fold is located with twice the harmonics, and the bound is twice the change; where that leads to
    no such fold, by collocation. A fold that neither of them has is not resolved.

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
    finer = 2 * harmonics + 1
    error, said = (
        _from_exact(system, critical)
        or bound_from(HarmonicBalance(finer).equations(system), critical, REST, f"{finer} harmonics lead")
        or bound_from(Collocation().equations(system), critical, 1 + SLACK, "collocation leads")
        or NONE
    )
    error += ROUND_OFF * abs(critical.value)
    return replace(critical, error=error, status=f"{critical.status}; {said}")


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


def bound_from(
    equations: Equations | CollocationEquations, critical: Critical, share: float, what: str
) -> tuple[float, str] | None:
    """Return a share of the distance from the fold of other equations and what leads to it, None where nothing does."""
    if time_is_over():
        return None
    try:
        finer = (
            fold_value(equations, critical.orbit, critical.parameter)
            if isinstance(equations, Equations)
            else _fold_on_mesh(equations, critical)
        )
    except FAILURES:
        return None
    if finer is None:
        return None
    value, omega, extremum = finer
    if extremum != critical.extremum or abs(omega / critical.omega - 1) > NEAR:
        return None
    return share * abs(critical.value - value), f"{what} to {value:.12g}"


def _fold_on_mesh(equations: CollocationEquations, critical: Critical) -> tuple[float, float, str]:
    found = fold(equations, critical.orbit, critical.parameter, search=False)
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
    place, equations = equations.system.parameter_names.index(parameter), equations.phased(orbit)
    p = equations.system.vector(**{parameter: orbit.parameters[parameter]})
    problem = Problem(equations, Conditions((place,)), p)
    y, tangent = np.append(equations.encode(orbit), p[place]), None
    stride, before = FIRST_STRIDE, None
    for _ in range(STRIDES):
        corrected = _corrected(problem, y, tangent)
        if corrected is None:
            return None
        y, tangent = corrected
        slope = float(tangent[-1])
        if before is not None:
            growth = (slope - before) / stride  # of the slope along the curve
            if growth == 0:
                return None
            stride = -slope / growth
            if abs(slope * stride * problem.scale[-1]) <= CLOSE * abs(y[-1]):
                value = float(y[-1] + 0.5 * slope * stride * problem.scale[-1])
                return value, equations.decode(y[:-1], p, "").omega, "minimum" if growth > 0 else "maximum"
            stride = float(np.clip(stride, -LONGEST_STRIDE, LONGEST_STRIDE))
        before = slope
        y = y + stride * problem.scale * tangent
    return None


def _corrected(problem: Problem, y: Array, along: Array | None) -> tuple[Array, Array] | None:
    """Return the point of the curve across a direction, and the tangent there, in scaled unknowns; None where lost."""
    for _ in range(CORRECTIONS):
        F, J = problem.evaluate(y)
        F, J = F / problem.row_scale, J / problem.row_scale[:, None] * problem.scale
        if not np.isfinite(J).all():
            return None
        row = np.linalg.svd(J)[2][-1] if along is None else along
        right = np.zeros((len(y), 2))
        right[:-1, 0], right[-1, 1] = -F, 1.0
        try:
            step, tangent = np.linalg.solve(np.vstack([J, row]), right).T
        except np.linalg.LinAlgError:
            return None
        tangent = tangent / np.linalg.norm(tangent)
        if np.abs(F).max() <= MET:
            return y, tangent
        y = y + problem.scale * step
    return None
