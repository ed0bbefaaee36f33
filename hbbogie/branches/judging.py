"""Judging cycles: stability, of the cycle polished by shooting where it is unknown, and error estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hbbogie.model.system import System
from hbbogie.results import Orbit, Stability
from hbbogie.results.branch import Branch
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.stability.multipliers import floquet
from hbbogie.stability.verification import verify

EXACT = 1e-3  # error of the trivial multiplier beyond which a cycle without a verdict is polished
MEETING = 0.2  # distance from 1 of two multipliers that meet there: next to a fold shooting is of no help
NEAR, FAR = 0.01, 0.5  # distance in frequency and, relative to the peaks, in waveform of a polished cycle


def estimate(system: System, branches: Sequence[Branch], H: int, tolerance: float) -> tuple[float, list[str]]:
    """Return the largest error estimate of the least resolved cycles of some branches, and a sentence about it.

    Parameters
    ----------
    system : System
    branches : sequence of Branch
    H : int
        Their highest harmonic.
    tolerance : float
        With which the sentence compares it.
    """
    worst = [max(b.orbits, key=lambda o: o.tail) for b in branches]
    if not worst:
        return 0.0, []
    (error, orbit) = max(((verified(system, o)[1], o) for o in worst), key=lambda pair: pair[0])
    where = ", ".join(f"{b.parameter} = {orbit.parameters[b.parameter]:.6g}" for b in branches[:1])
    meets = "meets" if error <= tolerance else "misses"
    text = f"the error estimate of the least resolved cycle, at {where}, is {error:.1e} and {meets} {tolerance:.0e}"
    return error, [f"Harmonics up to {H}: {text}."]


def stability_of(system: System, orbit: Orbit) -> Stability | None:
    """Return the stability of a cycle; where it is unknown, that of the cycle polished by shooting.

    Parameters
    ----------
    system : System
    orbit : Orbit
        Its stability is taken as it is where it has one.

    Returns
    -------
    Stability or None
        None where the multipliers cannot be computed at all.
    """
    try:
        first = orbit.stability or floquet(system, orbit)
    except FAILURES:
        return None
    return first if clear(first) else polished_stability(system, orbit) or first


def clear(stability: Stability) -> bool:
    """Tell whether a verdict is one, or will not become one for a better cycle, as where two multipliers meet at 1."""
    meeting = np.count_nonzero(np.abs(stability.multipliers - 1) < MEETING) > 1
    return bool(stability.verdict != "unknown" or stability.trivial_error <= EXACT or meeting)


def polished_stability(system: System, orbit: Orbit) -> Stability | None:
    """Return the stability of the cycle that shooting leads to; None where that is another cycle, or none.

    Multipliers of half a period are kept where `floquet` gives them for the orbit.
    """
    try:
        checked = verify(system, orbit)
        if abs(checked.omega_error) > NEAR * orbit.omega or checked.waveform_error > FAR:
            return None
        found = [checked.orbit.stability]
        if orbit.is_odd():
            found.insert(0, floquet(system, checked.orbit))
    except FAILURES:
        return None
    best = next((s for s in found if s is not None and clear(s)), None)
    return best and replace(best, reason=f"{best.reason} Judged on the cycle polished by shooting.")


def verified(system: System, orbit: Orbit) -> tuple[Orbit, float]:
    """Return the orbit with error estimates and their largest, relative; infinite where shooting does not converge."""
    try:
        checked = verify(system, orbit)
    except ConvergenceError as error:
        return orbit.replace(status=f"{orbit.status}; no error estimate: {error}"), np.inf
    errors = {"omega": abs(checked.omega_error), "waveform": checked.waveform_error}
    errors |= {name: abs(e) for name, e in checked.amplitude_errors.items()}
    stability = checked.orbit.stability
    if stability is not None:
        stability = replace(stability, mode=floquet(system, orbit).mode)
    return orbit.replace(errors=errors, stability=stability), max(errors["omega"] / orbit.omega, errors["waveform"])
