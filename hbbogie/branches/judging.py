"""Judging cycles: stability, of the cycle polished by shooting where it is unknown, and error estimates."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.deadline import time_is_over
from hbbogie.methods.equations import Equations
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
EQUALLY = 2.0  # ratio of the distances from 1 of two multipliers that are equally near it
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
        first: list[Stability | None] = [None for _ in some]
        if not time_is_over():
            first = _judged_together(system, some, level)
        doubtful = {i: s for i, s in enumerate(first) if polish and s is not None and not clear(s)}
        finer = finer_stabilities(system, [some[i] for i in doubtful], list(doubtful.values()))
        for i, (stability, settled) in zip(doubtful, finer, strict=True):
            polished = None if settled or time_is_over() else polished_stability(system, some[i])
            first[i] = polished or stability
        found.extend(first)
    return found


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


def finer_stabilities(
    system: System, orbits: Sequence[Orbit], given: Sequence[Stability]
) -> list[tuple[Stability, bool]]:
    """Return the stability of cycles of harmonic balance with more harmonics, and whether shooting is of no more help.

    The harmonics are doubled until it is clear. Where two multipliers meet at 1, or are equally near it and no cycle
    with twice the harmonics is found, the fold is on its other side, and shooting would not find the cycle.
    """
    best = [(stability, _meet(stability.multipliers, MEETING)) for stability in given]
    left = {i: orbit for i, orbit in enumerate(orbits) if orbit.method.startswith("harmonic balance")}
    while left := {i: o for i, o in left.items() if o.H <= MOST // 2 and not time_is_over()}:
        solved = _with_twice_the_harmonics(system, left)
        for i in left.keys() - solved.keys():
            best[i] = best[i][0], best[i][1] or _two_at_1(given[i])
        near = {i: o for i, o in solved.items() if abs(o.omega / orbits[i].omega - 1) <= NEAR}
        left = {}
        for (i, orbit), finer in zip(near.items(), _judged_together(system, list(near.values()), True), strict=True):
            if finer is None:
                continue
            settled = clear(finer)
            if settled or finer.trivial_error < best[i][0].trivial_error:
                reason = f"{finer.reason} Judged on the cycle with harmonics up to {orbit.H}."
                best[i] = replace(finer, reason=reason), best[i][1] or settled
            if not settled:
                left[i] = orbit
    return best


def _two_at_1(stability: Stability) -> bool:
    """Tell whether two multipliers, of half a period where they are known, are equally near 1."""
    half = stability.half_multipliers
    near = np.sort(np.abs((stability.multipliers if half is None else half) - 1))[:2]
    return bool(near[-1] < EQUALLY * near[0])


def _with_twice_the_harmonics(system: System, orbits: dict[int, Orbit]) -> dict[int, Orbit]:
    """Return those cycles that can be solved for with twice the harmonics, without their stability."""
    found: dict[int, Orbit] = {}
    equations: dict[int, Equations] = {}
    for i, orbit in orbits.items():
        with suppress(*FAILURES):
            if orbit.H not in equations:
                at = system.with_parameters(**orbit.parameters)
                equations[orbit.H] = HarmonicBalance(2 * orbit.H + 1).equations(at)
            at_values: dict[str, Any] = dict(orbit.parameters)
            found[i] = solve(equations[orbit.H], orbit, method="newton", **at_values)
    return found


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
