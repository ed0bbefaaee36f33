"""Where rest and cycles coexist: the interval between fold and Hopf point, and the disturbance that starts cycles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbbogie.branches.continuation import balanced_trace
from hbbogie.branches.crossing import near_crossings
from hbbogie.brief import brief
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.errors import door
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System
from hbbogie.results import Branch, Criticals, Orbit, SpecialPoint
from hbbogie.results.critical import Critical
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet_of_each

SAME = 0.2  # of the distance from the Hopf point: how far a fold may move with the harmonics
BEGINS = 0.01  # relative distance in value and frequency from its Hopf point up to which a branch begins there


@dataclass(frozen=True, eq=False)
class Coexistence:
    """An interval of a parameter in which the equilibrium is stable and cycles of a branch exist.

    Attributes
    ----------
    parameter : str
    interval : (float, float), unit of the parameter
        Between a fold of the branch, the farthest from it, and the Hopf point, where the equilibrium loses its
        stability.
    thresholds : tuple of Orbit
        The smallest cycle of the branch at values inside the interval, increasing, with its multipliers, but for stable
        ones. Where one of these is outside the unit circle, the cycle lies on a border between motions that come to
        different ends: along its shape larger motions grow and smaller ones shrink. Where several are, it lies on none.
    fold : Critical
        The fold at which the interval ends.
    """

    parameter: str
    interval: tuple[float, float]
    thresholds: tuple[Orbit, ...]
    fold: Critical

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
        Of one parameter, as from `critical_speeds`, whose branches serve again; others are traced.
    points : int
        Values inside the widest interval beside each Hopf point; narrower ones have those of them that lie inside.
    harmonics : int
        Highest harmonic.

    Returns
    -------
    list of Coexistence
        One for each branch that folds on the side of a Hopf point on which the equilibrium is stable, below or above;
        also where the Hopf point is not among the critical values, as it lies beyond those looked at. The farthest
        fold first.
    """
    equations, folds = HarmonicBalance(harmonics).equations(system), [c for c in critical if c.kind == "fold"]
    if not folds:
        return []
    name, known = folds[0].parameter, critical.branches if isinstance(critical, Criticals) else ()
    begins: list[Critical | SpecialPoint] = [c for c in critical if c.kind == "hopf"]
    if not any(_stable_side(system, name, begins, f) for f in folds):  # the Hopf point may lie beyond those looked at
        here = system.with_parameters(**{name: folds[0].value})
        begins += hopf_points(system, name, default_reach(here, name))
    ends: dict[tuple[float, float], tuple[Branch, Critical, float]] = {}
    for branch in _branches(equations, name, begins, folds, known):
        own = [one for one in (_nearest(folds, special, begins) for special in branch.folds()) if one is not None]
        met = [(f, hopf) for f in own if (hopf := _stable_side(system, name, begins, f)) is not None]
        if met:  # two branches from Hopf points may be one, which leads from one to the other
            fold, hopf = max(met, key=lambda pair: abs(pair[0].value - pair[1]))
            ends.setdefault((fold.value, hopf), (branch, fold, hopf))
    found = []
    for branch, fold, hopf in ends.values():
        far = max((value for value, beside in ends if beside == hopf), key=lambda value: abs(value - hopf))
        low, high = sorted((fold.value, hopf))
        values = [float(v) for v in np.linspace(far, hopf, points + 2)[1:-1] if low < v < high]
        orbits = [o for v in sorted(values) if (o := _smallest(equations, branch, v)) is not None]
        found.append(Coexistence(name, (low, high), _unstable(system, orbits), fold))
    return sorted(found, key=lambda c: c.interval)


def _branches(
    equations: Equations,
    name: str,
    begins: Iterable[Critical | SpecialPoint],
    folds: Sequence[Critical],
    known: Sequence[Branch],
) -> list[Branch]:
    """Return the branches that are known, and those from the other Hopf points."""
    branches, system = list(known), equations.system
    for hopf in begins:
        if any(_begins(branch, hopf) for branch in branches):
            continue
        values = [hopf.value, *(f.value for f in folds)]
        room = 0.1 * (max(values) - min(values)) or 1e-3 * max(abs(hopf.value), 1e-6)
        bounds = system.parameter(name).bounds
        span = max(min(values) - room, bounds[0]), min(max(values) + room, bounds[1])
        options: dict[str, Any] = {"families": False, "stability": False, "doubts": False}
        try:
            start = min(hopf_points(system, name, span), key=lambda h: abs(h.value - hopf.value))
            branches.append(balanced_trace(equations, start, name, span, **options))
        except (ConvergenceError, ValueError):  # no cycle of the kept harmonics begins here
            continue
    return branches


def _begins(branch: Branch, hopf: Critical | SpecialPoint) -> bool:
    """Tell whether a branch begins at a Hopf point, or ends there."""
    for small in (branch.orbits[0], branch.orbits[-1]):
        size = max(float(np.ptp(branch.values)), abs(hopf.value))
        near = abs(small.parameters[hopf.parameter] - hopf.value) <= BEGINS * size
        if near and abs(small.omega / hopf.omega - 1) <= BEGINS:
            return True
    return False


def _stable_side(system: System, name: str, begins: Iterable[Critical | SpecialPoint], fold: Critical) -> float | None:
    """Return the Hopf point nearest to a fold up to which the equilibrium is stable from there; None without one."""
    side = 1.0 if fold.extremum == "minimum" else -1.0
    ahead = sorted((h.value for h in begins if side * (h.value - fold.value) > 0), key=lambda v: side * v)
    return ahead[0] if ahead and _rests(system, name, (fold.value, ahead[0])) else None


def _nearest(
    folds: Sequence[Critical], special: SpecialPoint, begins: Iterable[Critical | SpecialPoint]
) -> Critical | None:
    """Return the critical value that is the fold of a branch, a little off with other harmonics; None without one."""
    alike = [f for f in folds if f.extremum == special.extremum]
    near = min(alike, key=lambda f: abs(f.value - special.value), default=None)
    away = min((abs(special.value - hopf.value) for hopf in begins), default=np.inf)
    return near if near is not None and abs(near.value - special.value) <= SAME * away else None


def _smallest(equations: Equations, branch: Branch, value: float) -> Orbit | None:
    """Return the smallest cycle of a branch at a value of its parameter, solved for; None without one."""
    at: dict[str, Any] = {branch.parameter: value}
    for guess in sorted(near_crossings(branch, value), key=_size):
        try:
            return solve(equations, guess, method="newton", **at)
        except ConvergenceError:
            continue
    return None


def _size(orbit: Orbit) -> float:
    return float(np.linalg.norm(orbit.coefficients[1:]))


def _unstable(system: System, orbits: list[Orbit]) -> tuple[Orbit, ...]:
    """Return cycles with their multipliers, without the stable ones, which attract."""
    judged = floquet_of_each(system, orbits) if orbits else []
    return tuple(o.replace(stability=s) for o, s in zip(orbits, judged, strict=True) if s.verdict != "stable")


def _rests(system: System, name: str, ends: tuple[float, float]) -> bool:
    """Tell whether the equilibrium is stable inside an interval: in the middle and near both ends."""
    line = Linearisation(system, name)
    for share in (0.01, 0.5, 0.99):
        values = line.eigen(ends[0] + share * (ends[1] - ends[0]))[0]
        if values[0].real > 1e-9 * np.abs(values).max():
            return False
    return True
