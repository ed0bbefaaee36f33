"""What confirms a cycle where a system has many states: more harmonics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.branches.same import alike, of_prime_period, peaks_near
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.model.turns import turns_of
from hbbogie.results import Orbit
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet

Array = NDArray[np.float64]
ORDERS = (15, 31, 63)  # highest harmonics tried in turn
CONVERGED = 1e-3  # change of the frequency with more harmonics of a cycle that they confirm
LOPSIDED = 0.05  # mean and even harmonics of the recurrence of a motion, relative to the largest, that may be none
ROUGHLY = (5e-3, 1e-2)  # shares of harmonics that are none in the recurrence of a motion, see `of_prime_period`
MOVING = 1e-8  # peak of a coordinate, relative to the largest, from which its waveform counts


def by_harmonics(system: System, orbit: Orbit, known: Sequence[Orbit] = ()) -> Orbit:
    """Return the cycle near an orbit with so many harmonics that twice as many hardly change it, with its verdict.

    Its errors are its changes with the last doubling of the harmonics. One of those ``known`` is given as it is.

    Raises
    ------
    ConvergenceError
        Where the balance has no solution, or goes on changing.
    """
    last, cycle = None, _if_odd(system, of_prime_period(orbit, turns_of(system.dynamics), *ROUGHLY))
    at: dict[str, Any] = dict(orbit.parameters)
    for H in ORDERS:
        coarse, cycle = cycle, solve(HarmonicBalance(H).equations(system), cycle, method="newton", **at)
        last = None if ORDERS[0] == H else coarse
        if last is None or abs(cycle.omega / last.omega - 1) > CONVERGED:
            continue
        if (same := next((one for one in known if alike(one, cycle)), None)) is not None:
            return same
        stability = floquet(system, cycle)
        if stability.verdict != "unknown" or ORDERS[-1] == H:
            status = f"{cycle.status}; {last.H} harmonics give the frequency within {abs(cycle.omega - last.omega):.1e}"
            return cycle.replace(stability=stability, errors=_errors(cycle, last), status=f"{status} rad/s")
    raise ConvergenceError(f"{ORDERS[-1]} harmonics do not resolve the cycle", orbit=cycle)


def come_to(system: System, recurrence: Orbit, least: float) -> Orbit | None:
    """Return the cycle, if it is not unstable, that harmonics confirm near the recurrence of a motion; else None.

    Parameters
    ----------
    system : System
    recurrence : Orbit
        Of one period or some.
    least : float
        Range of a coordinate, relative to the largest of all, up to which it does not count.
    """
    try:
        cycle = by_harmonics(system, recurrence)
    except FAILURES:
        return None
    times = max(1, round(cycle.omega / recurrence.omega))
    near = peaks_near(cycle, recurrence.replace(omega=times * recurrence.omega), least)
    return cycle if near and cycle.verdict != "unstable" else None


def _if_odd(system: System, orbit: Orbit) -> Orbit:
    """Return a recurrence of an odd system's motion without mean and even harmonics where they are small."""
    if not system.odd or not orbit.is_odd(LOPSIDED):
        return orbit
    c = orbit.coefficients.copy()
    c[0] = c[3::4] = c[4::4] = 0.0
    return orbit.replace(coefficients=c)


def _errors(cycle: Orbit, coarse: Orbit) -> dict[str, float]:
    """Return how much a cycle differs from itself with fewer harmonics."""
    change = np.abs(cycle.coefficients - fourier.resize(coarse.coefficients, cycle.H)).sum(axis=0)
    peaks = np.abs(cycle.extremes).max(axis=0)
    moving = peaks > MOVING * peaks.max()
    own = dict(zip(cycle.coordinates, change.tolist(), strict=True))
    return {"omega": abs(cycle.omega - coarse.omega), "waveform": float((change / peaks)[moving].max()), **own}
