"""Branches of cycles in which one group of bodies moves, or all do: no Hopf point need lead to them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.crossing import crossings
from hbbogie.branches.motions import recurrences, sample_distance
from hbbogie.branches.same import of_prime_period, once_each, signature
from hbbogie.deadline import time_is_over
from hbbogie.methods.equations import Equations
from hbbogie.model.system import System
from hbbogie.motion.energy import alone, group_states, moving_groups
from hbbogie.results import Branch, Orbit
from hbbogie.results.failure import FAILURES
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet

Array = NDArray[np.float64]
REST = 2.0  # errors of the trivial multiplier that another one may be off
SHARES = (0.5, 0.15)  # of the way from the lowest fold to the first Hopf point, at which motions begin
SMALLEST = 1e-3  # size of a state that rests, relative to the largest of its kind


def cycles_of_groups(
    equations: Equations, branches: Sequence[Branch], hopf: Sequence[float]
) -> Iterator[tuple[str, Orbit | None]]:
    """Yield what motions of one group of bodies at a time, and of all, come to where rest is stable and cycles known.

    They begin half the way from the lowest fold to the first Hopf point, and once more next to the lowest fold that is
    known by then: there are cycles to which motions come at one of these values only.

    Parameters
    ----------
    equations : Equations
        Of harmonic balance.
    branches : sequence of Branch
        Over one parameter, from Hopf points. Those that are added meanwhile count, too.
    hopf : sequence of float, unit of the parameter
        The values of the Hopf points.

    Yields
    ------
    (str, Orbit or None)
        What was done, and the cycle that lies on none of the branches, if there is one.
    """
    if len(equations.system.groups) < 2:
        return
    for share in SHARES:
        folds = [s.value for b in branches for s in b.folds() if s.extremum == "minimum" and s.value < min(hopf)]
        if folds:
            yield from _cycles_at(equations, branches, min(folds) + share * (min(hopf) - min(folds)))


def _cycles_at(equations: Equations, branches: Sequence[Branch], value: float) -> Iterator[tuple[str, Orbit | None]]:
    """Yield what motions at a value come to, and the cycle that lies on none of the branches, if there is one."""
    name = branches[0].parameter
    system = equations.system.with_parameters(**{name: value})
    known = [o for b in branches for o in crossings(equations, b, value)]
    marks, size = [signature(o) for o in known], np.zeros(system.n_states)
    for _, x in alone(system, known):
        size = np.maximum(size, np.abs(x))
    size = np.maximum(size, SMALLEST * size.max())
    h = sample_distance(np.linalg.eigvals(system.state_matrix(0 * size, system.vector())).astype(complex))
    for where, x in group_states(system, known):
        said = f"the motion at {name} = {value:.6g} from {where}"
        if time_is_over():
            yield f"{said} was not begun before the time limit", None
            continue
        kind, cycle = _end(equations, system, x, h, size, marks)
        if kind == "known" or (cycle is not None and len(once_each([*known, cycle])) == len(known)):
            yield f"{said} came to a cycle of a branch followed already", None
        elif cycle is None:
            yield f"{said} {kind}", None
        else:
            known.append(cycle)
            marks.append(signature(cycle))
            yield f"{said} came to another cycle ({moving_groups(system, cycle)})", cycle


def _end(
    equations: Equations, system: System, x: Array, h: float, size: Array, marks: list[Array]
) -> tuple[str, Orbit | None]:
    """Return what a motion comes to, in words, or "known", and the cycle of harmonic balance if it is near one."""
    kind, cycle, near = "undecided", None, False
    for met in recurrences(system, x, h, size, marks):
        kind, near = met.kind, met.orbit is not None
        if met.orbit is None or kind == "known":
            continue
        cycle = _confirmed(equations, met.orbit, dict(system.values))
        if cycle is not None and _attracts(system, cycle):  # the motion does not leave it
            break
    if kind == "known":
        return kind, None
    if not near or kind == "rest":
        return "came to rest" if kind == "rest" else "did not come to a cycle", None
    return "came near a cycle that harmonic balance does not confirm", cycle


def _confirmed(equations: Equations, orbit: Orbit, at: dict[str, Any]) -> Orbit | None:
    """Return the cycle of harmonic balance near a recurrence; None where there is none."""
    try:
        return solve(equations, _once_through(orbit), method="newton", **at)
    except FAILURES:
        return None


def _attracts(system: System, cycle: Orbit) -> bool:
    """Tell whether a cycle of few harmonics is stable beyond the error that its trivial multiplier shows."""
    stability = floquet(system, cycle)
    largest = stability.largest()
    return largest is not None and largest + REST * stability.trivial_error < 1


def _once_through(orbit: Orbit) -> Orbit:
    """Return a recurrence of several periods as one period: its largest harmonic is the first."""
    waves = np.hypot(orbit.coefficients[1::2], orbit.coefficients[2::2])
    times = 1 + int(np.argmax(waves.max(axis=1)))
    kept = np.arange(1, orbit.H + 1) % times == 0
    return of_prime_period(orbit.replace(coefficients=orbit.coefficients * np.r_[True, np.repeat(kept, 2)][:, None]))
