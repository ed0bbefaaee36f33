"""Where rest and cycles coexist: the interval between fold and Hopf point, and the disturbance that starts cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import crossings
from hbbogie.brief import brief
from hbbogie.critical.folds import Critical
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.errors import door
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.failure import ConvergenceError

SAME = 0.2  # of the distance from the Hopf point: how far a fold may move with the harmonics


@dataclass(frozen=True, eq=False)
class Coexistence:
    """An interval of a parameter in which the equilibrium is stable and cycles exist.

    Attributes
    ----------
    parameter : str
    interval : (float, float), unit of the parameter
        Between the fold and the Hopf point.
    thresholds : tuple of Orbit
        The smallest cycle at values inside the interval, increasing: it is unstable, and motions along its shape
        that are larger start the cycle, smaller ones die out.
    """

    parameter: str
    interval: tuple[float, float]
    thresholds: tuple[Orbit, ...]

    __repr__ = brief


@door(system=System)
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
        One for each Hopf point whose branch folds on the side on which the equilibrium is stable, below or above; also
        where the Hopf point is not among the critical values, as it lies beyond those looked at.
    """
    equations, folds = HarmonicBalance(harmonics).equations(system), [c for c in critical if c.kind == "fold"]
    found: list[Coexistence] = []
    for hopf in (c for c in critical if c.kind == "hopf" and folds):
        found += _beside(equations, hopf, folds, points)
    for fold in folds:  # the Hopf point of its branch may lie beyond the values looked at
        rests = _rests(system, fold.parameter, (fold.value, fold.value))
        if rests and not any(fold.value in c.interval for c in found):
            here = system.with_parameters(**{fold.parameter: fold.value})
            begins = hopf_points(system, fold.parameter, default_reach(here, fold.parameter))
            for near in sorted(begins, key=lambda h: abs(h.value - fold.value)):
                if new := _beside(equations, near, [fold], points):
                    found += new
                    break
    return found


def _beside(
    equations: Equations, hopf: Critical | SpecialPoint, folds: Sequence[Critical], points: int
) -> list[Coexistence]:
    """Return the interval in which rest and cycles coexist beside a Hopf point; nothing where they do not."""
    system, name, values = equations.system, hopf.parameter, [hopf.value, *(f.value for f in folds)]
    room = 0.1 * (max(values) - min(values)) or 1e-3 * max(abs(hopf.value), 1e-6)
    bounds = system.parameter(name).bounds
    span = max(min(values) - room, bounds[0]), min(max(values) + room, bounds[1])
    try:
        begins = min(hopf_points(system, name, span), key=lambda h: abs(h.value - hopf.value))
        branch = trace(equations, begins, name, span, families=False, stability=False)
    except (ConvergenceError, ValueError):  # no cycle of the kept harmonics begins here
        return []
    for special in branch.folds():
        end = _nearest(folds, special, hopf)
        if end is None or not _rests(system, name, (end.value, hopf.value)):
            continue
        orbits: list[Orbit] = []
        low, high = sorted((end.value, hopf.value))
        for value in np.linspace(low, high, points + 2)[1:-1]:
            at = crossings(equations, branch, float(value))
            orbits += [min(at, key=lambda o: float(np.linalg.norm(o.coefficients[1:])))] if at else []
        return [Coexistence(name, (low, high), tuple(orbits))]
    return []


def _nearest(folds: Sequence[Critical], special: SpecialPoint, hopf: Critical | SpecialPoint) -> Critical | None:
    """Return the critical value that is the fold of a branch, where cycles lie on the side of the Hopf point."""
    side = "minimum" if special.value < hopf.value else "maximum"
    near = min(folds, key=lambda f: abs(f.value - special.value))
    same = abs(near.value - special.value) <= SAME * abs(special.value - hopf.value)
    return near if same and near.extremum == side else None


def _rests(system: System, name: str, ends: tuple[float, float]) -> bool:
    """Tell whether the equilibrium is stable inside an interval: in the middle and near both ends."""
    line = Linearisation(system, name)
    for share in (0.01, 0.5, 0.99):
        values = line.eigen(ends[0] + share * (ends[1] - ends[0]))[0]
        if values[0].real > 1e-9 * np.abs(values).max():
            return False
    return True
