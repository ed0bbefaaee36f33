"""How far the harmonics left out may move a fold."""

from __future__ import annotations

from dataclasses import replace

from hbbogie.collocation.method import Collocation, CollocationEquations
from hbbogie.critical.folds import fold
from hbbogie.deadline import time_is_over
from hbbogie.exact.critical import fold_near
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results.critical import Critical
from hbbogie.results.failure import FAILURES
from hbbogie.results.orbit import NOT_RESOLVED

NEAR = 0.1  # relative distance in frequency up to which another fold is the same
SLACK = 1e-3  # share of a distance from the exact fold by which its bound is larger
REST = 2.0  # bound in units of what twice the harmonics change: right where they leave no more than half of the error
ROUND_OFF = 1e-10  # share of the value that no comparison can tell
NONE = float("inf"), f"{NOT_RESOLVED}: neither more harmonics nor another method lead to this fold"


def with_error(system: System, critical: Critical, harmonics: int) -> Critical:
    """Return a fold with a bound of the error that the harmonics left out make in its value.

    Where the system is linear between switchings that is the distance from the fold in closed form. Elsewhere the
    conditions of optimality are solved with twice the harmonics, and the bound is twice the change; where that leads to
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
        finer = fold(equations, critical.orbit, critical.parameter, search=False)
    except FAILURES:
        return None
    if finer.extremum != critical.extremum or abs(finer.omega / critical.omega - 1) > NEAR:
        return None
    return share * abs(critical.value - finer.value), f"{what} to {finer.value:.12g}"
