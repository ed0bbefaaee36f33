"""Where rest and cycles coexist: the interval between fold and Hopf point, and the disturbance that starts cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbbogie.continuation import trace
from hbbogie.critical import Critical
from hbbogie.cycles import crossings
from hbbogie.errors import ConvergenceError
from hbbogie.guesses import hopf_points
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.results import Orbit
from hbbogie.system import System


@dataclass(frozen=True, eq=False)
class Coexistence:
    """An interval of a parameter in which the equilibrium is stable and cycles exist.

    Attributes
    ----------
    parameter : str
    interval : (float, float), unit of the parameter
        From the fold to the Hopf point.
    thresholds : tuple of Orbit
        The smallest cycle at values inside the interval, increasing: it is unstable, and motions along its shape
        that are larger start the cycle, smaller ones die out.
    """

    parameter: str
    interval: tuple[float, float]
    thresholds: tuple[Orbit, ...]


def coexistence(
    system: System, critical: Sequence[Critical], *, points: int = 7, harmonics: int = 15
) -> list[Coexistence]:
    """Return the intervals in which rest and cycles coexist, with the size of the disturbance that starts cycles.

    Parameters
    ----------
    system : System
    critical : sequence of Critical
        Of one parameter, as from `critical_speeds`.
    points : int
        Values inside each interval.
    harmonics : int
        Highest harmonic.

    Returns
    -------
    list of Coexistence
        One for each Hopf point whose branch turns back to a fold at a lower value before it rises again.
    """
    equations, found = HarmonicBalance(harmonics).equations(system), []
    folds = [c for c in critical if c.kind == "fold" and c.extremum == "minimum"]
    for hopf in (c for c in critical if c.kind == "hopf"):
        below = [f for f in folds if f.value < hopf.value]
        if not below:
            continue
        name, reach = hopf.parameter, 1e-3 * max(abs(hopf.value), 1e-6)
        low, high = min(f.value for f in below), hopf.value
        begins = hopf_points(system, name, (hopf.value - reach, hopf.value + reach))
        span = (low - 0.1 * (high - low), high + reach)
        try:
            branch = trace(equations, begins[0], name, span, families=False, stability=False)
        except (ConvergenceError, IndexError):
            continue
        if not branch.folds():
            continue
        low = branch.folds()[0].value
        orbits: list[Orbit] = []
        for value in np.linspace(low, high, points + 2)[1:-1]:
            at = crossings(equations, branch, float(value))
            orbits += [min(at, key=lambda o: float(np.linalg.norm(o.coefficients[1:])))] if at else []
        found.append(Coexistence(name, (low, high), tuple(orbits)))
    return found
