"""How far the harmonics left out may move a fold."""

from __future__ import annotations

from dataclasses import replace

from hbbogie.branches.fold_error import NEAR, REST, Fold, bound_from
from hbbogie.collocation.method import Collocation
from hbbogie.critical.folds import fold
from hbbogie.deadline import time_is_over
from hbbogie.exact.critical import fold_near
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results.critical import Critical
from hbbogie.results.failure import FAILURES
from hbbogie.results.orbit import NOT_RESOLVED

SLACK = 1e-3  # share of a distance from the exact fold by which its bound is larger
COARSE = 9  # harmonics, at most, from which on the changes of the value are compared
SETTLED = 400.0  # ratio of successive changes beyond which the last one may be small by chance
ROUND_OFF = 1e-10  # share of the value that no comparison can tell
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

    def solved(equations: Equations) -> Fold:
        found = fold(equations, critical.orbit, critical.parameter, search=False)
        return found.value, found.omega, found.extremum

    def change(H: int, share: float = REST) -> tuple[float, str] | None:
        return bound_from(HarmonicBalance(H).equations(system), critical, share, f"{H} harmonics lead", solved)

    found = change(2 * harmonics + 1)
    if found is None:
        return None
    coarse = change(min(COARSE, (harmonics + 1) // 2), 1.0)
    if coarse is not None and found[0] >= coarse[0] / SETTLED:
        return found
    return max(found, change(3 * harmonics + 2) or found)
