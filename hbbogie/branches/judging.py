"""Judging cycles: stability, of the cycle polished by shooting where it is unknown, and error estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.deadline import time_is_over
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results import Orbit, Stability
from hbbogie.results.branch import Branch
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet, floquet_of_each
from hbbogie.stability.verification import verify

TOGETHER = 8000  # orbits judged together, times the square of the number of states: their matrices are in memory
EXACT = 1e-3  # error of the trivial multiplier beyond which a cycle without a verdict is polished
MEETING = 0.2  # distance from 1 of two multipliers that meet there
MOST = 63  # harmonics with which a cycle without a verdict is solved for again
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
    """Return the stability of a cycle; where it is unknown, that of the cycle with more harmonics, or by shooting.

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
    return stabilities_of(system, [orbit])[0]


def stabilities_of(
    system: System, orbits: Sequence[Orbit], polish: bool = True, level: bool = True
) -> list[Stability | None]:
    """Return what `stability_of` does of each of some orbits, which are judged together.

    Parameters
    ----------
    system : System
    orbits : sequence of Orbit
        The stability of those that have one is taken as it is.
    polish : bool
        Whether to polish cycles whose stability is unknown; otherwise they are judged as they are.
    level : bool
        Whether cycles of a family are judged among motions of their level.

    Returns
    -------
    list of Stability or None
        None where the multipliers cannot be computed at all, or the time limit was reached before.
    """
    found: list[Stability | None] = []
    most = max(1, TOGETHER // system.n_states**2)
    for k in range(0, len(orbits), most):
        some = orbits[k : k + most]
        first = [None for _ in some] if time_is_over() else _judged_together(system, some, level)
        for orbit, stability in zip(some, first, strict=True):
            if polish and stability is not None and not clear(stability) and not time_is_over():
                stability = _better(system, orbit, stability)
            found.append(stability)
    return found


def _better(system: System, orbit: Orbit, stability: Stability) -> Stability:
    """Return the stability of a cycle without a verdict with more harmonics, or by shooting, where that is closer."""
    finer = finer_stability(system, orbit)
    if finer is not None and clear(finer):
        return finer
    meets = _meet(stability.multipliers, MEETING)  # shooting is of no help
    if not meets and (polished := polished_stability(system, orbit)) is not None:
        return polished
    return finer if finer is not None and finer.trivial_error < stability.trivial_error else stability


def _judged_together(system: System, orbits: Sequence[Orbit], level: bool) -> list[Stability | None]:
    """Return the stability of each of some orbits, not polished; None where it cannot be computed."""
    new = [orbit for orbit in orbits if orbit.stability is None]
    try:
        judged = iter(floquet_of_each(system, new, level=level))
    except FAILURES:
        if len(new) == 1:
            return [orbit.stability for orbit in orbits]
        return [one for orbit in orbits for one in _judged_together(system, [orbit], level)]
    return [orbit.stability or next(judged) for orbit in orbits]


def clear(stability: Stability) -> bool:
    """Tell whether a verdict is one, or will not become one for a better cycle, as where two multipliers meet at 1.

    Over half a period those of an odd cycle meet there at a fold, but not at a pitchfork, where one is at -1.
    """
    half = stability.half_multipliers
    meets = _meet(stability.multipliers, MEETING) if half is None else _meet(half, MEETING / 2)
    return stability.verdict != "unknown" or stability.trivial_error <= EXACT or meets


def _meet(multipliers: NDArray[np.complex128], distance: float) -> bool:
    return bool(np.count_nonzero(np.abs(multipliers - 1) < distance) > 1)


def finer_stability(system: System, orbit: Orbit) -> Stability | None:
    """Return the stability of a cycle of harmonic balance with twice the harmonics; None where that is another one."""
    if not orbit.method.startswith("harmonic balance") or orbit.H > MOST // 2:
        return None
    at = system.with_parameters(**orbit.parameters)
    try:
        finer = solve(HarmonicBalance(2 * orbit.H + 1).equations(at), orbit, method="newton")
        found = floquet(system, finer)
    except FAILURES:
        return None
    if abs(finer.omega / orbit.omega - 1) > NEAR:
        return None
    return replace(found, reason=f"{found.reason} Judged on the cycle with harmonics up to {finer.H}.")


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
