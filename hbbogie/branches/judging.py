"""Judging cycles: stability, with more harmonics where it is unknown, and error estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hbbogie.deadline import time_is_over
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.progress import Progress, silent
from hbbogie.results import Orbit, Stability
from hbbogie.results.branch import Branch
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet
from hbbogie.stability.verification import verify

MOST_HARMONICS = 63  # with which a cycle is judged when fewer do not suffice


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


def judged(system: System, branch: Branch, progress: Progress = silent, message: str = "stability") -> Branch:
    """Return the branch with the stability of every cycle.

    Parameters
    ----------
    system : System
    branch : Branch
    progress : callable
        Called with (message, fraction done).
    message : str
    """
    orbits, neutral = [], {id(s.orbit) for s in branch.special}  # where more harmonics change nothing
    for i, orbit in enumerate(branch.orbits):
        progress(message, i / len(branch))
        kept = id(orbit) in neutral or time_is_over()
        orbits.append(orbit if kept else orbit.replace(stability=stability_of(system, orbit)))
    return branch.with_orbits(orbits)


def stability_of(system: System, orbit: Orbit) -> Stability | None:
    """Return the stability of a cycle; where it is unknown, that of the same cycle with more harmonics.

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
    verdict, finer = first, orbit
    while verdict.verdict == "unknown" and 0 < finer.H <= MOST_HARMONICS // 2:
        try:
            equations = HarmonicBalance(2 * finer.H + 1).equations(system)
            finer = solve(equations, finer, method="newton", **orbit.parameters)  # type: ignore[call-overload]
            if abs(finer.omega - orbit.omega) > 0.01 * orbit.omega:
                break  # another cycle, as may happen close to a fold
            verdict = floquet(system, finer)
        except FAILURES:
            break
    if verdict is first or verdict.verdict == "unknown":
        return first
    return replace(verdict, reason=f"{verdict.reason} Judged with harmonics up to {finer.H}.")


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
